//! Pictures of half floats.

use half::f16;

use super::sampled::{BLOCK, Block, Positions, Rule, Sampled};
use super::scalar::{self, taps};
use super::{Level, Source};

type Pixel = [f16; 4];

impl Sampled for Pixel {
    fn sample(source: Source<'_, Self>, at: [i32; 2]) -> Self {
        let (taps, weights) = taps(&source, at, [f16::ZERO; 4]);
        let [across, down] = weights.map(|weights| weights.map(|w| f32::from(w) / 128.0));
        let taps = taps.map(|row| row.map(|pixel| pixel.map(finite)));
        std::array::from_fn(|c| {
            let weighted = |p: [f32; 4], w: [f32; 4]| ((p[0] * w[0] + p[1] * w[1]) + p[2] * w[2]) + p[3] * w[3];
            let columns = std::array::from_fn(|i| weighted(taps.map(|row| row[i][c]), down));
            let all = taps.as_flattened().iter().map(|pixel| pixel[c]);
            let (least, largest) = (all.clone().fold(f32::INFINITY, f32::min), all.fold(f32::NEG_INFINITY, f32::max));
            f16::from_f32(weighted(columns, across).clamp(least, largest))
        })
    }

    fn merge(before: Self, after: Self, rule: &Rule) -> (Self, bool) {
        let (a, b) = (before.map(finite), after.map(finite));
        let differ_by = |levels: u8| {
            a.iter().zip(b).any(|(&a, b)| (b - a).abs() * 255.0 > f32::from(levels) * (a.abs().max(b.abs()) + 0.25))
        };
        let share = f32::from(rule.share()) / 128.0;
        let merged = if differ_by(rule.agree) {
            std::array::from_fn(|c| f16::from_f32(a[c] + (b[c] - a[c]) * share))
        } else if rule.nearer_is_current {
            after
        } else {
            before
        };
        (merged, differ_by(rule.careful))
    }

    fn tile(
        level: Level,
        previous: Source<'_, Self>,
        a: [i32; 2],
        current: Source<'_, Self>,
        b: [i32; 2],
        rule: &Rule,
        out: &mut [Self],
        stride: usize,
    ) -> u64 {
        let _ = level;
        scalar::tile(previous, a, current, b, rule, out, stride)
    }

    fn tile_of_one(level: Level, source: Source<'_, Self>, at: [i32; 2], out: &mut [Self], stride: usize) {
        let _ = level;
        scalar::tile_of_one(source, at, out, stride);
    }

    fn pixels(
        level: Level,
        previous: Source<'_, Self>,
        a: &Positions,
        current: Source<'_, Self>,
        b: &Positions,
        rule: &Rule,
        out: &mut Block<Self>,
    ) -> u64 {
        let _ = level;
        scalar::pixels(previous, a, current, b, rule, out)
    }

    fn pixels_of_one(level: Level, source: Source<'_, Self>, at: &Positions, out: &mut [Self; BLOCK]) {
        let _ = level;
        scalar::pixels_of_one(source, at, out);
    }
}

/// As a single float; what is no number as 0, the infinite as the largest half float.
fn finite(value: f16) -> f32 {
    if value.is_nan() { 0.0 } else { value.to_f32().clamp(-65504.0, 65504.0) }
}
