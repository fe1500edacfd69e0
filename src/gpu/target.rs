//! Validation of an engine's target textures and command lists.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::Gpu;
use super::compute::picture_formats::PictureFormat;
use super::texture::{barrier, can_name_state, copy, first_level, placed};
use crate::pixel_format::PixelFormat;
use crate::{Colours, Error, ErrorKind, Result};

/// An engine's texture, its state when a list reaches it, and the state to leave it in.
#[derive(Debug, Clone)]
pub struct Target {
    /// A 2D texture with one mip level, slice and sample: R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or typeless), R10G10B10A2 (UNORM
    /// or typeless), R16G16B16A16 (FLOAT or typeless) or R11G11B10 (FLOAT).
    pub texture: ID3D12Resource,
    /// State before the copy.
    pub before: D3D12_RESOURCE_STATES,
    /// State after the copy.
    pub after: D3D12_RESOURCE_STATES,
}

impl Target {
    /// Checks that a list of `kind` can write a frame of `size` in `colours` to it; returns its description and pixel type.
    ///
    /// # Errors
    /// `InvalidArgument` for a texture of another kind, size, format or device, and for states that the texture cannot be in or the
    /// list cannot name.
    pub(crate) fn check(
        &self,
        gpu: &Gpu,
        kind: D3D12_COMMAND_LIST_TYPE,
        size: (u32, u32),
        colours: Colours,
    ) -> Result<(D3D12_RESOURCE_DESC, PixelFormat)> {
        gpu.owns(&self.texture, "target")?;
        // SAFETY: a live resource.
        let desc = unsafe { self.texture.GetDesc() };
        let texel = check(&desc, size)?;
        if !colours.fits(texel) {
            let remedy = match colours {
                Colours::Hdr10 { .. } => "Use R10G10B10A2_UNORM",
                Colours::Linear => "Use R16G16B16A16_FLOAT or R11G11B10_FLOAT",
                _ => "Use R16G16B16A16_FLOAT",
            };
            return Err(refuse("target", format!("it does not hold {colours:?}")).remedy(remedy));
        }
        for (field, state) in [("before", self.before), ("after", self.after)] {
            check_state(field, state, &desc, kind)?;
        }
        Ok((desc, texel))
    }

    /// Bytes per pixel; `None` if frames cannot be written to it.
    pub(crate) fn pixel_bytes(&self) -> Option<u32> {
        // SAFETY: a live resource.
        PictureFormat::of(unsafe { self.texture.GetDesc() }.Format).map(|format| format.bytes)
    }

    /// Records a copy from a buffer, which is in a state that allows it, to the whole texture: a barrier, the copy, and a barrier. Nothing else
    /// of the list changes.
    pub(crate) fn record_copy(
        &self,
        list: &ID3D12GraphicsCommandList,
        from: &ID3D12Resource,
        rows: D3D12_PLACED_SUBRESOURCE_FOOTPRINT,
    ) {
        if self.before != D3D12_RESOURCE_STATE_COPY_DEST {
            barrier(list, &self.texture, self.before, D3D12_RESOURCE_STATE_COPY_DEST);
        }
        copy(list, &first_level(&self.texture), &placed(from, rows));
        if self.after != D3D12_RESOURCE_STATE_COPY_DEST {
            barrier(list, &self.texture, D3D12_RESOURCE_STATE_COPY_DEST, self.after);
        }
    }
}

/// Checks an engine's list; returns its type, which must be that of the queue for frames.
///
/// # Errors
/// `InvalidArgument` for a list of another type or of another device.
pub(crate) fn check_list(gpu: &Gpu, list: &ID3D12GraphicsCommandList) -> Result<D3D12_COMMAND_LIST_TYPE> {
    gpu.owns(list, "list")?;
    // SAFETY: a live list.
    let kind = unsafe { list.GetType() };
    if kind != gpu.frames().kind() {
        let why = "the list is of another type than the device's queue";
        return Err(refuse("list", why).remedy("Record into a list of the queue's type"));
    }
    Ok(kind)
}

pub(super) fn refuse(field: &str, why: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidArgument, why.into()).field(field)
}

/// The pixel type of a texture; an error if a frame of `size` cannot be copied into it.
fn check(desc: &D3D12_RESOURCE_DESC, (width, height): (u32, u32)) -> Result<PixelFormat> {
    let one = desc.DepthOrArraySize == 1 && desc.MipLevels == 1 && desc.SampleDesc.Count == 1;
    if desc.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        return Err(refuse("target", "it is no texture of two dimensions with one level, slice and sample"));
    }
    if (desc.Width, desc.Height) != (u64::from(width), height) {
        let why = format!("{} x {} pixels where frames have {width} x {height}", desc.Width, desc.Height);
        return Err(refuse("target", why).remedy("Set the size of the frames in the presenter's options"));
    }
    match desc.Format {
        DXGI_FORMAT_R8G8B8A8_UNORM | DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_R8G8B8A8_TYPELESS => {
            Ok(PixelFormat::Rgba8)
        }
        DXGI_FORMAT_B8G8R8A8_UNORM | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_TYPELESS => {
            Ok(PixelFormat::Bgra8)
        }
        DXGI_FORMAT_R10G10B10A2_UNORM | DXGI_FORMAT_R10G10B10A2_TYPELESS => Ok(PixelFormat::Rgb10A2),
        DXGI_FORMAT_R16G16B16A16_FLOAT | DXGI_FORMAT_R16G16B16A16_TYPELESS => Ok(PixelFormat::Rgba16F),
        DXGI_FORMAT_R11G11B10_FLOAT => Ok(PixelFormat::Rg11B10F),
        other => Err(refuse("target", format!("frames are not written in DXGI_FORMAT {}", other.0))
            .remedy("Use RGBA8, BGRA8, RGB10A2, RGBA16F or R11G11B10F")),
    }
}

/// Checks that the texture can be in the state and a list of the type can name it: a barrier with another state removes the device.
pub(super) fn check_state(
    field: &str,
    state: D3D12_RESOURCE_STATES,
    desc: &D3D12_RESOURCE_DESC,
    kind: D3D12_COMMAND_LIST_TYPE,
) -> Result<()> {
    const READS: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATES(
        D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE.0
            | D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE.0
            | D3D12_RESOURCE_STATE_COPY_SOURCE.0
            | D3D12_RESOURCE_STATE_RESOLVE_SOURCE.0,
    );
    let shaders = D3D12_RESOURCE_STATE_ALL_SHADER_RESOURCE;
    let has = |flag| desc.Flags & flag != D3D12_RESOURCE_FLAG_NONE;
    let name = state.0.cast_unsigned();
    let cannot = |why: &str| Err(refuse(field, format!("D3D12_RESOURCE_STATES {name:#x}: {why}")));
    match state {
        D3D12_RESOURCE_STATE_COMMON | D3D12_RESOURCE_STATE_COPY_DEST => {}
        D3D12_RESOURCE_STATE_RENDER_TARGET => {
            if !has(D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET) {
                return cannot("the texture was not made to be a render target");
            }
        }
        D3D12_RESOURCE_STATE_UNORDERED_ACCESS => {
            if !has(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS) {
                return cannot("the texture was not made to be written by shaders");
            }
        }
        D3D12_RESOURCE_STATE_RESOLVE_DEST => {}
        reads if reads & READS == reads => {
            let is_shader_read = reads & shaders != D3D12_RESOURCE_STATE_COMMON;
            if is_shader_read && has(D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE) {
                return cannot("the texture was made not to be read by shaders");
            }
        }
        _ => return cannot("no texture of colours can be in it"),
    }
    if !can_name_state(kind, state) {
        return cannot("a compute list cannot name it");
    }
    Ok(())
}
