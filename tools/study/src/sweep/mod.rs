//! Sweeps of operating points: every combination of a file's axes in every place, measured against the renderer's truth.
//!
//! ```text
//! file (TOML) -> plan (points, cells) -> make (a process each, skipping what is there) -> front -> report, chart
//!                                          ^ one cell: place, rollout, series, each under its manifest or key
//! ```
//!
//! Rollouts, manifests, truth, series and metrics are those of `compare`.

mod chart;
mod file;
mod front;
mod make;
mod measure;
mod plan;
mod report;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::{Error, ErrorKind, Result};
use serde::Serialize;

pub(crate) use plan::Settings;

use crate::compare::budget::budget;
use crate::compare::summary::figures;
use crate::inputs;
use crate::manifest::{absolute, to_json};
use crate::media::{RealDisk, describe_io, write_whole};
use crate::metrics::Net;
use crate::progress::Progress;
use crate::workers::{Work, run_all};
use make::{Shared, Whole};
use plan::Cell;
use report::{Found, Sweep};

/// Version of the output of [`list`].
const LIST_VERSION: u32 = 1;

/// Result of the sweep.
pub(crate) struct Outcome {
    /// Summary for the terminal.
    pub(crate) text: String,
    /// Files that were written, apart from those of the cells.
    pub(crate) files: Vec<PathBuf>,
}

/// All jobs, for programs that run them on other machines.
#[derive(Debug, Serialize)]
struct List<'a> {
    list_version: u32,
    /// The output folder.
    out: PathBuf,
    /// Threads per job.
    threads: usize,
    jobs: Vec<Listed<'a>>,
}

#[derive(Debug, Serialize)]
struct Listed<'a> {
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
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let shared = Shared::new(settings, &bundle, progress)?;
    // Load LPIPS first: a failure must not come after hours of rollouts.
    if settings.lpips {
        inputs::lpips(Net::Alex, progress)?;
    }
    let before = look(settings, &shared, progress)?;
    let mut work = Vec::new();
    for (cell, _) in before.iter().filter(|(_, whole)| whole.is_none()) {
        work.push(Work {
            name: cell.name(),
            folder: cell.folder(&settings.out),
            arguments: arguments(settings, cell),
            planned: planned(settings, cell)?,
        });
    }
    run_all(&work, settings.jobs, progress, stop)?;

    let kept = before.len() - work.len();
    let mut found = Vec::new();
    for (cell, whole) in before {
        let whole = match whole {
            Some(whole) => whole,
            None => shared.find(&cell)?.ok_or_else(|| not_there(&cell, settings))?,
        };
        let [truth, stream] = &whole.series;
        let passes = cell.point.point.schedule.table(&bundle.manifest().sampler)?.passes();
        let passes = u32::try_from(passes).unwrap_or(u32::MAX);
        let budget = budget(&whole.manifest, &whole.manifest, &bundle)?;
        found.push(Found { cell, passes, budget, figures: figures(stream, truth) });
    }
    let document = report::document(&Sweep { settings, bundle: &bundle, found: &found, kept });
    let mut files = Vec::new();
    for folder in std::iter::once(&settings.out).chain(&settings.publish) {
        files.extend(document.write(folder, &settings.name())?);
        let table = folder.join(format!("{}.csv", settings.name()));
        write_whole(&RealDisk, &table, report::csv(&found).as_bytes())?;
        files.push(table);
    }
    Ok(Outcome { text: document.markdown, files })
}

/// All jobs as JSON, with which of them are complete. Makes only seed pictures and scripts.
///
/// # Errors
/// As [`run`].
pub(crate) fn list(settings: &Settings, progress: &Progress) -> Result<String> {
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let shared = Shared::new(settings, &bundle, progress)?;
    let mut jobs = Vec::new();
    for (cell, whole) in look(settings, &shared, progress)? {
        jobs.push(Listed {
            name: cell.name(),
            scene: cell.place.family.name(),
            place: cell.place.seed,
            operating_point: cell.point.to_string(),
            frames: planned(settings, &cell)?,
            whole: whole.is_some(),
        });
    }
    let list = List { list_version: LIST_VERSION, out: absolute(&settings.out), threads: settings.threads, jobs };
    Ok(String::from_utf8_lossy(&to_json(&list)?).into_owned())
}

/// Makes the named job, unless it is complete.
///
/// # Errors
/// `InvalidArgument` if the sweep has no such job; otherwise as [`run`].
pub(crate) fn only(settings: &Settings, name: &str, progress: &Progress, stop: &AtomicBool) -> Result<()> {
    let cell = settings.cells().find(|cell| cell.name() == name).ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("the sweep has no job {name:?}"))
            .field("--only")
            .remedy("Use a name that --list-jobs shows")
    })?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    Shared::new(settings, &bundle, progress)?.make(&cell, progress, stop)
}

/// All cells, with the result of each complete one.
fn look<'a>(
    settings: &'a Settings,
    shared: &Shared<'_>,
    progress: &Progress,
) -> Result<Vec<(Cell<'a>, Option<Whole>)>> {
    std::fs::create_dir_all(&settings.out).map_err(|e| describe_io("cannot be made", &settings.out, &e))?;
    progress.phase("drawing the seed pictures");
    settings.places().try_for_each(|place| shared.prepare(place, progress))?;
    settings.cells().map(|cell| Ok((cell, shared.find(&cell)?))).collect()
}

fn planned(settings: &Settings, cell: &Cell<'_>) -> Result<u64> {
    let checked = cell.rollout(settings).check()?;
    Ok(checked.point.counts(checked.duration).presented)
}

/// Command line that makes a cell.
fn arguments(settings: &Settings, cell: &Cell<'_>) -> Vec<OsString> {
    let name = cell.name();
    let words: [&dyn AsRef<std::ffi::OsStr>; 7] =
        [&"sweep", &settings.file, &"--only", &name, &"--out", &settings.out, &"--quiet"];
    words.iter().map(|word| word.as_ref().to_owned()).collect()
}

fn not_there(cell: &Cell<'_>, settings: &Settings) -> Error {
    Error::new(ErrorKind::InvalidState, format!("{} was made, but is not there", cell.name()))
        .field(cell.folder(&settings.out).display().to_string())
        .remedy("See that nothing else writes into that folder, and run the command again")
}
