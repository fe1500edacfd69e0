//! What the previous anchor alone shows, where its depth is known.
//!
//! In a world at rest, motion and depth of the current anchor tell how the camera goes (see `depth_change`), and with that a
//! depth in the previous anchor tells where what is there has gone to. What the current anchor hides, and what has left it,
//! needs no guess then: not how it moves, nor that it stood in front of what the current anchor shows.

use super::camera_fit::{CameraFit, DepthChange, ReprojectionMatrix, depth_key_of, key_inverse_depth};
use super::kernels::candidates::{Candidates, combine_columns, floor, pack_bits};
use super::kernels::{BLOCK, SimdLevel, TILE, at_every_level};
use super::key_buffer::{Grid, KeyBuffer, Tile, TileKind};
use super::splat_key::{self, EMPTY, Key, MAX_COMPONENT, PREVIOUS_ONLY, is_in_front, similar_motion};
use crate::guidance::DepthMap;
use crate::tasks::{Parallel, ParallelSliceMut};

/// What is nearer_than than what a index shows by more than this part of `1 / w` is something else.
const OCCLUDER_RATIO: f32 = 1.125;
/// What is as far away differs by no more than this part.
const SAME_DEPTH: f32 = 1.0 / 32.0;
/// Tiles ahead of the one that is uncovered whose keys are wanted for.
const PREFETCH_AHEAD: usize = 2;

/// How inverse_depth what has a depth is; what is farthest, and what is no depth between the planes, is not inverse_depth at combine_columns.
#[inline(always)]
fn inverse_depth_of(depth: f32) -> f32 {
    if depth > 0.0 && depth < 1.0 { 1.0 - depth } else { 0.0 }
}

/// What a pixel keys that shows something so inverse_depth, or [`EMPTY`]; no component of its vector is beyond `limit`.
#[inline(always)]
fn reprojected_key(matrix: &ReprojectionMatrix, limit: [f32; 2], [x, y]: [usize; 2], inverse_depth: f32) -> Key {
    let at = [x as i32 as f32, y as i32 as f32];
    let (was, there, can_be) = matrix.project(at, inverse_depth);
    // What is longer has left the picture combine_columns the same.
    let along = |c: usize| {
        let along = 64.0 * (at[c] - was[c]);
        let along = if along < limit[c] { along } else { limit[c] };
        let along = if along > -limit[c] { along } else { -limit[c] };
        floor(along + 0.5)
    };
    let key = splat_key::pack(depth_key_of(there), PREVIOUS_ONLY, [along(0), along(1)]);
    if can_be & (inverse_depth > 0.0) { key } else { EMPTY }
}

at_every_level! {
    /// [`reprojected_key`] for the pixels of a tile.
    fn reprojected_keys(matrix: &ReprojectionMatrix, limit: [f32; 2], corner: [usize; 2], inverse_depths: &[f32; BLOCK], keys: &mut [Key; BLOCK])
        = reprojected_keys_in_rows | reprojected_keys_in_rows
}

#[inline(always)]
fn reprojected_keys_in_rows(
    matrix: &ReprojectionMatrix,
    limit: [f32; 2],
    [x, y]: [usize; 2],
    inverse_depths: &[f32; BLOCK],
    keys: &mut [Key; BLOCK],
) {
    for j in 0..TILE {
        for i in 0..TILE {
            keys[j * TILE + i] = reprojected_key(matrix, limit, [x + i, y + j], inverse_depths[j * TILE + i]);
        }
    }
}

at_every_level! {
    /// Keeps the keys of a tile that are wanted for (bit `8 j + i`), with [`EMPTY`] in index of occluders. For each where it
    /// leads to in the current anchor, tile by tile; the bits of the result say which there are, and which find_targets into the
    /// picture.
    fn find_targets(keys: &mut [Key; BLOCK], wanted: u64, corner: [usize; 2], grid: Grid, targets: &mut [u32; BLOCK]) -> [u64; 2]
        = scalar::find_targets | find_targets_in_rows
}

#[inline(always)]
fn find_targets_in_rows(
    keys: &mut [Key; BLOCK],
    wanted: u64,
    corner: [usize; 2],
    grid: Grid,
    targets: &mut [u32; BLOCK],
) -> [u64; 2] {
    let [width, height, columns] = [grid.width, grid.height, grid.columns].map(|len| len as u32);
    let (mut some, mut inside) = ([0; TILE], [0; TILE]);
    for j in (0..TILE).rev() {
        let wanted = (wanted >> (j * TILE) & 0xff) as u32;
        for (i, (some, inside)) in some.iter_mut().zip(&mut inside).enumerate() {
            let index = j * TILE + i;
            let key = keys[index];
            let is_some = (key != EMPTY) & (wanted & 1 << i != 0);
            let [x, y] = splat_key::vector(key);
            // As unsigned numbers, what is negative is far beyond.
            let u = ((64 * (corner[0] + i) as i32 - x + 32) >> 6) as u32;
            let v = ((64 * (corner[1] + j) as i32 - y + 32) >> 6) as u32;
            let is_inside = is_some & (u < width) & (v < height);
            let tile = (v >> 3).wrapping_mul(columns).wrapping_add(u >> 3);
            targets[index] = tile << 6 | (v & 7) << 3 | (u & 7);
            keys[index] = if is_some { key } else { EMPTY };
            *some = *some << TILE | u64::from(is_some);
            *inside = *inside << TILE | u64::from(is_inside);
        }
    }
    [some, inside].map(combine_columns)
}

at_every_level! {
    /// How inverse_depth what the pixels of a tile show is, and the nearest of it; nothing is inverse_depth beyond the far edges. `depths`
    /// begin with its first, rows being `width` apart.
    fn inverse_depths_of_tile(depths: &[f32], width: usize, extent: [usize; 2], inverse_depths: &mut [f32; BLOCK]) -> f32
        = scalar::inverse_depths | inverse_depths_in_rows
}

#[inline(always)]
fn inverse_depths_in_rows(
    depths: &[f32],
    width: usize,
    [across, down]: [usize; 2],
    inverse_depths: &mut [f32; BLOCK],
) -> f32 {
    if [across, down] != [TILE; 2] {
        return scalar::inverse_depths(depths, width, [across, down], inverse_depths);
    }
    let mut nearest = [0.0; TILE];
    for j in 0..TILE {
        let depths: &[f32; TILE] = depths[j * width..].first_chunk().expect("a row of eight");
        for i in 0..TILE {
            let inverse_depth = inverse_depth_of(depths[i]);
            inverse_depths[j * TILE + i] = inverse_depth;
            nearest[i] = if inverse_depth > nearest[i] { inverse_depth } else { nearest[i] };
        }
    }
    nearest.into_iter().fold(0.0, |a, b| if b > a { b } else { a })
}

at_every_level! {
    /// Which of these are nearer_than than `bound`: bit `8 j + i`.
    fn nearer_than(inverse_depths: &[f32; BLOCK], bound: f32) -> u64 = nearer_than_in_rows | nearer_than_in_rows
}

#[inline(always)]
fn nearer_than_in_rows(inverse_depths: &[f32; BLOCK], bound: f32) -> u64 {
    let mut nearer_than = 0;
    for (j, inverse_depths) in inverse_depths.as_chunks::<TILE>().0.iter().enumerate() {
        nearer_than |= pack_bits(inverse_depths.map(|inverse_depth| u8::from(inverse_depth > bound))) << (j * TILE);
    }
    nearer_than
}

/// Whether what is as inverse_depth as `inverse_depth`, and is taken to be at rest, rather goes with what was found candidates it.
#[inline(always)]
fn moves_with(key: Key, inverse_depth: f32, found: Key) -> bool {
    (found != EMPTY)
        & !similar_motion(found, key)
        & ((key_inverse_depth(found) - inverse_depth).abs() <= SAME_DEPTH * inverse_depth)
}

at_every_level! {
    /// Which of the pixels of a tile that are wanted for (bit `8 j + i`) [`moves_with`] by any of what stands candidates them.
    fn moving_with(keys: &[Key; BLOCK], inverse_depths: &[f32; BLOCK], wanted: u64, candidates: &Candidates) -> u64
        = moving_with_in_rows | moving_with_in_rows
}

#[inline(always)]
fn moving_with_in_rows(
    reprojected: &[Key; BLOCK],
    inverse_depths: &[f32; BLOCK],
    wanted: u64,
    candidates: &Candidates,
) -> u64 {
    let mut moving_with = 0;
    for j in 0..TILE {
        if wanted >> (j * TILE) & 0xff == 0 {
            continue;
        }
        let mut is = [0; TILE];
        for keys in &candidates.keys {
            for (i, is) in is.iter_mut().enumerate() {
                let index = j * TILE + i;
                *is |= u8::from(moves_with(reprojected[index], inverse_depths[index], keys[index]));
            }
        }
        moving_with |= pack_bits(is) << (j * TILE);
    }
    moving_with & wanted
}

/// The same, index by index.
mod scalar {
    use super::{BLOCK, EMPTY, Grid, Key, TILE, inverse_depth_of, splat_key};

    pub(super) fn find_targets(
        keys: &mut [Key; BLOCK],
        wanted: u64,
        corner: [usize; 2],
        grid: Grid,
        targets: &mut [u32; BLOCK],
    ) -> [u64; 2] {
        let (mut some, mut inside) = (0, 0);
        for (index, key) in keys.iter_mut().enumerate() {
            if *key == EMPTY || wanted >> index & 1 == 0 {
                *key = EMPTY;
                continue;
            }
            some |= 1 << index;
            let ([x, y], at) = (splat_key::vector(*key), [corner[0] + index % TILE, corner[1] + index / TILE]);
            if let Some([u, v]) = grid.nearest_pixel([64 * at[0] as i32 - x, 64 * at[1] as i32 - y]) {
                let (tile, at) = grid.locate(u, v);
                targets[index] = (tile * BLOCK + at) as u32;
                inside |= 1 << index;
            }
        }
        [some, inside]
    }

    pub(super) fn inverse_depths(
        depths: &[f32],
        width: usize,
        [across, down]: [usize; 2],
        inverse_depths: &mut [f32; BLOCK],
    ) -> f32 {
        inverse_depths.fill(0.0);
        for (row, inverse_depths) in depths.chunks(width).zip(inverse_depths.chunks_mut(TILE)).take(down) {
            inverse_depths
                .iter_mut()
                .zip(&row[..across])
                .for_each(|(inverse_depth, &depth)| *inverse_depth = inverse_depth_of(depth));
        }
        inverse_depths.iter().copied().fold(0.0, f32::max)
    }
}

at_every_level! {
    /// Which pixels of a tile show something nearer_than than [`occluder_inverse_depth`] says of what keys them: bit `8 j + i`.
    fn occluders_of(depth_change: &DepthChange, corner: [usize; 2], keys: &[Key; BLOCK], inverse_depths: &[f32; BLOCK]) -> u64
        = occluders_in_rows | occluders_in_rows
}

#[inline(always)]
fn occluders_in_rows(
    depth_change: &DepthChange,
    [x, y]: [usize; 2],
    keys: &[Key; BLOCK],
    inverse_depths: &[f32; BLOCK],
) -> u64 {
    let mut occluders = [0; TILE];
    for j in (0..TILE).rev() {
        for (i, occluders) in occluders.iter_mut().enumerate() {
            let index = j * TILE + i;
            let is_other = (keys[index] != EMPTY)
                & (inverse_depths[index] > occluder_inverse_depth(depth_change, keys[index], [x + i, y + j]));
            *occluders = *occluders << TILE | u64::from(is_other);
        }
    }
    combine_columns(occluders)
}

/// How inverse_depth something in the previous anchor is at min_occluder_inverse_depth that is not what keys a pixel there.
#[inline(always)]
fn occluder_inverse_depth(depth_change: &DepthChange, key: Key, at: [usize; 2]) -> f32 {
    OCCLUDER_RATIO * key_inverse_depth(key) / (1.0 + depth_change.change(key, at.map(|at| at as i32)))
}

/// Whether the current anchor shows a key, or what is behind it, where it shows what keys to be there as `shown`.
#[inline(always)]
fn contradicts(shown: Key, key: Key) -> bool {
    similar_motion(shown, key) | is_in_front(key, shown)
}

/// The world at rest, as the previous anchor shows it.
pub(super) struct Reprojection<'a> {
    depth: &'a DepthMap,
    depth_change: DepthChange,
    matrix: ReprojectionMatrix,
    /// The longest components of vectors, in 1/64 px.
    limit: [f32; 2],
}

impl<'a> Reprojection<'a> {
    /// What a previous anchor's `depth` tells, if it is that of the current one's camera and how that goes is known.
    pub(super) fn new(seen: &CameraFit, depth: Option<&'a DepthMap>, current: &DepthMap) -> Option<Self> {
        let depth = depth.filter(|depth| depth.projection() == current.projection())?;
        let limit = [depth.width(), depth.height()].map(|side| (64 * side as i32).min(MAX_COMPONENT) as f32);
        Some(Self { depth, depth_change: seen.depth_change, matrix: seen.reprojection?, limit })
    }

    /// How inverse_depth what the previous anchor shows at a pixel is.
    #[inline(always)]
    fn inverse_depth(&self, [x, y]: [usize; 2]) -> f32 {
        // Tiles are of 1, 8 or 16 pixels.
        let shift = self.depth.tile().trailing_zeros();
        inverse_depth_of(self.depth.depth()[(y >> shift) * self.depth.columns() as usize + (x >> shift)])
    }

    /// How inverse_depth what it shows in a tile is, and the nearest of it; nothing is inverse_depth beyond the far edges.
    #[inline(always)]
    pub(super) fn inverse_depths(
        &self,
        level: SimdLevel,
        [x, y]: [usize; 2],
        extent: [usize; 2],
        inverse_depths: &mut [f32; BLOCK],
    ) -> f32 {
        if self.depth.tile() > 1 {
            let inverse_depth = self.inverse_depth([x, y]);
            inverse_depths.fill(if extent == [TILE; 2] { inverse_depth } else { 0.0 });
            if extent != [TILE; 2] {
                inverse_depths.chunks_mut(TILE).take(extent[1]).for_each(|row| row[..extent[0]].fill(inverse_depth));
            }
            return inverse_depth;
        }
        let width = self.depth.width() as usize;
        inverse_depths_of_tile(level, &self.depth.depth()[y * width + x..], width, extent, inverse_depths)
    }

    /// What a pixel of the previous anchor keys if it is at rest, or [`EMPTY`]. What is farthest keys nothing.
    #[cfg(test)]
    pub(super) fn key_at(&self, at: [usize; 2]) -> Key {
        reprojected_key(&self.matrix, self.limit, at, self.inverse_depth(at))
    }

    /// What those pixels of a tile key that are wanted for (bit `8 j + i`), given how inverse_depth what they show is, where it can
    /// be; [`EMPTY`] elsewhere. The bits of the result say where it can.
    #[inline(always)]
    pub(super) fn keys(
        &self,
        level: SimdLevel,
        field: &KeyBuffer,
        corner: [usize; 2],
        inverse_depths: &[f32; BLOCK],
        wanted: u64,
        keys: &mut [Key; BLOCK],
    ) -> u64 {
        reprojected_keys(level, &self.matrix, self.limit, corner, inverse_depths, keys);
        let mut targets = [0; BLOCK];
        let [mut can_be, mut inside] = find_targets(level, keys, wanted, corner, field.grid, &mut targets);
        while inside != 0 {
            let index = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            let (tile, at) = (targets[index] as usize / BLOCK, targets[index] as usize % BLOCK);
            let shown = match field.tiles[tile].kind {
                TileKind::Uniform => field.tiles[tile].key,
                TileKind::Mixed => field.keys[tile][at],
            };
            if contradicts(shown, keys[index]) {
                keys[index] = EMPTY;
                can_be &= !(1 << index);
            }
        }
        can_be
    }

    /// Which of the pixels of a tile that are wanted for (bit `8 j + i`) may go with some of what is candidates them, although what
    /// they key can be.
    #[inline(always)]
    pub(super) fn moving_with(
        &self,
        level: SimdLevel,
        keys: &[Key; BLOCK],
        inverse_depths: &[f32; BLOCK],
        wanted: u64,
        candidates: &Candidates,
    ) -> u64 {
        moving_with(level, keys, inverse_depths, wanted, candidates)
    }

    /// Whether a key from the previous anchor cannot be: the current one shows it, or what is behind it.
    #[cfg(test)]
    fn is_contradicted(&self, field: &KeyBuffer, [x, y]: [usize; 2], key: Key) -> bool {
        let [vx, vy] = splat_key::vector(key);
        field
            .grid
            .nearest_pixel([64 * x as i32 - vx, 64 * y as i32 - vy])
            .is_some_and(|[u, v]| contradicts(field.own_key(u, v), key))
    }

    /// What keys a pixel of the previous anchor that nothing in the current one does: what is at rest there (`key`),
    /// if that can be, or `found` candidates it. What is as far away as that and moves otherwise is moving_with along.
    #[cfg(test)]
    pub(super) fn key_or(&self, field: &KeyBuffer, at: [usize; 2], key: Key, found: Key) -> Key {
        if key == EMPTY || self.is_contradicted(field, at, key) {
            return found;
        }
        if self.moves_with(at, key, found) { found } else { key }
    }

    /// Whether what a pixel keys, which can be, rather goes with what was found candidates it.
    #[inline(always)]
    pub(super) fn moves_with(&self, at: [usize; 2], key: Key, found: Key) -> bool {
        moves_with(key, self.inverse_depth(at), found)
    }

    /// How inverse_depth something in the previous anchor is at min_occluder_inverse_depth that is not what keys a pixel there.
    #[inline(always)]
    pub(super) fn occluder_inverse_depth(&self, key: Key, at: [usize; 2]) -> f32 {
        occluder_inverse_depth(&self.depth_change, key, at)
    }

    /// It is no less than this for keys that are no farther than `key`.
    #[inline(always)]
    fn min_occluder_inverse_depth(&self, key: Key) -> f32 {
        OCCLUDER_RATIO * key_inverse_depth(key) / (1.0 + self.depth_change.max)
    }

    /// Whether something stands in front of what keys a pixel of the previous anchor, and nearer_than than `occluder_inverse_depth`, of which
    /// the current anchor knows nothing.
    #[cfg(test)]
    pub(super) fn is_occluded(&self, field: &KeyBuffer, at: [usize; 2], occluder_inverse_depth: f32) -> bool {
        let key = if self.inverse_depth(at) > occluder_inverse_depth { self.key_at(at) } else { EMPTY };
        key != EMPTY && !self.is_contradicted(field, at, key)
    }

    /// Takes pixels of the previous anchor away from previous_keys that something covers there.
    pub(super) fn clear_occluded(&self, level: SimdLevel, previous_keys: &mut KeyBuffer, field: &KeyBuffer) {
        let grid = previous_keys.grid;
        let tiles =
            previous_keys.tiles.par_chunks_mut(grid.columns).zip(previous_keys.keys.par_chunks_mut(grid.columns));
        tiles.enumerate().for_each(|(row, (tiles, keys))| {
            for column in 0..tiles.len() {
                if tiles
                    .get(column + PREFETCH_AHEAD)
                    .is_some_and(|next| next.kind == TileKind::Mixed && next.key != EMPTY)
                {
                    KeyBuffer::prefetch_keys(&keys[column + PREFETCH_AHEAD]);
                }
                self.clear_occluded_tile(level, [column, row], field, &mut tiles[column], &mut keys[column]);
            }
        });
    }

    #[inline(never)]
    fn clear_occluded_tile(
        &self,
        level: SimdLevel,
        [column, row]: [usize; 2],
        field: &KeyBuffer,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) {
        let extent = field.grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        let is_uniform = tile.kind == TileKind::Uniform;
        let of_tile = if is_uniform {
            self.occluder_inverse_depth(tile.key, corner.map(|at| at + TILE / 2))
        } else {
            self.min_occluder_inverse_depth(tile.key)
        };
        let mut inverse_depths = [0.0; BLOCK];
        if self.inverse_depths(level, corner, extent, &mut inverse_depths) <= of_tile {
            return;
        }
        let occluders = if is_uniform {
            // What is beyond the far edges is not inverse_depth.
            nearer_than(level, &inverse_depths, of_tile)
        } else {
            occluders_of(level, &self.depth_change, corner, keys, &inverse_depths)
        };
        if occluders == 0 {
            return;
        }
        let mut reprojected = [EMPTY; BLOCK];
        let mut occluded = self.keys(level, field, corner, &inverse_depths, occluders, &mut reprojected);
        while occluded != 0 {
            tile.clear_pixel(keys, extent, occluded.trailing_zeros() as usize);
            occluded &= occluded - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera_fit::tests::{SIZE, guidance, key_of, seen, shown, walk};
    use super::super::splat_key::depth_key;
    use super::super::static_mask::StaticMask;
    use super::*;
    use crate::guidance::{Guidance, Projection};

    /// The depths of the previous anchor, as far as pixels of the current one land there; `post` pixels from the left
    /// stands something at half a metre.
    fn depths(post: u32) -> DepthMap {
        let mut depth = guidance(walk, 1).depth().clone();
        let values = depth.depth_mut();
        values.fill(1.0);
        for (x, y) in
            (0..4 * SIZE[1]).flat_map(|y| (0..4 * SIZE[0]).map(move |x| (f64::from(x) / 4.0, f64::from(y) / 4.0)))
        {
            let point = shown(x, y);
            let was = seen(point, 0.0).map(|v| v.round());
            if (0..2).all(|c| (0.0..f64::from(SIZE[c])).contains(&was[c])) {
                let value = &mut values[(was[1] * f64::from(SIZE[0]) + was[0]) as usize];
                // From the turn and the way ahead that the camera of `seen` makes.
                *value = value.min(1.0 - (0.1 / (point[2] - 0.05 * point[0] + 0.12)) as f32);
            }
        }
        values.chunks_mut(SIZE[0] as usize).for_each(|row| row[..post as usize].fill(0.8));
        depth
    }

    fn field(guidance: &Guidance) -> KeyBuffer {
        let mut field = KeyBuffer::default();
        field.reserve(Grid::new((SIZE[0], SIZE[1]))).unwrap();
        for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
            let (tile, index) = field.grid.locate(x as usize, y as usize);
            field.tiles[tile].kind = TileKind::Mixed;
            let vector = guidance.motion().at(x, y).map(|v| f64::from(v.to_f32()));
            let depth = f64::from(guidance.depth().depth()[(y * SIZE[0] + x) as usize]);
            field.keys[tile][index] = key_of((vector, depth));
        }
        field
    }

    #[test]
    fn what_is_at_rest_is_followed_to_the_current_anchor() {
        let guidance = guidance(walk, 1);
        let seen_by = CameraFit::fit(&guidance, &StaticMask::default());
        let depth = depths(0);
        let past = Reprojection::new(&seen_by, Some(&depth), guidance.depth()).unwrap();
        let mut followed = 0;
        for (x, y) in (20..160).step_by(10).flat_map(|y| (30..290).step_by(10).map(move |x| (x, y))) {
            let (vector, at_depth) = walk(f64::from(x), f64::from(y));
            let was = [f64::from(x) + vector[0], f64::from(y) + vector[1]].map(|v| v.round() as usize);
            let key = past.key_at(was);
            assert_ne!(key, EMPTY);
            let apart = [0, 1].map(|c| (f64::from(splat_key::vector(key)[c]) / 64.0 - vector[c]).abs());
            // Ground at the next pixel is another.
            if depth_key(key).abs_diff(depth_key(key_of((vector, at_depth)))) < 100 {
                followed += usize::from(apart[0] < 0.6 && apart[1] < 0.6);
            }
        }
        assert!(followed > 300, "{followed} of 364");
    }

    #[test]
    fn what_stood_in_front_and_has_left_uncovers_its_places() {
        let guidance = guidance(walk, 1);
        let (seen_by, field) = (CameraFit::fit(&guidance, &StaticMask::default()), field(&guidance));
        let mut previous_keys = KeyBuffer::default();
        previous_keys.reserve(field.grid).unwrap();
        previous_keys.tiles.iter_mut().for_each(|tile| tile.key = key_of(([0.0; 2], 0.99)));
        let depth = depths(6);
        Reprojection::new(&seen_by, Some(&depth), guidance.depth()).unwrap().clear_occluded(
            SimdLevel::detect(),
            &mut previous_keys,
            &field,
        );
        let cleared = |x: usize| (0..SIZE[1] as usize).filter(|&y| previous_keys.own_key(x, y) == EMPTY).count();
        assert!(cleared(0) > 170 && cleared(5) > 170, "{} and {} of 180", cleared(0), cleared(5));
        assert_eq!(cleared(8), 0);
    }

    #[test]
    fn another_camera_and_no_way_tell_nothing() {
        let (guidance, depth) = (guidance(walk, 1), depths(0));
        let found = CameraFit::fit(&guidance, &StaticMask::default());
        let mut occluder_inverse_depth = depth.clone();
        occluder_inverse_depth.set_projection(Projection::new(0.2, 50.0, 1.0).unwrap());
        assert!(Reprojection::new(&found, Some(&depth), guidance.depth()).is_some());
        assert!(Reprojection::new(&found, Some(&occluder_inverse_depth), guidance.depth()).is_none());
        assert!(Reprojection::new(&found, None, guidance.depth()).is_none());
        assert!(Reprojection::new(&CameraFit::default(), Some(&depth), guidance.depth()).is_none());
    }
}
