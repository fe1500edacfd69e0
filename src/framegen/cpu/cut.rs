//! Telling a cut from motion.
//!
//! Both anchors are reduced to small luma pictures. Every block of the current one is looked for in the previous one: where it
//! stands, where its motion vector points, and where the whole picture seems to have gone, each with a small search around.
//! Brightness is taken out of the comparison, so that a flash is no cut. If most blocks are nowhere to be found, it is one;
//! if fewer are, the distribution of brightness must have changed as well.

use rayon::prelude::*;

use super::sample::luma;
use super::sized;
use crate::guidance::MotionField;
use crate::{Picture, Result};

/// Finds cuts; keeps its small pictures from call to call.
#[derive(Debug, Default)]
pub(super) struct CutDetector {
    previous: Small,
    current: Small,
    tiny: [Small; 2],
    unexplained: f32,
    histogram_distance: f32,
}

/// The longer side of the small pictures is at most this.
const SMALL_SIDE: usize = 320;
/// Small pixels per pixel of the tiny pictures in which the motion of the whole is sought.
const TINY_FACTOR: usize = 8;
/// Side of a block, in small pixels.
const BLOCK: usize = 8;
/// Search around each candidate, in small pixels each way.
const SEARCH: isize = 3;
/// A block is found where it differs by less than this many levels per pixel, or this share of its own contrast.
const NOISE: f32 = 4.0;
const SHARE_OF_CONTRAST: f32 = 0.5;
/// A block without contrast is found where its level is as near as this.
const FLAT_LEVEL: f32 = 16.0;
/// Unexplained shares that make a cut: alone, and together with this distance of the histograms, 0 to 1.
const CUT_ALONE: f32 = 0.75;
const CUT_WITH_HISTOGRAM: f32 = 0.5;
const HISTOGRAM_DISTANCE: f32 = 0.3;

impl CutDetector {
    /// The share of blocks of `current` that `previous` does not have.
    pub(super) fn unexplained(&mut self, previous: &Picture, current: &Picture, motion: &MotionField) -> Result<f32> {
        let side = current.width().max(current.height()) as usize;
        let factor = side.div_ceil(SMALL_SIDE);
        self.previous.reduce_picture(previous, factor)?;
        self.current.reduce_picture(current, factor)?;
        self.tiny[0].reduce(&self.previous, TINY_FACTOR)?;
        self.tiny[1].reduce(&self.current, TINY_FACTOR)?;
        let whole = whole_motion(&self.tiny[0], &self.tiny[1]).map(|v| v * TINY_FACTOR as isize);

        let (previous, current) = (&self.previous, &self.current);
        let (across, down) = (current.width.div_ceil(BLOCK), current.height.div_ceil(BLOCK));
        let lost: usize = (0..across * down)
            .into_par_iter()
            .filter(|block| {
                let (x, y) = (block % across * BLOCK, block / across * BLOCK);
                let given = motion_at(motion, x + BLOCK / 2, y + BLOCK / 2, factor);
                !Block::new(current, x, y).is_found_in(previous, [[0, 0], given, whole])
            })
            .count();
        self.unexplained = lost as f32 / (across * down) as f32;
        self.histogram_distance = histogram_distance(previous, current);
        Ok(self.unexplained)
    }

    /// Whether the pair last looked at is a cut.
    pub(super) fn is_cut(&self) -> bool {
        self.unexplained >= CUT_ALONE
            || self.unexplained >= CUT_WITH_HISTOGRAM && self.histogram_distance >= HISTOGRAM_DISTANCE
    }
}

/// The motion vector at a small pixel, in small pixels; what is not finite is no motion.
fn motion_at(motion: &MotionField, x: usize, y: usize, factor: usize) -> [isize; 2] {
    let column = (x * factor).min(motion.width() as usize - 1);
    let row = (y * factor).min(motion.height() as usize - 1);
    let vector = motion.vectors()[row * motion.width() as usize + column];
    if vector.iter().all(|v| v.is_finite()) {
        vector.map(|v| (v.to_f32() / factor as f32).round() as isize)
    } else {
        [0, 0]
    }
}

/// The shift from `current` to `previous` that fits best over half the picture or more, with levels made comparable.
fn whole_motion(previous: &Small, current: &Small) -> [isize; 2] {
    let reach = |len: usize| (len / 2) as isize;
    let (reach_x, reach_y) = (reach(current.width), reach(current.height));
    let mut best = ([0, 0], f32::INFINITY);
    for dy in -reach_y..=reach_y {
        for dx in -reach_x..=reach_x {
            let difference = shifted_difference(previous, current, dx, dy);
            // The shorter shift wins a tie.
            let length = |[x, y]: [isize; 2]| x.abs() + y.abs();
            if difference < best.1 || difference == best.1 && length([dx, dy]) < length(best.0) {
                best = ([dx, dy], difference);
            }
        }
    }
    best.0
}

/// Mean absolute difference over the part both share, their mean levels taken out.
fn shifted_difference(previous: &Small, current: &Small, dx: isize, dy: isize) -> f32 {
    let overlap = |shift: isize, len: usize| {
        let len = len as isize;
        (0.max(-shift) as usize)..(len.min(len - shift) as usize)
    };
    let (columns, rows) = (overlap(dx, current.width), overlap(dy, current.height));
    let pairs = || {
        let columns = columns.clone();
        rows.clone().flat_map(move |y| {
            columns.clone().map(move |x| {
                let there = (y as isize + dy) as usize * previous.width + (x as isize + dx) as usize;
                f32::from(current.luma[y * current.width + x]) - f32::from(previous.luma[there])
            })
        })
    };
    let count = (columns.len() * rows.len()) as f32;
    let mean = pairs().sum::<f32>() / count;
    pairs().map(|d| (d - mean).abs()).sum::<f32>() / count
}

/// Half the sum of differences between the two distributions of levels: 0 alike, 1 disjoint.
fn histogram_distance(previous: &Small, current: &Small) -> f32 {
    let histogram = |small: &Small| {
        let mut bins = [0_u32; 32];
        small.luma.iter().for_each(|&v| bins[usize::from(v) / 8] += 1);
        bins
    };
    let (a, b) = (histogram(previous), histogram(current));
    let apart: u32 = a.iter().zip(b).map(|(&a, b)| a.abs_diff(b)).sum();
    apart as f32 / (2 * current.luma.len()) as f32
}

/// A block of the current picture, its mean taken out.
struct Block<'a> {
    small: &'a Small,
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    mean: f32,
    contrast: f32,
}

impl<'a> Block<'a> {
    fn new(small: &'a Small, x: usize, y: usize) -> Self {
        let (width, height) = (BLOCK.min(small.width - x), BLOCK.min(small.height - y));
        let mut block = Self { small, x, y, width, height, mean: 0.0, contrast: 0.0 };
        let count = (width * height) as f32;
        block.mean = block.rows().flatten().map(|&v| f32::from(v)).sum::<f32>() / count;
        block.contrast = block.rows().flatten().map(|&v| (f32::from(v) - block.mean).abs()).sum::<f32>() / count;
        block
    }

    fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let (small, x, width) = (self.small, self.x, self.width);
        (self.y..self.y + self.height).map(move |y| &small.luma[y * small.width + x..][..width])
    }

    /// Whether `previous` has this block within the search of one of the shifts.
    fn is_found_in(&self, previous: &'a Small, shifts: [[isize; 2]; 3]) -> bool {
        let around = |[dx, dy]: [isize; 2]| {
            (-SEARCH..=SEARCH).flat_map(move |sy| (-SEARCH..=SEARCH).map(move |sx| [dx + sx, dy + sy]))
        };
        // The shifts themselves first, which mostly settle it.
        shifts.into_iter().chain(shifts.into_iter().flat_map(around)).any(|shift| self.is_at(previous, shift))
    }

    fn is_at(&self, previous: &'a Small, [dx, dy]: [isize; 2]) -> bool {
        let (x, y) = (self.x as isize + dx, self.y as isize + dy);
        let fits = |at: isize, len: usize, of: usize| at >= 0 && at as usize + len <= of;
        if !fits(x, self.width, previous.width) || !fits(y, self.height, previous.height) {
            return false;
        }
        let there = Self { small: previous, x: x as usize, y: y as usize, mean: 0.0, contrast: 0.0, ..*self };
        let pairs = || self.rows().flatten().zip(there.rows().flatten()).map(|(&a, &b)| f32::from(a) - f32::from(b));
        let count = (self.width * self.height) as f32;
        let level = pairs().sum::<f32>() / count;
        if self.contrast < NOISE && level.abs() > FLAT_LEVEL {
            return false;
        }
        let difference = pairs().map(|d| (d - level).abs()).sum::<f32>() / count;
        difference <= NOISE.max(SHARE_OF_CONTRAST * self.contrast)
    }
}

/// A small luma picture.
#[derive(Debug, Default)]
struct Small {
    width: usize,
    height: usize,
    luma: Vec<u8>,
}

impl Small {
    /// The mean luma of each `factor` x `factor` square of `picture`; squares at the far edges may be smaller.
    fn reduce_picture(&mut self, picture: &Picture, factor: usize) -> Result<()> {
        let pixels = picture.pixels();
        let width = picture.width() as usize;
        self.average(width, picture.height() as usize, factor, |x, y| luma(pixels[y * width + x]))
    }

    fn reduce(&mut self, larger: &Self, factor: usize) -> Result<()> {
        self.average(larger.width, larger.height, factor, |x, y| larger.luma[y * larger.width + x])
    }

    fn average(
        &mut self,
        width: usize,
        height: usize,
        factor: usize,
        value: impl Fn(usize, usize) -> u8 + Sync,
    ) -> Result<()> {
        (self.width, self.height) = (width.div_ceil(factor), height.div_ceil(factor));
        sized(&mut self.luma, self.width * self.height, 0)?;
        self.luma.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            let rows = y * factor..((y + 1) * factor).min(height);
            for (x, mean) in row.iter_mut().enumerate() {
                let columns = x * factor..((x + 1) * factor).min(width);
                let count = rows.len() * columns.len();
                let sum: usize = rows
                    .clone()
                    .flat_map(|y| columns.clone().map(move |x| (x, y)))
                    .map(|(x, y)| usize::from(value(x, y)))
                    .sum();
                *mean = ((sum + count / 2) / count) as u8;
            }
        });
        Ok(())
    }
}
