//! Direct3D 12 resources as ffx-api's structs describe them. Windows only.

use windows::Win32::Graphics::Direct3D12::{
    D3D12_RESOURCE_DIMENSION_BUFFER, D3D12_RESOURCE_DIMENSION_TEXTURE1D, D3D12_RESOURCE_DIMENSION_TEXTURE2D,
    D3D12_RESOURCE_DIMENSION_TEXTURE3D, D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL,
    D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, ID3D12Resource,
};
use windows::core::Interface;

use super::bindings::{Resource, ResourceDescription, ResourceState, ResourceType, ResourceUsage, SurfaceFormat};

impl Resource {
    /// Describes a resource in `state`. Takes no reference: the resource must outlive the recorded work that uses it.
    pub fn of(resource: &ID3D12Resource, state: ResourceState) -> Self {
        // SAFETY: a live resource; the call has no arguments.
        let desc = unsafe { resource.GetDesc() };
        let mut usage = ResourceUsage::empty();
        for (flag, use_of_it) in [
            (D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, ResourceUsage::UNORDERED_ACCESS),
            (D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, ResourceUsage::RENDER_TARGET),
            (D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL, ResourceUsage::DEPTH_TARGET),
        ] {
            usage.set(use_of_it, desc.Flags.contains(flag));
        }
        let kind = match desc.Dimension {
            D3D12_RESOURCE_DIMENSION_TEXTURE1D => ResourceType::TEXTURE_1D,
            D3D12_RESOURCE_DIMENSION_TEXTURE2D => ResourceType::TEXTURE_2D,
            D3D12_RESOURCE_DIMENSION_TEXTURE3D => ResourceType::TEXTURE_3D,
            _ => ResourceType::BUFFER,
        };
        // The width of a buffer is its size in bytes, clamped to 32 bits.
        let width = u32::try_from(desc.Width).unwrap_or(u32::MAX);
        let is_buffer = desc.Dimension == D3D12_RESOURCE_DIMENSION_BUFFER;
        let description = ResourceDescription {
            kind,
            format: SurfaceFormat::from_dxgi(desc.Format.0.cast_unsigned()),
            width,
            height: if is_buffer { 0 } else { desc.Height },
            depth: desc.DepthOrArraySize.into(),
            mips: desc.MipLevels.into(),
            usage,
            ..Default::default()
        };
        Self { resource: resource.as_raw(), description, state }
    }
}
