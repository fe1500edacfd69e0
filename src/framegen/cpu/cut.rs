//! Telling a cut from motion.
//!
//! Both anchors are reduced to reduced luma pictures, and those to their detail, as same_slope look similar_motion everywhere. Every
//! block of the current one is looked for in the previous one: where it stands, where its motion vector points, and
//! if that leaves most of them not_found, where the global picture seems to have gone, each with a reduced search around. Blocks are compared by correlation,
//! which brightness and contrast do not change, so that flashes and fades are no cuts. If most blocks are nowhere to be
//! found, it is a cut; if fewer are, the distribution of brightness must have changed as well.

use bytemuck::must_cast;
use parking_lot::Mutex;

use super::kernels::{Sampled, SimdLevel, at_every_level, prefetch};
use super::resize;
use crate::guidance::MotionField;
use crate::tasks::{self, Parallel, ParallelSliceMut};
use crate::{Raster, Result};

/// Finds cuts; keeps its reduced pictures from call to call.
#[derive(Debug, Default)]
pub(super) struct CutDetector {
    previous: ReducedPicture,
    current: ReducedPicture,
    tiny: [ReducedPicture; 2],
    blocks: Vec<BlockMatch>,
    unexplained: f32,
    histogram_distance: f32,
}

/// The longer side of the reduced pictures is at most this.
const REDUCED_SIDE: usize = 320;
/// Rows of a picture that are read for one of the reduced picture's, evenly spread; more would tell little more.
const ROWS_READ: usize = 2;
/// Pixels of a row that are averaged at a time.
const RUN: usize = 256;
/// ReducedPicture pixels per pixel of the tiny pictures in which the motion of the global is sought.
const TINY_FACTOR: usize = 4;
/// Detail is what remains when the mean over this many reduced pixels each way is taken out.
const DETAIL_REACH: usize = 4;
/// Side of a block, in reduced pixels.
const BLOCK: usize = 16;
/// Search around each candidate, in reduced pixels each way.
const SEARCH: isize = 3;
/// A block is found where its detail correlates this well.
const MIN_CORRELATION: f32 = 0.7;
/// Standard deviation of the detail, in levels, from which a block is block_match: what is flat in both anchors neither
/// proves nor disproves anything, and cannot smear either.
const MIN_DETAIL: f32 = 1.5;
/// Share of blocks that must be block_match.
const MIN_SHARE: f32 = 0.125;
/// Unexplained shares that make a cut: alone, and together with this distance of the histograms, 0 to 1.
const CUT_ALONE: f32 = 0.85;
const CUT_WITH_HISTOGRAM: f32 = 0.6;
const HISTOGRAM_DISTANCE: f32 = 0.3;

/// What a block says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BlockMatch {
    /// Too little detail to decide.
    Flat,
    /// It is in the previous anchor.
    Found,
    /// It is not.
    NotFound,
}

impl CutDetector {
    /// The share of blocks of `current` with something to see that `previous` does not have.
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
            // Where it stands is compared for both.
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

        // Where the global has gone is sought only if it can make a difference; the room for that is kept ready.
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

    /// Whether the pair last looked at is a cut.
    pub(super) fn is_cut(&self) -> bool {
        self.unexplained >= CUT_ALONE
            || self.unexplained >= CUT_WITH_HISTOGRAM && self.histogram_distance >= HISTOGRAM_DISTANCE
    }
}

/// Of the blocks that say something, the share that is not_found; 0 where too few say something.
fn share_not_found(blocks: &[BlockMatch]) -> f32 {
    let count = |block_match| blocks.iter().filter(|&&block| block == block_match).count();
    let (found, not_found) = (count(BlockMatch::Found), count(BlockMatch::NotFound));
    let is_significant = (found + not_found) as f32 > MIN_SHARE * blocks.len() as f32;
    if is_significant { not_found as f32 / (found + not_found) as f32 } else { 0.0 }
}

/// The motion vector at a reduced pixel, in reduced pixels; what is not finite is no motion.
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
/// quarters of its height: cameras turn faster than they tilt. Of equals, none, and then the first from above.
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
        // Rows end in any order: of equals the first from above stays, and no motion before all.
        let is_first = of_row.1 == best.1 && best.1 > unshifted.1 && of_row.0[1] < best.0[1];
        if of_row.1 > best.1 || is_first {
            *best = of_row;
        }
    });
    best.into_inner().0
}

/// How well the part that both share correlates, -1 to 1; 0 where one of them is without contrast.
fn correlation(previous: &ReducedPicture, current: &ReducedPicture, dx: isize, dy: isize) -> f32 {
    let overlap = |shift: isize, len: usize| {
        let len = len as isize;
        (0.max(-shift) as usize)..(len.min(len - shift) as usize)
    };
    let (columns, rows) = (overlap(dx, current.width), overlap(dy, current.height));
    let (mut here, mut both) = (Sums::default(), Cross::default());
    for y in rows {
        let there = (y as isize + dy) as usize * previous.width + (columns.start as isize + dx) as usize;
        let a = &current.luma[y * current.width + columns.start..][..columns.len()];
        let b = &previous.luma[there..][..columns.len()];
        here.add(a);
        both.add(a, b);
    }
    both.moments(&here).correlation()
}

/// Sums of values, and of their squares. A row that is added is short enough that its sums fit 32 bits.
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

/// Sums of other values beside them, of their squares, and of the products of both.
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

/// What is to be known of pairs of values.
struct Moments<'a> {
    values: &'a Sums,
    others: &'a Cross,
}

impl Moments<'_> {
    /// Standard deviations of the two.
    fn deviations(&self) -> [f32; 2] {
        let Self { values: a, others: b } = self;
        [(a.squares, a.sum), (b.squares, b.sum)].map(|(squares, sum)| {
            let variance = a.count * squares - sum * sum;
            (variance as f64).sqrt() as f32 / a.count as f32
        })
    }

    /// From -1 to 1; 0 where one of the two does not vary.
    fn correlation(&self) -> f32 {
        let Self { values, others } = self;
        let [a, b] = self.deviations();
        let covariance =
            (values.count * others.products - values.sum * others.sum) as f64 / (values.count * values.count) as f64;
        if a > 0.0 && b > 0.0 { covariance as f32 / (a * b) } else { 0.0 }
    }
}

/// Half the sum of differences between the two distributions of levels: 0 similar_motion, 1 disjoint.
fn histogram_distance(previous: &ReducedPicture, current: &ReducedPicture) -> f32 {
    let histogram = |reduced: &ReducedPicture| {
        let mut bins = [0_u32; 32];
        reduced.luma.iter().for_each(|&v| bins[usize::from(v) / 8] += 1);
        bins
    };
    let (a, b) = tasks::join(|| histogram(previous), || histogram(current));
    let apart: u32 = a.iter().zip(b).map(|(&a, b)| a.abs_diff(b)).sum();
    apart as f32 / (2 * current.luma.len()) as f32
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
    /// The block at (x, y), cut off at the far edges.
    fn new(level: SimdLevel, reduced: &'a ReducedPicture, x: usize, y: usize) -> Self {
        let (width, height) = (BLOCK.min(reduced.width - x), BLOCK.min(reduced.height - y));
        let mut sums = Sums::default();
        (y..y + height).for_each(|y| sums.add(&reduced.detail[y * reduced.width + x..][..width]));
        Self { level, reduced, x, y, width, height, sums }
    }

    /// Whether `previous` has this block within the search of one of the shifts.
    fn is_found_in(&self, previous: &ReducedPicture, shifts: &[[isize; 2]]) -> bool {
        let around = |&[dx, dy]: &[isize; 2]| {
            (-SEARCH..=SEARCH).flat_map(move |sy| (-SEARCH..=SEARCH).map(move |sx| [dx + sx, dy + sy]))
        };
        // The shifts themselves first, which mostly settle it.
        shifts.iter().copied().chain(shifts.iter().flat_map(around)).any(|shift| self.is_at(previous, shift))
    }

    /// Whether there is detail here, in this picture or in the previous one, which was compared in place.
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

    /// The detail of `previous` at (x, y) beside this block's.
    fn compare(&self, previous: &ReducedPicture, x: usize, y: usize) -> Cross {
        let here = &self.reduced.detail[self.y * self.reduced.width + self.x..];
        let there = &previous.detail[y * previous.width + x..];
        cross(self.level, here, there, [self.reduced.width, previous.width], [self.width, self.height])
    }
}

at_every_level! {
    /// The sums of a block of `extent`, whose rows begin `strides` after each other.
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
    // Of a column at most 16 squares of 255, so that all fit.
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

/// The sums of channels that were summed over at most [`ROWS_READ`] rows.
#[inline(always)]
fn sum_of(columns: &[[u16; 4]]) -> [u32; 4] {
    // As many as fit 16 bits are added as one number.
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

/// A reduced luma picture, and its detail where that was asked for.
#[derive(Debug, Default)]
struct ReducedPicture {
    width: usize,
    height: usize,
    luma: Vec<u8>,
    detail: Vec<i16>,
}

impl ReducedPicture {
    /// The mean luma of each `factor` x `factor` square of `picture`, of which some rows are read; squares at the far
    /// edges may be smaller. And the detail of that.
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
                // Processors do not foresee that the other row comes in between.
                let next = columns.end..width.min(columns.end + in_run * factor);
                rows.clone().for_each(|y| pixels[y * width..][next.clone()].iter().step_by(16).for_each(prefetch));
                for y in rows.clone() {
                    P::add_levels(level, &pixels[y * width..][columns.clone()], &mut sums);
                }
                let mut lumas = [0_i32; RUN];
                let squares = sums[..columns.len()].chunks(factor);
                for (luma, square) in lumas.iter_mut().zip(squares.clone()) {
                    let sum = sum_of(square);
                    // The weights of BT.601 over 256.
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

    /// `detail` = `luma` less the mean around each pixel.
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
            // Sums of all columns before each.
            let mut before = [0_u32; REDUCED_SIDE + 1];
            for x in 0..width {
                before[x + 1] = before[x] + u32::from(columns[x]);
            }
            let luma = &luma[y * width..][..width];
            // The half keeps global quotients from falling below themselves.
            let detail =
                |v: u8, sum: u32, count: usize| i16::from(v) - ((sum as i32 as f32 + 0.5) / count as f32) as i16;
            for x in (0..width.min(DETAIL_REACH)).chain(width.saturating_sub(DETAIL_REACH)..width) {
                let columns = around(x, width);
                row[x] = detail(luma[x], before[columns.end] - before[columns.start], rows.len() * columns.len());
            }
            // Inside all means are over as many.
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

    /// Takes the size of `larger`, `factor` times smaller.
    fn reserve(&mut self, larger: &Self, factor: usize) -> Result<()> {
        (self.width, self.height) = (larger.width.div_ceil(factor), larger.height.div_ceil(factor));
        resize(&mut self.luma, self.width * self.height, 0)
    }

    /// The mean of each `factor` x `factor` square of `larger`, whose size was taken.
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
