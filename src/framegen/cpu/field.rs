//! The motion of the current anchor as it is given, made ready: sanitised, sorted into smooth and rough tiles, surfaces
//! drawn out over their rims.

mod matching;

use half::f16;

use super::colour::Colour;
use super::kernels::claims::{self, Around};
use super::kernels::{
    BLOCK, Landing, Level, RankRange, Source, TILE, VectorRange, claim_tile, depth_ranges, land, motion_ranges,
};
use super::layer::{self, ALIKE, EMPTY, Grid, Key, Kind, LONGEST, Layer, SAME_RANK, Tile, key};
use super::rules::{Rule, Rules};
use super::standing::Standing;
use super::{reserve, sized};
use crate::Result;
use crate::guidance::{DepthMap, Guidance};
use crate::tasks::{self, Parallel, ParallelSliceMut};

#[cfg(test)]
pub(super) use matching::{distance, match_of};
use matching::{fitting, mark_matches};

/// A tile whose vectors differ by no more than this, in 1/64 px, is smooth: three quarters of a pixel.
pub(super) const SMOOTH: i32 = 48;
/// Levels within which a pixel on the rim of a surface is that surface's.
pub(super) const RIM: f32 = 38.0;
/// Tiles ahead of the one that is looked at whose keys and pixels are asked for.
const AHEAD: usize = 3;
/// Rows of tiles that are made together at least.
const LEAST_BAND: usize = 4;
/// The match of a smooth tile whose pixels are not looked at: neither good nor bad.
pub(super) const UNKNOWN_MATCH: u8 = 24;

/// Makes the field of a guidance; keeps its working memory.
#[derive(Debug, Default)]
pub(super) struct Preparation {
    windows: Vec<[Line; 3]>,
}

/// A row of tiles as it is given.
#[derive(Debug, Default)]
struct Line {
    vectors: Vec<VectorRange>,
    ranks: Vec<RankRange>,
    ends: Vec<Ends>,
    tiles: Vec<Tile>,
    keys: Vec<[Key; BLOCK]>,
}

impl Line {
    fn reserve(&mut self, columns: usize) -> Result<()> {
        sized(&mut self.vectors, columns, VectorRange::default())?;
        sized(&mut self.ranks, columns, RankRange::default())?;
        sized(&mut self.ends, columns, Ends::NONE)?;
        sized(&mut self.tiles, columns, Tile::default())?;
        sized(&mut self.keys, columns, [EMPTY; BLOCK])
    }
}

impl Preparation {
    /// Fills `field` with the motion of `guidance`, and of what stands still in front of it. With a pair of anchors, where
    /// depth says nothing, pixels are ranked by how well the previous anchor matches.
    pub(super) fn prepare<P: Colour>(
        &mut self,
        level: Level,
        rules: Rules,
        guidance: &Guidance,
        anchors: Option<(Source<'_, P>, Source<'_, P>)>,
        standing: Standing<'_>,
        field: &mut Layer,
    ) -> Result<()> {
        let grid = Grid::new(guidance.size());
        let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(LONGEST));
        field.reserve(grid)?;
        // Rows are finished while those around them are at hand. Each band looks at one more on both sides.
        let in_band = grid.rows.div_ceil(2 * tasks::concurrency()).max(LEAST_BAND);
        let bands = grid.rows.div_ceil(in_band);
        if self.windows.len() < bands {
            reserve(&mut self.windows, bands)?;
            self.windows.resize_with(bands, Default::default);
        }
        for window in &mut self.windows[..bands] {
            window.iter_mut().try_for_each(|line| line.reserve(grid.columns))?;
        }
        let is_flat = is_flat(level, guidance.depth());
        let can_draw_out = !is_flat && guidance.motion().tile() == 1 && rules.has(Rule::EdgeExtension);
        let is_ranked = is_flat && rules.has(Rule::MatchAsDepth);
        let given = Given { level, guidance, limit, grid, standing };
        let edges = Edges { level, grid, anchors, is_ranked, can_draw_out };

        let tiles = field.tiles.par_chunks_mut(in_band * grid.columns);
        let keys = field.keys.par_chunks_mut(in_band * grid.columns);
        let bands = tiles.zip(keys).zip(field.spans.par_chunks_mut(in_band)).zip(self.windows.par_iter_mut());
        bands.enumerate().for_each(|(band, (((tiles, keys), spans), window))| {
            let first = band * in_band;
            let tiles = tiles.chunks_mut(grid.columns).zip(keys.chunks_mut(grid.columns));
            for row in first.saturating_sub(1)..=first {
                given.sort_row(row, window);
            }
            for (row, ((tiles, keys), span)) in (first..).zip(tiles.zip(spans)) {
                given.sort_row(row + 1, window);
                edges.finish_row(row, window, tiles, keys);
                *span = tiles
                    .iter()
                    .fold([i32::MAX, i32::MIN], |[low, high], tile| [low.min(tile.low[1]), high.max(tile.high[1])]);
            }
        });
        Ok(())
    }
}

/// Whether depth says nothing: all ranks are the same.
fn is_flat(level: Level, depth: &DepthMap) -> bool {
    if depth.uniform_value().is_some() {
        return true;
    }
    let mut landing = Landing::default();
    let mut ranks = |depth: &[f32]| {
        land(level, &[[f16::ZERO; 2]; TILE][..depth.len()], depth, [0; 2], 0, [0; 2], &mut landing);
        landing.keys.map(layer::rank)
    };
    let first = ranks(&depth.depth()[..1])[0];
    let mut is_like_first = |depth: &[f32]| ranks(depth)[..depth.len()].iter().all(|&rank| rank == first);
    // A few from all over first, which mostly settle it.
    let some = depth.depth().chunks(depth.depth().len().div_ceil(64));
    { some }.all(|some| is_like_first(&some[..1])) && depth.depth().chunks(TILE).all(is_like_first)
}

/// What the claims of a tile and, beside that, of those around it have in common.
///
/// The least of each component of the vectors, less the largest, the rank of what is nearest, less that of what is
/// farthest, and -1 for a rough tile: of several tiles the least of each number.
#[derive(Debug, Clone, Copy, Default)]
struct Ends([i32; 8]);

impl Ends {
    const NONE: Self = Self([i32::MAX; 8]);

    fn new(tile: &Tile, ranks: RankRange) -> Self {
        let Tile { low, high, .. } = tile;
        let is_rough = tile.kind == Kind::Rough;
        Self([low[0], low[1], -high[0], -high[1], ranks.near.into(), -i32::from(ranks.far), -i32::from(is_rough), 0])
    }

    #[inline(always)]
    fn and(self, other: &Self) -> Self {
        let mut both = self.0;
        for (end, other) in both.iter_mut().zip(other.0) {
            *end = other.min(*end);
        }
        Self(both)
    }

    /// Whether all of it moves alike.
    fn is_alike(&self) -> bool {
        (0..2).all(|c| -self.0[c + 2] - self.0[c] <= ALIKE)
    }

    fn is_rough(&self) -> bool {
        self.0[6] != 0
    }

    fn near(&self) -> i32 {
        self.0[4]
    }

    fn far(&self) -> i32 {
        -self.0[5]
    }
}

/// The guidance as it is given.
struct Given<'a> {
    level: Level,
    guidance: &'a Guidance,
    limit: [i32; 2],
    grid: Grid,
    standing: Standing<'a>,
}

impl Given<'_> {
    /// Sorts the tiles of a row, if there is one.
    fn sort_row(&self, row: usize, window: &mut [Line; 3]) {
        let Line { vectors, ranks, ends, tiles, keys } = &mut window[row % 3];
        if row >= self.grid.rows {
            return;
        }
        self.find_ranges(row, vectors, ranks);
        for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            ends[column] = self.sort(column, row, vectors[column], ranks[column], tile, keys);
        }
    }

    /// The ranges of vectors and ranks of a row of tiles.
    fn find_ranges(&self, row: usize, vectors: &mut [VectorRange], ranks: &mut [RankRange]) {
        let Self { level, limit, .. } = *self;
        let width = self.grid.width;
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
        if let Some(even) = depth.uniform_value() {
            let mut landing = Landing::default();
            land(level, &[[f16::ZERO; 2]], &[even], [0; 2], 0, limit, &mut landing);
            let rank = layer::rank(landing.keys[0]);
            ranks.fill(RankRange { near: rank, far: rank });
            return;
        }
        let (given, tile) = (depth.depth(), depth.tile() as usize);
        if tile == 1 {
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

    /// Sorts a tile, and finds the keys of its pixels where it is rough.
    #[inline(never)]
    fn sort(
        &self,
        column: usize,
        row: usize,
        VectorRange { low, high }: VectorRange,
        ranks: RankRange,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) -> Ends {
        let [across, down] = self.grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        let standing = self.standing.count(corner, [across, down]);
        if standing == across * down {
            *tile = Tile { key: key(0, 0, [0; 2]), ..Tile::default() };
            return Ends::new(tile, RankRange { near: 0, far: 0 });
        }
        if standing == 0 && (0..2).all(|c| high[c] - low[c] <= SMOOTH) {
            let middle = std::array::from_fn(|c| (low[c] + high[c]) >> 1);
            *tile = Tile { key: key(ranks.near, 0, middle), low: middle, high: middle, ..Tile::default() };
            return Ends::new(tile, RankRange { far: ranks.near, ..ranks });
        }
        let (vectors, depths) = (self.guidance.motion(), self.guidance.depth());
        let first = corner[1] * self.grid.width + corner[0];
        let even = depths.uniform_value().map(|even| [even; TILE]);
        if [across, down] == [TILE, TILE] && vectors.tile() == 1 && (depths.tile() == 1 || even.is_some()) {
            let (depth, stride) = match &even {
                Some(even) => (even.as_slice(), 0),
                None => (&depths.depth()[first..], self.grid.width),
            };
            claim_tile(self.level, &vectors.vectors()[first..], depth, [self.grid.width, stride], self.limit, keys);
        } else {
            keys.fill(EMPTY);
            let mut landing = Landing::default();
            let mut motion = [[f16::ZERO; 2]; TILE];
            let mut depth = [0.0; TILE];
            for j in 0..down {
                self.read(corner[0], corner[1] + j, &mut motion[..across], &mut depth[..across]);
                land(self.level, &motion[..across], &depth[..across], [0, 0], 0, self.limit, &mut landing);
                keys[j * TILE..][..across].copy_from_slice(&landing.keys[..across]);
            }
        }
        if standing > 0 {
            for place in (0..BLOCK).filter(|place| place % TILE < across && place / TILE < down) {
                if self.standing.is_at([corner[0] + place % TILE, corner[1] + place / TILE]) {
                    keys[place] = key(0, 0, [0; 2]);
                }
            }
        }
        let zero = if standing > 0 { [0; 2] } else { low };
        *tile = Tile {
            kind: Kind::Rough,
            key: EMPTY,
            holes: 0,
            low: [low[0].min(zero[0]), low[1].min(zero[1])],
            high: if standing > 0 { high.map(|v| v.max(0)) } else { high },
        };
        Ends::new(tile, if standing > 0 { RankRange { near: 0, ..ranks } } else { ranks })
    }

    /// The guidance of a run of pixels within a tile.
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

/// What happens where surfaces meet.
struct Edges<'a, P> {
    level: Level,
    grid: Grid,
    anchors: Option<(Source<'a, P>, Source<'a, P>)>,
    /// Whether depth says nothing.
    is_ranked: bool,
    /// Whether motion and depth are good enough to draw surfaces out over their rims.
    can_draw_out: bool,
}

impl<P: Colour> Edges<'_, P> {
    /// Asks for the pixels that a tile will be judged by.
    #[inline(always)]
    fn fetch(&self, column: usize, row: usize, Ends(ends): &Ends) {
        if let Some((previous, current)) = self.anchors {
            let at = [64 * (column * TILE) as i32, 64 * (row * TILE) as i32];
            current.fetch_tile(at, 0);
            previous.fetch_tile([at[0] + ends[0], at[1] + ends[1]], 0);
        }
    }

    /// The rows around a row that there are.
    #[inline(always)]
    fn lines<'b>(&self, row: usize, window: &'b [Line; 3]) -> impl Iterator<Item = &'b Line> + use<'b, P> {
        (row.saturating_sub(1)..(row + 2).min(self.grid.rows)).map(|row| &window[row % 3])
    }

    /// What the tiles of a column around a row have in common.
    #[inline(always)]
    fn column(&self, column: usize, row: usize, window: &[Line; 3]) -> Ends {
        let ends = self.lines(row, window).filter_map(|line| line.ends.get(column));
        ends.fold(Ends::NONE, |all, ends| all.and(ends))
    }

    /// Takes a row over from what is given, and settles what lies where surfaces meet.
    fn finish_row(&self, row: usize, window: &[Line; 3], tiles: &mut [Tile], keys: &mut [[Key; BLOCK]]) {
        let line = &window[row % 3];
        tiles.copy_from_slice(&line.tiles);
        let (mut before, mut here) = (Ends::NONE, self.column(0, row, window));
        let is_judged = self.is_ranked || self.can_draw_out;
        for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            if tile.kind == Kind::Rough {
                *keys = line.keys[column];
            }
            if !is_judged {
                continue;
            }
            let next = self.column(column + 1, row, window);
            let all = before.and(&here).and(&next);
            (before, here) = (here, next);
            if let Some(ends) = line.ends.get(column + AHEAD).filter(|ends| ends.is_rough()) {
                self.fetch(column + AHEAD, row, ends);
            }
            if self.is_ranked {
                self.rank(column, row, window, &all, tile, keys);
            } else if all.near() + i32::from(SAME_RANK) < line.ends[column].far() && !all.is_alike() {
                // Else nothing around can be in front and move otherwise.
                self.draw_out(column, row, window, tile, keys);
            }
        }
    }

    /// Where depth says nothing, and surfaces meet, marks each pixel of a tile with how badly it matches.
    #[inline(never)]
    fn rank(
        &self,
        column: usize,
        row: usize,
        window: &[Line; 3],
        all: &Ends,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) {
        let own = &window[row % 3].ends[column];
        let is_edge = tile.kind == Kind::Rough
            || self.anchors.is_some()
                && (all.is_rough()
                    || !all.is_alike()
                        && self.lines(row, window).any(|line| {
                            let around = &line.ends[column.saturating_sub(1)..(column + 2).min(self.grid.columns)];
                            around.iter().any(|other| !own.and(other).is_alike())
                        }));
        if !is_edge {
            tile.key = layer::marked(tile.key, UNKNOWN_MATCH);
            return;
        }
        let Some((previous, current)) = self.anchors else { return };
        if tile.kind == Kind::Smooth {
            let [across, down] = self.grid.extent(column, row);
            keys.fill(EMPTY);
            (0..down).for_each(|j| keys[j * TILE..][..across].fill(tile.key));
            (tile.kind, tile.key) = (Kind::Rough, EMPTY);
        }
        mark_matches(self.level, previous, current, [column * TILE, row * TILE], keys);
    }

    /// Colours on the rim of a surface are mixed with what is behind it, so that the rim moves with the surface in front: a
    /// pixel takes the key of the nearest around it, where that fits better than its own.
    #[inline(never)]
    fn draw_out(&self, column: usize, row: usize, window: &[Line; 3], tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let around = self.around(column, row, window);
        let mut nearest = [EMPTY; BLOCK];
        let mut nearer = claims::nearest_around(self.level, &around, ALIKE, &mut nearest);
        if nearer == 0 {
            return;
        }
        if tile.kind == Kind::Smooth {
            for (keys, line) in keys.chunks_mut(TILE).zip(&around[1..]) {
                keys.copy_from_slice(&line[1..=TILE]);
            }
        }
        if let Some((previous, current)) = self.anchors {
            nearer = fitting(self.level, previous, current, [column * TILE, row * TILE], nearer, &nearest, keys);
        }
        if nearer != 0 {
            (tile.kind, tile.key) = (Kind::Rough, EMPTY);
        }
        while nearer != 0 {
            let place = nearer.trailing_zeros() as usize;
            nearer &= nearer - 1;
            keys[place] = nearest[place];
            let vector = layer::vector(nearest[place]);
            tile.low = [0, 1].map(|c| tile.low[c].min(vector[c]));
            tile.high = [0, 1].map(|c| tile.high[c].max(vector[c]));
        }
    }

    /// The claims of a tile's pixels with one more on each side, [`EMPTY`] beyond the edges.
    #[inline(always)]
    fn around(&self, column: usize, row: usize, window: &[Line; 3]) -> Around {
        let Grid { width, height, .. } = self.grid;
        let (left, right) = (column * TILE, (column + 1) * TILE);
        let fill = |row: usize, j: usize, to: &mut [Key; TILE + 2]| {
            let line = &window[row % 3];
            let claim = |column: usize, i: usize| match line.tiles[column].kind {
                Kind::Smooth => line.tiles[column].key,
                Kind::Rough => line.keys[column][j * TILE + i],
            };
            match line.tiles[column].kind {
                Kind::Smooth => to[1..=TILE.min(width - left)].fill(line.tiles[column].key),
                Kind::Rough => to[1..=TILE].copy_from_slice(&line.keys[column][j * TILE..][..TILE]),
            }
            if column > 0 {
                to[0] = claim(column - 1, TILE - 1);
            }
            if right < width {
                to[TILE + 1] = claim(column + 1, 0);
            }
        };
        let mut around = [[EMPTY; TILE + 2]; TILE + 2];
        if row > 0 {
            fill(row - 1, TILE - 1, &mut around[0]);
        }
        for j in 0..TILE.min(height - row * TILE) {
            fill(row, j, &mut around[j + 1]);
        }
        if (row + 1) * TILE < height {
            fill(row + 1, 0, &mut around[TILE + 1]);
        }
        around
    }
}
