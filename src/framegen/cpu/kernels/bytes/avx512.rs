//! AVX-512: a row of eight pixels is one vector of 32 16-bit channels; two rows are one of 64 bytes.

use std::arch::x86_64::*;

use bytemuck::{must_cast, must_cast_mut, must_cast_ref};

use super::{
    BEFORE, BIAS, BLOCK, Block, Groups, MergeRule, NEGATIVE, PREFETCH_AHEAD, Patch, Pixel, Positions, SINC, SPAN,
    Source, TAPS, TILE, TileSource, clamped, starts, take_up_to,
};
use crate::framegen::cpu::kernels::lanczos::{PAIRS, PHASES};

/// Pixels per vector.
const PIXELS: usize = 16;
/// Row and column of the tile in its patch.
const OWN: usize = BEFORE as usize;

/// See [`super::Sampled::merge_tile`].
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
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
    for row in 0..TILE {
        // Prefetches the tiles to the right for writing.
        _mm_prefetch::<_MM_HINT_ET0>(out.as_ptr().wrapping_add(row * stride + PREFETCH_AHEAD).cast());
    }
    for pair in 0..TILE / 2 {
        let (rows, is_reported) = merge.sixteen(from_previous[pair], from_current[pair]);
        store(out, 2 * pair, stride, rows);
        mask |= u64::from(is_reported) << (PIXELS * pair);
    }
    mask
}

/// See [`super::Sampled::sample_tile`].
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
pub(super) fn sample_tile(source: TileSource<'_, Pixel>, out: &mut [Pixel], stride: usize) {
    let mut buffer = None;
    for (pair, rows) in
        sampled(&Patch::new(&source.picture, source.at, &mut buffer).prefetch_ahead()).into_iter().enumerate()
    {
        store(out, 2 * pair, stride, rows);
    }
}

/// See [`super::Sampled::merge_block`].
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
pub(super) fn merge_block(rule: &MergeRule, block: &mut Block<Pixel>) -> u64 {
    let merge = Merge::new(rule);
    let from_previous: &[[Pixel; PIXELS]; 4] = must_cast_ref::<[Pixel; BLOCK], _>(&block.previous);
    let from_current: &[[Pixel; PIXELS]; 4] = must_cast_ref::<[Pixel; BLOCK], _>(&block.current);
    let merged: &mut [[Pixel; PIXELS]; 4] = must_cast_mut::<[Pixel; BLOCK], _>(&mut block.merged);
    let mut mask = 0;
    for i in 0..4 {
        let (pixels, is_reported) = merge.sixteen(must_cast(from_previous[i]), must_cast(from_current[i]));
        merged[i] = must_cast(pixels);
        mask |= u64::from(is_reported) << (PIXELS * i);
    }
    mask
}

/// See [`super::Sampled::sample_pixels`].
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
pub(super) fn sample_pixels(source: Source<'_, Pixel>, at: &Positions, wanted: u64, out: &mut [Pixel; BLOCK]) {
    let mut groups = Groups::new(at, wanted);
    while let Some((corner, group)) = groups.next() {
        let mut buffer = None;
        let rows = sampled(&Patch::new(&source, corner, &mut buffer));
        let out = must_cast_mut::<_, [[Pixel; PIXELS]; TILE / 2]>(out);
        for (pair, (out, rows)) in out.iter_mut().zip(rows).enumerate() {
            *out = must_cast(_mm512_mask_mov_epi32(must_cast(*out), (group >> (PIXELS * pair)) as u16, rows));
        }
    }
    each_pixel(source, at, groups.single(), out);
}

/// Samples single pixels, two at a time.
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
fn each_pixel(source: Source<'_, Pixel>, at: &Positions, mut wanted: u64, out: &mut [Pixel; BLOCK]) {
    if wanted == 0 {
        return;
    }
    let (taps, levels): (__m512i, __m512i) = (must_cast(TAPS_BY_CHANNEL), must_cast(LEVELS_BY_PIXEL));
    let bias = _mm512_set1_epi64(BIAS.into());
    let starts = starts(&source, at);
    while wanted != 0 {
        let (indices, count) = take_up_to::<PIXELS>(&mut wanted);
        // Sums of two pixels, in even elements and again in odd ones.
        let mut sums = [_mm512_setzero_si512(); PIXELS / 2];
        for (pair, sums) in sums.iter_mut().enumerate().take(count.div_ceil(2)) {
            // Negated weighted rows, two per vector: a 128-bit lane per channel, with the sums of the first four taps
            // and of the others for each row. And the vertical phases.
            let mut rows = [[_mm512_setzero_si512(); TAPS / 2]; 2];
            let mut phases = [0; 2];
            for (side, (rows, phase)) in rows.iter_mut().zip(&mut phases).enumerate() {
                let pixel = indices[2 * pair + side];
                let at = [at.x[pixel], at.y[pixel]];
                let [fx, fy] = at.map(|v| (v & 63) as usize);
                let two = |upper, lower| {
                    _mm512_inserti64x4(_mm512_castsi256_si512(must_cast::<[Pixel; 8], _>(upper)), must_cast(lower), 1)
                };
                let bytes = match super::rows(&source, starts[pixel]) {
                    Some([a, b, c, d, e, f]) => [two(*a, *b), two(*c, *d), two(*e, *f)],
                    None => {
                        let [a, b, c, d, e, f] = clamped(&source, at);
                        [two(a, b), two(c, d), two(e, f)]
                    }
                };
                let across = _mm512_set1_epi64(must_cast(NEGATIVE[fx]));
                *rows = bytes.map(|bytes| _mm512_dpbusd_epi32(bias, _mm512_permutexvar_epi8(taps, bytes), across));
                *phase = fy;
            }
            let ([p, q], [fp, fq]) = (rows, phases);
            let four = |rows: [__m512i; 3], phase: usize| {
                let down = _mm512_broadcast_i32x4(must_cast(DOWN[phase]));
                _mm512_madd_epi16(_mm512_packs_epi32(rows[0], rows[1]), down)
            };
            let (of_p, of_q) = (four(p, fp), four(q, fq));
            let down = _mm512_broadcast_i32x4(must_cast([DOWN_LAST[fp], DOWN_LAST[fq]]));
            let last = _mm512_madd_epi16(_mm512_packs_epi32(p[2], q[2]), down);
            let halves = _mm512_add_epi32(
                _mm512_add_epi32(_mm512_unpacklo_epi64(of_p, of_q), _mm512_unpackhi_epi64(of_p, of_q)),
                last,
            );
            *sums = _mm512_add_epi32(halves, _mm512_shuffle_epi32(halves, 0b10_11_00_01));
        }
        let [a, b, c, d, e, f, g, h] = sums;
        let four = |a, b| _mm512_srai_epi32(_mm512_mask_blend_epi32(0xaaaa, a, b), 14);
        let eight = |a, b, c, d| _mm512_packs_epi32(four(a, b), four(c, d));
        let sixteen = _mm512_packs_epi16(eight(a, b, c, d), eight(e, f, g, h));
        let pixels = _mm512_permutexvar_epi8(levels, _mm512_xor_si512(sixteen, _mm512_set1_epi8(-128)));
        let pixels: [Pixel; PIXELS] = must_cast(pixels);
        for (&index, pixel) in indices[..count].iter().zip(pixels) {
            out[index] = pixel;
        }
    }
}

/// Negated vertical weights of the first four rows, each twice.
static DOWN: [[i16; 8]; PHASES] = {
    let mut table = [[0; 8]; PHASES];
    let mut i = 0;
    while i < 8 * PHASES {
        table[i / 8][i % 8] = -SINC[i / 8][i % 8 / 2];
        i += 1;
    }
    table
};

/// The same for the last two rows.
static DOWN_LAST: [[i16; 4]; PHASES] = {
    let mut table = [[0; 4]; PHASES];
    let mut i = 0;
    while i < 4 * PHASES {
        table[i / 4][i % 4] = -SINC[i / 4][4 + i % 4 / 2];
        i += 1;
    }
    table
};

/// Byte order from two rows of eight pixels to one 128-bit lane per channel, 64 bits per row, one byte per tap.
static TAPS_BY_CHANNEL: [u8; 64] = {
    let mut order = [0; 64];
    let mut i = 0;
    while i < 64 {
        let (channel, row, tap) = (i / 16, i / 8 % 2, i % 8);
        order[i] = (32 * row + 4 * tap + channel) as u8;
        i += 1;
    }
    order
};

/// Byte order from one lane per channel, with pixels in packed order, to pixels.
static LEVELS_BY_PIXEL: [u8; 64] = {
    let mut order = [0; 64];
    let mut i = 0;
    while i < 64 {
        let (pixel, channel) = (i / 4, i % 4);
        // Blending swapped pixels 1 and 2 of every four.
        let in_four = [0, 2, 1, 3][pixel % 4];
        order[i] = (16 * channel + pixel / 4 * 4 + in_four) as u8;
        i += 1;
    }
    order
};

/// Byte order that interleaves the two taps of a pair.
static BYTES_OF_PAIRS: [[u8; 64]; TAPS / 2] = {
    let mut bytes = [[0; 64]; TAPS / 2];
    let mut i = 0;
    while i < 64 * bytes.len() {
        let (pair, byte) = (i / 64, i % 64);
        // Bytes beyond the tile are not used.
        bytes[pair][byte] = ((byte / 2 + 4 * PAIRS[pair][byte % 2]) % 64) as u8;
        i += 1;
    }
    bytes
};

/// Samples a tile, two rows per vector.
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
#[inline]
fn sampled(patch: &Patch<'_>) -> [__m512i; TILE / 2] {
    if patch.is_whole() {
        return std::array::from_fn(|pair| {
            let [upper, lower] = [0, 1].map(|j| must_cast(*patch.row::<TILE>(2 * pair + j + OWN, OWN)));
            _mm512_inserti64x4(_mm512_castsi256_si512(upper), lower, 1)
        });
    }
    // Restores the row order after packing within lanes.
    let in_order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
    let packed = |upper, lower| {
        let levels = _mm512_xor_si512(_mm512_packs_epi16(upper, lower), _mm512_set1_epi8(-128));
        _mm512_permutexvar_epi64(in_order, levels)
    };
    let weights = NEGATIVE[patch.phases[0]].map(|w| i16::from(w as u8));
    let weights = PAIRS.map(|[p, q]| _mm512_set1_epi16(weights[p] | weights[q] << 8));
    let bytes_of_pairs: [__m512i; TAPS / 2] = must_cast(BYTES_OF_PAIRS);
    let bias = _mm512_set1_epi16(BIAS);
    // Negated horizontal sums of a row at the tile's columns, with the bias.
    let across = |j: usize| {
        let bytes: __m512i = must_cast(*patch.row::<PIXELS>(j, 0));
        let pair = |i: usize| _mm512_maddubs_epi16(_mm512_permutexvar_epi8(bytes_of_pairs[i], bytes), weights[i]);
        _mm512_add_epi16(_mm512_add_epi16(pair(0), pair(1)), _mm512_add_epi16(pair(2), bias))
    };
    if patch.phases[1] == 0 {
        // Whole rows: 128 times a row over 2^14 is the row over 2^7.
        let row = |j: usize| _mm512_srai_epi16(_mm512_sub_epi16(_mm512_setzero_si512(), across(j)), 7);
        return std::array::from_fn(|pair| packed(row(2 * pair + OWN), row(2 * pair + 1 + OWN)));
    }
    let mut rows = [_mm512_setzero_si512(); SPAN];
    for (j, row) in rows.iter_mut().enumerate() {
        *row = if patch.phases[0] == 0 {
            let levels = _mm512_cvtepu8_epi16(must_cast(*patch.row::<TILE>(j, OWN)));
            _mm512_sub_epi16(bias, _mm512_slli_epi16(levels, 7))
        } else {
            across(j)
        };
    }
    let down = SINC[patch.phases[1]].map(|w| -w);
    let down = [0, 2, 4].map(|tap| _mm512_set1_epi32(must_cast([down[tap], down[tap + 1]])));
    let row = |j: usize| {
        let [a, b, c, d, e, f] = std::array::from_fn(|tap| rows[j + tap]);
        let sum = |ab, cd, ef| {
            let four = _mm512_dpwssd_epi32(_mm512_madd_epi16(ab, down[0]), cd, down[1]);
            _mm512_srai_epi32(_mm512_dpwssd_epi32(four, ef, down[2]), 14)
        };
        _mm512_packs_epi32(
            sum(_mm512_unpacklo_epi16(a, b), _mm512_unpacklo_epi16(c, d), _mm512_unpacklo_epi16(e, f)),
            sum(_mm512_unpackhi_epi16(a, b), _mm512_unpackhi_epi16(c, d), _mm512_unpackhi_epi16(e, f)),
        )
    };
    std::array::from_fn(|pair| packed(row(2 * pair), row(2 * pair + 1)))
}

/// A [`MergeRule`] in vectors.
struct Merge {
    shares: __m512i,
    max_equal_difference: __m512i,
    doubt_threshold: __m512i,
    nearer_is_current: bool,
}

impl Merge {
    #[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
    #[inline]
    fn new(rule: &MergeRule) -> Self {
        let share = i16::from(rule.share());
        Self {
            shares: _mm512_set1_epi16((128 - share) | share << 8),
            max_equal_difference: _mm512_set1_epi8(rule.max_equal_difference as i8),
            doubt_threshold: _mm512_set1_epi8(rule.doubt_threshold as i8),
            nearer_is_current: rule.nearer_is_current,
        }
    }

    /// Merges sixteen pixels; also returns the bits of those to report.
    #[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
    #[inline]
    fn sixteen(&self, b: __m512i, a: __m512i) -> (__m512i, u16) {
        let apart = _mm512_or_si512(_mm512_subs_epu8(b, a), _mm512_subs_epu8(a, b));
        let is_beyond = |limit| {
            let rest = _mm512_subs_epu8(apart, limit);
            _mm512_test_epi32_mask(rest, rest)
        };
        let weighted = |pairs| _mm512_mulhrs_epi16(_mm512_maddubs_epi16(pairs, self.shares), _mm512_set1_epi16(256));
        let mixed = _mm512_packus_epi16(weighted(_mm512_unpacklo_epi8(b, a)), weighted(_mm512_unpackhi_epi8(b, a)));
        let nearer = if self.nearer_is_current { a } else { b };
        (_mm512_mask_blend_epi32(is_beyond(self.max_equal_difference), nearer, mixed), is_beyond(self.doubt_threshold))
    }
}

/// Stores two rows of a tile, starting at row `j`.
#[inline(always)]
fn store(out: &mut [Pixel], j: usize, stride: usize, rows: __m512i) {
    let [upper, lower]: [[Pixel; TILE]; 2] = must_cast(rows);
    *out[j * stride..].first_chunk_mut::<TILE>().expect("a tile fits") = upper;
    *out[(j + 1) * stride..].first_chunk_mut::<TILE>().expect("a tile fits") = lower;
}
