//! Segments for the pixels that no segment covers. In: segments of a time, of which some pixels are in none, and the motion of the current anchor.
//! Out: the same with every pixel in a segment.
//!
//! In the previous anchor such pixels show what the current one hides, or what has left it since; between the anchors they show what no
//! segment reaches. Both continue a surface beside them: of the nearest covered pixels to the left, right, above and below, the one that is most
//! similar, or farthest away from the camera, and whose motion the current anchor does not contradict.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::colour::Colour;
use super::super::kernels::{BLOCK, Level, Source, TILE};
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

/// Surfaces are looked for in this many tiles to each side.
const FARTHEST: usize = 32;
/// Distance in pixels of two pixels of one surface with a crack between them.
const CRACK: usize = 3;
/// Different keys that the pixels in and beside a tile can have.
const KEYS: usize = SLOTS + SIDES * TILE;
/// Left, right, above, below.
const SIDES: usize = 4;
/// Added to the order of a candidate that the current anchor contradicts.
const CONTRADICTED: u64 = 1 << 60;

/// The pixels of every tile that some segment covers; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Covers {
    masks: Vec<u64>,
    holes: usize,
}

impl Covers {
    /// Finds the covers of `segments`.
    pub(super) fn find(&mut self, segments: &Segments) -> Result<()> {
        let grid = segments.grid;
        sized(&mut self.masks, grid.tiles(), 0)?;
        let holes = AtomicUsize::new(0);
        self.masks.par_chunks_mut(grid.columns).with_min_len(8).enumerate().for_each(|(row, masks)| {
            let mut count = 0;
            for (column, mask) in masks.iter_mut().enumerate() {
                *mask = segments.covered(row * grid.columns + column);
                count += (inside(grid.extent(column, row)) & !*mask).count_ones() as usize;
            }
            holes.fetch_add(count, Ordering::Relaxed);
        });
        self.holes = holes.into_inner();
        Ok(())
    }

    /// Number of pixels that nothing covers.
    pub(super) fn holes(&self) -> usize {
        self.holes
    }

    /// Pixels of a tile that some segment covers.
    #[inline(always)]
    pub(super) fn of(&self, tile: usize) -> u64 {
        self.masks[tile]
    }

    /// For each row of a tile, or each column for sides 2 and 3, the nearest covered pixel beyond one side of the tile, among those `needed`. `visit`
    /// gets the line and the pixel.
    #[inline(always)]
    fn beside(
        &self,
        grid: Grid,
        [column, row]: [usize; 2],
        side: usize,
        mut needed: u64,
        mut visit: impl FnMut(usize, [usize; 2]),
    ) {
        let (at, end) = if side < 2 { (column, grid.columns) } else { (row, grid.rows) };
        let room = if side % 2 == 0 { at } else { end - 1 - at };
        let mut step = 1;
        while needed != 0 && step <= room.min(FARTHEST) {
            let there = if side % 2 == 0 { at - step } else { at + step };
            let [u, v] = if side < 2 { [there, row] } else { [column, there] };
            let mask = self.masks[v * grid.columns + u];
            step += 1;
            if mask == 0 {
                continue;
            }
            let lines = if side < 2 { rows_of(mask) } else { columns_of(mask) };
            each(lines & needed, |line| {
                let of_line = if side < 2 { mask >> (TILE * line) & 0xff } else { mask >> line & COLUMN };
                let pixel =
                    if side % 2 == 0 { 63 - of_line.leading_zeros() } else { of_line.trailing_zeros() } as usize;
                visit(
                    line,
                    if side < 2 {
                        [u * TILE + pixel, v * TILE + line]
                    } else {
                        [u * TILE + line, v * TILE + pixel / TILE]
                    },
                );
            });
            needed &= !lines;
        }
    }
}

/// Pixels of the first column of a tile.
const COLUMN: u64 = 0x0101_0101_0101_0101;

/// Which rows of a mask have a pixel.
#[inline(always)]
fn rows_of(mask: u64) -> u64 {
    let halves = mask | mask >> 4;
    let quarters = halves | halves >> 2;
    ((quarters | quarters >> 1) & COLUMN).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// Which columns of a mask have a pixel.
#[inline(always)]
fn columns_of(mask: u64) -> u64 {
    let halves = mask | mask >> 32;
    let quarters = halves | halves >> 16;
    (quarters | quarters >> 8) & 0xff
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

/// Keys of the pixels in and beside a tile, each once, and which pixels of the tile cannot have them.
struct Keys {
    keys: [Key; KEYS],
    count: usize,
    contradicted: [u64; KEYS],
    is_found: [bool; KEYS],
}

impl Keys {
    #[inline(always)]
    fn number(&mut self, key: Key) -> u8 {
        let found = self.keys[..self.count].iter().position(|other| *other == key);
        let number = found.unwrap_or_else(|| {
            (self.keys[self.count], self.is_found[self.count]) = (key, false);
            self.count += 1;
            self.count - 1
        });
        number as u8
    }
}

/// A covered pixel.
#[derive(Clone, Copy)]
struct Candidate {
    /// In [`Keys`].
    number: u8,
    luma: f32,
    at: [usize; 2],
}

/// The surface that a pixel continues.
#[derive(Clone, Copy)]
struct Found {
    candidate: Option<Candidate>,
    /// Whether it lies in a crack of that surface.
    is_crack: bool,
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
        at: [usize; 2],
        holes: u64,
        from: &Segments,
        covers: &Covers,
        to_tile: usize,
        to: &mut TilesMut<'_>,
    ) {
        let grid = from.grid;
        let tile = at[1] * grid.columns + at[0];
        let (corner, extent) = (at.map(|at| at * TILE), grid.extent(at[0], at[1]));
        let covered = covers.of(tile);
        let mut keys = Keys { keys: [EMPTY; KEYS], count: 0, contradicted: [0; KEYS], is_found: [false; KEYS] };
        let mut lumas = [0.0; BLOCK];
        self.read_lumas(corner, extent, &mut lumas);
        let mut numbers = [0; BLOCK];
        if covered != 0 {
            for segment in from.of(tile).filter(|segment| segment.mask != 0) {
                let number = keys.number(segment.key());
                each(segment.mask, |pixel| numbers[pixel] = number);
            }
        }
        let mut sides = [[None; TILE]; SIDES];
        let rims = [
            (holes & COLUMN).wrapping_mul(0x0102_0408_1020_4080) >> 56,
            (holes >> 7 & COLUMN).wrapping_mul(0x0102_0408_1020_4080) >> 56,
            holes & 0xff,
            holes >> 56,
        ];
        for side in 0..SIDES {
            covers.beside(grid, at, side, rims[side], |line, [x, y]| {
                let (tile, pixel) = grid.place(x, y);
                let segment = from.of(tile).find(|segment| segment.mask >> pixel & 1 == 1);
                let number = keys.number(segment.map_or(EMPTY, Segment::key));
                let luma = self.shown.map_or(0.0, |shown| shown.pixels[y * grid.width + x].luma());
                sides[side][line] = Some(Candidate { number, luma, at: [x, y] });
            });
        }

        let mut known = [EMPTY; BLOCK];
        let known_mask = self.past.map_or(0, |past| self.known(past, corner, extent, holes, &mut known));
        let (mut cracks, mut of_none, mut of_known) = (0, 0, 0);
        let mut given = [0; KEYS];
        each(holes, |pixel| {
            let at = [corner[0] + pixel % TILE, corner[1] + pixel / TILE];
            let beside = |side: usize| {
                // The nearest covered pixel of the tile, in this row or column, before or after.
                let (line, place) = if side < 2 { (pixel / TILE, pixel % TILE) } else { (pixel % TILE, pixel / TILE) };
                let of_line = if side < 2 { covered >> (TILE * line) & 0xff } else { covered >> line & COLUMN };
                let first = if side < 2 { place } else { TILE * place };
                let of_side = if side % 2 == 0 { of_line & ((1 << first) - 1) } else { of_line & (u64::MAX << first) };
                if of_side == 0 {
                    return sides[side][line];
                }
                let found =
                    if side % 2 == 0 { 63 - of_side.leading_zeros() } else { of_side.trailing_zeros() } as usize;
                let found = if side < 2 { TILE * line + found } else { found + line };
                let at = [corner[0] + found % TILE, corner[1] + found / TILE];
                Some(Candidate { number: numbers[found], luma: lumas[found], at })
            };
            let found = self.choose(at, pixel, lumas[pixel], std::array::from_fn(beside), &mut keys, corner);
            if known_mask >> pixel & 1 == 1
                && let Some(past) = self.past
            {
                let is_of_found = found.candidate.is_some_and(|found| {
                    let key = keys.keys[usize::from(found.number)];
                    !alike(key, known[pixel]) && past.is_one_thing(self.depth, at, found.at, key)
                });
                if !is_of_found {
                    of_known |= 1 << pixel;
                    return;
                }
            }
            match found.candidate {
                Some(Candidate { number, .. }) if found.is_crack => {
                    cracks |= 1 << pixel;
                    given[usize::from(number)] |= 1 << pixel;
                }
                Some(Candidate { number, .. }) => given[usize::from(number)] |= 1 << pixel,
                None => of_none |= 1 << pixel,
            }
        });
        let segment = |key: Key, mask: u64| Segment {
            mask,
            vector: layer::vector(key),
            rank: layer::rank(key),
            mark: layer::mark(key),
        };
        let keys = &keys.keys[..keys.count];
        let mut left = holes & !cracks;
        if cracks != 0 {
            for (key, mask) in keys.iter().zip(given).filter(|(_, mask)| mask & cracks != 0) {
                to.join(to_tile, segment(*key, mask & cracks));
            }
        }
        if let Some(leaving) = self.leaving.filter(|leaving| leaving.is_in(corner, extent)) {
            each(holes, |pixel| {
                if let Some(key) = leaving.claim(corner[0] + pixel % TILE, corner[1] + pixel / TILE) {
                    (known[pixel], of_known) = (key, of_known | 1 << pixel);
                }
            });
            left = holes & !(cracks & !of_known);
        }
        if left == 0 {
            return;
        }
        let mark = self.mark();
        if let Some(number) = given.iter().position(|&mask| mask == left) {
            to.add(to_tile, segment(layer::marked(keys[number], mark), left));
            return;
        }
        let mut all = [key(u16::MAX, mark, [0; 2]); BLOCK];
        for (key, mask) in keys.iter().zip(given) {
            each(mask & left, |pixel| all[pixel] = layer::marked(*key, mark));
        }
        each(of_known, |pixel| all[pixel] = known[pixel]);
        let mut made = [Segment::default(); SLOTS];
        let count = cluster(self.level, &all, left, &mut made, 0);
        made[..count].iter().for_each(|segment| to.add(to_tile, *segment));
    }

    /// The lumas of a tile of the anchor of this time.
    #[inline(always)]
    fn read_lumas(&self, corner: [usize; 2], [across, down]: [usize; 2], lumas: &mut [f32; BLOCK]) {
        let Some(shown) = self.shown else { return };
        for (j, lumas) in lumas.as_chunks_mut::<TILE>().0.iter_mut().enumerate().take(down) {
            let row = &shown.pixels[(corner[1] + j) * shown.width + corner[0]..][..across];
            match row.first_chunk() {
                Some(row) => *lumas = P::lumas_of(row),
                None => lumas.iter_mut().zip(row).for_each(|(luma, pixel)| *luma = pixel.luma()),
            }
        }
    }

    /// The surface that a pixel continues.
    #[inline(always)]
    fn choose(
        &self,
        at: [usize; 2],
        pixel: usize,
        own: f32,
        beside: [Option<Candidate>; SIDES],
        keys: &mut Keys,
        corner: [usize; 2],
    ) -> Found {
        let steps =
            beside.map(|candidate| candidate.map_or(usize::MAX, |c| c.at[0].abs_diff(at[0]) + c.at[1].abs_diff(at[1])));
        for [a, b] in [[0, 1], [2, 3]] {
            if steps[a].saturating_add(steps[b]) <= CRACK
                && let (Some(one), Some(other)) = (beside[a], beside[b])
            {
                let [first, second] = [one, other].map(|c| keys.keys[usize::from(c.number)]);
                if slopes(first, second) {
                    let candidate = Some(if steps[a] < steps[b] { one } else { other });
                    return Found { candidate, is_crack: true };
                }
            }
        }
        let (mut best, mut least) = (None, u64::MAX);
        for side in 0..SIDES {
            let Some(candidate) = beside[side] else { continue };
            let number = usize::from(candidate.number);
            let far = u64::from(u16::MAX - layer::rank(keys.keys[number]));
            let step = steps[side] as u64;
            let order = match self.shown {
                Some(_) => ((candidate.luma - own).abs() as u64 + step) << 16 | far,
                None => far << 16 | step,
            };
            let mut order = order << 2 | side as u64;
            if order >= least {
                continue;
            }
            if !keys.is_found[number] {
                keys.contradicted[number] = self.contradicted(corner, keys.keys[number]);
                keys.is_found[number] = true;
            }
            if keys.contradicted[number] >> pixel & 1 == 1 {
                order |= CONTRADICTED;
            }
            if order < least {
                (best, least) = (Some(candidate), order);
            }
        }
        Found { candidate: best, is_crack: false }
    }

    /// Which pixels of a tile would be seen in the current anchor if they moved like this: they are neither hidden there nor outside.
    fn contradicted(&self, corner: [usize; 2], key: Key) -> u64 {
        let (vector, reach) = (layer::vector(key), self.way.reach_of_tile(key, corner));
        let spot = std::array::from_fn(|c| (64 * corner[c] as i32 - part(vector[c], reach) + 32) >> 6);
        self.field.matching(spot, |shown| is_shown(shown.key(), key))
    }

    /// Fills `keys` with what the previous anchor's depth tells of those pixels of a tile that are `asked` for, and says for which it does.
    #[inline(always)]
    fn known(
        &self,
        past: &Past<'_>,
        corner: [usize; 2],
        extent: [usize; 2],
        asked: u64,
        keys: &mut [Key; BLOCK],
    ) -> u64 {
        let mut nears = [0.0; BLOCK];
        past.nears(self.level, corner, extent, &mut nears);
        past.visible_claims(self.level, self.field.grid, corner, &nears, asked, keys, |tile, pixel, claim| {
            let shown = self.field.of(tile).find(|segment| segment.mask >> pixel & 1 == 1);
            is_shown(shown.map_or(EMPTY, Segment::key), claim)
        })
    }

    /// Takes pixels of the previous anchor away from segments that are behind what its depth shows there.
    pub(super) fn uncover(&self, past: &Past<'_>, owners: &mut Segments) {
        let grid = owners.grid;
        owners.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            let (mut nears, mut known) = ([0.0; BLOCK], [EMPTY; BLOCK]);
            for column in 0..grid.columns {
                let (corner, extent) = ([column * TILE, row * TILE], grid.extent(column, row));
                let nearest = past.nears(self.level, corner, extent, &mut nears);
                if tiles.of(column).all(|segment| nearest <= past.least_other(segment.key())) {
                    continue;
                }
                let mut keys = [EMPTY; BLOCK];
                for segment in tiles.of(column) {
                    each(segment.mask, |pixel| keys[pixel] = segment.key());
                }
                let others = past.others(self.level, corner, &keys, &nears);
                let hidden = if others == 0 { 0 } else { self.known(past, corner, extent, others, &mut known) };
                if hidden != 0 {
                    tiles.remove(column, hidden);
                }
            }
        });
    }
}

/// Whether the current anchor shows a surface, or what is behind it, where it shows `shown`.
#[inline(always)]
fn is_shown(shown: Key, surface: Key) -> bool {
    alike(shown, surface) || is_nearer(surface, shown)
}
