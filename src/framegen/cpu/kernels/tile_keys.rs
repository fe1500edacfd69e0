//! Kernels over the splat keys of a tile.
//!
//! The same results as the functions of `splat_key`, for a whole tile at a time, in loops that compilers vectorise.

use super::super::splat_key::{EMPTY, Key, SIMILAR_MOTION, is_in_front, scaled, vector, warped};
use super::super::warp::{Warp, WarpTime};
use super::at_every_level;
use super::sampling::{BLOCK, Positions, TILE};

/// Destination of a splat: keys of some rows with a border of one pixel, so that the first tile starts at (1, 1).
#[derive(Debug)]
pub(in super::super) struct SplatTarget<'a> {
    /// Keys, row by row.
    pub(in super::super) keys: &'a mut [Key],
    /// Pixels per row.
    pub(in super::super) stride: usize,
    /// Per tile, with a border of one tile: whether keys of single pixels were splatted to it.
    pub(in super::super) is_mixed: &'a mut [bool],
}

impl SplatTarget<'_> {
    /// Splats `key` to the pixel (x, y), if that is inside.
    #[inline(always)]
    fn splat(&mut self, x: i32, y: i32, key: Key) {
        if key == EMPTY || x as u32 as usize >= self.stride {
            return;
        }
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        if let Some(pixel) = self.keys.get_mut((y as u32 as usize).saturating_mul(self.stride) + x as usize) {
            *pixel = (*pixel).min(key);
            self.is_mixed[self.tile(x as usize, y as usize)] = true;
        }
    }

    /// Index of the tile that contains a pixel.
    #[inline(always)]
    fn tile(&self, x: usize, y: usize) -> usize {
        y.div_ceil(TILE) * ((self.stride - 2) / TILE + 2) + x.div_ceil(TILE)
    }
}

at_every_level! {
    /// Splats the pixels of the tile whose first pixel is `at` in the picture. The picture's first pixel is at `shift`
    /// in the target.
    pub(in super::super) fn splat_pixels(
        keys: &[Key; BLOCK], at: [i32; 2], shift: [i32; 2], warp: Warp, target: &mut SplatTarget<'_>,
    ) = scalar::splat_pixels | splat_pixels_in_vectors
}

at_every_level! {
    /// Splats one key to `extent` pixels from index `start`.
    pub(in super::super) fn splat_rectangle(key: Key, splatted: &mut [Key], stride: usize, start: usize, extent: [usize; 2])
        = splat_rectangle_in_rows | splat_rectangle_in_rows
}

at_every_level! {
    /// The keys of the tile that starts at `splatted[stride + 1]`, with cracks closed: a hole or a farther pixel
    /// between two opposite neighbours of one surface gets the nearer one's key. Returns the number of holes and the
    /// farthest key, or [`EMPTY`].
    pub(in super::super) fn close_cracks(splatted: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key)
        = scalar::close_cracks | close_cracks_in_vectors
}

at_every_level! {
    /// For each pixel of the inner 8 x 8, the nearest key in its 3 x 3 neighbourhood. Bit `8 j + i` of the result is
    /// set if that is in front of the pixel's own key and their motion differs by more than `limit` (1/64 px).
    pub(in super::super) fn nearest_neighbours(padded: &PaddedTile, limit: i32, nearest: &mut [Key; BLOCK]) -> u64
        = scalar::nearest_neighbours | nearest_neighbours_in_vectors
}

at_every_level! {
    /// For each `wanted` pixel of the inner 8 x 8 (bit `8 j + i`), the smallest key in its 3 x 3 neighbourhood whose
    /// motion differs by more than `limit` (1/64 px) from its own, or [`EMPTY`]. The result has the bits of pixels with
    /// such a key.
    pub(in super::super) fn nearest_other_motion(padded: &PaddedTile, limit: i32, wanted: u64, others: &mut [Key; BLOCK]) -> u64
        = scalar::nearest_other_motion | nearest_other_motion_in_vectors
}

at_every_level! {
    /// Minimum and maximum of each motion component; if there are no keys, the minimum is above the maximum.
    pub(in super::super) fn vector_range(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] = scalar::vector_range | vector_range_in_vectors
}

at_every_level! {
    /// Positions (1/64 px) in the two anchors of the pixels of the tile whose first pixel is `at`, at a time between
    /// them. Bit `8 j + i` of the results is set if the position is outside the previous anchor, and outside the
    /// current one.
    pub(in super::super) fn source_positions(
        keys: &[Key; BLOCK], at: [i32; 2], time: WarpTime, size: [usize; 2], previous: &mut Positions,
        current: &mut Positions,
    ) -> [u64; 2] = scalar::source_positions | source_positions_in_vectors
}

at_every_level! {
    /// Pixels whose keys have `tag`, as bits `8 j + i`. The tag of [`EMPTY`] is
    /// [`HOLE`](super::super::splat_key::HOLE).
    pub(in super::super) fn tagged(keys: &[Key; BLOCK], tag: u8) -> u64 = scalar::tagged | tagged_in_vectors
}

/// The keys of a tile with a border of one pixel.
pub(in super::super) type PaddedTile = [[Key; TILE + 2]; TILE + 2];

const COMPONENT: u64 = (1 << 20) - 1;

/// [`similar_motion`](super::super::splat_key::similar_motion), branchless.
#[inline(always)]
fn similar_motion_in_vectors(a: Key, b: Key) -> bool {
    motion_within_in_vectors(a, b, SIMILAR_MOTION)
}

/// [`motion_within`](super::super::splat_key::motion_within), branchless.
#[inline(always)]
fn motion_within_in_vectors(a: Key, b: Key, limit: i32) -> bool {
    let limit = limit as u64;
    let is_near = |a: u64, b: u64| (a & COMPONENT).wrapping_sub(b & COMPONENT).wrapping_add(limit) <= 2 * limit;
    is_near(a >> 20, b >> 20) & is_near(a, b)
}

/// Index of a pixel outside the target.
const OUTSIDE: u32 = u32::MAX;

/// One value per pixel of a row of a tile.
type Row<T> = [T; TILE];

#[inline(always)]
fn row(keys: &[Key]) -> &Row<Key> {
    keys.first_chunk().expect("a row of eight")
}

// Plain loops: LLVM does not always inline closures of `from_fn`, and then does not vectorise them.

#[inline(always)]
fn splat_pixels_in_vectors(
    keys: &[Key; BLOCK],
    at: [i32; 2],
    shift: [i32; 2],
    warp: Warp,
    target: &mut SplatTarget<'_>,
) {
    let from = [at[0] + shift[0], at[1] + shift[1]];
    let lines = (target.keys.len() / target.stride) as u32;
    let (stride, columns) = (target.stride as u32, ((target.stride - 2) / TILE + 2) as u32);
    // All indices are computed before any key is written: mixed with the writes, they would not be vectorised.
    let (mut found, mut tiles) = ([OUTSIDE; BLOCK], [0; BLOCK]);
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let fractions = warp.fractions(keys, [at[0], at[1] + j as i32]);
        for i in 0..TILE {
            let [vx, vy] = vector(keys[i]);
            // Negative coordinates wrap to large unsigned values and fail the bounds check.
            let u = warped(from[0] + i as i32, vx, fractions[i]) as u32;
            let v = warped(from[1] + j as i32, vy, fractions[i]) as u32;
            let is_here = (u < stride) & (v < lines) & (keys[i] != EMPTY);
            found[j * TILE + i] = if is_here { v.wrapping_mul(stride).wrapping_add(u) } else { OUTSIDE };
            tiles[j * TILE + i] = (v.wrapping_add(7) >> 3).wrapping_mul(columns).wrapping_add(u.wrapping_add(7) >> 3);
        }
    }
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let found: &Row<u32> = found[j * TILE..].first_chunk().expect("a row of eight");
        let tiles: &Row<u32> = tiles[j * TILE..].first_chunk().expect("a row of eight");
        let (mut gaps, mut all) = (0, OUTSIDE);
        for i in 0..TILE {
            gaps |= found[i] ^ found[0].wrapping_add(i as u32);
            all &= found[i];
        }
        // The usual case: the row stays contiguous.
        if gaps == 0 && found[0] != OUTSIDE {
            let run: &mut Row<Key> = target.keys[found[0] as usize..].first_chunk_mut().expect("it fits");
            for i in 0..TILE {
                run[i] = run[i].min(keys[i]);
            }
            target.is_mixed[tiles[0] as usize] = true;
            target.is_mixed[tiles[7] as usize] = true;
        } else if all != OUTSIDE {
            for i in 0..TILE {
                if let Some(pixel) = target.keys.get_mut(found[i] as usize) {
                    *pixel = (*pixel).min(keys[i]);
                    target.is_mixed[tiles[i] as usize] = true;
                }
            }
        }
    }
}

#[inline(always)]
fn splat_rectangle_in_rows(key: Key, splatted: &mut [Key], stride: usize, start: usize, [across, down]: [usize; 2]) {
    for line in 0..down {
        for pixel in &mut splatted[start + line * stride..][..across] {
            *pixel = (*pixel).min(key);
        }
    }
}

/// A row with cracks closed between two neighbouring rows or columns, see [`close_cracks`].
#[inline(always)]
fn close_row(own: &Row<Key>, a: &Row<Key>, b: &Row<Key>) -> Row<Key> {
    let mut found = *own;
    for i in 0..TILE {
        let (own, nearer, farther) = (own[i], a[i].min(b[i]), a[i].max(b[i]));
        let is_surface = (farther != EMPTY) & similar_motion_in_vectors(nearer, farther);
        let is_behind = is_in_front(farther, own) & !similar_motion_in_vectors(nearer, own);
        found[i] = if is_surface & ((own == EMPTY) | is_behind) { nearer } else { own };
    }
    found
}

#[inline(always)]
fn close_cracks_in_vectors(splatted: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key) {
    let (mut holes, mut farthest) = ([0_u64; TILE], [0_u64; TILE]);
    for j in 0..TILE {
        let above = &splatted[j * stride..][..TILE + 2];
        let here = &splatted[(j + 1) * stride..][..TILE + 2];
        let below = &splatted[(j + 2) * stride..][..TILE + 2];
        let own = close_row(row(&here[1..]), row(here), row(&here[2..]));
        let own = close_row(&own, row(&above[1..]), row(&below[1..]));
        for i in 0..TILE {
            holes[i] += u64::from(own[i] == EMPTY);
            // Plus one, so that `EMPTY` becomes 0.
            farthest[i] = farthest[i].max(own[i].wrapping_add(1));
        }
        keys[j * TILE..][..TILE].copy_from_slice(&own);
    }
    let farthest = farthest.into_iter().fold(0, u64::max);
    (holes.iter().sum::<u64>() as u8, farthest.wrapping_sub(1))
}

#[inline(always)]
fn nearest_neighbours_in_vectors(padded: &PaddedTile, limit: i32, nearest: &mut [Key; BLOCK]) -> u64 {
    let mut across = [[EMPTY; TILE]; TILE + 2];
    for j in 0..TILE + 2 {
        for i in 0..TILE {
            across[j][i] = padded[j][i].min(padded[j][i + 1]).min(padded[j][i + 2]);
        }
    }
    let mut changes = [0; TILE];
    for j in 0..TILE {
        let own = row(&padded[j + 1][1..]);
        for i in 0..TILE {
            let first = across[j][i].min(across[j + 1][i]).min(across[j + 2][i]);
            let is_other =
                (own[i] != EMPTY) & is_in_front(first, own[i]) & !motion_within_in_vectors(first, own[i], limit);
            nearest[j * TILE + i] = first;
            changes[i] |= u64::from(is_other) << (j * TILE + i);
        }
    }
    changes.into_iter().fold(0, |all, bits| all | bits)
}

#[inline(always)]
fn nearest_other_motion_in_vectors(padded: &PaddedTile, limit: i32, wanted: u64, others: &mut [Key; BLOCK]) -> u64 {
    others.fill(EMPTY);
    let mut changes = [0; TILE];
    for j in 0..TILE {
        let wanted = wanted >> (j * TILE) & 0xff;
        if wanted == 0 {
            continue;
        }
        let own = row(&padded[j + 1][1..]);
        let mut first = [EMPTY; TILE];
        for neighbours in &padded[j..j + 3] {
            for shift in 0..3 {
                let neighbours = row(&neighbours[shift..]);
                for i in 0..TILE {
                    // `EMPTY` is the largest key and so never the minimum.
                    let other =
                        if motion_within_in_vectors(neighbours[i], own[i], limit) { EMPTY } else { neighbours[i] };
                    first[i] = first[i].min(other);
                }
            }
        }
        for i in 0..TILE {
            let is_wanted = (own[i] != EMPTY) & (wanted >> i & 1 == 1);
            let other = if is_wanted { first[i] } else { EMPTY };
            others[j * TILE + i] = other;
            changes[i] |= u64::from(other != EMPTY) << (j * TILE + i);
        }
    }
    changes.into_iter().fold(0, |all, bits| all | bits)
}

#[inline(always)]
fn vector_range_in_vectors(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] {
    const MAX: u32 = COMPONENT as u32;
    // Biased components. Both are at their maximum in `EMPTY`, and 0 after adding one.
    let (mut low, mut high) = ([[MAX; TILE]; 2], [[0; TILE]; 2]);
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        for i in 0..TILE {
            let (x, y) = ((keys[i] >> 20) as u32 & MAX, keys[i] as u32 & MAX);
            low[0][i] = low[0][i].min(x);
            low[1][i] = low[1][i].min(y);
            high[0][i] = high[0][i].max((x + 1) & MAX);
            high[1][i] = high[1][i].max((y + 1) & MAX);
        }
    }
    let (mut min, mut max) = ([MAX; 2], [0; 2]);
    for c in 0..2 {
        for i in 0..TILE {
            min[c] = min[c].min(low[c][i]);
            max[c] = max[c].max(high[c][i]);
        }
    }
    if max == [0; 2] {
        return [[i32::MAX; 2], [i32::MIN; 2]];
    }
    let [[x, y], [u, v]] = [min, max.map(|v| v - 1)];
    [vector(Key::from(x) << 20 | Key::from(y)), vector(Key::from(u) << 20 | Key::from(v))]
}

#[inline(always)]
fn source_positions_in_vectors(
    keys: &[Key; BLOCK],
    at: [i32; 2],
    time: WarpTime,
    size: [usize; 2],
    previous: &mut Positions,
    current: &mut Positions,
) -> [u64; 2] {
    let [width, height] = size.map(|len| 64 * len as u32);
    let from = at.map(|at| 64 * at);
    let mut outside = [[0; TILE]; 2];
    for j in 0..TILE {
        let keys = row(&keys[j * TILE..]);
        let phases = time.phases(keys, [at[0], at[1] + j as i32]);
        let (mut u, mut v, mut s, mut t) = ([0; TILE], [0; TILE], [0; TILE], [0; TILE]);
        for i in 0..TILE {
            let [x, y] = vector(keys[i]);
            u[i] = from[0] + 64 * i as i32 + scaled(x, phases[i]);
            v[i] = from[1] + 64 * j as i32 + scaled(y, phases[i]);
            s[i] = u[i] - x;
            t[i] = v[i] - y;
            // Negative coordinates wrap to large unsigned values and fail the bounds check.
            let is_previous_outside = ((u[i] + 32) as u32 >= width) | ((v[i] + 32) as u32 >= height);
            let is_current_outside = ((s[i] + 32) as u32 >= width) | ((t[i] + 32) as u32 >= height);
            outside[0][i] |= u64::from(is_previous_outside) << (j * TILE + i);
            outside[1][i] |= u64::from(is_current_outside) << (j * TILE + i);
        }
        previous.x[j * TILE..][..TILE].copy_from_slice(&u);
        previous.y[j * TILE..][..TILE].copy_from_slice(&v);
        current.x[j * TILE..][..TILE].copy_from_slice(&s);
        current.y[j * TILE..][..TILE].copy_from_slice(&t);
    }
    outside.map(|outside| outside.into_iter().fold(0, |all, bits| all | bits))
}

#[inline(always)]
fn tagged_in_vectors(keys: &[Key; BLOCK], tag: u8) -> u64 {
    let mut tagged = [0; TILE];
    for j in (0..TILE).rev() {
        let keys = row(&keys[j * TILE..]);
        for i in 0..TILE {
            tagged[i] = tagged[i] << TILE | u64::from(keys[i] >> 40 & 0xff == u64::from(tag));
        }
    }
    // One bit per row in each column's word.
    tagged.into_iter().enumerate().fold(0, |all, (i, of_column)| all | of_column << i)
}

/// The scalar versions.
mod scalar {
    use super::super::super::key_buffer::Grid;
    use super::super::super::splat_key::{self, is_in_front, motion_within, similar_motion};
    use super::{BLOCK, EMPTY, Key, PaddedTile, Positions, SplatTarget, TILE, Warp, WarpTime, scaled, vector, warped};

    pub(super) fn splat_pixels(
        keys: &[Key; BLOCK],
        at: [i32; 2],
        shift: [i32; 2],
        warp: Warp,
        target: &mut SplatTarget<'_>,
    ) {
        for (index, &key) in keys.iter().enumerate() {
            let at = [at[0] + (index % TILE) as i32, at[1] + (index / TILE) as i32];
            let ([x, y], fraction) = (vector(key), warp.fraction(key, at));
            target.splat(warped(at[0], x, fraction) + shift[0], warped(at[1], y, fraction) + shift[1], key);
        }
    }

    pub(super) fn close_cracks(splatted: &[Key], stride: usize, keys: &mut [Key; BLOCK]) -> (u8, Key) {
        for (index, key) in keys.iter_mut().enumerate() {
            let at = |i: usize, j: usize| splatted[(index / TILE + j) * stride + index % TILE + i];
            *key = at(1, 1);
            for [a, b] in [[at(0, 1), at(2, 1)], [at(1, 0), at(1, 2)]] {
                let is_surface = a != EMPTY && b != EMPTY && similar_motion(a, b);
                if is_surface && (*key == EMPTY || is_in_front(a.max(b), *key) && !similar_motion(a.min(b), *key)) {
                    *key = a.min(b);
                }
            }
        }
        let keys_found = keys.iter().copied().filter(|&key| key != EMPTY);
        ((BLOCK - keys_found.clone().count()) as u8, keys_found.max().unwrap_or(EMPTY))
    }

    pub(super) fn nearest_neighbours(padded: &PaddedTile, limit: i32, nearest: &mut [Key; BLOCK]) -> u64 {
        let mut changes = 0;
        for (index, nearest) in nearest.iter_mut().enumerate() {
            let (i, j) = (index % TILE, index / TILE);
            let own = padded[j + 1][i + 1];
            *nearest = padded[j..j + 3].iter().flat_map(|line| line[i..i + 3].iter().copied()).fold(EMPTY, Key::min);
            let is_other = own != EMPTY && is_in_front(*nearest, own) && !motion_within(*nearest, own, limit);
            changes |= u64::from(is_other) << index;
        }
        changes
    }

    pub(super) fn nearest_other_motion(padded: &PaddedTile, limit: i32, wanted: u64, others: &mut [Key; BLOCK]) -> u64 {
        let mut changes = 0;
        for (index, other) in others.iter_mut().enumerate() {
            let (i, j) = (index % TILE, index / TILE);
            let own = padded[j + 1][i + 1];
            let neighbours = padded[j..j + 3].iter().flat_map(|line| line[i..i + 3].iter().copied());
            let is_wanted = own != EMPTY && wanted >> index & 1 == 1;
            let moves_otherwise = |&key: &Key| is_wanted && key != EMPTY && !motion_within(key, own, limit);
            *other = neighbours.filter(moves_otherwise).fold(EMPTY, Key::min);
            changes |= u64::from(*other != EMPTY) << index;
        }
        changes
    }

    pub(super) fn vector_range(keys: &[Key; BLOCK]) -> [[i32; 2]; 2] {
        let vectors = keys.iter().filter(|&&key| key != EMPTY).map(|&key| vector(key));
        vectors.fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], vector| {
            [[0, 1].map(|c| low[c].min(vector[c])), [0, 1].map(|c| high[c].max(vector[c]))]
        })
    }

    pub(super) fn source_positions(
        keys: &[Key; BLOCK],
        at: [i32; 2],
        time: WarpTime,
        [width, height]: [usize; 2],
        previous: &mut Positions,
        current: &mut Positions,
    ) -> [u64; 2] {
        let grid = Grid { width, height, ..Grid::default() };
        let mut outside = [0; 2];
        for (index, &key) in keys.iter().enumerate() {
            let at = [at[0] + (index % TILE) as i32, at[1] + (index / TILE) as i32];
            let ([x, y], phase) = (vector(key), time.phase(key, at));
            (previous.x[index], previous.y[index]) = (64 * at[0] + scaled(x, phase), 64 * at[1] + scaled(y, phase));
            (current.x[index], current.y[index]) = (previous.x[index] - x, previous.y[index] - y);
            outside[0] |= u64::from(!grid.contains_position([previous.x[index], previous.y[index]])) << index;
            outside[1] |= u64::from(!grid.contains_position([current.x[index], current.y[index]])) << index;
        }
        outside
    }

    pub(super) fn tagged(keys: &[Key; BLOCK], tag: u8) -> u64 {
        keys.iter().enumerate().fold(0, |all, (index, &key)| all | u64::from(splat_key::tag(key) == tag) << index)
    }
}
