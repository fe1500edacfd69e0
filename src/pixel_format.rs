//! Conversion of pictures to the pixel formats of targets.

use half::f16;

/// Memory layout of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PixelFormat {
    /// Four bytes, red first.
    Rgba8,
    /// Four bytes, blue first.
    Bgra8,
    /// 10 bits each of red (lowest), green and blue, and 2 of alpha.
    Rgb10A2,
    /// Four half floats, red first, 0 to 1.
    Rgba16F,
    /// Unsigned floats: 11 bits each of red (lowest) and green, 10 of blue. No alpha.
    #[cfg_attr(not(windows), allow(dead_code, reason = "a format of textures only"))]
    Rg11B10F,
}

impl PixelFormat {
    /// Bytes of a pixel.
    pub(crate) fn bytes(self) -> usize {
        if self == Self::Rgba16F { 8 } else { 4 }
    }
}

/// Colour space of a frame. Pictures are sRGB. In a colour space that is brighter than their white, the host chooses the brightness of
/// that white; ITU-R BT.2408 recommends 203 nits for graphics.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Colours {
    /// Display-referred sRGB, as in pictures.
    #[default]
    Srgb,
    /// Linear, sRGB primaries, 1 is white. For half floats and 11/10-bit floats.
    Linear,
    /// scRGB (IEC 61966-2-2): linear, 1 is 80 nits. For half floats only.
    ScRgb {
        /// Brightness of the pictures' white.
        white_nits: f32,
    },
    /// HDR10: PQ transfer function (SMPTE ST 2084), BT.2020 primaries. For 10-bit formats only.
    Hdr10 {
        /// Brightness of the pictures' white.
        white_nits: f32,
    },
}

impl Colours {
    /// Whether `texel` can store this colour space.
    pub(crate) fn fits(self, texel: PixelFormat) -> bool {
        match self {
            Self::Srgb => true,
            Self::Linear => matches!(texel, PixelFormat::Rgba16F | PixelFormat::Rg11B10F),
            Self::ScRgb { .. } => texel == PixelFormat::Rgba16F,
            Self::Hdr10 { .. } => texel == PixelFormat::Rgb10A2,
        }
    }

    /// Scale factor of linear values in half floats; `None` for display-referred ones.
    fn linear_scale(self) -> Option<f64> {
        match self {
            Self::Linear => Some(1.0),
            Self::ScRgb { white_nits } => Some(f64::from(white_nits) / SCRGB_NITS),
            Self::Srgb | Self::Hdr10 { .. } => None,
        }
    }
}

/// Nits of the value 1 in scRGB.
pub(crate) const SCRGB_NITS: f64 = 80.0;

/// Converts rows of RGBA8 pixels to another format.
pub(crate) struct PixelConverter {
    texel: PixelFormat,
    /// Half-float value of each 8-bit level, of colour channels and of alpha; for float formats.
    halves: Option<[[f16; 256]; 2]>,
    pq: Option<Box<Pq>>,
}

/// Lookup tables for HDR10.
struct Pq {
    /// Nits of each 8-bit level.
    nits: [f32; 256],
    /// Lowest nits of each 10-bit level above 0.
    steps: [f32; 1023],
}

impl PixelConverter {
    /// An converter for `texel`, which must be able to store `colours`.
    pub(crate) fn new(texel: PixelFormat, colours: Colours) -> Self {
        let halves = matches!(texel, PixelFormat::Rgba16F | PixelFormat::Rg11B10F)
            .then(|| [halves(colours.linear_scale()), halves(None)]);
        let pq = match colours {
            Colours::Hdr10 { white_nits } => Some(Box::new(Pq::new(white_nits))),
            _ => None,
        };
        Self { texel, halves, pq }
    }

    /// Converts RGBA8 pixels; `to` must have room for as many in the target format.
    pub(crate) fn row(&self, from: &[u8], to: &mut [u8]) {
        assert_eq!(from.len() / 4 * self.texel.bytes(), to.len(), "as many pixels");
        match (self.texel, &self.halves) {
            (PixelFormat::Rgba16F, Some([colour, alpha])) => {
                for (c, (half, level)) in to.as_chunks_mut::<2>().0.iter_mut().zip(from).enumerate() {
                    *half = if c % 4 == 3 { alpha } else { colour }[usize::from(*level)].to_ne_bytes();
                }
            }
            (PixelFormat::Rg11B10F, Some([colour, _])) => {
                for (word, &[r, g, b, _]) in to.as_chunks_mut::<4>().0.iter_mut().zip(from.as_chunks::<4>().0) {
                    let [r, g, b] = [r, g, b].map(|level| colour[usize::from(level)]);
                    *word = (small_float(r, 6) | small_float(g, 6) << 11 | small_float(b, 5) << 22).to_ne_bytes();
                }
            }
            (PixelFormat::Rgb10A2, _) => {
                for (word, &[r, g, b, a]) in to.as_chunks_mut::<4>().0.iter_mut().zip(from.as_chunks::<4>().0) {
                    let [r, g, b] = match &self.pq {
                        Some(pq) => pq.levels([r, g, b]),
                        None => [r, g, b].map(|level| scaled(level, 1023)),
                    };
                    *word = (r | g << 10 | b << 20 | scaled(a, 3) << 30).to_ne_bytes();
                }
            }
            (texel, _) => {
                to.copy_from_slice(from);
                if texel == PixelFormat::Bgra8 {
                    swap_red_and_blue(to);
                }
            }
        }
    }
}

impl Pq {
    fn new(white_nits: f32) -> Self {
        let nits = |level: usize| srgb_to_linear(level as f64 / 255.0) * f64::from(white_nits);
        let step = |i: usize| pq_to_nits((i as f64 + 0.5) / 1023.0);
        Self { nits: std::array::from_fn(|i| nits(i) as f32), steps: std::array::from_fn(|i| step(i) as f32) }
    }

    /// 10-bit PQ levels of a colour, converted to BT.2020 primaries (ITU-R BT.2087).
    fn levels(&self, colour: [u8; 3]) -> [u32; 3] {
        const WIDE: [[f32; 3]; 3] = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
        let light = colour.map(|level| self.nits[usize::from(level)]);
        WIDE.map(|row| {
            let nits: f32 = row.iter().zip(light).map(|(part, light)| part * light).sum();
            self.steps.partition_point(|step| *step <= nits) as u32
        })
    }
}

/// Converts between RGBA and BGRA byte order.
pub(crate) fn swap_red_and_blue(row: &mut [u8]) {
    row.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
}

/// Rescales a level from 0..=255 to 0..=`top`, rounded to the nearest.
fn scaled(level: u8, top: u32) -> u32 {
    (u32::from(level) * top * 2 + 255) / 510
}

/// The nearest unsigned float with a half's exponent and `mantissa` mantissa bits, for halves from 0 to 1. Ties round away from zero.
fn small_float(half: f16, mantissa: u32) -> u32 {
    let dropped = 10 - mantissa;
    (u32::from(half.to_bits()) + (1 << (dropped - 1))) >> dropped
}

/// Half-float value of every 8-bit level: 0 to 1, or linear with `white` for white.
fn halves(white: Option<f64>) -> [f16; 256] {
    std::array::from_fn(|level| {
        let value = level as f64 / 255.0;
        f16::from_f64(white.map_or(value, |white| srgb_to_linear(value) * white))
    })
}

/// The sRGB curve (IEC 61966-2-1) from encoded to linear, for values from 0 to 1.
fn srgb_to_linear(shown: f64) -> f64 {
    if shown <= 0.04045 { shown / 12.92 } else { libm::pow((shown + 0.055) / 1.055, 2.4) }
}

/// The PQ curve (SMPTE ST 2084) from an encoded value in 0 to 1 to nits.
fn pq_to_nits(number: f64) -> f64 {
    let power = libm::pow(number, 1.0 / 78.843_75);
    let light = (power - 0.835_937_5).max(0.0) / (18.851_562_5 - 18.687_5 * power);
    10_000.0 * libm::pow(light, 1.0 / 0.159_301_757_812_5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_bits_are_the_nearest_of_each_level() {
        let converter = PixelConverter::new(PixelFormat::Rgb10A2, Colours::Srgb);
        for level in 0..=255_u8 {
            let mut word = [0; 4];
            converter.row(&[level, 255 - level, 0, level], &mut word);
            let word = u32::from_ne_bytes(word);
            let exact = |level: u8, top: f64| (f64::from(level) / 255.0 * top).round() as u32;
            let expected = exact(level, 1023.0) | exact(255 - level, 1023.0) << 10 | exact(level, 3.0) << 30;
            assert_eq!(word, expected, "{level}");
        }
    }

    #[test]
    fn floats_of_eleven_and_ten_bits_are_within_half_a_step_of_each_level() {
        // Decodes a float with 5 exponent bits, bias 15.
        let value = |bits: u32, mantissa: u32| {
            let (exponent, part) = (bits >> mantissa, f64::from(bits & ((1 << mantissa) - 1)));
            let steps = f64::from(1 << mantissa);
            match exponent {
                0 => part / steps * 2.0_f64.powi(-14),
                _ => (1.0 + part / steps) * 2.0_f64.powi(exponent as i32 - 15),
            }
        };
        for colours in [Colours::Srgb, Colours::Linear] {
            let converter = PixelConverter::new(PixelFormat::Rg11B10F, colours);
            for level in 0..=255_u8 {
                let mut word = [0; 4];
                converter.row(&[level, 255 - level, level, 7], &mut word);
                let word = u32::from_ne_bytes(word);
                let exact = |level: u8| {
                    let shown = f64::from(level) / 255.0;
                    if colours == Colours::Linear { srgb_to_linear(shown) } else { shown }
                };
                let found = [(word & 2047, 6, level), (word >> 11 & 2047, 6, 255 - level), (word >> 22, 5, level)];
                for (bits, mantissa, level) in found {
                    let (value, exact) = (value(bits, mantissa), exact(level));
                    let step = 2.0_f64.powi(-(mantissa as i32) - 1) * exact.max(2.0_f64.powi(-14)) * 1.01;
                    assert!((value - exact).abs() <= step, "{colours:?} {level}: {value} for {exact}");
                }
            }
        }
    }

    /// Values of the standard: black and white of graphics, and peak brightness.
    #[test]
    fn hdr10_has_the_numbers_of_its_curve_and_primaries() {
        let ten_bits = |colour: [u8; 3], white_nits: f32| {
            let mut word = [0; 4];
            PixelConverter::new(PixelFormat::Rgb10A2, Colours::Hdr10 { white_nits })
                .row(&[colour[0], colour[1], colour[2], 255], &mut word);
            let word = u32::from_ne_bytes(word);
            [word & 1023, word >> 10 & 1023, word >> 20 & 1023, word >> 30]
        };
        assert_eq!(ten_bits([0; 3], 203.0), [0, 0, 0, 3]);
        // In PQ, 203 nits are 58 % of the code range, 100 nits 50.8 %, and 10,000 nits 100 %.
        for (nits, share) in [(203.0, 0.5807), (100.0, 0.5081), (10_000.0, 1.0)] {
            let level: f64 = 1023.0 * share;
            let [r, g, b, _] = ten_bits([255; 3], nits).map(f64::from);
            assert!([r, g, b].iter().all(|found| (found - level).abs() <= 1.0), "{nits}: {r} {g} {b} for {level}");
        }
        // sRGB red lies inside BT.2020, so the other channels are not 0.
        let [r, g, b, _] = ten_bits([255, 0, 0], 203.0);
        assert!(r > g && g > b && b > 0, "{r} {g} {b}");
    }
}
