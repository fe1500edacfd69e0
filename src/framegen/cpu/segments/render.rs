//! Colours at a time between the anchors. In: both anchors, and the segments of the current anchor, the previous one and the time. Out: the picture, and
//! the pixels that neither anchor shows.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::colour::Colour;
use super::super::foreign::is_foreign;
use super::super::kernels::{BLOCK, Block, Level, Positions, Rule, Source, TILE};
use super::super::layer::{self, ALIKE, HOLE, ORPHAN, WHOLE, is_nearer, part, slopes};
use super::super::overlay::{Overlays, Stills, Which};
use super::super::perspective::Moment;
use super::super::render::{AGREE, DISTINCT, RIM, STRICT, apart, careful, unseen};
use super::super::soften::{TORN, soften};
use super::tiles::{FRONTS, Front, Segment, Segments, each, inside, place};
use crate::Raster;
use crate::guidance::MotionField;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Segments of one surface differ by no more than this along an axis, in 1/64 px: their vectors are means.
const SURFACE: i32 = 160;
/// Levels within which both anchors agree on a pixel of which it is not known that both show it.
const AGREEING: f32 = 24.0;
/// The same where it seems that neither shows it.
const PLAUSIBLE: f32 = 30.0;

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
    /// The motion of the current anchor's pixels.
    pub(super) motion: &'a MotionField,
    pub(super) moment: Moment,
    /// See [`foreign::margin`](super::super::foreign::margin).
    pub(super) margin: f32,
    pub(super) past: Option<&'a super::super::past::Past<'a>>,
    pub(super) stills: &'a Stills,
    pub(super) is_optical_flow: bool,
}

/// Pixels without a colour or without a segment of their own.
pub(super) struct Rendered {
    pub(super) uncovered: usize,
    pub(super) hidden: usize,
}

/// A segment of a tile, and where the anchors show the tile if all of it moves like that.
#[derive(Clone, Copy, Default)]
struct Seen {
    segment: Segment,
    /// First pixel's position in the previous anchor and in the current one, in 1/64 px.
    at: [[i32; 2]; 2],
    /// Pixels of the tile that lie on each anchor.
    on: [u64; 2],
    /// Pixels that each anchor shows.
    visible: [u64; 2],
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
    fn see(&self, segment: &Segment, corner: [usize; 2]) -> Seen {
        let key = segment.key();
        let phase = self.moment.phase_of_tile(key, corner);
        let before: [i32; 2] = std::array::from_fn(|c| 64 * corner[c] as i32 + part(segment.vector[c], phase));
        let after = std::array::from_fn(|c| before[c] - segment.vector[c]);
        let at = [before, after];
        let pixel = at.map(|at| at.map(|v| (v + 32) >> 6));
        let is_whole = segment.mask == u64::MAX;
        let is_alike = |other: &Segment| {
            other.moves_within(segment, SURFACE) || is_whole && other.mask == u64::MAX && slopes(other.key(), key)
        };
        let on = pixel.map(|at| self.on_picture(at));
        let is_orphan = segment.mark == ORPHAN;
        let before = if is_orphan {
            on[0]
        } else {
            self.owners
                .matching(pixel[0], |other| is_alike(other) || other.mark == ORPHAN && !is_nearer(other.key(), key))
        };
        let can_be_behind = segment.mark < ORPHAN;
        let after =
            self.field.matching(pixel[1], |other| is_alike(other) || can_be_behind && is_nearer(key, other.key()));
        Seen { segment: *segment, at, on, visible: [before, after] }
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
        let inside = inside(grid.extent(column, row));
        if self.shown.count(tile) == 1 && inside == u64::MAX && self.shown.first(tile).mask == u64::MAX {
            let seen = self.see(self.shown.first(tile), corner);
            if seen.visible == [u64::MAX; 2] {
                let [a, b] = seen.at;
                let doubtful = P::tile(self.level, self.previous, a, self.current, b, rule, pixels, grid.width);
                return if doubtful == 0 { 0 } else { self.settle_doubtful(&seen, corner, doubtful, rule, pixels) };
            }
        }
        self.render_mixed([column, row], inside, rule, work, pixels, loose)
    }

    /// Looks again at pixels of a uniform tile where the anchors differ; returns those that neither shows.
    #[inline(never)]
    fn settle_doubtful(&self, seen: &Seen, corner: [usize; 2], doubtful: u64, rule: &Rule, pixels: &mut [P]) -> u64 {
        let mut hidden = 0;
        each(doubtful, |p| {
            let [i, j] = place(p);
            let to = &mut pixels[j * self.shown.grid.width + i];
            let spots = seen.at.map(|[x, y]| [x + 64 * i as i32, y + 64 * j as i32]);
            match self.decide(seen, p, corner, true, None, self.exact(seen, p)) {
                Choice::Merged => {}
                Choice::Before => *to = P::sample(self.previous, spots[0]),
                Choice::After => *to = P::sample(self.current, spots[1]),
                Choice::Still => *to = self.still([corner[0] + i, corner[1] + j], rule),
                Choice::Neither => hidden |= 1 << p,
            }
        });
        hidden
    }

    #[inline(never)]
    fn render_mixed(
        &self,
        [column, row]: [usize; 2],
        inside: u64,
        rule: &Rule,
        work: &mut Work<P>,
        pixels: &mut [P],
        loose: &mut usize,
    ) -> u64 {
        let grid = self.shown.grid;
        let corner = [column * TILE, row * TILE];
        let tile = row * grid.columns + column;
        let strict = Rule { careful: STRICT, ..*rule };
        let Work { block, rim, result } = work;
        let (mut hidden, mut soft, mut fixed) = (0, 0, 0);
        let mut bounds = [[i32::MAX; 2], [i32::MIN; 2]];
        let mut fronts = [Front::default(); FRONTS];
        let front_count = self.shown.around([column, row], &mut fronts);
        for segment in self.shown.of(tile).filter(|segment| segment.mask & inside != 0) {
            let seen = self.see(segment, corner);
            let mask = segment.mask & inside;
            bounds = [0, 1].map(|end| {
                std::array::from_fn(|c| {
                    let v = segment.vector[c];
                    if end == 0 { bounds[0][c].min(v) } else { bounds[1][c].max(v) }
                })
            });
            let is_loose = segment.mark >= ORPHAN;
            if is_loose {
                *loose += mask.count_ones() as usize;
                soft |= mask;
            }
            let is_on = seen.on.map(|on| on & mask != 0);
            let mut at = seen.at.map(positions);
            let mut vectors = [segment.vector; BLOCK];
            self.refine(&seen, corner, mask, &mut at, &mut vectors);
            if is_on[0] {
                P::pixels_of_one(self.level, self.previous, &at[0], mask, &mut block.before);
            }
            if is_on[1] {
                P::pixels_of_one(self.level, self.current, &at[1], mask, &mut block.after);
            }
            let differing = if is_on == [true; 2] { P::merge_block(self.level, &strict, block) } else { 0 };
            let both = seen.visible[0] & seen.visible[1] & seen.on[0] & seen.on[1];
            let asked = (if is_loose { mask } else { 0 } | differing | !(seen.on[0] & seen.on[1])) & mask;
            each(mask & !asked, |p| {
                result[p] = block.merged[p];
            });
            let mut left = asked;
            // A pixel at the edge of something in front may be a mixture with that.
            for front in &fronts[..front_count] {
                let zone = front.zone & left;
                if zone == 0 || !self.can_be_in_front(&front.segment, segment) {
                    continue;
                }
                let over = self.see(&front.segment, corner);
                let zone = zone & over.on[0] & over.on[1];
                if zone == 0 {
                    continue;
                }
                P::pixels_of_one(self.level, self.previous, &positions(over.at[0]), zone, &mut rim.before);
                P::pixels_of_one(self.level, self.current, &positions(over.at[1]), zone, &mut rim.after);
                P::merge_block(self.level, &strict, rim);
                each(zone, |p| {
                    let of_rim = apart(rim.before[p], rim.after[p]);
                    let own = if both >> p & 1 == 1 {
                        apart(block.before[p], block.after[p])
                    } else {
                        unseen(self.is_optical_flow)
                    };
                    if of_rim <= RIM && of_rim < own {
                        result[p] = rim.merged[p];
                        left &= !(1 << p);
                    }
                });
            }
            each(left, |p| {
                let is_doubtful = is_loose
                    || (seen.on[0] & seen.on[1]) >> p & 1 == 0
                    || P::merge(block.before[p], block.after[p], rule).1;
                match self.decide(&seen, p, corner, is_doubtful, Some(block.before[p]), vectors[p]) {
                    Choice::Merged => result[p] = block.merged[p],
                    Choice::Before => result[p] = block.before[p],
                    Choice::After => result[p] = block.after[p],
                    Choice::Still => {
                        let [i, j] = place(p);
                        result[p] = self.still([corner[0] + i, corner[1] + j], rule);
                        fixed |= 1 << p;
                    }
                    Choice::Neither => hidden |= 1 << p,
                }
            });
        }
        if self.is_optical_flow && inside == u64::MAX {
            let is_torn = (0..2).any(|c| bounds[1][c] - bounds[0][c] > TORN);
            let soft = if is_torn { u64::MAX } else { soft };
            if soft & !fixed != 0 {
                soften(result, soft & !fixed, hidden);
            }
        }
        let [across, down] = grid.extent(column, row);
        for j in 0..down {
            pixels[j * grid.width..][..across].copy_from_slice(&result[j * TILE..][..across]);
        }
        hidden
    }

    /// The vector of a pixel itself, if that is near its segment's.
    fn exact(&self, seen: &Seen, p: usize) -> [i32; 2] {
        let [i, j] = place(p);
        let vector = seen.segment.vector;
        let [x, y] = [seen.at[1][0] + 64 * i as i32, seen.at[1][1] + 64 * j as i32].map(|v| (v + 32) >> 6);
        if self.motion.tile() > 1
            || seen.segment.mark >= ORPHAN
            || x < 0
            || y < 0
            || x >= self.motion.width() as i32
            || y >= self.motion.height() as i32
        {
            return vector;
        }
        let own = self.motion.vectors()[y as usize * self.motion.width() as usize + x as usize]
            .map(|v| (v.to_f32() * 64.0).round_ties_even() as i32);
        if (0..2).all(|c| own[c].saturating_sub(vector[c]).abs() <= 64) { own } else { vector }
    }

    /// Moves the positions of pixels by their own vectors instead of the segment's.
    #[inline(always)]
    fn refine(
        &self,
        seen: &Seen,
        corner: [usize; 2],
        mask: u64,
        at: &mut [Positions; 2],
        vectors: &mut [[i32; 2]; BLOCK],
    ) {
        if seen.segment.mark == ORPHAN {
            if let Some(past) = self.past {
                let phase = self.moment.phase_of_tile(seen.segment.key(), corner);
                each(mask & seen.on[0], |p| {
                    let from = [at[0].x[p], at[0].y[p]].map(|v| ((v + 32) >> 6) as usize);
                    if self.owners.at(from).is_none_or(|owner| owner.mark != ORPHAN) {
                        return;
                    }
                    let own = layer::vector(past.claim(from));
                    let vector = seen.segment.vector;
                    if (0..2).all(|c| (own[c] - vector[c]).abs() <= ALIKE) {
                        let [i, j] = place(p);
                        let to = [64 * (corner[0] + i) as i32, 64 * (corner[1] + j) as i32];
                        let before: [i32; 2] = std::array::from_fn(|c| to[c] + part(own[c], phase));
                        (at[0].x[p], at[0].y[p]) = (before[0], before[1]);
                        (at[1].x[p], at[1].y[p]) = (before[0] - own[0], before[1] - own[1]);
                        vectors[p] = own;
                    }
                });
            }
            return;
        }
        if self.motion.tile() > 1 || seen.segment.mark >= ORPHAN {
            return;
        }
        let phase = self.moment.phase_of_tile(seen.segment.key(), corner);
        let width = self.motion.width() as usize;
        each(mask & seen.on[1], |p| {
            let [x, y] = [at[1].x[p], at[1].y[p]].map(|v| ((v + 32) >> 6) as usize);
            let own = self.motion.vectors()[y * width + x].map(|v| (v.to_f32() * 64.0).round_ties_even() as i32);
            let vector = seen.segment.vector;
            if (0..2).all(|c| own[c].saturating_sub(vector[c]).abs() <= ALIKE) {
                let [i, j] = place(p);
                let to = [64 * (corner[0] + i) as i32, 64 * (corner[1] + j) as i32];
                let before: [i32; 2] = std::array::from_fn(|c| to[c] + part(own[c], phase));
                (at[0].x[p], at[0].y[p]) = (before[0], before[1]);
                (at[1].x[p], at[1].y[p]) = (before[0] - own[0], before[1] - own[1]);
                vectors[p] = own;
            }
        });
    }

    /// Whether `front` may cover pixels of `own`: it is nearer, or nobody knows which is.
    #[inline(always)]
    fn can_be_in_front(&self, front: &Segment, own: &Segment) -> bool {
        let is_nearer = front.key() < own.key() || self.is_optical_flow;
        is_nearer && !front.moves_within(own, DISTINCT) && front.mark < ORPHAN
    }

    /// What to show of a pixel where the anchors differ or one does not show it.
    #[inline(never)]
    fn decide(
        &self,
        seen: &Seen,
        p: usize,
        corner: [usize; 2],
        is_doubtful: bool,
        before: Option<P>,
        vector: [i32; 2],
    ) -> Choice {
        let [i, j] = place(p);
        let grid = self.shown.grid;
        let at = [corner[0] + i, corner[1] + j];
        let spots = seen.at.map(|[x, y]| [x + 64 * i as i32, y + 64 * j as i32]);
        let (from, to) = (grid.nearest(spots[0]), grid.nearest(spots[1]));
        let mut is_seen = [0, 1].map(|anchor| (seen.visible[anchor] & seen.on[anchor]) >> p & 1 == 1);
        if is_doubtful && (is_seen[0] == is_seen[1] || from.is_none() || to.is_none()) {
            let overlays = Overlays { previous: self.previous, current: self.current };
            let is_over = |which, at| self.stills.is_over(self.level, &overlays, which, at, vector);
            if is_over(Which::Current, at) {
                return Choice::Still;
            }
            is_seen[0] &= !from.is_some_and(|from| is_over(Which::Previous, from));
            is_seen[1] &= !to.is_some_and(|to| is_over(Which::Current, to));
        }
        let before = || before.unwrap_or_else(|| P::sample(self.previous, spots[0]));
        let is_on = (seen.on[0] & seen.on[1]) >> p & 1 == 1;
        let do_agree = |limit: f32| is_on && apart(before(), P::sample(self.current, spots[1])) <= limit;
        if is_seen != [true; 2] && seen.segment.mark < ORPHAN && do_agree(AGREEING) {
            return Choice::Merged;
        }
        match is_seen {
            [true, true] if is_doubtful && is_foreign(before(), self.current, spots[1], self.margin) => Choice::After,
            [true, true] => Choice::Merged,
            [true, false] => Choice::Before,
            [false, true] => Choice::After,
            [false, false] => {
                if do_agree(PLAUSIBLE) {
                    Choice::Merged
                } else {
                    Choice::Neither
                }
            }
        }
    }

    /// A pixel of something that stands still.
    fn still(&self, [x, y]: [usize; 2], rule: &Rule) -> P {
        let at = y * self.previous.width + x;
        P::merge(self.previous.pixels[at], self.current.pixels[at], rule).0
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

/// Where a pixel comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    Merged,
    Before,
    After,
    /// Both anchors, at the pixel's own position: a static overlay.
    Still,
    Neither,
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
