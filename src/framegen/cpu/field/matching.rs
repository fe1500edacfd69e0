//! Match of keys with the colours of the anchors.

use super::super::colour::Colour;
use super::super::kernels::{BLOCK, Source, TILE, at_every_level};
use super::super::splat_key::{self, EMPTY, Key, MAX_MATCH_ERROR};
use super::DILATION_TOLERANCE;

at_every_level! {
    /// `wanted` pixels of the tile at `corner` (bit `8 j + i`) that match better with the nearest key than with their
    /// own.
    pub(super) fn better_fit<P: Colour>(
        previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2], wanted: u64, nearest: &[Key; BLOCK],
        own: &[Key; BLOCK],
    ) -> u64 = better_fit_scalar | better_fit_in_rows
}

fn better_fit_scalar<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    wanted: u64,
    nearest: &[Key; BLOCK],
    own: &[Key; BLOCK],
) -> u64 {
    let indices = (0..BLOCK).filter(|index| wanted >> index & 1 == 1);
    let fits = indices.filter(|&index| {
        let at = [x + index % TILE, y + index / TILE];
        let of_nearest = colour_distance(previous, current, at, nearest[index]);
        of_nearest <= DILATION_TOLERANCE && of_nearest < colour_distance(previous, current, at, own[index])
    });
    fits.fold(0, |all, index| all | 1 << index)
}

#[inline(always)]
fn better_fit_in_rows<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    mut wanted: u64,
    nearest: &[Key; BLOCK],
    own: &[Key; BLOCK],
) -> u64 {
    let mut better_fit = 0;
    while wanted != 0 {
        // Eight pixels at a time; the last group repeats its last pixel.
        let (mut indices, mut index) = ([0; TILE], 0);
        for next in &mut indices {
            index = if wanted != 0 { wanted.trailing_zeros() as usize } else { index };
            wanted &= wanted.wrapping_sub(1);
            *next = index;
        }
        let (mut at, mut of_nearest, mut of_own) = ([[0; 2]; TILE], [EMPTY; TILE], [EMPTY; TILE]);
        let mut here = [P::OPAQUE_BLACK; TILE];
        for (i, &index) in indices.iter().enumerate() {
            let [x, y] = [x + index % TILE, y + index / TILE];
            (of_nearest[i], of_own[i]) = (nearest[index], own[index]);
            at[i] = [x as i32, y as i32];
            here[i] = current.pixels[y * current.width + x];
        }
        let nearest = colour_distances(previous, &here, &at, &of_nearest);
        if nearest.iter().all(|&colour_distance| colour_distance > DILATION_TOLERANCE) {
            continue;
        }
        let own = colour_distances(previous, &here, &at, &of_own);
        for (i, &index) in indices.iter().enumerate() {
            better_fit |= u64::from(nearest[i] <= DILATION_TOLERANCE && nearest[i] < own[i]) << index;
        }
    }
    better_fit
}

/// [`colour_distance`] of eight pixels.
#[inline(always)]
fn colour_distances<P: Colour>(
    previous: Source<'_, P>,
    here: &[P; TILE],
    at: &[[i32; 2]; TILE],
    keys: &[Key; TILE],
) -> [f32; TILE] {
    const CHANNELS: usize = 4 * TILE;
    let (mut fx, mut fy) = ([0.0; CHANNELS], [0.0; CHANNELS]);
    let mut corners = [[P::OPAQUE_BLACK; TILE]; 4];
    for i in 0..TILE {
        let [vx, vy] = splat_key::vector(keys[i]);
        let (u, v) = (64 * at[i][0] + vx, 64 * at[i][1] + vy);
        fx[4 * i..][..4].fill((u & 63) as f32 / 64.0);
        fy[4 * i..][..4].fill((v & 63) as f32 / 64.0);
        let (left, top) = (u >> 6, v >> 6);
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        let is_inside = (left as u32 as usize) < previous.width - 1 && (top as u32 as usize) < previous.height - 1;
        let on_axis = |at: i32, len: usize| at.clamp(0, len as i32 - 1) as usize;
        let [left, right] = if is_inside {
            [left as usize, left as usize + 1]
        } else {
            [left, left + 1].map(|at| on_axis(at, previous.width))
        };
        let [top, below] = if is_inside {
            [top as usize, top as usize + 1]
        } else {
            [top, top + 1].map(|at| on_axis(at, previous.height))
        };
        let [above, below] = [&previous.pixels[top * previous.width..], &previous.pixels[below * previous.width..]];
        (corners[0][i], corners[1][i], corners[2][i], corners[3][i]) =
            (above[left], above[right], below[left], below[right]);
    }
    let levels = |pixels: &[P; TILE]| {
        let mut levels = [0.0; CHANNELS];
        for (levels, pixel) in levels.chunks_exact_mut(4).zip(pixels) {
            levels.copy_from_slice(&pixel.in_levels());
        }
        levels
    };
    let [a, b, c, d] = [levels(&corners[0]), levels(&corners[1]), levels(&corners[2]), levels(&corners[3])];
    let here = levels(here);
    let mut difference = [0.0_f32; CHANNELS];
    for k in 0..CHANNELS {
        let above = a[k] + (b[k] - a[k]) * fx[k];
        let below = c[k] + (d[k] - c[k]) * fx[k];
        difference[k] = (above + (below - above) * fy[k] - here[k]).abs();
    }
    let mut colour_distances = [0.0; TILE];
    for (colour_distance, difference) in colour_distances.iter_mut().zip(difference.chunks_exact(4)) {
        *colour_distance = difference[2].max(difference[1].max(difference[0].max(0.0)));
    }
    colour_distances
}

at_every_level! {
    /// Tags the keys of the tile at `corner` with their match errors, see [`match_error`].
    pub(super) fn tag_match_errors<P: Colour>(
        previous: Source<'_, P>, current: Source<'_, P>, corner: [usize; 2], keys: &mut [Key; BLOCK],
    ) = tag_match_errors_scalar | tag_match_errors_in_rows
}

fn tag_match_errors_scalar<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    keys: &mut [Key; BLOCK],
) {
    for (index, key) in keys.iter_mut().enumerate().filter(|(_, key)| **key != EMPTY) {
        *key = splat_key::with_tag(*key, match_error(previous, current, [x + index % TILE, y + index / TILE], *key));
    }
}

#[inline(always)]
fn tag_match_errors_in_rows<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    keys: &mut [Key; BLOCK],
) {
    // Minimum and maximum of horizontally adjacent lumas, reused for the row below.
    let mut last: Option<(usize, [[f32; TILE]; 2])> = None;
    for (j, keys) in keys.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let here = current.pixels.get((y + j) * current.width + x..).and_then(|row| row.first_chunk::<TILE>());
        let run = rows_in_previous(previous, [x, y + j], keys);
        let squares = if run.is_none() { squares_in_previous(previous, [x, y + j], keys) } else { None };
        let (mut low, mut high) = ([0.0; TILE], [0.0; TILE]);
        match (here, run, &squares) {
            (Some(_), Some((start, [above, below])), _) => {
                let [low_above, high_above] = match last {
                    Some((index, ends)) if index == start => ends,
                    _ => pair_ranges(&P::lumas_of(above)),
                };
                let [low_below, high_below] = pair_ranges(&P::lumas_of(below));
                for i in 0..TILE {
                    low[i] = low_above[i].min(low_below[i]);
                    high[i] = high_above[i].max(high_below[i]);
                }
                last = Some((start + previous.width, [low_below, high_below]));
            }
            (Some(_), None, Some([a, b, c, d])) => {
                let (a, b, c, d) = (P::lumas_of(a), P::lumas_of(b), P::lumas_of(c), P::lumas_of(d));
                for i in 0..TILE {
                    low[i] = a[i].min(b[i]).min(c[i].min(d[i]));
                    high[i] = a[i].max(b[i]).max(c[i].max(d[i]));
                }
            }
            _ => {
                for (i, key) in keys.iter_mut().enumerate().filter(|(_, key)| **key != EMPTY) {
                    *key = splat_key::with_tag(*key, match_error(previous, current, [x + i, y + j], *key));
                }
                continue;
            }
        }
        let Some(here) = here.map(P::lumas_of) else { continue };
        for i in 0..TILE {
            let difference = (low[i] - here[i]).max(here[i] - high[i]).max(0.0);
            keys[i] = splat_key::with_tag(keys[i], (difference as u8).min(MAX_MATCH_ERROR));
        }
    }
}

/// Minimum and maximum of horizontally adjacent lumas.
#[inline(always)]
fn pair_ranges(lumas: &[f32; 2 * TILE]) -> [[f32; TILE]; 2] {
    let (mut low, mut high) = ([0.0; TILE], [0.0; TILE]);
    for i in 0..TILE {
        low[i] = lumas[i].min(lumas[i + 1]);
        high[i] = lumas[i].max(lumas[i + 1]);
    }
    [low, high]
}

/// If the row's pixels are contiguous in the previous anchor, the two rows there between which they lie, and the start
/// of the first.
#[inline(always)]
fn rows_in_previous<'a, P: Colour>(
    previous: Source<'a, P>,
    [x, y]: [usize; 2],
    keys: &[Key; TILE],
) -> Option<(usize, [&'a [P; 2 * TILE]; 2])> {
    let whole = |key: Key| splat_key::vector(key).map(|v| v >> 6);
    let [left, top] = whole(keys[0]);
    let mut is_run = true;
    for &key in keys {
        let [u, v] = whole(key);
        is_run &= (key != EMPTY) & (u == left) & (v == top);
    }
    // Negative coordinates wrap to large unsigned values and fail the bounds check.
    let (u, v) = ((x as i32 + left) as u32 as usize, (y as i32 + top) as u32 as usize);
    if !is_run || u.saturating_add(TILE) >= previous.width || v.saturating_add(1) >= previous.height {
        return None;
    }
    let start = v * previous.width + u;
    let row = |start: usize| previous.pixels.get(start..)?.first_chunk();
    Some((start, [row(start)?, row(start + previous.width)?]))
}

/// The 2x2 pixels of the previous anchor around the positions of eight pixels, if all of them have keys and are inside.
#[inline(always)]
fn squares_in_previous<P: Colour>(
    previous: Source<'_, P>,
    [x, y]: [usize; 2],
    keys: &[Key; TILE],
) -> Option<[[P; TILE]; 4]> {
    let mut squares = [[P::OPAQUE_BLACK; TILE]; 4];
    for (i, &key) in keys.iter().enumerate() {
        let [vx, vy] = splat_key::vector(key);
        // Negative coordinates wrap to large unsigned values and fail the bounds check.
        let (u, v) = ((x + i) as i32 + (vx >> 6), y as i32 + (vy >> 6));
        let (u, v) = (u as u32 as usize, v as u32 as usize);
        if key == EMPTY || u + 1 >= previous.width || v + 1 >= previous.height {
            return None;
        }
        let start = v * previous.width + u;
        let above = previous.pixels.get(start..start + 2)?;
        let below = previous.pixels.get(start + previous.width..start + previous.width + 2)?;
        (squares[0][i], squares[1][i], squares[2][i], squares[3][i]) = (above[0], above[1], below[0], below[1]);
    }
    Some(squares)
}

/// Levels by which a pixel's luma exceeds the range of the 2x2 pixels of the previous anchor around the position to
/// which its key leads.
pub(in super::super) fn match_error<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    key: Key,
) -> u8 {
    let (width, height) = (previous.width, previous.height);
    let [vx, vy] = splat_key::vector(key);
    let (left, top) = ((64 * x as i32 + vx) >> 6, (64 * y as i32 + vy) >> 6);
    let luma = current.pixels[y * width + x].luma();
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for v in [top, top + 1] {
        for u in [left, left + 1] {
            let u = u.clamp(0, width as i32 - 1) as usize;
            let v = v.clamp(0, height as i32 - 1) as usize;
            let there = previous.pixels[v * width + u].luma();
            (low, high) = (low.min(there), high.max(there));
        }
    }
    let difference = (low - luma).max(luma - high).max(0.0);
    (difference as u8).min(MAX_MATCH_ERROR)
}

/// Difference between a pixel of the current anchor and the bilinear sample of the previous one at the position to
/// which a key leads: the largest of any channel, in levels.
pub(in super::super) fn colour_distance<P: Colour>(
    previous: Source<'_, P>,
    current: Source<'_, P>,
    [x, y]: [usize; 2],
    key: Key,
) -> f32 {
    let [vx, vy] = splat_key::vector(key);
    let (u, v) = (64 * x as i32 + vx, 64 * y as i32 + vy);
    let (fx, fy) = ((u & 63) as f32 / 64.0, (v & 63) as f32 / 64.0);
    let at = |u: i32, v: i32| {
        let u = u.clamp(0, previous.width as i32 - 1) as usize;
        let v = v.clamp(0, previous.height as i32 - 1) as usize;
        previous.pixels[v * previous.width + u].in_levels()
    };
    let (left, top) = (u >> 6, v >> 6);
    let corners = [at(left, top), at(left + 1, top), at(left, top + 1), at(left + 1, top + 1)];
    let here = current.pixels[y * current.width + x].in_levels();
    // A plain loop: LLVM does not always inline closures here.
    let mut difference = [0.0_f32; 4];
    for c in 0..4 {
        let above = corners[0][c] + (corners[1][c] - corners[0][c]) * fx;
        let below = corners[2][c] + (corners[3][c] - corners[2][c]) * fx;
        difference[c] = (above + (below - above) * fy - here[c]).abs();
    }
    difference[2].max(difference[1].max(difference[0].max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::super::super::kernels::SimdLevel;
    use super::*;

    #[test]
    fn all_instruction_sets_match_alike() {
        const SIZE: [usize; 2] = [40, 30];
        // Pseudo-random numbers (Knuth's MMIX generator), the same in every run.
        let mut random = 7_u64;
        let mut below = |end: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) % end
        };
        let mut picture =
            || -> Vec<[u8; 4]> { (0..SIZE[0] * SIZE[1]).map(|_| [0; 4].map(|_: u8| 100 + below(60) as u8)).collect() };
        let pictures = [picture(), picture()];
        let [previous, current] =
            [0, 1].map(|i| Source { pixels: pictures[i].as_slice(), width: SIZE[0], height: SIZE[1] });
        let mut fitted = 0;
        for round in 0..2000 {
            let corner = [0, 1].map(|c| TILE * below((SIZE[c] / TILE) as u64) as usize);
            // One vector, one of a few, or any; some pixels have no key.
            let mut keys = || -> [Key; BLOCK] {
                let common = [0, 1].map(|_| below(1280) as i32 - 640);
                [EMPTY; BLOCK].map(|empty| match round % 4 {
                    0 => splat_key::pack(9, 0, common),
                    1 => splat_key::pack(9, 0, common.map(|v| v + below(3) as i32 * 64)),
                    2 => splat_key::pack(9, 0, [0, 1].map(|_| below(9000) as i32 - 4500)),
                    _ if below(8) == 0 => empty,
                    _ => splat_key::pack(9, 0, common.map(|v| v + below(90) as i32)),
                })
            };
            let (own, nearest) = (keys(), keys());
            let wanted = (0..BLOCK).filter(|&at| own[at] != EMPTY && nearest[at] != EMPTY && below(3) > 0);
            let wanted = wanted.fold(0, |all, index| all | 1 << index);
            let judge = |level| {
                let mut tagged = own;
                tag_match_errors(level, previous, current, corner, &mut tagged);
                (tagged, better_fit(level, previous, current, corner, wanted, &nearest, &own))
            };
            let expected = judge(SimdLevel::SCALAR);
            fitted += expected.1.count_ones();
            for level in SimdLevel::available() {
                assert_eq!(judge(level), expected, "{} in round {round}", level.name());
            }
        }
        assert!(fitted > 1000, "{fitted}");
    }
}
