//! The scalar versions, pixel by pixel.

use super::Source;
use super::lanczos::{BEFORE, SINC, TAPS};
use super::sampling::{BLOCK, Block, MergeRule, Positions, Sampled, TILE, TileSource, luma};

/// See [`Sampled::merge_tile`].
pub(super) fn merge_tile<P: Sampled>(
    previous: TileSource<'_, P>,
    current: TileSource<'_, P>,
    rule: &MergeRule,
    out: &mut [P],
    stride: usize,
) -> u64 {
    let mut mask = 0;
    for (j, i) in (0..TILE).flat_map(|j| (0..TILE).map(move |i| (j, i))) {
        let (from_previous, from_current) = (
            P::sample(previous.picture, moved(previous.at, i, j)),
            P::sample(current.picture, moved(current.at, i, j)),
        );
        let (merged, is_reported) = P::merge(from_previous, from_current, rule);
        out[j * stride + i] = merged;
        mask |= u64::from(is_reported) << (TILE * j + i);
    }
    mask
}

/// See [`Sampled::sample_tile`].
pub(super) fn sample_tile<P: Sampled>(source: TileSource<'_, P>, out: &mut [P], stride: usize) {
    for (j, i) in (0..TILE).flat_map(|j| (0..TILE).map(move |i| (j, i))) {
        out[j * stride + i] = P::sample(source.picture, moved(source.at, i, j));
    }
}

/// See [`Sampled::merge_block`].
pub(super) fn merge_block<P: Sampled>(rule: &MergeRule, block: &mut Block<P>) -> u64 {
    let mut mask = 0;
    for i in 0..BLOCK {
        let (merged, is_reported) = P::merge(block.previous[i], block.current[i], rule);
        block.merged[i] = merged;
        mask |= u64::from(is_reported) << i;
    }
    mask
}

/// See [`Sampled::sample_pixels`].
pub(super) fn sample_pixels<P: Sampled>(source: Source<'_, P>, at: &Positions, wanted: u64, out: &mut [P; BLOCK]) {
    for (i, pixel) in out.iter_mut().enumerate().filter(|(i, _)| wanted >> i & 1 == 1) {
        *pixel = P::sample(source, [at.x[i], at.y[i]]);
    }
}

/// See [`Sampled::add_levels`].
pub(super) fn add_levels<P: Sampled>(row: &[P], sums: &mut [[u16; 4]]) {
    for (sum, pixel) in sums.iter_mut().zip(row) {
        let levels = pixel.levels();
        *sum = std::array::from_fn(|c| sum[c].wrapping_add(levels[c].into()));
    }
}

/// See [`Sampled::lumas`].
pub(super) fn lumas<P: Sampled>(row: &[P], lumas: &mut [u8]) {
    for (value, pixel) in lumas.iter_mut().zip(row) {
        *value = luma(pixel.levels());
    }
}

/// Position of pixel (i, j) of a tile at `at`.
fn moved(at: [i32; 2], i: usize, j: usize) -> [i32; 2] {
    [at[0].saturating_add(64 * i as i32), at[1].saturating_add(64 * j as i32)]
}

/// The 6x6 pixels around a position, and their horizontal and vertical weights.
#[inline(always)]
pub(super) fn taps<P: Copy>(source: &Source<'_, P>, at: [i32; 2], zero: P) -> ([[P; TAPS]; TAPS], [[i16; TAPS]; 2]) {
    let mut taps = [[zero; TAPS]; TAPS];
    source.clamped(at.map(|v| (v >> 6) - BEFORE), &mut taps);
    (taps, at.map(|v| SINC[(v & 63) as usize]))
}
