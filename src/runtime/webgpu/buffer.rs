//! A buffer on the adapter.

use std::ffi::c_void;
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;

use ort::AsPointer;
use ort::memory::MemoryInfo;
use ort::sys::{self, ONNXTensorElementDataType as Element};

use super::adapter_errors::call_provider;
use super::plugin::{LOCK, Plugin};
use super::value::{Value, check};
use crate::runtime::aligned_buffer::AlignedBuffer;
use crate::{Error, ErrorKind, Result};

/// Memory on the adapter, from the plugin's allocator. Its size is a multiple of [`WORD`].
pub(super) struct DeviceBuffer {
    plugin: Arc<Plugin>,
    /// The provider's object, not an address.
    handle: NonNull<c_void>,
    /// Size in bytes.
    bytes: usize,
}

/// Bytes of the integers that values are moved and checked as.
pub(super) const WORD: usize = 4;

// SAFETY: the handle is used by calls under the plugin's lock only.
unsafe impl Send for DeviceBuffer {}
// SAFETY: as above.
unsafe impl Sync for DeviceBuffer {}

impl DeviceBuffer {
    /// Allocates at least `bytes` bytes and copies `contents`, whose size is that of the buffer, into them.
    pub(super) fn with_contents(plugin: &Arc<Plugin>, contents: &AlignedBuffer) -> Result<Self> {
        let buffer = Self::uninitialised(plugin, contents.len())?;
        buffer.write(contents.bytes())?;
        Ok(buffer)
    }

    /// The number of words that hold `bytes` bytes, at least 1.
    pub(super) fn words(bytes: usize) -> usize {
        bytes.div_ceil(WORD).max(1)
    }

    fn uninitialised(plugin: &Arc<Plugin>, bytes: usize) -> Result<Self> {
        assert!(bytes.is_multiple_of(WORD), "whole words");
        let mut handle = null_mut();
        let allocated = call_provider(|| {
            // SAFETY: the plugin's allocator lives as long as the process.
            let status = unsafe { (ort::api().AllocatorAlloc)(plugin.allocator(), bytes, &mut handle) };
            check(&format!("allocate {bytes} bytes on the adapter"), status)
                .map_err(|error| Error::new(ErrorKind::OutOfMemory, error.cause().to_owned()))
        });
        if let Err(error) = allocated {
            // The provider gives a buffer all the same if the adapter had no memory for it.
            drop(NonNull::new(handle).map(|handle| Self { plugin: plugin.clone(), handle, bytes }));
            return Err(error);
        }
        let handle = NonNull::new(handle).ok_or_else(|| {
            Error::new(ErrorKind::OutOfMemory, format!("{bytes} bytes cannot be allocated on the adapter"))
        })?;
        Ok(Self { plugin: plugin.clone(), handle, bytes })
    }

    /// A tensor of `shape` over the buffer. It must not outlive the buffer.
    pub(super) fn value(&self, shape: &[usize], element: Element) -> Result<Value> {
        // SAFETY: the buffer has that size; the caller keeps it alive.
        unsafe { Value::new(self.plugin.memory(), self.handle.as_ptr(), self.bytes, shape, element) }
    }

    /// Replaces the contents from the start on. Waits for nothing.
    pub(super) fn write(&self, contents: &[u8]) -> Result<()> {
        let host = MemoryInfo::default();
        // SAFETY: the slice lives during this call, and it is only read.
        let from = unsafe { host_value(&host, contents.as_ptr().cast_mut(), contents.len()) }?;
        let to = self.value(&[contents.len()], BYTES)?;
        copy("write to the adapter", &self.plugin, &from, &to)
    }

    /// Waits, then reads the contents from the start on.
    pub(super) fn read(&self, contents: &mut [u8]) -> Result<()> {
        let host = MemoryInfo::default();
        // SAFETY: the slice lives during this call.
        let to = unsafe { host_value(&host, contents.as_mut_ptr(), contents.len()) }?;
        let from = self.value(&[contents.len()], BYTES)?;
        copy("read from the adapter", &self.plugin, &from, &to)
    }

    /// A copy in a buffer of its own.
    pub(super) fn duplicate(&self) -> Result<Self> {
        let copy = Self::uninitialised(&self.plugin, self.bytes)?;
        copy.copy_from(self)?;
        Ok(copy)
    }

    /// Replaces the contents by those of a buffer of the same size.
    pub(super) fn copy_from(&self, from: &Self) -> Result<()> {
        let values = [from, self].map(|buffer| buffer.value(&[self.bytes], BYTES));
        let [from, to] = values;
        copy("copy on the adapter", &self.plugin, &from?, &to?)
    }
}

impl Drop for DeviceBuffer {
    fn drop(&mut self) {
        let _held = LOCK.lock();
        // SAFETY: from this allocator, freed once. The provider keeps the memory until its queue has used it.
        let status = unsafe { (ort::api().AllocatorFree)(self.plugin.allocator(), self.handle.as_ptr()) };
        if let Err(error) = check("free a buffer", status) {
            log::warn!("{error}");
        }
    }
}

/// The type for copies of whole buffers.
const BYTES: Element = Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_UINT8;

/// # Safety
/// As [`Value::new`].
unsafe fn host_value(memory: &MemoryInfo<'_>, address: *mut u8, bytes: usize) -> Result<Value> {
    // SAFETY: the caller's promise.
    unsafe { Value::new(memory.ptr(), address.cast(), bytes, &[bytes], BYTES) }
}

fn copy(what: &str, plugin: &Plugin, from: &Value, to: &Value) -> Result<()> {
    let (from, mut to): (*const sys::OrtValue, *const sys::OrtValue) = (from.ptr(), to.ptr());
    let copy = ort::api().CopyTensors;
    // SAFETY: a live environment, and one tensor each with memory of the same size.
    call_provider(|| check(what, unsafe { copy(plugin.environment_ptr(), &from, &mut to, null_mut(), 1) }))
}
