//! The motion of the current anchor as it is given, made ready: sanitised, sorted into smooth and rough tiles, surfaces
//! drawn out over their rims.

use half::f16;
use rayon::prelude::*;

use super::colour::Colour;
use super::kernels::claims;
use super::kernels::{
    BLOCK, Landing, Level, RankRange, Source, TILE, VectorRange, at_every_level, depth_ranges, land, motion_ranges,
};
use super::layer::{self, ALIKE, EMPTY, Grid, Key, Kind, LONGEST, Layer, Tile, WORST_MATCH, key};
use super::sized;
use super::standing::Standing;
use crate::Result;
use crate::guidance::Guidance;

/// A tile whose vectors differ by no more than this, in 1/64 px, is smooth: three quarters of a pixel.
pub(super) const SMOOTH: i32 = 48;
/// Levels within which a pixel on the rim of a surface is that surface's.
pub(super) const RIM: f32 = 28.0;
/// Tiles ahead of the one that is looked at whose keys and pixels are asked for.
const AHEAD: usize = 2;
/// The match of a smooth tile whose pixels are not looked at: neither good nor bad.
pub(super) const UNKNOWN_MATCH: u8 = 24;

/// Makes the field of a guidance; keeps its working memory.
#[derive(Debug, Default)]
pub(super) struct Preparation {
    vectors: Vec<VectorRange>,
    ranks: Vec<RankRange>,
    given: Layer,
}

impl Preparation {
    /// Fills `field` with the motion of `guidance`, and of what stands still in front of it. With a pair of anchors, where
    /// depth says nothing, pixels are ranked by how well the previous anchor matches.
    pub(super) fn prepare<P: Colour>(
        &mut self,
        level: Level,
        guidance: &Guidance,
        anchors: Option<(Source<'_, P>, Source<'_, P>)>,
        standing: Standing<'_>,
        field: &mut Layer,
    ) -> Result<()> {
        let grid = Grid::new(guidance.size());
        let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(LONGEST));
        self.given.reserve(grid)?;
        field.reserve(grid)?;
        self.find_ranges(level, guidance, limit)?;
        let is_flat = self.ranks.iter().all(|r| *r == self.ranks[0]) && self.ranks[0].near == self.ranks[0].far;
        let given = Given { level, guidance, limit, grid, standing };

        let columns = grid.columns;
        let (vectors, ranks) = (&self.vectors, &self.ranks);
        let rows = self.given.tiles.par_chunks_mut(columns).zip(self.given.keys.par_chunks_mut(columns));
        rows.enumerate().for_each(|(row, (tiles, keys))| {
            for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
                let index = row * columns + column;
                given.sort(column, row, vectors[index], ranks[index], tile, keys);
            }
        });

        let edges = Edges {
            level,
            given: &self.given,
            anchors,
            is_flat,
            can_dilate: !is_flat && guidance.motion().tile() == 1,
        };
        let rows = field.tiles.par_chunks_mut(columns).zip(field.keys.par_chunks_mut(columns));
        rows.zip(&mut field.spans).enumerate().for_each(|(row, ((tiles, keys), span))| {
            *span = [i32::MAX, i32::MIN];
            for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
                if column + AHEAD < columns {
                    edges.fetch(column + AHEAD, row);
                }
                edges.finish(column, row, tile, keys);
                *span = [span[0].min(tile.low[1]), span[1].max(tile.high[1])];
            }
        });
        Ok(())
    }

    /// The ranges of vectors and ranks of every tile.
    fn find_ranges(&mut self, level: Level, guidance: &Guidance, limit: [i32; 2]) -> Result<()> {
        let grid = self.given.grid;
        let (width, columns) = (grid.width, grid.columns);
        sized(&mut self.vectors, grid.tiles(), VectorRange::default())?;
        sized(&mut self.ranks, grid.tiles(), RankRange::default())?;

        let motion = guidance.motion();
        let (given, tile) = (motion.vectors(), motion.tile() as usize);
        self.vectors.par_chunks_mut(columns).enumerate().for_each(|(row, ranges)| {
            if tile == 1 {
                let rows = row * TILE * width..((row + 1) * TILE * width).min(given.len());
                motion_ranges(level, &given[rows], width, limit, ranges);
            } else {
                let of_row = &given[row * TILE / tile * motion.columns() as usize..];
                let mut landing = Landing::default();
                for (ranges, vectors) in ranges.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                    land(level, vectors, &[0.0; TILE][..vectors.len()], [0; 2], 0, limit, &mut landing);
                    for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&landing.keys) {
                        let vector = layer::vector(key);
                        ranges.fill(VectorRange { low: vector, high: vector });
                    }
                }
            }
        });

        let depth = guidance.depth();
        if let Some(even) = depth.even() {
            let mut landing = Landing::default();
            land(level, &[[f16::ZERO; 2]], &[even], [0; 2], 0, limit, &mut landing);
            let rank = layer::rank(landing.keys[0]);
            self.ranks.fill(RankRange { near: rank, far: rank });
            return Ok(());
        }
        let (given, tile) = (depth.depth(), depth.tile() as usize);
        self.ranks.par_chunks_mut(columns).enumerate().for_each(|(row, ranges)| {
            if tile == 1 {
                let rows = row * TILE * width..((row + 1) * TILE * width).min(given.len());
                depth_ranges(level, &given[rows], width, ranges);
            } else {
                let of_row = &given[row * TILE / tile * depth.columns() as usize..];
                let (still, mut landing) = ([[f16::ZERO; 2]; TILE], Landing::default());
                for (ranges, depth) in ranges.chunks_mut(tile).zip(of_row.chunks(TILE)) {
                    land(level, &still[..depth.len()], depth, [0; 2], 0, limit, &mut landing);
                    for (ranges, &key) in ranges.chunks_mut(tile / TILE).zip(&landing.keys) {
                        ranges.fill(RankRange { near: layer::rank(key), far: layer::rank(key) });
                    }
                }
            }
        });
        Ok(())
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
    ) {
        let [across, down] = self.grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        let standing = self.standing.count(corner, [across, down]);
        if standing == across * down {
            *tile = Tile { key: key(0, 0, [0; 2]), ..Tile::default() };
            return;
        }
        if standing == 0 && (0..2).all(|c| high[c] - low[c] <= SMOOTH) {
            let middle = std::array::from_fn(|c| (low[c] + high[c]) >> 1);
            *tile = Tile { key: key(ranks.near, 0, middle), low: middle, high: middle, ..Tile::default() };
            return;
        }
        if [across, down] != [TILE, TILE] {
            keys.fill(EMPTY);
        }
        let mut landing = Landing::default();
        let mut motion = [[f16::ZERO; 2]; TILE];
        let mut depth = [0.0; TILE];
        let (vectors, depths) = (self.guidance.motion(), self.guidance.depth());
        let is_by_pixel = vectors.tile() == 1 && depths.tile() == 1;
        for j in 0..down {
            let y = corner[1] + j;
            if is_by_pixel {
                let run = y * self.grid.width + corner[0]..y * self.grid.width + corner[0] + across;
                let (motion, depth) = (&vectors.vectors()[run.clone()], &depths.depth()[run]);
                land(self.level, motion, depth, [0, 0], 0, self.limit, &mut landing);
            } else {
                self.read(corner[0], y, &mut motion[..across], &mut depth[..across]);
                land(self.level, &motion[..across], &depth[..across], [0, 0], 0, self.limit, &mut landing);
            }
            keys[j * TILE..][..across].copy_from_slice(&landing.keys[..across]);
            if standing > 0 {
                for i in (0..across).filter(|&i| self.standing.is_at([corner[0] + i, y])) {
                    keys[j * TILE + i] = key(0, 0, [0; 2]);
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
    given: &'a Layer,
    anchors: Option<(Source<'a, P>, Source<'a, P>)>,
    /// Whether depth says nothing.
    is_flat: bool,
    /// Whether depth is good enough to draw surfaces out over their rims.
    can_dilate: bool,
}

impl<P: Colour> Edges<'_, P> {
    /// Asks for what a rough tile will be judged by.
    #[inline(always)]
    fn fetch(&self, column: usize, row: usize) {
        let index = row * self.given.grid.columns + column;
        let tile = &self.given.tiles[index];
        if tile.kind == Kind::Rough {
            Layer::fetch_keys(&self.given.keys[index]);
            if let Some((previous, current)) = self.anchors.filter(|_| self.is_flat) {
                let at = [64 * (column * TILE) as i32, 64 * (row * TILE) as i32];
                current.fetch_tile(at, 0);
                previous.fetch_tile([at[0] + tile.low[0], at[1] + tile.low[1]], 0);
            }
        }
    }

    /// Takes a tile over from what is given. Colours on the rim of a surface are mixed with what is behind it, so that
    /// the rim moves with the surface in front: a pixel takes the key of the nearest around it.
    #[inline(never)]
    fn finish(&self, column: usize, row: usize, tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let grid = self.given.grid;
        let index = row * grid.columns + column;
        let given = self.given.tiles[index];
        *tile = given;
        let is_apart = |other: &Tile| {
            other.kind == Kind::Rough
                || (0..2).any(|c| other.high[c].max(given.high[c]) - other.low[c].min(given.low[c]) > 64)
        };
        let columns = column.saturating_sub(1)..(column + 2).min(grid.columns);
        let mut rows = row.saturating_sub(1)..(row + 2).min(grid.rows);
        let is_edge = given.kind == Kind::Rough
            || (self.can_dilate || self.is_flat && self.anchors.is_some())
                && rows.any(|r| self.given.row(r..r + 1)[columns.clone()].iter().any(is_apart));
        if !is_edge {
            if self.is_flat {
                tile.key = layer::marked(given.key, UNKNOWN_MATCH);
            }
            return;
        }
        let is_rough = given.kind == Kind::Rough;
        let start = |keys: &mut [Key; BLOCK]| match given.kind {
            Kind::Rough => keys.copy_from_slice(&self.given.keys[index]),
            Kind::Smooth => {
                let [across, down] = grid.extent(column, row);
                keys.fill(EMPTY);
                (0..down).for_each(|j| keys[j * TILE..][..across].fill(given.key));
            }
        };
        match self.anchors {
            Some((previous, current)) if self.is_flat => {
                start(keys);
                self.find_matches(column, row, previous, current, keys);
            }
            _ => {
                let mut nearest = [EMPTY; BLOCK];
                let nearer = if self.can_dilate {
                    claims::nearest_around(self.level, &self.given.around(column, row, false), ALIKE, &mut nearest)
                } else {
                    0
                };
                if nearer == 0 && !is_rough {
                    return;
                }
                start(keys);
                if !self.dilate([column * TILE, row * TILE], nearer, &nearest, keys) && !is_rough {
                    return;
                }
            }
        }
        let [low, high] = claims::span(self.level, keys);
        *tile = Tile { kind: Kind::Rough, holes: 0, key: EMPTY, low, high };
    }

    /// Gives each pixel of a tile at `corner` that something is nearer to (`nearer`, bit `8 j + i`) the key of that, where
    /// it fits better than its own. Says whether any does.
    #[inline(never)]
    fn dilate(&self, corner: [usize; 2], mut nearer: u64, nearest: &[Key; BLOCK], keys: &mut [Key; BLOCK]) -> bool {
        let mut has_changed = false;
        while nearer != 0 {
            let place = nearer.trailing_zeros() as usize;
            nearer &= nearer - 1;
            let (own, nearest) = (&mut keys[place], nearest[place]);
            let at = [corner[0] + place % TILE, corner[1] + place / TILE];
            let is_of_nearest = self.anchors.is_none_or(|(previous, current)| {
                let of_nearest = distance(previous, current, at, nearest);
                of_nearest <= RIM && of_nearest < distance(previous, current, at, *own)
            });
            if is_of_nearest {
                *own = nearest;
                has_changed = true;
            }
        }
        has_changed
    }

    /// Marks each pixel with how badly it matches.
    #[inline(never)]
    fn find_matches(
        &self,
        column: usize,
        row: usize,
        previous: Source<'_, P>,
        current: Source<'_, P>,
        keys: &mut [Key; BLOCK],
    ) {
        mark_matches(self.level, previous, current, [column * TILE, row * TILE], keys);
    }
}

at_every_level! {
    /// Marks the claims of the pixels of a tile at `corner` with how badly they match, see [`match_of`].
    fn mark_matches<P: Colour>(
        previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2], keys: &mut [Key; BLOCK],
    ) = mark_one_by_one | mark_side_by_side
}

fn mark_one_by_one<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    keys: &mut [Key; BLOCK],
) {
    for (place, key) in keys.iter_mut().enumerate().filter(|(_, key)| **key != EMPTY) {
        *key = layer::marked(*key, match_of(previous, current, [x + place % TILE, y + place / TILE], *key));
    }
}

#[inline(always)]
fn mark_side_by_side<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    keys: &mut [Key; BLOCK],
) {
    for (j, keys) in keys.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let here = current.pixels.get((y + j) * current.width + x..).and_then(|row| row.first_chunk::<TILE>());
        let run = rows_of_run(previous, [x, y + j], keys);
        let squares = if run.is_none() { squares_of(previous, [x, y + j], keys) } else { None };
        let (mut low, mut high) = ([0.0; TILE], [0.0; TILE]);
        match (here, run, &squares) {
            (Some(_), Some([above, below]), _) => {
                let (above, below) = (P::lumas_of(above), P::lumas_of(below));
                for i in 0..TILE {
                    low[i] = above[i].min(above[i + 1]).min(below[i].min(below[i + 1]));
                    high[i] = above[i].max(above[i + 1]).max(below[i].max(below[i + 1]));
                }
            }
            (Some(_), None, Some([a, b, c, d])) => {
                let (a, b, c, d) = (P::lumas_of(a), P::lumas_of(b), P::lumas_of(c), P::lumas_of(d));
                for i in 0..TILE {
                    low[i] = a[i].min(b[i]).min(c[i].min(d[i]));
                    high[i] = a[i].max(b[i]).max(c[i].max(d[i]));
                }
            }
            _ => {
                for (i, key) in keys.iter_mut().enumerate().filter(|(_, key)| **key != EMPTY) {
                    *key = layer::marked(*key, match_of(previous, current, [x + i, y + j], *key));
                }
                continue;
            }
        }
        let Some(here) = here.map(P::lumas_of) else { continue };
        for i in 0..TILE {
            let apart = (low[i] - here[i]).max(here[i] - high[i]).max(0.0);
            keys[i] = layer::marked(keys[i], (apart as u8).min(WORST_MATCH));
        }
    }
}

/// The two rows of the previous anchor between which a row of a tile comes from, if its pixels lie side by side there.
#[inline(always)]
fn rows_of_run<'a, P: Colour>(
    previous: Source<'a, P>,
    [x, y]: [usize; 2],
    keys: &[Key; TILE],
) -> Option<[&'a [P; 2 * TILE]; 2]> {
    let whole = |key: Key| layer::vector(key).map(|v| v >> 6);
    let [left, top] = whole(keys[0]);
    let mut is_run = true;
    for &key in keys {
        let [u, v] = whole(key);
        is_run &= (key != EMPTY) & (u == left) & (v == top);
    }
    // What is negative is far beyond.
    let (u, v) = ((x as i32 + left) as u32 as usize, (y as i32 + top) as u32 as usize);
    if !is_run || u.saturating_add(TILE) >= previous.width || v.saturating_add(1) >= previous.height {
        return None;
    }
    let start = v * previous.width + u;
    let row = |start: usize| previous.pixels.get(start..)?.first_chunk();
    Some([row(start)?, row(start + previous.width)?])
}

/// The four pixels of the previous anchor around where each of eight beside each other comes from, if all have claims and
/// come from inside.
#[inline(always)]
fn squares_of<P: Colour>(previous: Source<'_, P>, [x, y]: [usize; 2], keys: &[Key; TILE]) -> Option<[[P; TILE]; 4]> {
    let mut squares = [[P::OPAQUE_BLACK; TILE]; 4];
    for (i, &key) in keys.iter().enumerate() {
        let [vx, vy] = layer::vector(key);
        // What is negative is far beyond.
        let (u, v) = ((x + i) as i32 + (vx >> 6), y as i32 + (vy >> 6));
        let (u, v) = (u as u32 as usize, v as u32 as usize);
        if key == EMPTY || u + 1 >= previous.width || v + 1 >= previous.height {
            return None;
        }
        let start = v * previous.width + u;
        let above = previous.pixels.get(start..start + 2)?;
        let below = previous.pixels.get(start + previous.width..start + previous.width + 2)?;
        (squares[0][i], squares[1][i], squares[2][i], squares[3][i]) = (above[0], above[1], below[0], below[1]);
    }
    Some(squares)
}

/// The levels by which the luma of a pixel of the current anchor lies outside those of the four pixels of the previous
/// one around the place that a claim leads to.
pub(super) fn match_of<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    claim: Key,
) -> u8 {
    let (width, height) = (previous.width, previous.height);
    let [vx, vy] = layer::vector(claim);
    let (left, top) = ((64 * x as i32 + vx) >> 6, (64 * y as i32 + vy) >> 6);
    let luma = current.pixels[y * width + x].luma();
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for v in [top, top + 1] {
        for u in [left, left + 1] {
            let u = u.clamp(0, width as i32 - 1) as usize;
            let v = v.clamp(0, height as i32 - 1) as usize;
            let there = previous.pixels[v * width + u].luma();
            (low, high) = (low.min(there), high.max(there));
        }
    }
    let apart = (low - luma).max(luma - high).max(0.0);
    (apart as u8).min(WORST_MATCH)
}

/// How far a pixel of the current anchor is from what is read bilinearly where a claim leads to in the previous one:
/// the levels of the channel that differs most.
pub(super) fn distance<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    claim: Key,
) -> f32 {
    let [vx, vy] = layer::vector(claim);
    let (u, v) = (64 * x as i32 + vx, 64 * y as i32 + vy);
    let (fx, fy) = ((u & 63) as f32 / 64.0, (v & 63) as f32 / 64.0);
    let at = |u: i32, v: i32| {
        let u = u.clamp(0, previous.width as i32 - 1) as usize;
        let v = v.clamp(0, previous.height as i32 - 1) as usize;
        previous.pixels[v * previous.width + u].in_levels()
    };
    let (left, top) = (u >> 6, v >> 6);
    let corners = [at(left, top), at(left + 1, top), at(left, top + 1), at(left + 1, top + 1)];
    let here = current.pixels[y * current.width + x].in_levels();
    // Plain loops over all channels: closures are at times left as functions of their own, one call to a channel.
    let mut apart = [0.0_f32; 4];
    for c in 0..4 {
        let above = corners[0][c] + (corners[1][c] - corners[0][c]) * fx;
        let below = corners[2][c] + (corners[3][c] - corners[2][c]) * fx;
        apart[c] = (above + (below - above) * fy - here[c]).abs();
    }
    apart[2].max(apart[1].max(apart[0].max(0.0)))
}
