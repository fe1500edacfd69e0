//! Feature maps, and all network operations except convolution.

use std::ops::Range;

use cairn::{Error, ErrorKind, Picture, Result};
use multiversion::multiversion;
use rayon::prelude::*;

/// Some rows of a feature map: row by row, column by column, channels last. The columns have a border of zeros, and rows outside the map are
/// zeros too, so that a convolution needs no bounds checks.
#[derive(Debug)]
pub(super) struct Map {
    /// Columns without the border.
    pub(super) width: usize,
    pub(super) channels: usize,
    /// Columns of zeros on each side.
    pub(super) border: usize,
    /// The rows held here; negative ones are above the map.
    pub(super) rows: Range<isize>,
    data: Vec<f32>,
}

impl Map {
    /// A map of zeros.
    pub(super) fn new(width: usize, channels: usize, border: usize, rows: Range<isize>) -> Result<Self> {
        let data = zeros([rows.len(), width + 2 * border, channels])?;
        Ok(Self { width, channels, border, rows, data })
    }

    /// The colours of `picture` scaled to -1 to 1, then normalised as LPIPS v0.1 does, with a border on all four sides.
    pub(super) fn of_picture(picture: &Picture, border: usize) -> Result<Self> {
        const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
        const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
        // Bytes have 256 values, so a table is computed once.
        let values: [[f32; 256]; 3] = std::array::from_fn(|channel| {
            std::array::from_fn(|byte| (byte as f32 / 127.5 - 1.0 - SHIFT[channel]) / SCALE[channel])
        });
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let rows = -(border as isize)..(height + border) as isize;
        let mut map = Self::new(width, 3, border, rows)?;
        for (y, pixels) in picture.pixels().chunks_exact(width).enumerate() {
            for (out, px) in map.row_mut(y as isize).as_chunks_mut::<3>().0.iter_mut().zip(pixels) {
                *out = std::array::from_fn(|channel| values[channel][usize::from(px[channel])]);
            }
        }
        Ok(map)
    }

    /// Columns with the border.
    pub(super) fn pitch(&self) -> usize {
        self.width + 2 * self.border
    }

    /// Index of row `y`, column 0 and channel 0 in [`data`](Self::data).
    pub(super) fn place(&self, y: isize) -> usize {
        ((y - self.rows.start) as usize * self.pitch() + self.border) * self.channels
    }

    pub(super) fn data(&self) -> &[f32] {
        &self.data
    }

    pub(super) fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Row `y` without its border.
    pub(super) fn row(&self, y: isize) -> &[f32] {
        let start = self.place(y);
        &self.data[start..start + self.width * self.channels]
    }

    fn row_mut(&mut self, y: isize) -> &mut [f32] {
        let start = self.place(y);
        let length = self.width * self.channels;
        &mut self.data[start..start + length]
    }

    /// Moves to other rows, at most as many as before, of a map with `height` rows. Rows outside the map become zero; the others keep arbitrary
    /// old values.
    pub(super) fn move_to(&mut self, rows: Range<isize>, height: usize) {
        let line = self.pitch() * self.channels;
        self.rows = rows.clone();
        for (y, line) in rows.zip(self.data.chunks_exact_mut(line)) {
            if y < 0 || y >= height as isize {
                line.fill(0.0);
            }
        }
    }
}

/// Zeros for a map of this size.
///
/// # Errors
/// `OutOfMemory` when the allocation fails.
pub(super) fn zeros(sides: [usize; 3]) -> Result<Vec<f32>> {
    let count = sides.iter().try_fold(1usize, |count, side| count.checked_mul(*side));
    let mut numbers = Vec::new();
    match count.map(|count| numbers.try_reserve_exact(count).map(|()| count)) {
        Some(Ok(count)) => {
            numbers.resize(count, 0.0);
            Ok(numbers)
        }
        _ => Err(Error::new(ErrorKind::OutOfMemory, format!("LPIPS cannot have a map of {sides:?} numbers"))
            .remedy("Use smaller pictures, or AlexNet instead of VGG16")),
    }
}

/// Max pooling over `size` x `size` with stride 2: computes those rows of `out` for which `input` has all rows from `rows` on. Rows of `out`
/// from `out_height` on are left out.
pub(super) fn pool(input: &Map, size: usize, rows: Range<isize>, out: &mut Map, out_height: usize) {
    debug_assert!(rows.start % 2 == 0);
    let made = rows.start / 2..(rows.end + 1).div_euclid(2).min(out_height as isize);
    if made.is_empty() {
        return;
    }
    let (line, start) = (out.pitch() * out.channels, out.place(made.start));
    let length = out.width * out.channels;
    let lines = out.data[start..].par_chunks_mut(line).zip(made.into_par_iter());
    lines.for_each(|(line, y)| {
        let line = &mut line[..length];
        let sources: [&[f32]; 3] = std::array::from_fn(|k| input.row(2 * y + k.min(size - 1) as isize));
        largest(&sources[..size], input.channels, line);
    });
}

/// One row of [`pool`]: the number of `rows` is the window size.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn largest(rows: &[&[f32]], channels: usize, out: &mut [f32]) {
    for (x, out) in out.chunks_exact_mut(channels).enumerate() {
        out.fill(f32::NEG_INFINITY);
        for row in rows {
            for source in row[2 * x * channels..].chunks_exact(channels).take(rows.len()) {
                for (out, value) in out.iter_mut().zip(source) {
                    *out = if *value > *out { *value } else { *out };
                }
            }
        }
    }
}

/// Normalises every pixel's channels as LPIPS does: divides by the vector's length plus 1e-10.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
pub(super) fn normalise(pixels: &[f32], channels: usize, out: &mut [f32]) {
    const LANES: usize = 16;
    for (pixel, out) in pixels.chunks_exact(channels).zip(out.chunks_exact_mut(channels)) {
        // Every network has a multiple of 64 channels.
        let mut sums = [0.0f32; LANES];
        for values in pixel.as_chunks::<LANES>().0 {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += value * value;
            }
        }
        let scale = 1.0 / (sums.iter().sum::<f32>().sqrt() + 1e-10);
        for (out, value) in out.iter_mut().zip(pixel) {
            *out = value * scale;
        }
    }
}

/// Sum of the weighted squared differences of two rows of unit vectors.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
pub(super) fn difference(a: &[f32], b: &[f32], weights: &[f32]) -> f64 {
    const LANES: usize = 16;
    let mut total = 0.0;
    for (a, b) in a.chunks_exact(weights.len()).zip(b.chunks_exact(weights.len())) {
        let mut sums = [0.0f32; LANES];
        let channels = a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0);
        for ((a, b), weights) in channels.zip(weights.as_chunks::<LANES>().0) {
            for lane in 0..LANES {
                let d = a[lane] - b[lane];
                sums[lane] += weights[lane] * (d * d);
            }
        }
        total += f64::from(sums.iter().sum::<f32>());
    }
    total
}
