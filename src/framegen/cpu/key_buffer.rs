//! A splat key per pixel, stored in tiles: one key for a uniform tile, 64 for a mixed one.

use std::ops::Range;

use super::kernels::tile_keys::PaddedTile;
use super::kernels::{BLOCK, TILE, prefetch};
use super::resize;
use super::splat_key::{EMPTY, Key};
use crate::Result;

/// Size of a picture in pixels and in tiles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Grid {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Tiles per row.
    pub(super) columns: usize,
    /// Rows of tiles.
    pub(super) rows: usize,
}

impl Grid {
    pub(super) fn new((width, height): (u32, u32)) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    pub(super) fn tiles(&self) -> usize {
        self.columns * self.rows
    }

    /// Width and height of the tile at (column, row) in pixels: smaller than [`TILE`] at the right and bottom borders.
    pub(super) fn extent(&self, column: usize, row: usize) -> [usize; 2] {
        [TILE.min(self.width - column * TILE), TILE.min(self.height - row * TILE)]
    }

    /// Index of the tile that contains a pixel, and the pixel's index in it.
    #[inline(always)]
    pub(super) fn locate(&self, x: usize, y: usize) -> (usize, usize) {
        (y / TILE * self.columns + x / TILE, y % TILE * TILE + x % TILE)
    }

    /// Whether the pixel nearest to a position (1/64 px) is inside the picture.
    #[inline(always)]
    pub(super) fn contains_position(&self, [x, y]: [i32; 2]) -> bool {
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        let is_on = |at: i32, len: usize| ((at + 32) as u32) < 64 * len as u32;
        is_on(x, self.width) & is_on(y, self.height)
    }

    /// The pixel nearest to a position (1/64 px); `None` outside the picture.
    #[inline(always)]
    pub(super) fn nearest_pixel(&self, [x, y]: [i32; 2]) -> Option<[usize; 2]> {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        let is_inside = (0..self.width as i32).contains(&x) && (0..self.height as i32).contains(&y);
        is_inside.then_some([x as usize, y as usize])
    }
}

/// Pixels of a tile with this width and height, as bits `8 j + i`.
#[inline(always)]
pub(super) fn tile_mask([across, down]: [usize; 2]) -> u64 {
    (0x0101_0101_0101_0101 * (0xff >> (TILE - across))) & (u64::MAX >> (TILE * (TILE - down)))
}

/// Calls `visit` with the index of each set bit, lowest first.
#[inline(always)]
pub(super) fn for_each_bit(mut mask: u64, mut visit: impl FnMut(usize)) {
    while mask != 0 {
        visit(mask.trailing_zeros() as usize);
        mask &= mask - 1;
    }
}

/// How a tile stores its keys.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum TileKind {
    /// One key for the whole tile.
    #[default]
    Uniform,
    /// One key per pixel.
    Mixed,
}

/// A tile of a key buffer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tile {
    pub(super) kind: TileKind,
    /// Number of pixels that no key covers.
    pub(super) holes: u8,
    /// Key of a uniform tile; in a mixed tile the farthest one, or [`EMPTY`].
    pub(super) key: Key,
    /// Minimum and maximum of each component of the motion vectors that are splatted from this tile.
    pub(super) low: [i32; 2],
    pub(super) high: [i32; 2],
}

impl Tile {
    /// Removes a pixel's key. A uniform tile becomes a mixed one.
    pub(super) fn clear_pixel(&mut self, keys: &mut [Key; BLOCK], extent: [usize; 2], index: usize) {
        if self.kind == TileKind::Uniform {
            keys.fill(EMPTY);
            keys.chunks_mut(TILE).take(extent[1]).for_each(|row| row[..extent[0]].fill(self.key));
            (self.kind, self.holes) = (TileKind::Mixed, 0);
        }
        if keys[index] != EMPTY {
            keys[index] = EMPTY;
            self.holes += 1;
        }
    }
}

/// Splat keys of all pixels of a picture. The 64 keys of a tile are contiguous, eight per row; those outside the
/// picture are [`EMPTY`].
#[derive(Debug, Default)]
pub(super) struct KeyBuffer {
    pub(super) grid: Grid,
    pub(super) tiles: Vec<Tile>,
    /// Keys of mixed tiles; undefined for uniform ones.
    pub(super) keys: Vec<[Key; BLOCK]>,
    /// In tiles with holes, the key that each hole inherited, and [`EMPTY`] for other pixels.
    pub(super) inherited: Vec<[Key; BLOCK]>,
    /// Minimum and maximum vertical motion per row of tiles.
    pub(super) vertical_ranges: Vec<[i32; 2]>,
}

impl KeyBuffer {
    /// Allocates for a picture size; contents stay undefined.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.grid = grid;
        resize(&mut self.tiles, grid.tiles(), Tile::default())?;
        resize(&mut self.keys, grid.tiles(), [EMPTY; BLOCK])?;
        resize(&mut self.vertical_ranges, grid.rows, [0; 2])
    }

    /// The key that covers a pixel; [`EMPTY`] for a hole.
    #[inline(always)]
    pub(super) fn own_key(&self, x: usize, y: usize) -> Key {
        let (tile, index) = self.grid.locate(x, y);
        match self.tiles[tile].kind {
            TileKind::Uniform => self.tiles[tile].key,
            TileKind::Mixed => self.keys[tile][index],
        }
    }

    /// Prefetches the key of the pixel nearest to a position (1/64 px).
    #[inline(always)]
    pub(super) fn prefetch(&self, [x, y]: [i32; 2]) {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        if (x as u32 as usize) < self.grid.width && (y as u32 as usize) < self.grid.height {
            let (tile, index) = self.grid.locate(x as usize, y as usize);
            prefetch(&self.tiles[tile]);
            prefetch(&self.keys[tile][index]);
        }
    }

    /// Prefetches the keys of a tile.
    #[inline(always)]
    pub(super) fn prefetch_keys(keys: &[Key; BLOCK]) {
        keys.as_chunks::<TILE>().0.iter().for_each(prefetch);
    }

    /// The keys of one row of a tile.
    #[inline(always)]
    pub(super) fn tile_row(&self, tile: usize, line: usize) -> [Key; TILE] {
        match self.tiles[tile].kind {
            TileKind::Uniform => [self.tiles[tile].key; TILE],
            TileKind::Mixed => *self.keys[tile][line * TILE..].first_chunk().expect("a tile has eight rows of eight"),
        }
    }

    /// Removes a pixel's key.
    #[cfg(test)]
    pub(super) fn clear_pixel(&mut self, x: usize, y: usize) {
        let (number, index) = self.grid.locate(x, y);
        let extent = self.grid.extent(number % self.grid.columns, number / self.grid.columns);
        self.tiles[number].clear_pixel(&mut self.keys[number], extent, index);
    }

    /// The key of a pixel; for a hole, the one that it inherited.
    #[inline(always)]
    pub(super) fn key_at(&self, x: usize, y: usize) -> Key {
        let own_key = self.own_key(x, y);
        let (tile, index) = self.grid.locate(x, y);
        if own_key == EMPTY { self.inherited[tile][index] } else { own_key }
    }

    /// The keys of a tile with a border of one pixel, [`EMPTY`] outside the picture. `with_inherited` includes
    /// inherited keys of holes.
    #[inline(always)]
    pub(super) fn padded_tile(&self, column: usize, row: usize, with_inherited: bool) -> PaddedTile {
        let Grid { width, height, columns, .. } = self.grid;
        let key = |x: usize, y: usize| if with_inherited { self.key_at(x, y) } else { self.own_key(x, y) };
        let (left, right) = (column * TILE, (column + 1) * TILE);
        let mut padded_tile = [[EMPTY; TILE + 2]; TILE + 2];
        for (j, line) in padded_tile.iter_mut().enumerate() {
            let Some(y) = (row * TILE + j).checked_sub(1).filter(|&y| y < height) else { continue };
            let tile = y / TILE * columns + column;
            if right > width || with_inherited && self.tiles[tile].holes > 0 {
                (left..right.min(width)).zip(&mut line[1..=TILE]).for_each(|(x, to)| *to = key(x, y));
            } else {
                line[1..=TILE].copy_from_slice(&self.tile_row(tile, y % TILE));
            }
            if column > 0 {
                line[0] = key(left - 1, y);
            }
            if right < width {
                line[TILE + 1] = key(right, y);
            }
        }
        padded_tile
    }

    /// The tiles of a range of rows.
    pub(super) fn tile_rows(&self, rows: Range<usize>) -> &[Tile] {
        &self.tiles[rows.start * self.grid.columns..rows.end * self.grid.columns]
    }
}
