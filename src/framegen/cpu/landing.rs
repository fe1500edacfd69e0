//! Carrying claims to another time.

use std::ops::Range;

use parking_lot::Mutex;

use super::kernels::claims::{self, Places};
use super::kernels::{BLOCK, Level, TILE, at_every_level};
use super::layer::{self, EMPTY, Grid, Key, Kind, Layer, ONE_SURFACE, SLOPE, Tile, key, landed};
use super::perspective::Way;
use super::rules::{Rule, Rules};
use super::{reserve, sized};
use crate::Result;
use crate::tasks::{self, Parallel, ParallelSliceMut};

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
    /// The least of each component of the vectors, and of what is left of nothing when they are taken from it.
    ends: [i32; 4],
    sum: [i64; 2],
    nearest: Key,
    area: u32,
    farthest: u32,
}

impl Cover {
    const NONE: Self = Self { ends: [i32::MAX; 4], sum: [0; 2], nearest: EMPTY, area: 0, farthest: 0 };

    fn low(&self) -> [i32; 2] {
        [self.ends[0], self.ends[1]]
    }

    fn high(&self) -> [i32; 2] {
        [self.ends[2], self.ends[3]].map(i32::wrapping_neg)
    }
}

/// Where a tile lands.
#[derive(Debug, Clone, Copy, Default)]
struct Spot {
    /// The corner of a smooth one. Of a rough one the least that any pixel of its first row gets down to,
    at: [i32; 2],
    /// and the most.
    most: i32,
}

impl Spot {
    /// Of what lands nowhere.
    const NONE: Self = Self { at: [i32::MAX; 2], most: i32::MIN };
}

/// Where the tiles of a pass land, and for each row of them the least and the most.
#[derive(Debug, Default)]
struct Spots {
    tiles: Vec<Spot>,
    rows: Vec<[i32; 2]>,
}

/// Working memory of one thread: a band of places with its rim, and what covers its tiles.
#[derive(Debug, Default)]
pub(super) struct Band {
    /// [`EMPTY`] all over while no band is filled.
    places: Vec<Key>,
    covers: Vec<Cover>,
    /// For each tile, and one more on each side, whether pixels of their own landed there,
    is_rough: Vec<bool>,
    /// whether anything is written there,
    is_used: Vec<bool>,
    /// and whether a tile that turned out rough is there or beside that.
    is_near: Vec<bool>,
}

/// Working memory of every thread that may share a loop.
#[derive(Debug, Default)]
pub(super) struct Bands {
    /// Threads for which there is room.
    threads: usize,
    of_threads: Vec<Mutex<Band>>,
    /// Of both passes.
    spots: [Mutex<Spots>; 2],
}

impl Bands {
    /// Makes room for all threads there are.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        let threads = tasks::concurrency();
        self.threads = 0;
        if self.of_threads.len() < threads {
            reserve(&mut self.of_threads, threads)?;
            self.of_threads.resize_with(threads, Mutex::default);
        }
        let with_rim = (BAND + 2) * (grid.columns + 2);
        for band in &mut self.of_threads[..threads] {
            let band = band.get_mut();
            sized(&mut band.places, stride(grid) * (BAND * TILE + 2 * RIM), EMPTY)?;
            sized(&mut band.covers, BAND * grid.columns, Cover::NONE)?;
            sized(&mut band.is_rough, with_rim, false)?;
            sized(&mut band.is_used, with_rim, false)?;
            sized(&mut band.is_near, with_rim, false)?;
        }
        for spots in &mut self.spots {
            let spots = spots.get_mut();
            sized(&mut spots.tiles, grid.tiles(), Spot::NONE)?;
            sized(&mut spots.rows, grid.rows, [0; 2])?;
        }
        self.threads = threads;
        Ok(())
    }
}

fn stride(grid: Grid) -> usize {
    grid.columns * TILE + 2 * RIM
}

impl Layer {
    /// Fills this layer with what `passes` carry to it. The nearest of those that land on one place gets it; cracks of
    /// a pixel in what lands are closed.
    pub(super) fn land(&mut self, level: Level, rules: Rules, passes: &[Pass<'_>], bands: &Bands) -> Result<()> {
        let grid = passes[0].layer.grid;
        self.reserve(grid)?;
        // Where there are holes is known only when they are to be filled.
        sized(&mut self.borrowed, grid.tiles(), [EMPTY; BLOCK])?;
        let mut spots = [bands.spots[0].lock(), bands.spots[1].lock()];
        for (spots, pass) in spots.iter_mut().zip(passes) {
            let Spots { tiles, rows } = &mut **spots;
            tiles.par_chunks_mut(grid.columns).zip(rows.par_iter_mut()).with_min_len(16).enumerate().for_each(
                |(row, (spots, ends))| {
                    *ends = find_spots(level, pass, row, spots);
                },
            );
        }
        let spots = [&*spots[0], &*spots[1]];
        let tiles = self.tiles.par_chunks_mut(BAND * grid.columns);
        let keys = self.keys.par_chunks_mut(BAND * grid.columns);
        tiles.zip(keys).enumerate().for_each_in_slot(bands.threads, |slot, (number, (tiles, keys))| {
            let mut band = bands.of_threads[slot].lock();
            let rows = tiles.len() / grid.columns;
            let closes_cracks = rules.has(Rule::CrackClosing);
            let filling = Filling { level, grid, top: number * BAND, rows, closes_cracks };
            filling.fill(passes, spots, &mut band, tiles, keys);
        });
        Ok(())
    }
}

at_every_level! {
    /// Where the tiles of a row land; the least and the most of how far down.
    fn find_spots(pass: &Pass<'_>, row: usize, spots: &mut [Spot]) -> [i32; 2] = spots_of_row | spots_of_row
}

#[inline(always)]
fn spots_of_row(pass: &Pass<'_>, row: usize, spots: &mut [Spot]) -> [i32; 2] {
    let Pass { layer, way, of } = *pass;
    let y = (row * TILE) as i32;
    let bounds = way.bounds();
    let mut ends = [i32::MAX, i32::MIN];
    let eights = layer.row(row..row + 1).chunks(TILE).zip(spots.chunks_mut(TILE));
    for (number, (tiles, spots)) in eights.enumerate() {
        let corner = |i: usize| ((number * TILE + i) * TILE) as i32;
        let (mut keys, mut low, mut high) = ([0; TILE], [0; TILE], [0; TILE]);
        for (i, tile) in tiles.iter().enumerate() {
            (keys[i], low[i], high[i]) = (tile.key, tile.low[1], tile.high[1]);
        }
        let (mut u, mut v) = ([0; TILE], [0; TILE]);
        let (mut least, mut most) = ([0; TILE], [0; TILE]);
        for i in 0..TILE {
            let reach = way.reach_of_tile(keys[i], [corner(i) as usize, y as usize]);
            let vector = layer::vector(keys[i]);
            (u[i], v[i]) = (landed(corner(i), vector[0], reach), landed(y, vector[1], reach));
            let a = bounds.map(|reach| landed(y, low[i], reach));
            let b = bounds.map(|reach| landed(y, high[i], reach));
            least[i] = a[0].min(a[1]).min(b[0].min(b[1]));
            most[i] = a[0].max(a[1]).max(b[0].max(b[1]));
        }
        for (i, (tile, spot)) in tiles.iter().zip(spots).enumerate() {
            *spot = match (of, tile.kind) {
                (Carried::Own, Kind::Smooth) => Spot { at: [u[i], v[i]], most: v[i] },
                (Carried::Borrowed, _) if tile.holes == 0 => Spot::NONE,
                _ if tile.low[1] > tile.high[1] => Spot::NONE,
                _ => Spot { at: [0, least[i]], most: most[i] },
            };
            ends = [ends[0].min(spot.at[1]), ends[1].max(spot.most)];
        }
    }
    ends
}

/// A band that is being filled.
struct Filling {
    level: Level,
    grid: Grid,
    /// Its first row of tiles, and how many it has.
    top: usize,
    rows: usize,
    closes_cracks: bool,
}

impl Filling {
    fn fill(
        &self,
        passes: &[Pass<'_>],
        spots: [&Spots; 2],
        band: &mut Band,
        tiles: &mut [Tile],
        keys: &mut [[Key; BLOCK]],
    ) {
        let columns = self.grid.columns;
        band.covers.fill(Cover::NONE);
        band.is_rough.fill(false);
        for (pass, spots) in passes.iter().zip(spots) {
            for row in self.reaching(spots) {
                let (tiles, spots) = (pass.layer.row(row..row + 1), &spots.tiles[row * columns..][..columns]);
                if pass.of == Carried::Own {
                    cover(self.level, self, row, tiles, spots, &mut band.covers);
                }
                let keys = if pass.of == Carried::Own { &pass.layer.keys } else { &pass.layer.borrowed };
                let keys = &keys[row * columns..][..columns];
                let is_carried = |column: usize| {
                    let is_by_pixel = pass.of == Carried::Borrowed || tiles[column].kind == Kind::Rough;
                    is_by_pixel && self.is_reached(&spots[column])
                };
                for column in 0..columns {
                    if column + AHEAD < columns && is_carried(column + AHEAD) {
                        Layer::fetch_keys(&keys[column + AHEAD]);
                    }
                    if is_carried(column) {
                        self.carry_pixels(pass.way, column, row, &keys[column], band);
                    }
                }
            }
        }
        band.is_used.copy_from_slice(&band.is_rough);
        band.is_near.fill(false);
        let mut has_rough = false;
        let covers = band.covers.chunks(columns).zip(band.is_rough.chunks(columns + 2).skip(1));
        for ((row, tiles), (covers, is_rough)) in tiles.chunks_mut(columns).enumerate().zip(covers) {
            for ((column, tile), cover) in tiles.iter_mut().enumerate().zip(covers) {
                *tile = self.settle(cover, is_rough[column + 1], self.grid.extent(column, self.top + row));
                if tile.kind == Kind::Rough {
                    has_rough = true;
                    (row..row + 3).for_each(|row| band.is_near[row * (columns + 2) + column..][..3].fill(true));
                }
            }
        }
        for (pass, spots) in passes.iter().zip(spots).filter(|(pass, _)| pass.of == Carried::Own && has_rough) {
            for row in self.reaching(spots) {
                let of_row = pass.layer.row(row..row + 1).iter().zip(&spots.tiles[row * columns..]);
                for (column, (tile, spot)) in of_row.enumerate() {
                    if tile.kind == Kind::Smooth && self.is_reached(spot) {
                        self.carry_tile(spot.at, self.grid.extent(column, row), tile.key, band, &*tiles);
                    }
                }
            }
        }
        for (index, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            if tile.kind == Kind::Rough {
                self.take(&band.places, index % columns, index / columns, tile, keys);
            }
        }
        self.clear(band);
    }

    /// Takes back what was written.
    #[inline(never)]
    fn clear(&self, band: &mut Band) {
        let stride = stride(self.grid);
        for (row, is_used) in band.is_used.chunks(self.grid.columns + 2).enumerate() {
            let lines = (row * TILE).saturating_sub(TILE - RIM)..(row * TILE + RIM).min(BAND * TILE + 2 * RIM);
            let mut column = 0;
            for run in is_used.chunk_by(|a, b| a == b) {
                let first = (column * TILE).saturating_sub(TILE - RIM);
                column += run.len();
                let end = ((column - 1) * TILE + RIM).min(stride);
                if run[0] {
                    lines.clone().for_each(|line| band.places[line * stride..][first..end].fill(EMPTY));
                }
            }
        }
    }

    /// Whether a tile may reach this band.
    #[inline(always)]
    fn is_reached(&self, spot: &Spot) -> bool {
        self.is_reached_by([spot.at[1], spot.most])
    }

    #[inline(always)]
    fn is_reached_by(&self, [least, most]: [i32; 2]) -> bool {
        let (rim, first, end) = (RIM as i32, (self.top * TILE) as i32, ((self.top + self.rows) * TILE) as i32);
        least < end + rim && most.saturating_add(TILE as i32) > first - rim
    }

    /// The rows of tiles that may reach this band.
    fn reaching<'a>(&'a self, spots: &'a Spots) -> impl Iterator<Item = usize> + 'a {
        (0..self.grid.rows).filter(|&row| self.is_reached_by(spots.rows[row]))
    }

    /// The tiles of `tiles` that `from..from + len` touches.
    #[inline(always)]
    fn touched(from: i32, len: usize, tiles: Range<usize>) -> Range<usize> {
        let until = ((from + len as i32 - 1) >> 3) + 1;
        (from >> 3).max(tiles.start as i32) as usize..until.clamp(0, tiles.end as i32) as usize
    }

    /// Carries pixels one by one.
    fn carry_pixels(&self, way: Way, column: usize, row: usize, keys: &[Key; BLOCK], band: &mut Band) {
        let at = [column * TILE, row * TILE].map(|at| at as i32);
        let shift = [RIM as i32, RIM as i32 - (self.top * TILE) as i32];
        let mut places = Places { keys: &mut band.places, stride: stride(self.grid), is_rough: &mut band.is_rough };
        claims::carry(self.level, keys, at, shift, way, &mut places);
    }

    /// What a tile is that is covered so, and on which pixels of their own landed or not.
    #[inline(always)]
    fn settle(&self, cover: &Cover, is_rough: bool, [across, down]: [usize; 2]) -> Tile {
        let whole = (across * down) as u32;
        let is_surface = cover.farthest.saturating_sub(layer::rank(cover.nearest).into()) <= ONE_SURFACE.into();
        // Between vectors given for whole tiles, the mean of those that meet is nearer to the truth than a step is.
        let apart = if is_surface { SLOPE } else { SMOOTH };
        let is_smooth = !is_rough
            && u64::from(cover.area) * 4 >= u64::from(whole) * 3
            && (0..2).all(|i| -cover.ends[i + 2] - cover.ends[i] <= apart);
        if !is_smooth {
            return Tile { kind: Kind::Rough, ..Tile::default() };
        }
        let area = i64::from(cover.area);
        let mean = |sum: i64| match (i32::try_from(2 * sum + area), i32::try_from(2 * area)) {
            // Mostly they fit, and are divided sooner.
            (Ok(sum), Ok(area)) => sum.div_euclid(area),
            _ => (2 * sum + area).div_euclid(2 * area) as i32,
        };
        let vector = if cover.low() == cover.high() { cover.low() } else { cover.sum.map(mean) };
        let key = key(layer::rank(cover.nearest), layer::mark(cover.nearest), vector);
        Tile { kind: Kind::Smooth, holes: 0, key, low: vector, high: vector }
    }

    /// Carries all of a smooth tile that lands at (x, y), if it touches one of `tiles` that is not.
    #[inline(always)]
    fn carry_tile(&self, [x, y]: [i32; 2], [across, down]: [usize; 2], key: Key, band: &mut Band, tiles: &[Tile]) {
        // What is negative is far beyond.
        let (column, row) = (((x >> 3) + 1) as u32 as usize, ((y >> 3) + 1 - self.top as i32) as u32 as usize);
        let is_near =
            column < self.grid.columns + 2 && row < BAND + 2 && band.is_near[row * (self.grid.columns + 2) + column];
        if is_near {
            self.carry_near(x, y, [across, down], key, band, tiles);
        }
    }

    /// The same near a rough one.
    #[inline(never)]
    fn carry_near(&self, x: i32, y: i32, [across, down]: [usize; 2], key: Key, band: &mut Band, tiles: &[Tile]) {
        let rim = RIM as i32;
        let columns = Self::touched(x - rim, across + 2 * RIM, 0..self.grid.columns);
        let mut rows = Self::touched(y - rim, down + 2 * RIM, self.top..self.top + self.rows);
        let touches_rough = rows.any(|r| {
            let tiles = &tiles[(r - self.top) * self.grid.columns..][..self.grid.columns];
            columns.clone().any(|c| tiles[c].kind == Kind::Rough)
        });
        if !touches_rough {
            return;
        }
        let width = (self.grid.columns * TILE) as i32;
        let columns = x.max(-rim)..(x + across as i32).min(width + rim);
        let first = (self.top * TILE) as i32 - rim;
        let lines = y.max(first)..(y + down as i32).min(first + (self.rows * TILE) as i32 + 2 * rim);
        if columns.is_empty() || lines.is_empty() {
            return;
        }
        let [left, right] = [columns.start, columns.end - 1].map(|x| (x + TILE as i32) as usize / TILE);
        let [above, below] = [lines.start, lines.end - 1].map(|y| (y - first + TILE as i32 - rim) as usize / TILE);
        for row in above..=below {
            band.is_used[row * (self.grid.columns + 2)..][left..=right].fill(true);
        }
        let start = (lines.start - first) as usize * stride(self.grid) + (columns.start + rim) as usize;
        let extent = [columns.len(), lines.len()];
        claims::lay(self.level, key, &mut band.places, stride(self.grid), start, extent);
    }

    /// Takes the keys of a rough tile from the band, and closes its cracks.
    #[inline(never)]
    fn take(&self, places: &[Key], column: usize, row: usize, tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let [across, down] = self.grid.extent(column, self.top + row);
        let stride = stride(self.grid);
        let first = row * TILE * stride + column * TILE;
        if self.closes_cracks {
            (tile.holes, tile.key) = claims::close(self.level, &places[first..], stride, keys);
        } else {
            let inner = places[first + RIM * stride + RIM..].chunks(stride);
            keys.chunks_mut(TILE).zip(inner).for_each(|(keys, line)| keys.copy_from_slice(&line[..TILE]));
        }
        if [across, down] == [TILE, TILE] && self.closes_cracks {
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

at_every_level! {
    /// Notes what parts of the tiles of a band the smooth ones of a row cover.
    fn cover(filling: &Filling, row: usize, tiles: &[Tile], spots: &[Spot], covers: &mut [Cover])
        = cover_parts | cover_parts
}

#[inline(always)]
fn cover_parts(filling: &Filling, row: usize, tiles: &[Tile], spots: &[Spot], covers: &mut [Cover]) {
    let &Filling { grid, top, rows, .. } = filling;
    for (column, (tile, spot)) in tiles.iter().zip(spots).enumerate() {
        if tile.kind != Kind::Smooth || !filling.is_reached(spot) {
            continue;
        }
        let [x, y] = spot.at;
        let extent = grid.extent(column, row).map(|len| len as i32);
        // Of the first tile that is touched, and of the next.
        let parts = |at: i32, len: i32| {
            let part = (TILE as i32 - (at & 7)).min(len);
            [part, len - part]
        };
        let (across, down) = (parts(x, extent[0]), parts(y, extent[1]));
        let [u, v] = layer::vector(tile.key);
        let ends = [u, v, -u, -v];
        let rank = u32::from(layer::rank(tile.key));
        for (j, &height) in down.iter().enumerate() {
            // What is negative is far beyond.
            let r = ((y >> 3) + j as i32 - top as i32) as u32 as usize;
            if height <= 0 || r >= rows {
                continue;
            }
            let covers = &mut covers[r * grid.columns..][..grid.columns];
            for (i, &width) in across.iter().enumerate() {
                let c = ((x >> 3) + i as i32) as u32 as usize;
                if width <= 0 || c >= grid.columns {
                    continue;
                }
                let cover = &mut covers[c];
                let area = width * height;
                for (end, of_tile) in cover.ends.iter_mut().zip(ends) {
                    *end = of_tile.min(*end);
                }
                cover.sum[0] += i64::from(u * area);
                cover.sum[1] += i64::from(v * area);
                cover.nearest = cover.nearest.min(tile.key);
                cover.area = cover.area.saturating_add(area as u32);
                cover.farthest = cover.farthest.max(rank);
            }
        }
    }
}
