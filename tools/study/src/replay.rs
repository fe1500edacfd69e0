//! Makes a rollout or a reconstruct again from its manifest and compares the files.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::{Error, ErrorKind, Result};

use crate::inputs::Overrides;
use crate::job::{Job, JobOutcome, run};
use crate::latents::first_difference;
use crate::machine::Versions;
use crate::manifest::{Input, Inputs, Manifest, Output, job_of};
use crate::output::LATENTS;
use crate::progress::Progress;
use crate::reconstruct::{self, ReconstructManifest, ReconstructOutcome, Reconstruction, reconstruct};
use crate::settings::Settings;
use media::RealDisk;

/// A replay job.
pub struct Replay<'a> {
    /// The manifest of the first rollout.
    pub manifest: &'a Path,
    /// Output folder; `None` for `replay` beside the manifest.
    pub out: Option<&'a Path>,
    /// Whether an earlier replay in that folder may be replaced.
    pub overwrite: bool,
    /// Current paths of the inputs.
    pub overrides: Overrides,
    /// Set from any thread to stop after the current frame.
    pub stop: &'a AtomicBool,
    /// Receives the progress.
    pub progress: &'a Progress,
}

/// A difference from the first run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Difference {
    /// An input differs, so the rollout was not made.
    Input {
        /// Name of the input.
        name: &'static str,
        /// What is different.
        how: String,
    },
    /// A version or the hardware differs: the result may or may not be the same.
    Version {
        /// Name of the item.
        name: &'static str,
        /// Value in the manifest.
        then: String,
        /// Current value.
        now: String,
    },
    /// An output differs.
    Output {
        /// Its path relative to the manifest.
        path: String,
        /// What is different.
        how: String,
    },
}

impl Difference {
    /// Whether this makes the replay fail. A different version alone does not.
    pub fn is_failure(&self) -> bool {
        !matches!(self, Self::Version { .. })
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input { name, how } => write!(f, "input {name}: {how}"),
            Self::Version { name, then, now } => write!(f, "version of {name}: {then} then, {now} now"),
            Self::Output { path, how } => write!(f, "output {path}: {how}"),
        }
    }
}

/// Result of a replay.
#[derive(Debug)]
pub struct ReplayReport {
    /// All differences; empty if everything is equal.
    pub differences: Vec<Difference>,
    /// Number of bit-identical files.
    pub equal: usize,
    /// Files that the first run did not finish; they are not compared.
    pub skipped: Vec<String>,
    /// Folder of the replay's files.
    pub out: PathBuf,
    /// Whether it was stopped before its end.
    pub interrupted: bool,
}

/// Makes the rollout of a manifest again and compares every output by its checksum.
///
/// # Errors
/// Errors of reading the manifest, and those of [`run`](crate::run_job); also failures during the replay.
pub fn replay(job: &Replay<'_>) -> Result<ReplayReport> {
    let beside = job.manifest.parent().unwrap_or(Path::new(""));
    let out = job.out.map_or_else(|| beside.join("replay"), Path::to_owned);
    if crate::manifest::absolute(&out) == crate::manifest::absolute(beside) {
        return Err(Error::new(ErrorKind::InvalidArgument, "the replay would replace what it is compared with")
            .field("--out")
            .remedy("Choose another folder"));
    }
    match job_of(job.manifest)?.as_deref() {
        None => replay_rollout(job, beside, out),
        Some(reconstruct::JOB) => replay_reconstruct(job, beside, out),
        Some(other) => Err(Error::new(ErrorKind::Unsupported, format!("this program knows no job {other:?}"))
            .field(job.manifest.display().to_string())
            .remedy("Use the version of study that wrote it")),
    }
}

fn nothing_to_compare(job: &Replay<'_>, writer: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, "it ended before its first frame")
        .field(job.manifest.display().to_string())
        .remedy(format!("Make it anew with {writer}"))
}

fn replay_rollout(job: &Replay<'_>, beside: &Path, out: PathBuf) -> Result<ReplayReport> {
    let first = Manifest::read(job.manifest)?;
    if first.counts.presented == 0 {
        return Err(nothing_to_compare(job, "study rollout"));
    }
    let Overrides { world, seed_picture, script } = job.overrides.clone();
    let settings = Settings {
        world: world.or(first.settings.world.clone()),
        seed_picture: seed_picture.or(first.settings.seed_picture.clone()),
        script: script.or(first.settings.script.clone()),
        ..first.settings.clone()
    };
    // Checked first: with a different input the rollout would differ.
    let now = crate::inputs::load(&settings, job.progress)?.inputs;
    let mut differences = inputs(&first.inputs, &now);
    if !differences.is_empty() {
        return Ok(ReplayReport { differences, equal: 0, skipped: Vec::new(), out, interrupted: false });
    }
    let JobOutcome { manifest: second, failure, interrupted, .. } = run(&Job {
        settings: &settings,
        out: &out,
        overwrite: job.overwrite,
        disk: Arc::new(RealDisk),
        stop: job.stop,
        progress: job.progress,
        limit: (!first.complete).then_some(first.counts),
    })?;
    if let Some(error) = failure {
        return Err(error);
    }
    let mut compared = ReplayReport { differences: Vec::new(), equal: 0, skipped: Vec::new(), out, interrupted };
    if !interrupted {
        outputs(&first.outputs, &second.outputs, beside, &mut compared);
    }
    differences.extend(versions(&first.versions, &second.versions));
    let library = [&first, &second].map(|manifest| manifest.inputs.onnxruntime.sha256.clone());
    differences.extend(changed("the ONNX Runtime library", library));
    differences.append(&mut compared.differences);
    compared.differences = differences;
    Ok(compared)
}

fn replay_reconstruct(job: &Replay<'_>, beside: &Path, out: PathBuf) -> Result<ReplayReport> {
    let first = ReconstructManifest::read(job.manifest)?;
    if first.counts.presented == 0 {
        return Err(nothing_to_compare(job, "study reconstruct"));
    }
    let Overrides { world, seed_picture, script } = &job.overrides;
    for (given, option) in [(world, "--world"), (seed_picture, "--seed-picture"), (script, "--script")] {
        if given.is_some() {
            return Err(Error::new(ErrorKind::InvalidArgument, "a reconstruct has no such input")
                .field(option)
                .remedy("Leave it out"));
        }
    }
    // Checked first: with a different script the walk would differ.
    let script = reconstruct::script_input(&first.settings.scene);
    if let Some(now) = script.filter(|now| now.sha256 != first.script.sha256) {
        let difference = Difference::Input { name: "script", how: changed_input(&first.script, &now) };
        return Ok(ReplayReport {
            differences: vec![difference],
            equal: 0,
            skipped: Vec::new(),
            out,
            interrupted: false,
        });
    }
    let ReconstructOutcome { manifest: second, failure, interrupted } = reconstruct(&Reconstruction {
        settings: &first.settings,
        out: &out,
        overwrite: job.overwrite,
        disk: Arc::new(RealDisk),
        stop: job.stop,
        progress: job.progress,
        limit: (!first.complete).then_some(first.counts.presented),
    })?;
    if let Some(error) = failure {
        return Err(error);
    }
    let differences = versions(&first.versions, &second.versions).collect();
    let mut compared = ReplayReport { differences, equal: 0, skipped: Vec::new(), out, interrupted };
    if !interrupted {
        outputs(&first.outputs, &second.outputs, beside, &mut compared);
    }
    Ok(compared)
}

fn inputs(then: &Inputs, now: &Inputs) -> Vec<Difference> {
    let pairs = [
        ("world", &then.world, &now.world),
        ("seed picture", &then.seed_picture, &now.seed_picture),
        ("script", &then.script, &now.script),
    ];
    let latents = then.latents.as_ref().zip(now.latents.as_ref()).map(|(then, now)| ("latents", then, now));
    let changed = pairs.into_iter().chain(latents).filter(|(_, then, now)| then.sha256 != now.sha256);
    changed.map(|(name, then, now)| Difference::Input { name, how: changed_input(then, now) }).collect()
}

fn changed_input(then: &Input, now: &Input) -> String {
    let place = if then.path == now.path { now.path.clone() } else { format!("{} instead of {}", now.path, then.path) };
    format!("{place} has {} bytes and SHA-256 {}, then {} bytes and {}", now.size, now.sha256, then.size, then.sha256)
}

fn versions(a: &Versions, b: &Versions) -> impl Iterator<Item = Difference> {
    let threads = |versions: &Versions| versions.threads.map(|threads| threads.to_string()).unwrap_or_default();
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    let driver = |versions: &Versions| versions.adapter.as_ref().and_then(|a| a.driver.clone()).unwrap_or_default();
    let libraries = |versions: &Versions| {
        let all = versions.libraries.iter().map(|l| format!("{} {}", l.name, l.version.as_deref().unwrap_or("?")));
        all.collect::<Vec<_>>().join(", ")
    };
    let pairs = [
        ("cairn", [a.cairn.clone(), b.cairn.clone()]),
        ("ONNX Runtime", [text(&a.onnxruntime), text(&b.onnxruntime)]),
        ("the video encoder", [a.encoder.clone(), b.encoder.clone()]),
        ("the frame generator", [a.generator.clone(), b.generator.clone()]),
        ("the device", [text(&a.device), text(&b.device)]),
        ("the adapter's driver", [driver(a), driver(b)]),
        ("libraries of others", [libraries(a), libraries(b)]),
        ("the thread count", [threads(a), threads(b)]),
        ("the processor architecture", [a.architecture.clone(), b.architecture.clone()]),
        ("the processor's features", [a.cpu_features.join(" "), b.cpu_features.join(" ")]),
    ];
    pairs.into_iter().filter_map(|(name, pair)| changed(name, pair))
}

fn changed(name: &'static str, [then, now]: [String; 2]) -> Option<Difference> {
    (then != now).then_some(Difference::Version { name, then, now })
}

fn outputs(first: &[Output], second: &[Output], beside: &Path, compared: &mut ReplayReport) {
    for then in first {
        if !then.complete {
            compared.skipped.push(then.path.clone());
            continue;
        }
        match second.iter().find(|now| now.path == then.path) {
            Some(now) if now.sha256 == then.sha256 => compared.equal += 1,
            Some(now) => compared.differences.push(Difference::Output {
                path: then.path.clone(),
                how: changed_output(then, now, beside, &compared.out),
            }),
            None => compared
                .differences
                .push(Difference::Output { path: then.path.clone(), how: "was not made again".into() }),
        }
    }
}

fn changed_output(then: &Output, now: &Output, beside: &Path, out: &Path) -> String {
    if then.path == LATENTS {
        let read = |folder: &Path| std::fs::read(folder.join(LATENTS)).ok();
        let at = read(beside).zip(read(out)).and_then(|(a, b)| first_difference(&a, &b));
        if let Some(at) = at {
            return format!("differs from latent {at} on");
        }
    }
    format!("{} bytes with SHA-256 {}, then {} bytes with {}", now.size, now.sha256, then.size, then.sha256)
}
