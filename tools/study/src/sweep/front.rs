//! The Pareto front, the best point per budget, and steps where more compute gave worse results.

use super::measure::Measure;
use super::point::Point;
use crate::statistics::{Estimate, estimate};

/// A point with its values and costs.
pub(super) struct Score<'a> {
    pub(super) point: &'a Point,
    /// Denoise passes per latent; for a stock schedule, the world's.
    pub(super) passes: u32,
    /// Cost per second of world time, in the sweep's unit.
    pub(super) cost: f64,
    /// Bytes of memory traffic and seconds of computing, per second of world time.
    pub(super) bytes: f64,
    pub(super) seconds: f64,
    /// Values of each measure of [`Measure::ALL`], scene by scene; empty if not measured.
    pub(super) values: [Vec<f64>; Measure::ALL.len()],
}

impl Score<'_> {
    /// Values of a measure, scene by scene.
    fn scenes(&self, measure: Measure) -> &[f64] {
        &self.values[measure as usize]
    }

    /// Mean over scenes.
    pub(super) fn estimate(&self, measure: Measure) -> Option<Estimate> {
        estimate(self.scenes(measure))
    }

    /// The mean with the sign changed where needed, so that larger is better.
    fn goodness(&self, measure: Measure) -> Option<f64> {
        self.estimate(measure).map(|estimate| measure.goodness(estimate.mean))
    }
}

/// Indices of the Pareto-optimal points, from the cheapest: no cheaper point is as good, and no point of the same cost is better.
pub(super) fn front(scores: &[Score<'_>], measure: Measure) -> Vec<usize> {
    let mut order: Vec<(usize, f64)> =
        scores.iter().enumerate().filter_map(|(n, score)| Some((n, score.goodness(measure)?))).collect();
    order.sort_by(|(a, good_a), (b, good_b)| {
        scores[*a].cost.total_cmp(&scores[*b].cost).then(good_b.total_cmp(good_a)).then(a.cmp(b))
    });
    let mut best = f64::NEG_INFINITY;
    let beats = |(n, good): (usize, f64)| {
        let better = good > best;
        best = best.max(good);
        better.then_some(n)
    };
    order.into_iter().filter_map(beats).collect()
}

/// Index of the best point within `budget`; of two equally good ones, the cheaper.
pub(super) fn within(scores: &[Score<'_>], measure: Measure, budget: f64) -> Option<usize> {
    front(scores, measure).into_iter().rfind(|&n| scores[n].cost <= budget)
}

/// A step to a more expensive point: window, schedule or anchor rate moves to the next swept value, and nothing else changes.
pub(super) struct Move {
    /// Indices into the scores.
    pub(super) from: usize,
    pub(super) to: usize,
    /// Improvement: mean over scenes, paired by scene.
    pub(super) gain: Estimate,
}

impl Move {
    /// Whether the interval over scenes is entirely below zero. Always false for a single scene, which has no interval.
    pub(super) fn is_surely_worse(&self) -> bool {
        self.gain.interval.is_some_and(|[_, high]| high < 0.0)
    }

    pub(super) fn is_worse(&self) -> bool {
        self.gain.mean < 0.0
    }
}

/// All such steps.
pub(super) fn moves(scores: &[Score<'_>], measure: Measure) -> Vec<Move> {
    let sorted = |of: fn(&Score<'_>) -> u32| {
        let mut all: Vec<u32> = scores.iter().map(of).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let axes: [fn(&Score<'_>) -> u32; 3] =
        [|s| s.point.point.global_window, |s| s.passes, |s| s.point.point.latents_per_second];
    let values = axes.map(sorted);
    let position = |score: &Score<'_>| -> [usize; 3] {
        std::array::from_fn(|n| values[n].partition_point(|value| *value < axes[n](score)))
    };
    let mut all = Vec::new();
    for (from, a) in scores.iter().enumerate() {
        for (to, b) in scores.iter().enumerate() {
            let up = position(a).into_iter().zip(position(b));
            let next =
                up.clone().all(|(a, b)| b == a || b == a + 1) && b.cost > a.cost && rest(a.point) == rest(b.point);
            if !next || from == to {
                continue;
            }
            let pairs = a.scenes(measure).iter().zip(b.scenes(measure));
            let gains: Vec<f64> = pairs.map(|(a, b)| measure.goodness(*b) - measure.goodness(*a)).collect();
            all.extend(estimate(&gains).map(|gain| Move { from, to, gain }));
        }
    }
    all
}

/// All settings except window, schedule and anchor rate.
fn rest(point: &Point) -> (String, u32, String, String) {
    let motion = match point.point.presentation {
        cairn::world::Presentation::Native => "native".to_owned(),
        cairn::world::Presentation::Generated { guidance, .. } => guidance.to_string(),
    };
    (point.point.cache_mode.to_string(), point.multiplier(), motion, point.generator.to_string())
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::plan::{Settings, tests::parse};
    use super::*;

    pub(in crate::sweep) fn grid() -> Settings {
        parse("[sweep]\nwindow = [128, 384, 512]\nsteps = [8, 10, 12]\n").unwrap()
    }

    pub(in crate::sweep) fn passes(point: &Point) -> u32 {
        match point.point.schedule {
            cairn::world::Schedule::Refined(passes) => passes,
            _ => 4,
        }
    }

    /// Scores of all points in two scenes, with a cost that grows along both axes.
    pub(in crate::sweep) fn scores(settings: &Settings, good: impl Fn(&Point, usize) -> f64) -> Vec<Score<'_>> {
        let score = |point| {
            let values = Measure::ALL.map(|measure| match measure {
                Measure::Ssim => (0..2).map(|scene| good(point, scene)).collect(),
                Measure::Lpips => (0..2).map(|scene| 1.0 - good(point, scene)).collect(),
                _ => Vec::new(),
            });
            let passes = passes(point);
            let cost = f64::from(point.point.global_window) * f64::from(passes) / 100.0;
            Score { point, passes, cost, bytes: 1e9, seconds: 1.0, values }
        };
        settings.points.iter().map(score).collect()
    }

    fn name(score: &Score<'_>) -> (u32, u32) {
        (score.point.point.global_window, score.passes)
    }

    /// The paper's finding: g384 with 10 passes is the best; more of both is worse.
    fn peak(point: &Point, scene: usize) -> f64 {
        let (window, passes) = (point.point.global_window, passes(point));
        let far = f64::from(window.abs_diff(384)) / 512.0 + f64::from(passes.abs_diff(10)) / 10.0;
        0.9 - 0.1 * far + 0.01 * scene as f64
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let settings = grid();
        let scores = scores(&settings, peak);
        for measure in [Measure::Ssim, Measure::Lpips] {
            let front: Vec<_> = front(&scores, measure).into_iter().map(|n| name(&scores[n])).collect();
            assert_eq!(front, [(128, 8), (128, 10), (384, 8), (384, 10)], "{measure}");
        }
        assert!(front(&scores, Measure::Psnr).is_empty(), "it was not measured");
        // Compared with brute force: every point left out is beaten.
        let front = front(&scores, Measure::Ssim);
        for (n, score) in scores.iter().enumerate() {
            let good = |s: &Score<'_>| s.goodness(Measure::Ssim).unwrap();
            let beaten = scores
                .iter()
                .enumerate()
                .any(|(m, other)| m != n && other.cost <= score.cost && good(other) >= good(score));
            assert_eq!(front.contains(&n), !beaten, "{:?}", name(score));
        }
    }

    #[test]
    fn of_two_that_are_alike_one_is_on_the_front() {
        let settings = grid();
        let scores = scores(&settings, |_, _| 0.5);
        assert_eq!(front(&scores, Measure::Ssim).into_iter().map(|n| name(&scores[n])).collect::<Vec<_>>(), [(128, 8)]);
    }

    #[test]
    fn a_budget_buys_the_best_that_it_can() {
        let settings = grid();
        let scores = scores(&settings, peak);
        let bought = |budget| within(&scores, Measure::Ssim, budget).map(|n| name(&scores[n]));
        // g384 with 10 passes costs 38.4; no more expensive point is better.
        for (budget, point) in [
            (10.0, None),
            (10.24, Some((128, 8))),
            (38.3, Some((384, 8))),
            (38.4, Some((384, 10))),
            (1e9, Some((384, 10))),
        ] {
            assert_eq!(bought(budget), point, "{budget}");
        }
    }

    #[test]
    fn steps_to_heavier_points_that_are_worse_are_found() {
        let settings = grid();
        let scores = scores(&settings, peak);
        let all = moves(&scores, Measure::Ssim);
        // On a grid of three by three: 6 steps along each axis and 4 diagonal ones.
        assert_eq!(all.len(), 16);
        let of = |m: &Move| (name(&scores[m.from]), name(&scores[m.to]));
        let found = all.iter().find(|m| of(m) == ((384, 10), (512, 12))).unwrap();
        assert!(found.is_worse() && found.is_surely_worse(), "{:?}", found.gain);
        assert!((found.gain.mean + 0.1 * (128.0 / 512.0 + 0.2)).abs() < 1e-9);
        let better = all.iter().find(|m| of(m) == ((128, 10), (384, 10))).unwrap();
        assert!(!better.is_worse() && !better.is_surely_worse());
        // If scenes disagree, the interval contains zero.
        let doubtful = scores_of_two_minds(&settings);
        let all = moves(&doubtful, Measure::Ssim);
        assert!(all.iter().any(Move::is_worse) && !all.iter().any(Move::is_surely_worse));
    }

    fn scores_of_two_minds(settings: &Settings) -> Vec<Score<'_>> {
        scores(settings, |point, scene| {
            let heavy = f64::from(point.point.global_window) / 512.0;
            if scene == 0 { 0.5 + 0.1 * heavy } else { 0.5 - 0.2 * heavy }
        })
    }
}
