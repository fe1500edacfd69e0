//! Frame generator with AMD's libraries: frames half way between two anchors, in Direct3D 12 textures. Windows only.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT_R8_UNORM, DXGI_FORMAT_R8G8B8A8_UNORM};

use super::AnchorId;
use super::densify::Densifier;
use super::shader::TexturePair;
use crate::ffx::bindings::{CreateFrameGeneration, Dimensions, SurfaceFormat};
use crate::ffx::{Api, Camera, Choice, FrameParams, GenerationTextures, TextureGenerator, TextureOptions, Version};
use crate::gpu::compute::{CommandRing, Kernel, ResourceWithState, Shape, View};
use crate::gpu::{FencePoint, Gpu, writable_texture};
use crate::guidance::Projection;
use crate::{Error, ErrorKind, Result};

/// Descriptors of a list that completes a frame.
const DESCRIPTORS: u32 = 4;
/// Side of a thread group, in threads.
const GROUP: u32 = 8;
/// Largest far plane that is passed to the provider, in multiples of the near plane: effectively infinite for single-precision depth.
const MAX_FAR_RATIO: f32 = 1e8;

/// Generates frames of one size half way between RGBA8 anchors, on a device's queue for frames.
///
/// A provider keeps history from frame to frame, so its commands must run: they are in lists of its own that are submitted at once. If
/// anchors were skipped, the provider first gets the earlier anchor of the pair with a reset.
///
/// Threads: one at a time; may move between them.
pub struct FsrGenerator {
    generator: TextureGenerator,
    size: (u32, u32),
    /// Size of motion and depth.
    guidance_size: (u32, u32),
    densifier: Densifier,
    finisher: FrameFinisher,
    /// The provider's frame.
    output: ID3D12Resource,
    /// The frame with the anchor's alpha and static overlay.
    finished: ID3D12Resource,
    /// The later anchor of the last pair, whose frame is in `finished`, and the fence point of that frame.
    last: Option<(AnchorId, FencePoint)>,
}

/// Parameters of a pair besides its textures.
#[derive(Debug, Clone, Copy)]
pub struct PairParams {
    /// Identity of the later anchor.
    pub anchor: AnchorId,
    /// Projection of the depth.
    pub projection: Projection,
    /// Time from the earlier anchor to the later one, in milliseconds of the world's time.
    pub interval_ms: f32,
}

impl FsrGenerator {
    /// Creates a generator for pictures of `size`, with motion and depth of `guidance_size`, the same or smaller. Only a provider that passes
    /// the test with a picture of known motion is accepted.
    ///
    /// # Errors
    /// `Unsupported` for pictures with a side shorter than [`CreateFrameGeneration::SHORTEST_SIDE`]; as of
    /// [`TextureGenerator::new`].
    pub fn new(gpu: &Gpu, api: &Api, choice: Choice, size: (u32, u32), guidance_size: (u32, u32)) -> Result<Self> {
        let shortest = CreateFrameGeneration::SHORTEST_SIDE;
        if size.0.min(size.1) < shortest {
            let cause =
                format!("AMD's libraries crash on pictures of {} x {} pixels: a side is too short", size.0, size.1);
            return Err(Error::new(ErrorKind::Unsupported, cause)
                .field("size")
                .remedy(format!("Use pictures of at least {shortest} x {shortest} pixels, or another generator")));
        }
        let (frames, guidance) = (dimensions(size), dimensions(guidance_size));
        let texture = || writable_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
        let options = TextureOptions { choice, ..TextureOptions::new(frames, guidance, SurfaceFormat::R8G8B8A8_UNORM) };
        Ok(Self {
            generator: TextureGenerator::new(gpu, api, &options)?,
            size,
            guidance_size,
            densifier: Densifier::new(gpu, guidance_size)?,
            finisher: FrameFinisher::new(gpu, size)?,
            output: texture()?,
            finished: texture()?,
            last: None,
        })
    }

    /// The version of the provider in use.
    pub fn version(&self) -> &Version {
        &self.generator.provider().version
    }

    /// Generates the frame half way between the anchors of a pair, whose motion and depth have the size given to [`new`](Self::new). Returns the
    /// frame, RGBA8 with the later anchor's alpha and in the state COMMON, and the fence point of its completion; the frame is valid until the next call.
    ///
    /// # Errors
    /// As of [`TextureGenerator::generate`]. The next frame then resets the history.
    pub fn generate(
        &mut self,
        pair: &TexturePair<'_>,
        pair_params: &PairParams,
    ) -> Result<(ID3D12Resource, FencePoint)> {
        let last = self.last.take();
        if let Some((anchor, fence_point)) = last.as_ref().filter(|(anchor, _)| *anchor == pair_params.anchor) {
            let made = (self.finished.clone(), fence_point.clone());
            self.last = Some((*anchor, fence_point.clone()));
            return Ok(made);
        }
        let follows = last.is_some_and(|(anchor, _)| Some(anchor) == pair_params.anchor.before());
        let (motion, depth) = self.densifier.densify(&pair.guidance)?;
        let params = |reset| FrameParams {
            reset,
            frame_time: pair_params.interval_ms,
            camera: camera(&pair_params.projection),
            ..FrameParams::of(dimensions(self.guidance_size))
        };
        let pictures = |color| GenerationTextures {
            color,
            output: ResourceWithState { resource: &self.output, state: D3D12_RESOURCE_STATE_COMMON },
            depth: depth.as_ref(),
            motion: motion.as_ref(),
            hudless: None,
            distortion: None,
        };
        if !follows {
            self.generator.generate(&pictures(pair.previous), &params(true))?;
        }
        self.generator.generate(&pictures(pair.current), &params(false))?;
        let in_common = |resource| ResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON };
        let [generated, finished] = [&self.output, &self.finished].map(in_common);
        let fence_point = self.finisher.finish(&generated, &pair.current, pair.guidance.hud.as_ref(), &finished)?;
        self.last = Some((pair_params.anchor, fence_point.clone()));
        Ok((self.finished.clone(), fence_point))
    }
}

impl std::fmt::Debug for FsrGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FsrGenerator({} x {}, {:?})", self.size.0, self.size.1, self.generator)
    }
}

/// Writes the alpha and the static overlay of anchors into frames, in lists of its own.
struct FrameFinisher {
    gpu: Gpu,
    size: (u32, u32),
    kernel: Kernel,
    ring: CommandRing,
}

impl FrameFinisher {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/compiled/fsr_finish.dxbc");
        Ok(Self {
            gpu: gpu.clone(),
            size,
            kernel: Kernel::new(gpu, code, Shape { constants: 3, inputs: 3, outputs: 1 })?,
            ring: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
        })
    }

    /// Writes `generated` to `finished`, with the alpha of `anchor` and its pixels where `mask` is not 0; returns the fence point of its completion.
    fn finish(
        &mut self,
        generated: &ResourceWithState<'_>,
        anchor: &ResourceWithState<'_>,
        mask: Option<&ResourceWithState<'_>>,
        finished: &ResourceWithState<'_>,
    ) -> Result<FencePoint> {
        let groups = [self.size.0.div_ceil(GROUP), self.size.1.div_ceil(GROUP), 1];
        // Without a mask the shader does not read it, and any texture is bound.
        let mask_view = mask.map_or_else(|| picture(anchor), |mask| View::Texture(*mask, DXGI_FORMAT_R8_UNORM));
        let inputs = [picture(generated), picture(anchor), mask_view];
        let constants = [self.size.0, self.size.1, u32::from(mask.is_some())];
        let mut list = self.ring.begin()?;
        list.begin_event(c"Cairn: alpha and static overlay of a generated frame");
        list.run(&self.kernel, &constants, &inputs, &[picture(finished)], groups)?;
        list.end_event();
        list.submit(self.gpu.frames())
    }
}

/// A view of an RGBA8 picture.
fn picture<'a>(texture: &ResourceWithState<'a>) -> View<'a> {
    View::Texture(*texture, DXGI_FORMAT_R8G8B8A8_UNORM)
}

/// A camera at the origin that looks ahead: the true pose is unknown, and the motion texture contains all motion.
pub(crate) fn camera(projection: &Projection) -> Camera {
    let near = projection.near();
    Camera {
        near,
        far: projection.far().min(near * MAX_FAR_RATIO),
        fov: projection.vertical_fov(),
        ..Camera::default()
    }
}

pub(crate) fn dimensions((width, height): (u32, u32)) -> Dimensions {
    Dimensions { width, height }
}
