//! Segments of the motion that the current anchor has. In: guidance, both anchors, static overlays. Out: the segments of every tile, each pixel in
//! exactly one.

use half::f16;

use super::super::colour::Colour;
use super::super::field::{fitting, mark_matches};
use super::super::kernels::{
    BLOCK, Landing, Level, RankRange, Source, TILE, VectorRange, at_every_level, claim_tile, depth_ranges, land,
    motion_ranges,
};
use super::super::layer::{self, ALIKE, EMPTY, Grid, Key, LONGEST, ONE_SURFACE, alike, is_nearer};
use super::super::sized;
use super::super::standing::Standing;
use super::tiles::{FRONTS, Front, SLOTS, Segment, Segments, TilesMut, each, inside};
use crate::Result;
use crate::guidance::Guidance;
use crate::tasks::{Parallel, ParallelSliceMut};

/// A tile whose vectors differ by no more than this along each axis is one segment, in 1/64 px.
const UNIFORM: i32 = 48;
/// Vectors of one segment differ from its first one by no more than this, in 1/64 px.
const CLUSTER: i32 = 32;
/// Where segments have to be wider than this, matching errors do not tell them apart.
const COARSE: i32 = 64;
/// Matching error, in levels, up to which a pixel of optical flow is good, and up to which it is fair.
const GOOD: u8 = 12;
const FAIR: u8 = 48;
/// Matching error of uniform tiles that are not compared.
const UNKNOWN: u8 = 24;

/// Ranges of the vectors and ranks of every tile; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Ranges {
    vectors: Vec<VectorRange>,
    ranks: Vec<RankRange>,
}

/// What segments are made from.
pub(super) struct Given<'a, P> {
    pub(super) level: Level,
    pub(super) guidance: &'a Guidance,
    /// Previous and current anchor.
    pub(super) anchors: Option<[Source<'a, P>; 2]>,
    pub(super) standing: Standing<'a>,
    /// Whether depth is the same everywhere.
    pub(super) is_flat: bool,
}

impl<P: Colour> Given<'_, P> {
    /// Segments the field.
    pub(super) fn segment(&self, ranges: &mut Ranges, field: &mut Segments) -> Result<()> {
        let grid = Grid::new(self.guidance.size());
        field.reserve(grid)?;
        sized(&mut ranges.vectors, grid.tiles(), VectorRange::default())?;
        sized(&mut ranges.ranks, grid.tiles(), RankRange::default())?;
        let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(LONGEST));
        let Ranges { vectors, ranks } = ranges;
        let rows = vectors.par_chunks_mut(grid.columns).zip(ranks.par_chunks_mut(grid.columns));
        rows.with_min_len(4)
            .enumerate()
            .for_each(|(row, (vectors, ranks))| self.find_ranges(row, limit, vectors, ranks));
        field.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            let mut made = [Segment::default(); SLOTS];
            for column in 0..grid.columns {
                let count = self.segment_tile([column, row], grid, limit, vectors, ranks, &mut made);
                tiles.set(column, &made[..count]);
            }
            tiles.find_spans();
        });
        Ok(())
    }

    /// Gives the surface in front the pixels at its edge that it fits better: they are mixtures of its colour with what is behind it.
    pub(super) fn widen(&self, from: &Segments, to: &mut Segments) -> Result<()> {
        let grid = from.grid;
        to.reserve(grid)?;
        to.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            for column in 0..grid.columns {
                tiles.copy(column, from, row * grid.columns + column);
                self.widen_tile([column, row], from, column, &mut tiles);
            }
            tiles.find_spans();
        });
        Ok(())
    }

    fn widen_tile(&self, at: [usize; 2], from: &Segments, to_tile: usize, to: &mut TilesMut<'_>) {
        let Some([previous, current]) = self.anchors else { return };
        let tile = at[1] * from.grid.columns + at[0];
        if !from.is_mixed_around(at) {
            return;
        }
        let corner = at.map(|at| at * TILE);
        let mut fronts = [Front::default(); FRONTS];
        let farthest = from.of(tile).map(Segment::key).max().unwrap_or(0);
        let count = from.around(at, u64::MAX, farthest, &mut fronts);
        let mut taken = 0;
        for front in &fronts[..count] {
            let front_key = front.key;
            let (mut own, mut asked) = ([EMPTY; BLOCK], 0);
            for segment in from.of(tile) {
                let key = segment.key();
                let zone = front.zone & segment.mask & !taken;
                if zone != 0 && is_nearer(front_key, key) && !alike(key, front_key) {
                    asked |= zone;
                    each(zone, |pixel| own[pixel] = key);
                }
            }
            if asked == 0 {
                continue;
            }
            let fitting = fitting(self.level, previous, current, corner, asked, &[front_key; BLOCK], &own);
            if fitting != 0 {
                taken |= fitting;
                to.remove(to_tile, fitting);
                to.join(to_tile, Segment::new(front_key, fitting));
            }
        }
    }

    /// The ranges of vectors and ranks of a row of tiles.
    fn find_ranges(&self, row: usize, limit: [i32; 2], vectors: &mut [VectorRange], ranks: &mut [RankRange]) {
        let (level, width) = (self.level, self.guidance.motion().width() as usize);
        let motion = self.guidance.motion();
        let (given, tile) = (motion.vectors(), motion.tile() as usize);
        if tile == 1 {
            let rows = row * TILE * width..((row + 1) * TILE * width).min(given.len());
            motion_ranges(level, &given[rows], width, limit, vectors);
        } else {
            let of_row = &given[row * TILE / tile * motion.columns() as usize..];
            let mut landing = Landing::default();
            for (ranges, vectors) in vectors.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                land(level, vectors, &[0.0; TILE][..vectors.len()], [0; 2], 0, limit, &mut landing);
                for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&landing.keys) {
                    let vector = layer::vector(key);
                    ranges.fill(VectorRange { low: vector, high: vector });
                }
            }
        }
        let depth = self.guidance.depth();
        let (given, tile) = (depth.depth(), depth.tile() as usize);
        if let Some(even) = depth.uniform_value() {
            let mut landing = Landing::default();
            land(level, &[[f16::ZERO; 2]], &[even], [0; 2], 0, limit, &mut landing);
            let rank = layer::rank(landing.keys[0]);
            ranks.fill(RankRange { near: rank, far: rank });
        } else if tile == 1 {
            let rows = row * TILE * width..((row + 1) * TILE * width).min(given.len());
            depth_ranges(level, &given[rows], width, ranks);
        } else {
            let of_row = &given[row * TILE / tile * depth.columns() as usize..];
            let (still, mut landing) = ([[f16::ZERO; 2]; TILE], Landing::default());
            for (ranges, depth) in ranks.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                land(level, &still[..depth.len()], depth, [0; 2], 0, limit, &mut landing);
                for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&landing.keys) {
                    ranges.fill(RankRange { near: layer::rank(key), far: layer::rank(key) });
                }
            }
        }
    }

    /// Makes the segments of a tile and returns their number.
    fn segment_tile(
        &self,
        at: [usize; 2],
        grid: Grid,
        limit: [i32; 2],
        vectors: &[VectorRange],
        ranks: &[RankRange],
        made: &mut [Segment; SLOTS],
    ) -> usize {
        let [column, row] = at;
        let tile = row * grid.columns + column;
        let extent = grid.extent(column, row);
        let (corner, inside) = ([column * TILE, row * TILE], inside(extent));
        let static_pixels = self.static_pixels(corner, extent);
        if static_pixels == inside {
            made[0] = Segment { mask: inside, ..Segment::default() };
            return 1;
        }
        let VectorRange { low, high } = vectors[tile];
        let is_uniform = (0..2).all(|c| high[c] - low[c] <= UNIFORM);
        let is_matched = self.is_flat && self.anchors.is_some() && self.is_at_edge(at, grid, vectors);
        if is_uniform && static_pixels == 0 && !is_matched {
            let vector = std::array::from_fn(|c| (low[c] + high[c]) >> 1);
            let mark = if self.is_flat { UNKNOWN } else { 0 };
            made[0] = Segment { mask: inside, vector, rank: ranks[tile].near.midpoint(ranks[tile].far), mark };
            return 1;
        }
        let mut keys = [EMPTY; BLOCK];
        self.read_tile(corner, extent, limit, &mut keys);
        if is_matched && let Some([previous, current]) = self.anchors {
            mark_matches(self.level, previous, current, corner, &mut keys);
            for key in keys.iter_mut().filter(|key| **key != EMPTY) {
                let error = match layer::mark(*key) {
                    mark if mark <= GOOD => GOOD / 2,
                    mark if mark <= FAIR => FAIR / 2,
                    _ => layer::WORST_MATCH,
                };
                *key = layer::marked(*key, error);
            }
        }
        let mut count = 0;
        if static_pixels != 0 {
            made[0] = Segment { mask: static_pixels, ..Segment::default() };
            count = 1;
        }
        cluster(self.level, &keys, inside & !static_pixels, made, count)
    }

    /// Pixels of a tile that a static overlay covers.
    fn static_pixels(&self, corner: [usize; 2], extent: [usize; 2]) -> u64 {
        let count = self.standing.count(corner, extent);
        if count == 0 {
            return 0;
        }
        let inside = inside(extent);
        if count == extent[0] * extent[1] {
            return inside;
        }
        let mut mask = 0;
        each(inside, |pixel| {
            let is_static = self.standing.is_at([corner[0] + pixel % TILE, corner[1] + pixel / TILE]);
            mask |= u64::from(is_static) << pixel;
        });
        mask
    }

    /// Whether a tile or one around it has different motion.
    fn is_at_edge(&self, [column, row]: [usize; 2], grid: Grid, vectors: &[VectorRange]) -> bool {
        let own = vectors[row * grid.columns + column];
        let (mut low, mut high) = (own.low, own.high);
        for row in row.saturating_sub(1)..(row + 2).min(grid.rows) {
            for other in &vectors[row * grid.columns..][column.saturating_sub(1)..(column + 2).min(grid.columns)] {
                low = std::array::from_fn(|c| low[c].min(other.low[c]));
                high = std::array::from_fn(|c| high[c].max(other.high[c]));
            }
        }
        (0..2).any(|c| high[c] - low[c] > ALIKE)
    }

    /// The keys of the pixels of a tile.
    fn read_tile(&self, corner: [usize; 2], [across, down]: [usize; 2], limit: [i32; 2], keys: &mut [Key; BLOCK]) {
        let (vectors, depths) = (self.guidance.motion(), self.guidance.depth());
        let width = vectors.width() as usize;
        let first = corner[1] * width + corner[0];
        let even = depths.uniform_value().map(|even| [even; TILE]);
        if [across, down] == [TILE; 2] && vectors.tile() == 1 && (depths.tile() == 1 || even.is_some()) {
            let (depth, stride) = match &even {
                Some(even) => (even.as_slice(), 0),
                None => (&depths.depth()[first..], width),
            };
            return claim_tile(self.level, &vectors.vectors()[first..], depth, [width, stride], limit, keys);
        }
        let mut landing = Landing::default();
        let (mut motion, mut depth) = ([[f16::ZERO; 2]; TILE], [0.0; TILE]);
        let (vector_tile, depth_tile) = (vectors.tile() as usize, depths.tile() as usize);
        for j in 0..down {
            let y = corner[1] + j;
            let vectors = &vectors.vectors()[y / vector_tile * vectors.columns() as usize..];
            let depths = &depths.depth()[y / depth_tile * depths.columns() as usize..];
            for i in 0..across {
                motion[i] = vectors[(corner[0] + i) / vector_tile];
                depth[i] = depths[(corner[0] + i) / depth_tile];
            }
            land(self.level, &motion[..across], &depth[..across], [0, 0], 0, limit, &mut landing);
            keys[j * TILE..][..across].copy_from_slice(&landing.keys[..across]);
        }
    }
}

at_every_level! {
    /// Groups the pixels of `mask` by motion, depth and matching error, after `first` segments in `made`; returns the number of all.
    ///
    /// A segment begins with the nearest pixel that is left. Where the segments of a tile would be too many, they are made wider.
    pub(super) fn cluster(keys: &[Key; BLOCK], mask: u64, made: &mut [Segment; SLOTS], first: usize) -> usize
        = cluster_side_by_side | cluster_side_by_side
}

#[inline(always)]
fn cluster_side_by_side(keys: &[Key; BLOCK], mask: u64, made: &mut [Segment; SLOTS], first: usize) -> usize {
    let (mut x, mut y, mut rank, mut mark) = ([0; BLOCK], [0; BLOCK], [0; BLOCK], [0; BLOCK]);
    for i in 0..BLOCK {
        let [vx, vy] = layer::vector(keys[i]);
        (x[i], y[i]) = (vx, vy);
        (rank[i], mark[i]) = (i32::from(layer::rank(keys[i])), i32::from(layer::mark(keys[i])));
    }
    let mut width = CLUSTER;
    loop {
        let (mut left, mut count) = (mask, first);
        while left != 0 && count < SLOTS {
            let mut seed = EMPTY;
            each(left, |pixel| seed = seed.min(keys[pixel]));
            let ([sx, sy], sr, sm) = (layer::vector(seed), i32::from(layer::rank(seed)), i32::from(layer::mark(seed)));
            let (mut x, mut y) = (x, y);
            for p in 0..BLOCK {
                (x[p], y[p]) = ((x[p] - sx).abs(), (y[p] - sy).abs());
            }
            let is_coarse = width >= COARSE;
            let mut found = 0;
            for j in 0..TILE {
                let mut bits = 0;
                for i in 0..TILE {
                    let p = j * TILE + i;
                    let is_alike = (x[p] <= width)
                        & (y[p] <= width)
                        & ((rank[p] - sr).abs() <= i32::from(ONE_SURFACE))
                        & ((mark[p] == sm) | is_coarse);
                    bits |= u64::from(is_alike) << i;
                }
                found |= bits << (j * TILE);
            }
            found &= left;
            made[count] = Segment { mask: found, vector: [0; 2], rank: layer::rank(seed), mark: layer::mark(seed) };
            (left, count) = (left & !found, count + 1);
        }
        if left != 0 && width < 1 << 13 {
            width *= 2;
            continue;
        }
        made[count - 1].mask |= left;
        for segment in &mut made[first..count] {
            let mut sum = [0_i64; 2];
            each(segment.mask, |pixel| sum = [sum[0] + i64::from(x[pixel]), sum[1] + i64::from(y[pixel])]);
            let area = i64::from(segment.mask.count_ones());
            segment.vector = sum.map(|sum| (2 * sum + area).div_euclid(2 * area) as i32);
            let mut total = 0;
            each(segment.mask, |pixel| total += i64::from(rank[pixel]));
            segment.rank = (total / area) as u16;
        }
        return count;
    }
}
