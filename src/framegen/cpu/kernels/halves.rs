//! Kernels for pictures of half floats.

mod vectors;

use half::f16;

use super::lanczos::TAPS;
use super::ranges::widened;
use super::sampling::{BLOCK, Block, MergeRule, Positions, Sampled, TileSource, luma};
use super::scalar::{self, taps};
use super::{SimdLevel, Source, at_every_level};

type Pixel = [f16; 4];

impl Sampled for Pixel {
    fn sample(source: Source<'_, Self>, at: [i32; 2]) -> Self {
        let (taps, weights) = taps(&source, at, [f16::ZERO; 4]);
        let [across, down] = weights.map(|weights| weights.map(|w| f32::from(w) / 128.0));
        let taps = taps.map(|row| row.map(|pixel| pixel.map(finite)));
        std::array::from_fn(|c| {
            let weighted =
                |p: [f32; TAPS], w: [f32; TAPS]| (1..TAPS).fold(p[0] * w[0], |sum, tap| sum + p[tap] * w[tap]);
            let columns = std::array::from_fn(|i| weighted(taps.map(|row| row[i][c]), down));
            let inner = taps[1..TAPS - 1].iter().flat_map(|row| &row[1..TAPS - 1]).map(|pixel| pixel[c]);
            let (least, largest) =
                (inner.clone().fold(f32::INFINITY, f32::min), inner.fold(f32::NEG_INFINITY, f32::max));
            // Adding 0 turns -0 into 0.
            f16::from_f32(weighted(columns, across).clamp(least, largest) + 0.0)
        })
    }

    fn merge(from_previous: Self, from_current: Self, rule: &MergeRule) -> (Self, bool) {
        let (a, b) = (from_previous.map(finite), from_current.map(finite));
        let differ_by = |levels: u8| {
            a.iter().zip(b).any(|(&a, b)| (b - a).abs() * 255.0 > f32::from(levels) * (a.abs().max(b.abs()) + 0.25))
        };
        let share = f32::from(rule.share()) / 128.0;
        let merged = if differ_by(rule.max_equal_difference) {
            std::array::from_fn(|c| f16::from_f32(a[c] + (b[c] - a[c]) * share))
        } else if rule.nearer_is_current {
            from_current
        } else {
            from_previous
        };
        (merged, differ_by(rule.doubt_threshold))
    }

    fn merge_tile(
        level: SimdLevel,
        previous: TileSource<'_, Self>,
        current: TileSource<'_, Self>,
        rule: &MergeRule,
        out: &mut [Self],
        stride: usize,
    ) -> u64 {
        merge_tile(level, previous, current, rule, out, stride)
    }

    fn sample_tile(level: SimdLevel, source: TileSource<'_, Self>, out: &mut [Self], stride: usize) {
        sample_tile(level, source, out, stride);
    }

    fn sample_pixels(level: SimdLevel, source: Source<'_, Self>, at: &Positions, wanted: u64, out: &mut [Self; BLOCK]) {
        sample_pixels(level, source, at, wanted, out);
    }

    fn merge_block(level: SimdLevel, rule: &MergeRule, block: &mut Block<Self>) -> u64 {
        merge_block(level, rule, block)
    }

    fn add_levels(level: SimdLevel, row: &[Self], sums: &mut [[u16; 4]]) {
        add_levels(level, row, sums);
    }

    fn lumas(level: SimdLevel, row: &[Self], lumas: &mut [u8]) {
        lumas_of(level, row, lumas);
    }

    fn levels(self) -> [u8; 4] {
        self.map(|v| (finite(v).clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
    }
}

at_every_level! {
    fn merge_tile(
        previous: TileSource<'_, Pixel>,
        current: TileSource<'_, Pixel>,
        rule: &MergeRule,
        out: &mut [Pixel], stride: usize,
    ) -> u64 = scalar::merge_tile | vectors::merge_tile
}

at_every_level! {
    fn sample_tile(source: TileSource<'_, Pixel>, out: &mut [Pixel], stride: usize)
        = scalar::sample_tile | vectors::sample_tile
}

at_every_level! {
    fn sample_pixels(source: Source<'_, Pixel>, at: &Positions, wanted: u64, out: &mut [Pixel; BLOCK])
        = scalar::sample_pixels | vectors::sample_pixels
}

at_every_level! {
    fn merge_block(rule: &MergeRule, block: &mut Block<Pixel>) -> u64 = scalar::merge_block | vectors::merge_block
}

at_every_level! {
    fn add_levels(row: &[Pixel], sums: &mut [[u16; 4]]) = scalar::add_levels | add_levels_in_vectors
}

at_every_level! {
    fn lumas_of(row: &[Pixel], lumas: &mut [u8]) = scalar::lumas | lumas_in_vectors
}

#[inline(always)]
fn add_levels_in_vectors(row: &[Pixel], sums: &mut [[u16; 4]]) {
    for (sum, value) in sums.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
        *sum = sum.wrapping_add(level_of(value.to_bits()));
    }
}

#[inline(always)]
fn lumas_in_vectors(row: &[Pixel], lumas: &mut [u8]) {
    for (value, pixel) in lumas.iter_mut().zip(row) {
        *value = luma(pixel.map(|v| level_of(v.to_bits()) as u8));
    }
}

/// Level of a half float, from its bits.
#[inline(always)]
fn level_of(bits: u16) -> u16 {
    // Negative values and NaN become 0, values above 1 become 1: the bits of positive half floats are ordered like
    // their values.
    const INFINITE: u16 = 0x7c00;
    const ONE: u16 = 0x3c00;
    let inside = if bits > INFINITE { 0 } else { bits.min(ONE) };
    (widened(inside) * 255.0 + 0.5) as i32 as u16
}

/// As single precision; NaN becomes 0, infinity the largest finite half float.
fn finite(value: f16) -> f32 {
    if value.is_nan() { 0.0 } else { value.to_f32().clamp(-65504.0, 65504.0) }
}
