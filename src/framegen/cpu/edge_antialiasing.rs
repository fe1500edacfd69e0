//! Edges between surfaces that nothing but pictures tells apart.
//!
//! Where depth says which surface is in front, an edge runs where it says. Motion that sharp found in pictures comes without
//! depth: its edges are right to a pixel or two, and so is where things go that only the previous anchor shows. A colour
//! neighbours its index is wrong by its contrast with what belongs there, so that a little contrast less takes away more error
//! than sharpness.

use super::colour::Colour;
use super::kernels::{BLOCK, SimdLevel, TILE, tile_keys};
use super::splat_key::Key;

/// Vectors of a tile that are farther apart than this along an axis are those of several surfaces, in 1/64 px.
pub(super) const EDGE_MOTION: i32 = 3 * 64;
/// The share of each of the four pixels neighbours one in its blended colour, of 128.
pub(super) const NEIGHBOUR_WEIGHT: u8 = 10;

/// Which pixels of a whole tile take a share of those neighbours them, bit `8 j + i`: all where several surfaces meet, else
/// those in `uncovered`, which nothing visible in the current anchor warped on.
pub(super) fn blend_mask(level: SimdLevel, keys: &[Key; BLOCK], uncovered: u64) -> u64 {
    let [least, largest] = tile_keys::vector_range(level, keys);
    let is_edge = (0..2).any(|axis| largest[axis] - least[axis] > EDGE_MOTION);
    if is_edge { u64::MAX } else { uncovered }
}

/// Gives each pixel of a tile in `blend_mask` its share of those neighbours it in the tile, as they were. Those in `hidden` have no
/// colour; in their index, and in that of pixels outside the tile, a pixel's own counts.
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

    /// The left half of a tile with one claim, the right one with another.
    fn halves(left: Key, right: Key) -> [Key; BLOCK] {
        std::array::from_fn(|index| if index % TILE < TILE / 2 { left } else { right })
    }

    #[test]
    fn a_tile_is_soft_where_surfaces_part_and_else_where_nothing_landed() {
        let claim = |x| splat_key::pack(9, 0, [x, 0]);
        let right = 0xf0f0_f0f0_f0f0_f0f0;
        assert_eq!(blend_mask(LEVEL, &halves(claim(0), claim(EDGE_MOTION + 1)), 0), u64::MAX);
        assert_eq!(blend_mask(LEVEL, &halves(claim(0), claim(EDGE_MOTION)), 0), 0);
        assert_eq!(blend_mask(LEVEL, &halves(claim(0), claim(EDGE_MOTION)), right), right);
    }

    #[test]
    fn softening_moves_contrast_and_keeps_the_sum() {
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
        // What is hidden gives nothing and takes nothing, and nothing else is touched.
        let mut tile = lone;
        antialias(&mut tile, u64::MAX, 1 << 27);
        assert_eq!(tile, lone);
        antialias(&mut tile, 1 << 26, 0);
        assert_eq!((tile[26][0], tile[27][0], tile[28][0]), (40 + NEIGHBOUR_WEIGHT, 168, 40));
    }

    #[test]
    fn corners_count_themselves_for_what_is_outside() {
        let mut tile = [[0, 0, 0, 255]; BLOCK];
        tile[0] = [128, 0, 0, 255];
        antialias(&mut tile, 1, 0);
        assert_eq!(tile[0], [128 - 2 * NEIGHBOUR_WEIGHT, 0, 0, 255]);
    }
}
