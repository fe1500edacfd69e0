//! Camera fit: the camera motion, estimated from motion and depth of the current anchor.
//!
//! With distances `w0` and `w1` from the camera plane in the two anchors, `w0 / w1 - 1` of a static point is `tau q + alpha x +
//! beta y` for a camera that moves forward by `tau` and turns by `alpha` and `beta`; `q`, the inverse depth, is
//! proportional to `1 / w1` up to a small constant. A pixel at (x, y) in the current anchor was at (u, v) in the
//! previous one:
//!
//! `u (1 + alpha x + beta y + tau q) = x + a x + b y + c + d q`, and the same for `v` with four parameters of its own.
//!
//! The eleven parameters are a least-squares fit to a few hundred pixels. If less than nine tenths of columns are
//! inliers, RANSAC (M. A. Fischler and R. C. Bolles, Random sample consensus, 1981) selects the inliers, which excludes
//! objects that move on their own or with the camera. If less than half of the pixels fit, motion is interpolated
//! linearly.

use super::static_mask::StaticMask;
use super::warp::DepthChange;
use crate::guidance::Guidance;

/// Columns and rows of sampled pixels.
const SAMPLE_GRID: [usize; 2] = [20, 12];
/// Largest distance of an inlier from its expected position, in pixels.
const INLIER_DISTANCE: f64 = 0.5;
/// Number of RANSAC trials, and samples per trial: two equations each, one more than there are parameters.
const RANSAC_TRIALS: usize = 24;
const TRIAL_SAMPLES: usize = 6;
/// What chooses their samples: pseudo-random numbers of 31 bits by Knuth's MMIX generator, the same in every call.
const RANDOM: [u32; RANSAC_TRIALS * TRIAL_SAMPLES] = {
    let (mut numbers, mut state, mut n) = ([0; RANSAC_TRIALS * TRIAL_SAMPLES], 1_u64, 0);
    while n < numbers.len() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        numbers[n] = (state >> 33) as u32;
        n += 1;
    }
    numbers
};
/// Refits to the inliers of the last fit.
const REFITS: usize = 2;
/// Number of parameters.
const PARAMETERS: usize = 11;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "CAMERA_FIT_": uint2 SAMPLE_GRID, float INLIER_DISTANCE, uint RANSAC_TRIALS, uint TRIAL_SAMPLES, [uint] RANDOM,
    uint PARAMETERS
);

/// Tikhonov regularisation: keeps parameters near zero that the samples do not determine. Variance of the motion over
/// that of the parameters.
const REGULARISATION: f64 = 1e-6;
/// Range of `w0 / w1 - 1`: half the distance to nearly twice the distance in the previous anchor.
const CHANGE_RANGE: [f64; 2] = [-0.5, 0.9];

/// Projection of static points from pixels of the previous anchor to the current one.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReprojectionMatrix {
    /// Rows of the 3x4 matrix that maps homogeneous `(x, y, 1, inverse_depth)` in the previous anchor to homogeneous
    /// `(x', y', w')` in the current one, up to scale. Coordinates are relative to the picture's centre, in picture
    /// widths.
    rows: [[f32; 4]; 3],
    centre: [f32; 2],
    width: f32,
}

/// Result of the fit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CameraFit {
    pub(super) depth_change: DepthChange,
    /// Set if the depth varies.
    pub(super) reprojection: Option<ReprojectionMatrix>,
}

/// Position of a pixel in both anchors, and its inverse depth. Positions are relative to the picture's centre, in
/// picture widths.
#[derive(Debug, Clone, Copy, Default)]
struct Sample {
    current: [f64; 2],
    previous: [f64; 2],
    inverse_depth: f64,
}

type Parameters = [f64; PARAMETERS];

impl Sample {
    /// Coefficients of the parameters in the equation of one component, and the right-hand side.
    fn equation(&self, component: usize) -> (Parameters, f64) {
        let ([x, y], previous) = (self.current, self.previous[component]);
        let mut coefficients = [0.0; PARAMETERS];
        coefficients[4 * component..][..4].copy_from_slice(&[x, y, 1.0, self.inverse_depth]);
        coefficients[8..].copy_from_slice(&[-previous * x, -previous * y, -previous * self.inverse_depth]);
        (coefficients, previous - self.current[component])
    }

    /// `w0 / w1 - 1`.
    fn change(&self, n: &Parameters) -> f64 {
        n[8] * self.current[0] + n[9] * self.current[1] + n[10] * self.inverse_depth
    }

    /// Squared distance between the previous position and the one that the parameters predict.
    fn squared_error(&self, n: &Parameters) -> f64 {
        let [x, y] = self.current;
        let scale = 1.0 + self.change(n);
        let expected = |c: usize| {
            (self.current[c] + n[4 * c] * x + n[4 * c + 1] * y + n[4 * c + 2] + n[4 * c + 3] * self.inverse_depth)
                / scale
        };
        let [x, y] = [expected(0) - self.previous[0], expected(1) - self.previous[1]];
        x * x + y * y
    }
}

impl ReprojectionMatrix {
    fn new(n: &Parameters, nearest: f64, size: [usize; 2]) -> Option<Self> {
        // With A for the 3x3 part and k for the column of the inverse depth, A (x, y, 1) + k q = s (u, v, 1), and q = s
        // r with the inverse depth r in the previous anchor. Hence (x, y, 1) = s A^-1 ((u, v, 1) - k r).
        let a = [[1.0 + n[0], n[1], n[2]], [n[4], 1.0 + n[5], n[6]], [n[8], n[9], 1.0]];
        let minor = |i: usize, j: usize| {
            let [i, j] = [[(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]];
            a[i[0]][j[0]] * a[i[1]][j[1]] - a[i[0]][j[1]] * a[i[1]][j[0]]
        };
        let determinant = a[0][0] * minor(0, 0) + a[0][1] * minor(0, 1) + a[0][2] * minor(0, 2);
        let k = [n[3], n[7], n[10]].map(|v| v / nearest);
        let rows = [0, 1, 2].map(|i| {
            let row = [0, 1, 2].map(|j| minor(j, i) / determinant);
            let per_inverse_depth = -(row[0] * k[0] + row[1] * k[1] + row[2] * k[2]);
            [row[0], row[1], row[2], per_inverse_depth].map(|v| v as f32)
        });
        let is_finite = rows.iter().flatten().all(|v| v.is_finite());
        is_finite.then_some(Self { rows, centre: size.map(|len| centre(len) as f32), width: size[0] as f32 })
    }

    /// Position in the current anchor of the static point at a pixel of the previous one, its inverse depth there, and
    /// whether the result is valid.
    #[inline(always)]
    pub(super) fn project(&self, [u, v]: [f32; 2], inverse_depth: f32) -> ([f32; 2], f32, bool) {
        let [u, v] = [(u - self.centre[0]) / self.width, (v - self.centre[1]) / self.width];
        let along = |row: [f32; 4]| (row[0] * u + row[1] * v) + (row[2] + row[3] * inverse_depth);
        let [x, y, z] = [along(self.rows[0]), along(self.rows[1]), along(self.rows[2])];
        let at = [x / z * self.width + self.centre[0], y / z * self.width + self.centre[1]];
        // Points behind the camera, or more than four times as near as before, are invalid.
        (at, inverse_depth / z, z > 0.25)
    }
}

impl CameraFit {
    /// Fits the camera to a guidance, without static pixels.
    pub(super) fn fit(guidance: &Guidance, static_mask: &StaticMask<'_>) -> Self {
        let (width, height) = (guidance.motion().width() as usize, guidance.motion().height() as usize);
        if width < SAMPLE_GRID[0] || height < SAMPLE_GRID[1] {
            return Self::default();
        }
        let mut all_samples = [Sample::default(); SAMPLE_GRID[0] * SAMPLE_GRID[1]];
        let (mut count, mut nearest, mut farthest) = (0, 0.0_f64, 1.0_f64);
        let size = [width, height];
        for number in 0..all_samples.len() {
            let cell = [number % SAMPLE_GRID[0], number / SAMPLE_GRID[0]];
            let at = [0, 1].map(|c| (2 * cell[c] + 1) * size[c] / (2 * SAMPLE_GRID[c]));
            if static_mask.is_static(at) {
                continue;
            }
            if let Some(sample) = sample(guidance, at) {
                (nearest, farthest) = (nearest.max(sample.inverse_depth), farthest.min(sample.inverse_depth));
                (all_samples[count], count) = (sample, count + 1);
            }
        }
        let samples = &mut all_samples[..count];
        if samples.len() * 2 < SAMPLE_GRID[0] * SAMPLE_GRID[1] {
            return Self::default();
        }
        // Without depth, forward motion cannot be told from a zoom.
        let has_depth = farthest < 0.75 * nearest;
        samples
            .iter_mut()
            .for_each(|sample| sample.inverse_depth = if has_depth { sample.inverse_depth / nearest } else { 0.0 });
        let Some(parameters) = ransac(samples, INLIER_DISTANCE / width as f64) else { return Self::default() };

        let bound = (INLIER_DISTANCE / width as f64).powi(2);
        let changes = samples.iter().filter(|s| s.squared_error(&parameters) <= bound).map(|s| s.change(&parameters));
        let [min, max] = changes.fold([0.0_f64; 2], |[min, max], v| [min.min(v), max.max(v)]);
        let [min, max] =
            [1.25 * min - 0.02, 1.25 * max + 0.02].map(|v| v.clamp(CHANGE_RANGE[0], CHANGE_RANGE[1]) as f32);
        let slope = [parameters[8], parameters[9]].map(|v| v / width as f64);
        let depth_change = DepthChange {
            inverse_depth: if has_depth { (parameters[10] / nearest) as f32 } else { 0.0 },
            slope: slope.map(|v| v as f32),
            origin: (-slope[0] * centre(width) - slope[1] * centre(height)) as f32,
            min,
            max,
        };
        let reprojection = if has_depth { ReprojectionMatrix::new(&parameters, nearest, size) } else { None };
        Self { depth_change, reprojection }
    }
}

fn centre(len: usize) -> f64 {
    (len - 1) as f64 / 2.0
}

/// The sample at a pixel. With tiled guidance its position is the tile's centre.
fn sample(guidance: &Guidance, [x, y]: [usize; 2]) -> Option<Sample> {
    let (motion, map) = (guidance.motion(), guidance.depth());
    let vector = motion.at(x as u32, y as u32).map(|v| f64::from(v.to_f32()));
    let tile = map.tile() as usize;
    let depth = map.depth()[y / tile * map.columns() as usize + x / tile];
    if !(vector[0].is_finite() && vector[1].is_finite() && (0.0..=1.0).contains(&depth)) {
        return None;
    }
    let side = motion.tile() as usize;
    let [width, height] = [motion.width(), motion.height()].map(|len| len as usize);
    let center = |at: usize, len: usize| (at / side * side) as f64 + (side - 1) as f64 / 2.0 - centre(len);
    let at = [center(x, width), center(y, height)];
    let previous = [at[0] + vector[0], at[1] + vector[1]];
    let in_widths = |v: [f64; 2]| v.map(|v| v / width as f64);
    Some(Sample { current: in_widths(at), previous: in_widths(previous), inverse_depth: f64::from(1.0 - depth) })
}

/// Parameters with the most inliers, if columns are at least half of the samples.
fn ransac(samples: &[Sample], within: f64) -> Option<Parameters> {
    let bound = within * within;
    let inliers =
        |parameters: &Parameters| samples.iter().filter(|sample| sample.squared_error(parameters) <= bound).count();
    let mut best = least_squares(samples.iter())?;
    let mut most_inliers = inliers(&best);
    for numbers in RANDOM.chunks_exact(TRIAL_SAMPLES) {
        if 10 * most_inliers >= 9 * samples.len() {
            break;
        }
        let subset: [Sample; TRIAL_SAMPLES] = std::array::from_fn(|n| samples[numbers[n] as usize % samples.len()]);
        let Some(trial) = least_squares(subset.iter()) else { continue };
        let count = inliers(&trial);
        if count > most_inliers {
            (best, most_inliers) = (trial, count);
        }
    }
    for _ in 0..REFITS {
        best = least_squares(samples.iter().filter(|sample| sample.squared_error(&best) <= bound))?;
    }
    (2 * inliers(&best) >= samples.len()).then_some(best)
}

/// Least-squares fit: normal equations, solved by Cholesky decomposition.
fn least_squares<'a>(samples: impl Iterator<Item = &'a Sample>) -> Option<Parameters> {
    let mut matrix = [[0.0; PARAMETERS]; PARAMETERS];
    let mut right = [0.0; PARAMETERS];
    for sample in samples {
        for component in 0..2 {
            let (coefficients, right_hand_side) = sample.equation(component);
            let columns = || (4 * component..4 * component + 4).chain(8..PARAMETERS);
            for i in columns() {
                columns().take_while(|&j| j <= i).for_each(|j| matrix[i][j] += coefficients[i] * coefficients[j]);
                right[i] += coefficients[i] * right_hand_side;
            }
        }
    }
    for i in 0..PARAMETERS {
        matrix[i][i] += REGULARISATION;
        for j in 0..=i {
            let sum = (0..j).fold(matrix[i][j], |sum, k| sum - matrix[i][k] * matrix[j][k]);
            matrix[i][j] = if i == j { sum.sqrt() } else { sum / matrix[j][j] };
        }
        let sum = (0..i).fold(right[i], |sum, k| sum - matrix[i][k] * right[k]);
        right[i] = sum / matrix[i][i];
    }
    for i in (0..PARAMETERS).rev() {
        let sum = (i + 1..PARAMETERS).fold(right[i], |sum, k| sum - matrix[k][i] * right[k]);
        right[i] = sum / matrix[i][i];
    }
    right.iter().all(|v| v.is_finite()).then_some(right)
}

#[cfg(test)]
pub(super) mod tests {
    use half::f16;

    use super::super::splat_key::{self, Key, PHASE_ONE};
    use super::super::warp::{Warp, WarpTime};
    use super::*;
    use crate::guidance::{DepthMap, MotionField, MotionOrigin, paper};

    pub(in super::super) const SIZE: [u32; 2] = [320, 180];
    /// Focal length, in pixels.
    const FOCAL: f64 = 200.0;
    const NEAR: f64 = 0.1;

    /// Position at phase t, in pixels, of a point in the current camera's space, for a camera that moves forward and
    /// turns.
    pub(in super::super) fn project([x, y, z]: [f64; 3], t: f64) -> [f64; 2] {
        // A small-angle rotation, linear in time.
        let (turn, ahead, aside) = (0.05, 0.12, 0.04);
        let previous = [x + turn * z + aside, y, z - turn * x + ahead];
        let at = |c: usize| previous[c] + ([x, y, z][c] - previous[c]) * t;
        [centre(SIZE[0] as usize) + FOCAL * at(0) / at(2), centre(SIZE[1] as usize) + FOCAL * at(1) / at(2)]
    }

    /// Point that a pixel of the current anchor shows: ground, and two posts on it.
    pub(in super::super) fn surface_point(x: f64, y: f64) -> [f64; 3] {
        let ray = [(x - centre(SIZE[0] as usize)) / FOCAL, (y - centre(SIZE[1] as usize)) / FOCAL];
        let ground = if ray[1] > 0.02 { 1.6 / ray[1] } else { 80.0 };
        let z = match x as u32 {
            40..70 => ground.min(4.0),
            200..220 => ground.min(2.5),
            _ => ground,
        };
        [ray[0] * z, ray[1] * z, z]
    }

    pub(in super::super) fn guidance(motion: impl Fn(f64, f64) -> ([f64; 2], f64), tile: u32) -> Guidance {
        let mut vectors = MotionField::tiled(SIZE[0], SIZE[1], tile).unwrap();
        let mut depths = DepthMap::tiled(SIZE[0], SIZE[1], tile, paper::PROJECTION).unwrap();
        let columns = vectors.columns();
        for i in 0..vectors.vectors().len() {
            let [x, y] =
                [i as u32 % columns, i as u32 / columns].map(|v| f64::from(v * tile) + f64::from(tile - 1) / 2.0);
            let (vector, depth) = motion(x, y);
            vectors.vectors_mut()[i] = vector.map(f16::from_f64);
            depths.depth_mut()[i] = depth as f32;
        }
        Guidance::from_parts(vectors, depths, MotionOrigin::Geometry).unwrap()
    }

    /// Motion and depth of the static world.
    pub(in super::super) fn walk(x: f64, y: f64) -> ([f64; 2], f64) {
        let point = surface_point(x, y);
        let previous = project(point, 0.0);
        ([previous[0] - x, previous[1] - y], 1.0 - NEAR / point[2])
    }

    pub(in super::super) fn key_of((vector, depth): ([f64; 2], f64)) -> Key {
        let depth_key = u16::MAX - ((((1.0 - depth) as f32).to_bits() - (103 << 23)) >> 12) as u16;
        splat_key::pack(depth_key, 0, vector.map(|v| (64.0 * v).round() as i32))
    }

    /// Largest error of the warp of static pixels, in pixels, for phases up to 2.
    fn worst(depth_change: DepthChange) -> f64 {
        let mut worst = 0.0_f64;
        for (x, y) in (0..180).step_by(9).flat_map(|y| (0..320).step_by(7).map(move |x| (x, y))) {
            let at = [f64::from(x), f64::from(y)];
            let (vector, depth) = walk(at[0], at[1]);
            for phase in [PHASE_ONE / 4, PHASE_ONE / 2, 3 * PHASE_ONE / 4, 3 * PHASE_ONE / 2] {
                let warp = Warp::from_current(WarpTime::new(phase, depth_change));
                let fraction = f64::from(warp.fraction(key_of((vector, depth)), [x, y])) / f64::from(PHASE_ONE);
                let truth = project(surface_point(at[0], at[1]), f64::from(phase) / f64::from(PHASE_ONE));
                (0..2).for_each(|c| worst = worst.max((at[c] + fraction * vector[c] - truth[c]).abs()));
            }
        }
        worst
    }

    #[test]
    fn a_walk_with_a_turn_is_fitted() {
        let linear = worst(DepthChange::default());
        assert!(linear > 0.5, "{linear}");
        for tile in [1, 8] {
            let found = worst(CameraFit::fit(&guidance(walk, tile), &StaticMask::default()).depth_change);
            assert!(found < 0.05 * linear, "{found} of {linear}, tiles of {tile}");
        }
    }

    #[test]
    fn objects_that_move_on_their_own_or_with_the_camera_are_outliers() {
        let motion = |x: f64, y: f64| match (x as u32, y as u32) {
            (180.., 110..) => ([0.0; 2], 0.3),
            (90..150, 70..120) => ([9.0, -3.0], 0.98),
            _ => walk(x, y),
        };
        let (found, linear) = (
            worst(CameraFit::fit(&guidance(motion, 1), &StaticMask::default()).depth_change),
            worst(DepthChange::default()),
        );
        assert!(found < 0.1 * linear, "{found} of {linear}");
    }

    #[test]
    fn motion_without_a_camera_fit_is_linear() {
        let any = |x: f64, y: f64| f64::from((x as u32 * 7919 + y as u32 * 104_729) % 257) / 16.0;
        let wild = guidance(|x, y| ([any(x, y), any(y, x)], 1.0 - 0.1 / (1.0 + any(x + 3.0, y))), 1);
        assert_eq!(CameraFit::fit(&wild, &StaticMask::default()).depth_change, DepthChange::default());
        let nothing = guidance(|_, _| ([f64::NAN, f64::INFINITY], f64::NAN), 1);
        assert_eq!(CameraFit::fit(&nothing, &StaticMask::default()).depth_change, DepthChange::default());
        // Without depth, a zoom may be content.
        let growing = guidance(|x, y| ([0.05 * (160.0 - x), 0.05 * (90.0 - y)], 0.5), 1);
        let time = WarpTime::new(PHASE_ONE / 2, CameraFit::fit(&growing, &StaticMask::default()).depth_change);
        assert!(
            [[0, 0], [319, 0], [160, 179]]
                .iter()
                .all(|&at| (time.phase(key_of(([0.0; 2], 0.5)), at) - PHASE_ONE / 2).abs() <= 4)
        );
    }

    #[test]
    fn warps_to_the_anchors_are_exact_and_fractions_bounded() {
        let depth_change = CameraFit::fit(&guidance(walk, 1), &StaticMask::default()).depth_change;
        for phase in [0, 1, PHASE_ONE / 3, PHASE_ONE, 2 * PHASE_ONE] {
            let warp = Warp::from_current(WarpTime::new(phase, depth_change));
            let [min, max] = warp.fraction_bounds();
            assert!(2 * PHASE_ONE > max && min >= 2 - 2 * PHASE_ONE, "{min}..={max}");
            for (depth_key, x, y) in
                [(0, 0, 0), (16_383, 319, 0), (30_000, 0, 179), (50_000, 100, 90), (u16::MAX, -9000, 9000)]
            {
                let fraction = warp.fraction(splat_key::pack(depth_key, 0, [0; 2]), [x, y]);
                assert!((min..=max).contains(&fraction));
                if phase % PHASE_ONE == 0 && phase <= PHASE_ONE {
                    assert_eq!(fraction, PHASE_ONE - phase);
                }
            }
        }
    }
}
