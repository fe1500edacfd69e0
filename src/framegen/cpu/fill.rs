//! Claims for the places that nothing claims.
//!
//! Such a place continues a surface beside it. In the previous anchor it shows what the current one does not: something
//! that is now hidden, or has left the picture. Between the anchors it shows what neither does. The nearest claims to
//! the left, right, above and below are the candidates; where none is near, a pyramid over the tiles has one that
//! prefers the farther surface.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::colour::Colour;
use super::kernels::beside::{self, Beside, Beyond, Orders, SIDES};
use super::kernels::{self, BLOCK, Source, TILE, claims};
use super::layer::{self, EMPTY, Grid, Key, Layer, Tile, alike, is_nearer, key, part};
use super::leaving::Leaving;
use super::past::Past;
use super::perspective::Way;
use super::sized;
use crate::Result;
use crate::tasks::{Parallel, ParallelSlice, ParallelSliceMut};

/// Tiles ahead of the one that is filled whose keys and pixels are asked for.
const AHEAD: usize = 1;
/// The same where it is only looked what claims them.
const FAR_AHEAD: usize = 6;
/// Places ahead of the one for which a candidate is chosen.
const PLACES_AHEAD: usize = 6;
/// Candidates are looked for up to this many pixels away.
pub(super) const NEAR: usize = 24;
/// Tiles that are as near as that.
const TILES: usize = NEAR / TILE;
const _: () = assert!(NEAR == TILES * TILE && TILES == 3);

/// Fills layers; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Filler {
    /// For each tile the places that something claims: bit `8 j + i`.
    claims: Vec<u64>,
    /// For each tile with holes what became of it.
    filled: Vec<Filled>,
    levels: Vec<Level>,
}

/// A tile whose holes have been filled where there are candidates.
#[derive(Debug, Clone, Copy, Default)]
struct Filled {
    /// The places for which there were none.
    left: u64,
    /// The least and the largest of each component of what was borrowed.
    span: [[i32; 2]; 2],
}

/// A grid half as wide and high as the one below, with the farthest of what is there: one more than its key, or 0.
#[derive(Debug, Default)]
struct Level {
    columns: usize,
    farthest: Vec<Key>,
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
    /// Whether what is at rest by that may move with a surface as far away beside it.
    pub(super) carries: bool,
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
        let holes = self.find_claims(level, layer);
        if holes == 0 {
            return Ok(0);
        }
        let Self { claims, filled, levels } = self;
        let mut borrowed = std::mem::take(&mut layer.borrowed);
        let (filling, is_left) = (Filling { level, layer, claims, evidence }, AtomicBool::new(false));
        let rows = borrowed.par_chunks_mut(grid.columns).zip(filled.par_chunks_mut(grid.columns));
        rows.enumerate().for_each(|(row, (borrowed, filled))| {
            let mut work = Work { beside: Beside::NOTHING, orders: [[u32::MAX; BLOCK]; SIDES] };
            for (column, (keys, filled)) in borrowed.iter_mut().zip(filled).enumerate() {
                filling.fetch(column + AHEAD, row);
                if filling.layer.tiles[row * grid.columns + column].holes > 0 {
                    *filled = filling.fill_tile([column, row], &mut work, keys);
                    if filled.left != 0 {
                        is_left.store(true, Ordering::Relaxed);
                    }
                }
            }
        });
        // Mostly there is a candidate for every place.
        if is_left.into_inner() {
            build(levels, layer);
        }
        let rows = layer.tiles.par_chunks_mut(grid.columns).zip(borrowed.par_chunks_mut(grid.columns));
        let rows = rows.zip(filled.par_chunks(grid.columns)).zip(layer.spans.par_iter_mut());
        rows.enumerate().for_each(|(row, (((tiles, borrowed), filled), span))| {
            *span = [i32::MAX, i32::MIN];
            for (column, ((tile, keys), filled)) in tiles.iter_mut().zip(borrowed).zip(filled).enumerate() {
                [tile.low, tile.high] = match (tile.holes, filled.left) {
                    (0, _) => [[i32::MAX; 2], [i32::MIN; 2]],
                    (_, 0) => filled.span,
                    (_, left) => {
                        borrow_far(left, layer::marked(farthest(levels, tile, column, row), evidence.mark), keys);
                        claims::span(level, keys)
                    }
                };
                *span = [span[0].min(tile.low[1]), span[1].max(tile.high[1])];
            }
        });
        layer.borrowed = borrowed;
        Ok(holes)
    }

    /// Makes room for the pyramid of a grid.
    fn reserve(&mut self, grid: Grid) -> Result<()> {
        sized(&mut self.claims, grid.tiles(), 0)?;
        sized(&mut self.filled, grid.tiles(), Filled::default())?;
        let mut size = [grid.columns, grid.rows];
        let count = size[0].max(size[1]).next_power_of_two().ilog2() as usize;
        super::reserve(&mut self.levels, count)?;
        self.levels.resize_with(count, Level::default);
        for level in &mut self.levels {
            size = size.map(|len| len.div_ceil(2));
            level.columns = size[0];
            sized(&mut level.farthest, size[0] * size[1], 0)?;
        }
        Ok(())
    }

    /// Looks which places something claims, and returns how many nothing does.
    fn find_claims(&mut self, level: kernels::Level, layer: &Layer) -> usize {
        let grid = layer.grid;
        let is_part = |tile: &Tile| tile.holes > 0 && usize::from(tile.holes) < BLOCK;
        let rows = layer.tiles.par_chunks(grid.columns).zip(layer.keys.par_chunks(grid.columns));
        let rows = rows.zip(self.claims.par_chunks_mut(grid.columns)).enumerate();
        let all_holes = AtomicUsize::new(0);
        rows.for_each(|(row, ((tiles, keys), claims))| {
            let mut holes = 0;
            for (column, (tile, claims)) in tiles.iter().zip(claims).enumerate() {
                if tiles.get(column + FAR_AHEAD).is_some_and(is_part) {
                    Layer::fetch_keys(&keys[column + FAR_AHEAD]);
                }
                let inside = inside(grid.extent(column, row));
                holes += usize::from(tile.holes);
                *claims = match usize::from(tile.holes) {
                    0 => inside,
                    BLOCK => 0,
                    _ => inside & beside::claimed(level, &keys[column]),
                };
            }
            all_holes.fetch_add(holes, Ordering::Relaxed);
        });
        all_holes.into_inner()
    }
}

/// Pulls the farthest key of each tile up a pyramid until one is left.
#[inline(never)]
fn build(levels: &mut [Level], layer: &Layer) {
    let pull = |rows: [&[Key]; 2], farthest: &mut [Key]| {
        for (column, farthest) in farthest.iter_mut().enumerate() {
            let beside = rows.iter().flat_map(|row| row.iter().skip(2 * column).take(2));
            *farthest = beside.copied().fold(0, Key::max);
        }
    };
    let Some((first, _)) = levels.split_first_mut() else { return };
    let columns = layer.grid.columns;
    first.farthest.par_chunks_mut(first.columns).zip(layer.tiles.par_chunks(2 * columns)).for_each(
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

/// The farthest claim of the least square of tiles around a tile that holds any.
fn farthest(levels: &[Level], tile: &Tile, column: usize, row: usize) -> Key {
    if tile.key != EMPTY {
        return tile.key;
    }
    let around = levels.iter().zip(1..);
    let found = around.map(|(level, power)| level.farthest[(row >> power) * level.columns + (column >> power)]);
    found.into_iter().find(|&farthest| farthest != 0).map_or(key(u16::MAX, 0, [0; 2]), |farthest| farthest - 1)
}

/// Lets the places `left` of a tile borrow a claim from farther away.
fn borrow_far(left: u64, far: Key, keys: &mut [Key; BLOCK]) {
    if left == u64::MAX {
        keys.fill(far);
    } else {
        each(left, |place| keys[place] = far);
    }
}

/// The places of a tile that are on the picture: bit `8 j + i`.
#[inline(always)]
fn inside([across, down]: [usize; 2]) -> u64 {
    let row = 0xff_u64 >> (TILE - across);
    (row * 0x0101_0101_0101_0101) & u64::MAX >> (TILE * (TILE - down))
}

#[inline(always)]
fn each(mut places: u64, mut act: impl FnMut(usize)) {
    while places != 0 {
        act(places.trailing_zeros() as usize);
        places &= places - 1;
    }
}

/// What is found out about a tile, left over from one before where this has no holes.
struct Work {
    beside: Beside,
    orders: Orders,
}

/// A layer whose holes are being filled.
struct Filling<'a, 'e, P> {
    level: kernels::Level,
    layer: &'a Layer,
    claims: &'a [u64],
    evidence: &'a Evidence<'e, P>,
}

impl<P: Colour> Filling<'_, '_, P> {
    /// Asks for what will be needed of a tile.
    #[inline(always)]
    fn fetch(&self, column: usize, row: usize) {
        let grid = self.layer.grid;
        let tile = row * grid.columns + column;
        // Of what nothing claims it is known.
        if column < grid.columns && self.layer.tiles[tile].holes > 0 && self.claims[tile] != 0 {
            Layer::fetch_keys(&self.layer.keys[tile]);
            if let Some(shown) = self.evidence.shown {
                shown.fetch_tile([column, row].map(|at| 64 * (at * TILE) as i32), 0);
            }
        }
    }

    /// Fills the holes of a tile for which there is a candidate.
    #[inline(never)]
    fn fill_tile(&self, [column, row]: [usize; 2], work: &mut Work, keys: &mut [Key; BLOCK]) -> Filled {
        let Self { level, layer, claims, evidence } = *self;
        let grid = layer.grid;
        let tile = row * grid.columns + column;
        let (corner, extent) = ([column * TILE, row * TILE], grid.extent(column, row));
        let (claims, holes) = (claims[tile], inside(extent) & !claims[tile]);

        // What is at rest needs no candidates, but where it may be carried along with one.
        let (mut nears, mut sure) = ([0.0; BLOCK], 0);
        match evidence.past {
            Some(past) => {
                past.nears(level, corner, extent, &mut nears);
                sure = past.claims(level, evidence.field, corner, &nears, holes, keys);
            }
            None => keys.fill(EMPTY),
        }
        let mut left = holes & !sure;
        let lines = [self.lines::<true>(column, row), self.lines::<false>(column, row)];
        if lines.iter().flatten().any(|&line| line != 0) {
            let mut beyond = self.beyond(corner, holes, &lines);
            let Work { beside, orders } = work;
            beside::find(level, &layer.keys[tile], claims, holes, &beyond, beside);
            let mut asked = left;
            if let Some(past) = evidence.past.filter(|_| sure != 0 && evidence.carries) {
                asked |= past.carried(level, keys, &nears, sure, beside);
            }
            if asked != 0 {
                self.order(corner, extent, [claims, holes], &mut beyond, beside, orders);
                let at = |place: usize| [corner[0] + place % TILE, corner[1] + place / TILE];
                // What it takes to know is asked for some places ahead.
                let mut ahead = asked;
                for _ in 0..PLACES_AHEAD {
                    evidence.fetch_next(&mut ahead, at, beside, orders);
                }
                each(asked, |place| {
                    evidence.fetch_next(&mut ahead, at, beside, orders);
                    let at = at(place);
                    let found = evidence.best(grid, at, place, beside, orders);
                    let is_sure = sure >> place & 1 == 1;
                    let is_taken = match evidence.past {
                        Some(past) if is_sure => past.is_carried(at, keys[place], found),
                        _ => found != EMPTY,
                    };
                    if is_taken {
                        keys[place] = layer::marked(found, evidence.mark);
                        left &= !(1 << place);
                    }
                });
            }
        }
        if let Some(leaving) = evidence.leaving.filter(|leaving| leaving.is_in(corner, extent)) {
            each(holes, |place| {
                if let Some(claim) = leaving.claim(corner[0] + place % TILE, corner[1] + place / TILE) {
                    keys[place] = claim;
                    left &= !(1 << place);
                }
            });
        }
        Filled { left, span: claims::span(level, keys) }
    }

    /// For each row or column of a tile the places near it on that line that something claims: first those before it, bits 24
    /// to 31 being its own.
    #[inline(always)]
    fn lines<const ACROSS: bool>(&self, column: usize, row: usize) -> [u64; TILE] {
        let Grid { columns, rows, .. } = self.layer.grid;
        let (at, len) = if ACROSS { (column, columns) } else { (row, rows) };
        let mut lines = [0; TILE];
        for step in (TILES - TILES.min(at))..(TILES + len - at).min(2 * TILES + 1) {
            let there = at + step - TILES;
            let tile = if ACROSS { row * columns + there } else { there * columns + column };
            let claims = if ACROSS { self.claims[tile] } else { transposed(self.claims[tile]) };
            for (i, line) in lines.iter_mut().enumerate() {
                *line |= (claims >> (TILE * i) & 0xff) << (TILE * step);
            }
        }
        lines
    }

    /// What is seen first beyond a tile from the holes at its rim.
    #[inline(always)]
    fn beyond(&self, [x, y]: [usize; 2], holes: u64, [rows, columns]: &[[u64; TILE]; 2]) -> Beyond {
        let mut beyond = Beyond::NOTHING;
        for i in 0..TILE {
            for side in 0..SIDES {
                let (line, place) = match side {
                    0 => (rows[i], TILE * i),
                    1 => (rows[i], TILE * i + TILE - 1),
                    2 => (columns[i], i),
                    _ => (columns[i], BLOCK - TILE + i),
                };
                let is_before = side % 2 == 0;
                let line = if is_before { line & ((1 << NEAR) - 1) } else { line >> (NEAR + TILE) };
                if line == 0 || holes >> place & 1 == 0 {
                    continue;
                }
                let along = if is_before {
                    (u64::BITS - line.leading_zeros()) as i32 - NEAR as i32 - 1
                } else {
                    TILE as i32 + line.trailing_zeros() as i32
                };
                let [u, v] = seen([x, y], side, i, along as u32);
                beyond.keys[side][i] = self.layer.owner(u, v);
                beyond.along[side][i] = along as u32;
            }
        }
        beyond
    }

    /// How good what stands beside the holes of a tile is.
    #[inline(always)]
    fn order(
        &self,
        corner: [usize; 2],
        [across, down]: [usize; 2],
        [claims, holes]: [u64; 2],
        beyond: &mut Beyond,
        beside: &Beside,
        orders: &mut Orders,
    ) {
        let Some(shown) = self.evidence.shown else {
            return beside::order_by_nearness(self.level, beside, orders);
        };
        let mut lumas = [0.0; BLOCK];
        for (j, lumas) in lumas.as_chunks_mut::<TILE>().0.iter_mut().enumerate().take(down) {
            let row = &shown.pixels[(corner[1] + j) * shown.width + corner[0]..][..across];
            match row.first_chunk() {
                Some(row) => *lumas = P::lumas_of(row),
                None => lumas.iter_mut().zip(row).for_each(|(luma, pixel)| *luma = pixel.luma()),
            }
        }
        for side in 0..SIDES {
            for i in (0..TILE).filter(|&i| beyond.keys[side][i] != EMPTY) {
                let [x, y] = seen(corner, side, i, beyond.along[side][i]);
                beyond.lumas[side][i] = shown.pixels[y * shown.width + x].luma();
            }
        }
        beside::order_by_likeness(self.level, beside, &lumas, claims, holes, beyond, orders);
    }
}

/// The pixel so far along a line of a tile: a row where one looks to the left or right, else a column.
#[inline(always)]
fn seen([x, y]: [usize; 2], side: usize, line: usize, along: u32) -> [usize; 2] {
    let along = along as i32 as isize;
    if side < 2 { [x.wrapping_add_signed(along), y + line] } else { [x + line, y.wrapping_add_signed(along)] }
}

/// The bits of a tile with rows and columns exchanged (H. S. Warren, Hacker's Delight, 2012, 7-3).
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

impl<P: Colour> Evidence<'_, P> {
    /// The best of what was found beside a place: of what the current anchor does not contradict the first in order, or, where
    /// it contradicts all, the first.
    #[inline(always)]
    fn best(&self, grid: Grid, at: [usize; 2], place: usize, beside: &Beside, orders: &Orders) -> Key {
        let key_of = |ranked: u64| beside.keys[ranked as usize % SIDES][place];
        let rank = |side: usize| u64::from(orders[side][place]) << 2 | side as u64;
        let mut ranked = [rank(0), rank(1), rank(2), rank(3)];
        // Of equals the first side's.
        for [a, b] in [[0, 1], [2, 3], [0, 2], [1, 3], [1, 2]] {
            (ranked[a], ranked[b]) = (ranked[a].min(ranked[b]), ranked[a].max(ranked[b]));
        }
        let first = key_of(ranked[0]);
        let mut contradicted = EMPTY;
        for n in 0..SIDES {
            let key = key_of(ranked[n]);
            if key == EMPTY {
                break;
            }
            if key == contradicted {
                continue;
            }
            // Mostly there is nothing else to choose from.
            let is_only = || ranked[1..].iter().all(|&other| [first, EMPTY].contains(&key_of(other)));
            if n == 0 && is_only() || !self.is_contradicted(grid, at, key) {
                return key;
            }
            contradicted = key;
        }
        first
    }

    /// Asks for what [`best`](Self::best) looks at first for the next of `places`.
    #[inline(always)]
    fn fetch_next(&self, places: &mut u64, at: impl Fn(usize) -> [usize; 2], beside: &Beside, orders: &Orders) {
        if *places == 0 {
            return;
        }
        let place = places.trailing_zeros() as usize;
        *places &= *places - 1;
        let rank = |side: usize| u64::from(orders[side][place]) << 2 | side as u64;
        let first = rank(0).min(rank(1)).min(rank(2).min(rank(3)));
        let key = beside.keys[first as usize % SIDES][place];
        let is_only = beside.keys.iter().all(|keys| keys[place] == key || keys[place] == EMPTY);
        if !is_only {
            self.field.fetch(self.spot(at(place), key));
        }
    }

    /// Where in the current anchor a candidate for a place leads to, in 1/64 px.
    #[inline(always)]
    fn spot(&self, at: [usize; 2], key: Key) -> [i32; 2] {
        let ([vx, vy], at) = (layer::vector(key), at.map(|at| at as i32));
        let reach = self.way.reach(key, at);
        [64 * at[0] - part(vx, reach), 64 * at[1] - part(vy, reach)]
    }

    /// Whether a candidate for a place would have claimed it: it is neither hidden in the current anchor nor has it left
    /// that.
    #[inline(always)]
    fn is_contradicted(&self, grid: Grid, at: [usize; 2], key: Key) -> bool {
        grid.nearest(self.spot(at, key)).is_some_and(|[u, v]| {
            let shown = self.field.owner(u, v);
            alike(shown, key) | is_nearer(key, shown)
        })
    }
}
