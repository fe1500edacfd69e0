//! The grid of patches of one level: their search and their smoothing.

use rayon::prelude::*;

use super::patch::{Found, STRIDE, Template};
use super::pyramid::Plane;
use super::reserve;
use crate::Result;

/// Rounds of the smoothing.
const ROUNDS: usize = 12;
/// Weight of a neighbour's motion against the information in a patch, per squared pixel.
const LAMBDA: f32 = 0.3;
/// Variance of a pixel that matches, in squared code values.
const NOISE: f32 = 4.0;
/// Luma by which neighbours differ before they count as different things, in code values.
const LUMA_SCALE: f32 = 12.0;
/// Motion by which neighbours differ before they count as different things, in pixels.
const FLOW_SCALE: f32 = 1.0;

/// The patches of one level, one to a cell of [`STRIDE`] x [`STRIDE`] pixels and centred on it.
#[derive(Debug, Default)]
pub(super) struct Grid {
    pub(super) across: usize,
    pub(super) down: usize,
    /// What the search found for each patch.
    pub(super) found: Vec<Found>,
    /// Motion of each patch after smoothing.
    pub(super) flow: Vec<[f32; 2]>,
    next: Vec<[f32; 2]>,
}

impl Grid {
    /// Searches every patch of `from` in `to`, starting from what the `coarse` level knows.
    pub(super) fn search(&mut self, from: &Plane, to: &Plane, coarse: Option<&Grid>) -> Result<()> {
        (self.across, self.down) = (from.width.div_ceil(STRIDE), from.height.div_ceil(STRIDE));
        let across = self.across;
        reserve(&mut self.found, across * self.down, Found::default())?;
        self.found.par_chunks_mut(across).enumerate().for_each(|(j, row)| {
            for (i, found) in row.iter_mut().enumerate() {
                let template = Template::new(from, i, j);
                *found = match coarse {
                    Some(coarse) => template.search(to, &coarse.starts(i, j)),
                    None => template.search(to, &[[0.0; 2]]),
                };
            }
        });
        Ok(())
    }

    /// Motions to try for cell (i, j) of the next finer level: the four cells around its centre, the one it lies in
    /// first, and none.
    fn starts(&self, i: usize, j: usize) -> [[f32; 2]; 5] {
        let pair = |i: usize, len: usize| {
            let own = (i / 2).min(len - 1);
            let other = if i.is_multiple_of(2) { own.saturating_sub(1) } else { (own + 1).min(len - 1) };
            [own, other]
        };
        let ([x, beside], [y, above]) = (pair(i, self.across), pair(j, self.down));
        let at = |x: usize, y: usize| self.flow[y * self.across + x].map(|v| 2.0 * v);
        [at(x, y), at(beside, y), at(x, above), at(beside, above), [0.0; 2]]
    }

    /// Smooths the motion: patches that fix theirs well keep it, the others take their neighbours'. Jacobi rounds of
    /// the normal equations, weights anew in each.
    pub(super) fn smooth(&mut self) -> Result<()> {
        let len = self.found.len();
        reserve(&mut self.flow, len, [0.0; 2])?;
        reserve(&mut self.next, len, [0.0; 2])?;
        for (flow, found) in self.flow.iter_mut().zip(&self.found) {
            *flow = found.flow;
        }
        let (across, down, found) = (self.across, self.down, &self.found);
        for _ in 0..ROUNDS {
            let flow = &self.flow;
            self.next.par_chunks_mut(across).enumerate().for_each(|(j, row)| {
                for (i, next) in row.iter_mut().enumerate() {
                    *next = relaxed(found, flow, across, down, i, j);
                }
            });
            std::mem::swap(&mut self.flow, &mut self.next);
        }
        Ok(())
    }
}

/// The motion of cell (i, j) that suits both its patch and its neighbours' present motion.
fn relaxed(found: &[Found], flow: &[[f32; 2]], across: usize, down: usize, i: usize, j: usize) -> [f32; 2] {
    let k = j * across + i;
    let (own, here) = (&found[k], flow[k]);
    let [xx, xy, yy] = own.hessian.map(|h| h / (own.residual + NOISE));
    let (mut weight_sum, mut pull) = (1e-6, [0.0_f32; 2]);
    let mut neighbour = |k: usize| {
        let (there, luma) = (flow[k], found[k].mean - own.mean);
        let change = (there[0] - here[0]).powi(2) + (there[1] - here[1]).powi(2);
        let unlike = (luma / LUMA_SCALE).powi(2);
        let weight = LAMBDA / ((1.0 + unlike) * (1.0 + change / (FLOW_SCALE * FLOW_SCALE)));
        weight_sum += weight;
        // Differences, so that equal motions stay equal to the last bit.
        pull[0] += weight * (there[0] - here[0]);
        pull[1] += weight * (there[1] - here[1]);
    };
    if i > 0 {
        neighbour(k - 1);
    }
    if i + 1 < across {
        neighbour(k + 1);
    }
    if j > 0 {
        neighbour(k - across);
    }
    if j + 1 < down {
        neighbour(k + across);
    }
    let back = [own.flow[0] - here[0], own.flow[1] - here[1]];
    let right = [xx * back[0] + xy * back[1] + pull[0], xy * back[0] + yy * back[1] + pull[1]];
    let (xx, yy) = (xx + weight_sum, yy + weight_sum);
    let determinant = xx * yy - xy * xy;
    let step = [(yy * right[0] - xy * right[1]) / determinant, (xx * right[1] - xy * right[0]) / determinant];
    [here[0] + step[0], here[1] + step[1]]
}
