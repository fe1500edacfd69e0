//! Presenter: takes anchors as they arrive and returns the frames that are due.

use std::collections::VecDeque;
use std::sync::{Arc, Weak};

use crate::locks::Mutex;

use super::cpu_drawer::CpuDrawer;
pub(crate) use super::frame::DrawMode;
pub use super::frame::{FrameInfo, FrameSource};
use super::frame::{FrameKey, FramePlan, FrameRequest, FrameTimes, OverlayMask, StreamAnchor};
use super::frame_governor::FrameGovernor;
pub use super::motion::extract;
use super::pacing::{Due, DueFrame, Interval, Pacer, Pacing};
pub use super::statistics::PresenterStatistics;
use crate::framegen::{AnchorId, FrameGenerator, Outcome, Phases};
use crate::guidance::Guidance;
use crate::world::{self, GuidanceSource, KeptAnchor};
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
    pub motion: GuidanceSource,
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
            motion: GuidanceSource::PictureFlow,
        }
    }
}

/// Shows a stream of anchors at a steady rate. Pushes and queries never wait for a picture that is being drawn.
pub struct Presenter {
    options: PresenterOptions,
    /// Phases at which frames can be generated, on the CPU or on a device; `None` without a generator.
    phases: Option<Phases>,
    stream: Mutex<Stream>,
    drawer: Mutex<CpuDrawer>,
}

/// Anchors and their clock.
struct Stream {
    pacer: Option<Pacer>,
    /// Number of resets; part of cache keys, so that frames from before a reset are not reused.
    epoch: u64,
    /// Index of the first anchor in `anchors`, in the order they were pushed.
    first: u64,
    anchors: VecDeque<StreamAnchor>,
    /// Pushed anchors whose fences are not signalled yet, in order.
    arriving: VecDeque<(Arc<KeptAnchor>, Option<Arc<Guidance>>)>,
    /// Size of the anchors.
    anchor_size: Option<(u32, u32)>,
    /// Size of the frames if it is not that of the anchors.
    custom_size: Option<(u32, u32)>,
    /// The static overlay over the anchors.
    overlay: Option<Arc<OverlayMask>>,
    /// The governor of the presenter's own budget.
    governor: Option<FrameGovernor>,
    /// A rollout's governor, followed as long as it exists.
    followed: Option<Weak<world::Governor>>,
    statistics: PresenterStatistics,
}

impl Presenter {
    /// Creates a presenter. `generator` makes its frames on the CPU; without one, each anchor is held until the next.
    ///
    /// # Errors
    /// `InvalidArgument` for a multiplier of 0 or above 64, a delay above [`MAX_INTERVAL_NS`](super::pacing::MAX_INTERVAL_NS),
    /// a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE) or a capacity of 0.
    pub fn new(options: PresenterOptions, generator: Option<Box<dyn FrameGenerator>>) -> Result<Self> {
        // Checks the pacer's options here instead of at the first anchor.
        options.pacer(Interval::per_second(1)?)?;
        let refuse = |field: &str, cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
        check_size(options.size)?;
        if options.capacity == 0 {
            return refuse("capacity", "no anchor could ever wait".into());
        }
        let out_of_memory = |_| {
            Error::new(ErrorKind::OutOfMemory, format!("{} anchors cannot wait", options.capacity)).field("capacity")
        };
        let (mut anchors, mut arriving) = (VecDeque::new(), VecDeque::new());
        anchors.try_reserve(options.capacity.saturating_add(3)).map_err(out_of_memory)?;
        arriving.try_reserve(options.capacity).map_err(out_of_memory)?;
        let stream = Stream {
            pacer: None,
            epoch: 0,
            first: 0,
            anchors,
            arriving,
            anchor_size: None,
            custom_size: options.size,
            overlay: None,
            governor: None,
            followed: None,
            statistics: PresenterStatistics::default(),
        };
        let phases = generator.as_ref().map(|generator| generator.phases());
        let drawer = CpuDrawer::new(generator);
        Ok(Self { options, phases, stream: Mutex::new(stream), drawer: Mutex::new(drawer) })
    }

    /// Takes an anchor at `now`, with the guidance from it back to the anchor before, if there is any. Each request for a frame checks
    /// [`KeptAnchor::is_complete`]; until it is true, the anchor counts as late. Returns `false` and does not take the anchor if `capacity`
    /// anchors wait already.
    ///
    /// # Errors
    /// `InvalidArgument` if the anchor or its guidance has another size than the first anchor, or neither the options nor the first anchor have an
    /// interval.
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
        fits(size, stream.pushed_size().unwrap_or(size), "anchor")
            .map_err(|e| e.remedy("Reset the presenter first"))?;
        if let Some(guidance) = &guidance {
            fits(guidance.size(), size, "guidance")?;
        }
        if let Some(overlay) = &stream.overlay {
            fits(size, overlay.size, "anchor").map_err(|e| e.remedy("Pass an overlay mask of the anchors' size"))?;
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
        self.resolve(&stream, due, self.phases).map(|(info, _)| info)
    }

    /// `(width, height)` of the frames; `None` before the first anchor unless the options set it.
    pub fn size(&self) -> Option<(u32, u32)> {
        let stream = self.stream.lock();
        stream.custom_size.or(stream.anchor_size)
    }

    /// `(width, height)` of the frames if it is not that of the anchors.
    pub fn custom_size(&self) -> Option<(u32, u32)> {
        self.stream.lock().custom_size
    }

    /// Changes the size of the frames, for example with a window's; `None`: that of the anchors. The stream continues; the next frame has the size.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    pub fn resize(&self, size: Option<(u32, u32)>) -> Result<()> {
        check_size(size)?;
        self.stream.lock().custom_size = size;
        Ok(())
    }

    /// Sets the mask of a static overlay, such as a HUD, from the next frame on: one byte per pixel of an anchor, `size.0` times `size.1` bytes row
    /// by row, 0 where there is no overlay. `None`: no mask is known, and generators detect static pixels themselves. A [`reset`](Self::reset)
    /// removes the mask. Every generator uses it.
    ///
    /// # Errors
    /// `InvalidArgument` for another number of bytes, and for another size than that of the anchors that were pushed.
    pub fn set_overlay(&self, overlay: Option<((u32, u32), Vec<u8>)>) -> Result<()> {
        let refuse = |cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field("overlay"));
        let mut stream = self.stream.lock();
        stream.overlay = match overlay {
            None => None,
            Some((size, mask)) => {
                if mask.len() as u64 != u64::from(size.0) * u64::from(size.1) || mask.is_empty() {
                    return refuse(format!("{} bytes for {} x {} pixels", mask.len(), size.0, size.1));
                }
                if let Some(have) = stream.pushed_size().filter(|have| *have != size) {
                    return refuse(format!("{} x {} pixels over {} x {}", size.0, size.1, have.0, have.1));
                }
                Some(Arc::new(OverlayMask { size, mask }))
            }
        };
        Ok(())
    }

    /// Frames shown per anchor.
    pub fn multiplier(&self) -> u32 {
        self.options.multiplier
    }

    /// `(width, height)` of the anchors; `None` before the first.
    pub fn anchor_size(&self) -> Option<(u32, u32)> {
        self.stream.lock().anchor_size
    }

    /// Makes the frame that is due at `now` and passes it to `write`; `None` before the first anchor has arrived. A frame that the
    /// last call made is not made again.
    ///
    /// # Errors
    /// `InvalidArgument` if frames do not have `size`, or motion from latents is needed and the anchors have none; `OutOfMemory`.
    pub fn draw(&self, now: u64, size: (u32, u32), write: impl FnOnce(&Picture)) -> Result<Option<FrameInfo>> {
        self.draw_in_mode(DrawMode::AllFrames, now, size, |picture, _| write(picture))
    }

    /// As [`draw`](Self::draw), for all frames or for anchors only; `write` also receives a number above 0, which differs between pictures.
    pub(crate) fn draw_in_mode(
        &self,
        mode: DrawMode,
        now: u64,
        size: (u32, u32),
        write: impl FnOnce(&Picture, u64),
    ) -> Result<Option<FrameInfo>> {
        let mut drawer = self.drawer.lock();
        let phases = drawer.phases().filter(|_| mode == DrawMode::AllFrames);
        let Some(mut request) = self.request(now, phases) else { return Ok(None) };
        if let (DrawMode::AnchorsOnly, FramePlan::Copy { current, id, picture, .. }) = (mode, &request.plan)
            && picture + 1 == current.anchor.count()
        {
            // All frames that show an anchor are one picture.
            request.key.frame = DueFrame::Anchor(id.index);
        }
        request.info.unprepared = mode == DrawMode::AnchorsOnly;
        request.info.repeated = drawer.last == Some(request.key);
        if !request.info.repeated {
            drawer.pictures += 1;
        }
        let number = drawer.pictures;
        let mut times = FrameTimes::default();
        let picture = drawer.make(&request, size, &mut times)?;
        write(picture, number);
        drawer.last = Some(request.key);
        let FrameRequest { mut info, plan, .. } = request;
        if !matches!(plan, FramePlan::Copy { .. }) && drawer.outcome != Outcome::Generated {
            info.source = FrameSource::Held;
            info.cut |= drawer.outcome == Outcome::CutFallback;
        }
        self.count(&info, &times);
        Ok(Some(info))
    }

    /// The frame that is due at `now`, planned for a generator of `phases`; `None` before the first anchor has arrived.
    fn request(&self, now: u64, phases: Option<Phases>) -> Option<FrameRequest> {
        let mut stream = self.stream.lock();
        stream.arrive(now, self.options.multiplier);
        let due = stream.due(now)?;
        let (info, plan) = self.resolve(&stream, due, phases)?;
        let frame = if self.options.extrapolate { due.frame } else { without_extrapolation(due.frame) };
        let PresenterOptions { motion, letterbox, multiplier, .. } = self.options;
        Some(FrameRequest {
            info,
            plan,
            key: FrameKey { epoch: stream.epoch, frame, size: stream.custom_size },
            overlay: stream.overlay.clone(),
            motion,
            letterbox,
            multiplier,
        })
    }

    /// Counts a frame that was made.
    fn count(&self, info: &FrameInfo, times: &FrameTimes) {
        self.stream.lock().statistics.count(info, times);
    }

    /// Counts objects created while a frame was made.
    #[cfg(windows)]
    pub(crate) fn count_objects(&self, made: u64) {
        self.stream.lock().statistics.objects_made += made;
    }

    /// Declares that the device also generates frames of `phases`, so that [`query`](Self::query) reports them.
    pub fn with_phases(self, phases: Phases) -> Self {
        Self { phases: Some(phases), ..self }
    }

    /// Discards all anchors, for example after a change of world; the next anchor is the first one again. Counters are kept.
    pub fn reset(&self) {
        let mut stream = self.stream.lock();
        stream.pacer = None;
        stream.anchors.clear();
        stream.arriving.clear();
        stream.first = 0;
        stream.anchor_size = None;
        stream.overlay = None;
        stream.epoch += 1;
    }

    /// Returns its statistics.
    pub fn statistics(&self) -> PresenterStatistics {
        let stream = self.stream.lock();
        match stream.followed().map(|governor| governor.statistics()) {
            None => stream.statistics,
            Some(governed) => PresenterStatistics {
                made_to_anchor: governed.generated,
                budget_changes: governed.reductions + governed.increases,
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
    fn brings_all(&self, pictures: usize) -> bool {
        self.options.decoded && pictures > 1 && pictures == self.options.multiplier as usize
    }

    /// Decides what to show for `due` and how to make it.
    fn resolve(&self, stream: &Stream, due: Due, phases: Option<Phases>) -> Option<(FrameInfo, FramePlan)> {
        let anchor = |index: u64| {
            let at = usize::try_from(index.checked_sub(stream.first)?).ok()?;
            stream.anchors.get(at)
        };
        let t = |step: u32| step as f32 / self.options.multiplier as f32;
        let generates = |t: f32| phases.is_some_and(|phases| phases.contains(t));
        let info = |source, previous: u64, current: u64, t, cut| FrameInfo {
            due,
            source,
            previous,
            current,
            t,
            cut,
            repeated: false,
            unprepared: false,
        };
        let id = |index: u64| AnchorId { epoch: stream.epoch, index };
        let copy = |index: u64, picture: usize| {
            let previous = index.checked_sub(1).and_then(anchor).cloned();
            Some(FramePlan::Copy { previous, current: anchor(index)?.clone(), id: id(index), picture })
        };
        let held = |index: u64, cut| {
            let anchor = &anchor(index)?.anchor;
            let number = anchor.number();
            Some((info(FrameSource::Held, number, number, 0.0, cut), copy(index, anchor.count() - 1)?))
        };
        match due.frame {
            // An anchor that replaces a frame left out under the budget.
            DueFrame::Anchor(index) if !due.position.is_multiple_of(self.options.multiplier.into()) => {
                held(index, false)
            }
            DueFrame::Anchor(index) => {
                let (info, plan) = held(index, false)?;
                Some((FrameInfo { source: FrameSource::Anchor, ..info }, plan))
            }
            DueFrame::Interpolate { previous: index, step } => {
                let (previous, current) = (anchor(index)?, anchor(index + 1)?);
                let (t, numbers) = (t(step), (previous.anchor.number(), current.anchor.number()));
                let pictures = current.anchor.count();
                if self.brings_all(pictures) {
                    let plan = copy(index + 1, step as usize - 1)?;
                    return Some((info(FrameSource::Decoded, numbers.0, numbers.1, t, false), plan));
                }
                if current.cut || !generates(t) {
                    return held(if t < 0.5 { index } else { index + 1 }, current.cut);
                }
                let (previous, current) = (previous.clone(), current.clone());
                let plan = FramePlan::Interpolate { previous, current, id: id(index + 1), t };
                Some((info(FrameSource::Generated, numbers.0, numbers.1, t, false), plan))
            }
            DueFrame::Extrapolate { last: index, .. } | DueFrame::Stalled { last: index } => {
                let last = anchor(index)?;
                let previous = index.checked_sub(1).and_then(anchor);
                let motion = last.guidance.is_some() || previous.is_some();
                if !self.options.extrapolate || last.cut || !motion || phases.is_none() {
                    return held(index, last.cut);
                }
                let (step, source) = match due.frame {
                    DueFrame::Extrapolate { step, .. } => (step, FrameSource::Extrapolated),
                    _ => (self.options.multiplier, FrameSource::Held),
                };
                let (t, number) = (t(step), last.anchor.number());
                let (previous, last) = (previous.cloned(), last.clone());
                let plan = FramePlan::Extrapolate { previous, last, id: id(index), t };
                Some((info(source, number, number, t, false), plan))
            }
        }
    }
}

impl Stream {
    /// `(width, height)` of the anchors that were pushed, also where none has arrived.
    fn pushed_size(&self) -> Option<(u32, u32)> {
        self.anchor_size.or_else(|| self.arriving.front().map(|(anchor, _)| anchor.size()))
    }

    /// Moves the anchors that have arrived by now into the stream, in order.
    fn arrive(&mut self, now: u64, multiplier: u32) {
        while self.arriving.front().is_some_and(|(anchor, _)| anchor.is_complete()) {
            let (Some((anchor, guidance)), Some(pacer)) = (self.arriving.pop_front(), &mut self.pacer) else { return };
            let (late, slipped) = (pacer.late(), pacer.slipped_ns());
            pacer.push(now);
            let statistics = &mut self.statistics;
            statistics.anchors += 1;
            statistics.late += pacer.late() - late;
            statistics.slipped_ns = statistics.slipped_ns.saturating_add(pacer.slipped_ns() - slipped);
            self.anchor_size = Some(anchor.size());
            let follows = |last: &StreamAnchor| last.anchor.number().checked_add(1) == Some(anchor.number());
            let cut = anchor.is_cut() || !self.anchors.back().is_some_and(follows);
            // Anchors before the due frame and before the last pair are not needed any more.
            let due = pacer.due(now).map_or(0, |due| due.position / u64::from(multiplier));
            let keep = due.min((pacer.anchors() - 1).saturating_sub(1));
            while self.first < keep && self.anchors.pop_front().is_some() {
                self.first += 1;
            }
            self.anchors.push_back(StreamAnchor { anchor, guidance, cut });
        }
    }
}

/// The frame without extrapolation: the last anchor replaces frames after it.
fn without_extrapolation(frame: DueFrame) -> DueFrame {
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

#[cfg(windows)]
mod device;
mod frame_budget;
#[cfg(test)]
mod tests;
