//! Motion from two pictures: dense inverse search optical flow.
//!
//! After Kroeger, Timofte, Dai and Van Gool, "Fast Optical Flow using Dense Inverse Search" (ECCV 2016), with a
//! smoothing of the patch grid in place of its variational refinement. From coarse to fine:
//!
//! ```text
//! luma     Y = 0.299 R + 0.587 G + 0.114 B in code values, halved by 2 x 2 means until a side is short
//! patches  8 x 8 pixels every 4; start: the best of four motions of the coarser level and of none
//! search   min over u of the sum of ((Y1(x + u) - mean) - (Y0(x) - mean))^2 by inverse-compositional steps
//!          u -= H^-1 b, H = sum of g g^T once per patch, g the centred gradient of Y0
//! grid     min over u of the sum of (u - u_p)^T H_p (u - u_p) / (residual + noise), and of differences of neighbours,
//!          weighted by likeness of their luma and of their motion
//! pixels   mean of the patches over a pixel, weighted by how well each explains the pixel
//! ```
//!
//! It runs from the current picture to the previous one, which is the motion given out, and back. Where the two do not
//! undo each other, or lead out of the picture, motion is taken from the nearest places where they do, those of similar
//! colour first. Removing each patch's mean makes it blind to a change of brightness.
//!
//! **Depth is flat**: 0.5 everywhere, no order. Longer motion is nearer only where the eye moves straight on through a
//! world at rest; while it turns all moves alike, and a held item rests although it is nearest. A guess that is wrong
//! just there would be worse than none.

mod dense;
mod grid;
mod patch;
mod pyramid;

use half::f16;
use rayon::prelude::*;

use super::{Guidance, Projection, paper};
use crate::{Error, ErrorKind, Picture, Result};
use dense::Dense;
use grid::Grid;
use pyramid::Pyramid;

/// The camera stated for the flat depth; the same as [`paper::PROJECTION`].
pub const PROJECTION: Projection = paper::PROJECTION;
/// The depth given to every pixel, in device depth.
pub const FLAT_DEPTH: f32 = 0.5;

/// Fills `out` for the step from `previous` to `current`.
///
/// One extraction; an [`Extractor`] keeps its working memory from one to the next.
///
/// # Errors
/// As [`Extractor::extract`].
pub fn extract(previous: &Picture, current: &Picture, out: &mut Guidance) -> Result<()> {
    Extractor::new().extract(previous, current, out)
}

/// The extractor with its working memory. It allocates nothing once it has seen the largest picture. Rows run in
/// parallel on the current rayon pool; the result does not depend on how many threads it has.
#[derive(Debug, Default)]
pub struct Extractor {
    current: Pyramid,
    previous: Pyramid,
    backward: Direction,
    forward: Direction,
    trusted: Vec<bool>,
}

/// The flow from one picture to the other.
#[derive(Debug, Default)]
struct Direction {
    coarse: Grid,
    fine: Grid,
    dense: Dense,
}

impl Extractor {
    /// An extractor without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Fills `out` for the step from `previous` to `current`; `out` takes their size if it has another. Motion is
    /// finite and no longer than the picture along each axis; depth is [`FLAT_DEPTH`].
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
        out.make_per_pixel(size, PROJECTION)?;
        self.current.build(current)?;
        self.previous.build(previous)?;
        self.backward.follow(&self.current, &self.previous)?;
        self.forward.follow(&self.previous, &self.current)?;
        reserve(&mut self.trusted, self.backward.dense.flow.len(), false)?;
        dense::check(&self.backward.dense, &self.forward.dense, &mut self.trusted);
        self.write(current, out);
        Ok(())
    }

    /// Writes the motion, filled where it is not to be trusted, and the depth.
    fn write(&self, current: &Picture, out: &mut Guidance) {
        let width = current.width() as usize;
        let limit = [current.width() as f32, current.height() as f32];
        let (flow, trusted) = (&self.backward.dense, &self.trusted);
        let Guidance { motion, depth } = out;
        depth.depth_mut().fill(FLAT_DEPTH);
        motion.vectors_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, vector) in row.iter_mut().enumerate() {
                let found = dense::filled(flow, trusted, current, x, y);
                // Added to 0 so that no motion is +0.
                *vector = [0, 1].map(|axis| f16::from_f32(0.0 + found[axis].clamp(-limit[axis], limit[axis])));
            }
        });
    }
}

impl Direction {
    /// The flow from each pixel of `from` to where it is in `to`, coarse to fine.
    fn follow(&mut self, from: &Pyramid, to: &Pyramid) -> Result<()> {
        for level in (0..from.levels().len()).rev() {
            let (from_plane, to_plane) = (&from.levels()[level], &to.levels()[level]);
            std::mem::swap(&mut self.coarse, &mut self.fine);
            let coarse = (level + 1 < from.levels().len()).then_some(&self.coarse);
            self.fine.search(from_plane, to_plane, coarse)?;
            self.fine.smooth()?;
        }
        self.dense.spread(&from.levels()[0], &to.levels()[0], &self.fine)
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
