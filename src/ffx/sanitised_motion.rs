//! Makes motion vectors safe for a provider: finite, and no longer than the picture. Windows only.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::bindings::{Coordinates, Dimensions};
use super::texture_generator::{GROUP, WRITTEN, texture};
use crate::gpu::Gpu;
use crate::gpu::compute::{CommandRecorder, Kernel, ResourceWithState, Shape, View};
use crate::{Error, ErrorKind, Result};

/// Supported formats of motion textures.
const FORMATS: [DXGI_FORMAT; 4] = [
    DXGI_FORMAT_R16G16_FLOAT,
    DXGI_FORMAT_R32G32_FLOAT,
    DXGI_FORMAT_R16G16B16A16_FLOAT,
    DXGI_FORMAT_R32G32B32A32_FLOAT,
];

/// Copies motion into a texture of its own: vectors that are not finite become zero, long ones are clamped to the picture's size. A
/// provider may step along a vector pixel by pixel, so that a huge one hangs the device.
pub(super) struct SanitisedMotion {
    kernel: Kernel,
    texture: ID3D12Resource,
}

impl SanitisedMotion {
    /// Descriptors per frame.
    pub(super) const DESCRIPTORS: u32 = 2;

    /// Creates the texture at `size`, the expected size of the motion.
    pub(super) fn new(gpu: &Gpu, size: Dimensions) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/compiled/fsr_motion.dxbc");
        Ok(Self {
            kernel: Kernel::new(gpu, code, Shape { constants: 4, inputs: 1, outputs: 1 })?,
            texture: texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT)?,
        })
    }

    /// The texture with the sanitised motion.
    pub(super) fn texture(&self) -> &ID3D12Resource {
        &self.texture
    }

    /// Checks that `motion`, which has `size`, can be sanitised, and creates a texture for it.
    ///
    /// # Errors
    /// `InvalidArgument` with the field `motion` for a format that is not supported; `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn prepare(&mut self, gpu: &Gpu, motion: &ResourceWithState<'_>, size: Dimensions) -> Result<()> {
        // SAFETY: live resources.
        let (format, had) = unsafe { (motion.resource.GetDesc().Format, self.texture.GetDesc()) };
        if !FORMATS.contains(&format) {
            let why = format!("motion of DXGI format {} is not read", format.0);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("motion").remedy("Use halves or floats"));
        }
        if (had.Width, had.Height) != (size.width.into(), size.height) {
            // Frames in flight hold the previous texture.
            self.texture = texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT)?;
        }
        Ok(())
    }

    /// Records the sanitising of `motion`, for which it is [prepared](Self::prepare); `scale` converts it to pixels of `size`, its own size.
    /// Returns the sanitised texture with its state.
    pub(super) fn record(
        &self,
        frame: &mut CommandRecorder<'_>,
        motion: &ResourceWithState<'_>,
        size: Dimensions,
        scale: Coordinates,
    ) -> Result<ResourceWithState<'_>> {
        // SAFETY: a live resource.
        let format = unsafe { motion.resource.GetDesc() }.Format;
        let clean = ResourceWithState { resource: &self.texture, state: WRITTEN };
        // The largest half, for a scale near 0.
        const LARGEST: f32 = 65504.0;
        let limit = |side: u32, scale: f32| (side as f32 / scale.abs()).min(LARGEST);
        let limits = [limit(size.width, scale.x), limit(size.height, scale.y)].map(f32::to_bits);
        let constants = [size.width, size.height, limits[0], limits[1]];
        let groups = [size.width.div_ceil(GROUP), size.height.div_ceil(GROUP), 1];
        let (from, to) = (View::Texture(*motion, format), View::Texture(clean, DXGI_FORMAT_R16G16_FLOAT));
        frame.run(&self.kernel, &constants, &[from], &[to], groups)?;
        Ok(clean)
    }
}
