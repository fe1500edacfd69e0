//! Few anchors and many frames: 10 to 60 a second beside 15 to 30, 15 to 60 and 30 to 60, scored against the truth frame by frame.
//!
//! ```text
//! measure (walks and rollouts, frames at every phase) -> report (tables, CSV, page), figure
//! ```

mod figure;
mod measure;
mod report;

use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::{OperatingPoint, Preset};

use crate::experiment::{self, Bench, Experiment, Figure, Measurements, Report};
use crate::progress::Progress;
use crate::scene_id::SceneId;
use measure::{Record, Strip};

pub use crate::experiment::{ExperimentOutcome, Settings};

/// Measures all cadences.
///
/// # Errors
/// An unusable world, missing weights of LPIPS, errors of making latents, and `Cancelled`.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<ExperimentOutcome> {
    experiment::run(&mut Cadences { first: None }, settings, progress, stop).map(|(outcome, _)| outcome)
}

/// The experiment.
struct Cadences {
    /// The first scene and its strips, for the figure.
    first: Option<(SceneId, Vec<Strip>)>,
}

impl Experiment for Cadences {
    const NAME: &'static str = "cadence";
    type Record = Record;

    /// The paper's point, with every decoded picture used, and the largest context window that the world supports up to the paper's.
    fn point(bundle: &Bundle) -> OperatingPoint {
        let point = Preset::Decoded60.operating_point();
        OperatingPoint { global_window: point.global_window.min(bundle.geometry().global.max_window), ..point }
    }

    fn measure(&mut self, scene: SceneId, bench: &Bench<'_>) -> Result<Vec<Record>> {
        let (records, strips) = measure::score(scene, bench)?;
        self.first = self.first.take().or(Some((scene, strips)));
        Ok(records)
    }

    fn figure(&self, _records: &[Record], _bench: &Bench<'_>) -> Result<Option<Figure>> {
        let figure = self
            .first
            .as_ref()
            .map(|(scene, strips)| Ok(Figure { caption: figure::caption(*scene), picture: figure::draw(strips)? }));
        figure.transpose()
    }

    fn report(&self, measured: &Measurements<'_, Record>, caption: Option<&str>) -> Report {
        Report {
            summary: report::summary(measured),
            page: report::page(measured, caption),
            csv: report::csv(measured.records),
        }
    }
}
