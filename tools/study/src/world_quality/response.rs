//! Response to the controls: mean motion of the world's pictures against the truth's.

/// Mean motion of one latent step, in render pixels from the current picture to the previous one, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Response {
    /// Mean optical flow of the world's pictures.
    pub(super) seen: [f64; 2],
    /// Mean exact motion of the scene.
    pub(super) meant: [f64; 2],
}

impl Response {
    /// Means over all pixels' motions; values that are not finite are left out.
    pub(super) fn new(seen: impl Iterator<Item = [f64; 2]>, meant: impl Iterator<Item = [f64; 2]>) -> Self {
        Self { seen: mean(seen), meant: mean(meant) }
    }
}

fn mean(motions: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0; 2], 0_u32);
    for [x, y] in motions.filter(|m| m.iter().all(|v| v.is_finite())) {
        sum = [sum[0] + x, sum[1] + y];
        count += 1;
    }
    sum.map(|s| s / f64::from(count.max(1)))
}

/// How well the motion along one axis follows the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ControlFit {
    /// Pearson's correlation over steps, -1 to 1; 0 if the world's motion is constant.
    pub(super) correlation: f64,
    /// Slope of the least-squares line through the origin; 1 is right, 0.5 is half as fast.
    pub(super) slope: f64,
    /// Share of the steps with a true motion of at least half a pixel whose motion has the same sign.
    pub(super) same_sign: f64,
}

/// Smaller true motions, in pixels, are not used for the sign comparison.
const STILL: f64 = 0.5;

/// How the steps follow along `axis` (0 is x: turning; 1 is y: tilting). None where the truth does not move.
pub(super) fn following<'a>(steps: impl Iterator<Item = &'a Response> + Clone, axis: usize) -> Option<ControlFit> {
    let pairs = || steps.clone().map(|r| (r.seen[axis], r.meant[axis]));
    let n = pairs().count() as f64;
    let (seen_sum, meant_sum) = pairs().fold((0.0, 0.0), |(a, b), (s, m)| (a + s, b + m));
    let (seen_mean, meant_mean) = (seen_sum / n, meant_sum / n);
    let centred = |f: fn(f64, f64) -> f64| pairs().map(|(s, m)| f(s - seen_mean, m - meant_mean)).sum::<f64>();
    let (both, seen_all, meant_all) = (centred(|s, m| s * m), centred(|s, _| s * s), centred(|_, m| m * m));
    let moving: Vec<_> = pairs().filter(|(_, m)| m.abs() >= STILL).collect();
    if moving.is_empty() || meant_all <= f64::EPSILON {
        return None;
    }
    let same = moving.iter().filter(|(s, m)| s * m > 0.0).count();
    let energy: f64 = pairs().map(|(_, m)| m * m).sum();
    Some(ControlFit {
        correlation: if seen_all <= f64::EPSILON { 0.0 } else { both / (seen_all * meant_all).sqrt() },
        slope: pairs().map(|(s, m)| s * m).sum::<f64>() / energy,
        same_sign: same as f64 / moving.len() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(pairs: &[(f64, f64)]) -> Vec<Response> {
        pairs.iter().map(|&(seen, meant)| Response { seen: [seen, 0.0], meant: [meant, 0.0] }).collect()
    }

    #[test]
    fn half_the_motion_correlates_fully_and_is_called_half() {
        let half = steps(&[(0.0, 0.0), (2.0, 4.0), (-1.0, -2.0), (0.5, 1.0)]);
        let found = following(half.iter(), 0).unwrap();
        assert!((found.correlation - 1.0).abs() < 1e-12 && (found.slope - 0.5).abs() < 1e-12, "{found:?}");
        assert_eq!(found.same_sign, 1.0);
    }

    #[test]
    fn the_wrong_way_and_no_way_are_told_apart() {
        let wrong = following(steps(&[(-3.0, 3.0), (1.0, -1.0), (0.2, -0.1)]).iter(), 0).unwrap();
        assert!(wrong.correlation < -0.99 && wrong.slope < -0.9 && wrong.same_sign == 0.0, "{wrong:?}");
        let frozen = following(steps(&[(0.0, 3.0), (0.0, -1.0)]).iter(), 0).unwrap();
        assert_eq!((frozen.correlation, frozen.slope, frozen.same_sign), (0.0, 0.0, 0.0));
    }

    #[test]
    fn a_truth_that_stands_still_says_nothing() {
        assert_eq!(following(steps(&[(1.0, 0.0), (2.0, 0.0)]).iter(), 0), None);
        assert_eq!(following(steps(&[]).iter(), 0), None);
    }

    #[test]
    fn what_is_behind_the_eye_does_not_count() {
        let nan = [f64::NAN, 0.0];
        let response = Response::new([[1.0, 2.0], nan, [3.0, 4.0]].into_iter(), [nan].into_iter());
        assert_eq!(response, Response { seen: [2.0, 3.0], meant: [0.0, 0.0] });
    }
}
