//! Anchors in as they come, pictures out when they are due.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;

use super::motion::Extractors;
pub use super::motion::{MotionSource, extract};
use super::pacing::{Due, DueFrame, Interval, Pacer, Pacing};
pub use super::statistics::PresenterStatistics;
use super::upscale::{Filter, Upscaler};
use crate::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome, Phases};
use crate::guidance::{Guidance, paper};
use crate::world::KeptAnchor;
use crate::{Error, ErrorKind, Picture, Result};

/// How a presenter works.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PresenterOptions {
    /// The time between anchors; `None`: as the first anchor's world says.
    pub interval: Option<Interval>,
    /// As in [`Pacing`].
    pub multiplier: u32,
    /// As in [`Pacing`]; `None`: one interval.
    pub delay_ns: Option<u64>,
    /// As in [`Pacing`].
    pub catch_up: bool,
    /// Whether motion goes on, for at most an interval, where an anchor is late; otherwise the last anchor stands.
    pub extrapolate: bool,
    /// Whether anchors that come with `multiplier` decoded pictures bring the frames before them themselves.
    pub decoded: bool,
    /// `(width, height)` of the frames; `None`: that of the anchors.
    pub size: Option<(u32, u32)>,
    /// Anchors that may wait for their time.
    pub capacity: usize,
    /// Where motion comes from when an anchor comes without guidance.
    pub motion: MotionSource,
}

/// A frame as it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// When it is due, and its place in the stream.
    pub due: Due,
    /// What it is made of.
    pub source: ShownSource,
    /// Number of the anchor it shows or starts from.
    pub previous: u64,
    /// Number of the anchor it leads to; the same as `previous` where it leads to none.
    pub current: u64,
    /// Intervals after `previous`, 0 to 1.
    pub t: f32,
    /// Whether a cut keeps it from being generated.
    pub cut: bool,
    /// Whether it is the very picture that was drawn before.
    pub repeated: bool,
}

/// What a shown frame is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShownSource {
    /// An anchor.
    Anchor,
    /// A picture that the next anchor brought with it.
    Decoded,
    /// Generated between two anchors.
    Generated,
    /// Generated beyond the last anchor, as the next one is late.
    Extrapolated,
    /// A picture that stands: nothing may or can be generated.
    Held,
}

/// Shows a stream of anchors at a steady rate. Pushing and asking never wait for a picture that is being drawn.
pub struct Presenter {
    options: PresenterOptions,
    phases: Option<Phases>,
    stream: Mutex<Stream>,
    drawer: Mutex<Drawer>,
}

/// Anchors and their clock.
struct Stream {
    pacer: Option<Pacer>,
    /// Number of resets: what was drawn before one is not what is drawn after it.
    epoch: u64,
    /// Which anchor the first of `slots` is, counted as they were pushed.
    first: u64,
    slots: VecDeque<Slot>,
    size: Option<(u32, u32)>,
    statistics: PresenterStatistics,
}

/// An anchor, with the guidance that came with it.
#[derive(Clone)]
pub(super) struct Slot {
    pub(super) anchor: Arc<KeptAnchor>,
    pub(super) guidance: Option<Arc<Guidance>>,
    pub(super) cut: bool,
}

/// How a frame comes about.
pub(super) enum Plan {
    Copy { anchor: Arc<KeptAnchor>, picture: usize },
    Between { previous: Slot, current: Slot, index: u64, t: f32 },
    Beyond { previous: Option<Slot>, last: Slot, index: u64, t: f32 },
}

/// What a drawn picture shows: the resets before it, and the frame.
pub(super) type Drawn = (u64, DueFrame);

/// A frame that is due.
pub(super) struct Taken {
    pub(super) shown: Shown,
    pub(super) plan: Plan,
    /// Number of resets before it.
    pub(super) epoch: u64,
    pub(super) key: Drawn,
}

/// What draws, with its working memory.
struct Drawer {
    generator: Option<Box<dyn FrameGenerator>>,
    extractors: Extractors,
    /// Guidance of the pair that ends with an anchor: reset and index.
    guidance: Option<((u64, u64), Guidance)>,
    generated: Option<Picture>,
    upscaler: Option<Upscaler>,
    resized: Option<Picture>,
    drawn: Option<Drawn>,
    outcome: Outcome,
}

impl Presenter {
    /// A presenter whose frames `generator` makes; without one, anchors stand until the next.
    ///
    /// # Errors
    /// `InvalidArgument` for a multiplier of 0 or above 64, a delay above [`MAX_INTERVAL_NS`](super::pacing::MAX_INTERVAL_NS),
    /// a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE) or a capacity of 0.
    pub fn new(options: PresenterOptions, generator: Option<Box<dyn FrameGenerator>>) -> Result<Self> {
        // What the pacer refuses, it shall refuse now and not when the first anchor comes.
        options.pacer(Interval::per_second(1)?)?;
        let refuse = |field: &str, cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
        if let Some((width, height)) = options.size {
            let sides = 1..=crate::MAX_SIDE;
            if !sides.contains(&width) || !sides.contains(&height) {
                return refuse("size", format!("frames of {width} x {height} pixels cannot be made"));
            }
        }
        if options.capacity == 0 {
            return refuse("capacity", "no anchor could ever wait".into());
        }
        let mut slots = VecDeque::new();
        slots.try_reserve(options.capacity.saturating_add(3)).map_err(|_| {
            Error::new(ErrorKind::OutOfMemory, format!("{} anchors cannot wait", options.capacity)).field("capacity")
        })?;
        let stream =
            Stream { pacer: None, epoch: 0, first: 0, slots, size: None, statistics: PresenterStatistics::default() };
        let drawer = Drawer {
            generator,
            extractors: Extractors::default(),
            guidance: None,
            generated: None,
            upscaler: None,
            resized: None,
            drawn: None,
            outcome: Outcome::Held,
        };
        let phases = drawer.generator.as_ref().map(|generator| generator.phases());
        Ok(Self { options, phases, stream: Mutex::new(stream), drawer: Mutex::new(drawer) })
    }

    /// Takes an anchor that came at `now`, with the guidance that leads to it from the one before, where there is some.
    /// `false` when as many wait as may, and nothing was taken.
    ///
    /// # Errors
    /// `InvalidArgument` when the anchor or its guidance has another size than the first, or neither the options nor the
    /// first anchor say how far apart anchors are.
    pub fn push(&self, anchor: Arc<KeptAnchor>, guidance: Option<Arc<Guidance>>, now: u64) -> Result<bool> {
        let refuse = |field: &str, cause: String| Error::new(ErrorKind::InvalidArgument, cause).field(field);
        let size = anchor.size();
        let fits = |have: (u32, u32), want: (u32, u32), field: &str| {
            let cause = || format!("{} x {} pixels where the stream has {} x {}", have.0, have.1, want.0, want.1);
            if have == want { Ok(()) } else { Err(refuse(field, cause())) }
        };
        let mut stream = self.stream.lock();
        let stream = &mut *stream;
        fits(size, stream.size.unwrap_or(size), "anchor").map_err(|e| e.remedy("Reset the presenter first"))?;
        if let Some(guidance) = &guidance {
            fits(guidance.size(), size, "guidance")?;
        }
        if stream.pacer.is_none() {
            let interval = match (self.options.interval, anchor.latents_per_second()) {
                (Some(interval), _) => interval,
                (None, 0) => {
                    let cause = "a picture that no world made does not say how far apart anchors are".to_owned();
                    return Err(refuse("anchor", cause).remedy("Set the interval"));
                }
                (None, rate) => Interval::per_second(rate)?,
            };
            stream.pacer = Some(self.options.pacer(interval)?);
        }
        let Some(pacer) = &mut stream.pacer else { return Ok(false) };
        if pacer.waiting(now) >= self.options.capacity as u64 {
            return Ok(false);
        }
        let (late, slipped) = (pacer.late(), pacer.slipped_ns());
        pacer.push(now);
        let figures = &mut stream.statistics;
        figures.anchors += 1;
        figures.late += pacer.late() - late;
        figures.slipped_ns = figures.slipped_ns.saturating_add(pacer.slipped_ns() - slipped);
        stream.size = Some(size);
        let follows = |slot: &Slot| slot.anchor.number().checked_add(1) == Some(anchor.number());
        let cut = anchor.is_cut() || !stream.slots.back().is_some_and(follows);
        // What lies before the frame that is due, and before the last pair, is not shown any more.
        let due = pacer.due(now).map_or(0, |due| due.position / u64::from(self.options.multiplier));
        let keep = due.min((pacer.anchors() - 1).saturating_sub(1));
        while stream.first < keep && stream.slots.pop_front().is_some() {
            stream.first += 1;
        }
        stream.slots.push_back(Slot { anchor, guidance, cut });
        Ok(true)
    }

    /// Which frame is due at `now`; none before the first anchor came.
    pub fn query(&self, now: u64) -> Option<Shown> {
        let mut stream = self.stream.lock();
        let due = stream.pacer.as_mut()?.due(now)?;
        self.resolve(&stream, due, self.phases).map(|(shown, _)| shown)
    }

    /// `(width, height)` of the frames; none before the first anchor, where the options do not say.
    pub fn size(&self) -> Option<(u32, u32)> {
        self.options.size.or_else(|| self.stream.lock().size)
    }

    /// `(width, height)` of the anchors; none before the first.
    pub fn anchor_size(&self) -> Option<(u32, u32)> {
        self.stream.lock().size
    }

    /// Makes the frame that is due at `now` and hands it to `write`; none before the first anchor came. A frame that was
    /// made by the call before is not made again.
    ///
    /// # Errors
    /// `InvalidArgument` when frames have not `size`, or latents are needed and the anchors have none; `OutOfMemory`.
    pub fn draw(&self, now: u64, size: (u32, u32), write: impl FnOnce(&Picture)) -> Result<Option<Shown>> {
        let mut drawer = self.drawer.lock();
        let phases = drawer.generator.as_ref().map(|generator| generator.phases());
        let Some(Taken { mut shown, plan, epoch, key }) = self.take(now, phases) else { return Ok(None) };
        shown.repeated = drawer.drawn == Some(key);
        let mut figures = PresenterStatistics::default();
        let picture = drawer.make(&plan, epoch, &self.options, size, shown.repeated, &mut figures)?;
        write(picture);
        drawer.drawn = Some(key);
        if !matches!(plan, Plan::Copy { .. }) && drawer.outcome != Outcome::Generated {
            shown.source = ShownSource::Held;
            shown.cut |= drawer.outcome == Outcome::CutFallback;
        }
        self.count(&shown, &figures);
        Ok(Some(shown))
    }

    /// The frame that is due at `now`, to be made by whoever does `phases`; none before the first anchor came.
    pub(super) fn take(&self, now: u64, phases: Option<Phases>) -> Option<Taken> {
        let mut stream = self.stream.lock();
        let due = stream.pacer.as_mut()?.due(now)?;
        let (shown, plan) = self.resolve(&stream, due, phases)?;
        let frame = if self.options.extrapolate { due.frame } else { stands(due.frame) };
        Some(Taken { shown, plan, epoch: stream.epoch, key: (stream.epoch, frame) })
    }

    /// Counts a frame that was made.
    pub(super) fn count(&self, shown: &Shown, times: &PresenterStatistics) {
        self.stream.lock().statistics.count(shown, times);
    }

    /// Counts frames again that were taken for generated, and are anchors after all: a cut was found once they were made.
    #[cfg(windows)]
    pub(super) fn count_cuts(&self, frames: u64) {
        let figures = &mut self.stream.lock().statistics;
        figures.generated = figures.generated.saturating_sub(frames);
        figures.held += frames;
        figures.cuts += frames;
    }

    /// How it works.
    #[cfg(windows)]
    pub(super) fn options(&self) -> &PresenterOptions {
        &self.options
    }

    /// Frames of `phases` are generated also by who records them, so that [`query`](Self::query) says so.
    pub fn with_phases(self, phases: Phases) -> Self {
        Self { phases: Some(phases), ..self }
    }

    /// Forgets all anchors, as after a change of world; the next one is a first again. What was counted stays.
    pub fn reset(&self) {
        let mut stream = self.stream.lock();
        stream.pacer = None;
        stream.slots.clear();
        stream.first = 0;
        stream.size = None;
        stream.epoch += 1;
    }

    /// What it has done.
    pub fn statistics(&self) -> PresenterStatistics {
        self.stream.lock().statistics
    }

    /// Anchors that are there and not due at `now`.
    pub fn waiting(&self, now: u64) -> u64 {
        self.stream.lock().pacer.as_mut().map_or(0, |pacer| pacer.waiting(now))
    }

    /// What to show and how it comes about.
    fn resolve(&self, stream: &Stream, due: Due, phases: Option<Phases>) -> Option<(Shown, Plan)> {
        let slot = |index: u64| {
            let at = usize::try_from(index.checked_sub(stream.first)?).ok()?;
            stream.slots.get(at)
        };
        let t = |step: u32| step as f32 / self.options.multiplier as f32;
        let generates = |t: f32| phases.is_some_and(|phases| phases.contains(t));
        let shown = |source, previous: u64, current: u64, t, cut| Shown {
            due,
            source,
            previous,
            current,
            t,
            cut,
            repeated: false,
        };
        let held = |slot: &Slot, cut| {
            let number = slot.anchor.number();
            let plan = Plan::Copy { anchor: slot.anchor.clone(), picture: slot.anchor.count() - 1 };
            (shown(ShownSource::Held, number, number, 0.0, cut), plan)
        };
        match due.frame {
            DueFrame::Anchor(index) => {
                let (of, plan) = held(slot(index)?, false);
                Some((Shown { source: ShownSource::Anchor, ..of }, plan))
            }
            DueFrame::Between { previous: index, step } => {
                let (previous, current) = (slot(index)?, slot(index + 1)?);
                let (t, numbers) = (t(step), (previous.anchor.number(), current.anchor.number()));
                let pictures = current.anchor.count();
                if self.options.decoded && pictures > 1 && pictures == self.options.multiplier as usize {
                    let plan = Plan::Copy { anchor: current.anchor.clone(), picture: step as usize - 1 };
                    return Some((shown(ShownSource::Decoded, numbers.0, numbers.1, t, false), plan));
                }
                if current.cut || !generates(t) {
                    return Some(held(if t < 0.5 { previous } else { current }, current.cut));
                }
                let (previous, current) = (previous.clone(), current.clone());
                let plan = Plan::Between { previous, current, index: index + 1, t };
                Some((shown(ShownSource::Generated, numbers.0, numbers.1, t, false), plan))
            }
            DueFrame::Beyond { last: index, .. } | DueFrame::Stalled { last: index } => {
                let last = slot(index)?;
                let previous = index.checked_sub(1).and_then(slot);
                let motion = last.guidance.is_some() || previous.is_some();
                if !self.options.extrapolate || last.cut || !motion || phases.is_none() {
                    return Some(held(last, last.cut));
                }
                let (step, source) = match due.frame {
                    DueFrame::Beyond { step, .. } => (step, ShownSource::Extrapolated),
                    _ => (self.options.multiplier, ShownSource::Held),
                };
                let (t, number) = (t(step), last.anchor.number());
                let plan = Plan::Beyond { previous: previous.cloned(), last: last.clone(), index, t };
                Some((shown(source, number, number, t, false), plan))
            }
        }
    }
}

/// A late anchor's frames where nothing is extrapolated: the last anchor.
fn stands(frame: DueFrame) -> DueFrame {
    match frame {
        DueFrame::Beyond { last, .. } | DueFrame::Stalled { last } => DueFrame::Anchor(last),
        other => other,
    }
}

impl PresenterOptions {
    fn pacer(&self, interval: Interval) -> Result<Pacer> {
        let delay_ns = self.delay_ns.unwrap_or(interval.ns());
        Pacer::new(interval, Pacing { multiplier: self.multiplier, delay_ns, catch_up: self.catch_up })
    }
}

impl Drawer {
    /// The picture of `plan` in the size of the frames; `again` when it is the last one made.
    fn make<'a>(
        &'a mut self,
        plan: &'a Plan,
        epoch: u64,
        options: &PresenterOptions,
        size: (u32, u32),
        again: bool,
        times: &mut PresenterStatistics,
    ) -> Result<&'a Picture> {
        if !again {
            self.drawn = None;
            self.generate(plan, epoch, options, times)?;
        }
        let made = match plan {
            Plan::Copy { anchor, picture } => anchor.read(*picture)?,
            Plan::Between { .. } | Plan::Beyond { .. } => self.generated.as_ref().ok_or_else(nothing_made)?,
        };
        let wanted = options.size.unwrap_or(made.size());
        if wanted != size {
            let cause = format!("{} x {} pixels where frames have {} x {}", size.0, size.1, wanted.0, wanted.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("target"));
        }
        if wanted == made.size() {
            return Ok(made);
        }
        let start = Instant::now();
        let fits = |u: &Upscaler| u.from_size() == made.size() && u.to_size() == wanted;
        if !self.upscaler.as_ref().is_some_and(fits) {
            self.upscaler = Some(Upscaler::new(made.size(), wanted, Filter::Lanczos3)?);
        }
        let resized = of_size(&mut self.resized, wanted)?;
        if let Some(upscaler) = self.upscaler.as_mut().filter(|_| !again) {
            upscaler.upscale(made, resized)?;
        }
        times.resize += start.elapsed();
        Ok(resized)
    }

    /// Fills `generated` where the plan is to generate.
    fn generate(
        &mut self,
        plan: &Plan,
        epoch: u64,
        options: &PresenterOptions,
        times: &mut PresenterStatistics,
    ) -> Result<()> {
        let (previous, current, index, t) = match plan {
            Plan::Copy { .. } => return Ok(()),
            Plan::Between { previous, current, index, t } => (Some(previous), current, *index, *t),
            Plan::Beyond { previous, last, index, t } => (previous.as_ref(), last, *index, *t),
        };
        let start = Instant::now();
        if current.guidance.is_none() && self.guidance.as_ref().is_none_or(|(of, _)| *of != (epoch, index)) {
            let previous = &previous.ok_or_else(nothing_made)?.anchor;
            self.extract(options.motion, previous, &current.anchor, (epoch, index))?;
        }
        let guidance = match &current.guidance {
            Some(guidance) => guidance,
            None => self.guidance.as_ref().map(|(_, guidance)| guidance).ok_or_else(nothing_made)?,
        };
        times.guidance += start.elapsed();
        let start = Instant::now();
        let generator = self.generator.as_mut().ok_or_else(nothing_made)?;
        let picture = current.anchor.picture()?;
        let out = of_size(&mut self.generated, picture.size())?;
        let report = match plan {
            Plan::Between { previous, .. } => {
                let mut pair = AnchorPair::new(previous.anchor.picture()?, picture, guidance)?;
                if let Some(guidance) = &previous.guidance {
                    pair = pair.with_previous_depth(guidance.depth())?;
                }
                generator.generate(&pair, t, out)?
            }
            _ => generator.extrapolate(&Anchor::new(picture, guidance)?, t, out)?,
        };
        self.outcome = report.outcome;
        times.generate += start.elapsed();
        Ok(())
    }

    /// Motion and depth of a pair, kept under `key`.
    fn extract(
        &mut self,
        source: MotionSource,
        previous: &KeptAnchor,
        current: &KeptAnchor,
        key: (u64, u64),
    ) -> Result<()> {
        let (width, height) = current.size();
        let mut guidance = match self.guidance.take() {
            Some((_, guidance)) => guidance,
            None => Guidance::new(width, height, paper::PROJECTION)?,
        };
        self.extractors.fill(source, previous, current, &mut guidance)?;
        self.guidance = Some((key, guidance));
        Ok(())
    }
}

/// The buffer, which becomes one of `size` if it is another.
fn of_size(buffer: &mut Option<Picture>, size: (u32, u32)) -> Result<&mut Picture> {
    if buffer.as_ref().is_none_or(|picture| picture.size() != size) {
        *buffer = Some(Picture::new(size.0, size.1)?);
    }
    buffer.as_mut().ok_or_else(nothing_made)
}

/// Cannot come about: what is asked for was put there just before.
fn nothing_made() -> Error {
    Error::new(ErrorKind::InvalidState, "nothing was generated yet")
}

#[cfg(test)]
mod tests;
