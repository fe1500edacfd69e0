//! Telling what lies over the picture and stands still: a HUD, a watermark.
//!
//! Motion of the world behind it does not know an overlay. Where a vector does not match while standing still does, the
//! pixel lies on one.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::colour::Colour;
use super::kernels::{Level, Source, TILE, at_every_level};
use super::layer::Grid;
use super::reserve;
use crate::Result;

/// A pixel lies on an overlay where standing still explains it to within `STILL` levels, and better than its vector
/// does by the factor `BETTER` after a `MARGIN` for noise. Where the vector comes from beyond the edge and there is
/// nothing to compare with, all of the patch must stand still, with a `CONTRAST` that a moving surface would not repeat
/// by chance.
const STILL: f32 = 4.0;
const BETTER: f32 = 2.0;
const MARGIN: f32 = 2.0;
const CONTRAST: f32 = 12.0;

/// The two anchors to compare.
pub(super) struct Overlays<'a, P> {
    pub(super) previous: Source<'a, P>,
    pub(super) current: Source<'a, P>,
}

impl<P: Colour> Overlays<'_, P> {
    /// Whether a pixel of the current anchor lies on an overlay, the world behind it moving by `vector` (current to
    /// previous, in 1/64 px).
    pub(super) fn is_at(&self, at: [usize; 2], vector: [i32; 2]) -> bool {
        is_over(self.current, self.previous, at, vector)
    }

    /// The same for a pixel of the previous anchor.
    pub(super) fn is_before(&self, at: [usize; 2], vector: [i32; 2]) -> bool {
        is_over(self.previous, self.current, at, vector.map(|v| -v))
    }
}

/// Which pixels of the two anchors stand still, found for a tile when that is first asked for. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Stills {
    grid: Grid,
    /// Bit `8 j + i` of a tile: see [`is_still`].
    tiles: Vec<AtomicU64>,
    is_found: Vec<AtomicBool>,
}

impl Stills {
    /// Forgets all, and makes room for the pictures of a grid.
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        self.grid = grid;
        let len = grid.tiles();
        reserve(&mut self.tiles, len)?;
        self.tiles.resize_with(len, AtomicU64::default);
        reserve(&mut self.is_found, len)?;
        self.is_found.resize_with(len, AtomicBool::default);
        self.is_found.iter_mut().for_each(|is_found| *is_found.get_mut() = false);
        Ok(())
    }

    /// Whether a pixel stands still, without which it lies on no overlay.
    #[inline(always)]
    pub(super) fn holds<P: Colour>(&self, level: Level, anchors: &Overlays<'_, P>, [x, y]: [usize; 2]) -> bool {
        self.of_tile(level, anchors, [x / TILE, y / TILE]) >> self.grid.place(x, y).1 & 1 == 1
    }

    /// The same for the pixels of a tile: bit `8 j + i`.
    #[inline(always)]
    pub(super) fn of_tile<P: Colour>(&self, level: Level, anchors: &Overlays<'_, P>, at: [usize; 2]) -> u64 {
        let tile = at[1] * self.grid.columns + at[0];
        if !self.is_found[tile].load(Ordering::Acquire) {
            // Where two threads ask at once, both find the same.
            let stills = stills_of_tile(level, anchors.previous, anchors.current, at.map(|at| at * TILE));
            self.tiles[tile].store(stills, Ordering::Relaxed);
            self.is_found[tile].store(true, Ordering::Release);
        }
        self.tiles[tile].load(Ordering::Relaxed)
    }

    /// The same for 8 x 8 pixels from (x, y) on, all of them on the picture.
    #[inline(always)]
    pub(super) fn from<P: Colour>(&self, level: Level, anchors: &Overlays<'_, P>, [x, y]: [usize; 2]) -> u64 {
        let ([column, i], [row, j]) = ([x / TILE, x % TILE], [y / TILE, y % TILE]);
        // The rows of two tiles above each other, from row j of the upper one on.
        let rows = |column: usize| {
            let upper = self.of_tile(level, anchors, [column, row]) >> (TILE * j);
            if j == 0 { upper } else { upper | self.of_tile(level, anchors, [column, row + 1]) << (TILE * (TILE - j)) }
        };
        if i == 0 {
            return rows(column);
        }
        let from_left = 0x0101_0101_0101_0101 * (0xff >> i);
        rows(column) >> i & from_left | rows(column + 1) << (TILE - i) & !from_left
    }
}

at_every_level! {
    /// The pixels of the tile at `corner` that stand still: bit `8 j + i`.
    fn stills_of_tile<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64
        = stills_one_by_one | stills_side_by_side
}

fn stills_one_by_one<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, [x, y]: [usize; 2]) -> u64 {
    let [across, down] = [TILE.min(current.width - x), TILE.min(current.height - y)];
    let places = (0..down).flat_map(|j| (0..across).map(move |i| (i, j)));
    places.fold(0, |stills, (i, j)| stills | u64::from(is_still(previous, current, [x + i, y + j])) << (TILE * j + i))
}

/// The differences of the pixels of a tile, one more on each side, and some that fill vectors.
type Differences = [[f32; 2 * TILE]; TILE + 2];

#[inline(always)]
fn stills_side_by_side<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let Some(apart) = differences(previous, current, corner) else {
        return stills_one_by_one(previous, current, corner);
    };
    let mut squares = [[0.0; TILE + 2]; TILE + 1];
    for j in 0..TILE + 1 {
        for i in 0..TILE + 2 {
            squares[j][i] = apart[j][i] + apart[j][i + 1] + apart[j + 1][i] + apart[j + 1][i + 1];
        }
    }
    let mut stills = [0; TILE];
    for j in 0..TILE {
        for i in 0..TILE {
            let (above, below) = (squares[j][i].min(squares[j][i + 1]), squares[j + 1][i].min(squares[j + 1][i + 1]));
            let is_still = (above.min(below) / 4.0 <= STILL) & (apart[j + 1][i + 1] <= 4.0 * STILL);
            stills[i] |= u64::from(is_still) << (TILE * j + i);
        }
    }
    stills.into_iter().fold(0, |all, bits| all | bits)
}

/// What the lumas of a tile and of those around it differ by; nothing at the edges of the picture.
#[inline(always)]
fn differences<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, [x, y]: [usize; 2]) -> Option<Differences> {
    if x == 0 || y == 0 || x + TILE >= current.width || y + TILE >= current.height {
        return None;
    }
    let mut apart = [[0.0; 2 * TILE]; TILE + 2];
    for (j, apart) in apart.iter_mut().enumerate() {
        let start = (y + j - 1) * current.width + x - 1;
        let before = previous.pixels[start..].first_chunk::<{ 2 * TILE }>()?;
        let after = current.pixels[start..].first_chunk::<{ 2 * TILE }>()?;
        let (before, after) = (P::lumas_of(before), P::lumas_of(after));
        for i in 0..2 * TILE {
            apart[i] = (after[i] - before[i]).abs();
        }
    }
    Some(apart)
}

/// Whether a pixel is about the same in both pictures, and so is a square of 2 x 2 that holds it: most of what moves is
/// not. This is the first that [`is_over`] asks.
fn is_still<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    let place = y * here.width + x;
    if (here.pixels[place].luma() - there.pixels[place].luma()).abs() > 4.0 * STILL {
        return false;
    }
    let (x, y) = (x as i32, y as i32);
    least_square(&apart(&lumas(here, x - 1, y - 1), &lumas(there, x - 1, y - 1)), there, x, y) <= STILL
}

/// Whether a pixel of `here` stands still and does not come from where `vector` leads to in `there`.
fn is_over<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2], vector: [i32; 2]) -> bool {
    let place = y * here.width + x;
    // Most of what moves does not even stand still at this pixel.
    if vector == [0; 2] || (here.pixels[place].luma() - there.pixels[place].luma()).abs() > 4.0 * STILL {
        return false;
    }
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let apart = apart(&patch, &lumas(there, x - 1, y - 1));
    let still = least_square(&apart, there, x, y);
    if still > STILL {
        return false;
    }
    let from = [64 * x + vector[0], 64 * y + vector[1]];
    let limit = [64 * (here.width as i32 - 1), 64 * (here.height as i32 - 1)];
    if from[0] >= 0 && from[1] >= 0 && from[0] <= limit[0] && from[1] <= limit[1] {
        let moved = difference(&patch, there, x, y, vector);
        (still + MARGIN) * BETTER <= moved
    } else {
        values(&apart).sum::<f32>() / 9.0 <= STILL && contrast(&patch) >= CONTRAST
    }
}

/// Three rows of three lumas, or of what differs between them; the fourth of each row is not of the patch.
type Patch = [[f32; 4]; 3];

/// The values of a patch.
fn values(patch: &Patch) -> impl Iterator<Item = f32> {
    patch.iter().flat_map(|row| &row[..3]).copied()
}

/// Mean absolute difference from the mean.
fn contrast(patch: &Patch) -> f32 {
    let mean = values(patch).sum::<f32>() / 9.0;
    values(patch).map(|v| (v - mean).abs()).sum::<f32>() / 9.0
}

/// Rows of four lumas from (x, y) on; the edge pixels go on beyond the edges.
#[inline(always)]
fn lumas<P: Colour, const N: usize>(source: Source<'_, P>, x: i32, y: i32) -> [[f32; 4]; N] {
    let mut lumas = [[0.0; 4]; N];
    if x >= 0 && y >= 0 && x as usize + 4 <= source.width && y as usize + N <= source.height {
        let pixels = &source.pixels[y as usize * source.width + x as usize..];
        for (lumas, row) in lumas.iter_mut().zip(pixels.chunks(source.width)) {
            if let Some(row) = row.first_chunk() {
                *lumas = P::lumas_of(row);
            }
        }
        return lumas;
    }
    lumas_at_edge(source, x, y)
}

#[inline(never)]
fn lumas_at_edge<P: Colour, const N: usize>(source: Source<'_, P>, x: i32, y: i32) -> [[f32; 4]; N] {
    let mut lumas = [[0.0; 4]; N];
    let on_axis = |at: i32, len: usize| at.clamp(0, len as i32 - 1) as usize;
    for (j, lumas) in (0..).zip(&mut lumas) {
        let row = &source.pixels[on_axis(y + j, source.height) * source.width..][..source.width];
        (0..).zip(lumas).for_each(|(i, luma)| *luma = row[on_axis(x + i, source.width)].luma());
    }
    lumas
}

/// How far `patch`, centred on (x, y) in one picture, is from the place in `there` that `vector` leads to, read
/// bilinearly.
#[inline(always)]
fn difference<P: Colour>(patch: &Patch, there: Source<'_, P>, x: i32, y: i32, vector: [i32; 2]) -> f32 {
    let [u, v] = [64 * (x - 1) + vector[0], 64 * (y - 1) + vector[1]];
    let [fx, fy] = [u, v].map(|at| (at & 63) as f32 / 64.0);
    let lumas: [[f32; 4]; 4] = lumas(there, u >> 6, v >> 6);
    let mut across = [[0.0; 4]; 4];
    for (across, line) in across.iter_mut().zip(&lumas) {
        let next = [line[1], line[2], line[3], line[3]];
        for i in 0..4 {
            across[i] = line[i] + (next[i] - line[i]) * fx;
        }
    }
    let mut between = [[0.0; 4]; 3];
    for j in 0..3 {
        for i in 0..4 {
            between[j][i] = across[j][i] + (across[j + 1][i] - across[j][i]) * fy;
        }
    }
    least_square(&apart(patch, &between), there, x, y)
}

#[inline(always)]
fn apart(a: &Patch, b: &Patch) -> Patch {
    let mut apart = [[0.0; 4]; 3];
    for j in 0..3 {
        for i in 0..4 {
            apart[j][i] = (b[j][i] - a[j][i]).abs();
        }
    }
    apart
}

/// The mean over the best of the four squares of 2 x 2 that hold the centre: a pixel on the rim of a surface is judged by
/// that surface alone.
#[inline(always)]
fn least_square<P>(apart: &Patch, there: Source<'_, P>, x: i32, y: i32) -> f32 {
    let square = |j: usize, i: usize| apart[j][i] + apart[j][i + 1] + apart[j + 1][i] + apart[j + 1][i + 1];
    // A square that reaches over the edge counts pixels twice, and is left out where there is another.
    let is_off = |at: i32, len: usize| len > 1 && [at == 0, at as usize + 1 == len].contains(&true);
    if !is_off(x, there.width) && !is_off(y, there.height) {
        return square(0, 0).min(square(0, 1)).min(square(1, 0)).min(square(1, 1)) / 4.0;
    }
    let starts = |at: i32, len: usize| {
        let at = at as usize;
        usize::from(at == 0 && len > 1)..if at + 1 == len && len > 1 { 1 } else { 2 }
    };
    let squares = starts(y, there.height).flat_map(|j| starts(x, there.width).map(move |i| (j, i)));
    squares.fold(f32::INFINITY, |least, (j, i)| least.min(square(j, i))) / 4.0
}

#[cfg(test)]
mod tests {
    use super::super::kernels::BLOCK;
    use super::*;

    /// A picture of noise, and one of which squares are the same but for a few levels.
    fn pictures(width: usize, height: usize) -> [Vec<[u8; 4]>; 2] {
        let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 13) as u8;
        let first: Vec<_> = (0..width * height).map(|i| [noise(i), noise(i + 7), noise(i + 19), 255]).collect();
        let second = first.iter().enumerate().map(|(i, pixel)| match noise(i % width / 5 + 31 * (i / width / 5)) % 3 {
            0 => [noise(i + 3), noise(i + 5), noise(i + 11), 255],
            step => pixel.map(|v| v.saturating_add(step + noise(i) % 4)),
        });
        let second = second.collect();
        [first, second]
    }

    #[test]
    fn tiles_tell_what_pixels_do() {
        for (width, height) in [(1, 1), (8, 8), (9, 30), (41, 17), (64, 40)] {
            let pictures = pictures(width, height);
            let [previous, current] = [&pictures[0], &pictures[1]].map(|pixels| Source { pixels, width, height });
            let grid = Grid::new((width as u32, height as u32));
            let anchors = Overlays { previous, current };
            for level in Level::available() {
                let mut stills_of = Stills::default();
                stills_of.reserve(grid).unwrap();
                let mut count = 0;
                for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                    let is_still = is_still(previous, current, [x, y]);
                    assert_eq!(stills_of.holds(level, &anchors, [x, y]), is_still, "({x}, {y}), {}", level.name());
                    count += usize::from(is_still);
                    if x + TILE <= width && y + TILE <= height {
                        let places = (0..BLOCK).map(|place| [x + place % TILE, y + place / TILE]);
                        let stills = places.enumerate().fold(0, |stills, (place, at)| {
                            stills | u64::from(stills_of.holds(level, &anchors, at)) << place
                        });
                        assert_eq!(stills_of.from(level, &anchors, [x, y]), stills);
                    }
                    let vectors = [[0, 0], [64, -130], [-700, 9], [20, 5]];
                    assert!(
                        is_still || vectors.iter().all(|&v| !anchors.is_at([x, y], v) && !anchors.is_before([x, y], v))
                    );
                }
                assert!(
                    width * height < 600 || (5 * count > width * height && 10 * count < 9 * width * height),
                    "{count}"
                );
            }
        }
    }
}
