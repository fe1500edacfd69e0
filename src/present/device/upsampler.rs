//! Upscales anchors to the size of frames with AMD's upscaler, before frames are generated between them.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R8G8B8A8_UNORM;

use super::resource_cache::Textures;
use super::resting;
use crate::Result;
use crate::ffx::bindings::{CreateUpscale, UpscaleCreateFlags, UpscaleFlags};
use crate::ffx::{Api, Choice, TextureUpscaler, UpscaleParams, UpscalePictures, Version};
use crate::framegen::densify::{DEPTH, Densifier, MOTION};
use crate::framegen::fsr::{Place, camera, dimensions};
use crate::gpu::compute::{CommandRing, Kernel, Shape, View};
use crate::gpu::{Gpu, written_texture};
use crate::guidance::{Projection, paper};

/// Cached upscaled anchors: those of a pair, and of the anchors before and after it.
const ANCHORS: usize = 4;
/// Cached pairs of upscaled motion and depth.
const PAIRS: usize = 2;
/// Descriptors of a list that upscales motion and depth.
const ROOM: u32 = 4;
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
    each: Densifier,
    /// Guidance for an anchor without any: no motion.
    still: Textures,
    upsample: Kernel,
    ring: CommandRing,
    anchors: Vec<(Option<Place>, ID3D12Resource)>,
    pairs: Vec<(Option<Place>, Textures)>,
    /// Next entry to replace in `anchors` and in `pairs`.
    next: [usize; 2],
    /// The last upscaled anchor.
    last: Option<Place>,
}

/// An anchor at its original size.
pub(super) struct LowResolutionAnchor<'a> {
    /// Epoch and index; `None` for a picture that is not part of the sequence.
    pub(super) place: Option<Place>,
    pub(super) picture: &'a ID3D12Resource,
    /// Motion and depth that lead back to the anchor before, with the depth's projection; `None` for the first anchor and after a cut.
    pub(super) lead: Option<(&'a Textures, Projection)>,
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
        let anchor = || Ok((None, written_texture(gpu, to, DXGI_FORMAT_R8G8B8A8_UNORM, state)?));
        let pair = || Ok((None, Textures::new(gpu, to, [1, 1])?));
        Ok(Self {
            upscaler,
            gpu: gpu.clone(),
            from,
            to,
            each: Densifier::new(gpu, from)?,
            // New device memory is zero.
            still: Textures::new(gpu, from, [1, 1])?,
            upsample: Kernel::new(
                gpu,
                include_bytes!("../../gpu/shaders/fsr_enlarge.dxbc"),
                Shape { constants: 6, inputs: 2, outputs: 2 },
            )?,
            ring: CommandRing::new(gpu, gpu.frames(), ROOM)?,
            anchors: (0..ANCHORS).map(|_| anchor()).collect::<Result<_>>()?,
            pairs: (0..PAIRS).map(|_| pair()).collect::<Result<_>>()?,
            next: [0; 2],
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
    pub(super) fn has(&self, place: Place) -> bool {
        self.anchors.iter().any(|(of, _)| *of == Some(place))
    }

    /// The upscaled anchor, in the state COMMON between lists.
    ///
    /// # Errors
    /// As of [`TextureUpscaler::upscale`]. The next anchor then resets the history.
    pub(super) fn anchor(&mut self, small: &LowResolutionAnchor<'_>) -> Result<ID3D12Resource> {
        let kept = self.anchors.iter().find(|(of, _)| small.place.is_some() && *of == small.place);
        if let Some((_, there)) = kept {
            return Ok(there.clone());
        }
        let before = small.place.and_then(|(stream, number)| Some((stream, number.checked_sub(1)?)));
        let follows = before.is_some() && self.last.take() == before && small.lead.is_some();
        let (textures, projection) = small.lead.unwrap_or((&self.still, paper::PROJECTION));
        let (motion, depth) = self.each.of(&textures.as_guidance())?;
        let at = self.next[0];
        self.anchors[at].0 = None;
        let to = self.anchors[at].1.clone();
        let shot = UpscaleParams {
            reset: !follows,
            frame_time: small.interval_ms,
            camera: camera(&projection),
            encoding: UpscaleFlags::COLOR_SRGB,
            ..UpscaleParams::of(dimensions(self.from), dimensions(self.to))
        };
        let pictures = UpscalePictures {
            color: resting(small.picture),
            depth: depth.resting(),
            motion: motion.resting(),
            exposure: None,
            reactive: None,
            transparency: None,
            output: resting(&to),
        };
        self.upscaler.upscale(&pictures, &shot)?;
        self.anchors[at].0 = small.place;
        self.next[0] = (at + 1) % ANCHORS;
        self.last = small.place;
        Ok(to)
    }

    /// Motion and depth at the upscaled size that lead to the anchor `place`.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn guidance(&mut self, place: Place, small: &Textures) -> Result<Textures> {
        if let Some((_, there)) = self.pairs.iter().find(|(of, _)| *of == Some(place)) {
            return Ok(there.clone());
        }
        let at = self.next[1];
        self.pairs[at].0 = None;
        let to = Textures { depth_is_even: small.depth_is_even, ..self.pairs[at].1.clone() };
        let constants = [self.from.0, self.from.1, self.to.0, self.to.1, small.motion_tile, small.depth_tile];
        let groups = [self.to.0.div_ceil(GROUP), self.to.1.div_ceil(GROUP), 1];
        let inputs = [View::Texture(resting(&small.motion), MOTION), View::Texture(resting(&small.depth), DEPTH)];
        let outputs = [View::Texture(resting(&to.motion), MOTION), View::Texture(resting(&to.depth), DEPTH)];
        let mut frame = self.ring.begin()?;
        frame.stage(c"Cairn: motion and depth of a larger anchor");
        frame.run(&self.upsample, &constants, &inputs, &outputs, groups)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        self.pairs[at] = (Some(place), to.clone());
        self.next[1] = (at + 1) % PAIRS;
        Ok(to)
    }

    /// The upscaled depth of the anchor `place` with its tile size, if it is cached.
    pub(super) fn depth(&self, place: Place) -> Option<(ID3D12Resource, u32)> {
        let found = self.pairs.iter().find(|(of, _)| *of == Some(place));
        found.map(|(_, textures)| (textures.depth.clone(), textures.depth_tile))
    }
}
