//! What stands beside the places of a tile that nothing claims, eight places at a time.

use std::ops::{BitAnd, BitXor};

use super::super::hole_filling::NEAR;
use super::super::key_buffer::{EMPTY, Key, rank};
use super::at_every_level;
use super::sampling::{BLOCK, TILE};

/// From the left, the right, above and below.
pub(in super::super) const SIDES: usize = 4;

/// What is seen first beyond each line of a tile from each side: beyond rows to the left and right, beyond columns above
/// and below.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Beyond {
    /// [`EMPTY`] where nothing is.
    pub(in super::super) keys: [[Key; TILE]; SIDES],
    /// How far along the line from the tile's first place, what is before it being less than 0.
    pub(in super::super) along: [[u32; TILE]; SIDES],
    /// The luma there, where an anchor shows it.
    pub(in super::super) lumas: [[f32; TILE]; SIDES],
}

impl Beyond {
    pub(in super::super) const NOTHING: Self =
        Self { keys: [[EMPTY; TILE]; SIDES], along: [[0; TILE]; SIDES], lumas: [[0.0; TILE]; SIDES] };
}

/// The nearest claims beside the places of a tile. Of rows without holes nothing is said.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Beside {
    /// [`EMPTY`] where none is near.
    pub(in super::super) keys: [[Key; BLOCK]; SIDES],
    /// How far away they are.
    pub(in super::super) away: [[u32; BLOCK]; SIDES],
}

impl Beside {
    pub(in super::super) const NOTHING: Self = Self { keys: [[EMPTY; BLOCK]; SIDES], away: [[0; BLOCK]; SIDES] };
}

/// How good claims beside places are, for each side: the least is the best, and `u32::MAX` is none.
pub(in super::super) type Orders = [[u32; BLOCK]; SIDES];

at_every_level! {
    /// Which places something claims: bit `8 j + i`.
    pub(in super::super) fn claimed(keys: &[Key; BLOCK]) -> u64 = scalar::claimed | claimed_in_vectors
}

at_every_level! {
    /// The nearest claims beside those places of a tile that nothing claims (`holes`, bit `8 j + i`); `claims` are places that
    /// something does.
    pub(in super::super) fn find(own: &[Key; BLOCK], claims: u64, holes: u64, beyond: &Beyond, beside: &mut Beside)
        = scalar::find | find_in_vectors
}

at_every_level! {
    /// The order of what was found beside places of which an anchor shows the lumas: how unlike it is and how far away, then
    /// how near its surface is.
    pub(in super::super) fn order_by_likeness(
        beside: &Beside, lumas: &[f32; BLOCK], claims: u64, holes: u64, beyond: &Beyond, orders: &mut Orders,
    ) = scalar::order_by_likeness | order_by_likeness_in_vectors
}

at_every_level! {
    /// The order of what was found beside places that nothing shows: how near its surface is, then how far away it is.
    pub(in super::super) fn order_by_nearness(beside: &Beside, orders: &mut Orders)
        = order_by_nearness_in_vectors | order_by_nearness_in_vectors
}

/// How near the surface of a claim is, the farthest first.
#[inline(always)]
fn nearness(key: Key) -> u32 {
    u32::from(u16::MAX - rank(key))
}

#[inline(always)]
fn by_likeness(key: Key, away: u32, luma: f32, there: f32) -> u32 {
    let unlike = (luma - there).abs();
    let order = (floor(if unlike < 255.0 { unlike } else { 255.0 }) as u32).wrapping_add(away) << 16 | nearness(key);
    if key == EMPTY { u32::MAX } else { order }
}

/// The largest whole number that is no larger, of one within 2^22 of 0. Conversions would be done one by one, as they bound
/// what they get.
#[inline(always)]
pub(in super::super) fn floor(v: f32) -> i32 {
    // Where singles are whole numbers, adding rounds; the number is in the lower bits.
    const ROUNDING: f32 = 12_582_912.0;
    let rounded = v + ROUNDING;
    rounded.to_bits() as i32 - ROUNDING.to_bits() as i32 - i32::from(rounded - ROUNDING > v)
}

/// A bit for each place of a row, from one byte for each that is 0 or 1.
#[inline(always)]
pub(in super::super) fn packed(row: [u8; TILE]) -> u64 {
    // Each byte's bit goes to a place of its own in the highest byte.
    u64::from_le_bytes(row).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// All bits of a tile from those of its columns, the upper row's the lowest of each eight.
#[inline(always)]
pub(in super::super) fn all(columns: [u64; TILE]) -> u64 {
    columns.into_iter().zip(0..).fold(0, |all, (bits, column)| all | bits << column)
}

/// Row `j` of a tile.
#[inline(always)]
fn row<T>(places: &[T; BLOCK], j: usize) -> &[T; TILE] {
    places[j * TILE..].first_chunk().expect("a row of eight")
}

#[inline(always)]
fn row_mut<T>(places: &mut [T; BLOCK], j: usize) -> &mut [T; TILE] {
    places[j * TILE..].first_chunk_mut().expect("a row of eight")
}

/// A number of which bits can be taken.
trait Bits: Copy + BitAnd<Output = Self> + BitXor<Output = Self> {}

impl Bits for u32 {}
impl Bits for u64 {}

/// `a` where `mask` has all bits, `b` where it has none. Choices by condition are at times made one by one.
#[inline(always)]
fn either<T: Bits>(mask: T, a: T, b: T) -> T {
    b ^ ((a ^ b) & mask)
}

/// All bits for the places that something claims, none for the others.
#[inline(always)]
fn masks(claims: u64) -> [u32; BLOCK] {
    let mut masks = [0; BLOCK];
    for j in 0..TILE {
        let (masks, claims) = (row_mut(&mut masks, j), (claims >> (j * TILE)) as u32);
        for (i, mask) in masks.iter_mut().enumerate() {
            *mask = 0_u32.wrapping_sub(claims >> i & 1);
        }
    }
    masks
}

/// Carries what stands at claimed places and beyond each line over the places that nothing claims, from each side, in rows
/// with holes.
#[inline(always)]
fn sweep<T: Bits>(
    own: [&[T; BLOCK]; 2],
    masks: &[T; BLOCK],
    [claims, holes]: [u64; 2],
    beyond: &[[T; TILE]; SIDES],
    found: &mut [[T; BLOCK]; SIDES],
) {
    let [left, right, above, below] = found;
    let ends = beyond[0].iter().zip(&beyond[1]);
    for (j, (&before, &after)) in ends.enumerate() {
        if holes >> (j * TILE) & 0xff == 0 {
            continue;
        }
        let (left, right) = (row_mut(left, j), row_mut(right, j));
        *left = [before; TILE];
        *right = [after; TILE];
        if claims >> (j * TILE) & 0xff != 0 {
            let (own, masks, mut before, mut after) = (row(own[0], j), row(masks, j), before, after);
            for i in 0..TILE {
                before = either(masks[i], own[i], before);
                left[i] = before;
            }
            for i in (0..TILE).rev() {
                after = either(masks[i], own[i], after);
                right[i] = after;
            }
        }
    }
    let mut before = beyond[2];
    for j in 0..TILE {
        let (own, masks) = (row(own[1], j), row(masks, j));
        for i in 0..TILE {
            before[i] = either(masks[i], own[i], before[i]);
        }
        *row_mut(above, j) = before;
    }
    let mut after = beyond[3];
    for j in (0..TILE).rev() {
        let (own, masks) = (row(own[1], j), row(masks, j));
        for i in 0..TILE {
            after[i] = either(masks[i], own[i], after[i]);
        }
        *row_mut(below, j) = after;
    }
}

/// How far along its row, and its column, each place stands.
const ALONG: [[u32; BLOCK]; 2] = {
    let mut along = [[0; BLOCK]; 2];
    let mut place = 0;
    while place < BLOCK {
        along[0][place] = (place % TILE) as u32;
        along[1][place] = (place / TILE) as u32;
        place += 1;
    }
    along
};

#[inline(always)]
fn claimed_in_vectors(keys: &[Key; BLOCK]) -> u64 {
    let mut claimed = [0; TILE];
    for j in (0..TILE).rev() {
        let keys = row(keys, j);
        for (i, claimed) in claimed.iter_mut().enumerate() {
            *claimed = *claimed << TILE | u64::from(keys[i] != EMPTY);
        }
    }
    all(claimed)
}

#[inline(always)]
fn find_in_vectors(own: &[Key; BLOCK], claims: u64, holes: u64, beyond: &Beyond, beside: &mut Beside) {
    let mut wide = [0; BLOCK];
    for i in 0..BLOCK {
        // Places that nothing claims are empty.
        wide[i] = if own[i] == EMPTY { 0 } else { u64::MAX };
    }
    sweep([own, own], &wide, [claims, holes], &beyond.keys, &mut beside.keys);
    sweep([&ALONG[0], &ALONG[1]], &masks(claims), [claims, holes], &beyond.along, &mut beside.away);
    for (side, (keys, away)) in beside.keys.iter_mut().zip(&mut beside.away).enumerate() {
        let along = &ALONG[side / 2];
        for i in 0..BLOCK {
            let apart = away[i].wrapping_sub(along[i]) as i32;
            away[i] = apart.unsigned_abs();
        }
        for i in 0..BLOCK {
            // Nothing is the most a number can be.
            keys[i] |= if away[i] > NEAR as u32 { EMPTY } else { 0 };
        }
    }
}

#[inline(always)]
fn order_by_likeness_in_vectors(
    beside: &Beside,
    lumas: &[f32; BLOCK],
    claims: u64,
    holes: u64,
    beyond: &Beyond,
    orders: &mut Orders,
) {
    let (own, mut there) = (lumas.map(f32::to_bits), [[0; BLOCK]; SIDES]);
    let ends = beyond.lumas.map(|lumas| lumas.map(f32::to_bits));
    sweep([&own, &own], &masks(claims), [claims, holes], &ends, &mut there);
    for (side, orders) in orders.iter_mut().enumerate() {
        let (keys, away, there) = (&beside.keys[side], &beside.away[side], &there[side]);
        for i in 0..BLOCK {
            orders[i] = by_likeness(keys[i], away[i], lumas[i], f32::from_bits(there[i]));
        }
    }
}

#[inline(always)]
fn order_by_nearness_in_vectors(beside: &Beside, orders: &mut Orders) {
    for (orders, (keys, away)) in orders.iter_mut().zip(beside.keys.iter().zip(&beside.away)) {
        for i in 0..BLOCK {
            let order = nearness(keys[i]) << 8 | away[i];
            orders[i] = if keys[i] == EMPTY { u32::MAX } else { order };
        }
    }
}

/// The same, place by place.
mod scalar {
    use super::{BLOCK, Beside, Beyond, EMPTY, Key, NEAR, Orders, SIDES, TILE, by_likeness};

    /// What is seen first from a place towards a side: a place of the tile, or none, and how far away that is, or what is
    /// beyond.
    fn first(claims: u64, place: usize, side: usize, along: u32) -> (Option<usize>, usize) {
        let (i, j) = (place % TILE, place / TILE);
        let (own, step) = if side < 2 { (i, 1) } else { (j, TILE) };
        let is_before = side.is_multiple_of(2);
        let room = if is_before { own } else { TILE - 1 - own };
        for away in 1..=room {
            let there = if is_before { place - away * step } else { place + away * step };
            if claims >> there & 1 == 1 {
                return (Some(there), away);
            }
        }
        (None, (along as i32).abs_diff(own as i32) as usize)
    }

    pub(super) fn claimed(keys: &[Key; BLOCK]) -> u64 {
        keys.iter().enumerate().fold(0, |all, (place, &key)| all | u64::from(key != EMPTY) << place)
    }

    fn each(holes: u64) -> impl Iterator<Item = (usize, usize, usize)> {
        let places = (0..BLOCK).filter(move |place| holes >> place & 1 == 1);
        places.flat_map(|place| {
            (0..SIDES).map(move |side| (place, side, if side < 2 { place / TILE } else { place % TILE }))
        })
    }

    pub(super) fn find(own: &[Key; BLOCK], claims: u64, holes: u64, beyond: &Beyond, beside: &mut Beside) {
        for (place, side, line) in each(holes) {
            let (there, away) = first(claims, place, side, beyond.along[side][line]);
            let key = there.map_or(beyond.keys[side][line], |there| own[there]);
            beside.keys[side][place] = if away > NEAR { EMPTY } else { key };
            beside.away[side][place] = away as u32;
        }
    }

    pub(super) fn order_by_likeness(
        beside: &Beside,
        lumas: &[f32; BLOCK],
        claims: u64,
        holes: u64,
        beyond: &Beyond,
        orders: &mut Orders,
    ) {
        for (place, side, line) in each(holes) {
            let (there, _) = first(claims, place, side, beyond.along[side][line]);
            let luma = there.map_or(beyond.lumas[side][line], |there| lumas[there]);
            let (key, away) = (beside.keys[side][place], beside.away[side][place]);
            orders[side][place] = by_likeness(key, away, lumas[place], luma);
        }
    }
}
