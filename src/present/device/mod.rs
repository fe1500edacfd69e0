//! Frames of a presenter that a Direct3D device makes. Windows only.
//!
//! What a frame is made of is brought there by command lists of our own, once to an anchor; the frame itself is recorded into
//! an engine's list, or into one of ours. Nothing comes back but a few words on what happened, which are looked at when the next frame
//! is recorded.

mod reports;
mod supply;

use std::time::Instant;

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12GraphicsCommandList, ID3D12Resource};

use super::presenter::{Drawn, Plan, Presenter, Shown, ShownSource, Taken};
use super::statistics::PresenterStatistics;
use crate::framegen::Phases;
use crate::framegen::shader::{DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair};
use crate::gpu::compute::{Frame, Frames, Resting, Spent, Transfer};
use crate::gpu::{Gpu, Moment, Promises, Target, check_list};
use crate::{Error, ErrorKind, Result};
use reports::Reports;
use supply::{Supplied, Supply};

/// What a presenter's frames of one size are made with on a Direct3D device, by the `shader` generator. Makes everything with it; a
/// frame makes nothing, and an anchor only what has another size than those before.
///
/// Belongs to one presenter. Lists must be given to the device's queue for frames in the order that they are recorded in, each before
/// the next one is recorded.
///
/// Threads: one at a time; may move between them.
pub struct DeviceDrawer {
    // Signals what was promised before anybody below waits for it.
    promises: Promises,
    gpu: Gpu,
    size: (u32, u32),
    linear: bool,
    generator: ShaderGenerator,
    frames: Frames,
    supply: Supply,
    reports: Reports,
    /// Resets, and the later anchor, of the pair that the generator knows.
    prepared: Option<(u64, u64)>,
    drawn: Option<Drawn>,
}

impl DeviceDrawer {
    /// For anchors and frames of `size`; frames in half floats are in `linear` light if so, and there are no others then.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`].
    pub fn new(gpu: &Gpu, size: (u32, u32), linear: bool) -> Result<Self> {
        let transfer = if linear { Transfer::Light } else { Transfer::Shown };
        Ok(Self {
            promises: Promises::new(gpu)?,
            gpu: gpu.clone(),
            size,
            linear,
            generator: ShaderGenerator::new(gpu, size)?.with_target_transfer(transfer),
            frames: Frames::new(gpu, gpu.frames(), DESCRIPTORS)?,
            supply: Supply::new(gpu, size)?,
            reports: Reports::new(gpu)?,
            prepared: None,
            drawn: None,
        })
    }

    /// Whether it makes frames of `size` for lists of the same queue.
    pub fn fits(&self, gpu: &Gpu, size: (u32, u32)) -> bool {
        self.size == size && self.gpu.frames().d3d12() == gpu.frames().d3d12()
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
        target: &Target,
        times: &mut PresenterStatistics,
    ) -> Result<Option<Moment>> {
        let start = Instant::now();
        let motion = presenter.options().motion;
        let supplied = self.supply.bring(&taken.plan, taken.epoch, motion)?;
        times.guidance += start.elapsed();
        let start = Instant::now();
        if let Plan::Between { index, .. } = &taken.plan {
            self.prepare(&supplied.pair()?, (taken.epoch, *index))?;
        }
        let again = taken.shown.repeated;
        let (promises, generator) = (&mut self.promises, &mut self.generator);
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
        if !(again && generator.again(&mut frame, &to)?) {
            generate(generator, &mut frame, &taken.plan, &supplied, &to)?;
        }
        self.reports.record(&mut frame, place, &generator.report())?;
        frame.leave(&target.texture, target.after);
        frame.end_stage();
        let moment = match promised {
            Some(moment) => {
                drop(frame);
                self.reports.comes_at(place, &moment, &taken.plan);
                None
            }
            None => {
                let moment = frame.submit(self.gpu.frames())?;
                self.reports.comes_at(place, &moment, &taken.plan);
                Some(moment)
            }
        };
        times.generate += start.elapsed();
        Ok(moment)
    }
}

impl DeviceDrawer {
    /// Has what frames of a pair have in common made in a list of ours, where it is not: an engine's list may never run.
    fn prepare(&mut self, pair: &TexturePair<'_>, key: (u64, u64)) -> Result<()> {
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
        Ok(GuidanceTextures {
            motion: resting(&guidance.motion),
            motion_tile: guidance.motion_tile,
            depth: resting(&guidance.depth),
            depth_tile: guidance.depth_tile,
            hud: None,
        })
    }
}

/// Records what a plan says.
fn generate(
    generator: &mut ShaderGenerator,
    frame: &mut Frame<'_>,
    plan: &Plan,
    supplied: &Supplied,
    to: &Resting<'_>,
) -> Result<()> {
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
        target.check(&drawer.gpu, drawer.gpu.frames().kind(), drawer.size, drawer.linear)?;
        // The list before this one has been given to the queue.
        drawer.promises.keep()?;
        self.look(drawer);
        let Some(mut taken) = self.take(now, Some(Phases::Any)) else { return Ok(None) };
        let size = taken.plan.size();
        if size != drawer.size {
            let cause =
                format!("{} x {} pixels where anchors have {} x {}", drawer.size.0, drawer.size.1, size.0, size.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("target"));
        }
        taken.shown.repeated = drawer.drawn == Some(taken.key);
        drawer.drawn = None;
        let mut times = PresenterStatistics::default();
        let moment = drawer.draw(&taken, self, list, target, &mut times)?;
        drawer.drawn = Some(taken.key);
        self.count(&taken.shown, &times);
        Ok(Some((taken.shown, moment)))
    }

    /// Looks at what has happened in frames that have run meanwhile, so that [`statistics`](Self::statistics) has it.
    pub fn look(&self, drawer: &mut DeviceDrawer) {
        self.count_cuts(drawer.reports.cuts());
    }
}

impl Plan {
    /// Size of the pictures it is made of.
    fn size(&self) -> (u32, u32) {
        match self {
            Self::Copy { anchor, .. } => anchor.size(),
            Self::Between { current: slot, .. } | Self::Beyond { last: slot, .. } => slot.anchor.size(),
        }
    }
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
