//! Textures of pictures and of what is known of them, looked at before anything is recorded.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::{CommandRecorder, ResourceWithState, View};
use crate::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// How the numbers of anchors in half floats stand for light. Whatever is decided about colours is decided about what is shown for
/// light, which is what eyes tell apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transfer {
    /// They are made to be shown: in sRGB, PQ (SMPTE ST 2084) or HLG. They are taken as they are held. PQ spends about half of its numbers
    /// on what sRGB can show, so that differences in that count half.
    #[default]
    Shown,
    /// They are proportional to light, as in scRGB, where 1 is 80 nits and colours beyond those of sRGB lie below 0. The curve of sRGB,
    /// which goes on above 1 and is mirrored below 0, makes of them what is shown, wherever they are read, and frames in half floats are
    /// brought back.
    Light,
}

/// How a picture's pixels are held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Format {
    /// In which it is viewed and copied: sRGB is not undone.
    pub(crate) viewed: DXGI_FORMAT,
    /// Its number in the shaders.
    pub(crate) written: u32,
    /// Whether what shaders read is light.
    pub(crate) is_light: bool,
    /// Whether colours are computed as floats.
    pub(crate) is_float: bool,
    /// Bytes of a pixel.
    pub(crate) bytes: u32,
}

impl Format {
    /// Whether its numbers may stand for light.
    pub(crate) fn holds_light(&self) -> bool {
        matches!(self.viewed, DXGI_FORMAT_R16G16B16A16_FLOAT | DXGI_FORMAT_R11G11B10_FLOAT)
    }

    /// That of a texture, if frames can be made in it.
    pub(crate) fn of(format: DXGI_FORMAT) -> Option<Self> {
        let (viewed, written, is_float, bytes) = match format {
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
        Some(Self { viewed, written, is_light: false, is_float, bytes })
    }
}

/// Where a finished picture is copied to.
#[derive(Clone, Copy)]
pub struct Output<'a>(To<'a>);

#[derive(Clone, Copy)]
enum To<'a> {
    /// Over all of a texture.
    Texture(ResourceWithState<'a>),
    /// To the start of a buffer, held so, row after row as a copy into a texture wants them.
    Rows(ResourceWithState<'a>, Format),
}

impl<'a> From<&ResourceWithState<'a>> for Output<'a> {
    /// All of a texture.
    fn from(texture: &ResourceWithState<'a>) -> Self {
        Self(To::Texture(*texture))
    }
}

impl<'a> Output<'a> {
    /// The rows of a picture that is held as `format` says, each at a multiple of 256 bytes, in a buffer with room for them.
    pub(crate) fn rows(buffer: ResourceWithState<'a>, format: Format) -> Self {
        Self(To::Rows(buffer, format))
    }

    /// How it is to hold a picture of that size.
    ///
    /// # Errors
    /// `InvalidArgument` for a texture of another size, format or device, and in a state that does not fit.
    pub(crate) fn format(&self, gpu: &Gpu, frame: &CommandRecorder<'_>, size: [u32; 2]) -> Result<Format> {
        self.takes(frame)?;
        match &self.0 {
            To::Texture(texture) => target(gpu, texture, size),
            To::Rows(_, format) => Ok(*format),
        }
    }

    /// Refuses a state that does not fit.
    pub(crate) fn takes(&self, frame: &CommandRecorder<'_>) -> Result<()> {
        let (To::Texture(given) | To::Rows(given, _)) = &self.0;
        frame.takes(given)
    }

    /// Records the copy of a picture that lies in a buffer as `rows` says.
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
            To::Texture(texture) => {
                let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: rows };
                frame.copy_rows(from, rows, texture)
            }
            To::Rows(buffer, _) => frame.copy_bytes(from, u64::from(rows.RowPitch) * u64::from(rows.Height), buffer, 0),
        }
    }
}

impl Format {
    /// The rows of a picture of that size, as a copy wants them in a buffer.
    pub(crate) fn rows(&self, [width, height]: [u32; 2]) -> D3D12_SUBRESOURCE_FOOTPRINT {
        D3D12_SUBRESOURCE_FOOTPRINT {
            Format: self.viewed,
            Width: width,
            Height: height,
            Depth: 1,
            RowPitch: pitch(width, self.bytes),
        }
    }
}

/// Bytes from one row to the next of a picture in a buffer, as copies want it.
pub(crate) fn pitch(width: u32, pixel: u32) -> u32 {
    (width * pixel).next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT)
}

/// An anchor's picture to read from.
///
/// # Errors
/// `InvalidArgument`, of `field`, for another size, another device's, no plain texture, or a format that frames are not made of; for
/// light in other numbers than half floats.
pub(crate) fn anchor(
    gpu: &Gpu,
    given: &ResourceWithState<'_>,
    size: [u32; 2],
    transfer: Transfer,
    field: &str,
) -> Result<Format> {
    let found = checked(gpu, given, size, field)?;
    // Without alpha it is a target only.
    let format = Format::of(found.Format).filter(|format| format.viewed != DXGI_FORMAT_R11G11B10_FLOAT);
    let Some(mut format) = format else { return Err(refused(&found, field)) };
    if transfer == Transfer::Light && !format.holds_light() {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("DXGI format {} holds no light", found.Format.0))
            .field(field)
            .remedy("Use R16G16B16A16_FLOAT, or Transfer::Shown"));
    }
    format.is_light = transfer == Transfer::Light;
    if matches!(found.Format, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB) {
        // Shaders read it in no other way than as light.
        (format.viewed, format.is_light) = (found.Format, true);
    }
    Ok(format)
}

/// A texture to write a frame to.
///
/// # Errors
/// As for an anchor's.
pub(crate) fn target(gpu: &Gpu, given: &ResourceWithState<'_>, size: [u32; 2]) -> Result<Format> {
    let found = checked(gpu, given, size, "target")?;
    Format::of(found.Format).ok_or_else(|| refused(&found, "target"))
}

/// Motion or depth, one texel to a square of `tile` pixels.
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
