//! Expands tiled motion and depth to one value per pixel, as AMD's providers require. Windows only.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATES, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT};

use super::shader::GuidanceTextures;
use crate::Result;
use crate::gpu::compute::{CommandRing, Kernel, ResourceWithState, Shape, View};
use crate::gpu::{Gpu, writable_texture};

/// Descriptors of a list that expands motion and depth.
const DESCRIPTORS: u32 = 4;
/// Side of a thread group, in threads.
const GROUP: u32 = 8;
/// Format of motion.
pub(crate) const MOTION: DXGI_FORMAT = DXGI_FORMAT_R16G16_FLOAT;
/// Format of depth.
pub(crate) const DEPTH: DXGI_FORMAT = DXGI_FORMAT_R32_FLOAT;

/// Expands tiles of motion and depth to pixels, in lists of its own on a device's queue for frames.
pub(crate) struct Densifier {
    gpu: Gpu,
    size: (u32, u32),
    kernel: Kernel,
    ring: CommandRing,
    /// Expanded motion and depth.
    dense: [ID3D12Resource; 2],
}

/// A texture and its state between lists.
#[derive(Clone)]
pub(crate) struct OwnedResourceWithState {
    pub(crate) resource: ID3D12Resource,
    pub(crate) state: D3D12_RESOURCE_STATES,
}

impl OwnedResourceWithState {
    /// Borrows the texture.
    pub(crate) fn as_ref(&self) -> ResourceWithState<'_> {
        ResourceWithState { resource: &self.resource, state: self.state }
    }
}

impl Densifier {
    /// For pictures of `size`.
    pub(crate) fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let shape = Shape { constants: 4, inputs: 2, outputs: 2 };
        let texture = |format| writable_texture(gpu, size, format, D3D12_RESOURCE_STATE_COMMON);
        Ok(Self {
            gpu: gpu.clone(),
            size,
            kernel: Kernel::new(gpu, include_bytes!("../gpu/shaders/compiled/fsr_densify.dxbc"), shape)?,
            ring: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
            dense: [texture(MOTION)?, texture(DEPTH)?],
        })
    }

    /// Motion and depth per pixel: the given textures if they have that resolution, else textures that are valid until the next call.
    pub(crate) fn densify(
        &mut self,
        guidance: &GuidanceTextures<'_>,
    ) -> Result<(OwnedResourceWithState, OwnedResourceWithState)> {
        let owned = |texture: &ResourceWithState<'_>| OwnedResourceWithState {
            resource: texture.resource.clone(),
            state: texture.state,
        };
        if [guidance.motion_tile, guidance.depth_tile] == [1, 1] {
            return Ok((owned(&guidance.motion), owned(&guidance.depth)));
        }
        let [motion, depth] =
            self.dense.clone().map(|resource| OwnedResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON });
        let constants = [self.size.0, self.size.1, guidance.motion_tile, guidance.depth_tile];
        let groups = [self.size.0.div_ceil(GROUP), self.size.1.div_ceil(GROUP), 1];
        // SAFETY: live resources.
        let formats = unsafe { [guidance.motion, guidance.depth].map(|from| from.resource.GetDesc().Format) };
        let inputs = [View::Texture(guidance.motion, formats[0]), View::Texture(guidance.depth, formats[1])];
        let outputs = [View::Texture(motion.as_ref(), MOTION), View::Texture(depth.as_ref(), DEPTH)];
        let mut frame = self.ring.begin()?;
        frame.begin_event(c"Cairn: motion and depth of each pixel");
        frame.run(&self.kernel, &constants, &inputs, &outputs, groups)?;
        frame.end_event();
        frame.submit(self.gpu.frames())?;
        Ok((motion, depth))
    }
}
