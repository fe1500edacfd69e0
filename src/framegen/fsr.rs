//! The generator of AMD's libraries: frames half way between two anchors, in textures of Direct3D 12. Windows only.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATES, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::{
    DXGI_FORMAT, DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT,
};

use super::shader::{GuidanceTextures, TexturePair};
use crate::Result;
use crate::ffx::bindings::{Dimensions, SurfaceFormat};
use crate::ffx::{Api, Camera, Choice, Pictures, Shot, TextureGenerator, TextureOptions, Version};
use crate::gpu::compute::{Frames, Kernel, Resting, Shape, View};
use crate::gpu::{Gpu, Moment, written_texture};
use crate::guidance::Projection;

/// Descriptors of a list that spreads motion and depth.
const ROOM: u32 = 4;
/// Sides of a group of threads.
const GROUP: u32 = 8;
/// How far the far plane is told to be at most, in distances of the near one: for depth in single precision that is infinite.
const FARTHEST: f32 = 1e8;
const MOTION: DXGI_FORMAT = DXGI_FORMAT_R16G16_FLOAT;
const DEPTH: DXGI_FORMAT = DXGI_FORMAT_R32_FLOAT;

/// Generates frames of one size half way between anchors of RGBA8, on a device's queue for frames.
///
/// A provider goes on from the frame before. What it records must therefore run, so that it is in lists of its own, which are submitted
/// at once; where anchors were left out it is shown the earlier one of a pair first.
///
/// Threads: one at a time; may move between them.
pub struct FsrGenerator {
    generator: TextureGenerator,
    gpu: Gpu,
    size: (u32, u32),
    spread: Kernel,
    ring: Frames,
    /// Motion and depth with one to a pixel; made for the first that have not.
    each: Option<[ID3D12Resource; 2]>,
    half: ID3D12Resource,
    /// The later anchor of the pair that it made a frame of last, which `half` is, and when that is there.
    last: Option<(Place, Moment)>,
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
    /// Makes it ready for pictures of `size`. Only a provider that puts a picture of known motion where it belongs is taken.
    ///
    /// # Errors
    /// As of [`TextureGenerator::new`].
    pub fn new(gpu: &Gpu, api: &Api, choice: Choice, size: (u32, u32)) -> Result<Self> {
        let shown = dimensions(size);
        let options = TextureOptions { choice, ..TextureOptions::new(shown, shown, SurfaceFormat::R8G8B8A8_UNORM) };
        let shape = Shape { constants: 4, inputs: 2, outputs: 2 };
        Ok(Self {
            generator: TextureGenerator::new(gpu, api, &options)?,
            gpu: gpu.clone(),
            size,
            spread: Kernel::new(gpu, include_bytes!("../gpu/shaders/fsr_spread.dxbc"), shape)?,
            ring: Frames::new(gpu, gpu.frames(), ROOM)?,
            each: None,
            half: written_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON)?,
            last: None,
        })
    }

    /// What runs.
    pub fn version(&self) -> &Version {
        &self.generator.provider().version
    }

    /// The frame half way between the anchors of a pair, RGBA8 and in the state COMMON, and when it is there; until the next one is made.
    ///
    /// # Errors
    /// As of [`TextureGenerator::generate`]. The next frame then starts anew.
    pub fn generate(&mut self, pair: &TexturePair<'_>, facts: &PairFacts) -> Result<(ID3D12Resource, Moment)> {
        let (stream, number) = facts.place;
        let last = self.last.take();
        if let Some((place, moment)) = last.as_ref().filter(|(place, _)| *place == facts.place) {
            let made = (self.half.clone(), moment.clone());
            self.last = Some((*place, moment.clone()));
            return Ok(made);
        }
        let before = number.checked_sub(1).map(|before| (stream, before));
        let goes_on = last.is_some_and(|(place, _)| Some(place) == before);
        let (motion, depth) = self.each(&pair.guidance)?;
        let shot = |reset| Shot {
            reset,
            frame_time: facts.interval_ms,
            camera: camera(&facts.projection),
            ..Shot::of(dimensions(self.size))
        };
        let pictures = |color| Pictures {
            color,
            output: Resting { resource: &self.half, state: D3D12_RESOURCE_STATE_COMMON },
            depth: depth.resting(),
            motion: motion.resting(),
            hudless: None,
            distortion: None,
        };
        if !goes_on {
            self.generator.generate(&pictures(pair.previous), &shot(true))?;
        }
        let moment = self.generator.generate(&pictures(pair.current), &shot(false))?;
        self.last = Some((facts.place, moment.clone()));
        Ok((self.half.clone(), moment))
    }

    /// Motion and depth with one to a pixel.
    fn each(&mut self, guidance: &GuidanceTextures<'_>) -> Result<(Held, Held)> {
        let hold = |resting: &Resting<'_>| Held { resource: resting.resource.clone(), state: resting.state };
        if [guidance.motion_tile, guidance.depth_tile] == [1, 1] {
            return Ok((hold(&guidance.motion), hold(&guidance.depth)));
        }
        let each = match &self.each {
            Some(each) => each,
            None => {
                let made = |format| written_texture(&self.gpu, self.size, format, D3D12_RESOURCE_STATE_COMMON);
                self.each.insert([made(MOTION)?, made(DEPTH)?])
            }
        };
        let [motion, depth] = each.clone().map(|resource| Held { resource, state: D3D12_RESOURCE_STATE_COMMON });
        let constants = [self.size.0, self.size.1, guidance.motion_tile, guidance.depth_tile];
        let groups = [self.size.0.div_ceil(GROUP), self.size.1.div_ceil(GROUP), 1];
        // SAFETY: live resources.
        let formats = unsafe { [guidance.motion, guidance.depth].map(|from| from.resource.GetDesc().Format) };
        let inputs = [View::Texture(guidance.motion, formats[0]), View::Texture(guidance.depth, formats[1])];
        let outputs = [View::Texture(motion.resting(), MOTION), View::Texture(depth.resting(), DEPTH)];
        let mut frame = self.ring.begin()?;
        frame.stage(c"Cairn: motion and depth of each pixel");
        frame.run(&self.spread, &constants, &inputs, &outputs, groups)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        Ok((motion, depth))
    }
}

impl std::fmt::Debug for FsrGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FsrGenerator({} x {}, {:?})", self.size.0, self.size.1, self.generator)
    }
}

/// A texture and the state it rests in.
struct Held {
    resource: ID3D12Resource,
    state: D3D12_RESOURCE_STATES,
}

impl Held {
    fn resting(&self) -> Resting<'_> {
        Resting { resource: &self.resource, state: self.state }
    }
}

/// A camera that looks ahead from the origin: where it really is nobody knows, and motion has it all.
fn camera(projection: &Projection) -> Camera {
    let near = projection.near();
    Camera { near, far: projection.far().min(near * FARTHEST), fov: projection.vertical_fov(), ..Camera::default() }
}

fn dimensions((width, height): (u32, u32)) -> Dimensions {
    Dimensions { width, height }
}
