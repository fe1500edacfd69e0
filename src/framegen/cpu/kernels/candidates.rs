//! Kernels that find candidates for the holes of a tile, eight pixels at a time.

use std::ops::{BitAnd, BitXor};

use super::super::hole_filling::SEARCH_RADIUS;
use super::super::splat_key::{EMPTY, Key, depth_key};
use super::at_every_level;
use super::sampling::{BLOCK, TILE};

/// Left, right, above and below.
pub(in super::super) const SIDES: usize = 4;

/// The first key outside each edge of a tile: per row for left and right, per column for above and below.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct OutsideCandidates {
    /// [`EMPTY`] if there is none within the search radius.
    pub(in super::super) keys: [[Key; TILE]; SIDES],
    /// Position along the row or column relative to the tile's first pixel, negative (wrapped) before it.
    pub(in super::super) position: [[u32; TILE]; SIDES],
    /// Luma at that position, if an anchor shows it.
    pub(in super::super) lumas: [[f32; TILE]; SIDES],
}

impl OutsideCandidates {
    pub(in super::super) const NONE: Self =
        Self { keys: [[EMPTY; TILE]; SIDES], position: [[0; TILE]; SIDES], lumas: [[0.0; TILE]; SIDES] };
}

/// The nearest key in each direction of each pixel. Undefined in rows without holes.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Candidates {
    /// [`EMPTY`] if there is none within the search radius.
    pub(in super::super) keys: [[Key; BLOCK]; SIDES],
    /// Distance in pixels.
    pub(in super::super) distance: [[u32; BLOCK]; SIDES],
}

impl Candidates {
    pub(in super::super) const NONE: Self = Self { keys: [[EMPTY; BLOCK]; SIDES], distance: [[0; BLOCK]; SIDES] };
}

/// Cost of each candidate: the smallest is the best, `u32::MAX` is none.
pub(in super::super) type Costs = [[u32; BLOCK]; SIDES];

at_every_level! {
    /// Pixels with a key, as bits `8 j + i`.
    pub(in super::super) fn covered_pixels(keys: &[Key; BLOCK]) -> u64 = scalar::covered_pixels | covered_pixels_in_vectors
}

at_every_level! {
    /// Finds the nearest key in each direction of the `holes` of a tile (bit `8 j + i`); `covered` has the bits of
    /// pixels with a key.
    pub(in super::super) fn find(own: &[Key; BLOCK], covered: u64, holes: u64, outside: &OutsideCandidates, candidates: &mut Candidates)
        = scalar::find | find_in_vectors
}

at_every_level! {
    /// Costs of candidates for holes that an anchor shows: luma difference plus distance, then depth, farthest first.
    pub(in super::super) fn cost_by_luma(
        candidates: &Candidates, lumas: &[f32; BLOCK], covered: u64, holes: u64, outside: &OutsideCandidates, costs: &mut Costs,
    ) = scalar::cost_by_luma | cost_by_luma_in_vectors
}

at_every_level! {
    /// Costs of candidates for holes that no anchor shows: depth, farthest first, then distance.
    pub(in super::super) fn cost_by_depth(candidates: &Candidates, costs: &mut Costs)
        = cost_by_depth_in_vectors | cost_by_depth_in_vectors
}

/// Depth key, farthest first.
#[inline(always)]
fn far_first_key(key: Key) -> u32 {
    u32::from(u16::MAX - depth_key(key))
}

#[inline(always)]
fn luma_cost(key: Key, distance: u32, luma: f32, candidate_luma: f32) -> u32 {
    let luma_difference = (luma - candidate_luma).abs();
    let cost = (floor(if luma_difference < 255.0 { luma_difference } else { 255.0 }) as u32).wrapping_add(distance)
        << 16
        | far_first_key(key);
    if key == EMPTY { u32::MAX } else { cost }
}

/// Largest integer that is not greater than `v`, for |v| up to 2^22. A conversion would saturate, which does not
/// vectorise.
#[inline(always)]
pub(in super::super) fn floor(v: f32) -> i32 {
    // Adding 1.5 * 2^23 rounds to the nearest integer, which is then in the low bits.
    const ROUNDING: f32 = 12_582_912.0;
    let rounded = v + ROUNDING;
    rounded.to_bits() as i32 - ROUNDING.to_bits() as i32 - i32::from(rounded - ROUNDING > v)
}

/// Packs eight bytes, each 0 or 1, into bits.
#[inline(always)]
pub(in super::super) fn pack_bits(row: [u8; TILE]) -> u64 {
    // The multiplication moves each byte's bit to its own position in the highest byte.
    u64::from_le_bytes(row).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// Combines one word per column into the bits of a tile.
#[inline(always)]
pub(in super::super) fn combine_columns(columns: [u64; TILE]) -> u64 {
    columns.into_iter().zip(0..).fold(0, |combine_columns, (bits, column)| combine_columns | bits << column)
}

/// Row `j` of a tile.
#[inline(always)]
fn row<T>(values: &[T; BLOCK], j: usize) -> &[T; TILE] {
    values[j * TILE..].first_chunk().expect("a row of eight")
}

#[inline(always)]
fn row_mut<T>(values: &mut [T; BLOCK], j: usize) -> &mut [T; TILE] {
    values[j * TILE..].first_chunk_mut().expect("a row of eight")
}

/// An integer with bitwise operators.
trait Bits: Copy + BitAnd<Output = Self> + BitXor<Output = Self> {}

impl Bits for u32 {}
impl Bits for u64 {}

/// `a` if `mask` is all ones, `b` if it is 0. A conditional would not always be vectorised.
#[inline(always)]
fn select<T: Bits>(mask: T, a: T, b: T) -> T {
    b ^ ((a ^ b) & mask)
}

/// All ones for covered pixels, 0 for others.
#[inline(always)]
fn masks(covered: u64) -> [u32; BLOCK] {
    let mut masks = [0; BLOCK];
    for j in 0..TILE {
        let (masks, covered) = (row_mut(&mut masks, j), (covered >> (j * TILE)) as u32);
        for (i, mask) in masks.iter_mut().enumerate() {
            *mask = 0_u32.wrapping_sub(covered >> i & 1);
        }
    }
    masks
}

/// Propagates values from covered pixels and from outside over the pixels that are not covered, from each side, in rows
/// with holes.
#[inline(always)]
fn sweep<T: Bits>(
    own: [&[T; BLOCK]; 2],
    masks: &[T; BLOCK],
    [covered, holes]: [u64; 2],
    outside: &[[T; TILE]; SIDES],
    found: &mut [[T; BLOCK]; SIDES],
) {
    let [left, right, above, below] = found;
    let ends = outside[0].iter().zip(&outside[1]);
    for (j, (&before, &after)) in ends.enumerate() {
        if holes >> (j * TILE) & 0xff == 0 {
            continue;
        }
        let (left, right) = (row_mut(left, j), row_mut(right, j));
        *left = [before; TILE];
        *right = [after; TILE];
        if covered >> (j * TILE) & 0xff != 0 {
            let (own, masks, mut before, mut after) = (row(own[0], j), row(masks, j), before, after);
            for i in 0..TILE {
                before = select(masks[i], own[i], before);
                left[i] = before;
            }
            for i in (0..TILE).rev() {
                after = select(masks[i], own[i], after);
                right[i] = after;
            }
        }
    }
    let mut before = outside[2];
    for j in 0..TILE {
        let (own, masks) = (row(own[1], j), row(masks, j));
        for i in 0..TILE {
            before[i] = select(masks[i], own[i], before[i]);
        }
        *row_mut(above, j) = before;
    }
    let mut after = outside[3];
    for j in (0..TILE).rev() {
        let (own, masks) = (row(own[1], j), row(masks, j));
        for i in 0..TILE {
            after[i] = select(masks[i], own[i], after[i]);
        }
        *row_mut(below, j) = after;
    }
}

/// Column and row of each pixel.
const POSITIONS: [[u32; BLOCK]; 2] = {
    let mut position = [[0; BLOCK]; 2];
    let mut index = 0;
    while index < BLOCK {
        position[0][index] = (index % TILE) as u32;
        position[1][index] = (index / TILE) as u32;
        index += 1;
    }
    position
};

#[inline(always)]
fn covered_pixels_in_vectors(keys: &[Key; BLOCK]) -> u64 {
    let mut covered_pixels = [0; TILE];
    for j in (0..TILE).rev() {
        let keys = row(keys, j);
        for (i, covered_pixels) in covered_pixels.iter_mut().enumerate() {
            *covered_pixels = *covered_pixels << TILE | u64::from(keys[i] != EMPTY);
        }
    }
    combine_columns(covered_pixels)
}

#[inline(always)]
fn find_in_vectors(
    own: &[Key; BLOCK],
    covered: u64,
    holes: u64,
    outside: &OutsideCandidates,
    candidates: &mut Candidates,
) {
    let mut wide = [0; BLOCK];
    for i in 0..BLOCK {
        // Keys of holes are `EMPTY`.
        wide[i] = if own[i] == EMPTY { 0 } else { u64::MAX };
    }
    sweep([own, own], &wide, [covered, holes], &outside.keys, &mut candidates.keys);
    sweep(
        [&POSITIONS[0], &POSITIONS[1]],
        &masks(covered),
        [covered, holes],
        &outside.position,
        &mut candidates.distance,
    );
    for (side, (keys, distance)) in candidates.keys.iter_mut().zip(&mut candidates.distance).enumerate() {
        let position = &POSITIONS[side / 2];
        for i in 0..BLOCK {
            let apart = distance[i].wrapping_sub(position[i]) as i32;
            distance[i] = apart.unsigned_abs();
        }
        for i in 0..BLOCK {
            // `EMPTY` is all ones.
            keys[i] |= if distance[i] > SEARCH_RADIUS as u32 { EMPTY } else { 0 };
        }
    }
}

#[inline(always)]
fn cost_by_luma_in_vectors(
    candidates: &Candidates,
    lumas: &[f32; BLOCK],
    covered: u64,
    holes: u64,
    outside: &OutsideCandidates,
    costs: &mut Costs,
) {
    let (own, mut candidate_lumas) = (lumas.map(f32::to_bits), [[0; BLOCK]; SIDES]);
    let ends = outside.lumas.map(|lumas| lumas.map(f32::to_bits));
    sweep([&own, &own], &masks(covered), [covered, holes], &ends, &mut candidate_lumas);
    for (side, costs) in costs.iter_mut().enumerate() {
        let (keys, distance, candidate_lumas) =
            (&candidates.keys[side], &candidates.distance[side], &candidate_lumas[side]);
        for i in 0..BLOCK {
            costs[i] = luma_cost(keys[i], distance[i], lumas[i], f32::from_bits(candidate_lumas[i]));
        }
    }
}

#[inline(always)]
fn cost_by_depth_in_vectors(candidates: &Candidates, costs: &mut Costs) {
    for (costs, (keys, distance)) in costs.iter_mut().zip(candidates.keys.iter().zip(&candidates.distance)) {
        for i in 0..BLOCK {
            let cost = far_first_key(keys[i]) << 8 | distance[i];
            costs[i] = if keys[i] == EMPTY { u32::MAX } else { cost };
        }
    }
}

/// The scalar versions.
mod scalar {
    use super::{BLOCK, Candidates, Costs, EMPTY, Key, OutsideCandidates, SEARCH_RADIUS, SIDES, TILE, luma_cost};

    /// The first covered pixel of the tile in a direction, or `None`, and its distance or that of the key outside.
    fn first_covered(covered: u64, index: usize, side: usize, position: u32) -> (Option<usize>, usize) {
        let (i, j) = (index % TILE, index / TILE);
        let (own, step) = if side < 2 { (i, 1) } else { (j, TILE) };
        let is_before = side.is_multiple_of(2);
        let available = if is_before { own } else { TILE - 1 - own };
        for distance in 1..=available {
            let found = if is_before { index - distance * step } else { index + distance * step };
            if covered >> found & 1 == 1 {
                return (Some(found), distance);
            }
        }
        (None, (position as i32).abs_diff(own as i32) as usize)
    }

    pub(super) fn covered_pixels(keys: &[Key; BLOCK]) -> u64 {
        keys.iter()
            .enumerate()
            .fold(0, |combine_columns, (index, &key)| combine_columns | u64::from(key != EMPTY) << index)
    }

    fn each(holes: u64) -> impl Iterator<Item = (usize, usize, usize)> {
        let values = (0..BLOCK).filter(move |index| holes >> index & 1 == 1);
        values.flat_map(|index| {
            (0..SIDES).map(move |side| (index, side, if side < 2 { index / TILE } else { index % TILE }))
        })
    }

    pub(super) fn find(
        own: &[Key; BLOCK],
        covered: u64,
        holes: u64,
        outside: &OutsideCandidates,
        candidates: &mut Candidates,
    ) {
        for (index, side, line) in each(holes) {
            let (found, distance) = first_covered(covered, index, side, outside.position[side][line]);
            let key = found.map_or(outside.keys[side][line], |found| own[found]);
            candidates.keys[side][index] = if distance > SEARCH_RADIUS { EMPTY } else { key };
            candidates.distance[side][index] = distance as u32;
        }
    }

    pub(super) fn cost_by_luma(
        candidates: &Candidates,
        lumas: &[f32; BLOCK],
        covered: u64,
        holes: u64,
        outside: &OutsideCandidates,
        costs: &mut Costs,
    ) {
        for (index, side, line) in each(holes) {
            let (found, _) = first_covered(covered, index, side, outside.position[side][line]);
            let luma = found.map_or(outside.lumas[side][line], |found| lumas[found]);
            let (key, distance) = (candidates.keys[side][index], candidates.distance[side][index]);
            costs[side][index] = luma_cost(key, distance, lumas[index], luma);
        }
    }
}
