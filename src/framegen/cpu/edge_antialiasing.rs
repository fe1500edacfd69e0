//! Anti-aliasing of edges that no depth confirms.
//!
//! Optical flow comes without depth: its edges, and the motion of pixels visible only in the previous anchor, are
//! accurate to a pixel or two. A misplaced pixel's error is its contrast with the right colour, so that blending with
//! the neighbours reduces the error by more than it costs in sharpness.

use super::colour::Colour;
use super::kernels::{BLOCK, SimdLevel, TILE, tile_keys};
use super::splat_key::Key;

/// Smallest difference between motion vectors of different surfaces in a tile, in 1/64 px per component.
pub(super) const EDGE_MOTION: i32 = 3 * 64;
/// Weight of each of the four neighbours, of 128.
pub(super) const NEIGHBOUR_WEIGHT: u8 = 10;

#[cfg(test)]
crate::shader_constants::shader_constants!("EDGE_ANTIALIASING_": int EDGE_MOTION, int NEIGHBOUR_WEIGHT);

/// Pixels of a tile to blend, as bits `8 j + i`: all if it contains an edge, else those in `uncovered`.
pub(super) fn blend_mask(level: SimdLevel, keys: &[Key; BLOCK], uncovered: u64) -> u64 {
    let [min, max] = tile_keys::vector_range(level, keys);
    let is_edge = (0..2).any(|axis| max[axis] - min[axis] > EDGE_MOTION);
    if is_edge { u64::MAX } else { uncovered }
}

/// Blends each pixel in `blend_mask` with its four neighbours in the tile. `hidden` neighbours have no colour; the
/// pixel's own colour replaces them and those outside the tile.
pub(super) fn antialias<P: Colour>(tile: &mut [P; BLOCK], blend_mask: u64, hidden: u64) {
    let sharp = *tile;
    if hidden == 0 {
        let rows = sharp.as_chunks::<TILE>().0;
        for (j, to) in tile.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
            let own = &rows[j];
            let (mut left, mut right) = (*own, *own);
            left[1..].copy_from_slice(&own[..TILE - 1]);
            right[..TILE - 1].copy_from_slice(&own[1..]);
            let (above, below) = (&rows[j.saturating_sub(1)], &rows[(j + 1).min(TILE - 1)]);
            let blended = P::blended_row(own, [&left, &right, above, below], NEIGHBOUR_WEIGHT);
            for i in 0..TILE {
                to[i] = if blend_mask >> (TILE * j + i) & 1 == 1 { blended[i] } else { own[i] };
            }
        }
        return;
    }
    for index in (0..BLOCK).filter(|index| (blend_mask & !hidden) >> index & 1 == 1) {
        let [i, j] = [index % TILE, index / TILE];
        let neighbours = [
            (i > 0).then(|| index - 1),
            (i + 1 < TILE).then_some(index + 1),
            (j > 0).then(|| index - TILE),
            (j + 1 < TILE).then_some(index + TILE),
        ];
        let colour =
            |neighbours: Option<usize>| sharp[neighbours.filter(|index| hidden >> index & 1 == 0).unwrap_or(index)];
        tile[index] = sharp[index].blended(neighbours.map(colour), NEIGHBOUR_WEIGHT);
    }
}

#[cfg(test)]
mod tests {
    use super::super::splat_key;
    use super::*;

    const LEVEL: SimdLevel = SimdLevel::SCALAR;

    /// A tile with one key in its left half and another in its right half.
    fn halves(left: Key, right: Key) -> [Key; BLOCK] {
        std::array::from_fn(|index| if index % TILE < TILE / 2 { left } else { right })
    }

    #[test]
    fn edges_and_uncovered_pixels_are_blended() {
        let key = |x| splat_key::pack(9, 0, [x, 0]);
        let right = 0xf0f0_f0f0_f0f0_f0f0;
        assert_eq!(blend_mask(LEVEL, &halves(key(0), key(EDGE_MOTION + 1)), 0), u64::MAX);
        assert_eq!(blend_mask(LEVEL, &halves(key(0), key(EDGE_MOTION)), 0), 0);
        assert_eq!(blend_mask(LEVEL, &halves(key(0), key(EDGE_MOTION)), right), right);
    }

    #[test]
    fn blending_preserves_the_sum() {
        let dark = [40, 80, 120, 255];
        let mut tile = [dark; BLOCK];
        tile[27] = [168, 80, 120, 255];
        let lone = tile;
        antialias(&mut tile, u64::MAX, 0);
        for (index, pixel) in tile.iter().enumerate() {
            let red = match index {
                27 => 168 - 4 * NEIGHBOUR_WEIGHT,
                19 | 26 | 28 | 35 => 40 + NEIGHBOUR_WEIGHT,
                _ => 40,
            };
            assert_eq!(*pixel, [red, 80, 120, 255], "{index}");
        }
        // Hidden pixels neither contribute nor change; pixels outside the mask do not change.
        let mut tile = lone;
        antialias(&mut tile, u64::MAX, 1 << 27);
        assert_eq!(tile, lone);
        antialias(&mut tile, 1 << 26, 0);
        assert_eq!((tile[26][0], tile[27][0], tile[28][0]), (40 + NEIGHBOUR_WEIGHT, 168, 40));
    }

    #[test]
    fn pixels_replace_neighbours_outside_the_tile() {
        let mut tile = [[0, 0, 0, 255]; BLOCK];
        tile[0] = [128, 0, 0, 255];
        antialias(&mut tile, 1, 0);
        assert_eq!(tile[0], [128 - 2 * NEIGHBOUR_WEIGHT, 0, 0, 255]);
    }
}
