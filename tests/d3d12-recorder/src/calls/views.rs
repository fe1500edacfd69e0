//! The part of a resource that a view has.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use crate::regions::Region;

/// Bytes of an element; `None` for formats that are in no buffer.
fn bytes_of(format: DXGI_FORMAT) -> Option<u64> {
    Some(match format {
        DXGI_FORMAT_R32G32B32A32_TYPELESS
        | DXGI_FORMAT_R32G32B32A32_FLOAT
        | DXGI_FORMAT_R32G32B32A32_UINT
        | DXGI_FORMAT_R32G32B32A32_SINT => 16,
        DXGI_FORMAT_R32G32B32_FLOAT | DXGI_FORMAT_R32G32B32_UINT | DXGI_FORMAT_R32G32B32_SINT => 12,
        DXGI_FORMAT_R16G16B16A16_FLOAT
        | DXGI_FORMAT_R16G16B16A16_UNORM
        | DXGI_FORMAT_R16G16B16A16_UINT
        | DXGI_FORMAT_R16G16B16A16_SINT
        | DXGI_FORMAT_R32G32_FLOAT
        | DXGI_FORMAT_R32G32_UINT
        | DXGI_FORMAT_R32G32_SINT => 8,
        DXGI_FORMAT_R32_TYPELESS
        | DXGI_FORMAT_R32_FLOAT
        | DXGI_FORMAT_R32_UINT
        | DXGI_FORMAT_R32_SINT
        | DXGI_FORMAT_R16G16_FLOAT
        | DXGI_FORMAT_R16G16_UINT
        | DXGI_FORMAT_R8G8B8A8_UNORM
        | DXGI_FORMAT_R8G8B8A8_UINT
        | DXGI_FORMAT_B8G8R8A8_UNORM
        | DXGI_FORMAT_R10G10B10A2_UNORM => 4,
        DXGI_FORMAT_R16_FLOAT
        | DXGI_FORMAT_R16_UINT
        | DXGI_FORMAT_R16_SINT
        | DXGI_FORMAT_R16_UNORM
        | DXGI_FORMAT_R8G8_UNORM => 2,
        DXGI_FORMAT_R8_UINT | DXGI_FORMAT_R8_SINT | DXGI_FORMAT_R8_UNORM => 1,
        _ => return None,
    })
}

/// Elements of a buffer. `structure` is their size, or 0 for typed and raw buffers.
fn elements(first: u64, count: u32, structure: u32, format: DXGI_FORMAT) -> Region {
    let size = if structure > 0 { Some(u64::from(structure)) } else { bytes_of(format) };
    match size {
        Some(size) => Region::Bytes(first * size..(first + u64::from(count)) * size),
        None => Region::All,
    }
}

/// Mipmap levels and array slices, whose counts may be -1 for all that follow.
fn subresources(level: u32, levels: u32, slice: u32, slices: u32) -> Region {
    Region::Subresources { levels: level..level.saturating_add(levels), slices: slice..slice.saturating_add(slices) }
}

/// The part that a shader resource view has; without a description, all.
pub(super) fn of_srv(desc: Option<&D3D12_SHADER_RESOURCE_VIEW_DESC>) -> Region {
    let Some(desc) = desc else { return Region::All };
    let of = &desc.Anonymous;
    // SAFETY: the member that the dimension names.
    unsafe {
        match desc.ViewDimension {
            D3D12_SRV_DIMENSION_BUFFER => {
                elements(of.Buffer.FirstElement, of.Buffer.NumElements, of.Buffer.StructureByteStride, desc.Format)
            }
            D3D12_SRV_DIMENSION_TEXTURE2D => subresources(of.Texture2D.MostDetailedMip, of.Texture2D.MipLevels, 0, 1),
            D3D12_SRV_DIMENSION_TEXTURE2DARRAY => {
                let of = of.Texture2DArray;
                subresources(of.MostDetailedMip, of.MipLevels, of.FirstArraySlice, of.ArraySize)
            }
            _ => Region::All,
        }
    }
}

/// The part that an unordered access view has.
pub(super) fn of_uav(desc: Option<&D3D12_UNORDERED_ACCESS_VIEW_DESC>) -> Region {
    let Some(desc) = desc else { return Region::All };
    let of = &desc.Anonymous;
    // SAFETY: the member that the dimension names.
    unsafe {
        match desc.ViewDimension {
            D3D12_UAV_DIMENSION_BUFFER => {
                elements(of.Buffer.FirstElement, of.Buffer.NumElements, of.Buffer.StructureByteStride, desc.Format)
            }
            D3D12_UAV_DIMENSION_TEXTURE2D => subresources(of.Texture2D.MipSlice, 1, 0, 1),
            D3D12_UAV_DIMENSION_TEXTURE2DARRAY => {
                let of = of.Texture2DArray;
                subresources(of.MipSlice, 1, of.FirstArraySlice, of.ArraySize)
            }
            _ => Region::All,
        }
    }
}

/// The part that a render target view has.
pub(super) fn of_rtv(desc: Option<&D3D12_RENDER_TARGET_VIEW_DESC>) -> Region {
    let Some(desc) = desc else { return Region::Subresources { levels: 0..1, slices: 0..u32::MAX } };
    let of = &desc.Anonymous;
    // SAFETY: the member that the dimension names.
    unsafe {
        match desc.ViewDimension {
            D3D12_RTV_DIMENSION_TEXTURE2D => subresources(of.Texture2D.MipSlice, 1, 0, 1),
            D3D12_RTV_DIMENSION_TEXTURE2DARRAY => {
                let of = of.Texture2DArray;
                subresources(of.MipSlice, 1, of.FirstArraySlice, of.ArraySize)
            }
            _ => Region::All,
        }
    }
}
