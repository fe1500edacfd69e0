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
    use std::ffi::c_void;

    const GET_MODULE_HANDLE_EX_FLAG_PIN: u32 = 1;
    const GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS: u32 = 4;
    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetModuleHandleExW(flags: u32, address: *const c_void, module: *mut *mut c_void) -> i32;
    }
    let here = pin_this_library as fn() as *const c_void;
    let mut module = std::ptr::null_mut();
    // SAFETY: `here` is an address in this module, and `module` receives the handle, which is not used.
    unsafe {
        GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, here, &mut module);
    }
}

#[cfg(not(any(target_os = "linux", windows)))]
pub(super) fn pin_this_library() {}
