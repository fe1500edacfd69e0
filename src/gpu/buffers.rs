//! Direct3D 12 buffers, on the device or mapped by the CPU.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::DXGI_SAMPLE_DESC;

use super::{Gpu, failed_on};
use crate::object_count::count_object;
use crate::{Error, ErrorKind, Result};

/// Heap type of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Heap {
    /// Default heap, for shaders; in the state COMMON between lists, from which Direct3D promotes it on first use.
    Device,
    /// Upload heap: the CPU writes, the device reads.
    Upload,
    /// Readback heap: the device writes, the CPU reads.
    Readback,
}

/// Creates a zeroed buffer of `bytes` bytes, rounded up to a multiple of four, as ONNX Runtime's provider requires.
pub(crate) fn buffer(gpu: &Gpu, heap: Heap, bytes: usize) -> Result<ID3D12Resource> {
    let (kind, state, flags) = match heap {
        Heap::Device => {
            (D3D12_HEAP_TYPE_DEFAULT, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS)
        }
        Heap::Upload => (D3D12_HEAP_TYPE_UPLOAD, D3D12_RESOURCE_STATE_GENERIC_READ, D3D12_RESOURCE_FLAG_NONE),
        Heap::Readback => (D3D12_HEAP_TYPE_READBACK, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_FLAG_NONE),
    };
    let properties = D3D12_HEAP_PROPERTIES { Type: kind, ..Default::default() };
    let wanted = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: bytes.max(1).next_multiple_of(4) as u64,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        Flags: flags,
        ..Default::default()
    };
    let mut made: Option<ID3D12Resource> = None;
    count_object();
    // SAFETY: a live device; descriptions and output pointer live during the call.
    unsafe { gpu.device().CreateCommittedResource(&properties, D3D12_HEAP_FLAG_NONE, &wanted, state, None, &mut made) }
        .map_err(|e| {
            let why = failed_on(gpu.device(), "ID3D12Device::CreateCommittedResource", &e);
            if why.kind() != ErrorKind::OutOfMemory {
                return why;
            }
            Error::new(ErrorKind::OutOfMemory, format!("a buffer of {bytes} bytes does not fit: {}", why.cause()))
        })?;
    made.ok_or_else(|| Error::new(ErrorKind::Device, "ID3D12Device::CreateCommittedResource gave no buffer"))
}

/// A buffer of an upload or readback heap, mapped as long as it lives.
pub(crate) struct MappedBuffer {
    resource: ID3D12Resource,
    address: *mut u8,
    len: usize,
}

// SAFETY: the mapping belongs to the resource and to no thread; access follows the borrow of `MappedBuffer`.
unsafe impl Send for MappedBuffer {}

impl MappedBuffer {
    pub(crate) fn new(gpu: &Gpu, heap: Heap, len: usize) -> Result<Self> {
        let resource = buffer(gpu, heap, len)?;
        let mut address = std::ptr::null_mut();
        // SAFETY: a buffer of a CPU-visible heap, and an output pointer that lives during the call.
        unsafe { resource.Map(0, None, Some(&mut address)) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Resource::Map", &e))?;
        Ok(Self { resource, address: address.cast(), len })
    }

    pub(crate) fn resource(&self) -> &ID3D12Resource {
        &self.resource
    }

    /// Length in bytes.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Writes `bytes` at byte `at`. The device must not be using that range.
    pub(crate) fn write(&mut self, at: usize, bytes: &[u8]) {
        assert!(at + bytes.len() <= self.len, "inside the mapping");
        // SAFETY: the range is inside the mapping, and `bytes` does not overlap it.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.address.add(at), bytes.len()) };
    }

    /// Reads from the start. The device must have finished writing that range.
    pub(crate) fn read(&self, into: &mut [u8]) {
        self.read_at(0, into);
    }

    /// Reads from byte `at` on, as [`read`](Self::read).
    pub(crate) fn read_at(&self, at: usize, into: &mut [u8]) {
        assert!(at + into.len() <= self.len, "inside the mapping");
        // SAFETY: the range is inside the mapping, and `into` does not overlap it.
        unsafe { std::ptr::copy_nonoverlapping(self.address.add(at), into.as_mut_ptr(), into.len()) };
    }
}
