//! A linear classifier of pictures: ridge regression of class indicators on features, a "linear probe".
//!
//! Ridge regression has a closed form, so that the classifier depends on its data only. Features are standardised first.

use cairn::{Error, ErrorKind, Result};

/// Weight of the penalty, in units of the variance of a standardised feature.
const PENALTY: f64 = 1e-2;

/// A trained classifier.
#[derive(Debug, Clone)]
pub(super) struct Probe {
    mean: Vec<f32>,
    /// Reciprocal standard deviation of each feature; 0 for a constant one.
    scale: Vec<f32>,
    /// A row for each class: a weight for each feature, then the bias.
    rows: Vec<Vec<f32>>,
}

impl Probe {
    /// Trains on pairs of features and class, 0 to `classes` - 1.
    ///
    /// # Errors
    /// `InvalidState` without data, or if the features are not finite.
    pub(super) fn train(features: &[&[f32]], labels: &[usize], classes: usize) -> Result<Self> {
        let (count, width) = (features.len(), features.first().map_or(0, |f| f.len()));
        let unusable = || Error::new(ErrorKind::InvalidState, "a classifier cannot be trained on these features");
        if count == 0 || width == 0 || labels.len() != count {
            return Err(unusable());
        }
        let (mean, scale) = standardisation(features, width);
        let mut data = vec![0.0_f32; count * width];
        for (row, features) in data.chunks_exact_mut(width).zip(features) {
            standardise(features, &mean, &scale, row);
        }
        // The bias is the mean of the indicators, because standardised features have mean 0.
        let bias: Vec<f32> = (0..classes)
            .map(|class| labels.iter().filter(|label| **label == class).count() as f32 / count as f32)
            .collect();
        let mut gram = vec![0.0_f32; width * width];
        product(&data, &data, count, width, width, &mut gram);
        let mut target = vec![0.0_f32; count * classes];
        for (row, label) in target.chunks_exact_mut(classes).zip(labels) {
            row.iter_mut().zip(&bias).enumerate().for_each(|(class, (out, mean))| {
                *out = f32::from(u8::from(class == *label)) - mean;
            });
        }
        let mut right = vec![0.0_f32; width * classes];
        product(&data, &target, count, width, classes, &mut right);
        let mut matrix: Vec<f64> = gram.iter().map(|value| f64::from(*value)).collect();
        for i in 0..width {
            matrix[i * width + i] += PENALTY * count as f64;
        }
        cholesky(&mut matrix, width).ok_or_else(unusable)?;
        let rows = (0..classes).map(|class| {
            let mut solved: Vec<f64> = (0..width).map(|i| f64::from(right[i * classes + class])).collect();
            solve(&matrix, width, &mut solved);
            solved.iter().map(|weight| *weight as f32).chain([bias[class]]).collect()
        });
        let rows = rows.collect();
        Ok(Self { mean, scale, rows })
    }

    /// The class of a picture with these features.
    pub(super) fn classify(&self, features: &[f32]) -> usize {
        let mut standard = vec![0.0; features.len()];
        standardise(features, &self.mean, &self.scale, &mut standard);
        let score = |row: &[f32]| {
            let (bias, weights) = row.split_last().expect("every row has a bias");
            weights.iter().zip(&standard).map(|(w, x)| w * x).sum::<f32>() + bias
        };
        let scores = self.rows.iter().map(|row| score(row)).enumerate();
        scores.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(class, _)| class)
    }
}

/// Mean and reciprocal standard deviation of each feature.
fn standardisation(features: &[&[f32]], width: usize) -> (Vec<f32>, Vec<f32>) {
    let count = features.len() as f64;
    let (mut sum, mut squares) = (vec![0.0_f64; width], vec![0.0_f64; width]);
    for row in features {
        for (i, value) in row.iter().enumerate() {
            sum[i] += f64::from(*value);
            squares[i] += f64::from(*value).powi(2);
        }
    }
    let mean: Vec<f64> = sum.iter().map(|sum| sum / count).collect();
    let scale = squares.iter().zip(&mean).map(|(squares, mean)| {
        let variance = squares / count - mean * mean;
        if variance > 1e-12 { (1.0 / variance.sqrt()) as f32 } else { 0.0 }
    });
    (mean.iter().map(|mean| *mean as f32).collect(), scale.collect())
}

fn standardise(features: &[f32], mean: &[f32], scale: &[f32], out: &mut [f32]) {
    for (out, ((value, mean), scale)) in out.iter_mut().zip(features.iter().zip(mean).zip(scale)) {
        *out = (value - mean) * scale;
    }
}

/// `out` = transpose of `a` (`rows` x `m`) times `b` (`rows` x `n`); all row by row.
fn product(a: &[f32], b: &[f32], rows: usize, m: usize, n: usize, out: &mut [f32]) {
    assert!(a.len() == rows * m && b.len() == rows * n && out.len() == m * n, "the sizes of the matrices");
    // SAFETY: strides and sizes describe the slices, as asserted.
    unsafe {
        matrixmultiply::sgemm(
            m,
            rows,
            n,
            1.0,
            a.as_ptr(),
            1,
            m as isize,
            b.as_ptr(),
            n as isize,
            1,
            0.0,
            out.as_mut_ptr(),
            n as isize,
            1,
        );
    }
}

/// Replaces a symmetric positive definite matrix by its lower Cholesky factor; `None` if it is not one.
fn cholesky(matrix: &mut [f64], width: usize) -> Option<()> {
    for i in 0..width {
        for j in 0..=i {
            let (of_i, of_j) = (&matrix[i * width..i * width + j], &matrix[j * width..j * width + j]);
            let rest = matrix[i * width + j] - of_i.iter().zip(of_j).map(|(a, b)| a * b).sum::<f64>();
            if i == j {
                if rest.is_nan() || rest <= 0.0 {
                    return None;
                }
                matrix[i * width + i] = rest.sqrt();
            } else {
                matrix[i * width + j] = rest / matrix[j * width + j];
            }
        }
    }
    Some(())
}

/// Solves a system given by its lower Cholesky factor, in place.
fn solve(factor: &[f64], width: usize, out: &mut [f64]) {
    for i in 0..width {
        let known: f64 = (0..i).map(|j| factor[i * width + j] * out[j]).sum();
        out[i] = (out[i] - known) / factor[i * width + i];
    }
    for i in (0..width).rev() {
        let known: f64 = (i + 1..width).map(|j| factor[j * width + i] * out[j]).sum();
        out[i] = (out[i] - known) / factor[i * width + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of a class: noise, one constant, and a shift in two directions.
    fn drawn(class: usize, number: u32) -> Vec<f32> {
        let mut state = number.wrapping_mul(747_796_405).wrapping_add(class as u32 * 97 + 1);
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let shift = [[0.0, 0.0], [0.9, 0.0], [0.0, 0.9]][class];
        vec![100.0 + shift[0] + noise(), 7.0, 0.01 * (shift[1] + noise()), noise()]
    }

    #[test]
    fn classes_that_a_plane_separates_are_told_apart() {
        let data: Vec<Vec<f32>> = (0..600).map(|n| drawn(n as usize % 3, n)).collect();
        let labels: Vec<usize> = (0..600).map(|n| n % 3).collect();
        let features: Vec<&[f32]> = data.iter().map(Vec::as_slice).collect();
        let probe = Probe::train(&features, &labels, 3).unwrap();
        let right = (1000..1600_u32).filter(|n| probe.classify(&drawn(*n as usize % 3, *n)) == *n as usize % 3).count();
        assert!(right > 530, "{right} of 600 are right");
        // Labels at random cannot be learnt.
        let shuffled: Vec<usize> = (0..600).map(|n| (n * 7919 / 13) % 3).collect();
        let probe = Probe::train(&features, &shuffled, 3).unwrap();
        let right = (1000..1600_u32).filter(|n| probe.classify(&drawn(*n as usize % 3, *n)) == *n as usize % 3).count();
        assert!((100..320).contains(&right), "{right} of 600 are right with random labels");
    }

    #[test]
    fn no_data_and_no_numbers_are_refused() {
        assert!(Probe::train(&[], &[], 2).is_err());
        let data = [[f32::NAN, 1.0], [0.0, 1.0]];
        assert!(Probe::train(&[&data[0][..], &data[1][..]], &[0, 1], 2).is_err());
    }

    #[test]
    fn a_system_is_solved() {
        // [[4, 2], [2, 3]] x = [2, 5] has the solution [-0.5, 2].
        let mut matrix = vec![4.0, 2.0, 2.0, 3.0];
        cholesky(&mut matrix, 2).unwrap();
        let mut found = [2.0, 5.0];
        solve(&matrix, 2, &mut found);
        assert!((found[0] + 0.5).abs() < 1e-12 && (found[1] - 2.0).abs() < 1e-12, "{found:?}");
        assert!(cholesky(&mut [1.0, 2.0, 2.0, 1.0], 2).is_none());
    }
}
