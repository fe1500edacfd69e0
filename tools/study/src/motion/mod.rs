//! Which motion is best: every source of motion and depth against the scenes' truth, and the frames made with each.
//!
//! ```text
//! sources (motion and depth) -> measure (walks, end points, frames) -> report (tables, CSV, page), figure
//! ```

mod figure;
mod measure;
mod report;
mod sources;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::{GuidanceSource, OperatingPoint, Preset};

use crate::experiment::{self, Bench, Experiment, Figure, Measurements, Report};
use crate::progress::Progress;
use crate::scene_id::SceneId;
use measure::{Record, Walks};

pub use crate::experiment::Settings;

/// Scene seed for tuning, in each family.
pub(crate) const TUNING: u64 = 4;

/// Result of the measurement.
#[derive(Debug)]
pub struct MotionOutcome {
    /// Summary for the terminal.
    pub text: String,
    /// Files that were written.
    pub files: Vec<PathBuf>,
    /// The best source by its generated frames, of those that need anchors only, between the renderer's anchors.
    pub best: Option<GuidanceSource>,
    /// The source that is first in most measures between the autoencoder's pictures; `None` if there is none.
    pub best_decoded: Option<GuidanceSource>,
}

/// Measures all sources.
///
/// # Errors
/// An unusable world, missing weights of LPIPS, errors of making latents, and `Cancelled`.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<MotionOutcome> {
    let (experiment::ExperimentOutcome { text, files }, records) =
        experiment::run(&mut Motion { scale: 0.0 }, settings, progress, stop)?;
    Ok(MotionOutcome { text, files, best: report::best(&records), best_decoded: report::best_decoded(&records) })
}

/// The experiment.
struct Motion {
    /// Scale of the calibrated extractor.
    scale: f32,
}

impl Experiment for Motion {
    const NAME: &'static str = "motion";
    type Record = Record;

    /// Only the autoencoder matters here, so it has the smallest declared window.
    fn point(bundle: &Bundle) -> OperatingPoint {
        let global = &bundle.geometry().global;
        OperatingPoint { global_window: global.window.min(global.max_window), ..Preset::Coherence.operating_point() }
    }

    fn prepare(&mut self, bench: &Bench<'_>) -> Result<()> {
        self.scale = Walks { bench }.calibrate(&SceneId::all(&[TUNING]))?;
        Ok(())
    }

    fn measure(&mut self, scene: SceneId, bench: &Bench<'_>) -> Result<Vec<Record>> {
        Walks { bench }.score(scene, self.scale)
    }

    fn figure(&self, records: &[Record], bench: &Bench<'_>) -> Result<Option<Figure>> {
        let Some((scene, anchor)) = figure::hard_frame(records) else { return Ok(None) };
        let Some(interval) = Walks { bench }.pictures(scene, anchor, self.scale)? else { return Ok(None) };
        Ok(Some(Figure { caption: figure::caption(&interval), picture: figure::draw(&interval)? }))
    }

    fn report(&self, measured: &Measurements<'_, Record>, caption: Option<&str>) -> Report {
        Report {
            summary: report::summary(measured, self.scale),
            page: report::page(measured, self.scale, caption),
            csv: report::csv(measured.records),
        }
    }
}
