//! Pixel formats of pictures, and checks of picture and guidance textures before anything is recorded.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::{CommandRecorder, ResourceWithState, View};
use crate::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// The transfer function of anchors in half floats. Colours are always compared as display-encoded values, in which equal differences
/// look about equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transfer {
    /// Display-encoded values, in sRGB, PQ (SMPTE ST 2084) or HLG, used as stored. PQ spends about half of its range on what sRGB can show, so
    /// differences within that range count half.
    #[default]
    Encoded,
    /// Linear values, as in scRGB, where 1 is 80 nits and colours outside the sRGB gamut have negative components. Reads apply the sRGB curve,
    /// extended above 1 and mirrored below 0; frames in half floats are converted back to linear.
    Linear,
}

/// Pixel format of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PictureFormat {
    /// Format of views and copies; without sRGB conversion, except in anchors of an sRGB format.
    pub(crate) view_format: DXGI_FORMAT,
    /// Number of the format in the shaders' constants.
    pub(crate) written: u32,
    /// Whether shader reads return linear values.
    pub(crate) is_linear: bool,
    /// Whether shaders compute colours as floats.
    pub(crate) is_float: bool,
    /// Bytes per pixel.
    pub(crate) bytes: u32,
}

impl PictureFormat {
    /// Whether it can hold linear values.
    pub(crate) fn can_hold_linear(&self) -> bool {
        matches!(self.view_format, DXGI_FORMAT_R16G16B16A16_FLOAT | DXGI_FORMAT_R11G11B10_FLOAT)
    }

    /// The pixel format for a DXGI format; `None` if frames cannot have it.
    pub(crate) fn of(format: DXGI_FORMAT) -> Option<Self> {
        let (view_format, written, is_float, bytes) = match format {
            DXGI_FORMAT_R8G8B8A8_UNORM | DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_R8G8B8A8_TYPELESS => {
                (DXGI_FORMAT_R8G8B8A8_UNORM, 0, false, 4)
            }
            DXGI_FORMAT_B8G8R8A8_UNORM | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_TYPELESS => {
                (DXGI_FORMAT_B8G8R8A8_UNORM, 1, false, 4)
            }
            DXGI_FORMAT_R10G10B10A2_UNORM | DXGI_FORMAT_R10G10B10A2_TYPELESS => {
                (DXGI_FORMAT_R10G10B10A2_UNORM, 2, true, 4)
            }
            DXGI_FORMAT_R16G16B16A16_FLOAT | DXGI_FORMAT_R16G16B16A16_TYPELESS => {
                (DXGI_FORMAT_R16G16B16A16_FLOAT, 3, true, 8)
            }
            DXGI_FORMAT_R11G11B10_FLOAT => (DXGI_FORMAT_R11G11B10_FLOAT, 4, true, 4),
            _ => return None,
        };
        Some(Self { view_format, written, is_linear: false, is_float, bytes })
    }
}

/// Destination of a finished picture.
#[derive(Clone, Copy)]
pub struct Output<'a>(Destination<'a>);

#[derive(Clone, Copy)]
enum Destination<'a> {
    /// A whole texture.
    Texture(ResourceWithState<'a>),
    /// The start of a buffer, in this format, with the row pitch of a texture copy.
    Rows(ResourceWithState<'a>, PictureFormat),
}

impl<'a> From<&ResourceWithState<'a>> for Output<'a> {
    /// A whole texture.
    fn from(texture: &ResourceWithState<'a>) -> Self {
        Self(Destination::Texture(*texture))
    }
}

impl<'a> Output<'a> {
    /// A buffer for a picture in `format`, with a row pitch of a multiple of 256 bytes.
    pub(crate) fn rows(buffer: ResourceWithState<'a>, format: PictureFormat) -> Self {
        Self(Destination::Rows(buffer, format))
    }

    /// The format of a picture of that size in this destination.
    ///
    /// # Errors
    /// `InvalidArgument` for a texture of another size, format or device, and in a state that does not fit.
    pub(crate) fn format(&self, gpu: &Gpu, frame: &CommandRecorder<'_>, size: [u32; 2]) -> Result<PictureFormat> {
        self.check_state(frame)?;
        match &self.0 {
            Destination::Texture(texture) => target(gpu, texture, size),
            Destination::Rows(_, format) => Ok(*format),
        }
    }

    /// Checks the resource's state.
    pub(crate) fn check_state(&self, frame: &CommandRecorder<'_>) -> Result<()> {
        let (Destination::Texture(given) | Destination::Rows(given, _)) = &self.0;
        frame.check_state(given)
    }

    /// Records the copy of a picture from a buffer, laid out as `rows`.
    ///
    /// # Errors
    /// As for any frame. Nothing is recorded then.
    pub(crate) fn copy(
        &self,
        frame: &mut CommandRecorder<'_>,
        from: &ResourceWithState<'_>,
        rows: D3D12_SUBRESOURCE_FOOTPRINT,
    ) -> Result<()> {
        match &self.0 {
            Destination::Texture(texture) => {
                let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: rows };
                frame.copy_rows(from, rows, texture)
            }
            Destination::Rows(buffer, _) => {
                frame.copy_bytes(from, u64::from(rows.RowPitch) * u64::from(rows.Height), buffer, 0)
            }
        }
    }
}

impl PictureFormat {
    /// Buffer layout of a picture of that size for a texture copy.
    pub(crate) fn rows(&self, [width, height]: [u32; 2]) -> D3D12_SUBRESOURCE_FOOTPRINT {
        D3D12_SUBRESOURCE_FOOTPRINT {
            Format: self.view_format,
            Width: width,
            Height: height,
            Depth: 1,
            RowPitch: pitch(width, self.bytes),
        }
    }
}

/// Row pitch in bytes of a picture in a buffer, as texture copies require it.
pub(crate) fn pitch(width: u32, pixel: u32) -> u32 {
    (width * pixel).next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT)
}

/// Checks an anchor's picture as a shader input; returns its format.
///
/// # Errors
/// `InvalidArgument`, of `field`, for another size or device, for a texture with several samples, levels or layers, for an unsupported
/// format, and for linear values in another format than half floats.
pub(crate) fn anchor(
    gpu: &Gpu,
    given: &ResourceWithState<'_>,
    size: [u32; 2],
    transfer: Transfer,
    field: &str,
) -> Result<PictureFormat> {
    let found = checked(gpu, given, size, field)?;
    // A format without alpha can only be a target.
    let format = PictureFormat::of(found.Format).filter(|format| format.view_format != DXGI_FORMAT_R11G11B10_FLOAT);
    let Some(mut format) = format else { return Err(refused(&found, field)) };
    if transfer == Transfer::Linear && !format.can_hold_linear() {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("DXGI format {} holds no light", found.Format.0))
            .field(field)
            .remedy("Use R16G16B16A16_FLOAT, or Transfer::Encoded"));
    }
    format.is_linear = transfer == Transfer::Linear;
    if matches!(found.Format, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB) {
        // Shader reads of an sRGB format always return linear values.
        (format.view_format, format.is_linear) = (found.Format, true);
    }
    Ok(format)
}

/// Checks a texture as the target of a frame; returns its format.
///
/// # Errors
/// As of [`anchor`].
pub(crate) fn target(gpu: &Gpu, given: &ResourceWithState<'_>, size: [u32; 2]) -> Result<PictureFormat> {
    let found = checked(gpu, given, size, "target")?;
    PictureFormat::of(found.Format).ok_or_else(|| refused(&found, "target"))
}

/// Checks a texture of motion or depth with one texel per square of `tile` pixels; returns its view.
///
/// # Errors
/// `InvalidArgument`, of `field`, for another tile than 1, 8 or 16 pixels, another size or format, or another device's.
pub(crate) fn guidance<'a>(
    gpu: &Gpu,
    given: &ResourceWithState<'a>,
    size: [u32; 2],
    tile: u32,
    formats: &[DXGI_FORMAT],
    field: &str,
) -> Result<View<'a>> {
    if !matches!(tile, 1 | 8 | 16) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("guidance in tiles of {tile} pixels"))
            .field(field)
            .remedy("Use tiles of 1, 8 or 16 pixels"));
    }
    let found = checked(gpu, given, size.map(|len| len.div_ceil(tile)), field)?;
    if !formats.contains(&found.Format) {
        return Err(refused(&found, field));
    }
    Ok(View::Texture(*given, found.Format))
}

fn checked(gpu: &Gpu, given: &ResourceWithState<'_>, size: [u32; 2], field: &str) -> Result<D3D12_RESOURCE_DESC> {
    gpu.owns(given.resource, field)?;
    // SAFETY: a live resource.
    let found = unsafe { given.resource.GetDesc() };
    let refuse = |why: String| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
    let one = found.SampleDesc.Count == 1 && found.MipLevels == 1 && found.DepthOrArraySize == 1;
    if found.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        return refuse("it is no texture of two dimensions with one sample, level and layer".to_owned());
    }
    if (found.Width, found.Height) != (u64::from(size[0]), size[1]) {
        return refuse(format!("{} x {} texels are not {} x {}", found.Width, found.Height, size[0], size[1]));
    }
    if found.Flags.contains(D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE) {
        return refuse("it was made with D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE".to_owned());
    }
    Ok(found)
}

fn refused(found: &D3D12_RESOURCE_DESC, field: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("frames are not made with DXGI format {}", found.Format.0))
        .field(field)
        .remedy("Use a format that is documented")
}
