//! Structural similarity.
//!
//! Wang, Bovik, Sheikh and Simoncelli, "Image Quality Assessment: From Error Visibility to Structural Similarity", IEEE
//! Transactions on Image Processing 13(4), 2004: equation 13 with the Gaussian window of 11x11 and sigma 1.5, K1 = 0.01,
//! K2 = 0.03, L = 255 and population covariances.

use cairn::{Error, ErrorKind, Picture, Result};
use multiversion::multiversion;
use rayon::prelude::*;

use super::same_size;

/// Width and height of the window, and so the smallest width and height of a picture.
pub const WINDOW: usize = 11;

/// Half a Gaussian of sigma 1.5 over 11 taps, from the outer tap to the centre; all 11 sum to one.
const TAPS: [f64; WINDOW / 2 + 1] = [
    0.001_028_380_084_479_11,
    0.007_598_758_135_239_185,
    0.036_000_772_128_430_83,
    0.109_360_689_509_700_02,
    0.213_005_537_711_253_7,
    0.266_011_724_861_794_36,
];

const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// Rows of results per task.
const BAND: usize = 48;

/// Structural similarity: the mean of [`ssim_rgb`]'s three values.
///
/// Equal but for rounding to scikit-image's `structural_similarity(truth, picture, gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, channel_axis=2, data_range=255)`. In 64-bit floats: 32 bits lose the variance of bright
/// flat areas.
///
/// # Errors
/// `InvalidArgument` for pictures of different sizes, or smaller than [`WINDOW`] along an axis.
pub fn ssim(truth: &Picture, picture: &Picture) -> Result<f64> {
    Ok(ssim_rgb(truth, picture)?.iter().sum::<f64>() / 3.0)
}

/// Structural similarity of red, green and blue, each the mean over all positions of the window inside the picture. Pixels within five of a
/// border are therefore never window centres, as in scikit-image, which crops its map by as much.
///
/// # Errors
/// As [`ssim`].
pub fn ssim_rgb(truth: &Picture, picture: &Picture) -> Result<[f64; 3]> {
    Ok(means_of(truth, picture, false)?.map(|means| means.similarity))
}

/// As [`ssim_rgb`], and contrast if `has_contrast`.
pub(super) fn means_of(truth: &Picture, picture: &Picture, has_contrast: bool) -> Result<[Means; 3]> {
    same_size(truth, picture)?;
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    if width < WINDOW || height < WINDOW {
        return Err(Error::new(
            ErrorKind::InvalidArgument,
            format!(
                "structural similarity needs a window of {WINDOW} x {WINDOW} pixels, the picture has {width} x {height}"
            ),
        )
        .field("size")
        .remedy(format!("Use pictures of at least {WINDOW} x {WINDOW} pixels")));
    }
    let fill = |y: usize, channel: usize, row: &mut Maps<i32>| {
        let pixels = y * width..(y + 1) * width;
        products(&truth.pixels()[pixels.clone()], &picture.pixels()[pixels], channel, row);
    };
    Ok(means([width, height], has_contrast, &fill))
}

/// Values averaged over all positions of the window.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Means {
    /// Structural similarity.
    pub(super) similarity: f64,
    /// Product of contrast and structure, without luminance. 0 if not requested.
    pub(super) contrast: f64,
}

/// Quantities that are averaged over the window, for each pixel of a row: a, b, a^2 + b^2 and ab.
pub(super) type Maps<T> = [Vec<T>; 4];

/// Number type of the maps. For bytes they are integers, whose pairwise sums are exact in half the size.
pub(super) trait Level: Copy + Default + Send {
    /// Weighted vertical average of eleven rows.
    fn down(rows: [&Maps<Self>; WINDOW], out: &mut Maps<f64>);
}

impl Level for i32 {
    fn down(rows: [&Maps<Self>; WINDOW], out: &mut Maps<f64>) {
        down_whole(rows, out);
    }
}

impl Level for f64 {
    fn down(rows: [&Maps<Self>; WINDOW], out: &mut Maps<f64>) {
        down_fractions(rows, out);
    }
}

/// Means over three channels of `size`; `fill` computes the maps of a row. With contrast if `has_contrast`.
pub(super) fn means<T: Level>(
    [width, height]: [usize; 2],
    has_contrast: bool,
    fill: &(dyn Fn(usize, usize, &mut Maps<T>) + Sync),
) -> [Means; 3] {
    let (columns, rows) = (width - (WINDOW - 1), height - (WINDOW - 1));
    let bands = rows.div_ceil(BAND);
    // Sums of whole rows are added in order, so that the result does not depend on bands and threads.
    let sums: Vec<Vec<Means>> = (0..3 * bands)
        .into_par_iter()
        .map_init(
            || Scratch::new(width),
            |scratch, task| {
                let (channel, first) = (task / bands, task % bands * BAND);
                let rows = first..(first + BAND).min(rows);
                band(&|y, row| fill(y, channel, row), rows, has_contrast, scratch)
            },
        )
        .collect();
    let mut all = [Means::default(); 3];
    for (channel, sums) in all.iter_mut().zip(sums.chunks_exact(bands)) {
        let mean = |of: fn(&Means) -> f64| sums.iter().flatten().map(of).sum::<f64>() / (columns as f64 * rows as f64);
        *channel = Means { similarity: mean(|m| m.similarity), contrast: mean(|m| m.contrast) };
    }
    all
}

/// Working memory for the rows of one channel.
struct Scratch<T> {
    /// The maps of the last [`WINDOW`] rows; row `y` is at `y % WINDOW`.
    ring: [Maps<T>; WINDOW],
    /// The vertical average of those rows.
    averaged: Maps<f64>,
    /// One row of similarity.
    similarity: Vec<f64>,
    /// One row of contrast and structure.
    contrast: Vec<f64>,
}

impl<T: Level> Scratch<T> {
    fn new(width: usize) -> Self {
        let columns = width - (WINDOW - 1);
        Self {
            ring: std::array::from_fn(|_| std::array::from_fn(|_| vec![T::default(); width])),
            averaged: std::array::from_fn(|_| vec![0.0; width]),
            similarity: vec![0.0; columns],
            contrast: vec![0.0; columns],
        }
    }
}

/// Sums of each row of results in `rows`.
fn band<T: Level>(
    fill: &dyn Fn(usize, &mut Maps<T>),
    rows: std::ops::Range<usize>,
    has_contrast: bool,
    scratch: &mut Scratch<T>,
) -> Vec<Means> {
    let Scratch { ring, averaged, similarity, contrast } = scratch;
    let mut sums = Vec::with_capacity(rows.len());
    for y in rows.start..rows.end + WINDOW - 1 {
        fill(y, &mut ring[y % WINDOW]);
        if y + 1 >= rows.start + WINDOW {
            T::down(std::array::from_fn(|k| &ring[(y + 1 + k) % WINDOW]), averaged);
            let mut means = Means::default();
            if has_contrast {
                across_with_contrast(averaged, similarity, contrast);
                means.contrast = sum(contrast);
            } else {
                across(averaged, similarity);
            }
            means.similarity = sum(similarity);
            sums.push(means);
        }
    }
    sums
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn products(a: &[[u8; 4]], b: &[[u8; 4]], channel: usize, out: &mut Maps<i32>) {
    let shift = 8 * channel as u32;
    let value = |px: &[u8; 4]| (u32::from_le_bytes(*px) >> shift & 255) as i32;
    let n = a.len();
    let [out_a, out_b, squares, product] = out.each_mut().map(|out| &mut out[..n]);
    let b = &b[..n];
    for x in 0..n {
        let (a, b) = (value(&a[x]), value(&b[x]));
        out_a[x] = a;
        out_b[x] = b;
        squares[x] = a * a + b * b;
        product[x] = a * b;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn down_whole(rows: [&Maps<i32>; WINDOW], out: &mut Maps<f64>) {
    for (map, out) in out.iter_mut().enumerate() {
        filter_rows(rows.map(|row| &row[map][..]), out, |a, b| f64::from(a + b), f64::from);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn down_fractions(rows: [&Maps<f64>; WINDOW], out: &mut Maps<f64>) {
    for (map, out) in out.iter_mut().enumerate() {
        filter_rows(rows.map(|row| &row[map][..]), out, |a, b| a + b, |a| a);
    }
}

/// Weighted sum of eleven rows; rows with the same weight are added first.
#[inline(always)]
fn filter_rows<T: Copy>(rows: [&[T]; WINDOW], out: &mut [f64], pair: impl Fn(T, T) -> f64, one: impl Fn(T) -> f64) {
    let n = out.len();
    let rows = rows.map(|row| &row[..n]);
    for x in 0..n {
        let mut sum = TAPS[5] * one(rows[5][x]);
        for k in 0..5 {
            sum += TAPS[k] * pair(rows[k][x], rows[10 - k][x]);
        }
        out[x] = sum;
    }
}

/// Similarity at each position of the window, from vertically averaged rows.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn across(maps: &Maps<f64>, out: &mut [f64]) {
    places::<false>(maps, out, &mut []);
}

/// The same, with contrast and structure.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn across_with_contrast(maps: &Maps<f64>, out: &mut [f64], contrast: &mut [f64]) {
    places::<true>(maps, out, contrast);
}

#[inline(always)]
fn places<const CONTRAST: bool>(maps: &Maps<f64>, out: &mut [f64], contrast: &mut [f64]) {
    const PIECE: usize = 64;
    let n = out.len();
    let mut start = 0;
    while start < n {
        let end = (start + PIECE).min(n);
        let length = end - start;
        let mut averages = [[0.0f64; PIECE]; 4];
        for (map, out) in maps.iter().zip(&mut averages) {
            filter_rows(std::array::from_fn(|k| &map[start + k..end + k]), &mut out[..length], |a, b| a + b, |a| a);
        }
        let [a, b, squares, product] = averages.each_ref().map(|average| &average[..length]);
        let out = &mut out[start..end];
        for x in 0..length {
            let (a, b, squares, product) = (a[x], b[x], squares[x], product[x]);
            let covariance = product - a * b;
            let variances = squares - (a * a + b * b);
            let above = (2.0 * a * b + C1) * (2.0 * covariance + C2);
            let below = (a * a + b * b + C1) * (variances + C2);
            out[x] = above / below;
            if CONTRAST {
                contrast[start + x] = (2.0 * covariance + C2) / (variances + C2);
            }
        }
        start = end;
    }
}

/// A sum whose order does not depend on the machine's vector width.
fn sum(values: &[f64]) -> f64 {
    let (eights, rest) = values.as_chunks::<8>();
    let mut lanes = [0.0f64; 8];
    for eight in eights {
        for (lane, value) in lanes.iter_mut().zip(eight) {
            *lane += value;
        }
    }
    lanes.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32, value: impl Fn(u32, u32, u32) -> u8) -> Picture {
        let mut picture = Picture::new(width, height).unwrap();
        for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            *px = [value(x, y, 0), value(x, y, 1), value(x, y, 2), 255];
        }
        picture
    }

    fn texture(x: u32, y: u32, c: u32) -> u8 {
        let (x, y) = (f64::from(x), f64::from(y));
        (128.0 + 90.0 * (x * 0.37 + f64::from(c)).sin() * (y * 0.23).cos() + 20.0 * (x * y * 0.9).sin()) as u8
    }

    /// The paper's formula for every position of the two-dimensional window, in 64-bit floats.
    fn by_definition(a: &Picture, b: &Picture, channel: usize) -> f64 {
        let width = a.width() as usize;
        let weight = |k: usize| (-(k as f64 - 5.0).powi(2) / (2.0 * 1.5 * 1.5)).exp();
        let all: f64 = (0..WINDOW).map(weight).sum();
        let (columns, rows) = (width - 10, a.height() as usize - 10);
        let mut total = 0.0;
        for place in 0..columns * rows {
            let mut m = [0.0; 5];
            for k in 0..WINDOW * WINDOW {
                let at = (place / columns + k / WINDOW) * width + place % columns + k % WINDOW;
                let (x, y) = (f64::from(a.pixels()[at][channel]), f64::from(b.pixels()[at][channel]));
                let w = weight(k / WINDOW) * weight(k % WINDOW) / (all * all);
                [x, y, x * x, y * y, x * y].iter().zip(&mut m).for_each(|(v, m)| *m += w * v);
            }
            let [x, y, xx, yy, xy] = m;
            let (c1, c2) = (2.55f64.powi(2), 7.65f64.powi(2));
            total += (2.0 * x * y + c1) * (2.0 * (xy - x * y) + c2)
                / ((x * x + y * y + c1) * (xx - x * x + yy - y * y + c2));
        }
        total / (columns * rows) as f64
    }

    #[test]
    fn equals_the_definition_at_odd_sizes() {
        for (width, height) in [(11, 11), (12, 75), (97, 13), (140, 61)] {
            let a = picture(width, height, texture);
            let b = picture(width, height, |x, y, c| texture(x + 1, y, c).saturating_add((x % 3 * 9) as u8));
            let found = ssim_rgb(&a, &b).unwrap();
            for (channel, found) in found.into_iter().enumerate() {
                let expected = by_definition(&a, &b, channel);
                assert!((found - expected).abs() < 1e-9, "{width} x {height}: {found} is not {expected}");
            }
        }
    }

    #[test]
    fn keeps_its_accuracy_where_nothing_varies() {
        for (low, high) in [(0, 1), (254, 255), (0, 255)] {
            let (a, b) = (picture(40, 30, |_, _, _| low), picture(40, 30, |_, _, _| high));
            let (found, expected) = (ssim(&a, &b).unwrap(), by_definition(&a, &b, 0));
            assert!((found - expected).abs() < 1e-9, "{low} and {high}: {found} is not {expected}");
        }
    }

    #[test]
    fn equal_pictures_have_one_and_alpha_counts_nothing() {
        let a = picture(64, 48, texture);
        let mut b = a.clone();
        b.pixels_mut().iter_mut().for_each(|px| px[3] = 7);
        assert_eq!(ssim_rgb(&a, &b).unwrap(), [1.0; 3]);
    }

    #[test]
    fn the_number_of_threads_does_not_show() {
        let (a, b) = (picture(300, 211, texture), picture(300, 211, |x, y, c| texture(x, y + 1, c)));
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ssim_rgb(&a, &b).unwrap().map(f64::to_bits))
        };
        assert_eq!(with(1), with(5));
    }

    #[test]
    fn too_small_pictures_are_refused_with_the_smallest_size() {
        for (width, height) in [(10, 64), (64, 10), (1, 1)] {
            let a = picture(width, height, texture);
            let error = ssim(&a, &a).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument);
            assert!(error.to_string().contains("at least 11 x 11"), "{error}");
        }
    }
}
