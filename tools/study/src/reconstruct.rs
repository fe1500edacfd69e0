//! Scores generated frames against the truth: takes a scene's anchors at 15 frames a second, generates and renders the frames between them,
//! and compares the two.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::world::WorldTime;
use cairn::{Error, ErrorKind, Picture, Result};
use scenes::Family;
use serde::{Deserialize, Serialize};

use crate::generator::GeneratorChoice;
use crate::inputs;
use crate::machine::Versions;
use crate::manifest::{Input, MANIFEST_VERSION, Output, read_manifest, sha256, to_json};
use crate::metrics::Net;
use crate::output::reconstruct::{COMPARISON, COMPARISON_VIDEO, RAW, TABLE, VIDEO};
use crate::output::{Folder, MANIFEST, SHEET, sinks};
use crate::progress::Progress;
use crate::sets;
use crate::settings::Formats;
use media::{FileSystem, FrameRate, Mp4Sink, Recorder, RecorderReport, VideoFormat, encode_small_png, write_whole};
pub use scores::Summary;
use stream::Stream;
use walk::Walk;

mod panels;
mod scores;
mod stream;
pub(crate) mod walk;

/// Anchors per second of world time.
pub(crate) const ANCHOR_RATE: u32 = 15;
/// Allowed presented frames per anchor, the anchor included.
const MULTIPLIERS: std::ops::RangeInclusive<u32> = 2..=8;
/// The largest side of rendered scenes.
const MAX_SIDE: u32 = 8192;
/// The smallest side, limited by the video encoder.
const MIN_SIDE: u32 = 16;

/// Job name in the manifest.
pub(crate) const JOB: &str = "reconstruct";

/// Source of motion and depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TruthOrPicture {
    /// The scene's exact motion and depth.
    Truth,
    /// Optical flow between the anchors.
    Picture,
}

/// Settings that affect the bytes of the outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReconstructSettings {
    /// `forest`, `sword`, `desert` or `snow`.
    pub scene: String,
    /// Seed of the scene.
    pub seed: u64,
    /// `[width, height]` of all frames.
    pub size: [u32; 2],
    /// Decimal seconds of world time.
    pub seconds: String,
    /// Frames presented per anchor, 2 to 8.
    pub multiplier: u32,
    /// Source of motion and depth.
    pub guidance: TruthOrPicture,
    /// Media of the presented frames; the comparison is always written.
    pub formats: Formats,
    /// Whether LPIPS is measured as well.
    pub lpips: bool,
    /// Generator of frames between anchors.
    #[serde(default, skip_serializing_if = "GeneratorChoice::is_cpu")]
    pub generator: GeneratorChoice,
}

impl Default for ReconstructSettings {
    /// Two seconds of forest, from 15 to 60 frames a second.
    fn default() -> Self {
        Self {
            scene: "forest".into(),
            seed: 1,
            size: [640, 360],
            seconds: "2".into(),
            multiplier: 4,
            guidance: TruthOrPicture::Picture,
            formats: Formats { mp4: true, ..Formats::default() },
            lpips: false,
            generator: GeneratorChoice::Cpu,
        }
    }
}

/// Parsed settings.
pub(crate) struct ParsedSettings {
    family: Family,
    anchors: u64,
}

impl ReconstructSettings {
    /// Checks the settings; reads no file.
    pub(crate) fn check(&self) -> Result<ParsedSettings> {
        let refused = |cause: String, field: &str, remedy: String| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
        };
        let family = self.scene.parse::<Family>().map_err(|_| {
            Error::new(ErrorKind::InvalidArgument, format!("there is no scene {:?}", self.scene))
                .field("--scene")
                .remedy("Use forest, sword, desert, snow, indoors, town, or all for the landscapes")
        })?;
        let [width, height] = self.size;
        if self.size.iter().any(|side| !(MIN_SIDE..=MAX_SIDE).contains(side)) {
            return refused(
                format!("scenes are not drawn at {width}x{height}"),
                "--size",
                format!("Use a width and a height from {MIN_SIDE} to {MAX_SIDE}, such as 640x360"),
            );
        }
        if !MULTIPLIERS.contains(&self.multiplier) {
            return refused(
                format!("{} frames cannot be made of each anchor", self.multiplier),
                "--multiplier",
                format!("Use {} to {}", MULTIPLIERS.start(), MULTIPLIERS.end()),
            );
        }
        sets::require_unsealed(&[self.seed], "--seed")?;
        self.generator.check_multiplier(self.multiplier)?;
        if self.formats == Formats::default() {
            return refused(
                "nothing would be written".into(),
                "--formats",
                "List one or more of mp4, png and y4m".into(),
            );
        }
        let duration = WorldTime::parse(&self.seconds).map_err(|e| e.field("--seconds"))?;
        let anchors = duration.whole_steps(ANCHOR_RATE) + 1;
        if anchors < 2 {
            return refused(
                format!("in {} s there are no two anchors", self.seconds),
                "--seconds",
                format!("Use at least 0.067, one of {ANCHOR_RATE} anchors a second"),
            );
        }
        let smallest = Net::Alex.smallest_side();
        if self.lpips && self.size.iter().any(|side| *side < smallest) {
            return refused(
                format!("LPIPS cannot be measured at {width}x{height}"),
                "--lpips",
                format!("Use a size of at least {smallest}x{smallest}, or --lpips no"),
            );
        }
        Ok(ParsedSettings { family, anchors })
    }

    /// Frames presented per second.
    pub fn rate(&self) -> u32 {
        ANCHOR_RATE * self.multiplier
    }
}

/// Counters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReconstructCounts {
    /// True frames used as anchors.
    pub anchors: u64,
    /// Frames generated between them.
    pub generated: u64,
    /// Generated frames that show the nearer anchor because of a detected cut.
    pub cut_fallbacks: u64,
    /// Frames presented, anchors and generated.
    pub presented: u64,
    /// Frames that were requested.
    pub planned: u64,
}

/// `manifest.json` of a reconstruct.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReconstructManifest {
    /// [`MANIFEST_VERSION`].
    pub manifest_version: u32,
    /// `reconstruct`, which distinguishes it from a rollout's manifest.
    pub job: String,
    /// Whether the job finished and every file is complete.
    pub complete: bool,
    /// Reason, if the job did not finish.
    pub stopped_by: Option<String>,
    /// Settings of the job.
    pub settings: ReconstructSettings,
    /// The control script of the walk.
    pub script: Input,
    /// Counters.
    pub counts: ReconstructCounts,
    /// Scores of the generated frames; `None` if there are none.
    pub scores: Option<Summary>,
    /// Every file beside this one.
    pub outputs: Vec<Output>,
    /// Software and hardware.
    pub versions: Versions,
    /// Durations in seconds. The only part that depends on a clock.
    pub timings: BTreeMap<String, f64>,
}

impl ReconstructManifest {
    /// Reads `path`.
    ///
    /// # Errors
    /// As [`Manifest::read`](crate::Manifest::read).
    pub fn read(path: &Path) -> Result<Self> {
        read_manifest(path, "a reconstruct", "study reconstruct")
    }
}

/// A reconstruct job.
pub struct Reconstruction<'a> {
    /// What to make.
    pub settings: &'a ReconstructSettings,
    /// The folder for all outputs.
    pub out: &'a Path,
    /// Whether an earlier one in that folder may be replaced.
    pub overwrite: bool,
    /// Where files are created.
    pub disk: Arc<dyn FileSystem>,
    /// Set from any thread to stop after the current anchor.
    pub stop: &'a AtomicBool,
    /// Receives the progress.
    pub progress: &'a Progress,
    /// Stops after this many frames, where an earlier, interrupted job ended.
    pub limit: Option<u64>,
}

/// Result. Every file is complete, and the manifest is written.
#[derive(Debug)]
pub struct ReconstructOutcome {
    /// As written.
    pub manifest: ReconstructManifest,
    /// The error after the first frame, if any.
    pub failure: Option<Error>,
    /// Whether [`Reconstruction::stop`] ended the job.
    pub interrupted: bool,
}

/// The script of a scene, as an input.
pub(crate) fn script_input(scene: &str) -> Option<Input> {
    let family: Family = scene.parse().ok()?;
    let text = family.script();
    Some(Input {
        path: format!("<built-in script of {family}>"),
        size: text.len() as u64,
        sha256: sha256(text.as_bytes()),
    })
}

/// Runs the job.
///
/// # Errors
/// Everything that can fail before the first frame. Later failures are in [`ReconstructOutcome::failure`], and the manifest then says
/// `"complete": false`.
pub fn reconstruct(job: &Reconstruction<'_>) -> Result<ReconstructOutcome> {
    let began = Instant::now();
    let settings = job.settings;
    let ParsedSettings { family, anchors } = settings.check()?;
    let folder = Folder::check(job.out, job.overwrite)?;
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, job.progress)).transpose()?;
    job.progress.phase("building the scene");
    let planned = (anchors - 1) * u64::from(settings.multiplier) + 1;
    let size = settings.size.into();
    let walk = Walk::new(family, settings.seed, size, [ANCHOR_RATE, settings.multiplier], planned)?;

    folder.prepare(settings.formats.png)?;
    let mut manifest = first_manifest(settings, planned)?;
    write_manifest(job, &folder, &manifest)?;
    let format = VideoFormat::new(size, FrameRate::new(settings.rate().into(), 1)?);
    let recorder = Recorder::start(sinks(&job.disk, &folder, settings.formats, [VIDEO, RAW], &format, 0)?, size)?;
    let mut stream = Stream::new(settings, walk, lpips)?;
    let wide = VideoFormat { size: stream.comparison_size(), ..format };
    let comparison: Box<dyn media::Sink> =
        Box::new(Mp4Sink::create(job.disk.as_ref(), &folder.join(COMPARISON_VIDEO), &wide, 0)?);
    let comparison = Recorder::start(vec![comparison], wide.size)?;
    let loading = began.elapsed();

    let limit = job.limit.unwrap_or(planned).min(planned);
    job.progress.begin(limit);
    let run = stream.run(limit, &recorder, &comparison, job.stop, |done| job.progress.frames(done));
    job.progress.end();
    let (recorded, compared) = (recorder.finish()?, comparison.finish()?);
    let interrupted = run.as_ref().is_ok_and(|done| !done) && job.stop.load(Ordering::Relaxed);
    let mut failure = recorded.failure.clone().or(compared.failure.clone()).or(run.err());

    manifest.counts = ReconstructCounts { presented: recorded.frames, planned, ..stream.counts };
    manifest.scores = stream.scores.summary();
    let (outputs, trouble) = describe(job, &folder, &mut stream, &recorded, &compared, &manifest, failure.is_some());
    manifest.outputs = outputs;
    failure = failure.or(trouble);
    manifest.complete = failure.is_none() && !interrupted && manifest.counts.presented == planned;
    manifest.stopped_by = match (&failure, interrupted) {
        (Some(error), _) => Some(error.to_string()),
        (None, true) => Some("interrupted".into()),
        (None, false) if manifest.complete => None,
        (None, false) => Some("the limit of the replayed reconstruct".into()),
    };
    let stages = stream.times.iter().map(|(name, time)| (*name, *time));
    let encoding = recorded.busy + compared.busy;
    let all = stages.chain([("loading", loading), ("encoding", encoding), ("total", began.elapsed())]);
    manifest.timings = all.map(|(name, time)| (name.to_owned(), seconds(time))).collect();
    if let Err(error) = write_manifest(job, &folder, &manifest) {
        failure = failure.or(Some(error));
    }
    Ok(ReconstructOutcome { manifest, failure, interrupted })
}

/// Seconds, rounded to microseconds.
fn seconds(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e6).round() / 1e6
}

fn first_manifest(settings: &ReconstructSettings, planned: u64) -> Result<ReconstructManifest> {
    let script = script_input(&settings.scene)
        .ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "there is no such scene").field("--scene"))?;
    Ok(ReconstructManifest {
        manifest_version: MANIFEST_VERSION,
        job: JOB.into(),
        complete: false,
        stopped_by: Some("the program is still running, or ended without a word".into()),
        settings: settings.clone(),
        script,
        counts: ReconstructCounts { planned, ..ReconstructCounts::default() },
        scores: None,
        outputs: Vec::new(),
        versions: Versions::without_world(settings.generator),
        timings: BTreeMap::new(),
    })
}

fn write_manifest(job: &Reconstruction<'_>, folder: &Folder, manifest: &ReconstructManifest) -> Result<()> {
    write_whole(job.disk.as_ref(), &folder.join(MANIFEST), &to_json(manifest)?)
}

/// Draws and writes the final pictures, and describes every finished file. An error costs only its own entry. After a failed job no file counts
/// as complete, because its end is arbitrary.
fn describe(
    job: &Reconstruction<'_>,
    folder: &Folder,
    stream: &mut Stream,
    recorded: &RecorderReport,
    compared: &RecorderReport,
    manifest: &ReconstructManifest,
    failed: bool,
) -> (Vec<Output>, Option<Error>) {
    let ReconstructManifest { counts, settings, .. } = manifest;
    let disk = job.disk.as_ref();
    let mut described: Vec<Result<Output>> = Vec::new();
    for (written, kind) in
        recorded.written.iter().map(|w| (w, w.kind)).chain(compared.written.iter().map(|w| (w, "comparison-video")))
    {
        let whole = kind == "png" || (!failed && written.frames == counts.presented);
        described.push(folder.describe(&written.path, kind, written.frames, whole));
    }
    let mut add = |name: &str, kind: &str, frames: u64, bytes: Result<Option<Vec<u8>>>| {
        let path = folder.join(name);
        match bytes {
            Ok(Some(bytes)) => described
                .push(write_whole(disk, &path, &bytes).and_then(|()| folder.describe(&path, kind, frames, !failed))),
            Ok(None) => {}
            Err(error) => described.push(Err(error)),
        }
    };
    let png = |picture: Picture| encode_small_png(&picture).map(Some);
    let title = format!("{}, seed {}, {} s", settings.scene, settings.seed, settings.seconds);
    let how = match settings.guidance {
        TruthOrPicture::Truth => "true motion and depth",
        TruthOrPicture::Picture => "motion from the pictures",
    };
    let [width, height] = settings.size;
    let subtitle = format!("{ANCHOR_RATE} anchors a second, {} frames, {how}, {width} x {height}", settings.rate());
    add(TABLE, "scores", counts.presented, Ok(Some(stream.scores.csv(settings.multiplier, settings.rate()).into())));
    add(SHEET, "contact-sheet", 1, stream.sheet.draw(&title, &subtitle, None).and_then(png));
    add(
        COMPARISON,
        "comparison",
        1,
        stream.compare(&format!("{title}: {subtitle}")).and_then(|p| p.map_or(Ok(None), png)),
    );
    let mut failure = None;
    let mut outputs = Vec::new();
    for result in described {
        match result {
            Ok(output) => outputs.push(output),
            Err(error) => failure = failure.or(Some(error)),
        }
    }
    (outputs, failure)
}
