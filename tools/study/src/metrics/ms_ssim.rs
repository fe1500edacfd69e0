//! Structural similarity at five scales.
//!
//! Wang, Simoncelli and Bovik, "Multi-scale Structural Similarity for Image Quality Assessment", Asilomar Conference on Signals,
//! Systems and Computers, 2003: equation 7 with the exponents of its section 3.2.

use cairn::{Error, ErrorKind, Picture, Result};
use rayon::prelude::*;

use super::same_size;
use super::ssim::{Maps, Means, means, means_of};

/// Exponents of contrast and structure, from the finest scale; the last also applies to luminance.
const EXPONENTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// The smallest width and height: the window must fit at a sixteenth of the size, with halves rounded up.
pub const MS_SSIM_SIDE: u32 = 161;

/// One channel after another.
struct Planes {
    size: [usize; 2],
    channels: [Vec<f32>; 3],
}

/// Structural similarity at five scales, each half the size of the previous one: the mean over red, green and blue.
///
/// Equal up to rounding to TensorFlow's `image.ssim_multiscale(truth, picture, max_val=255)`, which follows the authors' own program: a pixel of
/// the next scale is the mean of four, an odd border is repeated, and negative contrast counts as 0.
///
/// # Errors
/// `InvalidArgument` for pictures of different sizes, or smaller than [`MS_SSIM_SIDE`] along an axis.
pub fn ms_ssim(truth: &Picture, picture: &Picture) -> Result<f64> {
    same_size(truth, picture)?;
    if truth.width() < MS_SSIM_SIDE || truth.height() < MS_SSIM_SIDE {
        return Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("five scales of {} x {} pixels are too small for the window", truth.width(), truth.height()),
        )
        .field("size")
        .remedy(format!("Use pictures of at least {MS_SSIM_SIDE} x {MS_SSIM_SIDE} pixels")));
    }
    let mut product = [1.0; 3];
    let mut take = |scale: usize, means: [Means; 3]| {
        let is_last = scale + 1 == EXPONENTS.len();
        for (product, Means { similarity, contrast }) in product.iter_mut().zip(means) {
            let value = if is_last { similarity } else { contrast };
            *product *= value.max(0.0).powf(EXPONENTS[scale]);
        }
    };
    take(0, means_of(truth, picture, true)?);
    let mut planes = [halved_picture(truth), halved_picture(picture)];
    for scale in 1..EXPONENTS.len() {
        if scale > 1 {
            planes = planes.map(|planes| halved(&planes));
        }
        take(scale, compared(&planes));
    }
    Ok(product.iter().sum::<f64>() / 3.0)
}

fn compared([a, b]: &[Planes; 2]) -> [Means; 3] {
    let [width, height] = a.size;
    let fill = |y: usize, channel: usize, row: &mut Maps<f64>| {
        let values = y * width..(y + 1) * width;
        let pairs = a.channels[channel][values.clone()].iter().zip(&b.channels[channel][values]);
        let [out_a, out_b, squares, product] = row;
        for (x, (a, b)) in pairs.enumerate() {
            let (a, b) = (f64::from(*a), f64::from(*b));
            out_a[x] = a;
            out_b[x] = b;
            squares[x] = a * a + b * b;
            product[x] = a * b;
        }
    };
    means([width, height], true, &fill)
}

fn halved_picture(picture: &Picture) -> Planes {
    let width = picture.width() as usize;
    half([width, picture.height() as usize], |channel, at| f32::from(picture.pixels()[at][channel]))
}

fn halved(planes: &Planes) -> Planes {
    half(planes.size, |channel, at| planes.channels[channel][at])
}

/// Means of four pixels, with a repeated border. Exact in 32 bits, as the values start as bytes and are halved eight times.
fn half([width, height]: [usize; 2], value: impl Fn(usize, usize) -> f32 + Sync) -> Planes {
    let size = [width.div_ceil(2), height.div_ceil(2)];
    let channels = [0, 1, 2].map(|channel| {
        let mut plane = vec![0.0; size[0] * size[1]];
        plane.par_chunks_exact_mut(size[0]).enumerate().for_each(|(y, row)| {
            let rows = [2 * y, (2 * y + 1).min(height - 1)].map(|y| y * width);
            for (x, out) in row.iter_mut().enumerate() {
                let columns = [2 * x, (2 * x + 1).min(width - 1)];
                *out = rows.iter().flat_map(|y| columns.map(|x| value(channel, y + x))).sum::<f32>() / 4.0;
            }
        });
        plane
    });
    Planes { size, channels }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32, value: impl Fn(u32, u32) -> u8) -> Picture {
        let mut picture = Picture::new(width, height).unwrap();
        for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
            let value = value(i as u32 % width, i as u32 / width);
            *px = [value, value / 2, 255 - value, 255];
        }
        picture
    }

    #[test]
    fn equal_pictures_have_one_and_opposite_ones_nothing() {
        let a = picture(163, 161, |x, y| ((x * 7) ^ (y * 3)) as u8);
        assert_eq!(ms_ssim(&a, &a).unwrap(), 1.0);
        let opposite = picture(163, 161, |x, y| 255 - ((x * 7) ^ (y * 3)) as u8);
        assert_eq!(ms_ssim(&a, &opposite).unwrap(), 0.0, "no root of a negative number");
    }

    #[test]
    fn halves_are_means_and_repeat_an_odd_border() {
        let planes = halved_picture(&picture(3, 3, |x, y| (10 * x + y) as u8));
        assert_eq!(planes.size, [2, 2]);
        assert_eq!(planes.channels[0], [5.5, 20.5, 7.0, 22.0]);
        assert_eq!(halved(&planes).channels[0], [13.75]);
    }

    #[test]
    fn the_smallest_size_is_the_one_that_is_said() {
        let a = picture(MS_SSIM_SIDE, MS_SSIM_SIDE, |x, _| x as u8);
        assert!(ms_ssim(&a, &a).is_ok());
        for (width, height) in [(MS_SSIM_SIDE - 1, 200), (200, MS_SSIM_SIDE - 1)] {
            let a = picture(width, height, |x, _| x as u8);
            let error = ms_ssim(&a, &a).unwrap_err();
            assert!(error.kind() == ErrorKind::InvalidArgument && error.to_string().contains("161"), "{error}");
        }
    }
}
