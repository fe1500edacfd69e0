//! Segments for the pixels that no segment covers. In: segments of a time, of which some pixels are in none, and the motion of the current anchor.
//! Out: the same with every pixel in a segment.
//!
//! In the previous anchor such pixels show what the current one hides, or what has left it since; between the anchors they show what no
//! segment reaches. Both continue a surface beside them: of the nearest covered pixels to the left, right, above and below, the one that is most
//! similar, or farthest away from the camera, and whose motion the current anchor does not contradict.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::colour::Colour;
use super::super::kernels::{BLOCK, Level, Source, TILE, at_every_level};
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
const CRACK: u16 = 3;
/// Where nothing shows the colour, a surface farther away on the screen than this many pixels is only taken if there is no other.
const REMOTE: u16 = 24;
/// Pixels within which a surface carries along what is as far away.
const CARRIED: u16 = 24;
/// Different keys that the pixels in and beside a tile can have.
const KEYS: usize = SLOTS + SIDES * TILE;
/// Left, right, above, below.
const SIDES: usize = 4;
/// Added to the order of a candidate that the current anchor contradicts.
const CONTRADICTED: u32 = 1 << 30;

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
        let room = if side.is_multiple_of(2) { at } else { end - 1 - at };
        let mut step = 1;
        while needed != 0 && step <= room.min(FARTHEST) {
            let there = if side.is_multiple_of(2) { at - step } else { at + step };
            let [u, v] = if side < 2 { [there, row] } else { [column, there] };
            let mask = self.masks[v * grid.columns + u];
            step += 1;
            if mask == 0 {
                continue;
            }
            let lines = if side < 2 { rows_of(mask) } else { columns_of(mask) };
            each(lines & needed, |line| {
                let of_line = if side < 2 { mask >> (TILE * line) & 0xff } else { mask >> line & COLUMN };
                let pixel = if side.is_multiple_of(2) { 63 - of_line.leading_zeros() } else { of_line.trailing_zeros() }
                    as usize;
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

/// Keys of the pixels in and beside a tile, each once, and whether it is known which pixels of the tile cannot have them.
struct Keys {
    keys: [Key; KEYS],
    count: usize,
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

/// The nearest covered pixel to one side of each pixel of a tile. A pixel without one has a step of [`NO_STEP`].
#[derive(Clone, Copy)]
struct Beside {
    /// In [`Keys`].
    numbers: [u8; BLOCK],
    /// [`layer::rank`].
    ranks: [u16; BLOCK],
    lumas: [f32; BLOCK],
    /// Distance in pixels.
    steps: [u16; BLOCK],
}

const NO_STEP: u16 = u16::MAX;

impl Beside {
    const NOTHING: Self = Self { numbers: [0; BLOCK], ranks: [0; BLOCK], lumas: [0.0; BLOCK], steps: [NO_STEP; BLOCK] };

    /// Writes a candidate of a pixel, and how much farther away it is than its own step.
    #[inline(always)]
    fn set(&mut self, pixel: usize, candidate: &Candidate, step: usize) {
        self.numbers[pixel] = candidate.number;
        self.ranks[pixel] = candidate.rank;
        self.lumas[pixel] = candidate.luma;
        self.steps[pixel] = candidate.step.saturating_add(step as u16);
    }

    /// Writes the candidates of all pixels of a tile that has none itself.
    #[inline(always)]
    fn spread(&mut self, side: usize, rims: &[Candidate; TILE]) {
        for j in 0..TILE {
            for i in 0..TILE {
                let rim = &rims[if side < 2 { j } else { i }];
                let place = if side < 2 { i } else { j };
                self.set(TILE * j + i, rim, if side.is_multiple_of(2) { place } else { TILE - 1 - place });
            }
        }
    }
}

/// The surfaces that the holes of a tile continue.
struct Chosen {
    /// Holes in cracks of one surface.
    cracks: u64,
    /// For each key its holes.
    masks: [u64; KEYS],
    /// The side on which each hole's surface is.
    sides: [u8; BLOCK],
}

/// A covered pixel beside a tile.
#[derive(Clone, Copy)]
struct Candidate {
    number: u8,
    rank: u16,
    luma: f32,
    /// Distance in pixels from the nearest pixel of the tile.
    step: u16,
}

impl<P: Colour> Evidence<'_, P> {
    fn mark(&self) -> u8 {
        if self.shown.is_some() { ORPHAN } else { HOLE }
    }

    /// Finds segments for what `segments` do not cover, and adds them. `added` gets those alone, but for cracks, and is to be read where it has
    /// some; it is not written where nothing is missing.
    pub(super) fn fill(&self, segments: &mut Segments, covers: &Covers, added: &mut Segments) -> Result<()> {
        let grid = segments.grid;
        added.reserve(grid)?;
        let from = &*segments;
        added.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            for column in 0..grid.columns {
                tiles.set(column, &[]);
                let holes = inside(grid.extent(column, row)) & !covers.of(row * grid.columns + column);
                if holes != 0 {
                    self.fill_tile([column, row], holes, from, covers, column, &mut tiles);
                }
            }
            tiles.find_spans();
        });
        let added = &*added;
        segments.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
            for column in 0..grid.columns {
                let tile = row * grid.columns + column;
                for segment in added.of(tile) {
                    if segment.mark == self.mark() {
                        tiles.add(column, *segment);
                    } else {
                        tiles.join(column, *segment);
                    }
                }
            }
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
        let mut keys = Keys { keys: [EMPTY; KEYS], count: 0, is_found: [false; KEYS] };
        let mut lumas = [0.0; BLOCK];
        self.read_lumas(corner, extent, &mut lumas);
        let mut numbers = [0; BLOCK];
        if covered != 0 {
            for segment in from.of(tile).filter(|segment| segment.mask != 0) {
                let number = keys.number(segment.key());
                each(segment.mask, |pixel| numbers[pixel] = number);
            }
        }
        let nothing = Candidate { number: 0, rank: 0, luma: 0.0, step: NO_STEP };
        let mut rims = [[nothing; TILE]; SIDES];
        let needed = [
            (holes & COLUMN).wrapping_mul(0x0102_0408_1020_4080) >> 56,
            (holes >> 7 & COLUMN).wrapping_mul(0x0102_0408_1020_4080) >> 56,
            holes & 0xff,
            holes >> 56,
        ];
        for side in 0..SIDES {
            covers.beside(grid, at, side, needed[side], |line, [x, y]| {
                let (tile, pixel) = grid.place(x, y);
                let segment = from.of(tile).find(|segment| segment.mask >> pixel & 1 == 1);
                let number = keys.number(segment.map_or(EMPTY, Segment::key));
                let luma = self.shown.map_or(0.0, |shown| shown.pixels[y * grid.width + x].luma());
                let step = match side {
                    0 => corner[0] - x,
                    1 => x + 1 - corner[0] - TILE,
                    2 => corner[1] - y,
                    _ => y + 1 - corner[1] - TILE,
                };
                rims[side][line] = Candidate { number, rank: segment.map_or(0, |s| s.rank), luma, step: step as u16 };
            });
        }
        let mut beside = [const { Beside::NOTHING }; SIDES];
        if covered == 0 {
            (0..SIDES).for_each(|side| beside[side].spread(side, &rims[side]));
        } else {
            for side in 0..SIDES {
                let beside = &mut beside[side];
                each(holes, |pixel| {
                    // The nearest covered pixel of the tile, in this row or column, before or after.
                    let (line, place) =
                        if side < 2 { (pixel / TILE, pixel % TILE) } else { (pixel % TILE, pixel / TILE) };
                    let of_line = if side < 2 { covered >> (TILE * line) & 0xff } else { covered >> line & COLUMN };
                    let first = if side < 2 { place } else { TILE * place };
                    let of_side = if side.is_multiple_of(2) {
                        of_line & ((1 << first) - 1)
                    } else {
                        of_line & (u64::MAX << first)
                    };
                    if of_side == 0 {
                        beside.set(
                            pixel,
                            &rims[side][line],
                            if side.is_multiple_of(2) { place } else { TILE - 1 - place },
                        );
                        return;
                    }
                    let found =
                        if side.is_multiple_of(2) { 63 - of_side.leading_zeros() } else { of_side.trailing_zeros() }
                            as usize;
                    let step = if side < 2 { found.abs_diff(place) } else { (found / TILE).abs_diff(place) };
                    let found = if side < 2 { TILE * line + found } else { found + line };
                    let number = numbers[found];
                    let rank = layer::rank(keys.keys[usize::from(number)]);
                    beside.set(pixel, &Candidate { number, rank, luma: lumas[found], step: 0 }, step);
                });
            }
        }
        let mut chosen = Chosen { cracks: 0, masks: [0; KEYS], sides: [SIDES as u8; BLOCK] };
        self.choose(corner, holes, &lumas, &beside, &mut keys, &mut chosen);
        let Chosen { mut cracks, masks: mut given, sides } = chosen;

        let (mut known, mut of_known) = ([EMPTY; BLOCK], 0);
        if let Some(past) = self.past {
            of_known = self.known(past, corner, extent, holes, &mut known);
            for (key, mask) in keys.keys[..keys.count].iter().zip(&mut given) {
                each(*mask & of_known, |pixel| {
                    let side = usize::from(sides[pixel]);
                    if alike(*key, known[pixel]) || beside[side].steps[pixel] > CARRIED {
                        return;
                    }
                    let at = [corner[0] + pixel % TILE, corner[1] + pixel / TILE];
                    let there = stepped(at, side, beside[side].steps[pixel].into());
                    of_known &= !(u64::from(past.is_one_thing(self.depth, at, there, *key)) << pixel);
                });
                *mask &= !of_known;
            }
            cracks &= !of_known;
        }
        let keys = &keys.keys[..keys.count];
        let mut left = holes & !cracks;
        if cracks != 0 {
            for (key, mask) in keys.iter().zip(given).filter(|(_, mask)| mask & cracks != 0) {
                to.add(to_tile, Segment::new(*key, mask & cracks));
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
            to.add(to_tile, Segment::new(layer::marked(keys[number], mark), left));
            return;
        }
        // A pixel with nothing in its row and column continues the farthest surface of the tile.
        let farthest = keys.iter().copied().max().unwrap_or(key(u16::MAX, mark, [0; 2]));
        let mut all = [layer::marked(farthest, mark); BLOCK];
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

    /// For each hole of a tile the surface that it continues, if there is one.
    #[inline(always)]
    fn choose(
        &self,
        corner: [usize; 2],
        holes: u64,
        lumas: &[f32; BLOCK],
        beside: &[Beside; SIDES],
        keys: &mut Keys,
        chosen: &mut Chosen,
    ) {
        let mut orders = [[u32::MAX; BLOCK]; SIDES];
        let between = holes & order(self.level, beside, lumas, self.shown.is_some(), &mut orders);
        let mut best = [u32::MAX; BLOCK];
        let Chosen { cracks, masks, sides } = chosen;
        loop {
            least(self.level, &orders, &mut best, sides);
            masks[..keys.count].fill(0);
            each(holes, |pixel| {
                if best[pixel] != u32::MAX {
                    let side = usize::from(sides[pixel]);
                    masks[usize::from(beside[side].numbers[pixel])] |= 1 << pixel;
                }
            });
            let mut is_settled = true;
            for (number, mask) in masks.iter().copied().enumerate().take(keys.count) {
                if mask == 0 || keys.is_found[number] {
                    continue;
                }
                keys.is_found[number] = true;
                let contradicted = self.contradicted(corner, keys.keys[number]) & holes;
                is_settled &= mask & contradicted == 0;
                each(contradicted, |pixel| {
                    for side in 0..SIDES {
                        let is_it =
                            usize::from(beside[side].numbers[pixel]) == number && orders[side][pixel] != u32::MAX;
                        orders[side][pixel] |= if is_it { CONTRADICTED } else { 0 };
                    }
                });
            }
            if is_settled {
                break;
            }
        }
        each(between, |pixel| {
            for [a, b] in [[0, 1], [2, 3]] {
                let steps = [a, b].map(|side| beside[side].steps[pixel]);
                if *cracks >> pixel & 1 == 0 && steps[0].saturating_add(steps[1]) <= CRACK {
                    let numbers = [a, b].map(|side: usize| usize::from(beside[side].numbers[pixel]));
                    if slopes(keys.keys[numbers[0]], keys.keys[numbers[1]]) {
                        *cracks |= 1 << pixel;
                        masks[usize::from(beside[usize::from(sides[pixel])].numbers[pixel])] &= !(1 << pixel);
                        let is_first = steps[0] < steps[1];
                        sides[pixel] = if is_first { a } else { b } as u8;
                        masks[if is_first { numbers[0] } else { numbers[1] }] |= 1 << pixel;
                    }
                }
            }
        });
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

at_every_level! {
    /// Orders the candidates of a tile's pixels: of less order is better, and the lowest two bits are the side. With `by_luma`, similar and near ones are
    /// better, and of those the ones farther from the camera; else far ones, and of those the nearest on the screen.
    /// Returns which pixels lie close between two candidates.
    fn order(
        beside: &[Beside; SIDES], own: &[f32; BLOCK], by_luma: bool, orders: &mut [[u32; BLOCK]; SIDES],
    ) -> u64 = order_side_by_side | order_side_by_side
}

#[inline(always)]
fn order_side_by_side(
    beside: &[Beside; SIDES],
    own: &[f32; BLOCK],
    by_luma: bool,
    orders: &mut [[u32; BLOCK]; SIDES],
) -> u64 {
    for side in 0..SIDES {
        let (Beside { ranks, lumas, steps, .. }, orders) = (&beside[side], &mut orders[side]);
        for p in 0..BLOCK {
            let (far, step) = (u32::from(u16::MAX - ranks[p]), u32::from(steps[p]));
            let apart = (lumas[p] - own[p]).abs().min(255.0) as i32 as u32;
            let is_remote = u32::from(steps[p] > REMOTE);
            let order = if by_luma { (apart + step) << 16 | far } else { is_remote << 27 | far << 11 | step };
            orders[p] = if steps[p] == NO_STEP { u32::MAX } else { order << 2 | side as u32 };
        }
    }
    let mut between = 0;
    for p in 0..BLOCK {
        let [left, right, above, below] = [0, 1, 2, 3].map(|side: usize| beside[side].steps[p]);
        let is_close = (left.saturating_add(right) <= CRACK) | (above.saturating_add(below) <= CRACK);
        between |= u64::from(is_close) << p;
    }
    between
}

at_every_level! {
    /// The least order of each pixel, and its side.
    fn least(orders: &[[u32; BLOCK]; SIDES], least: &mut [u32; BLOCK], sides: &mut [u8; BLOCK])
        = least_side_by_side | least_side_by_side
}

#[inline(always)]
fn least_side_by_side(orders: &[[u32; BLOCK]; SIDES], least: &mut [u32; BLOCK], sides: &mut [u8; BLOCK]) {
    for p in 0..BLOCK {
        least[p] = orders[0][p].min(orders[1][p]).min(orders[2][p].min(orders[3][p]));
        sides[p] = (least[p] & 3) as u8;
    }
}

/// The pixel so many steps to one side.
fn stepped([x, y]: [usize; 2], side: usize, step: usize) -> [usize; 2] {
    match side {
        0 => [x - step, y],
        1 => [x + step, y],
        2 => [x, y - step],
        _ => [x, y + step],
    }
}

/// Whether the current anchor shows a surface, or what is behind it, where it shows `shown`.
#[inline(always)]
fn is_shown(shown: Key, surface: Key) -> bool {
    alike(shown, surface) || is_nearer(surface, shown)
}
