//! Conversion of guidance to splat keys, and ranges of motion and depth keys per tile.

use half::f16;

use super::sampling::{BLOCK, TILE};
use super::{at_every_level, prefetch};

/// Range of a tile's motion vectors, in 1/64 px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VectorRange {
    /// Minimum of each component.
    pub low: [i32; 2],
    /// Maximum of each component.
    pub high: [i32; 2],
}

/// Range of a tile's depth keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DepthKeyRange {
    /// The smallest, nearest one.
    pub near: u16,
    /// The largest, farthest one.
    pub far: u16,
}

/// Destinations and splat keys of up to eight adjacent pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WarpedRow {
    /// Column of the nearest pixel.
    pub x: [i32; TILE],
    /// Row of the nearest pixel.
    pub y: [i32; TILE],
    /// Splat keys: depth key in the upper 16 bits, 8 bits of 0, then x and y of the motion vector in 20 bits each, with
    /// an offset of 2^19.
    pub keys: [u64; TILE],
}

/// Motion vector in 1/64 px, rounded to the nearest (ties to even) and clamped to `limit` (at most 8191 px); 0 if a
/// component is not finite.
#[inline(always)]
fn vector(motion: [f16; 2], limit: [i32; 2]) -> [i32; 2] {
    if !(motion[0].is_finite() && motion[1].is_finite()) {
        return [0; 2];
    }
    std::array::from_fn(|c| ((motion[c].to_f32() * 64.0).round_ties_even() as i32).min(limit[c]).max(-limit[c]))
}

/// Depth clamped to 0..1; NaN becomes 1.
#[inline(always)]
fn bounded(depth: f32) -> f32 {
    let depth = if depth < 1.0 { depth } else { 1.0 };
    if depth > 0.0 { depth } else { 0.0 }
}

/// Depth key, 0 nearest, with higher resolution for farther depths: the logarithm of `1 - depth` in steps of 1/2048
/// octave, over 24 octaves. NaN is farthest.
#[inline(always)]
fn depth_key(depth: f32) -> u16 {
    let to_far = 1.0 - bounded(depth);
    let min_bits = (1.0 / 16_777_216.0_f32).to_bits() as i32;
    u16::MAX - ((to_far.to_bits() as i32 - min_bits).max(0) >> 12) as u16
}

at_every_level! {
    /// Motion range of each tile of a row of tiles. `motion` has up to eight rows of `width` vectors, `out` one element
    /// per tile; the last tile may be narrower.
    pub fn motion_ranges(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange])
        = scalar::motion_ranges | motion_ranges_in_vectors
}

at_every_level! {
    /// Depth key range of each tile of a row of tiles. `depth` has up to eight rows of `width` values, `out` one
    /// element per tile; the last tile may be narrower.
    pub fn depth_ranges(depth: &[f32], width: usize, out: &mut [DepthKeyRange]) = scalar::depth_ranges | depth_ranges_in_vectors
}

at_every_level! {
    /// Warps up to eight adjacent pixels, the first at `at`, by `fraction` / 1024 of their motion vectors, which are
    /// clamped to `limit`. Elements beyond the pixels are unchanged.
    pub fn warp_row(motion: &[[f16; 2]], depth: &[f32], at: [i32; 2], fraction: i32, limit: [i32; 2], out: &mut WarpedRow)
        = scalar::warp_row | warp_row_in_vectors
}

at_every_level! {
    /// Splat keys of a tile of 8x8 pixels, see [`WarpedRow::keys`]. `motion` starts at its first pixel and has rows of
    /// `strides[0]` vectors, `depth` likewise; a stride of 0 repeats one row.
    ///
    /// # Panics
    /// If a slice ends before the tile does.
    pub fn pack_tile(motion: &[[f16; 2]], depth: &[f32], strides: [usize; 2], limit: [i32; 2], keys: &mut [u64; BLOCK])
        = scalar::pack_tile | pack_tile_in_vectors
}

/// Tiles whose values are prefetched ahead of the current one: hardware prefetchers do not follow eight rows.
const PREFETCH_AHEAD: usize = 16;

/// Prefetches the tile [`PREFETCH_AHEAD`] tiles after this one.
#[inline(always)]
fn prefetch_ahead<T>(values: &[T], width: usize, tile: usize) {
    // Two tiles per cache line.
    if tile.is_multiple_of(2) {
        let at = (tile + PREFETCH_AHEAD) * TILE;
        values.chunks(width).filter_map(|row| row.get(at)).for_each(prefetch);
    }
}

/// Components of a row of a tile.
const ROW: usize = 2 * TILE;

/// Maps half-float bits to integers of the same order, and back.
#[inline(always)]
fn in_order(bits: i16) -> i16 {
    bits ^ ((bits >> 15) & 0x7fff)
}

#[inline(always)]
fn motion_ranges_in_vectors(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange]) {
    // Rounding and clamping are monotonic, so that the extremes can be found before.
    for i in 0..out.len() {
        prefetch_ahead(motion, width, i);
        let mut low = [i16::MAX; ROW];
        let mut high = [i16::MIN; ROW];
        for row in motion.chunks(width) {
            let Some(row) = row.get(i * TILE..).and_then(|row| row.first_chunk::<TILE>()) else {
                return scalar::motion_ranges_from(i, motion, width, limit, out);
            };
            let bits: [u32; TILE] = bytemuck::must_cast(*row);
            let finite = bits.map(|v| {
                let is_finite = (v & 0x7c00 != 0x7c00) & (v & 0x7c00_0000 != 0x7c00_0000);
                if is_finite { v } else { 0 }
            });
            let ordered = bytemuck::must_cast::<_, [i16; ROW]>(finite).map(in_order);
            low = std::array::from_fn(|k| low[k].min(ordered[k]));
            high = std::array::from_fn(|k| high[k].max(ordered[k]));
        }
        let of = |ends: [i16; ROW], better: fn(i16, i16) -> i16| -> [i32; 2] {
            let half: [i16; 8] = std::array::from_fn(|k| better(ends[k], ends[k + 8]));
            let quarter: [i16; 4] = std::array::from_fn(|k| better(half[k], half[k + 4]));
            std::array::from_fn(|c| {
                let end = in_order(better(quarter[c], quarter[c + 2])) as u16;
                rounded_even(widened(end) * 64.0).min(limit[c]).max(-limit[c])
            })
        };
        out[i] = VectorRange { low: of(low, i16::min), high: of(high, i16::max) };
    }
}

#[inline(always)]
fn depth_ranges_in_vectors(depth: &[f32], width: usize, out: &mut [DepthKeyRange]) {
    for i in 0..out.len() {
        prefetch_ahead(depth, width, i);
        let (mut near, mut far) = ([1.0_f32; TILE], [0.0_f32; TILE]);
        for row in depth.chunks(width) {
            let Some(depths) = row.get(i * TILE..).and_then(|row| row.first_chunk::<TILE>()) else {
                return scalar::depth_ranges_from(i, depth, width, out);
            };
            for x in 0..TILE {
                let depth = bounded(depths[x]);
                near[x] = smaller(near[x], depth);
                far[x] = larger(far[x], depth);
            }
        }
        let of = |ends: [f32; TILE], better: fn(f32, f32) -> f32| {
            let half: [f32; 4] = std::array::from_fn(|x| better(ends[x], ends[x + 4]));
            depth_key(better(better(half[0], half[1]), better(half[2], half[3])))
        };
        out[i] = DepthKeyRange { near: of(near, smaller), far: of(far, larger) };
    }
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

#[inline(always)]
fn warp_row_in_vectors(
    motion: &[[f16; 2]],
    depth: &[f32],
    at: [i32; 2],
    fraction: i32,
    limit: [i32; 2],
    out: &mut WarpedRow,
) {
    let (Some(motion), Some(depth)) = (motion.first_chunk::<TILE>(), depth.first_chunk::<TILE>()) else {
        return scalar::warp_row(motion, depth, at, fraction, limit, out);
    };
    let [x, y] = components(motion, limit);
    for i in 0..TILE {
        let warped = |vector: i32, from: i32| (64 * from + ((vector * fraction + 512) >> 10) + 32) >> 6;
        (out.x[i], out.y[i]) = (warped(x[i], at[0] + i as i32), warped(y[i], at[1]));
    }
    out.keys = pack_row(&[x, y], depth);
}

#[inline(always)]
fn pack_tile_in_vectors(
    motion: &[[f16; 2]],
    depth: &[f32],
    strides: [usize; 2],
    limit: [i32; 2],
    keys: &mut [u64; BLOCK],
) {
    for (j, keys) in keys.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let motion = motion[j * strides[0]..].first_chunk().expect("a row of eight");
        let depth = depth[j * strides[1]..].first_chunk().expect("a row of eight");
        *keys = pack_row(&components(motion, limit), depth);
    }
}

/// Components of eight motion vectors.
#[inline(always)]
fn components(motion: &[[f16; 2]; TILE], limit: [i32; 2]) -> [[i32; TILE]; 2] {
    let (mut x, mut y) = ([0; TILE], [0; TILE]);
    for i in 0..TILE {
        let bits = motion[i].map(f16::to_bits);
        let is_finite = (bits[0] & 0x7c00 != 0x7c00) & (bits[1] & 0x7c00 != 0x7c00);
        let rounded = |bits: u16, limit: i32| rounded_even(widened(bits) * 64.0).min(limit).max(-limit);
        x[i] = if is_finite { rounded(bits[0], limit[0]) } else { 0 };
        y[i] = if is_finite { rounded(bits[1], limit[1]) } else { 0 };
    }
    [x, y]
}

/// Splat keys of eight pixels.
#[inline(always)]
fn pack_row([x, y]: &[[i32; TILE]; 2], depth: &[f32; TILE]) -> [u64; TILE] {
    let mut keys = [0; TILE];
    for i in 0..TILE {
        let [x, y] = [x[i], y[i]].map(|v| (v + (1 << 19)) as u32 as u64);
        keys[i] = u64::from(depth_key(depth[i])) << 48 | x << 20 | y;
    }
    keys
}

/// Converts a finite half float to single precision; exact.
#[inline(always)]
pub(super) fn widened(bits: u16) -> f32 {
    // The exponents' biases differ by 112; the multiplication also normalises denormal values.
    let magnitude = f32::from_bits(u32::from(bits & 0x7fff) << 13) * f32::from_bits((254 - 15) << 23);
    f32::from_bits(magnitude.to_bits() | u32::from(bits & 0x8000) << 16)
}

/// Rounds to the nearest integer, ties to even, for |value| up to 2^22.
#[inline(always)]
fn rounded_even(value: f32) -> i32 {
    // Adding 1.5 * 2^23 rounds to the nearest integer, which is then in the low bits.
    const ROUNDING: f32 = 12_582_912.0;
    (value + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
}

/// The scalar versions.
mod scalar {
    use super::*;

    pub(super) fn motion_ranges(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange]) {
        motion_ranges_from(0, motion, width, limit, out);
    }

    /// The same, starting at tile `first`.
    pub(super) fn motion_ranges_from(
        first: usize,
        motion: &[[f16; 2]],
        width: usize,
        limit: [i32; 2],
        out: &mut [VectorRange],
    ) {
        for (i, range) in out.iter_mut().enumerate().skip(first) {
            *range = VectorRange { low: [i32::MAX; 2], high: [i32::MIN; 2] };
            for row in motion.chunks(width) {
                for &motion in &row[i * TILE..width.min((i + 1) * TILE)] {
                    let vector = vector(motion, limit);
                    range.low = std::array::from_fn(|c| range.low[c].min(vector[c]));
                    range.high = std::array::from_fn(|c| range.high[c].max(vector[c]));
                }
            }
        }
    }

    pub(super) fn depth_ranges(depth: &[f32], width: usize, out: &mut [DepthKeyRange]) {
        depth_ranges_from(0, depth, width, out);
    }

    /// The same, starting at tile `first`.
    pub(super) fn depth_ranges_from(first: usize, depth: &[f32], width: usize, out: &mut [DepthKeyRange]) {
        for (i, range) in out.iter_mut().enumerate().skip(first) {
            *range = DepthKeyRange { near: u16::MAX, far: 0 };
            for row in depth.chunks(width) {
                for &depth in &row[i * TILE..width.min((i + 1) * TILE)] {
                    let depth_key = depth_key(depth);
                    *range = DepthKeyRange { near: range.near.min(depth_key), far: range.far.max(depth_key) };
                }
            }
        }
    }

    pub(super) fn pack_tile(
        motion: &[[f16; 2]],
        depth: &[f32],
        strides: [usize; 2],
        limit: [i32; 2],
        keys: &mut [u64; BLOCK],
    ) {
        let mut warped_row = WarpedRow::default();
        for (j, keys) in keys.chunks_mut(TILE).enumerate() {
            let (motion, depth) = (&motion[j * strides[0]..][..TILE], &depth[j * strides[1]..][..TILE]);
            warp_row(motion, depth, [0; 2], 0, limit, &mut warped_row);
            keys.copy_from_slice(&warped_row.keys);
        }
    }

    pub(super) fn warp_row(
        motion: &[[f16; 2]],
        depth: &[f32],
        at: [i32; 2],
        fraction: i32,
        limit: [i32; 2],
        out: &mut WarpedRow,
    ) {
        for (i, (&motion, &depth)) in motion.iter().zip(depth).enumerate().take(TILE) {
            let vector = vector(motion, limit);
            let warped = |c: usize, from: i32| (64 * from + ((vector[c] * fraction + 512) >> 10) + 32) >> 6;
            (out.x[i], out.y[i]) = (warped(0, at[0] + i as i32), warped(1, at[1]));
            let [x, y] = vector.map(|v| (v + (1 << 19)) as u64);
            out.keys[i] = u64::from(depth_key(depth)) << 48 | x << 20 | y;
        }
    }
}
