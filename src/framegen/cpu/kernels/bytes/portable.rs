//! The version for the compiler's vectoriser: a row of eight pixels is one vector of 32 channels.

use super::{
    BEFORE, BIAS, BLOCK, Groups, MergeRule, NEGATIVE, Patch, Pixel, Positions, ROW, SINC, SPAN, Sampled, Source, TAPS,
    TILE, TileSource, scalar,
};

/// See [`Sampled::merge_tile`].
pub(super) fn merge_tile(
    previous: TileSource<'_, Pixel>,
    current: TileSource<'_, Pixel>,
    rule: &MergeRule,
    out: &mut [Pixel],
    stride: usize,
) -> u64 {
    let (mut buffer_a, mut buffer_b) = (None, None);
    let from_previous = sampled(&Patch::new(&previous.picture, previous.at, &mut buffer_a).prefetch_ahead());
    let from_current = sampled(&Patch::new(&current.picture, current.at, &mut buffer_b).prefetch_ahead());
    let mut mask = 0;
    for j in 0..TILE {
        let (from_previous, from_current) = (from_previous[j].as_chunks::<4>().0, from_current[j].as_chunks::<4>().0);
        for (i, out) in out[j * stride..][..TILE].iter_mut().enumerate() {
            let (merged, is_reported) = Pixel::merge(from_previous[i], from_current[i], rule);
            *out = merged;
            mask |= u64::from(is_reported) << (TILE * j + i);
        }
    }
    mask
}

/// See [`Sampled::sample_tile`].
pub(super) fn sample_tile(source: TileSource<'_, Pixel>, out: &mut [Pixel], stride: usize) {
    let mut buffer = None;
    for (j, row) in sampled(&Patch::new(&source.picture, source.at, &mut buffer).prefetch_ahead()).iter().enumerate() {
        out[j * stride..][..TILE].as_flattened_mut().copy_from_slice(row);
    }
}

/// See [`Sampled::sample_pixels`].
pub(super) fn sample_pixels(source: Source<'_, Pixel>, at: &Positions, wanted: u64, out: &mut [Pixel; BLOCK]) {
    let mut groups = Groups::new(at, wanted);
    while let Some((corner, group)) = groups.next() {
        let mut buffer = None;
        for (j, row) in sampled(&Patch::new(&source, corner, &mut buffer)).iter().enumerate() {
            let pixels = out[TILE * j..].iter_mut().zip(row.as_chunks::<4>().0).enumerate();
            for (_, (out, pixel)) in pixels.filter(|(i, _)| group >> (TILE * j + i) & 1 == 1) {
                *out = *pixel;
            }
        }
    }
    scalar::sample_pixels(source, at, groups.single(), out);
}

/// Samples a tile, row by row.
fn sampled(patch: &Patch<'_>) -> [[u8; ROW]; TILE] {
    if patch.is_whole() {
        return std::array::from_fn(|j| *bytes(patch.row(j + BEFORE as usize, BEFORE as usize)));
    }
    let (across, down) = (NEGATIVE[patch.phases[0]].map(i16::from), SINC[patch.phases[1]]);
    let rows: [[i16; ROW]; SPAN] = std::array::from_fn(|j| {
        let taps: [&[u8; ROW]; TAPS] = std::array::from_fn(|i| bytes(patch.row(j, i)));
        std::array::from_fn(|i| {
            let weighted = |tap: usize| i16::from(taps[tap][i]).wrapping_mul(across[tap]);
            (0..TAPS).fold(BIAS, |sum, tap| sum.wrapping_add(weighted(tap)))
        })
    });
    std::array::from_fn(|j| {
        std::array::from_fn(|i| {
            let sum: i32 = (0..TAPS).map(|tap| i32::from(rows[j + tap][i]) * -i32::from(down[tap])).sum();
            ((sum >> 14).clamp(-128, 127) + 128) as u8
        })
    })
}

fn bytes(pixels: &[Pixel; TILE]) -> &[u8; ROW] {
    bytemuck::must_cast_ref(pixels)
}
