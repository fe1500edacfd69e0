//! What a tile of guidance holds, and where its pixels land.

use half::f16;

use super::at_every_level;
use super::sampled::TILE;

/// The vectors of a tile, in 1/64 px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VectorRange {
    /// The least of each component.
    pub low: [i32; 2],
    /// The largest of each component.
    pub high: [i32; 2],
}

/// The ranks of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RankRange {
    /// The least, of what is nearest.
    pub near: u16,
    /// The largest, of what is farthest.
    pub far: u16,
}

/// Where a run of pixels lands, and with what claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Landing {
    /// Whole pixels across.
    pub x: [i32; TILE],
    /// Whole pixels down.
    pub y: [i32; TILE],
    /// The smallest key wins a place: rank in the upper 16 bits, 8 bits of 0, then the vector's components in 20 bits
    /// each, x first, 2^19 being none.
    pub keys: [u64; TILE],
}

/// A vector in 1/64 px, rounded to the nearest (ties to even) and kept within `limit` (at most 8191 px) each way; what
/// is not finite in both components is no motion.
#[inline(always)]
pub(super) fn vector(motion: [f16; 2], limit: [i32; 2]) -> [i32; 2] {
    if !(motion[0].is_finite() && motion[1].is_finite()) {
        return [0; 2];
    }
    std::array::from_fn(|c| ((motion[c].to_f32() * 64.0).round_ties_even() as i32).clamp(-limit[c], limit[c]))
}

/// A depth as a rank, finer the farther away: 0 is nearest. The logarithm of the distance to the far plane in steps of
/// 1/2048 octave, over 24 octaves; what is no number is farthest.
#[inline(always)]
pub(super) fn rank(depth: f32) -> u16 {
    let depth = if depth < 1.0 { depth } else { 1.0 };
    let to_far = 1.0 - if depth > 0.0 { depth } else { 0.0 };
    let least = (1.0 / 16_777_216.0_f32).to_bits() as i32;
    u16::MAX - ((to_far.to_bits() as i32 - least).max(0) >> 12) as u16
}

at_every_level! {
    /// For each tile of a row of tiles, the range of its vectors. `motion` holds up to eight rows of `width` vectors,
    /// `out` as many tiles as they begin; the last may be narrower.
    pub fn motion_ranges(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange])
        = motion_ranges_scalar | motion_ranges_scalar
}

at_every_level! {
    /// For each tile of a row of tiles, the range of its ranks. `depth` holds up to eight rows of `width` depths, `out`
    /// as many tiles as they begin; the last may be narrower.
    pub fn depth_ranges(depth: &[f32], width: usize, out: &mut [RankRange]) = depth_ranges_scalar | depth_ranges_scalar
}

at_every_level! {
    /// Where a run of up to eight pixels from `at` on lands when it goes `reach` / 1024 of its vectors, which are kept
    /// within `limit`. Numbers beyond the run keep what they were.
    pub fn land(motion: &[[f16; 2]], depth: &[f32], at: [i32; 2], reach: i32, limit: [i32; 2], out: &mut Landing)
        = land_scalar | land_scalar
}

fn motion_ranges_scalar(motion: &[[f16; 2]], width: usize, limit: [i32; 2], out: &mut [VectorRange]) {
    for (i, range) in out.iter_mut().enumerate() {
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

fn depth_ranges_scalar(depth: &[f32], width: usize, out: &mut [RankRange]) {
    for (i, range) in out.iter_mut().enumerate() {
        *range = RankRange { near: u16::MAX, far: 0 };
        for row in depth.chunks(width) {
            for &depth in &row[i * TILE..width.min((i + 1) * TILE)] {
                let rank = rank(depth);
                *range = RankRange { near: range.near.min(rank), far: range.far.max(rank) };
            }
        }
    }
}

fn land_scalar(motion: &[[f16; 2]], depth: &[f32], at: [i32; 2], reach: i32, limit: [i32; 2], out: &mut Landing) {
    for (i, (&motion, &depth)) in motion.iter().zip(depth).enumerate().take(TILE) {
        let vector = vector(motion, limit);
        let landed = |c: usize, from: i32| (64 * from + ((vector[c] * reach + 512) >> 10) + 32) >> 6;
        (out.x[i], out.y[i]) = (landed(0, at[0] + i as i32), landed(1, at[1]));
        let [x, y] = vector.map(|v| (v + (1 << 19)) as u64);
        out.keys[i] = u64::from(rank(depth)) << 48 | x << 20 | y;
    }
}
