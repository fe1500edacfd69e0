//! Splatting (forward warping) of keys to another time.

use std::ops::Range;

use crate::locks::Mutex;

use super::kernels::tile_keys::{self, SplatTarget};
use super::kernels::{BLOCK, SimdLevel, TILE, at_every_level};
use super::key_buffer::{Grid, KeyBuffer, Tile, TileKind};
use super::rules::{Rule, Rules};
use super::splat_key::{self, EMPTY, Key, SLOPE_DEPTH_KEYS, SLOPE_MOTION, pack, warped};
use super::warp::Warp;
use super::{reserve, resize};
use crate::Result;
use crate::tasks::{self, Parallel, ParallelSliceMut};

/// Rows of tiles per band; a band is splatted by one thread.
const BAND_ROWS: usize = 8;
/// Tiles whose keys are prefetched ahead of the current one.
const PREFETCH_AHEAD: usize = 2;
/// Border around a band in pixels, so that cracks can be closed at its edges.
const BORDER: usize = 1;
/// Largest difference per component between the motion vectors that cover a uniform tile, in 1/64 px.
pub(super) const UNIFORM_RANGE: i32 = 48;

#[cfg(test)]
crate::shader_constants::shader_constants!("SPLAT_": int UNIFORM_RANGE);

/// A key buffer to splat, and the warp for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplatPass<'a> {
    pub(super) source: &'a KeyBuffer,
    pub(super) warp: Warp,
    pub(super) origin: KeyOrigin,
}

/// Which keys of a buffer are splatted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeyOrigin {
    /// Keys of pixels that are covered.
    Own,
    /// Keys that holes inherited.
    Inherited,
}

/// Sums and extremes of the uniform tiles that cover a destination tile.
#[derive(Debug, Clone, Copy)]
struct Coverage {
    /// Minimum of each motion component, then minimum of each negated component.
    extremes: [i32; 4],
    sum: [i64; 2],
    nearest: Key,
    area: u32,
    farthest: u32,
}

impl Coverage {
    const NONE: Self = Self { extremes: [i32::MAX; 4], sum: [0; 2], nearest: EMPTY, area: 0, farthest: 0 };

    fn low(&self) -> [i32; 2] {
        [self.extremes[0], self.extremes[1]]
    }

    fn high(&self) -> [i32; 2] {
        [self.extremes[2], self.extremes[3]].map(i32::wrapping_neg)
    }
}

/// Destination of a tile.
#[derive(Debug, Clone, Copy, Default)]
struct Destination {
    /// Destination pixel of a uniform tile's corner. For a mixed tile only y is valid: the smallest for any pixel of
    /// its first row.
    at: [i32; 2],
    /// The largest y.
    max_y: i32,
}

impl Destination {
    /// Destination of a tile without keys.
    const NONE: Self = Self { at: [i32::MAX; 2], max_y: i32::MIN };
}

/// Destinations of all tiles of a pass, and minimum and maximum y per row of tiles.
#[derive(Debug, Default)]
struct Destinations {
    tiles: Vec<Destination>,
    rows: Vec<[i32; 2]>,
}

/// Memory of one thread: keys of a band with its border, and coverage of its tiles.
#[derive(Debug, Default)]
struct Band {
    /// [`EMPTY`] between bands.
    splatted: Vec<Key>,
    coverages: Vec<Coverage>,
    /// Per tile, with a border of one tile: whether keys of single pixels are splatted to it.
    has_pixels: Vec<bool>,
    /// Whether any key is written to it.
    is_written: Vec<bool>,
    /// Whether it or one of its neighbours is a mixed tile.
    is_near_mixed: Vec<bool>,
}

/// Forward warp; keeps its working memory.
#[derive(Debug, Default)]
pub(super) struct Splatter {
    /// Number of threads with memory.
    threads: usize,
    bands: Vec<Mutex<Band>>,
    /// For each of two passes.
    destinations: [Mutex<Destinations>; 2],
}

impl Splatter {
    /// Allocates memory for all threads.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        let threads = tasks::concurrency();
        self.threads = 0;
        if self.bands.len() < threads {
            reserve(&mut self.bands, threads)?;
            self.bands.resize_with(threads, Mutex::default);
        }
        let with_border = (BAND_ROWS + 2) * (grid.columns + 2);
        for band in &mut self.bands[..threads] {
            let band = band.get_mut();
            resize(&mut band.splatted, stride(grid) * (BAND_ROWS * TILE + 2 * BORDER), EMPTY)?;
            resize(&mut band.coverages, BAND_ROWS * grid.columns, Coverage::NONE)?;
            resize(&mut band.has_pixels, with_border, false)?;
            resize(&mut band.is_written, with_border, false)?;
            resize(&mut band.is_near_mixed, with_border, false)?;
        }
        for destinations in &mut self.destinations {
            let destinations = destinations.get_mut();
            resize(&mut destinations.tiles, grid.tiles(), Destination::NONE)?;
            resize(&mut destinations.rows, grid.rows, [0; 2])?;
        }
        self.threads = threads;
        Ok(())
    }

    /// Splats the keys of `passes` into `target`, keeps the nearest at each destination pixel, and closes cracks one
    /// pixel wide.
    pub(super) fn splat(
        &self,
        level: SimdLevel,
        rules: Rules,
        passes: &[SplatPass<'_>],
        target: &mut KeyBuffer,
    ) -> Result<()> {
        let grid = passes[0].source.grid;
        target.reserve(grid)?;
        // Allocated for all tiles: which have holes is known only after splatting.
        resize(&mut target.inherited, grid.tiles(), [EMPTY; BLOCK])?;
        let mut destinations = [self.destinations[0].lock(), self.destinations[1].lock()];
        for (destinations, pass) in destinations.iter_mut().zip(passes) {
            let Destinations { tiles, rows } = &mut **destinations;
            tiles.par_chunks_mut(grid.columns).zip(rows.par_iter_mut()).with_min_len(16).enumerate().for_each(
                |(row, (destinations, range))| {
                    *range = find_destinations(level, pass, row, destinations);
                },
            );
        }
        let destinations = [&*destinations[0], &*destinations[1]];
        let tiles = target.tiles.par_chunks_mut(BAND_ROWS * grid.columns);
        let keys = target.keys.par_chunks_mut(BAND_ROWS * grid.columns);
        tiles.zip(keys).enumerate().for_each_in_slot(self.threads, |slot, (number, (tiles, keys))| {
            let mut memory = self.bands[slot].lock();
            let (top, rows) = (number * BAND_ROWS, tiles.len() / grid.columns);
            let band = BandSplat { level, grid, top, rows, closes_cracks: rules.has(Rule::CrackClosing) };
            band.run(passes, destinations, &mut memory, tiles, keys);
        });
        Ok(())
    }
}

fn stride(grid: Grid) -> usize {
    grid.columns * TILE + 2 * BORDER
}

at_every_level! {
    /// Computes the destinations of a row of tiles; returns minimum and maximum y.
    fn find_destinations(pass: &SplatPass<'_>, row: usize, destinations: &mut [Destination]) -> [i32; 2] = destinations_of_row | destinations_of_row
}

#[inline(always)]
fn destinations_of_row(pass: &SplatPass<'_>, row: usize, destinations: &mut [Destination]) -> [i32; 2] {
    let SplatPass { source, warp, origin } = *pass;
    let y = (row * TILE) as i32;
    let fraction_bounds = warp.fraction_bounds();
    let mut range = [i32::MAX, i32::MIN];
    let eights = source.tile_rows(row..row + 1).chunks(TILE).zip(destinations.chunks_mut(TILE));
    for (number, (tiles, destinations)) in eights.enumerate() {
        let corner = |i: usize| ((number * TILE + i) * TILE) as i32;
        let (mut keys, mut low, mut high) = ([0; TILE], [0; TILE], [0; TILE]);
        for (i, tile) in tiles.iter().enumerate() {
            (keys[i], low[i], high[i]) = (tile.key, tile.low[1], tile.high[1]);
        }
        let (mut u, mut v) = ([0; TILE], [0; TILE]);
        let (mut min_y, mut max_y) = ([0; TILE], [0; TILE]);
        for i in 0..TILE {
            let fraction = warp.fraction_of_tile(keys[i], [corner(i) as usize, y as usize]);
            let vector = splat_key::vector(keys[i]);
            (u[i], v[i]) = (warped(corner(i), vector[0], fraction), warped(y, vector[1], fraction));
            let a = fraction_bounds.map(|fraction| warped(y, low[i], fraction));
            let b = fraction_bounds.map(|fraction| warped(y, high[i], fraction));
            min_y[i] = a[0].min(a[1]).min(b[0].min(b[1]));
            max_y[i] = a[0].max(a[1]).max(b[0].max(b[1]));
        }
        for (i, (tile, destination)) in tiles.iter().zip(destinations).enumerate() {
            *destination = match (origin, tile.kind) {
                (KeyOrigin::Own, TileKind::Uniform) => Destination { at: [u[i], v[i]], max_y: v[i] },
                (KeyOrigin::Inherited, _) if tile.holes == 0 => Destination::NONE,
                _ if tile.low[1] > tile.high[1] => Destination::NONE,
                _ => Destination { at: [0, min_y[i]], max_y: max_y[i] },
            };
            range = [range[0].min(destination.at[1]), range[1].max(destination.max_y)];
        }
    }
    range
}

/// A band of destination tiles.
struct BandSplat {
    level: SimdLevel,
    grid: Grid,
    /// First row of tiles, and number of rows.
    top: usize,
    rows: usize,
    closes_cracks: bool,
}

impl BandSplat {
    fn run(
        &self,
        passes: &[SplatPass<'_>],
        destinations: [&Destinations; 2],
        band: &mut Band,
        tiles: &mut [Tile],
        keys: &mut [[Key; BLOCK]],
    ) {
        let columns = self.grid.columns;
        band.coverages.fill(Coverage::NONE);
        band.has_pixels.fill(false);
        for (pass, destinations) in passes.iter().zip(destinations) {
            for row in self.reaching_rows(destinations) {
                let (tiles, destinations) =
                    (pass.source.tile_rows(row..row + 1), &destinations.tiles[row * columns..][..columns]);
                if pass.origin == KeyOrigin::Own {
                    add_coverage(self.level, self, row, tiles, destinations, &mut band.coverages);
                }
                let keys = if pass.origin == KeyOrigin::Own { &pass.source.keys } else { &pass.source.inherited };
                let keys = &keys[row * columns..][..columns];
                let is_splatted = |column: usize| {
                    let is_by_pixel = pass.origin == KeyOrigin::Inherited || tiles[column].kind == TileKind::Mixed;
                    is_by_pixel && self.reaches_band(&destinations[column])
                };
                for column in 0..columns {
                    if column + PREFETCH_AHEAD < columns && is_splatted(column + PREFETCH_AHEAD) {
                        KeyBuffer::prefetch_keys(&keys[column + PREFETCH_AHEAD]);
                    }
                    if is_splatted(column) {
                        self.splat_pixels(pass.warp, column, row, &keys[column], band);
                    }
                }
            }
        }
        band.is_written.copy_from_slice(&band.has_pixels);
        band.is_near_mixed.fill(false);
        let mut has_mixed = false;
        let coverages = band.coverages.chunks(columns).zip(band.has_pixels.chunks(columns + 2).skip(1));
        for ((row, tiles), (coverages, has_pixels)) in tiles.chunks_mut(columns).enumerate().zip(coverages) {
            for ((column, tile), coverage) in tiles.iter_mut().enumerate().zip(coverages) {
                *tile = self.classify(coverage, has_pixels[column + 1], self.grid.extent(column, self.top + row));
                if tile.kind == TileKind::Mixed {
                    has_mixed = true;
                    (row..row + 3).for_each(|row| band.is_near_mixed[row * (columns + 2) + column..][..3].fill(true));
                }
            }
        }
        for (pass, destinations) in
            passes.iter().zip(destinations).filter(|(pass, _)| pass.origin == KeyOrigin::Own && has_mixed)
        {
            for row in self.reaching_rows(destinations) {
                let of_row = pass.source.tile_rows(row..row + 1).iter().zip(&destinations.tiles[row * columns..]);
                for (column, (tile, destination)) in of_row.enumerate() {
                    if tile.kind == TileKind::Uniform && self.reaches_band(destination) {
                        self.splat_tile(destination.at, self.grid.extent(column, row), tile.key, band, &*tiles);
                    }
                }
            }
        }
        for (index, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
            if tile.kind == TileKind::Mixed {
                self.resolve_tile(&band.splatted, index % columns, index / columns, tile, keys);
            }
        }
        self.clear(band);
    }

    /// Resets the written keys to `EMPTY`.
    #[inline(never)]
    fn clear(&self, band: &mut Band) {
        let stride = stride(self.grid);
        for (row, is_written) in band.is_written.chunks(self.grid.columns + 2).enumerate() {
            let lines =
                (row * TILE).saturating_sub(TILE - BORDER)..(row * TILE + BORDER).min(BAND_ROWS * TILE + 2 * BORDER);
            let mut column = 0;
            for run in is_written.chunk_by(|a, b| a == b) {
                let first = (column * TILE).saturating_sub(TILE - BORDER);
                column += run.len();
                let end = ((column - 1) * TILE + BORDER).min(stride);
                if run[0] {
                    lines.clone().for_each(|line| band.splatted[line * stride..][first..end].fill(EMPTY));
                }
            }
        }
    }

    /// Whether the destination of a tile may overlap this band.
    #[inline(always)]
    fn reaches_band(&self, destination: &Destination) -> bool {
        self.range_reaches_band([destination.at[1], destination.max_y])
    }

    #[inline(always)]
    fn range_reaches_band(&self, [min_y, max_y]: [i32; 2]) -> bool {
        let (border, first, end) = (BORDER as i32, (self.top * TILE) as i32, ((self.top + self.rows) * TILE) as i32);
        min_y < end + border && max_y.saturating_add(TILE as i32) > first - border
    }

    /// Rows of tiles that may overlap this band.
    fn reaching_rows<'a>(&'a self, destinations: &'a Destinations) -> impl Iterator<Item = usize> + 'a {
        (0..self.grid.rows).filter(|&row| self.range_reaches_band(destinations.rows[row]))
    }

    /// Range of tiles, clipped to `tiles`, that the pixels `from..from + len` overlap.
    #[inline(always)]
    fn touched(from: i32, len: usize, tiles: Range<usize>) -> Range<usize> {
        let until = ((from + len as i32 - 1) >> 3) + 1;
        (from >> 3).max(tiles.start as i32) as usize..until.clamp(0, tiles.end as i32) as usize
    }

    /// Splats the pixels of a tile one by one.
    fn splat_pixels(&self, warp: Warp, column: usize, row: usize, keys: &[Key; BLOCK], band: &mut Band) {
        let at = [column * TILE, row * TILE].map(|at| at as i32);
        let shift = [BORDER as i32, BORDER as i32 - (self.top * TILE) as i32];
        let mut splatted =
            SplatTarget { keys: &mut band.splatted, stride: stride(self.grid), is_mixed: &mut band.has_pixels };
        tile_keys::splat_pixels(self.level, keys, at, shift, warp, &mut splatted);
    }

    /// Decides whether a destination tile is uniform. It is if no key of a single pixel reaches it, and uniform tiles
    /// with similar motion cover at least three quarters of it; its motion is their mean, weighted by area.
    #[inline(always)]
    fn classify(&self, coverage: &Coverage, has_pixels: bool, [across, down]: [usize; 2]) -> Tile {
        let tile_area = (across * down) as u32;
        let is_one_slope =
            coverage.farthest.saturating_sub(splat_key::depth_key(coverage.nearest).into()) <= SLOPE_DEPTH_KEYS.into();
        // On a sloping surface with one vector per tile, the mean of neighbouring vectors is more accurate than a step.
        let max_range = if is_one_slope { SLOPE_MOTION } else { UNIFORM_RANGE };
        let is_uniform = !has_pixels
            && u64::from(coverage.area) * 4 >= u64::from(tile_area) * 3
            && (0..2).all(|i| -coverage.extremes[i + 2] - coverage.extremes[i] <= max_range);
        if !is_uniform {
            return Tile { kind: TileKind::Mixed, ..Tile::default() };
        }
        let area = i64::from(coverage.area);
        let mean = |sum: i64| match (i32::try_from(2 * sum + area), i32::try_from(2 * area)) {
            // The usual case: 32-bit division is faster.
            (Ok(sum), Ok(area)) => sum.div_euclid(area),
            _ => (2 * sum + area).div_euclid(2 * area) as i32,
        };
        let vector = if coverage.low() == coverage.high() { coverage.low() } else { coverage.sum.map(mean) };
        let key = pack(splat_key::depth_key(coverage.nearest), splat_key::tag(coverage.nearest), vector);
        Tile { kind: TileKind::Uniform, holes: 0, key, low: vector, high: vector }
    }

    /// Splats a uniform tile with its corner at (x, y), if it touches one of the mixed `tiles`.
    #[inline(always)]
    fn splat_tile(&self, [x, y]: [i32; 2], [across, down]: [usize; 2], key: Key, band: &mut Band, tiles: &[Tile]) {
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        let (column, row) = (((x >> 3) + 1) as u32 as usize, ((y >> 3) + 1 - self.top as i32) as u32 as usize);
        let is_near_mixed = column < self.grid.columns + 2
            && row < BAND_ROWS + 2
            && band.is_near_mixed[row * (self.grid.columns + 2) + column];
        if is_near_mixed {
            self.splat_tile_near_mixed(x, y, [across, down], key, band, tiles);
        }
    }

    /// The slow path of [`splat_tile`](Self::splat_tile), near a mixed tile.
    #[inline(never)]
    fn splat_tile_near_mixed(
        &self,
        x: i32,
        y: i32,
        [across, down]: [usize; 2],
        key: Key,
        band: &mut Band,
        tiles: &[Tile],
    ) {
        let border = BORDER as i32;
        let columns = Self::touched(x - border, across + 2 * BORDER, 0..self.grid.columns);
        let mut rows = Self::touched(y - border, down + 2 * BORDER, self.top..self.top + self.rows);
        let touches_mixed = rows.any(|r| {
            let tiles = &tiles[(r - self.top) * self.grid.columns..][..self.grid.columns];
            columns.clone().any(|c| tiles[c].kind == TileKind::Mixed)
        });
        if !touches_mixed {
            return;
        }
        let width = (self.grid.columns * TILE) as i32;
        let columns = x.max(-border)..(x + across as i32).min(width + border);
        let first = (self.top * TILE) as i32 - border;
        let lines = y.max(first)..(y + down as i32).min(first + (self.rows * TILE) as i32 + 2 * border);
        if columns.is_empty() || lines.is_empty() {
            return;
        }
        let [left, right] = [columns.start, columns.end - 1].map(|x| (x + TILE as i32) as usize / TILE);
        let [above, below] = [lines.start, lines.end - 1].map(|y| (y - first + TILE as i32 - border) as usize / TILE);
        for row in above..=below {
            band.is_written[row * (self.grid.columns + 2)..][left..=right].fill(true);
        }
        let start = (lines.start - first) as usize * stride(self.grid) + (columns.start + border) as usize;
        let extent = [columns.len(), lines.len()];
        tile_keys::splat_rectangle(self.level, key, &mut band.splatted, stride(self.grid), start, extent);
    }

    /// Copies the keys of a mixed tile from the band, with cracks closed if that rule applies.
    #[inline(never)]
    fn resolve_tile(&self, splatted: &[Key], column: usize, row: usize, tile: &mut Tile, keys: &mut [Key; BLOCK]) {
        let [across, down] = self.grid.extent(column, self.top + row);
        let stride = stride(self.grid);
        let first = row * TILE * stride + column * TILE;
        if self.closes_cracks {
            (tile.holes, tile.key) = tile_keys::close_cracks(self.level, &splatted[first..], stride, keys);
        } else {
            let inner = splatted[first + BORDER * stride + BORDER..].chunks(stride);
            keys.chunks_mut(TILE).zip(inner).for_each(|(keys, line)| keys.copy_from_slice(&line[..TILE]));
        }
        if [across, down] == [TILE, TILE] && self.closes_cracks {
            return;
        }
        (tile.holes, tile.key) = (0, 0);
        for (index, key) in keys.iter_mut().enumerate() {
            if index % TILE >= across || index / TILE >= down {
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
    /// Adds a row of uniform tiles to the coverage of the destination tiles.
    fn add_coverage(band: &BandSplat, row: usize, tiles: &[Tile], destinations: &[Destination], coverages: &mut [Coverage])
        = add_coverage_of_row | add_coverage_of_row
}

#[inline(always)]
fn add_coverage_of_row(
    band: &BandSplat,
    row: usize,
    tiles: &[Tile],
    destinations: &[Destination],
    coverages: &mut [Coverage],
) {
    let &BandSplat { grid, top, rows, .. } = band;
    for (column, (tile, destination)) in tiles.iter().zip(destinations).enumerate() {
        if tile.kind != TileKind::Uniform || !band.reaches_band(destination) {
            continue;
        }
        let [x, y] = destination.at;
        let extent = grid.extent(column, row).map(|len| len as i32);
        // Pixels on the first overlapped tile, and on the next.
        let parts = |at: i32, len: i32| {
            let part = (TILE as i32 - (at & 7)).min(len);
            [part, len - part]
        };
        let (across, down) = (parts(x, extent[0]), parts(y, extent[1]));
        let [u, v] = splat_key::vector(tile.key);
        let range = [u, v, -u, -v];
        let farthest_key = u32::from(splat_key::depth_key(tile.key));
        for (j, &height) in down.iter().enumerate() {
            // Negative coordinates wrap to large unsigned values and fail the bounds check.
            let r = ((y >> 3) + j as i32 - top as i32) as u32 as usize;
            if height <= 0 || r >= rows {
                continue;
            }
            let coverages = &mut coverages[r * grid.columns..][..grid.columns];
            for (i, &width) in across.iter().enumerate() {
                let c = ((x >> 3) + i as i32) as u32 as usize;
                if width <= 0 || c >= grid.columns {
                    continue;
                }
                let coverage = &mut coverages[c];
                let area = width * height;
                for (end, of_tile) in coverage.extremes.iter_mut().zip(range) {
                    *end = of_tile.min(*end);
                }
                coverage.sum[0] += i64::from(u * area);
                coverage.sum[1] += i64::from(v * area);
                coverage.nearest = coverage.nearest.min(tile.key);
                coverage.area = coverage.area.saturating_add(area as u32);
                coverage.farthest = coverage.farthest.max(farthest_key);
            }
        }
    }
}
