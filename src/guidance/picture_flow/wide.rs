//! Search over all whole-pixel motions nearby, for patches whose descent ended in a poor match.
//!
//! A descent finds a motion within a few pixels of its start, which comes from the next smaller level. A small object that moves fast is
//! invisible on the levels where its motion is that short, so no start is near it.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use super::patch::{PatchMatch, SIDE, mean_of};
use super::pyramid::{Plane, floor};

/// Largest distance of a motion from the one that the descent found, in pixels along each axis.
const RADIUS: i32 = 8;
/// Motions along one axis.
const DIAMETER: usize = 2 * RADIUS as usize + 1;
/// A patch with at most this residual keeps its match, in squared code values.
pub(super) const POOR: f32 = 200.0;
/// A match is replaced by one with less than this fraction of its residual.
const MAX_RATIO: f32 = 0.6;
/// The residual must also be less than this fraction of that of every motion more than a pixel away: where texture repeats, none is.
const MAX_RATIO_TO_SECOND: f32 = 0.7;
/// Largest distance, in pixels along each axis, at which the search back from the match may end from where the patch is. A patch that is
/// covered in the other picture matches something there which has its own match here.
const MAX_RETURN_ERROR: i32 = 1;
/// Motion is clamped to this along each axis, in pixels. It leads out of every picture.
const FAR: i32 = 1 << 20;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "WIDE_": int RADIUS, float POOR, float MAX_RATIO, float MAX_RATIO_TO_SECOND, int MAX_RETURN_ERROR, float FAR
);

/// The best of the motions that were compared.
struct Best {
    motion: [i32; 2],
    residual: f32,
    brightening: f32,
    /// The smallest residual of those more than a pixel away from it.
    second: f32,
}

/// Replaces `found`, the match in `to` of the patch of `from` at `origin`, if one of the motions around it matches clearly better than
/// it and than all others, and is found again on the way back.
#[inline(always)]
pub(super) fn search<S: Simd>(simd: S, from: &Plane, to: &Plane, origin: [i32; 2], found: &mut PatchMatch) {
    let near = found.flow.map(|v| floor(v + 0.5).clamp(-FAR, FAR));
    let Some(best) = best_near(simd, from, to, origin, near) else { return };
    let most = (MAX_RATIO * found.residual).min(MAX_RATIO_TO_SECOND * best.second);
    // Written so that NaN is refused as well.
    let is_better = best.residual < most;
    if !is_better {
        return;
    }
    let there = [0, 1].map(|axis| origin[axis] + best.motion[axis]);
    let Some(back) = best_near(simd, to, from, there, best.motion.map(|v| -v)) else { return };
    if (0..2).any(|axis| (best.motion[axis] + back.motion[axis]).abs() > MAX_RETURN_ERROR) {
        return;
    }
    found.flow = best.motion.map(|v| v as f32);
    found.residual = best.residual;
    found.brightening = best.brightening;
}

/// Compares the patch of `from` at `origin` with `to` at every motion within [`RADIUS`] of `near` that keeps it inside the picture. `None` if
/// there is none, or if the patch lies across the border.
#[inline(always)]
fn best_near<S: Simd>(simd: S, from: &Plane, to: &Plane, origin: [i32; 2], near: [i32; 2]) -> Option<Best> {
    if !from.holds(origin[0], origin[1], SIDE) {
        return None;
    }
    let row = |plane: &Plane, x, y: i32| f32x8::from_slice(simd, &plane.row::<SIDE>(x, y));
    let own: [f32x8<S>; SIDE] = std::array::from_fn(|j| row(from, origin[0], origin[1] + j as i32));
    let mut residuals = [[f32::INFINITY; DIAMETER]; DIAMETER];
    let (mut least, mut brightening, mut at) = (f32::INFINITY, 0.0, [0; 2]);
    for (j, residuals) in residuals.iter_mut().enumerate() {
        for (i, residual) in residuals.iter_mut().enumerate() {
            let (x, y) = (origin[0] + near[0] - RADIUS + i as i32, origin[1] + near[1] - RADIUS + j as i32);
            if !to.holds(x, y, SIDE) {
                continue;
            }
            let (mut sum, mut squares) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 0.0));
            for (y, own) in (y..).zip(&own) {
                let difference = row(to, x, y) - *own;
                sum += difference;
                squares += difference * difference;
            }
            let mean = mean_of(sum);
            *residual = (mean_of(squares) - mean * mean).max(0.0);
            if *residual < least {
                (least, brightening, at) = (*residual, mean, [i, j]);
            }
        }
    }
    let is_apart = |i: usize, j: usize| i.abs_diff(at[0]).max(j.abs_diff(at[1])) > 1;
    let apart = residuals.iter().enumerate().flat_map(|(j, residuals)| {
        residuals.iter().enumerate().filter(move |(i, _)| is_apart(*i, j)).map(|(_, residual)| *residual)
    });
    least.is_finite().then(|| Best {
        motion: [0, 1].map(|axis| near[axis] - RADIUS + at[axis] as i32),
        residual: least,
        brightening,
        second: apart.fold(f32::INFINITY, f32::min),
    })
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::guidance::picture_flow::pyramid::Plane;

    const SIZE: usize = 48;
    const ORIGIN: [i32; 2] = [20, 18];

    /// A plane of noise that depends on `seed`, read at the position that `place` gives.
    fn noise(seed: u32, place: impl Fn(i32, i32) -> [i32; 2]) -> Plane {
        let value = |[x, y]: [i32; 2]| {
            let mixed = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed;
            (mixed.wrapping_mul(0xc2b2_ae3d) >> 24) as f32
        };
        let luma = (0..SIZE * SIZE).map(|k| value(place((k % SIZE) as i32, (k / SIZE) as i32))).collect();
        Plane { width: SIZE, height: SIZE, luma }
    }

    fn copy(from: &Plane, [x, y]: [i32; 2], to: &mut Plane, [u, v]: [i32; 2], change: impl Fn(f32) -> f32) {
        for j in 0..SIDE as i32 {
            for i in 0..SIDE as i32 {
                let at = |x: i32, y: i32| (y + j) as usize * SIZE + (x + i) as usize;
                to.luma[at(u, v)] = change(from.luma[at(x, y)]);
            }
        }
    }

    /// What becomes of a match of no motion and residual 4000.
    fn after(from: &Plane, to: &Plane, origin: [i32; 2]) -> PatchMatch {
        let mut found = PatchMatch { residual: 4000.0, ..PatchMatch::default() };
        dispatch!(Level::new(), simd => search(simd, from, to, origin, &mut found));
        found
    }

    #[test]
    fn the_match_is_found_anywhere_within_the_radius() {
        let from = noise(1, |x, y| [x, y]);
        for [u, v] in [[6, -5], [8, 8], [-8, 0]] {
            let mut to = noise(1, |x, y| [x - u, y - v]);
            to.luma.iter_mut().for_each(|value| *value += 9.0);
            let found = after(&from, &to, ORIGIN);
            assert_eq!(found.flow, [u as f32, v as f32]);
            assert_eq!((found.brightening, found.residual), (9.0, 0.0));
        }
        // One pixel farther.
        let found = after(&from, &noise(1, |x, y| [x - 9, y]), ORIGIN);
        assert_eq!((found.flow, found.residual), ([0.0; 2], 4000.0));
    }

    #[test]
    fn a_match_that_is_one_of_several_is_not_taken() {
        let repeated = |x: i32, y: i32| [x.rem_euclid(6), y];
        let to = noise(1, |x, y| repeated(x - 2, y - 3));
        assert_eq!(after(&noise(1, repeated), &to, ORIGIN).flow, [0.0; 2]);
    }

    #[test]
    fn a_patch_that_is_covered_does_not_take_the_match_of_another() {
        let [x, y] = ORIGIN;
        let own = noise(1, |x, y| [x, y]);
        let (mut from, mut to) = (noise(1, |x, y| [x, y]), noise(2, |x, y| [x, y]));
        // Only something similar, eight pixels to the right, is in both pictures.
        let similar = |value: f32| 0.8 * value + 4.0;
        copy(&own, ORIGIN, &mut to, [x + 8, y], similar);
        let taken = after(&from, &to, ORIGIN);
        assert_eq!(taken.flow, [8.0, 0.0]);
        copy(&own, ORIGIN, &mut from, [x + 8, y], similar);
        assert_eq!(after(&from, &to, ORIGIN).flow, [0.0; 2]);
    }

    #[test]
    fn a_patch_across_the_border_keeps_its_match() {
        let (from, to) = (noise(1, |x, y| [x, y]), noise(1, |x, y| [x - 3, y]));
        assert_eq!(after(&from, &to, [0, 18]).flow, [3.0, 0.0]);
        for origin in [[-2, 18], [SIZE as i32 - 7, 18], [20, -1]] {
            assert_eq!(after(&from, &to, origin).flow, [0.0; 2]);
        }
    }
}
