//! Means, and intervals over scenes.

use std::collections::BTreeMap;

use crate::scene_id::SceneId;

/// Share of intervals that contain the true value.
const CONFIDENCE: f64 = 0.95;

/// The quantile 0.975 of Student's t distribution for 1 to 30 degrees of freedom. A percentile bootstrap over few places is too narrow: of a mean
/// over three it contains the true one in 74 of 100 cases (Hesterberg, The American Statistician 69, 2015).
const STUDENT: [f64; 30] = [
    12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281, 2.2010, 2.1788, 2.1604, 2.1448,
    2.1314, 2.1199, 2.1098, 2.1009, 2.0930, 2.0860, 2.0796, 2.0739, 2.0687, 2.0639, 2.0595, 2.0555, 2.0518, 2.0484,
    2.0452, 2.0423,
];

/// The same for any number of degrees of freedom: beyond the table by the first term of its expansion around the normal distribution.
fn student(freedom: usize) -> f64 {
    const NORMAL: f64 = 1.959_964;
    let beyond = || NORMAL + (NORMAL.powi(3) + NORMAL) / (4.0 * freedom as f64);
    STUDENT.get(freedom - 1).copied().unwrap_or_else(beyond)
}

/// Mean of the values that exist.
pub(crate) fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let (sum, count) = values.flatten().fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Mean of each scene's values, ordered by scene.
pub(crate) fn scene_means(values: impl Iterator<Item = (SceneId, f64)>) -> Vec<(SceneId, f64)> {
    let mut by_scene: BTreeMap<SceneId, Vec<f64>> = BTreeMap::new();
    for (scene, value) in values {
        by_scene.entry(scene).or_default().push(value);
    }
    by_scene.into_iter().map(|(scene, values)| (scene, values.iter().sum::<f64>() / values.len() as f64)).collect()
}

/// A mean over scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) mean: f64,
    /// 95 % interval; `None` for a single scene, and for a median of fewer than six.
    pub(crate) interval: Option<[f64; 2]>,
}

impl Estimate {
    /// In another unit.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { mean: self.mean * factor, interval: self.interval.map(|ends| ends.map(|end| end * factor)) }
    }
}

/// Mean over scenes, with the interval of Student's t. `None` without values.
pub(crate) fn estimate(values: &[f64]) -> Option<Estimate> {
    let n = values.len();
    let mean = (n > 0).then(|| values.iter().sum::<f64>() / n as f64)?;
    let interval = (n > 1 && mean.is_finite()).then(|| {
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        let half = student(n - 1) * (variance / n as f64).sqrt();
        [mean - half, mean + half]
    });
    Some(Estimate { mean, interval })
}

/// The mean over scenes of shares from 0 to 1, with Wilson's score interval, which stays within them. It is exact for shares of 0 and 1 and too wide for
/// others, whose variance is smaller (Wilson, Journal of the American Statistical Association 22, 1927). `None` without values.
pub(crate) fn estimate_share(shares: &[f64]) -> Option<Estimate> {
    const NORMAL: f64 = 1.959_964;
    let n = shares.len() as f64;
    let mean = (n > 0.0).then(|| shares.iter().sum::<f64>() / n)?;
    let interval = (n > 1.0 && mean.is_finite()).then(|| {
        let weight = NORMAL.powi(2) / n;
        let middle = (mean + weight / 2.0) / (1.0 + weight);
        let half = (weight * (mean * (1.0 - mean) + weight / 4.0)).sqrt() / (1.0 + weight);
        [(middle - half).max(0.0), (middle + half).min(1.0)]
    });
    Some(Estimate { mean, interval })
}

/// As [`estimate`], of the median: of an even number of values the mean of the middle two. The interval is of two values as far from both ends,
/// which makes no assumption on their distribution.
pub(crate) fn estimate_median(values: &[f64]) -> Option<Estimate> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let median = (n > 0).then(|| (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0)?;
    // How many values may be left out at each end: that so few are on one side of the median has at most half of the probability outside.
    let (mut probability, mut below, mut left_out) = (0.5_f64.powi(n as i32), 0.0, None);
    for count in 0..n {
        below += probability;
        if below > (1.0 - CONFIDENCE) / 2.0 {
            break;
        }
        left_out = Some(count);
        probability *= (n - count) as f64 / (count + 1) as f64;
    }
    let is_finite = sorted.iter().all(|value| value.is_finite());
    let interval = left_out.filter(|_| is_finite).map(|count| [sorted[count], sorted[n - 1 - count]]);
    Some(Estimate { mean: median, interval })
}

#[cfg(test)]
mod tests {
    use scenes::Family;

    use super::*;

    #[test]
    fn an_interval_needs_two_places_and_holds_the_mean() {
        assert_eq!(estimate(&[]), None);
        assert_eq!(estimate(&[0.25]), Some(Estimate { mean: 0.25, interval: None }));
        let few = estimate(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        let [low, high] = few.interval.unwrap();
        // Standard deviation 1.291, 3.1824 standard errors.
        assert!(few.mean == 2.5 && (low - 0.4457).abs() < 1e-3 && (high - 4.5543).abs() < 1e-3, "{few:?}");
        let many: Vec<f64> = [1.0, 2.0, 3.0, 4.0].repeat(25);
        let [tight_low, tight_high] = estimate(&many).unwrap().interval.unwrap();
        // Standard error of the mean of 100: 1.1237 / 10, 1.9842 of them.
        assert!((tight_high - tight_low - 2.0 * 1.9842 * 0.11237).abs() < 1e-4, "{tight_low} {tight_high}");
        assert_eq!(estimate(&[1.0, f64::NAN]).unwrap().interval, None);
    }

    /// Of samples of four from a distribution that is almost normal (the sum of twelve uniform ones); the bootstrap's intervals contain the mean in
    /// about 80 %.
    #[test]
    fn nineteen_of_twenty_intervals_hold_the_true_mean() {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1_u64 << 24) as f64
        };
        let mut next = || (0..12).map(|_| uniform()).sum::<f64>();
        let holds = |_: &i32| {
            let [low, high] = estimate(&[next(), next(), next(), next()]).unwrap().interval.unwrap();
            (low..=high).contains(&6.0)
        };
        let held = (0..4000).filter(holds).count();
        assert!((3750..3850).contains(&held), "{held} of 4000");
    }

    #[test]
    fn the_interval_of_a_share_stays_within_it() {
        let of = |right: usize, n: usize| {
            let shares: Vec<f64> = (0..n).map(|i| if i < right { 1.0 } else { 0.0 }).collect();
            estimate_share(&shares).unwrap().interval.unwrap()
        };
        // Published values: 0 and 10 of 10, and 7 of 10.
        for ((right, n), [low, high]) in
            [((0, 10), [0.0, 0.2775]), ((10, 10), [0.7225, 1.0]), ((7, 10), [0.3968, 0.8922])]
        {
            let found = of(right, n);
            assert!((found[0] - low).abs() < 1e-4 && (found[1] - high).abs() < 1e-4, "{right} of {n}: {found:?}");
        }
        assert_eq!(estimate_share(&[0.5]), Some(Estimate { mean: 0.5, interval: None }));
        assert_eq!(estimate_share(&[]), None);
    }

    #[test]
    fn a_median_ignores_how_far_the_farthest_is() {
        assert_eq!(estimate_median(&[3.0, 1.0, 100.0]).unwrap().mean, 3.0);
        let even = estimate_median(&[3.0, 1.0, 100.0, 4.0]).unwrap();
        assert_eq!((even.mean, even.times(10.0).mean), (3.5, 35.0));
        assert_eq!(even.interval, None, "all of four are on one side of the median in one case of eight");
        let ends = |n: u32| estimate_median(&(1..=n).map(f64::from).collect::<Vec<_>>()).unwrap().interval;
        // Order statistics of the binomial distribution, as in tables of the sign test.
        assert_eq!(
            [6, 8, 9, 12, 20].map(ends),
            [[1.0, 6.0], [1.0, 8.0], [2.0, 8.0], [3.0, 10.0], [6.0, 15.0]].map(Some)
        );
    }

    #[test]
    fn frames_count_once_for_their_scene() {
        let scene = |seed| SceneId { family: Family::Snow, seed };
        let values = [(scene(42), 5.0), (scene(41), 1.0), (scene(41), 2.0)];
        assert_eq!(scene_means(values.into_iter()), [(scene(41), 1.5), (scene(42), 5.0)]);
    }
}
