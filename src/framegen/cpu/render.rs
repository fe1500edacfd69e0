//! Pixels for phase t from the two anchors.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::colour::Colour;
use super::foreign::is_foreign;
use super::kernels::claims;
use super::kernels::{BLOCK, Block, Level, Positions, Rule, Source, TILE};
use super::layer::{
    self, EMPTY, Grid, HOLE, Key, Kind, Layer, ORPHAN, Tile, WHOLE, alike, is_nearer, moves_within, part, slopes,
};
use super::overlay::{Overlays, Stills, Which};
use super::perspective::{Moment, Way};
use super::rules::Rules;
use super::soften::{soft, soften};
use crate::Raster;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Samples that differ by no more than this many levels agree, and the one nearer in time is taken as it is.
pub(super) const AGREE: u8 = 1;
/// Samples that differ by more than this are looked at one by one. Motion that was found in the pictures themselves seldom is that
/// of what lies behind an overlay.
pub(super) const fn careful(is_optical_flow: bool) -> u8 {
    if is_optical_flow { 64 } else { 24 }
}
/// The same where surfaces meet.
pub(super) const STRICT: u8 = 4;

/// Vectors (1/64 px) that are farther apart than this along an axis lead to colours that can be told apart.
pub(super) const DISTINCT: i32 = 8;
/// Levels within which a pixel beside something in front is that thing's.
pub(super) const RIM: f32 = 45.0;
/// The levels that count where an anchor does not show what a pixel claims to be. Where motion was found in pictures, less
/// is sure of who shows what.
pub(super) const fn unseen(is_optical_flow: bool) -> f32 {
    if is_optical_flow { 40.0 } else { 30.0 }
}

/// What a picture between two anchors is made of.
pub(super) struct Between<'a, P> {
    pub(super) level: Level,
    pub(super) rules: Rules,
    pub(super) previous: Source<'a, P>,
    pub(super) current: Source<'a, P>,
    /// What is at phase t.
    pub(super) places: &'a Layer,
    /// The current anchor's motion.
    pub(super) field: &'a Layer,
    /// What is in the previous anchor.
    pub(super) owners: &'a Layer,
    /// Phase t of [`WHOLE`].
    pub(super) phase: i32,
    /// The same, as seen by claims.
    pub(super) moment: Moment,
    /// See [`foreign::margin`](super::foreign::margin).
    pub(super) margin: f32,
    /// What stands still in both.
    pub(super) stills: &'a Stills,
    /// Whether motion, and with it edges, is known from pictures alone.
    pub(super) is_optical_flow: bool,
}

/// What a rendered picture lacks.
pub(super) struct Rendered {
    /// Places that nothing visible in the current anchor landed on.
    pub(super) uncovered: usize,
    /// Places that neither anchor shows.
    pub(super) hidden: usize,
}

/// Where the two anchors show a place.
#[derive(Clone, Copy)]
struct Spots {
    before: [i32; 2],
    after: [i32; 2],
}

impl<P: Colour> Between<'_, P> {
    /// Writes the picture; in `hidden`, one bit for each pixel of a tile, what neither anchor shows.
    pub(super) fn render(&self, out: &mut Raster<P>, hidden: &mut [u64]) -> Rendered {
        let grid = self.places.grid;
        let weight = ((self.phase + 16) >> 5).clamp(1, 127) as u8;
        let careful = careful(self.is_optical_flow);
        let rule = Rule { weight, nearer_is_current: self.phase >= WHOLE / 2, agree: AGREE, careful };
        let (uncovered, unseen) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
        rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
            let block = Block {
                before: [P::OPAQUE_BLACK; BLOCK],
                after: [P::OPAQUE_BLACK; BLOCK],
                merged: [P::OPAQUE_BLACK; BLOCK],
            };
            let mut blocks = [block; 2];
            let (mut loose, mut lost) = (0, 0);
            for (column, hidden) in hidden.iter_mut().enumerate() {
                let pixels = &mut pixels[column * TILE..];
                if column + 1 < grid.columns {
                    self.fetch_rough(column + 1, row);
                }
                loose += self.render_tile(column, row, &rule, &mut blocks, pixels, hidden);
                lost += hidden.count_ones() as usize;
            }
            uncovered.fetch_add(loose, Ordering::Relaxed);
            unseen.fetch_add(lost, Ordering::Relaxed);
        });
        Rendered { uncovered: uncovered.into_inner(), hidden: unseen.into_inner() }
    }

    /// Asks for what a tile is made of that is rough.
    #[inline(always)]
    fn fetch_rough(&self, column: usize, row: usize) {
        let index = row * self.places.grid.columns + column;
        let tile = &self.places.tiles[index];
        if tile.kind == Kind::Rough {
            Layer::fetch_keys(&self.places.keys[index]);
            let spots = self.spots([column * TILE, row * TILE], tile.key, self.phase);
            self.previous.fetch_tile(spots.before, 2);
            self.current.fetch_tile(spots.after, 2);
        }
    }

    /// Writes a tile; returns how many of its pixels nothing visible in the current anchor landed on.
    #[inline(never)]
    fn render_tile(
        &self,
        column: usize,
        row: usize,
        rule: &Rule,
        [block, rims]: &mut [Block<P>; 2],
        pixels: &mut [P],
        hidden: &mut u64,
    ) -> usize {
        let grid = self.places.grid;
        let index = row * grid.columns + column;
        let tile = &self.places.tiles[index];
        let [across, down] = grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        *hidden = 0;
        let phase = self.moment.phase_of_tile(tile.key, corner);
        let spots = self.spots(corner, tile.key, phase);
        let is_whole = tile.kind == Kind::Smooth && [across, down] == [TILE, TILE];
        let doubtful = if is_whole && self.is_clear(tile.key, spots) {
            Some(P::tile(self.level, self.previous, spots.before, self.current, spots.after, rule, pixels, grid.width))
        } else if is_whole && self.is_entering([column, row], tile.key, spots) {
            P::tile_of_one(self.level, self.current, spots.after, pixels, grid.width);
            let overlays = self.overlays();
            let there = grid.nearest(spots.after).map_or(u64::MAX, |at| self.stills.from(self.level, &overlays, at));
            Some(self.stills.of_tile(self.level, &overlays, [column, row]) | there)
        } else {
            None
        };
        if let Some(mask) = doubtful {
            each_bit(mask, |place| {
                let [i, j] = [place % TILE, place / TILE];
                let spots = self.spots([corner[0] + i, corner[1] + j], tile.key, phase);
                let pixel = &mut pixels[j * grid.width + i];
                match self.decide([corner[0] + i, corner[1] + j], tile.key, spots, true, None) {
                    Choice::Merged => {}
                    Choice::Before => *pixel = P::sample(self.previous, spots.before),
                    Choice::After => *pixel = P::sample(self.current, spots.after),
                    Choice::Still => *pixel = self.still(corner[0] + i, corner[1] + j, rule),
                    Choice::Neither => *hidden |= 1 << place,
                }
            });
            return 0;
        }

        let mut keys = match tile.kind {
            Kind::Smooth => [tile.key; BLOCK],
            Kind::Rough => self.places.keys[index],
        };
        let (mut before, mut after) =
            (Positions { x: [0; BLOCK], y: [0; BLOCK] }, Positions { x: [0; BLOCK], y: [0; BLOCK] });
        let (mut uncovered, mut questionable, mut orphans, mut fixed) = (0, 0, 0, 0);
        if tile.kind == Kind::Rough {
            if [across, down] != [TILE, TILE] {
                // Beyond the edges there is nothing to ask.
                let beyond = (0..BLOCK).filter(|place| place % TILE >= across || place / TILE >= down);
                beyond.for_each(|place| keys[place] = layer::key(0, 0, [0; 2]));
            }
            if tile.holes > 0 {
                let borrowed = &self.places.borrowed[index];
                for (key, &borrowed) in keys.iter_mut().zip(borrowed).filter(|(key, _)| **key == EMPTY) {
                    (*key, uncovered) = (borrowed, uncovered + 1);
                }
                questionable |= claims::having(self.level, &keys, HOLE);
            }
            orphans = claims::having(self.level, &keys, ORPHAN);
            uncovered += orphans.count_ones() as usize;
            questionable |= orphans;
        }
        let can_be_soft = self.is_optical_flow
            && self.rules.has(super::Rule::EdgeSoftening)
            && tile.kind == Kind::Rough
            && [across, down] == [TILE, TILE];
        let soft = if can_be_soft { soft(self.level, &keys, questionable) } else { 0 };
        let from = corner.map(|at| at as i32);
        let size = [grid.width, grid.height];
        let beyond = if is_whole {
            positions(grid, spots, &mut before, &mut after)
        } else {
            claims::spots(self.level, &keys, from, self.moment, size, &mut before, &mut after)
        };
        questionable |= beyond[0] | beyond[1];
        // What decides will be asked for while the pixels are sampled.
        for place in (0..BLOCK).step_by(TILE).flat_map(|first| [first, first + TILE - 1]) {
            self.owners.fetch([before.x[place], before.y[place]]);
            self.field.fetch([after.x[place], after.y[place]]);
        }
        let strict = Rule { careful: STRICT, ..*rule };
        // An anchor that shows nothing of the tile is not asked.
        let shows_nothing = beyond.map(|beyond| beyond == u64::MAX);
        // Nor is one for what lies beyond its edges.
        let sample = |anchor, first, at, beyond: u64, samples: &mut [P; BLOCK]| match is_whole {
            true => P::tile_of_one(self.level, anchor, first, samples, TILE),
            false => P::pixels_of_one(self.level, anchor, at, !beyond, samples),
        };
        if shows_nothing != [true, false] {
            sample(self.previous, spots.before, &before, beyond[0], &mut block.before);
        }
        if shows_nothing != [false, true] {
            sample(self.current, spots.after, &after, beyond[1], &mut block.after);
        }
        let differing =
            if shows_nothing[0] == shows_nothing[1] { P::merge_block(self.level, &strict, block) } else { 0 };
        let mask = questionable | differing;
        let mut fronts = [EMPTY; BLOCK];
        let has_front = if mask == 0 || !self.rules.has(super::Rule::ForegroundEdges) {
            0
        } else {
            self.fronts(column, row, mask, &mut fronts)
        };
        let has_rim = self.rims(from, &keys, &fronts, has_front, &strict, rims);
        // What the previous anchor alone shows, and what the current one alone does.
        let (leaving, entering) = (orphans & beyond[1] & !beyond[0], beyond[0] & !beyond[1]);
        let overlays = self.overlays();
        let stills = if questionable == 0 { 0 } else { self.stills.of_tile(self.level, &overlays, [column, row]) };
        // What leaves where nothing stands still, as mostly, needs no other look than for what may show over it.
        let mut plain = leaving & !stills & !has_rim;
        if plain != 0 {
            plain &= !self.stills.at_each(self.level, &overlays, &before, plain);
            for place in 0..BLOCK {
                let is_plain = plain >> place & 1 == 1;
                block.merged[place] = if is_plain { block.before[place] } else { block.merged[place] };
            }
        }
        let entering = entering & !stills;
        let inside = u64::MAX >> (TILE * (TILE - down)) & (0x0101_0101_0101_0101 * (0xff >> (TILE - across)));
        each_bit(mask & !plain & inside, |place| {
            let [i, j] = [place % TILE, place / TILE];
            let at = [corner[0] + i, corner[1] + j];
            let spots = Spots { before: [before.x[place], before.y[place]], after: [after.x[place], after.y[place]] };
            if has_rim >> place & 1 == 1 {
                let of_rim = apart(rims.before[place], rims.after[place]);
                let own = |is_seen| match is_seen {
                    true => apart(block.before[place], block.after[place]),
                    false => unseen(self.is_optical_flow),
                };
                if of_rim <= RIM && of_rim < own(self.is_seen(keys[place], spots)) {
                    block.merged[place] = rims.merged[place];
                    return;
                }
            }
            if entering >> place & 1 == 1 {
                let is_shown = |[x, y]: [usize; 2]| {
                    alike(self.field.owner(x, y), keys[place]) && !self.stills.holds(self.level, &overlays, [x, y])
                };
                if grid.nearest(spots.after).is_some_and(is_shown) {
                    block.merged[place] = block.after[place];
                    return;
                }
            }
            let is_doubtful =
                questionable >> place & 1 == 1 || P::merge(block.before[place], block.after[place], rule).1;
            let seen = Some(block.before[place]);
            match self.decide(at, keys[place], spots, is_doubtful, seen) {
                Choice::Merged => {}
                Choice::Before => block.merged[place] = block.before[place],
                Choice::After => block.merged[place] = block.after[place],
                Choice::Still => {
                    block.merged[place] = self.still(at[0], at[1], rule);
                    fixed |= 1 << place;
                }
                Choice::Neither => *hidden |= 1 << place,
            }
        });
        if soft & !fixed != 0 {
            soften(&mut block.merged, soft & !fixed, *hidden);
        }
        for j in 0..down {
            pixels[j * grid.width..][..across].copy_from_slice(&block.merged[j * TILE..][..across]);
        }
        uncovered
    }

    /// Where the anchors show what is at a place with a claim, by even motion at `phase`.
    #[inline(always)]
    fn spots(&self, [x, y]: [usize; 2], key: Key, phase: i32) -> Spots {
        let at = [64 * x as i32, 64 * y as i32];
        let vector = layer::vector(key);
        let before: [i32; 2] = std::array::from_fn(|c| at[c] + part(vector[c], phase));
        Spots { before, after: std::array::from_fn(|c| before[c] - vector[c]) }
    }

    /// For each pixel of a tile that is asked for what may show over it of the nine claims around it, and where something
    /// may: the nearest where that is in front of its own. Where depth says nothing, anything that moves otherwise may be in
    /// front: the best match of that.
    #[inline(never)]
    fn fronts(&self, column: usize, row: usize, asked: u64, fronts: &mut [Key; BLOCK]) -> u64 {
        let around = self.places.around(column, row, true);
        if self.is_optical_flow {
            claims::other_around(self.level, &around, DISTINCT, asked, fronts)
        } else {
            claims::nearest_around(self.level, &around, DISTINCT, fronts) & asked
        }
    }

    /// The colours at places beside something in front (`has_front`), as they are if those move with that (`fronts`): the
    /// rim of a surface is mixed with what is behind it. Returns at which of them both anchors show that.
    #[inline(never)]
    fn rims(
        &self,
        from: [i32; 2],
        keys: &[Key; BLOCK],
        fronts: &[Key; BLOCK],
        has_front: u64,
        rule: &Rule,
        rims: &mut Block<P>,
    ) -> u64 {
        if has_front == 0 {
            return 0;
        }
        let grid = self.places.grid;
        let mut claims = *keys;
        each_bit(has_front, |place| claims[place] = fronts[place]);
        let mut before = Positions { x: [0; BLOCK], y: [0; BLOCK] };
        let mut after = before;
        let size = [grid.width, grid.height];
        let beyond = claims::spots(self.level, &claims, from, self.moment, size, &mut before, &mut after);
        let has_rim = has_front & !(beyond[0] | beyond[1]);
        P::pixels_of_one(self.level, self.previous, &before, has_rim, &mut rims.before);
        P::pixels_of_one(self.level, self.current, &after, has_rim, &mut rims.after);
        P::merge_block(self.level, rule, rims);
        has_rim
    }

    /// Whether both anchors show what a pixel claims to be.
    fn is_seen(&self, key: Key, spots: Spots) -> bool {
        let grid = self.places.grid;
        grid.nearest(spots.before).is_some_and(|[x, y]| alike(self.owners.claim(x, y), key))
            && grid.nearest(spots.after).is_some_and(|[x, y]| alike(self.field.owner(x, y), key))
    }

    fn overlays(&self) -> Overlays<'_, P> {
        Overlays { previous: self.previous, current: self.current }
    }

    /// Whether both anchors show all of a smooth tile: it lies in tiles that are smooth as well and move alike.
    #[inline(always)]
    fn is_clear(&self, key: Key, spots: Spots) -> bool {
        let can_be = |tile: &Tile| alike(tile.key, key) || slopes(tile.key, key);
        is_in_smooth(self.owners, spots.before, can_be) && is_in_smooth(self.field, spots.after, can_be)
    }

    /// Whether the current anchor alone shows a smooth tile, and all of it: the previous one shows not even its rim. Nothing
    /// around it is in front, or may be.
    #[inline(always)]
    fn is_entering(&self, [column, row]: [usize; 2], key: Key, spots: Spots) -> bool {
        let grid = self.places.grid;
        let is_off = |at: i32, len: usize| at + 64 * (TILE as i32 - 1) < -32 || at + 32 >= 64 * len as i32;
        let moves_along = |tile: &Tile| moves_within(tile.key, key, DISTINCT);
        let can_show = |tile: &Tile| self.is_optical_flow || is_nearer(tile.key, key);
        let is_in_front = |tile: &Tile| tile.kind == Kind::Rough || can_show(tile) && !moves_along(tile);
        let columns = column.saturating_sub(1)..(column + 2).min(grid.columns);
        let mut rows = row.saturating_sub(1)..(row + 2).min(grid.rows);
        (is_off(spots.before[0], grid.width) || is_off(spots.before[1], grid.height))
            && is_in_smooth(self.field, spots.after, |tile| alike(tile.key, key))
            && !rows.any(|row| self.places.row(row..row + 1)[columns.clone()].iter().any(is_in_front))
    }

    /// What to show where the anchors disagree, or where it is not known that the current one shows the place. Overlays
    /// are looked for where that is doubtful.
    #[inline(never)]
    fn decide(&self, at: [usize; 2], key: Key, spots: Spots, is_doubtful: bool, seen: Option<P>) -> Choice {
        let grid = self.places.grid;
        let (from, to) = (grid.nearest(spots.before), grid.nearest(spots.after));
        let mark = layer::mark(key);
        let mut is_before = from.is_some_and(|[x, y]| {
            if mark == ORPHAN {
                return true;
            }
            let owner = self.owners.claim(x, y);
            alike(owner, key) || layer::mark(owner) == ORPHAN && !is_nearer(owner, key)
        });
        let mut is_after = to.is_some_and(|[x, y]| {
            let shown = self.field.owner(x, y);
            alike(shown, key) || mark != ORPHAN && mark != HOLE && is_nearer(key, shown)
        });
        // Where one of them is hidden by something that moves, the vector is right and no overlay in question.
        if is_doubtful && (is_before == is_after || from.is_none() || to.is_none()) {
            let overlays = self.overlays();
            let vector = layer::vector(key);
            let is_over = |which, at| self.stills.is_over(self.level, &overlays, which, at, vector);
            if is_over(Which::Current, at) {
                return Choice::Still;
            }
            is_before = is_before && !from.is_some_and(|from| is_over(Which::Previous, from));
            is_after = is_after && !to.is_some_and(|to| is_over(Which::Current, to));
        }
        let before = || seen.unwrap_or_else(|| P::sample(self.previous, spots.before));
        match (is_before, is_after) {
            (true, true) if is_doubtful && is_foreign(before(), self.current, spots.after, self.margin) => {
                Choice::After
            }
            (true, true) => Choice::Merged,
            (true, false) => Choice::Before,
            (false, true) => Choice::After,
            (false, false) => Choice::Neither,
        }
    }

    /// A pixel of something that stands still.
    fn still(&self, x: usize, y: usize, rule: &Rule) -> P {
        let place = y * self.previous.width + x;
        P::merge(self.previous.pixels[place], self.current.pixels[place], rule).0
    }
}

/// Whether the tiles of a layer on which 8 x 8 pixels from `spot` on lie are on the picture, smooth, and what `can_be` says.
#[inline(always)]
fn is_in_smooth(layer: &Layer, spot: [i32; 2], can_be: impl Fn(&Tile) -> bool) -> bool {
    let grid = layer.grid;
    let last = spot.map(|v| v + 64 * (TILE as i32 - 1));
    let (Some(first), Some(last)) = (grid.nearest(spot), grid.nearest(last)) else { return false };
    // A plain loop: closures of `all` are left as functions of their own.
    for row in first[1] / TILE..=last[1] / TILE {
        for tile in &layer.row(row..row + 1)[first[0] / TILE..=last[0] / TILE] {
            if tile.kind != Kind::Smooth || !can_be(tile) {
                return false;
            }
        }
    }
    true
}

/// Where the anchors show the pixels of a tile that moves as a whole; which pixels they do not show, as
/// [`claims::spots`] tells it.
fn positions(grid: Grid, spots: Spots, before: &mut Positions, after: &mut Positions) -> [u64; 2] {
    [(spots.before, before), (spots.after, after)].map(|(first, at)| {
        let mut beyond = 0;
        for place in 0..BLOCK {
            let [x, y] = [first[0] + 64 * (place % TILE) as i32, first[1] + 64 * (place / TILE) as i32];
            (at.x[place], at.y[place]) = (x, y);
            beyond |= u64::from(!grid.holds([x, y])) << place;
        }
        beyond
    })
}

/// Which anchor a pixel comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    /// Both.
    Merged,
    /// The previous one.
    Before,
    /// The current one.
    After,
    /// Both, where the place itself is: something that stands still lies over it.
    Still,
    /// None.
    Neither,
}

/// Writes the picture of a `moment` after `current`; in `hidden` what it does not show.
#[inline(never)]
pub(super) fn beyond<P: Colour>(
    level: Level,
    current: Source<'_, P>,
    places: &Layer,
    field: &Layer,
    moment: Moment,
    out: &mut Raster<P>,
    hidden: &mut [u64],
) -> Rendered {
    let grid = places.grid;
    let (uncovered, unseen) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let way = Way::from_current(moment);
    let spot = |[x, y]: [usize; 2], key: Key, reach: i32| -> [i32; 2] {
        let at = [64 * x as i32, 64 * y as i32];
        let vector = layer::vector(key);
        std::array::from_fn(|c| at[c] + part(vector[c], -reach))
    };
    let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
    rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
        let mut block = [P::OPAQUE_BLACK; BLOCK];
        let (mut loose, mut lost) = (0, 0);
        for (column, hidden) in hidden.iter_mut().enumerate() {
            let index = row * grid.columns + column;
            let tile = &places.tiles[index];
            let [across, down] = grid.extent(column, row);
            let corner = [column * TILE, row * TILE];
            let pixels = &mut pixels[column * TILE..];
            *hidden = 0;
            if tile.kind == Kind::Smooth && [across, down] == [TILE, TILE] {
                let spot = spot(corner, tile.key, way.reach_of_tile(tile.key, corner));
                P::tile_of_one(level, current, spot, pixels, grid.width);
                continue;
            }
            let mut at = Positions { x: [0; BLOCK], y: [0; BLOCK] };
            for place in 0..BLOCK {
                let [i, j] = [place % TILE, place / TILE];
                let pixel = [corner[0] + i, corner[1] + j];
                if i >= across || j >= down {
                    continue;
                }
                let own = if tile.kind == Kind::Smooth { tile.key } else { places.keys[index][place] };
                let claim = if own == EMPTY { places.borrowed[index][place] } else { own };
                let spot = spot(pixel, claim, way.reach(claim, pixel.map(|at| at as i32)));
                (at.x[place], at.y[place]) = (spot[0], spot[1]);
                if own == EMPTY {
                    loose += 1;
                    // What stands there now is in front of it, and would be seen twice.
                    let is_covered = grid.nearest(spot).is_some_and(|[x, y]| {
                        let shown = field.owner(x, y);
                        !alike(shown, claim) && is_nearer(shown, claim)
                    });
                    *hidden |= u64::from(is_covered) << place;
                }
            }
            lost += hidden.count_ones() as usize;
            P::pixels_of_one(level, current, &at, u64::MAX, &mut block);
            for j in 0..down {
                pixels[j * grid.width..][..across].copy_from_slice(&block[j * TILE..][..across]);
            }
        }
        uncovered.fetch_add(loose, Ordering::Relaxed);
        unseen.fetch_add(lost, Ordering::Relaxed);
    });
    Rendered { uncovered: uncovered.into_inner(), hidden: unseen.into_inner() }
}

/// How far two colours are apart: the levels of the channel that differs most.
pub(super) fn apart<P: Colour>(a: P, b: P) -> f32 {
    let (a, b) = (a.in_levels(), b.in_levels());
    let mut apart = [0.0_f32; 4];
    for c in 0..4 {
        apart[c] = (a[c] - b[c]).abs();
    }
    0.0_f32.max(apart[0]).max(apart[1]).max(apart[2])
}

/// Calls `visit` for each bit that is set, lowest first.
#[inline(always)]
fn each_bit(mut mask: u64, mut visit: impl FnMut(usize)) {
    while mask != 0 {
        visit(mask.trailing_zeros() as usize);
        mask &= mask - 1;
    }
}
