//! Which motions to trust, and what to put in place of the others.

use super::dense::Dense;
use super::pyramid::floor;
use super::reserve;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};
use crate::{Picture, Result};

/// How far forward and backward motion may fail to undo each other, in squared pixels: this,
const SLACK: f32 = 0.5;
/// and this part of their squared lengths.
const SLACK_PER_LENGTH: f32 = 0.01;
/// How far a fill looks along a ray, step by step, in pixels.
const STEPS: [i32; 14] = [1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86];
/// Colour by which pixels differ before they count as different things, in code values.
const COLOUR_SCALE: f32 = 20.0;
/// How far apart two pixels are at least whose motion gives a slope, in steps along a ray.
const LEAST_REACH: i32 = 8;
/// A slope of motion from here on is an edge, in pixels to a step.
const STEEP: f32 = 0.3;
/// Where a fill looks.
const RAYS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// Which pixels' motion to trust.
#[derive(Debug, Default)]
pub(super) struct Trust {
    width: usize,
    trusted: Vec<bool>,
}

impl Trust {
    /// Finds where motion in `flow` shows the same at its end and is undone there by `back`. Motion out of the picture
    /// cannot be checked, and is not trusted. `back` is `halvings` times half the size.
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

    /// Whether the motion of the pixels of row `y` is trusted.
    pub(super) fn row(&self, y: usize) -> &[bool] {
        &self.trusted[y * self.width..][..self.width]
    }

    /// What to take for the motion of pixel (x, y) in place of its own: that of the nearest trusted pixels along eight
    /// rays, drawn on to it, weighted by nearness and by likeness in `picture`; its own where there are none. All but
    /// `picture` is `halvings` times half the size.
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

    /// The motion of the trusted pixel `place`, drawn on in a line over `distance` steps back along `ray`, from as far
    /// behind it: on a floor or a wall motion has a slope. As it is where another surface begins there.
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
