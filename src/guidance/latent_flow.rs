//! Motion from two latents by block matching: for each cell of the current latent, the best match in the previous one.
//!
//! ```text
//! e(x, u) = mean over channels of ((z1(x) - z0(x + u)) / s)^2    s: the channel's standard deviation over both latents;
//!                                                                z0 bilinear, edges clamped
//! E(x, u) = mean of e(., u) over 3 x 3 cells, weighted 1 2 1
//! u(x)    = argmin of E(x, u) + 0.05 * the sum over four neighbours of |u - u(neighbour)|^2
//! motion  = U(u cells), clamped to [-width, width] x [-height, height]    U: bilinear, half-pixel centres, edge clamp
//! ```
//!
//! u is searched in steps of a quarter cell, up to three cells each way. The first round takes the minimum without the neighbour
//! term, later rounds use the neighbours' result of the round before, and a parabola through the minimum and its two neighbours
//! gives the sub-step position. Ties go to the shortest motion, so an area without texture does not move. Non-finite values count as 0.
//!
//! A cell covers many pixels and encodes its surroundings as well, so the result follows the ground but not object edges.
//! **Depth is flat**, as that of [`picture_flow`].

use half::f16;

use super::interpolation::{Tap, bilinear};
use super::{Guidance, LatentView, MotionOrigin, Projection, check_shapes, picture_flow};
use crate::Result;
use crate::allocate;
use crate::tasks::{Parallel, ParallelSliceMut, PoolLease};

/// The camera stated for the flat depth; the same as that of [`picture_flow`].
pub const PROJECTION: Projection = picture_flow::PROJECTION;
/// The longest motion along an axis, in cells.
pub const REACH: usize = 3;
/// Search steps per cell.
const STEPS_PER_CELL: usize = 4;
/// Candidate displacements along an axis.
const CANDIDATES_PER_AXIS: usize = 2 * REACH * STEPS_PER_CELL + 1;
/// Candidate displacements of a cell.
const CANDIDATES: usize = CANDIDATES_PER_AXIS * CANDIDATES_PER_AXIS;
/// Smoothness cost of a neighbour whose motion differs by one cell.
const SMOOTHNESS_WEIGHT: f32 = 0.05;
/// Smoothing rounds.
const ROUNDS: usize = 6;

/// Fills `out` for the step from `z0` (previous) to `z1` (current) at the `render` size `(width, height)`.
///
/// One extraction; an [`Extractor`] keeps its working memory from one to the next.
///
/// # Errors
/// As [`Extractor::extract`].
pub fn extract(z0: LatentView<'_>, z1: LatentView<'_>, render: (u32, u32), out: &mut Guidance) -> Result<()> {
    Extractor::new().extract(z0, z1, render, out)
}

/// The extractor with its working memory, about seven kilobytes per cell of 32 channels. It allocates nothing after the largest
/// latent and render size. Rows run in parallel; the result does not depend on the number of threads.
#[derive(Debug, Default)]
pub struct Extractor {
    /// The current latent, cell by cell, in standard deviations of each channel.
    current: Vec<f32>,
    /// The previous latent resampled at each of the 4 x 4 sub-cell offsets: offset by offset, row-major, each cell by cell.
    phases: Vec<f32>,
    /// e for each cell and displacement.
    unfiltered_errors: Vec<f32>,
    /// E for each cell and displacement.
    errors: Vec<f32>,
    /// Best displacement of each cell in this round, in steps.
    best: Vec<[i32; 2]>,
    /// Best displacement of each cell in the round before, in steps.
    previous_best: Vec<[i32; 2]>,
    /// Motion of each cell, in cells.
    flow: Vec<[f32; 2]>,
    columns: Vec<Tap>,
    _threads: PoolLease,
}

impl Extractor {
    /// An extractor without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Fills `out` for the step from `z0` (previous) to `z1` (current) at the `render` size `(width, height)`;
    /// `out` becomes one of that size, per pixel, if it is another.
    ///
    /// # Errors
    /// `InvalidArgument` when the latents differ in shape or the render size is outside 1 to
    /// [`MAX_SIDE`](crate::MAX_SIDE); `OutOfMemory` when working memory or `out` cannot grow.
    pub fn extract(
        &mut self,
        z0: LatentView<'_>,
        z1: LatentView<'_>,
        render: (u32, u32),
        out: &mut Guidance,
    ) -> Result<()> {
        check_shapes(z0, z1)?;
        out.make_per_pixel(render, PROJECTION, MotionOrigin::OpticalFlow)?;
        self.allocate(z1.shape())?;
        self.normalise(z0, z1);
        self.matching_costs(z1.shape());
        self.select_motion(z1.shape());
        self.upsample(z1.shape(), out);
        Ok(())
    }

    fn allocate(&mut self, [channels, height, width]: [usize; 3]) -> Result<()> {
        let cells = height * width;
        let grow = |values: &mut Vec<f32>, len: usize| {
            if values.len() != len {
                *values = allocate::filled(len, 0.0)?;
            }
            Ok(())
        };
        grow(&mut self.current, cells * channels)?;
        grow(&mut self.phases, STEPS_PER_CELL * STEPS_PER_CELL * cells * channels)?;
        grow(&mut self.unfiltered_errors, CANDIDATES * cells)?;
        grow(&mut self.errors, CANDIDATES * cells)?;
        if self.best.len() != cells {
            (self.best, self.previous_best) = (allocate::filled(cells, [0; 2])?, allocate::filled(cells, [0; 2])?);
            self.flow = allocate::filled(cells, [0.0; 2])?;
        }
        Ok(())
    }

    /// Divides both latents by the channels' standard deviations, and resamples the previous one at all sub-cell offsets.
    fn normalise(&mut self, z0: LatentView<'_>, z1: LatentView<'_>) {
        let [channels, height, width] = z1.shape();
        let cells = height * width;
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        for c in 0..channels {
            let both = || z0.channel(c).iter().chain(z1.channel(c)).map(|v| f64::from(finite(*v)));
            let mean = both().sum::<f64>() / (2 * cells) as f64;
            let variance = both().map(|v| (v - mean).powi(2)).sum::<f64>() / (2 * cells) as f64;
            // A constant channel carries no information.
            let scale = if variance > 0.0 { variance.sqrt().recip() } else { 0.0 };
            let of = |v: f32| ((f64::from(finite(v)) - mean) * scale) as f32;
            for (cell, (before, now)) in z0.channel(c).iter().zip(z1.channel(c)).enumerate() {
                self.current[cell * channels + c] = of(*now);
                self.phases[cell * channels + c] = of(*before);
            }
        }
        let (whole, between) = self.phases.split_at_mut(cells * channels);
        between.par_chunks_mut(cells * channels).enumerate().for_each(|(n, values)| {
            let phase = [(n + 1) % STEPS_PER_CELL, (n + 1) / STEPS_PER_CELL];
            let [across, down] = phase.map(|steps| steps as f32 / STEPS_PER_CELL as f32);
            for (cell, values) in values.chunks_exact_mut(channels).enumerate() {
                let (x, y) = (cell % width, cell / width);
                let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
                let cells = [y, below].map(|y| [x, right].map(|x| y * width + x));
                for (c, value) in values.iter_mut().enumerate() {
                    *value = bilinear(cells, [across, down], |cell| whole[cell * channels + c]);
                }
            }
        });
    }

    /// Fills `errors` with E.
    fn matching_costs(&mut self, [channels, height, width]: [usize; 3]) {
        let (current, phases) = (&self.current, &self.phases);
        let per_phase = height * width * channels;
        self.unfiltered_errors.par_chunks_mut(CANDIDATES).enumerate().for_each(|(cell, errors)| {
            let (x, y) = (cell % width, cell / width);
            let here = &current[cell * channels..][..channels];
            for (candidate, error) in errors.iter_mut().enumerate() {
                let [u, v] = displacement(candidate);
                // Position in steps, clamped to the latent.
                let at = |from: usize, steps: i32, len: usize| {
                    (from as i64 * STEPS_PER_CELL as i64 + i64::from(steps))
                        .clamp(0, ((len - 1) * STEPS_PER_CELL) as i64) as usize
                };
                let (px, py) = (at(x, u, width), at(y, v, height));
                let phase = py % STEPS_PER_CELL * STEPS_PER_CELL + px % STEPS_PER_CELL;
                let there = phase * per_phase + (py / STEPS_PER_CELL * width + px / STEPS_PER_CELL) * channels;
                let there = &phases[there..][..channels];
                let sum: f32 = here.iter().zip(there).map(|(a, b)| (a - b) * (a - b)).sum();
                *error = sum / channels as f32;
            }
        });
        let unfiltered_errors = &self.unfiltered_errors;
        self.errors.par_chunks_mut(CANDIDATES).enumerate().for_each(|(cell, errors)| {
            errors.fill(0.0);
            let mut weights = 0.0;
            for (neighbour, weight) in window(cell, height, width) {
                weights += weight;
                let theirs = &unfiltered_errors[neighbour * CANDIDATES..][..CANDIDATES];
                errors.iter_mut().zip(theirs).for_each(|(sum, error)| *sum += weight * error);
            }
            errors.iter_mut().for_each(|sum| *sum /= weights);
        });
    }

    /// Fills `flow` with u.
    fn select_motion(&mut self, [_, height, width]: [usize; 3]) {
        let Self { errors, best, previous_best, flow, .. } = self;
        let errors_of = |cell: usize| &errors[cell * CANDIDATES..][..CANDIDATES];
        for round in 0..=ROUNDS {
            std::mem::swap(best, previous_best);
            let previous_best = &*previous_best;
            best.par_iter_mut().enumerate().for_each(|(cell, best)| {
                let smoothness =
                    Smoothness::new(if round == 0 { None } else { Some(previous_best) }, cell, height, width);
                *best = argmin(errors_of(cell), &smoothness);
            });
        }
        let best = &*best;
        flow.par_iter_mut().enumerate().for_each(|(cell, flow)| {
            let smoothness = Smoothness::new(Some(best), cell, height, width);
            let (errors, at) = (errors_of(cell), best[cell]);
            let cost = |at: [i32; 2]| candidate_index(at).map(|candidate| errors[candidate] + smoothness.cost(at));
            *flow = [0, 1].map(|axis| {
                let cost_at_step = |step: i32| {
                    let mut to = at;
                    to[axis] += step;
                    cost(to)
                };
                (at[axis] as f32 + parabola_minimum(cost_at_step(-1), cost_at_step(0), cost_at_step(1)))
                    / STEPS_PER_CELL as f32
            });
        });
    }

    /// Upsamples the flow to render size and writes it to `out`.
    fn upsample(&mut self, [_, height, width]: [usize; 3], out: &mut Guidance) {
        let (render_width, render_height) = (out.size().0 as usize, out.size().1 as usize);
        self.columns.clear();
        self.columns.extend((0..render_width).map(|x| Tap::new(x, render_width, width)));
        let (columns, flow) = (&self.columns, &self.flow);
        let limit = [render_width as f32, render_height as f32];
        let cell = [limit[0] / width as f32, limit[1] / height as f32];
        let Guidance { motion, depth, .. } = out;
        depth.fill(picture_flow::FLAT_DEPTH);
        motion.vectors_mut().par_chunks_mut(render_width).enumerate().for_each(|(y, vectors)| {
            let row = Tap::new(y, render_height, height);
            for (vector, column) in vectors.iter_mut().zip(columns) {
                let (cells, weights) = (Tap::cells(row, *column, width), [column.weight, row.weight]);
                *vector = [0, 1].map(|axis| {
                    let m = cell[axis] * bilinear(cells, weights, |cell| flow[cell][axis]);
                    f16::from_f32(m.clamp(-limit[axis], limit[axis]))
                });
            }
        });
    }
}

/// The cells of the 3 x 3 window around `cell` that exist, with their weights.
fn window(cell: usize, height: usize, width: usize) -> impl Iterator<Item = (usize, f32)> {
    let (x, y) = ((cell % width) as i64, (cell / width) as i64);
    (-1..=1).flat_map(move |dy: i64| (-1..=1).map(move |dx: i64| (dx, dy))).filter_map(move |(dx, dy)| {
        let (x, y) = (x + dx, y + dy);
        let is_inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
        let weight = ((2 - dx.abs()) * (2 - dy.abs())) as f32;
        is_inside.then(|| (y as usize * width + x as usize, weight))
    })
}

/// Displacement in steps for a candidate index.
fn displacement(candidate: usize) -> [i32; 2] {
    [candidate % CANDIDATES_PER_AXIS, candidate / CANDIDATES_PER_AXIS]
        .map(|n| n as i32 - (REACH * STEPS_PER_CELL) as i32)
}

/// Candidate index for a displacement in steps; `None` beyond the search range.
fn candidate_index([u, v]: [i32; 2]) -> Option<usize> {
    let [u, v] = [u, v].map(|steps| {
        usize::try_from(steps + (REACH * STEPS_PER_CELL) as i32).ok().filter(|n| *n < CANDIDATES_PER_AXIS)
    });
    Some(v? * CANDIDATES_PER_AXIS + u?)
}

/// Smoothness term of a cell. The sum of squared distances to the neighbours equals `count` times the squared distance to their mean,
/// plus a constant.
struct Smoothness {
    mean: [f32; 2],
    count: f32,
}

impl Smoothness {
    fn new(flow: Option<&Vec<[i32; 2]>>, cell: usize, height: usize, width: usize) -> Self {
        let (x, y) = (cell % width, cell / width);
        let neighbours = [
            (x > 0).then(|| cell - 1),
            (x + 1 < width).then_some(cell + 1),
            (y > 0).then(|| cell - width),
            (y + 1 < height).then_some(cell + width),
        ];
        let mut smoothness = Self { mean: [0.0; 2], count: 0.0 };
        for steps in flow.iter().flat_map(|flow| neighbours.into_iter().flatten().map(|n| flow[n])) {
            smoothness.mean = [smoothness.mean[0] + steps[0] as f32, smoothness.mean[1] + steps[1] as f32];
            smoothness.count += 1.0;
        }
        smoothness.mean = smoothness.mean.map(|sum| sum / smoothness.count.max(1.0));
        smoothness
    }

    fn cost(&self, at: [i32; 2]) -> f32 {
        let cells = [0, 1].map(|axis| (at[axis] as f32 - self.mean[axis]) / STEPS_PER_CELL as f32);
        SMOOTHNESS_WEIGHT * self.count * (cells[0] * cells[0] + cells[1] * cells[1])
    }
}

/// Displacement of least cost, in steps; the shortest where several have it.
fn argmin(errors: &[f32], smoothness: &Smoothness) -> [i32; 2] {
    let mut best = ([0; 2], f32::INFINITY, i32::MAX);
    for (candidate, error) in errors.iter().enumerate() {
        let at = displacement(candidate);
        let (cost, far) = (error + smoothness.cost(at), at[0] * at[0] + at[1] * at[1]);
        if (cost, far) < (best.1, best.2) {
            best = (at, cost, far);
        }
    }
    best.0
}

/// Minimum, between -1/2 and 1/2, of the parabola through three costs at -1, 0 and 1. 0 if a cost is missing, the cost is already 0
/// or the parabola does not open upwards.
fn parabola_minimum(before: Option<f32>, here: Option<f32>, after: Option<f32>) -> f32 {
    let (Some(before), Some(here), Some(after)) = (before, here, after) else { return 0.0 };
    let bend = before - 2.0 * here + after;
    if bend > 0.0 && here > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests;
