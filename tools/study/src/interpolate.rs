//! Raises the frame rate of a video: optical flow between consecutive frames, and generated frames at phases between them.
//!
//! ```text
//! source (reads, decodes) -> flow (motion) -> generator -> recorder (encodes, writes)
//! ```
//!
//! Each of the four stages has its own thread and waits for the next one, so only a few frames are in memory for a video of any length.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Result};

use crate::generator::GeneratorChoice;
use crate::progress::Progress;
use media::{FileSystem, FrameRate, Recorder, VideoFormat, WrittenFile};
use pipeline::{Counts, Stages, Steps};
use source::Input;
use target::Target;

mod ffmpeg;
mod folder;
mod pipeline;
mod source;
mod target;

/// Frame rate of a folder of pictures, which has none itself.
pub const FOLDER_RATE: u32 = 30;
/// Maximum number of frames made from one.
pub const MAX_MULTIPLIER: u32 = 16;

/// An interpolation job.
pub struct Interpolation<'a> {
    /// A Y4M file, a folder of PNG or JPEG pictures, or a video that an ffmpeg on the path (or the one that
    /// `CAIRN_FFMPEG` names) can read.
    pub input: &'a Path,
    /// Output frames per input frame, 2 to [`MAX_MULTIPLIER`].
    pub multiplier: u32,
    /// Input frames per second, overriding the input's own rate.
    pub rate: Option<FrameRate>,
    /// Generator of the frames between.
    pub generator: GeneratorChoice,
    /// `.mp4`, `.y4m`, or a folder for PNG pictures; `None` for an MP4 beside the input.
    pub out: Option<&'a Path>,
    /// Whether an earlier output may be replaced.
    pub overwrite: bool,
    /// Where files are created.
    pub disk: Arc<dyn FileSystem>,
    /// Set from any thread to stop after the current frame.
    pub stop: &'a AtomicBool,
    /// Receives the progress.
    pub progress: &'a Progress,
}

/// Result. The written files are complete and playable, also after a failure.
#[derive(Debug)]
pub struct Report {
    /// `(width, height)` of every frame.
    pub size: (u32, u32),
    /// Frame rate of the input.
    pub rate: FrameRate,
    /// Frame rate of the output: exactly the multiple.
    pub new_rate: FrameRate,
    /// Frames that were read.
    pub frames_in: u64,
    /// Frames that were written.
    pub frames_out: u64,
    /// Frames generated between two input frames.
    pub generated: u64,
    /// Pairs with a cut between them; they get no generated frames, but the nearer frame.
    pub cuts: u64,
    /// Pairs of equal frames; the same frame is repeated between them.
    pub repeats: u64,
    /// The output file, or the folder of pictures.
    pub out: PathBuf,
    /// Whether the output has any content.
    pub has_output: bool,
    /// Notes for the user, e.g. that the sound is left out.
    pub notes: Vec<String>,
    /// Working time of each stage; stages run in parallel.
    pub stages: Vec<(&'static str, Duration)>,
    /// Wall time.
    pub total: Duration,
    /// The error that ended the job early.
    pub failure: Option<Error>,
    /// Whether [`Interpolation::stop`] ended the job.
    pub interrupted: bool,
}

/// Runs the job.
///
/// # Errors
/// Everything that can fail before the first frame is written: `InvalidArgument` for an input of fewer than two frames, or of two sizes;
/// `Unsupported` for video that cannot be read; `Io`. Later failures are in [`Report::failure`].
pub fn interpolate(job: &Interpolation<'_>) -> Result<Report> {
    let began = Instant::now();
    check(job.multiplier, job.rate, job.out)?;
    job.generator.check_multiplier(job.multiplier)?;
    job.progress.phase("reading the input");
    let Input { size, rate, pixel_aspect, expected, notes, source, stopper } = source::open(job.input)?;
    let (rate, notes) = settled_rate(job, rate, notes)?;
    let new_rate = rate.times(job.multiplier).map_err(|e| e.field("--multiplier"))?;
    let target = Target::choose(job.input, job.out, job.multiplier)?;
    target.check(job.input, job.overwrite)?;

    let format = VideoFormat { pixel_aspect, ..VideoFormat::new(size, new_rate) };
    let generator = job.generator.make(None, rate.interval_ms())?;
    let mut steps = Steps::start(source, stopper, size)?;
    // No output is created before the first two frames are read.
    let start = steps.first_pair(job.stop).map_err(|e| named(e, job.input))?;
    let recorder = Recorder::start(vec![target.create(&job.disk, &format)?], size)?;
    job.progress.begin(expected.map(|frames| frames * u64::from(job.multiplier)));
    let run = steps.run(start, (generator, job.multiplier), &recorder, job.stop, |done| job.progress.frames(done));
    job.progress.end();
    let (reading, flow) = steps.finish();
    let recorded = recorder.finish()?;

    let interrupted = job.stop.load(Ordering::Relaxed);
    let Counts { frames_in, generated, cuts, repeats } = run.counts;
    let Stages { generation } = run.stages;
    Ok(Report {
        size,
        rate,
        new_rate,
        frames_in,
        frames_out: recorded.frames,
        generated,
        cuts,
        repeats,
        has_output: recorded.written.iter().map(|WrittenFile { frames, .. }| frames).sum::<u64>() > 0,
        out: target.path().to_owned(),
        notes,
        stages: vec![("reading", reading), ("motion", flow), ("generation", generation), ("encoding", recorded.busy)],
        total: began.elapsed(),
        // The recorder's error takes precedence, because it causes the others.
        failure: recorded.failure.or(run.failure.filter(|_| !interrupted)),
        interrupted,
    })
}

/// Checks the options; reads no file.
pub(crate) fn check(multiplier: u32, rate: Option<FrameRate>, out: Option<&Path>) -> Result<()> {
    if !(2..=MAX_MULTIPLIER).contains(&multiplier) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("{multiplier} frames cannot be made of each"))
            .field("--multiplier")
            .remedy(format!("Use 2 to {MAX_MULTIPLIER}")));
    }
    if let Some(rate) = rate {
        rate.times(multiplier).map_err(|e| e.field("--rate"))?;
    }
    if let Some(out) = out {
        Target::of(out)?;
    }
    Ok(())
}

fn settled_rate(
    job: &Interpolation<'_>,
    said: Option<FrameRate>,
    mut notes: Vec<String>,
) -> Result<(FrameRate, Vec<String>)> {
    if let Some(rate) = job.rate.or(said) {
        return Ok((rate, notes));
    }
    if !job.input.is_dir() {
        return Err(Error::new(ErrorKind::InvalidArgument, "it does not say its frame rate")
            .field(job.input.display().to_string())
            .remedy("Say it with --rate, such as --rate 30"));
    }
    notes.push(format!("pictures have no frame rate: {FOLDER_RATE} a second are assumed; --rate says another"));
    Ok((FrameRate::new(FOLDER_RATE.into(), 1)?, notes))
}

/// Adds the input's name to an error that names no file.
fn named(error: Error, input: &Path) -> Error {
    if error.offending_field().is_some() { error } else { error.field(input.display().to_string()) }
}
