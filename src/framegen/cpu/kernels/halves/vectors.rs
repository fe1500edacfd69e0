//! The version for the compiler's vectoriser: half floats are widened once, and a row of eight pixels is a vector of 32
//! floats.

use half::f16;

use super::super::lanczos::{BEFORE, SINC, TAPS};
use super::super::ranges::widened;
use super::super::sampling::TILE;
use super::{BLOCK, Block, MergeRule, Pixel, Positions, Source, TileSource, taps};

/// Rows and columns of pixels from which a tile is sampled.
const SPAN: usize = TILE + TAPS - 1;
/// Channels of a row of a tile.
const ROW: usize = 4 * TILE;

/// See [`super::Sampled::merge_tile`].
#[inline(always)]
pub(super) fn merge_tile(
    previous: TileSource<'_, Pixel>,
    current: TileSource<'_, Pixel>,
    rule: &MergeRule,
    out: &mut [Pixel],
    stride: usize,
) -> u64 {
    let (mut from_previous, mut from_current) = ([[0.0; ROW]; TILE], [[0.0; ROW]; TILE]);
    sampled(previous, &mut from_previous);
    sampled(current, &mut from_current);
    let mut mask = 0;
    for j in 0..TILE {
        let (row, is_reported) = merged(&from_previous[j], &from_current[j], rule);
        *out[j * stride..].first_chunk_mut().expect("a tile fits") = narrowed(&row);
        mask |= is_reported << (TILE * j);
    }
    mask
}

/// See [`super::Sampled::sample_tile`].
#[inline(always)]
pub(super) fn sample_tile(source: TileSource<'_, Pixel>, out: &mut [Pixel], stride: usize) {
    let mut rows = [[0.0; ROW]; TILE];
    sampled(source, &mut rows);
    for (j, row) in rows.iter().enumerate() {
        *out[j * stride..].first_chunk_mut().expect("a tile fits") = narrowed(row);
    }
}

/// See [`super::Sampled::merge_block`].
#[inline(always)]
pub(super) fn merge_block(rule: &MergeRule, block: &mut Block<Pixel>) -> u64 {
    let mut mask = 0;
    for j in 0..TILE {
        let (mut from_previous, mut from_current) = ([0.0; ROW], [0.0; ROW]);
        widen(block.previous[TILE * j..].as_flattened(), &mut from_previous);
        widen(block.current[TILE * j..].as_flattened(), &mut from_current);
        let (row, is_reported) = merged(&from_previous, &from_current, rule);
        block.merged[TILE * j..][..TILE].copy_from_slice(&narrowed(&row));
        mask |= is_reported << (TILE * j);
    }
    mask
}

/// See [`super::Sampled::sample_pixels`].
#[inline(always)]
pub(super) fn sample_pixels(source: Source<'_, Pixel>, at: &Positions, wanted: u64, out: &mut [Pixel; BLOCK]) {
    for (j, out) in out.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let wanted = (wanted >> (TILE * j)) as u8;
        if wanted == 0 {
            continue;
        }
        // A row of eight pixels: their column sums and horizontal weights, per tap.
        let mut sums = [[0.0; ROW]; TAPS];
        let (mut low, mut high, mut across) = (sums, sums, sums);
        for x in 0..TILE {
            let at = [at.x[TILE * j + x], at.y[TILE * j + x]];
            let rows = around(&source, at);
            let [weights, down] = weights(at);
            let of_pixel = columns(&rows, down);
            for tap in 0..TAPS {
                for c in 0..4 {
                    sums[tap][4 * x + c] = of_pixel.0[4 * tap + c];
                    low[tap][4 * x + c] = of_pixel.1[4 * tap + c];
                    high[tap][4 * x + c] = of_pixel.2[4 * tap + c];
                    across[tap][4 * x + c] = weights[tap];
                }
            }
        }
        let mut values = [0.0; ROW];
        for (i, value) in values.iter_mut().enumerate() {
            let [s, l, h, w] = [&sums, &low, &high, &across].map(|taps| std::array::from_fn(|tap| taps[tap][i]));
            *value = sample(s, l, h, w);
        }
        for (x, (out, value)) in out.iter_mut().zip(narrowed(&values)).enumerate() {
            *out = if wanted >> x & 1 == 1 { value } else { *out };
        }
    }
}

/// The 6x6 pixels around a position in single precision.
#[inline(always)]
fn around(source: &Source<'_, Pixel>, at: [i32; 2]) -> [[f32; 4 * TAPS]; TAPS] {
    let mut rows = [[0.0; 4 * TAPS]; TAPS];
    if let Some(pixels) = inside(source, at) {
        for (row, pixels) in rows.iter_mut().zip(pixels) {
            widen(pixels.as_flattened(), row);
        }
        rows
    } else {
        around_edge(source, at)
    }
}

#[cold]
#[inline(never)]
fn around_edge(source: &Source<'_, Pixel>, at: [i32; 2]) -> [[f32; 4 * TAPS]; TAPS] {
    let mut rows = [[0.0; 4 * TAPS]; TAPS];
    for (row, taps) in rows.iter_mut().zip(&taps(source, at, [f16::ZERO; 4]).0) {
        widen(taps.as_flattened(), row);
    }
    rows
}

/// The same as half floats, if all of them are inside the picture.
#[inline(always)]
fn inside<'a>(source: &Source<'a, Pixel>, at: [i32; 2]) -> Option<[&'a [Pixel; TAPS]; TAPS]> {
    let [x, y] = at.map(|v| usize::try_from((v >> 6) - BEFORE).ok());
    let (x, y) = (x?, y?);
    let row = |j: usize| {
        let row = source.pixels.get((y + j) * source.width..)?.get(..source.width)?;
        row.get(x..).and_then(|rest| rest.first_chunk())
    };
    Some([row(0)?, row(1)?, row(2)?, row(3)?, row(4)?, row(5)?])
}

/// Samples a tile, rounded to half floats, row by row.
#[inline(always)]
fn sampled(TileSource { picture, at }: TileSource<'_, Pixel>, out: &mut [[f32; ROW]; TILE]) {
    let mut taps = [[[f16::ZERO; 4]; SPAN]; SPAN];
    picture.clamped(at.map(|v| (v >> 6) - BEFORE), &mut taps);
    let [across, down] = weights(at);
    let mut rows = [[0.0; 4 * SPAN]; SPAN];
    for (row, taps) in rows.iter_mut().zip(&taps) {
        widen(taps.as_flattened(), row);
    }
    for (j, out) in out.iter_mut().enumerate() {
        let (sums, low, high) = columns(rows[j..].first_chunk().expect("a tile has thirteen rows"), down);
        for (i, out) in out.iter_mut().enumerate() {
            let [s, l, h] = [&sums, &low, &high].map(|columns| std::array::from_fn(|tap| columns[i + 4 * tap]));
            *out = widened(nearest(sample(s, l, h, across)));
        }
    }
}

/// Weighted sums of six rows, with minimum and maximum of the inner four.
#[inline(always)]
fn columns<const N: usize>(rows: &[[f32; N]; TAPS], down: [f32; TAPS]) -> ([f32; N], [f32; N], [f32; N]) {
    let [p, q, r, s, t, u] = rows;
    let (mut sums, mut low, mut high) = ([0.0; N], [0.0; N], [0.0; N]);
    for i in 0..N {
        sums[i] = weighted([p[i], q[i], r[i], s[i], t[i], u[i]], down);
        low[i] = smaller(smaller(q[i], r[i]), smaller(s[i], t[i]));
        high[i] = larger(larger(q[i], r[i]), larger(s[i], t[i]));
    }
    (sums, low, high)
}

/// Weighted sum of six columns, clamped to the range of the inner four.
#[inline(always)]
fn sample(sums: [f32; TAPS], low: [f32; TAPS], high: [f32; TAPS], across: [f32; TAPS]) -> f32 {
    let low = smaller(smaller(low[1], low[2]), smaller(low[3], low[4]));
    let high = larger(larger(high[1], high[2]), larger(high[3], high[4]));
    // Adding 0 turns -0 into 0.
    smaller(larger(weighted(sums, across), low), high) + 0.0
}

/// In the order of the taps.
#[inline(always)]
fn weighted(p: [f32; TAPS], w: [f32; TAPS]) -> f32 {
    ((((p[0] * w[0] + p[1] * w[1]) + p[2] * w[2]) + p[3] * w[3]) + p[4] * w[4]) + p[5] * w[5]
}

/// Merges a row of pixels, without rounding; also returns the bits of those to report.
#[inline(always)]
fn merged(from_previous: &[f32; ROW], from_current: &[f32; ROW], rule: &MergeRule) -> ([f32; ROW], u64) {
    let share = f32::from(rule.share()) / 128.0;
    let nearer = if rule.nearer_is_current { from_current } else { from_previous };
    let [max_equal_difference, doubt_threshold] = [rule.max_equal_difference, rule.doubt_threshold].map(f32::from);
    let (mut is_mixed, mut is_reported) = ([0; ROW], [0; ROW]);
    let mut mixed = [0.0; ROW];
    for i in 0..ROW {
        let (a, b) = (from_previous[i], from_current[i]);
        let (apart, scale) = ((b - a).abs() * 255.0, larger(a.abs(), b.abs()) + 0.25);
        is_mixed[i] = u32::from(apart > max_equal_difference * scale);
        is_reported[i] = u32::from(apart > doubt_threshold * scale);
        mixed[i] = a + (b - a) * share;
    }
    let (mut row, mut mask) = (*nearer, 0);
    for x in 0..TILE {
        let any = |flags: &[u32; ROW]| flags[4 * x] | flags[4 * x + 1] | flags[4 * x + 2] | flags[4 * x + 3];
        for i in 4 * x..4 * x + 4 {
            row[i] = if any(&is_mixed) != 0 { mixed[i] } else { row[i] };
        }
        mask |= u64::from(any(&is_reported)) << x;
    }
    (row, mask)
}

/// Horizontal and vertical weights of a position, as fractions of 1.
#[inline(always)]
fn weights(at: [i32; 2]) -> [[f32; TAPS]; 2] {
    let mut weights = [[0.0; TAPS]; 2];
    for (weights, v) in weights.iter_mut().zip(at) {
        for (single, &weight) in weights.iter_mut().zip(&SINC[(v & 63) as usize]) {
            *single = f32::from(weight) / 128.0;
        }
    }
    weights
}

/// Half floats in finite single precision.
#[inline(always)]
fn widen<const N: usize>(halves: &[f16], singles: &mut [f32; N]) {
    for (single, half) in singles.iter_mut().zip(halves) {
        *single = finite(half.to_bits());
    }
}

/// Single precision of a half float's bits; NaN becomes 0, infinity the largest finite half float.
#[inline(always)]
fn finite(bits: u16) -> f32 {
    const INFINITE: u16 = 0x7c00;
    let magnitude = bits & 0x7fff;
    let bounded = if magnitude == INFINITE { bits - 1 } else { bits };
    widened(if magnitude > INFINITE { 0 } else { bounded })
}

/// Bits of the nearest half float of a value within its range; ties to even.
#[inline(always)]
fn nearest(value: f32) -> u16 {
    const LEAST_NORMAL: u32 = (127 - 14) << 23;
    const HALF: f32 = 0.5;
    let sign = (value.to_bits() >> 16) & 0x8000;
    let magnitude = value.to_bits() & 0x7fff_ffff;
    // Rounds to ten bits of mantissa and changes the exponent's bias.
    let normal = (magnitude.wrapping_sub(112 << 23) + 0xfff + (magnitude >> 13 & 1)) >> 13;
    // Floats around 0.5 have the spacing of denormal half floats, so that adding rounds.
    let small = (f32::from_bits(magnitude) + HALF).to_bits().wrapping_sub(HALF.to_bits());
    (sign | if magnitude < LEAST_NORMAL { small } else { normal }) as u16
}

/// Rounds a row to half floats.
#[inline(always)]
fn narrowed(row: &[f32; ROW]) -> [Pixel; TILE] {
    let mut bits = [0; ROW];
    for (bits, &single) in bits.iter_mut().zip(row) {
        *bits = nearest(single);
    }
    bytemuck::must_cast(bits)
}

/// Minimum of two values that are not NaN.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Maximum of two values that are not NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_float_conversions_follow_ieee_754() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            let expected = if half.is_nan() { 0.0 } else { half.to_f32().clamp(-65504.0, 65504.0) };
            assert_eq!(finite(bits).to_bits(), expected.to_bits(), "{half:?}");
            if half.is_finite() {
                // The value itself, half way to the next, and the floats beside that.
                let next = f16::from_bits(bits + 1).to_f32();
                let halfway = half.to_f32() + (next.clamp(-65504.0, 65504.0) - half.to_f32()) / 2.0;
                for value in [half.to_f32(), halfway, halfway.next_up(), halfway.next_down()] {
                    assert_eq!(nearest(value), f16::from_f32(value).to_bits(), "{value}");
                }
            }
        }
    }
}
