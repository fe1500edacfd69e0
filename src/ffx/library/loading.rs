//! Loads AMD's libraries, and reports the files found.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use super::module::Module;
use super::{LibraryKind, search, signature};
use crate::ffx::{Api, Effect};
use crate::libraries::FileVersion;
use crate::libraries::own_folders;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// Where AMD's libraries are loaded from.
#[derive(Debug, Clone)]
pub struct LoadOptions {
    /// Their folder; None for this library's folder, else the program's.
    pub directory: Option<PathBuf>,
    /// Loads only unaltered files signed by AMD. If false, any file of the right name is loaded, also a user's replacement.
    pub signed: bool,
}

/// Whether [`LoadOptions::of_host`] loads signed libraries only.
static HOST_WANTS_SIGNED: AtomicBool = AtomicBool::new(true);

impl Default for LoadOptions {
    /// Signed libraries beside this one, or beside the program.
    fn default() -> Self {
        Self { directory: None, signed: true }
    }
}

impl LoadOptions {
    /// The options of tools, which have no host: the folder in `CAIRN_FFX_DIR`, if set. Files that AMD has not signed are loaded
    /// only if `CAIRN_FFX_UNSIGNED` is 1.
    pub fn from_environment() -> Self {
        let is_unsigned = std::env::var_os("CAIRN_FFX_UNSIGNED").is_some_and(|value| value == "1");
        Self { directory: search::configured_folder(&LibrarySearch::for_tools()), signed: !is_unsigned }
    }

    /// The options of the C interface: the folder that the host names, else the one in `CAIRN_FFX_DIR`, if the host lets the
    /// environment name libraries. Signed libraries only, whatever the environment says.
    pub fn of_host(search: &LibrarySearch) -> Self {
        Self { directory: search::configured_folder(search), signed: HOST_WANTS_SIGNED.load(Ordering::Relaxed) }
    }
}

/// Makes the C interface load libraries that AMD has not signed too, in this process from now on: for tests, and for Rust programs
/// whose user replaces AMD's libraries. C hosts cannot ask for it.
pub fn allow_unsigned_in_host() {
    HOST_WANTS_SIGNED.store(false, Ordering::Relaxed);
}

/// A file that was found.
#[derive(Debug, Clone)]
pub struct File {
    /// Its purpose.
    pub kind: LibraryKind,
    /// Its path.
    pub path: PathBuf,
    /// The version in its version resource.
    pub version: Option<FileVersion>,
    /// Its signer, if the signature was checked.
    pub signer: Option<String>,
    /// Why it is not used, if it is not.
    pub fault: Option<Error>,
}

/// AMD's libraries in this process.
///
/// Threads: may be used from any thread at any time.
#[derive(Debug, Clone)]
pub struct Library {
    files: Vec<File>,
    /// For each effect, the library that its calls go to, and that library's functions.
    entry_points: [Option<(LibraryKind, Api)>; Effect::ALL.len()],
}

impl Library {
    /// Loads the libraries in the folder. Each effect's library is loaded by path before AMD's loader, which loads it by name. If
    /// another file of that name is already in the process, the effect's own functions are called and the loader is not used. The
    /// library of SDK 1.1 serves the effects that have no other.
    ///
    /// # Errors
    /// `RuntimeMissing` when no folder holds any of them, or none of the files can be used; it is the first file's error, and
    /// [`File::fault`] has each.
    pub fn load(options: &LoadOptions) -> Result<Self> {
        let folder = search::folder(options.directory.as_deref(), &own_folders())?;
        let mut loading = Loading { folder, signed: options.signed, files: Vec::new() };
        let mut entry_points = [None; Effect::ALL.len()];
        let mut effects = Vec::new();
        for (entry_point, effect) in entry_points.iter_mut().zip(Effect::ALL) {
            let kind = LibraryKind::of(effect);
            if let Some((module, api)) = loading.open(kind) {
                *entry_point = Some((kind, api));
                effects.push((kind, module));
            }
        }
        if !effects.is_empty()
            && loading.may_use_loader(&effects)
            && let Some((_, api)) = loading.open(LibraryKind::Loader)
        {
            for entry_point in entry_points.iter_mut().flatten() {
                *entry_point = (LibraryKind::Loader, api);
            }
        }
        if entry_points.iter().any(Option::is_none)
            && let Some((_, api)) = loading.open(LibraryKind::Whole)
        {
            for entry_point in entry_points.iter_mut().filter(|entry_point| entry_point.is_none()) {
                *entry_point = Some((LibraryKind::Whole, api));
            }
        }
        let files = loading.files;
        for file in files.iter().filter(|file| file.fault.is_some()) {
            log::warn!(target: "cairn::ffx", "{} is not used: {:?}", file.path.display(), file.fault);
        }
        if entry_points.iter().all(Option::is_none) {
            let fault = files.into_iter().find_map(|file| file.fault);
            return Err(fault.unwrap_or_else(|| {
                Error::new(ErrorKind::RuntimeMissing, "AMD's loader is there without the library of an effect")
                    .field(LibraryKind::Loader.file_name())
                    .remedy("Put amd_fidelityfx_framegeneration_dx12.dll beside it")
            }));
        }
        Ok(Self { files, entry_points })
    }

    /// The functions that serve `effect`.
    ///
    /// # Errors
    /// `RuntimeMissing` when its library is missing or cannot be used.
    pub fn api(&self, effect: Effect) -> Result<&Api> {
        let entry_point = self.entry_points.iter().zip(Effect::ALL).find(|(_, of)| *of == effect);
        entry_point.and_then(|(entry_point, _)| entry_point.as_ref()).map(|(_, api)| api).ok_or_else(|| {
            let kind = LibraryKind::of(effect);
            let fault = self.files.iter().find(|file| file.kind == kind).and_then(|file| file.fault.clone());
            fault.unwrap_or_else(|| {
                Error::new(ErrorKind::RuntimeMissing, format!("AMD's library of {effect} is not there"))
                    .field(kind.file_name())
                    .remedy("Put it beside the others")
            })
        })
    }

    /// The library that calls for `effect` go to.
    pub fn serves(&self, effect: Effect) -> Option<LibraryKind> {
        self.entry_points
            .iter()
            .zip(Effect::ALL)
            .find(|(_, of)| *of == effect)
            .and_then(|(entry_point, _)| Some(entry_point.as_ref()?.0))
    }

    /// The files that were found.
    pub fn files(&self) -> &[File] {
        &self.files
    }
}

/// The state of loading: the folder, and the files found so far.
struct Loading {
    folder: PathBuf,
    signed: bool,
    files: Vec<File>,
}

impl Loading {
    /// Loads one library, if its file exists and can be used.
    fn open(&mut self, kind: LibraryKind) -> Option<(Module, Api)> {
        let path = self.folder.join(kind.file_name());
        if !path.is_file() {
            return None;
        }
        let mut file = File { kind, version: FileVersion::read(&path), signer: None, fault: None, path };
        let opened = open(&mut file, self.signed);
        let opened = opened.map_err(|fault| file.fault = Some(fault)).ok();
        self.files.push(file);
        opened
    }

    /// Whether AMD's loader would find exactly the effect libraries that were loaded, and no others of their names.
    fn may_use_loader(&mut self, effects: &[(LibraryKind, Module)]) -> bool {
        let other = effects.iter().find_map(|&(kind, module)| {
            let namesake = Module::namesakes(kind.file_name()).into_iter().find(|other| *other != module);
            namesake.map(Module::path)
        });
        let path = self.folder.join(LibraryKind::Loader.file_name());
        if let (Some(other), true) = (&other, path.is_file()) {
            let cause = format!(
                "it would perhaps use another library of the same name, which is loaded already: {}",
                other.display()
            );
            let fault = Error::new(ErrorKind::Unsupported, cause)
                .field(path.display().to_string())
                .remedy("Give Cairn and the engine the same folder");
            let version = FileVersion::read(&path);
            self.files.push(File { kind: LibraryKind::Loader, version, signer: None, fault: Some(fault), path });
        }
        other.is_none()
    }
}

fn open(file: &mut File, signed: bool) -> Result<(Module, Api)> {
    // The file is held open until it is loaded, so that the checked bytes are the loaded ones.
    let held = if signed { Some(signature::check(&file.path)?) } else { None };
    file.signer = held.as_ref().map(|signed| signed.signer.clone());
    let module = Module::load(&file.path)?;
    // SAFETY: a library with AMD's name, which the caller chose; it is never unloaded.
    let api = unsafe { Api::from_exports(|name| module.symbol(name)) }.map_err(|missing| {
        let names: Vec<_> = missing.iter().map(|name| name.to_string_lossy()).collect();
        Error::new(
            ErrorKind::RuntimeMissing,
            format!("it is no library of ffx-api: it does not export {}", names.join(", ")),
        )
        .field(file.path.display().to_string())
        .remedy("Use AMD's own file")
    })?;
    Ok((module, api))
}
