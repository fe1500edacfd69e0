//! Colours for what neither anchor shows: from a pyramid of the colours around.

use std::sync::atomic::{AtomicBool, Ordering};

use super::colour::Colour;
use super::kernels::{BLOCK, TILE, prefetch};
use super::key_buffer::Grid;
use super::resize;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Raster, Result};

/// Tiles across and down of a square that has a pyramid of its own: of 16 x 16, 8 x 8, 4 x 4, 2 x 2 and one.
const SQUARE_TILES: usize = 16;
/// What a coarser level's colour weighs in a cell, in pixels.
const PARENT_WEIGHT: f32 = 1.0 / 16.0;

/// Three channels and alpha, each times the weight, and the weight: how many pixels are visible.
type Sum = [f32; 5];

/// The pyramids; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Inpainter {
    /// Squares to a row.
    columns: usize,
    /// Which squares are needed.
    is_needed: Vec<bool>,
    /// The cells of a square stand together, a cell to a tile.
    cells: Vec<[Sum; SQUARE_TILES * SQUARE_TILES]>,
    /// What is visible of each row of tiles.
    rows: Vec<Sum>,
}

impl Inpainter {
    /// Paints the pixels of `hidden`, one bit for each in a word for each tile. There is a colour for each tile; what is
    /// visible of it outweighs what the tiles around lend it, by twos, fours and so on.
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

    /// Makes room for what the pictures of a grid may need.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.columns = grid.columns.div_ceil(SQUARE_TILES);
        let squares = self.columns * grid.rows.div_ceil(SQUARE_TILES);
        resize(&mut self.is_needed, squares, false)?;
        resize(&mut self.cells, squares, [[0.0; 5]; SQUARE_TILES * SQUARE_TILES])?;
        resize(&mut self.rows, grid.rows, [0.0; 5])
    }

    /// A pixel is painted from its tile and from those beside it.
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

    /// Where nothing is visible of a whole square, the mean of the picture serves; black where nothing is visible at all.
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

/// What is visible of a picture.
struct VisiblePixels<'a, P> {
    grid: Grid,
    hidden: &'a [u64],
    pixels: &'a [P],
}

impl<P: Colour> VisiblePixels<'_, P> {
    /// The sum over the pixels of a tile that are not hidden.
    fn of_tile(&self, column: usize, row: usize) -> Sum {
        let grid = self.grid;
        let mut sum = [0.0; 5];
        if column >= grid.columns || row >= grid.rows {
            return sum;
        }
        let [across, down] = grid.extent(column, row);
        let mask = self.hidden[row * grid.columns + column];
        if mask == 0 && [across, down] == [TILE; 2] {
            // Mostly nothing of a tile is hidden.
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

    /// Asks for the pixels of a tile.
    #[inline(always)]
    fn prefetch_tile(&self, column: usize, row: usize) {
        for j in 0..TILE {
            self.pixels.get((row * TILE + j) * self.grid.width + column * TILE).into_iter().for_each(prefetch);
        }
    }

    /// Fills the cells of a square; says whether nothing is visible of it.
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

/// Adds up the cells of a level, four to a cell of the level above, which has `side` of them to a row.
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

/// Down again: what is visible of a cell outweighs what its parent, of which there are `side` to a row, lends it.
fn push(above: &[Sum], below: &mut [Sum], side: usize) {
    for (row, sums) in below.chunks_mut(2 * side).enumerate() {
        for (column, sum) in sums.iter_mut().enumerate() {
            let parent = above[row / 2 * side + column / 2];
            let weight = PARENT_WEIGHT / parent[4].max(PARENT_WEIGHT);
            (0..5).for_each(|c| sum[c] += parent[c] * weight);
        }
    }
}

/// The colour at a pixel, between the middles of the tiles.
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
