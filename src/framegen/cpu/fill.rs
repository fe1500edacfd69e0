//! Vectors for the places that nothing landed on.
//!
//! Nothing visible in the current anchor is there at phase t, so it is either something the current anchor hides
//! (background that a moving thing is about to cover), something that has left the picture, or a crack in a surface
//! that grows. All three continue a surface beside the hole: the nearest owned places to the left, right, above and
//! below are the candidates.

use rayon::prelude::*;

use super::sized;
use super::splat::{Splat, nearest};
use super::surface::Surfaces;
use crate::Result;

/// For each place at phase t, the pixel of the current anchor whose vector it takes, and whether it is borrowed.
#[derive(Debug, Default)]
pub(super) struct Filler {
    sources: Vec<u32>,
    above: Vec<u16>,
    below: Vec<u16>,
}

const NO_SOURCE: u32 = u32::MAX;
const BORROWED: u32 = 1 << 31;
const NO_ROW: u16 = u16::MAX;

/// Where a place takes its vector from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Vector {
    /// From the pixel that lands there.
    Own(usize),
    /// From a pixel that lands nearby.
    Borrowed(usize),
    /// From nowhere: nothing lands in its row nor in its column.
    Missing,
}

impl Filler {
    /// Settles the vector of every place of `splat`; returns the share of places nothing landed on.
    ///
    /// `reach` is that of `splat`. `previous` is the splat to phase 0; with it, a candidate that leads to a pixel of
    /// the previous anchor which nothing in the current one accounts for comes first. Then one whose surface the
    /// current anchor must be hiding, or has lost; then the farthest surface, then the nearest place, then left, right,
    /// above, below.
    pub(super) fn fill(
        &mut self,
        surfaces: &Surfaces,
        splat: &Splat,
        reach: f32,
        previous: Option<&Splat>,
        size: (u32, u32),
    ) -> Result<f32> {
        let (width, height) = (size.0 as usize, size.1 as usize);
        sized(&mut self.sources, width * height, NO_SOURCE)?;
        let holes: usize = self
            .sources
            .par_chunks_mut(width)
            .enumerate()
            .map(|(y, row)| {
                let mut holes = 0;
                for (x, source) in row.iter_mut().enumerate() {
                    *source = splat.owner(y * width + x).map_or(NO_SOURCE, |pixel| pixel as u32);
                    holes += usize::from(*source == NO_SOURCE);
                }
                holes
            })
            .sum();
        if holes > 0 {
            self.find_rows(splat, width, height)?;
            let (above, below) = (&self.above, &self.below);
            self.sources.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                let candidates = Candidates { surfaces, splat, reach, previous, width, height, above, below };
                candidates.fill_row(y, row);
            });
        }
        Ok(holes as f32 / (width * height) as f32)
    }

    /// Where the place at `index` takes its vector from.
    pub(super) fn vector(&self, index: usize) -> Vector {
        match self.sources[index] {
            NO_SOURCE => Vector::Missing,
            source if source & BORROWED != 0 => Vector::Borrowed((source & !BORROWED) as usize),
            source => Vector::Own(source as usize),
        }
    }

    /// For each place, the nearest row above and below in which its column is owned.
    fn find_rows(&mut self, splat: &Splat, width: usize, height: usize) -> Result<()> {
        sized(&mut self.above, width * height, NO_ROW)?;
        sized(&mut self.below, width * height, NO_ROW)?;
        let carry = |rows: &mut [u16], y: usize, from: Option<usize>| {
            for x in 0..width {
                let place = y * width + x;
                rows[place] = match from {
                    _ if splat.owner(place).is_some() => y as u16,
                    Some(from) => rows[from * width + x],
                    None => NO_ROW,
                };
            }
        };
        rayon::join(
            || (0..height).for_each(|y| carry(&mut self.above, y, y.checked_sub(1))),
            || (0..height).rev().for_each(|y| carry(&mut self.below, y, Some(y + 1).filter(|&next| next < height))),
        );
        Ok(())
    }
}

/// What the choice among neighbours needs to know.
struct Candidates<'a> {
    surfaces: &'a Surfaces,
    splat: &'a Splat,
    reach: f32,
    previous: Option<&'a Splat>,
    width: usize,
    height: usize,
    above: &'a [u16],
    below: &'a [u16],
}

impl Candidates<'_> {
    fn fill_row(&self, y: usize, row: &mut [u32]) {
        let mut x = 0;
        while x < self.width {
            if row[x] != NO_SOURCE {
                x += 1;
                continue;
            }
            let end = (x..self.width).find(|&x| row[x] != NO_SOURCE).unwrap_or(self.width);
            let (left, right) = (x.checked_sub(1), Some(end).filter(|&end| end < self.width));
            for (place, hole) in row[x..end].iter_mut().zip(x..) {
                *place = self.choose(hole, y, left, right).map_or(NO_SOURCE, |pixel| pixel as u32 | BORROWED);
            }
            x = end;
        }
    }

    /// The best of the owned places around the hole at (x, y), as the pixel that lands there.
    fn choose(&self, x: usize, y: usize, left: Option<usize>, right: Option<usize>) -> Option<usize> {
        let in_row = |column: Option<usize>| column.map(|column| (y * self.width + column, column.abs_diff(x)));
        let in_column = |rows: &[u16]| {
            let row = rows[y * self.width + x];
            (row != NO_ROW).then(|| (usize::from(row) * self.width + x, usize::from(row).abs_diff(y)))
        };
        let around = [in_row(left), in_row(right), in_column(self.above), in_column(self.below)];
        around
            .into_iter()
            .flatten()
            .filter_map(|(place, distance)| self.splat.owner(place).map(|pixel| (pixel, distance)))
            .min_by_key(|&(pixel, distance)| {
                let farthest_first = u32::MAX - self.surfaces.depth(pixel);
                (self.is_accounted_for(x, y, pixel), !self.is_gone(x, y, pixel), farthest_first, distance)
            })
            .map(|(pixel, _)| pixel)
    }

    /// Whether what the vector of `pixel` leads to in the previous anchor is visible in the current one too.
    fn is_accounted_for(&self, x: usize, y: usize, pixel: usize) -> bool {
        self.previous.is_some_and(|previous| {
            // The whole way back is 1, of which `reach` lies behind.
            previous.owner_at(self.along(x, y, pixel, 1.0 - self.reach)).is_some()
        })
    }

    /// Whether the current anchor cannot show what the vector of `pixel` leads to: it has left the picture, or
    /// something that moves otherwise is in front of it.
    fn is_gone(&self, x: usize, y: usize, pixel: usize) -> bool {
        nearest(self.along(x, y, pixel, -self.reach), self.width, self.height).is_none_or(|there| {
            !self.surfaces.move_alike(there, pixel) && self.surfaces.depth(there) < self.surfaces.depth(pixel)
        })
    }

    /// The place (x, y) carried by `reach` times the vector of `pixel`.
    fn along(&self, x: usize, y: usize, pixel: usize, reach: f32) -> [f32; 2] {
        let [mx, my] = self.surfaces.vector(pixel);
        [x as f32 + reach * mx, y as f32 + reach * my]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framegen::cpu::tests::world::guide;

    /// A row of 20 pixels, all of which leave it but two that move as stated: `(pixel, motion, depth)`. Those that
    /// leave are nearest, but for one. Gives where place 8 takes its vector from.
    fn source_of_a_hole(two: [(usize, f64, f32); 2], farthest: Option<usize>, reach: f32) -> Vector {
        let size = (20, 1);
        let guidance = guide(20, 1, |x, _| match two.iter().find(|(pixel, ..)| *pixel == x as usize) {
            Some(&(_, motion, depth)) => ([motion, 0.0], depth),
            None => ([0.0, 1.0], if farthest == Some(x as usize) { 0.9 } else { 0.0 }),
        });
        let (mut surfaces, mut at_phase, mut at_previous) = (Surfaces::default(), Splat::default(), Splat::default());
        surfaces.prepare_anchor(&guidance).unwrap();
        at_phase.splat(&surfaces, size, reach).unwrap();
        at_previous.splat(&surfaces, size, 1.0).unwrap();
        let mut filler = Filler::default();
        let previous = (reach > 0.0).then_some(&at_previous);
        assert_eq!(filler.fill(&surfaces, &at_phase, reach, previous, size).unwrap(), 18.0 / 20.0);
        assert_eq!([filler.vector(5), filler.vector(11)], [Vector::Own(two[0].0), Vector::Own(two[1].0)]);
        filler.vector(8)
    }

    #[test]
    fn of_two_surfaces_the_farther_goes_on() {
        assert_eq!(source_of_a_hole([(10, 5.0, 0.3), (4, -7.0, 0.6)], None, -1.0), Vector::Borrowed(4));
        assert_eq!(source_of_a_hole([(10, 5.0, 0.6), (4, -7.0, 0.3)], None, -1.0), Vector::Borrowed(10));
    }

    #[test]
    fn a_surface_that_would_be_visible_now_does_not_go_on() {
        // Pixel 10 leads to pixel 13, which is behind it and would show it.
        assert_eq!(source_of_a_hole([(10, 5.0, 0.6), (4, -7.0, 0.3)], Some(13), -1.0), Vector::Borrowed(4));
    }

    #[test]
    fn a_surface_whose_past_is_accounted_for_does_not_go_on() {
        // Pixel 11 leads to place 2 of the previous anchor, which is where pixel 19 comes from.
        assert_eq!(source_of_a_hole([(11, -12.0, 0.6), (19, -17.0, 0.3)], None, 0.5), Vector::Borrowed(19));
    }

    #[test]
    fn where_nothing_lands_in_row_or_column_there_is_no_vector() {
        let guidance = guide(6, 4, |x, y| if (x, y) == (1.0, 1.0) { ([0.0; 2], 0.5) } else { ([6.0, 0.0], 0.5) });
        let (mut surfaces, mut splat, mut filler) = (Surfaces::default(), Splat::default(), Filler::default());
        surfaces.prepare_anchor(&guidance).unwrap();
        splat.splat(&surfaces, (6, 4), -1.0).unwrap();
        filler.fill(&surfaces, &splat, -1.0, None, (6, 4)).unwrap();
        for place in 0..24 {
            let expected = match (place % 6, place / 6) {
                (1, 1) => Vector::Own(7),
                (1, _) | (_, 1) => Vector::Borrowed(7),
                _ => Vector::Missing,
            };
            assert_eq!(filler.vector(place), expected, "{place}");
        }
    }
}
