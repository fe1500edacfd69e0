//! The paper's experiment: every scene and place in every branch, measured against the renderer's truth, and a report.
//!
//! ```text
//! plan (cells) -> make (a process each, skipping what cells finds whole)
//!              -> score (truth, series: frame by frame; turn) -> summary (figures of rollouts, intervals over places)
//!              -> budget (work counted, times measured) -> video (side by side) -> report
//! ```

mod branch;
pub(crate) mod budget;
pub(crate) mod cells;
pub(crate) mod make;
mod panels;
pub(crate) mod plan;
mod report;
pub(crate) mod score;
pub(crate) mod series;
pub(crate) mod summary;
pub(crate) mod truth;
mod turn;
mod video;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::Result;

pub(crate) use plan::Settings;

use crate::inputs;
use crate::metrics::Net;
use crate::progress::Progress;

/// File name of the report in the output folder.
const REPORT: &str = "report";

/// Result of the comparison.
pub(crate) struct Outcome {
    /// Summary for the terminal.
    pub(crate) text: String,
    /// Files that were written, apart from those of the cells.
    pub(crate) files: Vec<PathBuf>,
}

/// Makes the missing cells, measures all, and writes the report.
///
/// # Errors
/// Errors of [`Settings::check`]; a world that cannot be run at a branch's window; a rollout that fails, with its cell named; a manifest of
/// a newer version; `Cancelled` when `stop` was set. Complete cells are kept in every case.
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    settings.check()?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    // Load LPIPS first: a failure must not come after hours of rollouts.
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
    let made = make::make(settings, &bundle, progress, stop)?;
    let scored = score::score(settings, &made, lpips.as_ref(), progress, stop)?;
    let budgets = budget::budgets(&made.cells, &bundle)?;
    let mut files: Vec<PathBuf> = scored.iter().map(|scored| scored.file.clone()).collect();
    let videos = scored.iter().map(|scored| {
        let frames = scored.series.first().map_or(1, |series| series.rows.len() as u64);
        video::video(scored.place, &scored.key, frames, settings, progress, stop)
    });
    let videos = videos.collect::<Result<Vec<_>>>()?;
    files.extend_from_slice(&videos);
    let found =
        report::Found { settings, bundle: &bundle, made: &made, budgets: &budgets, scored: &scored, videos: &videos };
    let report = report::report(&found)?;
    let mut folders = vec![settings.out.clone()];
    folders.extend(settings.publish.clone());
    for folder in folders {
        files.extend(report.write(&folder, REPORT)?);
    }
    Ok(Outcome { text: report.markdown, files })
}
