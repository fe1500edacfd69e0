//! The main job from end to end.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::runtime::Device;
use cairn::world::{Preset, Rollout, WorldOptions};
use cairn::{Error, ErrorKind, Result};

use crate::device::{self, DeviceChoice};
use crate::inputs::{self, LoadedInputs};
use crate::latents::LatentFile;
use crate::machine::{self, Versions};
use crate::manifest::{Counts, MANIFEST_VERSION, Manifest, Output, absolute, to_json};
use crate::output::{Folder, LATENTS, MANIFEST, RAW, SHEET, VIDEO, sinks};
use crate::progress::Progress;
use crate::settings::{ParsedSettings, Settings};
use crate::sheet::Sheet;
use media::{FileSystem, FrameRate, Recorder, VideoFormat, encode_small_png, write_whole};
use stream::{End, Makers, Stream};

mod stream;

/// A rollout job.
pub struct Job<'a> {
    /// What to make.
    pub settings: &'a Settings,
    /// The folder for all outputs.
    pub out: &'a Path,
    /// Whether an earlier rollout in that folder may be replaced.
    pub overwrite: bool,
    /// Where files are created.
    pub disk: Arc<dyn FileSystem>,
    /// Set from any thread to stop after the current frame.
    pub stop: &'a AtomicBool,
    /// Receives the progress.
    pub progress: &'a Progress,
    /// Stops after this many latents and presented frames, where an earlier, interrupted rollout ended.
    pub limit: Option<Counts>,
}

/// Result. Every file is complete, and the manifest is written.
#[derive(Debug)]
pub struct JobOutcome {
    /// As written.
    pub manifest: Manifest,
    /// The error after the first frame, if any.
    pub failure: Option<Error>,
    /// Whether [`Job::stop`] ended the job.
    pub interrupted: bool,
    /// Why [`DeviceChoice::Auto`] did not take the devices before the one that it took, if it did not.
    pub fallback: Option<Error>,
}

/// Makes a rollout.
///
/// # Errors
/// Everything that can fail before the first frame. Later failures are in [`JobOutcome::failure`], and the manifest then has
/// `"complete": false`.
pub fn run(job: &Job<'_>) -> Result<JobOutcome> {
    let began = Instant::now();
    let checked = job.settings.check()?;
    let folder = Folder::check(job.out, job.overwrite)?;
    let loaded = inputs::load(job.settings, job.progress)?;
    checked.point.check_for(loaded.bundle.geometry())?;
    job.progress.phase("loading the world");
    let shape = loaded.bundle.geometry().latent;
    let shape = [shape.channels, shape.height, shape.width];
    let counts = checked.point.counts(checked.duration);
    if let Some(latents) = &loaded.latents {
        latents.check_for(shape, counts.latents)?;
    }
    let options = WorldOptions::for_point(&checked.point);
    let Settings { device, threads, .. } = *job.settings;
    let device::LoadedWorld { world, choice, fallback } =
        device::load(device, &loaded.ort, threads, &loaded.bundle, &options)?;
    // With a graphics device, all CPU threads are free for the video encoder.
    let threads = match choice {
        DeviceChoice::Cpu => world.device().threads(),
        _ => threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)),
    };
    let rollout = Rollout::new(&world, &checked.point, job.settings.seed)?;
    let size = job.settings.size.into();
    // Before the folder is prepared: if this fails, an earlier rollout stays.
    let makers = Makers::new(&checked, &world, size)?;
    let loading = began.elapsed();

    folder.prepare(job.settings.formats.png)?;
    let settings = Settings { device: choice, threads: Some(threads), ..job.settings.clone() };
    let mut manifest = first_manifest(settings, &loaded, world.device(), &checked)?;
    write_manifest(job, &folder, &manifest)?;
    let rate = FrameRate::new(checked.point.presented_rate().into(), 1)?;
    let format = VideoFormat::new(size, rate);
    let sinks = sinks(&job.disk, &folder, job.settings.formats, [VIDEO, RAW], &format, threads)?;
    let recorder = Recorder::start(sinks, size)?;
    let latents = LatentFile::create(job.disk.as_ref(), &folder.join(LATENTS), shape)?;

    let sheet = Sheet::new(world.render_size(), "latent");
    let mut stream = Stream::new(&checked, rollout, makers, size, recorder, latents, sheet)?;
    job.progress.begin(job.limit.map_or(counts.presented, |l| l.presented));
    let end = stream.run(job, &loaded);
    job.progress.end();

    let mut finished = stream.finish();
    // Some libraries are loaded only at the first frame.
    manifest.versions.libraries = machine::libraries();
    let mut failure = finished.failure.take();
    let interrupted = matches!(end, Ok(End::Stopped));
    // The recorder's error is the cause; the loop only noticed that it stopped.
    failure = failure.or(end.err());

    manifest.counts = Counts { planned: counts.presented, ..finished.counts };
    let (outputs, trouble) = describe(job, &folder, &finished, &manifest, &title(&manifest, &loaded));
    manifest.outputs = outputs;
    failure = failure.or(trouble);
    manifest.complete = failure.is_none() && !interrupted && manifest.counts.presented == manifest.counts.planned;
    manifest.stopped_by = match (&failure, interrupted) {
        (Some(error), _) => Some(error.to_string()),
        (None, true) => Some("interrupted".into()),
        (None, false) if manifest.complete => None,
        (None, false) => Some("the limit of the replayed rollout".into()),
    };
    manifest.timings = timings(loading, began.elapsed(), finished.times);
    if let Err(error) = write_manifest(job, &folder, &manifest) {
        failure = failure.or(Some(error));
    }
    Ok(JobOutcome { manifest, failure, interrupted, fallback })
}

/// The manifest before the first frame, so that an interrupted run leaves one.
fn first_manifest(
    mut settings: Settings,
    loaded: &LoadedInputs,
    device: &Device,
    checked: &ParsedSettings,
) -> Result<Manifest> {
    let Settings { world, seed_picture, script, latents, .. } = &mut settings;
    for path in [world, seed_picture, script, latents].into_iter().flatten() {
        *path = absolute(path);
    }
    // A preset's name is kept only if all its values are unchanged.
    let named = settings.preset.as_deref().and_then(Preset::from_name);
    settings.preset = named.filter(|p| p.operating_point() == checked.point).map(|p| p.name().into());
    let weights = loaded.bundle.manifest().provenance.get("weights");
    let note = weights
        .filter(|w| w.starts_with("random"))
        .map(|_| "This world has random weights: its pictures mean nothing until trained weights land.".to_owned());
    Ok(Manifest {
        manifest_version: MANIFEST_VERSION,
        complete: false,
        stopped_by: Some("the program is still running, or ended without a word".into()),
        note,
        settings,
        inputs: loaded.inputs.clone(),
        counts: Counts { planned: checked.point.counts(checked.duration).presented, ..Counts::default() },
        outputs: Vec::new(),
        versions: Versions {
            onnxruntime: Some(loaded.ort.version().into()),
            device: Some(device.describe()),
            threads: Some(device.threads()),
            adapter: machine::adapter(device, checked.generator),
            ..Versions::without_world(checked.generator)
        },
        timings: BTreeMap::new(),
    })
}

fn write_manifest(job: &Job<'_>, folder: &Folder, manifest: &Manifest) -> Result<()> {
    write_whole(job.disk.as_ref(), &folder.join(MANIFEST), &to_json(manifest)?)
}

fn title(manifest: &Manifest, loaded: &LoadedInputs) -> String {
    let how = manifest.settings.preset.as_deref().unwrap_or("own operating point");
    format!("{}, {how}, {} s", loaded.bundle.manifest().name, manifest.settings.seconds)
}

fn subtitle(manifest: &Manifest) -> String {
    let Settings { operating_point, seed, .. } = &manifest.settings;
    let Counts { latents, presented, generated, .. } = manifest.counts;
    let [width, height] = manifest.settings.size;
    format!(
        "{operating_point}   seed {seed}   {latents} latents   {presented} frames, {generated} of them generated   \
         {width} x {height}"
    )
}

/// Makes the contact sheet and describes every finished file. An error costs only its own entry.
fn describe(
    job: &Job<'_>,
    folder: &Folder,
    finished: &stream::StreamReport,
    manifest: &Manifest,
    title: &str,
) -> (Vec<Output>, Option<Error>) {
    let counts = manifest.counts;
    let mut described: Vec<Result<Output>> =
        finished.written.iter().map(|written| folder.describe_media(written, counts.presented)).collect();
    if let Some((path, count)) = &finished.latents {
        described.push(folder.describe(path, "latents", *count, *count == counts.latents));
    }
    let path = folder.join(SHEET);
    let sheet = finished.sheet.draw(title, &subtitle(manifest), manifest.note.as_deref());
    let sheet = sheet.and_then(|picture| encode_small_png(&picture));
    let sheet = sheet.and_then(|bytes| write_whole(job.disk.as_ref(), &path, &bytes));
    described.push(sheet.and_then(|()| folder.describe(&path, "contact-sheet", 1, true)));
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

/// Seconds by stage. `total` is wall time; the recorder runs in parallel to the other stages.
fn timings(loading: Duration, total: Duration, stages: BTreeMap<&'static str, Duration>) -> BTreeMap<String, f64> {
    let all = stages.into_iter().chain([("loading", loading), ("total", total)]);
    all.map(|(name, time)| (name.to_owned(), (time.as_secs_f64() * 1e6).round() / 1e6)).collect()
}

/// Whether `stop` was set.
fn stopped(job: &Job<'_>) -> bool {
    job.stop.load(Ordering::Relaxed)
}

/// Error for an internal inconsistency.
fn impossible(what: &str) -> Error {
    Error::new(ErrorKind::InvalidState, what).remedy("Report this together with the manifest")
}
