//! Frames between two, in textures of Direct3D 12: what [`Generator`] asks for, brought about. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::Interface;

use super::bindings::{
    Coordinates, CreateFlags, CreateFrameGeneration, Dimensions, MemoryUsage, Resource, ResourceState, SurfaceFormat,
};
use super::clean_motion::CleanMotion;
use super::watch::Watch;
use super::{Api, Choice, Frame, Generator, Provider, Seen, Shot, Version, self_test};
use crate::gpu::compute::{self, CommandRing, ResourceWithState};
use crate::gpu::{FencePoint, Gpu, written_texture};
use crate::{Error, ErrorKind, Result};

/// How a [`TextureGenerator`] is made.
#[derive(Debug, Clone, Copy)]
pub struct TextureOptions {
    /// Which provider.
    pub choice: Choice,
    /// Sizes, format and kind of the frames. Whether generation is asynchronous is told by the device's queue for frames.
    pub head: CreateFrameGeneration,
    /// The format of frames without interface, where it is another.
    pub hudless: Option<SurfaceFormat>,
    /// A provider is only taken when it puts a frame of known motion where it belongs. Costs two frames and their textures.
    pub self_test: bool,
    /// Each frame is looked at, whether it is one between or the one that was given; see [`TextureGenerator::seen`].
    pub watch: bool,
}

impl TextureOptions {
    /// Any provider that stands the test, for frames of that size and format, rendered at most so large.
    pub fn new(shown: Dimensions, rendered: Dimensions, format: SurfaceFormat) -> Self {
        let head = CreateFrameGeneration {
            display_size: shown,
            max_render_size: rendered,
            back_buffer_format: format,
            ..Default::default()
        };
        Self { choice: Choice::Any, head, hudless: None, self_test: true, watch: false }
    }
}

/// A frame, and where the one between it and the frame before is to go. Each is a texture of two dimensions with one level, layer
/// and sample, and in the state it rests in when the list is run, before and after.
#[derive(Clone, Copy)]
pub struct Pictures<'a> {
    /// The frame, of the size shown and the format that the generator was made for.
    pub color: ResourceWithState<'a>,
    /// Gets the generated frame, of the same size and format. Where shaders may not write it, such as a swapchain's own, the frame
    /// is made in a texture of the generator's and copied.
    pub output: ResourceWithState<'a>,
    /// Device depth, of the size rendered at.
    pub depth: ResourceWithState<'a>,
    /// From this frame to the one before, of the size rendered at or shown, as the generator was made. A vector that is not finite
    /// counts as none, and one that is longer than the picture as one of its length.
    pub motion: ResourceWithState<'a>,
    /// The frame without interface, of the size shown.
    pub hudless: Option<ResourceWithState<'a>>,
    /// Where a lens puts each pixel less where it was, in parts of the picture, of the size shown. Once one was given, every frame
    /// has one.
    pub distortion: Option<ResourceWithState<'a>>,
}

/// Generates frames into textures of an engine's, on its list or its queue. At most three frames are under way, and what they use is
/// held until they have run.
///
/// Frames run on the device's queue for frames. Where that is a compute queue, generation is asynchronous: the provider is told so,
/// and an engine has its own queue wait for the frame's moment before it uses what was generated.
///
/// Threads: one at a time; may move between them.
pub struct TextureGenerator {
    /// First: it waits until nothing that follows is used any more.
    ring: CommandRing,
    generator: Generator,
    gpu: Gpu,
    motion: CleanMotion,
    /// Frames for targets that shaders may not write.
    between: Option<ID3D12Resource>,
    watch: Option<Watch>,
    refused: Vec<(Version, Error)>,
}

/// What a [`TextureGenerator`] keeps on the device, in bytes.
#[derive(Debug, Clone, Copy)]
pub struct Memory {
    /// Its own textures: motion as a provider is given it, and frames for targets that shaders may not write.
    pub own: u64,
    /// What the provider reports of itself; None where it cannot say.
    pub provider: Option<MemoryUsage>,
}

/// What shaders read and write.
pub(super) const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
pub(super) const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Sides of a group of threads.
pub(super) const GROUP: u32 = 8;

/// Descriptors of a frame: those to clean its motion, and four to watch it.
const ROOM: u32 = CleanMotion::ROOM + 4;

impl TextureGenerator {
    /// Makes a generator on `gpu`. Where the provider that runs fails the test, one of the other family is tried, unless one is
    /// required; [`refused`](Self::refused) says why.
    ///
    /// # Errors
    /// As of [`Generator::create`]; `Unsupported`, of `provider`, when no provider stands the test; `OutOfMemory`, `DeviceRemoved`.
    pub fn new(gpu: &Gpu, api: &Api, options: &TextureOptions) -> Result<Self> {
        let mut refused = Vec::new();
        let mut choice = options.choice;
        loop {
            let mut made = Self::untested(gpu, api, options, choice)?;
            let tested = if options.self_test { self_test::run(&mut made, options) } else { Ok(()) };
            let why = match tested {
                Ok(()) => {
                    made.refused = refused;
                    return Ok(made);
                }
                Err(why) if [ErrorKind::DeviceRemoved, ErrorKind::OutOfMemory].contains(&why.kind()) => {
                    return Err(why);
                }
                Err(why) => why,
            };
            let Provider { version, offered, .. } = made.provider();
            log::warn!(target: "cairn::ffx", "{version} is not used: {why}");
            refused.push((version.clone(), why.clone()));
            let was_refused = |family| refused.iter().any(|(version, _)| version.family() == Some(family));
            let other = offered.iter().filter_map(Version::family).find(|family| !was_refused(*family));
            match (options.choice, other) {
                (Choice::Any | Choice::Prefer(_), Some(family)) => choice = Choice::Require(family),
                _ => return Err(why),
            }
        }
    }

    fn untested(gpu: &Gpu, api: &Api, options: &TextureOptions, choice: Choice) -> Result<Self> {
        let mut head = options.head;
        let is_compute = gpu.frames().kind() == D3D12_COMMAND_LIST_TYPE_COMPUTE;
        head.flags.set(CreateFlags::ASYNC_WORKLOAD, is_compute);
        let device = gpu.device().as_raw();
        // SAFETY: a live device, of which the generator holds a reference as long as the context lives.
        let generator = unsafe { Generator::create(api, device, choice, head, options.hudless) }?;
        Ok(Self {
            ring: CommandRing::new(gpu, gpu.frames(), ROOM)?,
            generator,
            gpu: gpu.clone(),
            motion: CleanMotion::new(gpu, motion_size(&head))?,
            between: None,
            watch: if options.watch { Some(Watch::new(gpu)?) } else { None },
            refused: Vec::new(),
        })
    }

    /// What runs.
    pub fn provider(&self) -> &Provider {
        self.generator.provider()
    }

    /// What it keeps on the device.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<Memory> {
        let own = [Some(self.motion.texture()), self.between.as_ref()].into_iter().flatten().map(|texture| {
            // SAFETY: a live device and resource.
            unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[texture.GetDesc()]) }.SizeInBytes
        });
        Ok(Memory { own: own.sum(), provider: self.generator.memory()? })
    }

    /// The providers that failed the test, with what was wrong with them.
    pub fn refused(&self) -> &[(Version, Error)] {
        &self.refused
    }

    /// What the last frame that was watched and has run was; None where none was, or nothing is watched.
    pub fn seen(&mut self) -> Option<Seen> {
        self.watch.as_mut().and_then(Watch::last)
    }

    /// Generates the frame between this one and the one before, on the device's queue for frames; the moment when it is there. Waits
    /// where three frames are under way.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what a provider would fail, hang or crash on; what the library answers;
    /// `DeviceRemoved`, `OutOfMemory`. Nothing is submitted then.
    pub fn generate(&mut self, pictures: &Pictures<'_>, shot: &Shot) -> Result<FencePoint> {
        let Self { ring, generator, gpu, motion, between, watch, .. } = self;
        let mut frame = ring.begin()?;
        let mut parts = Parts { gpu, generator: &mut *generator, motion, between, watch: watch.as_mut() };
        let watched = parts.record(&mut frame, pictures, shot);
        let fence_point = watched.and_then(|watched| Ok((watched, frame.submit(gpu.frames())?)));
        // What the library has of a frame that does not run is none to go on with.
        let (watched, fence_point) = fence_point.inspect_err(|_| generator.forget())?;
        if let (Some(watch), true) = (watch, watched) {
            watch.comes(&fence_point);
        }
        Ok(fence_point)
    }

    /// Records the same into an engine's open list for its queue for frames, which will have run at `until`, a moment that must come
    /// even if the list is never given to a queue.
    ///
    /// Left bound are others than before: descriptor heaps, compute root signature and pipeline, and nothing else.
    ///
    /// # Errors
    /// As of [`generate`](Self::generate), and `InvalidArgument` for a list of another device or type. After an answer of the library
    /// the list may hold a part of the work.
    pub fn record(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        until: &FencePoint,
        pictures: &Pictures<'_>,
        shot: &Shot,
    ) -> Result<()> {
        let Self { ring, generator, gpu, motion, between, watch, .. } = self;
        let mut frame = ring.begin_in(list, until)?;
        let mut parts = Parts { gpu, generator: &mut *generator, motion, between, watch: watch.as_mut() };
        let watched = parts.record(&mut frame, pictures, shot);
        drop(frame);
        let watched = watched.inspect_err(|_| generator.forget())?;
        if let (Some(watch), true) = (watch, watched) {
            watch.comes(until);
        }
        Ok(())
    }

    /// Starts anew with the next frame, as after a cut.
    pub fn forget(&mut self) {
        self.generator.forget();
    }

    /// Whether the next frame goes on from the one before.
    pub(super) fn follows(&self) -> bool {
        self.generator.follows()
    }

    pub(super) fn gpu(&self) -> &Gpu {
        &self.gpu
    }
}

impl std::fmt::Debug for TextureGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TextureGenerator({}, {:?})", self.provider().version, self.ring)
    }
}

/// What a frame is recorded with.
struct Parts<'a> {
    gpu: &'a Gpu,
    generator: &'a mut Generator,
    motion: &'a mut CleanMotion,
    between: &'a mut Option<ID3D12Resource>,
    watch: Option<&'a mut Watch>,
}

impl Parts<'_> {
    /// Records a frame; whether it is watched.
    fn record(
        &mut self,
        frame: &mut compute::CommandRecorder<'_>,
        pictures: &Pictures<'_>,
        shot: &Shot,
    ) -> Result<bool> {
        let made = *self.generator.made_with();
        let (shown, motion) = (made.display_size, motion_size_at(&made, shot.render_size));
        let told = |resting: &ResourceWithState<'_>, size, field: &str, state| {
            picture(self.gpu, resting, size, field).map(|()| Resource::of(resting.resource, state))
        };
        const INPUT: ResourceState = ResourceState::COMPUTE_READ;
        let optional = |given: &Option<ResourceWithState<'_>>, field| {
            given.as_ref().map_or(Ok(Resource::default()), |given| told(given, shown, field, INPUT))
        };
        let color = told(&pictures.color, shown, "color", INPUT)?;
        let depth = told(&pictures.depth, shot.render_size, "depth", INPUT)?;
        told(&pictures.motion, motion, "motion", INPUT)?;
        let (hudless, distortion) =
            (optional(&pictures.hudless, "hudless")?, optional(&pictures.distortion, "distortion")?);
        let target = told(&pictures.output, shown, "output", ResourceState::UNORDERED_ACCESS)?;
        if target.description.format != made.back_buffer_format {
            let why = "its format is not the one that the generator was made for";
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("output"));
        }
        // SAFETY: a live resource.
        let wanted = unsafe { pictures.output.resource.GetDesc() };
        let is_written = wanted.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
        if !is_written && self.between.is_none() {
            *self.between = Some(texture(self.gpu, shown, wanted.Format)?);
        }
        let between = self.between.as_ref().filter(|_| !is_written);
        let between = between.map(|resource| ResourceWithState { resource, state: WRITTEN });
        let output = between.unwrap_or(pictures.output);

        let clean = self.motion.record(self.gpu, frame, &pictures.motion, motion, shot.motion_scale)?;
        let inputs = [Some(clean), Some(pictures.color), Some(pictures.depth), pictures.hudless, pictures.distortion];
        for input in inputs.iter().flatten() {
            frame.bring(input, READ)?;
        }
        frame.bring(&output, WRITTEN)?;
        let asked = Frame {
            command_list: frame.list().as_raw(),
            color,
            output: Resource::of(output.resource, ResourceState::UNORDERED_ACCESS),
            depth,
            motion: Resource::of(clean.resource, INPUT),
            hudless,
            distortion,
            shot: *shot,
        };
        let starts = shot.reset || !self.generator.follows();
        // SAFETY: the frame's open list; what it uses is of the device, in the states that were told, and held by the frame, the
        // generator itself outlives the ring.
        unsafe { self.generator.record(&asked) }?;
        frame.resume();
        let watched = match self.watch.as_mut().filter(|_| !starts) {
            Some(watch) => {
                let scale = Coordinates {
                    x: shot.motion_scale.x * shown.width as f32 / motion.width as f32,
                    y: shot.motion_scale.y * shown.height as f32 / motion.height as f32,
                };
                watch.record(frame, &output, &pictures.color, &clean, (shown, motion, scale))?;
                true
            }
            None => false,
        };
        if let Some(between) = between {
            frame.bring(&between, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
            frame.bring(&pictures.output, D3D12_RESOURCE_STATE_COPY_DEST)?;
            // SAFETY: an open list, and textures of one size and format in the states of a copy.
            unsafe { frame.list().CopyResource(pictures.output.resource, between.resource) };
        }
        Ok(watched)
    }
}

/// The size of the largest motion that a generator is given.
fn motion_size(made: &CreateFrameGeneration) -> Dimensions {
    motion_size_at(made, made.max_render_size)
}

pub(super) fn motion_size_at(made: &CreateFrameGeneration, rendered: Dimensions) -> Dimensions {
    if made.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) { made.display_size } else { rendered }
}

/// Refuses what is no picture of that size.
pub(super) fn picture(gpu: &Gpu, given: &ResourceWithState<'_>, size: Dimensions, field: &str) -> Result<()> {
    gpu.owns(given.resource, field)?;
    // SAFETY: a live resource.
    let found = unsafe { given.resource.GetDesc() };
    let one = found.SampleDesc.Count == 1 && found.MipLevels == 1 && found.DepthOrArraySize == 1;
    let why = if found.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        "it is no texture of two dimensions with one sample, level and layer".to_owned()
    } else if (found.Width, found.Height) != (size.width.into(), size.height) {
        format!("it has {} x {} pixels, and not {} x {}", found.Width, found.Height, size.width, size.height)
    } else {
        return Ok(());
    };
    Err(Error::new(ErrorKind::InvalidArgument, why).field(field))
}

/// A texture that shaders write, resting so.
pub(super) fn texture(gpu: &Gpu, size: Dimensions, format: DXGI_FORMAT) -> Result<ID3D12Resource> {
    written_texture(gpu, (size.width, size.height), format, WRITTEN)
}
