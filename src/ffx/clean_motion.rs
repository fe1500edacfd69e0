//! Motion as a provider can be given it. Windows only.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::bindings::{Coordinates, Dimensions};
use super::textures::{GROUP, WRITTEN, texture};
use crate::gpu::Gpu;
use crate::gpu::compute::{CommandRecorder, Kernel, ResourceWithState, Shape, View};
use crate::{Error, ErrorKind, Result};

/// Formats that motion is read in.
const MOTION: [DXGI_FORMAT; 4] = [
    DXGI_FORMAT_R16G16_FLOAT,
    DXGI_FORMAT_R32G32_FLOAT,
    DXGI_FORMAT_R16G16B16A16_FLOAT,
    DXGI_FORMAT_R32G32B32A32_FLOAT,
];

/// Makes of motion what holds no device up, in a texture of its own.
pub(super) struct CleanMotion {
    kernel: Kernel,
    texture: ID3D12Resource,
}

impl CleanMotion {
    /// Descriptors of a frame.
    pub(super) const ROOM: u32 = 2;

    /// For motion that is mostly of `size`.
    pub(super) fn new(gpu: &Gpu, size: Dimensions) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/fsr_motion.dxbc");
        Ok(Self {
            kernel: Kernel::new(gpu, code, Shape { constants: 4, inputs: 1, outputs: 1 })?,
            texture: texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT)?,
        })
    }

    /// Its texture.
    pub(super) fn texture(&self) -> &ID3D12Resource {
        &self.texture
    }

    /// Records that `motion`, of `size` and with `scale` to pixels of that size, is made clean; where it is then.
    pub(super) fn record(
        &mut self,
        gpu: &Gpu,
        frame: &mut CommandRecorder<'_>,
        motion: &ResourceWithState<'_>,
        size: Dimensions,
        scale: Coordinates,
    ) -> Result<ResourceWithState<'_>> {
        // SAFETY: live resources.
        let (format, had) = unsafe { (motion.resource.GetDesc().Format, self.texture.GetDesc()) };
        if !MOTION.contains(&format) {
            let why = format!("motion of DXGI format {} is not read", format.0);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("motion").remedy("Use halves or floats"));
        }
        if (had.Width, had.Height) != (size.width.into(), size.height) {
            // What is under way holds the one before.
            self.texture = texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT)?;
        }
        let clean = ResourceWithState { resource: &self.texture, state: WRITTEN };
        // What a half can hold, where the scale is nearly 0.
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
