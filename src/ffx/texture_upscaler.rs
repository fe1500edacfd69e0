//! Larger frames, in textures of Direct3D 12: what [`Upscaler`] asks for, brought about. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::bindings::{
    CreateUpscale, Dimensions, MemoryUsage, Resource, ResourceState, UpscaleCreateFlags, UpscaleResources,
};
use super::clean_motion::CleanMotion;
use super::textures::{READ, WRITTEN, picture, texture};
use super::{Api, Choice, Memory, Provider, ReactiveMask, UpscaleFrame, UpscaleShot, Upscaler};
use crate::gpu::compute::{CommandRecorder, CommandRing, ResourceWithState};
use crate::gpu::{FencePoint, Gpu};
use crate::{Error, ErrorKind, Result};

/// A frame, and where the larger one is to go. Each is a texture of two dimensions with one level, layer and sample, and in the state it
/// rests in when the list is run, before and after.
#[derive(Clone, Copy)]
pub struct UpscalePictures<'a> {
    /// The frame, of the size rendered at.
    pub color: ResourceWithState<'a>,
    /// Device depth, of the same size.
    pub depth: ResourceWithState<'a>,
    /// From this frame to the one before, of the same size or, where the upscaler was made so, of the size shown. A vector that is not
    /// finite counts as none, and one that is longer than the picture as one of its length.
    pub motion: ResourceWithState<'a>,
    /// What the frame's numbers are to be multiplied by, one pixel.
    pub exposure: Option<ResourceWithState<'a>>,
    /// From 0 to 1, how little each pixel's past is to be trusted, of the size rendered at; see [`TextureUpscaler::find_reactive`].
    pub reactive: Option<ResourceWithState<'a>>,
    /// From 0 to 1, where what is seen is not what depth and motion are of, of the size rendered at.
    pub transparency: Option<ResourceWithState<'a>>,
    /// Gets the larger frame, of the size shown. Where shaders may not write it, the frame is made in a texture of the upscaler's and
    /// copied.
    pub output: ResourceWithState<'a>,
}

/// Makes frames larger, from textures into textures of an engine's, on its list or its queue. At most three frames are under way, and what
/// they use is held until they have run.
///
/// Threads: one at a time; may move between them.
pub struct TextureUpscaler {
    /// First: it waits until nothing that follows is used any more.
    ring: CommandRing,
    upscaler: Upscaler,
    gpu: Gpu,
    motion: CleanMotion,
    /// Frames for targets that shaders may not write.
    large: Option<ID3D12Resource>,
    /// What the provider must be given, where it says so.
    required: UpscaleResources,
}

/// Pictures that can be given here.
const KNOWN: UpscaleResources = UpscaleResources::COLOR
    .union(UpscaleResources::DEPTH)
    .union(UpscaleResources::MOTION)
    .union(UpscaleResources::EXPOSURE)
    .union(UpscaleResources::REACTIVE)
    .union(UpscaleResources::TRANSPARENCY);

impl TextureUpscaler {
    /// Makes an upscaler on `gpu`, for its queue for frames.
    ///
    /// # Errors
    /// As of [`Upscaler::create`]; `Unsupported`, of `provider`, for one that needs a kind of picture that is not known here.
    pub fn new(gpu: &Gpu, api: &Api, choice: Choice, head: CreateUpscale) -> Result<Self> {
        // SAFETY: a live device, of which this holds a reference as long as the upscaler lives.
        let mut upscaler = unsafe { Upscaler::create(api, gpu.device().as_raw(), choice, head) }?;
        let [required, _] = upscaler.resources()?.unwrap_or_default();
        if !(required - KNOWN).is_empty() {
            let why = format!("{} needs pictures of kinds {required:?}", upscaler.provider().version);
            return Err(Error::new(ErrorKind::Unsupported, why).field("provider").remedy("Choose another provider"));
        }
        let has_shown_motion = head.flags.contains(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION);
        let size = if has_shown_motion { head.max_upscale_size } else { head.max_render_size };
        Ok(Self {
            ring: CommandRing::new(gpu, gpu.frames(), CleanMotion::ROOM)?,
            upscaler,
            gpu: gpu.clone(),
            motion: CleanMotion::new(gpu, size)?,
            large: None,
            required,
        })
    }

    /// What runs.
    pub fn provider(&self) -> &Provider {
        self.upscaler.provider()
    }

    /// The pictures that every frame must have; colour, depth and motion where the provider does not say.
    pub fn required(&self) -> UpscaleResources {
        self.required | UpscaleResources::COLOR | UpscaleResources::DEPTH | UpscaleResources::MOTION
    }

    /// What it keeps on the device.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<Memory> {
        let own = [Some(self.motion.texture()), self.large.as_ref()].into_iter().flatten().map(|texture| {
            // SAFETY: a live device and resource.
            unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[texture.GetDesc()]) }.SizeInBytes
        });
        let (own, provider): (u64, Option<MemoryUsage>) = (own.sum(), self.upscaler.memory()?);
        Ok(Memory { own, provider })
    }

    /// Makes a frame larger, on the device's queue for frames; the moment when it is there. Waits where three frames are under way.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what a provider would fail, hang or crash on, and for a picture that it must have and is not
    /// there; what the library answers; `DeviceRemoved`, `OutOfMemory`. Nothing is submitted then.
    pub fn upscale(&mut self, pictures: &UpscalePictures<'_>, shot: &UpscaleShot) -> Result<FencePoint> {
        let Self { ring, upscaler, gpu, motion, large, required } = self;
        let mut frame = ring.begin()?;
        let mut parts = Parts { gpu, upscaler: &mut *upscaler, motion, large, required: *required };
        let recorded = parts.record(&mut frame, pictures, shot);
        let fence_point = recorded.and_then(|()| frame.submit(gpu.frames()));
        // What the library has of a frame that does not run is none to go on with.
        fence_point.inspect_err(|_| upscaler.forget())
    }

    /// Records the same into an engine's open list for its queue for frames, which will have run at `until`, a moment that must come
    /// even if the list is never given to a queue.
    ///
    /// Left bound are others than before: descriptor heaps, compute root signature and pipeline, and nothing else.
    ///
    /// # Errors
    /// As of [`upscale`](Self::upscale), and `InvalidArgument` for a list of another device or type. After an answer of the library the
    /// list may hold a part of the work.
    pub fn record(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        until: &FencePoint,
        pictures: &UpscalePictures<'_>,
        shot: &UpscaleShot,
    ) -> Result<()> {
        let Self { ring, upscaler, gpu, motion, large, required } = self;
        let mut frame = ring.begin_in(list, until)?;
        let mut parts = Parts { gpu, upscaler: &mut *upscaler, motion, large, required: *required };
        parts.record(&mut frame, pictures, shot).inspect_err(|_| upscaler.forget())
    }

    /// Finds where a frame's past is not to be trusted, from the frame `color` and the same without what is transparent, on the device's
    /// queue for frames: for [`UpscalePictures::reactive`] of the same frame. `output` is written by shaders.
    ///
    /// # Errors
    /// As of [`upscale`](Self::upscale); what a provider without masks answers.
    pub fn find_reactive(
        &mut self,
        opaque: &ResourceWithState<'_>,
        color: &ResourceWithState<'_>,
        output: &ResourceWithState<'_>,
        mask: &ReactiveMask,
    ) -> Result<FencePoint> {
        let size = mask.render_size;
        let mut frame = self.ring.begin()?;
        for (given, field) in [(opaque, "opaque"), (color, "color"), (output, "output")] {
            picture(&self.gpu, given, size, field)?;
        }
        frame.bring(opaque, READ)?;
        frame.bring(color, READ)?;
        frame.bring(output, WRITTEN)?;
        let told = |given: &ResourceWithState<'_>, state| Resource::of(given.resource, state);
        let (input, written) = (ResourceState::COMPUTE_READ, ResourceState::UNORDERED_ACCESS);
        let list = frame.list().as_raw();
        // SAFETY: the frame's open list; what it uses is of the device, in the states that are told, and held by the frame; the
        // upscaler itself outlives the ring.
        unsafe {
            self.upscaler.find_reactive(list, told(opaque, input), told(color, input), told(output, written), mask)
        }?;
        frame.resume();
        frame.submit(self.gpu.frames())
    }

    /// Starts anew with the next frame, as after a cut.
    pub fn forget(&mut self) {
        self.upscaler.forget();
    }
}

impl std::fmt::Debug for TextureUpscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TextureUpscaler({}, {:?})", self.provider().version, self.ring)
    }
}

/// What a frame is recorded with.
struct Parts<'a> {
    gpu: &'a Gpu,
    upscaler: &'a mut Upscaler,
    motion: &'a mut CleanMotion,
    large: &'a mut Option<ID3D12Resource>,
    required: UpscaleResources,
}

impl Parts<'_> {
    fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        pictures: &UpscalePictures<'_>,
        shot: &UpscaleShot,
    ) -> Result<()> {
        let (rendered, shown) = (shot.render_size, shot.shown);
        for (size, field) in [(rendered, "render_size"), (shown, "shown")] {
            if let Some(why) = size.fault() {
                return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
            }
        }
        let flags = self.upscaler.made_with().flags;
        let moved = if flags.contains(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION) { shown } else { rendered };
        const INPUT: ResourceState = ResourceState::COMPUTE_READ;
        let told = |resting: &ResourceWithState<'_>, size, field: &str, state| {
            picture(self.gpu, resting, size, field).map(|()| Resource::of(resting.resource, state))
        };
        let color = told(&pictures.color, rendered, "color", INPUT)?;
        let depth = told(&pictures.depth, rendered, "depth", INPUT)?;
        told(&pictures.motion, moved, "motion", INPUT)?;
        let one = Dimensions { width: 1, height: 1 };
        let optional = |given: &Option<ResourceWithState<'_>>, size, field: &str, kind| match given {
            Some(given) => told(given, size, field, INPUT),
            None if self.required.contains(kind) => {
                Err(Error::new(ErrorKind::InvalidArgument, "the provider must be given it").field(field))
            }
            None => Ok(Resource::default()),
        };
        let exposure = optional(&pictures.exposure, one, "exposure", UpscaleResources::EXPOSURE)?;
        let reactive = optional(&pictures.reactive, rendered, "reactive", UpscaleResources::REACTIVE)?;
        let transparency = optional(&pictures.transparency, rendered, "transparency", UpscaleResources::TRANSPARENCY)?;
        told(&pictures.output, shown, "output", ResourceState::UNORDERED_ACCESS)?;
        // SAFETY: a live resource.
        let wanted = unsafe { pictures.output.resource.GetDesc() };
        let is_written = wanted.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
        if !is_written {
            // SAFETY: a live resource.
            let had = self.large.as_ref().map(|large| unsafe { large.GetDesc() });
            if had.is_none_or(|had| (had.Width, had.Height, had.Format) != (wanted.Width, wanted.Height, wanted.Format))
            {
                // What is under way holds the one before.
                *self.large = Some(texture(self.gpu, shown, wanted.Format)?);
            }
        }
        let large = self.large.as_ref().filter(|_| !is_written);
        let large = large.map(|resource| ResourceWithState { resource, state: WRITTEN });
        let output = large.unwrap_or(pictures.output);
        let motion = self.motion.record(self.gpu, frame, &pictures.motion, moved, shot.motion_scale)?;
        let inputs = [Some(pictures.color), Some(pictures.depth), Some(motion)];
        let optional = [pictures.exposure, pictures.reactive, pictures.transparency];
        for input in inputs.iter().chain(&optional).flatten() {
            frame.bring(input, READ)?;
        }
        frame.bring(&output, WRITTEN)?;
        let asked = UpscaleFrame {
            command_list: frame.list().as_raw(),
            color,
            depth,
            motion: Resource::of(motion.resource, INPUT),
            exposure,
            reactive,
            transparency,
            output: Resource::of(output.resource, ResourceState::UNORDERED_ACCESS),
            shot: *shot,
        };
        // SAFETY: the frame's open list; what it uses is of the device, in the states that were told, and held by the frame, the
        // upscaler itself outlives the ring.
        unsafe { self.upscaler.record(&asked) }?;
        frame.resume();
        if let Some(large) = large {
            frame.bring(&large, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
            frame.bring(&pictures.output, D3D12_RESOURCE_STATE_COPY_DEST)?;
            // SAFETY: an open list, and textures of one size and format in the states of a copy.
            unsafe { frame.list().CopyResource(pictures.output.resource, large.resource) };
        }
        Ok(())
    }
}
