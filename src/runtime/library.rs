//! The ONNX Runtime library: loaded by path, checked, and kept for the life of the process.

use std::ffi::CStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::quiet_mutex::QuietMutex;

use super::failure::ort_failure;
use super::library_search;
use super::pin::pin_this_library;
use super::self_test;
use crate::libraries::canonical;
#[cfg(windows)]
use crate::libraries::load_refusal;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// The oldest release that offers the interface version of this build, as its major and minor version. Later releases offer it, too.
const OLDEST: (u32, u32) = (1, ort::sys::ORT_API_VERSION);

/// The versions that worlds are tested with, the newest last.
const TESTED: [&str; 2] = ["1.24.4", "1.32.0"];

/// The file that this process uses. ONNX Runtime allows one environment per process, so the first file that is started stays, also if it
/// fails after that.
static STARTED: QuietMutex<Option<Started>> = QuietMutex::new(None);

/// A library that was started. Calls that failed are repeated when the same file is loaded again.
struct Started {
    path: PathBuf,
    version: String,
    /// Present once its environment has started.
    ort: Option<Ort>,
    /// Whether it has passed the self-test.
    is_tested: bool,
}

/// A loaded ONNX Runtime 1.24 or newer. Cheap to clone; every clone is the same library.
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
    /// Loads the library at `path`, starts its environment and runs a small graph, whose result must be right. Loading the same file
    /// again gives the same [`Ort`].
    ///
    /// Versions 1.24.4 and 1.32.0 are tested. Another one from 1.24 on is used if it offers the interface of 1.24 and passes the
    /// self-test; one newer than 1.32 also logs a warning.
    ///
    /// # Errors
    /// `RuntimeMissing` when the file does not exist, is not ONNX Runtime, is older than 1.24, does not offer its interface, or fails the
    /// self-test; `Unsupported` when this process already uses another ONNX Runtime file, also if that one failed to start; `Device`
    /// when its environment does not start; `OutOfMemory`.
    pub fn load(path: &Path) -> Result<Ort> {
        let path = canonical(path).map_err(|e| missing(path, &format!("cannot be opened: {e}")))?;
        let mut held = STARTED.lock();
        if let Some(started) = held.as_ref().filter(|started| started.path != path) {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!("this process already uses the ONNX Runtime at {}", started.path.display()),
            )
            .field(path.display().to_string())
            .remedy("Use one ONNX Runtime file in one process"));
        }
        let started = match &mut *held {
            Some(started) => started,
            none => none.insert(Started::open(path)?),
        };
        started.ready()
    }

    /// Finds ONNX Runtime and loads it. If `search` names a file, only that one is tried. Else the first existing file is used:
    /// beside this library, then beside the program. In a folder on Linux this is the file of the highest version from 1.24 on, such as
    /// `libonnxruntime.so.1.24.4`, else `libonnxruntime.so.1`, else `libonnxruntime.so`. If the environment may name libraries, the file that the variable
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

impl Started {
    /// Checks the library and gives it to the `ort` crate, which keeps it until the process ends.
    fn open(path: PathBuf) -> Result<Self> {
        report_others(&path);
        let CheckedLibrary { version, library } = CheckedLibrary::open(&path)?;
        if is_newer_than_tested(&version) {
            let path = path.display();
            log::warn!(
                "ONNX Runtime {version} at {path} is newer than the versions that are tested: {}",
                TESTED.join(", ")
            );
        }
        drop(ort::init_from(&path).map_err(|e| missing(&path, &e.to_string()))?);
        // ONNX Runtime must never be unloaded, because sessions run its code.
        std::mem::forget(library);
        Ok(Self { path, version, ort: None, is_tested: false })
    }

    /// The library once its environment has started and it has passed the self-test.
    fn ready(&mut self) -> Result<Ort> {
        let ort = match &self.ort {
            Some(ort) => ort.clone(),
            None => self.ort.insert(self.start()?).clone(),
        };
        if !self.is_tested {
            self_test::run_on_cpu(&ort).map_err(|failure| match failure.kind() {
                ErrorKind::OutOfMemory => failure,
                _ => missing(&self.path, &format!("{} fails its self-test: {}", self.version, failure.cause())),
            })?;
            self.is_tested = true;
        }
        Ok(ort)
    }

    fn start(&self) -> Result<Ort> {
        let environment = ort::init()
            .with_name("cairn")
            .with_telemetry(false)
            .with_logger(Arc::new(forward_log))
            .build()
            .map_err(|e| ort_failure("start its environment", &e))?;
        // With a logger, the environment starts at the most verbose level.
        environment.set_log_level(ort::logging::LogLevel::Warning);
        // This library must never be unloaded either, because the environment calls its logger.
        pin_this_library();
        Ok(Ort(Arc::new(Inner { path: self.path.clone(), version: self.version.clone(), environment })))
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
        let library = open(path)?;
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
        if let Some(why) = refusal(&version) {
            return Err(missing(path, &format!("{version} {why}")));
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

/// Loads a library.
#[cfg(windows)]
fn open(path: &Path) -> Result<libloading::Library> {
    // Not through `libloading`, whose error does not give the system's code.
    // SAFETY: the caller named the library as ONNX Runtime; that trust is the caller's.
    let module = unsafe { crate::libraries::load(path) }.map_err(|e| refused(path, e.code()))?;
    // SAFETY: the handle of a library that was loaded above, which nothing else frees.
    Ok(unsafe { libloading::os::windows::Library::from_raw(module.0.expose_provenance().cast_signed()) }.into())
}

/// The error for a library that Windows does not load.
#[cfg(windows)]
fn refused(path: &Path, code: windows::core::HRESULT) -> Error {
    use super::module;
    use crate::libraries::FileVersion;
    use windows::core::w;

    /// The C++ runtime from which on a mutex needs no call to be made, as the mutexes of ONNX Runtime 1.24 expect.
    const OLDEST_RUNTIME: FileVersion = FileVersion([14, 40, 0, 0]);

    let (mut cause, mut remedy) = load_refusal(path, code, REMEDY);
    // The first one of this name serves the whole process.
    let loaded = module::loaded(w!("MSVCP140.dll"));
    let old = loaded.filter(|runtime| FileVersion::read(runtime).is_some_and(|found| found < OLDEST_RUNTIME));
    if let Some(old) = old {
        cause.push_str(&format!("; this process has the C++ runtime {}", module::described(&old)));
        remedy = "ONNX Runtime needs version 14.40 or newer: replace the one that the program brings by that of Microsoft's current \
                  Visual C++ redistributable for x64";
    }
    Error::new(ErrorKind::RuntimeMissing, format!("ONNX Runtime cannot be loaded as a library: {cause}"))
        .field(path.display().to_string())
        .remedy(remedy)
}

/// Loads a library.
#[cfg(not(windows))]
fn open(path: &Path) -> Result<libloading::Library> {
    // SAFETY: runs the initialisers of a library the caller named as ONNX Runtime; that trust is the caller's.
    unsafe { libloading::Library::new(path) }.map_err(|e| missing(path, &format!("cannot be loaded as a library: {e}")))
}

/// Logs a warning if the process has loaded another ONNX Runtime file; ours is loaded in addition.
#[cfg(windows)]
fn report_others(ours: &Path) {
    use super::module;
    let other = module::loaded(windows::core::w!("onnxruntime.dll"))
        .filter(|other| canonical(other).is_ok_and(|path| path != ours));
    if let Some(other) = other {
        log::warn!("another ONNX Runtime is in this process and is not used: {}", module::described(&other));
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

/// The major and minor version in a version such as `1.24.4`.
fn release(version: &str) -> Option<(u32, u32)> {
    let mut parts = version.split('.').map(|part| part.parse().ok());
    parts.next().flatten().zip(parts.next().flatten())
}

/// Why a version cannot be used; `None` if it can, provided that it offers the interface.
fn refusal(version: &str) -> Option<String> {
    let (major, minor) = OLDEST;
    match release(version) {
        Some(found) if found < OLDEST => {
            Some(format!("is older than {major}.{minor}, the oldest that this build works with"))
        }
        Some((found, _)) if found == major => None,
        _ => Some(format!("is unknown to this build, which works with {major}.{minor} and newer versions of {major}")),
    }
}

fn is_newer_than_tested(version: &str) -> bool {
    release(version) > TESTED.iter().filter_map(|tested| release(tested)).max()
}

fn forward_log(level: ort::logging::LogLevel, category: &str, _id: &str, location: &str, message: &str) {
    use ort::logging::LogLevel;
    super::webgpu::note(message);
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
        for old in ["1.9.0", "0.99.1", "1.23.2"] {
            assert!(refusal(old).unwrap().contains("older than 1.24"), "{old}");
        }
        for unknown in ["2.0.0", "nightly", "1", "1.x", ""] {
            assert!(refusal(unknown).unwrap().contains("unknown to this build"), "{unknown}");
        }
        for usable in ["1.24.0", "1.24.4", "1.25.0", "1.32.0", "1.33.0-dev", "1.100.0"] {
            assert_eq!(refusal(usable), None, "{usable}");
        }
        assert!(!is_newer_than_tested("1.24.4") && !is_newer_than_tested("1.31.1") && !is_newer_than_tested("1.32.9"));
        assert!(is_newer_than_tested("1.33.0") && is_newer_than_tested("1.100.0"));
    }

    #[test]
    fn the_tested_versions_are_those_of_the_tests() {
        assert_eq!(TESTED, [provision::ONNXRUNTIME_VERSION, provision::NEWEST_ONNXRUNTIME_VERSION]);
        assert_eq!(release(TESTED[0]), Some(OLDEST));
    }
}
