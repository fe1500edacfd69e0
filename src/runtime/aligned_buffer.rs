//! Aligned host memory that ONNX Runtime accesses by address.

use std::alloc::Layout;
use std::ptr::NonNull;

use crate::{Error, ErrorKind, Result};

/// The size of a cache line, and sufficient for all vector instructions.
const ALIGN: usize = 64;

/// Zeroed, aligned memory of fixed size. Its address never changes, so a binding may keep it.
pub(super) struct AlignedBuffer {
    start: NonNull<u8>,
    layout: Layout,
}

// SAFETY: the memory is owned and not tied to a thread; access follows the borrow of `AlignedBuffer`.
unsafe impl Send for AlignedBuffer {}
// SAFETY: shared access only reads.
unsafe impl Sync for AlignedBuffer {}

impl AlignedBuffer {
    /// Allocates `bytes` zeroed bytes, at least 1.
    pub(super) fn zeroed(bytes: usize) -> Result<Self> {
        let exhausted = || Error::new(ErrorKind::OutOfMemory, format!("a buffer of {bytes} bytes cannot be allocated"));
        let layout = Layout::from_size_align(bytes.max(1), ALIGN).map_err(|_| exhausted())?;
        // SAFETY: the layout's size is not zero.
        let start = unsafe { std::alloc::alloc_zeroed(layout) };
        Ok(Self { start: NonNull::new(start).ok_or_else(exhausted)?, layout })
    }

    /// Size in bytes.
    pub(super) fn len(&self) -> usize {
        self.layout.size()
    }

    /// The address for a binding. Writing through it requires the same exclusive access as `&mut self`.
    pub(super) fn address(&self) -> *mut u8 {
        self.start.as_ptr()
    }

    pub(super) fn bytes(&self) -> &[u8] {
        // SAFETY: the allocation is `len` initialised bytes and is not written while `self` is borrowed.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len()) }
    }

    pub(super) fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: the allocation is `len` initialised bytes and `self` is borrowed mutably.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len()) }
    }
}

impl Drop for AlignedBuffer {
    fn drop(&mut self) {
        // SAFETY: allocated with this layout, freed once.
        unsafe { std::alloc::dealloc(self.start.as_ptr(), self.layout) };
    }
}
