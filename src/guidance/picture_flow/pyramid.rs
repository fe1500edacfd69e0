//! Luma at full, half, quarter, ... size.

use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

use super::reserve;
use crate::{Picture, Result};

/// A level is halved again while its shorter side has at least this many pixels.
const SHORT: usize = 24;
/// Pixels of the finest level that is searched at most: motion changes no faster in a larger picture.
const LARGE: usize = 1 << 20;
/// Rows that are worth a task of their own.
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

/// The whole number at or below `x`. Without SSE 4.1 `f32::floor` is a call.
#[inline(always)]
pub(super) fn floor(x: f32) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from((towards_zero as f32) > x)
}

impl Plane {
    /// Whether the `side` x `side` pixels from (x, y) on lie in the picture.
    #[inline(always)]
    pub(super) fn holds(&self, x: i32, y: i32, side: usize) -> bool {
        let (x, y) = (i64::from(x), i64::from(y));
        x >= 0 && y >= 0 && x + side as i64 <= self.width as i64 && y + side as i64 <= self.height as i64
    }

    /// The `N` pixels from (x, y) on, which lie in the picture.
    #[inline(always)]
    pub(super) fn row<const N: usize>(&self, x: i32, y: i32) -> [f32; N] {
        let start = y as usize * self.width + x as usize;
        let mut row = [0.0; N];
        row.copy_from_slice(&self.luma[start..start + N]);
        row
    }

    /// The `N` x `N` pixels from (x, y) on, the edge repeated outside.
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
        let mut block = [[0.0; N]; N];
        for (j, row) in (0..).zip(&mut block) {
            let start = y.saturating_add(j).clamp(0, last_y) as usize * self.width;
            for (i, value) in (0..).zip(row) {
                *value = self.luma[start + x.saturating_add(i).clamp(0, last_x) as usize];
            }
        }
        block
    }

    fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        (self.width, self.height) = (width, height);
        reserve(&mut self.luma, width * height, 0.0)
    }
}

impl Pyramid {
    /// All levels, the finest first; none before the first picture.
    pub(super) fn levels(&self) -> &[Plane] {
        &self.planes[..self.used]
    }

    /// The finest level that is not large.
    pub(super) fn finest(&self) -> usize {
        self.levels().iter().position(|plane| plane.luma.len() <= LARGE).unwrap_or(0)
    }

    /// Takes the luma of `picture` and halves it as often as it bears.
    pub(super) fn build(&mut self, features: Level, picture: &Picture) -> Result<()> {
        let (mut width, mut height) = (picture.width() as usize, picture.height() as usize);
        let mut used = 0;
        self.used = 0;
        loop {
            if self.planes.len() == used {
                self.planes.push(Plane::default());
            }
            self.planes[used].resize(width, height)?;
            used += 1;
            if width.min(height) < SHORT {
                break;
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
        let width = picture.width() as usize;
        let rows = self.planes[0].luma.par_chunks_mut(width).zip(picture.pixels().par_chunks(width));
        rows.with_min_len(ROWS).for_each(|(row, pixels)| {
            dispatch!(features, simd => luma(simd, pixels, row));
        });
        for level in 1..used {
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
    for (value, &[r, g, b, _]) in row.iter_mut().zip(pixels) {
        *value = 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b);
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
