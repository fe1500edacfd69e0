//! Tables, CSV and the page `docs/weights.md`.

use std::fmt::Write as _;

use cairn::world::OperatingPoint;

use super::super::figures::{show, show_difference};
use super::super::place::TestWalk;
use super::Measured;
use super::measure::{PER_SECOND, Samples, Truth};
use crate::statistics::{Estimate, estimate, mean};
use crate::table::Table;

/// A figure of a rollout.
struct Column {
    head: &'static str,
    digits: usize,
    of: fn(&Truth, &Samples) -> Option<f64>,
}

const COLUMNS: [Column; 8] = [
    Column { head: "LPIPS to 5 s", digits: 3, of: |_, samples| lpips(samples, 0, 5) },
    Column { head: "5 to 15 s", digits: 3, of: |_, samples| lpips(samples, 5, 15) },
    Column { head: "from 15 s", digits: 3, of: |_, samples| lpips(samples, 15, u32::MAX) },
    Column { head: "LPIPS", digits: 3, of: |_, samples| lpips(samples, 0, u32::MAX) },
    Column { head: "PSNR, dB", digits: 2, of: |_, samples| mean(samples.iter().map(|s| Some(s.score.psnr))) },
    Column { head: "horizon, s", digits: 1, of: horizon },
    Column { head: "brightness off by, %", digits: 1, of: brightness },
    Column { head: "detail", digits: 2, of: detail },
];

/// The columns that decide whether a world differs: chosen before anything was measured, as of many columns some differ by chance.
const DECISIVE: [&str; 2] = ["LPIPS", "horizon, s"];

/// Mean LPIPS after the second `from` until the second `to`.
fn lpips(samples: &Samples, from: u32, to: u32) -> Option<f64> {
    let [from, to] = [from, to].map(|second| second.saturating_mul(PER_SECOND) as usize);
    mean(samples.get(from..to.min(samples.len()))?.iter().map(|sample| sample.score.lpips))
}

/// Start of the first second that is as far from the truth as the walk's first picture is, on average, from its second half; the whole length if
/// there is none.
fn horizon(truth: &Truth, samples: &Samples) -> Option<f64> {
    let lost = truth.lpips_of_lost()?;
    let mut seconds = samples.chunks(PER_SECOND as usize);
    let count = seconds.len();
    let is_lost = |second: &[super::measure::Sample]| {
        mean(second.iter().map(|sample| sample.score.lpips)).is_some_and(|level| level >= lost)
    };
    Some(seconds.position(is_lost).unwrap_or(count) as f64)
}

/// Mean difference of the brightness from the truth's, in percent of it.
fn brightness(truth: &Truth, samples: &Samples) -> Option<f64> {
    let off = samples.iter().zip(&truth.statistics).map(|(sample, truth)| {
        (truth.brightness > 0.0).then(|| 100.0 * (sample.statistics.brightness / truth.brightness - 1.0).abs())
    });
    mean(off)
}

/// Differences of neighbouring pixels over the truth's, as means over the walk.
fn detail(truth: &Truth, samples: &Samples) -> Option<f64> {
    let ours = mean(samples.iter().map(|sample| Some(sample.statistics.detail)))?;
    let true_detail = mean(truth.statistics.iter().map(|statistics| Some(statistics.detail)))?;
    (true_detail > 0.0).then_some(ours / true_detail)
}

/// All measurements.
pub(super) struct Results<'a> {
    /// Of the worlds; the others are compared with the first.
    pub(super) names: &'a [&'a str],
    pub(super) point: &'a OperatingPoint,
    pub(super) seconds: u32,
    /// In the order of the walks.
    pub(super) measured: &'a [Measured],
}

impl Results<'_> {
    /// Columns that a walk of this length has.
    fn columns(&self) -> impl Iterator<Item = &'static Column> {
        COLUMNS.iter().filter(|column| self.measured.iter().all(|m| (column.of)(&m.truth, &m.rollouts[0]).is_some()))
    }

    /// A figure of one world in each walk.
    fn values(&self, world: usize, column: &Column) -> Vec<f64> {
        self.measured.iter().filter_map(|m| (column.of)(&m.truth, &m.rollouts[world])).collect()
    }

    /// Differences of a world from the first one, walk by walk.
    fn difference(&self, world: usize, column: &Column) -> Option<Estimate> {
        let pairs = self.values(world, column).into_iter().zip(self.values(0, column));
        estimate(&pairs.map(|(ours, first)| ours - first).collect::<Vec<_>>())
    }

    /// Heading and tables.
    pub(super) fn text(&self) -> String {
        let heads = || self.columns().map(|column| column.head);
        let mut rows: Vec<Vec<String>> = Vec::new();
        for (world, name) in self.names.iter().enumerate() {
            let cells = self.columns().map(|column| show(estimate(&self.values(world, column)), column.digits));
            rows.push([(*name).to_owned()].into_iter().chain(cells).collect());
        }
        let still = |column: &Column| {
            let values: Vec<f64> =
                self.measured.iter().filter_map(|m| (column.of)(&m.truth, &m.truth.repeat)).collect();
            show(estimate(&values), column.digits)
        };
        rows.push(["the first picture, repeated".to_owned()].into_iter().chain(self.columns().map(still)).collect());
        let head: Vec<&str> = ["weights"].into_iter().chain(heads()).collect();
        let means = Table::new(1, &head, rows).markdown();

        let mut rows = Vec::new();
        for (world, name) in self.names.iter().enumerate().skip(1) {
            let cells = self.columns().map(|column| show_difference(self.difference(world, column), column.digits));
            let row = [(*name).to_owned()].into_iter().chain(cells).chain([self.verdict(world)]);
            rows.push(row.collect());
        }
        let head: Vec<&str> = ["weights"].into_iter().chain(heads()).chain(["measurably other in"]).collect();
        let differences = Table::new(1, &head, rows).markdown();

        let how_judged = match self.decisive().next() {
            Some(_) => {
                " The last column is of LPIPS and horizon alone: where their intervals contain 0, no difference was measured."
            }
            None => "",
        };
        let OperatingPoint { global_window, schedule, .. } = self.point;
        format!(
            "{} held-out walks of {} s, schedule {schedule}, g{global_window}. Means over the walks, with 95 % intervals.\n\n{means}\n\
             Differences from {}, walk by walk.{how_judged}\n\n{differences}",
            self.measured.len(),
            self.seconds,
            self.names[0],
        )
    }

    /// The columns that decide, if they were measured.
    fn decisive(&self) -> impl Iterator<Item = &'static Column> {
        self.columns().filter(|column| DECISIVE.contains(&column.head))
    }

    /// The decisive columns in which a world differs measurably from the first; a dash if there are none.
    fn verdict(&self, world: usize) -> String {
        if self.decisive().next().is_none() {
            return "-".to_owned();
        }
        let differs = |column: &&Column| {
            self.difference(world, column)
                .and_then(|estimate| estimate.interval)
                .is_some_and(|[low, high]| low > 0.0 || high < 0.0)
        };
        let found: Vec<&str> = self.decisive().filter(differs).map(|column| column.head).collect();
        if found.is_empty() { "nothing".to_owned() } else { found.join("; ") }
    }

    /// A line for each sample.
    pub(super) fn csv(&self, places: &[TestWalk]) -> String {
        let mut text = String::from("place,weights,seconds,psnr_db,ssim,lpips_alex,brightness,detail\n");
        for (place, measured) in places.iter().zip(self.measured) {
            let rows = self.names.iter().copied().zip(&measured.rollouts);
            for (name, samples) in rows.chain([("repeat", &measured.truth.repeat)]) {
                for (number, sample) in samples.iter().enumerate() {
                    let seconds = (number + 1) as f64 / f64::from(PER_SECOND);
                    let (score, statistics) = (&sample.score, &sample.statistics);
                    let lpips = score.lpips.map(|value| format!("{value:.6}")).unwrap_or_default();
                    let _ = writeln!(
                        text,
                        "{},\"{name}\",{seconds},{:.4},{:.6},{lpips},{:.3},{:.4}",
                        place.key(),
                        score.psnr,
                        score.ssim,
                        statistics.brightness,
                        statistics.detail
                    );
                }
            }
        }
        text
    }
}

const INTRODUCTION: &str = "\
# Quantised weights over a minute

How far long rollouts of a world with weights in 8 or 4 bits are from the truth, beside those of the same world with weights in 16 bits. All are
[the world inside the library](world.md), quantised by `python -m cairn.build quantise`. [Section 4 of the bundle format](bundle.md) has errors of single
passes and memory. Each rollout begins with the first true picture of a held-out walk through one of the four levels and gets the walk's controls. All
worlds have the same controls and the same noise. Two pictures a second are compared with the true ones.

- **8 bits**: blocks of 32, the control fusion of layer 0 in 16 bits. **Activations too**: the processor also rounds activations to 8 bits.
- **4 bits**: the same in 4 bits. **Two thirds in 16**: the layers 0, 5, 6 and 7 and the attention of all layers stay in 16 bits, with which a pass
  keeps to an error of 1 %.
- **Horizon**: the first second whose pictures are as far from the truth, by LPIPS of AlexNet, as the walk's first picture is from the walk's second half.
  By then nothing of the first view remains. A rollout that never gets there has the walk's length.
- **Brightness** is off by the mean difference from the truth's. **Detail** is the difference of neighbouring pixels over the truth's.

Rollouts that differ in one bit diverge within seconds, so two equally good worlds differ in each walk, too. An interval of 95 % says how far the mean
over walks may be from that over all walks.

";

/// The page.
pub(super) fn page(text: &str, command: &str) -> String {
    format!("{INTRODUCTION}{text}\nThis page was written by:\n\n```sh\n{command}\n```\n")
}

#[cfg(test)]
mod tests {
    use super::super::measure::Sample;
    use super::*;
    use crate::metrics::Score;
    use crate::world_quality::endurance::PictureStatistics;
    use cairn::world::Preset;

    fn sample(lpips: f64, brightness: f64) -> Sample {
        let statistics = PictureStatistics { brightness, colour: [brightness; 3], contrast: 1.0, detail: 2.0 };
        Sample { score: Score { psnr: 20.0, ssim: 0.5, lpips: Some(lpips) }, statistics }
    }

    /// A walk of six seconds whose first picture is at .5 from its second half.
    fn truth() -> Truth {
        Truth { repeat: vec![sample(0.5, 100.0); 12], statistics: vec![sample(0.0, 100.0).statistics; 12] }
    }

    #[test]
    fn the_horizon_is_the_first_second_that_is_lost() {
        let levels =
            |lost_from: usize| (0..12).map(|i| sample(if i >= lost_from { 0.6 } else { 0.1 }, 100.0)).collect();
        let found = [0, 4, 5, 12].map(|from| horizon(&truth(), &levels(from)).unwrap());
        // Half of the third second is not enough: its mean is .35.
        assert_eq!(found, [0.0, 2.0, 3.0, 6.0]);
    }

    #[test]
    fn a_difference_counts_if_its_interval_excludes_zero() {
        let walks = |shift: &dyn Fn(usize) -> f64| -> Vec<Measured> {
            let one = |number: usize| {
                let noise = 0.02 * number as f64;
                let first = vec![sample(0.3 + noise, 110.0); 12];
                let other = vec![sample(0.3 + noise + shift(number), 110.0); 12];
                Measured { truth: truth(), rollouts: vec![first, other] }
            };
            (0..8).map(one).collect()
        };
        let point = Preset::Stock.operating_point();
        let results = |measured: &[Measured]| {
            let results = Results { names: &["16 bits", "8 bits"], point: &point, seconds: 6, measured };
            (results.verdict(1), results.text())
        };
        let (verdict, text) = results(&walks(&|_| 0.05));
        assert_eq!(verdict, "LPIPS");
        assert!(text.contains("+0.050 [+0.050, +0.050]") && text.contains("10.0 [10.0, 10.0]"), "{text}");
        let (verdict, text) = results(&walks(&|number| if number % 2 == 0 { 0.05 } else { -0.05 }));
        assert_eq!(verdict, "nothing", "{text}");
        assert!(!text.contains("from 15 s"), "the walk is shorter: {text}");
    }
}
