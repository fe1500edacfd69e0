//! Structs and handles of the C interface, as a host makes them.

use std::ptr::null_mut;

use cairn::abi::device::{CAIRN_DEVICE_ENVIRONMENT, cairn_device_options};
use cairn::abi::results::{CAIRN_OK, cairn_result};

/// A struct of the interface as a host prepares it.
pub(crate) fn prepared<T>(size: impl FnOnce(&mut T) -> &mut u32) -> T {
    // SAFETY: structs of the interface are plain data, for which zero is a value.
    let mut made: T = unsafe { std::mem::zeroed() };
    *size(&mut made) = u32::try_from(size_of::<T>()).expect("small");
    made
}

/// Options for devices in tests: the environment may name libraries, as for a tool.
#[allow(dead_code, reason = "an engine's plugin has options of its own")]
pub(crate) fn of_a_tool() -> cairn_device_options {
    let mut options: cairn_device_options = prepared(|options: &mut cairn_device_options| &mut options.struct_size);
    options.flags = CAIRN_DEVICE_ENVIRONMENT;
    options
}

/// Returns the handle that a call of the interface creates.
pub(crate) fn made<T>(make: impl FnOnce(*mut *mut T) -> cairn_result) -> *mut T {
    let mut handle = null_mut();
    assert_eq!(make(&mut handle), CAIRN_OK);
    assert!(!handle.is_null());
    handle
}
