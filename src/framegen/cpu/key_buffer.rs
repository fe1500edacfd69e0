//! A picture's motion in tiles: whole where it is smooth, pixel by pixel where it is not.

use std::ops::Range;

use super::kernels::tile_keys::Around;
use super::kernels::{BLOCK, TILE, fetch};
use super::sized;
use crate::Result;

/// What claims a place, in one number of which the smallest wins: rank of depth (16 bits), mark (8), and both
/// components of the vector in 1/64 px, 2^19 being none (20 each). As it holds all that counts, equal keys are the same
/// claim, and the order in which claims arrive changes nothing.
pub(super) type Key = u64;

/// A place that nothing claims.
pub(super) const EMPTY: Key = Key::MAX;
/// The largest mark that says how badly a pixel matches the previous anchor.
pub(super) const WORST_MATCH: u8 = 250;
/// The mark of a place of the previous anchor that no pixel of the current one comes from.
pub(super) const ORPHAN: u8 = 254;
/// The mark of a place between the anchors that nothing lands on.
pub(super) const HOLE: u8 = 255;

const ORIGIN: i32 = 1 << 19;
const COMPONENT: Key = (1 << 20) - 1;

pub(super) fn key(rank: u16, mark: u8, [x, y]: [i32; 2]) -> Key {
    let component = |v: i32| (v + ORIGIN) as Key & COMPONENT;
    Key::from(rank) << 48 | Key::from(mark) << 40 | component(x) << 20 | component(y)
}

/// From the current anchor to the previous one, in 1/64 px.
#[inline(always)]
pub(super) fn vector(key: Key) -> [i32; 2] {
    [(key >> 20 & COMPONENT) as i32 - ORIGIN, (key & COMPONENT) as i32 - ORIGIN]
}

/// 0 is nearest.
#[inline(always)]
pub(super) fn rank(key: Key) -> u16 {
    (key >> 48) as u16
}

#[inline(always)]
pub(super) fn mark(key: Key) -> u8 {
    (key >> 40) as u8
}

/// `key` with another mark.
pub(super) fn marked(key: Key, mark: u8) -> Key {
    key & !(0xff << 40) | Key::from(mark) << 40
}

/// Vectors of one surface differ by no more than this from pixel to pixel along an axis, in 1/64 px.
pub(super) const ALIKE: i32 = 64;

/// Whether two claims move so much alike that they can lie on one surface.
#[inline(always)]
pub(super) fn alike(a: Key, b: Key) -> bool {
    moves_within(a, b, ALIKE)
}

/// Whether two claims move by no more than `limit` of 1/64 px otherwise along each axis.
#[inline(always)]
pub(super) fn moves_within(a: Key, b: Key, limit: i32) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= limit && (ay - by).abs() <= limit
}

/// Ranks that differ by no more than this can lie on one surface: 1/64 of the distance.
pub(super) const SAME_RANK: u16 = 32;

/// Whether `a` is in front of `b` by more than a slope makes.
#[inline(always)]
pub(super) fn is_nearer(a: Key, b: Key) -> bool {
    rank(a).saturating_add(SAME_RANK) < rank(b)
}

/// Vectors of one surface that slopes differ by no more than this from tile to tile, in 1/64 px.
pub(super) const SLOPE: i32 = 256;
/// Surfaces whose ranks differ by no more than this can be one that slopes: an octave of distance.
pub(super) const ONE_SURFACE: u16 = 2048;

/// Whether the claims of two tiles can be parts of one surface that slopes.
#[inline(always)]
pub(super) fn slopes(a: Key, b: Key) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= SLOPE && (ay - by).abs() <= SLOPE && rank(a).abs_diff(rank(b)) <= ONE_SURFACE
}

/// Reaches and phases are in parts of this: the whole way between two anchors.
pub(super) const WHOLE: i32 = 1 << 12;
/// Vectors are kept within this, in 1/64 px, so that a reach of them can be computed in 32 bits.
pub(super) const LONGEST: i32 = 4095 * 64;

/// `reach` of a component of a vector, in 1/64 px.
#[inline(always)]
pub(super) fn part(component: i32, reach: i32) -> i32 {
    // Of what claims nothing the vector is longer than any; its parts are not used.
    component.wrapping_mul(reach).wrapping_add(WHOLE / 2) >> 12
}

/// Where `reach` of a component of a vector carries: from a whole pixel to the nearest whole pixel.
#[inline(always)]
pub(super) fn landed(from: i32, component: i32, reach: i32) -> i32 {
    (64 * from + part(component, reach) + 32) >> 6
}

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

    /// The tile that holds a pixel, and its place in it.
    #[inline(always)]
    pub(super) fn place(&self, x: usize, y: usize) -> (usize, usize) {
        (y / TILE * self.columns + x / TILE, y % TILE * TILE + x % TILE)
    }

    /// Whether a position lies on the picture.
    #[inline(always)]
    pub(super) fn holds(&self, [x, y]: [i32; 2]) -> bool {
        // As unsigned numbers, what is negative is far beyond.
        let is_on = |at: i32, len: usize| ((at + 32) as u32) < 64 * len as u32;
        is_on(x, self.width) & is_on(y, self.height)
    }

    /// The pixel nearest to a position, where that is on the picture.
    #[inline(always)]
    pub(super) fn nearest(&self, [x, y]: [i32; 2]) -> Option<[usize; 2]> {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        let is_inside = (0..self.width as i32).contains(&x) && (0..self.height as i32).contains(&y);
        is_inside.then_some([x as usize, y as usize])
    }
}

/// How the motion of a tile is held.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Kind {
    /// One key for all of the tile.
    #[default]
    Smooth,
    /// A key to a pixel.
    Rough,
}

/// A tile of a layer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tile {
    pub(super) kind: Kind,
    /// Places that nothing claims.
    pub(super) holes: u8,
    /// The claim of a smooth tile; of a rough one the farthest, or [`EMPTY`].
    pub(super) key: Key,
    /// The least and the largest of each component of what moves from here.
    pub(super) low: [i32; 2],
    pub(super) high: [i32; 2],
}

impl Tile {
    /// Takes a pixel of the tile away from its owner.
    pub(super) fn free(&mut self, keys: &mut [Key; BLOCK], extent: [usize; 2], place: usize) {
        if self.kind == Kind::Smooth {
            keys.fill(EMPTY);
            keys.chunks_mut(TILE).take(extent[1]).for_each(|row| row[..extent[0]].fill(self.key));
            (self.kind, self.holes) = (Kind::Rough, 0);
        }
        if keys[place] != EMPTY {
            keys[place] = EMPTY;
            self.holes += 1;
        }
    }
}

/// The motion of a picture, tile by tile. The keys of a tile stand together, eight to a row; those of pixels beyond the
/// far edges are [`EMPTY`].
#[derive(Debug, Default)]
pub(super) struct Layer {
    pub(super) grid: Grid,
    pub(super) tiles: Vec<Tile>,
    /// Keys of rough tiles; those of others are left over from other pictures.
    pub(super) keys: Vec<[Key; BLOCK]>,
    /// In tiles with holes, a borrowed key for each of them, and [`EMPTY`] elsewhere.
    pub(super) borrowed: Vec<[Key; BLOCK]>,
    /// For each row of tiles the least and the largest vertical component.
    pub(super) spans: Vec<[i32; 2]>,
}

impl Layer {
    /// Makes room for a picture's keys; what they hold is left over.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.grid = grid;
        sized(&mut self.tiles, grid.tiles(), Tile::default())?;
        sized(&mut self.keys, grid.tiles(), [EMPTY; BLOCK])?;
        sized(&mut self.spans, grid.rows, [0; 2])
    }

    /// What claims a pixel by itself; [`EMPTY`] where nothing does.
    #[inline(always)]
    pub(super) fn owner(&self, x: usize, y: usize) -> Key {
        let (tile, place) = self.grid.place(x, y);
        match self.tiles[tile].kind {
            Kind::Smooth => self.tiles[tile].key,
            Kind::Rough => self.keys[tile][place],
        }
    }

    /// Asks for what claims the pixel nearest to a position (1/64 px), if there is one.
    #[inline(always)]
    pub(super) fn fetch(&self, [x, y]: [i32; 2]) {
        let (x, y) = ((x + 32) >> 6, (y + 32) >> 6);
        if (x as u32 as usize) < self.grid.width && (y as u32 as usize) < self.grid.height {
            let (tile, place) = self.grid.place(x as usize, y as usize);
            fetch(&self.tiles[tile]);
            fetch(&self.keys[tile][place]);
        }
    }

    /// Asks for the keys of a tile.
    #[inline(always)]
    pub(super) fn fetch_keys(keys: &[Key; BLOCK]) {
        keys.as_chunks::<TILE>().0.iter().for_each(fetch);
    }

    /// The keys of a row of a tile.
    #[inline(always)]
    pub(super) fn line(&self, tile: usize, line: usize) -> [Key; TILE] {
        match self.tiles[tile].kind {
            Kind::Smooth => [self.tiles[tile].key; TILE],
            Kind::Rough => *self.keys[tile][line * TILE..].first_chunk().expect("a tile has eight rows of eight"),
        }
    }

    /// Takes a pixel away from its owner.
    pub(super) fn free(&mut self, x: usize, y: usize) {
        let (number, place) = self.grid.place(x, y);
        let extent = self.grid.extent(number % self.grid.columns, number / self.grid.columns);
        self.tiles[number].free(&mut self.keys[number], extent, place);
    }

    /// What claims a pixel: its owner, or what it borrows.
    #[inline(always)]
    pub(super) fn claim(&self, x: usize, y: usize) -> Key {
        let owner = self.owner(x, y);
        let (tile, place) = self.grid.place(x, y);
        if owner == EMPTY { self.borrowed[tile][place] } else { owner }
    }

    /// The claims of a tile's pixels with one more on each side, [`EMPTY`] beyond the edges. With `borrows`, places that
    /// nothing claims have what they borrow.
    #[inline(always)]
    pub(super) fn around(&self, column: usize, row: usize, borrows: bool) -> Around {
        let Grid { width, height, columns, .. } = self.grid;
        let claim = |x: usize, y: usize| if borrows { self.claim(x, y) } else { self.owner(x, y) };
        let (left, right) = (column * TILE, (column + 1) * TILE);
        let mut around = [[EMPTY; TILE + 2]; TILE + 2];
        for (j, line) in around.iter_mut().enumerate() {
            let Some(y) = (row * TILE + j).checked_sub(1).filter(|&y| y < height) else { continue };
            let tile = y / TILE * columns + column;
            if right > width || borrows && self.tiles[tile].holes > 0 {
                (left..right.min(width)).zip(&mut line[1..=TILE]).for_each(|(x, key)| *key = claim(x, y));
            } else {
                line[1..=TILE].copy_from_slice(&self.line(tile, y % TILE));
            }
            if column > 0 {
                line[0] = claim(left - 1, y);
            }
            if right < width {
                line[TILE + 1] = claim(right, y);
            }
        }
        around
    }

    /// The tiles of some rows.
    pub(super) fn row(&self, rows: Range<usize>) -> &[Tile] {
        &self.tiles[rows.start * self.grid.columns..rows.end * self.grid.columns]
    }
}
