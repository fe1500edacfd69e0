//! Colours as numbers that can be compared and averaged.

use half::f16;

use super::kernels::Sampled;

/// A pixel whose channels can be read in levels of 1/255 of full scale.
pub(super) trait Colour: Sampled {
    fn in_levels(self) -> [f32; 4];

    fn from_levels(levels: [f32; 4]) -> Self;

    /// Luma after BT.601.
    #[inline(always)]
    fn luma(self) -> f32 {
        let [r, g, b, _] = self.in_levels();
        0.299 * r + 0.587 * g + 0.114 * b
    }

    /// [`luma`](Self::luma) of some pixels.
    #[inline(always)]
    fn lumas_of<const N: usize>(pixels: &[Self; N]) -> [f32; N] {
        let mut lumas = [0.0; N];
        lumas.iter_mut().zip(pixels).for_each(|(luma, pixel)| *luma = pixel.luma());
        lumas
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
    fn lumas_of<const N: usize>(pixels: &[Self; N]) -> [f32; N] {
        let mut lumas = [0.0; N];
        for (luma, &pixel) in lumas.iter_mut().zip(pixels) {
            // As one number, which vectors take apart faster than four bytes.
            let pixel = u32::from_le_bytes(pixel);
            let [r, g, b] = [0, 8, 16].map(|shift| (pixel >> shift & 255) as i32 as f32);
            *luma = 0.299 * r + 0.587 * g + 0.114 * b;
        }
        lumas
    }
}

impl Colour for [f16; 4] {
    /// What is no number counts as 0, the infinite as the largest finite.
    fn in_levels(self) -> [f32; 4] {
        self.map(|v| {
            let v = v.to_f32();
            if v.is_nan() { 0.0 } else { v.clamp(-65504.0, 65504.0) * 255.0 }
        })
    }

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| f16::from_f32(v / 255.0))
    }
}
