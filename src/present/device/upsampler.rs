//! Upscales anchors to the size of frames with AMD's upscaler, before frames are generated between them.

use windows::Win32::Graphics::Direct3D12::{
    D3D12_PLACED_SUBRESOURCE_FOOTPRINT, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_GENERIC_READ,
    D3D12_SUBRESOURCE_FOOTPRINT, D3D12_TEXTURE_DATA_PITCH_ALIGNMENT, ID3D12Resource,
};
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_FORMAT_R32_FLOAT};

use super::inputs::{OwnedGuidance, in_common_state};
use crate::Result;
use crate::ffx::bindings::{CreateUpscale, UpscaleCreateFlags, UpscaleFlags};
use crate::ffx::{Api, Choice, TextureUpscaler, UpscaleParams, UpscaleTextures, Version};
use crate::framegen::AnchorId;
use crate::framegen::densify::{DEPTH, Densifier, MOTION};
use crate::framegen::fsr::{camera, dimensions};
use crate::gpu::compute::{CommandRing, Kernel, ResourceWithState, Shape, View};
use crate::gpu::{Gpu, Heap, MappedBuffer, writable_texture};
use crate::guidance::{Projection, paper};

/// Cached upscaled anchors: those of a pair, and of the anchors before and after it.
const CACHED_ANCHORS: usize = 4;
/// Cached pairs of upscaled motion and depth.
const CACHED_PAIRS: usize = 2;
/// Descriptors of a list that upscales motion and depth.
const DESCRIPTORS: u32 = 4;
/// Side of a thread group, in threads.
const GROUP: u32 = 8;

/// Upscales anchors of one size temporally: the provider keeps history from anchor to anchor. If an anchor was skipped, and after a cut, it
/// resets the history.
///
/// The work is in lists of its own that are submitted at once, so a list that the engine discards leaves the history intact.
pub(super) struct Upsampler {
    upscaler: TextureUpscaler,
    gpu: Gpu,
    from: (u32, u32),
    to: (u32, u32),
    densifier: Densifier,
    /// Guidance for an anchor without any: no motion.
    no_motion: OwnedGuidance,
    /// 1: anchors are display-referred. Some providers require an exposure, whatever the flags, such as AMD's 4.0.2.
    exposure: ID3D12Resource,
    upsample_guidance: Kernel,
    ring: CommandRing,
    /// Upscaled anchors.
    anchors: Vec<(Option<AnchorId>, ID3D12Resource)>,
    /// Upscaled motion and depth, by the later anchor of the pair.
    pairs: Vec<(Option<AnchorId>, OwnedGuidance)>,
    /// Index of the next entry to replace in `anchors`.
    next_anchor: usize,
    /// Index of the next entry to replace in `pairs`.
    next_pair: usize,
    /// The last upscaled anchor.
    last: Option<AnchorId>,
}

/// An anchor at its original size.
pub(super) struct LowResolutionAnchor<'a> {
    /// `None` for a picture that is not part of the sequence.
    pub(super) id: Option<AnchorId>,
    pub(super) picture: &'a ID3D12Resource,
    /// Motion and depth that lead back to the anchor before, with the depth's projection; `None` for the first anchor and after a cut.
    pub(super) guidance: Option<(&'a OwnedGuidance, Projection)>,
    /// Time since the anchor before, in milliseconds of the world's time.
    pub(super) interval_ms: f32,
}

impl Upsampler {
    /// Creates an upsampler from anchors of the size `from`, RGBA8 in sRGB, to the size `to`.
    ///
    /// # Errors
    /// As of [`TextureUpscaler::new`].
    pub(super) fn new(gpu: &Gpu, api: &Api, choice: Choice, from: (u32, u32), to: (u32, u32)) -> Result<Self> {
        let head = CreateUpscale {
            flags: UpscaleCreateFlags::NON_LINEAR_COLOR,
            max_render_size: dimensions(from),
            max_upscale_size: dimensions(to),
            ..Default::default()
        };
        let upscaler = TextureUpscaler::new(gpu, api, choice, head)?;
        let state = D3D12_RESOURCE_STATE_COMMON;
        let anchor = || Ok((None, writable_texture(gpu, to, DXGI_FORMAT_R8G8B8A8_UNORM, state)?));
        let pair = || Ok((None, OwnedGuidance::new(gpu, to, [1, 1])?));
        let mut ring = CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?;
        Ok(Self {
            upscaler,
            gpu: gpu.clone(),
            from,
            to,
            densifier: Densifier::new(gpu, from)?,
            // New device memory is zero.
            no_motion: OwnedGuidance::new(gpu, from, [1, 1])?,
            exposure: exposure_of_one(gpu, &mut ring)?,
            upsample_guidance: Kernel::new(
                gpu,
                include_bytes!("../../gpu/shaders/compiled/fsr_upsample.dxbc"),
                Shape { constants: 6, inputs: 2, outputs: 2 },
            )?,
            ring,
            anchors: (0..CACHED_ANCHORS).map(|_| anchor()).collect::<Result<_>>()?,
            pairs: (0..CACHED_PAIRS).map(|_| pair()).collect::<Result<_>>()?,
            next_anchor: 0,
            next_pair: 0,
            last: None,
        })
    }

    /// Size of the upscaled anchors.
    pub(super) fn to(&self) -> (u32, u32) {
        self.to
    }

    /// The version of the upscaler in use.
    pub(super) fn version(&self) -> &Version {
        &self.upscaler.provider().version
    }

    /// Whether the upscaled anchor is cached.
    pub(super) fn has(&self, id: AnchorId) -> bool {
        self.anchors.iter().any(|(key, _)| *key == Some(id))
    }

    /// The upscaled anchor, in the state COMMON between lists.
    ///
    /// # Errors
    /// As of [`TextureUpscaler::upscale`]. The next anchor then resets the history.
    pub(super) fn anchor(&mut self, source: &LowResolutionAnchor<'_>) -> Result<ID3D12Resource> {
        let cached = self.anchors.iter().find(|(key, _)| source.id.is_some() && *key == source.id);
        if let Some((_, texture)) = cached {
            return Ok(texture.clone());
        }
        let before = source.id.and_then(AnchorId::before);
        let follows = before.is_some() && self.last.take() == before && source.guidance.is_some();
        let (guidance, projection) = source.guidance.unwrap_or((&self.no_motion, paper::PROJECTION));
        let (motion, depth) = self.densifier.densify(&guidance.textures())?;
        let at = self.next_anchor;
        self.anchors[at].0 = None;
        let to = self.anchors[at].1.clone();
        let params = UpscaleParams {
            reset: !follows,
            frame_time: source.interval_ms,
            camera: camera(&projection),
            encoding: UpscaleFlags::COLOR_SRGB,
            ..UpscaleParams::of(dimensions(self.from), dimensions(self.to))
        };
        let pictures = UpscaleTextures {
            color: in_common_state(source.picture),
            depth: depth.as_ref(),
            motion: motion.as_ref(),
            exposure: Some(in_common_state(&self.exposure)),
            reactive: None,
            transparency: None,
            output: in_common_state(&to),
        };
        self.upscaler.upscale(&pictures, &params)?;
        self.anchors[at].0 = source.id;
        self.next_anchor = (at + 1) % CACHED_ANCHORS;
        self.last = source.id;
        Ok(to)
    }

    /// Motion and depth at the upscaled size, from the anchor `id` back to the one before.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn guidance(&mut self, id: AnchorId, source: &OwnedGuidance) -> Result<OwnedGuidance> {
        if let Some((_, guidance)) = self.pairs.iter().find(|(key, _)| *key == Some(id)) {
            return Ok(guidance.clone());
        }
        let at = self.next_pair;
        self.pairs[at].0 = None;
        let to = OwnedGuidance { motion_origin: source.motion_origin, ..self.pairs[at].1.clone() };
        let constants = [self.from.0, self.from.1, self.to.0, self.to.1, source.motion_tile, source.depth_tile];
        let groups = [self.to.0.div_ceil(GROUP), self.to.1.div_ceil(GROUP), 1];
        let inputs = [
            View::Texture(in_common_state(&source.motion), MOTION),
            View::Texture(in_common_state(&source.depth), DEPTH),
        ];
        let outputs =
            [View::Texture(in_common_state(&to.motion), MOTION), View::Texture(in_common_state(&to.depth), DEPTH)];
        let mut frame = self.ring.begin()?;
        frame.begin_event(c"Cairn: motion and depth of a larger anchor");
        frame.run(&self.upsample_guidance, &constants, &inputs, &outputs, groups)?;
        frame.end_event();
        frame.submit(self.gpu.frames())?;
        self.pairs[at] = (Some(id), to.clone());
        self.next_pair = (at + 1) % CACHED_PAIRS;
        Ok(to)
    }

    /// The upscaled depth of the anchor `id` with its tile size in pixels, if it is cached.
    pub(super) fn depth(&self, id: AnchorId) -> Option<(ID3D12Resource, u32)> {
        let cached = self.pairs.iter().find(|(key, _)| *key == Some(id));
        cached.map(|(_, guidance)| (guidance.depth.clone(), guidance.depth_tile))
    }
}

/// A 1x1 texture with the value 1, in the state COMMON between lists. It is filled on the queue for frames, before all work submitted later.
fn exposure_of_one(gpu: &Gpu, ring: &mut CommandRing) -> Result<ID3D12Resource> {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R32_FLOAT;
    const PITCH: u32 = D3D12_TEXTURE_DATA_PITCH_ALIGNMENT;
    let mut upload = MappedBuffer::new(gpu, Heap::Upload, PITCH as usize)?;
    upload.write(0, &1.0_f32.to_le_bytes());
    let texture = writable_texture(gpu, (1, 1), FORMAT, D3D12_RESOURCE_STATE_COMMON)?;
    let from = ResourceWithState { resource: upload.resource(), state: D3D12_RESOURCE_STATE_GENERIC_READ };
    let rows = D3D12_SUBRESOURCE_FOOTPRINT { Format: FORMAT, Width: 1, Height: 1, Depth: 1, RowPitch: PITCH };
    let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: rows };
    let mut frame = ring.begin()?;
    // The ring holds the buffer until the list has run.
    frame.copy_rows(&from, rows, &in_common_state(&texture))?;
    frame.submit(gpu.frames())?;
    Ok(texture)
}
