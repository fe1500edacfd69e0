//! Frame generation from and into Direct3D 12 textures, with the resource states and sanitised motion that [`Generator`] needs.
//! Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::Interface;

use super::bindings::{
    Coordinates, CreateFlags, CreateFrameGeneration, Dimensions, MemoryUsage, Resource, ResourceState, SurfaceFormat,
};
use super::pass_through_detector::PassThroughDetector;
use super::sanitised_motion::SanitisedMotion;
use super::{Api, Choice, Frame, FrameParams, GenerationCheck, Generator, Provider, Version, self_test};
use crate::gpu::compute::{self, CommandRing, ResourceWithState};
use crate::gpu::{FencePoint, Gpu, writable_texture};
use crate::{Error, ErrorKind, Result};

/// How a [`TextureGenerator`] is created.
#[derive(Debug, Clone, Copy)]
pub struct TextureOptions {
    /// The wanted provider.
    pub choice: Choice,
    /// Sizes, format and flags. The flag for asynchronous generation is set from the type of the device's frame queue.
    pub head: CreateFrameGeneration,
    /// The format of HUD-less frames, if it differs.
    pub hudless: Option<SurfaceFormat>,
    /// Accepts a provider only if it passes the self-test: a generated frame of known motion. Costs two frames and their textures.
    pub self_test: bool,
    /// Checks on the device whether each frame was really generated or is a copy of the input; see [`TextureGenerator::last_check`].
    pub detect_pass_through: bool,
}

impl TextureOptions {
    /// Any provider that passes the self-test, for frames of that display size and format and that maximum render size.
    pub fn new(display_size: Dimensions, rendered: Dimensions, format: SurfaceFormat) -> Self {
        let head = CreateFrameGeneration {
            display_size,
            max_render_size: rendered,
            back_buffer_format: format,
            ..Default::default()
        };
        Self { choice: Choice::Any, head, hudless: None, self_test: true, detect_pass_through: false }
    }
}

/// The inputs of one generated frame and its output. Each is a 2D texture with one mip level, array layer and sample, in the given
/// state before and after the list runs.
#[derive(Clone, Copy)]
pub struct GenerationTextures<'a> {
    /// The frame at display size, in the format that the generator was created for.
    pub color: ResourceWithState<'a>,
    /// Receives the generated frame, of the same size and format. If shaders may not write it, as with a swap chain's buffers, the
    /// frame is generated into a texture of the generator's and copied. AMD's provider 3.1.5 writes the value of red into its alpha.
    pub output: ResourceWithState<'a>,
    /// Device depth at render size.
    pub depth: ResourceWithState<'a>,
    /// Motion vectors from this frame to the previous one, at render or display size, as the generator was created. A vector that
    /// is not finite counts as zero; one longer than the picture is clamped to its size.
    pub motion: ResourceWithState<'a>,
    /// The HUD-less frame at display size.
    pub hudless: Option<ResourceWithState<'a>>,
    /// Lens distortion field at display size: distorted minus undistorted position of each pixel, as a fraction of the picture.
    pub distortion: Option<ResourceWithState<'a>>,
}

/// Generates frames into an engine's textures, on the engine's list or the device's queue. At most three frames are in flight;
/// their resources are held until they have run.
///
/// Frames run on the device's frame queue. If that is a compute queue, generation is asynchronous: the provider gets
/// [`CreateFlags::ASYNC_WORKLOAD`], and the engine makes its own queue wait for the frame's fence point before it uses the frame.
///
/// Threads: one at a time; may move between threads.
pub struct TextureGenerator {
    /// First, as its drop waits until the device no longer uses the fields below.
    ring: CommandRing,
    generator: Generator,
    gpu: Gpu,
    motion: SanitisedMotion,
    /// The generated frame, for outputs that shaders may not write.
    intermediate: Option<ID3D12Resource>,
    detector: Option<PassThroughDetector>,
    refused: Vec<(Version, Error)>,
}

/// Device memory of a [`TextureGenerator`], in bytes.
#[derive(Debug, Clone, Copy)]
pub struct TextureMemory {
    /// Its own textures: sanitised motion, and the generated frame for outputs that shaders may not write.
    pub own: u64,
    /// The provider's memory, as it reports it; None if it cannot.
    pub provider: Option<MemoryUsage>,
}

/// Resource states for shader reads and writes.
pub(super) const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
pub(super) const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Width and height of a thread group.
pub(super) const GROUP: u32 = 8;

/// Descriptors per frame: for sanitised motion, and four for the pass-through detector.
const DESCRIPTORS: u32 = SanitisedMotion::DESCRIPTORS + 4;

impl TextureGenerator {
    /// Creates a generator on `gpu`. If the provider fails the self-test, one of the other family is tried, unless a family is
    /// required; [`refused`](Self::refused) lists the failures.
    ///
    /// # Errors
    /// As [`Generator::create`]; `Unsupported` with the field `provider` when no provider passes the self-test; `OutOfMemory`,
    /// `DeviceRemoved`.
    pub fn new(gpu: &Gpu, api: &Api, options: &TextureOptions) -> Result<Self> {
        let mut refused = Vec::new();
        let mut choice = options.choice;
        loop {
            let mut made = Self::untested(gpu, api, options, choice).map_err(|error| gpu.or_removed(error))?;
            let tested = if options.self_test { made.test(api, options, choice) } else { Ok(()) };
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

    /// Runs the self-test, with a generator of its own if this one needs HUD-less frames of another format, which shaders may not be able to write.
    fn test(&mut self, api: &Api, options: &TextureOptions, choice: Choice) -> Result<()> {
        if options.hudless.is_none_or(|hudless| hudless == options.head.back_buffer_format) {
            return self_test::run(self, options);
        }
        let options = TextureOptions { hudless: None, detect_pass_through: false, ..*options };
        self_test::run(&mut Self::untested(&self.gpu, api, &options, choice)?, &options)
    }

    fn untested(gpu: &Gpu, api: &Api, options: &TextureOptions, choice: Choice) -> Result<Self> {
        let mut head = options.head;
        let is_compute = gpu.frames().kind() == D3D12_COMMAND_LIST_TYPE_COMPUTE;
        head.flags.set(CreateFlags::ASYNC_WORKLOAD, is_compute);
        let device = gpu.device().as_raw();
        // SAFETY: a live device, to which the generator holds a reference as long as the context lives.
        let generator = unsafe { Generator::create(api, device, choice, head, options.hudless) }?;
        Ok(Self {
            ring: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
            generator,
            gpu: gpu.clone(),
            motion: SanitisedMotion::new(gpu, motion_size(&head))?,
            intermediate: None,
            detector: if options.detect_pass_through { Some(PassThroughDetector::new(gpu)?) } else { None },
            refused: Vec::new(),
        })
    }

    /// The provider in use.
    pub fn provider(&self) -> &Provider {
        self.generator.provider()
    }

    /// Device memory of the generator.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<TextureMemory> {
        let own = [Some(self.motion.texture()), self.intermediate.as_ref()].into_iter().flatten().map(|texture| {
            // SAFETY: a live device and resource.
            unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[texture.GetDesc()]) }.SizeInBytes
        });
        Ok(TextureMemory { own: own.sum(), provider: self.generator.memory()? })
    }

    /// The providers that failed the self-test, each with its error.
    pub fn refused(&self) -> &[(Version, Error)] {
        &self.refused
    }

    /// The result of the last checked frame that has run; None if no frame was checked.
    pub fn last_check(&mut self) -> Option<GenerationCheck> {
        self.detector.as_mut().and_then(PassThroughDetector::last)
    }

    /// Generates the frame between this one and the previous one on the device's frame queue; returns the fence point of its
    /// completion. Waits while three frames are in flight.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input on which a provider would fail, hang or crash; the library's own errors;
    /// `DeviceRemoved`, `OutOfMemory`. On an error nothing is submitted.
    pub fn generate(&mut self, pictures: &GenerationTextures<'_>, params: &FrameParams) -> Result<FencePoint> {
        let Self { ring, generator, gpu, motion, intermediate, detector, .. } = self;
        let mut frame = ring.begin()?;
        let mut parts =
            RecordingParts { gpu, generator: &mut *generator, motion, intermediate, detector: detector.as_mut() };
        let is_checked = parts.record(&mut frame, pictures, params);
        let fence_point = is_checked.and_then(|is_checked| Ok((is_checked, frame.submit(gpu.frames())?)));
        // The library's history would contain a frame that never runs.
        let (is_checked, fence_point) =
            fence_point.inspect_err(|_| generator.drop_history()).map_err(|error| gpu.or_removed(error))?;
        if let (Some(detector), true) = (detector, is_checked) {
            detector.expect_result_at(&fence_point);
        }
        Ok(fence_point)
    }

    /// As [`generate`](Self::generate), but records into an open list of the engine's for its frame queue. `until` is the fence
    /// point at which the list will have run; it must be reached even if the list is never submitted.
    ///
    /// Changes the list's descriptor heaps, compute root signature and pipeline, and no other state.
    ///
    /// # Errors
    /// As [`generate`](Self::generate), and `InvalidArgument` for a list of another device or type. After an error of the library
    /// the list may hold part of the work.
    pub fn record(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        until: &FencePoint,
        pictures: &GenerationTextures<'_>,
        params: &FrameParams,
    ) -> Result<()> {
        let Self { ring, generator, gpu, motion, intermediate, detector, .. } = self;
        let mut frame = ring.begin_in(list, until)?;
        let mut parts =
            RecordingParts { gpu, generator: &mut *generator, motion, intermediate, detector: detector.as_mut() };
        let is_checked = parts.record(&mut frame, pictures, params);
        drop(frame);
        let is_checked = is_checked.inspect_err(|_| generator.drop_history()).map_err(|error| gpu.or_removed(error))?;
        if let (Some(detector), true) = (detector, is_checked) {
            detector.expect_result_at(until);
        }
        Ok(())
    }

    /// Drops the history at the next frame, as after a cut.
    pub fn drop_history(&mut self) {
        self.generator.drop_history();
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

/// The parts of the generator that recording a frame needs.
struct RecordingParts<'a> {
    gpu: &'a Gpu,
    generator: &'a mut Generator,
    motion: &'a mut SanitisedMotion,
    intermediate: &'a mut Option<ID3D12Resource>,
    detector: Option<&'a mut PassThroughDetector>,
}

impl RecordingParts<'_> {
    /// Records a frame; returns whether it is checked.
    fn record(
        &mut self,
        frame: &mut compute::CommandRecorder<'_>,
        pictures: &GenerationTextures<'_>,
        params: &FrameParams,
    ) -> Result<bool> {
        let made = *self.generator.creation();
        let (display_size, motion) = (made.display_size, motion_size_at(&made, params.render_size));
        let check_and_describe = |given: &ResourceWithState<'_>, size, field: &str, state| {
            picture(self.gpu, given, size, field).map(|()| Resource::of(given.resource, state))
        };
        const INPUT: ResourceState = ResourceState::COMPUTE_READ;
        let optional = |given: &Option<ResourceWithState<'_>>, field| {
            given
                .as_ref()
                .map_or(Ok(Resource::default()), |given| check_and_describe(given, display_size, field, INPUT))
        };
        let color = check_and_describe(&pictures.color, display_size, "color", INPUT)?;
        let depth = check_and_describe(&pictures.depth, params.render_size, "depth", INPUT)?;
        check_and_describe(&pictures.motion, motion, "motion", INPUT)?;
        let (hudless, distortion) =
            (optional(&pictures.hudless, "hudless")?, optional(&pictures.distortion, "distortion")?);
        let target = check_and_describe(&pictures.output, display_size, "output", ResourceState::UNORDERED_ACCESS)?;
        if target.description.format != made.back_buffer_format {
            let why = "its format is not the one that the generator was made for";
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("output"));
        }
        // SAFETY: a live resource.
        let wanted = unsafe { pictures.output.resource.GetDesc() };
        let is_written = wanted.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
        if !is_written && self.intermediate.is_none() {
            *self.intermediate = Some(texture(self.gpu, display_size, wanted.Format)?);
        }
        let intermediate = self.intermediate.as_ref().filter(|_| !is_written);
        let intermediate = intermediate.map(|resource| ResourceWithState { resource, state: WRITTEN });
        let output = intermediate.unwrap_or(pictures.output);

        self.motion.prepare(self.gpu, &pictures.motion, motion)?;
        let input = Frame {
            command_list: frame.list().as_raw(),
            color,
            output: Resource::of(output.resource, ResourceState::UNORDERED_ACCESS),
            depth,
            motion: Resource::of(self.motion.texture(), INPUT),
            hudless,
            distortion,
            params: *params,
        };
        // Before anything is recorded.
        self.generator.check(&input)?;

        let clean = self.motion.record(frame, &pictures.motion, motion, params.motion_scale)?;
        let inputs = [Some(clean), Some(pictures.color), Some(pictures.depth), pictures.hudless, pictures.distortion];
        for input in inputs.iter().flatten() {
            frame.transition_to(input, READ)?;
        }
        frame.transition_to(&output, WRITTEN)?;
        let drops_history = params.reset || !self.generator.has_history();
        // SAFETY: the frame's open list; its resources belong to the device, are in the stated states and are held by the frame;
        // the generator itself outlives the ring.
        unsafe { self.generator.record(&input) }?;
        frame.resume();
        let is_checked = match self.detector.as_mut().filter(|_| !drops_history) {
            Some(detector) => {
                let scale = Coordinates {
                    x: params.motion_scale.x * display_size.width as f32 / motion.width as f32,
                    y: params.motion_scale.y * display_size.height as f32 / motion.height as f32,
                };
                detector.record(frame, &output, &pictures.color, &clean, (display_size, motion, scale))?;
                true
            }
            None => false,
        };
        if let Some(intermediate) = intermediate {
            frame.transition_to(&intermediate, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
            frame.transition_to(&pictures.output, D3D12_RESOURCE_STATE_COPY_DEST)?;
            // SAFETY: an open list, and textures of one size and format in the states of a copy.
            unsafe { frame.list().CopyResource(pictures.output.resource, intermediate.resource) };
        }
        Ok(is_checked)
    }
}

/// The largest size of the motion texture.
fn motion_size(made: &CreateFrameGeneration) -> Dimensions {
    motion_size_at(made, made.max_render_size)
}

pub(super) fn motion_size_at(made: &CreateFrameGeneration, rendered: Dimensions) -> Dimensions {
    if made.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) { made.display_size } else { rendered }
}

/// Checks that a resource is a single 2D texture of that size on this device.
pub(super) fn picture(gpu: &Gpu, given: &ResourceWithState<'_>, size: Dimensions, field: &str) -> Result<()> {
    gpu.owns(given.resource, field)?;
    // SAFETY: a live resource.
    let found = unsafe { given.resource.GetDesc() };
    let one = found.SampleDesc.Count == 1 && found.MipLevels == 1 && found.DepthOrArraySize == 1;
    let why = if found.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        "it is no texture of two dimensions with one sample, level and layer".to_owned()
    } else if (found.Width, found.Height) != (size.width.into(), size.height) {
        format!("it has {} x {} pixels, and not {} x {}", found.Width, found.Height, size.width, size.height)
    } else if found.Flags & D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE != D3D12_RESOURCE_FLAG_NONE {
        "it was made with D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE, so that no shader may read it".to_owned()
    } else {
        return Ok(());
    };
    Err(Error::new(ErrorKind::InvalidArgument, why).field(field))
}

/// A texture in the unordered-access state.
pub(super) fn texture(gpu: &Gpu, size: Dimensions, format: DXGI_FORMAT) -> Result<ID3D12Resource> {
    writable_texture(gpu, (size.width, size.height), format, WRITTEN)
}
