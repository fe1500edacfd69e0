//! Detection of static overlays such as HUDs and watermarks.
//!
//! An overlay does not follow the motion of the scene behind it. Where two anchors match at the same position but not
//! along the motion vector, the pixel belongs to an overlay.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::colour::Colour;
use super::kernels::{Positions, SimdLevel, Source, TILE, at_every_level};
use super::key_buffer::{Grid, tile_mask};
use super::reserve;
use crate::Result;

/// A pixel belongs to an overlay if it differs by at most `MAX_STATIC_DIFFERENCE` levels from the same position, and by
/// less than along its motion vector by the factor `RATIO` after adding `NOISE` to the static difference. The static
/// pixels of the patch around it must differ along the vector by `MIN_MISMATCH` levels, as an inexact vector on a smooth
/// surface does not. If the vector leads outside the picture, the whole patch must be static and have `MIN_CONTRAST`,
/// which a moving surface would not repeat by chance.
const MAX_STATIC_DIFFERENCE: f32 = 4.0;
const RATIO: f32 = 2.0;
const NOISE: f32 = 2.0;
const MIN_MISMATCH: f32 = 18.0;
const MIN_CONTRAST: f32 = 12.0;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "STATIC_OVERLAY_": float MAX_STATIC_DIFFERENCE, float RATIO, float NOISE, float MIN_MISMATCH, float MIN_CONTRAST
);

/// The two anchors.
pub(super) struct Anchors<'a, P> {
    pub(super) previous: Source<'a, P>,
    pub(super) current: Source<'a, P>,
}

#[cfg(test)]
impl<P: Colour> Anchors<'_, P> {
    /// Whether a pixel of the current anchor belongs to an overlay; `vector` is the motion of the scene behind it
    /// (current to previous, 1/64 px).
    pub(super) fn is_overlay_in_current(&self, at: [usize; 2], vector: [i32; 2]) -> bool {
        is_overlay(self.current, self.previous, at, vector)
    }

    /// The same for a pixel of the previous anchor.
    pub(super) fn is_overlay_in_previous(&self, at: [usize; 2], vector: [i32; 2]) -> bool {
        is_overlay(self.previous, self.current, at, vector.map(|v| -v))
    }
}

/// One of the two anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AnchorIndex {
    Previous,
    Current,
}

/// Static pixels of the anchors, computed per tile on first use. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct StaticPixels {
    grid: Grid,
    /// Whether they are searched for; otherwise no pixel is static.
    is_on: bool,
    /// Bits `8 j + i`: see [`is_static`].
    tiles: LazyMasks,
    /// Bits `8 j + i`: see [`is_static_patch`], for the previous and the current anchor.
    static_patches: [LazyMasks; 2],
}

/// A mask per tile that is computed on first use.
#[derive(Debug, Default)]
struct LazyMasks {
    masks: Vec<AtomicU64>,
    is_found: Vec<AtomicBool>,
}

impl LazyMasks {
    fn reserve(&mut self, len: usize) -> Result<()> {
        reserve(&mut self.masks, len)?;
        self.masks.resize_with(len, AtomicU64::default);
        reserve(&mut self.is_found, len)?;
        self.is_found.resize_with(len, AtomicBool::default);
        self.is_found.iter_mut().for_each(|is_found| *is_found.get_mut() = false);
        Ok(())
    }

    #[inline(always)]
    fn of(&self, tile: usize, find: impl FnOnce() -> u64) -> u64 {
        if !self.is_found[tile].load(Ordering::Acquire) {
            // Two threads may compute it at once; the result is the same.
            self.masks[tile].store(find(), Ordering::Relaxed);
            self.is_found[tile].store(true, Ordering::Release);
        }
        self.masks[tile].load(Ordering::Relaxed)
    }
}

impl StaticPixels {
    /// Discards all masks and allocates for a grid.
    pub(super) fn reserve(&mut self, grid: Grid, is_on: bool) -> Result<()> {
        (self.grid, self.is_on) = (grid, is_on);
        self.tiles.reserve(grid.tiles())?;
        self.static_patches.iter_mut().try_for_each(|static_patches| static_patches.reserve(grid.tiles()))
    }

    /// Whether a pixel is static, a necessary condition for an overlay.
    #[inline(always)]
    pub(super) fn is_static_at<P: Colour>(
        &self,
        level: SimdLevel,
        anchors: &Anchors<'_, P>,
        [x, y]: [usize; 2],
    ) -> bool {
        self.tile(level, anchors, [x / TILE, y / TILE]) >> self.grid.locate(x, y).1 & 1 == 1
    }

    /// [`Self::is_static_at`] for the `wanted` pixels nearest to positions inside the picture, as bits `8 j + i`.
    #[inline(never)]
    pub(super) fn static_at<P: Colour>(
        &self,
        level: SimdLevel,
        anchors: &Anchors<'_, P>,
        at: &Positions,
        mut wanted: u64,
    ) -> u64 {
        let (mut found, mut last, mut last_mask) = (0, [usize::MAX; 2], 0);
        while wanted != 0 {
            let index = wanted.trailing_zeros();
            wanted &= wanted - 1;
            let [x, y] = [at.x[index as usize], at.y[index as usize]].map(|v| ((v + 32) >> 6) as usize);
            let tile = [x / TILE, y / TILE];
            if tile != last {
                (last, last_mask) = (tile, self.tile(level, anchors, tile));
            }
            found |= (last_mask >> (y % TILE * TILE + x % TILE) & 1) << index;
        }
        found
    }

    /// Whether a pixel of an anchor belongs to an overlay, see [`Anchors`]. `vector` points from the current anchor to
    /// the previous one.
    #[inline(always)]
    pub(super) fn is_overlay<P: Colour>(
        &self,
        level: SimdLevel,
        anchors: &Anchors<'_, P>,
        anchor: AnchorIndex,
        [x, y]: [usize; 2],
        vector: [i32; 2],
    ) -> bool {
        if !self.is_static_at(level, anchors, [x, y]) || vector == [0; 2] {
            return false;
        }
        let (here, there, vector) = match anchor {
            AnchorIndex::Previous => (anchors.previous, anchors.current, vector.map(|v| -v)),
            AnchorIndex::Current => (anchors.current, anchors.previous, vector),
        };
        if leads_outside(here, [x, y], vector) {
            let ((tile, index), corner) = (self.grid.locate(x, y), [x, y].map(|at| at / TILE * TILE));
            return self.static_patches[anchor as usize].of(tile, || patch_mask_of_tile(level, here, there, corner))
                >> index
                & 1
                == 1;
        }
        static_fits_better(here, there, [x, y], vector)
    }

    /// Static pixels of a tile, as bits `8 j + i`.
    #[inline(always)]
    pub(super) fn tile<P: Colour>(&self, level: SimdLevel, anchors: &Anchors<'_, P>, at: [usize; 2]) -> u64 {
        if !self.is_on {
            return 0;
        }
        self.tiles.of(at[1] * self.grid.columns + at[0], || {
            static_mask_of_tile(level, anchors.previous, anchors.current, at.map(|at| at * TILE))
        })
    }

    /// Static pixels of the 8x8 block at (x, y), inside the picture.
    #[inline(always)]
    pub(super) fn block<P: Colour>(&self, level: SimdLevel, anchors: &Anchors<'_, P>, [x, y]: [usize; 2]) -> u64 {
        let ([column, i], [row, j]) = ([x / TILE, x % TILE], [y / TILE, y % TILE]);
        // Rows from two vertically adjacent tiles, starting at row j of the upper one.
        let rows = |column: usize| {
            let upper = self.tile(level, anchors, [column, row]) >> (TILE * j);
            if j == 0 { upper } else { upper | self.tile(level, anchors, [column, row + 1]) << (TILE * (TILE - j)) }
        };
        if i == 0 {
            return rows(column);
        }
        let from_left = 0x0101_0101_0101_0101 * (0xff >> i);
        rows(column) >> i & from_left | rows(column + 1) << (TILE - i) & !from_left
    }
}

at_every_level! {
    /// Static pixels of the tile at `corner`, as bits `8 j + i`.
    fn static_mask_of_tile<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64
        = static_mask_scalar | static_mask_in_rows
}

at_every_level! {
    /// Pixels of the tile at `corner` with a static patch, as bits `8 j + i`.
    fn patch_mask_of_tile<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64
        = patch_mask_scalar | patch_mask_in_rows
}

fn static_mask_scalar<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64 {
    mask_scalar(current, corner, |at| is_static(previous, current, at))
}

fn patch_mask_scalar<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64 {
    mask_scalar(here, corner, |at| is_static_patch(here, there, at))
}

fn mask_scalar<P>(source: Source<'_, P>, [x, y]: [usize; 2], is: impl Fn([usize; 2]) -> bool) -> u64 {
    let [across, down] = extent(source, [x, y]);
    let pixels = (0..down).flat_map(|j| (0..across).map(move |i| (i, j)));
    pixels.fold(0, |all, (i, j)| all | u64::from(is([x + i, y + j])) << (TILE * j + i))
}

/// Width and height of the tile at a corner, in pixels.
fn extent<P>(source: Source<'_, P>, [x, y]: [usize; 2]) -> [usize; 2] {
    [TILE.min(source.width - x), TILE.min(source.height - y)]
}

/// A row of lumas, or of their differences, from one pixel left of a tile, padded to full vectors.
type Line = [f32; 2 * TILE];

/// The row shifted by one pixel.
#[inline(always)]
fn next(line: &Line) -> Line {
    let mut next = *line;
    next[..2 * TILE - 1].copy_from_slice(&line[1..]);
    next
}

#[inline(always)]
fn line_differences(a: &Line, b: &Line) -> Line {
    let mut differences = [0.0; 2 * TILE];
    for i in 0..2 * TILE {
        differences[i] = (b[i] - a[i]).abs();
    }
    differences
}

#[inline(always)]
fn static_mask_in_rows<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let is_at_edge = is_at_edge(current, corner);
    let mut static_pixels = [0; TILE];
    // Differences of the row above, and minima of adjacent 2x2 sums of the two rows above.
    let (mut above, mut min_above): (Line, Line) = ([0.0; 2 * TILE], [0.0; 2 * TILE]);
    for j in 0..TILE + 2 {
        let differences = line_differences(&line_around(previous, corner, j), &line_around(current, corner, j));
        let (next_above, next_apart) = (next(&above), next(&differences));
        let mut squares: Line = [0.0; 2 * TILE];
        for i in 0..2 * TILE {
            squares[i] = above[i] + next_above[i] + differences[i] + next_apart[i];
        }
        if is_at_edge {
            exclude_outside(current, corner, j, &mut squares);
        }
        let next_squares = next(&squares);
        let mut min_sum: Line = [0.0; 2 * TILE];
        for i in 0..2 * TILE {
            min_sum[i] = squares[i].min(next_squares[i]);
        }
        if j > 1 {
            // The result is for the row above.
            for i in 0..TILE {
                let is_static = (min_above[i].min(min_sum[i]) / 4.0 <= MAX_STATIC_DIFFERENCE)
                    & (next_above[i] <= 4.0 * MAX_STATIC_DIFFERENCE);
                static_pixels[i] |= u64::from(is_static) << (TILE * (j - 2) + i);
            }
        }
        (above, min_above) = (differences, min_sum);
    }
    static_pixels.into_iter().fold(0, |all, bits| all | bits) & tile_mask(extent(current, corner))
}

/// Whether the neighbourhood of a tile extends beyond the picture.
#[inline(always)]
fn is_at_edge<P>(source: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    x == 0 || y == 0 || x + TILE >= source.width || y + TILE >= source.height
}

/// Excludes 2x2 squares that extend beyond the border, where pixels are repeated, if there is another square.
#[inline(never)]
fn exclude_outside<P>(source: Source<'_, P>, corner: [usize; 2], j: usize, squares: &mut Line) {
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
fn patch_mask_in_rows<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, corner: [usize; 2]) -> u64 {
    let (mut lumas, mut differences) = ([[0.0; 2 * TILE]; TILE + 2], [[0.0; 2 * TILE]; TILE + 2]);
    for j in 0..TILE + 2 {
        lumas[j] = line_around(here, corner, j);
        differences[j] = line_differences(&lumas[j], &line_around(there, corner, j));
    }
    let mut static_patches = [0; TILE];
    for j in 0..TILE {
        let (mut difference, mut mean, mut contrast) = ([0.0; TILE], [0.0; TILE], [0.0; TILE]);
        for (lumas, differences) in lumas[j..j + 3].iter().zip(&differences[j..j + 3]) {
            for shift in 0..3 {
                for i in 0..TILE {
                    difference[i] += differences[i + shift];
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
            let is_static_patch = (difference[i] / 9.0 <= MAX_STATIC_DIFFERENCE) & (contrast[i] / 9.0 >= MIN_CONTRAST);
            static_patches[i] |= u64::from(is_static_patch) << (TILE * j + i);
        }
    }
    static_patches.into_iter().fold(0, |all, bits| all | bits) & tile_mask(extent(here, corner))
}

/// Lumas of row `j` of a tile's neighbourhood, clamped to the border.
#[inline(always)]
fn line_around<P: Colour>(source: Source<'_, P>, [x, y]: [usize; 2], j: usize) -> Line {
    let row = &source.pixels[(y + j).saturating_sub(1).min(source.height - 1) * source.width..][..source.width];
    match row[x.saturating_sub(1)..].first_chunk() {
        Some(row) if x > 0 => P::lumas_of(row),
        _ => P::lumas_of(&at_edge(row, x)),
    }
}

/// Pixels of a row from `x - 1`, clamped to the border.
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

/// Whether a pixel, and one of the four 2x2 squares that contain it, are about equal in both pictures.
fn is_static<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    let index = y * here.width + x;
    if (here.pixels[index].luma() - there.pixels[index].luma()).abs() > 4.0 * MAX_STATIC_DIFFERENCE {
        return false;
    }
    let (x, y) = (x as i32, y as i32);
    min_square_mean(&differences(&lumas(here, x - 1, y - 1), &lumas(there, x - 1, y - 1)), there, x, y)
        <= MAX_STATIC_DIFFERENCE
}

#[cfg(test)]
/// Whether a pixel of `here` is static and does not match `there` along `vector`.
fn is_overlay<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, at: [usize; 2], vector: [i32; 2]) -> bool {
    if vector == [0; 2] || !is_static(here, there, at) {
        return false;
    }
    if leads_outside(here, at, vector) {
        is_static_patch(here, there, at)
    } else {
        static_fits_better(here, there, at, vector)
    }
}

/// Whether a vector leads from a pixel to the outside of the picture.
#[inline(always)]
fn leads_outside<P>(here: Source<'_, P>, at: [usize; 2], vector: [i32; 2]) -> bool {
    let (size, mut is_outside) = ([here.width, here.height], false);
    for c in 0..2 {
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        is_outside |= (64 * at[c] as i32 + vector[c]) as u32 > 64 * (size[c] as u32 - 1);
    }
    is_outside
}

/// Whether the 3x3 patch around a pixel is static and has contrast.
fn is_static_patch<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, [x, y]: [usize; 2]) -> bool {
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let differences = differences(&patch, &lumas(there, x - 1, y - 1));
    values(&differences).sum::<f32>() / 9.0 <= MAX_STATIC_DIFFERENCE && contrast(&patch) >= MIN_CONTRAST
}

/// Whether the same position matches better than the one along the vector.
#[inline(never)]
fn static_fits_better<P: Colour>(
    here: Source<'_, P>,
    there: Source<'_, P>,
    [x, y]: [usize; 2],
    vector: [i32; 2],
) -> bool {
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let moved = moved_differences(&patch, there, x, y, vector);
    // The usual case: the vector matches.
    if values(&moved).all(|difference| difference < MIN_MISMATCH) {
        return false;
    }
    let unmoved = differences(&patch, &lumas(there, x - 1, y - 1));
    is_mismatch(&moved, &unmoved)
        && (min_square_mean(&unmoved, there, x, y) + NOISE) * RATIO <= min_square_mean(&moved, there, x, y)
}

/// Whether the static pixels of a patch differ along the vector; at an overlay's corner these are the overlay's.
#[inline(always)]
fn is_mismatch(moved: &Patch, unmoved: &Patch) -> bool {
    let (mut sum, mut pixels) = (0.0, 0.0);
    for (moved, unmoved) in values(moved).zip(values(unmoved)) {
        if unmoved <= MAX_STATIC_DIFFERENCE {
            (sum, pixels) = (sum + moved, pixels + 1.0);
        }
    }
    sum >= MIN_MISMATCH * pixels
}

/// 3x3 lumas or differences; the fourth column is padding.
type Patch = [[f32; 4]; 3];

/// The values of a patch.
fn values(patch: &Patch) -> impl Iterator<Item = f32> {
    patch.iter().flat_map(|row| &row[..3]).copied()
}

/// Mean absolute deviation.
fn contrast(patch: &Patch) -> f32 {
    let mean = values(patch).sum::<f32>() / 9.0;
    values(patch).map(|v| (v - mean).abs()).sum::<f32>() / 9.0
}

/// Rows of four lumas from (x, y), clamped to the border.
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

/// Differences between the patch centred on (x, y) and the bilinear samples of `there` along `vector`.
#[inline(always)]
fn moved_differences<P: Colour>(patch: &Patch, there: Source<'_, P>, x: i32, y: i32, vector: [i32; 2]) -> Patch {
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
    differences(patch, &between)
}

#[inline(always)]
fn differences(a: &Patch, b: &Patch) -> Patch {
    let mut differences = [[0.0; 4]; 3];
    for j in 0..3 {
        for i in 0..4 {
            differences[j][i] = (b[j][i] - a[j][i]).abs();
        }
    }
    differences
}

/// The smallest mean of the four 2x2 squares that contain the centre: at an edge, one of them lies on the pixel's own
/// surface.
#[inline(always)]
fn min_square_mean<P>(differences: &Patch, there: Source<'_, P>, x: i32, y: i32) -> f32 {
    let square = |j: usize, i: usize| {
        differences[j][i] + differences[j][i + 1] + differences[j + 1][i] + differences[j + 1][i + 1]
    };
    // A square that extends beyond the border repeats pixels; it is excluded if there is another.
    let is_off = |at: i32, len: usize| len > 1 && [at == 0, at as usize + 1 == len].contains(&true);
    if !is_off(x, there.width) && !is_off(y, there.height) {
        return square(0, 0).min(square(0, 1)).min(square(1, 0)).min(square(1, 1)) / 4.0;
    }
    let starts = |at: i32, len: usize| {
        let at = at as usize;
        usize::from(at == 0 && len > 1)..if at + 1 == len && len > 1 { 1 } else { 2 }
    };
    let squares = starts(y, there.height).flat_map(|j| starts(x, there.width).map(move |i| (j, i)));
    squares.fold(f32::INFINITY, |min_sum, (j, i)| min_sum.min(square(j, i))) / 4.0
}

#[cfg(test)]
mod tests {
    use super::super::kernels::BLOCK;
    use super::*;

    /// A picture of noise, and one that equals it in some squares up to a few levels.
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
    fn masks_of_tiles_equal_tests_of_pixels() {
        for (width, height) in [(1, 1), (8, 8), (9, 30), (41, 17), (64, 40)] {
            let pictures = pictures(width, height);
            let [previous, current] = [&pictures[0], &pictures[1]].map(|pixels| Source { pixels, width, height });
            let grid = Grid::new((width as u32, height as u32));
            let anchors = Anchors { previous, current };
            for level in SimdLevel::available() {
                let mut static_pixels = StaticPixels::default();
                static_pixels.reserve(grid, true).unwrap();
                let (mut count, mut over) = (0, 0);
                for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                    let is_static = is_static(previous, current, [x, y]);
                    assert_eq!(
                        static_pixels.is_static_at(level, &anchors, [x, y]),
                        is_static,
                        "({x}, {y}), {}",
                        level.name()
                    );
                    count += usize::from(is_static);
                    if x + TILE <= width && y + TILE <= height {
                        let pixels = (0..BLOCK).map(|index| [x + index % TILE, y + index / TILE]);
                        let expected = pixels.enumerate().fold(0, |mask, (index, at)| {
                            mask | u64::from(static_pixels.is_static_at(level, &anchors, at)) << index
                        });
                        assert_eq!(static_pixels.block(level, &anchors, [x, y]), expected);
                    }
                    for vector in [[0, 0], [64, -130], [-700, 9], [20, 5], [0, -64], [90, 3000]] {
                        let is_overlay = |anchor| static_pixels.is_overlay(level, &anchors, anchor, [x, y], vector);
                        let plain = [
                            anchors.is_overlay_in_previous([x, y], vector),
                            anchors.is_overlay_in_current([x, y], vector),
                        ];
                        assert_eq!(
                            [is_overlay(AnchorIndex::Previous), is_overlay(AnchorIndex::Current)],
                            plain,
                            "({x}, {y}), {vector:?}"
                        );
                        assert!(is_static || plain == [false; 2]);
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
