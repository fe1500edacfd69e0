//! Converts a decoder's colour planes to pictures on the device.

use windows::Win32::Graphics::Dxgi::Common::*;

use super::Gpu;
use super::compute::{CommandRecorder, Kernel, ResourceWithState, Shape, Texture, View, WordRange, texture};
use crate::{Error, ErrorKind, MAX_SIDE, Result};

/// Decoded pictures in a buffer: for each the planes red, green and blue, `[height, width]` values in [0, 1], tightly packed.
#[derive(Clone, Copy)]
pub struct Planes<'a> {
    /// The buffer.
    pub buffer: ResourceWithState<'a>,
    /// Index of the picture in the buffer, from 0.
    pub picture: u32,
    /// Width and height, each 1 to [`MAX_SIDE`].
    pub size: (u32, u32),
    /// Whether values are half floats; otherwise they are floats.
    pub half: bool,
}

/// Converts planes to a texture of any size: bilinear, half-pixel centres, edges repeated, values clamped to [0, 1]
/// before interpolation, alpha 1. It computes the same operations as [`world::Bilinear`](crate::world::Bilinear). The results differ
/// only by the device's rounding of a division and a multiplication: by at most one step of 255 for a value on the border between
/// two.
pub struct Resize {
    gpu: Gpu,
    kernel: Kernel,
}

/// Formats of a texture, and the largest integer of their channels; 0 for floats.
const FORMATS: [(DXGI_FORMAT, u32); 4] = [
    (DXGI_FORMAT_R8G8B8A8_UNORM, 255),
    (DXGI_FORMAT_B8G8R8A8_UNORM, 255),
    (DXGI_FORMAT_R10G10B10A2_UNORM, 1023),
    (DXGI_FORMAT_R16G16B16A16_FLOAT, 0),
];

/// Side of a thread group, in threads.
const GROUP: u32 = 8;

impl Resize {
    /// Creates the shader; [`record`](Self::record) uses two descriptors of a frame.
    ///
    /// # Errors
    /// `DeviceRemoved`, `OutOfMemory`, or `Device` when the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let shape = Shape { constants: 7, inputs: 1, outputs: 1 };
        Ok(Self { gpu: gpu.clone(), kernel: Kernel::new(gpu, include_bytes!("shaders/compiled/resize.dxbc"), shape)? })
    }

    /// Records the conversion of `planes` to `texture`, filling it: a 2D texture with one mip level, layer and sample that allows
    /// unordered access, in R8G8B8A8, B8G8R8A8 or R10G10B10A2 (UNORM or typeless) or R16G16B16A16 (FLOAT or typeless).
    /// Values are written unchanged: no transfer function is applied.
    ///
    /// # Errors
    /// `InvalidArgument` for a buffer that is too short, for another texture, or for one of another device; `Unsupported` when the
    /// device cannot write the format from a shader; as for any frame. Nothing is recorded then.
    pub fn record(
        &self,
        frame: &mut CommandRecorder<'_>,
        planes: &Planes<'_>,
        texture: &ResourceWithState<'_>,
    ) -> Result<()> {
        let (width, height) = planes.size;
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            let why = format!("planes of {width} x {height} numbers cannot be");
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("size"));
        }
        let values = 3 * u64::from(width) * u64::from(height);
        let first = values * u64::from(planes.picture);
        let element = if planes.half { 2 } else { 4 };
        // Shaders read 32-bit words, and buffers hold whole words.
        let bytes = ((first + values) * element).next_multiple_of(4);
        // Shaders use 32-bit byte offsets.
        let (Ok(words), Ok(first), Ok(_)) = (u32::try_from(bytes / 4), u32::try_from(first), u32::try_from(bytes))
        else {
            let why = format!("picture {} of planes of {width} x {height} lies beyond 4 GiB", planes.picture);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("picture"));
        };
        planes.buffer.buffer(&self.gpu, bytes, "buffer")?;
        let to = texture_to_write(&self.gpu, texture)?;
        let levels = FORMATS.iter().find(|(format, _)| *format == to.format).map_or(0, |(_, levels)| *levels);
        let constants = [width, height, to.width, to.height, first, u32::from(planes.half), levels];
        let input = View::Buffer(planes.buffer, WordRange { first: 0, count: words });
        let output = View::Texture(*texture, to.format);
        let groups = [to.width.div_ceil(GROUP), to.height.div_ceil(GROUP), 1];
        frame.run(&self.kernel, &constants, &[input], &[output], groups)
    }
}

fn texture_to_write(gpu: &Gpu, given: &ResourceWithState<'_>) -> Result<Texture> {
    texture(gpu, given, &FORMATS.map(|(format, _)| format), "texture")
}

impl std::fmt::Debug for Resize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Resize")
    }
}
