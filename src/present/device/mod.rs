//! Presenter frames made on a Direct3D 12 device. Windows only.
//!
//! All work on a frame is recorded into command lists of our own and submitted to the device's queue for frames. A frame that an engine records
//! into its own list is first made in memory of the presenter; the engine's list only copies it from there. So the engine may submit that list
//! late, in another order, or never. The device returns only a small report per frame, which is read when a later frame is made.

mod cut_reports;
mod half_way;
mod inputs;
mod output_pass;
mod pictures;
mod recorded;
mod reports;
mod resource_cache;
mod scaling;
mod shader_path;
mod upsampler;

use std::time::Instant;

use windows::Win32::Graphics::Direct3D12::{ID3D12GraphicsCommandList, ID3D12Resource};

use super::area::Area;
use super::frame::{FrameKey, FramePlan, FrameRequest, FrameSource, FrameTimes};
use crate::ffx::{Api, Choice, Version};
use crate::framegen::shader;
use crate::gpu::compute::picture_formats::{PictureFormat, target as format_of};
use crate::gpu::compute::{CommandRing, GpuTimeStatistics, Output, ResourceWithState};
use crate::gpu::{FencePoint, Gpu, Target, check_list};
use crate::world::GuidanceSource;
use crate::{Colours, Error, Result};
use half_way::HalfWayGenerator;
use inputs::{FrameInputs, in_common_state};
pub use pictures::PictureUpscaler;
use recorded::RecordedFrames;
pub use recorded::RetiredFrames;
pub(in crate::present) use reports::DeviceReport;
use reports::ReportCollector;
use resource_cache::ResourceCache;
pub use scaling::ScaledBy;
use scaling::{UpscaleResult, Upscaling};
use shader_path::{PairKey, ShaderPath};

/// Makes a presenter's frames on a Direct3D 12 device from anchors of one size: with the `shader` generator, or with `fsr` for the frame half
/// way between two anchors. [`new`](Self::new) and [`Presenter::prepare`](super::presenter::Presenter::prepare) create all resources; making a
/// frame creates none.
///
/// Belongs to one presenter.
///
/// Threads: one at a time; may move between them.
pub struct DeviceDrawer {
    gpu: Gpu,
    /// Size of the anchors.
    size: (u32, u32),
    /// Colours of the targets.
    colours: Colours,
    /// The size at which frames are generated: that of the anchors, or of the upscaled anchors.
    generation_size: (u32, u32),
    shaders: ShaderPath,
    /// AMD's upscaler, if the caller chose it.
    upscaling: Option<Upscaling>,
    /// AMD's frame generator, if the caller chose it.
    half_way: Option<HalfWayGenerator>,
    /// Command lists of frames.
    ring: CommandRing,
    /// Inputs of frames.
    cache: ResourceCache,
    reports: ReportCollector,
    /// Finished frames that an engine's lists copy from.
    recorded: RecordedFrames,
    /// Frames of earlier preparations that an engine's lists may still copy from.
    retired: RetiredFrames,
    /// The last preparation; `None` if it failed.
    prepared: Option<Prepared>,
    /// Key of the last frame that was made.
    last: Option<FrameKey>,
}

/// Sizes and formats to prepare for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preparation {
    /// `(width, height)` of the frames.
    pub size: (u32, u32),
    /// Largest number of bytes per pixel of the targets: 4, or 8 for half floats.
    pub pixel_bytes: u32,
    /// How many recorded frames may wait for the engine's lists to run; 0 if frames are only submitted.
    pub lists: usize,
    /// Pictures per anchor.
    pub pictures: usize,
    /// `[channels, height, width]` of the anchors' latents if motion is extracted from them; otherwise all 0.
    pub latent: [u32; 3],
}

/// Default of [`Preparation::lists`].
pub const LISTS: usize = 4;

impl Preparation {
    /// For frames of `size` in any format.
    pub fn new(size: (u32, u32)) -> Self {
        Self { size, pixel_bytes: 8, lists: LISTS, pictures: 1, latent: [0; 3] }
    }
}

/// The preparation of a drawer.
#[derive(Clone, Copy)]
struct Prepared {
    /// Size of the frames.
    size: (u32, u32),
    /// Largest number of bytes per pixel of the targets.
    pixel_bytes: u32,
    /// Whether anchors keep their aspect ratio in frames of another.
    letterbox: bool,
}

/// Result of a request for a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameResult<T> {
    /// The frame was made.
    Made(T),
    /// No anchor has arrived yet.
    NoAnchor,
    /// [`Presenter::prepare`](super::presenter::Presenter::prepare) was not called for frames of this size and format. Nothing was made.
    NotPrepared,
    /// Every slot holds a recorded frame whose list may not have run. Nothing was recorded.
    QueueFull,
}

impl<T> FrameResult<T> {
    /// The frame, if it was made.
    pub fn made(self) -> Option<T> {
        if let Self::Made(made) = self { Some(made) } else { None }
    }

    /// Converts the frame, if it was made.
    pub(super) fn map<U>(self, convert: impl FnOnce(T) -> U) -> FrameResult<U> {
        match self {
            Self::Made(made) => FrameResult::Made(convert(made)),
            Self::NoAnchor => FrameResult::NoAnchor,
            Self::NotPrepared => FrameResult::NotPrepared,
            Self::QueueFull => FrameResult::QueueFull,
        }
    }
}

impl DeviceDrawer {
    /// Creates a drawer for anchors of `size` and frames in `colours`.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`](shader::ShaderGenerator::new).
    pub fn new(gpu: &Gpu, size: (u32, u32), colours: Colours) -> Result<Self> {
        Ok(Self {
            gpu: gpu.clone(),
            size,
            colours,
            generation_size: size,
            shaders: ShaderPath::new(gpu, size, colours)?,
            upscaling: None,
            half_way: None,
            ring: CommandRing::new(gpu, gpu.frames(), shader::DESCRIPTORS + output_pass::DESCRIPTORS)?,
            cache: ResourceCache::new(gpu, size)?,
            reports: ReportCollector::new(gpu)?,
            recorded: RecordedFrames::none(),
            retired: RetiredFrames::default(),
            prepared: None,
            last: None,
        })
    }

    /// From now on a provider of AMD's in `api` makes the frames half way between two anchors. Only a provider that passes the test with a picture
    /// of known motion is accepted. Shaders still make frames at other phases and extrapolated frames. If the provider fails later, shaders make
    /// its frames too; with `is_required`, drawing fails instead.
    ///
    /// A provider keeps history from frame to frame. If the frame half way to an anchor is skipped, the next one costs a second call of the provider.
    ///
    /// # Errors
    /// As for [`TextureGenerator::new`](crate::ffx::TextureGenerator::new).
    pub fn use_fsr(&mut self, api: &Api, choice: Choice, is_required: bool) -> Result<()> {
        let (size, guidance) = (self.generation_size, self.size);
        self.half_way = Some(HalfWayGenerator::new(&self.gpu, api, choice, is_required, size, guidance)?);
        Ok(())
    }

    /// From now on a provider of AMD's upscaler in `api` upscales anchors to the size of frames before frames are generated between them. It is used
    /// only if frames are larger than anchors and anchors do not bring all frames of their interval with them, because its history goes from anchor
    /// to anchor. If the provider fails, frames are resized spatially; with `is_required`, drawing fails instead.
    pub fn use_fsr_upscaler(&mut self, api: &Api, choice: Choice, is_required: bool) {
        self.upscaling = Some(Upscaling::new(api, choice, is_required));
    }

    /// The provider that made the last generated frame, or will make the first one half way; `None` if shaders did or will.
    pub fn made_by_fsr(&self) -> Option<&Version> {
        self.half_way.as_ref().and_then(HalfWayGenerator::version_in_use)
    }

    /// The failure after which the provider is not used any more, if it failed.
    pub fn fsr_failed(&self) -> Option<&Error> {
        self.half_way.as_ref().and_then(HalfWayGenerator::failure)
    }

    /// How frames are scaled, as of the last preparation.
    pub fn scaled_by(&self) -> ScaledBy<'_> {
        match self.upscaling.as_ref().and_then(Upscaling::version_in_use) {
            Some(version) => ScaledBy::Amd(version),
            None if self.shaders.resizes() => ScaledBy::Space,
            None => ScaledBy::Nothing,
        }
    }

    /// The failure after which the upscaler is not used any more, if it failed.
    pub fn upscaler_failed(&self) -> Option<&Error> {
        self.upscaling.as_ref().and_then(Upscaling::failure)
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Whether this drawer takes anchors of `size` and its queue for frames is that of `gpu`.
    pub fn fits(&self, gpu: &Gpu, size: (u32, u32)) -> bool {
        self.size == size && self.gpu.frames().d3d12() == gpu.frames().d3d12()
    }

    /// Creates everything that frames of this preparation need. `motion`: source of motion for anchors without guidance. `brings_all`: anchors
    /// bring all frames of their interval.
    ///
    /// # Errors
    /// As of [`Presenter::prepare`](super::presenter::Presenter::prepare). Nothing is prepared then.
    pub(super) fn prepare(
        &mut self,
        preparation: &Preparation,
        motion: GuidanceSource,
        letterbox: bool,
        brings_all: bool,
    ) -> Result<()> {
        self.prepared = None;
        let area = Area::of(self.size, preparation.size, letterbox);
        let generation_size = match &mut self.upscaling {
            Some(upscaling) => upscaling.resize(&self.gpu, self.size, area.size, brings_all)?,
            None => self.size,
        };
        self.set_generation_size(generation_size)?;
        self.cache.prepare(motion, preparation.latent)?;
        self.set_output_size(preparation.size, letterbox)?;
        let Preparation { size, pixel_bytes, lists, .. } = *preparation;
        let recorded = RecordedFrames::new(&self.gpu, lists, size, pixel_bytes)?;
        self.retired.push(std::mem::replace(&mut self.recorded, recorded));
        self.last = None;
        self.prepared = Some(Prepared { size, pixel_bytes, letterbox });
        Ok(())
    }

    /// Sets the size at which frames are generated.
    fn set_generation_size(&mut self, size: (u32, u32)) -> Result<()> {
        self.cache.set_generation_size(size)?;
        if self.generation_size == size {
            return Ok(());
        }
        self.last = None;
        // If a step below fails, no size matches and the next call creates everything again.
        self.generation_size = (0, 0);
        self.shaders.resize(&self.gpu, size)?;
        if let Some(half_way) = &mut self.half_way {
            half_way.resize(&self.gpu, size, self.size)?;
        }
        self.generation_size = size;
        Ok(())
    }

    /// Sets the size of the frames.
    fn set_output_size(&mut self, size: (u32, u32), letterbox: bool) -> Result<()> {
        self.shaders.set_output_size(&mut self.cache, &self.gpu, self.generation_size, size, letterbox)
    }

    /// Whether frames can be recorded into an engine's lists: the preparation has slots for them.
    pub(super) fn can_record(&self) -> bool {
        !self.recorded.is_empty()
    }

    /// Makes the requested frame and records its copy over `target` into an engine's open list, which has run once `until` is reached.
    ///
    /// # Errors
    /// As for [`Presenter::record`](super::presenter::Presenter::record).
    pub(super) fn record(
        &mut self,
        request: &mut FrameRequest,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) -> Result<FrameResult<FrameTimes>> {
        let Some(format) = self.check(request, target)? else { return Ok(FrameResult::NotPrepared) };
        let (slot, times) = match self.recorded.find(request.key, format) {
            Some(slot) => {
                self.reports.count_repeat();
                (slot, FrameTimes::default())
            }
            None => {
                let Some(slot) = self.recorded.free_slot() else { return Ok(FrameResult::QueueFull) };
                let (_, times) = self.make(request, format, Destination::Slot(slot))?;
                self.recorded.set_frame(slot, request.key, format);
                (slot, times)
            }
        };
        self.recorded.record_copy(slot, list, target, until);
        Ok(FrameResult::Made(times))
    }

    /// Makes the requested frame in `target`; returns the fence point at which it is finished.
    ///
    /// # Errors
    /// As for [`Presenter::record`](super::presenter::Presenter::record).
    pub(super) fn submit(
        &mut self,
        request: &mut FrameRequest,
        target: &Target,
    ) -> Result<FrameResult<(FencePoint, FrameTimes)>> {
        let Some(format) = self.check(request, target)? else { return Ok(FrameResult::NotPrepared) };
        self.make(request, format, Destination::Target(target)).map(FrameResult::Made)
    }

    /// Checks that the requested frame can be made in `target`, and sets whether it repeats the last one. Returns the target's pixel format;
    /// `None` if the frame is not prepared.
    fn check(&self, request: &mut FrameRequest, target: &Target) -> Result<Option<PictureFormat>> {
        if request.anchor_size() != self.size {
            return Ok(None);
        }
        let size = request.size();
        target.check(&self.gpu, self.gpu.frames().kind(), size, self.colours)?;
        let texture = ResourceWithState { resource: &target.texture, state: target.before };
        let format = format_of(&self.gpu, &texture, [size.0, size.1])?;
        let fits = |prepared: &Prepared| {
            prepared.size == size && prepared.letterbox == request.letterbox && format.bytes <= prepared.pixel_bytes
        };
        if !self.prepared.as_ref().is_some_and(fits) {
            return Ok(None);
        }
        request.info.repeated = self.last == Some(request.key);
        Ok(Some(format))
    }

    /// Submits the work of a frame; returns the fence point at which it is finished.
    fn make(
        &mut self,
        request: &FrameRequest,
        format: PictureFormat,
        to: Destination<'_>,
    ) -> Result<(FencePoint, FrameTimes)> {
        self.last = None;
        let mut times = FrameTimes::default();
        let start = Instant::now();
        let inputs = self.inputs(request)?;
        times.guidance = start.elapsed();
        let start = Instant::now();
        let inputs = self.upscale(inputs, request)?;
        times.resize = start.elapsed();
        let start = Instant::now();
        let half_way = self.prepare_plan(request, &inputs)?;
        let fence_point = self.submit_frame(request, &inputs, half_way.as_ref(), format, to)?;
        times.generate = start.elapsed();
        self.last = Some(request.key);
        Ok((fence_point, times))
    }

    /// The inputs of a frame at the anchors' size.
    fn inputs(&mut self, request: &FrameRequest) -> Result<FrameInputs> {
        let anchor = request.plan.anchor_id();
        let lacks = |upscaling: &Upscaling| anchor.is_some_and(|anchor| upscaling.lacks(anchor));
        let with_guidance = self.upscaling.as_ref().is_some_and(lacks);
        self.cache.inputs(request, with_guidance)
    }

    /// Replaces a frame's inputs by upscaled ones if the upscaler is in use.
    fn upscale(&mut self, inputs: FrameInputs, request: &FrameRequest) -> Result<FrameInputs> {
        let Some(upscaling) = &mut self.upscaling else { return Ok(inputs) };
        match upscaling.upscale(&inputs, request)? {
            UpscaleResult::Inactive => Ok(inputs),
            UpscaleResult::Upscaled(upscaled) => Ok(upscaled),
            UpscaleResult::Failed => {
                // Nothing is prepared if one of these fails.
                let prepared = self.prepared.take();
                // Allocates memory for frames of the anchors' size. The device caches the pipelines already.
                self.set_generation_size(self.size)?;
                self.set_output_size(request.size(), request.letterbox)?;
                self.prepared = prepared;
                // The overlay mask had the upscaled size.
                self.cache.inputs(request, false)
            }
        }
    }

    /// Submits the work that precedes an interpolated frame: the provider's frame, which is returned, or else the shaders'
    /// work for the pair.
    fn prepare_plan(&mut self, request: &FrameRequest, inputs: &FrameInputs) -> Result<Option<ID3D12Resource>> {
        let half_way = match &mut self.half_way {
            Some(half_way) => half_way.generate(&request.plan, inputs, request.interval_ms())?,
            None => None,
        };
        if let (FramePlan::Interpolate { id, .. }, None) = (&request.plan, &half_way) {
            let key = PairKey { anchor: *id, overlay: self.cache.overlay_version() };
            self.shaders.prepare_pair(&mut self.cache, &self.gpu, &inputs.pair()?, key)?;
        }
        Ok(half_way)
    }

    /// Submits the list that finishes a frame and writes it to its destination. `half_way`: the provider's frame, if there is one.
    fn submit_frame(
        &mut self,
        request: &FrameRequest,
        inputs: &FrameInputs,
        half_way: Option<&ID3D12Resource>,
        format: PictureFormat,
        to: Destination<'_>,
    ) -> Result<FencePoint> {
        let output = match to {
            Destination::Target(target) => {
                Output::from(&ResourceWithState { resource: &target.texture, state: target.before })
            }
            Destination::Slot(slot) => Output::rows(in_common_state(self.recorded.memory(slot)), format),
        };
        let slot = self.ring.next_slot();
        let mut frame = self.ring.begin()?;
        frame.begin_event(match request.info.source {
            FrameSource::Generated => c"Cairn: a frame between two anchors",
            FrameSource::Extrapolated => c"Cairn: a frame beyond an anchor",
            _ => c"Cairn: an anchor",
        });
        let is_copied = request.info.repeated && self.shaders.record_again(&mut frame, format, output)?;
        if !is_copied {
            self.shaders.record(&mut frame, &request.plan, inputs, half_way, format, output)?;
        }
        self.reports.cuts.record(&mut frame, slot, &self.shaders.report())?;
        if let Destination::Target(target) = to {
            frame.set_final_state(&target.texture, target.after);
        }
        frame.end_event();
        // Only shader interpolation detects cuts on the device. Other plans know them beforehand, and a provider does not report a cut.
        let may_be_cut = matches!(request.plan, FramePlan::Interpolate { .. }) && half_way.is_none();
        let fence_point = frame.submit(self.gpu.frames())?;
        self.reports.cuts.set_fence_point(slot, &fence_point, may_be_cut && !is_copied);
        if let Some(generator) = self.half_way.as_mut().filter(|_| !matches!(request.plan, FramePlan::Copy { .. })) {
            generator.set_made_last(half_way.is_some());
        }
        Ok(fence_point)
    }

    /// Cuts and device times of frames that have run since the last report.
    pub(super) fn report(&mut self) -> DeviceReport {
        let cuts = self.reports.cuts.take_count();
        let (frames, anchors) = (self.gpu_time(), self.gpu_time_of_anchors());
        self.reports.next(cuts, frames, anchors)
    }

    /// Waits until all frames have run and releases their targets, for example before a swap chain is resized. The caller must have submitted or
    /// discarded every list that a frame was recorded into.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn finish(&mut self) -> Result<()> {
        self.ring.finish()?;
        self.gpu.frames().signal()?.wait()?;
        self.recorded.release();
        self.retired.release();
        Ok(())
    }

    /// Destroys the drawer except for the frames that an engine's lists may still read.
    pub fn retire(self) -> RetiredFrames {
        let Self { recorded, mut retired, .. } = self;
        retired.push(recorded);
        retired
    }

    /// Device time of the frames that have run.
    pub fn gpu_time(&mut self) -> GpuTimeStatistics {
        self.ring.gpu_time()
    }

    /// Device time of the uploads of anchors and of the extraction of motion and depth.
    pub fn gpu_time_of_anchors(&mut self) -> GpuTimeStatistics {
        self.cache.gpu_time()
    }

    /// Submitted frames that have not finished.
    pub fn in_flight(&self) -> usize {
        self.ring.in_flight()
    }

    /// Recorded frames whose lists may not have run.
    pub fn pending(&mut self) -> usize {
        self.recorded.pending() + self.retired.pending()
    }
}

/// Destination of a frame.
#[derive(Clone, Copy)]
enum Destination<'a> {
    Target(&'a Target),
    /// A slot of [`RecordedFrames`].
    Slot(usize),
}

/// Checks that a frame can be recorded into the list with this fence.
///
/// # Errors
/// `DeviceRemoved`; `InvalidArgument` for a list of another type than the queue for frames or of another device, and for a fence that has its
/// value already.
pub(crate) fn check_recording(gpu: &Gpu, list: &ID3D12GraphicsCommandList, until: &FencePoint) -> Result<()> {
    if let Some(removed) = gpu.removed() {
        return Err(removed);
    }
    check_list(gpu, list)?;
    until.check_pending()
}

impl std::fmt::Debug for DeviceDrawer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DeviceDrawer({} x {}, {:?})", self.size.0, self.size.1, self.ring)
    }
}
