//! A Vulkan driver that hands every call on to the driver that `VULKAN_DOUBLE_DRIVER` names, and fails while files exist that variables name:
//!
//! - `VULKAN_DOUBLE_LOST`: devices are lost, so that submitting work and waiting for it fail;
//! - `VULKAN_DOUBLE_HUNG`: devices are lost, which shows when work is waited for;
//! - `VULKAN_DOUBLE_EXHAUSTED`: no memory is left.
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
/// `VK_ERROR_OUT_OF_DEVICE_MEMORY`.
const OUT_OF_DEVICE_MEMORY: i32 = -2;

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

/// A file whose existence lets calls fail.
struct Switch(&'static str, OnceLock<Option<PathBuf>>);

impl Switch {
    /// `code` if the file exists.
    fn fails(&self, code: i32) -> Option<i32> {
        let file = self.1.get_or_init(|| std::env::var_os(self.0).map(PathBuf::from));
        file.as_ref().is_some_and(|file| file.exists()).then_some(code)
    }
}

static LOST: Switch = Switch("VULKAN_DOUBLE_LOST", OnceLock::new());
static HUNG: Switch = Switch("VULKAN_DOUBLE_HUNG", OnceLock::new());
static EXHAUSTED: Switch = Switch("VULKAN_DOUBLE_EXHAUSTED", OnceLock::new());

fn submission_fails() -> Option<i32> {
    LOST.fails(DEVICE_LOST)
}

fn wait_fails() -> Option<i32> {
    submission_fails().or_else(|| HUNG.fails(DEVICE_LOST))
}

fn allocation_fails() -> Option<i32> {
    EXHAUSTED.fails(OUT_OF_DEVICE_MEMORY)
}

/// Defines functions that can fail, and `wrapped`, which gives them by name and keeps the driver's own.
macro_rules! failing_functions {
    ($($name:ident $text:literal if $failure:ident ($($argument:ident: $type:ty),*);)*) => {
        $(
            static $name: OnceLock<unsafe extern "system" fn($($type),*) -> i32> = OnceLock::new();
        )*

        /// Replaces a function of the driver that can fail.
        fn wrapped(name: &CStr, own: Function) -> Function {
            $(
                if name.to_bytes() == $text.as_bytes() {
                    unsafe extern "system" fn replacement($($argument: $type),*) -> i32 {
                        if let Some(code) = $failure() {
                            return code;
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

failing_functions! {
    QUEUE_SUBMIT "vkQueueSubmit" if submission_fails (queue: *mut c_void, count: u32, submits: *const c_void, fence: u64);
    QUEUE_SUBMIT_2 "vkQueueSubmit2" if submission_fails (queue: *mut c_void, count: u32, submits: *const c_void, fence: u64);
    QUEUE_WAIT_IDLE "vkQueueWaitIdle" if wait_fails (queue: *mut c_void);
    DEVICE_WAIT_IDLE "vkDeviceWaitIdle" if wait_fails (device: *mut c_void);
    WAIT_FOR_FENCES "vkWaitForFences" if wait_fails (device: *mut c_void, count: u32, fences: *const u64, all: u32, timeout: u64);
    FENCE_STATUS "vkGetFenceStatus" if submission_fails (device: *mut c_void, fence: u64);
    ALLOCATE_MEMORY "vkAllocateMemory" if allocation_fails
        (device: *mut c_void, wanted: *const c_void, callbacks: *const c_void, memory: *mut u64);
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
