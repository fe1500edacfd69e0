//! A tensor for ONNX Runtime that borrows its memory.

use std::ffi::c_void;
use std::ptr::{NonNull, null_mut};

use ort::sys;

use super::super::failure::ort_failure;
use crate::Result;

/// An `OrtValue` over memory of others. The memory must live as long as the value, and as long as a binding that it was bound with.
pub(super) struct Value(NonNull<sys::OrtValue>);

// SAFETY: the value only holds an address and a shape; access to the memory follows the owner's rules.
unsafe impl Send for Value {}

impl Value {
    /// A tensor of `shape` in the `bytes` bytes at `address` of the memory that `memory` describes.
    ///
    /// # Safety
    /// The memory has that size and outlives the value.
    pub(super) unsafe fn new(
        memory: *const sys::OrtMemoryInfo,
        address: *mut c_void,
        bytes: usize,
        shape: &[usize],
        element: sys::ONNXTensorElementDataType,
    ) -> Result<Self> {
        let shape: Vec<i64> = shape.iter().map(|&n| n as i64).collect();
        let mut value = null_mut();
        let create = ort::api().CreateTensorWithDataAsOrtValue;
        // SAFETY: live descriptions and memory by the caller's promise, and a place for the value.
        let status = unsafe { create(memory, address, bytes, shape.as_ptr(), shape.len(), element, &mut value) };
        check("describe a tensor", status)?;
        Ok(Self(NonNull::new(value).expect("a value where the call succeeded")))
    }

    pub(super) fn ptr(&self) -> *mut sys::OrtValue {
        self.0.as_ptr()
    }
}

impl Drop for Value {
    fn drop(&mut self) {
        // SAFETY: made by `new` and released once.
        unsafe { (ort::api().ReleaseValue)(self.0.as_ptr()) };
    }
}

/// Converts a status that a call returned; `what` is the operation, in the infinitive.
pub(super) fn check(what: &str, status: sys::OrtStatusPtr) -> Result<()> {
    // SAFETY: the status is what a call returned, used once.
    unsafe { ort::Error::result_from_status(status) }.map_err(|e| ort_failure(what, &e))
}
