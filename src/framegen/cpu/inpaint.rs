//! Colours for what neither anchor shows: from a pyramid of the colours around.

use rayon::prelude::*;

use super::colour::Colour;
use super::kernels::TILE;
use super::layer::Grid;
use super::sized;
use crate::{Raster, Result};

/// The pyramid; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Inpainter {
    levels: Vec<Mip>,
}

/// Colours of a grid, weighted by how much is known there.
#[derive(Debug, Default)]
struct Mip {
    columns: usize,
    rows: usize,
    /// Three channels and alpha, each times the weight, and the weight.
    sums: Vec<[f32; 5]>,
}

impl Inpainter {
    /// Paints the pixels of `hidden`, one bit for each in a word for each tile. The finest level has a colour for each
    /// tile; where nothing is known of a tile, coarser levels tell.
    pub(super) fn paint<P: Colour>(&mut self, grid: Grid, hidden: &[u64], out: &mut Raster<P>) -> Result<()> {
        self.reserve(grid)?;
        let pixels = out.pixels();
        let base = &mut self.levels[0];
        base.sums.par_chunks_mut(grid.columns).enumerate().for_each(|(row, sums)| {
            for (column, sum) in sums.iter_mut().enumerate() {
                *sum = [0.0; 5];
                let [across, down] = grid.extent(column, row);
                let mask = hidden[row * grid.columns + column];
                for j in 0..down {
                    let line = &pixels[(row * TILE + j) * grid.width + column * TILE..][..across];
                    let known = line.iter().enumerate().filter(|(i, _)| mask >> (j * TILE + i) & 1 == 0);
                    for (_, pixel) in known {
                        let levels = pixel.in_levels();
                        (0..4).for_each(|c| sum[c] += levels[c]);
                        sum[4] += 1.0;
                    }
                }
            }
        });
        for number in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(number);
            let (below, level) = (&below[number - 1], &mut above[0]);
            for (index, sum) in level.sums.iter_mut().enumerate() {
                let (column, row) = (2 * (index % level.columns), 2 * (index / level.columns));
                *sum = [0.0; 5];
                for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    if column + i < below.columns && row + j < below.rows {
                        let child = below.sums[(row + j) * below.columns + column + i];
                        (0..5).for_each(|c| sum[c] += child[c]);
                    }
                }
            }
        }
        // Down again: what is known of a cell outweighs what its parent lends it.
        for number in (1..self.levels.len()).rev() {
            let (below, above) = self.levels.split_at_mut(number);
            let (below, level) = (&mut below[number - 1], &above[0]);
            let columns = below.columns;
            for (index, sum) in below.sums.iter_mut().enumerate() {
                let parent = level.sums[index / columns / 2 * level.columns + index % columns / 2];
                let lent = LENT / parent[4].max(1e-6);
                (0..5).for_each(|c| sum[c] += parent[c] * lent);
            }
        }
        let base = &self.levels[0];
        out.pixels_mut().par_chunks_mut(grid.width * TILE).enumerate().for_each(|(row, lines)| {
            for column in 0..grid.columns {
                let mut mask = hidden[row * grid.columns + column];
                while mask != 0 {
                    let place = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let (i, j) = (place % TILE, place / TILE);
                    lines[j * grid.width + column * TILE + i] =
                        P::from_levels(base.at(column * TILE + i, row * TILE + j));
                }
            }
        });
        Ok(())
    }

    fn reserve(&mut self, grid: Grid) -> Result<()> {
        let mut size = (grid.columns, grid.rows);
        let mut count = 1;
        while size != (1, 1) {
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
            count += 1;
        }
        self.levels.truncate(count);
        super::reserve(&mut self.levels, count)?;
        self.levels.resize_with(count, Mip::default);
        let mut size = (grid.columns, grid.rows);
        for level in &mut self.levels {
            (level.columns, level.rows) = size;
            sized(&mut level.sums, size.0 * size.1, [0.0; 5])?;
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
        }
        Ok(())
    }
}

/// What a parent's colour weighs in a cell, in pixels.
const LENT: f32 = 1.0 / 16.0;

impl Mip {
    /// The colour at a pixel, between the centres of the cells.
    fn at(&self, x: usize, y: usize) -> [f32; 4] {
        let axis = |at: usize, len: usize| {
            let at = ((at as f32 + 0.5) / TILE as f32 - 0.5).clamp(0.0, (len - 1) as f32);
            let first = (at as usize).min(len - 1);
            (first, (first + 1).min(len - 1), at - first as f32)
        };
        let (left, right, fx) = axis(x, self.columns);
        let (top, bottom, fy) = axis(y, self.rows);
        let mut sum = [0.0; 5];
        for (row, wy) in [(top, 1.0 - fy), (bottom, fy)] {
            for (column, wx) in [(left, 1.0 - fx), (right, fx)] {
                let cell = self.sums[row * self.columns + column];
                (0..5).for_each(|c| sum[c] += cell[c] * wx * wy);
            }
        }
        std::array::from_fn(|c| sum[c] / sum[4].max(1e-6))
    }
}
