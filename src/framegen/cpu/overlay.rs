//! Telling what lies over the picture and stands still: a HUD, a watermark.
//!
//! Motion of the world behind it does not know an overlay. Where a vector does not match while standing still does, the
//! pixel lies on one.

use super::colour::Colour;
use super::kernels::Source;

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
                *lumas = P::lumas_of_four(row);
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
