//! Search paths of third-party dynamic libraries.

#[cfg(windows)]
mod windows_files;

use std::path::{Path, PathBuf};

#[cfg(windows)]
pub use windows_files::FileVersion;
#[cfg(windows)]
pub(crate) use windows_files::{load, load_refusal, wide};

/// Where ONNX Runtime and AMD's libraries are searched for. The default suits a game: the folder of this library, then the program's,
/// and nowhere else, so that only whoever installed the game decides which code runs in it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LibrarySearch {
    /// Path of ONNX Runtime's library; `None` searches for it.
    pub onnxruntime: Option<PathBuf>,
    /// Folder of AMD's libraries; `None` searches for them.
    pub ffx: Option<PathBuf>,
    /// Path of the library of ONNX Runtime's WebGPU provider; `None`: beside ONNX Runtime's library.
    pub webgpu: Option<PathBuf>,
    /// Whether environment variables and the user's cache may name libraries too.
    pub environment: bool,
}

impl LibrarySearch {
    /// For tools and tests: environment variables and the user's cache may name libraries.
    pub fn for_tools() -> Self {
        Self { environment: true, ..Self::default() }
    }

    /// The path in an environment variable, if the environment may name libraries and the variable is set and not empty.
    pub(crate) fn variable(&self, name: &str) -> Option<PathBuf> {
        let value = self.environment.then(|| std::env::var_os(name)).flatten();
        value.filter(|value| !value.is_empty()).map(PathBuf::from)
    }
}

/// The folders searched in every process: this library's, then the program's.
pub(crate) fn own_folders() -> Vec<PathBuf> {
    let files = [own_module(), std::env::current_exe().ok()];
    let mut folders: Vec<PathBuf> =
        files.into_iter().flatten().filter_map(|file| file.parent().map(Path::to_owned)).collect();
    folders.dedup();
    folders
}

/// The file that holds this code: the library, or the program it is linked into.
#[cfg(windows)]
pub(crate) fn own_module() -> Option<PathBuf> {
    use windows::Win32::Foundation::HMODULE;
    use windows::Win32::System::LibraryLoader::{
        GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleHandleExW,
    };
    use windows::core::PCWSTR;

    let here = own_module as fn() -> Option<PathBuf> as *const u16;
    let flags = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    let mut module = HMODULE::default();
    // SAFETY: an address in this module, and memory for the handle.
    unsafe { GetModuleHandleExW(flags, PCWSTR(here), &mut module) }.ok()?;
    module_file(module)
}

/// The file of a loaded module. Windows only.
#[cfg(windows)]
pub(crate) fn module_file(module: windows::Win32::Foundation::HMODULE) -> Option<PathBuf> {
    use std::os::windows::ffi::OsStringExt;

    use windows::Win32::System::LibraryLoader::GetModuleFileNameW;

    // The longest path on Windows.
    let mut name = vec![0; 1 << 15];
    // SAFETY: a loaded module, and the slice's memory.
    let length = unsafe { GetModuleFileNameW(Some(module), &mut name) } as usize;
    let is_whole = (1..name.len()).contains(&length);
    is_whole.then(|| std::ffi::OsString::from_wide(&name[..length]).into())
}

/// The same on Linux, from the memory mapping that contains this function.
#[cfg(target_os = "linux")]
pub(crate) fn own_module() -> Option<PathBuf> {
    let here = own_module as fn() -> Option<PathBuf> as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        let (range, rest) = line.split_once(' ')?;
        let (from, to) = range.split_once('-')?;
        let (from, to) = (usize::from_str_radix(from, 16).ok()?, usize::from_str_radix(to, 16).ok()?);
        let path = &rest[rest.find('/')?..];
        (from..to).contains(&here).then(|| PathBuf::from(path))
    })
}

/// Not available on other systems.
#[cfg(not(any(windows, target_os = "linux")))]
pub(crate) fn own_module() -> Option<PathBuf> {
    None
}

/// A file's path without symbolic links, so that two paths of one file compare equal. On Windows without the `\\?\` prefix, which
/// some loaders refuse.
pub(crate) fn canonical(path: &Path) -> std::io::Result<PathBuf> {
    let path = path.canonicalize()?;
    #[cfg(windows)]
    {
        /// The longest path that works without the prefix on systems where long paths are disabled.
        const MAX_PATH: usize = 260;
        let plain = path.to_str().and_then(|path| path.strip_prefix(r"\\?\"));
        if let Some(plain) = plain.filter(|plain| plain.as_bytes().get(1) == Some(&b':') && plain.len() < MAX_PATH) {
            return Ok(plain.into());
        }
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(any(windows, target_os = "linux"))]
    #[test]
    fn the_module_of_a_test_is_the_test_program() {
        assert_eq!(own_module(), std::env::current_exe().ok());
        assert_eq!(own_folders().len(), 1);
    }

    #[test]
    fn a_variable_is_read_only_if_the_environment_may_name_libraries() {
        let tools = LibrarySearch::for_tools();
        assert!(tools.variable("PATH").is_some() && tools.variable("CAIRN_NO_SUCH_VARIABLE").is_none());
        assert_eq!(LibrarySearch::default().variable("PATH"), None);
    }

    #[test]
    fn canonical_paths_of_one_file_are_equal_and_have_no_prefix() {
        let program = std::env::current_exe().expect("our own path");
        let folder = program.parent().expect("a folder");
        let (name, parent) = (program.file_name().expect("a name"), folder.file_name().expect("a name"));
        let around = folder.join("..").join(parent).join(name);
        let path = canonical(&around).expect("it is there");
        assert_eq!(path, canonical(&program).expect("it is there"));
        assert!(!path.to_string_lossy().starts_with(r"\\?\"), "{}", path.display());
    }
}
