//! Figures of the tables: means over walks with their intervals.

use super::discrepancy::{discrepancy, median_distance};
use super::endurance::{self, Second, second};
use super::place::{Group, TestWalk, kind};
use super::response::{Axis, ControlFit, control_fit};
use super::walk::{Horizon, PoseScore, Sample, Shown, WalkScores};
use crate::statistics::{Estimate, estimate, estimate_median, estimate_share};

/// Measurements of one walk.
#[derive(Debug, Clone)]
pub(super) struct WalkResult {
    pub(super) place: TestWalk,
    pub(super) walked: WalkScores,
    /// Pictures at the walk's horizons.
    pub(super) shown: Shown,
}

/// A row of a table: walks of one group, or of all levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Row {
    Group(Group),
    Levels,
}

impl Row {
    /// All rows, in their order.
    pub(super) fn all() -> Vec<Self> {
        let (levels, unseen): (Vec<Group>, Vec<Group>) = Group::all().partition(|group| *group != Group::Unseen);
        let rows = levels.into_iter().map(Self::Group).chain([Self::Levels]);
        rows.chain(unseen.into_iter().map(Self::Group)).collect()
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Group(group) => group.name(),
            Self::Levels => "levels",
        }
    }

    fn has(self, place: TestWalk) -> bool {
        match self {
            Self::Group(group) => place.group() == group,
            Self::Levels => place.group() != Group::Unseen,
        }
    }
}

/// All walks, and their latents in a second.
pub(super) struct Results {
    pub(super) all: Vec<WalkResult>,
    pub(super) latents_per_second: u32,
}

impl Results {
    fn of(&self, row: Row) -> impl Iterator<Item = &WalkResult> + Clone {
        self.all.iter().filter(move |result| row.has(result.place))
    }

    fn walks(&self, row: Row) -> impl Iterator<Item = &WalkScores> + Clone {
        self.of(row).map(|result| &result.walked)
    }

    /// Mean over walks of a value that some of them have.
    pub(super) fn mean<'a>(&'a self, row: Row, of: impl Fn(&'a WalkScores) -> Option<f64>) -> Option<Estimate> {
        estimate(&self.walks(row).filter_map(of).collect::<Vec<_>>())
    }

    /// Mean of a value of each walk's horizon.
    pub(super) fn horizon(&self, row: Row, seconds: f64, of: impl Fn(&Horizon) -> Option<f64>) -> Option<Estimate> {
        self.mean(row, |walked| walked.horizons.iter().find(|h| h.seconds == seconds).and_then(&of))
    }

    /// Mean of a score with the stock schedule at a horizon.
    pub(super) fn stock(
        &self,
        row: Row,
        seconds: f64,
        of: impl Fn(&crate::metrics::Score) -> Option<f64>,
    ) -> Option<Estimate> {
        self.mean(row, |walked| walked.few_steps.iter().find(|(at, _)| *at == seconds).and_then(|(_, score)| of(score)))
    }

    /// Mean of a value of the second that ends at `end`.
    pub(super) fn second(&self, row: Row, end: u32, of: impl Fn(&Second) -> f64) -> Option<Estimate> {
        self.mean(row, |walked| second(walked, end, self.latents_per_second).map(|s| of(&s)))
    }

    /// The seconds that all walks have: ends of the table's rows.
    pub(super) fn ends(&self) -> Vec<u32> {
        endurance::ENDS.into_iter().filter(|end| self.second(Row::Levels, *end, |s| s.detail).is_some()).collect()
    }

    /// End of the seconds before `end` in the table; 0 for the first.
    pub(super) fn since(&self, end: u32) -> u32 {
        self.ends().into_iter().rev().find(|other| *other < end).unwrap_or(0)
    }

    /// Share of the samples between two rows of the table for which `is_right` holds; `is_right` gets the walk, its kind and the sample.
    pub(super) fn recognised(
        &self,
        row: Row,
        end: u32,
        is_right: impl Fn(&WalkScores, usize, &Sample) -> bool,
    ) -> Option<Estimate> {
        let shares = self.of(row).filter_map(|result| {
            let samples = || self.samples(&result.walked, end);
            let count = samples().count();
            let kind = kind(result.place.family());
            let right = samples().filter(|sample| is_right(&result.walked, kind, sample)).count();
            (count > 0 && self.is_whole(&result.walked, end)).then(|| right as f64 / count as f64)
        });
        estimate_share(&shares.collect::<Vec<_>>())
    }

    fn is_whole(&self, walked: &WalkScores, end: u32) -> bool {
        walked.responses.len() >= (end * self.latents_per_second) as usize
    }

    /// Samples between two rows of the table.
    fn samples<'a>(&self, walked: &'a WalkScores, end: u32) -> impl Iterator<Item = &'a Sample> + Clone {
        let [from, until] = [self.since(end), end].map(|second| u64::from(second * self.latents_per_second));
        walked.samples.iter().filter(move |sample| (from + 1..=until).contains(&sample.step))
    }

    /// Discrepancy of the world's pictures from the true ones between two rows of the table, in each walk; the kernel's width is that of the walk's
    /// true pictures.
    pub(super) fn discrepancy(&self, row: Row, end: u32) -> Option<Estimate> {
        self.mean(row, |walked| {
            let [made, real] = [0, 1].map(|i| features(self.samples(walked, end), i));
            discrepancy(&slices(&made), &slices(&real), self.width(walked))
        })
    }

    /// Discrepancy of the true pictures of another walk of the same level from a walk's own, over the same seconds: the next walk's, in turn.
    pub(super) fn discrepancy_of_walks(&self, row: Row, end: u32) -> Option<Estimate> {
        let own: Vec<&WalkResult> = self.of(row).collect();
        let found = own.iter().filter_map(|result| {
            let level: Vec<&WalkResult> =
                own.iter().copied().filter(|o| o.place.group() == result.place.group()).collect();
            let position = level.iter().position(|other| other.place == result.place)?;
            let other = level[(position + 1) % level.len()];
            if other.place == result.place || result.place.group() == Group::Unseen {
                return None;
            }
            let [own, other] = [&result.walked, &other.walked].map(|walked| features(self.samples(walked, end), 1));
            discrepancy(&slices(&other), &slices(&own), self.width(&result.walked))
        });
        estimate(&found.collect::<Vec<_>>())
    }

    fn width(&self, walked: &WalkScores) -> f64 {
        median_distance(&slices(&features(walked.samples.iter(), 1)))
    }

    /// Median of a value of each walk's pose at a horizon.
    pub(super) fn pose(&self, row: Row, seconds: f64, of: impl Fn(&PoseScore) -> f64) -> Option<Estimate> {
        let values = self.walks(row).filter_map(|walked| walked.poses.iter().find(|p| p.seconds == seconds).map(&of));
        estimate_median(&values.collect::<Vec<_>>())
    }

    /// Mean of a value of each walk's look away.
    pub(super) fn memory(
        &self,
        row: Row,
        away: f64,
        of: impl Fn(&super::memory::MemoryScore) -> f64,
    ) -> Option<Estimate> {
        self.mean(row, |walked| walked.remembered.iter().find(|m| m.away == away).map(&of))
    }

    /// Share of the walks whose place is right after a look away.
    pub(super) fn right_place(&self, row: Row, away: f64) -> Option<Estimate> {
        let scores = self.walks(row).filter_map(|walked| walked.remembered.iter().find(|m| m.away == away));
        estimate_share(&scores.map(|score| f64::from(u8::from(score.is_right))).collect::<Vec<_>>())
    }

    /// Times away of the memory test, ascending.
    pub(super) fn away(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.all.iter().flat_map(|r| r.walked.remembered.iter().map(|m| m.away)).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    /// Mean of a value of how each walk follows its controls.
    pub(super) fn control(&self, row: Row, axis: Axis, of: impl Fn(&ControlFit) -> f64) -> Option<Estimate> {
        self.mean(row, |walked| control_fit(&walked.responses, axis).as_ref().map(&of))
    }
}

/// Features of samples, of the world's pictures (0) or the true ones (1), 0 to 1.
fn features<'a>(samples: impl Iterator<Item = &'a Sample>, of: usize) -> Vec<Vec<f32>> {
    samples.map(|sample| sample.features[of].iter().map(|value| f32::from(*value) / 65535.0).collect()).collect()
}

fn slices(vectors: &[Vec<f32>]) -> Vec<&[f32]> {
    vectors.iter().map(Vec::as_slice).collect()
}

/// An estimate as text, such as `0.31 [0.25, 0.38]`.
pub(super) fn show(estimate: Option<Estimate>, digits: usize) -> String {
    show_with(estimate, |value| format!("{value:.digits$}"))
}

/// A difference as text, such as `+0.02 [-0.01, +0.05]`; without the sign of a number that is rounded to 0.
pub(super) fn show_difference(estimate: Option<Estimate>, digits: usize) -> String {
    let half_a_digit = 0.5 * 0.1_f64.powi(digits as i32);
    show_with(estimate, |value| format!("{:+.digits$}", if value.abs() < half_a_digit { 0.0 } else { value }))
}

fn show_with(estimate: Option<Estimate>, number: impl Fn(f64) -> String) -> String {
    match estimate {
        None => "-".into(),
        Some(Estimate { mean, interval: None }) => number(mean),
        Some(Estimate { mean, interval: Some([low, high]) }) => {
            format!("{} [{}, {}]", number(mean), number(low), number(high))
        }
    }
}

/// The mean alone.
pub(super) fn show_mean(estimate: Option<Estimate>, digits: usize) -> String {
    estimate.map_or_else(|| "-".into(), |estimate| format!("{:.digits$}", estimate.mean))
}

/// The walks that a sheet shows: `[best, worst]`, ranked by PSNR gain over repeating the last true picture. At most half of all walks and at most
/// `most` each.
pub(super) fn extremes(results: &[WalkResult], most: usize) -> [Vec<&WalkResult>; 2] {
    let gain = |result: &WalkResult| {
        let gains: Vec<f64> = result.walked.horizons.iter().map(|h| h.world.psnr - h.repeat.psnr).collect();
        gains.iter().sum::<f64>() / gains.len().max(1) as f64
    };
    let mut ranked: Vec<&WalkResult> = results.iter().collect();
    ranked.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
    let (best, worst) = (ranked.len().div_ceil(2).min(most), (ranked.len() / 2).min(most));
    [ranked[..best].to_vec(), ranked.iter().rev().take(worst).copied().collect()]
}
