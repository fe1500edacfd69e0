//! Sweeps of operating points: every combination of a file's axes in every scene, measured against the renderer's truth.
//!
//! ```text
//! file (TOML) -> plan (points, cells) -> make (a process for each missing cell) -> front -> report, chart
//!                                          ^ one cell: scene, rollout, series, each under its manifest or key
//! ```
//!
//! Rollouts, manifests, truth, series and metrics are those of `compare`. The processes are this program again, as
//! `study sweep FILE --only NAME`: a program that calls [`run`] must pass its own arguments to [`study::run`](crate::run) when it is
//! started with them.

mod chart;
mod file;
mod front;
mod make;
mod measure;
mod plan;
mod point;
mod report;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::{Error, ErrorKind, Result};
use serde::Serialize;

pub use crate::experiment::ExperimentOutcome;
pub use plan::Settings;

use crate::compare::budget::budget;
use crate::compare::summary::summarise;
use crate::experiment::cells::{Cells, complete};
use crate::inputs;
use crate::manifest::{absolute, to_json};
use crate::metrics::Net;
use crate::progress::Progress;
use make::SweepInputs;
use media::{RealDisk, write_whole};
use report::{CellResult, Sweep};

/// Version of the output of [`list`].
const LIST_VERSION: u32 = 1;

/// All jobs, for programs that run them on other machines.
#[derive(Debug, Serialize)]
struct JobList<'a> {
    list_version: u32,
    /// The output folder.
    out: PathBuf,
    /// Threads per job.
    threads: usize,
    jobs: Vec<JobEntry<'a>>,
}

#[derive(Debug, Serialize)]
struct JobEntry<'a> {
    /// Value for `--only`; with slashes, the folder below `out`.
    name: String,
    scene: &'a str,
    place: u64,
    operating_point: String,
    /// Number of frames to be made.
    frames: u64,
    /// Whether the job is complete.
    whole: bool,
}

/// Makes the missing cells and writes the report.
///
/// # Errors
/// A world that does not support the settings; a rollout that fails, with its name; a manifest of a newer version; `Io`; `Cancelled` when `stop`
/// was set. Complete cells are kept in every case.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<ExperimentOutcome> {
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let shared = SweepInputs::new(settings, &bundle, progress)?;
    // Load LPIPS first: a failure must not come after hours of rollouts.
    if settings.lpips {
        inputs::lpips(Net::Alex, progress)?;
    }
    shared.prepare_all(progress)?;
    let complete = complete(&shared, settings.cells().collect(), settings.jobs, progress, stop)?;
    let (mut found, mut rollouts) = (Vec::new(), Vec::new());
    for (cell, whole) in complete.cells {
        let [truth, stream] = &whole.series;
        let passes = cell.point.point.schedule.table(&bundle.manifest().sampler)?.passes();
        let passes = u32::try_from(passes).unwrap_or(u32::MAX);
        let budget = budget(&whole.manifest, &whole.manifest, &bundle)?;
        found.push(CellResult { cell, passes, budget, metrics: summarise(stream, truth) });
        rollouts.push(whole.manifest);
    }
    let kept = complete.kept;
    let document = report::document(&Sweep { settings, bundle: &bundle, found: &found, kept }).stamped(&rollouts);
    let mut files = Vec::new();
    for folder in std::iter::once(&settings.out).chain(&settings.publish) {
        files.extend(document.write(folder, &settings.name())?);
        let table = folder.join(format!("{}.csv", settings.name()));
        write_whole(&RealDisk, &table, report::csv(&found).as_bytes())?;
        files.push(table);
    }
    Ok(ExperimentOutcome { text: document.markdown, files })
}

/// All jobs as JSON, with which of them are complete. Makes only seed pictures and scripts.
///
/// # Errors
/// As [`run`].
pub fn list(settings: &Settings, progress: &Progress) -> Result<String> {
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let shared = SweepInputs::new(settings, &bundle, progress)?;
    let mut jobs = Vec::new();
    shared.prepare_all(progress)?;
    for cell in settings.cells() {
        let whole = shared.find(cell)?;
        jobs.push(JobEntry {
            name: cell.name(),
            scene: cell.scene.family.name(),
            place: cell.scene.seed,
            operating_point: cell.point.to_string(),
            frames: cell.planned(settings)?,
            whole: whole.is_some(),
        });
    }
    let list = JobList { list_version: LIST_VERSION, out: absolute(&settings.out), threads: settings.threads, jobs };
    Ok(String::from_utf8_lossy(&to_json(&list)?).into_owned())
}

/// Makes the named job, unless it is complete.
///
/// # Errors
/// `InvalidArgument` if the sweep has no such job; otherwise as [`run`].
pub fn only(settings: &Settings, name: &str, progress: &Progress, stop: &AtomicBool) -> Result<()> {
    let cell = settings.cells().find(|cell| cell.name() == name).ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("the sweep has no job {name:?}"))
            .field("--only")
            .remedy("Use a name that --list-jobs shows")
    })?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    SweepInputs::new(settings, &bundle, progress)?.make(cell, progress, stop)
}
