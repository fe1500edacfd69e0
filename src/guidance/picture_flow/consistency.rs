//! Forward-backward consistency check, and hole filling for the pixels that fail it.

use super::dense::Dense;
use super::pyramid::floor;
use super::reserve;
use super::rules::{Rule, Rules};
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Picture, Result};

/// Constant part of the tolerance of the forward-backward check, in squared pixels.
const TOLERANCE: f32 = 0.5;
/// Length-dependent part of the tolerance: this fraction of the sum of both squared lengths.
const TOLERANCE_PER_LENGTH: f32 = 0.01;
/// Distances at which hole filling samples along a ray, in pixels.
const STEPS: [i32; 14] = [1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86];
/// RMS colour difference at which a candidate's weight falls to a quarter, in code values.
const COLOUR_SCALE: f32 = 20.0;
/// Smallest distance between the two pixels that give a motion gradient, in steps along a ray.
const MIN_GRADIENT_STEPS: i32 = 8;
/// A motion gradient of at least this is an edge, in pixels per step.
const EDGE_GRADIENT: f32 = 0.3;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "CONSISTENCY_": float TOLERANCE, float TOLERANCE_PER_LENGTH, [uint] STEPS, float COLOUR_SCALE,
    int MIN_GRADIENT_STEPS, float EDGE_GRADIENT
);

/// Ray directions of hole filling.
const RAYS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// Which pixels passed the forward-backward check.
#[derive(Debug, Default)]
pub(super) struct Consistency {
    width: usize,
    consistent: Vec<bool>,
    fills_by_gradient: bool,
}

impl Consistency {
    /// Marks the pixels whose motion in `flow` found a match and is cancelled by `back` at its end point. Motion that leads out of the
    /// picture cannot be checked and counts as inconsistent. `back` has `flow`'s size halved `halvings` times.
    pub(super) fn check(&mut self, flow: &Dense, back: &Dense, halvings: usize, rules: Rules) -> Result<()> {
        self.fills_by_gradient = rules.has(Rule::FillByGradient);
        let compares = rules.has(Rule::ConsistencyCheck);
        let scale = (1_u32 << halvings) as f32;
        let (width, height) = (flow.width, flow.flow.len() / flow.width);
        let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
        self.width = width;
        reserve(&mut self.consistent, flow.flow.len(), false)?;
        let rows = flow.flow.par_chunks(width).zip(flow.has_match.par_chunks(width));
        self.consistent.par_chunks_mut(width).zip(rows).enumerate().for_each(|(y, (consistent, (row, has_match)))| {
            for (x, (consistent, (&[u, v], &has_match))) in
                consistent.iter_mut().zip(row.iter().zip(has_match)).enumerate()
            {
                let (there_x, there_y) = (x as f32 + u, y as f32 + v);
                *consistent =
                    has_match && there_x >= 0.0 && there_y >= 0.0 && there_x <= right && there_y <= bottom && {
                        let [i, j] =
                            [floor(there_x + 0.5) as usize >> halvings, floor(there_y + 0.5) as usize >> halvings];
                        let [bu, bv] = back.flow[j * back.width + i];
                        let (bu, bv) = (scale * bu, scale * bv);
                        let error = (u + bu) * (u + bu) + (v + bv) * (v + bv);
                        !compares || error <= TOLERANCE + TOLERANCE_PER_LENGTH * (u * u + v * v + bu * bu + bv * bv)
                    };
            }
        });
        Ok(())
    }

    /// For each pixel of row `y`, whether its motion passed the check.
    pub(super) fn row(&self, y: usize) -> &[bool] {
        &self.consistent[y * self.width..][..self.width]
    }

    /// Replacement motion for pixel (x, y): the motion of the nearest consistent pixel along each of eight rays, extrapolated to (x, y) and
    /// averaged with weights that fall with distance and with colour difference in `picture`. The pixel's own motion where no ray finds one.
    /// `flow` and this check have `picture`'s size halved `halvings` times.
    pub(super) fn fill_from_rays(
        &self,
        flow: &Dense,
        picture: &Picture,
        halvings: usize,
        x: usize,
        y: usize,
    ) -> [f32; 2] {
        let (width, height) = (self.width as i32, (self.consistent.len() / self.width) as i32);
        let colour = |x: usize, y: usize| {
            picture.pixels()[(y << halvings) * picture.width() as usize + (x << halvings)].map(f32::from)
        };
        let own = colour(x, y);
        let (mut weight_sum, mut sum) = (0.0, [0.0_f32; 2]);
        for [dx, dy] in RAYS {
            for distance in STEPS {
                let (px, py) = (x as i32 + dx * distance, y as i32 + dy * distance);
                if px < 0 || py < 0 || px >= width || py >= height {
                    break;
                }
                let k = (py * width + px) as usize;
                if self.consistent[k] {
                    let other = colour(px as usize, py as usize);
                    let difference: f32 = (0..3).map(|c| (other[c] - own[c]).powi(2)).sum::<f32>() / 3.0;
                    let penalty = 1.0 + difference / (COLOUR_SCALE * COLOUR_SCALE);
                    let weight = 1.0 / (penalty * penalty * distance as f32);
                    weight_sum += weight;
                    let vector = self.extrapolated(flow, [px, py], [dx, dy], distance);
                    sum[0] += weight * vector[0];
                    sum[1] += weight * vector[1];
                    break;
                }
            }
        }
        if weight_sum > 0.0 { sum.map(|s| s / weight_sum) } else { flow.row(y)[x] }
    }

    /// Extrapolates the motion of the consistent pixel `position` linearly by `distance` steps against `ray`, because motion on a floor or
    /// wall has a gradient. Returns that motion unchanged where the gradient is steep: another surface begins there.
    #[inline(always)]
    fn extrapolated(&self, flow: &Dense, position: [i32; 2], ray: [i32; 2], distance: i32) -> [f32; 2] {
        let (width, height) = (self.width as i32, (self.consistent.len() / self.width) as i32);
        let at = |[x, y]: [i32; 2]| (y * width + x) as usize;
        let gradient_steps = distance.max(MIN_GRADIENT_STEPS);
        let farther = [0, 1].map(|axis| position[axis] + gradient_steps * ray[axis]);
        let vector = flow.flow[at(position)];
        let is_inside = farther[0] >= 0 && farther[1] >= 0 && farther[0] < width && farther[1] < height;
        if !(self.fills_by_gradient && is_inside && self.consistent[at(farther)]) {
            return vector;
        }
        let there = flow.flow[at(farther)];
        let slope = [0, 1].map(|axis| (vector[axis] - there[axis]) / gradient_steps as f32);
        if slope[0].abs().max(slope[1].abs()) >= EDGE_GRADIENT {
            return vector;
        }
        [0, 1].map(|axis| vector[axis] + slope[axis] * distance as f32)
    }
}
