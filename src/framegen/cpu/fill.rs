//! Claims for the places that nothing claims.
//!
//! Such a place continues a surface beside it. In the previous anchor it shows what the current one does not: something
//! that is now hidden, or has left the picture. Between the anchors it shows what neither does. The nearest claims to
//! the left, right, above and below are the candidates; where none is near, a pyramid over the tiles has one that
//! prefers the farther surface.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::colour::Colour;
use super::kernels::{self, BLOCK, Source, TILE, claims};
use super::layer::{self, EMPTY, Grid, HOLE, Key, Layer, alike, is_nearer, key, part};
use super::leaving::Leaving;
use super::past::Past;
use super::perspective::Way;
use super::sized;
use crate::Result;

/// Tiles ahead of the one that is filled whose keys and pixels are asked for.
const AHEAD: usize = 1;
/// Candidates are looked for up to this many pixels away.
pub(super) const NEAR: usize = 24;

/// Fills layers; keeps its pyramid.
#[derive(Debug, Default)]
pub(super) struct Filler {
    levels: Vec<Level>,
}

/// Keys of a grid half as wide and high as the one below: the farthest of what is there.
#[derive(Debug, Default)]
struct Level {
    columns: usize,
    rows: usize,
    keys: Vec<Key>,
}

/// What a candidate is judged by.
pub(super) struct Evidence<'a, P> {
    /// The current anchor's motion.
    pub(super) field: &'a Layer,
    /// From the current anchor to the layer.
    pub(super) way: Way,
    /// The anchor that shows what is looked for, where one does.
    pub(super) shown: Option<Source<'a, P>>,
    /// What the anchor that shows it tells of it, where that is known.
    pub(super) past: Option<&'a Past<'a>>,
    /// What leaves the picture, where that was looked for.
    pub(super) leaving: Option<&'a Leaving>,
    /// What borrowed claims are marked with.
    pub(super) mark: u8,
}

impl Filler {
    /// Lets every place of `layer` that nothing claims borrow a key; returns how many there are.
    pub(super) fn fill<P: Colour>(
        &mut self,
        level: kernels::Level,
        layer: &mut Layer,
        evidence: &Evidence<'_, P>,
    ) -> Result<usize> {
        let grid = layer.grid;
        self.reserve(grid)?;
        let holes = layer.tiles.iter().map(|tile| usize::from(tile.holes)).sum();
        if holes == 0 {
            return Ok(0);
        }
        let mut borrowed = std::mem::take(&mut layer.borrowed);
        let (filled, is_left) = (&*layer, AtomicBool::new(false));
        borrowed.par_chunks_mut(grid.columns).enumerate().for_each(|(row, tiles)| {
            for (column, keys) in tiles.iter_mut().enumerate() {
                let next = row * grid.columns + column + AHEAD;
                if column + AHEAD < grid.columns && filled.tiles[next].holes > 0 {
                    Layer::fetch_keys(&filled.keys[next]);
                    if let Some(shown) = evidence.shown {
                        shown.fetch_tile([64 * ((column + AHEAD) * TILE) as i32, 64 * (row * TILE) as i32], 0);
                    }
                }
                if filled.tiles[row * grid.columns + column].holes > 0
                    && !fill_tile(level, filled, evidence, column, row, keys)
                {
                    is_left.store(true, Ordering::Relaxed);
                }
            }
        });
        // Mostly there is a candidate for every place.
        if is_left.into_inner() {
            self.build(filled);
            let far = &self.levels[0].keys;
            borrowed.par_chunks_mut(grid.columns).enumerate().for_each(|(row, tiles)| {
                for (column, keys) in tiles.iter_mut().enumerate() {
                    let tile = row * grid.columns + column;
                    if filled.tiles[tile].holes > 0 {
                        borrow_far(&filled.keys[tile], far[tile], evidence.mark, grid.extent(column, row), keys);
                    }
                }
            });
        }
        layer.borrowed = borrowed;
        let columns = grid.columns;
        let tiles = layer.tiles.par_chunks_mut(columns).zip(layer.borrowed.par_chunks(columns));
        tiles.zip(&mut layer.spans).for_each(|((tiles, borrowed), span)| {
            *span = [i32::MAX, i32::MIN];
            for (tile, keys) in tiles.iter_mut().zip(borrowed) {
                let has_holes = tile.holes > 0;
                [tile.low, tile.high] =
                    if has_holes { claims::span(level, keys) } else { [[i32::MAX; 2], [i32::MIN; 2]] };
                *span = [span[0].min(tile.low[1]), span[1].max(tile.high[1])];
            }
        });
        Ok(holes)
    }

    /// Makes room for the pyramid of a grid.
    fn reserve(&mut self, grid: Grid) -> Result<()> {
        let mut size = [grid.columns, grid.rows];
        let count = 1 + size[0].max(size[1]).next_power_of_two().ilog2() as usize;
        super::reserve(&mut self.levels, count)?;
        self.levels.resize_with(count, Level::default);
        for level in &mut self.levels {
            [level.columns, level.rows] = size;
            sized(&mut level.keys, size[0] * size[1], EMPTY)?;
            size = size.map(|len| len.div_ceil(2));
        }
        Ok(())
    }

    /// Pulls the farthest key of each tile up a pyramid until one is left, and pushes keys back down where there are
    /// none.
    #[inline(never)]
    fn build(&mut self, layer: &Layer) {
        let levels = &mut self.levels;
        levels[0].keys.iter_mut().zip(&layer.tiles).for_each(|(key, tile)| *key = tile.key);
        for number in 1..levels.len() {
            let (below, above) = levels.split_at_mut(number);
            let (below, level) = (&below[number - 1], &mut above[0]);
            for (index, key) in level.keys.iter_mut().enumerate() {
                let (column, row) = (2 * (index % level.columns), 2 * (index / level.columns));
                let children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| below.at(column + i, row + j));
                *key = children.into_iter().filter(|&key| key != EMPTY).max().unwrap_or(EMPTY);
            }
        }
        for number in (1..levels.len()).rev() {
            let (below, above) = levels.split_at_mut(number);
            let (below, level) = (&mut below[number - 1], &above[0]);
            let columns = below.columns;
            for (index, key) in below.keys.iter_mut().enumerate().filter(|(_, key)| **key == EMPTY) {
                *key = level.at(index % columns / 2, index / columns / 2);
            }
        }
    }
}

impl Level {
    fn at(&self, column: usize, row: usize) -> Key {
        if column < self.columns && row < self.rows { self.keys[row * self.columns + column] } else { EMPTY }
    }
}

/// Fills the holes of a tile for which there is a candidate; whether that is all of them.
#[inline(never)]
fn fill_tile<P: Colour>(
    level: kernels::Level,
    layer: &Layer,
    evidence: &Evidence<'_, P>,
    column: usize,
    row: usize,
    keys: &mut [Key; BLOCK],
) -> bool {
    let grid = layer.grid;
    let tile = row * grid.columns + column;
    let own = &layer.keys[tile];
    let holes = claims::having(level, own, HOLE);
    let corner = [column * TILE, row * TILE];
    let best = [(u64::MAX, EMPTY); BLOCK];
    let mut sides = Sides { layer, evidence, own, holes, corner, lumas: [0.0; BLOCK], best };
    if holes != u64::MAX || !is_far_from_claims(layer, [column, row]) {
        sides.find_lumas(grid.extent(column, row));
        // From the left, the right, above and below.
        sides.look::<true, false>();
        sides.look::<true, true>();
        sides.look::<false, false>();
        sides.look::<false, true>();
    }
    for (key, (_, found)) in keys.iter_mut().zip(sides.best) {
        *key = if found == EMPTY { EMPTY } else { layer::marked(found, evidence.mark) };
    }
    if let Some(past) = evidence.past {
        let claims = past.claims(level, corner, grid.extent(column, row));
        for (place, key) in keys.iter_mut().enumerate().filter(|&(place, _)| own[place] == EMPTY) {
            let at = [column * TILE + place % TILE, row * TILE + place / TILE];
            if at[0] < grid.width && at[1] < grid.height {
                *key = past.claim_or(evidence.field, at, claims[place], *key);
            }
        }
    }
    if let Some(leaving) = evidence.leaving {
        for (place, key) in keys.iter_mut().enumerate().filter(|&(place, _)| own[place] == EMPTY) {
            let [x, y] = [column * TILE + place % TILE, row * TILE + place / TILE];
            if x < grid.width && y < grid.height {
                *key = leaving.claim(x, y).unwrap_or(*key);
            }
        }
    }
    let found = keys.iter().filter(|&&key| key != EMPTY).count();
    found == usize::from(layer.tiles[tile].holes)
}

/// Whether nothing claims a place as near as candidates are looked for, to the sides of a tile and above and below it.
#[inline(always)]
fn is_far_from_claims(layer: &Layer, [column, row]: [usize; 2]) -> bool {
    const TILES: usize = NEAR.div_ceil(TILE);
    let Grid { columns, rows, .. } = layer.grid;
    let is_bare = |column: usize, row: usize| usize::from(layer.tiles[row * columns + column].holes) == BLOCK;
    (column.saturating_sub(TILES)..(column + TILES + 1).min(columns)).all(|column| is_bare(column, row))
        && (row.saturating_sub(TILES)..(row + TILES + 1).min(rows)).all(|row| is_bare(column, row))
}

/// Fills the holes of a tile for which there was no candidate with a claim from farther away.
fn borrow_far(own: &[Key; BLOCK], far: Key, mark: u8, [across, down]: [usize; 2], keys: &mut [Key; BLOCK]) {
    let far = if far == EMPTY { key(u16::MAX, 0, [0; 2]) } else { far };
    let far = layer::marked(far, mark);
    let rows = own.as_chunks::<TILE>().0.iter().zip(keys.as_chunks_mut::<TILE>().0);
    for (own, keys) in rows.take(down) {
        for i in 0..across {
            keys[i] = if own[i] == EMPTY && keys[i] == EMPTY { far } else { keys[i] };
        }
    }
}

/// The candidates for the holes of a tile.
struct Sides<'a, 'e, P> {
    layer: &'a Layer,
    evidence: &'a Evidence<'e, P>,
    own: &'a [Key; BLOCK],
    /// Those that nothing claims: bit `8 j + i`.
    holes: u64,
    corner: [usize; 2],
    /// Where an anchor shows the tile, the lumas there.
    lumas: [f32; BLOCK],
    /// For each place the best so far, and what it costs.
    best: [(u64, Key); BLOCK],
}

/// A claim that may go on at places beside it.
#[derive(Clone, Copy)]
struct Candidate {
    key: Key,
    /// How far away it is.
    away: usize,
    /// The luma where it stands.
    luma: f32,
}

impl<P: Colour> Sides<'_, '_, P> {
    #[inline(always)]
    fn find_lumas(&mut self, [across, down]: [usize; 2]) {
        if let Some(shown) = self.evidence.shown {
            for (j, lumas) in self.lumas.as_chunks_mut::<TILE>().0.iter_mut().enumerate().take(down) {
                let row = &shown.pixels[(self.corner[1] + j) * shown.width + self.corner[0]..][..across];
                match row.first_chunk() {
                    Some(row) => *lumas = P::lumas_of(row),
                    None => lumas.iter_mut().zip(row).for_each(|(luma, pixel)| *luma = pixel.luma()),
                }
            }
        }
    }

    /// Goes through the lines of the tile that have holes: the last claim before each hole, seen from one side, is the
    /// nearest there.
    #[inline(always)]
    fn look<const ACROSS: bool, const BACK: bool>(&mut self) {
        let grid = self.layer.grid;
        let [across, down] = grid.extent(self.corner[0] / TILE, self.corner[1] / TILE);
        let (lines, len) = if ACROSS { (down, across) } else { (across, down) };
        for line in 0..lines {
            let inside = (1_u32 << len) - 1;
            let holes = u32::from(if ACROSS { row_of(self.holes, line) } else { column_of(self.holes, line) }) & inside;
            if holes == 0 {
                continue;
            }
            let claims = !holes & inside;
            let place = |along: usize| if ACROSS { line * TILE + along } else { along * TILE + line };
            let at = |along: usize| {
                let [x, y] = if ACROSS { [along, line] } else { [line, along] };
                [self.corner[0] + x, self.corner[1] + y]
            };
            // Holes up to the first claim from this side on are beside what is outside.
            let first = match (claims, BACK) {
                (0, _) => len,
                (_, false) => claims.trailing_zeros() as usize,
                (_, true) => len - (u32::BITS - claims.leading_zeros()) as usize,
            };
            let outside = if first == 0 {
                None
            } else {
                let run = (0..first).map(|step| place(if BACK { len - 1 - step } else { step }));
                let far = run.map(|place| self.farthest(place)).max();
                self.outside::<ACROSS, BACK>(at(if BACK { len - 1 } else { 0 }), far.unwrap_or(NEAR))
            };
            let mut left = holes;
            while left != 0 {
                let along = left.trailing_zeros() as usize;
                left &= left - 1;
                let before = if BACK { claims >> along } else { claims & ((1 << along) - 1) };
                let inside =
                    |from: usize, away| Candidate { key: self.own[place(from)], away, luma: self.lumas[place(from)] };
                let candidate = match (before, outside) {
                    (0, None) => continue,
                    (0, Some(outside)) => {
                        Candidate { away: outside.away + if BACK { len - 1 - along } else { along }, ..outside }
                    }
                    (_, _) if BACK => {
                        let away = before.trailing_zeros() as usize;
                        inside(along + away, away)
                    }
                    (_, _) => {
                        let from = (u32::BITS - 1 - before.leading_zeros()) as usize;
                        inside(from, along - from)
                    }
                };
                if candidate.away > NEAR {
                    continue;
                }
                let place = place(along);
                let luma = self.lumas[place];
                if let Some(cost) = self.evidence.cost_below(self.best[place], grid, at(along), luma, candidate) {
                    self.best[place] = (cost, candidate.key);
                }
            }
        }
    }

    /// How far away a candidate can be that is better than the best so far.
    #[inline(always)]
    fn farthest(&self, place: usize) -> usize {
        if self.evidence.shown.is_some() { NEAR.min((self.best[place].0 >> 16) as usize) } else { NEAR }
    }

    /// The nearest claim before a place, up to `far` away.
    #[inline(always)]
    fn outside<const ACROSS: bool, const BACK: bool>(&self, at: [usize; 2], far: usize) -> Option<Candidate> {
        let Grid { width, height, .. } = self.layer.grid;
        let (along, side) = if ACROSS { (at[0], width) } else { (at[1], height) };
        let room = if BACK { side - 1 - along } else { along };
        let (mut away, last) = (1, room.min(far));
        while away <= last {
            let [x, y] = moved::<ACROSS, BACK>(at, away);
            if usize::from(self.layer.tiles[self.layer.grid.place(x, y).0].holes) == BLOCK {
                // `at` is on the rim of a tile, so that all tiles are gone through from rim to rim.
                away += TILE;
                continue;
            }
            let key = self.layer.owner(x, y);
            if key != EMPTY {
                let luma = self.evidence.shown.map_or(0.0, |shown| shown.pixels[y * width + x].luma());
                return Some(Candidate { key, away, luma });
            }
            away += 1;
        }
        None
    }
}

/// The bits of a row of a tile.
#[inline(always)]
fn row_of(bits: u64, row: usize) -> u8 {
    (bits >> (TILE * row)) as u8
}

/// The bits of a column of a tile, the upper row's lowest.
#[inline(always)]
fn column_of(bits: u64, column: usize) -> u8 {
    // Each row's bit goes to a place of its own in the highest byte.
    ((bits >> column & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// The place `away` places before (x, y): to its left where one looks across from there, and so on.
#[inline(always)]
fn moved<const ACROSS: bool, const BACK: bool>([x, y]: [usize; 2], away: usize) -> [usize; 2] {
    match (ACROSS, BACK) {
        (true, false) => [x - away, y],
        (true, true) => [x + away, y],
        (false, false) => [x, y - away],
        (false, true) => [x, y + away],
    }
}

impl<P: Colour> Evidence<'_, P> {
    /// How bad a candidate is: whether the current anchor contradicts it first; then, for what an anchor shows, how
    /// unlike it is and how far away it was found, for what none does, how near its surface is.
    ///
    /// Only where that is less than `best`, and with no more looks than it takes to know.
    #[inline(always)]
    fn cost_below(
        &self,
        (best, found): (u64, Key),
        grid: Grid,
        at: [usize; 2],
        luma: f32,
        Candidate { key, away, luma: there }: Candidate,
    ) -> Option<u64> {
        let unlike = if self.shown.is_some() { (luma - there).abs().min(255.0) as u64 } else { 0 };
        let order = self.order(key, away, unlike);
        if order >= best {
            return None;
        }
        let is_contradicted = if key == found { best >> 40 != 0 } else { self.is_contradicted(grid, at, key) };
        let cost = u64::from(is_contradicted) << 40 | order;
        (cost < best).then_some(cost)
    }

    #[inline(always)]
    fn order(&self, key: Key, step: usize, unlike: u64) -> u64 {
        let (nearness, away) =
            (u64::from(u16::MAX - layer::rank(key)), (unlike + step as u64).min(u64::from(u16::MAX)));
        if self.shown.is_some() { away << 16 | nearness } else { nearness << 16 | away }
    }

    /// Whether a candidate for a place would have claimed it: it is neither hidden in the current anchor nor has it left
    /// that.
    #[inline(always)]
    fn is_contradicted(&self, grid: Grid, [x, y]: [usize; 2], key: Key) -> bool {
        let [vx, vy] = layer::vector(key);
        let at = [x as i32, y as i32];
        let reach = self.way.reach(key, at);
        let there = [64 * at[0] - part(vx, reach), 64 * at[1] - part(vy, reach)];
        grid.nearest(there).is_some_and(|[u, v]| {
            let shown = self.field.owner(u, v);
            alike(shown, key) || is_nearer(key, shown)
        })
    }
}
