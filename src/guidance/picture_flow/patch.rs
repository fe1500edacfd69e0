//! One patch and its search.

use super::pyramid::Plane;

/// Pixels along a patch's side.
pub(super) const SIDE: usize = 8;
/// Pixels from one patch to the next.
pub(super) const STRIDE: usize = 4;

const AREA: usize = SIDE * SIDE;
/// Fewer pixels than these in both pictures say nothing about a motion.
const FEWEST: f32 = (AREA / 4) as f32;
const MOST_STEPS: usize = 10;
/// A step shorter than this, in pixels, ends the search.
const SETTLED: f32 = 0.02;
/// By how much another start must be better than what the coarser level says, in squared code values: rounding to 8 bits
/// alone must not decide it, or a plain sky would rest while all else turns.
const MARGIN: f32 = 1.0;
/// Added to the diagonal of H per pixel, in squared code values: what a flat patch has instead of a gradient.
const DAMPING: f32 = 0.02;

/// What the search found for a patch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Found {
    /// Motion in pixels of this level.
    pub(super) flow: [f32; 2],
    /// How much brighter the other picture is there, in code values.
    pub(super) brightening: f32,
    /// Mean squared difference that is left, in squared code values.
    pub(super) residual: f32,
    /// H per pixel: xx, xy, yy.
    pub(super) hessian: [f32; 3],
    /// Mean luma of the patch.
    pub(super) mean: f32,
}

/// A patch of the picture the motion is wanted for.
pub(super) struct Template {
    origin: [i32; 2],
    value: [f32; AREA],
    gradient: [[f32; AREA]; 2],
    inside: [f32; AREA],
    whole: bool,
    mean: f32,
    hessian: [f32; 3],
}

/// A template against the other picture at one motion.
struct Comparison {
    slope: [f32; 2],
    residual: f32,
    brightening: f32,
}

impl Template {
    /// The patch number `i` across, `j` down; the patches at the edge hang over it, and what hangs over does not count.
    pub(super) fn new(plane: &Plane, i: usize, j: usize) -> Self {
        let margin = ((SIDE - STRIDE) / 2) as i32;
        let origin = [(i * STRIDE) as i32 - margin, (j * STRIDE) as i32 - margin];
        let around = plane.block::<{ SIDE + 2 }>(origin[0] - 1, origin[1] - 1);
        let (mut value, mut gradient, mut inside) = ([0.0; AREA], [[0.0; AREA]; 2], [1.0; AREA]);
        let mut whole = true;
        for y in 0..SIDE {
            for x in 0..SIDE {
                let k = y * SIDE + x;
                value[k] = around[y + 1][x + 1];
                gradient[0][k] = 0.5 * (around[y + 1][x + 2] - around[y + 1][x]);
                gradient[1][k] = 0.5 * (around[y + 2][x + 1] - around[y][x + 1]);
                if !within(plane, origin[0] + x as i32, origin[1] + y as i32) {
                    inside[k] = 0.0;
                    whole = false;
                }
            }
        }
        let count: f32 = inside.iter().sum();
        let mean = |of: &[f32; AREA]| of.iter().zip(&inside).map(|(v, w)| v * w).sum::<f32>() / count;
        let means = [mean(&gradient[0]), mean(&gradient[1])];
        let mut hessian = [0.0; 3];
        for k in 0..AREA {
            let [gx, gy] = [0, 1].map(|axis| (gradient[axis][k] - means[axis]) * inside[k]);
            (gradient[0][k], gradient[1][k]) = (gx, gy);
            hessian[0] += gx * gx;
            hessian[1] += gx * gy;
            hessian[2] += gy * gy;
        }
        let mean = mean(&value);
        Self { origin, value, gradient, inside, whole, mean, hessian: hessian.map(|h| h / count) }
    }

    /// The best motion into `target` that can be reached from one of `starts`; the first of them where all are bad.
    pub(super) fn search(&self, target: &Plane, starts: &[[f32; 2]]) -> Found {
        let nowhere = Comparison { slope: [0.0; 2], residual: f32::INFINITY, brightening: 0.0 };
        let (mut flow, mut best) = (starts[0], nowhere);
        for (i, &start) in starts.iter().enumerate() {
            let near = |other: &[f32; 2]| (start[0] - other[0]).abs().max((start[1] - other[1]).abs()) < 0.1;
            if i > 0 && starts[..i].iter().any(near) {
                continue;
            }
            if let Some(comparison) = self.compare(target, start)
                && comparison.residual + if best.residual.is_finite() { MARGIN } else { 0.0 } < best.residual
            {
                (flow, best) = (start, comparison);
            }
        }
        if best.residual.is_finite() {
            self.descend(target, &mut flow, &mut best);
        }
        Found {
            flow,
            brightening: best.brightening,
            // Where nothing could be compared, nothing is known.
            residual: if best.residual.is_finite() { best.residual } else { 1e6 },
            hessian: self.hessian,
            mean: self.mean,
        }
    }

    /// Inverse-compositional steps from `flow` on, kept while they do not make it worse.
    fn descend(&self, target: &Plane, flow: &mut [f32; 2], best: &mut Comparison) {
        let [xx, xy, yy] = self.hessian;
        let (xx, yy) = (xx + DAMPING, yy + DAMPING);
        let determinant = xx * yy - xy * xy;
        let start = *flow;
        for _ in 0..MOST_STEPS {
            let [bx, by] = best.slope;
            let step = [(yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant];
            let next = [flow[0] - step[0], flow[1] - step[1]];
            let strayed = (next[0] - start[0]).abs().max((next[1] - start[1]).abs()) > SIDE as f32;
            let Some(comparison) = self.compare(target, next).filter(|c| !strayed && c.residual < best.residual) else {
                break;
            };
            (*flow, *best) = (next, comparison);
            if step[0].abs().max(step[1].abs()) < SETTLED {
                break;
            }
        }
    }

    /// The template against `target` at `flow`; none where too little of it is in both pictures.
    #[inline]
    fn compare(&self, target: &Plane, flow: [f32; 2]) -> Option<Comparison> {
        let whole = [flow[0].floor(), flow[1].floor()];
        let [fx, fy] = [flow[0] - whole[0], flow[1] - whole[1]];
        let (x, y) = (self.origin[0] + whole[0] as i32, self.origin[1] + whole[1] as i32);
        let block = target.block::<{ SIDE + 1 }>(x, y);
        let mut difference = [0.0_f32; AREA];
        let rows = difference.as_chunks_mut::<SIDE>().0.iter_mut().zip(self.value.as_chunks::<SIDE>().0);
        for ((row, values), [upper, lower]) in rows.zip(block.array_windows::<2>()) {
            for k in 0..SIDE {
                let above = upper[k] + (upper[k + 1] - upper[k]) * fx;
                let below = lower[k] + (lower[k + 1] - lower[k]) * fx;
                row[k] = above + (below - above) * fy - values[k];
            }
        }
        let side = SIDE as i32;
        if self.whole && within(target, x, y) && within(target, x + side, y + side) {
            return Some(self.sums(&difference, AREA as f32));
        }
        // Pixels that are outside one of the pictures do not count.
        let mut inside = self.inside;
        for (k, weight) in inside.iter_mut().enumerate() {
            if !within(target, x + (k % SIDE) as i32, y + (k / SIDE) as i32) {
                *weight = 0.0;
            }
        }
        let count: f32 = inside.iter().sum();
        if count < FEWEST.min(self.inside.iter().sum()) {
            return None;
        }
        let mean = difference.iter().zip(&inside).map(|(d, w)| d * w).sum::<f32>() / count;
        for (d, w) in difference.iter_mut().zip(&inside) {
            *d = (*d - mean) * w;
        }
        Some(Comparison { brightening: mean, ..self.sums(&difference, count) })
    }

    /// The sums over `count` pixels of a difference that is zero at all others.
    #[inline]
    fn sums(&self, difference: &[f32; AREA], count: f32) -> Comparison {
        let (mut sum, mut squares, mut slope) = ([0.0_f32; SIDE], [0.0_f32; SIDE], [[0.0_f32; SIDE]; 2]);
        let gradients = self.gradient[0].as_chunks::<SIDE>().0.iter().zip(self.gradient[1].as_chunks::<SIDE>().0);
        for (row, (gx, gy)) in difference.as_chunks::<SIDE>().0.iter().zip(gradients) {
            for k in 0..SIDE {
                sum[k] += row[k];
                squares[k] += row[k] * row[k];
                slope[0][k] += gx[k] * row[k];
                slope[1][k] += gy[k] * row[k];
            }
        }
        let total = |lanes: [f32; SIDE]| lanes.iter().sum::<f32>() / count;
        let mean = total(sum);
        Comparison {
            // The gradients are centred: the difference's mean drops out of the slope.
            slope: slope.map(total),
            residual: (total(squares) - mean * mean).max(0.0),
            brightening: mean,
        }
    }
}

#[inline]
fn within(plane: &Plane, x: i32, y: i32) -> bool {
    x >= 0 && y >= 0 && x < plane.width as i32 && y < plane.height as i32
}
