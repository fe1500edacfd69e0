//! A picture's motion in tiles: whole where it is smooth, pixel by pixel where it is not.

use std::ops::Range;

use super::kernels::tile_keys::PaddedTile;
use super::kernels::{BLOCK, TILE, prefetch};
use super::resize;
use super::splat_key::{EMPTY, Key};
use crate::Result;

/// The tiles of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Grid {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Tiles in a row.
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

    /// Pixels across and down of the tile at (column, row): fewer at the far edges.
    pub(super) fn extent(&self, column: usize, row: usize) -> [usize; 2] {
        [TILE.min(self.width - column * TILE), TILE.min(self.height - row * TILE)]
    }

    /// The tile that contains_position a pixel, and its index in it.
    #[inline(always)]
    pub(super) fn locate(&self, x: usize, y: usize) -> (usize, usize) {
        (y / TILE * self.columns + x / TILE, y % TILE * TILE + x % TILE)
    }

    /// Whether a position lies on the picture.
    #[inline(always)]
    pub(super) fn contains_position(&self, [x, y]: [i32; 2]) -> bool {
        // As unsigned numbers, what is negative is far beyond.
        let is_on = |at: i32, len: usize| ((at + 32) as u32) < 64 * len as u32;
        is_on(x, self.width) & is_on(y, self.height)
    }

    /// The pixel nearest_pixel to a position, where that is on the picture.
    #[inline(always)]
    pub(super) fn nearest_pixel(&self, [x, y]: [i32; 2]) -> Option<[usize; 2]> {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        let is_inside = (0..self.width as i32).contains(&x) && (0..self.height as i32).contains(&y);
        is_inside.then_some([x as usize, y as usize])
    }
}

/// How the motion of a tile is held.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum TileKind {
    /// One key for all of the tile.
    #[default]
    Uniform,
    /// A key to a pixel.
    Mixed,
}

/// A tile of a layer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tile {
    pub(super) kind: TileKind,
    /// Places that nothing claims.
    pub(super) holes: u8,
    /// The key_at of a smooth tile; of a rough one the farthest, or [`EMPTY`].
    pub(super) key: Key,
    /// The least and the largest of each component of what moves from here.
    pub(super) low: [i32; 2],
    pub(super) high: [i32; 2],
}

impl Tile {
    /// Takes a pixel of the tile away from its own_key.
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

/// The motion of a picture, tile by tile. The keys of a tile stand together, eight to a row; those of pixels beyond the
/// far edges are [`EMPTY`].
#[derive(Debug, Default)]
pub(super) struct KeyBuffer {
    pub(super) grid: Grid,
    pub(super) tiles: Vec<Tile>,
    /// Keys of rough tiles; those of others are left over from other pictures.
    pub(super) keys: Vec<[Key; BLOCK]>,
    /// In tiles with holes, a inherited key for each of them, and [`EMPTY`] elsewhere.
    pub(super) inherited: Vec<[Key; BLOCK]>,
    /// For each row of tiles the least and the largest vertical component.
    pub(super) vertical_ranges: Vec<[i32; 2]>,
}

impl KeyBuffer {
    /// Makes room for a picture's keys; what they hold is left over.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.grid = grid;
        resize(&mut self.tiles, grid.tiles(), Tile::default())?;
        resize(&mut self.keys, grid.tiles(), [EMPTY; BLOCK])?;
        resize(&mut self.vertical_ranges, grid.rows, [0; 2])
    }

    /// What claims a pixel by itself; [`EMPTY`] where nothing does.
    #[inline(always)]
    pub(super) fn own_key(&self, x: usize, y: usize) -> Key {
        let (tile, index) = self.grid.locate(x, y);
        match self.tiles[tile].kind {
            TileKind::Uniform => self.tiles[tile].key,
            TileKind::Mixed => self.keys[tile][index],
        }
    }

    /// Asks for what claims the pixel nearest_pixel to a position (1/64 px), if there is one.
    #[inline(always)]
    pub(super) fn prefetch(&self, [x, y]: [i32; 2]) {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        if (x as u32 as usize) < self.grid.width && (y as u32 as usize) < self.grid.height {
            let (tile, index) = self.grid.locate(x as usize, y as usize);
            prefetch(&self.tiles[tile]);
            prefetch(&self.keys[tile][index]);
        }
    }

    /// Asks for the keys of a tile.
    #[inline(always)]
    pub(super) fn prefetch_keys(keys: &[Key; BLOCK]) {
        keys.as_chunks::<TILE>().0.iter().for_each(prefetch);
    }

    /// The keys of a row of a tile.
    #[inline(always)]
    pub(super) fn tile_row(&self, tile: usize, line: usize) -> [Key; TILE] {
        match self.tiles[tile].kind {
            TileKind::Uniform => [self.tiles[tile].key; TILE],
            TileKind::Mixed => *self.keys[tile][line * TILE..].first_chunk().expect("a tile has eight rows of eight"),
        }
    }

    /// Takes a pixel away from its own_key.
    pub(super) fn clear_pixel(&mut self, x: usize, y: usize) {
        let (number, index) = self.grid.locate(x, y);
        let extent = self.grid.extent(number % self.grid.columns, number / self.grid.columns);
        self.tiles[number].clear_pixel(&mut self.keys[number], extent, index);
    }

    /// What claims a pixel: its own_key, or what it with_inherited.
    #[inline(always)]
    pub(super) fn key_at(&self, x: usize, y: usize) -> Key {
        let own_key = self.own_key(x, y);
        let (tile, index) = self.grid.locate(x, y);
        if own_key == EMPTY { self.inherited[tile][index] } else { own_key }
    }

    /// The claims of a tile's pixels with one more on each side, [`EMPTY`] beyond the edges. With `with_inherited`, places that
    /// nothing claims have what they borrow.
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

    /// The tiles of some rows.
    pub(super) fn tile_rows(&self, rows: Range<usize>) -> &[Tile] {
        &self.tiles[rows.start * self.grid.columns..rows.end * self.grid.columns]
    }
}
