//! The motion field of the current anchor as splat keys: guidance is sanitised, tiles are classified as uniform or
//! mixed, and foreground is dilated over its anti-aliased edges.

mod matching;

use half::f16;

use super::colour::Colour;
use super::kernels::tile_keys::{self, PaddedTile};
use super::kernels::{
    BLOCK, DepthKeyRange, SimdLevel, Source, TILE, VectorRange, WarpedRow, depth_ranges, motion_ranges, pack_tile,
    warp_row,
};
use super::key_buffer::{Grid, KeyBuffer, Tile, TileKind};
use super::rules::{Rule, Rules};
use super::splat_key::{self, DEPTH_KEY_TOLERANCE, EMPTY, Key, MAX_COMPONENT, SIMILAR_MOTION, pack};
use super::static_mask::StaticMask;
use super::{reserve, resize};
use crate::Result;
use crate::guidance::{DepthMap, Guidance};
use crate::tasks::{self, Parallel, ParallelSliceMut};

use matching::{better_fit, tag_match_errors};
#[cfg(test)]
pub(super) use matching::{colour_distance, match_error};

/// Largest difference per component between the motion vectors of a uniform tile, in 1/64 px: three quarters of a
/// pixel.
pub(super) const UNIFORM_RANGE: i32 = 48;
/// Largest colour difference, in levels, of a pixel that dilation assigns to the foreground.
pub(super) const DILATION_TOLERANCE: f32 = 38.0;
/// Tiles whose keys and pixels are prefetched ahead of the current one.
const PREFETCH_AHEAD: usize = 3;
/// Smallest number of rows of tiles per band.
const MIN_BAND_ROWS: usize = 4;
/// Match error of a uniform tile, which is not measured: neither good nor bad.
pub(super) const UNKNOWN_MATCH_ERROR: u8 = 24;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "FIELD_": int UNIFORM_RANGE, float DILATION_TOLERANCE, uint UNKNOWN_MATCH_ERROR
);

/// Builds the field of a guidance; keeps its working memory.
#[derive(Debug, Default)]
pub(super) struct FieldBuilder {
    windows: Vec<[GuidanceRow; 3]>,
}

/// A row of classified tiles, before refinement at edges.
#[derive(Debug, Default)]
struct GuidanceRow {
    vectors: Vec<VectorRange>,
    depth_keys: Vec<DepthKeyRange>,
    ranges: Vec<NeighbourRange>,
    tiles: Vec<Tile>,
    keys: Vec<[Key; BLOCK]>,
}

impl GuidanceRow {
    fn reserve(&mut self, columns: usize) -> Result<()> {
        resize(&mut self.vectors, columns, VectorRange::default())?;
        resize(&mut self.depth_keys, columns, DepthKeyRange::default())?;
        resize(&mut self.ranges, columns, NeighbourRange::NONE)?;
        resize(&mut self.tiles, columns, Tile::default())?;
        resize(&mut self.keys, columns, [EMPTY; BLOCK])
    }
}

impl FieldBuilder {
    /// Fills `field` with the keys of `guidance` and of static foreground. For a pair of anchors without depth, the
    /// match error with the previous anchor replaces depth as the order of keys.
    pub(super) fn build<P: Colour>(
        &mut self,
        level: SimdLevel,
        rules: Rules,
        guidance: &Guidance,
        anchors: Option<(Source<'_, P>, Source<'_, P>)>,
        static_mask: StaticMask<'_>,
        field: &mut KeyBuffer,
    ) -> Result<()> {
        let grid = Grid::new(guidance.size());
        let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(MAX_COMPONENT));
        field.reserve(grid)?;
        // A row is refined while its neighbours are in the window. Each band also classifies the rows above and below
        // it.
        let band_rows = grid.rows.div_ceil(2 * tasks::concurrency()).max(MIN_BAND_ROWS);
        let bands = grid.rows.div_ceil(band_rows);
        if self.windows.len() < bands {
            reserve(&mut self.windows, bands)?;
            self.windows.resize_with(bands, Default::default);
        }
        for window in &mut self.windows[..bands] {
            window.iter_mut().try_for_each(|guidance_row| guidance_row.reserve(grid.columns))?;
        }
        let is_flat = is_flat(level, guidance.depth());
        let can_dilate = !is_flat && guidance.motion().tile() == 1 && rules.has(Rule::EdgeDilation);
        let orders_by_match = is_flat && rules.has(Rule::MatchAsDepth);
        let reader = GuidanceReader { level, guidance, limit, grid, static_mask };
        let refinement = EdgeRefinement { level, grid, anchors, orders_by_match, can_dilate };

        let tiles = field.tiles.par_chunks_mut(band_rows * grid.columns);
        let keys = field.keys.par_chunks_mut(band_rows * grid.columns);
        let bands =
            tiles.zip(keys).zip(field.vertical_ranges.par_chunks_mut(band_rows)).zip(self.windows.par_iter_mut());
        bands.enumerate().for_each(|(band, (((tiles, keys), vertical_ranges), window))| {
            let first = band * band_rows;
            let tiles = tiles.chunks_mut(grid.columns).zip(keys.chunks_mut(grid.columns));
            for row in first.saturating_sub(1)..=first {
                reader.classify_row(row, window);
            }
            for (row, ((tiles, keys), vertical_range)) in (first..).zip(tiles.zip(vertical_ranges)) {
                reader.classify_row(row + 1, window);
                refinement.refine_row(row, window, tiles, keys);
                *vertical_range = tiles
                    .iter()
                    .fold([i32::MAX, i32::MIN], |[low, high], tile| [low.min(tile.low[1]), high.max(tile.high[1])]);
            }
        });
        Ok(())
    }
}

/// Whether all depth keys are equal. Constant depth means that motion came from optical flow.
fn is_flat(level: SimdLevel, depth: &DepthMap) -> bool {
    if depth.uniform_value().is_some() {
        return true;
    }
    let mut warped_row = WarpedRow::default();
    let mut depth_keys = |depth: &[f32]| {
        warp_row(level, &[[f16::ZERO; 2]; TILE][..depth.len()], depth, [0; 2], 0, [0; 2], &mut warped_row);
        warped_row.keys.map(splat_key::depth_key)
    };
    let first = depth_keys(&depth.depth()[..1])[0];
    let mut is_like_first =
        |depth: &[f32]| depth_keys(depth)[..depth.len()].iter().all(|&depth_key| depth_key == first);
    // A few samples first, which usually decide.
    let samples = depth.depth().chunks(depth.depth().len().div_ceil(64));
    { samples }.all(|sample| is_like_first(&sample[..1])) && depth.depth().chunks(TILE).all(is_like_first)
}

/// Extremes of a tile's keys, or of several tiles'.
///
/// Minimum of each motion component, minimum of each negated component, smallest depth key, negated largest depth key,
/// and -1 for a mixed tile: a union is the minimum of each value.
#[derive(Debug, Clone, Copy, Default)]
struct NeighbourRange([i32; 8]);

impl NeighbourRange {
    const NONE: Self = Self([i32::MAX; 8]);

    fn new(tile: &Tile, depth_keys: DepthKeyRange) -> Self {
        let Tile { low, high, .. } = tile;
        let has_mixed = tile.kind == TileKind::Mixed;
        Self([
            low[0],
            low[1],
            -high[0],
            -high[1],
            depth_keys.near.into(),
            -i32::from(depth_keys.far),
            -i32::from(has_mixed),
            0,
        ])
    }

    #[inline(always)]
    fn union(self, other: &Self) -> Self {
        let mut both = self.0;
        for (end, other) in both.iter_mut().zip(other.0) {
            *end = other.min(*end);
        }
        Self(both)
    }

    /// Whether all motion is similar.
    fn is_similar(&self) -> bool {
        (0..2).all(|c| -self.0[c + 2] - self.0[c] <= SIMILAR_MOTION)
    }

    fn has_mixed(&self) -> bool {
        self.0[6] != 0
    }

    fn near(&self) -> i32 {
        self.0[4]
    }

    fn far(&self) -> i32 {
        -self.0[5]
    }
}

/// Converts guidance to keys.
struct GuidanceReader<'a> {
    level: SimdLevel,
    guidance: &'a Guidance,
    limit: [i32; 2],
    grid: Grid,
    static_mask: StaticMask<'a>,
}

impl GuidanceReader<'_> {
    /// Classifies the tiles of a row, if that is inside the picture.
    fn classify_row(&self, row: usize, window: &mut [GuidanceRow; 3]) {
        let GuidanceRow { vectors, depth_keys, ranges, tiles, keys } = &mut window[row % 3];
        if row >= self.grid.rows {
            return;
        }
        self.find_ranges(row, vectors, depth_keys);
        for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            ranges[column] = self.classify(column, row, vectors[column], depth_keys[column], tile, keys);
        }
    }

    /// Computes the ranges of motion and depth keys of a row of tiles.
    fn find_ranges(&self, row: usize, vectors: &mut [VectorRange], depth_keys: &mut [DepthKeyRange]) {
        let Self { level, limit, .. } = *self;
        let width = self.grid.width;
        let motion = self.guidance.motion();
        let (values, tile) = (motion.vectors(), motion.tile() as usize);
        if tile == 1 {
            let rows = row * TILE * width..((row + 1) * TILE * width).min(values.len());
            motion_ranges(level, &values[rows], width, limit, vectors);
        } else {
            let of_row = &values[row * TILE / tile * motion.columns() as usize..];
            let mut warped_row = WarpedRow::default();
            for (ranges, vectors) in vectors.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                warp_row(level, vectors, &[0.0; TILE][..vectors.len()], [0; 2], 0, limit, &mut warped_row);
                for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&warped_row.keys) {
                    let vector = splat_key::vector(key);
                    ranges.fill(VectorRange { low: vector, high: vector });
                }
            }
        }

        let depth = self.guidance.depth();
        if let Some(uniform) = depth.uniform_value() {
            let mut warped_row = WarpedRow::default();
            warp_row(level, &[[f16::ZERO; 2]], &[uniform], [0; 2], 0, limit, &mut warped_row);
            let depth_key = splat_key::depth_key(warped_row.keys[0]);
            depth_keys.fill(DepthKeyRange { near: depth_key, far: depth_key });
            return;
        }
        let (values, tile) = (depth.depth(), depth.tile() as usize);
        if tile == 1 {
            let rows = row * TILE * width..((row + 1) * TILE * width).min(values.len());
            depth_ranges(level, &values[rows], width, depth_keys);
        } else {
            let of_row = &values[row * TILE / tile * depth.columns() as usize..];
            let (no_motion, mut warped_row) = ([[f16::ZERO; 2]; TILE], WarpedRow::default());
            for (ranges, depth) in depth_keys.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                warp_row(level, &no_motion[..depth.len()], depth, [0; 2], 0, limit, &mut warped_row);
                for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&warped_row.keys) {
                    ranges.fill(DepthKeyRange { near: splat_key::depth_key(key), far: splat_key::depth_key(key) });
                }
            }
        }
    }

    /// Classifies a tile, and computes the keys of its pixels if it is mixed.
    #[inline(never)]
    fn classify(
        &self,
        column: usize,
        row: usize,
        VectorRange { low, high }: VectorRange,
        depth_keys: DepthKeyRange,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) -> NeighbourRange {
        let [across, down] = self.grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        let static_count = self.static_mask.count(corner, [across, down]);
        if static_count == across * down {
            *tile = Tile { key: pack(0, 0, [0; 2]), ..Tile::default() };
            return NeighbourRange::new(tile, DepthKeyRange { near: 0, far: 0 });
        }
        if static_count == 0 && (0..2).all(|c| high[c] - low[c] <= UNIFORM_RANGE) {
            let middle = std::array::from_fn(|c| (low[c] + high[c]) >> 1);
            *tile = Tile { key: pack(depth_keys.near, 0, middle), low: middle, high: middle, ..Tile::default() };
            return NeighbourRange::new(tile, DepthKeyRange { far: depth_keys.near, ..depth_keys });
        }
        let (vectors, depths) = (self.guidance.motion(), self.guidance.depth());
        let first = corner[1] * self.grid.width + corner[0];
        let uniform = depths.uniform_value().map(|uniform| [uniform; TILE]);
        if [across, down] == [TILE, TILE] && vectors.tile() == 1 && (depths.tile() == 1 || uniform.is_some()) {
            let (depth, stride) = match &uniform {
                Some(uniform) => (uniform.as_slice(), 0),
                None => (&depths.depth()[first..], self.grid.width),
            };
            pack_tile(self.level, &vectors.vectors()[first..], depth, [self.grid.width, stride], self.limit, keys);
        } else {
            keys.fill(EMPTY);
            let mut warped_row = WarpedRow::default();
            let mut motion = [[f16::ZERO; 2]; TILE];
            let mut depth = [0.0; TILE];
            for j in 0..down {
                self.read(corner[0], corner[1] + j, &mut motion[..across], &mut depth[..across]);
                warp_row(self.level, &motion[..across], &depth[..across], [0, 0], 0, self.limit, &mut warped_row);
                keys[j * TILE..][..across].copy_from_slice(&warped_row.keys[..across]);
            }
        }
        if static_count > 0 {
            for index in (0..BLOCK).filter(|index| index % TILE < across && index / TILE < down) {
                if self.static_mask.is_static([corner[0] + index % TILE, corner[1] + index / TILE]) {
                    keys[index] = pack(0, 0, [0; 2]);
                }
            }
        }
        let zero = if static_count > 0 { [0; 2] } else { low };
        *tile = Tile {
            kind: TileKind::Mixed,
            key: EMPTY,
            holes: 0,
            low: [low[0].min(zero[0]), low[1].min(zero[1])],
            high: if static_count > 0 { high.map(|v| v.max(0)) } else { high },
        };
        NeighbourRange::new(tile, if static_count > 0 { DepthKeyRange { near: 0, ..depth_keys } } else { depth_keys })
    }

    /// Reads motion and depth of some pixels of a row of a tile.
    fn read(&self, x: usize, y: usize, motion: &mut [[f16; 2]], depth: &mut [f32]) {
        let (field, map) = (self.guidance.motion(), self.guidance.depth());
        let (columns, tile) = (field.columns() as usize, field.tile() as usize);
        let row = &field.vectors()[y / tile * columns..][..columns];
        motion.iter_mut().enumerate().for_each(|(i, v)| *v = row[(x + i) / tile]);
        let (columns, tile) = (map.columns() as usize, map.tile() as usize);
        let row = &map.depth()[y / tile * columns..][..columns];
        depth.iter_mut().enumerate().for_each(|(i, v)| *v = row[(x + i) / tile]);
    }
}

/// Refines keys at the edges of surfaces.
struct EdgeRefinement<'a, P> {
    level: SimdLevel,
    grid: Grid,
    anchors: Option<(Source<'a, P>, Source<'a, P>)>,
    /// Whether the depth is constant.
    orders_by_match: bool,
    /// Whether motion and depth are per pixel, so that foreground can be dilated.
    can_dilate: bool,
}

impl<P: Colour> EdgeRefinement<'_, P> {
    /// Prefetches the pixels with which a tile is compared.
    #[inline(always)]
    fn prefetch(&self, column: usize, row: usize, NeighbourRange(ranges): &NeighbourRange) {
        if let Some((previous, current)) = self.anchors {
            let at = [64 * (column * TILE) as i32, 64 * (row * TILE) as i32];
            current.prefetch_tile(at, 0);
            previous.prefetch_tile([at[0] + ranges[0], at[1] + ranges[1]], 0);
        }
    }

    /// The given row and its neighbours inside the picture.
    #[inline(always)]
    fn rows_around<'b>(
        &self,
        row: usize,
        window: &'b [GuidanceRow; 3],
    ) -> impl Iterator<Item = &'b GuidanceRow> + use<'b, P> {
        (row.saturating_sub(1)..(row + 2).min(self.grid.rows)).map(|row| &window[row % 3])
    }

    /// Extremes of a column of three tiles.
    #[inline(always)]
    fn column(&self, column: usize, row: usize, window: &[GuidanceRow; 3]) -> NeighbourRange {
        let ranges = self.rows_around(row, window).filter_map(|guidance_row| guidance_row.ranges.get(column));
        ranges.fold(NeighbourRange::NONE, |all, ranges| all.union(ranges))
    }

    /// Copies a row from the window and refines its tiles at edges.
    fn refine_row(&self, row: usize, window: &[GuidanceRow; 3], tiles: &mut [Tile], keys: &mut [[Key; BLOCK]]) {
        let guidance_row = &window[row % 3];
        tiles.copy_from_slice(&guidance_row.tiles);
        let (mut before, mut here) = (NeighbourRange::NONE, self.column(0, row, window));
        let is_refined = self.orders_by_match || self.can_dilate;
        for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            if tile.kind == TileKind::Mixed {
                *keys = guidance_row.keys[column];
            }
            if !is_refined {
                continue;
            }
            let next = self.column(column + 1, row, window);
            let all = before.union(&here).union(&next);
            (before, here) = (here, next);
            if let Some(ranges) = guidance_row.ranges.get(column + PREFETCH_AHEAD).filter(|ranges| ranges.has_mixed()) {
                self.prefetch(column + PREFETCH_AHEAD, row, ranges);
            }
            if self.orders_by_match {
                self.tag_match_errors(column, row, window, &all, tile, keys);
            } else if all.near() + i32::from(DEPTH_KEY_TOLERANCE) < guidance_row.ranges[column].far()
                && !all.is_similar()
            {
                // Otherwise no neighbour is in front with different motion.
                self.dilate(column, row, window, tile, keys);
            }
        }
    }

    /// Without depth, tags each pixel of a tile at an edge with its match error.
    #[inline(never)]
    fn tag_match_errors(
        &self,
        column: usize,
        row: usize,
        window: &[GuidanceRow; 3],
        all: &NeighbourRange,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) {
        let own = &window[row % 3].ranges[column];
        let is_edge = tile.kind == TileKind::Mixed
            || self.anchors.is_some()
                && (all.has_mixed()
                    || !all.is_similar()
                        && self.rows_around(row, window).any(|guidance_row| {
                            let neighbours =
                                &guidance_row.ranges[column.saturating_sub(1)..(column + 2).min(self.grid.columns)];
                            neighbours.iter().any(|other| !own.union(other).is_similar())
                        }));
        if !is_edge {
            tile.key = splat_key::with_tag(tile.key, UNKNOWN_MATCH_ERROR);
            return;
        }
        let Some((previous, current)) = self.anchors else { return };
        if tile.kind == TileKind::Uniform {
            let [across, down] = self.grid.extent(column, row);
            keys.fill(EMPTY);
            (0..down).for_each(|j| keys[j * TILE..][..across].fill(tile.key));
            (tile.kind, tile.key) = (TileKind::Mixed, EMPTY);
        }
        tag_match_errors(self.level, previous, current, [column * TILE, row * TILE], keys);
    }

    /// Dilates foreground: at its edge its colours are mixed with the background's, so that the edge must move with the
    /// foreground. A pixel takes the nearest key of its 3x3 neighbourhood if that matches the previous anchor better
    /// than its own.
    #[inline(never)]
    fn dilate(&self, column: usize, row: usize, window: &[GuidanceRow; 3], tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let padded_tile = self.padded_tile(column, row, window);
        let mut nearest = [EMPTY; BLOCK];
        let mut nearer = tile_keys::nearest_neighbours(self.level, &padded_tile, SIMILAR_MOTION, &mut nearest);
        if nearer == 0 {
            return;
        }
        if tile.kind == TileKind::Uniform {
            for (keys, guidance_row) in keys.chunks_mut(TILE).zip(&padded_tile[1..]) {
                keys.copy_from_slice(&guidance_row[1..=TILE]);
            }
        }
        if let Some((previous, current)) = self.anchors {
            nearer = better_fit(self.level, previous, current, [column * TILE, row * TILE], nearer, &nearest, keys);
        }
        if nearer != 0 {
            (tile.kind, tile.key) = (TileKind::Mixed, EMPTY);
        }
        while nearer != 0 {
            let index = nearer.trailing_zeros() as usize;
            nearer &= nearer - 1;
            keys[index] = nearest[index];
            let vector = splat_key::vector(nearest[index]);
            tile.low = [0, 1].map(|c| tile.low[c].min(vector[c]));
            tile.high = [0, 1].map(|c| tile.high[c].max(vector[c]));
        }
    }

    /// The keys of a tile with a border of one pixel, [`EMPTY`] outside the picture.
    #[inline(always)]
    fn padded_tile(&self, column: usize, row: usize, window: &[GuidanceRow; 3]) -> PaddedTile {
        let Grid { width, height, .. } = self.grid;
        let (left, right) = (column * TILE, (column + 1) * TILE);
        let fill = |row: usize, j: usize, to: &mut [Key; TILE + 2]| {
            let guidance_row = &window[row % 3];
            let key = |column: usize, i: usize| match guidance_row.tiles[column].kind {
                TileKind::Uniform => guidance_row.tiles[column].key,
                TileKind::Mixed => guidance_row.keys[column][j * TILE + i],
            };
            match guidance_row.tiles[column].kind {
                TileKind::Uniform => to[1..=TILE.min(width - left)].fill(guidance_row.tiles[column].key),
                TileKind::Mixed => to[1..=TILE].copy_from_slice(&guidance_row.keys[column][j * TILE..][..TILE]),
            }
            if column > 0 {
                to[0] = key(column - 1, TILE - 1);
            }
            if right < width {
                to[TILE + 1] = key(column + 1, 0);
            }
        };
        let mut padded_tile = [[EMPTY; TILE + 2]; TILE + 2];
        if row > 0 {
            fill(row - 1, TILE - 1, &mut padded_tile[0]);
        }
        for j in 0..TILE.min(height - row * TILE) {
            fill(row, j, &mut padded_tile[j + 1]);
        }
        if (row + 1) * TILE < height {
            fill(row + 1, 0, &mut padded_tile[TILE + 1]);
        }
        padded_tile
    }
}
