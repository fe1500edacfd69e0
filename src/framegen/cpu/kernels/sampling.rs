//! What can be sampled and merged, and the rule by which two samples become one.

use super::{SimdLevel, Source};
use crate::picture::Pixel;

/// Side of a tile, in pixels.
pub const TILE: usize = 8;
/// Pixels of a block: as many as a tile has.
pub const BLOCK: usize = TILE * TILE;

/// How the samples of two anchors become one pixel: the one nearer in time where they max_equal_difference, else a mixture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    /// Share of the current anchor in a mixture, of 128: 1 to 127; what lies outside counts as the nearest of these.
    pub weight: u8,
    /// Whether the current anchor is the nearer.
    pub nearer_is_current: bool,
    /// Samples that differ by no more than this many levels in any channel max_equal_difference.
    pub max_equal_difference: u8,
    /// Samples that differ by more than this many levels in some channel are reported.
    pub doubt_threshold: u8,
}

impl Rule {
    /// The share of the current anchor in a mixture, of 128.
    pub(super) fn share(&self) -> u8 {
        self.weight.clamp(1, 127)
    }
}

/// Positions of the pixels of a block, in 1/64 px.
#[derive(Debug, Clone, Copy)]
pub struct Positions {
    /// Across.
    pub x: [i32; BLOCK],
    /// Down.
    pub y: [i32; BLOCK],
}

/// What was made of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block<P> {
    /// The samples of the previous anchor.
    pub previous: [P; BLOCK],
    /// The samples of the current anchor.
    pub current: [P; BLOCK],
    /// Both merged.
    pub merged: [P; BLOCK],
}

/// A pixel that pictures are sampled in and merged.
///
/// # Samples
///
/// A sample is the windowed sinc of Lanczos with three lobes over the 6 x 6 pixels around a position, with the weights
/// of its 1/64 px as whole numbers that add up to 128 (`wx`, `wy`). At whole positions it is the pixel itself.
///
/// - Bytes: `clamp((sum_j wy[j] * sum_i wx[i] * p[j][i] + 2^13) >> 14, 0, 255)`, in whole numbers.
/// - Half floats, in single precision and this order: columns `c[i] = (((((p[0][i] * wy[0] + p[1][i] * wy[1]) + p[2][i] *
///   wy[2]) + p[3][i] * wy[3]) + p[4][i] * wy[4]) + p[5][i] * wy[5]`, then the same of these with `wx`, the weights
///   divided by 128; kept between the least and the largest of the inner 4 x 4, so that highlights get no halo, and
///   rounded to the nearest half float. What is no number counts as 0 and the infinite as 65504 of its sign, so that
///   nothing spreads beyond its 6 x 6.
///
/// # Merging
///
/// - Bytes: the difference is that of the channel where it is largest; a mixture is
///   `(from_previous * (128 - weight) + from_current * weight + 64) >> 7`.
/// - Half floats: a channel differs by more than `n` levels where `|b - a| * 255 > n * (max(|a|, |b|) + 1/4)`; a
///   mixture is `a + (b - a) * (weight / 128)`, rounded to the nearest half float.
pub trait Sampled: Pixel {
    /// The sample at one position.
    fn sample(source: Source<'_, Self>, at: [i32; 2]) -> Self;

    /// One pixel from two, and whether the two differ so much that it is to be reported.
    fn merge(from_previous: Self, from_current: Self, rule: &Rule) -> (Self, bool);

    /// A tile of 8 x 8 pixels, merged: the pixel (i, j) comes from `a + 64 (i, j)` in `previous` and `b + 64 (i, j)` in
    /// `current`, and goes to `out[j * stride + i]`. Bit `8 j + i` of the result says that it is reported.
    ///
    /// # Panics
    /// When `out` is too small for that.
    #[expect(clippy::too_many_arguments, reason = "two pictures, a place in each, and a place for the result")]
    fn tile(
        level: SimdLevel,
        previous: Source<'_, Self>,
        a: [i32; 2],
        current: Source<'_, Self>,
        b: [i32; 2],
        rule: &Rule,
        out: &mut [Self],
        stride: usize,
    ) -> u64;

    /// A tile from one picture alone.
    ///
    /// # Panics
    /// When `out` is too small for that.
    fn tile_of_one(level: SimdLevel, source: Source<'_, Self>, at: [i32; 2], out: &mut [Self], stride: usize);

    /// Those of sixty-four pixels that are `wanted` (bit `8 j + i`), each from a place of its own. Others are left as they
    /// are.
    fn pixels_of_one(level: SimdLevel, source: Source<'_, Self>, at: &Positions, wanted: u64, out: &mut [Self; BLOCK]);

    /// Merges the samples of a block. Bits as for [`Self::tile`].
    fn merge_block(level: SimdLevel, rule: &Rule, block: &mut Block<Self>) -> u64;

    /// Adds the channels of a row of pixels to `sums`, in whole levels from 0 to 255 (see [`Self::levels`]); sums wrap
    /// around, which those of up to 257 rows do not.
    fn add_levels(level: SimdLevel, row: &[Self], sums: &mut [[u16; 4]]);

    /// The luma of each pixel in 8 bits, from_current BT.601.
    fn lumas(level: SimdLevel, row: &[Self], lumas: &mut [u8]);

    /// The channels in whole levels: bytes as they are; of half floats, 255 times what lies in 0 to 1, rounded.
    fn levels(self) -> [u8; 4];
}

/// The luma of BT.601 of a pixel in levels, in 8 bits.
#[inline(always)]
pub(super) fn luma(levels: [u8; 4]) -> u8 {
    let [r, g, b, _] = levels.map(u32::from);
    // The weights over 256, which they add up to.
    ((77 * r + 150 * g + 29 * b) >> 8) as u8
}
