//! Edges between surfaces that nothing but pictures tells apart.
//!
//! Where depth says which surface is in front, an edge runs where it says. Motion that was found in pictures comes without
//! depth: its edges are right to a pixel or two, and so is where things go that only the previous anchor shows. A colour
//! beside its place is wrong by its contrast with what belongs there, so that a little contrast less takes away more error
//! than sharpness.

use super::colour::Colour;
use super::kernels::{BLOCK, Level, TILE, tile_keys};
use super::key_buffer::Key;

/// Vectors of a tile that are farther apart than this along an axis are those of several surfaces, in 1/64 px.
pub(super) const TORN: i32 = 3 * 64;
/// The share of each of the four pixels beside one in its softened colour, of 128.
pub(super) const SHARE: u8 = 10;

/// Which pixels of a whole tile take a share of those beside them, bit `8 j + i`: all where several surfaces meet, else
/// those in `loose`, which nothing visible in the current anchor landed on.
pub(super) fn soft(level: Level, keys: &[Key; BLOCK], loose: u64) -> u64 {
    let [least, largest] = tile_keys::span(level, keys);
    let is_torn = (0..2).any(|axis| largest[axis] - least[axis] > TORN);
    if is_torn { u64::MAX } else { loose }
}

/// Gives each pixel of a tile in `soft` its share of those beside it in the tile, as they were. Those in `hidden` have no
/// colour; in their place, and in that of pixels outside the tile, a pixel's own counts.
pub(super) fn soften<P: Colour>(tile: &mut [P; BLOCK], soft: u64, hidden: u64) {
    let was = *tile;
    if hidden == 0 {
        let rows = was.as_chunks::<TILE>().0;
        for (j, to) in tile.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
            let own = &rows[j];
            let (mut left, mut right) = (*own, *own);
            left[1..].copy_from_slice(&own[..TILE - 1]);
            right[..TILE - 1].copy_from_slice(&own[1..]);
            let (above, below) = (&rows[j.saturating_sub(1)], &rows[(j + 1).min(TILE - 1)]);
            let softened = P::softened_row(own, [&left, &right, above, below], SHARE);
            for i in 0..TILE {
                to[i] = if soft >> (TILE * j + i) & 1 == 1 { softened[i] } else { own[i] };
            }
        }
        return;
    }
    for place in (0..BLOCK).filter(|place| (soft & !hidden) >> place & 1 == 1) {
        let [i, j] = [place % TILE, place / TILE];
        let beside = [
            (i > 0).then(|| place - 1),
            (i + 1 < TILE).then_some(place + 1),
            (j > 0).then(|| place - TILE),
            (j + 1 < TILE).then_some(place + TILE),
        ];
        let colour = |beside: Option<usize>| was[beside.filter(|place| hidden >> place & 1 == 0).unwrap_or(place)];
        tile[place] = was[place].softened(beside.map(colour), SHARE);
    }
}

#[cfg(test)]
mod tests {
    use super::super::key_buffer;
    use super::*;

    const LEVEL: Level = Level::SCALAR;

    /// The left half of a tile with one claim, the right one with another.
    fn halves(left: Key, right: Key) -> [Key; BLOCK] {
        std::array::from_fn(|place| if place % TILE < TILE / 2 { left } else { right })
    }

    #[test]
    fn a_tile_is_soft_where_surfaces_part_and_else_where_nothing_landed() {
        let claim = |x| key_buffer::key(9, 0, [x, 0]);
        let right = 0xf0f0_f0f0_f0f0_f0f0;
        assert_eq!(soft(LEVEL, &halves(claim(0), claim(TORN + 1)), 0), u64::MAX);
        assert_eq!(soft(LEVEL, &halves(claim(0), claim(TORN)), 0), 0);
        assert_eq!(soft(LEVEL, &halves(claim(0), claim(TORN)), right), right);
    }

    #[test]
    fn softening_moves_contrast_and_keeps_the_sum() {
        let dark = [40, 80, 120, 255];
        let mut tile = [dark; BLOCK];
        tile[27] = [168, 80, 120, 255];
        let lone = tile;
        soften(&mut tile, u64::MAX, 0);
        for (place, pixel) in tile.iter().enumerate() {
            let red = match place {
                27 => 168 - 4 * SHARE,
                19 | 26 | 28 | 35 => 40 + SHARE,
                _ => 40,
            };
            assert_eq!(*pixel, [red, 80, 120, 255], "{place}");
        }
        // What is hidden gives nothing and takes nothing, and nothing else is touched.
        let mut tile = lone;
        soften(&mut tile, u64::MAX, 1 << 27);
        assert_eq!(tile, lone);
        soften(&mut tile, 1 << 26, 0);
        assert_eq!((tile[26][0], tile[27][0], tile[28][0]), (40 + SHARE, 168, 40));
    }

    #[test]
    fn corners_count_themselves_for_what_is_outside() {
        let mut tile = [[0, 0, 0, 255]; BLOCK];
        tile[0] = [128, 0, 0, 255];
        soften(&mut tile, 1, 0);
        assert_eq!(tile[0], [128 - 2 * SHARE, 0, 0, 255]);
    }
}
