//! Kernels for pictures of bytes.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

use super::lanczos::{BEFORE, ONE, PHASES, SINC, TAPS};
use super::sampling::{BLOCK, Block, MergeRule, Positions, Sampled, TILE, TileSource, luma};
use super::scalar::{self, taps};
use super::{Set, SimdLevel, Source, at_every_level};

type Pixel = [u8; 4];

impl Sampled for Pixel {
    #[inline]
    fn sample(source: Source<'_, Self>, at: [i32; 2]) -> Self {
        let (taps, [across, down]) = taps(&source, at, [0; 4]);
        // Plain loops: LLVM does not always inline closures of arrays here.
        let mut sums = [1 << 13; 4];
        for (row, down) in taps.iter().zip(down) {
            let mut of_row = [0; 4];
            for (pixel, across) in row.iter().zip(across) {
                for c in 0..4 {
                    of_row[c] += i32::from(pixel[c]) * i32::from(across);
                }
            }
            for c in 0..4 {
                sums[c] += of_row[c] * i32::from(down);
            }
        }
        let mut sample = [0; 4];
        for c in 0..4 {
            sample[c] = (sums[c] >> 14).clamp(0, 255) as u8;
        }
        sample
    }

    #[inline]
    fn merge(from_previous: Self, from_current: Self, rule: &MergeRule) -> (Self, bool) {
        let share = u16::from(rule.share());
        let (mut difference, mut mixed) = (0, [0; 4]);
        for c in 0..4 {
            difference = difference.max(from_previous[c].abs_diff(from_current[c]));
            mixed[c] =
                ((u16::from(from_previous[c]) * (128 - share) + u16::from(from_current[c]) * share + 64) >> 7) as u8;
        }
        let nearer = if rule.nearer_is_current { from_current } else { from_previous };
        (if difference <= rule.max_equal_difference { nearer } else { mixed }, difference > rule.doubt_threshold)
    }

    fn merge_tile(
        level: SimdLevel,
        previous: TileSource<'_, Self>,
        current: TileSource<'_, Self>,
        rule: &MergeRule,
        out: &mut [Self],
        stride: usize,
    ) -> u64 {
        match level.0 {
            Set::Scalar => scalar::merge_tile(previous, current, rule, out, stride),
            Set::Portable => portable::merge_tile(previous, current, rule, out, stride),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has AVX2.
            Set::Avx2 => unsafe { avx2::merge_tile(previous, current, rule, out, stride) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has these features.
            Set::Avx512 => unsafe { avx512::merge_tile(previous, current, rule, out, stride) },
        }
    }

    fn sample_tile(level: SimdLevel, source: TileSource<'_, Self>, out: &mut [Self], stride: usize) {
        match level.0 {
            Set::Scalar => scalar::sample_tile(source, out, stride),
            Set::Portable => portable::sample_tile(source, out, stride),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has AVX2.
            Set::Avx2 => unsafe { avx2::sample_tile(source, out, stride) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has these features.
            Set::Avx512 => unsafe { avx512::sample_tile(source, out, stride) },
        }
    }

    fn sample_pixels(level: SimdLevel, source: Source<'_, Self>, at: &Positions, wanted: u64, out: &mut [Self; BLOCK]) {
        match level.0 {
            Set::Scalar => scalar::sample_pixels(source, at, wanted, out),
            Set::Portable => portable::sample_pixels(source, at, wanted, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has AVX2.
            Set::Avx2 => unsafe { avx2::sample_pixels(source, at, wanted, out) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has these features.
            Set::Avx512 => unsafe { avx512::sample_pixels(source, at, wanted, out) },
        }
    }

    fn merge_block(level: SimdLevel, rule: &MergeRule, block: &mut Block<Self>) -> u64 {
        match level.0 {
            Set::Scalar | Set::Portable => scalar::merge_block(rule, block),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has AVX2.
            Set::Avx2 => unsafe { avx2::merge_block(rule, block) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a value of this level proves that the processor has these features.
            Set::Avx512 => unsafe { avx512::merge_block(rule, block) },
        }
    }

    fn add_levels(level: SimdLevel, row: &[Self], sums: &mut [[u16; 4]]) {
        add_levels(level, row, sums);
    }

    fn lumas(level: SimdLevel, row: &[Self], lumas: &mut [u8]) {
        lumas_of(level, row, lumas);
    }

    #[inline(always)]
    fn levels(self) -> [u8; 4] {
        self
    }
}

at_every_level! {
    fn add_levels(row: &[Pixel], sums: &mut [[u16; 4]]) = scalar::add_levels | add_levels_in_vectors
}

at_every_level! {
    fn lumas_of(row: &[Pixel], lumas: &mut [u8]) = scalar::lumas | lumas_in_vectors
}

#[inline(always)]
fn add_levels_in_vectors(row: &[Pixel], sums: &mut [[u16; 4]]) {
    for (sum, &level) in sums.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
        *sum = sum.wrapping_add(level.into());
    }
}

#[inline(always)]
fn lumas_in_vectors(row: &[Pixel], lumas: &mut [u8]) {
    for (value, &pixel) in lumas.iter_mut().zip(row) {
        *value = luma(pixel);
    }
}

/// Rows and columns of pixels from which a tile is sampled.
const SPAN: usize = TILE + TAPS - 1;
/// Readable pixels of each of those rows: a whole vector.
const PATCH_WIDTH: usize = 16;
/// Bytes of a row of a tile.
const ROW: usize = 4 * TILE;

/// Copy of a patch that extends beyond the border.
type PatchBuffer = [[Pixel; PATCH_WIDTH]; SPAN];

/// The 13 rows around a tile, with 16 readable pixels each, and the subpixel phases of its position.
#[derive(Clone, Copy)]
struct Patch<'a> {
    pixels: &'a [Pixel],
    stride: usize,
    phases: [usize; 2],
}

impl<'a> Patch<'a> {
    /// The patch of the tile at a position.
    #[inline(always)]
    fn new(source: &Source<'a, Pixel>, at: [i32; 2], buffer: &'a mut Option<PatchBuffer>) -> Self {
        let ([x, y], phases) = (at.map(|v| (v >> 6) - BEFORE), at.map(|v| (v & 63) as usize));
        let is_inside = x >= 0 && y >= 0 && x as usize + SPAN <= source.width && y as usize + SPAN <= source.height;
        if is_inside {
            let start = y as usize * source.width + x as usize;
            // Rows are read beyond their end, into the next one; after the picture's last row there is none.
            let end = start + (SPAN - 1) * source.width + PATCH_WIDTH;
            if let Some(pixels) = source.pixels.get(start..end) {
                return Self { pixels, stride: source.width, phases };
            }
        }
        let buffer = buffer.insert([[[0; 4]; PATCH_WIDTH]; SPAN]);
        source.clamped([x, y], buffer);
        Self { pixels: buffer.as_flattened(), stride: PATCH_WIDTH, phases }
    }

    /// Prefetches rows of the tiles to the right: thirteen rows are too many for hardware prefetchers.
    #[inline(always)]
    fn prefetch_ahead(self) -> Self {
        #[cfg(target_arch = "x86_64")]
        for row in 0..SPAN {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            let ahead = self.pixels.as_ptr().wrapping_add(row * self.stride + PREFETCH_AHEAD);
            // SAFETY: a hint, which reads nothing and may name any address.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(ahead.cast()) };
        }
        self
    }

    /// `N` pixels of a row, starting at `from`.
    #[inline(always)]
    fn row<const N: usize>(&self, row: usize, from: usize) -> &[Pixel; N] {
        self.pixels[row * self.stride + from..].first_chunk().expect("a patch has sixteen pixels in each row")
    }

    /// Whether the position is a whole pixel.
    #[inline(always)]
    fn is_whole(&self) -> bool {
        self.phases == [0, 0]
    }
}

/// Prefetch distance in pixels: six tiles.
#[cfg(target_arch = "x86_64")]
const PREFETCH_AHEAD: usize = 6 * TILE;

/// Negated weights as signed bytes, because 128 does not fit but -128 does. The last two are 0.
static NEGATIVE: [[i8; EIGHT]; PHASES] = {
    let mut table = [[0; EIGHT]; PHASES];
    let mut phase = 0;
    while phase < PHASES {
        let mut tap = 0;
        while tap < TAPS {
            table[phase][tap] = -SINC[phase][tap] as i8;
            tap += 1;
        }
        phase += 1;
    }
    table
};

/// Added to the negated sum of six weighted bytes, this gives the negated sum of the same bytes less 128, which fits 16
/// bits. As weights add up to 128, the 64 is the half for rounding.
const BIAS: i16 = 128 * ONE - 64;

/// Pixels that are read per row: two more than a sample needs.
const EIGHT: usize = 8;

/// Smallest group of contiguous pixels for which a tile is sampled instead of single pixels.
const MIN_GROUP: u32 = 10;
/// Number of smaller groups after which the search ends.
const MAX_SMALL_GROUPS: usize = 3;
/// Positions within this, and those a tile away, do not overflow.
const MAX_POSITION: i32 = 1 << 30;

/// Splits the pixels of a block into groups that are contiguous in the picture, as those of one surface usually are,
/// and single pixels.
struct Groups<'a> {
    at: &'a Positions,
    left: u64,
    single: u64,
    attempts: usize,
}

impl<'a> Groups<'a> {
    #[inline(always)]
    fn new(at: &'a Positions, wanted: u64) -> Self {
        Self { at, left: wanted, single: 0, attempts: MAX_SMALL_GROUPS }
    }

    /// The next group with the position of its tile; `None` if no large one is left.
    #[inline(always)]
    fn next(&mut self) -> Option<([i32; 2], u64)> {
        while self.left.count_ones() >= MIN_GROUP && self.attempts > 0 {
            let index = self.left.trailing_zeros() as usize;
            let at = [self.at.x[index], self.at.y[index]];
            let corner = [at[0].wrapping_sub(to_fixed(index % TILE)), at[1].wrapping_sub(to_fixed(index / TILE))];
            let is_outside_range = at.iter().any(|v| !(-MAX_POSITION..MAX_POSITION).contains(v));
            let group = if is_outside_range { 0 } else { self.members(corner) };
            self.left &= !(group | 1 << index);
            if group.count_ones() >= MIN_GROUP {
                return Some((corner, group));
            }
            self.single |= group | 1 << index;
            self.attempts -= 1;
        }
        None
    }

    /// Pixels without a group.
    #[inline(always)]
    fn single(&self) -> u64 {
        self.single | self.left
    }

    /// Remaining pixels that are where a tile at `corner` would have them.
    #[inline(always)]
    fn members(&self, corner: [i32; 2]) -> u64 {
        let mut columns = [0_u64; TILE];
        for j in 0..TILE {
            for (i, column) in columns.iter_mut().enumerate() {
                let index = TILE * j + i;
                let is_in =
                    (self.at.x[index] == corner[0] + to_fixed(i)) & (self.at.y[index] == corner[1] + to_fixed(j));
                *column |= u64::from(is_in) << index;
            }
        }
        columns.into_iter().fold(0, |all, bits| all | bits) & self.left
    }
}

/// Removes up to `N` indices from `wanted`. Returns them with their number; missing ones repeat the last.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn take_up_to<const N: usize>(wanted: &mut u64) -> ([usize; N], usize) {
    let (mut indices, mut last) = ([0; N], 0);
    let count = N.min(wanted.count_ones() as usize);
    for index in &mut indices {
        last = if *wanted == 0 { last } else { wanted.trailing_zeros() as usize };
        *wanted &= wanted.wrapping_sub(1);
        // Shows the compiler that it is in bounds.
        *index = last % BLOCK;
    }
    (indices, count)
}

/// Pixels in 1/64 px.
#[inline(always)]
fn to_fixed(pixels: usize) -> i32 {
    64 * pixels as i32
}

/// Index of the first of the 6x6 pixels around each position of a block, or [`OUTSIDE`] if some of them are outside the
/// picture.
#[inline(always)]
fn starts(source: &Source<'_, Pixel>, at: &Positions) -> [u32; BLOCK] {
    let [width, height] = [source.width, source.height].map(|len| len as u32);
    std::array::from_fn(|i| {
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        let [x, y] = [at.x[i], at.y[i]].map(|v| ((v >> 6) - BEFORE) as u32);
        let last = TAPS as u32 - 1;
        let is_inside = (x < width.saturating_sub(last)) & (y < height.saturating_sub(last));
        if is_inside { y.wrapping_mul(width).wrapping_add(x) } else { OUTSIDE }
    })
}

const OUTSIDE: u32 = u32::MAX;

/// The six rows at `start`; `None` if that is [`OUTSIDE`]. Rows are read beyond their end, into the next one; after the
/// picture's last row there is none.
#[inline(always)]
fn rows<'a>(source: &Source<'a, Pixel>, start: u32) -> Option<[&'a [Pixel; EIGHT]; TAPS]> {
    let row = |j: usize| source.pixels.get(start as usize + j * source.width..).and_then(|row| row.first_chunk());
    Some([row(0)?, row(1)?, row(2)?, row(3)?, row(4)?, row(5)?])
}

/// The 6x6 pixels around any position, clamped to the border.
#[cold]
#[inline(never)]
fn clamped(source: &Source<'_, Pixel>, at: [i32; 2]) -> [[Pixel; EIGHT]; TAPS] {
    let mut rows = [[[0; 4]; EIGHT]; TAPS];
    source.clamped(at.map(|v| (v >> 6) - BEFORE), &mut rows);
    rows
}
