//! The ONNX Runtime library: loaded by path, checked, and kept for the life of the process.

use std::ffi::CStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::locks::Mutex;

use super::failure::ort_failure;
use super::library_search;
use super::pin::pin_this_library;
use crate::libraries::canonical;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// The release series that this build supports, as ONNX Runtime writes it.
const SERIES: &str = "1.24.";

/// ONNX Runtime allows one environment per process, so the first library that loads stays.
static LOADED: Mutex<Option<Ort>> = Mutex::new(None);

/// A loaded ONNX Runtime 1.24.x. Cheap to clone; every clone is the same library.
///
/// Threads: may be used from any thread at any time.
#[derive(Clone)]
pub struct Ort(Arc<Inner>);

struct Inner {
    path: PathBuf,
    version: String,
    environment: ort::environment::Environment,
}

impl Ort {
    /// Loads the library at `path` and starts its environment. Loading the same file again gives the same [`Ort`].
    ///
    /// # Errors
    /// `RuntimeMissing` when the file does not exist, is not ONNX Runtime, or its version is not 1.24.x; `Unsupported` when this
    /// process already uses another ONNX Runtime file; `Device` when its environment does not start.
    pub fn load(path: &Path) -> Result<Ort> {
        let path = canonical(path).map_err(|e| missing(path, &format!("cannot be opened: {e}")))?;
        let mut loaded = LOADED.lock();
        if let Some(ort) = loaded.as_ref() {
            return if ort.0.path == path {
                Ok(ort.clone())
            } else {
                Err(Error::new(
                    ErrorKind::Unsupported,
                    format!("this process already uses the ONNX Runtime at {}", ort.0.path.display()),
                )
                .field(path.display().to_string())
                .remedy("Use one ONNX Runtime file in one process"))
            };
        }
        report_others(&path);
        let CheckedLibrary { version, library } = CheckedLibrary::open(&path)?;
        let builder = ort::init_from(&path).map_err(|e| missing(&path, &e.to_string()))?;
        let environment = builder
            .with_name("cairn")
            .with_telemetry(false)
            .with_logger(Arc::new(forward_log))
            .build()
            .map_err(|e| ort_failure("start its environment", &e))?;
        // With a logger, the environment starts at the most verbose level.
        environment.set_log_level(ort::logging::LogLevel::Warning);
        // ONNX Runtime must never be unloaded, because sessions run its code. Nor must this library, because the environment calls
        // its logger.
        std::mem::forget(library);
        pin_this_library();
        let ort = Ort(Arc::new(Inner { path, version, environment }));
        *loaded = Some(ort.clone());
        Ok(ort)
    }

    /// Finds ONNX Runtime and loads it. If `search` names a file, only that one is tried. Else the first existing file is used:
    /// beside this library, then beside the program. If the environment may name libraries, the file that the variable
    /// `CAIRN_ONNXRUNTIME` names replaces both, and `<cache>/cairn/onnxruntime-1.24.4/` is searched after them, where `<cache>` is
    /// `$CAIRN_CACHE_DIR`, else `$XDG_CACHE_HOME` or `~/.cache` (on Windows `%LOCALAPPDATA%`). The system's library path is never
    /// searched: it often holds a library of another version.
    ///
    /// # Errors
    /// As [`Ort::load`]; `RuntimeMissing` lists the paths that were tried.
    pub fn find(search: &LibrarySearch) -> Result<Ort> {
        match library_search::library(search) {
            Ok(path) => Self::load(&path),
            Err(tried) => {
                let tried: Vec<_> = tried.iter().map(|p| p.display().to_string()).collect();
                let mut cause = format!("ONNX Runtime was not found; looked at {}", tried.join(", "));
                if let Some(own) = system_copy() {
                    cause.push_str(&format!("; {own} is the system's and never used"));
                }
                if !search.environment && std::env::var_os(library_search::VARIABLE).is_some() {
                    cause.push_str(&format!(
                        "; {} is set, but this host lets it name no library",
                        library_search::VARIABLE
                    ));
                }
                Err(Error::new(ErrorKind::RuntimeMissing, cause).field(library_search::VARIABLE).remedy(REMEDY))
            }
        }
    }

    /// The file it was loaded from, canonical.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Its version, e.g. `1.24.4`.
    pub fn version(&self) -> &str {
        &self.0.version
    }

    pub(super) fn environment(&self) -> &ort::environment::Environment {
        &self.0.environment
    }
}

impl std::fmt::Debug for Ort {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Ort({} at {})", self.version(), self.path().display())
    }
}

const REMEDY: &str = "Put the library file of ONNX Runtime 1.24.4 (`cargo xtask setup` fetches it; on Windows with its DirectML.dll) \
                      beside this library, name it in the device's options, or, where the host lets the environment name \
                      libraries, in CAIRN_ONNXRUNTIME";

fn missing(path: &Path, why: &str) -> Error {
    Error::new(ErrorKind::RuntimeMissing, format!("ONNX Runtime {why}"))
        .field(path.display().to_string())
        .remedy(REMEDY)
}

/// A library whose version and interface were checked: the `ort` crate only asserts them.
struct CheckedLibrary {
    version: String,
    library: libloading::Library,
}

impl CheckedLibrary {
    fn open(path: &Path) -> Result<Self> {
        if !path.is_file() {
            return Err(missing(path, "is not a file"));
        }
        let library = open(path).map_err(|e| missing(path, &format!("cannot be loaded as a library: {e}")))?;
        type GetApiBase = unsafe extern "system" fn() -> *const ort::sys::OrtApiBase;
        // SAFETY: the symbol has this type in every release of ONNX Runtime.
        let base = unsafe { library.get::<GetApiBase>(b"OrtGetApiBase\0") }
            .map_err(|_| missing(path, "was expected, but this library does not export OrtGetApiBase"))?;
        // SAFETY: takes nothing and returns a static table or null.
        let base = unsafe { base() };
        // SAFETY: null or a static table that lives as long as `library`.
        let base =
            unsafe { base.as_ref() }.ok_or_else(|| missing(path, "gave no interface (OrtGetApiBase is null)"))?;
        // SAFETY: takes nothing and returns a static string or null.
        let version = unsafe { (base.GetVersionString)() };
        if version.is_null() {
            return Err(missing(path, "does not say its version"));
        }
        // SAFETY: not null, NUL-terminated and static by ONNX Runtime's contract.
        let version = unsafe { CStr::from_ptr(version) }.to_string_lossy().into_owned();
        if !version.starts_with(SERIES) {
            return Err(missing(
                path,
                &format!("{version} is {} than the {SERIES}x this build is made for", age(&version)),
            ));
        }
        // SAFETY: any version may be requested; an unknown one gives null.
        if unsafe { (base.GetApi)(ort::sys::ORT_API_VERSION) }.is_null() {
            return Err(missing(
                path,
                &format!("{version} does not offer interface version {}", ort::sys::ORT_API_VERSION),
            ));
        }
        Ok(Self { version, library })
    }
}

/// Loads a library. Its dependencies are searched beside it and in the system directory, and neither beside the program, in the
/// working directory nor along the PATH.
#[cfg(windows)]
fn open(path: &Path) -> Result<libloading::Library, libloading::Error> {
    use libloading::os::windows::{LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR, LOAD_LIBRARY_SEARCH_SYSTEM32, Library};

    let search = LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR | LOAD_LIBRARY_SEARCH_SYSTEM32;
    // SAFETY: runs the initialisers of a library the caller named as ONNX Runtime; that trust is the caller's.
    unsafe { Library::load_with_flags(path, search) }.map(Into::into)
}

/// Loads a library.
#[cfg(not(windows))]
fn open(path: &Path) -> Result<libloading::Library, libloading::Error> {
    // SAFETY: runs the initialisers of a library the caller named as ONNX Runtime; that trust is the caller's.
    unsafe { libloading::Library::new(path) }
}

/// Logs a warning if the process has loaded another ONNX Runtime file; ours is loaded in addition.
#[cfg(windows)]
fn report_others(ours: &Path) {
    use super::module;
    let other = module::loaded(windows::core::w!("onnxruntime.dll"))
        .filter(|other| canonical(&other.path).is_ok_and(|path| path != ours));
    if let Some(other) = other {
        log::warn!("another ONNX Runtime is in this process and is not used: {}", module::described(&other.path));
    }
}

/// Not available on other systems, which do not identify a loaded library by its file name.
#[cfg(not(windows))]
fn report_others(_: &Path) {}

/// Path and version of the old ONNX Runtime that comes with Windows.
#[cfg(windows)]
fn system_copy() -> Option<String> {
    let path = PathBuf::from(std::env::var_os("SystemRoot")?).join("System32").join("onnxruntime.dll");
    path.is_file().then(|| super::module::described(&path))
}

/// Other systems have none.
#[cfg(not(windows))]
fn system_copy() -> Option<String> {
    None
}

/// Compares a version outside the series with it: `older`, `newer` or, if it cannot be parsed, `other`.
fn age(version: &str) -> &'static str {
    let part = |text: &str, i: usize| text.split('.').nth(i).and_then(|p| p.parse::<u32>().ok());
    let pair = |text: &str| part(text, 0).zip(part(text, 1));
    match (pair(version), pair(SERIES)) {
        (Some(found), Some(wanted)) if found < wanted => "older",
        (Some(found), Some(wanted)) if found > wanted => "newer",
        _ => "other",
    }
}

fn forward_log(level: ort::logging::LogLevel, category: &str, _id: &str, location: &str, message: &str) {
    use ort::logging::LogLevel;
    let level = match level {
        LogLevel::Verbose => log::Level::Trace,
        LogLevel::Info => log::Level::Debug,
        LogLevel::Warning => log::Level::Warn,
        LogLevel::Error | LogLevel::Fatal => log::Level::Error,
    };
    log::log!(target: "cairn::onnxruntime", level, "{category} {location}: {message}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_by_number() {
        assert_eq!(age("1.9.0"), "older");
        assert_eq!(age("0.99.1"), "older");
        assert_eq!(age("1.25.0"), "newer");
        assert_eq!(age("2.0.0"), "newer");
        assert_eq!(age("nonsense"), "other");
    }
}
