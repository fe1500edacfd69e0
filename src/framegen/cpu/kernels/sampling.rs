//! Sampling of pictures, and the rule that merges the samples of two anchors.

use super::{SimdLevel, Source};
use crate::picture::Pixel;

/// Side of a tile, in pixels.
pub const TILE: usize = 8;

#[cfg(test)]
crate::shader_constants::shader_constants!("": int TILE);

/// Pixels of a tile.
pub const BLOCK: usize = TILE * TILE;

/// How the samples of two anchors are merged: the one nearer in time if they are equal, otherwise a blend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MergeRule {
    /// Weight of the current anchor in a blend, of 128; clamped to 1..127.
    pub weight: u8,
    /// Whether the current anchor is the nearer one in time.
    pub nearer_is_current: bool,
    /// Largest difference, in levels of any channel, between samples that count as equal.
    pub max_equal_difference: u8,
    /// Samples that differ by more levels in any channel are reported.
    pub doubt_threshold: u8,
}

impl MergeRule {
    /// Weight of the current anchor in a blend, of 128.
    pub(super) fn share(&self) -> u8 {
        self.weight.clamp(1, 127)
    }
}

/// The pixels of a picture from which a tile is sampled.
#[derive(Debug, Clone, Copy)]
pub struct TileSource<'a, P> {
    /// The picture.
    pub picture: Source<'a, P>,
    /// Position of the tile's first pixel, in 1/64 px.
    pub at: [i32; 2],
}

/// Positions of a tile's pixels, in 1/64 px.
#[derive(Debug, Clone, Copy)]
pub struct Positions {
    /// x coordinates.
    pub x: [i32; BLOCK],
    /// y coordinates.
    pub y: [i32; BLOCK],
}

/// Samples of a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block<P> {
    /// Samples of the previous anchor.
    pub previous: [P; BLOCK],
    /// Samples of the current anchor.
    pub current: [P; BLOCK],
    /// Merged samples.
    pub merged: [P; BLOCK],
}

/// A pixel type that can be sampled and merged.
///
/// # Samples
///
/// A sample is a Lanczos filter with three lobes over the 6x6 pixels around a position. Its weights for 1/64 px (`wx`,
/// `wy`) are integers that add up to 128. At whole positions it is the pixel itself.
///
/// - Bytes: `clamp((sum_j wy[j] * sum_i wx[i] * p[j][i] + 2^13) >> 14, 0, 255)`, in integers.
/// - Half floats, in single precision and this order: columns `c[i] =
///   (((((p[0][i] * wy[0] + p[1][i] * wy[1]) + p[2][i] * wy[2]) + p[3][i] * wy[3]) + p[4][i] * wy[4]) + p[5][i] * wy[5]`,
///   then the same with `wx`, weights divided by 128; clamped to the range of the inner 4x4 pixels, so that highlights
///   get no halo, and rounded to the nearest half float. NaN counts as 0 and infinity as 65504 of its sign, so that
///   neither spreads beyond its 6x6 pixels.
///
/// # Merging
///
/// - Bytes: the difference is the largest of any channel; a blend is
///   `(previous * (128 - weight) + current * weight + 64) >> 7`.
/// - Half floats: channels differ by more than `n` levels if `|b - a| * 255 > n * (max(|a|, |b|) + 1/4)`; a blend is
///   `a + (b - a) * (weight / 128)`, rounded to the nearest half float.
pub trait Sampled: Pixel {
    /// Samples one position.
    fn sample(source: Source<'_, Self>, at: [i32; 2]) -> Self;

    /// Merges two samples; also returns whether their difference is to be reported.
    fn merge(from_previous: Self, from_current: Self, rule: &MergeRule) -> (Self, bool);

    /// Samples and merges a tile of 8x8 pixels: pixel (i, j) from the position `at + 64 (i, j)` of each source,
    /// into `out[j * stride + i]`. Returns the pixels to report, as bits `8 j + i`.
    ///
    /// # Panics
    /// If `out` is too small.
    fn merge_tile(
        level: SimdLevel,
        previous: TileSource<'_, Self>,
        current: TileSource<'_, Self>,
        rule: &MergeRule,
        out: &mut [Self],
        stride: usize,
    ) -> u64;

    /// Samples a tile from one picture.
    ///
    /// # Panics
    /// If `out` is too small.
    fn sample_tile(level: SimdLevel, source: TileSource<'_, Self>, out: &mut [Self], stride: usize);

    /// Samples the `wanted` pixels (bit `8 j + i`), each at its own position. Others are unchanged.
    fn sample_pixels(level: SimdLevel, source: Source<'_, Self>, at: &Positions, wanted: u64, out: &mut [Self; BLOCK]);

    /// Merges the samples of a block; returns as [`Self::merge_tile`] does.
    fn merge_block(level: SimdLevel, rule: &MergeRule, block: &mut Block<Self>) -> u64;

    /// Adds the channels of a row of pixels to `sums`, in levels from 0 to 255 (see [`Self::levels`]). Sums wrap, which
    /// those of up to 257 rows do not.
    fn add_levels(level: SimdLevel, row: &[Self], sums: &mut [[u16; 4]]);

    /// BT.601 luma of each pixel in 8 bits.
    fn lumas(level: SimdLevel, row: &[Self], lumas: &mut [u8]);

    /// Channels in integer levels: bytes unchanged; half floats clamped to 0..1, times 255, rounded.
    fn levels(self) -> [u8; 4];
}

/// BT.601 luma in 8 bits of a pixel in levels.
#[inline(always)]
pub(super) fn luma(levels: [u8; 4]) -> u8 {
    let [r, g, b, _] = levels.map(u32::from);
    // The weights are in 1/256.
    ((77 * r + 150 * g + 29 * b) >> 8) as u8
}
