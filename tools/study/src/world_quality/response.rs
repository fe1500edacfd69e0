//! Response to the controls: mean motion of the world's pictures against the truth's.

use serde::{Deserialize, Serialize};

/// Mean motion of one latent step, in render pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct MeanMotion {
    /// Right and down, from the current picture to the previous one.
    pub(super) mean: [f64; 2],
    /// Away from the picture's centre, from the previous picture to the current one: positive when walking ahead.
    pub(super) expansion: f64,
    /// Length of the motion.
    pub(super) speed: f64,
}

impl MeanMotion {
    /// Means over all pixels' motions, row by row, each from the current picture to the previous one; values that are not finite are left out.
    pub(super) fn new(motions: impl Iterator<Item = [f64; 2]>, (width, height): (u32, u32)) -> Self {
        let (mut sum, mut expansion, mut speed, mut count) = ([0.0; 2], 0.0, 0.0, 0_u32);
        let centre = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        for (i, [x, y]) in motions.enumerate().filter(|(_, m)| m.iter().all(|v| v.is_finite())) {
            let (column, row) = (i as u32 % width, i as u32 / width);
            let away = [f64::from(column) + 0.5 - centre[0], f64::from(row) + 0.5 - centre[1]];
            sum = [sum[0] + x, sum[1] + y];
            expansion -= (x * away[0] + y * away[1]) / away[0].hypot(away[1]).max(1.0);
            speed += x.hypot(y);
            count += 1;
        }
        let count = f64::from(count.max(1));
        Self { mean: sum.map(|s| s / count), expansion: expansion / count, speed: speed / count }
    }
}

/// Motion of one latent step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Response {
    /// Optical flow of the world's pictures.
    pub(super) seen: MeanMotion,
    /// Exact motion of the scene.
    pub(super) meant: MeanMotion,
}

/// A component of the motion, which one kind of control causes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// Motion across: the mouse to the left and right.
    Turning,
    /// Motion up and down: the mouse ahead and back.
    Tilting,
    /// Expansion: the keys for walking.
    Walking,
}

impl Axis {
    fn of(self, flow: &MeanMotion) -> f64 {
        match self {
            Self::Turning => flow.mean[0],
            Self::Tilting => flow.mean[1],
            Self::Walking => flow.expansion,
        }
    }
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

/// Smaller true motions, in pixels, say nothing about the sign.
const MIN_TRUE_MOTION: f64 = 0.5;
/// True speed in pixels a step below which a walker stands still.
const STANDING: f64 = 0.1;

/// How the steps follow along `axis`. `None` if the true motion is constant, or below [`MIN_TRUE_MOTION`] in every step.
pub(super) fn control_fit(steps: &[Response], axis: Axis) -> Option<ControlFit> {
    let pairs = || steps.iter().map(|r| (axis.of(&r.seen), axis.of(&r.meant)));
    let n = steps.len() as f64;
    let (seen_sum, meant_sum) = pairs().fold((0.0, 0.0), |(a, b), (s, m)| (a + s, b + m));
    let (seen_mean, meant_mean) = (seen_sum / n, meant_sum / n);
    let centred = |f: fn(f64, f64) -> f64| pairs().map(|(s, m)| f(s - seen_mean, m - meant_mean)).sum::<f64>();
    let (both, seen_all, meant_all) = (centred(|s, m| s * m), centred(|s, _| s * s), centred(|_, m| m * m));
    let moving: Vec<_> = pairs().filter(|(_, m)| m.abs() >= MIN_TRUE_MOTION).collect();
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

/// Mean speed of the world's pictures in pixels a step, over the steps in which the true walker stands still; `None` if there are none.
pub(super) fn standing_speed(steps: &[Response]) -> Option<f64> {
    let standing = || steps.iter().filter(|r| r.meant.speed < STANDING);
    let count = standing().count();
    (count > 0).then(|| standing().map(|r| r.seen.speed).sum::<f64>() / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow(turn: f64) -> MeanMotion {
        MeanMotion { mean: [turn, 0.0], expansion: 0.0, speed: turn.abs() }
    }

    fn steps(pairs: &[(f64, f64)]) -> Vec<Response> {
        pairs.iter().map(|&(seen, meant)| Response { seen: flow(seen), meant: flow(meant) }).collect()
    }

    #[test]
    fn half_the_motion_correlates_fully_and_is_called_half() {
        let half = steps(&[(0.0, 0.0), (2.0, 4.0), (-1.0, -2.0), (0.5, 1.0)]);
        let found = control_fit(&half, Axis::Turning).unwrap();
        assert!((found.correlation - 1.0).abs() < 1e-12 && (found.slope - 0.5).abs() < 1e-12, "{found:?}");
        assert_eq!(found.same_sign, 1.0);
        assert_eq!(control_fit(&half, Axis::Tilting), None);
        assert_eq!(control_fit(&half, Axis::Walking), None);
    }

    #[test]
    fn the_wrong_way_and_no_way_are_told_apart() {
        let wrong = control_fit(&steps(&[(-3.0, 3.0), (1.0, -1.0), (0.2, -0.1)]), Axis::Turning).unwrap();
        assert!(wrong.correlation < -0.99 && wrong.slope < -0.9 && wrong.same_sign == 0.0, "{wrong:?}");
        let frozen = control_fit(&steps(&[(0.0, 3.0), (0.0, -1.0)]), Axis::Turning).unwrap();
        assert_eq!((frozen.correlation, frozen.slope, frozen.same_sign), (0.0, 0.0, 0.0));
    }

    #[test]
    fn a_truth_that_stands_still_says_nothing_but_how_still_the_world_is() {
        let restless = steps(&[(1.0, 0.0), (2.0, 0.0), (9.0, 5.0)]);
        assert_eq!(control_fit(&restless[..2], Axis::Turning), None);
        assert_eq!(control_fit(&[], Axis::Turning), None);
        assert_eq!((standing_speed(&restless), standing_speed(&restless[2..])), (Some(1.5), None));
    }

    #[test]
    fn what_is_behind_the_eye_does_not_count() {
        let nan = [f64::NAN, 0.0];
        let of = |motions: [[f64; 2]; 3]| MeanMotion::new(motions.into_iter(), (3, 1));
        assert_eq!(of([[1.0, 2.0], nan, [3.0, 4.0]]).mean, [2.0, 3.0]);
        assert_eq!(of([nan; 3]), MeanMotion { mean: [0.0; 2], expansion: 0.0, speed: 0.0 });
    }

    #[test]
    fn a_picture_that_grows_expands_and_one_that_shifts_does_not() {
        // Motion points to the previous picture: towards the centre while walking ahead.
        let of = |motion: fn(f64, f64) -> [f64; 2]| {
            let centred = |i: u32| [f64::from(i % 8) - 3.5, f64::from(i / 8) - 3.5];
            MeanMotion::new((0..64).map(|i| motion(centred(i)[0], centred(i)[1])), (8, 8))
        };
        let ahead = of(|x, y| [-0.1 * x, -0.1 * y]);
        assert!(ahead.expansion > 0.2 && ahead.mean.iter().all(|m| m.abs() < 1e-9), "{ahead:?}");
        // Everything moves outwards, so that the whole motion is expansion but for the four pixels in the middle.
        assert!((ahead.speed - ahead.expansion).abs() < 0.01 * ahead.speed, "{ahead:?}");
        let turned = of(|_, _| [5.0, 0.0]);
        assert!(turned.expansion.abs() < 1e-9 && turned.mean == [5.0, 0.0], "{turned:?}");
    }
}
