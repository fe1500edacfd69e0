//! Upscales Direct3D 12 textures, with the resource states and sanitised motion that [`Upscaler`] needs. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::bindings::{
    CreateUpscale, Dimensions, MemoryUsage, Resource, ResourceState, UpscaleCreateFlags, UpscaleResources,
};
use super::sanitised_motion::SanitisedMotion;
use super::texture_generator::{READ, WRITTEN, picture, texture};
use super::{Api, Choice, Provider, ReactiveMask, TextureMemory, UpscaleFrame, UpscaleParams, Upscaler};
use crate::gpu::compute::{CommandRecorder, CommandRing, ResourceWithState};
use crate::gpu::{FencePoint, Gpu};
use crate::{Error, ErrorKind, Result};

/// The inputs and the output of one upscaled frame. Each is a 2D texture with one mip level, array layer and sample, in the given
/// state before and after the list runs.
#[derive(Clone, Copy)]
pub struct UpscaleTextures<'a> {
    /// The frame at render size.
    pub color: ResourceWithState<'a>,
    /// Device depth at render size.
    pub depth: ResourceWithState<'a>,
    /// Motion vectors from this frame to the previous one, at render size, or at display size if the upscaler was created so. A
    /// vector that is not finite counts as zero; one longer than the picture is clamped to its size.
    pub motion: ResourceWithState<'a>,
    /// Exposure, a 1x1 texture whose value multiplies the frame's colours.
    pub exposure: Option<ResourceWithState<'a>>,
    /// Reactive mask at render size, 0 to 1: how little a pixel's history may be trusted; see [`TextureUpscaler::find_reactive`].
    pub reactive: Option<ResourceWithState<'a>>,
    /// Transparency mask at render size, 0 to 1: pixels whose colour does not belong to the depth and motion there.
    pub transparency: Option<ResourceWithState<'a>>,
    /// Receives the upscaled frame at display size. If shaders may not write it, the frame is made in a texture of the upscaler's
    /// and copied.
    pub output: ResourceWithState<'a>,
}

/// Upscales textures into an engine's textures, on the engine's list or the device's queue. At most three frames are in flight;
/// their resources are held until they have run.
///
/// Threads: one at a time; may move between threads.
pub struct TextureUpscaler {
    /// First, as its drop waits until the device no longer uses the fields below.
    ring: CommandRing,
    upscaler: Upscaler,
    gpu: Gpu,
    motion: SanitisedMotion,
    /// The upscaled frame, for outputs that shaders may not write.
    intermediate: Option<ID3D12Resource>,
    /// The inputs that the provider requires; empty if it cannot say.
    required: UpscaleResources,
}

/// The kinds of inputs that [`UpscaleTextures`] has.
const KNOWN: UpscaleResources = UpscaleResources::COLOR
    .union(UpscaleResources::DEPTH)
    .union(UpscaleResources::MOTION)
    .union(UpscaleResources::EXPOSURE)
    .union(UpscaleResources::REACTIVE)
    .union(UpscaleResources::TRANSPARENCY);

impl TextureUpscaler {
    /// Creates an upscaler on `gpu`, for its frame queue.
    ///
    /// # Errors
    /// As [`Upscaler::create`]; `Unsupported` with the field `provider` for one that requires another kind of input.
    pub fn new(gpu: &Gpu, api: &Api, choice: Choice, head: CreateUpscale) -> Result<Self> {
        // SAFETY: a live device, to which this holds a reference as long as the upscaler lives.
        let made = unsafe { Upscaler::create(api, gpu.device().as_raw(), choice, head) };
        let mut upscaler = made.map_err(|error| gpu.or_removed(error))?;
        let [required, _] = upscaler.resources()?.unwrap_or_default();
        if !(required - KNOWN).is_empty() {
            let why = format!("{} needs pictures of kinds {required:?}", upscaler.provider().version);
            return Err(Error::new(ErrorKind::Unsupported, why).field("provider").remedy("Choose another provider"));
        }
        let has_display_motion = head.flags.contains(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION);
        let size = if has_display_motion { head.max_upscale_size } else { head.max_render_size };
        Ok(Self {
            ring: CommandRing::new(gpu, gpu.frames(), SanitisedMotion::DESCRIPTORS)?,
            upscaler,
            gpu: gpu.clone(),
            motion: SanitisedMotion::new(gpu, size)?,
            intermediate: None,
            required,
        })
    }

    /// The provider in use.
    pub fn provider(&self) -> &Provider {
        self.upscaler.provider()
    }

    /// The inputs that every frame must have: colour, depth, motion, and others that the provider requires.
    pub fn required(&self) -> UpscaleResources {
        self.required | UpscaleResources::COLOR | UpscaleResources::DEPTH | UpscaleResources::MOTION
    }

    /// Device memory of the upscaler.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<TextureMemory> {
        let own = [Some(self.motion.texture()), self.intermediate.as_ref()].into_iter().flatten().map(|texture| {
            // SAFETY: a live device and resource.
            unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[texture.GetDesc()]) }.SizeInBytes
        });
        let (own, provider): (u64, Option<MemoryUsage>) = (own.sum(), self.upscaler.memory()?);
        Ok(TextureMemory { own, provider })
    }

    /// Upscales a frame on the device's frame queue; returns the fence point of its completion. Waits while three frames are in
    /// flight.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input on which a provider would fail, hang or crash, and for a required input that is
    /// missing; the library's own errors; `DeviceRemoved`, `OutOfMemory`. On an error nothing is submitted.
    pub fn upscale(&mut self, pictures: &UpscaleTextures<'_>, params: &UpscaleParams) -> Result<FencePoint> {
        let Self { ring, upscaler, gpu, motion, intermediate, required } = self;
        let mut frame = ring.begin()?;
        let mut parts = RecordingParts { gpu, upscaler: &mut *upscaler, motion, intermediate, required: *required };
        let recorded = parts.record(&mut frame, pictures, params);
        let fence_point = recorded.and_then(|()| frame.submit(gpu.frames()));
        // The library's history would contain a frame that never runs.
        fence_point.inspect_err(|_| upscaler.drop_history()).map_err(|error| gpu.or_removed(error))
    }

    /// As [`upscale`](Self::upscale), but records into an open list of the engine's for its frame queue. `until` is the fence point
    /// at which the list will have run; it must be reached even if the list is never submitted.
    ///
    /// Changes the list's descriptor heaps, compute root signature and pipeline, and no other state.
    ///
    /// # Errors
    /// As [`upscale`](Self::upscale), and `InvalidArgument` for a list of another device or type. After an error of the library the
    /// list may hold part of the work.
    pub fn record(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        until: &FencePoint,
        pictures: &UpscaleTextures<'_>,
        params: &UpscaleParams,
    ) -> Result<()> {
        let Self { ring, upscaler, gpu, motion, intermediate, required } = self;
        let mut frame = ring.begin_in(list, until)?;
        let mut parts = RecordingParts { gpu, upscaler: &mut *upscaler, motion, intermediate, required: *required };
        let recorded = parts.record(&mut frame, pictures, params);
        recorded.inspect_err(|_| upscaler.drop_history()).map_err(|error| gpu.or_removed(error))
    }

    /// Computes a reactive mask for [`UpscaleTextures::reactive`] of the same frame, on the device's frame queue, from the frame
    /// `color` and the same frame without transparent objects, `opaque`. `output` is written by shaders.
    ///
    /// # Errors
    /// As [`upscale`](Self::upscale); the error of a provider without reactive masks.
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
        frame.transition_to(opaque, READ)?;
        frame.transition_to(color, READ)?;
        frame.transition_to(output, WRITTEN)?;
        let describe = |given: &ResourceWithState<'_>, state| Resource::of(given.resource, state);
        let (input, written) = (ResourceState::COMPUTE_READ, ResourceState::UNORDERED_ACCESS);
        let list = frame.list().as_raw();
        // SAFETY: the frame's open list; its resources belong to the device, are in the stated states and are held by the frame;
        // the upscaler itself outlives the ring.
        unsafe {
            self.upscaler.find_reactive(
                list,
                describe(opaque, input),
                describe(color, input),
                describe(output, written),
                mask,
            )
        }
        .map_err(|error| self.gpu.or_removed(error))?;
        frame.resume();
        frame.submit(self.gpu.frames())
    }

    /// Drops the history at the next frame, as after a cut.
    pub fn drop_history(&mut self) {
        self.upscaler.drop_history();
    }
}

impl std::fmt::Debug for TextureUpscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TextureUpscaler({}, {:?})", self.provider().version, self.ring)
    }
}

/// The parts of the upscaler that recording a frame needs.
struct RecordingParts<'a> {
    gpu: &'a Gpu,
    upscaler: &'a mut Upscaler,
    motion: &'a mut SanitisedMotion,
    intermediate: &'a mut Option<ID3D12Resource>,
    required: UpscaleResources,
}

impl RecordingParts<'_> {
    fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        pictures: &UpscaleTextures<'_>,
        params: &UpscaleParams,
    ) -> Result<()> {
        let (rendered, shown) = (params.render_size, params.shown);
        for (size, field) in [(rendered, "render_size"), (shown, "shown")] {
            if let Some(why) = size.fault() {
                return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
            }
        }
        let flags = self.upscaler.creation().flags;
        let moved = if flags.contains(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION) { shown } else { rendered };
        const INPUT: ResourceState = ResourceState::COMPUTE_READ;
        let check_and_describe = |given: &ResourceWithState<'_>, size, field: &str, state| {
            picture(self.gpu, given, size, field).map(|()| Resource::of(given.resource, state))
        };
        let color = check_and_describe(&pictures.color, rendered, "color", INPUT)?;
        let depth = check_and_describe(&pictures.depth, rendered, "depth", INPUT)?;
        check_and_describe(&pictures.motion, moved, "motion", INPUT)?;
        let one = Dimensions { width: 1, height: 1 };
        let optional = |given: &Option<ResourceWithState<'_>>, size, field: &str, kind| match given {
            Some(given) => check_and_describe(given, size, field, INPUT),
            None if self.required.contains(kind) => {
                Err(Error::new(ErrorKind::InvalidArgument, "the provider must be given it").field(field))
            }
            None => Ok(Resource::default()),
        };
        let exposure = optional(&pictures.exposure, one, "exposure", UpscaleResources::EXPOSURE)?;
        let reactive = optional(&pictures.reactive, rendered, "reactive", UpscaleResources::REACTIVE)?;
        let transparency = optional(&pictures.transparency, rendered, "transparency", UpscaleResources::TRANSPARENCY)?;
        check_and_describe(&pictures.output, shown, "output", ResourceState::UNORDERED_ACCESS)?;
        // SAFETY: a live resource.
        let wanted = unsafe { pictures.output.resource.GetDesc() };
        let is_written = wanted.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
        if !is_written {
            // SAFETY: a live resource.
            let had = self.intermediate.as_ref().map(|intermediate| unsafe { intermediate.GetDesc() });
            if had.is_none_or(|had| (had.Width, had.Height, had.Format) != (wanted.Width, wanted.Height, wanted.Format))
            {
                // Frames in flight hold the previous texture.
                *self.intermediate = Some(texture(self.gpu, shown, wanted.Format)?);
            }
        }
        let intermediate = self.intermediate.as_ref().filter(|_| !is_written);
        let intermediate = intermediate.map(|resource| ResourceWithState { resource, state: WRITTEN });
        let output = intermediate.unwrap_or(pictures.output);
        self.motion.prepare(self.gpu, &pictures.motion, moved)?;
        let input = UpscaleFrame {
            command_list: frame.list().as_raw(),
            color,
            depth,
            motion: Resource::of(self.motion.texture(), INPUT),
            exposure,
            reactive,
            transparency,
            output: Resource::of(output.resource, ResourceState::UNORDERED_ACCESS),
            params: *params,
        };
        // Before anything is recorded.
        self.upscaler.check(&input)?;

        let motion = self.motion.record(frame, &pictures.motion, moved, params.motion_scale)?;
        let inputs = [Some(pictures.color), Some(pictures.depth), Some(motion)];
        let optional = [pictures.exposure, pictures.reactive, pictures.transparency];
        for input in inputs.iter().chain(&optional).flatten() {
            frame.transition_to(input, READ)?;
        }
        frame.transition_to(&output, WRITTEN)?;
        // SAFETY: the frame's open list; its resources belong to the device, are in the stated states and are held by the frame;
        // the upscaler itself outlives the ring.
        unsafe { self.upscaler.record(&input) }?;
        frame.resume();
        if let Some(intermediate) = intermediate {
            frame.transition_to(&intermediate, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
            frame.transition_to(&pictures.output, D3D12_RESOURCE_STATE_COPY_DEST)?;
            // SAFETY: an open list, and textures of one size and format in the states of a copy.
            unsafe { frame.list().CopyResource(pictures.output.resource, intermediate.resource) };
        }
        Ok(())
    }
}
