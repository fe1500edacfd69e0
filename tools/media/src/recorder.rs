//! Encodes and writes frames on a thread of its own while the next ones are being made.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Picture, Result};

use super::Yuv420;

/// Capacity of the queue; a further frame waits in [`Recorder::push`]. Bounds the memory.
const QUEUE: usize = 3;

/// One presented frame.
pub struct Frame<'a> {
    /// Counts from 0.
    pub number: u64,
    /// The picture.
    pub picture: &'a Picture,
    /// The same as video planes; only valid if a sink [wants](Sink::wants_planes) them.
    pub planes: &'a Yuv420,
}

/// A finished file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenFile {
    /// Its path.
    pub path: PathBuf,
    /// `mp4`, `png` or `y4m`.
    pub kind: &'static str,
    /// Frames in it.
    pub frames: u64,
}

/// Stores frames.
pub trait Sink: Send {
    /// `mp4`, `png` or `y4m`.
    fn kind(&self) -> &'static str;

    /// Whether [`Frame::planes`] must be filled.
    fn wants_planes(&self) -> bool;

    /// Stores one frame.
    ///
    /// # Errors
    /// `Io` and errors of the encoder. Everything before this frame stays.
    fn write(&mut self, frame: &Frame<'_>) -> Result<()>;

    /// Closes the files and returns those that exist. After a failed write (`failed`) it keeps what is complete. The error, if any, says why
    /// something is missing.
    fn finish(self: Box<Self>, failed: bool) -> (Vec<WrittenFile>, Option<Error>);
}

/// Result of a recorder.
#[derive(Debug)]
pub struct RecorderReport {
    /// Every finished file.
    pub written: Vec<WrittenFile>,
    /// Frames that all sinks stored.
    pub frames: u64,
    /// The error that stopped it.
    pub failure: Option<Error>,
    /// Working time of the recorder's thread, without waiting.
    pub busy: Duration,
}

/// Passes frames to sinks on a thread of its own.
pub struct Recorder {
    queue: Option<SyncSender<Picture>>,
    spent: Receiver<Picture>,
    thread: JoinHandle<RecorderReport>,
}

impl Recorder {
    /// Starts the thread. Every frame must be of `size`.
    ///
    /// # Errors
    /// `OutOfMemory` when the frame buffers do not fit.
    pub fn start(sinks: Vec<Box<dyn Sink>>, size: (u32, u32)) -> Result<Self> {
        let planes = Yuv420::new(size.0, size.1)?;
        let (queue, frames) = sync_channel(QUEUE);
        let (give_back, spent) = sync_channel(QUEUE + 2);
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || record(sinks, planes, &frames, &give_back))
            .map_err(|e| Error::new(ErrorKind::OutOfMemory, format!("no thread for the recorder: {e}")))?;
        Ok(Self { queue: Some(queue), spent, thread })
    }

    /// A used picture for reuse, if there is one.
    pub fn recycled(&self) -> Option<Picture> {
        self.spent.try_recv().ok()
    }

    /// Passes one frame on; waits while the queue is full. `false`: the recorder has stopped, and [`finish`](Self::finish) returns the
    /// reason.
    pub fn push(&self, picture: Picture) -> bool {
        self.queue.as_ref().is_some_and(|queue| queue.send(picture).is_ok())
    }

    /// Waits for the queued frames and closes all files.
    ///
    /// # Errors
    /// `Device` when the thread itself failed. The error of a file is in [`RecorderReport::failure`].
    pub fn finish(mut self) -> Result<RecorderReport> {
        drop(self.queue.take());
        self.thread.join().map_err(|_| Error::new(ErrorKind::Device, "the video encoder stopped unexpectedly"))
    }
}

fn record(
    mut sinks: Vec<Box<dyn Sink>>,
    mut planes: Yuv420,
    queue: &Receiver<Picture>,
    give_back: &SyncSender<Picture>,
) -> RecorderReport {
    let wants_planes = sinks.iter().any(|s| s.wants_planes());
    let mut failed = vec![false; sinks.len()];
    let mut failure = None;
    let mut frames = 0;
    let mut busy = Duration::ZERO;
    while let Ok(picture) = queue.recv() {
        let start = Instant::now();
        if wants_planes && let Err(error) = planes.convert(&picture) {
            failure = Some(error);
            break;
        }
        let frame = Frame { number: frames, picture: &picture, planes: &planes };
        for (sink, failed) in sinks.iter_mut().zip(&mut failed) {
            if let Err(error) = sink.write(&frame) {
                *failed = true;
                failure = failure.or(Some(error));
            }
        }
        busy += start.elapsed();
        if failure.is_some() {
            break;
        }
        frames += 1;
        // If the channel is full or closed, the picture is dropped.
        let _ = give_back.try_send(picture);
    }
    let start = Instant::now();
    let mut written = Vec::new();
    for (sink, failed) in sinks.into_iter().zip(failed) {
        let (files, error) = sink.finish(failed);
        written.extend(files);
        failure = failure.or(error);
    }
    busy += start.elapsed();
    RecorderReport { written, frames, failure, busy }
}
