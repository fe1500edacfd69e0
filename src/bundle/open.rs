//! Opens a bundle: reads and checks its parts in order.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use sha2::{Digest, Sha256};

use super::container::Container;
use super::{Bundle, FileEntry, MANIFEST_NAME, Manifest, Model, available_memory, damaged, manifest_check, onnx};
use crate::{Error, ErrorKind, Result};

/// Options of [`Bundle::open_with`].
#[derive(Default, Clone, Copy)]
pub struct OpenOptions<'a> {
    /// Called from the opening thread after every mebibyte or file.
    pub progress: Option<&'a dyn Fn(OpenProgress)>,
    /// Stops the reading when it becomes true; any thread may set it, `progress` too.
    pub cancel: Option<&'a AtomicBool>,
    /// Maximum total size of all files in bytes; `None`: limited only by memory.
    pub max_bytes: Option<u64>,
}

/// Progress of opening.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenProgress {
    /// Bytes read and checked.
    pub done: u64,
    /// Bytes of all files.
    pub total: u64,
}

/// Reads and checks the whole bundle.
pub(super) fn load(mut container: Container, options: &OpenOptions<'_>) -> Result<Bundle> {
    let (manifest, digest) = read_manifest(&mut container)?;
    let total = check_sizes(&container, &manifest, options)?;
    let mut reader = Reader { container, options, done: 0, total };
    let mut files = BTreeMap::new();
    // Models first, so that a bad one is refused before weights are read.
    let (mut models, mut scales) = (Vec::new(), BTreeMap::<String, Vec<_>>::new());
    for (precision, kind, path) in manifest.graphs.paths() {
        let Some(entry) = manifest.file(path) else { continue };
        let bytes = reader.read(entry)?;
        let context = onnx::ModelContext { manifest: &manifest, kind, precision };
        let onnx::ExternalData { external, scales: found } = onnx::check(&bytes, context)?;
        for found in found {
            let file = external.iter().find(|(location, _)| *location == found.location);
            let file = file.map(|(_, file)| file.clone()).unwrap_or_default();
            scales.entry(file).or_default().push((context, found));
        }
        models.push(Model { kind, precision, path: path.to_owned(), external });
        files.insert(path.to_owned(), bytes);
    }
    for entry in &manifest.files {
        if !files.contains_key(&entry.path) {
            files.insert(entry.path.clone(), reader.read(entry)?);
        }
    }
    for (file, scales) in &scales {
        check_cancel(options)?;
        let bytes = files.get(file).map_or(&[][..], AsRef::as_ref);
        let of_file: Vec<_> = scales.iter().map(|(_, scales)| scales).collect();
        onnx::check_scales(&of_file, bytes).map_err(|(i, cause)| scales[i].0.invalid(cause))?;
    }
    Ok(Bundle { manifest, digest, files, models })
}

fn read_manifest(container: &mut Container) -> Result<(Manifest, String)> {
    let size = container.size(MANIFEST_NAME)?;
    if size > manifest_check::MAX_MANIFEST {
        return Err(damaged(MANIFEST_NAME, format!("{size} bytes are more than a manifest may have")));
    }
    let bytes = container.read(MANIFEST_NAME, size, &mut |_| Ok(()))?;
    Ok((manifest_check::read_manifest(&bytes)?, hex(&Sha256::digest(&bytes))))
}

/// Checks every size against the manifest, and the sum against the limit, before reading any file.
fn check_sizes(container: &Container, manifest: &Manifest, options: &OpenOptions<'_>) -> Result<u64> {
    let mut total = 0_u64;
    for entry in &manifest.files {
        let found = container.size(&entry.path)?;
        if found != entry.size {
            return Err(damaged(&entry.path, format!("the file has {found} bytes, the manifest says {}", entry.size)));
        }
        total = total.checked_add(found).ok_or_else(|| damaged(&entry.path, "the sizes of all files overflow"))?;
    }
    // Without this check, a system that overcommits memory would kill the process instead.
    let limit = options.max_bytes.into_iter().chain(available_memory().filter(|_| container.allocates_on_read())).min();
    if let Some(limit) = limit.filter(|&limit| total > limit) {
        return Err(Error::new(
            ErrorKind::OutOfMemory,
            format!("the bundle's files have {total} bytes, the limit is {limit}"),
        )
        .field("files")
        .remedy("Free memory or raise the limit, or use a smaller bundle"));
    }
    Ok(total)
}

struct Reader<'a> {
    container: Container,
    options: &'a OpenOptions<'a>,
    done: u64,
    total: u64,
}

impl Reader<'_> {
    /// Reads one file and checks its SHA-256 against the manifest.
    fn read(&mut self, entry: &FileEntry) -> Result<Cow<'static, [u8]>> {
        let mut hash = Sha256::new();
        let Self { container, options, done, total } = self;
        check_cancel(options)?;
        let bytes = container.read(&entry.path, entry.size, &mut |part| {
            hash.update(part);
            *done += part.len() as u64;
            if let Some(progress) = options.progress {
                progress(OpenProgress { done: *done, total: *total });
            }
            check_cancel(options)
        })?;
        if hex(&hash.finalize()) != entry.sha256 {
            return Err(damaged(&entry.path, "the SHA-256 is not the one in the manifest"));
        }
        Ok(bytes)
    }
}

fn check_cancel(options: &OpenOptions<'_>) -> Result<()> {
    if options.cancel.is_some_and(|flag| flag.load(Ordering::Relaxed)) {
        return Err(Error::new(ErrorKind::Cancelled, "opening the bundle was cancelled"));
    }
    Ok(())
}

/// Lower-case hex.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
