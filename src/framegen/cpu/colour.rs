//! Arithmetic with colours.

use half::f16;

use super::kernels::{Sampled, TILE};

/// A pixel whose channels can be converted to levels, 1/255 of full scale.
pub(super) trait Colour: Sampled {
    fn in_levels(self) -> [f32; 4];

    fn from_levels(levels: [f32; 4]) -> Self;

    /// Blends the pixel with its four neighbours, `weight` / 128 each.
    ///
    /// - Bytes: `(own * (128 - 4 weight) + (left + right + above + below) * weight + 64) >> 7`.
    /// - Half floats, in single precision and this order: `own + ((((left - own) + (right - own)) + (above - own)) +
    ///   (below - own)) * (weight / 128)`, rounded to the nearest half float. NaN and infinity as in [`Sampled`].
    fn blended(self, neighbours: [Self; 4], weight: u8) -> Self;

    /// The same for a row of pixels.
    #[inline(always)]
    fn blended_row(own: &[Self; TILE], [left, right, above, below]: [&[Self; TILE]; 4], weight: u8) -> [Self; TILE] {
        let mut out = *own;
        for i in 0..TILE {
            out[i] = own[i].blended([left[i], right[i], above[i], below[i]], weight);
        }
        out
    }

    /// BT.601 luma.
    #[inline(always)]
    fn luma(self) -> f32 {
        let [r, g, b, _] = self.in_levels();
        0.299 * r + 0.587 * g + 0.114 * b
    }

    /// [`luma`](Self::luma) of several pixels.
    #[inline(always)]
    fn lumas_of<const N: usize>(pixels: &[Self; N]) -> [f32; N] {
        let mut lumas = [0.0; N];
        lumas.iter_mut().zip(pixels).for_each(|(luma, pixel)| *luma = pixel.luma());
        lumas
    }

    /// Sum of a tile's pixels in row order; `pixels` starts at the first one and has rows of `width` pixels.
    #[inline(always)]
    fn sum_of_tile(pixels: &[Self], width: usize) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for pixel in pixels.chunks(width).take(TILE).flat_map(|row| &row[..TILE]) {
            let levels = pixel.in_levels();
            (0..4).for_each(|c| sum[c] += levels[c]);
        }
        sum
    }
}

impl Colour for [u8; 4] {
    #[inline(always)]
    fn in_levels(self) -> [f32; 4] {
        let [r, g, b, a] = self;
        [f32::from(r), f32::from(g), f32::from(b), f32::from(a)]
    }

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| (v + 0.5) as u8)
    }

    #[inline(always)]
    fn blended(self, [left, right, above, below]: [Self; 4], weight: u8) -> Self {
        let weight = u16::from(weight);
        std::array::from_fn(|c| {
            let [own, left, right, above, below] = [self, left, right, above, below].map(|pixel| u16::from(pixel[c]));
            ((own * (128 - 4 * weight) + (left + right + above + below) * weight + 64) >> 7) as u8
        })
    }

    #[inline(always)]
    fn blended_row(own: &[Self; TILE], neighbours: [&[Self; TILE]; 4], weight: u8) -> [Self; TILE] {
        let [left, right, above, below] = neighbours.map(|row| row.as_flattened());
        let (mut out, own, weight) = (*own, own.as_flattened(), u16::from(weight));
        for (i, out) in out.as_flattened_mut().iter_mut().enumerate() {
            let sum = u16::from(left[i]) + u16::from(right[i]) + u16::from(above[i]) + u16::from(below[i]);
            *out = ((u16::from(own[i]) * (128 - 4 * weight) + sum * weight + 64) >> 7) as u8;
        }
        out
    }

    #[inline(always)]
    fn lumas_of<const N: usize>(pixels: &[Self; N]) -> [f32; N] {
        let mut lumas = [0.0; N];
        for (luma, &pixel) in lumas.iter_mut().zip(pixels) {
            // As one integer, which vectorises better than four bytes.
            let pixel = u32::from_le_bytes(pixel);
            let (r, g, b) = (pixel & 255, pixel >> 8 & 255, pixel >> 16 & 255);
            let (r, g, b) = (r as i32 as f32, g as i32 as f32, b as i32 as f32);
            *luma = 0.299 * r + 0.587 * g + 0.114 * b;
        }
        lumas
    }

    /// Every partial sum is exact in single precision, so that the order does not matter.
    #[inline(always)]
    fn sum_of_tile(pixels: &[Self], width: usize) -> [f32; 4] {
        let mut sums = [0_u16; 4 * TILE];
        for row in pixels.chunks(width).take(TILE) {
            for (sum, &channel) in sums.iter_mut().zip(row[..TILE].as_flattened()) {
                *sum += u16::from(channel);
            }
        }
        std::array::from_fn(|c| sums.iter().skip(c).step_by(4).sum::<u16>().into())
    }
}

impl Colour for [f16; 4] {
    /// NaN counts as 0, infinity as the largest finite half float.
    fn in_levels(self) -> [f32; 4] {
        self.map(|v| finite(v) * 255.0)
    }

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| f16::from_f32(v / 255.0))
    }

    fn blended(self, [left, right, above, below]: [Self; 4], weight: u8) -> Self {
        let weight = f32::from(weight) / 128.0;
        std::array::from_fn(|c| {
            let [own, left, right, above, below] = [self, left, right, above, below].map(|pixel| finite(pixel[c]));
            f16::from_f32(own + ((((left - own) + (right - own)) + (above - own)) + (below - own)) * weight)
        })
    }
}

/// NaN counts as 0, infinity as the largest finite half float.
#[inline(always)]
fn finite(value: f16) -> f32 {
    let value = value.to_f32();
    if value.is_nan() { 0.0 } else { value.clamp(-65504.0, 65504.0) }
}
