//! Motion from two pictures: dense inverse search optical flow.
//!
//! After Kroeger, Timofte, Dai and Van Gool, "Fast Optical Flow using Dense Inverse Search" (ECCV 2016), with a
//! smoothing of the patch grid in place of its variational refinement. From coarse to fine:
//!
//! ```text
//! luma     Y = 0.299 R + 0.587 G + 0.114 B in code values, halved by 2 x 2 means until a side is short
//! patches  8 x 8 pixels every 4, or every 8 in large pictures; start: the best of the coarser level's motions here and in
//!          adjacent cells, the global model, and zero
//! search   min over u of the sum of ((Y1(x + u) - mean) - (Y0(x) - mean))^2 by inverse-compositional steps
//!          u -= H^-1 b, H = sum of g g^T once per patch, g the centred gradient of Y0
//! widen    on small levels, where the match is poor: all motions of whole pixels within 8; one that matches clearly better than the
//!          others, in both directions, is taken
//! smooth   min over u of the sum of (u - u_p)^T H_p (u - u_p) / (residual + noise), plus squared differences between
//!          neighbours, weighted by similarity of their luma and motion
//! model    robust fit of one motion to the grid: a plane in front of a moving camera
//! repeat   on all levels but the finest: search again from the smoothed motion, the neighbours' extrapolated motion and the
//!          global model, where they differ from the motion found; then smooth and fit again
//! densify  bilinear between patches where motion is smooth; at motion edges the candidate around the block with the smallest
//!          difference over each pixel's 5 x 5 neighbourhood
//! ```
//!
//! The backward flow, from the current picture to the previous one, is the output; the forward flow only checks it. In a picture of
//! more than a megapixel the finest level searched is the first below that, and the forward flow stops one level coarser. Motion
//! that fails the forward-backward check, leads out of the picture or does not match is replaced by hole filling from
//! consistent pixels nearby, weighted towards similar colours. Removing each patch's mean makes the search insensitive to brightness changes.
//!
//! **Depth is flat**: 0.5 everywhere. Motion gives an order of depth only where the camera moves straight through a static world. While
//! the camera turns, motion does not depend on depth, and an item in its hand does not move although it is nearest. A wrong order would
//! make worse frames than none.

mod consistency;
mod dense;
#[cfg(windows)]
mod gpu;
mod grid;
mod model;
mod patch;
mod pyramid;
mod rules;
mod wide;

use std::time::{Duration, Instant};

use fearless_simd::Level;
use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{Guidance, MotionOrigin, Projection, paper};
use crate::{Error, ErrorKind, Picture, Result};
use consistency::Consistency;
use dense::Dense;
#[cfg(windows)]
pub use gpu::{DESCRIPTORS, GpuExtractor};
use grid::{FirstSearch, Grid};
use pyramid::Pyramid;
#[doc(hidden)]
pub use rules::Rule;
use rules::Rules;

use crate::tasks::{self, Parallel, ParallelSliceMut, PoolLease};

/// The camera stated for the flat depth; the same as [`paper::PROJECTION`].
pub const PROJECTION: Projection = paper::PROJECTION;
/// The depth given to every pixel, in device depth.
pub const FLAT_DEPTH: f32 = 0.5;

#[cfg(test)]
crate::shader_constants::shader_constants!("PICTURE_FLOW_": float FLAT_DEPTH);

/// Repeated searches on a level of at most [`SMALL_LEVEL`] pixels.
const ROUNDS: usize = 4;
/// Largest level that gets [`ROUNDS`] repetitions and the search over all motions nearby: correct motion has far to spread there, and
/// both are cheap.
const SMALL_LEVEL: usize = 1 << 14;
/// Pixels of a row that are written at a time.
const SEGMENT: usize = 32;

/// Fills `out` for the step from `previous` to `current`.
///
/// One extraction; an [`Extractor`] keeps its working memory from one to the next.
///
/// # Errors
/// As [`Extractor::extract`].
pub fn extract(previous: &Picture, current: &Picture, out: &mut Guidance) -> Result<()> {
    Extractor::new().extract(previous, current, out)
}

/// The extractor with its working memory: about 60 bytes per pixel, a quarter of that in large pictures. It allocates nothing
/// after the largest picture. Rows run in parallel; the result does not depend on the number of threads or on the processor's
/// vector instructions.
#[derive(Debug)]
pub struct Extractor {
    level: Level,
    rules: Rules,
    current: Pyramid,
    previous: Pyramid,
    backward: DirectedFlow,
    forward: DirectedFlow,
    consistency: Consistency,
    times: StageTimes,
    _threads: PoolLease,
}

/// How long the stages of an extraction took.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct StageTimes {
    /// Building the luma pyramids.
    pub pyramid: Duration,
    /// Search and smoothing of the patches, both directions.
    pub search: Duration,
    /// From patches to pixels, both directions.
    pub densify: Duration,
    /// Forward-backward check.
    pub check: Duration,
    /// Hole filling, and writing the guidance.
    pub write: Duration,
}

/// Working memory and result of the flow in one direction, from one picture to the other.
#[derive(Debug, Default)]
struct DirectedFlow {
    coarse: Grid,
    fine: Grid,
    dense: Dense,
}

impl Default for Extractor {
    fn default() -> Self {
        Self::new()
    }
}

impl Extractor {
    /// An extractor without working memory yet.
    pub fn new() -> Self {
        Self::at(Level::new())
    }

    /// An extractor that uses vector instructions up to `level`.
    fn at(level: Level) -> Self {
        Self {
            level,
            rules: Rules::default(),
            current: Pyramid::default(),
            previous: Pyramid::default(),
            backward: DirectedFlow::default(),
            forward: DirectedFlow::default(),
            consistency: Consistency::default(),
            times: StageTimes::default(),
            _threads: PoolLease::new(),
        }
    }

    /// This extractor without one of its rules, for measurements.
    #[doc(hidden)]
    pub fn without(self, rule: Rule) -> Self {
        Self { rules: self.rules.without(rule), ..self }
    }

    /// Writes the guidance for the step from `previous` to `current` to `out`, which is resized to one vector and one depth per pixel
    /// if needed. Motion is finite and no longer than the picture along each axis; depth is [`FLAT_DEPTH`].
    ///
    /// # Errors
    /// `InvalidArgument` when the pictures differ in size, `OutOfMemory` when working memory or `out` cannot grow.
    pub fn extract(&mut self, previous: &Picture, current: &Picture, out: &mut Guidance) -> Result<()> {
        let size = current.size();
        if previous.size() != size {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("the pictures have {:?} and {size:?} pixels", previous.size()),
            )
            .field("previous"));
        }
        let start = Instant::now();
        out.make_per_pixel(size, PROJECTION, MotionOrigin::OpticalFlow)?;
        self.previous.build(self.level, previous)?;
        self.current.build(self.level, current)?;
        let built = Instant::now();

        // The forward flow only checks the backward one: in a large picture one level coarser is enough.
        let finest = self.previous.finest();
        let checked = if finest > 0 { (finest + 1).min(self.previous.levels().len() - 1) } else { 0 };
        let Self { level, rules, previous: from, current: to, backward, forward, .. } = &mut *self;
        let (level, rules, from, to) = (*level, *rules, &*from, &*to);
        let (back, forth) = tasks::join_loops(
            || backward.search(level, rules, to, from, finest),
            || forward.search(level, rules, from, to, checked),
        );
        back.and(forth)?;
        let searched = Instant::now();

        backward.densify(level, to, from, finest)?;
        forward.densify(level, from, to, checked)?;
        let densified = Instant::now();

        self.consistency.check(&self.backward.dense, &self.forward.dense, checked - finest, rules)?;
        let compared = Instant::now();

        self.write(current, finest, out);
        self.times = StageTimes {
            pyramid: built - start,
            search: searched - built,
            densify: densified - searched,
            check: compared - densified,
            write: compared.elapsed(),
        };
        Ok(())
    }

    /// How long the stages of the last extraction took.
    pub fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Writes depth, and motion from level `finest` with holes filled.
    fn write(&self, current: &Picture, finest: usize, out: &mut Guidance) {
        let width = current.width() as usize;
        // In a large picture the row below reuses the filled motion.
        let (height, together) = (1 << finest, if finest > 0 { 2 } else { 1 });
        let Guidance { motion, depth, .. } = out;
        depth.fill(FLAT_DEPTH);
        let motions = motion.vectors_mut().par_chunks_mut(together * height * width);
        motions.enumerate().for_each(|(n, motion)| {
            let mut above = None;
            for (y, rows) in (n * together..).zip(motion.chunks_mut(height * width)) {
                let (first, others) = rows.split_at_mut(width);
                self.write_row(current, finest, y, first, above);
                others.chunks_exact_mut(width).for_each(|other| other.copy_from_slice(first));
                above = Some(&*first);
            }
        });
    }

    /// Writes the motion of row `y` of level `finest` to a row of the picture. A pixel that is inconsistent here and in the row above
    /// copies its vector from `above`, if given.
    fn write_row(&self, current: &Picture, finest: usize, y: usize, row: &mut [[f16; 2]], above: Option<&[[f16; 2]]>) {
        let (flow, consistency) = (&self.backward.dense, &self.consistency);
        let (scale, limit) = ((1_u32 << finest) as f32, [current.width() as f32, current.height() as f32]);
        let (mut found, mut vectors) = ([[0.0_f32; 2]; SEGMENT], [[f16::ZERO; 2]; SEGMENT]);
        for (i, run) in row.chunks_mut(SEGMENT << finest).enumerate() {
            let first = i * SEGMENT;
            let len = run.len().div_ceil(1 << finest);
            let (found, vectors) = (&mut found[..len], &mut vectors[..len]);
            found.copy_from_slice(&flow.row(y)[first..][..len]);
            let consistent = &consistency.row(y)[first..][..len];
            let is_as_above = |k: usize| !consistent[k] && above.is_some() && !consistency.row(y - 1)[first + k];
            let all_consistent = consistent.iter().all(|consistent| *consistent);
            if !all_consistent {
                let mut wanted = [false; SEGMENT];
                (0..len).for_each(|k| wanted[k] = !consistent[k] && !is_as_above(k));
                // A pixel between two others to be filled takes the mean of them.
                let is_between = |k: usize| k % 2 == 1 && wanted.get(k - 1..k + 2) == Some(&[true; 3]);
                for k in (0..len).filter(|&k| wanted[k] && !is_between(k)) {
                    found[k] = consistency.fill_from_rays(flow, current, finest, first + k, y);
                }
                for k in (1..len).step_by(2).filter(|&k| is_between(k)) {
                    found[k] = [0, 1].map(|axis| 0.5 * (found[k - 1][axis] + found[k + 1][axis]));
                }
            }
            for vector in found.iter_mut() {
                // Adding to 0 turns -0 into +0.
                vector[0] = 0.0 + (scale * vector[0]).clamp(-limit[0], limit[0]);
                vector[1] = 0.0 + (scale * vector[1]).clamp(-limit[1], limit[1]);
            }
            vectors.as_flattened_mut().convert_from_f32_slice(found.as_flattened());
            if let (Some(above), false) = (above, all_consistent) {
                let above = &above[first << finest..];
                (0..len).filter(|&k| is_as_above(k)).for_each(|k| vectors[k] = above[k << finest]);
            }
            match finest {
                0 => run.copy_from_slice(vectors),
                1 if run.len() == 2 * SEGMENT => {
                    run.as_chunks_mut::<2>().0.iter_mut().zip(vectors).for_each(|(pair, vector)| *pair = [*vector; 2]);
                }
                _ => run.chunks_mut(1 << finest).zip(vectors).for_each(|(run, vector)| run.fill(*vector)),
            }
        }
    }
}

impl DirectedFlow {
    /// Patch motion from `from` to `to`, coarse to fine down to level `finest`.
    fn search(&mut self, simd: Level, rules: Rules, from: &Pyramid, to: &Pyramid, finest: usize) -> Result<()> {
        // Swap so that the finest level always ends up in the same grid; the other's memory then stays small.
        if (from.levels().len() - finest) % 2 == 1 {
            std::mem::swap(&mut self.coarse, &mut self.fine);
        }
        for level in (finest..from.levels().len()).rev() {
            let (from_plane, to_plane) = (&from.levels()[level], &to.levels()[level]);
            std::mem::swap(&mut self.coarse, &mut self.fine);
            let coarse = (level + 1 < from.levels().len()).then_some(&self.coarse);
            let is_large = level > 0 && level == from.finest();
            let first = FirstSearch {
                stride: if is_large { grid::WIDE_STRIDE } else { grid::STRIDE },
                is_wide: rules.has(Rule::WideSearch),
            };
            self.fine.search(simd, from_plane, to_plane, coarse, first)?;
            self.fine.smooth(simd)?;
            let rounds = match level {
                _ if level == finest || !rules.has(Rule::RepeatedSearch) => 0,
                _ if from_plane.luma.len() <= SMALL_LEVEL => ROUNDS,
                _ => 1,
            };
            for _ in 0..rounds {
                self.fit(rules)?;
                self.fine.search_again(simd, from_plane, to_plane);
                self.fine.smooth(simd)?;
            }
            if level > finest {
                self.fit(rules)?;
            }
        }
        Ok(())
    }

    /// Fits the global model, if there is one.
    fn fit(&mut self, rules: Rules) -> Result<()> {
        if rules.has(Rule::GlobalModel) { self.fine.fit() } else { Ok(()) }
    }

    /// Densifies the motion on level `finest`.
    fn densify(&mut self, level: Level, from: &Pyramid, to: &Pyramid, finest: usize) -> Result<()> {
        self.dense.densify(level, &from.levels()[finest], &to.levels()[finest], &self.fine)
    }
}

/// Resizes `values` to exactly `len` elements; new ones are `value`.
fn reserve<T: Clone>(values: &mut Vec<T>, len: usize, value: T) -> Result<()> {
    values.truncate(len);
    values.try_reserve_exact(len - values.len()).map_err(|_| {
        Error::new(ErrorKind::OutOfMemory, format!("{len} values of {} bytes cannot be allocated", size_of::<T>()))
    })?;
    values.resize(len, value);
    Ok(())
}

/// The constants of these modules that shaders have too, for `constants.hlsli`.
#[cfg(test)]
pub(super) fn shader_constants() -> Vec<crate::shader_constants::Constants> {
    vec![
        SHADER_CONSTANTS,
        patch::SHADER_CONSTANTS,
        wide::SHADER_CONSTANTS,
        model::SHADER_CONSTANTS,
        grid::SHADER_CONSTANTS,
        dense::SHADER_CONSTANTS,
        consistency::SHADER_CONSTANTS,
    ]
}

#[cfg(test)]
mod tests;
