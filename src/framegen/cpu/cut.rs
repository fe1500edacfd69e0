//! Telling a cut from motion.
//!
//! Both anchors are reduced to small luma pictures, and those to their detail, as slopes look alike everywhere. Every
//! block of the current one is looked for in the previous one: where it stands, where its motion vector points, and
//! where the whole picture seems to have gone, each with a small search around. Blocks are compared by correlation,
//! which brightness and contrast do not change, so that flashes and fades are no cuts. If most blocks are nowhere to be
//! found, it is a cut; if fewer are, the distribution of brightness must have changed as well.

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
const TINY_FACTOR: usize = 4;
/// Detail is what remains when the mean over this many small pixels each way is taken out.
const DETAIL_REACH: usize = 4;
/// Side of a block, in small pixels.
const BLOCK: usize = 16;
/// Search around each candidate, in small pixels each way.
const SEARCH: isize = 3;
/// A block is found where its detail correlates this well.
const CORRELATION: f32 = 0.7;
/// Standard deviation of the detail, in levels, from which a block is evidence: what is flat in both anchors neither
/// proves nor disproves anything, and cannot smear either.
const EVIDENT: f32 = 1.5;
/// Share of blocks that must be evidence.
const ENOUGH: f32 = 0.125;
/// Unexplained shares that make a cut: alone, and together with this distance of the histograms, 0 to 1.
const CUT_ALONE: f32 = 0.85;
const CUT_WITH_HISTOGRAM: f32 = 0.6;
const HISTOGRAM_DISTANCE: f32 = 0.3;

impl CutDetector {
    /// The share of blocks of `current` with something to see that `previous` does not have.
    pub(super) fn unexplained(&mut self, previous: &Picture, current: &Picture, motion: &MotionField) -> Result<f32> {
        let side = current.width().max(current.height()) as usize;
        let factor = side.div_ceil(SMALL_SIDE);
        self.previous.reduce_picture(previous, factor)?;
        self.current.reduce_picture(current, factor)?;
        self.tiny[0].reduce(&self.previous, TINY_FACTOR)?;
        self.tiny[1].reduce(&self.current, TINY_FACTOR)?;
        for small in [&mut self.previous, &mut self.current] {
            small.find_detail()?;
        }
        let whole = whole_motion(&self.tiny[0], &self.tiny[1]).map(|v| v * TINY_FACTOR as isize);

        let (previous, current) = (&self.previous, &self.current);
        let (across, down) = (current.width.div_ceil(BLOCK), current.height.div_ceil(BLOCK));
        let (evident, lost) = (0..across * down)
            .into_par_iter()
            .map(|block| {
                let (x, y) = (block % across * BLOCK, block / across * BLOCK);
                let block = Block::new(current, x, y);
                if !block.is_evident(previous) {
                    return (0, 0);
                }
                let given = motion_at(motion, x + BLOCK / 2, y + BLOCK / 2, factor);
                (1, usize::from(!block.is_found_in(previous, [[0, 0], given, whole])))
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        let is_enough = evident as f32 > ENOUGH * (across * down) as f32;
        self.unexplained = if is_enough { lost as f32 / evident as f32 } else { 0.0 };
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
    let vector = motion.at(column as u32, row as u32);
    if vector.iter().all(|v| v.is_finite()) {
        vector.map(|v| (v.to_f32() / factor as f32).round() as isize)
    } else {
        [0, 0]
    }
}

/// The shift from `current` to `previous` that correlates best, over half the picture's width or more and three
/// quarters of its height: cameras turn faster than they tilt.
fn whole_motion(previous: &Small, current: &Small) -> [isize; 2] {
    let (reach_x, reach_y) = ((current.width / 2) as isize, (current.height / 4) as isize);
    let mut best = ([0, 0], correlation(previous, current, 0, 0));
    for dy in -reach_y..=reach_y {
        for dx in -reach_x..=reach_x {
            let correlation = correlation(previous, current, dx, dy);
            if correlation > best.1 {
                best = ([dx, dy], correlation);
            }
        }
    }
    best.0
}

/// How well the part that both share correlates, -1 to 1; 0 where one of them is without contrast.
fn correlation(previous: &Small, current: &Small, dx: isize, dy: isize) -> f32 {
    let overlap = |shift: isize, len: usize| {
        let len = len as isize;
        (0.max(-shift) as usize)..(len.min(len - shift) as usize)
    };
    let (columns, rows) = (overlap(dx, current.width), overlap(dy, current.height));
    let mut sums = Moments::default();
    for y in rows {
        let there = (y as isize + dy) as usize * previous.width + (columns.start as isize + dx) as usize;
        let here = y * current.width + columns.start;
        let (a, b) = (&current.luma[here..][..columns.len()], &previous.luma[there..][..columns.len()]);
        sums.add(a.iter().map(|&v| i32::from(v)), b.iter().map(|&v| i32::from(v)));
    }
    sums.correlation()
}

/// Sums over pairs of values.
#[derive(Default)]
struct Moments {
    count: i64,
    a: i64,
    b: i64,
    aa: i64,
    bb: i64,
    ab: i64,
}

impl Moments {
    /// Adds a row, short enough that its own sums fit 32 bits.
    fn add(&mut self, a: impl ExactSizeIterator<Item = i32>, b: impl Iterator<Item = i32>) {
        self.count += a.len() as i64;
        let (mut sum_a, mut sum_b, mut aa, mut bb, mut ab) = (0, 0, 0, 0, 0);
        for (a, b) in a.zip(b) {
            sum_a += a;
            sum_b += b;
            aa += a * a;
            bb += b * b;
            ab += a * b;
        }
        self.a += i64::from(sum_a);
        self.b += i64::from(sum_b);
        self.aa += i64::from(aa);
        self.bb += i64::from(bb);
        self.ab += i64::from(ab);
    }

    /// Standard deviations of the two.
    fn deviations(&self) -> [f32; 2] {
        [(self.aa, self.a), (self.bb, self.b)].map(|(squares, sum)| {
            let variance = self.count * squares - sum * sum;
            (variance as f64).sqrt() as f32 / self.count as f32
        })
    }

    /// From -1 to 1; 0 where one of the two does not vary.
    fn correlation(&self) -> f32 {
        let [a, b] = self.deviations();
        let covariance = (self.count * self.ab - self.a * self.b) as f64 / (self.count * self.count) as f64;
        if a > 0.0 && b > 0.0 { covariance as f32 / (a * b) } else { 0.0 }
    }
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

/// A block of the current picture.
struct Block<'a> {
    small: &'a Small,
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl<'a> Block<'a> {
    /// The block at (x, y), cut off at the far edges.
    fn new(small: &'a Small, x: usize, y: usize) -> Self {
        Self { small, x, y, width: BLOCK.min(small.width - x), height: BLOCK.min(small.height - y) }
    }

    /// Whether `previous` has this block within the search of one of the shifts.
    fn is_found_in(&self, previous: &Small, shifts: [[isize; 2]; 3]) -> bool {
        let around = |[dx, dy]: [isize; 2]| {
            (-SEARCH..=SEARCH).flat_map(move |sy| (-SEARCH..=SEARCH).map(move |sx| [dx + sx, dy + sy]))
        };
        // The shifts themselves first, which mostly settle it.
        shifts.into_iter().chain(shifts.into_iter().flat_map(around)).any(|shift| self.is_at(previous, shift))
    }

    /// Whether there is detail here, in this picture or in `previous`.
    fn is_evident(&self, previous: &Small) -> bool {
        let [here, there] = self.compare(previous, self.x, self.y).deviations();
        here.max(there) >= EVIDENT
    }

    fn is_at(&self, previous: &Small, [dx, dy]: [isize; 2]) -> bool {
        let (x, y) = (self.x as isize + dx, self.y as isize + dy);
        let fits = |at: isize, len: usize, of: usize| at >= 0 && at as usize + len <= of;
        fits(x, self.width, previous.width)
            && fits(y, self.height, previous.height)
            && self.compare(previous, x as usize, y as usize).correlation() >= CORRELATION
    }

    /// This block's detail against that of `previous` at (x, y).
    fn compare(&self, previous: &Small, x: usize, y: usize) -> Moments {
        let mut moments = Moments::default();
        for row in 0..self.height {
            let here = &self.small.detail[(self.y + row) * self.small.width + self.x..][..self.width];
            let there = &previous.detail[(y + row) * previous.width + x..][..self.width];
            moments.add(here.iter().map(|&v| i32::from(v)), there.iter().map(|&v| i32::from(v)));
        }
        moments
    }
}

/// A small luma picture, and its detail where that was asked for.
#[derive(Debug, Default)]
struct Small {
    width: usize,
    height: usize,
    luma: Vec<u8>,
    detail: Vec<i16>,
}

impl Small {
    /// The mean luma of each `factor` x `factor` square of `picture`; squares at the far edges may be smaller.
    fn reduce_picture(&mut self, picture: &Picture, factor: usize) -> Result<()> {
        let pixels = picture.pixels();
        let width = picture.width() as usize;
        self.average(width, picture.height() as usize, factor, |x, y| luma(pixels[y * width + x]))
    }

    /// `detail` = `luma` less the mean around each pixel.
    fn find_detail(&mut self) -> Result<()> {
        sized(&mut self.detail, self.luma.len(), 0)?;
        let (width, height, luma) = (self.width, self.height, &self.luma);
        self.detail.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let rows = y.saturating_sub(DETAIL_REACH)..(y + DETAIL_REACH + 1).min(height);
            for (x, detail) in row.iter_mut().enumerate() {
                let columns = x.saturating_sub(DETAIL_REACH)..(x + DETAIL_REACH + 1).min(width);
                let around = rows.clone().flat_map(|y| &luma[y * width..][columns.clone()]);
                let mean = around.map(|&v| i32::from(v)).sum::<i32>() / (rows.len() * columns.len()) as i32;
                *detail = (i32::from(luma[y * width + x]) - mean) as i16;
            }
        });
        Ok(())
    }

    /// The mean of each `factor` x `factor` square of `larger`.
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
