//! The paper's extractor on a Direct3D device: the same formulas, from latents in buffers into textures.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::*;

use crate::gpu::compute::{CommandRecorder, Kernel, ResourceWithState, Shape, View, WordRange, texture};
use crate::gpu::{Gpu, Heap, buffer};
use crate::{Error, ErrorKind, MAX_SIDE, Result};

/// A latent in a buffer: `[channels, height, width]` numbers, tightly packed.
#[derive(Clone, Copy)]
pub struct LatentBuffer<'a> {
    /// The buffer with its state.
    pub buffer: ResourceWithState<'a>,
    /// Index of the latent's first number.
    pub first: u32,
}

/// The extractor for latents of one shape. Its output is within two half-float steps of [`Extractor`](super::Extractor)'s; below the
/// smallest normal half the step of subnormals applies.
pub struct GpuExtractor {
    gpu: Gpu,
    grid: Kernel,
    upsample: Kernel,
    /// Intermediate values: five 32-bit words per cell, in the shaders' layout.
    cells: ID3D12Resource,
    shape: [u32; 3],
    half: bool,
}

/// Maximum number of channels for which the shader's division is as exact as documented.
const CHANNELS: usize = 2047;
/// Words per cell passed from the first shader to the second.
const WORDS: u32 = 5;
/// Side of a thread group at render size.
const GROUP: u32 = 8;
/// Formats of motion and of depth.
const MOTION: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32G32_FLOAT];
const DEPTH: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R32_FLOAT, DXGI_FORMAT_R16_FLOAT];

impl GpuExtractor {
    /// Prepares an extractor for latents of shape `[channels, height, width]` in half or single precision. Each
    /// [`record`](Self::record) takes six descriptors.
    ///
    /// # Errors
    /// `InvalidArgument` for a dimension of 0, a side beyond [`MAX_SIDE`](crate::MAX_SIDE), more than 2047 channels, or more than 2^28 numbers;
    /// `DeviceRemoved`, `OutOfMemory`, or `Device` when the driver refuses a shader.
    pub fn new(gpu: &Gpu, shape: [usize; 3], half: bool) -> Result<Self> {
        let [channels, height, width] = shape;
        let side = 1..=MAX_SIDE as usize;
        let numbers = channels.checked_mul(height).and_then(|n| n.checked_mul(width));
        let fits = numbers.is_some_and(|n| (1..=1 << 28).contains(&n)) && channels <= CHANNELS;
        if !side.contains(&height) || !side.contains(&width) || !fits {
            let why = format!("a latent of shape {shape:?} is not taken");
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("latent"));
        }
        // At most 2^28 each.
        let shape = shape.map(|n| n as u32);
        let cells = buffer(gpu, Heap::Device, shape[1] as usize * shape[2] as usize * WORDS as usize * 4)?;
        let grid = Shape { constants: 6, inputs: 2, outputs: 1 };
        let upsample = Shape { constants: 4, inputs: 1, outputs: 2 };
        let grid = Kernel::new(gpu, include_bytes!("../../gpu/shaders/compiled/paper_grid.dxbc"), grid)?;
        let upsample = Kernel::new(gpu, include_bytes!("../../gpu/shaders/compiled/paper_lift.dxbc"), upsample)?;
        Ok(Self { gpu: gpu.clone(), grid, upsample, cells, shape, half })
    }

    /// Sets whether latents are half or single precision from now on.
    pub fn set_half_precision(&mut self, half: bool) {
        self.half = half;
    }

    /// Records the step from `z0` (previous) to `z1` (current) into `motion`, R16G16 or R32G32 (FLOAT), and `depth`, R32 or R16
    /// (FLOAT): textures of the render size, of two dimensions with one level, layer and sample, which shaders may write.
    ///
    /// All recordings of one extractor must run on the same queue, because they share its working memory.
    ///
    /// # Errors
    /// `InvalidArgument` for a buffer that is too short, for textures of other formats or of different sizes, and for resources of another
    /// device;
    /// `Unsupported` when the device cannot write a format from a shader; as for any frame.
    pub fn record(
        &self,
        frame: &mut CommandRecorder<'_>,
        z0: &LatentBuffer<'_>,
        z1: &LatentBuffer<'_>,
        motion: &ResourceWithState<'_>,
        depth: &ResourceWithState<'_>,
    ) -> Result<()> {
        let [channels, height, width] = self.shape;
        let inputs = [self.latent(z0, "z0")?, self.latent(z1, "z1")?];
        let motion_target = texture(&self.gpu, motion, &MOTION, "motion")?;
        let depth_target = texture(&self.gpu, depth, &DEPTH, "depth")?;
        if (motion_target.width, motion_target.height) != (depth_target.width, depth_target.height) {
            let sizes = [motion_target.width, motion_target.height, depth_target.width, depth_target.height];
            let why = format!("motion has {} x {} pixels, depth {} x {}", sizes[0], sizes[1], sizes[2], sizes[3]);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("depth"));
        }
        let cells = ResourceWithState { resource: &self.cells, state: D3D12_RESOURCE_STATE_COMMON };
        let cells = View::Buffer(cells, WordRange { first: 0, count: height * width * WORDS });
        let constants = [width, height, z0.first, z1.first, channels, u32::from(self.half)];
        frame.run(&self.grid, &constants, &inputs, &[cells], [1, 1, 1])?;
        let outputs = [View::Texture(*motion, motion_target.format), View::Texture(*depth, depth_target.format)];
        let groups = [motion_target.width.div_ceil(GROUP), motion_target.height.div_ceil(GROUP), 1];
        frame.run(
            &self.upsample,
            &[width, height, motion_target.width, motion_target.height],
            &[cells],
            &outputs,
            groups,
        )
    }

    /// A view of the buffer's words up to the end of a latent.
    fn latent<'a>(&self, given: &LatentBuffer<'a>, field: &str) -> Result<View<'a>> {
        let numbers: u64 = self.shape.iter().map(|n| u64::from(*n)).product();
        let element = if self.half { 2 } else { 4 };
        let bytes = ((u64::from(given.first) + numbers) * element).next_multiple_of(4);
        // Shaders address bytes with 32 bits.
        if u32::try_from(bytes).is_err() {
            let why = format!("a latent that starts at number {} lies beyond 4 GiB", given.first);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        }
        given.buffer.buffer(&self.gpu, bytes, field)?;
        Ok(View::Buffer(given.buffer, WordRange { first: 0, count: (bytes / 4) as u32 }))
    }
}

impl std::fmt::Debug for GpuExtractor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GpuExtractor({:?})", self.shape)
    }
}
