//! Motion from two pictures: dense inverse search optical flow.
//!
//! After Kroeger, Timofte, Dai and Van Gool, "Fast Optical Flow using Dense Inverse Search" (ECCV 2016), with a
//! smoothing of the patch grid in place of its variational refinement. From coarse to fine:
//!
//! ```text
//! luma     Y = 0.299 R + 0.587 G + 0.114 B in code values, halved by 2 x 2 means until a side is short
//! patches  8 x 8 pixels every 4, or every 8 in large pictures; start: the best of the motions there and beside there
//!          on the coarser level, of that of the whole picture, and of none
//! search   min over u of the sum of ((Y1(x + u) - mean) - (Y0(x) - mean))^2 by inverse-compositional steps
//!          u -= H^-1 b, H = sum of g g^T once per patch, g the centred gradient of Y0
//! grid     min over u of the sum of (u - u_p)^T H_p (u - u_p) / (residual + noise), and of differences of neighbours,
//!          weighted by likeness of their luma and of their motion
//! whole    the motion that most of the grid agrees on, as of a plane before a moving camera
//! again    on all levels but the finest: search from the smooth motion, from that of the neighbours drawn on in a line
//!          and from the whole picture's, where they differ from what was found; grid and whole anew
//! pixels   bilinear between patches on a smooth sheet; at edges of motion, of the motions around, that which explains
//!          best the 5 x 5 pixels around each
//! ```
//!
//! It runs from the current picture to the previous one, which is the motion given out, and back. Of a picture of more
//! than a megapixel the finest level is that which has less, and the way back, which is only for checking, stops at half
//! the size of that. Where the two do not undo each other, lead out of the picture or to what looks otherwise, motion is
//! taken from near places where none of this is so, those of similar colour first. Removing each patch's mean makes it
//! blind to a change of brightness.
//!
//! **Depth is flat**: 0.5 everywhere, no order. Longer motion is nearer only where the eye moves straight on through a
//! world at rest; while it turns all moves alike, and a held item rests although it is nearest. A guess that is wrong
//! just there would be worse than none.

mod dense;
#[cfg(windows)]
mod gpu;
mod grid;
mod model;
mod patch;
mod pyramid;
mod trust;

use std::time::{Duration, Instant};

use fearless_simd::Level;
use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{Guidance, Projection, paper};
use crate::{Error, ErrorKind, Picture, Result};
use dense::Dense;
#[cfg(windows)]
pub use gpu::{DESCRIPTORS, GpuExtractor};
use grid::Grid;
use pyramid::Pyramid;
use trust::Trust;

use crate::tasks::{self, Parallel, ParallelSliceMut, Use};

/// The camera stated for the flat depth; the same as [`paper::PROJECTION`].
pub const PROJECTION: Projection = paper::PROJECTION;
/// The depth given to every pixel, in device depth.
pub const FLAT_DEPTH: f32 = 0.5;
/// Searches anew on a level of few pixels,
const ROUNDS: usize = 4;
/// which are these at most: what is right must go a long way there, and costs little.
const SMALL: usize = 1 << 14;
/// Pixels of a row that are written at once.
const RUN: usize = 32;

/// Fills `out` for the step from `previous` to `current`.
///
/// One extraction; an [`Extractor`] keeps its working memory from one to the next.
///
/// # Errors
/// As [`Extractor::extract`].
pub fn extract(previous: &Picture, current: &Picture, out: &mut Guidance) -> Result<()> {
    Extractor::new().extract(previous, current, out)
}

/// The extractor with its working memory, about 60 bytes per pixel, a quarter of that in large pictures. It allocates nothing once it has seen the largest
/// picture. Rows run in parallel; the result depends neither on how many threads there are nor on
/// the vector instructions of the processor.
#[derive(Debug)]
pub struct Extractor {
    level: Level,
    current: Pyramid,
    previous: Pyramid,
    backward: Direction,
    forward: Direction,
    trust: Trust,
    times: StageTimes,
    _threads: Use,
}

/// How long the stages of an extraction took.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct StageTimes {
    /// Luma at all sizes.
    pub pyramid: Duration,
    /// Search and smoothing of the patches, in both directions.
    pub search: Duration,
    /// From patches to pixels, in both directions.
    pub densify: Duration,
    /// Which motions to trust.
    pub check: Duration,
    /// Fills, and the guidance itself.
    pub write: Duration,
}

/// The flow from one picture to the other.
#[derive(Debug, Default)]
struct Direction {
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
            current: Pyramid::default(),
            previous: Pyramid::default(),
            backward: Direction::default(),
            forward: Direction::default(),
            trust: Trust::default(),
            times: StageTimes::default(),
            _threads: Use::new(),
        }
    }

    /// Fills `out` for the step from `previous` to `current`; `out` takes their size, and a vector and a depth to each
    /// pixel, if it has others. Motion is finite and no longer than the picture along each axis; depth is
    /// [`FLAT_DEPTH`].
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
        out.make_per_pixel(size, PROJECTION)?;
        self.previous.build(self.level, previous)?;
        self.current.build(self.level, current)?;
        let built = Instant::now();

        // The way back is only for checking: where the finest level is left out, half its size will do.
        let finest = self.previous.finest();
        let checked = if finest > 0 { (finest + 1).min(self.previous.levels().len() - 1) } else { 0 };
        let Self { level, previous: from, current: to, backward, forward, .. } = &mut *self;
        let (level, from, to) = (*level, &*from, &*to);
        let (back, forth) =
            tasks::join_loops(|| backward.follow(level, to, from, finest), || forward.follow(level, from, to, checked));
        back.and(forth)?;
        let searched = Instant::now();

        backward.spread(level, to, from, finest)?;
        forward.spread(level, from, to, checked)?;
        let spread = Instant::now();

        self.trust.check(&self.backward.dense, &self.forward.dense, checked - finest)?;
        let compared = Instant::now();

        self.write(current, finest, out);
        self.times = StageTimes {
            pyramid: built - start,
            search: searched - built,
            densify: spread - searched,
            check: compared - spread,
            write: compared.elapsed(),
        };
        Ok(())
    }

    /// How long the stages of the last extraction took.
    pub fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Writes the motion, found on level `finest` and filled where it is not to be trusted, and the depth.
    fn write(&self, current: &Picture, finest: usize, out: &mut Guidance) {
        let width = current.width() as usize;
        // In a large picture a fill does for the row below as well.
        let (height, together) = (1 << finest, if finest > 0 { 2 } else { 1 });
        let Guidance { motion, depth } = out;
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

    /// Writes the motion of row `y` of level `finest` to a row of the picture; what neither is trusted here nor was in the
    /// row `above`, where that is given, is as there.
    fn write_row(&self, current: &Picture, finest: usize, y: usize, row: &mut [[f16; 2]], above: Option<&[[f16; 2]]>) {
        let (flow, trust) = (&self.backward.dense, &self.trust);
        let (scale, limit) = ((1_u32 << finest) as f32, [current.width() as f32, current.height() as f32]);
        let (mut found, mut vectors) = ([[0.0_f32; 2]; RUN], [[f16::ZERO; 2]; RUN]);
        for (i, run) in row.chunks_mut(RUN << finest).enumerate() {
            let first = i * RUN;
            let len = run.len().div_ceil(1 << finest);
            let (found, vectors) = (&mut found[..len], &mut vectors[..len]);
            found.copy_from_slice(&flow.row(y)[first..][..len]);
            let trusted = &trust.row(y)[first..][..len];
            let is_as_above = |k: usize| !trusted[k] && above.is_some() && !trust.row(y - 1)[first + k];
            let all_trusted = trusted.iter().all(|trusted| *trusted);
            if !all_trusted {
                let mut wanted = [false; RUN];
                (0..len).for_each(|k| wanted[k] = !trusted[k] && !is_as_above(k));
                // Those between two others that are filled take the mean of them.
                let is_between = |k: usize| k % 2 == 1 && wanted.get(k - 1..k + 2) == Some(&[true; 3]);
                for k in (0..len).filter(|&k| wanted[k] && !is_between(k)) {
                    found[k] = trust.filled(flow, current, finest, first + k, y);
                }
                for k in (1..len).step_by(2).filter(|&k| is_between(k)) {
                    found[k] = [0, 1].map(|axis| 0.5 * (found[k - 1][axis] + found[k + 1][axis]));
                }
            }
            for vector in found.iter_mut() {
                // Added to 0 so that no motion is +0.
                vector[0] = 0.0 + (scale * vector[0]).clamp(-limit[0], limit[0]);
                vector[1] = 0.0 + (scale * vector[1]).clamp(-limit[1], limit[1]);
            }
            vectors.as_flattened_mut().convert_from_f32_slice(found.as_flattened());
            if let (Some(above), false) = (above, all_trusted) {
                let above = &above[first << finest..];
                (0..len).filter(|&k| is_as_above(k)).for_each(|k| vectors[k] = above[k << finest]);
            }
            match finest {
                0 => run.copy_from_slice(vectors),
                1 if run.len() == 2 * RUN => {
                    run.as_chunks_mut::<2>().0.iter_mut().zip(vectors).for_each(|(pair, vector)| *pair = [*vector; 2]);
                }
                _ => run.chunks_mut(1 << finest).zip(vectors).for_each(|(run, vector)| run.fill(*vector)),
            }
        }
    }
}

impl Direction {
    /// The patches' motion from `from` to `to`, coarse to fine down to level `finest`.
    fn follow(&mut self, simd: Level, from: &Pyramid, to: &Pyramid, finest: usize) -> Result<()> {
        // The finest level ends up in the same one of the two every time, so that the other's memory stays small.
        if (from.levels().len() - finest) % 2 == 1 {
            std::mem::swap(&mut self.coarse, &mut self.fine);
        }
        for level in (finest..from.levels().len()).rev() {
            let (from_plane, to_plane) = (&from.levels()[level], &to.levels()[level]);
            std::mem::swap(&mut self.coarse, &mut self.fine);
            let coarse = (level + 1 < from.levels().len()).then_some(&self.coarse);
            let is_large = level > 0 && level == from.finest();
            self.fine.search(simd, from_plane, to_plane, coarse, if is_large { grid::APART } else { grid::CLOSE })?;
            self.fine.smooth(simd)?;
            let rounds = match level {
                _ if level == finest => 0,
                _ if from_plane.luma.len() <= SMALL => ROUNDS,
                _ => 1,
            };
            for _ in 0..rounds {
                self.fine.fit()?;
                self.fine.search_again(simd, from_plane, to_plane);
                self.fine.smooth(simd)?;
            }
            if level > finest {
                self.fine.fit()?;
            }
        }
        Ok(())
    }

    /// The motion of each pixel of level `finest`.
    fn spread(&mut self, level: Level, from: &Pyramid, to: &Pyramid, finest: usize) -> Result<()> {
        self.dense.spread(level, &from.levels()[finest], &to.levels()[finest], &self.fine)
    }
}

/// Makes `values` hold exactly `len` values, those that are new being `value`.
fn reserve<T: Clone>(values: &mut Vec<T>, len: usize, value: T) -> Result<()> {
    values.truncate(len);
    values.try_reserve_exact(len - values.len()).map_err(|_| {
        Error::new(ErrorKind::OutOfMemory, format!("{len} values of {} bytes cannot be allocated", size_of::<T>()))
    })?;
    values.resize(len, value);
    Ok(())
}

#[cfg(test)]
mod tests;
