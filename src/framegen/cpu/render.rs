//! Colours of a frame from the two anchors.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::colour::Colour;
use super::edge_antialiasing::{antialias, blend_mask};
use super::kernels::tile_keys;
use super::kernels::{BLOCK, Block, MergeRule, Positions, SimdLevel, Source, TILE, TileSource};
use super::key_buffer::{Grid, KeyBuffer, Tile, TileKind, for_each_bit, tile_mask};
use super::rules::Rules;
use super::splat_key::{
    self, EMPTY, HOLE, Key, PHASE_ONE, PREVIOUS_ONLY, is_in_front, motion_within, same_slope, scaled, similar_motion,
};
use super::static_overlay::{AnchorIndex, Anchors, StaticPixels};
use super::warp::{Warp, WarpTime};
use crate::Raster;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Samples that differ by at most this many levels are equal, and the one nearer in time is used unchanged.
pub(super) const MAX_EQUAL_DIFFERENCE: u8 = 1;
/// Samples that differ by more levels are checked for occlusion and overlays. Optical flow follows overlays instead of
/// the background behind them, so it is trusted more.
const DOUBT_THRESHOLD: u8 = 24;
const DOUBT_THRESHOLD_OF_FLOW: u8 = 64;
/// The same threshold at the edges of surfaces.
pub(super) const STRICT_DOUBT_THRESHOLD: u8 = 4;

/// Largest difference (1/64 px, per component) between motion vectors that lead to the same colours.
pub(super) const DISTINCT_MOTION: i32 = 8;
/// Largest difference between the anchors, in levels, for a pixel beside foreground that is assigned to it.
pub(super) const EDGE_TOLERANCE: f32 = 45.0;
/// Difference that is assumed between the anchors, in levels, where one of them is occluded. Occlusion from optical
/// flow is less certain.
const OCCLUDED_DIFFERENCE: f32 = 30.0;
const OCCLUDED_DIFFERENCE_OF_FLOW: f32 = 40.0;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "RENDER_": float MAX_EQUAL_DIFFERENCE, float DOUBT_THRESHOLD, float DOUBT_THRESHOLD_OF_FLOW,
    float STRICT_DOUBT_THRESHOLD, int DISTINCT_MOTION, float EDGE_TOLERANCE, float OCCLUDED_DIFFERENCE,
    float OCCLUDED_DIFFERENCE_OF_FLOW
);

/// Difference from which samples are checked for occlusion and overlays, in levels.
pub(super) const fn doubt_threshold(is_optical_flow: bool) -> u8 {
    if is_optical_flow { DOUBT_THRESHOLD_OF_FLOW } else { DOUBT_THRESHOLD }
}

/// Difference that is assumed where an anchor is occluded, in levels.
pub(super) const fn occluded_difference(is_optical_flow: bool) -> f32 {
    if is_optical_flow { OCCLUDED_DIFFERENCE_OF_FLOW } else { OCCLUDED_DIFFERENCE }
}

/// A frame to interpolate between two anchors.
pub(super) struct Interpolation<'a, P> {
    pub(super) level: SimdLevel,
    /// The rules that apply.
    pub(super) rules: Rules,
    pub(super) previous: Source<'a, P>,
    pub(super) current: Source<'a, P>,
    /// Keys of the frame.
    pub(super) frame_keys: &'a KeyBuffer,
    /// Keys of the current anchor.
    pub(super) field: &'a KeyBuffer,
    /// Keys of the previous anchor.
    pub(super) previous_keys: &'a KeyBuffer,
    /// Phase, in units of 1 / [`PHASE_ONE`].
    pub(super) phase: i32,
    /// The same as a warp time.
    pub(super) time: WarpTime,
    /// Static pixels of the anchors.
    pub(super) static_pixels: &'a StaticPixels,
    /// Whether motion is optical flow, which comes without depth.
    pub(super) is_optical_flow: bool,
}

/// Counts of a rendered picture.
pub(super) struct Rendered {
    /// Pixels to which no visible pixel of the current anchor is splatted.
    pub(super) uncovered: usize,
    /// Pixels that neither anchor shows.
    pub(super) hidden: usize,
}

/// Positions of a pixel in the two anchors, in 1/64 px.
#[derive(Clone, Copy)]
struct SourcePositions {
    previous: [i32; 2],
    current: [i32; 2],
}

impl<P: Colour> Interpolation<'_, P> {
    /// Renders the picture. `hidden` receives one bit per pixel of a tile that neither anchor shows.
    pub(super) fn render(&self, out: &mut Raster<P>, hidden: &mut [u64]) -> Rendered {
        let grid = self.frame_keys.grid;
        let weight = ((self.phase + 16) >> 5).clamp(1, 127) as u8;
        let doubt_threshold = doubt_threshold(self.is_optical_flow);
        let rule = MergeRule {
            weight,
            nearer_is_current: self.phase >= PHASE_ONE / 2,
            max_equal_difference: MAX_EQUAL_DIFFERENCE,
            doubt_threshold,
        };
        let (uncovered, hidden_pixels) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
        rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
            let block = Block {
                previous: [P::OPAQUE_BLACK; BLOCK],
                current: [P::OPAQUE_BLACK; BLOCK],
                merged: [P::OPAQUE_BLACK; BLOCK],
            };
            let mut blocks = [block; 2];
            let (mut uncovered_here, mut hidden_here) = (0, 0);
            for (column, hidden) in hidden.iter_mut().enumerate() {
                let pixels = &mut pixels[column * TILE..];
                if column + 1 < grid.columns {
                    self.prefetch_mixed(column + 1, row);
                }
                uncovered_here += self.render_tile(column, row, &rule, &mut blocks, pixels, hidden);
                hidden_here += hidden.count_ones() as usize;
            }
            uncovered.fetch_add(uncovered_here, Ordering::Relaxed);
            hidden_pixels.fetch_add(hidden_here, Ordering::Relaxed);
        });
        Rendered { uncovered: uncovered.into_inner(), hidden: hidden_pixels.into_inner() }
    }

    /// Prefetches the keys and pixels of a mixed tile.
    #[inline(always)]
    fn prefetch_mixed(&self, column: usize, row: usize) {
        let tile_index = row * self.frame_keys.grid.columns + column;
        let tile = &self.frame_keys.tiles[tile_index];
        if tile.kind == TileKind::Mixed {
            KeyBuffer::prefetch_keys(&self.frame_keys.keys[tile_index]);
            let positions = self.positions([column * TILE, row * TILE], tile.key, self.phase);
            self.previous.prefetch_tile(positions.previous, 2);
            self.current.prefetch_tile(positions.current, 2);
        }
    }

    /// Renders a tile; returns the number of its pixels to which no visible pixel of the current anchor is splatted.
    #[inline(never)]
    fn render_tile(
        &self,
        column: usize,
        row: usize,
        rule: &MergeRule,
        [block, with_foreground]: &mut [Block<P>; 2],
        pixels: &mut [P],
        hidden: &mut u64,
    ) -> usize {
        let grid = self.frame_keys.grid;
        let tile_index = row * grid.columns + column;
        let tile = &self.frame_keys.tiles[tile_index];
        let [across, down] = grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        *hidden = 0;
        let phase = self.time.phase_of_tile(tile.key, corner);
        let positions = self.positions(corner, tile.key, phase);
        let is_whole = tile.kind == TileKind::Uniform && [across, down] == [TILE, TILE];
        let doubtful = if is_whole && self.is_visible_in_both(tile.key, positions) {
            let previous = TileSource { picture: self.previous, at: positions.previous };
            let current = TileSource { picture: self.current, at: positions.current };
            Some(P::merge_tile(self.level, previous, current, rule, pixels, grid.width))
        } else if is_whole && self.is_only_in_current([column, row], tile.key, positions) {
            P::sample_tile(self.level, TileSource { picture: self.current, at: positions.current }, pixels, grid.width);
            let anchors = self.anchors();
            let mask_in_current = grid
                .nearest_pixel(positions.current)
                .map_or(u64::MAX, |at| self.static_pixels.block(self.level, &anchors, at));
            Some(self.static_pixels.tile(self.level, &anchors, [column, row]) | mask_in_current)
        } else {
            None
        };
        if let Some(mask) = doubtful {
            for_each_bit(mask, |index| {
                let [i, j] = [index % TILE, index / TILE];
                let positions = self.positions([corner[0] + i, corner[1] + j], tile.key, phase);
                let pixel = &mut pixels[j * grid.width + i];
                match self.choose([corner[0] + i, corner[1] + j], tile.key, positions, true) {
                    Choice::Blend => {}
                    Choice::Previous => *pixel = P::sample(self.previous, positions.previous),
                    Choice::Current => *pixel = P::sample(self.current, positions.current),
                    Choice::Static => *pixel = self.static_pixel(corner[0] + i, corner[1] + j, rule),
                    Choice::Hidden => *hidden |= 1 << index,
                }
            });
            return 0;
        }

        let mut keys = match tile.kind {
            TileKind::Uniform => [tile.key; BLOCK],
            TileKind::Mixed => self.frame_keys.keys[tile_index],
        };
        let (mut previous, mut current) =
            (Positions { x: [0; BLOCK], y: [0; BLOCK] }, Positions { x: [0; BLOCK], y: [0; BLOCK] });
        let (mut uncovered, mut uncertain, mut previous_only, mut static_drawn) = (0, 0, 0, 0);
        if tile.kind == TileKind::Mixed {
            if [across, down] != [TILE, TILE] {
                // Pixels outside the picture get a key without motion.
                let outside = (0..BLOCK).filter(|index| index % TILE >= across || index / TILE >= down);
                outside.for_each(|index| keys[index] = splat_key::pack(0, 0, [0; 2]));
            }
            if tile.holes > 0 {
                let inherited = &self.frame_keys.inherited[tile_index];
                for (key, &inherited) in keys.iter_mut().zip(inherited).filter(|(key, _)| **key == EMPTY) {
                    (*key, uncovered) = (inherited, uncovered + 1);
                }
                uncertain |= tile_keys::tagged(self.level, &keys, HOLE);
            }
            previous_only = tile_keys::tagged(self.level, &keys, PREVIOUS_ONLY);
            uncovered += previous_only.count_ones() as usize;
            uncertain |= previous_only;
        }
        let can_blend_edges = self.is_optical_flow
            && self.rules.has(super::Rule::EdgeAntialiasing)
            && tile.kind == TileKind::Mixed
            && [across, down] == [TILE, TILE];
        let blend_mask = if can_blend_edges { blend_mask(self.level, &keys, uncertain) } else { 0 };
        let from = corner.map(|at| at as i32);
        let size = [grid.width, grid.height];
        let outside = if is_whole {
            tile_positions(grid, positions, &mut previous, &mut current)
        } else {
            tile_keys::source_positions(self.level, &keys, from, self.time, size, &mut previous, &mut current)
        };
        uncertain |= outside[0] | outside[1];
        // Keys that the visibility test reads are prefetched while the pixels are sampled.
        for index in (0..BLOCK).step_by(TILE).flat_map(|first| [first, first + TILE - 1]) {
            self.previous_keys.prefetch([previous.x[index], previous.y[index]]);
            self.field.prefetch([current.x[index], current.y[index]]);
        }
        let strict = MergeRule { doubt_threshold: STRICT_DOUBT_THRESHOLD, ..*rule };
        // An anchor that shows no pixel of the tile is not sampled,
        let shows_nothing = outside.map(|outside| outside == u64::MAX);
        // nor is it at positions outside of it.
        let sample = |anchor, first, at, outside: u64, samples: &mut [P; BLOCK]| match is_whole {
            true => P::sample_tile(self.level, TileSource { picture: anchor, at: first }, samples, TILE),
            false => P::sample_pixels(self.level, anchor, at, !outside, samples),
        };
        if shows_nothing != [true, false] {
            sample(self.previous, positions.previous, &previous, outside[0], &mut block.previous);
        }
        if shows_nothing != [false, true] {
            sample(self.current, positions.current, &current, outside[1], &mut block.current);
        }
        let differing =
            if shows_nothing[0] == shows_nothing[1] { P::merge_block(self.level, &strict, block) } else { 0 };
        let mask = uncertain | differing;
        let mut foreground_keys = [EMPTY; BLOCK];
        let follows_foreground = mask != 0 && self.rules.has(super::Rule::ForegroundEdges);
        let has_foreground =
            if follows_foreground { self.foreground_keys(column, row, mask, &mut foreground_keys) } else { 0 };
        let foreground_in_both =
            self.with_foreground(from, &keys, &foreground_keys, has_foreground, &strict, with_foreground);
        // Pixels that only one of the anchors shows.
        let (only_in_previous, only_in_current) = (previous_only & outside[1] & !outside[0], outside[0] & !outside[1]);
        let anchors = self.anchors();
        let static_pixels =
            if uncertain == 0 { 0 } else { self.static_pixels.tile(self.level, &anchors, [column, row]) };
        // Fast path: pixels visible only in the previous anchor need only the occlusion test where this tile has no
        // static overlay.
        let mut unoccluded = only_in_previous & !static_pixels & !foreground_in_both;
        if unoccluded != 0 {
            unoccluded &= !self.static_pixels.static_at(self.level, &anchors, &previous, unoccluded);
            for index in 0..BLOCK {
                let is_copied = unoccluded >> index & 1 == 1;
                block.merged[index] = if is_copied { block.previous[index] } else { block.merged[index] };
            }
        }
        let only_in_current = only_in_current & !static_pixels;
        for_each_bit(mask & !unoccluded & tile_mask([across, down]), |index| {
            let [i, j] = [index % TILE, index / TILE];
            let at = [corner[0] + i, corner[1] + j];
            let positions = SourcePositions {
                previous: [previous.x[index], previous.y[index]],
                current: [current.x[index], current.y[index]],
            };
            if foreground_in_both >> index & 1 == 1 {
                let foreground_difference =
                    colour_difference(with_foreground.previous[index], with_foreground.current[index]);
                let own = |is_visible| match is_visible {
                    true => colour_difference(block.previous[index], block.current[index]),
                    false => occluded_difference(self.is_optical_flow),
                };
                if foreground_difference <= EDGE_TOLERANCE
                    && foreground_difference < own(self.is_visible_in_anchors(keys[index], positions))
                {
                    block.merged[index] = with_foreground.merged[index];
                    return;
                }
            }
            if only_in_current >> index & 1 == 1 {
                let is_shown = |[x, y]: [usize; 2]| {
                    similar_motion(self.field.own_key(x, y), keys[index])
                        && !self.static_pixels.is_static_at(self.level, &anchors, [x, y])
                };
                if grid.nearest_pixel(positions.current).is_some_and(is_shown) {
                    block.merged[index] = block.current[index];
                    return;
                }
            }
            let is_doubtful =
                uncertain >> index & 1 == 1 || P::merge(block.previous[index], block.current[index], rule).1;
            match self.choose(at, keys[index], positions, is_doubtful) {
                Choice::Blend => {}
                Choice::Previous => block.merged[index] = block.previous[index],
                Choice::Current => block.merged[index] = block.current[index],
                Choice::Static => {
                    block.merged[index] = self.static_pixel(at[0], at[1], rule);
                    static_drawn |= 1 << index;
                }
                Choice::Hidden => *hidden |= 1 << index,
            }
        });
        if blend_mask & !static_drawn != 0 {
            antialias(&mut block.merged, blend_mask & !static_drawn, *hidden);
        }
        for j in 0..down {
            pixels[j * grid.width..][..across].copy_from_slice(&block.merged[j * TILE..][..across]);
        }
        uncovered
    }

    /// Positions of a pixel in both anchors, with linear motion at `phase`.
    #[inline(always)]
    fn positions(&self, [x, y]: [usize; 2], key: Key, phase: i32) -> SourcePositions {
        let at = [64 * x as i32, 64 * y as i32];
        let vector = splat_key::vector(key);
        let previous: [i32; 2] = std::array::from_fn(|c| at[c] + scaled(vector[c], phase));
        SourcePositions { previous, current: std::array::from_fn(|c| previous[c] - vector[c]) }
    }

    /// Foreground keys that may cover the `wanted` pixels of a tile: the nearest key of the 3x3 neighbourhood if it is
    /// in front of the pixel's own. Without depth, any key with different motion may be in front; the one with the
    /// smallest match error is used. Returns the bits of pixels that have one.
    #[inline(never)]
    fn foreground_keys(&self, column: usize, row: usize, wanted: u64, foreground_keys: &mut [Key; BLOCK]) -> u64 {
        let padded_tile = self.frame_keys.padded_tile(column, row, true);
        if self.is_optical_flow {
            tile_keys::nearest_other_motion(self.level, &padded_tile, DISTINCT_MOTION, wanted, foreground_keys)
        } else {
            tile_keys::nearest_neighbours(self.level, &padded_tile, DISTINCT_MOTION, foreground_keys) & wanted
        }
    }

    /// Samples the pixels of `has_foreground` as if they moved with the foreground: pixels at a surface's edge are
    /// mixed with its background. Returns the bits of those that are inside both anchors.
    #[inline(never)]
    fn with_foreground(
        &self,
        from: [i32; 2],
        keys: &[Key; BLOCK],
        foreground_keys: &[Key; BLOCK],
        has_foreground: u64,
        rule: &MergeRule,
        with_foreground: &mut Block<P>,
    ) -> u64 {
        if has_foreground == 0 {
            return 0;
        }
        let grid = self.frame_keys.grid;
        let mut claims = *keys;
        for_each_bit(has_foreground, |index| claims[index] = foreground_keys[index]);
        let mut previous = Positions { x: [0; BLOCK], y: [0; BLOCK] };
        let mut current = previous;
        let size = [grid.width, grid.height];
        let outside =
            tile_keys::source_positions(self.level, &claims, from, self.time, size, &mut previous, &mut current);
        let foreground_in_both = has_foreground & !(outside[0] | outside[1]);
        P::sample_pixels(self.level, self.previous, &previous, foreground_in_both, &mut with_foreground.previous);
        P::sample_pixels(self.level, self.current, &current, foreground_in_both, &mut with_foreground.current);
        P::merge_block(self.level, rule, with_foreground);
        foreground_in_both
    }

    /// Whether the surface of a key is visible in both anchors.
    fn is_visible_in_anchors(&self, key: Key, positions: SourcePositions) -> bool {
        let grid = self.frame_keys.grid;
        grid.nearest_pixel(positions.previous)
            .is_some_and(|[x, y]| similar_motion(self.previous_keys.key_at(x, y), key))
            && grid.nearest_pixel(positions.current).is_some_and(|[x, y]| similar_motion(self.field.own_key(x, y), key))
    }

    fn anchors(&self) -> Anchors<'_, P> {
        Anchors { previous: self.previous, current: self.current }
    }

    /// Whether a uniform tile is visible in both anchors: it overlaps only uniform tiles with similar motion.
    #[inline(always)]
    fn is_visible_in_both(&self, key: Key, positions: SourcePositions) -> bool {
        let can_be = |tile: &Tile| similar_motion(tile.key, key) || same_slope(tile.key, key);
        is_in_uniform(self.previous_keys, positions.previous, can_be)
            && is_in_uniform(self.field, positions.current, can_be)
    }

    /// Whether a uniform tile is completely visible in the current anchor, completely outside the previous one, and no
    /// foreground may overlap it.
    #[inline(always)]
    fn is_only_in_current(&self, [column, row]: [usize; 2], key: Key, positions: SourcePositions) -> bool {
        let grid = self.frame_keys.grid;
        let is_off = |at: i32, len: usize| at + 64 * (TILE as i32 - 1) < -32 || at + 32 >= 64 * len as i32;
        let moves_along = |tile: &Tile| motion_within(tile.key, key, DISTINCT_MOTION);
        let can_show = |tile: &Tile| self.is_optical_flow || is_in_front(tile.key, key);
        let is_in_front = |tile: &Tile| tile.kind == TileKind::Mixed || can_show(tile) && !moves_along(tile);
        let columns = column.saturating_sub(1)..(column + 2).min(grid.columns);
        let mut rows = row.saturating_sub(1)..(row + 2).min(grid.rows);
        (is_off(positions.previous[0], grid.width) || is_off(positions.previous[1], grid.height))
            && is_in_uniform(self.field, positions.current, |tile| similar_motion(tile.key, key))
            && !rows.any(|row| self.frame_keys.tile_rows(row..row + 1)[columns.clone()].iter().any(is_in_front))
    }

    /// Decides which anchor a pixel is taken from, by visibility. Overlays are searched where the pixel `is_doubtful`.
    #[inline(never)]
    fn choose(&self, at: [usize; 2], key: Key, positions: SourcePositions, is_doubtful: bool) -> Choice {
        let grid = self.frame_keys.grid;
        let (from, to) = (grid.nearest_pixel(positions.previous), grid.nearest_pixel(positions.current));
        let tag = splat_key::tag(key);
        let mut in_previous = from.is_some_and(|[x, y]| {
            if tag == PREVIOUS_ONLY {
                return true;
            }
            let key_there = self.previous_keys.key_at(x, y);
            similar_motion(key_there, key) || splat_key::tag(key_there) == PREVIOUS_ONLY && !is_in_front(key_there, key)
        });
        let mut in_current = to.is_some_and(|[x, y]| {
            let key_there = self.field.own_key(x, y);
            similar_motion(key_there, key) || tag != PREVIOUS_ONLY && tag != HOLE && is_in_front(key, key_there)
        });
        // If only one anchor is occluded, the motion is right and there is no overlay.
        if is_doubtful && (in_previous == in_current || from.is_none() || to.is_none()) {
            let anchors = self.anchors();
            let vector = splat_key::vector(key);
            let is_overlay = |anchor, at| self.static_pixels.is_overlay(self.level, &anchors, anchor, at, vector);
            if is_overlay(AnchorIndex::Current, at) {
                return Choice::Static;
            }
            in_previous = in_previous && !from.is_some_and(|from| is_overlay(AnchorIndex::Previous, from));
            in_current = in_current && !to.is_some_and(|to| is_overlay(AnchorIndex::Current, to));
        }
        match (in_previous, in_current) {
            (true, true) => Choice::Blend,
            (true, false) => Choice::Previous,
            (false, true) => Choice::Current,
            (false, false) => Choice::Hidden,
        }
    }

    /// A static pixel.
    fn static_pixel(&self, x: usize, y: usize, rule: &MergeRule) -> P {
        let index = y * self.previous.width + x;
        P::merge(self.previous.pixels[index], self.current.pixels[index], rule).0
    }
}

/// Whether the 8x8 pixels from `position` overlap only uniform tiles that satisfy `can_be`, and are inside the picture.
#[inline(always)]
fn is_in_uniform(keys: &KeyBuffer, position: [i32; 2], can_be: impl Fn(&Tile) -> bool) -> bool {
    let grid = keys.grid;
    let last = position.map(|v| v + 64 * (TILE as i32 - 1));
    let (Some(first), Some(last)) = (grid.nearest_pixel(position), grid.nearest_pixel(last)) else { return false };
    // A plain loop: LLVM does not inline closures of `all` here.
    for row in first[1] / TILE..=last[1] / TILE {
        for tile in &keys.tile_rows(row..row + 1)[first[0] / TILE..=last[0] / TILE] {
            if tile.kind != TileKind::Uniform || !can_be(tile) {
                return false;
            }
        }
    }
    true
}

/// Positions of the pixels of a uniform tile; returns the bits of those outside each anchor, as
/// [`tile_keys::source_positions`] does.
fn tile_positions(
    grid: Grid,
    positions: SourcePositions,
    previous: &mut Positions,
    current: &mut Positions,
) -> [u64; 2] {
    [(positions.previous, previous), (positions.current, current)].map(|(first, at)| {
        let mut outside = 0;
        for index in 0..BLOCK {
            let [x, y] = [first[0] + 64 * (index % TILE) as i32, first[1] + 64 * (index / TILE) as i32];
            (at.x[index], at.y[index]) = (x, y);
            outside |= u64::from(!grid.contains_position([x, y])) << index;
        }
        outside
    })
}

/// Where a pixel is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    /// Both anchors.
    Blend,
    /// The previous anchor.
    Previous,
    /// The current anchor.
    Current,
    /// Both anchors, without motion: a static overlay.
    Static,
    /// Neither anchor shows it.
    Hidden,
}

/// Renders an extrapolated picture. `hidden` receives the bits of pixels that `current` does not show.
#[inline(never)]
pub(super) fn extrapolate<P: Colour>(
    level: SimdLevel,
    current: Source<'_, P>,
    frame_keys: &KeyBuffer,
    field: &KeyBuffer,
    time: WarpTime,
    out: &mut Raster<P>,
    hidden: &mut [u64],
) -> Rendered {
    let grid = frame_keys.grid;
    let (uncovered, hidden_pixels) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let warp = Warp::from_current(time);
    let position = |[x, y]: [usize; 2], key: Key, fraction: i32| -> [i32; 2] {
        let at = [64 * x as i32, 64 * y as i32];
        let vector = splat_key::vector(key);
        std::array::from_fn(|c| at[c] + scaled(vector[c], -fraction))
    };
    let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
    rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
        let mut block = [P::OPAQUE_BLACK; BLOCK];
        let (mut uncovered_here, mut hidden_here) = (0, 0);
        for (column, hidden) in hidden.iter_mut().enumerate() {
            let tile_index = row * grid.columns + column;
            let tile = &frame_keys.tiles[tile_index];
            let [across, down] = grid.extent(column, row);
            let corner = [column * TILE, row * TILE];
            let pixels = &mut pixels[column * TILE..];
            *hidden = 0;
            if tile.kind == TileKind::Uniform && [across, down] == [TILE, TILE] {
                let position = position(corner, tile.key, warp.fraction_of_tile(tile.key, corner));
                P::sample_tile(level, TileSource { picture: current, at: position }, pixels, grid.width);
                continue;
            }
            let mut at = Positions { x: [0; BLOCK], y: [0; BLOCK] };
            for index in 0..BLOCK {
                let [i, j] = [index % TILE, index / TILE];
                let pixel = [corner[0] + i, corner[1] + j];
                if i >= across || j >= down {
                    continue;
                }
                let own = if tile.kind == TileKind::Uniform { tile.key } else { frame_keys.keys[tile_index][index] };
                let key = if own == EMPTY { frame_keys.inherited[tile_index][index] } else { own };
                let position = position(pixel, key, warp.fraction(key, pixel.map(|at| at as i32)));
                (at.x[index], at.y[index]) = (position[0], position[1]);
                if own == EMPTY {
                    uncovered_here += 1;
                    // The foreground at that position would be drawn twice.
                    let is_occluded = grid.nearest_pixel(position).is_some_and(|[x, y]| {
                        let key_there = field.own_key(x, y);
                        !similar_motion(key_there, key) && is_in_front(key_there, key)
                    });
                    *hidden |= u64::from(is_occluded) << index;
                }
            }
            hidden_here += hidden.count_ones() as usize;
            P::sample_pixels(level, current, &at, u64::MAX, &mut block);
            for j in 0..down {
                pixels[j * grid.width..][..across].copy_from_slice(&block[j * TILE..][..across]);
            }
        }
        uncovered.fetch_add(uncovered_here, Ordering::Relaxed);
        hidden_pixels.fetch_add(hidden_here, Ordering::Relaxed);
    });
    Rendered { uncovered: uncovered.into_inner(), hidden: hidden_pixels.into_inner() }
}

/// Difference between two colours: the largest of any channel, in levels.
pub(super) fn colour_difference<P: Colour>(a: P, b: P) -> f32 {
    let (a, b) = (a.in_levels(), b.in_levels());
    let mut difference = [0.0_f32; 4];
    for c in 0..4 {
        difference[c] = (a[c] - b[c]).abs();
    }
    0.0_f32.max(difference[0]).max(difference[1]).max(difference[2])
}
