//! Working memory of shaders.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::DXGI_SAMPLE_DESC;

use crate::gpu::{Gpu, failed_on};
use crate::{Error, ErrorKind, Result};

/// A buffer on the device that shaders read and write; rests in the state COMMON, with contents of no meaning.
///
/// # Errors
/// `OutOfMemory`, `DeviceRemoved`.
pub(crate) fn device_buffer(gpu: &Gpu, bytes: u64) -> Result<ID3D12Resource> {
    let heap = D3D12_HEAP_PROPERTIES { Type: D3D12_HEAP_TYPE_DEFAULT, ..Default::default() };
    let wanted = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: bytes.next_multiple_of(4),
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        Flags: D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS,
        ..Default::default()
    };
    let state = D3D12_RESOURCE_STATE_COMMON;
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: a live device; descriptions and place live during the call.
    unsafe { gpu.device().CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &wanted, state, None, &mut made) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateCommittedResource", &e))?;
    made.ok_or_else(|| Error::new(ErrorKind::Device, "ID3D12Device::CreateCommittedResource gave no buffer"))
}
