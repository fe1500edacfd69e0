//! The threads, and the data passed between them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, picture_flow};
use cairn::{Error, ErrorKind, Picture, Result};

use super::ffmpeg::Stopper;
use super::source::Source;
use media::Recorder;

/// Capacity of a channel between two threads. Bounds the memory.
const QUEUE: usize = 1;
/// Interval at which a wait for the next step checks `stop`.
const PATIENCE: Duration = Duration::from_millis(100);

/// An input frame, and its relation to the previous one.
struct Step {
    frame: Arc<Picture>,
    link: Link,
}

enum Link {
    /// The first frame.
    First,
    /// Equal to the previous frame.
    Same,
    /// Moved; with the motion.
    Moved(Guidance),
}

/// Frame counters.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub(super) frames_in: u64,
    pub(super) generated: u64,
    pub(super) cuts: u64,
    pub(super) repeats: u64,
}

/// Working times.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stages {
    pub(super) generation: Duration,
}

/// Result of the frame loop.
pub(super) struct Run {
    pub(super) counts: Counts,
    pub(super) stages: Stages,
    pub(super) failure: Option<Error>,
}

/// The first two frames.
pub(super) struct FirstPair(Step, Step);

/// The threads that read and that find motion, and their output channel.
pub(super) struct Steps {
    steps: Option<Receiver<Result<Step>>>,
    /// Returns used frames and guidance for reuse.
    spent_frames: SyncSender<Picture>,
    spent_guidance: SyncSender<Guidance>,
    reading: JoinHandle<Duration>,
    flow: JoinHandle<Duration>,
    stopper: Option<Stopper>,
}

impl Steps {
    /// Starts both threads.
    pub(super) fn start(source: Box<dyn Source>, stopper: Option<Stopper>, size: (u32, u32)) -> Result<Self> {
        let no_thread = |e| Error::new(ErrorKind::OutOfMemory, format!("no thread can be started: {e}"));
        let (frames_in, frames) = sync_channel(QUEUE);
        let (steps_in, steps) = sync_channel(QUEUE);
        let (spent_frames, old_frames) = sync_channel(2 * QUEUE + 2);
        let (spent_guidance, old_guidance) = sync_channel(QUEUE + 2);
        let reading = std::thread::Builder::new()
            .name("reader".into())
            .spawn(move || read(source, size, &frames_in, &old_frames))
            .map_err(no_thread)?;
        let flow = std::thread::Builder::new()
            .name("motion".into())
            .spawn(move || find_motion(size, &frames, &steps_in, &old_guidance))
            .map_err(no_thread)?;
        Ok(Self { steps: Some(steps), spent_frames, spent_guidance, reading, flow, stopper })
    }

    /// The next step; `None` at the end of the input, or if `stop` was set during the wait.
    fn next(&self, stop: &AtomicBool) -> Result<Option<Step>> {
        let Some(steps) = &self.steps else { return Ok(None) };
        while !stop.load(Ordering::Relaxed) {
            match steps.recv_timeout(PATIENCE) {
                Ok(step) => return step.map(Some),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(None)
    }

    /// Waits for the first two frames.
    pub(super) fn first_pair(&self, stop: &AtomicBool) -> Result<FirstPair> {
        let too_few = |what: &str| {
            if stop.load(Ordering::Relaxed) {
                return Error::new(ErrorKind::Cancelled, "it was interrupted before anything was made");
            }
            Error::new(ErrorKind::InvalidArgument, what).remedy("Give at least two frames")
        };
        let first = self.next(stop)?.ok_or_else(|| too_few("it holds no frame"))?;
        let second = self.next(stop)?.ok_or_else(|| too_few("it holds one frame, and nothing lies between"))?;
        Ok(FirstPair(first, second))
    }

    /// Generates between all frames and hands everything to the recorder, including the input's frames, until the input ends. The last frame is
    /// shown for one more interval, so that the video keeps its length. Calls `progress` with the number of frames done.
    pub(super) fn run(
        &mut self,
        FirstPair(first, second): FirstPair,
        (generator, multiplier): (Box<dyn FrameGenerator>, u32),
        recorder: &Recorder,
        stop: &AtomicBool,
        mut progress: impl FnMut(u64),
    ) -> Run {
        let mut writer = Writer { recorder, multiplier, generator, run: Run::new(), written: 0 };
        let mut previous = first.frame;
        let mut on = writer.frame(&previous);
        writer.run.counts.frames_in = 1;
        let mut next = Some(second);
        while on && !stop.load(Ordering::Relaxed) {
            let step = match next.take().map_or_else(|| self.next(stop), |step| Ok(Some(step))) {
                Ok(Some(step)) => step,
                Ok(None) => break,
                Err(error) => {
                    writer.run.failure = Some(error);
                    break;
                }
            };
            writer.run.counts.frames_in += 1;
            on = writer.between(&previous, &step, &mut progress) && writer.frame(&step.frame);
            progress(writer.written);
            if let Link::Moved(guidance) = step.link {
                // If the channel is full, the guidance is dropped.
                let _ = self.spent_guidance.try_send(guidance);
            }
            if let Ok(frame) = Arc::try_unwrap(std::mem::replace(&mut previous, step.frame)) {
                let _ = self.spent_frames.try_send(frame);
            }
        }
        for _ in 1..multiplier {
            on = on && !stop.load(Ordering::Relaxed) && writer.frame(&previous);
        }
        progress(writer.written);
        writer.run
    }

    /// Stops both threads and returns their working times.
    pub(super) fn finish(mut self) -> (Duration, Duration) {
        drop(self.steps.take());
        if let Some(stopper) = &self.stopper {
            stopper.stop();
        }
        (self.reading.join().unwrap_or_default(), self.flow.join().unwrap_or_default())
    }
}

impl Run {
    fn new() -> Self {
        Self { counts: Counts::default(), stages: Stages::default(), failure: None }
    }
}

/// Generates frames and passes them to the recorder.
struct Writer<'a> {
    recorder: &'a Recorder,
    multiplier: u32,
    generator: Box<dyn FrameGenerator>,
    run: Run,
    written: u64,
}

impl Writer<'_> {
    /// Makes all frames between two input frames; `false` if the job must stop.
    fn between(&mut self, previous: &Picture, step: &Step, progress: &mut impl FnMut(u64)) -> bool {
        let mut is_cut = false;
        for part in 1..self.multiplier {
            let done = match &step.link {
                Link::Moved(guidance) => self.generate(previous, &step.frame, guidance, part, &mut is_cut),
                Link::First | Link::Same => Ok(self.frame(previous)),
            };
            match done {
                Ok(true) => progress(self.written),
                Ok(false) => return false,
                Err(error) => {
                    self.run.failure = Some(error);
                    return false;
                }
            }
        }
        self.run.counts.cuts += u64::from(is_cut);
        self.run.counts.repeats += u64::from(matches!(step.link, Link::Same));
        true
    }

    fn generate(
        &mut self,
        previous: &Picture,
        current: &Picture,
        guidance: &Guidance,
        part: u32,
        is_cut: &mut bool,
    ) -> Result<bool> {
        let start = Instant::now();
        let mut out = self.empty(current.size())?;
        // A cut that was detected once is not searched for again.
        let pair = AnchorPair::new(previous, current, guidance)?.with_cut(*is_cut);
        let report = self.generator.generate(&pair, part as f32 / self.multiplier as f32, &mut out)?;
        self.run.stages.generation += start.elapsed();
        *is_cut |= report.outcome == Outcome::CutFallback;
        self.run.counts.generated += u64::from(report.outcome == Outcome::Generated);
        Ok(self.push(out))
    }

    /// Passes on an input frame unchanged.
    fn frame(&mut self, frame: &Picture) -> bool {
        match self.empty(frame.size()) {
            Ok(mut out) => {
                out.rgba_mut().copy_from_slice(frame.rgba());
                self.push(out)
            }
            Err(error) => {
                self.run.failure = Some(error);
                false
            }
        }
    }

    fn empty(&self, size: (u32, u32)) -> Result<Picture> {
        self.recorder.recycled().map_or_else(|| Picture::new(size.0, size.1), Ok)
    }

    fn push(&mut self, frame: Picture) -> bool {
        let taken = self.recorder.push(frame);
        self.written += u64::from(taken);
        taken
    }
}

/// Body of the reading thread.
fn read(
    mut source: Box<dyn Source>,
    size: (u32, u32),
    frames: &SyncSender<Result<Picture>>,
    spent: &Receiver<Picture>,
) -> Duration {
    let mut busy = Duration::ZERO;
    loop {
        let start = Instant::now();
        let frame = spent.try_recv().or_else(|_| Picture::new(size.0, size.1)).and_then(|mut frame| {
            let there = source.read(&mut frame)?;
            Ok(there.then_some(frame))
        });
        busy += start.elapsed();
        let (frame, last) = match frame {
            Ok(Some(frame)) => (Ok(frame), false),
            Ok(None) => return busy,
            Err(error) => (Err(error), true),
        };
        if frames.send(frame).is_err() || last {
            return busy;
        }
    }
}

/// Body of the thread that finds motion.
fn find_motion(
    size: (u32, u32),
    frames: &Receiver<Result<Picture>>,
    steps: &SyncSender<Result<Step>>,
    spent: &Receiver<Guidance>,
) -> Duration {
    let mut busy = Duration::ZERO;
    let mut extractor = picture_flow::Extractor::new();
    let mut previous: Option<Arc<Picture>> = None;
    while let Ok(frame) = frames.recv() {
        let start = Instant::now();
        let step = frame.and_then(|frame| {
            let link = match &previous {
                None => Link::First,
                Some(previous) if previous.rgba() == frame.rgba() => Link::Same,
                Some(previous) => {
                    let guidance =
                        spent.try_recv().or_else(|_| Guidance::new(size.0, size.1, picture_flow::PROJECTION));
                    let mut guidance = guidance?;
                    extractor.extract(previous, &frame, &mut guidance)?;
                    Link::Moved(guidance)
                }
            };
            let frame = Arc::new(frame);
            previous = Some(Arc::clone(&frame));
            Ok(Step { frame, link })
        });
        busy += start.elapsed();
        let last = step.is_err();
        if steps.send(step).is_err() || last {
            break;
        }
    }
    busy
}
