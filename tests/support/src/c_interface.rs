//! Structs and handles of the C interface, as a host creates them.

use std::ptr::null_mut;

use cairn::abi::device::{CAIRN_DEVICE_ENVIRONMENT, cairn_device_options};
use cairn::abi::results::{CAIRN_OK, cairn_result};

/// A zeroed struct of the interface with its `struct_size`, which `size` selects.
pub fn with_struct_size<T>(size: impl FnOnce(&mut T) -> &mut u32) -> T {
    // SAFETY: structs of the interface are plain data, for which zero is a value.
    let mut value: T = unsafe { std::mem::zeroed() };
    *size(&mut value) = u32::try_from(size_of::<T>()).expect("small");
    value
}

/// Device options for tests: environment variables may name libraries, as for a tool.
pub fn tool_device_options() -> cairn_device_options {
    let mut options: cairn_device_options =
        with_struct_size(|options: &mut cairn_device_options| &mut options.struct_size);
    options.flags = CAIRN_DEVICE_ENVIRONMENT;
    options
}

/// Returns the handle that a call of the interface creates.
pub fn create_handle<T>(make: impl FnOnce(*mut *mut T) -> cairn_result) -> *mut T {
    let mut handle = null_mut();
    assert_eq!(make(&mut handle), CAIRN_OK);
    assert!(!handle.is_null());
    handle
}
