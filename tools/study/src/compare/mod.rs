//! The paper's experiment: every scene in every branch, measured against the renderer's truth, and a report.
//!
//! ```text
//! walk, paths (scripts, files) -> plan (cells) -> make (a process for each cell that resume does not find complete)
//!   -> score (truth, series: frame by frame; turn_onset) -> summary (metrics of each rollout)
//!   -> budget (work counted, times measured) -> video (side by side) -> report
//! ```
//!
//! The processes are this program again, as `study rollout`: a program that calls [`run`] must pass its own arguments to
//! [`study::run`](crate::run) when it is started with them.

mod branch;
pub(crate) mod budget;
pub(crate) mod make;
mod panels;
pub(crate) mod paths;
pub(crate) mod plan;
mod report;
pub(crate) mod resume;
pub(crate) mod score;
pub(crate) mod series;
pub(crate) mod summary;
pub(crate) mod truth;
mod turn_onset;
mod video;
pub(crate) mod walk;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::Result;

pub use crate::experiment::ExperimentOutcome;
pub use plan::Settings;

use crate::inputs;
use crate::metrics::Net;
use crate::progress::Progress;

/// File name of the report in the output folder.
const REPORT: &str = "report";

/// Makes the missing cells, measures all, and writes the report.
///
/// # Errors
/// Errors of [`Settings::check`]; a world that cannot be run at a branch's window; a rollout that fails, with its cell named; a manifest of
/// a newer version; `Cancelled` when `stop` was set. Complete cells are kept in every case.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<ExperimentOutcome> {
    settings.check()?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    // Load LPIPS first: a failure must not come after hours of rollouts.
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
    let made = make::make(settings, &bundle, progress, stop)?;
    let scored = score::score(settings, &made, lpips.as_ref(), progress, stop)?;
    let budgets = budget::budgets(&made.cells, &bundle)?;
    let mut files: Vec<PathBuf> = scored.iter().map(|scored| scored.file.clone()).collect();
    let video = |place: &score::SceneScores| {
        let frames = place.series.first().map_or(1, |series| series.rows.len() as u64);
        video::video(place.scene, &place.key, frames, settings, progress, stop)
    };
    // The report shows the first place of each kind. The other videos take longer than all of the report, and follow it.
    let is_first = |place: &&score::SceneScores| settings.first_place(place.scene.family) == Some(place.scene);
    let (first, others): (Vec<_>, Vec<_>) = scored.iter().partition(is_first);
    let videos = first.into_iter().map(|place| Ok((place, video(place)?))).collect::<Result<Vec<_>>>()?;
    let found =
        report::Results { settings, bundle: &bundle, made: &made, budgets: &budgets, scored: &scored, videos: &videos };
    let rollouts = made.cells.iter().chain(&made.straight).map(|(_, manifest)| manifest);
    let report = report::report(&found)?.stamped(rollouts);
    files.extend(report.write(&settings.out, REPORT)?);
    if let Some(folder) = &settings.publish {
        files.extend(report.write_compressed(folder, REPORT)?);
    }
    files.extend(videos.into_iter().map(|(_, path)| path));
    for place in others {
        files.push(video(place)?);
    }
    Ok(ExperimentOutcome { text: report.markdown, files })
}
