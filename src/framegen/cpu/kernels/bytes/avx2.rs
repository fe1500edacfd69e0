//! AVX2: a row of eight pixels is two vectors of 16-bit channels, the first with pixels 0, 1, 4, 5 and the second with
//! 2, 3, 6, 7, as unpacking within 128-bit lanes leaves them; packing restores the order.

use std::arch::x86_64::*;

use bytemuck::{must_cast, must_cast_ref};

use super::{
    BEFORE, BIAS, BLOCK, Block, Groups, MergeRule, NEGATIVE, Patch, Pixel, Positions, SINC, SPAN, Source, TAPS, TILE,
    TileSource, clamped, rows, starts, take_up_to,
};
use crate::framegen::cpu::kernels::lanczos::{PAIRS, PHASES};

/// See [`super::Sampled::merge_tile`].
#[target_feature(enable = "avx2")]
pub(super) fn merge_tile(
    previous: TileSource<'_, Pixel>,
    current: TileSource<'_, Pixel>,
    rule: &MergeRule,
    out: &mut [Pixel],
    stride: usize,
) -> u64 {
    let (mut buffer_a, mut buffer_b) = (None, None);
    let from_previous = sampled(&Patch::new(&previous.picture, previous.at, &mut buffer_a).prefetch_ahead());
    let from_current = sampled(&Patch::new(&current.picture, current.at, &mut buffer_b).prefetch_ahead());
    let merge = Merge::new(rule);
    let mut mask = 0;
    for j in 0..TILE {
        let (row, is_reported) = merge.eight(from_previous[j], from_current[j]);
        store(&mut out[j * stride..], row);
        mask |= u64::from(is_reported) << (TILE * j);
    }
    mask
}

/// See [`super::Sampled::sample_tile`].
#[target_feature(enable = "avx2")]
pub(super) fn sample_tile(source: TileSource<'_, Pixel>, out: &mut [Pixel], stride: usize) {
    let mut buffer = None;
    for (j, row) in
        sampled(&Patch::new(&source.picture, source.at, &mut buffer).prefetch_ahead()).into_iter().enumerate()
    {
        store(&mut out[j * stride..], row);
    }
}

/// See [`super::Sampled::merge_block`].
#[target_feature(enable = "avx2")]
pub(super) fn merge_block(rule: &MergeRule, block: &mut Block<Pixel>) -> u64 {
    let merge = Merge::new(rule);
    let rows = |pixels| -> &[[Pixel; TILE]; TILE] { must_cast_ref::<[Pixel; BLOCK], _>(pixels) };
    let (from_previous, from_current) = (rows(&block.previous), rows(&block.current));
    let mut mask = 0;
    for j in 0..TILE {
        let (row, is_reported) = merge.eight(must_cast(from_previous[j]), must_cast(from_current[j]));
        store(&mut block.merged[j * TILE..], row);
        mask |= u64::from(is_reported) << (TILE * j);
    }
    mask
}

/// See [`super::Sampled::sample_pixels`].
#[target_feature(enable = "avx2")]
pub(super) fn sample_pixels(source: Source<'_, Pixel>, at: &Positions, wanted: u64, out: &mut [Pixel; BLOCK]) {
    let mut groups = Groups::new(at, wanted);
    while let Some((corner, group)) = groups.next() {
        let mut buffer = None;
        for (j, row) in sampled(&Patch::new(&source, corner, &mut buffer)).into_iter().enumerate() {
            let pixels: [Pixel; TILE] = must_cast(row);
            for (i, (out, pixel)) in out[TILE * j..].iter_mut().zip(pixels).enumerate() {
                *out = if group >> (TILE * j + i) & 1 == 1 { pixel } else { *out };
            }
        }
    }
    each_pixel(source, at, groups.single(), out);
}

/// Samples single pixels.
#[target_feature(enable = "avx2")]
fn each_pixel(source: Source<'_, Pixel>, at: &Positions, mut wanted: u64, out: &mut [Pixel; BLOCK]) {
    if wanted == 0 {
        return;
    }
    // Interleaves the channels of two adjacent pixels.
    let by_channel = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15));
    let bias = _mm256_set1_epi16(BIAS);
    let starts = starts(&source, at);
    while wanted != 0 {
        let (indices, count) = take_up_to::<4>(&mut wanted);
        let mut sums = [_mm_setzero_si128(); 4];
        for (&index, sum) in indices.iter().zip(&mut sums).take(count) {
            let at = [at.x[index], at.y[index]];
            let rows: [__m256i; TAPS] = match rows(&source, starts[index]) {
                Some([a, b, c, d, e, f]) => {
                    [must_cast(*a), must_cast(*b), must_cast(*c), must_cast(*d), must_cast(*e), must_cast(*f)]
                }
                None => must_cast(clamped(&source, at)),
            };
            let [fx, fy] = [at[0] & 63, at[1] & 63].map(|v| v as usize);
            // Negated column sums with the bias: columns 0, 1, 4, 5 and columns 2, 3.
            let (mut outer, mut inner) = (bias, bias);
            for (pair, [p, q]) in PAIRS.into_iter().enumerate() {
                let down = _mm256_set1_epi16(DOWN[fy][pair]);
                let [low, high] = [_mm256_unpacklo_epi8(rows[p], rows[q]), _mm256_unpackhi_epi8(rows[p], rows[q])];
                outer = _mm256_add_epi16(outer, _mm256_maddubs_epi16(low, down));
                inner = _mm256_add_epi16(inner, _mm256_maddubs_epi16(high, down));
            }
            let [of_outer, of_inner] = ACROSS[fx];
            let all = _mm256_add_epi32(
                _mm256_madd_epi16(_mm256_shuffle_epi8(outer, by_channel), must_cast(of_outer)),
                _mm256_madd_epi16(_mm256_shuffle_epi8(inner, by_channel), must_cast(of_inner)),
            );
            *sum = _mm_add_epi32(_mm256_castsi256_si128(all), _mm256_extracti128_si256(all, 1));
        }
        let [a, b, c, d] = sums.map(|sum| _mm_srai_epi32(sum, 14));
        let levels = _mm_packs_epi16(_mm_packs_epi32(a, b), _mm_packs_epi32(c, d));
        let pixels: [Pixel; 4] = must_cast(_mm_xor_si128(levels, _mm_set1_epi8(-128)));
        for (&index, pixel) in indices[..count].iter().zip(pixels) {
            out[index] = pixel;
        }
    }
}

/// Negated weights of each of [`PAIRS`], as two bytes.
static DOWN: [[i16; TAPS / 2]; PHASES] = {
    let mut table = [[0; TAPS / 2]; PHASES];
    let mut i = 0;
    while i < PHASES * TAPS / 2 {
        let (phase, pair) = (i / (TAPS / 2), i % (TAPS / 2));
        let [p, q] = PAIRS[pair];
        table[phase][pair] = NEGATIVE[phase][p] as u8 as i16 | (NEGATIVE[phase][q] as i16) << 8;
        i += 1;
    }
    table
};

/// Negated horizontal weights, two per channel: of columns 0, 1, 4, 5, then of columns 2, 3; the last two columns have
/// none.
static ACROSS: [[[i16; 16]; 2]; PHASES] = {
    let mut table = [[[0; 16]; 2]; PHASES];
    let mut i = 0;
    while i < PHASES * 32 {
        let (phase, inner, index) = (i / 32, i / 16 % 2, i % 16);
        let tap = 4 * (index / 8) + 2 * inner + index % 2;
        table[phase][inner][index] = if tap < TAPS { -SINC[phase][tap] } else { 0 };
        i += 1;
    }
    table
};

/// Samples a tile, row by row.
#[target_feature(enable = "avx2")]
#[inline]
fn sampled(patch: &Patch<'_>) -> [__m256i; TILE] {
    if patch.is_whole() {
        return std::array::from_fn(|j| must_cast(*patch.row::<TILE>(j + BEFORE as usize, BEFORE as usize)));
    }
    let across = NEGATIVE[patch.phases[0]].map(|w| i16::from(w as u8));
    let across = PAIRS.map(|[p, q]| _mm256_set1_epi16(across[p] | across[q] << 8));
    let bias = _mm256_set1_epi16(BIAS);
    let mut rows = [[_mm256_setzero_si256(); 2]; SPAN];
    for (j, row) in rows.iter_mut().enumerate() {
        let taps: [__m256i; TAPS] = std::array::from_fn(|from| must_cast(*patch.row::<TILE>(j, from)));
        *row = [bias; 2];
        for ([p, q], across) in PAIRS.into_iter().zip(across) {
            let pairs = [_mm256_unpacklo_epi8(taps[p], taps[q]), _mm256_unpackhi_epi8(taps[p], taps[q])];
            *row = [0, 1].map(|h| _mm256_add_epi16(row[h], _mm256_maddubs_epi16(pairs[h], across)));
        }
    }
    let down = SINC[patch.phases[1]].map(|w| -w);
    let down = [0, 2, 4].map(|tap| _mm256_set1_epi32(must_cast([down[tap], down[tap + 1]])));
    let mut levels = [_mm256_setzero_si256(); TILE];
    for (j, levels) in levels.iter_mut().enumerate() {
        let half = |h: usize| {
            let [a, b, c, d, e, f] = std::array::from_fn(|tap| rows[j + tap][h]);
            let sum = |ab, cd, ef| {
                let [ab, cd, ef] =
                    [_mm256_madd_epi16(ab, down[0]), _mm256_madd_epi16(cd, down[1]), _mm256_madd_epi16(ef, down[2])];
                _mm256_srai_epi32(_mm256_add_epi32(_mm256_add_epi32(ab, cd), ef), 14)
            };
            _mm256_packs_epi32(
                sum(_mm256_unpacklo_epi16(a, b), _mm256_unpacklo_epi16(c, d), _mm256_unpacklo_epi16(e, f)),
                sum(_mm256_unpackhi_epi16(a, b), _mm256_unpackhi_epi16(c, d), _mm256_unpackhi_epi16(e, f)),
            )
        };
        *levels = _mm256_xor_si256(_mm256_packs_epi16(half(0), half(1)), _mm256_set1_epi8(-128));
    }
    levels
}

/// A [`MergeRule`] in vectors.
struct Merge {
    shares: __m256i,
    max_equal_difference: __m256i,
    doubt_threshold: __m256i,
    nearer_is_current: bool,
}

impl Merge {
    #[target_feature(enable = "avx2")]
    #[inline]
    fn new(rule: &MergeRule) -> Self {
        let share = i16::from(rule.share());
        Self {
            shares: _mm256_set1_epi16((128 - share) | share << 8),
            max_equal_difference: _mm256_set1_epi8(rule.max_equal_difference as i8),
            doubt_threshold: _mm256_set1_epi8(rule.doubt_threshold as i8),
            nearer_is_current: rule.nearer_is_current,
        }
    }

    /// Merges eight pixels; also returns the bits of those to report.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn eight(&self, b: __m256i, a: __m256i) -> (__m256i, u8) {
        let apart = _mm256_or_si256(_mm256_subs_epu8(b, a), _mm256_subs_epu8(a, b));
        let is_within = |limit| _mm256_cmpeq_epi32(_mm256_subs_epu8(apart, limit), _mm256_setzero_si256());
        let weighted = |pairs| _mm256_mulhrs_epi16(_mm256_maddubs_epi16(pairs, self.shares), _mm256_set1_epi16(256));
        let mixed = _mm256_packus_epi16(weighted(_mm256_unpacklo_epi8(b, a)), weighted(_mm256_unpackhi_epi8(b, a)));
        let nearer = if self.nearer_is_current { a } else { b };
        let is_reported = !_mm256_movemask_ps(_mm256_castsi256_ps(is_within(self.doubt_threshold)));
        (_mm256_blendv_epi8(mixed, nearer, is_within(self.max_equal_difference)), is_reported as u8)
    }
}

#[inline(always)]
fn store(out: &mut [Pixel], row: __m256i) {
    *out.first_chunk_mut::<TILE>().expect("a tile fits") = must_cast(row);
}
