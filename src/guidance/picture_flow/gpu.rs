//! Motion from two pictures on a Direct3D device: the same algorithm, from anchors in textures into textures.
//!
//! Its shaders are `flow_*.hlsl`, and `flow.hlsli` holds what they share. They keep the processor's order of sums, so that what
//! differs is how a device divides, and the motion of the whole picture, which is fitted in floats. Both directions run in one
//! dispatch. A patch is searched by eight threads, each with one column of it; the rounds of the smoothing stay in the memory of a
//! group, which works at some cells around its own as well where the grid does not fit into one.

mod kernels;
mod layout;
mod steps;

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::*;

use crate::gpu::compute::{CommandRecorder, ResourceWithState, Transfer, View, Words, pictures, texture};
use crate::gpu::{Gpu, Heap, buffer};
use crate::{Error, ErrorKind, MAX_SIDE, Result};
use kernels::Kernels;
use layout::{Constants, Layout};
use steps::Steps;

/// Descriptors that an extraction takes of its frame.
pub const DESCRIPTORS: u32 = 5;
/// What buffers have room for, in words.
const MOST_WORDS: u64 = 1 << 27;
/// Pixels to a side for which depth may have one texel.
const TILES: [u32; 3] = [1, 8, 16];
/// Formats of motion and of depth.
const MOTION: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32G32_FLOAT];
const DEPTH: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R32_FLOAT, DXGI_FORMAT_R16_FLOAT];

/// The extractor for pictures of one size. What it finds is within a quarter of a pixel of what [`Extractor`](super::Extractor)
/// finds for 99 of 100 pixels of pictures of one scene, and as a rule the same. Its memory is about 40 bytes to a pixel, in pictures of
/// more than a megapixel at most 10, and is made with it, as are its pipelines; recording makes nothing.
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
    /// Makes it ready for pictures of `size`, 1 to [`MAX_SIDE`](crate::MAX_SIDE) to a side.
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
        let (kernels, transfer) = (Kernels::new(gpu)?, Transfer::Shown);
        Ok(Self { gpu: gpu.clone(), kernels, layout, work, transfer, size: [width, height] })
    }

    /// The same for anchors whose numbers stand for light in another way than [`Transfer::Shown`]. Numbers beyond [0, 1] of what is shown count
    /// as its ends.
    pub fn with_transfer(self, transfer: Transfer) -> Self {
        Self { transfer, ..self }
    }

    /// Records the step from `previous` to `current`, two anchors of the extractor's size in one format, R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or
    /// typeless), R10G10B10A2 (UNORM or typeless) or R16G16B16A16 (FLOAT or typeless), into `motion`, R16G16 or R32G32 (FLOAT) of that size, and `depth`, R32 or R16
    /// (FLOAT): a texel to each square of 1, 8 or 16 pixels to a side, all of them [`FLAT_DEPTH`](super::FLAT_DEPTH). Shaders must be able to
    /// write both.
    ///
    /// Frames of one extractor are recorded for one queue: they share its working memory. Nothing comes back to the processor.
    ///
    /// # Errors
    /// `InvalidArgument` for textures of other sizes or formats, anchors of two formats, and what is another device's; `Unsupported` when the
    /// device cannot write a format from a shader; as for any frame. Nothing is recorded then.
    pub fn record(
        &self,
        frame: &mut CommandRecorder<'_>,
        previous: &ResourceWithState<'_>,
        current: &ResourceWithState<'_>,
        motion: &ResourceWithState<'_>,
        depth: &ResourceWithState<'_>,
    ) -> Result<()> {
        let format = pictures::anchor(&self.gpu, current, self.size, self.transfer, "current")?;
        if pictures::anchor(&self.gpu, previous, self.size, self.transfer, "previous")?.viewed != format.viewed {
            return Err(Error::new(ErrorKind::InvalidArgument, "the anchors are of two formats").field("previous"));
        }
        let refuse = |found: [u32; 2], field: &str| {
            let [width, height] = self.size;
            let why = format!("{} x {} texels for pictures of {width} x {height} pixels", found[0], found[1]);
            Error::new(ErrorKind::InvalidArgument, why).field(field)
        };
        let to = texture(&self.gpu, motion, &MOTION, "motion")?;
        let beside = texture(&self.gpu, depth, &DEPTH, "depth")?;
        if [to.width, to.height] != self.size {
            return Err(refuse([to.width, to.height], "motion"));
        }
        let depth_size = [beside.width, beside.height];
        if !TILES.iter().any(|&tile| depth_size == self.size.map(|len| len.div_ceil(tile))) {
            return Err(refuse(depth_size, "depth").remedy("Use a texel to each square of 1, 8 or 16 pixels to a side"));
        }
        let inputs = [View::Texture(*previous, format.viewed), View::Texture(*current, format.viewed)];
        let work = ResourceWithState { resource: &self.work, state: D3D12_RESOURCE_STATE_COMMON };
        let work = View::Buffer(work, Words { first: 0, count: (self.layout.bytes / 4) as u32 });
        let outputs = [work, View::Texture(*motion, to.format), View::Texture(*depth, beside.format)];
        let table = frame.bind(&inputs, &outputs)?;
        let common = Constants {
            size: self.size,
            depth_size,
            at_model: self.layout.at_model,
            at_dense: self.layout.at_dense,
            at_trusted: self.layout.at_trusted,
            is_float: format.is_float.into(),
            is_light: format.is_light.into(),
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
