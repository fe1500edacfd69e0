//! Hole hole_fill: keys for pixels that no key covers.
//!
//! A hole continues a surface beside it. In the previous anchor it is a pixel that is occluded in the current one or
//! has left the picture; in the frame, one that neither anchor shows. Candidates are the nearest keys to the left,
//! right, above and below; where none is near, a pyramid over the tiles supplies the farthest key around.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::colour::Colour;
use super::kernels::candidates::{self, Candidates, Costs, OutsideCandidates, SIDES};
use super::kernels::{self, BLOCK, Source, TILE, tile_keys};
use super::key_buffer::{Grid, KeyBuffer, Tile, for_each_bit, tile_mask};
use super::reprojection::Reprojection;
use super::resize;
use super::splat_key::{self, EMPTY, HOLE, Key, is_in_front, pack, scaled, similar_motion};
use super::warp::Warp;
use crate::Result;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};

/// Tiles whose keys and pixels are prefetched ahead of the one being filled.
const PREFETCH_AHEAD: usize = 1;
/// The same in the coverage pass.
const COVERAGE_PREFETCH_AHEAD: usize = 6;
/// Pixels for which candidates are prefetched ahead.
const PIXELS_PREFETCH_AHEAD: usize = 6;
/// Largest distance of a candidate, in pixels.
pub(super) const SEARCH_RADIUS: usize = 24;

#[cfg(test)]
crate::shader_constants::shader_constants!("HOLE_FILLING_": int SEARCH_RADIUS);

/// The same in tiles.
const SEARCH_TILES: usize = SEARCH_RADIUS / TILE;
const _: () = assert!(SEARCH_RADIUS == SEARCH_TILES * TILE && SEARCH_TILES == 3);

/// Fills key buffers; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct HoleFiller {
    /// Covered pixels of each tile, as bits `8 j + i`.
    covered: Vec<u64>,
    /// Result per tile with holes.
    filled: Vec<Filled>,
    levels: Vec<PyramidLevel>,
}

/// Result of hole_fill a tile from candidates.
#[derive(Debug, Clone, Copy, Default)]
struct Filled {
    /// Holes without a candidate.
    unfilled: u64,
    /// Minimum and maximum of each component of the inherited motion.
    vector_range: [[i32; 2]; 2],
}

/// A level of the pyramid, half the size of the one below. Each cell has the farthest key below it plus one, or 0.
#[derive(Debug, Default)]
struct PyramidLevel {
    columns: usize,
    farthest: Vec<Key>,
}

/// What candidates are judged by.
pub(super) struct FillInputs<'a, P> {
    /// Keys of the current anchor.
    pub(super) field: &'a KeyBuffer,
    /// Warp from the current anchor to the buffer being filled.
    pub(super) warp: Warp,
    /// The anchor that shows the holes' content, if one does.
    pub(super) picture: Option<Source<'a, P>>,
    /// Reprojection of that anchor's depth, if it is known.
    pub(super) reprojection: Option<&'a Reprojection<'a>>,
    /// Whether a reprojected hole may follow the motion of a neighbouring surface at the same distance.
    pub(super) follows_neighbours: bool,
    /// Tag of inherited keys.
    pub(super) tag: u8,
}

impl HoleFiller {
    /// Gives each hole of `buffer` an inherited key; returns the number of holes.
    pub(super) fn fill<P: Colour>(
        &mut self,
        level: kernels::SimdLevel,
        buffer: &mut KeyBuffer,
        inputs: &FillInputs<'_, P>,
    ) -> Result<usize> {
        let grid = buffer.grid;
        self.reserve(grid)?;
        let holes = self.find_covered(level, buffer);
        if holes == 0 {
            return Ok(0);
        }
        let Self { covered, filled, levels } = self;
        let mut inherited = std::mem::take(&mut buffer.inherited);
        let (hole_fill, has_unfilled) = (HoleFill { level, buffer, covered, inputs }, AtomicBool::new(false));
        let rows = inherited.par_chunks_mut(grid.columns).zip(filled.par_chunks_mut(grid.columns));
        rows.enumerate().for_each(|(row, (inherited, filled))| {
            let mut scratch = Scratch { candidates: Candidates::NONE, costs: [[u32::MAX; BLOCK]; SIDES] };
            for (column, (keys, filled)) in inherited.iter_mut().zip(filled).enumerate() {
                hole_fill.prefetch(column + PREFETCH_AHEAD, row);
                if hole_fill.buffer.tiles[row * grid.columns + column].holes > 0 {
                    *filled = hole_fill.fill_tile([column, row], &mut scratch, keys);
                    if filled.unfilled != 0 {
                        has_unfilled.store(true, Ordering::Relaxed);
                    }
                }
            }
        });
        // Usually every hole has a candidate.
        if has_unfilled.into_inner() {
            build_pyramid(levels, buffer);
        }
        let rows = buffer.tiles.par_chunks_mut(grid.columns).zip(inherited.par_chunks_mut(grid.columns));
        let rows = rows.zip(filled.par_chunks(grid.columns)).zip(buffer.vertical_ranges.par_iter_mut());
        rows.enumerate().for_each(|(row, (((tiles, inherited), filled), vertical_range))| {
            *vertical_range = [i32::MAX, i32::MIN];
            for (column, ((tile, keys), filled)) in tiles.iter_mut().zip(inherited).zip(filled).enumerate() {
                [tile.low, tile.high] = match (tile.holes, filled.unfilled) {
                    (0, _) => [[i32::MAX; 2], [i32::MIN; 2]],
                    (_, 0) => filled.vector_range,
                    (_, unfilled) => {
                        inherit_farthest(
                            unfilled,
                            splat_key::with_tag(farthest(levels, tile, column, row), inputs.tag),
                            keys,
                        );
                        tile_keys::vector_range(level, keys)
                    }
                };
                *vertical_range = [vertical_range[0].min(tile.low[1]), vertical_range[1].max(tile.high[1])];
            }
        });
        buffer.inherited = inherited;
        Ok(holes)
    }

    /// Allocates for a grid.
    fn reserve(&mut self, grid: Grid) -> Result<()> {
        resize(&mut self.covered, grid.tiles(), 0)?;
        resize(&mut self.filled, grid.tiles(), Filled::default())?;
        let mut size = [grid.columns, grid.rows];
        let count = size[0].max(size[1]).next_power_of_two().ilog2() as usize;
        super::reserve(&mut self.levels, count)?;
        self.levels.resize_with(count, PyramidLevel::default);
        for level in &mut self.levels {
            size = size.map(|len| len.div_ceil(2));
            level.columns = size[0];
            resize(&mut level.farthest, size[0] * size[1], 0)?;
        }
        Ok(())
    }

    /// Finds the covered pixels; returns the number of holes.
    fn find_covered(&mut self, level: kernels::SimdLevel, buffer: &KeyBuffer) -> usize {
        let grid = buffer.grid;
        let is_part = |tile: &Tile| tile.holes > 0 && usize::from(tile.holes) < BLOCK;
        let rows = buffer.tiles.par_chunks(grid.columns).zip(buffer.keys.par_chunks(grid.columns));
        let rows = rows.zip(self.covered.par_chunks_mut(grid.columns)).enumerate();
        let all_holes = AtomicUsize::new(0);
        rows.for_each(|(row, ((tiles, keys), covered))| {
            let mut holes = 0;
            for (column, (tile, covered)) in tiles.iter().zip(covered).enumerate() {
                if tiles.get(column + COVERAGE_PREFETCH_AHEAD).is_some_and(is_part) {
                    KeyBuffer::prefetch_keys(&keys[column + COVERAGE_PREFETCH_AHEAD]);
                }
                let inside = tile_mask(grid.extent(column, row));
                holes += usize::from(tile.holes);
                *covered = match usize::from(tile.holes) {
                    0 => inside,
                    BLOCK => 0,
                    _ => inside & candidates::covered_pixels(level, &keys[column]),
                };
            }
            all_holes.fetch_add(holes, Ordering::Relaxed);
        });
        all_holes.into_inner()
    }
}

/// Builds the pyramid of farthest keys.
#[inline(never)]
fn build_pyramid(levels: &mut [PyramidLevel], buffer: &KeyBuffer) {
    let pull = |rows: [&[Key]; 2], farthest: &mut [Key]| {
        for (column, farthest) in farthest.iter_mut().enumerate() {
            let children = rows.iter().flat_map(|row| row.iter().skip(2 * column).take(2));
            *farthest = children.copied().fold(0, Key::max);
        }
    };
    let Some((first, _)) = levels.split_first_mut() else { return };
    let columns = buffer.grid.columns;
    first.farthest.par_chunks_mut(first.columns).zip(buffer.tiles.par_chunks(2 * columns)).for_each(
        |(farthest, tiles)| {
            farthest.fill(0);
            for row in tiles.chunks(columns) {
                for (farthest, tiles) in farthest.iter_mut().zip(row.chunks(2)) {
                    *farthest = tiles.iter().fold(*farthest, |farthest, tile| farthest.max(tile.key.wrapping_add(1)));
                }
            }
        },
    );
    for number in 1..levels.len() {
        let (below, above) = levels.split_at_mut(number);
        let (below, level) = (&below[number - 1], &mut above[0]);
        for (row, farthest) in level.farthest.chunks_mut(level.columns).enumerate() {
            let (upper, lower) = below.farthest[2 * row * below.columns..].split_at(below.columns);
            pull([upper, &lower[..below.columns.min(lower.len())]], farthest);
        }
    }
}

/// The farthest key in the smallest square of 1, 2x2, 4x4, ... tiles that has any.
fn farthest(levels: &[PyramidLevel], tile: &Tile, column: usize, row: usize) -> Key {
    if tile.key != EMPTY {
        return tile.key;
    }
    let squares = levels.iter().zip(1..);
    let found = squares.map(|(level, power)| level.farthest[(row >> power) * level.columns + (column >> power)]);
    found.into_iter().find(|&farthest| farthest != 0).map_or(pack(u16::MAX, 0, [0; 2]), |farthest| farthest - 1)
}

/// Sets the `unfilled` holes of a tile to a key from the pyramid.
fn inherit_farthest(unfilled: u64, far: Key, keys: &mut [Key; BLOCK]) {
    if unfilled == u64::MAX {
        keys.fill(far);
    } else {
        for_each_bit(unfilled, |index| keys[index] = far);
    }
}

/// Working memory for one tile, not cleared between tiles.
struct Scratch {
    candidates: Candidates,
    costs: Costs,
}

/// A key buffer whose holes are being filled.
struct HoleFill<'a, 'e, P> {
    level: kernels::SimdLevel,
    buffer: &'a KeyBuffer,
    covered: &'a [u64],
    inputs: &'a FillInputs<'e, P>,
}

impl<P: Colour> HoleFill<'_, '_, P> {
    /// Prefetches a tile.
    #[inline(always)]
    fn prefetch(&self, column: usize, row: usize) {
        let grid = self.buffer.grid;
        let tile = row * grid.columns + column;
        // The keys of a tile without coverage are known to be empty.
        if column < grid.columns && self.buffer.tiles[tile].holes > 0 && self.covered[tile] != 0 {
            KeyBuffer::prefetch_keys(&self.buffer.keys[tile]);
            if let Some(picture) = self.inputs.picture {
                picture.prefetch_tile([column, row].map(|at| 64 * (at * TILE) as i32), 0);
            }
        }
    }

    /// Fills the holes of a tile that have a candidate.
    #[inline(never)]
    fn fill_tile(&self, [column, row]: [usize; 2], scratch: &mut Scratch, keys: &mut [Key; BLOCK]) -> Filled {
        let Self { level, buffer, covered, inputs } = *self;
        let grid = buffer.grid;
        let tile = row * grid.columns + column;
        let (corner, extent) = ([column * TILE, row * TILE], grid.extent(column, row));
        let (covered, holes) = (covered[tile], tile_mask(extent) & !covered[tile]);

        // Reprojected pixels need no candidate, unless they may belong to a moving surface.
        let (mut inverse_depths, mut reprojected) = ([0.0; BLOCK], 0);
        match inputs.reprojection {
            Some(reprojection) => {
                reprojection.inverse_depths(level, corner, extent, &mut inverse_depths);
                reprojected = reprojection.keys(level, inputs.field, corner, &inverse_depths, holes, keys);
            }
            None => keys.fill(EMPTY),
        }
        let mut unfilled = holes & !reprojected;
        let line_coverage = [self.line_coverage::<true>(column, row), self.line_coverage::<false>(column, row)];
        if line_coverage.iter().flatten().any(|&line| line != 0) {
            let mut outside = self.outside_candidates(corner, holes, &line_coverage);
            let Scratch { candidates, costs } = scratch;
            candidates::find(level, &buffer.keys[tile], covered, holes, &outside, candidates);
            let mut wanted = unfilled;
            if let Some(reprojection) = inputs.reprojection.filter(|_| reprojected != 0 && inputs.follows_neighbours) {
                wanted |= reprojection.moving_with(level, keys, &inverse_depths, reprojected, candidates);
            }
            if wanted != 0 {
                self.find_costs(corner, extent, [covered, holes], &mut outside, candidates, costs);
                let at = |index: usize| [corner[0] + index % TILE, corner[1] + index / TILE];
                // Keys for the next candidates are prefetched.
                let mut ahead = wanted;
                for _ in 0..PIXELS_PREFETCH_AHEAD {
                    inputs.prefetch_next(&mut ahead, at, candidates, costs);
                }
                for_each_bit(wanted, |index| {
                    inputs.prefetch_next(&mut ahead, at, candidates, costs);
                    let at = at(index);
                    let found = inputs.best(grid, at, index, candidates, costs);
                    let is_reprojected = reprojected >> index & 1 == 1;
                    let is_better = match inputs.reprojection {
                        Some(reprojection) if is_reprojected => reprojection.moves_with(at, keys[index], found),
                        _ => found != EMPTY,
                    };
                    if is_better {
                        keys[index] = splat_key::with_tag(found, inputs.tag);
                        unfilled &= !(1 << index);
                    }
                });
            }
        }
        Filled { unfilled, vector_range: tile_keys::vector_range(level, keys) }
    }

    /// Coverage along each row (or column) of a tile and its neighbours within the search radius; bits 24 to 31 are the
    /// tile's own.
    #[inline(always)]
    fn line_coverage<const ACROSS: bool>(&self, column: usize, row: usize) -> [u64; TILE] {
        let Grid { columns, rows, .. } = self.buffer.grid;
        let (at, len) = if ACROSS { (column, columns) } else { (row, rows) };
        let mut line_coverage = [0; TILE];
        for step in (SEARCH_TILES - SEARCH_TILES.min(at))..(SEARCH_TILES + len - at).min(2 * SEARCH_TILES + 1) {
            let there = at + step - SEARCH_TILES;
            let tile = if ACROSS { row * columns + there } else { there * columns + column };
            let covered = if ACROSS { self.covered[tile] } else { transposed(self.covered[tile]) };
            for (i, line) in line_coverage.iter_mut().enumerate() {
                *line |= (covered >> (TILE * i) & 0xff) << (TILE * step);
            }
        }
        line_coverage
    }

    /// The first covered pixel outside the tile, as seen from holes at its edges.
    #[inline(always)]
    fn outside_candidates(
        &self,
        [x, y]: [usize; 2],
        holes: u64,
        [rows, columns]: &[[u64; TILE]; 2],
    ) -> OutsideCandidates {
        let mut outside = OutsideCandidates::NONE;
        for i in 0..TILE {
            for side in 0..SIDES {
                let (line, index) = match side {
                    0 => (rows[i], TILE * i),
                    1 => (rows[i], TILE * i + TILE - 1),
                    2 => (columns[i], i),
                    _ => (columns[i], BLOCK - TILE + i),
                };
                let is_before = side % 2 == 0;
                let line = if is_before { line & ((1 << SEARCH_RADIUS) - 1) } else { line >> (SEARCH_RADIUS + TILE) };
                if line == 0 || holes >> index & 1 == 0 {
                    continue;
                }
                let position = if is_before {
                    (u64::BITS - line.leading_zeros()) as i32 - SEARCH_RADIUS as i32 - 1
                } else {
                    TILE as i32 + line.trailing_zeros() as i32
                };
                let [u, v] = pixel_on_line([x, y], side, i, position as u32);
                outside.keys[side][i] = self.buffer.own_key(u, v);
                outside.position[side][i] = position as u32;
            }
        }
        outside
    }

    /// Costs of the candidates of a tile.
    #[inline(always)]
    fn find_costs(
        &self,
        corner: [usize; 2],
        [across, down]: [usize; 2],
        [covered, holes]: [u64; 2],
        outside: &mut OutsideCandidates,
        candidates: &Candidates,
        costs: &mut Costs,
    ) {
        let Some(picture) = self.inputs.picture else {
            return candidates::cost_by_depth(self.level, candidates, costs);
        };
        let mut lumas = [0.0; BLOCK];
        for (j, lumas) in lumas.as_chunks_mut::<TILE>().0.iter_mut().enumerate().take(down) {
            let row = &picture.pixels[(corner[1] + j) * picture.width + corner[0]..][..across];
            match row.first_chunk() {
                Some(row) => *lumas = P::lumas_of(row),
                None => lumas.iter_mut().zip(row).for_each(|(luma, pixel)| *luma = pixel.luma()),
            }
        }
        for side in 0..SIDES {
            for i in (0..TILE).filter(|&i| outside.keys[side][i] != EMPTY) {
                let [x, y] = pixel_on_line(corner, side, i, outside.position[side][i]);
                outside.lumas[side][i] = picture.pixels[y * picture.width + x].luma();
            }
        }
        candidates::cost_by_luma(self.level, candidates, &lumas, covered, holes, outside, costs);
    }
}

/// Pixel at a position along a line of a tile: a row for the sides left and right, otherwise a column.
#[inline(always)]
fn pixel_on_line([x, y]: [usize; 2], side: usize, line: usize, position: u32) -> [usize; 2] {
    let position = position as i32 as isize;
    if side < 2 { [x.wrapping_add_signed(position), y + line] } else { [x + line, y.wrapping_add_signed(position)] }
}

/// Transposes an 8x8 bit matrix (H. S. Warren, Hacker's Delight, 2012, 7-3).
#[inline(always)]
fn transposed(bits: u64) -> u64 {
    let swapped = |bits: u64, by: u32, which: u64| {
        let changes = (bits ^ bits >> by) & which;
        bits ^ changes ^ changes << by
    };
    let bits = swapped(bits, 7, 0x00aa_00aa_00aa_00aa);
    let bits = swapped(bits, 14, 0x0000_cccc_0000_cccc);
    swapped(bits, 28, 0x0000_0000_f0f0_f0f0)
}

impl<'a, P> FillInputs<'a, P> {
    /// Inputs for holes in a frame, which no anchor shows.
    pub(super) fn in_frame(field: &'a KeyBuffer, warp: Warp) -> Self {
        Self { field, warp, picture: None, reprojection: None, follows_neighbours: false, tag: HOLE }
    }
}

impl<P: Colour> FillInputs<'_, P> {
    /// The cheapest candidate that the current anchor does not contradict; if it contradicts all, the cheapest.
    #[inline(always)]
    fn best(&self, grid: Grid, at: [usize; 2], index: usize, candidates: &Candidates, costs: &Costs) -> Key {
        let key_of = |by_cost: u64| candidates.keys[by_cost as usize % SIDES][index];
        let cost_of = |side: usize| u64::from(costs[side][index]) << 2 | side as u64;
        let mut by_cost = [cost_of(0), cost_of(1), cost_of(2), cost_of(3)];
        // Sorting network; for equal costs the first side wins.
        for [a, b] in [[0, 1], [2, 3], [0, 2], [1, 3], [1, 2]] {
            (by_cost[a], by_cost[b]) = (by_cost[a].min(by_cost[b]), by_cost[a].max(by_cost[b]));
        }
        let first = key_of(by_cost[0]);
        let mut contradicted = EMPTY;
        for n in 0..SIDES {
            let key = key_of(by_cost[n]);
            if key == EMPTY {
                break;
            }
            if key == contradicted {
                continue;
            }
            // The usual case: all candidates are the same.
            let is_only = || by_cost[1..].iter().all(|&other| [first, EMPTY].contains(&key_of(other)));
            if n == 0 && is_only() || !self.is_contradicted(grid, at, key) {
                return key;
            }
            contradicted = key;
        }
        first
    }

    /// Prefetches what [`best`](Self::best) reads first for the next of `indices`.
    #[inline(always)]
    fn prefetch_next(
        &self,
        indices: &mut u64,
        at: impl Fn(usize) -> [usize; 2],
        candidates: &Candidates,
        costs: &Costs,
    ) {
        if *indices == 0 {
            return;
        }
        let index = indices.trailing_zeros() as usize;
        *indices &= *indices - 1;
        let cost_of = |side: usize| u64::from(costs[side][index]) << 2 | side as u64;
        let first = cost_of(0).min(cost_of(1)).min(cost_of(2).min(cost_of(3)));
        let key = candidates.keys[first as usize % SIDES][index];
        let is_only = candidates.keys.iter().all(|keys| keys[index] == key || keys[index] == EMPTY);
        if !is_only {
            self.field.prefetch(self.position_in_current(at(index), key));
        }
    }

    /// Position in the current anchor (1/64 px) to which a candidate leads.
    #[inline(always)]
    fn position_in_current(&self, at: [usize; 2], key: Key) -> [i32; 2] {
        let ([vx, vy], at) = (splat_key::vector(key), at.map(|at| at as i32));
        let fraction = self.warp.fraction(key, at);
        [64 * at[0] - scaled(vx, fraction), 64 * at[1] - scaled(vy, fraction)]
    }

    /// Whether the current anchor contradicts a candidate. If the hole belonged to its surface, it would be covered,
    /// unless it is occluded or outside the current anchor.
    #[inline(always)]
    fn is_contradicted(&self, grid: Grid, at: [usize; 2], key: Key) -> bool {
        grid.nearest_pixel(self.position_in_current(at, key)).is_some_and(|[u, v]| {
            let key_there = self.field.own_key(u, v);
            similar_motion(key_there, key) | is_in_front(key, key_there)
        })
    }
}
