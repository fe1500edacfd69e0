//! Luma pyramid: full, half, quarter, ... size.

use fearless_simd::{Level, Simd, dispatch};

use super::reserve;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Picture, Result};

/// A level is halved again while its shorter side has at least this many pixels.
pub(super) const SHORT: usize = 24;
/// Largest number of pixels of the finest level searched. In larger pictures motion does not vary on a finer scale.
pub(super) const LARGE: usize = 1 << 20;
/// Pixels of a halved row computed at a time.
const RUN: usize = 64;
/// Smallest number of rows per parallel task.
const ROWS: usize = 16;

/// One level: luma in code values, row by row.
#[derive(Debug, Default)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) luma: Vec<f32>,
}

/// All levels of a picture, the finest first.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    planes: Vec<Plane>,
    used: usize,
}

/// Rounds down. Without SSE 4.1 `f32::floor` is a function call.
#[inline(always)]
pub(super) fn floor(x: f32) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from((towards_zero as f32) > x)
}

impl Plane {
    /// Whether the `side` x `side` pixels from (x, y) on lie inside the picture.
    #[inline(always)]
    pub(super) fn holds(&self, x: i32, y: i32, side: usize) -> bool {
        let (x, y) = (i64::from(x), i64::from(y));
        x >= 0 && y >= 0 && x + side as i64 <= self.width as i64 && y + side as i64 <= self.height as i64
    }

    /// The `N` pixels from (x, y) on, all of which must lie inside the picture.
    #[inline(always)]
    pub(super) fn row<const N: usize>(&self, x: i32, y: i32) -> [f32; N] {
        let start = y as usize * self.width + x as usize;
        let mut row = [0.0; N];
        row.copy_from_slice(&self.luma[start..start + N]);
        row
    }

    /// The `N` x `N` pixels from (x, y) on, with clamped coordinates.
    #[inline(always)]
    pub(super) fn block<const N: usize>(&self, x: i32, y: i32) -> [[f32; N]; N] {
        if self.holds(x, y, N) {
            let mut block = [[0.0; N]; N];
            for (row, y) in block.iter_mut().zip(y..) {
                *row = self.row(x, y);
            }
            return block;
        }
        self.block_at_edge(x, y)
    }

    #[inline(never)]
    fn block_at_edge<const N: usize>(&self, x: i32, y: i32) -> [[f32; N]; N] {
        let (last_x, last_y) = (self.width as i32 - 1, self.height as i32 - 1);
        let columns: [usize; N] = std::array::from_fn(|i| x.saturating_add(i as i32).clamp(0, last_x) as usize);
        let is_whole = columns[N - 1] - columns[0] == N - 1;
        let mut block = [[0.0; N]; N];
        for (j, row) in (0..).zip(&mut block) {
            let start = y.saturating_add(j).clamp(0, last_y) as usize * self.width;
            let line = &self.luma[start..start + self.width];
            if is_whole {
                row.copy_from_slice(&line[columns[0]..columns[0] + N]);
            } else {
                row.iter_mut().zip(columns).for_each(|(value, column)| *value = line[column]);
            }
        }
        block
    }

    fn resize(&mut self, width: usize, height: usize, is_left_out: bool) -> Result<()> {
        (self.width, self.height) = (width, height);
        reserve(&mut self.luma, if is_left_out { 0 } else { width * height }, 0.0)
    }
}

impl Pyramid {
    /// All levels, the finest first; none before the first picture.
    pub(super) fn levels(&self) -> &[Plane] {
        &self.planes[..self.used]
    }

    /// The finest level of at most [`LARGE`] pixels, or else the coarsest.
    pub(super) fn finest(&self) -> usize {
        let fits = |plane: &Plane| !plane.luma.is_empty() && plane.luma.len() <= LARGE;
        self.levels().iter().position(fits).unwrap_or(self.used.saturating_sub(1))
    }

    /// Builds the pyramid of `picture`. Level 0 of a large picture is never searched and stores no luma.
    pub(super) fn build(&mut self, features: Level, picture: &Picture) -> Result<()> {
        let (mut width, mut height) = (picture.width() as usize, picture.height() as usize);
        let is_large = width * height > LARGE && width.min(height) >= SHORT;
        let mut used = 0;
        self.used = 0;
        loop {
            if self.planes.len() == used {
                self.planes.push(Plane::default());
            }
            self.planes[used].resize(width, height, is_large && used == 0)?;
            used += 1;
            if width.min(height) < SHORT {
                break;
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
        let (width, pixels) = (picture.width() as usize, picture.pixels());
        if is_large {
            let coarser = &mut self.planes[1];
            let rows = coarser.luma.par_chunks_mut(coarser.width).zip(pixels.par_chunks(2 * width));
            rows.with_min_len(ROWS).for_each(|(row, pixels)| {
                let (above, below) = pixels.split_at(width);
                let below = if below.is_empty() { above } else { below };
                dispatch!(features, simd => halved_luma(simd, above, below, row));
            });
        } else {
            let rows = self.planes[0].luma.par_chunks_mut(width).zip(pixels.par_chunks(width));
            rows.with_min_len(ROWS).for_each(|(row, pixels)| {
                dispatch!(features, simd => luma(simd, pixels, row));
            });
        }
        for level in 1 + usize::from(is_large)..used {
            let (finer, coarser) = self.planes.split_at_mut(level);
            let (finer, coarser) = (&finer[level - 1], &mut coarser[0]);
            coarser.luma.par_chunks_mut(coarser.width).with_min_len(ROWS).enumerate().for_each(|(y, row)| {
                let line = |y: usize| &finer.luma[y * finer.width..(y + 1) * finer.width];
                let (above, below) = (line(2 * y), line((2 * y + 1).min(finer.height - 1)));
                dispatch!(features, simd => halve(simd, above, below, row));
            });
        }
        self.used = used;
        Ok(())
    }
}

#[inline(always)]
fn luma<S: Simd>(_: S, pixels: &[[u8; 4]], row: &mut [f32]) {
    for (value, &pixel) in row.iter_mut().zip(pixels) {
        // Read as one u32: vector code extracts bytes from it faster than from four u8.
        let pixel = u32::from_le_bytes(pixel);
        let [r, g, b] = [0, 8, 16].map(|shift| (pixel >> shift & 255) as i32 as f32);
        *value = 0.299 * r + 0.587 * g + 0.114 * b;
    }
}

/// [`luma`] of two rows, then [`halve`].
#[inline(always)]
fn halved_luma<S: Simd>(simd: S, above: &[[u8; 4]], below: &[[u8; 4]], row: &mut [f32]) {
    let mut lumas = [[0.0; 2 * RUN]; 2];
    let pixels = above.chunks(2 * RUN).zip(below.chunks(2 * RUN));
    for (run, (above, below)) in row.chunks_mut(RUN).zip(pixels) {
        let [of_above, of_below] = lumas.each_mut().map(|lumas| &mut lumas[..above.len()]);
        luma(simd, above, of_above);
        luma(simd, below, of_below);
        halve(simd, of_above, of_below, run);
    }
}

/// Means of 2 x 2 pixels; an odd last column counts twice.
#[inline(always)]
fn halve<S: Simd>(_: S, above: &[f32], below: &[f32], row: &mut [f32]) {
    let pairs = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
    for (value, (a, b)) in row.iter_mut().zip(pairs) {
        *value = 0.25 * ((a[0] + a[1]) + (b[0] + b[1]));
    }
    if let (true, Some(value), Some(a), Some(b)) = (above.len() % 2 == 1, row.last_mut(), above.last(), below.last()) {
        *value = 0.5 * (a + b);
    }
}
