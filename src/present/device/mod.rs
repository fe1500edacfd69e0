//! Presenter frames made on a Direct3D 12 device. Windows only.
//!
//! All work on a frame is recorded into command lists of our own and submitted to the device's queue for frames. A frame that an engine records
//! into its own list is first made in memory of the presenter; the engine's list only copies it from there. So the engine may submit that list
//! late, in another order, or never. The device returns only a small report per frame, which is read when a later frame is made.

mod output_pass;
mod pictures;
mod record;
mod recorded;
mod reports;
mod resource_cache;
mod scaling;
mod upsampler;

use std::time::{Duration, Instant};

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12GraphicsCommandList, ID3D12Resource};

use super::area::Area;
use super::presenter::{FrameInfo, FrameKey, FrameSource, PendingFrame, Plan, Presenter, PresenterOptions, Slot};
use super::statistics::PresenterStatistics;
use crate::ffx::{Api, Choice, Version};
use crate::framegen::Phases;
use crate::framegen::fsr::{FsrGenerator, PairFacts, Place};
use crate::framegen::shader::{self, GuidanceTextures, ShaderGenerator, TexturePair};
use crate::gpu::compute::pictures::{Format, target as format_of};
use crate::gpu::compute::{CommandRecorder, CommandRing, Output, ResourceWithState, Spent, Transfer};
use crate::gpu::{FencePoint, Gpu, Target, check_list};
use crate::guidance::{Projection, paper};
use crate::{Colours, Error, ErrorKind, Result};
use output_pass::OutputPass;
pub use pictures::PictureUpscaler;
use recorded::RecordedFrames;
pub use recorded::RetiredFrames;
use reports::Reports;
use resource_cache::{FrameInputs, ResourceCache};
pub use scaling::ScaledBy;
use scaling::Upscaling;

/// Makes a presenter's frames on a Direct3D 12 device from anchors of one size: with the `shader` generator, or with `fsr` for the frame half
/// way between two anchors. [`new`](Self::new) and [`prepare`](Self::prepare) create all resources; making a frame creates none.
///
/// Belongs to one presenter.
///
/// Threads: one at a time; may move between them.
pub struct DeviceDrawer {
    gpu: Gpu,
    size: (u32, u32),
    colours: Colours,
    generator: ShaderGenerator,
    /// Scales and converts pictures for targets that the generator does not write itself.
    output_pass: Option<OutputPass>,
    /// The size at which frames are generated: that of the anchors, or of the upscaled anchors.
    work: (u32, u32),
    /// AMD's upscaler, if the caller asked for it.
    upscaling: Option<Upscaling>,
    /// AMD's frame generator, if the caller asked for it.
    fsr: Option<Fsr>,
    frames: CommandRing,
    cache: ResourceCache,
    reports: Reports,
    /// Finished frames that an engine's lists copy from.
    recorded: RecordedFrames,
    /// Frames of earlier preparations that an engine's lists may still copy from.
    retired: RetiredFrames,
    /// Sizes and format of the last [`prepare`](Self::prepare).
    prepared: Option<Prepared>,
    /// The pair that the generator is prepared for.
    pair: Option<PairKey>,
    drawn: Option<FrameKey>,
    /// Repeated frames that a list of the engine's copied from memory, without other work of the device.
    copied: u64,
    /// Frames whose device time was reported to the presenter, and the sum of that time.
    noted: (u64, Duration),
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
#[derive(Clone, Copy, PartialEq, Eq)]
struct Prepared {
    size: (u32, u32),
    pixel_bytes: u32,
    keeps_shape: bool,
}

/// Cache key of a prepared pair: the stream's epoch, the later anchor and the version of the overlay.
#[derive(Clone, Copy, PartialEq, Eq)]
struct PairKey {
    epoch: u64,
    /// The later anchor.
    anchor: u64,
    overlay: u64,
}

/// AMD's frame generator and its state.
struct Fsr {
    api: Api,
    choice: Choice,
    /// If set, a failure is an error; otherwise the shaders take over.
    is_required: bool,
    generator: Option<FsrGenerator>,
    /// The failure after which it is not used any more.
    failed: Option<Error>,
    /// Whether it made the last generated frame; true before the first one.
    made_last: bool,
}

/// Result of a request for a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameResult<T> {
    /// The frame was made.
    Made(T),
    /// No anchor has arrived yet.
    NoAnchor,
    /// [`DeviceDrawer::prepare`] was not called for frames of this size and format. Nothing was made.
    NotPrepared,
    /// Every slot holds a recorded frame whose list may not have run. Nothing was recorded.
    QueueFull,
}

impl<T> FrameResult<T> {
    /// The frame, if it was made.
    pub fn made(self) -> Option<T> {
        if let Self::Made(made) = self { Some(made) } else { None }
    }
}

impl DeviceDrawer {
    /// Creates a drawer for anchors of `size` and frames in `colours`.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`].
    pub fn new(gpu: &Gpu, size: (u32, u32), colours: Colours) -> Result<Self> {
        let transfer = if colours == Colours::Linear { Transfer::Linear } else { Transfer::Encoded };
        Ok(Self {
            gpu: gpu.clone(),
            size,
            colours,
            generator: ShaderGenerator::new(gpu, size)?.with_target_transfer(transfer),
            output_pass: None,
            work: size,
            upscaling: None,
            fsr: None,
            frames: CommandRing::new(gpu, gpu.frames(), shader::DESCRIPTORS + output_pass::DESCRIPTORS)?,
            cache: ResourceCache::new(gpu, size)?,
            reports: Reports::new(gpu)?,
            recorded: RecordedFrames::none(),
            retired: RetiredFrames::default(),
            prepared: None,
            pair: None,
            drawn: None,
            copied: 0,
            noted: (0, Duration::ZERO),
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
        let generator = Some(FsrGenerator::new(&self.gpu, api, choice, self.work, self.size)?);
        self.fsr = Some(Fsr { api: *api, choice, is_required, generator, failed: None, made_last: true });
        Ok(())
    }

    /// The provider that made the last generated frame, or will make the first one half way; `None` if shaders did or will.
    pub fn made_by_fsr(&self) -> Option<&Version> {
        let fsr = self.fsr.as_ref().filter(|fsr| fsr.made_last)?;
        fsr.generator.as_ref().map(FsrGenerator::version)
    }

    /// The failure after which the provider is not used any more, if it failed.
    pub fn fsr_failed(&self) -> Option<&Error> {
        self.fsr.as_ref().and_then(|fsr| fsr.failed.as_ref())
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Whether this drawer takes anchors of `size` and its queue for frames is that of `gpu`.
    pub fn fits(&self, gpu: &Gpu, size: (u32, u32)) -> bool {
        self.size == size && self.gpu.frames().d3d12() == gpu.frames().d3d12()
    }

    /// Creates everything that `presenter`'s frames of this preparation need. Another size or a wider format needs another call.
    ///
    /// # Errors
    /// `Unsupported` for more pixels than fit into the buffers of Direct3D, and where an upscaler is required that cannot be used;
    /// `OutOfMemory`, `DeviceRemoved`, `Device`. Nothing is prepared then.
    pub fn prepare(&mut self, presenter: &Presenter, wanted: &Preparation) -> Result<()> {
        let keeps_shape = presenter.keeps_shape();
        self.prepared = None;
        let area = Area::of(self.size, wanted.size, keeps_shape);
        let work = self.set_upsampled_size(area.size, presenter.brings_all(wanted.pictures))?;
        self.work_at(work)?;
        self.cache.prepare(presenter.options().motion, wanted.latent)?;
        self.scale_to(wanted.size, keeps_shape)?;
        let recorded = RecordedFrames::new(&self.gpu, wanted.lists, wanted.size, wanted.pixel_bytes)?;
        self.retired.push(std::mem::replace(&mut self.recorded, recorded));
        self.drawn = None;
        let Preparation { size, pixel_bytes, .. } = *wanted;
        self.prepared = Some(Prepared { size, pixel_bytes, keeps_shape });
        Ok(())
    }

    /// Sets up the output pass for frames of `size`, or drops it if the generator can write them itself.
    fn scale_to(&mut self, size: (u32, u32), keeps_shape: bool) -> Result<()> {
        if size == self.work && matches!(self.colours, Colours::Shown | Colours::Linear) {
            self.output_pass = None;
            return Ok(());
        }
        let output_pass = match &mut self.output_pass {
            Some(output_pass) => output_pass,
            none => none.insert(OutputPass::new(&self.gpu, self.work)?),
        };
        output_pass.fit(&mut self.cache, size, keeps_shape)
    }

    /// Sets the size at which frames are generated.
    fn work_at(&mut self, size: (u32, u32)) -> Result<()> {
        self.cache.work_at(size)?;
        if self.work == size {
            return Ok(());
        }
        (self.output_pass, self.pair, self.drawn) = (None, None, None);
        // If a step below fails, no size matches and the next call creates everything again.
        self.work = (0, 0);
        let transfer = if self.colours == Colours::Linear { Transfer::Linear } else { Transfer::Encoded };
        self.generator = ShaderGenerator::new(&self.gpu, size)?.with_target_transfer(transfer);
        if let Some(fsr) = self.fsr.as_mut().filter(|fsr| fsr.failed.is_none()) {
            fsr.generator = None;
            match FsrGenerator::new(&self.gpu, &fsr.api, fsr.choice, size, self.size) {
                Ok(made) => fsr.generator = Some(made),
                Err(why) if fsr.is_required || why.kind() == ErrorKind::DeviceRemoved => return Err(why),
                Err(why) => {
                    log::warn!("frames are made by shaders from now on, as there is no fsr of another size: {why}");
                    fsr.failed = Some(why);
                }
            }
        }
        self.work = size;
        Ok(())
    }

    /// Whether frames of that size and format are prepared.
    fn is_prepared(&self, size: (u32, u32), pixel_bytes: u32, keeps_shape: bool) -> bool {
        self.prepared.is_some_and(|prepared| {
            prepared.size == size && prepared.keeps_shape == keeps_shape && pixel_bytes <= prepared.pixel_bytes
        })
    }

    /// Waits until all frames have run and releases their targets, for example before a swap chain is resized. The caller must have submitted or
    /// discarded every list that a frame was recorded into.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn finish(&mut self) -> Result<()> {
        self.frames.finish()?;
        self.gpu.frames().now()?.wait()?;
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
    pub fn spent(&mut self) -> Spent {
        self.frames.spent()
    }

    /// Device time of the uploads of anchors and of the extraction of motion and depth.
    pub fn spent_on_anchors(&mut self) -> Spent {
        self.cache.spent()
    }

    /// Submitted frames that have not finished.
    pub fn under_way(&self) -> usize {
        self.frames.under_way()
    }

    /// Recorded frames whose lists may not have run.
    pub fn pending(&mut self) -> usize {
        self.recorded.pending() + self.retired.pending()
    }

    /// Records and submits a frame; returns the fence point at which it is finished.
    fn make(
        &mut self,
        pending: &PendingFrame,
        presenter: &Presenter,
        format: Format,
        to: To<'_>,
        times: &mut PresenterStatistics,
    ) -> Result<FencePoint> {
        let start = Instant::now();
        let PresenterOptions { motion, multiplier, .. } = *presenter.options();
        let interval_ms = interval_ms(pending, multiplier);
        let place = pending.plan.place(pending.epoch);
        let also_leads = self.upsampler().is_some_and(|upsampler| place.is_some_and(|place| !upsampler.has(place)));
        let inputs = self.cache.bring(pending, motion, also_leads)?;
        times.guidance += start.elapsed();
        let start = Instant::now();
        let inputs = self.larger(inputs, pending, presenter, interval_ms)?;
        times.resize += start.elapsed();
        let start = Instant::now();
        let half = self.half(pending, &inputs, interval_ms)?;
        if let (Plan::Interpolate { index, .. }, None) = (&pending.plan, &half) {
            let key = PairKey { epoch: pending.epoch, anchor: *index, overlay: self.cache.overlays };
            self.prepare_pair(&inputs.pair()?, key)?;
        }
        let output = match to {
            To::Target(target) => Output::from(&ResourceWithState { resource: &target.texture, state: target.before }),
            To::Recorded(slot) => Output::rows(resting(self.recorded.memory(slot)), format),
        };
        let (generator, output_pass) = (&mut self.generator, &mut self.output_pass);
        let place = self.frames.place();
        let mut frame = self.frames.begin()?;
        frame.stage(match pending.shown.source {
            FrameSource::Generated => c"Cairn: a frame between two anchors",
            FrameSource::Extrapolated => c"Cairn: a frame beyond an anchor",
            _ => c"Cairn: an anchor",
        });
        let half = half.as_ref();
        let is_copied = pending.shown.repeated
            && match output_pass {
                None => generator.again(&mut frame, output)?,
                Some(output_pass) => output_pass.again(&mut frame, format, self.colours, output)?,
            };
        if !is_copied {
            match output_pass {
                None => generate(generator, &mut frame, &pending.plan, &inputs, half, output)?,
                Some(output_pass) => {
                    let picture = Output::from(&output_pass.picture());
                    generate(generator, &mut frame, &pending.plan, &inputs, half, picture)?;
                    output_pass.record(&mut frame, format, self.colours, output)?;
                }
            }
        }
        self.reports.record(&mut frame, place, &generator.report())?;
        if let To::Target(target) = to {
            frame.leave(&target.texture, target.after);
        }
        frame.end_stage();
        // Only shader interpolation detects cuts on the device. Other plans know them beforehand, and a provider does not report a cut.
        let may_be_cut = matches!(pending.plan, Plan::Interpolate { .. }) && half.is_none();
        let fence_point = frame.submit(self.gpu.frames())?;
        self.reports.comes_at(place, &fence_point, may_be_cut && !is_copied);
        if let Some(fsr) = self.fsr.as_mut().filter(|_| !matches!(pending.plan, Plan::Copy { .. })) {
            fsr.made_last = half.is_some();
        }
        times.generate += start.elapsed();
        Ok(fence_point)
    }
}

/// Destination of a frame.
#[derive(Clone, Copy)]
enum To<'a> {
    Target(&'a Target),
    /// A slot of [`RecordedFrames`].
    Recorded(usize),
}

impl DeviceDrawer {
    /// The provider's frame, if the plan is the frame half way between two anchors and a provider is in use.
    fn half(
        &mut self,
        pending: &PendingFrame,
        inputs: &FrameInputs,
        interval_ms: f32,
    ) -> Result<Option<ID3D12Resource>> {
        let (Some(fsr), Plan::Interpolate { current, index, t, .. }) = (&mut self.fsr, &pending.plan) else {
            return Ok(None);
        };
        let Some(generator) = fsr.generator.as_mut().filter(|_| *t == 0.5) else { return Ok(None) };
        let facts = PairFacts { place: (pending.epoch, *index), projection: current.projection(), interval_ms };
        let mut pair = inputs.pair()?;
        if let Some(rendered) = &inputs.rendered {
            pair.guidance = GuidanceTextures { hud: pair.guidance.hud, ..rendered.as_guidance() };
        }
        // The provider runs on the queue for frames, so later work on that queue needs no wait.
        match generator.generate(&pair, &facts) {
            Ok((half, _)) => Ok(Some(half)),
            Err(why) if fsr.is_required || why.kind() == ErrorKind::DeviceRemoved => Err(why),
            Err(why) => {
                log::warn!("frames are made by shaders from now on, as fsr fails: {why}");
                (fsr.generator, fsr.failed) = (None, Some(why));
                Ok(None)
            }
        }
    }

    /// Submits the work that all frames of a pair share, unless the generator is prepared for this pair already.
    fn prepare_pair(&mut self, pair: &TexturePair<'_>, key: PairKey) -> Result<()> {
        // Textures are recycled, so pointer equality does not identify the pair.
        if self.pair == Some(key) && self.generator.is_prepared(pair)? {
            return Ok(());
        }
        self.pair = None;
        let mut frame = self.cache.begin()?;
        frame.stage(c"Cairn: what frames of a pair have in common");
        self.generator.prepare(&mut frame, pair)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        self.pair = Some(key);
        Ok(())
    }
}

impl FrameInputs {
    /// Textures for interpolation.
    fn pair(&self) -> Result<TexturePair<'_>> {
        let previous = self.previous.as_ref().map(resting).ok_or_else(nothing_brought)?;
        let previous_depth = self.previous_depth.as_ref().map(|(depth, tile)| (resting(depth), *tile));
        Ok(TexturePair {
            previous,
            current: resting(&self.current),
            guidance: self.guidance()?,
            previous_depth,
            cut: false,
        })
    }

    fn guidance(&self) -> Result<GuidanceTextures<'_>> {
        let guidance = self.guidance.as_ref().ok_or_else(nothing_brought)?;
        Ok(GuidanceTextures { hud: self.overlay.as_ref().map(resting), ..guidance.as_guidance() })
    }
}

/// Records the frame of a plan; with `half`, shows the provider's frame instead.
fn generate(
    generator: &mut ShaderGenerator,
    frame: &mut CommandRecorder<'_>,
    plan: &Plan,
    inputs: &FrameInputs,
    half: Option<&ID3D12Resource>,
    to: Output<'_>,
) -> Result<()> {
    if let Some(half) = half {
        return generator.show_anchor(frame, &resting(half), to);
    }
    match plan {
        Plan::Copy { .. } => generator.show_anchor(frame, &resting(&inputs.current), to),
        Plan::Interpolate { t, .. } => generator.interpolate(frame, &inputs.pair()?, *t, to),
        Plan::Extrapolate { t, .. } => {
            generator.extrapolate(frame, &resting(&inputs.current), &inputs.guidance()?, false, *t, to)
        }
    }
}

/// Checks that a frame can be recorded into the list with this fence.
///
/// # Errors
/// `DeviceRemoved`; `InvalidArgument` for a list of another type than the queue for frames or of another device, and for a fence that has its
/// value already.
pub(crate) fn check_recording(gpu: &Gpu, list: &ID3D12GraphicsCommandList, until: &FencePoint) -> Result<()> {
    if let Some(gone) = gpu.removed() {
        return Err(gone);
    }
    check_list(gpu, list)?;
    until.check_pending()
}

/// A frame that is due, and the pixel format of its target.
struct Ready {
    pending: PendingFrame,
    format: Format,
}

impl Plan {
    /// The anchor that is shown, the later anchor of an interpolation, or the start of an extrapolation.
    fn slot(&self) -> &Slot {
        let (Self::Copy { current: slot, .. }
        | Self::Interpolate { current: slot, .. }
        | Self::Extrapolate { last: slot, .. }) = self;
        slot
    }

    /// Size of the anchor's pictures.
    fn size(&self) -> (u32, u32) {
        self.slot().anchor.size()
    }

    /// Epoch and index of the anchor; `None` for a copy of an additional picture of the anchor.
    fn place(&self, epoch: u64) -> Option<Place> {
        match self {
            Self::Copy { current, picture, .. } if picture + 1 < current.anchor.count() => None,
            Self::Copy { index, .. } | Self::Interpolate { index, .. } | Self::Extrapolate { index, .. } => {
                Some((epoch, *index))
            }
        }
    }
}

impl Slot {
    /// Camera projection of the anchor's depth.
    fn projection(&self) -> Projection {
        self.guidance.as_ref().map_or(paper::PROJECTION, |given| given.depth().projection())
    }
}

/// Milliseconds from one anchor to the next.
fn interval_ms(pending: &PendingFrame, multiplier: u32) -> f32 {
    let due = &pending.shown.due;
    due.until_ns.saturating_sub(due.since_ns).max(1) as f32 * multiplier as f32 / 1e6
}

impl std::fmt::Debug for DeviceDrawer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DeviceDrawer({} x {}, {:?})", self.size.0, self.size.1, self.frames)
    }
}

/// Our own resources are in the state COMMON between command lists.
fn resting(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

/// Cannot happen: the cache provides everything that a plan needs.
fn nothing_brought() -> Error {
    Error::new(ErrorKind::InvalidState, "what the frame is made of is not there")
}
