//! Keeping this very library loaded. ONNX Runtime's environment can be started once in a process and lives until its end; it
//! calls this library's log function, so a host that unloads the library must not take that code away.

#[cfg(target_os = "linux")]
pub(super) fn pin_this_library() {
    use libloading::os::unix::{Library, RTLD_NOW};

    /// From `dlfcn.h`, for every processor ONNX Runtime is made for: only what is loaded already, and closing does not unload.
    const RTLD_NOLOAD: i32 = 0x4;
    const RTLD_NODELETE: i32 = 0x1000;
    let Some(path) = crate::libraries::own_module() else { return };
    // A program that has the library linked in is no library, cannot be opened as one, and needs no pin.
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
    // SAFETY: `here` lies in this module, and `module` takes the handle, which nobody needs.
    unsafe {
        GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, here, &mut module);
    }
}

#[cfg(not(any(target_os = "linux", windows)))]
pub(super) fn pin_this_library() {}
