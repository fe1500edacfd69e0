//! Carrying claims to another time.

use std::ops::Range;

use parking_lot::Mutex;
use rayon::prelude::*;

use super::kernels::claims::{self, Places};
use super::kernels::{BLOCK, Level, TILE};
use super::layer::{self, EMPTY, Grid, Key, Kind, Layer, ONE_SURFACE, SLOPE, Tile, key, landed};
use super::perspective::Way;
use super::{reserve, sized};
use crate::Result;

/// Rows of tiles that are filled together.
const BAND: usize = 8;
/// Tiles ahead of the one that is carried whose keys are asked for.
const AHEAD: usize = 2;
/// Rows and columns of places around a band, so that cracks are seen whole.
const RIM: usize = 1;
/// A place that is covered by surfaces whose vectors differ by no more than this, in 1/64 px, is smooth.
pub(super) const SMOOTH: i32 = 48;
/// A layer to carry and how far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) layer: &'a Layer,
    pub(super) way: Way,
    pub(super) of: Carried,
}

/// Which claims of a layer are carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Carried {
    /// Those of pixels for themselves.
    Own,
    /// Borrowed ones.
    Borrowed,
}

/// What covers a tile while a band is filled.
#[derive(Debug, Clone, Copy)]
struct Cover {
    low: [i32; 2],
    high: [i32; 2],
    sum: [i64; 2],
    area: u32,
    nearest: Key,
    farthest: u16,
    is_rough: bool,
}

impl Cover {
    const NONE: Self = Self {
        low: [i32::MAX; 2],
        high: [i32::MIN; 2],
        sum: [0; 2],
        area: 0,
        nearest: EMPTY,
        farthest: 0,
        is_rough: false,
    };
}

/// Working memory of one thread: a band of places with its rim, and what covers its tiles.
#[derive(Debug, Default)]
pub(super) struct Band {
    /// [`EMPTY`] all over while no band is filled.
    places: Vec<Key>,
    covers: Vec<Cover>,
    /// For each tile, and one more on each side, whether pixels of their own landed there.
    is_rough: Vec<bool>,
    /// For each [`TILE`] columns of places whether anything is written there.
    is_used: Vec<bool>,
}

/// Working memory of every thread of the pool.
#[derive(Debug, Default)]
pub(super) struct Bands(Vec<Mutex<Band>>);

impl Bands {
    /// Makes room for all threads of the current pool.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        let threads = rayon::current_num_threads();
        if self.0.len() < threads {
            reserve(&mut self.0, threads)?;
            self.0.resize_with(threads, Mutex::default);
        }
        for band in &mut self.0[..threads] {
            let band = band.get_mut();
            sized(&mut band.places, stride(grid) * (BAND * TILE + 2 * RIM), EMPTY)?;
            sized(&mut band.covers, BAND * grid.columns, Cover::NONE)?;
            sized(&mut band.is_rough, (BAND + 2) * (grid.columns + 2), false)?;
            sized(&mut band.is_used, stride(grid).div_ceil(TILE), false)?;
        }
        Ok(())
    }
}

fn stride(grid: Grid) -> usize {
    grid.columns * TILE + 2 * RIM
}

impl Layer {
    /// Fills this layer with what `passes` carry to it. The nearest of those that land on one place gets it; cracks of
    /// a pixel in what lands are closed.
    pub(super) fn land(&mut self, level: Level, passes: &[Pass<'_>], bands: &Bands) -> Result<()> {
        let grid = passes[0].layer.grid;
        self.reserve(grid)?;
        // Where there are holes is known only when they are to be filled.
        sized(&mut self.borrowed, grid.tiles(), [EMPTY; BLOCK])?;
        let tiles = self.tiles.par_chunks_mut(BAND * grid.columns);
        let keys = self.keys.par_chunks_mut(BAND * grid.columns);
        tiles.zip(keys).enumerate().for_each(|(number, (tiles, keys))| {
            let thread = rayon::current_thread_index().unwrap_or(0);
            let mut band = bands.0[thread].lock();
            let filling = Filling { level, grid, top: number * BAND, rows: tiles.len() / grid.columns };
            filling.fill(passes, &mut band, tiles, keys);
        });
        Ok(())
    }
}

/// A band that is being filled.
struct Filling {
    level: Level,
    grid: Grid,
    /// Its first row of tiles, and how many it has.
    top: usize,
    rows: usize,
}

impl Filling {
    fn fill(&self, passes: &[Pass<'_>], band: &mut Band, tiles: &mut [Tile], keys: &mut [[Key; BLOCK]]) {
        band.covers.fill(Cover::NONE);
        band.is_rough.fill(false);
        for pass in passes {
            self.each_tile(pass, |column, row, tile| match (pass.of, tile.kind) {
                (Carried::Own, Kind::Smooth) => self.cover(&pass.way, column, row, tile, &mut band.covers),
                (Carried::Own, Kind::Rough) => {
                    let keys = &pass.layer.keys[row * self.grid.columns + column];
                    self.carry_pixels(pass.way, column, row, keys, band);
                }
                (Carried::Borrowed, _) if tile.holes > 0 => {
                    let keys = &pass.layer.borrowed[row * self.grid.columns + column];
                    self.carry_pixels(pass.way, column, row, keys, band);
                }
                (Carried::Borrowed, _) => {}
            });
        }
        let Band { covers, is_rough, is_used, .. } = band;
        for line in is_rough.chunks(self.grid.columns + 2) {
            // A group of columns holds parts of two tiles.
            let groups = is_used.iter_mut().zip(line.windows(2));
            groups.for_each(|(is_used, tiles)| *is_used |= tiles[0] | tiles[1]);
        }
        let mut rough = self.grid.columns..0;
        let covers = covers.chunks_mut(self.grid.columns).zip(is_rough.chunks(self.grid.columns + 2).skip(1));
        for ((row, tiles), (covers, is_rough)) in tiles.chunks_mut(self.grid.columns).enumerate().zip(covers) {
            for ((column, tile), cover) in tiles.iter_mut().enumerate().zip(covers) {
                cover.is_rough = is_rough[column + 1];
                *tile = self.settle(cover, self.grid.extent(column, self.top + row));
                cover.is_rough = tile.kind == Kind::Rough;
                if cover.is_rough {
                    rough = rough.start.min(column)..rough.end.max(column + 1);
                }
            }
        }
        for pass in passes.iter().filter(|pass| pass.of == Carried::Own && !rough.is_empty()) {
            self.each_tile(pass, |column, row, tile| {
                if tile.kind == Kind::Smooth {
                    self.carry_tile(&pass.way, column, row, tile, &rough, band);
                }
            });
        }
        for (index, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            if tile.kind == Kind::Rough {
                self.take(&band.places, index % self.grid.columns, index / self.grid.columns, tile, keys);
            }
        }
        let stride = stride(self.grid);
        for (group, is_used) in band.is_used.iter_mut().enumerate().filter(|(_, is_used)| **is_used) {
            *is_used = false;
            let columns = group * TILE..stride.min((group + 1) * TILE);
            band.places.chunks_mut(stride).for_each(|line| line[columns.clone()].fill(EMPTY));
        }
    }

    /// Calls `visit` for each tile that may reach this band.
    #[inline(never)]
    fn each_tile(&self, pass: &Pass<'_>, mut visit: impl FnMut(usize, usize, &Tile)) {
        let rim = RIM as i32;
        let band = (self.top * TILE) as i32 - rim..((self.top + self.rows) * TILE) as i32 + rim;
        let bounds = pass.way.bounds();
        let reaches = |row: usize, low: i32, high: i32| {
            let first = (row * TILE) as i32;
            let [a, b] = bounds.map(|reach| [landed(first, low, reach), landed(first, high, reach)]);
            let [least, most] = [a[0].min(a[1]).min(b[0]).min(b[1]), a[0].max(a[1]).max(b[0]).max(b[1])];
            least < band.end && most + TILE as i32 > band.start
        };
        for row in 0..self.grid.rows {
            let [low, high] = pass.layer.spans[row];
            if low > high || !reaches(row, low, high) {
                continue;
            }
            let first = row * self.grid.columns;
            let keys = if pass.of == Carried::Own { &pass.layer.keys } else { &pass.layer.borrowed };
            let tiles = pass.layer.row(row..row + 1);
            for (column, tile) in tiles.iter().enumerate() {
                let next = tiles.get(column + AHEAD).filter(|next| next.kind == Kind::Rough);
                if next.is_some_and(|next| pass.of == Carried::Own || next.holes > 0) {
                    Layer::fetch_keys(&keys[first + column + AHEAD]);
                }
                if tile.low[1] <= tile.high[1] && reaches(row, tile.low[1], tile.high[1]) {
                    visit(column, row, tile);
                }
            }
        }
    }

    /// Where the corner of a smooth tile lands.
    fn corner(&self, way: &Way, column: usize, row: usize, key: Key) -> [i32; 2] {
        let [x, y] = layer::vector(key);
        let reach = way.reach_of_tile(key, [column * TILE, row * TILE]);
        [landed((column * TILE) as i32, x, reach), landed((row * TILE) as i32, y, reach)]
    }

    /// The tiles of `tiles` that `from..from + len` touches.
    #[inline(always)]
    fn touched(from: i32, len: usize, tiles: Range<usize>) -> Range<usize> {
        let until = ((from + len as i32 - 1) >> 3) + 1;
        (from >> 3).max(tiles.start as i32) as usize..until.clamp(0, tiles.end as i32) as usize
    }

    /// How much of it is on one of them.
    #[inline(always)]
    fn part(from: i32, len: usize, tile: usize) -> u32 {
        let start = (tile * TILE) as i32;
        ((from + len as i32).min(start + TILE as i32) - from.max(start)) as u32
    }

    /// Notes that a smooth tile covers parts of others.
    #[inline(never)]
    fn cover(&self, way: &Way, column: usize, row: usize, tile: &Tile, covers: &mut [Cover]) {
        let [x, y] = self.corner(way, column, row, tile.key);
        let [across, down] = self.grid.extent(column, row);
        let vector = layer::vector(tile.key);
        let columns = Self::touched(x, across, 0..self.grid.columns);
        for r in Self::touched(y, down, self.top..self.top + self.rows) {
            let height = Self::part(y, down, r);
            for c in columns.clone() {
                let cover = &mut covers[(r - self.top) * self.grid.columns + c];
                let area = Self::part(x, across, c) * height;
                cover.low = std::array::from_fn(|c| cover.low[c].min(vector[c]));
                cover.high = std::array::from_fn(|c| cover.high[c].max(vector[c]));
                cover.sum = std::array::from_fn(|c| cover.sum[c] + i64::from(vector[c]) * i64::from(area));
                cover.area = cover.area.saturating_add(area);
                cover.nearest = cover.nearest.min(tile.key);
                cover.farthest = cover.farthest.max(layer::rank(tile.key));
            }
        }
    }

    /// Carries pixels one by one.
    fn carry_pixels(&self, way: Way, column: usize, row: usize, keys: &[Key; BLOCK], band: &mut Band) {
        let at = [column * TILE, row * TILE].map(|at| at as i32);
        let shift = [RIM as i32, RIM as i32 - (self.top * TILE) as i32];
        let mut places = Places { keys: &mut band.places, stride: stride(self.grid), is_rough: &mut band.is_rough };
        claims::carry(self.level, keys, at, shift, way, &mut places);
    }

    /// What a tile is that is covered so.
    #[inline(never)]
    fn settle(&self, cover: &Cover, [across, down]: [usize; 2]) -> Tile {
        let whole = (across * down) as u32;
        let is_surface = cover.farthest.saturating_sub(layer::rank(cover.nearest)) <= ONE_SURFACE;
        // Between vectors given for whole tiles, the mean of those that meet is nearer to the truth than a step is.
        let apart = if is_surface { SLOPE } else { SMOOTH };
        let is_smooth =
            !cover.is_rough && 4 * cover.area >= 3 * whole && (0..2).all(|i| cover.high[i] - cover.low[i] <= apart);
        if !is_smooth {
            return Tile { kind: Kind::Rough, ..Tile::default() };
        }
        let area = i64::from(cover.area);
        let mean = |sum: i64| ((2 * sum + area).div_euclid(2 * area)) as i32;
        let vector = if cover.low == cover.high { cover.low } else { cover.sum.map(mean) };
        let key = key(layer::rank(cover.nearest), layer::mark(cover.nearest), vector);
        Tile { kind: Kind::Smooth, holes: 0, key, low: vector, high: vector }
    }

    /// Carries all of a smooth tile, if it touches one that is not; those lie within the columns `rough`.
    #[inline(never)]
    fn carry_tile(&self, way: &Way, column: usize, row: usize, tile: &Tile, rough: &Range<usize>, band: &mut Band) {
        let [x, y] = self.corner(way, column, row, tile.key);
        let [across, down] = self.grid.extent(column, row);
        let rim = RIM as i32;
        let columns = Self::touched(x - rim, across + 2 * RIM, rough.clone());
        if columns.is_empty() {
            return;
        }
        let mut rows = Self::touched(y - rim, down + 2 * RIM, self.top..self.top + self.rows);
        let touches_rough = rows.any(|r| {
            let covers = &band.covers[(r - self.top) * self.grid.columns..][..self.grid.columns];
            columns.clone().any(|c| covers[c].is_rough)
        });
        if !touches_rough {
            return;
        }
        let width = (self.grid.columns * TILE) as i32;
        let columns = x.max(-rim)..(x + across as i32).min(width + rim);
        let first = (self.top * TILE) as i32 - rim;
        let lines = y.max(first)..(y + down as i32).min(first + (self.rows * TILE) as i32 + 2 * rim);
        if columns.is_empty() {
            return;
        }
        let [from, until] = [columns.start, columns.end - 1].map(|x| (x + rim) as usize / TILE);
        band.is_used[from..=until].fill(true);
        let start = (lines.start - first) as usize * stride(self.grid) + (columns.start + rim) as usize;
        let extent = [columns.len(), lines.len()];
        claims::lay(self.level, tile.key, &mut band.places, stride(self.grid), start, extent);
    }

    /// Takes the keys of a rough tile from the band, and closes its cracks.
    #[inline(never)]
    fn take(&self, places: &[Key], column: usize, row: usize, tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let [across, down] = self.grid.extent(column, self.top + row);
        let stride = stride(self.grid);
        (tile.holes, tile.key) =
            claims::close(self.level, &places[row * TILE * stride + column * TILE..], stride, keys);
        if [across, down] == [TILE, TILE] {
            return;
        }
        (tile.holes, tile.key) = (0, 0);
        for (place, key) in keys.iter_mut().enumerate() {
            if place % TILE >= across || place / TILE >= down {
                *key = EMPTY;
            } else if *key == EMPTY {
                tile.holes += 1;
            } else {
                tile.key = tile.key.max(*key);
            }
        }
        if tile.key == 0 {
            tile.key = EMPTY;
        }
    }
}
