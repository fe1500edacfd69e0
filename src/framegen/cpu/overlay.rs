//! Telling what lies over the picture and stands still: a HUD, a watermark.
//!
//! Motion of the world behind it does not know an overlay. Where a vector does not match while standing still does, the
//! pixel lies on one.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::colour::Colour;
use super::kernels::{Level, Positions, Source, TILE, at_every_level};
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

#[cfg(test)]
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

/// One of the two anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    Previous,
    Current,
}

/// Which pixels of the two anchors stand still, found for a tile when that is first asked for. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Stills {
    grid: Grid,
    /// Whether they are looked for; else nothing stands still.
    is_on: bool,
    /// Bit `8 j + i` of a tile: see [`is_still`].
    tiles: Facts,
    /// The same: see [`is_steady`], for the previous anchor and for the current one.
    steady: [Facts; 2],
}

/// A number to each tile that is found when it is first asked for.
#[derive(Debug, Default)]
struct Facts {
    numbers: Vec<AtomicU64>,
    is_found: Vec<AtomicBool>,
}

impl Facts {
    fn reserve(&mut self, len: usize) -> Result<()> {
        reserve(&mut self.numbers, len)?;
        self.numbers.resize_with(len, AtomicU64::default);
        reserve(&mut self.is_found, len)?;
        self.is_found.resize_with(len, AtomicBool::default);
        self.is_found.iter_mut().for_each(|is_found| *is_found.get_mut() = false);
        Ok(())
    }

    #[inline(always)]
    fn of(&self, tile: usize, find: impl FnOnce() -> u64) -> u64 {
        if !self.is_found[tile].load(Ordering::Acquire) {
            // Where two threads ask at once, both find the same.
            self.numbers[tile].store(find(), Ordering::Relaxed);
            self.is_found[tile].store(true, Ordering::Release);
        }
        self.numbers[tile].load(Ordering::Relaxed)
    }
}

impl Stills {
    /// Forgets all, and makes room for the pictures of a grid.
    pub(super) fn reserve(&mut self, grid: Grid, is_on: bool) -> Result<()> {
        (self.grid, self.is_on) = (grid, is_on);
        self.tiles.reserve(grid.tiles())?;
        self.steady.iter_mut().try_for_each(|steady| steady.reserve(grid.tiles()))
    }

    /// Whether a pixel stands still, without which it lies on no overlay.
    #[inline(always)]
    pub(super) fn holds<P: Colour>(&self, level: Level, anchors: &Overlays<'_, P>, [x, y]: [usize; 2]) -> bool {
        self.of_tile(level, anchors, [x / TILE, y / TILE]) >> self.grid.place(x, y).1 & 1 == 1
    }

    /// [`Self::holds`] for the pixels nearest to some positions, all of them on the picture: those that are asked for, bit
    /// `8 j + i`.
    #[inline(never)]
    pub(super) fn at_each<P: Colour>(
        &self,
        level: Level,
        anchors: &Overlays<'_, P>,
        at: &Positions,
        mut asked: u64,
    ) -> u64 {
        let (mut found, mut last, mut of_last) = (0, [usize::MAX; 2], 0);
        while asked != 0 {
            let place = asked.trailing_zeros();
            asked &= asked - 1;
            let [x, y] = [at.x[place as usize], at.y[place as usize]].map(|v| ((v + 32) >> 6) as usize);
            let tile = [x / TILE, y / TILE];
            if tile != last {
                (last, of_last) = (tile, self.of_tile(level, anchors, tile));
            }
            found |= (of_last >> (y % TILE * TILE + x % TILE) & 1) << place;
        }
        found
    }

    /// Whether a pixel of an anchor lies on an overlay, see [`Overlays`]. The vector is that of the claim, from the current
    /// anchor to the previous one.
    #[inline(always)]
    pub(super) fn is_over<P: Colour>(
        &self,
        level: Level,
        anchors: &Overlays<'_, P>,
        which: Which,
        [x, y]: [usize; 2],
        vector: [i32; 2],
    ) -> bool {
        if !self.holds(level, anchors, [x, y]) || vector == [0; 2] {
            return false;
        }
        let (here, there, vector) = match which {
            Which::Previous => (anchors.previous, anchors.current, vector.map(|v| -v)),
            Which::Current => (anchors.current, anchors.previous, vector),
        };
        if leads_outside(here, [x, y], vector) {
            let ((tile, place), corner) = (self.grid.place(x, y), [x, y].map(|at| at / TILE * TILE));
            return self.steady[which as usize].of(tile, || steady_of_tile(level, here, there, corner)) >> place & 1
                == 1;
        }
        fits_better_at_rest(here, there, [x, y], vector)
    }

    /// The pixels of a tile that stand still: bit `8 j + i`.
    #[inline(always)]
    pub(super) fn of_tile<P: Colour>(&self, level: Level, anchors: &Overlays<'_, P>, at: [usize; 2]) -> u64 {
        if !self.is_on {
            return 0;
        }
        self.tiles.of(at[1] * self.grid.columns + at[0], || {
            stills_of_tile(level, anchors.previous, anchors.current, at.map(|at| at * TILE))
        })
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

at_every_level! {
    /// The pixels of the tile at `corner` of one anchor that are steady: bit `8 j + i`.
    fn steady_of_tile<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64
        = steady_one_by_one | steady_side_by_side
}

fn stills_one_by_one<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64 {
    one_by_one(current, corner, |at| is_still(previous, current, at))
}

fn steady_one_by_one<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64 {
    one_by_one(here, corner, |at| is_steady(here, there, at))
}

fn one_by_one<P>(source: Source<'_, P>, [x, y]: [usize; 2], is: impl Fn([usize; 2]) -> bool) -> u64 {
    let [across, down] = extent(source, [x, y]);
    let places = (0..down).flat_map(|j| (0..across).map(move |i| (i, j)));
    places.fold(0, |all, (i, j)| all | u64::from(is([x + i, y + j])) << (TILE * j + i))
}

/// Pixels across and down of the tile at a corner.
fn extent<P>(source: Source<'_, P>, [x, y]: [usize; 2]) -> [usize; 2] {
    [TILE.min(source.width - x), TILE.min(source.height - y)]
}

/// The pixels of the tile at `corner` that are on the picture: bit `8 j + i`.
#[inline(always)]
fn on_picture<P>(source: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let [across, down] = extent(source, corner);
    (0x0101_0101_0101_0101 * (0xff >> (TILE - across))) & (u64::MAX >> (TILE * (TILE - down)))
}

/// A row of lumas from before a tile on, some of which fill vectors; or of what they differ by.
type Line = [f32; 2 * TILE];

/// The same row from its second value on.
#[inline(always)]
fn next(line: &Line) -> Line {
    let mut next = *line;
    next[..2 * TILE - 1].copy_from_slice(&line[1..]);
    next
}

#[inline(always)]
fn apart_in_line(a: &Line, b: &Line) -> Line {
    let mut apart = [0.0; 2 * TILE];
    for i in 0..2 * TILE {
        apart[i] = (b[i] - a[i]).abs();
    }
    apart
}

#[inline(always)]
fn stills_side_by_side<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let is_at_edge = is_at_edge(current, corner);
    let mut stills = [0; TILE];
    // What the row above differs by, and the least of each two squares between the two rows above.
    let (mut above, mut least_above): (Line, Line) = ([0.0; 2 * TILE], [0.0; 2 * TILE]);
    for j in 0..TILE + 2 {
        let apart = apart_in_line(&line_around(previous, corner, j), &line_around(current, corner, j));
        let (next_above, next_apart) = (next(&above), next(&apart));
        let mut squares: Line = [0.0; 2 * TILE];
        for i in 0..2 * TILE {
            squares[i] = above[i] + next_above[i] + apart[i] + next_apart[i];
        }
        if is_at_edge {
            leave_out_beyond(current, corner, j, &mut squares);
        }
        let next_squares = next(&squares);
        let mut least: Line = [0.0; 2 * TILE];
        for i in 0..2 * TILE {
            least[i] = squares[i].min(next_squares[i]);
        }
        if j > 1 {
            // What is judged is the row above.
            for i in 0..TILE {
                let is_still = (least_above[i].min(least[i]) / 4.0 <= STILL) & (next_above[i] <= 4.0 * STILL);
                stills[i] |= u64::from(is_still) << (TILE * (j - 2) + i);
            }
        }
        (above, least_above) = (apart, least);
    }
    stills.into_iter().fold(0, |all, bits| all | bits) & on_picture(current, corner)
}

/// Whether pixels around a tile lie beyond the picture.
#[inline(always)]
fn is_at_edge<P>(source: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    x == 0 || y == 0 || x + TILE >= source.width || y + TILE >= source.height
}

/// Of the squares above row `j` around a tile, one that reaches over the edge counts pixels twice, and is left out where
/// there is another.
#[inline(never)]
fn leave_out_beyond<P>(source: Source<'_, P>, corner: [usize; 2], j: usize, squares: &mut Line) {
    let size = [source.width, source.height];
    let is_beyond = |c: usize, at: usize| size[c] > 1 && !(2..=size[c]).contains(&(corner[c] + at));
    let is_row_beyond = is_beyond(1, j);
    for (i, square) in squares.iter_mut().enumerate() {
        if is_row_beyond || is_beyond(0, i + 1) {
            *square = f32::INFINITY;
        }
    }
}

#[inline(always)]
fn steady_side_by_side<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let (mut lumas, mut apart) = ([[0.0; 2 * TILE]; TILE + 2], [[0.0; 2 * TILE]; TILE + 2]);
    for j in 0..TILE + 2 {
        lumas[j] = line_around(here, corner, j);
        apart[j] = apart_in_line(&lumas[j], &line_around(there, corner, j));
    }
    let mut steady = [0; TILE];
    for j in 0..TILE {
        let (mut at_rest, mut mean, mut contrast) = ([0.0; TILE], [0.0; TILE], [0.0; TILE]);
        for (lumas, apart) in lumas[j..j + 3].iter().zip(&apart[j..j + 3]) {
            for shift in 0..3 {
                for i in 0..TILE {
                    at_rest[i] += apart[i + shift];
                    mean[i] += lumas[i + shift];
                }
            }
        }
        for sum in &mut mean {
            *sum /= 9.0;
        }
        for lumas in &lumas[j..j + 3] {
            for shift in 0..3 {
                for i in 0..TILE {
                    contrast[i] += (lumas[i + shift] - mean[i]).abs();
                }
            }
        }
        for i in 0..TILE {
            let is_steady = (at_rest[i] / 9.0 <= STILL) & (contrast[i] / 9.0 >= CONTRAST);
            steady[i] |= u64::from(is_steady) << (TILE * j + i);
        }
    }
    steady.into_iter().fold(0, |all, bits| all | bits) & on_picture(here, corner)
}

/// The lumas of row `j` of those around a tile; the edge pixels go on beyond the edges.
#[inline(always)]
fn line_around<P: Colour>(source: Source<'_, P>, [x, y]: [usize; 2], j: usize) -> Line {
    let row = &source.pixels[(y + j).saturating_sub(1).min(source.height - 1) * source.width..][..source.width];
    match row[x.saturating_sub(1)..].first_chunk() {
        Some(row) if x > 0 => P::lumas_of(row),
        _ => P::lumas_of(&at_edge(row, x)),
    }
}

/// The pixels of a row from before `x` on; the edge pixels go on beyond the edges.
#[inline(never)]
fn at_edge<P: Colour>(row: &[P], x: usize) -> [P; 2 * TILE] {
    let mut pixels = [row[row.len() - 1]; 2 * TILE];
    let start = usize::from(x == 0);
    let run = &row[(x + start - 1).min(row.len())..];
    let len = run.len().min(2 * TILE - start);
    pixels[start..start + len].copy_from_slice(&run[..len]);
    if x == 0 {
        pixels[0] = row[0];
    }
    pixels
}

/// Whether a pixel is about the same in both pictures, and so is a square of 2 x 2 that holds it: most of what moves is
/// not.
fn is_still<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    let place = y * here.width + x;
    if (here.pixels[place].luma() - there.pixels[place].luma()).abs() > 4.0 * STILL {
        return false;
    }
    let (x, y) = (x as i32, y as i32);
    least_square(&apart(&lumas(here, x - 1, y - 1), &lumas(there, x - 1, y - 1)), there, x, y) <= STILL
}

#[cfg(test)]
/// Whether a pixel of `here` stands still and does not come from where `vector` leads to in `there`.
fn is_over<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, at: [usize; 2], vector: [i32; 2]) -> bool {
    if vector == [0; 2] || !is_still(here, there, at) {
        return false;
    }
    if leads_outside(here, at, vector) {
        is_steady(here, there, at)
    } else {
        fits_better_at_rest(here, there, at, vector)
    }
}

/// Whether a vector leads from a pixel over the edge of the picture.
#[inline(always)]
fn leads_outside<P>(here: Source<'_, P>, at: [usize; 2], vector: [i32; 2]) -> bool {
    let (size, mut is_outside) = ([here.width, here.height], false);
    for c in 0..2 {
        // As unsigned numbers, what is negative is far beyond.
        is_outside |= (64 * at[c] as i32 + vector[c]) as u32 > 64 * (size[c] as u32 - 1);
    }
    is_outside
}

/// Whether all around a pixel stands still, and has a contrast.
fn is_steady<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let apart = apart(&patch, &lumas(there, x - 1, y - 1));
    values(&apart).sum::<f32>() / 9.0 <= STILL && contrast(&patch) >= CONTRAST
}

/// Whether standing still explains a pixel better than its vector does.
#[inline(never)]
fn fits_better_at_rest<P: Colour>(
    here: Source<'_, P>,
    there: Source<'_, P>,
    [x, y]: [usize; 2],
    vector: [i32; 2],
) -> bool {
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let moved = difference(&patch, there, x, y, vector);
    // Mostly the vector is right.
    if moved < MARGIN * BETTER {
        return false;
    }
    let still = least_square(&apart(&patch, &lumas(there, x - 1, y - 1)), there, x, y);
    (still + MARGIN) * BETTER <= moved
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
                stills_of.reserve(grid, true).unwrap();
                let (mut count, mut over) = (0, 0);
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
                    for vector in [[0, 0], [64, -130], [-700, 9], [20, 5], [0, -64], [90, 3000]] {
                        let is_over = |which| stills_of.is_over(level, &anchors, which, [x, y], vector);
                        let plain = [anchors.is_before([x, y], vector), anchors.is_at([x, y], vector)];
                        assert_eq!(
                            [is_over(Which::Previous), is_over(Which::Current)],
                            plain,
                            "({x}, {y}), {vector:?}"
                        );
                        assert!(is_still || plain == [false; 2]);
                        over += usize::from(plain[0]);
                    }
                }
                assert!(
                    width * height < 600 || (5 * count > width * height && 10 * count < 9 * width * height),
                    "{count}"
                );
                assert!(width * height < 600 || over > 0);
            }
        }
    }
}
