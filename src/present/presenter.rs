//! Presenter: takes anchors as they arrive and returns the frames that are due.

use std::collections::VecDeque;
use std::sync::{Arc, Weak};

use parking_lot::Mutex;

use super::drawer::Drawer;
pub(crate) use super::drawer::Draws;
use super::governor::Governor;
pub use super::motion::{MotionSource, extract};
use super::pacing::{Due, DueFrame, Interval, Pacer, Pacing};
pub use super::statistics::PresenterStatistics;
use crate::framegen::{FrameGenerator, Outcome, Phases};
use crate::guidance::Guidance;
use crate::world::{self, KeptAnchor};
use crate::{Error, ErrorKind, Picture, Result};

/// Options of a presenter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PresenterOptions {
    /// The time between anchors; `None`: that of the first anchor's world.
    pub interval: Option<Interval>,
    /// As in [`Pacing`].
    pub multiplier: u32,
    /// As in [`Pacing`]; `None`: one interval.
    pub delay_ns: Option<u64>,
    /// As in [`Pacing`].
    pub catch_up: bool,
    /// Whether to extrapolate, for at most an interval, while an anchor is late; otherwise the last anchor is held.
    pub extrapolate: bool,
    /// Whether the pictures of an anchor with `multiplier` decoded pictures are shown as the frames before it.
    pub decoded: bool,
    /// `(width, height)` of the frames; `None`: that of the anchors.
    pub size: Option<(u32, u32)>,
    /// Whether anchors keep their aspect ratio in frames of another, with black bars (letterbox); otherwise they are stretched.
    pub letterbox: bool,
    /// Largest number of anchors that wait to become due.
    pub capacity: usize,
    /// Source of motion for anchors without guidance.
    pub motion: MotionSource,
}

impl Default for PresenterOptions {
    /// Two frames per anchor, at the rate of the first anchor's world, with a delay of one interval: the same as all zero in the C interface.
    fn default() -> Self {
        Self {
            interval: None,
            multiplier: 2,
            delay_ns: None,
            catch_up: false,
            extrapolate: true,
            decoded: true,
            size: None,
            letterbox: false,
            capacity: 4,
            motion: MotionSource::PictureFlow,
        }
    }
}

/// Information about a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// When it is due, and its position in the stream.
    pub due: Due,
    /// How it is made.
    pub source: FrameSource,
    /// Number of the anchor it shows or starts from.
    pub previous: u64,
    /// Number of the anchor it leads to; the same as `previous` if it leads to none.
    pub current: u64,
    /// Time after `previous` in intervals, 0 to 1.
    pub t: f32,
    /// Whether a cut keeps it from being generated.
    pub cut: bool,
    /// Whether it is the same picture as the last drawn frame.
    pub repeated: bool,
    /// Whether an anchor replaces it because it was not prepared.
    pub unprepared: bool,
}

/// Source of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSource {
    /// An anchor.
    Anchor,
    /// A decoded picture that belongs to the next anchor.
    Decoded,
    /// Generated between two anchors.
    Generated,
    /// Extrapolated from the last anchor, because the next one is late.
    Extrapolated,
    /// A held picture: nothing may or can be generated.
    Held,
}

/// Shows a stream of anchors at a steady rate. Pushes and queries never wait for a picture that is being drawn.
pub struct Presenter {
    options: PresenterOptions,
    phases: Option<Phases>,
    stream: Mutex<Stream>,
    drawer: Mutex<Drawer>,
}

/// Anchors and their clock.
struct Stream {
    pacer: Option<Pacer>,
    /// Number of resets; part of cache keys, so that frames from before a reset are not reused.
    epoch: u64,
    /// Index of the first anchor in `slots`, in the order they were pushed.
    first: u64,
    slots: VecDeque<Slot>,
    /// Pushed anchors whose fences are not signalled yet, in order.
    arriving: VecDeque<(Arc<KeptAnchor>, Option<Arc<Guidance>>)>,
    size: Option<(u32, u32)>,
    /// Size of the frames if it is not that of the anchors.
    wanted: Option<(u32, u32)>,
    /// The static overlay over the anchors.
    overlay: Option<Arc<Overlay>>,
    /// The governor of the presenter's own budget.
    governor: Option<Governor>,
    /// A rollout's governor, followed as long as it exists.
    followed: Option<Weak<world::Governor>>,
    statistics: PresenterStatistics,
}

/// An anchor, with the guidance that was pushed with it.
#[derive(Clone)]
pub(super) struct Slot {
    pub(super) anchor: Arc<KeptAnchor>,
    pub(super) guidance: Option<Arc<Guidance>>,
    pub(super) cut: bool,
}

/// Mask of a static overlay over the anchors, such as a HUD: one byte per pixel, 0 where there is no overlay.
#[derive(Debug)]
pub(super) struct Overlay {
    pub(super) size: (u32, u32),
    pub(super) mask: Vec<u8>,
}

#[cfg(windows)]
impl Overlay {
    /// The mask resized to another size by nearest neighbour.
    pub(super) fn at(&self, size: (u32, u32)) -> Vec<u8> {
        let nearest =
            |at: u32, from: u32, to: u32| (u64::from(2 * at + 1) * u64::from(from) / (2 * u64::from(to))) as usize;
        let columns: Vec<_> = (0..size.0).map(|x| nearest(x, self.size.0, size.0)).collect();
        let mut made = Vec::with_capacity(columns.len() * size.1 as usize);
        for y in 0..size.1 {
            let row = &self.mask[nearest(y, self.size.1, size.1) * self.size.0 as usize..];
            made.extend(columns.iter().map(|x| row[*x]));
        }
        made
    }
}

/// How a frame is made.
pub(super) enum Plan {
    /// Picture number `picture` of `current`, the anchor with that index, unchanged.
    #[cfg_attr(not(windows), expect(dead_code, reason = "a device is told what leads to it"))]
    Copy {
        previous: Option<Slot>,
        current: Slot,
        index: u64,
        picture: usize,
    },
    Interpolate {
        previous: Slot,
        current: Slot,
        index: u64,
        t: f32,
    },
    Extrapolate {
        previous: Option<Slot>,
        last: Slot,
        index: u64,
        t: f32,
    },
}

/// Cache key of a frame: epoch, due frame, and size if it is not that of the anchors.
pub(super) type FrameKey = (u64, DueFrame, Option<(u32, u32)>);

/// A frame that is due and not made yet.
pub(super) struct PendingFrame {
    pub(super) shown: FrameInfo,
    pub(super) plan: Plan,
    /// The stream's epoch: number of resets before it.
    pub(super) epoch: u64,
    /// Size of the frames if it is not that of the anchors.
    pub(super) size: Option<(u32, u32)>,
    /// The static overlay over the anchors.
    pub(super) overlay: Option<Arc<Overlay>>,
    pub(super) key: FrameKey,
}

impl Presenter {
    /// A presenter whose frames `generator` makes; without one, each anchor is held until the next.
    ///
    /// # Errors
    /// `InvalidArgument` for a multiplier of 0 or above 64, a delay above [`MAX_INTERVAL_NS`](super::pacing::MAX_INTERVAL_NS),
    /// a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE) or a capacity of 0.
    pub fn new(options: PresenterOptions, generator: Option<Box<dyn FrameGenerator>>) -> Result<Self> {
        // Checks the pacer's options now instead of with the first anchor.
        options.pacer(Interval::per_second(1)?)?;
        let refuse = |field: &str, cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
        check_size(options.size)?;
        if options.capacity == 0 {
            return refuse("capacity", "no anchor could ever wait".into());
        }
        let no_room = |_| {
            Error::new(ErrorKind::OutOfMemory, format!("{} anchors cannot wait", options.capacity)).field("capacity")
        };
        let (mut slots, mut arriving) = (VecDeque::new(), VecDeque::new());
        slots.try_reserve(options.capacity.saturating_add(3)).map_err(no_room)?;
        arriving.try_reserve(options.capacity).map_err(no_room)?;
        let stream = Stream {
            pacer: None,
            epoch: 0,
            first: 0,
            slots,
            arriving,
            size: None,
            wanted: options.size,
            overlay: None,
            governor: None,
            followed: None,
            statistics: PresenterStatistics::default(),
        };
        let phases = generator.as_ref().map(|generator| generator.phases());
        let drawer = Drawer::new(generator);
        Ok(Self { options, phases, stream: Mutex::new(stream), drawer: Mutex::new(drawer) })
    }

    /// Takes an anchor at `now`, with the guidance from it back to the anchor before, if there is any. Each request for a frame checks
    /// [`KeptAnchor::has_arrived`]; until it is true, the anchor counts as late. Returns `false` and does not take the anchor if `capacity`
    /// anchors wait already.
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
        stream.arrive(now, self.options.multiplier);
        let known = stream.size.or_else(|| stream.arriving.front().map(|(anchor, _)| anchor.size()));
        fits(size, known.unwrap_or(size), "anchor").map_err(|e| e.remedy("Reset the presenter first"))?;
        if let Some(guidance) = &guidance {
            fits(guidance.size(), size, "guidance")?;
        }
        if let Some(overlay) = &stream.overlay {
            fits(size, overlay.size, "anchor").map_err(|e| e.remedy("Say what lies over anchors of this size"))?;
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
        let waiting = stream.pacer.as_mut().map_or(0, |pacer| pacer.waiting(now));
        if waiting + stream.arriving.len() as u64 >= self.options.capacity as u64 {
            return Ok(false);
        }
        stream.arriving.push_back((anchor, guidance));
        stream.arrive(now, self.options.multiplier);
        Ok(true)
    }

    /// The frame that is due at `now`; `None` before the first anchor has arrived.
    pub fn query(&self, now: u64) -> Option<FrameInfo> {
        let mut stream = self.stream.lock();
        stream.arrive(now, self.options.multiplier);
        let due = stream.due(now)?;
        self.resolve(&stream, due, self.phases).map(|(shown, _)| shown)
    }

    /// `(width, height)` of the frames; `None` before the first anchor unless the options set it.
    pub fn size(&self) -> Option<(u32, u32)> {
        let stream = self.stream.lock();
        stream.wanted.or(stream.size)
    }

    /// `(width, height)` of the frames if it is not that of the anchors.
    pub fn wanted_size(&self) -> Option<(u32, u32)> {
        self.stream.lock().wanted
    }

    /// Changes the size of the frames, for example with a window's; `None`: that of the anchors. The stream continues; the next frame has the size.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    pub fn resize(&self, size: Option<(u32, u32)>) -> Result<()> {
        check_size(size)?;
        self.stream.lock().wanted = size;
        Ok(())
    }

    /// Sets the mask of a static overlay, such as a HUD, from the next frame on: one byte per pixel of an anchor, `size.0` times `size.1` bytes row
    /// by row, 0 where there is no overlay. `None`: no mask is known, and generators detect static pixels themselves. A [`reset`](Self::reset)
    /// removes the mask. Every generator uses it.
    ///
    /// # Errors
    /// `InvalidArgument` for another number of bytes, and for another size than that of the anchors that have arrived.
    pub fn set_overlay(&self, overlay: Option<((u32, u32), Vec<u8>)>) -> Result<()> {
        let refuse = |cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field("overlay"));
        let mut stream = self.stream.lock();
        stream.overlay = match overlay {
            None => None,
            Some((size, mask)) => {
                if mask.len() as u64 != u64::from(size.0) * u64::from(size.1) || mask.is_empty() {
                    return refuse(format!("{} bytes for {} x {} pixels", mask.len(), size.0, size.1));
                }
                if let Some(have) = stream.size.filter(|have| *have != size) {
                    return refuse(format!("{} x {} pixels over {} x {}", size.0, size.1, have.0, have.1));
                }
                Some(Arc::new(Overlay { size, mask }))
            }
        };
        Ok(())
    }

    /// Frames shown per anchor.
    pub fn multiplier(&self) -> u32 {
        self.options.multiplier
    }

    /// Whether anchors keep their aspect ratio in frames of another.
    pub fn keeps_shape(&self) -> bool {
        self.options.letterbox
    }

    /// `(width, height)` of the anchors; `None` before the first.
    pub fn anchor_size(&self) -> Option<(u32, u32)> {
        self.stream.lock().size
    }

    /// Makes the frame that is due at `now` and passes it to `write`; `None` before the first anchor has arrived. A frame that the
    /// last call made is not made again.
    ///
    /// # Errors
    /// `InvalidArgument` if frames do not have `size`, or latents are needed and the anchors have none; `OutOfMemory`.
    pub fn draw(&self, now: u64, size: (u32, u32), write: impl FnOnce(&Picture)) -> Result<Option<FrameInfo>> {
        self.draw_of(Draws::Frames, now, size, |picture, _| write(picture))
    }

    /// As [`draw`](Self::draw), for all frames or for anchors only; `write` also gets whether the picture is the same as that of the last call.
    pub(crate) fn draw_of(
        &self,
        draws: Draws,
        now: u64,
        size: (u32, u32),
        write: impl FnOnce(&Picture, bool),
    ) -> Result<Option<FrameInfo>> {
        let mut drawer = self.drawer.lock();
        let phases = drawer.phases().filter(|_| draws == Draws::Frames);
        let Some(mut pending) = self.take(now, phases) else { return Ok(None) };
        if let (Draws::Anchors, Plan::Copy { current, index, picture, .. }) = (draws, &pending.plan)
            && picture + 1 == current.anchor.count()
        {
            // All frames that show an anchor are one picture.
            pending.key.1 = DueFrame::Anchor(*index);
        }
        pending.shown.unprepared = draws == Draws::Anchors;
        pending.shown.repeated = drawer.drawn == Some(pending.key);
        let mut figures = PresenterStatistics::default();
        let picture = drawer.make(&pending, &self.options, size, &mut figures)?;
        write(picture, pending.shown.repeated);
        drawer.drawn = Some(pending.key);
        let PendingFrame { mut shown, plan, .. } = pending;
        if !matches!(plan, Plan::Copy { .. }) && drawer.outcome != Outcome::Generated {
            shown.source = FrameSource::Held;
            shown.cut |= drawer.outcome == Outcome::CutFallback;
        }
        self.count(&shown, &figures);
        Ok(Some(shown))
    }

    /// The frame that is due at `now`, planned for a generator of `phases`; `None` before the first anchor has arrived.
    pub(super) fn take(&self, now: u64, phases: Option<Phases>) -> Option<PendingFrame> {
        let mut stream = self.stream.lock();
        stream.arrive(now, self.options.multiplier);
        let due = stream.due(now)?;
        let (shown, plan) = self.resolve(&stream, due, phases)?;
        let frame = if self.options.extrapolate { due.frame } else { stands(due.frame) };
        let (epoch, size, overlay) = (stream.epoch, stream.wanted, stream.overlay.clone());
        Some(PendingFrame { shown, plan, epoch, size, overlay, key: (epoch, frame, size) })
    }

    /// Counts a frame that was made.
    pub(super) fn count(&self, shown: &FrameInfo, times: &PresenterStatistics) {
        self.stream.lock().statistics.count(shown, times);
    }

    /// Counts objects created while a frame was made.
    #[cfg(windows)]
    pub(crate) fn count_objects(&self, made: u64) {
        self.stream.lock().statistics.objects_made += made;
    }

    /// Recounts frames as held with a cut that were counted as generated: the device detected a cut in them afterwards.
    #[cfg(windows)]
    pub(super) fn count_cuts(&self, frames: u64) {
        let figures = &mut self.stream.lock().statistics;
        figures.generated = figures.generated.saturating_sub(frames);
        figures.held += frames;
        figures.cuts += frames;
    }

    /// Its options.
    #[cfg(windows)]
    pub(super) fn options(&self) -> &PresenterOptions {
        &self.options
    }

    /// Declares that the device also generates frames of `phases`, so that [`query`](Self::query) reports them.
    pub fn with_phases(self, phases: Phases) -> Self {
        Self { phases: Some(phases), ..self }
    }

    /// Discards all anchors, for example after a change of world; the next anchor is a first again. Counters are kept.
    pub fn reset(&self) {
        let mut stream = self.stream.lock();
        stream.pacer = None;
        stream.slots.clear();
        stream.arriving.clear();
        stream.first = 0;
        stream.size = None;
        stream.overlay = None;
        stream.epoch += 1;
    }

    /// Its statistics.
    pub fn statistics(&self) -> PresenterStatistics {
        let stream = self.stream.lock();
        match stream.followed().map(|governor| governor.statistics()) {
            None => stream.statistics,
            Some(told) => PresenterStatistics {
                made_to_anchor: told.made,
                budget_changes: told.less + told.more,
                ..stream.statistics
            },
        }
    }

    /// Anchors that were pushed and have not arrived.
    pub fn arriving(&self) -> usize {
        self.stream.lock().arriving.len()
    }

    /// Anchors that have arrived and are not due at `now`.
    pub fn waiting(&self, now: u64) -> u64 {
        self.stream.lock().pacer.as_mut().map_or(0, |pacer| pacer.waiting(now))
    }

    /// Whether an anchor with `pictures` pictures brings all frames of its interval.
    pub(super) fn brings_all(&self, pictures: usize) -> bool {
        self.options.decoded && pictures > 1 && pictures == self.options.multiplier as usize
    }

    /// Decides what to show for `due` and how to make it.
    fn resolve(&self, stream: &Stream, due: Due, phases: Option<Phases>) -> Option<(FrameInfo, Plan)> {
        let slot = |index: u64| {
            let at = usize::try_from(index.checked_sub(stream.first)?).ok()?;
            stream.slots.get(at)
        };
        let t = |step: u32| step as f32 / self.options.multiplier as f32;
        let generates = |t: f32| phases.is_some_and(|phases| phases.contains(t));
        let shown = |source, previous: u64, current: u64, t, cut| FrameInfo {
            due,
            source,
            previous,
            current,
            t,
            cut,
            repeated: false,
            unprepared: false,
        };
        let copy = |index: u64, picture: usize| {
            let previous = index.checked_sub(1).and_then(slot).cloned();
            Some(Plan::Copy { previous, current: slot(index)?.clone(), index, picture })
        };
        let held = |index: u64, cut| {
            let anchor = &slot(index)?.anchor;
            let number = anchor.number();
            Some((shown(FrameSource::Held, number, number, 0.0, cut), copy(index, anchor.count() - 1)?))
        };
        match due.frame {
            // An anchor that replaces a frame left out under the budget.
            DueFrame::Anchor(index) if !due.position.is_multiple_of(self.options.multiplier.into()) => {
                held(index, false)
            }
            DueFrame::Anchor(index) => {
                let (of, plan) = held(index, false)?;
                Some((FrameInfo { source: FrameSource::Anchor, ..of }, plan))
            }
            DueFrame::Interpolate { previous: index, step } => {
                let (previous, current) = (slot(index)?, slot(index + 1)?);
                let (t, numbers) = (t(step), (previous.anchor.number(), current.anchor.number()));
                let pictures = current.anchor.count();
                if self.brings_all(pictures) {
                    let plan = copy(index + 1, step as usize - 1)?;
                    return Some((shown(FrameSource::Decoded, numbers.0, numbers.1, t, false), plan));
                }
                if current.cut || !generates(t) {
                    return held(if t < 0.5 { index } else { index + 1 }, current.cut);
                }
                let (previous, current) = (previous.clone(), current.clone());
                let plan = Plan::Interpolate { previous, current, index: index + 1, t };
                Some((shown(FrameSource::Generated, numbers.0, numbers.1, t, false), plan))
            }
            DueFrame::Extrapolate { last: index, .. } | DueFrame::Stalled { last: index } => {
                let last = slot(index)?;
                let previous = index.checked_sub(1).and_then(slot);
                let motion = last.guidance.is_some() || previous.is_some();
                if !self.options.extrapolate || last.cut || !motion || phases.is_none() {
                    return held(index, last.cut);
                }
                let (step, source) = match due.frame {
                    DueFrame::Extrapolate { step, .. } => (step, FrameSource::Extrapolated),
                    _ => (self.options.multiplier, FrameSource::Held),
                };
                let (t, number) = (t(step), last.anchor.number());
                let plan = Plan::Extrapolate { previous: previous.cloned(), last: last.clone(), index, t };
                Some((shown(source, number, number, t, false), plan))
            }
        }
    }
}

impl Stream {
    /// Moves the anchors that have arrived by now into the stream, in order.
    fn arrive(&mut self, now: u64, multiplier: u32) {
        while self.arriving.front().is_some_and(|(anchor, _)| anchor.has_arrived()) {
            let (Some((anchor, guidance)), Some(pacer)) = (self.arriving.pop_front(), &mut self.pacer) else { return };
            let (late, slipped) = (pacer.late(), pacer.slipped_ns());
            pacer.push(now);
            let figures = &mut self.statistics;
            figures.anchors += 1;
            figures.late += pacer.late() - late;
            figures.slipped_ns = figures.slipped_ns.saturating_add(pacer.slipped_ns() - slipped);
            self.size = Some(anchor.size());
            let follows = |slot: &Slot| slot.anchor.number().checked_add(1) == Some(anchor.number());
            let cut = anchor.is_cut() || !self.slots.back().is_some_and(follows);
            // Anchors before the due frame and before the last pair are not needed any more.
            let due = pacer.due(now).map_or(0, |due| due.position / u64::from(multiplier));
            let keep = due.min((pacer.anchors() - 1).saturating_sub(1));
            while self.first < keep && self.slots.pop_front().is_some() {
                self.first += 1;
            }
            self.slots.push_back(Slot { anchor, guidance, cut });
        }
    }
}

/// The frame without extrapolation: the last anchor replaces frames beyond it.
fn stands(frame: DueFrame) -> DueFrame {
    match frame {
        DueFrame::Extrapolate { last, .. } | DueFrame::Stalled { last } => DueFrame::Anchor(last),
        other => other,
    }
}

impl PresenterOptions {
    fn pacer(&self, interval: Interval) -> Result<Pacer> {
        let delay_ns = self.delay_ns.unwrap_or(interval.ns());
        Pacer::new(interval, Pacing { multiplier: self.multiplier, delay_ns, catch_up: self.catch_up })
    }
}

/// Checks a size of frames.
fn check_size(size: Option<(u32, u32)>) -> Result<()> {
    let sides = 1..=crate::MAX_SIDE;
    match size {
        Some((width, height)) if !sides.contains(&width) || !sides.contains(&height) => {
            let cause = format!("frames of {width} x {height} pixels cannot be made");
            Err(Error::new(ErrorKind::InvalidArgument, cause).field("size"))
        }
        _ => Ok(()),
    }
}

mod budget;
#[cfg(test)]
mod tests;
