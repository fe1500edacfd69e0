//! The generator of AMD's libraries: frames half way between two anchors, in textures of Direct3D 12. Windows only.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT_R8_UNORM, DXGI_FORMAT_R8G8B8A8_UNORM};

use super::densify::Densifier;
use super::shader::TexturePair;
use crate::ffx::bindings::{CreateFrameGeneration, Dimensions, SurfaceFormat};
use crate::ffx::{Api, Camera, Choice, Pictures, Shot, TextureGenerator, TextureOptions, Version};
use crate::gpu::compute::{CommandRing, Kernel, ResourceWithState, Shape, View};
use crate::gpu::{FencePoint, Gpu, written_texture};
use crate::guidance::Projection;
use crate::{Error, ErrorKind, Result};

/// Descriptors of a list that lays something over a frame.
const ROOM: u32 = 3;
/// Sides of a group of threads.
const GROUP: u32 = 8;
/// How far the far plane is told to be at most, in distances of the near one: for depth in single precision that is infinite.
const FARTHEST: f32 = 1e8;

/// Generates frames of one size half way between anchors of RGBA8, on a device's queue for frames.
///
/// A provider goes on from the frame before. What it records must therefore run, so that it is in lists of its own, which are submitted
/// at once; where anchors were left out it is shown the earlier one of a pair first.
///
/// Threads: one at a time; may move between them.
pub struct FsrGenerator {
    generator: TextureGenerator,
    size: (u32, u32),
    rendered: (u32, u32),
    each: Densifier,
    overlay: Overlay,
    half: ID3D12Resource,
    /// The later anchor of the pair that it made a frame of last, which `half` is, and when that is there.
    last: Option<(Place, FencePoint)>,
}

/// Which anchor it is: stream, and place in it. What follows another has the next place.
pub type Place = (u64, u64);

/// What a provider is told of a pair beside its textures.
#[derive(Debug, Clone, Copy)]
pub struct PairFacts {
    /// Of the later anchor.
    pub place: Place,
    /// Of the depth.
    pub projection: Projection,
    /// From the earlier anchor to the later one, in milliseconds of the world's time.
    pub interval_ms: f32,
}

impl FsrGenerator {
    /// Makes it ready for pictures of `size`, whose motion and depth are of the size `rendered`, the same or smaller. Only a provider that puts a picture of known motion where it belongs is taken.
    ///
    /// # Errors
    /// `Unsupported` for pictures with a side shorter than [`CreateFrameGeneration::SHORTEST_SIDE`]; as of
    /// [`TextureGenerator::new`].
    pub fn new(gpu: &Gpu, api: &Api, choice: Choice, size: (u32, u32), rendered: (u32, u32)) -> Result<Self> {
        let shortest = CreateFrameGeneration::SHORTEST_SIDE;
        if size.0.min(size.1) < shortest {
            let why =
                format!("AMD's libraries crash on pictures of {} x {} pixels: a side is too short", size.0, size.1);
            return Err(Error::new(ErrorKind::Unsupported, why)
                .field("size")
                .remedy(format!("Use pictures of at least {shortest} x {shortest} pixels, or another generator")));
        }
        let (shown, at) = (dimensions(size), dimensions(rendered));
        let options = TextureOptions { choice, ..TextureOptions::new(shown, at, SurfaceFormat::R8G8B8A8_UNORM) };
        Ok(Self {
            generator: TextureGenerator::new(gpu, api, &options)?,
            size,
            rendered,
            each: Densifier::new(gpu, rendered)?,
            overlay: Overlay::new(gpu, size)?,
            half: written_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON)?,
            last: None,
        })
    }

    /// What runs.
    pub fn version(&self) -> &Version {
        &self.generator.provider().version
    }

    /// The frame half way between the anchors of a pair, which has motion and depth of the size rendered at, RGBA8 and in the state COMMON, and when it is there; until the next one is made.
    ///
    /// # Errors
    /// As of [`TextureGenerator::generate`]. The next frame then starts anew.
    pub fn generate(&mut self, pair: &TexturePair<'_>, facts: &PairFacts) -> Result<(ID3D12Resource, FencePoint)> {
        let (stream, number) = facts.place;
        let last = self.last.take();
        if let Some((place, fence_point)) = last.as_ref().filter(|(place, _)| *place == facts.place) {
            let made = (self.half.clone(), fence_point.clone());
            self.last = Some((*place, fence_point.clone()));
            return Ok(made);
        }
        let before = number.checked_sub(1).map(|before| (stream, before));
        let goes_on = last.is_some_and(|(place, _)| Some(place) == before);
        let (motion, depth) = self.each.of(&pair.guidance)?;
        let shot = |reset| Shot {
            reset,
            frame_time: facts.interval_ms,
            camera: camera(&facts.projection),
            ..Shot::of(dimensions(self.rendered))
        };
        let pictures = |color| Pictures {
            color,
            output: ResourceWithState { resource: &self.half, state: D3D12_RESOURCE_STATE_COMMON },
            depth: depth.resting(),
            motion: motion.resting(),
            hudless: None,
            distortion: None,
        };
        if !goes_on {
            self.generator.generate(&pictures(pair.previous), &shot(true))?;
        }
        let mut fence_point = self.generator.generate(&pictures(pair.current), &shot(false))?;
        if let Some(hud) = &pair.guidance.hud {
            let half = ResourceWithState { resource: &self.half, state: D3D12_RESOURCE_STATE_COMMON };
            fence_point = self.overlay.lay(&pair.current, hud, &half)?;
        }
        self.last = Some((facts.place, fence_point.clone()));
        Ok((self.half.clone(), fence_point))
    }
}

impl std::fmt::Debug for FsrGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FsrGenerator({} x {}, {:?})", self.size.0, self.size.1, self.generator)
    }
}

/// Lays what stands still over frames, in lists of its own.
struct Overlay {
    gpu: Gpu,
    size: (u32, u32),
    kernel: Kernel,
    ring: CommandRing,
}

impl Overlay {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/fsr_overlay.dxbc");
        Ok(Self {
            gpu: gpu.clone(),
            size,
            kernel: Kernel::new(gpu, code, Shape { constants: 2, inputs: 2, outputs: 1 })?,
            ring: CommandRing::new(gpu, gpu.frames(), ROOM)?,
        })
    }

    /// Lays what `mask` says of `anchor` over `frame`; the moment when it lies there.
    fn lay(
        &mut self,
        anchor: &ResourceWithState<'_>,
        mask: &ResourceWithState<'_>,
        frame: &ResourceWithState<'_>,
    ) -> Result<FencePoint> {
        let groups = [self.size.0.div_ceil(GROUP), self.size.1.div_ceil(GROUP), 1];
        let inputs = [View::Texture(*anchor, DXGI_FORMAT_R8G8B8A8_UNORM), View::Texture(*mask, DXGI_FORMAT_R8_UNORM)];
        let output = View::Texture(*frame, DXGI_FORMAT_R8G8B8A8_UNORM);
        let mut list = self.ring.begin()?;
        list.stage(c"Cairn: what lies over a generated frame");
        list.run(&self.kernel, &[self.size.0, self.size.1], &inputs, &[output], groups)?;
        list.end_stage();
        list.submit(self.gpu.frames())
    }
}

/// A camera that looks ahead from the origin: where it really is nobody knows, and motion has it all.
pub(crate) fn camera(projection: &Projection) -> Camera {
    let near = projection.near();
    Camera { near, far: projection.far().min(near * FARTHEST), fov: projection.vertical_fov(), ..Camera::default() }
}

pub(crate) fn dimensions((width, height): (u32, u32)) -> Dimensions {
    Dimensions { width, height }
}
