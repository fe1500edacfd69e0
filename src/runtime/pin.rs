//! Keeps this library loaded. ONNX Runtime's environment can be started only once in a process and lives until its end. It calls
//! this library's log function, so unloading the library would leave it with a dangling pointer.

#[cfg(target_os = "linux")]
pub(super) fn pin_this_library() {
    use libloading::os::unix::{Library, RTLD_NOW};

    /// From `dlfcn.h`, the same for every processor that ONNX Runtime supports: opens only what is loaded already, and closing does
    /// not unload.
    const RTLD_NOLOAD: i32 = 0x4;
    const RTLD_NODELETE: i32 = 0x1000;
    let Some(path) = crate::libraries::own_module() else { return };
    // If the library is linked into the program, the file cannot be opened as a library and needs no pin.
    // SAFETY: the file is loaded already, so none of its initialisers runs.
    if let Ok(library) = unsafe { Library::open(Some(path), RTLD_NOW | RTLD_NOLOAD | RTLD_NODELETE) } {
        std::mem::forget(library);
    }
}

#[cfg(windows)]
pub(super) fn pin_this_library() {
    use windows::Win32::Foundation::HMODULE;
    use windows::Win32::System::LibraryLoader::{
        GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_PIN, GetModuleHandleExW,
    };
    use windows::core::PCWSTR;

    let here = pin_this_library as fn() as *const u16;
    let flags = GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS;
    // SAFETY: an address in this module, and memory for the handle, which is not used.
    let pinned = unsafe { GetModuleHandleExW(flags, PCWSTR(here), &mut HMODULE::default()) };
    if let Err(why) = pinned {
        log::warn!("this library cannot be kept loaded: {why}");
    }
}

#[cfg(not(any(target_os = "linux", windows)))]
pub(super) fn pin_this_library() {}
