//! From patches to pixels; which of them to trust, and what to put in place of the others.

use rayon::prelude::*;

use super::grid::Grid;
use super::patch::{SIDE, STRIDE};
use super::pyramid::Plane;
use super::reserve;
use crate::{Picture, Result};

/// How far forward and backward motion may fail to undo each other, in squared pixels: this,
const SLACK: f32 = 0.5;
/// and this part of their squared lengths.
const SLACK_PER_LENGTH: f32 = 0.01;
/// How far a fill looks, in pixels.
const REACH: i32 = 64;
/// Colour by which pixels differ before they count as different things, in code values.
const COLOUR_SCALE: f32 = 10.0;
/// Where a fill looks.
const RAYS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// A motion to a pixel, in pixels.
#[derive(Debug, Default)]
pub(super) struct Dense {
    width: usize,
    pub(super) flow: Vec<[f32; 2]>,
}

impl Dense {
    /// Spreads the motion of `grid`'s patches over the pixels: each pixel takes the mean of the four patches over it,
    /// weighted by how well their motion explains it.
    pub(super) fn spread(&mut self, from: &Plane, to: &Plane, grid: &Grid) -> Result<()> {
        self.width = from.width;
        reserve(&mut self.flow, from.luma.len(), [0.0; 2])?;
        // Every pixel lies under the patch of its own cell and under that of the cell whose edge is nearer.
        const { assert!(SIDE == 2 * STRIDE) };
        let pair = |x: usize, len: usize| {
            let own = x / STRIDE;
            let other = if x % STRIDE < STRIDE / 2 { own.saturating_sub(1) } else { (own + 1).min(len - 1) };
            [own, other]
        };
        self.flow.par_chunks_mut(from.width).enumerate().for_each(|(y, row)| {
            let cells_down = pair(y, grid.down);
            for (x, flow) in row.iter_mut().enumerate() {
                let luma = from.luma[y * from.width + x];
                let first = grid.flow[cells_down[0] * grid.across + x / STRIDE];
                let (mut weight_sum, mut sum) = (0.0, [0.0_f32; 2]);
                for j in cells_down {
                    for i in pair(x, grid.across) {
                        let k = j * grid.across + i;
                        let [u, v] = grid.flow[k];
                        let other = to.sample(x as f32 + u, y as f32 + v);
                        let left = other - luma - grid.found[k].brightening;
                        let weight = 1.0 / (1.0 + left * left);
                        weight_sum += weight;
                        // Differences, so that equal motions stay equal to the last bit.
                        sum[0] += weight * (u - first[0]);
                        sum[1] += weight * (v - first[1]);
                    }
                }
                *flow = [first[0] + sum[0] / weight_sum, first[1] + sum[1] / weight_sum];
            }
        });
        Ok(())
    }

    /// The motion at a position in pixels that lies in the picture; bilinear.
    fn sample(&self, x: f32, y: f32) -> [f32; 2] {
        let height = self.flow.len() / self.width;
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(self.width - 1), (top + 1).min(height - 1));
        let (fx, fy) = (x - left as f32, y - top as f32);
        [0, 1].map(|axis| {
            let at = |x: usize, y: usize| self.flow[y * self.width + x][axis];
            let above = at(left, top) + (at(right, top) - at(left, top)) * fx;
            let below = at(left, below) + (at(right, below) - at(left, below)) * fx;
            above + (below - above) * fy
        })
    }
}

/// Which pixels' motion in `flow` is undone by `back` at its end. Motion out of the picture cannot be checked, and is
/// not trusted.
pub(super) fn check(flow: &Dense, back: &Dense, trusted: &mut [bool]) {
    let (width, height) = (flow.width, flow.flow.len() / flow.width);
    let (last_x, last_y) = ((width - 1) as f32, (height - 1) as f32);
    trusted.par_chunks_mut(width).zip(flow.flow.par_chunks(width)).enumerate().for_each(|(y, (trusted, row))| {
        for (x, (trusted, &[u, v])) in trusted.iter_mut().zip(row).enumerate() {
            let (there_x, there_y) = (x as f32 + u, y as f32 + v);
            *trusted = there_x >= 0.0 && there_y >= 0.0 && there_x <= last_x && there_y <= last_y && {
                let [bu, bv] = back.sample(there_x, there_y);
                let miss = (u + bu).powi(2) + (v + bv).powi(2);
                miss <= SLACK + SLACK_PER_LENGTH * (u * u + v * v + bu * bu + bv * bv)
            };
        }
    });
}

/// The motion of pixel (x, y): its own where it is trusted, else that of the nearest trusted pixels along eight rays,
/// weighted by nearness and by likeness in `picture`; its own again where there are none.
pub(super) fn filled(flow: &Dense, trusted: &[bool], picture: &Picture, x: usize, y: usize) -> [f32; 2] {
    let (width, height) = (flow.width as i32, (flow.flow.len() / flow.width) as i32);
    let here = y * flow.width + x;
    if trusted[here] {
        return flow.flow[here];
    }
    let pixels = picture.pixels();
    let own = pixels[here].map(f32::from);
    let (mut weight_sum, mut sum) = (0.0, [0.0_f32; 2]);
    for [dx, dy] in RAYS {
        let (mut px, mut py) = (x as i32, y as i32);
        for distance in 1..=REACH {
            (px, py) = (px + dx, py + dy);
            if px < 0 || py < 0 || px >= width || py >= height {
                break;
            }
            let k = (py * width + px) as usize;
            if trusted[k] {
                let other = pixels[k].map(f32::from);
                let unlike: f32 = (0..3).map(|c| (other[c] - own[c]).powi(2)).sum::<f32>() / 3.0;
                let alike = 1.0 + unlike / (COLOUR_SCALE * COLOUR_SCALE);
                let weight = 1.0 / (alike * alike * distance as f32);
                weight_sum += weight;
                sum[0] += weight * flow.flow[k][0];
                sum[1] += weight * flow.flow[k][1];
                break;
            }
        }
    }
    if weight_sum > 0.0 { sum.map(|s| s / weight_sum) } else { flow.flow[here] }
}
