//! Global motion model: one parametric motion for the whole picture.
//!
//! The motion of a plane before a camera that moves and turns, to first order in time (Longuet-Higgins and Prazdny 1980):
//!
//! ```text
//! u = a0 + a1 x + a2 y + a6 x^2 + a7 x y
//! v = a3 + a4 x + a5 y + a6 x y + a7 y^2
//! ```
//!
//! A pure camera rotation has exactly this form. The model is only one more start for the search: where texture repeats or motion is
//! long, a patch finds its motion only from a start near it.

/// Parameters of the model.
const N: usize = 8;
/// Reciprocal of the squared residual scale of each reweighting round, in 1/px²: samples with larger residuals lose weight.
const INVERSE_SQUARED_SCALES: [f32; 5] = [0.0, 0.25, 1.0, 4.0, 4.0];
/// Regularisation: this fraction of the mean diagonal is added to the diagonal, so that little data still gives a model.
const RIDGE: f32 = 1e-5;
/// Samples are summed in this many parts, and then the parts: the order in which the shader's threads sum.
const PARTS: usize = 64;
/// Different sums of the normal equations: 13 of the matrix and 8 of the right side.
const SUMS: usize = MATRIX_SUMS + N;

#[cfg(test)]
crate::shader_constants::shader_constants!("MODEL_": uint N, float RIDGE, uint PARTS, uint SUMS);

const MATRIX_SUMS: usize = 13;
/// For each entry of the upper half of the matrix its sum; [`ZERO`] where it is 0.
const ENTRIES: [[usize; N]; N] = [
    [0, 1, 2, ZERO, ZERO, ZERO, 3, 4],
    [ZERO, 3, 4, ZERO, ZERO, ZERO, 6, 7],
    [ZERO, ZERO, 5, ZERO, ZERO, ZERO, 7, 8],
    [ZERO, ZERO, ZERO, 0, 1, 2, 4, 5],
    [ZERO, ZERO, ZERO, ZERO, 3, 4, 7, 8],
    [ZERO, ZERO, ZERO, ZERO, ZERO, 5, 8, 9],
    [ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, 10, 11],
    [ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, 12],
];
const ZERO: usize = SUMS;

/// A motion for every position in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionModel {
    coefficients: [f32; N],
    /// Origin of x and y: the picture's centre, in pixels.
    centre: [f32; 2],
    /// Scale from pixels to x and y.
    unit: f32,
}

/// Motion measured at one position.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sample {
    /// In pixels.
    pub(super) position: [f32; 2],
    /// In pixels.
    pub(super) flow: [f32; 2],
    pub(super) weight: f32,
}

impl MotionModel {
    /// The model that most `samples` agree on, in a picture of `size` pixels. Iteratively reweighted least squares. `None` if the
    /// samples carry no weight or are not finite.
    ///
    /// All operations are those of `flow_fit.hlsl`, in the same order: where the match is poor, starts that differ in the last bit lead
    /// patches to different motion.
    pub(super) fn fit(samples: &[Sample], size: [f32; 2]) -> Option<Self> {
        let mut model =
            Self { coefficients: [0.0; N], centre: size.map(|s| 0.5 * s), unit: 2.0 / size[0].max(size[1]) };
        for inverse in INVERSE_SQUARED_SCALES {
            let mut parts = [[0.0; SUMS]; PARTS];
            for samples in samples.chunks(PARTS) {
                samples.iter().zip(&mut parts).for_each(|(sample, part)| model.add(sample, inverse, part));
            }
            let mut sums = [0.0; SUMS];
            for part in parts {
                sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            }
            model.coefficients = solve(&sums)?;
        }
        Some(model)
    }

    /// Adds a sample to the sums of the normal equations.
    #[inline(always)]
    fn add(&self, sample: &Sample, inverse: f32, sums: &mut [f32; SUMS]) {
        let ([u, v], [model_u, model_v]) = (sample.flow, self.at(sample.position));
        let apart = [u - model_u, v - model_v];
        let off = 1.0 + (apart[0] * apart[0] + apart[1] * apart[1]) * inverse;
        let weight = sample.weight / (off * off);
        let [x, y] = self.relative(sample.position);
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let square = xx + yy;
        let matrix = [1.0, x, y, xx, xy, yy, x * xx, x * xy, x * yy, y * yy, xx * square, xy * square, yy * square];
        let right = [u, x * u, y * u, v, x * v, y * v, xx * u + xy * v, xy * u + yy * v];
        let (of_matrix, of_right) = sums.split_at_mut(MATRIX_SUMS);
        of_matrix.iter_mut().zip(matrix).for_each(|(sum, term)| *sum += weight * term);
        of_right.iter_mut().zip(right).for_each(|(sum, term)| *sum += weight * term);
    }

    /// Motion at a position in pixels.
    pub(super) fn at(&self, position: [f32; 2]) -> [f32; 2] {
        let ([x, y], a) = (self.relative(position), &self.coefficients);
        let bend = a[6] * x + a[7] * y;
        [a[0] + a[1] * x + a[2] * y + bend * x, a[3] + a[4] * x + a[5] * y + bend * y]
    }

    /// The same motion in a picture of twice the size.
    pub(super) fn doubled(&self) -> Self {
        Self {
            coefficients: self.coefficients.map(|a| 2.0 * a),
            centre: self.centre.map(|m| 2.0 * m),
            unit: 0.5 * self.unit,
        }
    }

    fn relative(&self, position: [f32; 2]) -> [f32; 2] {
        [0, 1].map(|axis| (position[axis] - self.centre[axis]) * self.unit)
    }
}

/// Solves the positive definite system of these sums; `None` if it is singular or not finite.
fn solve(sums: &[f32; SUMS]) -> Option<[f32; N]> {
    let mut matrix = ENTRIES.map(|row| row.map(|entry| sums.get(entry).copied().unwrap_or(0.0)));
    let mut right: [f32; N] = std::array::from_fn(|i| sums[MATRIX_SUMS + i]);
    let ridge = RIDGE / N as f32 * (0..N).map(|i| matrix[i][i]).fold(0.0, |sum, v| sum + v);
    for i in 0..N {
        matrix[i][i] += ridge;
        // Written so that NaN is refused as well.
        let is_known = matrix[i][i] > 0.0;
        if !is_known {
            return None;
        }
        let pivot = matrix[i];
        for (j, row) in matrix.iter_mut().enumerate().skip(i + 1) {
            let part = pivot[j] / pivot[i];
            for (value, above) in row.iter_mut().zip(pivot).skip(j) {
                *value -= part * above;
            }
            right[j] -= part * right[i];
        }
    }
    for i in (0..N).rev() {
        for j in i + 1..N {
            right[i] -= matrix[i][j] * right[j];
        }
        right[i] /= matrix[i][i];
    }
    right.iter().all(|v| v.is_finite()).then_some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Motion of a plane seen by a camera that pans right, tilts up and rolls, from the analytic formula.
    fn turning([x, y]: [f32; 2]) -> [f32; 2] {
        let (x, y) = ((x - 80.0) / 80.0, (y - 45.0) / 80.0);
        [12.0 + 2.0 * x - 1.5 * y + 5.0 * x * x - 3.0 * x * y, -4.0 + 1.5 * x + 3.0 * y + 5.0 * x * y - 3.0 * y * y]
    }

    fn samples(flow: impl Fn(usize, [f32; 2]) -> [f32; 2]) -> Vec<Sample> {
        let positions = (0..200).map(|k| [(k % 20) as f32 * 8.0 + 4.0, (k / 20) as f32 * 9.0 + 4.5]);
        positions.enumerate().map(|(k, position)| Sample { position, flow: flow(k, position), weight: 1.0 }).collect()
    }

    fn worst(model: &MotionModel, truth: impl Fn([f32; 2]) -> [f32; 2]) -> f32 {
        let off = |sample: &Sample| {
            let ([u, v], [tu, tv]) = (model.at(sample.position), truth(sample.position));
            (u - tu).hypot(v - tv)
        };
        samples(|_, position| position).iter().map(off).fold(0.0, f32::max)
    }

    #[test]
    fn the_camera_motion_is_fitted_although_a_part_moves_differently() {
        let model = MotionModel::fit(&samples(|_, position| turning(position)), [160.0, 90.0]).unwrap();
        assert!(worst(&model, turning) < 0.01);
        let held = |k: usize| (7..17).contains(&(k % 20)) && k / 20 >= 5;
        let other = samples(|k, position| if held(k) { [-9.0, 7.0] } else { turning(position) });
        let model = MotionModel::fit(&other, [160.0, 90.0]).unwrap();
        assert!(worst(&model, turning) < 0.1, "off by {} px", worst(&model, turning));
        // Twice the size: the same motion.
        let doubled = model.doubled();
        for position in [[3.0, 5.0], [120.0, 80.0]] {
            let (one, two) = (model.at(position), doubled.at(position.map(|p| 2.0 * p)));
            assert!((2.0 * one[0] - two[0]).abs() < 1e-4 && (2.0 * one[1] - two[1]).abs() < 1e-4);
        }
    }

    #[test]
    fn zero_motion_is_fitted_exactly_and_no_data_gives_no_model() {
        let model = MotionModel::fit(&samples(|_, _| [0.0; 2]), [160.0, 90.0]).unwrap();
        assert_eq!(model.at([17.0, 80.0]), [0.0; 2]);
        assert!(MotionModel::fit(&[], [160.0, 90.0]).is_none());
        assert!(MotionModel::fit(&[Sample { weight: 0.0, ..Sample::default() }], [160.0, 90.0]).is_none());
        assert!(MotionModel::fit(&samples(|_, _| [f32::NAN; 2]), [160.0, 90.0]).is_none());
        // One sample is enough for a model.
        let one = [Sample { position: [80.0, 45.0], flow: [3.0, 1.0], weight: 1.0 }];
        let [u, v] = MotionModel::fit(&one, [160.0, 90.0]).unwrap().at([80.0, 45.0]);
        assert!((u - 3.0).abs() < 0.01 && (v - 1.0).abs() < 0.01, "{u} {v}");
    }
}
