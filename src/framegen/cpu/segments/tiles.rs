//! Segments: sets of pixels of one tile that move together.

use std::cmp::Ordering;

use super::super::kernels::{BLOCK, TILE};
use super::super::layer::{self, ALIKE, Grid, Key, is_nearer};
use super::super::sized;
use crate::Result;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Maximum number of segments of a tile.
pub(super) const SLOTS: usize = 8;
/// Maximum number of segments in and around a tile that are told apart.
pub(super) const FRONTS: usize = 16;
/// Pixels of the first column of a tile.
const COLUMN: u64 = 0x0101_0101_0101_0101;

/// Pixels of one tile that have one motion vector and one depth. Bit `8 j + i` of a mask is pixel `i` of row `j`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Segment {
    pub(super) mask: u64,
    /// From the current anchor to the previous one, in 1/64 px.
    pub(super) vector: [i32; 2],
    /// Depth, 0 nearest; see [`layer::rank`].
    pub(super) rank: u16,
    /// Matching error, [`layer::ORPHAN`] or [`layer::HOLE`].
    pub(super) mark: u8,
}

impl Segment {
    /// A segment of all that `key` says.
    #[inline(always)]
    pub(super) fn new(key: Key, mask: u64) -> Self {
        Self { mask, vector: layer::vector(key), rank: layer::rank(key), mark: layer::mark(key) }
    }

    /// All that orders segments, in one number: the nearest first.
    #[inline(always)]
    pub(super) fn key(&self) -> Key {
        layer::key(self.rank, self.mark, self.vector)
    }

    /// Whether both move alike, to `limit` of 1/64 px along each axis.
    #[inline(always)]
    pub(super) fn moves_within(&self, other: &Self, limit: i32) -> bool {
        (0..2).all(|c| (self.vector[c] - other.vector[c]).abs() <= limit)
    }
}

/// The segments of every tile of a picture. The first ones are stored together, because most tiles have only that.
#[derive(Debug, Default)]
pub(super) struct Segments {
    pub(super) grid: Grid,
    first: Vec<Segment>,
    more: Vec<[Segment; SLOTS - 1]>,
    count: Vec<u8>,
    /// For each row of tiles the least and the largest vertical component.
    spans: Vec<[i32; 2]>,
}

/// Some rows of tiles, writable. Tiles are numbered from the first one.
pub(super) struct TilesMut<'a> {
    columns: usize,
    first: &'a mut [Segment],
    more: &'a mut [[Segment; SLOTS - 1]],
    count: &'a mut [u8],
    spans: &'a mut [[i32; 2]],
}

impl Segments {
    /// Makes room for the tiles of `grid`; their content is undefined.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.grid = grid;
        sized(&mut self.first, grid.tiles(), Segment::default())?;
        sized(&mut self.more, grid.tiles(), [Segment::default(); SLOTS - 1])?;
        sized(&mut self.count, grid.tiles(), 0)?;
        sized(&mut self.spans, grid.rows, [0; 2])
    }

    /// Number of segments of a tile.
    #[inline(always)]
    pub(super) fn count(&self, tile: usize) -> usize {
        self.count[tile].into()
    }

    /// The first segment of a tile, which has one.
    #[inline(always)]
    pub(super) fn first(&self, tile: usize) -> &Segment {
        &self.first[tile]
    }

    /// The segments of a tile.
    #[inline(always)]
    pub(super) fn of(&self, tile: usize) -> impl Iterator<Item = &Segment> {
        let count = self.count(tile);
        let (first, more) = (&self.first[tile..][..count.min(1)], &self.more[tile][..count.saturating_sub(1)]);
        first.iter().chain(more)
    }

    /// Pixels of a tile that some segment has.
    #[inline(always)]
    pub(super) fn covered(&self, tile: usize) -> u64 {
        self.of(tile).fold(0, |all, segment| all | segment.mask)
    }

    /// The segment that has a pixel.
    #[inline(always)]
    pub(super) fn at(&self, [x, y]: [usize; 2]) -> Option<&Segment> {
        let (tile, pixel) = self.grid.place(x, y);
        self.of(tile).find(|segment| segment.mask >> pixel & 1 == 1)
    }

    /// Takes a pixel away from its segment.
    pub(super) fn remove(&mut self, x: usize, y: usize) {
        let (tile, pixel) = self.grid.place(x, y);
        self.first[tile].mask &= !(1 << pixel);
        self.more[tile].iter_mut().for_each(|segment| segment.mask &= !(1 << pixel));
    }

    /// The least and the largest vertical component of a row of tiles.
    pub(super) fn span(&self, row: usize) -> [i32; 2] {
        self.spans[row]
    }

    /// All tiles in parallel, writable, `rows` rows at a time.
    pub(super) fn par_rows_mut(&mut self, rows: usize) -> impl Parallel<Item = TilesMut<'_>> {
        let columns = self.grid.columns;
        let len = rows * columns;
        let tiles = self.first.par_chunks_mut(len).zip(self.more.par_chunks_mut(len));
        Rows(tiles.zip(self.count.par_chunks_mut(len)).zip(self.spans.par_chunks_mut(rows)), columns)
    }

    /// Whether some segment in or around a tile moves differently from the tile's first one.
    pub(super) fn is_mixed_around(&self, [column, row]: [usize; 2]) -> bool {
        let own = self.first(row * self.grid.columns + column);
        (row.saturating_sub(1)..(row + 2).min(self.grid.rows)).any(|v| {
            (column.saturating_sub(1)..(column + 2).min(self.grid.columns)).any(|u| {
                let tile = v * self.grid.columns + u;
                self.count(tile) > 1 || self.count(tile) == 1 && !self.first(tile).moves_within(own, ALIKE)
            })
        })
    }

    /// Which pixels of the 8 x 8 block at the pixel `at`, which may lie partly outside, belong to segments that `is` accepts.
    #[inline(always)]
    pub(super) fn matching(&self, at: [i32; 2], is: impl Fn(&Segment) -> bool) -> u64 {
        block(self.grid, at, |column, row| {
            let tile = row * self.grid.columns + column;
            let count = self.count(tile);
            let mut mask = if count > 0 && is(&self.first[tile]) { self.first[tile].mask } else { 0 };
            if count > 1 {
                for segment in &self.more[tile][..count - 1] {
                    mask |= if is(segment) { segment.mask } else { 0 };
                }
            }
            mask
        })
    }

    /// Whether a tile is one segment.
    #[inline(always)]
    pub(super) fn is_whole(&self, tile: usize) -> bool {
        self.count(tile) == 1 && self.first(tile).mask == u64::MAX
    }
}

/// The mask of the 8 x 8 block at the pixel `at`, which may lie partly outside, given those of the tiles of a grid.
#[inline(always)]
pub(super) fn block(grid: Grid, [x, y]: [i32; 2], mut of_tile: impl FnMut(usize, usize) -> u64) -> u64 {
    let [column, row] = [x >> 3, y >> 3];
    let [s, t] = [(x & 7) as u32, (y & 7) as u32];
    let mut mask = 0;
    for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let ([column, row], is_used) = ([column + dx, row + dy], (dx == 0 || s > 0) && (dy == 0 || t > 0));
        // As unsigned numbers, negative ones fail the check.
        let is_inside = (column as u32 as usize) < grid.columns && (row as u32 as usize) < grid.rows;
        if !is_used || !is_inside {
            continue;
        }
        let found = of_tile(column as usize, row as usize);
        let across = if dx == 0 { shifted_left(found, s) } else { shifted_right(found, 8 - s) };
        mask |= if dy == 0 { across >> (8 * t) } else { across << (8 * (8 - t)) };
    }
    mask
}

/// A segment in or around a tile.
#[derive(Clone, Copy, Default)]
pub(super) struct Front {
    /// [`Segment::key`].
    pub(super) key: Key,
    /// Pixels of the tile within one pixel of it.
    pub(super) zone: u64,
}

/// What of a key is not depth.
const BUT_RANK: Key = (1 << 48) - 1;

impl Segments {
    /// The segments in and around a tile that come within one pixel of pixels `asked` for, the nearest first. Only of those that are in front of `behind`;
    /// returns their number.
    pub(super) fn around(
        &self,
        [column, row]: [usize; 2],
        asked: u64,
        behind: Key,
        fronts: &mut [Front; FRONTS],
    ) -> usize {
        let mut count = 0;
        for v in row.saturating_sub(1)..(row + 2).min(self.grid.rows) {
            for u in column.saturating_sub(1)..(column + 2).min(self.grid.columns) {
                for segment in self.of(v * self.grid.columns + u) {
                    let mask = match u.cmp(&column) {
                        Ordering::Less => shifted_left(segment.mask, 7),
                        Ordering::Equal => {
                            segment.mask | shifted_left(segment.mask, 1) | shifted_right(segment.mask, 1)
                        }
                        Ordering::Greater => shifted_right(segment.mask, 7),
                    };
                    let zone = match v.cmp(&row) {
                        Ordering::Less => mask >> 56,
                        Ordering::Equal => mask | mask << 8 | mask >> 8,
                        Ordering::Greater => mask << 56,
                    };
                    let key = segment.key();
                    if zone & asked == 0 || key >= behind {
                        continue;
                    }
                    match fronts[..count].iter_mut().find(|front| (front.key ^ key) & BUT_RANK == 0) {
                        Some(front) => *front = Front { key: front.key.min(key), zone: front.zone | zone },
                        None if count < FRONTS => {
                            fronts[count] = Front { key, zone };
                            count += 1;
                        }
                        None => {}
                    }
                }
            }
        }
        for end in 1..count {
            let front = fronts[end];
            let mut at = end;
            while at > 0 && fronts[at - 1].key > front.key {
                fronts[at] = fronts[at - 1];
                at -= 1;
            }
            fronts[at] = front;
        }
        count
    }
}

/// Turns nested pairs into [`TilesMut`].
struct Rows<R>(R, usize);

// SAFETY: items are those of the wrapped iterator.
unsafe impl<'a, R> Parallel for Rows<R>
where
    R: Parallel<Item = (((&'a mut [Segment], &'a mut [[Segment; SLOTS - 1]]), &'a mut [u8]), &'a mut [[i32; 2]])>,
{
    type Item = TilesMut<'a>;

    fn len(&self) -> usize {
        self.0.len()
    }

    unsafe fn item(&self, index: usize) -> TilesMut<'a> {
        // SAFETY: the caller's promise.
        let (((first, more), count), spans) = unsafe { self.0.item(index) };
        TilesMut { columns: self.1, first, more, count, spans }
    }
}

impl TilesMut<'_> {
    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.spans.len()
    }

    /// Writes the segments of a tile, at most [`SLOTS`].
    #[inline(always)]
    pub(super) fn set(&mut self, tile: usize, segments: &[Segment]) {
        self.count[tile] = segments.len() as u8;
        if let Some((first, more)) = segments.split_first() {
            self.first[tile] = *first;
            self.more[tile][..more.len()].copy_from_slice(more);
        }
    }

    /// Adds a segment to a tile. A tile that is full gets its pixels for the segment whose motion is most similar.
    pub(super) fn add(&mut self, tile: usize, segment: Segment) {
        let count = usize::from(self.count[tile]);
        match count {
            0 => self.first[tile] = segment,
            1..SLOTS => self.more[tile][count - 1] = segment,
            _ => {
                let more = self.more[tile].iter_mut();
                let all = std::iter::once(&mut self.first[tile]).chain(more);
                let apart = |a: &Segment| (0..2).map(|c| (a.vector[c] - segment.vector[c]).abs()).sum::<i32>();
                if let Some(similar) = all.min_by_key(|a| apart(a)) {
                    similar.mask |= segment.mask;
                }
                return;
            }
        }
        self.count[tile] += 1;
    }

    /// Writes the segments of a tile of `from`.
    #[inline(always)]
    pub(super) fn copy(&mut self, tile: usize, from: &Segments, from_tile: usize) {
        let count = from.count(from_tile);
        self.count[tile] = count as u8;
        if count > 0 {
            self.first[tile] = from.first[from_tile];
            let more = count - 1;
            self.more[tile][..more].copy_from_slice(&from.more[from_tile][..more]);
        }
    }

    /// Gives pixels to the segment of a tile that moves like `segment`, or adds it.
    pub(super) fn join(&mut self, tile: usize, segment: Segment) {
        let count = usize::from(self.count[tile]);
        let more = self.more[tile].iter_mut().take(count.saturating_sub(1));
        let mut all = self.first[tile..].iter_mut().take(count.min(1)).chain(more);
        match all.find(|other| {
            other.mask != 0 && other.moves_within(&segment, ALIKE) && !is_nearer(segment.key(), other.key())
        }) {
            Some(similar) => similar.mask |= segment.mask,
            None => self.add(tile, segment),
        }
    }

    /// The segments of a tile.
    #[inline(always)]
    pub(super) fn of(&self, tile: usize) -> impl Iterator<Item = &Segment> {
        let count = usize::from(self.count[tile]);
        let (first, more) = (&self.first[tile..][..count.min(1)], &self.more[tile][..count.saturating_sub(1)]);
        first.iter().chain(more)
    }

    /// Takes pixels away from the segments of a tile; empty segments stay.
    pub(super) fn remove(&mut self, tile: usize, mask: u64) {
        self.first[tile].mask &= !mask;
        self.more[tile].iter_mut().for_each(|segment| segment.mask &= !mask);
    }

    /// Finds the vertical span of every row.
    pub(super) fn find_spans(&mut self) {
        for row in 0..self.rows() {
            let mut span = [i32::MAX, i32::MIN];
            for tile in row * self.columns..(row + 1) * self.columns {
                for segment in self.of(tile) {
                    span = [span[0].min(segment.vector[1]), span[1].max(segment.vector[1])];
                }
            }
            self.spans[row] = span;
        }
    }
}

/// The pixels of a tile of `extent` that lie on the picture.
#[inline(always)]
pub(super) fn inside([across, down]: [usize; 2]) -> u64 {
    ((0xff >> (TILE - across)) * COLUMN) & (u64::MAX >> (TILE * (TILE - down)))
}

/// `mask` with every pixel moved to the right by 0 to 8 pixels; what leaves the tile is dropped.
#[inline(always)]
pub(super) fn shifted_right(mask: u64, by: u32) -> u64 {
    if by > 7 { 0 } else { (mask << by) & (COLUMN * (0xff << by & 0xff)) }
}

/// The same to the left.
#[inline(always)]
pub(super) fn shifted_left(mask: u64, by: u32) -> u64 {
    if by > 7 { 0 } else { (mask >> by) & (COLUMN * (0xff >> by)) }
}

/// The parts of `mask` in four tiles after a move by `s` and `t` of 0 to 7 pixels to the right and down: own tile, right, below, below right.
#[inline(always)]
pub(super) fn split(mask: u64, s: u32, t: u32) -> [u64; 4] {
    let (left, right) = (shifted_right(mask, s), if s == 0 { 0 } else { shifted_left(mask, 8 - s) });
    let down = |mask: u64| [mask << (8 * t), if t == 0 { 0 } else { mask >> (8 * (8 - t)) }];
    let ([a, c], [b, d]) = (down(left), down(right));
    [a, b, c, d]
}

/// Calls `visit` for each pixel of a mask, in order.
#[inline(always)]
pub(super) fn each(mut mask: u64, mut visit: impl FnMut(usize)) {
    while mask != 0 {
        visit(mask.trailing_zeros() as usize);
        mask &= mask - 1;
    }
}

/// Column and row of a pixel of a tile.
#[inline(always)]
pub(super) fn place(pixel: usize) -> [usize; 2] {
    debug_assert!(pixel < BLOCK);
    [pixel % TILE, pixel / TILE]
}
