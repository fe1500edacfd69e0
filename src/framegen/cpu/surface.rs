//! What is known of each pixel of the current anchor: where it was before, and how far in front it is.

use half::f16;
use rayon::prelude::*;

use super::bars::Inside;
use super::kernels::{Level, Source};
use super::sample::{luma, split};
use super::sized;
use crate::guidance::{DepthMap, Guidance, MotionField};
use crate::{Picture, Result};

/// A vector and a rank for each pixel of the current anchor.
#[derive(Debug, Default)]
pub(super) struct Surfaces {
    vectors: Vec<[f32; 2]>,
    ranks: Vec<u32>,
    previous_luma: Vec<u8>,
    current_luma: Vec<u8>,
}

/// A pixel lies on an overlay where standing still explains it to within `STILL` levels, and better than its vector
/// does by the factor `BETTER` after a `MARGIN` for noise. Where the vector comes from beyond the edge and there is
/// nothing to compare with, all of the patch must stand still, with a `CONTRAST` that a moving surface would not repeat
/// by chance.
const STILL: f32 = 4.0;
const BETTER: f32 = 2.0;
const MARGIN: f32 = 2.0;
const CONTRAST: f32 = 12.0;

impl Surfaces {
    /// Current to previous, in pixels; finite, at most the picture's size.
    pub(super) fn vector(&self, pixel: usize) -> [f32; 2] {
        self.vectors[pixel]
    }

    /// Device depth in the upper 24 bits, how badly the previous anchor matches in the lower 8: the smaller is in
    /// front.
    pub(super) fn rank(&self, pixel: usize) -> u32 {
        self.ranks[pixel]
    }

    /// Device depth in 24 bits.
    pub(super) fn depth(&self, pixel: usize) -> u32 {
        self.ranks[pixel] >> 8
    }

    /// Whether two pixels move so much alike that they can lie on one surface.
    pub(super) fn move_alike(&self, a: usize, b: usize) -> bool {
        let ([ax, ay], [bx, by]) = (self.vectors[a], self.vectors[b]);
        (ax - bx).abs() <= 1.0 && (ay - by).abs() <= 1.0
    }

    /// For interpolation: vectors are checked against both anchors.
    ///
    /// A pixel on a letterbox bar, or whose vector does not match while standing still does, lies on an overlay (a HUD,
    /// a watermark), which motion of the world behind it does not know. It gets no motion and comes to the front.
    pub(super) fn prepare_pair(&mut self, previous: &Picture, current: &Picture, guidance: &Guidance) -> Result<()> {
        self.prepare_anchor(guidance)?;
        let (width, height) = (current.width() as usize, current.height() as usize);
        for (plane, picture) in [(&mut self.previous_luma, previous), (&mut self.current_luma, current)] {
            sized(plane, width * height, 0)?;
            plane.par_iter_mut().zip(picture.pixels()).for_each(|(value, &pixel)| *value = luma(pixel));
        }
        let [before, after] = [previous, current].map(|picture| Source { pixels: picture.pixels(), width, height });
        let inside = Inside::find(Level::detect(), before, after);
        let previous = Plane { luma: &self.previous_luma, width, height };
        let current = Plane { luma: &self.current_luma, width, height };

        let vector_rows = self.vectors.par_chunks_mut(width);
        let rank_rows = self.ranks.par_chunks_mut(width);
        vector_rows.zip(rank_rows).enumerate().for_each(|(y, (vectors, ranks))| {
            for (x, (vector, rank)) in vectors.iter_mut().zip(ranks).enumerate() {
                if !inside.contains(x, y) {
                    *vector = [0.0; 2];
                    *rank = 0;
                    continue;
                }
                let patch = current.patch(x as isize - 1, y as isize - 1);
                let moved = previous.difference(&patch, x, y, *vector);
                if *vector != [0.0; 2] {
                    let comes_from_here = previous.contains(x as f32 + vector[0], y as f32 + vector[1]);
                    // Standing still cannot be better by enough where the vector is as good as this.
                    let is_overlay = if comes_from_here {
                        moved.square >= MARGIN * BETTER && {
                            let still = previous.difference(&patch, x, y, [0.0; 2]);
                            still.square <= STILL && (still.square + MARGIN) * BETTER <= moved.square
                        }
                    } else {
                        contrast(&patch) >= CONTRAST && previous.difference(&patch, x, y, [0.0; 2]).patch <= STILL
                    };
                    if is_overlay {
                        *vector = [0.0; 2];
                        *rank = 0;
                        continue;
                    }
                }
                *rank |= ((moved.square + 0.5) as u32).min(255);
            }
        });
        Ok(())
    }

    /// For extrapolation: vectors and depth as they are given.
    pub(super) fn prepare_anchor(&mut self, guidance: &Guidance) -> Result<()> {
        let (motion, depth): (&MotionField, &DepthMap) = (guidance.motion(), guidance.depth());
        let limit = [motion.width() as f32, motion.height() as f32];
        let (width, height) = (motion.width() as usize, motion.height() as usize);
        sized(&mut self.vectors, width * height, [0.0; 2])?;
        sized(&mut self.ranks, width * height, 0)?;
        let (columns, tile) = (motion.columns() as usize, motion.tile() as usize);
        self.vectors.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let given = &motion.vectors()[y / tile * columns..][..columns];
            row.iter_mut().enumerate().for_each(|(x, vector)| *vector = bounded(given[x / tile], limit));
        });
        let (columns, tile) = (depth.columns() as usize, depth.tile() as usize);
        self.ranks.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let given = &depth.depth()[y / tile * columns..][..columns];
            for (x, rank) in row.iter_mut().enumerate() {
                let depth = given[x / tile];
                let depth = if depth.is_nan() { 1.0 } else { depth.clamp(0.0, 1.0) };
                *rank = ((f64::from(depth) * 16_777_215.0) as u32) << 8;
            }
        });
        Ok(())
    }
}

/// A vector as finite numbers of at most `limit`; what is not finite is no motion.
fn bounded(vector: [f16; 2], limit: [f32; 2]) -> [f32; 2] {
    if !(vector[0].is_finite() && vector[1].is_finite()) {
        return [0.0; 2];
    }
    [vector[0].to_f32().clamp(-limit[0], limit[0]), vector[1].to_f32().clamp(-limit[1], limit[1])]
}

/// Mean absolute differences, in levels.
struct Difference {
    /// Over the best of the four squares of 2 x 2 that hold the centre: a pixel on the rim of a surface is judged by
    /// that surface alone.
    square: f32,
    /// Over the whole patch.
    patch: f32,
}

/// Mean absolute difference from the mean.
fn contrast(patch: &[[f32; 3]; 3]) -> f32 {
    let mean = patch.as_flattened().iter().sum::<f32>() / 9.0;
    patch.as_flattened().iter().map(|v| (v - mean).abs()).sum::<f32>() / 9.0
}

/// A luma plane whose edge pixels go on beyond the edges.
#[derive(Clone, Copy)]
struct Plane<'a> {
    luma: &'a [u8],
    width: usize,
    height: usize,
}

impl Plane<'_> {
    /// Whether a position lies between the plane's pixels.
    fn contains(&self, x: f32, y: f32) -> bool {
        x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f32 && y <= (self.height - 1) as f32
    }

    /// The `N` x `N` values from (x, y) on.
    fn patch<const N: usize>(&self, x: isize, y: isize) -> [[f32; N]; N] {
        let on_axis = |at: isize, len: usize| at.clamp(0, len as isize - 1) as usize;
        std::array::from_fn(|j| {
            let row = &self.luma[on_axis(y + j as isize, self.height) * self.width..][..self.width];
            match row.get(x.max(0) as usize..).and_then(|rest| rest.first_chunk::<N>()) {
                Some(values) if x >= 0 => values.map(f32::from),
                _ => std::array::from_fn(|i| f32::from(row[on_axis(x + i as isize, self.width)])),
            }
        })
    }

    /// How far `patch`, centred on (x, y) in the other plane, is from the place here that `vector` leads to from there,
    /// read bilinearly.
    fn difference(&self, patch: &[[f32; 3]; 3], x: usize, y: usize, vector: [f32; 2]) -> Difference {
        let (column, fx) = split(x as f32 + vector[0] - 1.0);
        let (row, fy) = split(y as f32 + vector[1] - 1.0);
        let here: [[f32; 4]; 4] = self.patch(column as isize, row as isize);
        let apart: [[f32; 3]; 3] = std::array::from_fn(|j| {
            std::array::from_fn(|i| {
                let across = |line: &[f32; 4]| line[i] + (line[i + 1] - line[i]) * fx;
                let (above, below) = (across(&here[j]), across(&here[j + 1]));
                (above + (below - above) * fy - patch[j][i]).abs()
            })
        });
        // A square that reaches over the edge counts pixels twice, and is left out where there is another.
        let starts =
            |at: usize, len: usize| usize::from(at == 0 && len > 1)..if at + 1 == len && len > 1 { 1 } else { 2 };
        let square = |j: usize, i: usize| apart[j][i] + apart[j][i + 1] + apart[j + 1][i] + apart[j + 1][i + 1];
        let rows = starts(y, self.height);
        let squares = rows.flat_map(|j| starts(x, self.width).map(move |i| square(j, i)));
        Difference {
            square: squares.fold(f32::INFINITY, f32::min) / 4.0,
            patch: apart.as_flattened().iter().sum::<f32>() / 9.0,
        }
    }
}
