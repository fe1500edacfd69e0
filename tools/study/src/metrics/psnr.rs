//! Peak signal-to-noise ratio.

use cairn::{Picture, Result};
use multiversion::multiversion;
use rayon::prelude::*;

use super::same_size;

/// Pixels per task: enough to outweigh the overhead, and few enough that a sum of squares fits 32 bits.
const TASK: usize = 16_384;

/// Peak signal-to-noise ratio in dB: `10 log10(255^2 / e)` with `e` from [`mean_squared_error`].
///
/// Positive infinity for equal pictures, and at least 0 (black against white).
///
/// # Errors
/// `InvalidArgument` for pictures of different sizes.
pub fn psnr(truth: &Picture, picture: &Picture) -> Result<f64> {
    // For equal pictures the division by zero gives infinity, as intended.
    mean_squared_error(truth, picture).map(|error| 10.0 * (255.0 * 255.0 / error).log10())
}

/// Mean squared difference over all pixels and R, G and B, in squared 8-bit steps: 0 to 65025. Exact except for the final division.
///
/// # Errors
/// `InvalidArgument` for pictures of different sizes.
pub fn mean_squared_error(truth: &Picture, picture: &Picture) -> Result<f64> {
    same_size(truth, picture)?;
    let (a, b) = (truth.pixels(), picture.pixels());
    let sum: u64 = a.par_chunks(TASK).zip(b.par_chunks(TASK)).map(|(a, b)| squares(a, b)).sum();
    Ok(sum as f64 / (3.0 * a.len() as f64))
}

/// Sum of the squared differences of at most [`TASK`] pixels: at most 16384 * 3 * 255^2, which is below 2^32.
#[multiversion(targets("x86_64+avx2"))]
fn squares(a: &[[u8; 4]], b: &[[u8; 4]]) -> u64 {
    let mut sum = 0u32;
    for (a, b) in a.iter().zip(b) {
        // Alpha is masked rather than skipped, because four equal bytes vectorise.
        let difference = |c: usize, mask: i32| {
            let d = (i32::from(a[c]) - i32::from(b[c])) & mask;
            (d * d) as u32
        };
        sum += difference(0, -1) + difference(1, -1) + difference(2, -1) + difference(3, 0);
    }
    u64::from(sum)
}

#[cfg(test)]
mod tests {
    use cairn::ErrorKind;

    use super::*;

    fn flat(width: u32, height: u32, rgba: [u8; 4]) -> Picture {
        let mut picture = Picture::new(width, height).unwrap();
        picture.pixels_mut().fill(rgba);
        picture
    }

    #[test]
    fn black_against_white_is_nil_and_equal_is_infinite() {
        let (black, white) = (flat(301, 203, [0, 0, 0, 255]), flat(301, 203, [255; 4]));
        assert_eq!(psnr(&black, &white).unwrap(), 0.0);
        assert_eq!(psnr(&black, &black).unwrap(), f64::INFINITY);
        assert_eq!(mean_squared_error(&black, &white).unwrap(), 65_025.0);
    }

    #[test]
    fn one_step_everywhere_is_48_13_db_and_alpha_counts_nothing() {
        let (a, b) = (flat(64, 48, [9, 9, 9, 0]), flat(64, 48, [10, 8, 10, 255]));
        assert_eq!(mean_squared_error(&a, &b).unwrap(), 1.0);
        assert!((psnr(&a, &b).unwrap() - 48.130_803_608_679).abs() < 1e-12);
    }

    #[test]
    fn one_channel_of_one_pixel_is_a_third_of_its_share() {
        let (a, mut b) = (flat(10, 10, [0; 4]), flat(10, 10, [0; 4]));
        b.pixels_mut()[99] = [0, 0, 30, 0];
        assert_eq!(mean_squared_error(&a, &b).unwrap(), 3.0);
    }

    #[test]
    fn other_sizes_are_refused() {
        let error = psnr(&flat(4, 6, [0; 4]), &flat(6, 4, [0; 4])).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("size")));
    }
}
