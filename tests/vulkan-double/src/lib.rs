//! A Vulkan driver that hands every call on to the driver that `VULKAN_DOUBLE_DRIVER` names, and whose devices are lost while the file exists
//! that `VULKAN_DOUBLE_LOST` names: then submitting work and waiting for it fail.
//!
//! The entry points are those of Vulkan's interface between loader and driver (`LoaderDriverInterface.md` of the Vulkan loader).
#![cfg(unix)]

use std::ffi::{CStr, c_char, c_void};
use std::path::PathBuf;
use std::sync::{LazyLock, OnceLock};

use libloading::Library;

type Function = unsafe extern "system" fn();
type GetProcAddr = unsafe extern "system" fn(*mut c_void, *const c_char) -> Option<Function>;
type Negotiate = unsafe extern "system" fn(*mut u32) -> i32;

/// `VK_ERROR_DEVICE_LOST`.
const DEVICE_LOST: i32 = -4;

struct Driver {
    negotiate: Negotiate,
    instance_function: GetProcAddr,
    physical_device_function: GetProcAddr,
}

static DRIVER: LazyLock<Driver> = LazyLock::new(|| {
    let path = std::env::var_os("VULKAN_DOUBLE_DRIVER").expect("VULKAN_DOUBLE_DRIVER names a driver");
    // SAFETY: a Vulkan driver, which has these functions with these types. It stays loaded.
    unsafe {
        let library = Box::leak(Box::new(Library::new(path).expect("the driver")));
        Driver {
            negotiate: *library.get(b"vk_icdNegotiateLoaderICDInterfaceVersion").expect("a function"),
            instance_function: *library.get(b"vk_icdGetInstanceProcAddr").expect("a function"),
            physical_device_function: *library.get(b"vk_icdGetPhysicalDeviceProcAddr").expect("a function"),
        }
    }
});

fn is_lost() -> bool {
    static FILE: LazyLock<Option<PathBuf>> =
        LazyLock::new(|| std::env::var_os("VULKAN_DOUBLE_LOST").map(PathBuf::from));
    FILE.as_ref().is_some_and(|file| file.exists())
}

/// Defines functions that fail on a lost device, and `wrapped`, which gives them by name and keeps the driver's own.
macro_rules! lost_functions {
    ($($name:ident $text:literal ($($argument:ident: $type:ty),*);)*) => {
        $(
            static $name: OnceLock<unsafe extern "system" fn($($type),*) -> i32> = OnceLock::new();
        )*

        /// Replaces a function of the driver that a lost device lets fail.
        fn wrapped(name: &CStr, own: Function) -> Function {
            $(
                if name.to_bytes() == $text.as_bytes() {
                    unsafe extern "system" fn replacement($($argument: $type),*) -> i32 {
                        if is_lost() {
                            return DEVICE_LOST;
                        }
                        // SAFETY: the caller's arguments, for the driver's own function.
                        unsafe { $name.get().expect("set before this was given out")($($argument),*) }
                    }
                    // SAFETY: Vulkan's function of this name has this type.
                    $name.get_or_init(|| unsafe { std::mem::transmute(own) });
                    // SAFETY: a function pointer, which Vulkan's users convert back before they call it.
                    return unsafe {
                        std::mem::transmute::<unsafe extern "system" fn($($type),*) -> i32, Function>(replacement)
                    };
                }
            )*
            own
        }
    };
}

lost_functions! {
    QUEUE_SUBMIT "vkQueueSubmit" (queue: *mut c_void, count: u32, submits: *const c_void, fence: u64);
    QUEUE_SUBMIT_2 "vkQueueSubmit2" (queue: *mut c_void, count: u32, submits: *const c_void, fence: u64);
    QUEUE_WAIT_IDLE "vkQueueWaitIdle" (queue: *mut c_void);
    DEVICE_WAIT_IDLE "vkDeviceWaitIdle" (device: *mut c_void);
    WAIT_FOR_FENCES "vkWaitForFences" (device: *mut c_void, count: u32, fences: *const u64, all: u32, timeout: u64);
    FENCE_STATUS "vkGetFenceStatus" (device: *mut c_void, fence: u64);
}

/// # Safety
/// As Vulkan's interface between loader and driver says.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdNegotiateLoaderICDInterfaceVersion(version: *mut u32) -> i32 {
    // SAFETY: the caller's arguments.
    unsafe { (DRIVER.negotiate)(version) }
}

/// # Safety
/// As Vulkan's interface between loader and driver says.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdGetInstanceProcAddr(
    instance: *mut c_void,
    name: *const c_char,
) -> Option<Function> {
    // SAFETY: a NUL-terminated name.
    let text = unsafe { CStr::from_ptr(name) };
    // SAFETY: the caller's arguments.
    let own = unsafe { (DRIVER.instance_function)(instance, name) }?;
    if text == c"vkGetDeviceProcAddr" {
        let replacement: GetProcAddr = device_function;
        _ = DEVICE_FUNCTION.get_or_init(|| {
            // SAFETY: Vulkan's function of this name has this type.
            unsafe { std::mem::transmute::<Function, GetProcAddr>(own) }
        });
        // SAFETY: a function pointer, which Vulkan's users convert back before they call it.
        return Some(unsafe { std::mem::transmute::<GetProcAddr, Function>(replacement) });
    }
    Some(wrapped(text, own))
}

/// # Safety
/// As Vulkan's interface between loader and driver says.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdGetPhysicalDeviceProcAddr(
    instance: *mut c_void,
    name: *const c_char,
) -> Option<Function> {
    // SAFETY: the caller's arguments.
    unsafe { (DRIVER.physical_device_function)(instance, name) }
}

static DEVICE_FUNCTION: OnceLock<GetProcAddr> = OnceLock::new();

/// Replaces the driver's `vkGetDeviceProcAddr`.
unsafe extern "system" fn device_function(device: *mut c_void, name: *const c_char) -> Option<Function> {
    // SAFETY: the caller's arguments, for the driver's own function.
    let own = unsafe { DEVICE_FUNCTION.get().expect("set before this was given out")(device, name) }?;
    // SAFETY: a NUL-terminated name.
    Some(wrapped(unsafe { CStr::from_ptr(name) }, own))
}
