//! Copies pictures between textures and memory, and creates textures.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::Interface;

use super::buffers::{Heap, MappedBuffer};
use super::compute::{borrowed, compute_queue_knows, transition};
use super::target::{check_state, refuse};
use super::{FencePoint, Gpu, failed_on};
use crate::object_count::count_object;
use crate::pixel_format::swap_red_and_blue;
use crate::{Error, ErrorKind, MAX_SIDE, Picture, Result};

/// Reads a texture into memory, after all earlier work of the queue for frames; waits for it.
///
/// `texture` is a 2D texture with one slice, not multisampled, RGBA8 or BGRA8 (UNORM, UNORM_SRGB or typeless); its bytes are copied unchanged.
/// It must be in `state` when the queue reaches it, and is left in it. Only the first mip level is read, but all levels
/// must be in that state.
///
/// # Errors
/// `InvalidArgument` for another kind of resource, one of another device, and a state that it cannot be in or the queue's lists cannot name;
/// `OutOfMemory`; `DeviceRemoved`.
pub fn read_texture(gpu: &Gpu, texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) -> Result<Picture> {
    gpu.owns(texture, "texture")?;
    // SAFETY: a live resource.
    let desc = unsafe { texture.GetDesc() };
    let blue_first = check(&desc)?;
    if !can_name_state(gpu.frames().kind(), state) {
        return Err(refuse("state", "the queue for frames is a compute queue, which cannot name that state"));
    }
    if state != D3D12_RESOURCE_STATE_GENERIC_READ {
        check_state("state", state, &desc, gpu.frames().kind())?;
    }
    let mut picture = Picture::new(desc.Width as u32, desc.Height)?;
    let (layout, bytes) = layout(gpu, &desc);
    let readback = MappedBuffer::new(gpu, Heap::Readback, bytes)?;
    run_and_wait(gpu, |list| {
        let change = state != D3D12_RESOURCE_STATE_COPY_SOURCE;
        if change {
            barrier(list, texture, state, D3D12_RESOURCE_STATE_COPY_SOURCE);
        }
        copy(list, &placed(readback.resource(), layout), &first_level(texture));
        if change {
            barrier(list, texture, D3D12_RESOURCE_STATE_COPY_SOURCE, state);
        }
    })?;
    let len = picture.width() as usize * 4;
    for (y, row) in picture.rgba_mut().chunks_exact_mut(len).enumerate() {
        readback.read_at(y * layout.Footprint.RowPitch as usize, row);
        if blue_first {
            swap_red_and_blue(row);
        }
    }
    Ok(picture)
}

/// Creates a texture with a picture, RGBA8, in the state COMMON; waits for the copy, which runs on the queue for frames.
///
/// # Errors
/// `OutOfMemory`; `DeviceRemoved`.
pub fn texture_from_picture(gpu: &Gpu, picture: &Picture) -> Result<(ID3D12Resource, FencePoint)> {
    let state = D3D12_RESOURCE_STATE_COPY_DEST;
    let (texture, desc) = create_texture(gpu, picture.size(), PICTURE_FORMAT, D3D12_RESOURCE_FLAG_NONE, state)?;
    let (layout, bytes) = layout(gpu, &desc);
    let mut upload = MappedBuffer::new(gpu, Heap::Upload, bytes)?;
    let rows = picture.rgba().chunks_exact(picture.width() as usize * 4);
    rows.enumerate().for_each(|(y, row)| upload.write(y * layout.Footprint.RowPitch as usize, row));
    let fence_point = run_and_wait(gpu, |list| {
        copy(list, &first_level(&texture), &placed(upload.resource(), layout));
        barrier(list, &texture, state, D3D12_RESOURCE_STATE_COMMON);
    })?;
    Ok((texture, fence_point))
}

/// A texture that shaders may write, RGBA8, in the state COMMON. Its contents are undefined.
pub(crate) fn picture_texture(gpu: &Gpu, size: (u32, u32)) -> Result<ID3D12Resource> {
    writable_texture(gpu, size, PICTURE_FORMAT, D3D12_RESOURCE_STATE_COMMON)
}

/// A texture that shaders may write, in `state`. Its contents are undefined.
pub(crate) fn writable_texture(
    gpu: &Gpu,
    size: (u32, u32),
    format: DXGI_FORMAT,
    state: D3D12_RESOURCE_STATES,
) -> Result<ID3D12Resource> {
    Ok(create_texture(gpu, size, format, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, state)?.0)
}

/// DXGI format of [`Picture`].
const PICTURE_FORMAT: DXGI_FORMAT = DXGI_FORMAT_R8G8B8A8_UNORM;

/// Creates a texture of one mip level; also returns its description.
fn create_texture(
    gpu: &Gpu,
    (width, height): (u32, u32),
    format: DXGI_FORMAT,
    flags: D3D12_RESOURCE_FLAGS,
    state: D3D12_RESOURCE_STATES,
) -> Result<(ID3D12Resource, D3D12_RESOURCE_DESC)> {
    let desc = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
        Width: u64::from(width),
        Height: height,
        DepthOrArraySize: 1,
        MipLevels: 1,
        Format: format,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Flags: flags,
        ..Default::default()
    };
    let heap = D3D12_HEAP_PROPERTIES { Type: D3D12_HEAP_TYPE_DEFAULT, ..Default::default() };
    let mut made = None::<ID3D12Resource>;
    count_object();
    // SAFETY: a live device; descriptions and output pointer live during the call.
    unsafe { gpu.device().CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &desc, state, None, &mut made) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateCommittedResource", &e))?;
    let texture =
        made.ok_or_else(|| Error::new(ErrorKind::Device, "ID3D12Device::CreateCommittedResource gave no texture"))?;
    Ok((texture, desc))
}

/// Reads the first bytes of a buffer that is in the state COMMON, on the queue for frames; waits for it.
pub(crate) fn read_buffer(gpu: &Gpu, buffer: &ID3D12Resource, into: &mut [u8]) -> Result<()> {
    let readback = MappedBuffer::new(gpu, Heap::Readback, into.len())?;
    run_and_wait(gpu, |list| {
        // SAFETY: an open list; both buffers live until it has run, and the range is inside both.
        unsafe { list.CopyBufferRegion(readback.resource(), 0, buffer, 0, into.len() as u64) };
    })?;
    readback.read(into);
    Ok(())
}

/// Whether a list of the type may name a state in a barrier.
pub(super) fn can_name_state(kind: D3D12_COMMAND_LIST_TYPE, state: D3D12_RESOURCE_STATES) -> bool {
    kind != D3D12_COMMAND_LIST_TYPE_COMPUTE || compute_queue_knows(state)
}

/// Checks that a texture is a plain picture; returns whether its pixels are BGRA.
fn check(desc: &D3D12_RESOURCE_DESC) -> Result<bool> {
    if desc.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || desc.DepthOrArraySize != 1 {
        return Err(refuse("texture", "it is no two-dimensional texture of one slice"));
    }
    if desc.SampleDesc.Count != 1 {
        return Err(refuse("texture", "it is multisampled").remedy("Resolve it first"));
    }
    if desc.Width > u64::from(MAX_SIDE) || desc.Height > MAX_SIDE {
        return Err(refuse("texture", format!("{} x {} pixels are too many", desc.Width, desc.Height)));
    }
    match desc.Format {
        DXGI_FORMAT_R8G8B8A8_UNORM | DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_R8G8B8A8_TYPELESS => Ok(false),
        DXGI_FORMAT_B8G8R8A8_UNORM | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_TYPELESS => Ok(true),
        other => Err(refuse("texture", format!("its format is DXGI_FORMAT {}", other.0)).remedy("Use RGBA8 or BGRA8")),
    }
}

/// Buffer layout of a texture's first mip level, and its size in bytes.
pub(super) fn layout(gpu: &Gpu, desc: &D3D12_RESOURCE_DESC) -> (D3D12_PLACED_SUBRESOURCE_FOOTPRINT, usize) {
    let (mut layout, mut bytes) = (D3D12_PLACED_SUBRESOURCE_FOOTPRINT::default(), 0);
    // SAFETY: a live device; description and output pointers live during the call.
    unsafe { gpu.device().GetCopyableFootprints(desc, 0, 1, 0, Some(&mut layout), None, None, Some(&mut bytes)) };
    (layout, bytes as usize)
}

/// An open list with its own allocator.
pub(crate) fn open_list(
    gpu: &Gpu,
    kind: D3D12_COMMAND_LIST_TYPE,
) -> Result<(ID3D12GraphicsCommandList, ID3D12CommandAllocator)> {
    let device = gpu.device();
    // An allocator and a list.
    (0..2).for_each(|_| count_object());
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }
        .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandAllocator", &e))?;
    // SAFETY: a live device and allocator.
    let list = unsafe { device.CreateCommandList(0, kind, &allocator, None) }
        .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandList", &e))?;
    Ok((list, allocator))
}

/// Records commands with `record`, runs them on the queue for frames and waits; returns the fence point.
fn run_and_wait(gpu: &Gpu, record: impl FnOnce(&ID3D12GraphicsCommandList)) -> Result<FencePoint> {
    let device = gpu.device();
    let (list, _allocator) = open_list(gpu, gpu.frames().kind())?;
    record(&list);
    // SAFETY: an open list.
    unsafe { list.Close() }.map_err(|e| failed_on(device, "ID3D12GraphicsCommandList::Close", &e))?;
    let list = list.cast().map_err(|e| failed_on(device, "IUnknown::QueryInterface", &e))?;
    let fence_point = gpu.frames().submit(&[list])?;
    // The list's allocator and resources must live until then.
    fence_point.wait()?;
    Ok(fence_point)
}

/// A buffer as the location of a texture copy.
pub(super) fn placed(
    buffer: &ID3D12Resource,
    layout: D3D12_PLACED_SUBRESOURCE_FOOTPRINT,
) -> D3D12_TEXTURE_COPY_LOCATION {
    D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(buffer),
        Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: layout },
    }
}

pub(super) fn first_level(texture: &ID3D12Resource) -> D3D12_TEXTURE_COPY_LOCATION {
    D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(texture),
        Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
    }
}

pub(super) fn copy(
    list: &ID3D12GraphicsCommandList,
    to: &D3D12_TEXTURE_COPY_LOCATION,
    from: &D3D12_TEXTURE_COPY_LOCATION,
) {
    // SAFETY: an open list, and live resources of its device in the states for it.
    unsafe { list.CopyTextureRegion(to, 0, 0, 0, from, None) };
}

pub(super) fn barrier(
    list: &ID3D12GraphicsCommandList,
    resource: &ID3D12Resource,
    before: D3D12_RESOURCE_STATES,
    after: D3D12_RESOURCE_STATES,
) {
    // SAFETY: an open list and a live resource in the state before.
    unsafe { list.ResourceBarrier(&[transition(resource, before, after)]) };
}
