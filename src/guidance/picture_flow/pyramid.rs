//! Luma at full, half, quarter, ... size.

use rayon::prelude::*;

use super::reserve;
use crate::{Picture, Result};

/// A level is halved again while its shorter side has at least this many pixels.
const SHORT: usize = 24;

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

impl Plane {
    /// The `N` x `N` pixels from (x, y) on, the edge repeated outside.
    #[inline]
    pub(super) fn block<const N: usize>(&self, x: i32, y: i32) -> [[f32; N]; N] {
        let mut block = [[0.0; N]; N];
        let (w, h, n) = (self.width as i32, self.height as i32, N as i32);
        if x >= 0 && y >= 0 && x + n <= w && y + n <= h {
            for (j, row) in block.iter_mut().enumerate() {
                let start = (y as usize + j) * self.width + x as usize;
                row.copy_from_slice(&self.luma[start..start + N]);
            }
            return block;
        }
        for (row, y) in block.iter_mut().zip(y..) {
            let start = y.clamp(0, h - 1) as usize * self.width;
            for (value, x) in row.iter_mut().zip(x..) {
                *value = self.luma[start + x.clamp(0, w - 1) as usize];
            }
        }
        block
    }

    /// Luma at a position in pixels, whole numbers being pixels; bilinear, the edge repeated outside.
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> f32 {
        let x = x.clamp(0.0, (self.width - 1) as f32);
        let y = y.clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (fx, fy) = (x - left as f32, y - top as f32);
        let (upper, lower) = (top * self.width, below * self.width);
        let mix = |row: usize| {
            let (a, b) = (self.luma[row + left], self.luma[row + right]);
            a + (b - a) * fx
        };
        let (a, b) = (mix(upper), mix(lower));
        a + (b - a) * fy
    }

    fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        (self.width, self.height) = (width, height);
        reserve(&mut self.luma, width * height, 0.0)
    }
}

impl Pyramid {
    /// All levels, the finest first; at least one.
    pub(super) fn levels(&self) -> &[Plane] {
        &self.planes[..self.used]
    }

    /// Takes the luma of `picture` and halves it as often as it bears.
    pub(super) fn build(&mut self, picture: &Picture) -> Result<()> {
        let (mut width, mut height) = (picture.width() as usize, picture.height() as usize);
        self.used = 0;
        loop {
            if self.planes.len() == self.used {
                self.planes.push(Plane::default());
            }
            self.planes[self.used].resize(width, height)?;
            self.used += 1;
            if width.min(height) < SHORT {
                break;
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
        let width = picture.width() as usize;
        let rows = self.planes[0].luma.par_chunks_mut(width).zip(picture.pixels().par_chunks(width));
        rows.for_each(|(row, pixels)| {
            for (value, &[r, g, b, _]) in row.iter_mut().zip(pixels) {
                *value = 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b);
            }
        });
        for level in 1..self.used {
            let (finer, coarser) = self.planes.split_at_mut(level);
            halve(&finer[level - 1], &mut coarser[0]);
        }
        Ok(())
    }
}

/// Means of 2 x 2 pixels; an odd last row or column counts twice.
fn halve(from: &Plane, to: &mut Plane) {
    let width = to.width;
    to.luma.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let (top, below) = (2 * y * from.width, (2 * y + 1).min(from.height - 1) * from.width);
        for (x, value) in row.iter_mut().enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(from.width - 1));
            let luma = &from.luma;
            *value = 0.25 * (luma[top + left] + luma[top + right] + luma[below + left] + luma[below + right]);
        }
    });
}
