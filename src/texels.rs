//! Pixels of a picture in the formats of targets.

use half::f16;

/// How a pixel lies in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Texel {
    /// Four bytes, red first.
    Rgba8,
    /// Four bytes, blue first.
    Bgra8,
    /// Ten bits of red, the lowest, of green and of blue, two of alpha.
    #[cfg_attr(not(any(windows, test)), expect(dead_code, reason = "targets of Direct3D have it"))]
    Rgb10A2,
    /// Four half floats, red first, 0 to 1.
    Rgba16F,
}

impl Texel {
    /// Bytes of a pixel.
    pub(crate) fn bytes(self) -> usize {
        if self == Self::Rgba16F { 8 } else { 4 }
    }
}

/// Writes rows of a picture's pixels in another format.
pub(crate) struct Encoder {
    texel: Texel,
    /// Each level of a colour and of alpha as half floats, where that is the format.
    halves: Option<[[f16; 256]; 2]>,
}

impl Encoder {
    /// For `texel`; in `linear` light, which only half floats can be in.
    pub(crate) fn new(texel: Texel, linear: bool) -> Self {
        Self { texel, halves: (texel == Texel::Rgba16F).then(|| [halves(linear), halves(false)]) }
    }

    /// Writes RGBA8 pixels; `to` has room for as many in the format.
    pub(crate) fn row(&self, from: &[u8], to: &mut [u8]) {
        assert_eq!(from.len() / 4 * self.texel.bytes(), to.len(), "as many pixels");
        match (self.texel, &self.halves) {
            (Texel::Rgba16F, Some([colour, alpha])) => {
                for (c, (half, level)) in to.as_chunks_mut::<2>().0.iter_mut().zip(from).enumerate() {
                    *half = if c % 4 == 3 { alpha } else { colour }[usize::from(*level)].to_ne_bytes();
                }
            }
            (Texel::Rgb10A2, _) => {
                for (word, &[r, g, b, a]) in to.as_chunks_mut::<4>().0.iter_mut().zip(from.as_chunks::<4>().0) {
                    let [r, g, b] = [r, g, b].map(|level| scaled(level, 1023));
                    *word = (r | g << 10 | b << 20 | scaled(a, 3) << 30).to_ne_bytes();
                }
            }
            (texel, _) => {
                to.copy_from_slice(from);
                if texel == Texel::Bgra8 {
                    swap_red_and_blue(to);
                }
            }
        }
    }
}

/// Between the two orders of four bytes.
pub(crate) fn swap_red_and_blue(row: &mut [u8]) {
    row.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
}

/// A level of 255 as the nearest one of `top`.
fn scaled(level: u8, top: u32) -> u32 {
    (u32::from(level) * top * 2 + 255) / 510
}

/// Every 8-bit level as a half float from 0 to 1, also brought to linear light by the curve of sRGB (IEC 61966-2-1).
fn halves(linear: bool) -> [f16; 256] {
    std::array::from_fn(|level| {
        let value = level as f64 / 255.0;
        f16::from_f64(match value {
            v if !linear => v,
            v if v <= 0.04045 => v / 12.92,
            v => libm::pow((v + 0.055) / 1.055, 2.4),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_bits_are_the_nearest_of_each_level() {
        let encoder = Encoder::new(Texel::Rgb10A2, false);
        for level in 0..=255_u8 {
            let mut word = [0; 4];
            encoder.row(&[level, 255 - level, 0, level], &mut word);
            let word = u32::from_ne_bytes(word);
            let exact = |level: u8, top: f64| (f64::from(level) / 255.0 * top).round() as u32;
            let expected = exact(level, 1023.0) | exact(255 - level, 1023.0) << 10 | exact(level, 3.0) << 30;
            assert_eq!(word, expected, "{level}");
        }
    }
}
