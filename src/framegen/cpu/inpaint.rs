//! Inpainting of pixels that neither anchor shows, from a pyramid of the surrounding colours.

use std::sync::atomic::{AtomicBool, Ordering};

use super::colour::Colour;
use super::kernels::{BLOCK, TILE, prefetch};
use super::key_buffer::Grid;
use super::resize;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Raster, Result};

/// Side of a square of tiles with its own pyramid of 16x16, 8x8, 4x4, 2x2 and 1 cells.
const SQUARE_TILES: usize = 16;
/// Weight of a parent's colour in a cell, in pixels.
const PARENT_WEIGHT: f32 = 1.0 / 16.0;

#[cfg(test)]
crate::shader_constants::shader_constants!("INPAINT_": float PARENT_WEIGHT);

/// Weighted sum of RGBA, and the weight: the number of visible pixels.
type Sum = [f32; 5];

/// The pyramids; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Inpainter {
    /// Squares per row.
    columns: usize,
    /// Which squares are needed.
    is_needed: Vec<bool>,
    /// One cell per tile, grouped by square.
    cells: Vec<[Sum; SQUARE_TILES * SQUARE_TILES]>,
    /// Sum of each row of tiles.
    rows: Vec<Sum>,
}

impl Inpainter {
    /// Fills the pixels in `hidden`, which has one word of bits per tile. A tile's colour is that of its visible
    /// pixels, with little weight for the surrounding 2x2, 4x4, ... tiles.
    pub(super) fn paint<P: Colour>(&mut self, grid: Grid, hidden: &[u64], out: &mut Raster<P>) -> Result<()> {
        self.reserve(grid)?;
        self.find_needed(grid, hidden);
        let visible = VisiblePixels { grid, hidden, pixels: out.pixels() };
        let columns = self.columns;
        let has_empty_square = AtomicBool::new(false);
        let squares = self.cells.par_iter_mut().zip(self.is_needed.par_iter()).enumerate();
        squares.for_each(|(square, (cells, &is_needed))| {
            let corner = [square % columns * SQUARE_TILES, square / columns * SQUARE_TILES];
            if is_needed && visible.build(corner, cells) {
                has_empty_square.store(true, Ordering::Relaxed);
            }
        });
        if has_empty_square.into_inner() {
            self.fill_empty_squares(&visible);
        }
        let (columns, cells) = (self.columns, &self.cells);
        out.pixels_mut().par_chunks_mut(grid.width * TILE).enumerate().for_each(|(row, lines)| {
            for column in 0..grid.columns {
                let mut mask = hidden[row * grid.columns + column];
                while mask != 0 {
                    let index = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let (x, j) = (column * TILE + index % TILE, index / TILE);
                    lines[j * grid.width + x] = P::from_levels(colour(cells, columns, grid, x, row * TILE + j));
                }
            }
        });
        Ok(())
    }

    /// Allocates for a grid.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.columns = grid.columns.div_ceil(SQUARE_TILES);
        let squares = self.columns * grid.rows.div_ceil(SQUARE_TILES);
        resize(&mut self.is_needed, squares, false)?;
        resize(&mut self.cells, squares, [[0.0; 5]; SQUARE_TILES * SQUARE_TILES])?;
        resize(&mut self.rows, grid.rows, [0.0; 5])
    }

    /// Marks squares that contain a tile with hidden pixels or one beside it.
    fn find_needed(&mut self, grid: Grid, hidden: &[u64]) {
        self.is_needed.fill(false);
        for (tile, _) in hidden.iter().enumerate().filter(|(_, mask)| **mask != 0) {
            let (column, row) = (tile % grid.columns, tile / grid.columns);
            for row in [row.saturating_sub(1), (row + 1).min(grid.rows - 1)] {
                for column in [column.saturating_sub(1), (column + 1).min(grid.columns - 1)] {
                    self.is_needed[row / SQUARE_TILES * self.columns + column / SQUARE_TILES] = true;
                }
            }
        }
    }

    /// Sets squares without visible pixels to the picture's mean; to black if no pixel is visible.
    #[cold]
    fn fill_empty_squares<P: Colour>(&mut self, visible: &VisiblePixels<'_, P>) {
        let add = |sum: Sum, other: Sum| -> Sum { std::array::from_fn(|c| sum[c] + other[c]) };
        self.rows.par_iter_mut().enumerate().for_each(|(row, sum)| {
            *sum = (0..visible.grid.columns).map(|column| visible.of_tile(column, row)).fold([0.0; 5], add);
        });
        let sum = self.rows.iter().copied().fold([0.0; 5], add);
        let mean = if sum[4] > 0.0 { sum.map(|v| v / sum[4]) } else { [0.0, 0.0, 0.0, 255.0, 1.0] };
        for cell in self.cells.iter_mut().flatten().filter(|cell| cell[4] == 0.0) {
            *cell = mean;
        }
    }
}

/// A picture's visible pixels.
struct VisiblePixels<'a, P> {
    grid: Grid,
    hidden: &'a [u64],
    pixels: &'a [P],
}

impl<P: Colour> VisiblePixels<'_, P> {
    /// Sum over the visible pixels of a tile.
    fn of_tile(&self, column: usize, row: usize) -> Sum {
        let grid = self.grid;
        let mut sum = [0.0; 5];
        if column >= grid.columns || row >= grid.rows {
            return sum;
        }
        let [across, down] = grid.extent(column, row);
        let mask = self.hidden[row * grid.columns + column];
        if mask == 0 && [across, down] == [TILE; 2] {
            // The usual case: the whole tile is visible.
            let visible = P::sum_of_tile(&self.pixels[row * TILE * grid.width + column * TILE..], grid.width);
            sum[..4].copy_from_slice(&visible);
            sum[4] = BLOCK as f32;
            return sum;
        }
        for j in 0..down {
            let line = &self.pixels[(row * TILE + j) * grid.width + column * TILE..][..across];
            for (i, pixel) in line.iter().enumerate() {
                if mask >> (j * TILE + i) & 1 == 1 {
                    continue;
                }
                let levels = pixel.in_levels();
                for c in 0..4 {
                    sum[c] += levels[c];
                }
                sum[4] += 1.0;
            }
        }
        sum
    }

    /// Prefetches the pixels of a tile.
    #[inline(always)]
    fn prefetch_tile(&self, column: usize, row: usize) {
        for j in 0..TILE {
            self.pixels.get((row * TILE + j) * self.grid.width + column * TILE).into_iter().for_each(prefetch);
        }
    }

    /// Computes the cells of a square; returns whether it has no visible pixel.
    fn build(&self, corner: [usize; 2], cells: &mut [Sum; SQUARE_TILES * SQUARE_TILES]) -> bool {
        for (index, cell) in cells.iter_mut().enumerate() {
            let [column, row] = [corner[0] + index % SQUARE_TILES, corner[1] + index / SQUARE_TILES];
            self.prefetch_tile(column, row + 1);
            *cell = self.of_tile(column, row);
        }
        let mut levels = ([[0.0; 5]; 64], [[0.0; 5]; 16], [[0.0; 5]; 4], [[0.0; 5]; 1]);
        pull(cells, &mut levels.0, 8);
        pull(&levels.0, &mut levels.1, 4);
        pull(&levels.1, &mut levels.2, 2);
        pull(&levels.2, &mut levels.3, 1);
        push(&levels.3, &mut levels.2, 1);
        push(&levels.2, &mut levels.1, 2);
        push(&levels.1, &mut levels.0, 4);
        push(&levels.0, cells, 8);
        levels.3[0][4] == 0.0
    }
}

/// Sums 2x2 cells of a level into each cell of the one above, which has `side` cells per row.
fn pull(below: &[Sum], above: &mut [Sum], side: usize) {
    for (row, sums) in above.chunks_mut(side).enumerate() {
        for (column, sum) in sums.iter_mut().enumerate() {
            let first = 4 * row * side + 2 * column;
            for child in [first, first + 1, first + 2 * side, first + 2 * side + 1] {
                (0..5).for_each(|c| sum[c] += below[child][c]);
            }
        }
    }
}

/// Adds the parents' colours to the cells below; `side` is the number of parents per row.
fn push(above: &[Sum], below: &mut [Sum], side: usize) {
    for (row, sums) in below.chunks_mut(2 * side).enumerate() {
        for (column, sum) in sums.iter_mut().enumerate() {
            let parent = above[row / 2 * side + column / 2];
            let weight = PARENT_WEIGHT / parent[4].max(PARENT_WEIGHT);
            (0..5).for_each(|c| sum[c] += parent[c] * weight);
        }
    }
}

/// Bilinear interpolation between the tile centres.
fn colour(cells: &[[Sum; SQUARE_TILES * SQUARE_TILES]], columns: usize, grid: Grid, x: usize, y: usize) -> [f32; 4] {
    let axis = |at: usize, len: usize| {
        let at = ((at as f32 + 0.5) / TILE as f32 - 0.5).clamp(0.0, (len - 1) as f32);
        let first = (at as usize).min(len - 1);
        (first, (first + 1).min(len - 1), at - first as f32)
    };
    let (left, right, fx) = axis(x, grid.columns);
    let (top, bottom, fy) = axis(y, grid.rows);
    let mut sum = [0.0; 5];
    for (row, wy) in [(top, 1.0 - fy), (bottom, fy)] {
        for (column, wx) in [(left, 1.0 - fx), (right, fx)] {
            let cell = cells[row / SQUARE_TILES * columns + column / SQUARE_TILES]
                [row % SQUARE_TILES * SQUARE_TILES + column % SQUARE_TILES];
            (0..5).for_each(|c| sum[c] += cell[c] * wx * wy);
        }
    }
    std::array::from_fn(|c| sum[c] / sum[4].max(1e-6))
}
