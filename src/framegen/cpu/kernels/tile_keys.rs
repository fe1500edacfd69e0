//! The claims of a tile's pixels, eight at a time.
//!
//! What a claim is, and what may be said of two, is in `layer`; here it is written so that compilers make vectors of it.

use super::super::camera_fit::{Moment, Way};
use super::super::key_buffer::{ALIKE, EMPTY, Key, is_nearer, landed, part, vector};
use super::at_every_level;
use super::sampling::{BLOCK, Positions, TILE};

/// Rows of a picture that are being filled, with what is known of their tiles. Tiles begin at the place (1, 1), as one
/// more row and column stand on each side.
#[derive(Debug)]
pub(in super::super) struct Places<'a> {
    /// A key to a place, row by row.
    pub(in super::super) keys: &'a mut [Key],
    /// Places to a row.
    pub(in super::super) stride: usize,
    /// For each tile, and one more on each side, whether a pixel of its own landed on it.
    pub(in super::super) is_rough: &'a mut [bool],
}

impl Places<'_> {
    /// Lets `key` claim a place, if that is one of these.
    #[inline(always)]
    fn claim(&mut self, x: i32, y: i32, key: Key) {
        if key == EMPTY || x as u32 as usize >= self.stride {
            return;
        }
        // What is negative is far beyond.
        if let Some(place) = self.keys.get_mut((y as u32 as usize).saturating_mul(self.stride) + x as usize) {
            *place = (*place).min(key);
            self.is_rough[self.tile(x as usize, y as usize)] = true;
        }
    }

    /// The number of the tile that holds a place.
    #[inline(always)]
    fn tile(&self, x: usize, y: usize) -> usize {
        y.div_ceil(TILE) * ((self.stride - 2) / TILE + 2) + x.div_ceil(TILE)
    }
}

at_every_level! {
    /// Carries the pixels of a tile, the first of them standing at `at` of the picture. Its first pixel is the place
    /// `shift`.
    pub(in super::super) fn carry(
        keys: &[Key; BLOCK], at: [i32; 2], shift: [i32; 2], way: Way, places: &mut Places<'_>,
    ) = scalar::carry | carry_in_vectors
}

at_every_level! {
    /// Lays a claim on `extent` places from `start` on, where it is in front of what is there.
    pub(in super::super) fn lay(key: Key, places: &mut [Key], stride: usize, start: usize, extent: [usize; 2])
        = lay_on_rows | lay_on_rows
}

at_every_level! {
    /// The keys of a tile whose first place is `places[stride + 1]`, with cracks closed: a place that has nothing, or only
    /// what is behind, gets what stands on both sides of it, where that is one surface. Returns how many places nothing
    /// claims, and the farthest claim, or [`EMPTY`].
    pub(in super::super) fn close(places: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key)
        = scalar::close | close_in_vectors
}

at_every_level! {
    /// For each place of the inner 8 x 8 the nearest of the nine around it. Bit `8 j + i` of the result says that it is
    /// in front of the place's own, and moves otherwise: by more than `limit` of 1/64 px along an axis.
    pub(in super::super) fn nearest_around(around: &Around, limit: i32, nearest: &mut [Key; BLOCK]) -> u64
        = scalar::nearest_around | nearest_around_in_vectors
}

at_every_level! {
    /// For each place of the inner 8 x 8 that is asked for (bit `8 j + i`) the first of the nine claims around it that move
    /// otherwise: by more than `limit` of 1/64 px along an axis; [`EMPTY`] where none does. Such a bit of the result says that
    /// one does.
    pub(in super::super) fn other_around(around: &Around, limit: i32, asked: u64, others: &mut [Key; BLOCK]) -> u64
        = scalar::other_around | other_around_in_vectors
}

at_every_level! {
    /// The least and the largest of each component of what moves by claims; the least above the largest where there are
    /// none.
    pub(in super::super) fn span(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] = scalar::span | span_in_vectors
}

at_every_level! {
    /// Where the two anchors of a size show (1/64 px) the pixels of a tile with these claims, the first of which is at
    /// `at`, at a moment between them. Bit `8 j + i` of the result says that the previous one does not, and that the
    /// current one does not.
    pub(in super::super) fn spots(
        keys: &[Key; BLOCK], at: [i32; 2], moment: Moment, size: [usize; 2], before: &mut Positions,
        after: &mut Positions,
    ) -> [u64; 2] = scalar::spots | spots_in_vectors
}

at_every_level! {
    /// Which of these claims have a mark, [`EMPTY`] having the mark [`HOLE`](super::super::key_buffer::HOLE): bit `8 j + i`.
    pub(in super::super) fn having(keys: &[Key; BLOCK], mark: u8) -> u64 = scalar::having | having_in_vectors
}

/// The keys of a tile with one more on each side.
pub(in super::super) type Around = [[Key; TILE + 2]; TILE + 2];

const COMPONENT: u64 = (1 << 20) - 1;

/// Whether two claims move alike, see [`alike`](super::super::key_buffer::alike).
#[inline(always)]
fn move_alike(a: Key, b: Key) -> bool {
    move_within(a, b, ALIKE)
}

/// Whether two claims move by no more than `limit` of 1/64 px otherwise along each axis.
#[inline(always)]
fn move_within(a: Key, b: Key, limit: i32) -> bool {
    let limit = limit as u64;
    let is_near = |a: u64, b: u64| (a & COMPONENT).wrapping_sub(b & COMPONENT).wrapping_add(limit) <= 2 * limit;
    is_near(a >> 20, b >> 20) & is_near(a, b)
}

/// A place that is none of those that are filled.
const NOWHERE: u32 = u32::MAX;

/// Lanes of a row of a tile.
type Row<T> = [T; TILE];

#[inline(always)]
fn row(keys: &[Key]) -> &Row<Key> {
    keys.first_chunk().expect("a row of eight")
}

// Plain loops: closures of `from_fn` are at times left as functions of their own, which have no vectors.

#[inline(always)]
fn carry_in_vectors(keys: &[Key; BLOCK], at: [i32; 2], shift: [i32; 2], way: Way, places: &mut Places<'_>) {
    let from = [at[0] + shift[0], at[1] + shift[1]];
    let lines = (places.keys.len() / places.stride) as u32;
    let (stride, columns) = (places.stride as u32, ((places.stride - 2) / TILE + 2) as u32);
    // All are found before any is written: one by one they would be taken out of vectors.
    let (mut found, mut tiles) = ([NOWHERE; BLOCK], [0; BLOCK]);
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let reaches = way.reaches(keys, [at[0], at[1] + j as i32]);
        for i in 0..TILE {
            let [vx, vy] = vector(keys[i]);
            // As unsigned numbers, what is negative is far beyond.
            let u = landed(from[0] + i as i32, vx, reaches[i]) as u32;
            let v = landed(from[1] + j as i32, vy, reaches[i]) as u32;
            let is_here = (u < stride) & (v < lines) & (keys[i] != EMPTY);
            found[j * TILE + i] = if is_here { v.wrapping_mul(stride).wrapping_add(u) } else { NOWHERE };
            tiles[j * TILE + i] = (v.wrapping_add(7) >> 3).wrapping_mul(columns).wrapping_add(u.wrapping_add(7) >> 3);
        }
    }
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let found: &Row<u32> = found[j * TILE..].first_chunk().expect("a row of eight");
        let tiles: &Row<u32> = tiles[j * TILE..].first_chunk().expect("a row of eight");
        let (mut apart, mut all) = (0, NOWHERE);
        for i in 0..TILE {
            apart |= found[i] ^ found[0].wrapping_add(i as u32);
            all &= found[i];
        }
        // Mostly they stay side by side.
        if apart == 0 && found[0] != NOWHERE {
            let run: &mut Row<Key> = places.keys[found[0] as usize..].first_chunk_mut().expect("it fits");
            for i in 0..TILE {
                run[i] = run[i].min(keys[i]);
            }
            places.is_rough[tiles[0] as usize] = true;
            places.is_rough[tiles[7] as usize] = true;
        } else if all != NOWHERE {
            for i in 0..TILE {
                if let Some(place) = places.keys.get_mut(found[i] as usize) {
                    *place = (*place).min(keys[i]);
                    places.is_rough[tiles[i] as usize] = true;
                }
            }
        }
    }
}

#[inline(always)]
fn lay_on_rows(key: Key, places: &mut [Key], stride: usize, start: usize, [across, down]: [usize; 2]) {
    for line in 0..down {
        for place in &mut places[start + line * stride..][..across] {
            *place = (*place).min(key);
        }
    }
}

/// What stands at places between others, see [`close`].
#[inline(always)]
fn closed(own: &Row<Key>, a: &Row<Key>, b: &Row<Key>) -> Row<Key> {
    let mut found = *own;
    for i in 0..TILE {
        let (own, nearer, farther) = (own[i], a[i].min(b[i]), a[i].max(b[i]));
        let is_surface = (farther != EMPTY) & move_alike(nearer, farther);
        let is_behind = is_nearer(farther, own) & !move_alike(nearer, own);
        found[i] = if is_surface & ((own == EMPTY) | is_behind) { nearer } else { own };
    }
    found
}

#[inline(always)]
fn close_in_vectors(places: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key) {
    let (mut holes, mut farthest) = ([0_u64; TILE], [0_u64; TILE]);
    for j in 0..TILE {
        let above = &places[j * stride..][..TILE + 2];
        let here = &places[(j + 1) * stride..][..TILE + 2];
        let below = &places[(j + 2) * stride..][..TILE + 2];
        let own = closed(row(&here[1..]), row(here), row(&here[2..]));
        let own = closed(&own, row(&above[1..]), row(&below[1..]));
        for i in 0..TILE {
            holes[i] += u64::from(own[i] == EMPTY);
            // One more than the key: nothing is 0 then, and nearest.
            farthest[i] = farthest[i].max(own[i].wrapping_add(1));
        }
        keys[j * TILE..][..TILE].copy_from_slice(&own);
    }
    let farthest = farthest.into_iter().fold(0, u64::max);
    (holes.iter().sum::<u64>() as u8, farthest.wrapping_sub(1))
}

#[inline(always)]
fn nearest_around_in_vectors(around: &Around, limit: i32, nearest: &mut [Key; BLOCK]) -> u64 {
    let mut across = [[EMPTY; TILE]; TILE + 2];
    for j in 0..TILE + 2 {
        for i in 0..TILE {
            across[j][i] = around[j][i].min(around[j][i + 1]).min(around[j][i + 2]);
        }
    }
    let mut changes = [0; TILE];
    for j in 0..TILE {
        let own = row(&around[j + 1][1..]);
        for i in 0..TILE {
            let first = across[j][i].min(across[j + 1][i]).min(across[j + 2][i]);
            let is_other = (own[i] != EMPTY) & is_nearer(first, own[i]) & !move_within(first, own[i], limit);
            nearest[j * TILE + i] = first;
            changes[i] |= u64::from(is_other) << (j * TILE + i);
        }
    }
    changes.into_iter().fold(0, |all, bits| all | bits)
}

#[inline(always)]
fn other_around_in_vectors(around: &Around, limit: i32, asked: u64, others: &mut [Key; BLOCK]) -> u64 {
    others.fill(EMPTY);
    let mut changes = [0; TILE];
    for j in 0..TILE {
        let asked = asked >> (j * TILE) & 0xff;
        if asked == 0 {
            continue;
        }
        let own = row(&around[j + 1][1..]);
        let mut first = [EMPTY; TILE];
        for beside in &around[j..j + 3] {
            for shift in 0..3 {
                let beside = row(&beside[shift..]);
                for i in 0..TILE {
                    // Nothing is no claim to move otherwise, and the last of all.
                    let other = if move_within(beside[i], own[i], limit) { EMPTY } else { beside[i] };
                    first[i] = first[i].min(other);
                }
            }
        }
        for i in 0..TILE {
            let is_asked = (own[i] != EMPTY) & (asked >> i & 1 == 1);
            let other = if is_asked { first[i] } else { EMPTY };
            others[j * TILE + i] = other;
            changes[i] |= u64::from(other != EMPTY) << (j * TILE + i);
        }
    }
    changes.into_iter().fold(0, |all, bits| all | bits)
}

#[inline(always)]
fn span_in_vectors(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] {
    const MOST: u32 = COMPONENT as u32;
    // As they are held: in EMPTY both are the most that can be, and one more of that is the least.
    let (mut low, mut high) = ([[MOST; TILE]; 2], [[0; TILE]; 2]);
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        for i in 0..TILE {
            let (x, y) = ((keys[i] >> 20) as u32 & MOST, keys[i] as u32 & MOST);
            low[0][i] = low[0][i].min(x);
            low[1][i] = low[1][i].min(y);
            high[0][i] = high[0][i].max((x + 1) & MOST);
            high[1][i] = high[1][i].max((y + 1) & MOST);
        }
    }
    let (mut least, mut largest) = ([MOST; 2], [0; 2]);
    for c in 0..2 {
        for i in 0..TILE {
            least[c] = least[c].min(low[c][i]);
            largest[c] = largest[c].max(high[c][i]);
        }
    }
    if largest == [0; 2] {
        return [[i32::MAX; 2], [i32::MIN; 2]];
    }
    let [[x, y], [u, v]] = [least, largest.map(|v| v - 1)];
    [vector(Key::from(x) << 20 | Key::from(y)), vector(Key::from(u) << 20 | Key::from(v))]
}

#[inline(always)]
fn spots_in_vectors(
    keys: &[Key; BLOCK],
    at: [i32; 2],
    moment: Moment,
    size: [usize; 2],
    before: &mut Positions,
    after: &mut Positions,
) -> [u64; 2] {
    let [width, height] = size.map(|len| 64 * len as u32);
    let from = at.map(|at| 64 * at);
    let mut beyond = [[0; TILE]; 2];
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let phases = moment.phases(keys, [at[0], at[1] + j as i32]);
        let (mut u, mut v, mut s, mut t) = ([0; TILE], [0; TILE], [0; TILE], [0; TILE]);
        for i in 0..TILE {
            let [x, y] = vector(keys[i]);
            u[i] = from[0] + 64 * i as i32 + part(x, phases[i]);
            v[i] = from[1] + 64 * j as i32 + part(y, phases[i]);
            s[i] = u[i] - x;
            t[i] = v[i] - y;
            // As unsigned numbers, what is negative is far beyond.
            let is_before_beyond = ((u[i] + 32) as u32 >= width) | ((v[i] + 32) as u32 >= height);
            let is_after_beyond = ((s[i] + 32) as u32 >= width) | ((t[i] + 32) as u32 >= height);
            beyond[0][i] |= u64::from(is_before_beyond) << (j * TILE + i);
            beyond[1][i] |= u64::from(is_after_beyond) << (j * TILE + i);
        }
        before.x[j * TILE..][..TILE].copy_from_slice(&u);
        before.y[j * TILE..][..TILE].copy_from_slice(&v);
        after.x[j * TILE..][..TILE].copy_from_slice(&s);
        after.y[j * TILE..][..TILE].copy_from_slice(&t);
    }
    beyond.map(|beyond| beyond.into_iter().fold(0, |all, bits| all | bits))
}

#[inline(always)]
fn having_in_vectors(keys: &[Key; BLOCK], mark: u8) -> u64 {
    let mut having = [0; TILE];
    for j in (0..TILE).rev() {
        let keys = row(&keys[j * TILE..]);
        for i in 0..TILE {
            having[i] = having[i] << TILE | u64::from(keys[i] >> 40 & 0xff == u64::from(mark));
        }
    }
    // Of each column a bit to a row.
    having.into_iter().enumerate().fold(0, |all, (i, of_column)| all | of_column << i)
}

/// The same, place by place.
mod scalar {
    use super::super::super::key_buffer::{self, Grid, alike, is_nearer, moves_within};
    use super::{Around, BLOCK, EMPTY, Key, Moment, Places, Positions, TILE, Way, landed, part, vector};

    pub(super) fn carry(keys: &[Key; BLOCK], at: [i32; 2], shift: [i32; 2], way: Way, places: &mut Places<'_>) {
        for (place, &key) in keys.iter().enumerate() {
            let at = [at[0] + (place % TILE) as i32, at[1] + (place / TILE) as i32];
            let ([x, y], reach) = (vector(key), way.reach(key, at));
            places.claim(landed(at[0], x, reach) + shift[0], landed(at[1], y, reach) + shift[1], key);
        }
    }

    pub(super) fn close(places: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key) {
        for (place, key) in keys.iter_mut().enumerate() {
            let at = |i: usize, j: usize| places[(place / TILE + j) * stride + place % TILE + i];
            *key = at(1, 1);
            for [a, b] in [[at(0, 1), at(2, 1)], [at(1, 0), at(1, 2)]] {
                let is_surface = a != EMPTY && b != EMPTY && alike(a, b);
                if is_surface && (*key == EMPTY || is_nearer(a.max(b), *key) && !alike(a.min(b), *key)) {
                    *key = a.min(b);
                }
            }
        }
        let claims = keys.iter().copied().filter(|&key| key != EMPTY);
        ((BLOCK - claims.clone().count()) as u8, claims.max().unwrap_or(EMPTY))
    }

    pub(super) fn nearest_around(around: &Around, limit: i32, nearest: &mut [Key; BLOCK]) -> u64 {
        let mut changes = 0;
        for (place, nearest) in nearest.iter_mut().enumerate() {
            let (i, j) = (place % TILE, place / TILE);
            let own = around[j + 1][i + 1];
            *nearest = around[j..j + 3].iter().flat_map(|line| line[i..i + 3].iter().copied()).fold(EMPTY, Key::min);
            let is_other = own != EMPTY && is_nearer(*nearest, own) && !moves_within(*nearest, own, limit);
            changes |= u64::from(is_other) << place;
        }
        changes
    }

    pub(super) fn other_around(around: &Around, limit: i32, asked: u64, others: &mut [Key; BLOCK]) -> u64 {
        let mut changes = 0;
        for (place, other) in others.iter_mut().enumerate() {
            let (i, j) = (place % TILE, place / TILE);
            let own = around[j + 1][i + 1];
            let beside = around[j..j + 3].iter().flat_map(|line| line[i..i + 3].iter().copied());
            let is_asked = own != EMPTY && asked >> place & 1 == 1;
            let moves_otherwise = |&key: &Key| is_asked && key != EMPTY && !moves_within(key, own, limit);
            *other = beside.filter(moves_otherwise).fold(EMPTY, Key::min);
            changes |= u64::from(*other != EMPTY) << place;
        }
        changes
    }

    pub(super) fn span(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] {
        let vectors = keys.iter().filter(|&&key| key != EMPTY).map(|&key| vector(key));
        vectors.fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], vector| {
            [[0, 1].map(|c| low[c].min(vector[c])), [0, 1].map(|c| high[c].max(vector[c]))]
        })
    }

    pub(super) fn spots(
        keys: &[Key; BLOCK],
        at: [i32; 2],
        moment: Moment,
        [width, height]: [usize; 2],
        before: &mut Positions,
        after: &mut Positions,
    ) -> [u64; 2] {
        let grid = Grid { width, height, ..Grid::default() };
        let mut beyond = [0; 2];
        for (place, &key) in keys.iter().enumerate() {
            let at = [at[0] + (place % TILE) as i32, at[1] + (place / TILE) as i32];
            let ([x, y], phase) = (vector(key), moment.phase(key, at));
            (before.x[place], before.y[place]) = (64 * at[0] + part(x, phase), 64 * at[1] + part(y, phase));
            (after.x[place], after.y[place]) = (before.x[place] - x, before.y[place] - y);
            beyond[0] |= u64::from(!grid.holds([before.x[place], before.y[place]])) << place;
            beyond[1] |= u64::from(!grid.holds([after.x[place], after.y[place]])) << place;
        }
        beyond
    }

    pub(super) fn having(keys: &[Key; BLOCK], mark: u8) -> u64 {
        keys.iter().enumerate().fold(0, |all, (place, &key)| all | u64::from(key_buffer::mark(key) == mark) << place)
    }
}
