//! Forward-backward consistency check, and hole filling for the pixels that fail it.

use super::dense::Dense;
use super::pyramid::floor;
use super::reserve;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Picture, Result};

/// Tolerance of the forward-backward check, in squared pixels: a constant,
const SLACK: f32 = 0.5;
/// plus this fraction of the sum of the squared lengths.
const SLACK_PER_LENGTH: f32 = 0.01;
/// Distances at which hole filling samples along a ray, in pixels.
const STEPS: [i32; 14] = [1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86];
/// RMS colour difference at which a candidate's weight falls to a quarter, in code values.
const COLOUR_SCALE: f32 = 20.0;
/// Smallest distance between the two pixels from which a motion gradient is taken, in steps along a ray.
const LEAST_REACH: i32 = 8;
/// A motion gradient of at least this is an edge, in pixels per step.
const STEEP: f32 = 0.3;
/// Ray directions of hole filling.
const RAYS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// Which pixels passed the forward-backward check.
#[derive(Debug, Default)]
pub(super) struct Trust {
    width: usize,
    trusted: Vec<bool>,
}

impl Trust {
    /// Trusts motion of `flow` that matched and that `back` undoes at its end. Motion that leads out of the picture cannot be checked
    /// and is not trusted. `back` is halved `halvings` times in size.
    pub(super) fn check(&mut self, flow: &Dense, back: &Dense, halvings: usize) -> Result<()> {
        let scale = (1_u32 << halvings) as f32;
        let (width, height) = (flow.width, flow.flow.len() / flow.width);
        let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
        self.width = width;
        reserve(&mut self.trusted, flow.flow.len(), false)?;
        let rows = flow.flow.par_chunks(width).zip(flow.matched.par_chunks(width));
        self.trusted.par_chunks_mut(width).zip(rows).enumerate().for_each(|(y, (trusted, (row, matched)))| {
            for (x, (trusted, (&[u, v], &matched))) in trusted.iter_mut().zip(row.iter().zip(matched)).enumerate() {
                let (there_x, there_y) = (x as f32 + u, y as f32 + v);
                *trusted = matched && there_x >= 0.0 && there_y >= 0.0 && there_x <= right && there_y <= bottom && {
                    let [i, j] = [floor(there_x + 0.5) as usize >> halvings, floor(there_y + 0.5) as usize >> halvings];
                    let [bu, bv] = back.flow[j * back.width + i];
                    let (bu, bv) = (scale * bu, scale * bv);
                    let miss = (u + bu) * (u + bu) + (v + bv) * (v + bv);
                    miss <= SLACK + SLACK_PER_LENGTH * (u * u + v * v + bu * bu + bv * bv)
                };
            }
        });
        Ok(())
    }

    /// For each pixel of row `y`, whether its motion is trusted.
    pub(super) fn row(&self, y: usize) -> &[bool] {
        &self.trusted[y * self.width..][..self.width]
    }

    /// Replacement motion for pixel (x, y): the nearest trusted pixel along each of eight rays, extrapolated to it and weighted by
    /// nearness and by colour similarity in `picture`. Its own motion where no ray finds one. `flow` and this check are `picture`'s size
    /// halved `halvings` times.
    pub(super) fn filled(&self, flow: &Dense, picture: &Picture, halvings: usize, x: usize, y: usize) -> [f32; 2] {
        let (width, height) = (self.width as i32, (self.trusted.len() / self.width) as i32);
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
                if self.trusted[k] {
                    let other = colour(px as usize, py as usize);
                    let unlike: f32 = (0..3).map(|c| (other[c] - own[c]).powi(2)).sum::<f32>() / 3.0;
                    let alike = 1.0 + unlike / (COLOUR_SCALE * COLOUR_SCALE);
                    let weight = 1.0 / (alike * alike * distance as f32);
                    weight_sum += weight;
                    let vector = self.drawn_on(flow, [px, py], [dx, dy], distance);
                    sum[0] += weight * vector[0];
                    sum[1] += weight * vector[1];
                    break;
                }
            }
        }
        if weight_sum > 0.0 { sum.map(|s| s / weight_sum) } else { flow.row(y)[x] }
    }

    /// Extrapolates the motion of the trusted pixel `place` linearly by `distance` steps against `ray`, because motion on a floor or wall
    /// has a gradient. Returns it unchanged where the gradient is so steep that another surface begins.
    #[inline(always)]
    fn drawn_on(&self, flow: &Dense, place: [i32; 2], ray: [i32; 2], distance: i32) -> [f32; 2] {
        let (width, height) = (self.width as i32, (self.trusted.len() / self.width) as i32);
        let at = |[x, y]: [i32; 2]| (y * width + x) as usize;
        let reach = distance.max(LEAST_REACH);
        let behind = [0, 1].map(|axis| place[axis] + reach * ray[axis]);
        let vector = flow.flow[at(place)];
        let is_inside = behind[0] >= 0 && behind[1] >= 0 && behind[0] < width && behind[1] < height;
        if !(is_inside && self.trusted[at(behind)]) {
            return vector;
        }
        let there = flow.flow[at(behind)];
        let slope = [0, 1].map(|axis| (vector[axis] - there[axis]) / reach as f32);
        if slope[0].abs().max(slope[1].abs()) >= STEEP {
            return vector;
        }
        [0, 1].map(|axis| vector[axis] + slope[axis] * distance as f32)
    }
}
