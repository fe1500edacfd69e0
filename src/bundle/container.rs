//! Sources of a bundle's bytes: a directory, an archive, or memory.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::archive::{self, Entry};
use super::{MANIFEST_NAME, damaged, names};
use crate::{Error, ErrorKind, Result, allocate};

/// Read size: small enough for frequent progress reports and prompt cancellation.
const CHUNK: usize = 1 << 20;

/// Named files of known sizes. Callers pass only names that [`names::violation`] accepts.
pub(super) enum Container {
    Directory(PathBuf),
    Archive { file: File, entries: BTreeMap<String, Entry> },
    Memory(BTreeMap<String, Cow<'static, [u8]>>),
}

impl Container {
    /// The bundle at `path`.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let path_text = path.display().to_string();
        let found = fs::metadata(path).map_err(|error| io_error(&path_text, &error))?;
        if found.is_dir() {
            return Ok(Self::Directory(path.to_path_buf()));
        }
        if !found.is_file() {
            return Err(Error::new(ErrorKind::InvalidBundle, "this is neither a directory nor a file")
                .field(path_text)
                .remedy(format!("Give the directory that holds {MANIFEST_NAME}, or an archive of it")));
        }
        let mut file = File::open(path).map_err(|error| io_error(&path_text, &error))?;
        let entries = archive::directory(&mut file, found.len())?;
        Ok(Self::Archive { file, entries })
    }

    /// An archive in memory.
    pub(super) fn from_archive(bytes: Cow<'static, [u8]>) -> Result<Self> {
        let entries = archive::directory(&mut Cursor::new(&bytes), bytes.len() as u64)?;
        let mut files = BTreeMap::new();
        for (name, entry) in entries {
            let outside = || damaged(&name, "the entry lies outside the archive");
            let part = match &bytes {
                Cow::Borrowed(all) => {
                    Cow::Borrowed(entry.range().and_then(|range| all.get(range)).ok_or_else(outside)?)
                }
                Cow::Owned(all) => {
                    let part = entry.range().and_then(|range| all.get(range)).ok_or_else(outside)?;
                    Cow::Owned(allocate::copy_of(part)?)
                }
            };
            if name == MANIFEST_NAME {
                archive::check_manifest(&part, &entry)?;
            }
            files.insert(name, part);
        }
        Ok(Self::Memory(files))
    }

    /// Files in memory.
    pub(super) fn from_memory(files: Vec<(String, Cow<'static, [u8]>)>) -> Result<Self> {
        let mut map = BTreeMap::new();
        for (name, bytes) in files {
            if let Some(fault) = names::violation(&name) {
                return Err(Error::new(ErrorKind::InvalidArgument, fault)
                    .field(name.escape_debug().to_string())
                    .remedy("Give names as docs/bundle.md section 1 says"));
            }
            if map.insert(name.clone(), bytes).is_some() {
                return Err(Error::new(ErrorKind::InvalidArgument, "the file is given twice")
                    .field(name)
                    .remedy("Give each file once"));
            }
        }
        Ok(Self::Memory(map))
    }

    /// Whether reading a file allocates memory.
    pub(super) fn allocates_on_read(&self) -> bool {
        !matches!(self, Self::Memory(_))
    }

    /// The size of a file, without reading it.
    pub(super) fn size(&self, name: &str) -> Result<u64> {
        match self {
            Self::Directory(root) => {
                let found = fs::metadata(root.join(name)).map_err(|error| missing_or_io(name, &error))?;
                if !found.is_file() {
                    return Err(damaged(name, "this is no regular file"));
                }
                Ok(found.len())
            }
            Self::Archive { entries, .. } => entries.get(name).map(Entry::size).ok_or_else(|| missing(name)),
            Self::Memory(files) => files.get(name).map(|bytes| bytes.len() as u64).ok_or_else(|| missing(name)),
        }
    }

    /// Reads a whole file, which must have `size` bytes. A file in memory is moved out, so each file is read once. `sink` gets all bytes once and in order; an error from it stops the reading.
    pub(super) fn read(
        &mut self,
        name: &str,
        size: u64,
        sink: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<Cow<'static, [u8]>> {
        match self {
            Self::Directory(root) => {
                let file = File::open(root.join(name)).map_err(|error| missing_or_io(name, &error))?;
                // Check the size of the open file again: a pipe in its place would never end.
                let found = file.metadata().map_err(|error| missing_or_io(name, &error))?;
                if !found.is_file() || found.len() != size {
                    return Err(damaged(name, "the file changed while it was opened"));
                }
                read_stream(file, name, size, sink).map(Cow::Owned)
            }
            Self::Archive { file, entries } => {
                let entry = entries.get(name).filter(|entry| entry.size() == size).ok_or_else(|| missing(name))?;
                file.seek(SeekFrom::Start(entry.data.start)).map_err(|error| io_error(name, &error))?;
                let bytes = read_stream(file, name, size, sink)?;
                if name == MANIFEST_NAME {
                    archive::check_manifest(&bytes, entry)?;
                }
                Ok(Cow::Owned(bytes))
            }
            Self::Memory(files) => {
                let bytes = files.remove(name).ok_or_else(|| missing(name))?;
                if bytes.len() as u64 != size {
                    return Err(damaged(name, "the file has another size than before"));
                }
                bytes.chunks(CHUNK).try_for_each(sink)?;
                Ok(bytes)
            }
        }
    }
}

/// `size` bytes of `stream`, allocated once.
fn read_stream(
    mut stream: impl Read,
    name: &str,
    size: u64,
    sink: &mut dyn FnMut(&[u8]) -> Result<()>,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let len = usize::try_from(size).map_err(|_| too_large(name, size))?;
    bytes.try_reserve_exact(len).map_err(|_| too_large(name, size))?;
    while bytes.len() < len {
        let start = bytes.len();
        let part = CHUNK.min(len - start);
        let got = stream.by_ref().take(part as u64).read_to_end(&mut bytes).map_err(|error| io_error(name, &error))?;
        if got != part {
            return Err(damaged(name, format!("the file ends after {} of {size} bytes", bytes.len())));
        }
        sink(&bytes[start..])?;
    }
    Ok(bytes)
}

fn too_large(name: &str, size: u64) -> Error {
    Error::new(ErrorKind::OutOfMemory, format!("{size} bytes cannot be allocated"))
        .field(name)
        .remedy("Free memory, or use a smaller bundle")
}

fn missing(name: &str) -> Error {
    damaged(name, "the file is not in the bundle")
}

fn missing_or_io(name: &str, error: &io::Error) -> Error {
    if error.kind() == io::ErrorKind::NotFound { missing(name) } else { io_error(name, error) }
}

fn io_error(name: &str, error: &io::Error) -> Error {
    Error::new(ErrorKind::Io, error.to_string()).field(name).remedy("Check that the file is there and may be read")
}
