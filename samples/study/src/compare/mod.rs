//! The paper's experiment: every scene and place in every branch, measured against the renderer's truth, and a report.
//!
//! ```text
//! plan (cells) -> make (a process each, skipping what cells finds whole)
//!              -> score (truth, series: frame by frame; turn) -> summary (figures of rollouts, intervals over places)
//!              -> budget (work counted, times measured) -> report
//! ```

mod branch;
mod budget;
mod cells;
mod make;
mod plan;
mod report;
mod score;
mod series;
mod summary;
mod truth;
mod turn;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::Result;

pub(crate) use plan::Settings;

use crate::inputs;
use crate::media::{RealDisk, encode_small_png, write_whole};
use crate::progress::Progress;

/// The report, in the folder of everything: as text, and as a page.
const REPORT: [&str; 2] = ["report.md", "report.html"];

/// What came of it.
pub(crate) struct Outcome {
    /// For people.
    pub(crate) text: String,
    /// Files that were written, beside the cells' own.
    pub(crate) files: Vec<PathBuf>,
}

/// Makes what is missing, measures it, and writes the report on everything.
///
/// # Errors
/// What [`Settings::check`] refuses; a world that cannot be run at a branch's window; a rollout that fails, with its cell
/// named; a manifest of a newer version; `Cancelled` when `stop` was set. What is whole is kept in every case.
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    settings.check()?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let made = make::make(settings, &bundle, progress, stop)?;
    let scored = score::score(settings, &made, progress, stop)?;
    let budgets = budget::budgets(&made.cells, &bundle)?;
    let mut files: Vec<PathBuf> = scored.iter().map(|scored| scored.file.clone()).collect();
    let mut sheets = Vec::new();
    for scored in &scored {
        let path = scored.place.folder(&settings.out).join(report::SHEET);
        let count = scored.series.first().map_or(1, |series| series.rows.len() as u64);
        let png = encode_small_png(&report::sheet(scored.place, count, settings)?)?;
        write_whole(&RealDisk, &path, &png)?;
        files.push(path);
        sheets.push(png);
    }
    let report::Report { markdown, html } = report::report(settings, &bundle, &made, &budgets, &scored, sheets)?;
    for (name, text) in REPORT.into_iter().zip([&markdown, &html]) {
        let path = settings.out.join(name);
        write_whole(&RealDisk, &path, text.as_bytes())?;
        files.push(path);
    }
    Ok(Outcome { text: markdown, files })
}
