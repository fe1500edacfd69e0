//! Claims for the places that nothing claims.
//!
//! Such a place continues a surface beside it. In the previous anchor it shows what the current one does not: something
//! that is now hidden, or has left the picture. Between the anchors it shows what neither does. The nearest claims to
//! the left, right, above and below are the candidates; where none is near, a pyramid over the tiles has one that
//! prefers the farther surface.

use rayon::prelude::*;

use super::colour::Colour;
use super::kernels::{BLOCK, Source, TILE};
use super::layer::{self, EMPTY, Grid, Key, Layer, alike, is_nearer, key, part};
use super::sized;
use crate::Result;

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
    /// How far the layer lies from the current anchor, of the way to the previous one, see [`WHOLE`](layer::WHOLE).
    pub(super) reach: i32,
    /// The anchor that shows what is looked for, where one does.
    pub(super) shown: Option<Source<'a, P>>,
    /// What borrowed claims are marked with.
    pub(super) mark: u8,
}

impl Filler {
    /// Lets every place of `layer` that nothing claims borrow a key; returns how many there are.
    pub(super) fn fill<P: Colour>(&mut self, layer: &mut Layer, evidence: &Evidence<'_, P>) -> Result<usize> {
        let grid = layer.grid;
        self.reserve(grid)?;
        let holes = layer.tiles.iter().map(|tile| usize::from(tile.holes)).sum();
        if holes == 0 {
            return Ok(0);
        }
        self.build(layer);
        let mut borrowed = std::mem::take(&mut layer.borrowed);
        let (filled, levels) = (&*layer, &self.levels);
        borrowed.par_chunks_mut(grid.columns).enumerate().for_each(|(row, tiles)| {
            for (column, keys) in tiles.iter_mut().enumerate() {
                if filled.tiles[row * grid.columns + column].holes > 0 {
                    fill_tile(filled, levels, evidence, column, row, keys);
                }
            }
        });
        layer.borrowed = borrowed;
        let columns = grid.columns;
        let tiles = layer.tiles.par_chunks_mut(columns).zip(layer.borrowed.par_chunks(columns));
        tiles.zip(&mut layer.spans).for_each(|((tiles, borrowed), span)| {
            *span = [i32::MAX, i32::MIN];
            for (tile, keys) in tiles.iter_mut().zip(borrowed) {
                (tile.low, tile.high) = ([i32::MAX; 2], [i32::MIN; 2]);
                if tile.holes > 0 {
                    for &key in keys.iter().filter(|&&key| key != EMPTY) {
                        let vector = layer::vector(key);
                        tile.low = std::array::from_fn(|c| tile.low[c].min(vector[c]));
                        tile.high = std::array::from_fn(|c| tile.high[c].max(vector[c]));
                    }
                }
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

/// Fills the holes of a tile.
#[inline(never)]
fn fill_tile<P: Colour>(
    layer: &Layer,
    levels: &[Level],
    evidence: &Evidence<'_, P>,
    column: usize,
    row: usize,
    keys: &mut [Key; BLOCK],
) {
    let grid = layer.grid;
    let tile = row * grid.columns + column;
    let corner = [column * TILE, row * TILE];
    let [across, down] = grid.extent(column, row);
    let own = &layer.keys[tile];
    let mut best = [(u64::MAX, EMPTY); BLOCK];
    // From the left, the right, above and below: what was passed last is the nearest on that side.
    for (direction, lines) in [down, down, across, across].into_iter().enumerate() {
        let (is_across, is_back) = (direction < 2, direction % 2 == 1);
        let (len, side) = if is_across { (across, grid.width) } else { (down, grid.height) };
        let first = if is_across { corner[0] } else { corner[1] };
        for line in 0..lines {
            let at = |along: usize| if is_across { [along, corner[1] + line] } else { [corner[0] + line, along] };
            let mut passed = None;
            for step in 0..len {
                let along = first + if is_back { len - 1 - step } else { step };
                let [x, y] = at(along);
                let place = (y - corner[1]) * TILE + x - corner[0];
                if own[place] != EMPTY {
                    passed = Some((own[place], along));
                    continue;
                }
                if step == 0 {
                    passed = outside(layer, along, if is_back { side } else { 0 }, at);
                }
                let Some((key, from)) = passed.filter(|&(_, from)| along.abs_diff(from) <= NEAR) else { continue };
                let cost = evidence.cost(grid, [x, y], key, along.abs_diff(from), at(from));
                if best[place].1 == EMPTY || cost < best[place].0 {
                    best[place] = (cost, key);
                }
            }
        }
    }
    let far = match levels[0].keys[tile] {
        EMPTY => key(u16::MAX, 0, [0; 2]),
        key => key,
    };
    keys.fill(EMPTY);
    for (j, i) in (0..down).flat_map(|j| (0..across).map(move |i| (j, i))) {
        let place = j * TILE + i;
        if own[place] == EMPTY {
            let found = best[place].1;
            keys[place] = layer::marked(if found == EMPTY { far } else { found }, evidence.mark);
        }
    }
}

/// The nearest claim on a line from `along` (itself excluded) towards `end`, and where it was found.
#[inline(always)]
fn outside(layer: &Layer, along: usize, end: usize, at: impl Fn(usize) -> [usize; 2]) -> Option<(Key, usize)> {
    let look = |along: usize| {
        let [x, y] = at(along);
        let key = layer.owner(x, y);
        (key != EMPTY).then_some((key, along))
    };
    if end > along {
        (along + 1..end.min(along + NEAR + 1)).find_map(look)
    } else {
        (along.saturating_sub(NEAR)..along).rev().find_map(look)
    }
}

impl<P: Colour> Evidence<'_, P> {
    /// How bad a candidate is: whether the current anchor contradicts it, how near its surface is, how far away it was
    /// found.
    pub(super) fn cost(&self, grid: Grid, [x, y]: [usize; 2], key: Key, step: usize, from: [usize; 2]) -> u64 {
        let [vx, vy] = layer::vector(key);
        let there = [64 * x as i32 - part(vx, self.reach), 64 * y as i32 - part(vy, self.reach)];
        // It must be hidden in the current anchor, or have left it: else it would have claimed this place.
        let is_contradicted = grid.nearest(there).is_some_and(|[u, v]| {
            let shown = self.field.owner(u, v);
            alike(shown, key) || is_nearer(key, shown)
        });
        let unlike = self.shown.map_or(0, |shown| {
            let (here, there) = (shown.pixels[y * grid.width + x], shown.pixels[from[1] * grid.width + from[0]]);
            (here.luma() - there.luma()).abs().min(255.0) as u64
        });
        u64::from(is_contradicted) << 40
            | u64::from(u16::MAX - layer::rank(key)) << 16
            | (unlike + step as u64).min(u64::from(u16::MAX))
    }
}
