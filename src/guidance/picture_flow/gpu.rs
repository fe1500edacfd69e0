//! Motion from two pictures on a Direct3D device: the same algorithm, from anchors in textures into textures.
//!
//! The shaders are `flow_*.hlsl`; `flow.hlsli` holds shared code. They do the CPU's operations in the CPU's order, so the result is equal to
//! the bit on a device that rounds quotients correctly; Direct3D allows an error of one unit in the last place. Both directions run in one
//! dispatch. Eight threads search a patch, one per column. Smoothing iterations stay in group-shared memory; where the grid does not fit into
//! one group, each group also computes a halo of cells around its own.

mod kernels;
mod layout;
mod steps;

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::*;

use crate::gpu::compute::{CommandRecorder, ResourceWithState, Transfer, View, WordRange, picture_formats, texture};
use crate::gpu::{Gpu, Heap, buffer};
use crate::{Error, ErrorKind, MAX_SIDE, Result};
use kernels::Kernels;
use layout::{Constants, Layout};
use steps::Steps;

/// Descriptors that one extraction allocates from the command recorder.
pub const DESCRIPTORS: u32 = 5;
/// Largest size of the working buffer, in 32-bit words.
const MOST_WORDS: u64 = 1 << 27;
/// Sides of the pixel square that a depth texel may cover.
const TILES: [u32; 3] = [1, 8, 16];
/// Formats of motion and of depth.
const MOTION: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32G32_FLOAT];
const DEPTH: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R32_FLOAT, DXGI_FORMAT_R16_FLOAT];

/// The extractor for pictures of one size. On a device that rounds quotients correctly its result is [`Extractor`](super::Extractor)'s; on
/// others 99 of 100 pixels of pictures of one scene are within a quarter of a pixel of that. Working memory is about 40 bytes per pixel, at
/// most 10 for pictures of more than a megapixel. It and the pipelines are created with the extractor; recording creates nothing.
///
/// Threads: one at a time; may move between them.
pub struct GpuExtractor {
    gpu: Gpu,
    kernels: Kernels,
    layout: Layout,
    work: ID3D12Resource,
    transfer: Transfer,
    size: [u32; 2],
}

impl GpuExtractor {
    /// An extractor for pictures of `size`, each side 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    ///
    /// # Errors
    /// `InvalidArgument` for another size, `Unsupported` for one that does not fit into a buffer of Direct3D; `OutOfMemory`,
    /// `DeviceRemoved`, or `Device` when the driver refuses a shader.
    pub fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let (width, height) = size;
        let refuse = |kind| Error::new(kind, format!("motion of {width} x {height} pixels")).field("size");
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(
                refuse(ErrorKind::InvalidArgument).remedy(format!("Use a width and a height from 1 to {MAX_SIDE}"))
            );
        }
        let layout = Layout::new(size);
        if layout.bytes / 4 > MOST_WORDS {
            return Err(refuse(ErrorKind::Unsupported).remedy("Find motion at a smaller size"));
        }
        let work = buffer(gpu, Heap::Device, layout.bytes as usize)?;
        let (kernels, transfer) = (Kernels::new(gpu)?, Transfer::Encoded);
        Ok(Self { gpu: gpu.clone(), kernels, layout, work, transfer, size: [width, height] })
    }

    /// Sets the anchors' transfer function if it is not [`Transfer::Encoded`]. Display-encoded values outside [0, 1] are clamped.
    pub fn with_transfer(self, transfer: Transfer) -> Self {
        Self { transfer, ..self }
    }

    /// Records the step from `previous` to `current` into `motion` and `depth`. Shaders must be able to write both.
    ///
    /// The anchors have the extractor's size and one format: R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or typeless), R10G10B10A2 (UNORM or
    /// typeless) or R16G16B16A16 (FLOAT or typeless). `motion` has their size and is R16G16 or R32G32 (FLOAT). `depth` is R32 or R16
    /// (FLOAT), has one texel per square of 1, 8 or 16 pixels a side, and is filled with [`FLAT_DEPTH`](super::FLAT_DEPTH).
    ///
    /// All recordings of one extractor must run on the same queue, because they share its working memory. Nothing is read back.
    ///
    /// # Errors
    /// `InvalidArgument` for textures of other sizes or formats, anchors of two formats, and textures of another device; `Unsupported` when the
    /// device cannot write a format from a shader; as for any frame. Nothing is recorded then.
    pub fn record(
        &self,
        frame: &mut CommandRecorder<'_>,
        previous: &ResourceWithState<'_>,
        current: &ResourceWithState<'_>,
        motion: &ResourceWithState<'_>,
        depth: &ResourceWithState<'_>,
    ) -> Result<()> {
        let format = picture_formats::anchor(&self.gpu, current, self.size, self.transfer, "current")?;
        if picture_formats::anchor(&self.gpu, previous, self.size, self.transfer, "previous")?.view_format
            != format.view_format
        {
            return Err(Error::new(ErrorKind::InvalidArgument, "the anchors are of two formats").field("previous"));
        }
        let refuse = |found: [u32; 2], field: &str| {
            let [width, height] = self.size;
            let why = format!("{} x {} texels for pictures of {width} x {height} pixels", found[0], found[1]);
            Error::new(ErrorKind::InvalidArgument, why).field(field)
        };
        let motion_target = texture(&self.gpu, motion, &MOTION, "motion")?;
        let depth_target = texture(&self.gpu, depth, &DEPTH, "depth")?;
        if [motion_target.width, motion_target.height] != self.size {
            return Err(refuse([motion_target.width, motion_target.height], "motion"));
        }
        let depth_size = [depth_target.width, depth_target.height];
        if !TILES.iter().any(|&tile| depth_size == self.size.map(|len| len.div_ceil(tile))) {
            return Err(refuse(depth_size, "depth").remedy("Use a texel to each square of 1, 8 or 16 pixels to a side"));
        }
        let inputs = [View::Texture(*previous, format.view_format), View::Texture(*current, format.view_format)];
        let work = ResourceWithState { resource: &self.work, state: D3D12_RESOURCE_STATE_COMMON };
        let work = View::Buffer(work, WordRange { first: 0, count: (self.layout.bytes / 4) as u32 });
        let outputs = [work, View::Texture(*motion, motion_target.format), View::Texture(*depth, depth_target.format)];
        let table = frame.bind(&inputs, &outputs)?;
        let common = Constants {
            size: self.size,
            depth_size,
            at_model: self.layout.at_model,
            at_dense: self.layout.at_dense,
            at_trusted: self.layout.at_trusted,
            is_float: format.is_float.into(),
            is_linear: format.is_linear.into(),
            ..Constants::default()
        };
        Steps { frame, table: &table, kernels: &self.kernels, layout: &self.layout, common }.run();
        Ok(())
    }
}

impl std::fmt::Debug for GpuExtractor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size;
        write!(f, "GpuExtractor({width} x {height})")
    }
}
