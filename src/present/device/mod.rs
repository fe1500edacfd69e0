//! Frames of a presenter that a Direct3D device makes. Windows only.
//!
//! What a frame is made of is brought there by command lists of our own, once to an anchor; the frame itself is recorded into
//! an engine's list, or into one of ours. Nothing comes back but a few words on what happened, which are looked at when the next frame
//! is recorded.

mod canvas;
mod enlarger;
mod pictures;
mod reports;
mod scaling;
mod supply;

use std::time::{Duration, Instant};

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12GraphicsCommandList, ID3D12Resource};

use super::area::Area;
use super::presenter::{Drawn, Plan, Presenter, PresenterOptions, Shown, ShownSource, Slot, Taken};
use super::statistics::PresenterStatistics;
use crate::ffx::{Api, Choice, Version};
use crate::framegen::Phases;
use crate::framegen::fsr::{FsrGenerator, PairFacts, Place};
use crate::framegen::shader::{self, GuidanceTextures, ShaderGenerator, TexturePair};
use crate::gpu::compute::pictures::{Format, target as format_of};
use crate::gpu::compute::{Frame, Frames, Resting, Spent, Transfer};
use crate::gpu::{Gpu, Moment, Promises, Target, check_list};
use crate::guidance::{Projection, paper};
use crate::{Colours, Error, ErrorKind, Result};
use canvas::Canvas;
use enlarger::Enlarger;
pub use pictures::PictureUpscaler;
use reports::Reports;
pub use scaling::ScaledBy;
use scaling::Upscaling;
use supply::{Supplied, Supply};

/// What a presenter's frames are made with on a Direct3D device, by the `shader` generator, or those half way
/// between two anchors by `fsr`, from anchors of one size. Makes everything with it; a frame makes nothing, but for the first one of
/// another size than that before, and an anchor only what has another size than those before.
///
/// Belongs to one presenter. Lists must be given to the device's queue for frames in the order that they are recorded in, each before
/// the next one is recorded, or never: of one that is dropped nothing is used later. Until it is known that a list has run, a frame that is
/// shown again is made again.
///
/// Threads: one at a time; may move between them.
pub struct DeviceDrawer {
    // Signals what was promised before anybody below waits for it.
    promises: Promises,
    gpu: Gpu,
    size: (u32, u32),
    colours: Colours,
    generator: ShaderGenerator,
    /// What brings pictures into targets that the generator does not write itself.
    canvas: Option<Canvas>,
    /// The size that frames are generated in: the anchors', or larger where these are made so first.
    work: (u32, u32),
    /// Who makes them larger, where that is wanted.
    upscaling: Option<Upscaling>,
    enlarger: Option<Enlarger>,
    fsr: Option<FsrGenerator>,
    /// What it is made of.
    amd: Option<(Api, Choice)>,
    /// Where nobody else is to make the frames that it does.
    requires_fsr: bool,
    /// Why it makes none any more.
    fsr_failed: Option<Error>,
    /// Whether it made the frame that was generated last, or none was.
    made_by_fsr: bool,
    frames: Frames,
    supply: Supply,
    reports: Reports,
    /// Resets, the later anchor, and what lay over the anchors, of the pair that the generator knows.
    prepared: Option<(u64, u64, u64)>,
    drawn: Option<Drawn>,
    /// Where the picture of that was recorded to be made in an engine's list, which may never have run: a place of the ring.
    doubtful: Option<usize>,
    /// Frames whose time the presenter knows, and all time that it knows of.
    noted: (u64, Duration),
}

impl DeviceDrawer {
    /// For anchors of `size`, and frames in `colours`.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`].
    pub fn new(gpu: &Gpu, size: (u32, u32), colours: Colours) -> Result<Self> {
        let transfer = if colours == Colours::Linear { Transfer::Light } else { Transfer::Shown };
        Ok(Self {
            promises: Promises::new(gpu)?,
            gpu: gpu.clone(),
            size,
            colours,
            generator: ShaderGenerator::new(gpu, size)?.with_target_transfer(transfer),
            canvas: None,
            work: size,
            upscaling: None,
            enlarger: None,
            amd: None,
            frames: Frames::new(gpu, gpu.frames(), shader::DESCRIPTORS + canvas::DESCRIPTORS)?,
            fsr: None,
            requires_fsr: false,
            fsr_failed: None,
            made_by_fsr: true,
            supply: Supply::new(gpu, size)?,
            reports: Reports::new(gpu)?,
            prepared: None,
            drawn: None,
            doubtful: None,
            noted: (0, Duration::ZERO),
        })
    }

    /// From now on frames half way between two anchors are made by a provider of AMD's in `api`; only one that puts a picture of known
    /// motion where it belongs is taken. Those at other phases, and those beyond an anchor, are made by shaders as ever. Where the
    /// provider fails later, shaders make its frames too, unless it `is_required`: then drawing fails.
    ///
    /// A provider goes on from frame to frame. Where the frame half way to an anchor is not drawn, the next one costs a second call of it.
    ///
    /// # Errors
    /// As for [`TextureGenerator::new`](crate::ffx::TextureGenerator::new).
    pub fn use_fsr(&mut self, api: &Api, choice: Choice, is_required: bool) -> Result<()> {
        self.fsr = Some(FsrGenerator::new(&self.gpu, api, choice, self.work, self.size)?);
        (self.requires_fsr, self.fsr_failed, self.amd) = (is_required, None, Some((*api, choice)));
        Ok(())
    }

    /// The provider that made the frame that was generated last, or will make the first one half way; None where shaders did, or will.
    pub fn made_by_fsr(&self) -> Option<&Version> {
        self.fsr.as_ref().filter(|_| self.made_by_fsr).map(FsrGenerator::version)
    }

    /// Why the provider that it was given makes no frames any more, where it failed.
    pub fn fsr_failed(&self) -> Option<&Error> {
        self.fsr_failed.as_ref()
    }

    /// Whether it makes frames of anchors of `size` for lists of the same queue.
    pub fn fits(&self, gpu: &Gpu, size: (u32, u32)) -> bool {
        self.size == size && self.gpu.frames().d3d12() == gpu.frames().d3d12()
    }

    /// Makes it ready for `presenter`'s frames of `size`; otherwise the first of them does.
    ///
    /// # Errors
    /// `Unsupported` for more pixels than fit into the buffers of Direct3D, and where an upscaler is required that cannot be used;
    /// `OutOfMemory`, `DeviceRemoved`, `Device`.
    pub fn fit(&mut self, presenter: &Presenter, size: (u32, u32)) -> Result<()> {
        let keeps_shape = presenter.keeps_shape();
        let work = self.enlarge_to(Area::of(self.size, size, keeps_shape).size, presenter.shows_decoded())?;
        self.work_at(work)?;
        if size == work && matches!(self.colours, Colours::Shown | Colours::Linear) {
            self.canvas = None;
            return Ok(());
        }
        let canvas = match &mut self.canvas {
            Some(canvas) => canvas,
            none => none.insert(Canvas::new(&self.gpu, work)?),
        };
        canvas.fit(&mut self.supply, size, keeps_shape)
    }

    /// Has frames generated in that size.
    fn work_at(&mut self, size: (u32, u32)) -> Result<()> {
        if self.work == size {
            return Ok(());
        }
        (self.canvas, self.prepared, self.drawn) = (None, None, None);
        // Where something fails below it is of no size, and all of it is made again.
        self.work = (0, 0);
        let transfer = if self.colours == Colours::Linear { Transfer::Light } else { Transfer::Shown };
        self.generator = ShaderGenerator::new(&self.gpu, size)?.with_target_transfer(transfer);
        if let Some((api, choice)) = self.amd.filter(|_| self.fsr_failed.is_none()) {
            self.fsr = None;
            match FsrGenerator::new(&self.gpu, &api, choice, size, self.size) {
                Ok(made) => self.fsr = Some(made),
                Err(why) if self.requires_fsr || why.kind() == ErrorKind::DeviceRemoved => return Err(why),
                Err(why) => {
                    log::warn!("frames are made by shaders from now on, as there is no fsr of another size: {why}");
                    self.fsr_failed = Some(why);
                }
            }
        }
        self.supply.work_at(size);
        self.work = size;
        Ok(())
    }

    /// Waits until all frames have run and lets go of their targets: before a swap chain is resized, for one. Lists that were recorded
    /// must have been given to the queue, or never will be.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn finish(&mut self) -> Result<()> {
        self.promises.keep()?;
        self.frames.finish()
    }

    /// Time on the device of the frames that have run.
    pub fn spent(&mut self) -> Spent {
        self.frames.spent()
    }

    /// Time on the device of what brought anchors there, with their motion and depth.
    pub fn spent_on_anchors(&mut self) -> Spent {
        self.supply.spent()
    }

    /// Frames that are recorded or given to the queue, and have not run.
    pub fn under_way(&self) -> usize {
        self.frames.under_way()
    }

    /// What is recorded of a frame, and the moment when it has run where the list is ours.
    fn draw(
        &mut self,
        taken: &Taken,
        presenter: &Presenter,
        list: Option<&ID3D12GraphicsCommandList>,
        (target, format): (&Target, Format),
        times: &mut PresenterStatistics,
    ) -> Result<Option<Moment>> {
        let start = Instant::now();
        let PresenterOptions { motion, multiplier, .. } = *presenter.options();
        let interval_ms = interval_ms(taken, multiplier);
        let place = taken.plan.place(taken.epoch);
        let also_leads = self.enlarger.as_ref().is_some_and(|enlarger| place.is_some_and(|place| !enlarger.has(place)));
        let supplied = self.supply.bring(taken, motion, also_leads)?;
        times.guidance += start.elapsed();
        let start = Instant::now();
        let supplied = self.larger(supplied, taken, presenter, interval_ms)?;
        times.resize += start.elapsed();
        let start = Instant::now();
        let half = self.half(taken, &supplied, interval_ms)?;
        if let (Plan::Between { index, .. }, None) = (&taken.plan, &half) {
            let key = (taken.epoch, *index, self.supply.overlays);
            self.prepare(&supplied.pair()?, key)?;
        }
        // A list that was dropped has made nothing that could be copied: it is made anew as long as it is not known to be there.
        if self.doubtful.is_some_and(|place| self.reports.has_run(place)) {
            self.doubtful = None;
        }
        let again = taken.shown.repeated && self.doubtful.is_none();
        let (promises, generator, canvas) = (&mut self.promises, &mut self.generator, &mut self.canvas);
        let place = self.frames.place();
        let (mut frame, promised) = match list {
            Some(list) => {
                let moment = promises.next()?;
                (self.frames.begin_in(list, &moment)?, Some(moment))
            }
            None => (self.frames.begin()?, None),
        };
        let to = Resting { resource: &target.texture, state: target.before };
        frame.stage(match taken.shown.source {
            ShownSource::Generated => c"Cairn: a frame between two anchors",
            ShownSource::Extrapolated => c"Cairn: a frame beyond an anchor",
            _ => c"Cairn: an anchor",
        });
        let half = half.as_ref();
        let is_copied = again
            && match canvas {
                None => generator.again(&mut frame, &to)?,
                Some(canvas) => canvas.again(&mut frame, format, self.colours, &to)?,
            };
        if !is_copied {
            match canvas {
                None => generate(generator, &mut frame, &taken.plan, &supplied, half, &to)?,
                Some(canvas) => {
                    generate(generator, &mut frame, &taken.plan, &supplied, half, &canvas.picture())?;
                    canvas.record(&mut frame, format, self.colours, &to)?;
                }
            }
            self.doubtful = list.is_some().then_some(place);
        }
        self.reports.record(&mut frame, place, &generator.report())?;
        frame.leave(&target.texture, target.after);
        frame.end_stage();
        // Of all else it is known beforehand whether there is a cut, and a provider shows an anchor there without a word.
        let may_be_cut = matches!(taken.plan, Plan::Between { .. }) && half.is_none();
        let moment = match promised {
            Some(moment) => {
                drop(frame);
                self.reports.comes_at(place, &moment, may_be_cut);
                None
            }
            None => {
                let moment = frame.submit(self.gpu.frames())?;
                self.reports.comes_at(place, &moment, may_be_cut);
                Some(moment)
            }
        };
        if !matches!(taken.plan, Plan::Copy { .. }) {
            self.made_by_fsr = half.is_some();
        }
        times.generate += start.elapsed();
        Ok(moment)
    }
}

impl DeviceDrawer {
    /// The frame half way between two anchors, where it is asked for and a provider makes it.
    fn half(&mut self, taken: &Taken, supplied: &Supplied, interval_ms: f32) -> Result<Option<ID3D12Resource>> {
        let (Some(fsr), Plan::Between { current, index, t, .. }) = (&mut self.fsr, &taken.plan) else {
            return Ok(None);
        };
        if *t != 0.5 {
            return Ok(None);
        }
        let facts = PairFacts { place: (taken.epoch, *index), projection: current.projection(), interval_ms };
        let mut pair = supplied.pair()?;
        if let Some(rendered) = &supplied.rendered {
            pair.guidance = GuidanceTextures { hud: pair.guidance.hud, ..rendered.as_guidance() };
        }
        // What follows on the queue for frames comes after it.
        match fsr.generate(&pair, &facts) {
            Ok((half, _)) => Ok(Some(half)),
            Err(why) if self.requires_fsr || why.kind() == ErrorKind::DeviceRemoved => Err(why),
            Err(why) => {
                log::warn!("frames are made by shaders from now on, as fsr fails: {why}");
                (self.fsr, self.fsr_failed) = (None, Some(why));
                Ok(None)
            }
        }
    }

    /// Has what frames of a pair have in common made in a list of ours, where it is not: an engine's list may never run.
    fn prepare(&mut self, pair: &TexturePair<'_>, key: (u64, u64, u64)) -> Result<()> {
        // Textures are used again for other anchors, so that they do not tell.
        if self.prepared == Some(key) && self.generator.is_prepared(pair)? {
            return Ok(());
        }
        self.prepared = None;
        let mut frame = self.supply.begin()?;
        frame.stage(c"Cairn: what frames of a pair have in common");
        self.generator.prepare(&mut frame, pair)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        self.prepared = Some(key);
        Ok(())
    }
}

impl Supplied {
    /// For frames between two anchors.
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

/// Records what a plan says, or shows what a provider has made of it.
fn generate(
    generator: &mut ShaderGenerator,
    frame: &mut Frame<'_>,
    plan: &Plan,
    supplied: &Supplied,
    half: Option<&ID3D12Resource>,
    to: &Resting<'_>,
) -> Result<()> {
    if let Some(half) = half {
        return generator.show_anchor(frame, &resting(half), to);
    }
    match plan {
        Plan::Copy { .. } => generator.show_anchor(frame, &resting(&supplied.current), to),
        Plan::Between { t, .. } => generator.interpolate(frame, &supplied.pair()?, *t, to),
        Plan::Beyond { t, .. } => {
            generator.extrapolate(frame, &resting(&supplied.current), &supplied.guidance()?, false, *t, to)
        }
    }
}

impl Presenter {
    /// Records the frame that is due at `now` into `list`, an engine's open one, as [`draw`](Self::draw) writes it into memory; none before
    /// the first anchor came. A cut that only the generator finds is counted once the frame has run.
    ///
    /// Afterwards the list has another pipeline, compute root signature and descriptor heaps than before.
    ///
    /// # Errors
    /// `InvalidArgument` for a list or target that frames cannot be recorded into, or where latents are needed and the anchors have none;
    /// `OutOfMemory`; `DeviceRemoved`. No frame is recorded then.
    pub fn record(
        &self,
        now: u64,
        drawer: &mut DeviceDrawer,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
    ) -> Result<Option<Shown>> {
        check_list(&drawer.gpu, list)?;
        Ok(self.record_to(now, drawer, Some(list), target)?.map(|(shown, _)| shown))
    }

    /// Has the frame that is due at `now` made on the device's queue for frames, behind what that has been given; also the moment when
    /// `target` holds it.
    ///
    /// # Errors
    /// As for [`record`](Self::record).
    pub fn submit(&self, now: u64, drawer: &mut DeviceDrawer, target: &Target) -> Result<Option<(Shown, Moment)>> {
        let made = self.record_to(now, drawer, None, target)?;
        made.map(|(shown, moment)| moment.map(|moment| (shown, moment)).ok_or_else(nothing_brought)).transpose()
    }

    fn record_to(
        &self,
        now: u64,
        drawer: &mut DeviceDrawer,
        list: Option<&ID3D12GraphicsCommandList>,
        target: &Target,
    ) -> Result<Option<(Shown, Option<Moment>)>> {
        if let Some(gone) = drawer.gpu.removed() {
            return Err(gone);
        }
        // The list before this one has been given to the queue.
        drawer.promises.keep()?;
        self.look(drawer);
        let Some(mut taken) = self.take(now, Some(Phases::Any)) else { return Ok(None) };
        let anchors = taken.plan.size();
        let size = taken.size.unwrap_or(anchors);
        if anchors != drawer.size {
            let (of, for_) = (drawer.size, anchors);
            let cause =
                format!("it makes frames of anchors of {} x {} pixels, not {} x {}", of.0, of.1, for_.0, for_.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("drawer"));
        }
        target.check(&drawer.gpu, drawer.gpu.frames().kind(), size, drawer.colours)?;
        let resting = Resting { resource: &target.texture, state: target.before };
        let format = format_of(&drawer.gpu, &resting, [size.0, size.1])?;
        drawer.fit(self, size)?;
        taken.shown.repeated = drawer.drawn == Some(taken.key);
        drawer.drawn = None;
        let mut times = PresenterStatistics::default();
        let moment = drawer.draw(&taken, self, list, (target, format), &mut times)?;
        drawer.drawn = Some(taken.key);
        self.count(&taken.shown, &times);
        Ok(Some((taken.shown, moment)))
    }

    /// Looks at what has happened in frames that have run meanwhile, so that [`statistics`](Self::statistics) has it.
    pub fn look(&self, drawer: &mut DeviceDrawer) {
        self.count_cuts(drawer.reports.cuts());
        let (frames, lists) = (drawer.spent(), drawer.spent_on_anchors());
        let known = (frames.frames, frames.total.saturating_add(lists.total));
        let (before, spent) = std::mem::replace(&mut drawer.noted, known);
        if known.0 > before {
            self.note_spent(known.0 - before, known.1.saturating_sub(spent));
        } else {
            // It counts with the next frame.
            drawer.noted.1 = spent;
        }
    }
}

impl Plan {
    /// The anchor that is shown, led to or gone on from.
    fn slot(&self) -> &Slot {
        let (Self::Copy { current: slot, .. } | Self::Between { current: slot, .. } | Self::Beyond { last: slot, .. }) =
            self;
        slot
    }

    /// Size of the pictures it is made of.
    fn size(&self) -> (u32, u32) {
        self.slot().anchor.size()
    }

    /// Which anchor it is; None for a picture that one brought beside its own.
    fn place(&self, epoch: u64) -> Option<Place> {
        match self {
            Self::Copy { current, picture, .. } if picture + 1 < current.anchor.count() => None,
            Self::Copy { index, .. } | Self::Between { index, .. } | Self::Beyond { index, .. } => {
                Some((epoch, *index))
            }
        }
    }
}

impl Slot {
    /// The camera of the depth that leads to it.
    fn projection(&self) -> Projection {
        self.guidance.as_ref().map_or(paper::PROJECTION, |given| given.depth().projection())
    }
}

/// Milliseconds from one anchor to the next.
fn interval_ms(taken: &Taken, multiplier: u32) -> f32 {
    let due = &taken.shown.due;
    due.until_ns.saturating_sub(due.since_ns).max(1) as f32 * multiplier as f32 / 1e6
}

impl std::fmt::Debug for DeviceDrawer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DeviceDrawer({} x {}, {:?})", self.size.0, self.size.1, self.frames)
    }
}

/// Between command lists all of ours rest so.
fn resting(resource: &ID3D12Resource) -> Resting<'_> {
    Resting { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

/// Cannot come about: what a plan needs was brought before.
fn nothing_brought() -> Error {
    Error::new(ErrorKind::InvalidState, "what the frame is made of is not there")
}
