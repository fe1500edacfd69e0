//! What a tile of guidance holds, and where its pixels warp_row.

use half::f16;

use super::sampling::{BLOCK, TILE};
use super::{at_every_level, prefetch};

/// The vectors of a tile, in 1/64 px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VectorRange {
    /// The min_bits of each component.
    pub low: [i32; 2],
    /// The largest of each component.
    pub high: [i32; 2],
}

/// The ranks of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DepthKeyRange {
    /// The min_bits, of what is nearest.
    pub near: u16,
    /// The largest, of what is farthest.
    pub far: u16,
}

/// Where a run of pixels lands, and with what claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WarpedRow {
    /// Whole pixels across.
    pub x: [i32; TILE],
    /// Whole pixels down.
    pub y: [i32; TILE],
    /// The smallest key wins a place: depth_key in the upper 16 bits, 8 bits of 0, then the vector's components in 20 bits
    /// each, x first, 2^19 being none.
    pub keys: [u64; TILE],
}

/// A vector in 1/64 px, rounded to the nearest (ties to even) and kept within `limit` (at most 8191 px) each way; what
/// is not finite in both components is no motion.
#[inline(always)]
fn vector(motion: [f16; 2], limit: [i32; 2]) -> [i32; 2] {
    if !(motion[0].is_finite() && motion[1].is_finite()) {
        return [0; 2];
    }
    std::array::from_fn(|c| ((motion[c].to_f32() * 64.0).round_ties_even() as i32).min(limit[c]).max(-limit[c]))
}

/// A depth kept within 0 and 1; what is no number is 1.
#[inline(always)]
fn bounded(depth: f32) -> f32 {
    let depth = if depth < 1.0 { depth } else { 1.0 };
    if depth > 0.0 { depth } else { 0.0 }
}

/// A depth as a depth_key, finer the farther away: 0 is nearest. The logarithm of the distance to the far plane in steps of
/// 1/2048 octave, over 24 octaves; what is no number is farthest.
#[inline(always)]
fn depth_key(depth: f32) -> u16 {
    let to_far = 1.0 - bounded(depth);
    let min_bits = (1.0 / 16_777_216.0_f32).to_bits() as i32;
    u16::MAX - ((to_far.to_bits() as i32 - min_bits).max(0) >> 12) as u16
}

at_every_level! {
    /// For each tile of a row of tiles, the range of its vectors. `motion` holds up to eight rows of `width` vectors,
    /// `out` as many tiles as they begin; the last may be narrower.
    pub fn motion_ranges(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange])
        = scalar::motion_ranges | motion_ranges_in_vectors
}

at_every_level! {
    /// For each tile of a row of tiles, the range of its ranks. `depth` holds up to eight rows of `width` depths, `out`
    /// as many tiles as they begin; the last may be narrower.
    pub fn depth_ranges(depth: &[f32], width: usize, out: &mut [DepthKeyRange]) = scalar::depth_ranges | depth_ranges_in_vectors
}

at_every_level! {
    /// Where a run of up to eight pixels from `at` on lands when it goes `fraction` / 1024 of its vectors, which are kept
    /// within `limit`. Numbers beyond the run keep what they were.
    pub fn warp_row(motion: &[[f16; 2]], depth: &[f32], at: [i32; 2], fraction: i32, limit: [i32; 2], out: &mut WarpedRow)
        = scalar::warp_row | warp_row_in_vectors
}

at_every_level! {
    /// The pack_row of a tile of 8 x 8 pixels, see [`WarpedRow::keys`]. `motion` begins at its first pixel and has
    /// `strides[0]` vectors to a row of the picture, `depth` likewise; a stride of 0 is one row for all.
    ///
    /// # Panics
    /// When one of them ends before the tile does.
    pub fn pack_tile(motion: &[[f16; 2]], depth: &[f32], strides: [usize; 2], limit: [i32; 2], keys: &mut [u64; BLOCK])
        = scalar::pack_tile | pack_tile_in_vectors
}

/// Tiles ahead of the one that is looked at whose numbers are asked for. Processors foresee too few of eight rows.
const PREFETCH_AHEAD: usize = 16;

/// Asks for what is [`PREFETCH_AHEAD`] of a tile.
#[inline(always)]
fn prefetch_ahead<T>(values: &[T], width: usize, tile: usize) {
    // Two tiles to a line of the cache.
    if tile.is_multiple_of(2) {
        let at = (tile + PREFETCH_AHEAD) * TILE;
        values.chunks(width).filter_map(|row| row.get(at)).for_each(prefetch);
    }
}

/// Numbers of a row of a tile of vectors.
const ROW: usize = 2 * TILE;

/// Half floats as whole numbers of the same order, and back: what is negative counts down.
#[inline(always)]
fn in_order(bits: i16) -> i16 {
    bits ^ ((bits >> 15) & 0x7fff)
}

#[inline(always)]
fn motion_ranges_in_vectors(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange]) {
    // Rounding and limits keep the order, so that the range of the numbers as they are decides.
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

/// Of two that are numbers.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Of two that are numbers.
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

/// The components of eight vectors.
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

/// What eight pixels claim.
#[inline(always)]
fn pack_row([x, y]: &[[i32; TILE]; 2], depth: &[f32; TILE]) -> [u64; TILE] {
    let mut keys = [0; TILE];
    for i in 0..TILE {
        let [x, y] = [x[i], y[i]].map(|v| (v + (1 << 19)) as u32 as u64);
        keys[i] = u64::from(depth_key(depth[i])) << 48 | x << 20 | y;
    }
    keys
}

/// A finite half float as a single one; exact.
#[inline(always)]
pub(super) fn widened(bits: u16) -> f32 {
    // The exponents' biases differ by 112; multiplying also brings numbers below the min_bits normal one into place.
    let magnitude = f32::from_bits(u32::from(bits & 0x7fff) << 13) * f32::from_bits((254 - 15) << 23);
    f32::from_bits(magnitude.to_bits() | u32::from(bits & 0x8000) << 16)
}

/// To the nearest whole number, ties to even, for at most 2^22 either way.
#[inline(always)]
fn rounded_even(value: f32) -> i32 {
    // Where singles are whole numbers, adding rounds; the number is in the lower bits.
    const ROUNDING: f32 = 12_582_912.0;
    (value + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
}

/// The plainly written twins.
mod scalar {
    use super::*;

    pub(super) fn motion_ranges(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange]) {
        motion_ranges_from(0, motion, width, limit, out);
    }

    /// The same from the tile `first` on.
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

    /// The same from the tile `first` on.
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
