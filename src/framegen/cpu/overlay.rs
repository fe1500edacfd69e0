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
    let difference_here = (here.pixels[place].luma() - there.pixels[place].luma()).abs();
    if difference_here > 4.0 * STILL || vector == [0; 2] {
        return false;
    }
    if !may_be_still(here, there, place, difference_here) {
        return false;
    }
    let (x, y) = (x as i32, y as i32);
    let patch = lumas::<P, 3>(here, x - 1, y - 1);
    let still = Difference::new(&apart(&patch, &lumas(there, x - 1, y - 1)), there, x, y);
    if still.square > STILL {
        return false;
    }
    let from = [64 * x + vector[0], 64 * y + vector[1]];
    let limit = [64 * (here.width as i32 - 1), 64 * (here.height as i32 - 1)];
    if from[0] >= 0 && from[1] >= 0 && from[0] <= limit[0] && from[1] <= limit[1] {
        let moved = difference(&patch, there, x, y, vector);
        (still.square + MARGIN) * BETTER <= moved.square
    } else {
        still.patch <= STILL && contrast(&patch) >= CONTRAST
    }
}

/// Whether a square of 2 x 2 that holds a pixel can stand still, by the pixels beside it: those at a corner from it are
/// not looked at.
#[inline(always)]
fn may_be_still<P: Colour>(here: Source<'_, P>, there: Source<'_, P>, place: usize, difference_here: f32) -> bool {
    let width = here.width;
    let (Some(first), len) = (place.checked_sub(width), here.pixels.len()) else { return true };
    if place + width >= len {
        return true;
    }
    let apart = |place: usize| (here.pixels[place].luma() - there.pixels[place].luma()).abs();
    // At the ends of a row this looks at pixels of others, which proves nothing.
    let column = place % width;
    if column == 0 || column + 1 == width {
        return true;
    }
    let beside = apart(place - 1).min(apart(place + 1));
    let above = apart(first).min(apart(place + width));
    // With room for how sums are rounded.
    difference_here + beside + above <= 4.0 * STILL + 0.5
}

/// Mean absolute differences, in levels.
struct Difference {
    /// Over the best of the four squares of 2 x 2 that hold the centre: a pixel on the rim of a surface is judged by
    /// that surface alone.
    square: f32,
    /// Over the whole patch.
    patch: f32,
}

/// Mean absolute difference from the mean.
fn contrast(patch: &[[f32; 3]; 3]) -> f32 {
    let mean = patch.as_flattened().iter().sum::<f32>() / 9.0;
    patch.as_flattened().iter().map(|v| (v - mean).abs()).sum::<f32>() / 9.0
}

/// The lumas from (x, y) on; the edge pixels go on beyond the edges.
#[inline(always)]
fn lumas<P: Colour, const N: usize>(source: Source<'_, P>, x: i32, y: i32) -> [[f32; N]; N] {
    let mut lumas = [[0.0; N]; N];
    if x >= 0 && y >= 0 && x as usize + N <= source.width && y as usize + N <= source.height {
        for (j, lumas) in lumas.iter_mut().enumerate() {
            let row = &source.pixels[(y as usize + j) * source.width + x as usize..][..N];
            lumas.iter_mut().zip(row).for_each(|(luma, pixel)| *luma = pixel.luma());
        }
        return lumas;
    }
    let on_axis = |at: i32, len: usize| at.clamp(0, len as i32 - 1) as usize;
    for (j, lumas) in (0..).zip(&mut lumas) {
        let row = &source.pixels[on_axis(y + j, source.height) * source.width..][..source.width];
        (0..).zip(lumas).for_each(|(i, luma)| *luma = row[on_axis(x + i, source.width)].luma());
    }
    lumas
}

/// How far `patch`, centred on (x, y) in one picture, is from the place in `there` that `vector` leads to, read
/// bilinearly.
fn difference<P: Colour>(patch: &[[f32; 3]; 3], there: Source<'_, P>, x: i32, y: i32, vector: [i32; 2]) -> Difference {
    let [u, v] = [64 * (x - 1) + vector[0], 64 * (y - 1) + vector[1]];
    let [fx, fy] = [u, v].map(|at| (at & 63) as f32 / 64.0);
    let lumas: [[f32; 4]; 4] = lumas(there, u >> 6, v >> 6);
    let mut across = [[0.0; 3]; 4];
    for (across, line) in across.iter_mut().zip(&lumas) {
        for i in 0..3 {
            across[i] = line[i] + (line[i + 1] - line[i]) * fx;
        }
    }
    let mut between = [[0.0; 3]; 3];
    for j in 0..3 {
        for i in 0..3 {
            between[j][i] = across[j][i] + (across[j + 1][i] - across[j][i]) * fy;
        }
    }
    Difference::new(&apart(patch, &between), there, x, y)
}

fn apart(a: &[[f32; 3]; 3], b: &[[f32; 3]; 3]) -> [[f32; 3]; 3] {
    let mut apart = [[0.0; 3]; 3];
    for j in 0..3 {
        for i in 0..3 {
            apart[j][i] = (b[j][i] - a[j][i]).abs();
        }
    }
    apart
}

impl Difference {
    fn new<P>(apart: &[[f32; 3]; 3], there: Source<'_, P>, x: i32, y: i32) -> Self {
        // A square that reaches over the edge counts pixels twice, and is left out where there is another.
        let starts = |at: i32, len: usize| {
            let at = at as usize;
            usize::from(at == 0 && len > 1)..if at + 1 == len && len > 1 { 1 } else { 2 }
        };
        let square = |j: usize, i: usize| apart[j][i] + apart[j][i + 1] + apart[j + 1][i] + apart[j + 1][i + 1];
        let mut least = f32::INFINITY;
        for j in starts(y, there.height) {
            for i in starts(x, there.width) {
                least = least.min(square(j, i));
            }
        }
        Self { square: least / 4.0, patch: apart.as_flattened().iter().sum::<f32>() / 9.0 }
    }
}
