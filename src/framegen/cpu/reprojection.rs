//! Reprojection of the previous anchor's depth.
//!
//! In a static world the camera fit gives the position in the current anchor of every point that the previous anchor's
//! depth describes. Pixels that are visible in the previous anchor only then have exact motion and a known depth order
//! instead of inherited ones.

use super::camera_fit::{CameraFit, ReprojectionMatrix};
use super::kernels::candidates::{Candidates, combine_columns, floor, pack_bits};
use super::kernels::{BLOCK, SimdLevel, TILE, at_every_level};
use super::key_buffer::{Grid, KeyBuffer, Tile, TileKind};
use super::splat_key::{
    self, EMPTY, Key, MAX_COMPONENT, PREVIOUS_ONLY, depth_key_from, is_in_front, key_inverse_depth, similar_motion,
};
use super::warp::DepthChange;
use crate::guidance::DepthMap;
use crate::tasks::{Parallel, ParallelSliceMut};

/// A surface whose inverse depth is larger by this factor is an occluder.
const OCCLUDER_RATIO: f32 = 1.125;
/// Largest relative difference between inverse depths of one surface.
const SAME_DEPTH: f32 = 1.0 / 32.0;

#[cfg(test)]
crate::shader_constants::shader_constants!("REPROJECTION_": float OCCLUDER_RATIO, float SAME_DEPTH);

/// Tiles whose keys are prefetched ahead of the current one.
const PREFETCH_AHEAD: usize = 2;

/// Inverse depth `1 - d` for `0 < d < 1`; 0 for the far plane and for invalid depths.
#[inline(always)]
fn inverse_depth_of(depth: f32) -> f32 {
    if depth > 0.0 && depth < 1.0 { 1.0 - depth } else { 0.0 }
}

/// Key of a static pixel of the previous anchor with an inverse depth, its vector clamped to `limit`; [`EMPTY`] if it
/// cannot be reprojected.
#[inline(always)]
fn reprojected_key(matrix: &ReprojectionMatrix, limit: [f32; 2], [x, y]: [usize; 2], inverse_depth: f32) -> Key {
    let at = [x as i32 as f32, y as i32 as f32];
    let (position, projected_depth, is_valid) = matrix.project(at, inverse_depth);
    // A vector that exceeds the limit leads outside the picture in either case.
    let along = |c: usize| {
        let along = 64.0 * (at[c] - position[c]);
        let along = if along < limit[c] { along } else { limit[c] };
        let along = if along > -limit[c] { along } else { -limit[c] };
        floor(along + 0.5)
    };
    let key = splat_key::pack(depth_key_from(projected_depth), PREVIOUS_ONLY, [along(0), along(1)]);
    if is_valid & (inverse_depth > 0.0) { key } else { EMPTY }
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
    /// Sets the keys of pixels that are not `wanted` (bit `8 j + i`) to [`EMPTY`]. Computes the pixel of the current
    /// anchor to which each remaining key leads, as an index in tile order. Returns bits of the remaining keys, and of
    /// those that lead inside the picture.
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
            // Negative coordinates wrap to large unsigned values and fail the bounds check.
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
    /// Inverse depths of the pixels of a tile, 0 outside the picture; returns the largest. `depths` starts at the
    /// tile's first pixel and has rows of `width` values.
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
    /// Pixels whose inverse depth exceeds `bound`, as bits `8 j + i`.
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

/// Whether a pixel belongs to the surface of a candidate beside it, which does not move like the static world: about
/// equal inverse depth, but different motion.
#[inline(always)]
fn moves_with(key: Key, inverse_depth: f32, found: Key) -> bool {
    (found != EMPTY)
        & !similar_motion(found, key)
        & ((key_inverse_depth(found) - inverse_depth).abs() <= SAME_DEPTH * inverse_depth)
}

at_every_level! {
    /// `wanted` pixels of a tile that [`moves_with`] holds for with one of their candidates, as bits `8 j + i`.
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

/// The scalar versions.
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
    /// Pixels of a tile whose inverse depth exceeds that of an occluder of their key, as bits `8 j + i`.
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

/// Smallest inverse depth in the previous anchor of a surface that occludes the key's.
#[inline(always)]
fn occluder_inverse_depth(depth_change: &DepthChange, key: Key, at: [usize; 2]) -> f32 {
    OCCLUDER_RATIO * key_inverse_depth(key) / (1.0 + depth_change.change(key, at.map(|at| at as i32)))
}

/// Whether the current anchor, which has the key `key_there` at the reprojected position, shows the same surface or one
/// behind it. Then nothing occludes that position, and the reprojected key is wrong.
#[inline(always)]
fn contradicts(key_there: Key, key: Key) -> bool {
    similar_motion(key_there, key) | is_in_front(key, key_there)
}

/// The previous anchor's depth with the camera motion.
pub(super) struct Reprojection<'a> {
    depth: &'a DepthMap,
    depth_change: DepthChange,
    matrix: ReprojectionMatrix,
    /// Largest components of motion vectors, in 1/64 px.
    limit: [f32; 2],
}

impl<'a> Reprojection<'a> {
    /// `None` without a depth, without camera motion, or if the depth has another projection than the current anchor's.
    pub(super) fn new(camera: &CameraFit, depth: Option<&'a DepthMap>, current: &DepthMap) -> Option<Self> {
        let depth = depth.filter(|depth| depth.projection() == current.projection())?;
        let limit = [depth.width(), depth.height()].map(|side| (64 * side as i32).min(MAX_COMPONENT) as f32);
        Some(Self { depth, depth_change: camera.depth_change, matrix: camera.reprojection?, limit })
    }

    /// Inverse depth of a pixel of the previous anchor.
    #[inline(always)]
    fn inverse_depth(&self, [x, y]: [usize; 2]) -> f32 {
        // Tiles are 1, 8 or 16 pixels wide.
        let shift = self.depth.tile().trailing_zeros();
        inverse_depth_of(self.depth.depth()[(y >> shift) * self.depth.columns() as usize + (x >> shift)])
    }

    /// Inverse depths of the previous anchor's pixels in a tile, 0 outside the picture; returns the largest.
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

    /// Reprojected key of a pixel of the previous anchor; [`EMPTY`] at the far plane.
    #[cfg(test)]
    pub(super) fn key_at(&self, at: [usize; 2]) -> Key {
        reprojected_key(&self.matrix, self.limit, at, self.inverse_depth(at))
    }

    /// Reprojected keys of the `wanted` pixels of a tile (bit `8 j + i`), [`EMPTY`] if the current anchor contradicts
    /// them. Returns the bits of the others.
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
        let [mut remaining, mut inside] = find_targets(level, keys, wanted, corner, field.grid, &mut targets);
        while inside != 0 {
            let index = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            let (tile, at) = (targets[index] as usize / BLOCK, targets[index] as usize % BLOCK);
            let key_there = match field.tiles[tile].kind {
                TileKind::Uniform => field.tiles[tile].key,
                TileKind::Mixed => field.keys[tile][at],
            };
            if contradicts(key_there, keys[index]) {
                keys[index] = EMPTY;
                remaining &= !(1 << index);
            }
        }
        remaining
    }

    /// `wanted` pixels of a tile (bit `8 j + i`) that may belong to a moving surface beside them although their
    /// reprojected key is not contradicted.
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

    /// Whether the current anchor contradicts a reprojected key: it shows the key's surface, or one behind it.
    #[cfg(test)]
    fn is_contradicted(&self, field: &KeyBuffer, [x, y]: [usize; 2], key: Key) -> bool {
        let [vx, vy] = splat_key::vector(key);
        field
            .grid
            .nearest_pixel([64 * x as i32 - vx, 64 * y as i32 - vy])
            .is_some_and(|[u, v]| contradicts(field.own_key(u, v), key))
    }

    /// Key of a pixel of the previous anchor that no pixel of the current one covers: the reprojected `key` if it is
    /// not contradicted, else the candidate `found`. A candidate at the same depth that moves differently wins.
    #[cfg(test)]
    pub(super) fn key_or(&self, field: &KeyBuffer, at: [usize; 2], key: Key, found: Key) -> Key {
        if key == EMPTY || self.is_contradicted(field, at, key) {
            return found;
        }
        if self.moves_with(at, key, found) { found } else { key }
    }

    /// Whether a pixel with an uncontradicted key belongs to the surface of a candidate beside it.
    #[inline(always)]
    pub(super) fn moves_with(&self, at: [usize; 2], key: Key, found: Key) -> bool {
        moves_with(key, self.inverse_depth(at), found)
    }

    /// Smallest inverse depth in the previous anchor of a surface that occludes the key's.
    #[inline(always)]
    pub(super) fn occluder_inverse_depth(&self, key: Key, at: [usize; 2]) -> f32 {
        occluder_inverse_depth(&self.depth_change, key, at)
    }

    /// Lower bound of the same for keys that are not farther than `key`.
    #[inline(always)]
    fn min_occluder_inverse_depth(&self, key: Key) -> f32 {
        OCCLUDER_RATIO * key_inverse_depth(key) / (1.0 + self.depth_change.max)
    }

    /// Whether a surface with more than this inverse depth occludes a pixel of the previous anchor, invisible in the
    /// current one.
    #[cfg(test)]
    pub(super) fn is_occluded(&self, field: &KeyBuffer, at: [usize; 2], occluder_inverse_depth: f32) -> bool {
        let key = if self.inverse_depth(at) > occluder_inverse_depth { self.key_at(at) } else { EMPTY };
        key != EMPTY && !self.is_contradicted(field, at, key)
    }

    /// Removes keys of the current anchor from pixels of the previous anchor where a nearer surface occludes them.
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
            // Pixels outside the picture have inverse depth 0.
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
    use super::super::camera_fit::tests::{SIZE, guidance, key_of, project, surface_point, walk};
    use super::super::splat_key::depth_key;
    use super::super::static_mask::StaticMask;
    use super::*;
    use crate::guidance::{Guidance, Projection};

    /// Depths of the previous anchor, splatted from the current one; in the left `post` columns a post half a metre
    /// away.
    fn depths(post: u32) -> DepthMap {
        let mut depth = guidance(walk, 1).depth().clone();
        let values = depth.depth_mut();
        values.fill(1.0);
        for (x, y) in
            (0..4 * SIZE[1]).flat_map(|y| (0..4 * SIZE[0]).map(move |x| (f64::from(x) / 4.0, f64::from(y) / 4.0)))
        {
            let point = surface_point(x, y);
            let previous = project(point, 0.0).map(|v| v.round());
            if (0..2).all(|c| (0.0..f64::from(SIZE[c])).contains(&previous[c])) {
                let value = &mut values[(previous[1] * f64::from(SIZE[0]) + previous[0]) as usize];
                // Distance in the previous anchor, from the rotation and translation of `project`.
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
    fn static_pixels_are_reprojected_to_the_current_anchor() {
        let guidance = guidance(walk, 1);
        let camera = CameraFit::fit(&guidance, &StaticMask::default());
        let depth = depths(0);
        let reprojection = Reprojection::new(&camera, Some(&depth), guidance.depth()).unwrap();
        let mut matching = 0;
        for (x, y) in (20..160).step_by(10).flat_map(|y| (30..290).step_by(10).map(move |x| (x, y))) {
            let (vector, at_depth) = walk(f64::from(x), f64::from(y));
            let previous = [f64::from(x) + vector[0], f64::from(y) + vector[1]].map(|v| v.round() as usize);
            let key = reprojection.key_at(previous);
            assert_ne!(key, EMPTY);
            let error = [0, 1].map(|c| (f64::from(splat_key::vector(key)[c]) / 64.0 - vector[c]).abs());
            // Adjacent pixels of the ground have other depths.
            if depth_key(key).abs_diff(depth_key(key_of((vector, at_depth)))) < 100 {
                matching += usize::from(error[0] < 0.6 && error[1] < 0.6);
            }
        }
        assert!(matching > 300, "{matching} of 364");
    }

    #[test]
    fn keys_behind_an_occluder_that_left_are_cleared() {
        let guidance = guidance(walk, 1);
        let (camera, field) = (CameraFit::fit(&guidance, &StaticMask::default()), field(&guidance));
        let mut previous_keys = KeyBuffer::default();
        previous_keys.reserve(field.grid).unwrap();
        previous_keys.tiles.iter_mut().for_each(|tile| tile.key = key_of(([0.0; 2], 0.99)));
        let depth = depths(6);
        Reprojection::new(&camera, Some(&depth), guidance.depth()).unwrap().clear_occluded(
            SimdLevel::detect(),
            &mut previous_keys,
            &field,
        );
        let cleared = |x: usize| (0..SIZE[1] as usize).filter(|&y| previous_keys.own_key(x, y) == EMPTY).count();
        assert!(cleared(0) > 170 && cleared(5) > 170, "{} and {} of 180", cleared(0), cleared(5));
        assert_eq!(cleared(8), 0);
    }

    #[test]
    fn no_reprojection_without_camera_motion_or_with_another_projection() {
        let (guidance, depth) = (guidance(walk, 1), depths(0));
        let found = CameraFit::fit(&guidance, &StaticMask::default());
        let mut other = depth.clone();
        other.set_projection(Projection::new(0.2, 50.0, 1.0).unwrap());
        assert!(Reprojection::new(&found, Some(&depth), guidance.depth()).is_some());
        assert!(Reprojection::new(&found, Some(&other), guidance.depth()).is_none());
        assert!(Reprojection::new(&found, None, guidance.depth()).is_none());
        assert!(Reprojection::new(&CameraFit::default(), Some(&depth), guidance.depth()).is_none());
    }
}
