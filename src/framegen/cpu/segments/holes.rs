//! Segments for the pixels that no segment covers. In: segments of a time, of which some pixels are in none, and the motion of the current anchor.
//! Out: the same with every pixel in a segment.
//!
//! In the previous anchor such pixels show what the current one hides, or what has left it since; between the anchors they show what no
//! segment reaches. Both continue a surface beside them.

use super::super::colour::Colour;
use super::super::kernels::{Level, Source, TILE};
use super::super::layer::{self, EMPTY, Grid, HOLE, Key, ORPHAN, alike, is_nearer, key, part, slopes};
use super::super::leaving::Leaving;
use super::super::past::Past;
use super::super::perspective::Way;
use super::super::sized;
use super::field::cluster;
use super::tiles::{SLOTS, Segment, Segments, TilesMut, each, inside};
use crate::Result;
use crate::guidance::DepthMap;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Surfaces are looked for up to this many pixels away.
const FARTHEST: usize = 256;
/// Distance in pixels of two pixels of one surface with a crack between them.
const CRACK: usize = 3;

/// The pixels of every tile that some segment covers; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Covers {
    masks: Vec<u64>,
    count: usize,
}

impl Covers {
    /// Finds the covers of `segments`.
    pub(super) fn find(&mut self, segments: &Segments) -> Result<()> {
        let grid = segments.grid;
        sized(&mut self.masks, grid.tiles(), 0)?;
        let holes = std::sync::atomic::AtomicUsize::new(0);
        self.masks.par_chunks_mut(grid.columns).with_min_len(8).enumerate().for_each(|(row, masks)| {
            let mut count = 0;
            for (column, mask) in masks.iter_mut().enumerate() {
                *mask = segments.of(row * grid.columns + column).fold(0, |all, segment| all | segment.mask);
                count += (inside(grid.extent(column, row)) & !*mask).count_ones() as usize;
            }
            holes.fetch_add(count, std::sync::atomic::Ordering::Relaxed);
        });
        self.count = holes.into_inner();
        Ok(())
    }

    /// Number of pixels that nothing covers.
    pub(super) fn holes(&self) -> usize {
        self.count
    }

    pub(super) fn of(&self, tile: usize) -> u64 {
        self.masks[tile]
    }

    /// The nearest covered pixel in one direction along an axis.
    #[inline(always)]
    fn nearest(&self, grid: Grid, at: [usize; 2], axis: usize, forward: bool) -> Option<([usize; 2], usize)> {
        let size = [grid.width, grid.height];
        let room = if forward { size[axis] - 1 - at[axis] } else { at[axis] }.min(FARTHEST);
        let mut step = 1;
        while step <= room {
            let mut there = at;
            there[axis] = if forward { at[axis] + step } else { at[axis] - step };
            let (tile, pixel) = grid.place(there[0], there[1]);
            let mask = self.masks[tile];
            if mask >> pixel & 1 == 1 {
                return Some((there, step));
            }
            let along = there[axis] % TILE;
            step += if mask == 0 { if forward { TILE - along } else { along + 1 } } else { 1 };
        }
        None
    }
}

/// What pixels without a segment are judged by.
pub(super) struct Evidence<'a, P> {
    /// The current anchor's motion.
    pub(super) field: &'a Segments,
    /// From the current anchor to this time.
    pub(super) way: Way,
    /// The current anchor's depth.
    pub(super) depth: &'a DepthMap,
    /// The anchor of this time, if it is one.
    pub(super) shown: Option<Source<'a, P>>,
    /// The previous anchor's depth, if it is known.
    pub(super) past: Option<&'a Past<'a>>,
    /// What leaves the picture, if that was looked for.
    pub(super) leaving: Option<&'a Leaving>,
    pub(super) level: Level,
}

/// A surface beside a pixel.
#[derive(Clone, Copy)]
struct Candidate {
    key: Key,
    order: u64,
    there: [usize; 2],
}

impl<P: Colour> Evidence<'_, P> {
    fn mark(&self) -> u8 {
        if self.shown.is_some() { ORPHAN } else { HOLE }
    }

    /// Finds segments for what `from` does not cover, and writes all segments to `to`.
    pub(super) fn fill(&self, from: &Segments, covers: &Covers, to: &mut Segments) -> Result<()> {
        let grid = from.grid;
        to.reserve(grid)?;
        to.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            for column in 0..grid.columns {
                let tile = row * grid.columns + column;
                tiles.copy(column, from, tile);
                let holes = inside(grid.extent(column, row)) & !covers.of(tile);
                if holes != 0 {
                    self.fill_tile([column, row], holes, from, covers, column, &mut tiles);
                }
            }
            tiles.find_spans();
        });
        Ok(())
    }

    #[inline(never)]
    fn fill_tile(
        &self,
        [column, row]: [usize; 2],
        holes: u64,
        from: &Segments,
        covers: &Covers,
        to_tile: usize,
        to: &mut TilesMut<'_>,
    ) {
        let corner = [column * TILE, row * TILE];
        let mut keys = [EMPTY; TILE * TILE];
        let mut cracks = 0;
        each(holes, |pixel| {
            let at = [corner[0] + pixel % TILE, corner[1] + pixel / TILE];
            if let Some(key) = self.leaving.and_then(|leaving| leaving.claim(at[0], at[1])) {
                keys[pixel] = key;
                return;
            }
            let (found, is_crack, there) = self.find(at, from, covers);
            keys[pixel] = match self.past {
                Some(past) => {
                    let known = self.known(past, at);
                    if known != EMPTY && (alike(found, known) || !past.is_one_thing(self.depth, at, there, found)) {
                        known
                    } else {
                        found
                    }
                }
                None => found,
            };
            cracks |= u64::from(is_crack) << pixel;
        });
        each(cracks, |pixel| {
            let segment = Segment {
                mask: 1 << pixel,
                vector: layer::vector(keys[pixel]),
                rank: layer::rank(keys[pixel]),
                mark: layer::mark(keys[pixel]),
            };
            to.join(to_tile, segment);
        });
        let left = holes & !cracks;
        if left != 0 {
            let mut made = [Segment::default(); SLOTS];
            let count = cluster(&keys, left, &mut made, 0);
            made[..count].iter().for_each(|segment| to.add(to_tile, *segment));
        }
    }

    /// What the previous anchor's depth tells of a pixel that the current one does not show.
    #[inline(always)]
    fn known(&self, past: &Past<'_>, at: [usize; 2]) -> Key {
        let key = past.claim(at);
        if key == EMPTY || self.is_contradicted(at, key) { EMPTY } else { key }
    }

    /// The surface that a pixel continues, and whether it lies in a crack of one.
    #[inline(always)]
    fn find(&self, at: [usize; 2], from: &Segments, covers: &Covers) -> (Key, bool, [usize; 2]) {
        let grid = from.grid;
        let luma = |[x, y]: [usize; 2]| self.shown.map_or(0.0, |shown| shown.pixels[y * grid.width + x].luma());
        let own = luma(at);
        let mut found = [Candidate { key: EMPTY, order: u64::MAX, there: at }; 4];
        let mut steps = [usize::MAX; 4];
        for side in 0..4 {
            if let Some((there, step)) = covers.nearest(grid, at, side / 2, side % 2 == 1) {
                let segment = from.at(there).copied().unwrap_or_default();
                let key = segment.key();
                let far = u64::from(u16::MAX - segment.rank);
                let order = match self.shown {
                    Some(_) => ((luma(there) - own).abs() as u64 + step as u64) << 16 | far,
                    None => far << 16 | step as u64,
                };
                found[side] = Candidate { key, order: order << 2 | side as u64, there };
                steps[side] = step;
            }
        }
        for pair in [[0, 1], [2, 3]] {
            let [a, b] = pair.map(|side| found[side].key);
            let gap = steps[pair[0]].saturating_add(steps[pair[1]]);
            if gap <= CRACK && slopes(a, b) {
                return (if steps[pair[0]] < steps[pair[1]] { a } else { b }, true, at);
            }
        }
        found.sort_unstable_by_key(|candidate| candidate.order);
        let first = found[0].key;
        if first == EMPTY {
            return (key(u16::MAX, self.mark(), [0; 2]), false, at);
        }
        let mut candidates = found.iter().filter(|candidate| candidate.key != EMPTY);
        let best = candidates.find(|candidate| !self.is_contradicted(at, candidate.key));
        let best = best.copied().unwrap_or(found[0]);
        (layer::marked(best.key, self.mark()), false, best.there)
    }

    /// Whether something that moves like this from a pixel would be seen in the current anchor: it is neither hidden there nor outside.
    fn is_contradicted(&self, at: [usize; 2], key: Key) -> bool {
        let at = at.map(|v| v as i32);
        let (vector, reach) = (layer::vector(key), self.way.reach(key, at));
        let spot = std::array::from_fn(|c| 64 * at[c] - part(vector[c], reach));
        self.field.grid.nearest(spot).is_some_and(|at| {
            let shown = self.field.at(at).map_or(EMPTY, Segment::key);
            alike(shown, key) || is_nearer(key, shown)
        })
    }
}

impl<P: Colour> Evidence<'_, P> {
    /// Takes pixels of the previous anchor away from segments that are behind what its depth shows there.
    pub(super) fn uncover(&self, past: &Past<'_>, owners: &mut Segments) {
        let grid = owners.grid;
        owners.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            let mut nears = [0.0; TILE * TILE];
            for column in 0..grid.columns {
                let (corner, extent) = ([column * TILE, row * TILE], grid.extent(column, row));
                let nearest = past.nears(self.level, corner, extent, &mut nears);
                let mut taken = 0;
                for segment in tiles.of(column) {
                    if nearest <= past.least_other(segment.key()) {
                        continue;
                    }
                    each(segment.mask, |pixel| {
                        let at = [corner[0] + pixel % TILE, corner[1] + pixel / TILE];
                        let is_other = nears[pixel] > past.other(segment.key(), at);
                        taken |= u64::from(is_other && self.known(past, at) != EMPTY) << pixel;
                    });
                }
                if taken != 0 {
                    tiles.remove(column, taken);
                }
            }
        });
    }
}
