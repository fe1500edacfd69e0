//! Densification: from patch motion to pixel motion.
//!
//! Pixels are processed in blocks of 8 x 8. Where motion is continuous in and around the block, it is interpolated
//! bilinearly. Elsewhere there is a motion edge: every distinct motion around the block is tried for every pixel, and each pixel gets
//! the one with the smallest difference over its 5 x 5 neighbourhood.

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x8};

use super::grid::Grid;
use super::pyramid::{Plane, floor};
use super::reserve;
use crate::Result;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Pixels along a block's side.
const BLOCK: usize = 8;
/// Radius of the neighbourhood over which differences are summed, in pixels.
const RADIUS: usize = 2;
const BLOCK_WITH_MARGIN: usize = BLOCK + 2 * RADIUS;
const DIAMETER: usize = 2 * RADIUS + 1;
/// Row length of a block with its margin, rounded up to a multiple of the vector length.
const LANES: usize = 16;
/// Largest number of candidate motions per block.
const MAX_CANDIDATES: usize = 8;
/// Candidates closer than this, in pixels, are merged.
const MERGE_DISTANCE: f32 = 0.25;
/// Motions closer than this, in pixels, belong to the same surface.
const SAME_SURFACE: f32 = 1.0;
/// A pixel's difference is clamped to this, in code values.
const MAX_DIFFERENCE: f32 = 20.0;
/// Difference assigned to a pixel whose motion leads out of the picture, in code values.
const OUTSIDE_DIFFERENCE: f32 = 8.0;
/// A mean difference above this is a mismatch, in code values.
const MISMATCH: f32 = 16.0;

/// Per-pixel motion, in pixels.
#[derive(Debug, Default)]
pub(super) struct Dense {
    pub(super) width: usize,
    pub(super) flow: Vec<[f32; 2]>,
    /// Whether the other picture matches at the end of the motion.
    pub(super) has_match: Vec<bool>,
}

/// Motion and brightening of the cells in and around a block.
struct Window {
    flow: [[f32; 2]; 16],
    brightening: [f32; 16],
    /// Cells per side: 3 at stride 8, 4 at stride 4.
    side: usize,
}

/// Linear interpolation of 8 pixels: indices of the nearer and the farther cell, and the weight of the farther one.
struct Taps {
    near: [usize; BLOCK],
    far: [usize; BLOCK],
    weight: [f32; BLOCK],
}

const WIDE_TAPS: Taps = taps(8);
const TAPS: Taps = taps(4);

const fn taps(stride: usize) -> Taps {
    let mut taps = Taps { near: [0; BLOCK], far: [0; BLOCK], weight: [0.0; BLOCK] };
    let mut x = 0;
    while x < BLOCK {
        let within = (x % stride) as f32 + 0.5 - 0.5 * stride as f32;
        taps.near[x] = 1 + x / stride;
        taps.far[x] = if within < 0.0 { x / stride } else { 2 + x / stride };
        taps.weight[x] = if within < 0.0 { -within } else { within } / stride as f32;
        x += 1;
    }
    taps
}

/// Cell indices of a window, sorted by distance from its centre.
const ORDER_OF_9: [usize; 9] = [4, 3, 5, 1, 7, 0, 2, 6, 8];
const ORDER_OF_16: [usize; 16] = [5, 6, 9, 10, 1, 2, 4, 7, 8, 11, 13, 14, 0, 3, 12, 15];

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "DENSE_": int BLOCK, int RADIUS, uint BLOCK_WITH_MARGIN, uint MAX_CANDIDATES, float MERGE_DISTANCE,
    float SAME_SURFACE, float MAX_DIFFERENCE, float OUTSIDE_DIFFERENCE, float MISMATCH, [uint] ORDER_OF_9,
    [uint] ORDER_OF_16
);

impl Dense {
    /// Motion of the pixels of row `y`.
    pub(super) fn row(&self, y: usize) -> &[[f32; 2]] {
        &self.flow[y * self.width..][..self.width]
    }

    /// Computes the motion of every pixel of `from` from the patches of `grid`.
    pub(super) fn densify(&mut self, level: Level, from: &Plane, to: &Plane, grid: &Grid) -> Result<()> {
        self.width = from.width;
        reserve(&mut self.flow, from.luma.len(), [0.0; 2])?;
        reserve(&mut self.has_match, from.luma.len(), false)?;
        let rows = self.flow.par_chunks_mut(BLOCK * from.width).zip(self.has_match.par_chunks_mut(BLOCK * from.width));
        rows.enumerate().for_each(|(j, (flow, has_match))| {
            dispatch!(level, simd => densify_row(simd, from, to, grid, j, flow, has_match));
        });
        Ok(())
    }
}

/// Densifies row `j` of blocks.
#[inline(always)]
fn densify_row<S: Simd>(
    simd: S,
    from: &Plane,
    to: &Plane,
    grid: &Grid,
    j: usize,
    flow: &mut [[f32; 2]],
    has_match: &mut [bool],
) {
    let width = from.width;
    for i in 0..width.div_ceil(BLOCK) {
        let (window, is_discontinuous) = Window::new(grid, i, j);
        let origin = [(i * BLOCK) as i32, (j * BLOCK) as i32];
        let (motion, is_match) = if is_discontinuous {
            window.choose_per_pixel(simd, from, to, origin)
        } else {
            (window.bilinear(simd), [[true; 8]; 8])
        };
        let len = BLOCK.min(width - i * BLOCK);
        let rows = flow.chunks_exact_mut(width).zip(has_match.chunks_exact_mut(width));
        for (y, (flow, has_match)) in rows.enumerate() {
            let [u, v] = [&motion[0][y], &motion[1][y]];
            let flow = &mut flow[i * BLOCK..i * BLOCK + len];
            for (x, flow) in flow.iter_mut().enumerate() {
                *flow = [u[x], v[x]];
            }
            has_match[i * BLOCK..i * BLOCK + len].copy_from_slice(&is_match[y][..len]);
        }
    }
}

type Block = [[f32; BLOCK]; BLOCK];

impl Window {
    /// The window of block (i, j), and whether motion is discontinuous at any of its cells.
    #[inline(always)]
    fn new(grid: &Grid, i: usize, j: usize) -> (Self, bool) {
        let (side, cells) = if grid.stride == BLOCK { (3, 1) } else { (4, 2) };
        let mut window = Self { flow: [[0.0; 2]; 16], brightening: [0.0; 16], side };
        let mut is_discontinuous = false;
        for y in 0..side {
            let row = (j * cells + y).saturating_sub(1).min(grid.down - 1);
            for x in 0..side {
                let column = (i * cells + x).saturating_sub(1).min(grid.across - 1);
                let k = row * grid.across + column;
                window.flow[y * side + x] = grid.flow.at(column, row);
                window.brightening[y * side + x] = grid.matches[k].brightening;
                is_discontinuous |= grid.discontinuous[k];
            }
        }
        (window, is_discontinuous)
    }

    /// Bilinear interpolation between the cells.
    #[inline(always)]
    fn bilinear<S: Simd>(&self, simd: S) -> [Block; 2] {
        let taps = if self.side == 3 { &WIDE_TAPS } else { &TAPS };
        let mut motion = [[[0.0; BLOCK]; BLOCK]; 2];
        for (axis, motion) in motion.iter_mut().enumerate() {
            let mut rows = [[0.0_f32; BLOCK]; 4];
            for (y, row) in rows.iter_mut().enumerate().take(self.side) {
                for (x, value) in row.iter_mut().enumerate() {
                    let at = |x: usize| self.flow[y * self.side + x][axis];
                    let near = at(taps.near[x]);
                    // Computed from differences, so that equal motions stay equal to the last bit.
                    *value = near + (at(taps.far[x]) - near) * taps.weight[x];
                }
            }
            for (y, out) in motion.iter_mut().enumerate() {
                let near = f32x8::from_slice(simd, &rows[taps.near[y]]);
                let far = f32x8::from_slice(simd, &rows[taps.far[y]]);
                (near + (far - near) * taps.weight[y]).store_slice(out);
            }
        }
        motion
    }

    /// Indices of cells with distinct motions, nearest to the window's centre first, and how many there are.
    #[inline(always)]
    fn distinct_motions(&self) -> ([usize; MAX_CANDIDATES], usize) {
        let order = if self.side == 3 { &ORDER_OF_9[..] } else { &ORDER_OF_16[..] };
        let (mut picked, mut count) = ([0; MAX_CANDIDATES], 0);
        for &cell in order {
            let [u, v] = self.flow[cell];
            let near = |&other: &usize| {
                let [a, b] = self.flow[other];
                (a - u).abs().max((b - v).abs()) < MERGE_DISTANCE
            };
            if count < MAX_CANDIDATES && !picked[..count].iter().any(near) {
                picked[count] = cell;
                count += 1;
            }
        }
        (picked, count)
    }

    /// Chooses the best candidate for each pixel of the block at `origin`. Also returns whether the pixel matches at that motion.
    #[inline(always)]
    fn choose_per_pixel<S: Simd>(
        &self,
        simd: S,
        from: &Plane,
        to: &Plane,
        origin: [i32; 2],
    ) -> ([Block; 2], [[bool; BLOCK]; BLOCK]) {
        let (motions, count) = self.distinct_motions();
        let radius = RADIUS as i32;
        let corner = [origin[0] - radius, origin[1] - radius];
        let own = from.block::<{ LANES + 1 }>(corner[0], corner[1]);
        let none = f32x8::splat(simd, 0.0);
        let mut best = [f32x8::splat(simd, f32::INFINITY); BLOCK];
        let mut label = [none; BLOCK];
        for (number, &cell) in motions[..count].iter().enumerate() {
            let differences = self.differences(simd, cell, &own, to, corner);
            let number = f32x8::splat(simd, number as f32);
            for y in 0..BLOCK {
                let mut sums = [0.0; LANES];
                for half in [0, BLOCK] {
                    let mut sum = none;
                    for row in &differences[y..y + DIAMETER] {
                        sum += f32x8::from_slice(simd, &row[half..half + BLOCK]);
                    }
                    sum.store_slice(&mut sums[half..half + BLOCK]);
                }
                let mut sum = none;
                for dx in 0..DIAMETER {
                    sum += f32x8::from_slice(simd, &sums[dx..dx + BLOCK]);
                }
                let is_better = sum.simd_lt(best[y]);
                best[y] = is_better.select(sum, best[y]);
                label[y] = is_better.select(number, label[y]);
            }
        }
        let mut motion = [[none; BLOCK]; 2];
        for (number, &cell) in motions[..count].iter().enumerate() {
            let surface_motion = self.surface_motion(simd, cell);
            let number = f32x8::splat(simd, number as f32);
            for y in 0..BLOCK {
                let is_own = label[y].simd_eq(number);
                motion[0][y] = is_own.select(surface_motion[0][y], motion[0][y]);
                motion[1][y] = is_own.select(surface_motion[1][y], motion[1][y]);
            }
        }
        let (mut chosen, mut is_match) = ([[[0.0; BLOCK]; BLOCK]; 2], [[false; BLOCK]; BLOCK]);
        for y in 0..BLOCK {
            motion[0][y].store_slice(&mut chosen[0][y]);
            motion[1][y].store_slice(&mut chosen[1][y]);
            let best = <[f32; BLOCK]>::from(best[y]);
            for x in 0..BLOCK {
                is_match[y][x] = best[x] <= MISMATCH * (DIAMETER * DIAMETER) as f32;
            }
        }
        (chosen, is_match)
    }

    /// Absolute differences between `own`, the block with its margin at `corner`, and `to` displaced by the motion of `cell`.
    #[inline(always)]
    fn differences<S: Simd>(
        &self,
        simd: S,
        cell: usize,
        own: &[[f32; LANES + 1]; LANES + 1],
        to: &Plane,
        corner: [i32; 2],
    ) -> [[f32; LANES]; BLOCK_WITH_MARGIN] {
        let flow = self.flow[cell];
        let brightening = self.brightening[cell];
        let whole = [floor(flow[0]), floor(flow[1])];
        let [fx, fy] = [flow[0] - whole[0] as f32, flow[1] - whole[1] as f32];
        let (left, top) = (corner[0] + whole[0], corner[1] + whole[1]);
        let block = to.block::<{ LANES + 1 }>(left, top);
        let mut differences = [[0.0; LANES]; BLOCK_WITH_MARGIN];
        let most = f32x8::splat(simd, MAX_DIFFERENCE);
        for half in [0, BLOCK] {
            let mut above = across(simd, &block[0], half, fx);
            for y in 0..BLOCK_WITH_MARGIN {
                let below = across(simd, &block[y + 1], half, fx);
                let here = f32x8::from_slice(simd, &own[y][half..half + BLOCK]);
                let difference = (above + (below - above) * fy - here - brightening).abs();
                difference.min(most).store_slice(&mut differences[y][half..half + BLOCK]);
                above = below;
            }
        }
        if !to.holds(left, top, LANES + 1) {
            for (row, y) in differences.iter_mut().zip(top..) {
                for (value, x) in row.iter_mut().zip(left..) {
                    if !to.holds(x, y, 1) {
                        *value = OUTSIDE_DIFFERENCE;
                    }
                }
            }
        }
        differences
    }

    /// Smooth motion over the block of the surface that `cell` belongs to: the weighted mean of all cells within [`SAME_SURFACE`] of it.
    #[inline(always)]
    fn surface_motion<S: Simd>(&self, simd: S, cell: usize) -> [[f32x8<S>; BLOCK]; 2] {
        let taps = if self.side == 3 { &WIDE_TAPS } else { &TAPS };
        let own = self.flow[cell];
        let none = f32x8::splat(simd, 0.0);
        let (mut weights, mut sums) = ([f32x8::splat(simd, 1e-6); BLOCK], [[none; BLOCK]; 2]);
        for row in 0..self.side {
            let down = tent(taps, row);
            for column in 0..self.side {
                let there = self.flow[row * self.side + column];
                let apart = [there[0] - own[0], there[1] - own[1]];
                if apart[0].abs().max(apart[1].abs()) >= SAME_SURFACE {
                    continue;
                }
                let across = f32x8::from_slice(simd, &tent(taps, column));
                for y in 0..BLOCK {
                    let weight = across * down[y];
                    weights[y] += weight;
                    sums[0][y] += weight * apart[0];
                    sums[1][y] += weight * apart[1];
                }
            }
        }
        for y in 0..BLOCK {
            sums[0][y] = sums[0][y] / weights[y] + own[0];
            sums[1][y] = sums[1][y] / weights[y] + own[1];
        }
        sums
    }
}

/// Weight of cell `cell` along one side for each of the 8 pixels: a tent of half-width two cells.
#[inline(always)]
fn tent(taps: &Taps, cell: usize) -> [f32; BLOCK] {
    let mut weights = [0.0; BLOCK];
    for (x, weight) in weights.iter_mut().enumerate() {
        let sign = if taps.far[x] > taps.near[x] { 1.0 } else { -1.0 };
        let at = taps.near[x] as f32 + sign * taps.weight[x];
        *weight = (2.0 - (at - cell as f32).abs()).max(0.0);
    }
    weights
}

/// Linear interpolation at eight positions of a row from `x` on, each shifted right by `fraction` of a pixel.
#[inline(always)]
fn across<S: Simd>(simd: S, row: &[f32; LANES + 1], x: usize, fraction: f32) -> f32x8<S> {
    let left = f32x8::from_slice(simd, &row[x..x + BLOCK]);
    left + (f32x8::from_slice(simd, &row[x + 1..x + 1 + BLOCK]) - left) * fraction
}
