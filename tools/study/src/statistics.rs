//! Means, and intervals over scenes.

use std::collections::BTreeMap;

use crate::scene_id::SceneId;

/// Bootstrap samples of an interval.
const RESAMPLINGS: usize = 2_000;
/// Share of bootstrap means inside an interval.
const CONFIDENCE: f64 = 0.95;

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
    /// 95 % interval of the bootstrap means; `None` for a single scene.
    pub(crate) interval: Option<[f64; 2]>,
}

impl Estimate {
    /// In another unit.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { mean: self.mean * factor, interval: self.interval.map(|ends| ends.map(|end| end * factor)) }
    }
}

/// Mean over scenes with a percentile bootstrap over scenes, bit-identical on every machine. `None` without values.
pub(crate) fn estimate(values: &[f64]) -> Option<Estimate> {
    bootstrap(values, |drawn| drawn.iter().sum::<f64>() / drawn.len() as f64)
}

/// As [`estimate`], of the median: of an even number of values the mean of the middle two.
pub(crate) fn estimate_median(values: &[f64]) -> Option<Estimate> {
    bootstrap(values, |drawn| {
        drawn.sort_by(f64::total_cmp);
        let n = drawn.len();
        (drawn[(n - 1) / 2] + drawn[n / 2]) / 2.0
    })
}

/// A statistic with a percentile bootstrap; `None` without values. The statistic may change the order of its values.
fn bootstrap(values: &[f64], statistic: impl Fn(&mut [f64]) -> f64) -> Option<Estimate> {
    let n = values.len();
    let interval = (n > 1 && values.iter().all(|value| value.is_finite())).then(|| {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut pick = || {
            // The splitmix64 generator.
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            values[((z ^ (z >> 31)) % n as u64) as usize]
        };
        let mut drawn = vec![0.0; n];
        let mut means: Vec<f64> = (0..RESAMPLINGS)
            .map(|_| {
                drawn.fill_with(&mut pick);
                statistic(&mut drawn)
            })
            .collect();
        means.sort_by(f64::total_cmp);
        let at = |share: f64| means[((RESAMPLINGS - 1) as f64 * share).round() as usize];
        [at((1.0 - CONFIDENCE) / 2.0), at((1.0 + CONFIDENCE) / 2.0)]
    });
    (n > 0).then(|| Estimate { mean: statistic(&mut values.to_vec()), interval })
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
        assert!(few.mean == 2.5 && (1.0..2.0).contains(&low) && (3.0..=4.0).contains(&high), "{few:?}");
        assert_eq!(estimate(&[1.0, 2.0, 3.0, 4.0]), Some(few), "the same every time");
        let many: Vec<f64> = [1.0, 2.0, 3.0, 4.0].repeat(25);
        let [tight_low, tight_high] = estimate(&many).unwrap().interval.unwrap();
        // Standard error of the mean of 100: 1.118 / 10.
        assert!((tight_high - tight_low - 2.0 * 1.96 * 0.1118).abs() < 0.06, "{tight_low} {tight_high}");
    }

    #[test]
    fn a_median_ignores_how_far_the_farthest_is() {
        assert_eq!(estimate_median(&[3.0, 1.0, 100.0]).unwrap().mean, 3.0);
        let even = estimate_median(&[3.0, 1.0, 100.0, 4.0]).unwrap();
        assert_eq!((even.mean, even.times(10.0).mean), (3.5, 35.0));
        assert_eq!(even.times(2.0).interval, even.interval.map(|ends| ends.map(|end| 2.0 * end)));
    }

    #[test]
    fn frames_count_once_for_their_scene() {
        let scene = |seed| SceneId { family: Family::Snow, seed };
        let values = [(scene(42), 5.0), (scene(41), 1.0), (scene(41), 2.0)];
        assert_eq!(scene_means(values.into_iter()), [(scene(41), 1.5), (scene(42), 5.0)]);
    }
}
