//! The grid of patches of one level: their search and their smoothing.

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x8};

use super::model::{MotionModel, Sample};
use super::patch::{PatchMatch, SAME_START, SIDE, Template};
use super::pyramid::Plane;
use super::{SMALL_LEVEL, reserve, wide};
use crate::tasks::{Parallel, ParallelSliceMut};
use crate::{Error, ErrorKind, Result};

/// Patch stride in pixels.
pub(super) const STRIDE: usize = 4;
/// Patch stride on the finest level of a large picture, where denser patches bring nothing.
pub(super) const WIDE_STRIDE: usize = 8;
/// Jacobi iterations of the smoothing.
pub(super) const ROUNDS: usize = 12;
/// Weight of a neighbour's motion against a patch's own data term, per squared pixel.
const LAMBDA: f32 = 0.3;
/// Noise variance of a matching pixel, in squared code values.
const NOISE: f32 = 1.0;
/// Luma difference at which the weight between neighbours halves, in code values.
const LUMA_SCALE: f32 = 25.0;
/// Motion difference at which the weight between neighbours halves, in pixels.
const FLOW_SCALE: f32 = 1.0;
/// Motion is discontinuous at a cell if it differs by more than this from the mean of two opposite neighbours, in pixels per pixel
/// of stride.
const DISCONTINUITY: f32 = 0.5;
/// Sum of H's diagonal over the residual at which a patch has half of the full weight in the global model.
const HALF_WEIGHT_INFORMATION: f32 = 4.0;
/// Motion is extrapolated from two neighbours only if they differ by less than this, in pixels.
const MAX_EXTRAPOLATED_STEP: f32 = 2.0;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "GRID_": float LAMBDA, float NOISE, float LUMA_SCALE, float DISCONTINUITY, float HALF_WEIGHT_INFORMATION,
    float MAX_EXTRAPOLATED_STEP
);

/// Largest number of cells sampled for the global model.
pub(super) const SAMPLES: usize = 400;
/// Cells processed at once by vector instructions.
const LANES: usize = 8;
/// Smallest number of cells per parallel task of the smoothing.
const MIN_CELLS_PER_TASK: usize = 4096;

/// The patches of one level: one per square cell, centred on it.
#[derive(Debug, Default)]
pub(super) struct Grid {
    pub(super) across: usize,
    pub(super) down: usize,
    /// Pixels along a cell's side.
    pub(super) stride: usize,
    /// Search result of each patch.
    pub(super) matches: Vec<PatchMatch>,
    /// Motion of each patch after smoothing.
    pub(super) flow: Padded<2>,
    next: Padded<2>,
    smoothing_inputs: Padded<7>,
    /// Whether a cell's motion differs from the mean of its left and right, or upper and lower, neighbours by more than [`DISCONTINUITY`].
    pub(super) discontinuous: Vec<bool>,
    /// Global motion model of the picture.
    model: Option<MotionModel>,
    samples: Vec<Sample>,
}

/// `N` planes with one value per cell each, with a border of one zero cell on all sides.
#[derive(Debug)]
pub(super) struct Padded<const N: usize> {
    /// Cells per row, border included.
    pitch: usize,
    planes: [Vec<f32>; N],
}

/// Inputs of the smoothing for one row of cells: matched motion, its H over the residual, and the luma penalties to the neighbours.
#[derive(Debug, Clone, Copy)]
struct SmoothingRow<'a> {
    flow: [&'a [f32]; 2],
    hessian: [&'a [f32]; 3],
    /// Penalty to the left neighbour; the next entry is that to the right neighbour.
    horizontal: &'a [f32],
    above: &'a [f32],
    below: &'a [f32],
}

/// How the first search of a level goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct FirstSearch {
    /// Distance of the patches, in pixels.
    pub(super) stride: usize,
    /// Whether all motions nearby are compared where the match is poor, on a small level.
    pub(super) is_wide: bool,
}

impl<const N: usize> Default for Padded<N> {
    fn default() -> Self {
        Self { pitch: 0, planes: std::array::from_fn(|_| Vec::new()) }
    }
}

impl<const N: usize> Padded<N> {
    fn resize(&mut self, across: usize, down: usize) -> Result<()> {
        self.pitch = across + 2;
        self.planes.iter_mut().try_for_each(|plane| reserve(plane, (across + 2) * (down + 2), 0.0))
    }

    /// The values of cell (i, j).
    #[inline(always)]
    pub(super) fn at(&self, i: usize, j: usize) -> [f32; N] {
        let k = (j + 1) * self.pitch + i + 1;
        std::array::from_fn(|n| self.planes[n][k])
    }

    /// Row `j` of plane `n` with its border cells; rows -1 and `down` are the border.
    #[inline(always)]
    fn row(&self, n: usize, j: isize) -> &[f32] {
        let start = (j + 1) as usize * self.pitch;
        &self.planes[n][start..start + self.pitch]
    }
}

impl Grid {
    /// Searches every patch of `from` (one per `stride` pixels) in `to`, starting from the motions of the `coarse` level.
    pub(super) fn search(
        &mut self,
        level: Level,
        from: &Plane,
        to: &Plane,
        coarse: Option<&Grid>,
        first: FirstSearch,
    ) -> Result<()> {
        self.stride = first.stride;
        (self.across, self.down) = (from.width.div_ceil(self.stride), from.height.div_ceil(self.stride));
        let across = self.across;
        reserve(&mut self.matches, across * self.down, PatchMatch::default())?;
        self.matches.par_chunks_mut(across).enumerate().for_each(|(j, row)| {
            dispatch!(level, simd => search_row(simd, from, to, coarse, first, j, row));
        });
        Ok(())
    }

    /// Searches again from the smoothed motion of each patch and of its neighbours, where that differs from the matched motion. This
    /// propagates correct motion from patch to patch, also where it changes linearly.
    pub(super) fn search_again(&mut self, level: Level, from: &Plane, to: &Plane) {
        // Moved out so that the rows can be written while the rest of the grid is read.
        let mut found = std::mem::take(&mut self.matches);
        let this = &*self;
        found.par_chunks_mut(this.across).enumerate().for_each(|(j, row)| {
            dispatch!(level, simd => search_row_again(simd, from, to, this, j, row));
        });
        self.matches = found;
    }

    /// Start motions for the repeated search of cell (i, j): its own, the global model's, and one linearly extrapolated from each side.
    #[inline(always)]
    fn starts_again(&self, i: usize, j: usize) -> [[f32; 2]; 6] {
        let own = self.flow.at(i, j);
        let extrapolated = |next: Option<(usize, usize)>, farther: Option<(usize, usize)>| {
            let Some((i, j)) = next.filter(|(i, j)| *i < self.across && *j < self.down) else { return own };
            let next = self.flow.at(i, j);
            let Some((i, j)) = farther.filter(|(i, j)| *i < self.across && *j < self.down) else { return next };
            let slope = [0, 1].map(|axis| next[axis] - self.flow.at(i, j)[axis]);
            let is_straight = slope[0].abs().max(slope[1].abs()) < MAX_EXTRAPOLATED_STEP;
            if is_straight { [next[0] + slope[0], next[1] + slope[1]] } else { next }
        };
        let left = |by: usize| i.checked_sub(by).map(|i| (i, j));
        let above = |by: usize| j.checked_sub(by).map(|j| (i, j));
        [
            own,
            self.model.map_or(own, |model| model.at(self.centre(i, j))),
            extrapolated(left(1), left(2)),
            extrapolated(Some((i + 1, j)), Some((i + 2, j))),
            extrapolated(above(1), above(2)),
            extrapolated(Some((i, j + 1)), Some((i, j + 2))),
        ]
    }

    /// Centre of cell (i, j), in pixels.
    #[inline(always)]
    fn centre(&self, i: usize, j: usize) -> [f32; 2] {
        [(i as f32 + 0.5) * self.stride as f32, (j as f32 + 0.5) * self.stride as f32]
    }

    /// Fits the global model to the smoothed motion of a regular subset of the cells.
    pub(super) fn fit(&mut self) -> Result<()> {
        let fits = |step: &usize| self.across.div_ceil(*step) * self.down.div_ceil(*step) <= SAMPLES;
        let step = (1..).find(fits).unwrap_or(1);
        self.samples.clear();
        self.samples.try_reserve(SAMPLES).map_err(|_| Error::new(ErrorKind::OutOfMemory, "no room for samples"))?;
        for j in (0..self.down).step_by(step) {
            for i in (0..self.across).step_by(step) {
                let found = &self.matches[j * self.across + i];
                let information = (found.hessian[0] + found.hessian[2]) / (found.residual + NOISE);
                let weight = information / (information + HALF_WEIGHT_INFORMATION);
                self.samples.push(Sample { position: self.centre(i, j), flow: self.flow.at(i, j), weight });
            }
        }
        self.model =
            MotionModel::fit(&self.samples, [self.across, self.down].map(|cells| (cells * self.stride) as f32));
        Ok(())
    }

    /// Start motions for cell (i, j) of the next finer level: the enclosing coarse cell's, the global model's, the adjacent cells', and
    /// zero.
    #[inline(always)]
    fn starts(&self, i: usize, j: usize, stride: usize) -> [[f32; 2]; 7] {
        let (last_x, last_y) = (self.across - 1, self.down - 1);
        let at = |x: usize, y: usize| {
            let [u, v] = self.flow.at(x.min(last_x), y.min(last_y));
            [2.0 * u, 2.0 * v]
        };
        let centre = [i, j].map(|k| (k as f32 + 0.5) * stride as f32);
        let whole = self.model.map_or([0.0; 2], |model| model.doubled().at(centre));
        if stride == 2 * self.stride {
            // Each fine cell covers exactly one coarse cell.
            let (left, above) = (at(i.saturating_sub(1), j), at(i, j.saturating_sub(1)));
            return [at(i, j), whole, left, at(i + 1, j), above, at(i, j + 1), [0.0; 2]];
        }
        // The four coarse cells around the fine cell's centre.
        let nearest_two = |i: usize| [i / 2, if i.is_multiple_of(2) { (i / 2).saturating_sub(1) } else { i / 2 + 1 }];
        let ([x, next_x], [y, next_y]) = (nearest_two(i), nearest_two(j));
        [at(x, y), whole, at(next_x, y), at(x, next_y), at(next_x, next_y), [0.0; 2], [0.0; 2]]
    }

    /// Smooths the motion by Jacobi iterations of the normal equations; the weights are recomputed in each. Patches with strong data
    /// terms keep their motion, the others approach their neighbours'.
    pub(super) fn smooth(&mut self, level: Level) -> Result<()> {
        let (across, down) = (self.across, self.down);
        self.flow.resize(across, down)?;
        self.next.resize(across, down)?;
        self.smoothing_inputs.resize(across, down)?;
        self.fill_smoothing_inputs();
        let pitch = across + 2;
        for _ in 0..ROUNDS {
            let (flow, smoothing_inputs) = (&self.flow, &self.smoothing_inputs);
            let [next_x, next_y] = &mut self.next.planes;
            let rows = next_x[pitch..].par_chunks_mut(pitch).zip(next_y[pitch..].par_chunks_mut(pitch)).take(down);
            rows.with_min_len(MIN_CELLS_PER_TASK.div_ceil(across)).enumerate().for_each(|(j, (x, y))| {
                let j = j as isize;
                let row = |n| smoothing_inputs.row(n, j);
                let known = SmoothingRow {
                    flow: [row(0), row(1)],
                    hessian: [row(2), row(3), row(4)],
                    horizontal: row(5),
                    above: row(6),
                    below: smoothing_inputs.row(6, j + 1),
                };
                let around = [j - 1, j, j + 1].map(|j| [flow.row(0, j), flow.row(1, j)]);
                dispatch!(level, simd => relax_row(simd, known, around, [&mut x[1..=across], &mut y[1..=across]]));
            });
            std::mem::swap(&mut self.flow, &mut self.next);
        }
        reserve(&mut self.discontinuous, across * down, false)?;
        let (flow, discontinuous, most) = (&self.flow, &mut self.discontinuous, DISCONTINUITY * self.stride as f32);
        discontinuous.par_chunks_mut(across).with_min_len(MIN_CELLS_PER_TASK.div_ceil(across)).enumerate().for_each(
            |(j, row)| {
                for (i, discontinuous) in row.iter_mut().enumerate() {
                    let own = flow.at(i, j);
                    let far = |one: [f32; 2], other: [f32; 2]| {
                        [0, 1].into_iter().any(|axis| (0.5 * (one[axis] + other[axis]) - own[axis]).abs() > most)
                    };
                    let (left, right) = (i.saturating_sub(1), (i + 1).min(across - 1));
                    let (above, below) = (j.saturating_sub(1), (j + 1).min(down - 1));
                    *discontinuous =
                        far(flow.at(left, j), flow.at(right, j)) || far(flow.at(i, above), flow.at(i, below));
                }
            },
        );
        Ok(())
    }

    /// Fills the planes that the smoothing reads.
    fn fill_smoothing_inputs(&mut self) {
        let (across, down, pitch) = (self.across, self.down, self.across + 2);
        for planes in [&mut self.flow.planes[..], &mut self.next.planes[..], &mut self.smoothing_inputs.planes[..]] {
            for plane in planes {
                // The border may hold values from a grid of another size.
                plane[..pitch].fill(0.0);
                plane[(down + 1) * pitch..].fill(0.0);
                for row in plane.chunks_exact_mut(pitch) {
                    (row[0], row[pitch - 1]) = (0.0, 0.0);
                }
            }
        }
        for (j, row) in self.matches.chunks_exact(across).enumerate() {
            for (i, found) in row.iter().enumerate() {
                let k = (j + 1) * pitch + i + 1;
                let certain = 1.0 / (found.residual + NOISE);
                let penalty = |other: f32| {
                    let difference = (other - found.mean) * (1.0 / LUMA_SCALE);
                    1.0 + difference * difference
                };
                let [u, v] = found.flow;
                let [xx, xy, yy] = found.hessian.map(|h| h * certain);
                // Penalties: the neighbour's weight is LAMBDA divided by them. A missing neighbour has an infinite penalty, so weight 0.
                let left = if i > 0 { penalty(row[i - 1].mean) } else { f32::INFINITY };
                let above = if j > 0 { penalty(self.matches[(j - 1) * across + i].mean) } else { f32::INFINITY };
                for (plane, value) in self.smoothing_inputs.planes.iter_mut().zip([u, v, xx, xy, yy, left, above]) {
                    plane[k] = value;
                }
                (self.flow.planes[0][k], self.flow.planes[1][k]) = (u, v);
            }
            self.smoothing_inputs.planes[5][(j + 2) * pitch - 1] = f32::INFINITY;
        }
        self.smoothing_inputs.planes[6][(down + 1) * pitch..].fill(f32::INFINITY);
    }
}

#[inline(always)]
fn search_row<S: Simd>(
    simd: S,
    from: &Plane,
    to: &Plane,
    coarse: Option<&Grid>,
    FirstSearch { stride, is_wide }: FirstSearch,
    j: usize,
    row: &mut [PatchMatch],
) {
    let margin = (SIDE - stride) as i32 / 2;
    let is_wide = is_wide && from.luma.len() <= SMALL_LEVEL;
    for (i, found) in row.iter_mut().enumerate() {
        let origin = [i, j].map(|k| (k * stride) as i32 - margin);
        let template = Template::new(simd, from, origin);
        *found = match coarse {
            Some(coarse) => template.search(simd, to, &coarse.starts(i, j, stride)),
            None => template.search(simd, to, &[[0.0; 2]]),
        };
        if is_wide && found.residual > wide::POOR {
            wide::search(simd, from, to, origin, found);
        }
    }
}

#[inline(always)]
fn search_row_again<S: Simd>(simd: S, from: &Plane, to: &Plane, grid: &Grid, j: usize, row: &mut [PatchMatch]) {
    let margin = (SIDE - grid.stride) as i32 / 2;
    for (i, found) in row.iter_mut().enumerate() {
        let starts = grid.starts_again(i, j);
        let [u, v] = found.flow;
        if starts.iter().all(|start| (start[0] - u).abs().max((start[1] - v).abs()) < SAME_START) {
            continue;
        }
        let origin = [i, j].map(|k| (k * grid.stride) as i32 - margin);
        *found = Template::new(simd, from, origin).search(simd, to, &starts);
    }
}

/// One Jacobi iteration for a row of cells: the motion that minimises the data term plus the weighted distance to the neighbours'
/// current motion. `around` holds the current motion of the row above, this row and the row below.
#[inline(always)]
fn relax_row<S: Simd>(simd: S, known: SmoothingRow<'_>, around: [[&[f32]; 2]; 3], next: [&mut [f32]; 2]) {
    let [next_x, next_y] = next;
    let len = next_x.len();
    let mut from = 0;
    while from < len {
        // The last group of eight may overlap the one before.
        if from + LANES > len && len >= LANES {
            from = len - LANES;
        }
        let [above, own, below] = around;
        let here = lanes_of_pair(simd, own, from + 1);
        let none = f32x8::splat(simd, 0.0);
        let (mut weights, mut pull) = (f32x8::splat(simd, 1e-6), [none; 2]);
        let neighbours = [
            (lanes_of_pair(simd, own, from), lanes(simd, known.horizontal, from + 1)),
            (lanes_of_pair(simd, own, from + 2), lanes(simd, known.horizontal, from + 2)),
            (lanes_of_pair(simd, above, from + 1), lanes(simd, known.above, from + 1)),
            (lanes_of_pair(simd, below, from + 1), lanes(simd, known.below, from + 1)),
        ];
        for (there, penalty) in neighbours {
            // Computed from differences, so that equal motions stay equal to the last bit.
            let apart = [there[0] - here[0], there[1] - here[1]];
            let change = apart[0] * apart[0] + apart[1] * apart[1];
            let weight = f32x8::splat(simd, LAMBDA) / (penalty * (change * (1.0 / (FLOW_SCALE * FLOW_SCALE)) + 1.0));
            weights += weight;
            pull[0] += weight * apart[0];
            pull[1] += weight * apart[1];
        }
        let [xx, xy, yy] = [
            lanes(simd, known.hessian[0], from + 1),
            lanes(simd, known.hessian[1], from + 1),
            lanes(simd, known.hessian[2], from + 1),
        ];
        let found = lanes_of_pair(simd, known.flow, from + 1);
        let back = [found[0] - here[0], found[1] - here[1]];
        let right = [xx * back[0] + xy * back[1] + pull[0], xy * back[0] + yy * back[1] + pull[1]];
        let (a, c) = (xx + weights, yy + weights);
        let determinant = a * c - xy * xy;
        let moved = [
            here[0] + (c * right[0] - xy * right[1]) / determinant,
            here[1] + (a * right[1] - xy * right[0]) / determinant,
        ];
        for (next, moved) in [&mut *next_x, &mut *next_y].into_iter().zip(moved) {
            let moved: [f32; LANES] = moved.into();
            let next = &mut next[from..];
            let count = next.len().min(LANES);
            next[..count].copy_from_slice(&moved[..count]);
        }
        from += LANES;
    }
}

/// Eight values of `row` from `k` on; values past its end are 0.
#[inline(always)]
fn lanes<S: Simd>(simd: S, row: &[f32], k: usize) -> f32x8<S> {
    match row.get(k..k + LANES) {
        Some(values) => f32x8::from_slice(simd, values),
        None => {
            let (mut few, rest) = ([0.0; LANES], &row[k..]);
            few[..rest.len()].copy_from_slice(rest);
            f32x8::from_slice(simd, &few)
        }
    }
}

#[inline(always)]
fn lanes_of_pair<S: Simd>(simd: S, planes: [&[f32]; 2], k: usize) -> [f32x8<S>; 2] {
    [lanes(simd, planes[0], k), lanes(simd, planes[1], k)]
}
