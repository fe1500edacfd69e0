//! One patch and its search.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use super::pyramid::{Plane, floor};

/// Pixels along a patch's side.
pub(super) const SIDE: usize = 8;

const AREA: usize = SIDE * SIDE;
/// A comparison of fewer overlapping pixels is rejected.
const MIN_OVERLAP: f32 = (AREA / 4) as f32;
const MAX_STEPS: usize = 8;
/// A step shorter than this, in pixels, is taken without another comparison and ends the descent.
const CONVERGED_STEP: f32 = 0.02;
/// A start within this distance of an earlier one, in pixels, is skipped: the descent covers it.
pub(super) const SAME_START: f32 = 0.3;
/// A start must beat the best one so far by this much, in squared code values. Otherwise 8-bit rounding alone would decide,
/// and a uniform sky would have no motion while the camera turns.
const MIN_IMPROVEMENT: f32 = 1.0;
/// Added per pixel to the diagonal of H, in squared code values. Keeps H invertible on a flat patch.
const DAMPING: f32 = 0.02;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "PATCH_": uint SIDE, float AREA, float MIN_OVERLAP, uint MAX_STEPS, float CONVERGED_STEP, float SAME_START,
    float MIN_IMPROVEMENT, float DAMPING
);

/// One value for each pixel of a patch.
type PatchPixels = [[f32; SIDE]; SIDE];

/// Search result of one patch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PatchMatch {
    /// Motion in pixels of this level.
    pub(super) flow: [f32; 2],
    /// Mean of target minus template, in code values.
    pub(super) brightening: f32,
    /// Mean squared difference after the mean is removed, in squared code values.
    pub(super) residual: f32,
    /// H per pixel: xx, xy, yy.
    pub(super) hessian: [f32; 3],
    /// Mean luma of the patch.
    pub(super) mean: f32,
}

/// An 8 x 8 patch of the source picture, with its centred gradients and H.
pub(super) struct Template {
    origin: [i32; 2],
    value: PatchPixels,
    gradient: [PatchPixels; 2],
    is_inside: bool,
    mean: f32,
    hessian: [f32; 3],
}

/// Result of comparing a template with the target picture at one motion.
#[derive(Clone, Copy)]
struct Comparison {
    slope: [f32; 2],
    residual: f32,
    brightening: f32,
}

impl Template {
    /// The patch whose first pixel is `origin`. Pixels outside the picture have weight 0.
    #[inline(always)]
    pub(super) fn new<S: Simd>(simd: S, plane: &Plane, origin: [i32; 2]) -> Self {
        let mut template = Self {
            origin,
            value: [[0.0; SIDE]; SIDE],
            gradient: [[[0.0; SIDE]; SIDE]; 2],
            is_inside: plane.holds(origin[0] - 1, origin[1] - 1, SIDE + 2),
            mean: 0.0,
            hessian: [0.0; 3],
        };
        if template.is_inside {
            template.centre(simd, plane);
        } else {
            template.centre_at_edge(simd, plane);
        }
        template
    }

    /// Reads values and gradients from `plane`, subtracts the mean from the gradients, and sums H.
    #[inline(always)]
    fn centre<S: Simd>(&mut self, simd: S, plane: &Plane) {
        let (left, top) = (self.origin[0] - 1, self.origin[1] - 1);
        let none = f32x8::splat(simd, 0.0);
        let (mut value, mut gradient, mut sums) = ([none; SIDE], [[none; SIDE]; 2], [none; 3]);
        let (mut above, mut own) = (plane.row::<{ SIDE + 2 }>(left, top), plane.row::<{ SIDE + 2 }>(left, top + 1));
        for j in 0..SIDE {
            let below = plane.row::<{ SIDE + 2 }>(left, top + 2 + j as i32);
            value[j] = lanes(simd, &own, 1);
            gradient[0][j] = (lanes(simd, &own, 2) - lanes(simd, &own, 0)) * 0.5;
            gradient[1][j] = (lanes(simd, &below, 1) - lanes(simd, &above, 1)) * 0.5;
            sums[0] += value[j];
            sums[1] += gradient[0][j];
            sums[2] += gradient[1][j];
            (above, own) = (own, below);
        }
        let [mean, mean_x, mean_y] = [mean_of(sums[0]), mean_of(sums[1]), mean_of(sums[2])];
        let mut hessian = [none; 3];
        for j in 0..SIDE {
            let (gx, gy) = (gradient[0][j] - mean_x, gradient[1][j] - mean_y);
            hessian[0] += gx * gx;
            hessian[1] += gx * gy;
            hessian[2] += gy * gy;
            value[j].store_slice(&mut self.value[j]);
            gx.store_slice(&mut self.gradient[0][j]);
            gy.store_slice(&mut self.gradient[1][j]);
        }
        self.mean = mean;
        self.hessian = [mean_of(hessian[0]), mean_of(hessian[1]), mean_of(hessian[2])];
    }

    /// As [`centre`](Self::centre) for a patch at the border: outside pixels have weight 0, gradients use clamped reads.
    #[inline(always)]
    fn centre_at_edge<S: Simd>(&mut self, simd: S, plane: &Plane) {
        let around = plane.block::<{ SIDE + 2 }>(self.origin[0] - 1, self.origin[1] - 1);
        let [columns, rows] = [plane.width, plane.height];
        let (across, down) = (inside(self.origin[0], columns), inside(self.origin[1], rows));
        let count = across.iter().sum::<f32>() * down.iter().sum::<f32>();
        let (across, none) = (f32x8::from_slice(simd, &across), f32x8::splat(simd, 0.0));
        let (mut gradient, mut sums) = ([[none; SIDE]; 2], [none; 3]);
        for j in 0..SIDE {
            let value = lanes(simd, &around[j + 1], 1);
            gradient[0][j] = (lanes(simd, &around[j + 1], 2) - lanes(simd, &around[j + 1], 0)) * 0.5;
            gradient[1][j] = (lanes(simd, &around[j + 2], 1) - lanes(simd, &around[j], 1)) * 0.5;
            value.store_slice(&mut self.value[j]);
            let counts = across * down[j];
            sums[0] += value * counts;
            sums[1] += gradient[0][j] * counts;
            sums[2] += gradient[1][j] * counts;
        }
        let [mean, mean_x, mean_y] = sums.map(|sum| sum_of(sum) / count);
        let mut hessian = [none; 3];
        for j in 0..SIDE {
            let counts = across * down[j];
            let (gx, gy) = ((gradient[0][j] - mean_x) * counts, (gradient[1][j] - mean_y) * counts);
            hessian[0] += gx * gx;
            hessian[1] += gx * gy;
            hessian[2] += gy * gy;
            gx.store_slice(&mut self.gradient[0][j]);
            gy.store_slice(&mut self.gradient[1][j]);
        }
        self.mean = mean;
        self.hessian = hessian.map(|sum| sum_of(sum) / count);
    }

    /// The best motion into `target` reachable from `starts`; `starts[0]` if no start can be compared.
    #[inline(always)]
    pub(super) fn search<S: Simd, const N: usize>(
        &self,
        simd: S,
        target: &Plane,
        starts: &[[f32; 2]; N],
    ) -> PatchMatch {
        let nowhere = Comparison { slope: [0.0; 2], residual: f32::INFINITY, brightening: 0.0 };
        let (mut flow, mut best) = (starts[0], nowhere);
        for (i, &start) in starts.iter().enumerate() {
            let near = |other: &[f32; 2]| (start[0] - other[0]).abs().max((start[1] - other[1]).abs()) < SAME_START;
            if starts[..i].iter().any(near) {
                continue;
            }
            let comparison = self.compare(simd, target, start);
            if comparison.residual + if best.residual.is_finite() { MIN_IMPROVEMENT } else { 0.0 } < best.residual {
                (flow, best) = (start, comparison);
            }
        }
        if best.residual.is_finite() {
            self.descend(simd, target, &mut flow, &mut best);
        }
        PatchMatch {
            flow,
            brightening: best.brightening,
            // No start could be compared: a large residual gives this patch almost no weight.
            residual: if best.residual.is_finite() { best.residual } else { 1e6 },
            hessian: self.hessian,
            mean: self.mean,
        }
    }

    /// Inverse-compositional steps from `flow`, until one does not reduce the residual.
    #[inline(always)]
    fn descend<S: Simd>(&self, simd: S, target: &Plane, flow: &mut [f32; 2], best: &mut Comparison) {
        let [xx, xy, yy] = self.hessian;
        let (xx, yy) = (xx + DAMPING, yy + DAMPING);
        let reciprocal = 1.0 / (xx * yy - xy * xy);
        let start = *flow;
        for _ in 0..MAX_STEPS {
            let [bx, by] = best.slope;
            let step = [(yy * bx - xy * by) * reciprocal, (xx * by - xy * bx) * reciprocal];
            let length = step[0].abs().max(step[1].abs());
            let next = [flow[0] - step[0], flow[1] - step[1]];
            if length < CONVERGED_STEP {
                *flow = next;
                break;
            }
            if (next[0] - start[0]).abs().max((next[1] - start[1]).abs()) > SIDE as f32 {
                break;
            }
            let comparison = self.compare(simd, target, next);
            // Written so that NaN also ends the loop.
            let better = comparison.residual < best.residual;
            if !better {
                break;
            }
            (*flow, *best) = (next, comparison);
        }
    }

    /// Compares the template with `target` at `flow`. The residual is infinite where too few pixels lie in both pictures.
    #[inline(always)]
    fn compare<S: Simd>(&self, simd: S, target: &Plane, flow: [f32; 2]) -> Comparison {
        let whole = [floor(flow[0]), floor(flow[1])];
        let [fx, fy] = [flow[0] - whole[0] as f32, flow[1] - whole[1] as f32];
        let (x, y) = (self.origin[0].saturating_add(whole[0]), self.origin[1].saturating_add(whole[1]));
        if !(self.is_inside && target.holds(x, y, SIDE + 1)) {
            return self.compare_at_edge(simd, target, [x, y], [fx, fy]);
        }
        let none = f32x8::splat(simd, 0.0);
        let (mut sum, mut squares, mut slope) = (none, none, [none; 2]);
        let mut above = across(simd, &target.row(x, y), fx);
        for j in 0..SIDE {
            let below = across(simd, &target.row(x, y + 1 + j as i32), fx);
            let difference = above + (below - above) * fy - f32x8::from_slice(simd, &self.value[j]);
            sum += difference;
            squares += difference * difference;
            slope[0] += f32x8::from_slice(simd, &self.gradient[0][j]) * difference;
            slope[1] += f32x8::from_slice(simd, &self.gradient[1][j]) * difference;
            above = below;
        }
        let mean = mean_of(sum);
        Comparison {
            // The gradients have zero mean, so the mean of the difference cancels.
            slope: [mean_of(slope[0]), mean_of(slope[1])],
            residual: (mean_of(squares) - mean * mean).max(0.0),
            brightening: mean,
        }
    }

    /// As [`compare`](Self::compare), with weight 0 for pixels outside either picture.
    #[inline(always)]
    fn compare_at_edge<S: Simd>(&self, simd: S, target: &Plane, position: [i32; 2], [fx, fy]: [f32; 2]) -> Comparison {
        // Both pictures have the same size.
        let size = [target.width, target.height];
        let own = [0, 1].map(|axis| inside(self.origin[axis], size[axis]));
        let there = [0, 1].map(|axis| inside(position[axis], size[axis]));
        let both: [[f32; SIDE]; 2] = [0, 1].map(|axis| std::array::from_fn(|i| own[axis][i] * there[axis][i]));
        let count = |[across, down]: &[[f32; SIDE]; 2]| across.iter().sum::<f32>() * down.iter().sum::<f32>();
        let shared = count(&both);
        // The first condition also covers a patch that lies entirely outside.
        if shared == 0.0 || shared < MIN_OVERLAP.min(count(&own)) {
            return Comparison { slope: [0.0; 2], residual: f32::INFINITY, brightening: 0.0 };
        }
        let block = target.block::<{ SIDE + 1 }>(position[0], position[1]);
        let [columns, rows] = &both;
        let (columns, none) = (f32x8::from_slice(simd, columns), f32x8::splat(simd, 0.0));
        let (mut differences, mut sum) = ([none; SIDE], none);
        let mut above = across(simd, &block[0], fx);
        for j in 0..SIDE {
            let below = across(simd, &block[j + 1], fx);
            differences[j] = above + (below - above) * fy - f32x8::from_slice(simd, &self.value[j]);
            sum += differences[j] * (columns * rows[j]);
            above = below;
        }
        let mean = sum_of(sum) / shared;
        let (mut squares, mut slope) = (none, [none; 2]);
        for j in 0..SIDE {
            // The gradients were centred over more pixels than are compared here, so subtract the mean explicitly.
            let difference = (differences[j] - mean) * (columns * rows[j]);
            squares += difference * difference;
            slope[0] += f32x8::from_slice(simd, &self.gradient[0][j]) * difference;
            slope[1] += f32x8::from_slice(simd, &self.gradient[1][j]) * difference;
        }
        Comparison {
            slope: slope.map(|sum| sum_of(sum) / shared),
            residual: sum_of(squares) / shared,
            brightening: mean,
        }
    }
}

/// Weight of each of a patch's 8 positions along one axis: 1 inside the picture, 0 outside.
#[inline(always)]
fn inside(first: i32, len: usize) -> [f32; SIDE] {
    let mut inside = [0.0; SIDE];
    for (i, inside) in (0..).zip(&mut inside) {
        let at = i64::from(first) + i;
        *inside = if at >= 0 && at < len as i64 { 1.0 } else { 0.0 };
    }
    inside
}

/// Sum of all elements, each the sum of one patch column. A fixed tree order keeps the result reproducible.
#[inline(always)]
fn sum_of<S: Simd>(lanes: f32x8<S>) -> f32 {
    let [a, b, c, d, e, f, g, h] = <[f32; SIDE]>::from(lanes);
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// Mean over a whole patch; see [`sum_of`].
#[inline(always)]
pub(super) fn mean_of<S: Simd>(lanes: f32x8<S>) -> f32 {
    sum_of(lanes) * (1.0 / AREA as f32)
}

/// Eight pixels of a row, starting at `x`.
#[inline(always)]
fn lanes<S: Simd, const N: usize>(simd: S, row: &[f32; N], x: usize) -> f32x8<S> {
    f32x8::from_slice(simd, &row[x..x + SIDE])
}

/// Linear interpolation at eight positions of a row, each shifted right by `fraction` of a pixel.
#[inline(always)]
fn across<S: Simd>(simd: S, row: &[f32; SIDE + 1], fraction: f32) -> f32x8<S> {
    let left = lanes(simd, row, 0);
    left + (lanes(simd, row, 1) - left) * fraction
}
