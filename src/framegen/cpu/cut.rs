//! Cut detection.
//!
//! Both anchors are reduced to small luma pictures, and these to their detail, because smooth gradients look alike
//! everywhere. Every block of the current anchor is searched in the previous one: at the same position, along its
//! motion vector and, if most blocks are not found there, along the global motion, each with a small search window.
//! Blocks are compared by correlation, which is invariant to brightness and contrast, so that flashes and fades are no
//! cuts. If most blocks are not found, there is a cut; if fewer are not found, the luma histograms must differ as well.

use bytemuck::must_cast;

use super::kernels::{Sampled, SimdLevel, at_every_level, prefetch};
use super::resize;
use crate::guidance::MotionField;
use crate::locks::Mutex;
use crate::tasks::{self, Parallel, ParallelSliceMut};
use crate::{Raster, Result};

/// Detects cuts; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct CutDetector {
    previous: ReducedPicture,
    current: ReducedPicture,
    tiny: [ReducedPicture; 2],
    blocks: Vec<BlockMatch>,
    unexplained: f32,
    histogram_distance: f32,
}

/// Largest side of the reduced pictures, in pixels.
pub(in crate::framegen) const REDUCED_SIDE: usize = 320;
/// Rows that are read per row of a reduced picture, evenly spaced; more would hardly change the result.
const ROWS_READ: usize = 2;
/// Pixels of a row that are averaged at a time.
const RUN: usize = 256;
/// Reduction factor from the reduced to the tiny pictures in which the global motion is searched.
pub(in crate::framegen) const TINY_FACTOR: usize = 4;
/// Radius of the local mean that is subtracted to get the detail, in reduced pixels.
const DETAIL_REACH: usize = 4;
/// Side of a block, in reduced pixels.
pub(in crate::framegen) const BLOCK: usize = 16;
/// Radius of the search window, in reduced pixels.
const SEARCH: isize = 3;
/// Smallest correlation of the detail of matching blocks.
const MIN_CORRELATION: f32 = 0.7;
/// Smallest standard deviation of the detail, in levels, of blocks that count: in a block that is flat in both anchors
/// there is nothing to compare.
const MIN_DETAIL: f32 = 1.5;
/// Smallest share of blocks that must count.
const MIN_SHARE: f32 = 0.125;
/// Share of blocks without a match that makes a cut: alone, or together with a histogram distance (0 to 1).
const CUT_ALONE: f32 = 0.85;
const CUT_WITH_HISTOGRAM: f32 = 0.6;
const HISTOGRAM_DISTANCE: f32 = 0.3;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "CUT_": uint TINY_FACTOR, int DETAIL_REACH, uint BLOCK, int SEARCH, float MIN_CORRELATION, float MIN_DETAIL,
    float MIN_SHARE, float CUT_ALONE, float CUT_WITH_HISTOGRAM, float HISTOGRAM_DISTANCE
);

/// Result of searching a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BlockMatch {
    /// Too little detail to decide.
    Flat,
    /// A match in the previous anchor.
    Found,
    /// No match.
    NotFound,
}

impl CutDetector {
    /// Share of the blocks of `current` with detail that have no match in `previous`.
    pub(super) fn unexplained<P: Sampled>(
        &mut self,
        level: SimdLevel,
        previous: &Raster<P>,
        current: &Raster<P>,
        motion: &MotionField,
    ) -> Result<f32> {
        let side = current.width().max(current.height()) as usize;
        let factor = side.div_ceil(REDUCED_SIDE);
        let (reduced_previous, reduced_current) = (&mut self.previous, &mut self.current);
        let (a, b) = tasks::join_loops(
            || reduced_previous.reduce_picture(level, previous, factor),
            || reduced_current.reduce_picture(level, current, factor),
        );
        a.and(b)?;
        let (previous, current) = (&self.previous, &self.current);

        let (across, down) = (current.width.div_ceil(BLOCK), current.height.div_ceil(BLOCK));
        resize(&mut self.blocks, across * down, BlockMatch::Flat)?;
        let block_at = |i: usize| Block::new(level, current, i % across * BLOCK, i / across * BLOCK);
        self.blocks.par_iter_mut().with_min_len(16).enumerate().for_each(|(i, block_match)| {
            let block = block_at(i);
            let motion_vector = motion_at(motion, block.x + BLOCK / 2, block.y + BLOCK / 2, factor);
            // The unshifted comparison serves both tests.
            let unshifted = block.compare(previous, block.x, block.y);
            *block_match = if !block.has_detail(&unshifted) {
                BlockMatch::Flat
            } else if block.is_similar(&unshifted) || block.is_found_in(previous, &[[0, 0], motion_vector]) {
                BlockMatch::Found
            } else {
                BlockMatch::NotFound
            };
        });
        self.unexplained = share_not_found(&self.blocks);
        self.histogram_distance = histogram_distance(previous, current);

        // The global motion is searched only if it can change the result. Its memory is allocated in any case.
        for (tiny, reduced) in self.tiny.iter_mut().zip([&self.previous, &self.current]) {
            tiny.reserve(reduced, TINY_FACTOR)?;
        }
        if self.is_cut() {
            self.tiny[0].reduce(&self.previous, TINY_FACTOR);
            self.tiny[1].reduce(&self.current, TINY_FACTOR);
            let global = global_motion(&self.tiny[0], &self.tiny[1]).map(|v| v * TINY_FACTOR as isize);
            self.blocks.par_iter_mut().with_min_len(16).enumerate().for_each(|(i, block_match)| {
                if *block_match == BlockMatch::NotFound && block_at(i).is_found_in(previous, &[global]) {
                    *block_match = BlockMatch::Found;
                }
            });
            self.unexplained = share_not_found(&self.blocks);
        }
        Ok(self.unexplained)
    }

    /// Whether there is a cut in the last pair.
    pub(super) fn is_cut(&self) -> bool {
        self.unexplained >= CUT_ALONE
            || self.unexplained >= CUT_WITH_HISTOGRAM && self.histogram_distance >= HISTOGRAM_DISTANCE
    }
}

/// Share of blocks without a match among those with detail; 0 if too few have detail.
fn share_not_found(blocks: &[BlockMatch]) -> f32 {
    let count = |block_match| blocks.iter().filter(|&&block| block == block_match).count();
    let (found, not_found) = (count(BlockMatch::Found), count(BlockMatch::NotFound));
    let is_significant = (found + not_found) as f32 > MIN_SHARE * blocks.len() as f32;
    if is_significant { not_found as f32 / (found + not_found) as f32 } else { 0.0 }
}

/// Motion vector at a reduced pixel, in reduced pixels; 0 if it is not finite.
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

/// The shift from `current` to `previous` with the largest correlation, up to half the width and a quarter of the
/// height: cameras pan faster than they tilt. For equal correlations no shift wins, then the first in row order.
fn global_motion(previous: &ReducedPicture, current: &ReducedPicture) -> [isize; 2] {
    let (reach_x, reach_y) = ((current.width / 2) as isize, (current.height / 4) as isize);
    let better = |a: ([isize; 2], f32), b: ([isize; 2], f32)| if b.1 > a.1 { b } else { a };
    let unshifted = ([0, 0], correlation(previous, current, 0, 0));
    let best = Mutex::new(unshifted);
    tasks::for_each_index(2 * reach_y as usize + 1, |row| {
        let dy = row as isize - reach_y;
        let shifts = (-reach_x..=reach_x).map(|dx| ([dx, dy], correlation(previous, current, dx, dy)));
        let of_row = shifts.fold(unshifted, better);
        let mut best = best.lock();
        // Rows are processed in any order.
        let is_first = of_row.1 == best.1 && best.1 > unshifted.1 && of_row.0[1] < best.0[1];
        if of_row.1 > best.1 || is_first {
            *best = of_row;
        }
    });
    best.into_inner().0
}

/// Correlation of the overlapping part, -1 to 1; 0 if one of the pictures is uniform there.
fn correlation(previous: &ReducedPicture, current: &ReducedPicture, dx: isize, dy: isize) -> f32 {
    let overlap = |shift: isize, len: usize| {
        let len = len as isize;
        (0.max(-shift) as usize)..(len.min(len - shift) as usize)
    };
    let (columns, rows) = (overlap(dx, current.width), overlap(dy, current.height));
    let (mut here, mut both) = (Sums::default(), Cross::default());
    for y in rows {
        let start = (y as isize + dy) as usize * previous.width + (columns.start as isize + dx) as usize;
        let a = &current.luma[y * current.width + columns.start..][..columns.len()];
        let b = &previous.luma[start..][..columns.len()];
        here.add(a);
        both.add(a, b);
    }
    both.moments(&here).correlation()
}

/// Sums of values and of their squares. Rows are short enough that their sums fit 32 bits.
#[derive(Debug, Default)]
struct Sums {
    count: i64,
    sum: i64,
    squares: i64,
}

impl Sums {
    #[inline(always)]
    fn add<T: Copy + Into<i32>>(&mut self, values: &[T]) {
        let (mut sum, mut squares) = (0_i32, 0_i32);
        for &v in values {
            let v: i32 = v.into();
            sum += v;
            squares += v * v;
        }
        self.count += values.len() as i64;
        self.sum += i64::from(sum);
        self.squares += i64::from(squares);
    }
}

/// Sums of a second series of values, of their squares, and of the products with the first.
#[derive(Default)]
struct Cross {
    sum: i64,
    squares: i64,
    products: i64,
}

impl Cross {
    #[inline(always)]
    fn add<T: Copy + Into<i32>>(&mut self, values: &[T], others: &[T]) {
        let (mut sum, mut squares, mut products) = (0_i32, 0_i32, 0_i32);
        for (&a, &b) in values.iter().zip(others) {
            let (a, b): (i32, i32) = (a.into(), b.into());
            sum += b;
            squares += b * b;
            products += a * b;
        }
        self.sum += i64::from(sum);
        self.squares += i64::from(squares);
        self.products += i64::from(products);
    }

    fn moments<'a>(&'a self, values: &'a Sums) -> Moments<'a> {
        Moments { values, others: self }
    }
}

/// Statistics of two series of values.
struct Moments<'a> {
    values: &'a Sums,
    others: &'a Cross,
}

impl Moments<'_> {
    /// Standard deviations of both series.
    fn deviations(&self) -> [f32; 2] {
        let Self { values: a, others: b } = self;
        [(a.squares, a.sum), (b.squares, b.sum)].map(|(squares, sum)| {
            let variance = a.count * squares - sum * sum;
            (variance as f64).sqrt() as f32 / a.count as f32
        })
    }

    /// Correlation coefficient, -1 to 1; 0 if one of the series is constant.
    fn correlation(&self) -> f32 {
        let Self { values, others } = self;
        let [a, b] = self.deviations();
        let covariance =
            (values.count * others.products - values.sum * others.sum) as f64 / (values.count * values.count) as f64;
        if a > 0.0 && b > 0.0 { covariance as f32 / (a * b) } else { 0.0 }
    }
}

/// Half the sum of absolute differences of the luma histograms: 0 for equal ones, 1 for disjoint ones.
fn histogram_distance(previous: &ReducedPicture, current: &ReducedPicture) -> f32 {
    let histogram = |reduced: &ReducedPicture| {
        let mut bins = [0_u32; 32];
        reduced.luma.iter().for_each(|&v| bins[usize::from(v) / 8] += 1);
        bins
    };
    let (a, b) = tasks::join(|| histogram(previous), || histogram(current));
    let difference: u32 = a.iter().zip(b).map(|(&a, b)| a.abs_diff(b)).sum();
    difference as f32 / (2 * current.luma.len()) as f32
}

/// A block of the current picture.
struct Block<'a> {
    level: SimdLevel,
    reduced: &'a ReducedPicture,
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    sums: Sums,
}

impl<'a> Block<'a> {
    /// The block at (x, y), clipped at the right and bottom borders.
    fn new(level: SimdLevel, reduced: &'a ReducedPicture, x: usize, y: usize) -> Self {
        let (width, height) = (BLOCK.min(reduced.width - x), BLOCK.min(reduced.height - y));
        let mut sums = Sums::default();
        (y..y + height).for_each(|y| sums.add(&reduced.detail[y * reduced.width + x..][..width]));
        Self { level, reduced, x, y, width, height, sums }
    }

    /// Whether `previous` contains this block within the search window of one of the shifts.
    fn is_found_in(&self, previous: &ReducedPicture, shifts: &[[isize; 2]]) -> bool {
        let around = |&[dx, dy]: &[isize; 2]| {
            (-SEARCH..=SEARCH).flat_map(move |sy| (-SEARCH..=SEARCH).map(move |sx| [dx + sx, dy + sy]))
        };
        // The shifts themselves first: usually one of them matches.
        shifts.iter().copied().chain(shifts.iter().flat_map(around)).any(|shift| self.is_at(previous, shift))
    }

    /// Whether this block has detail, in this picture or at the same position in the previous one.
    fn has_detail(&self, unshifted: &Cross) -> bool {
        let [here, there] = unshifted.moments(&self.sums).deviations();
        here.max(there) >= MIN_DETAIL
    }

    fn is_similar(&self, there: &Cross) -> bool {
        there.moments(&self.sums).correlation() >= MIN_CORRELATION
    }

    fn is_at(&self, previous: &ReducedPicture, [dx, dy]: [isize; 2]) -> bool {
        let (x, y) = (self.x as isize + dx, self.y as isize + dy);
        let fits = |at: isize, len: usize, of: usize| at >= 0 && at as usize + len <= of;
        fits(x, self.width, previous.width)
            && fits(y, self.height, previous.height)
            && self.is_similar(&self.compare(previous, x as usize, y as usize))
    }

    /// Sums of the previous detail at (x, y) with this block's.
    fn compare(&self, previous: &ReducedPicture, x: usize, y: usize) -> Cross {
        let here = &self.reduced.detail[self.y * self.reduced.width + self.x..];
        let there = &previous.detail[y * previous.width + x..];
        cross(self.level, here, there, [self.reduced.width, previous.width], [self.width, self.height])
    }
}

at_every_level! {
    /// Sums of a block of `extent` in two pictures with these strides.
    fn cross(here: &[i16], there: &[i16], strides: [usize; 2], extent: [usize; 2]) -> Cross
        = cross_by_rows | cross_in_vectors
}

fn cross_by_rows(here: &[i16], there: &[i16], strides: [usize; 2], [width, height]: [usize; 2]) -> Cross {
    let mut cross = Cross::default();
    for row in 0..height {
        cross.add(&here[row * strides[0]..][..width], &there[row * strides[1]..][..width]);
    }
    cross
}

#[inline(always)]
fn cross_in_vectors(here: &[i16], there: &[i16], strides: [usize; 2], [width, height]: [usize; 2]) -> Cross {
    if width != BLOCK {
        return cross_by_rows(here, there, strides, [width, height]);
    }
    // At most 16 squares of 255 per column: they fit 32 bits.
    let (mut sums, mut squares, mut products) = ([0_i32; BLOCK], [0_i32; BLOCK], [0_i32; BLOCK]);
    for row in 0..height {
        let here: &[i16; BLOCK] = here[row * strides[0]..].first_chunk().expect("a row of sixteen");
        let there: &[i16; BLOCK] = there[row * strides[1]..].first_chunk().expect("a row of sixteen");
        for i in 0..BLOCK {
            let (a, b) = (i32::from(here[i]), i32::from(there[i]));
            sums[i] += b;
            squares[i] += b * b;
            products[i] += a * b;
        }
    }
    let [sum, squares, products] = [sums, squares, products].map(|of_columns| of_columns.iter().sum::<i32>().into());
    Cross { sum, squares, products }
}

/// Sum of channels that were summed over at most [`ROWS_READ`] rows.
#[inline(always)]
fn sum_of(columns: &[[u16; 4]]) -> [u32; 4] {
    // Four 16-bit channels are summed as one 64-bit integer; this many do not overflow.
    const PART: usize = 64;
    const { assert!(PART * ROWS_READ * 255 <= u16::MAX as usize) };
    let mut sum = [0_u32; 4];
    for part in columns.chunks(PART) {
        let part: u64 = part.iter().map(|&channels| must_cast::<[u16; 4], u64>(channels)).sum();
        let part: [u16; 4] = must_cast(part);
        sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += u32::from(part));
    }
    sum
}

/// A reduced luma picture, and its detail if it was computed.
#[derive(Debug, Default)]
struct ReducedPicture {
    width: usize,
    height: usize,
    luma: Vec<u8>,
    detail: Vec<i16>,
}

impl ReducedPicture {
    /// Computes the mean luma of each `factor` x `factor` square of `picture`, from some of its rows, and the detail.
    /// Squares at the right and bottom borders may be smaller.
    fn reduce_picture<P: Sampled>(&mut self, level: SimdLevel, picture: &Raster<P>, factor: usize) -> Result<()> {
        let (pixels, width, height) = (picture.pixels(), picture.width() as usize, picture.height() as usize);
        (self.width, self.height) = (width.div_ceil(factor), height.div_ceil(factor));
        resize(&mut self.luma, self.width * self.height, 0)?;
        let in_run = RUN / factor;
        self.luma.par_chunks_mut(self.width).with_min_len(8).enumerate().for_each(|(y, row)| {
            let rows = (y * factor..((y + 1) * factor).min(height)).step_by(factor.div_ceil(ROWS_READ));
            for (run, means) in row.chunks_mut(in_run).enumerate() {
                let columns = run * in_run * factor..width.min((run + 1) * in_run * factor);
                let mut sums = [[0; 4]; RUN];
                // Prefetches the next run; hardware prefetchers do not follow two alternating rows.
                let next = columns.end..width.min(columns.end + in_run * factor);
                rows.clone().for_each(|y| pixels[y * width..][next.clone()].iter().step_by(16).for_each(prefetch));
                for y in rows.clone() {
                    P::add_levels(level, &pixels[y * width..][columns.clone()], &mut sums);
                }
                let mut lumas = [0_i32; RUN];
                let squares = sums[..columns.len()].chunks(factor);
                for (luma, square) in lumas.iter_mut().zip(squares.clone()) {
                    let sum = sum_of(square);
                    // BT.601 weights in 1/256.
                    *luma = (77 * sum[0] + 150 * sum[1] + 29 * sum[2]) as i32;
                }
                let mean = |luma: i32, len: usize| (luma as f32 / (256 * len * rows.len()) as f32 + 0.5) as u8;
                means.iter_mut().zip(&lumas).for_each(|(to, &luma)| *to = mean(luma, factor));
                let last = squares.len() - 1;
                means[last] = mean(lumas[last], columns.len() - last * factor);
            }
        });
        self.find_detail()
    }

    /// `detail` = `luma` - local mean.
    fn find_detail(&mut self) -> Result<()> {
        resize(&mut self.detail, self.luma.len(), 0)?;
        let (width, height, luma) = (self.width, self.height, &self.luma);
        let around = |at: usize, len: usize| at.saturating_sub(DETAIL_REACH)..(at + DETAIL_REACH + 1).min(len);
        self.detail.par_chunks_mut(width).with_min_len(8).enumerate().for_each(|(y, row)| {
            let rows = around(y, height);
            let mut columns = [0_u16; REDUCED_SIDE];
            for y in rows.clone() {
                columns.iter_mut().zip(&luma[y * width..][..width]).for_each(|(sum, &v)| *sum += u16::from(v));
            }
            // Prefix sums of the columns.
            let mut before = [0_u32; REDUCED_SIDE + 1];
            for x in 0..width {
                before[x + 1] = before[x] + u32::from(columns[x]);
            }
            let luma = &luma[y * width..][..width];
            // The added half keeps exact quotients from rounding down.
            let detail =
                |v: u8, sum: u32, count: usize| i16::from(v) - ((sum as i32 as f32 + 0.5) / count as f32) as i16;
            for x in (0..width.min(DETAIL_REACH)).chain(width.saturating_sub(DETAIL_REACH)..width) {
                let columns = around(x, width);
                row[x] = detail(luma[x], before[columns.end] - before[columns.start], rows.len() * columns.len());
            }
            // Away from the borders all means have the same number of columns.
            const REACHED: usize = 2 * DETAIL_REACH + 1;
            let inside = DETAIL_REACH..width.saturating_sub(DETAIL_REACH).max(DETAIL_REACH);
            let ends = before[..width + 1].iter().zip(before.get(REACHED..).unwrap_or_default());
            let values = row.iter_mut().zip(luma).take(inside.end).skip(inside.start);
            for ((to, &v), (start, end)) in values.zip(ends) {
                *to = detail(v, end - start, rows.len() * REACHED);
            }
        });
        Ok(())
    }

    /// Sets the size to that of `larger` divided by `factor`.
    fn reserve(&mut self, larger: &Self, factor: usize) -> Result<()> {
        (self.width, self.height) = (larger.width.div_ceil(factor), larger.height.div_ceil(factor));
        resize(&mut self.luma, self.width * self.height, 0)
    }

    /// Computes the mean of each `factor` x `factor` square of `larger`, for which memory is reserved.
    fn reduce(&mut self, larger: &Self, factor: usize) {
        for (y, row) in self.luma.chunks_mut(self.width).enumerate() {
            let rows = y * factor..((y + 1) * factor).min(larger.height);
            for (x, mean) in row.iter_mut().enumerate() {
                let columns = x * factor..((x + 1) * factor).min(larger.width);
                let count = rows.len() * columns.len();
                let squares = rows.clone().flat_map(|y| &larger.luma[y * larger.width..][columns.clone()]);
                *mean = ((squares.map(|&v| usize::from(v)).sum::<usize>() + count / 2) / count) as u8;
            }
        }
    }
}
