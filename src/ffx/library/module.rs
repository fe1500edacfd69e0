//! Loaded libraries of this process.

use std::ffi::{CStr, c_void};
use std::path::{Path, PathBuf};

use windows::Win32::Foundation::{HANDLE, HMODULE};
use windows::Win32::System::LibraryLoader::{
    GetModuleFileNameW, GetProcAddress, LOAD_LIBRARY_SEARCH_DEFAULT_DIRS, LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR,
    LoadLibraryExW,
};
use windows::Win32::System::Threading::GetCurrentProcess;
use windows::core::{HRESULT, PCSTR, PCWSTR};

use crate::libraries::{load_refusal, wide};
use crate::{Error, ErrorKind, Result};

#[link(name = "kernel32")]
unsafe extern "system" {
    fn K32EnumProcessModules(process: HANDLE, modules: *mut HMODULE, capacity: u32, needed: *mut u32) -> i32;
}

/// A loaded library. It is never unloaded: its threads and the driver may use it as long as the process lives.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::ffx) struct Module(HMODULE);

impl Module {
    /// Loads the file at an absolute path. Its dependencies are searched beside it, beside the program and in the system, and
    /// neither in the working directory nor along the PATH.
    pub(super) fn load(path: &Path) -> Result<Self> {
        let name = wide(path);
        let search = LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR | LOAD_LIBRARY_SEARCH_DEFAULT_DIRS;
        // SAFETY: a NUL-terminated path; this runs the initialisers of a library that the caller trusts as AMD's.
        let module = unsafe { LoadLibraryExW(PCWSTR(name.as_ptr()), None, search) };
        module.map(Self).map_err(|e| refused(path, e.code()))
    }

    /// All loaded libraries of this process with that file name, in any folder. Which of them a load by name returns is up to the
    /// system, and not always the first.
    pub(in crate::ffx) fn namesakes(name: &str) -> Vec<Self> {
        // SAFETY: the call has no arguments; its result is a pseudo-handle that needs no closing.
        let process = unsafe { GetCurrentProcess() };
        let mut modules = vec![HMODULE::default(); 256];
        loop {
            let capacity = size_of_val(modules.as_slice());
            let mut needed = 0;
            // SAFETY: memory of the stated size, and memory for the needed size.
            let success = unsafe { K32EnumProcessModules(process, modules.as_mut_ptr(), capacity as u32, &mut needed) };
            let count = if success == 0 { 0 } else { needed as usize / size_of::<HMODULE>() };
            if count <= modules.len() {
                modules.truncate(count);
                break;
            }
            modules.resize(count + 16, HMODULE::default());
        }
        let is_one = |path: &Path| path.file_name().is_some_and(|file| file.eq_ignore_ascii_case(name));
        modules.into_iter().map(Self).filter(|module| is_one(&module.path())).collect()
    }

    /// An exported function, or null.
    pub(in crate::ffx) fn symbol(self, name: &CStr) -> *const c_void {
        // SAFETY: a loaded module and a NUL-terminated name.
        let found = unsafe { GetProcAddress(self.0, PCSTR(name.as_ptr().cast())) };
        found.map_or(std::ptr::null(), |function| function as *const c_void)
    }

    /// The path of its file.
    pub(in crate::ffx) fn path(self) -> PathBuf {
        let mut name = vec![0; 1 << 15];
        // SAFETY: a loaded module, and the slice's memory.
        let length = unsafe { GetModuleFileNameW(Some(self.0), &mut name) } as usize;
        String::from_utf16_lossy(&name[..length]).into()
    }
}

/// The error for a file that the system does not load.
fn refused(path: &Path, code: HRESULT) -> Error {
    let (cause, remedy) = load_refusal(path, code, "Use AMD's own file for x64");
    Error::new(ErrorKind::RuntimeMissing, format!("it cannot be loaded: {cause}"))
        .field(path.display().to_string())
        .remedy(remedy)
}
