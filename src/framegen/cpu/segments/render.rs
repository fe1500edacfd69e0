//! Colours at a time between the anchors. In: both anchors, and the segments of the current anchor, the previous one and the time. Out: the picture, and
//! the pixels that neither anchor shows.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::colour::Colour;
use super::super::foreign::is_foreign;
use super::super::kernels::{BLOCK, Block, Level, Positions, Rule, Source, TILE, at_every_level};
use super::super::layer::{self, EMPTY, HOLE, ORPHAN, WHOLE, is_nearer, part, slopes};
use super::super::overlay::{Overlays, Stills, Which};
use super::super::perspective::Moment;
use super::super::render::{AGREE, DISTINCT, RIM, STRICT, apart, careful, unseen};
use super::super::soften::{TORN, soften};
use super::tiles::{FRONTS, Front, Segment, Segments, block, each, inside, place};
use crate::Raster;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Segments of one surface differ by no more than this along an axis, in 1/64 px: their vectors are means.
const SURFACE: i32 = 160;
/// The same where motion was given in tiles, and each vector is that of the tile's centre.
const TILED_SURFACE: i32 = 320;
/// So many pixels take as long sampled one by one as all of a tile.
const TOGETHER: u32 = 10;

/// What a picture is made of.
pub(super) struct Between<'a, P> {
    pub(super) level: Level,
    pub(super) previous: Source<'a, P>,
    pub(super) current: Source<'a, P>,
    /// Segments of the picture.
    pub(super) shown: &'a Segments,
    /// Segments of the current anchor.
    pub(super) field: &'a Segments,
    /// Segments of the previous anchor.
    pub(super) owners: &'a Segments,
    /// Phase of [`WHOLE`].
    pub(super) phase: i32,
    pub(super) moment: Moment,
    /// See [`foreign::margin`](super::super::foreign::margin).
    pub(super) margin: f32,
    pub(super) stills: &'a Stills,
    pub(super) is_optical_flow: bool,
    /// Whether motion was given in tiles.
    pub(super) is_tiled: bool,
}

/// Pixels without a colour or without a segment of their own.
pub(super) struct Rendered {
    pub(super) uncovered: usize,
    pub(super) hidden: usize,
}

/// Where the anchors show a tile that moves as a whole.
#[derive(Clone, Copy)]
struct Placed {
    /// First pixel's position in the previous anchor and in the current one, in 1/64 px.
    at: [[i32; 2]; 2],
    /// The nearest pixels.
    pixel: [[i32; 2]; 2],
    /// Pixels of the tile that lie on each anchor.
    on: [u64; 2],
}

impl<P: Colour> Between<'_, P> {
    /// Writes the picture, and in `hidden`, a mask for each tile, the pixels that neither anchor shows.
    pub(super) fn render(&self, out: &mut Raster<P>, hidden: &mut [u64]) -> Rendered {
        let grid = self.shown.grid;
        let weight = ((self.phase + 16) >> 5).clamp(1, 127) as u8;
        let careful = careful(self.is_optical_flow);
        let rule = Rule { weight, nearer_is_current: self.phase >= WHOLE / 2, agree: AGREE, careful };
        let (uncovered, unseen) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
        rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
            let mut work = Work::new();
            let (mut loose, mut lost) = (0, 0);
            for (column, hidden) in hidden.iter_mut().enumerate() {
                let pixels = &mut pixels[column * TILE..];
                *hidden = self.render_tile([column, row], &rule, &mut work, pixels, &mut loose);
                lost += hidden.count_ones() as usize;
            }
            uncovered.fetch_add(loose, Ordering::Relaxed);
            unseen.fetch_add(lost, Ordering::Relaxed);
        });
        Rendered { uncovered: uncovered.into_inner(), hidden: unseen.into_inner() }
    }

    /// Where the anchors show a tile that moves like `segment`.
    #[inline(always)]
    fn place(&self, segment: &Segment, corner: [usize; 2]) -> Placed {
        let phase = self.moment.phase_of_tile(segment.key(), corner);
        let before: [i32; 2] = std::array::from_fn(|c| 64 * corner[c] as i32 + part(segment.vector[c], phase));
        let after = std::array::from_fn(|c| before[c] - segment.vector[c]);
        let at = [before, after];
        let pixel = at.map(|at| at.map(|v| (v + 32) >> 6));
        Placed { at, pixel, on: pixel.map(|at| self.on_picture(at)) }
    }

    /// Pixels of a tile that each anchor shows if the tile moves like `segment`.
    #[inline(always)]
    fn visible(&self, segment: &Segment, placed: &Placed) -> [u64; 2] {
        let key = segment.key();
        let is_whole = segment.mask == u64::MAX;
        let surface = if self.is_tiled { TILED_SURFACE } else { SURFACE };
        let is_alike = |other: &Segment| {
            other.moves_within(segment, surface) || is_whole && other.mask == u64::MAX && slopes(other.key(), key)
        };
        let before = if segment.mark == ORPHAN {
            placed.on[0]
        } else {
            self.owners.matching(placed.pixel[0], |other| {
                is_alike(other) || other.mark == ORPHAN && !is_nearer(other.key(), key)
            })
        };
        let can_be_behind = segment.mark < ORPHAN;
        let after = self
            .field
            .matching(placed.pixel[1], |other| is_alike(other) || can_be_behind && is_nearer(key, other.key()));
        [before, after]
    }

    /// The pixels of an 8 x 8 block that lie on the picture.
    #[inline(always)]
    fn on_picture(&self, at: [i32; 2]) -> u64 {
        let size = [self.shown.grid.width as i32, self.shown.grid.height as i32];
        let is_on = (0..2).all(|c| at[c] >= 0 && at[c] + TILE as i32 <= size[c]);
        if is_on {
            return u64::MAX;
        }
        let lines = |c: usize| {
            let (start, end) = ((-at[c]).clamp(0, 8) as u32, (size[c] - at[c]).clamp(0, 8) as u32);
            if start >= end { 0_u64 } else { (0xff << start & (0xff >> (8 - end))) & 0xff }
        };
        let (across, down) = (lines(0), lines(1));
        (0..TILE as u32).fold(0, |all, j| all | if down >> j & 1 == 1 { across << (8 * j) } else { 0 })
    }

    #[inline(never)]
    fn render_tile(
        &self,
        [column, row]: [usize; 2],
        rule: &Rule,
        work: &mut Work<P>,
        pixels: &mut [P],
        loose: &mut usize,
    ) -> u64 {
        let grid = self.shown.grid;
        let tile = row * grid.columns + column;
        let corner = [column * TILE, row * TILE];
        if self.shown.is_whole(tile) {
            let segment = self.shown.first(tile);
            let placed = self.place(segment, corner);
            let visible = self.visible(segment, &placed);
            if visible == [u64::MAX; 2] && segment.mark < ORPHAN {
                let [a, b] = placed.at;
                let doubtful = P::tile(self.level, self.previous, a, self.current, b, rule, pixels, grid.width);
                if doubtful != 0 {
                    self.settle_doubtful(segment, &placed, [column, row], doubtful, rule, work, pixels);
                }
                return 0;
            }
        }
        let inside = inside(grid.extent(column, row));
        self.render_mixed([column, row], inside, rule, work, pixels, loose)
    }

    /// Looks again at pixels of a uniform tile where the anchors differ, although both show it.
    #[expect(clippy::too_many_arguments, reason = "a tile, what it shows, and where it goes")]
    #[inline(never)]
    fn settle_doubtful(
        &self,
        segment: &Segment,
        placed: &Placed,
        at: [usize; 2],
        doubtful: u64,
        rule: &Rule,
        work: &mut Work<P>,
        pixels: &mut [P],
    ) {
        let corner = at.map(|at| at * TILE);
        let mut visible = [u64::MAX; 2];
        let mut still = 0;
        self.find_overlays(segment, placed, at, doubtful, &mut visible, &mut still);
        let width = self.shown.grid.width;
        self.sample(0, placed.at[0], doubtful & visible[0], &mut work.block.before);
        each(doubtful, |p| {
            let [i, j] = place(p);
            let spot = [placed.at[1][0] + 64 * i as i32, placed.at[1][1] + 64 * j as i32];
            let to = &mut pixels[j * width + i];
            match [still, visible[0], visible[1]].map(|mask| mask >> p & 1 == 1) {
                [true, ..] => *to = self.still([corner[0] + i, corner[1] + j], rule),
                [false, true, true] if is_foreign(work.block.before[p], self.current, spot, self.margin) => {
                    *to = P::sample(self.current, spot);
                }
                [false, true, false] => *to = work.block.before[p],
                [false, false, true] => *to = P::sample(self.current, spot),
                [false, false, false] | [false, true, true] => {}
            }
        });
    }

    /// Samples those pixels of a tile that are `wanted` from an anchor, the first one at `at`.
    #[inline(always)]
    fn sample(&self, anchor: usize, at: [i32; 2], wanted: u64, samples: &mut [P; BLOCK]) {
        let source = if anchor == 0 { self.previous } else { self.current };
        if wanted.count_ones() < TOGETHER {
            if wanted != 0 {
                P::pixels_of_one(self.level, source, &positions(at), wanted, samples);
            }
        } else {
            P::tile_of_one(self.level, source, at, samples, TILE);
        }
    }

    /// Of the pixels `asked`, finds those that show a static overlay in the picture, and takes those from `visible` over which an anchor has one.
    #[inline(never)]
    fn find_overlays(
        &self,
        segment: &Segment,
        placed: &Placed,
        at: [usize; 2],
        asked: u64,
        visible: &mut [u64; 2],
        still: &mut u64,
    ) {
        let vector = segment.vector;
        if vector == [0; 2] {
            return;
        }
        let grid = self.shown.grid;
        let overlays = Overlays { previous: self.previous, current: self.current };
        let of_tile = |at: [usize; 2]| self.stills.of_tile(self.level, &overlays, at);
        let over = |which, at, asked| self.stills.over_block(self.level, &overlays, which, at, vector, asked);
        let here = asked & of_tile(at);
        *still |= if here == 0 { 0 } else { over(Which::Current, at.map(|at| (at * TILE) as i32), here) };
        for (anchor, which) in [Which::Previous, Which::Current].into_iter().enumerate() {
            let asked = asked & !*still & visible[anchor] & placed.on[anchor];
            if asked == 0 {
                continue;
            }
            let there = asked & block(grid, placed.pixel[anchor], |column, row| of_tile([column, row]));
            if there != 0 {
                visible[anchor] &= !over(which, placed.pixel[anchor], there);
            }
        }
    }

    #[inline(never)]
    fn render_mixed(
        &self,
        at: [usize; 2],
        inside: u64,
        rule: &Rule,
        work: &mut Work<P>,
        pixels: &mut [P],
        loose: &mut usize,
    ) -> u64 {
        let grid = self.shown.grid;
        let corner = at.map(|at| at * TILE);
        let tile = at[1] * grid.columns + at[0];
        let (mut hidden, mut soft, mut fixed) = (0, 0, 0);
        let mut bounds = [[i32::MAX; 2], [i32::MIN; 2]];
        for segment in self.shown.of(tile) {
            let mask = segment.mask & inside;
            if mask == 0 {
                continue;
            }
            let [low, high] = bounds;
            let vector = segment.vector;
            bounds = [[0, 1].map(|c: usize| low[c].min(vector[c])), [0, 1].map(|c: usize| high[c].max(vector[c]))];
            let is_loose = segment.mark >= ORPHAN;
            if is_loose {
                *loose += mask.count_ones() as usize;
                soft |= mask;
            }
            let placed = self.place(segment, corner);
            let on_both = placed.on[0] & placed.on[1];
            let block = &mut work.block;
            self.sample(0, placed.at[0], placed.on[0] & mask, &mut block.before);
            self.sample(1, placed.at[1], placed.on[1] & mask, &mut block.after);
            let apart_by = |levels: u8, block: &mut Block<P>| match mask & on_both {
                0 => 0,
                _ => P::merge_block(self.level, &Rule { careful: levels, ..*rule }, block),
            };
            let mut asked = mask & (!on_both | apart_by(STRICT, block));
            if is_loose {
                asked = mask;
            }
            select(self.level, mask & !asked, &block.merged, &mut work.result);
            if asked == 0 {
                continue;
            }
            let visible = self.visible(segment, &placed);
            let mut sees = [0, 1].map(|anchor| visible[anchor] & placed.on[anchor]);
            // A pixel at the edge of something in front may be a mixture with that.
            let behind = if self.is_optical_flow { EMPTY } else { segment.key() };
            let mut fronts = [Front::default(); FRONTS];
            let count = self.shown.around(at, asked, behind, &mut fronts);
            let own = Own { segment, both: sees[0] & sees[1] & on_both, block };
            let left =
                asked & !self.take_fronts(&own, &fronts[..count], corner, asked, rule, &mut work.rim, &mut work.result);
            if left == 0 {
                continue;
            }
            let block = &mut work.block;
            let mut doubtful = left & (!on_both | apart_by(rule.careful, block));
            if is_loose {
                doubtful = left;
            }
            let mut still = 0;
            let unsure = doubtful & (!(sees[0] ^ sees[1]) | !on_both);
            if unsure != 0 {
                self.find_overlays(segment, &placed, at, unsure, &mut sees, &mut still);
                each(still, |p| {
                    let [i, j] = place(p);
                    work.result[p] = self.still([corner[0] + i, corner[1] + j], rule);
                });
                fixed |= still;
            }
            let left = left & !still;
            let [both, neither] = [sees[0] & sees[1], !(sees[0] | sees[1])];
            let mut merged = left & both;
            each(merged & both & doubtful, |p| {
                let [i, j] = place(p);
                let spot = [placed.at[1][0] + 64 * i as i32, placed.at[1][1] + 64 * j as i32];
                if is_foreign(block.before[p], self.current, spot, self.margin) {
                    merged &= !(1 << p);
                    sees[0] &= !(1 << p);
                }
            });
            let one = left & !merged & !neither;
            select(self.level, merged, &block.merged, &mut work.result);
            select(self.level, one & sees[0], &block.before, &mut work.result);
            select(self.level, one & sees[1], &block.after, &mut work.result);
            hidden |= left & !merged & neither;
        }
        if self.is_optical_flow && inside == u64::MAX {
            let is_torn = (0..2).any(|c| bounds[1][c] - bounds[0][c] > TORN);
            let soft = if is_torn { u64::MAX } else { soft };
            if soft & !fixed != 0 {
                soften(&mut work.result, soft & !fixed, hidden);
            }
        }
        let [across, down] = grid.extent(at[0], at[1]);
        for j in 0..down {
            pixels[j * grid.width..][..across].copy_from_slice(&work.result[j * TILE..][..across]);
        }
        hidden
    }

    /// Gives pixels that are `asked` for to segments in front, where the anchors agree better on those. Returns which.
    #[expect(clippy::too_many_arguments, reason = "two surfaces, and the colours of both")]
    #[inline(always)]
    fn take_fronts(
        &self,
        own: &Own<'_, P>,
        fronts: &[Front],
        corner: [usize; 2],
        asked: u64,
        rule: &Rule,
        rim: &mut Block<P>,
        result: &mut [P; BLOCK],
    ) -> u64 {
        let mut taken = 0;
        for front in fronts {
            let zone = front.zone & asked & !taken;
            let segment = Segment::new(front.key, 0);
            if zone == 0 || segment.mark >= ORPHAN || segment.moves_within(own.segment, DISTINCT) {
                continue;
            }
            let over = self.place(&segment, corner);
            let zone = zone & over.on[0] & over.on[1];
            if zone == 0 {
                continue;
            }
            self.sample(0, over.at[0], zone, &mut rim.before);
            self.sample(1, over.at[1], zone, &mut rim.after);
            let zone = zone & !P::merge_block(self.level, &Rule { careful: RIM as u8, ..*rule }, rim);
            each(zone, |p| {
                let of_own = if own.both >> p & 1 == 1 {
                    apart(own.block.before[p], own.block.after[p])
                } else {
                    unseen(self.is_optical_flow)
                };
                if apart(rim.before[p], rim.after[p]) < of_own {
                    result[p] = rim.merged[p];
                    taken |= 1 << p;
                }
            });
        }
        taken
    }

    /// A pixel of something that stands still.
    fn still(&self, [x, y]: [usize; 2], rule: &Rule) -> P {
        let at = y * self.previous.width + x;
        P::merge(self.previous.pixels[at], self.current.pixels[at], rule).0
    }
}

/// A surface of a tile, and its colours.
struct Own<'a, P> {
    segment: &'a Segment,
    /// Pixels that both anchors show.
    both: u64,
    block: &'a Block<P>,
}

at_every_level! {
    /// Copies the pixels of a mask.
    pub(super) fn select<P: Colour>(mask: u64, from: &[P; BLOCK], to: &mut [P; BLOCK]) = select_side_by_side | select_side_by_side
}

#[inline(always)]
fn select_side_by_side<P: Colour>(mask: u64, from: &[P; BLOCK], to: &mut [P; BLOCK]) {
    if mask == u64::MAX {
        *to = *from;
        return;
    }
    if mask == 0 {
        return;
    }
    for p in 0..BLOCK {
        to[p] = if mask >> p & 1 == 1 { from[p] } else { to[p] };
    }
}

/// The positions of the pixels of a tile that starts at a position.
#[inline(always)]
fn positions([x, y]: [i32; 2]) -> Positions {
    let mut at = Positions { x: [0; BLOCK], y: [0; BLOCK] };
    for p in 0..BLOCK {
        let [i, j] = place(p);
        (at.x[p], at.y[p]) = (x + 64 * i as i32, y + 64 * j as i32);
    }
    at
}

/// Working memory of one row.
struct Work<P> {
    block: Block<P>,
    rim: Block<P>,
    result: [P; BLOCK],
}

impl<P: Colour> Work<P> {
    fn new() -> Self {
        let black = [P::OPAQUE_BLACK; BLOCK];
        let block = Block { before: black, after: black, merged: black };
        Self { block, rim: block, result: black }
    }
}

const _: () = assert!(HOLE > ORPHAN && layer::WORST_MATCH < ORPHAN);
