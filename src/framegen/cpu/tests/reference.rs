//! The frame that the generator must make, described plainly: place by place over whole pictures, with no bands, no early
//! outs, no threads and no instruction sets.
//!
//! What a claim is (`layer`), and rules about a single pixel (`Standing`, `Overlays`, `is_foreign`, `distance`, `match_of`, the
//! cost of a candidate) are the generator's own, and so is the painting of what nobody sees, which has no other form.

use crate::Raster;
use crate::framegen::cpu::bars::Inside;
use crate::framegen::cpu::colour::Colour;
use crate::framegen::cpu::field::{self, RIM, SMOOTH as SMOOTH_GIVEN, UNKNOWN_MATCH};
use crate::framegen::cpu::fill::{Evidence, NEAR};
use crate::framegen::cpu::foreign::{self, is_foreign};
use crate::framegen::cpu::inpaint::Inpainter;
use crate::framegen::cpu::kernels::{BLOCK, Landing, Level, Rule, Source, TILE, land};
use crate::framegen::cpu::landing::SMOOTH as SMOOTH_LANDED;
use crate::framegen::cpu::layer::{
    self, EMPTY, Grid, HOLE, Key, Kind, LONGEST, Layer, ONE_SURFACE, ORPHAN, SLOPE, Tile, WHOLE, alike, is_nearer,
    landed, part, slopes,
};
use crate::framegen::cpu::leaving::Leaving;
use crate::framegen::cpu::overlay::Overlays;
use crate::framegen::cpu::past::Past;
use crate::framegen::cpu::perspective::{Moment, Seen, Way};
use crate::framegen::cpu::render::{AGREE, DISTINCT, STRICT, apart, careful, unseen};
use crate::framegen::cpu::soften::{SHARE, TORN};
use crate::framegen::cpu::{source, standing::Standing, tests::oracle::RIM_BETWEEN};
use crate::framegen::{Anchor, AnchorPair};
use crate::guidance::Guidance;

/// The picture at `phase` of [`WHOLE`] between two anchors without a cut, and the share that nothing visible in the
/// current one lands on.
pub(super) fn between<P: Colour>(pair: &AnchorPair<'_, P>, phase: i32) -> (Raster<P>, f32) {
    let (previous, current) = (source(pair.previous()), source(pair.current()));
    let inside = Inside::find(Level::SCALAR, previous, current);
    let standing = Standing::new(Some(&inside), pair.overlay(), current.width);
    let field = moved_by(pair.guidance(), Some((previous, current)), &standing);

    let mut owners = settled(&field, &claims_of(&field), Way::from_current(Moment::previous()));
    let mut leaving = Leaving::default();
    let is_optical_flow = pair.guidance().origin().is_optical_flow();
    let seen = Seen::find(pair.guidance(), &standing);
    let past = Past::new(&seen, pair.previous_depth(), pair.guidance().depth());
    match &past {
        Some(past) => uncover(&mut owners, &field, past),
        None => {
            let margin = foreign::margin(previous, current);
            leaving.find(&mut owners, previous, current, margin, is_optical_flow.into()).unwrap();
        }
    }
    let evidence = Evidence {
        field: &field,
        way: Way::from_current(Moment::previous()),
        shown: Some(previous),
        past: past.as_ref(),
        carries: true,
        leaving: past.is_none().then_some(&leaving),
        mark: ORPHAN,
    };
    fill(&mut owners, &evidence);

    // Both go to phase t: what the current anchor shows, and what only the previous one does.
    let moment = Moment::new(phase, seen.perspective);
    let [way, back] = [Way::from_current(moment), Way::from_previous(moment)];
    let mut moving: Vec<_> = claims_of(&field).into_iter().map(|claim| claim.carried(way)).collect();
    moving.extend(borrowed_of(&owners).into_iter().map(|claim| claim.carried(back)));
    let mut places = gathered(field.grid, &moving);
    fill(
        &mut places,
        &Evidence::<P> { field: &field, way, shown: None, past: None, carries: false, leaving: None, mark: HOLE },
    );

    render(&Shown {
        previous,
        current,
        places: &places,
        field: &field,
        owners: &owners,
        phase,
        moment,
        is_optical_flow,
    })
}

/// The picture `phase` of [`WHOLE`] after an anchor, and the same share.
pub(super) fn beyond<P: Colour>(anchor: &Anchor<'_, P>, phase: i32) -> (Raster<P>, f32) {
    let current = source(anchor.picture());
    let standing = Standing::new(None, anchor.overlay(), current.width);
    let field = moved_by::<P>(anchor.guidance(), None, &standing);
    let moment = Moment::new(WHOLE + phase, Seen::find(anchor.guidance(), &standing).perspective);
    let way = Way::from_current(moment);
    let mut places = settled(&field, &claims_of(&field), way);
    fill(
        &mut places,
        &Evidence::<P> { field: &field, way, shown: None, past: None, carries: false, leaving: None, mark: HOLE },
    );

    let grid = field.grid;
    let mut out = anchor.picture().clone();
    let (mut hidden, mut uncovered) = (vec![0; grid.tiles()], 0);
    for [x, y] in pixels(grid) {
        let (own, tile, place) = (places.owner(x, y), grid.place(x, y).0, grid.place(x, y).1);
        let claim = if own == EMPTY { places.borrowed[tile][place] } else { own };
        let vector = layer::vector(claim);
        let phase = phase_at(&places, &moment, [x, y], claim, true) - WHOLE;
        let from = [64 * x as i32 + part(vector[0], phase), 64 * y as i32 + part(vector[1], phase)];
        out.pixels_mut()[y * grid.width + x] = P::sample(current, from);
        if own == EMPTY {
            uncovered += 1;
            let shown = grid.nearest(from).map(|[u, v]| field.owner(u, v));
            let is_covered = shown.is_some_and(|shown| !alike(shown, claim) && is_nearer(shown, claim));
            hidden[tile] |= u64::from(is_covered) << place;
        }
    }
    painted(grid, &hidden, &mut out);
    (out, uncovered as f32 / (grid.width * grid.height) as f32)
}

fn pixels(grid: Grid) -> impl Iterator<Item = [usize; 2]> {
    (0..grid.height).flat_map(move |y| (0..grid.width).map(move |x| [x, y]))
}

fn tiles(grid: Grid) -> impl Iterator<Item = (usize, [usize; 2])> {
    (0..grid.tiles()).map(move |tile| (tile, [tile % grid.columns, tile / grid.columns]))
}

/// The pixels of a tile.
fn pixels_of(grid: Grid, [column, row]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let [across, down] = grid.extent(column, row);
    (0..down).flat_map(move |j| (0..across).map(move |i| [column * TILE + i, row * TILE + j]))
}

fn empty(grid: Grid) -> Layer {
    let mut layer = Layer::default();
    layer.reserve(grid).unwrap();
    layer.borrowed = vec![[EMPTY; BLOCK]; grid.tiles()];
    layer
}

/// The motion of the current anchor.
fn moved_by<P: Colour>(
    guidance: &Guidance,
    anchors: Option<(Source<'_, P>, Source<'_, P>)>,
    standing: &Standing<'_>,
) -> Layer {
    let grid = Grid::new(guidance.size());
    let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(LONGEST));
    let told = |[x, y]: [usize; 2]| {
        let mut landing = Landing::default();
        let vector = guidance.motion().at(x as u32, y as u32);
        let map = guidance.depth();
        let tile = map.tile() as usize;
        let depth = map.depth()[y / tile * map.columns() as usize + x / tile];
        land(Level::SCALAR, &[vector], &[depth], [0; 2], 0, limit, &mut landing);
        landing.keys[0]
    };
    let rank = |at| layer::rank(told(at));
    let is_flat = pixels(grid).all(|at| rank(at) == rank([0, 0]));

    let mut given = empty(grid);
    for (tile, at) in tiles(grid) {
        let still = pixels_of(grid, at).filter(|&at| standing.is_at(at)).count();
        let ([low, high], near) = (range(pixels_of(grid, at).map(told)), pixels_of(grid, at).map(rank).min().unwrap());
        if still == pixels_of(grid, at).count() {
            given.tiles[tile].key = layer::key(0, 0, [0; 2]);
        } else if still == 0 && (0..2).all(|c| high[c] - low[c] <= SMOOTH_GIVEN) {
            given.tiles[tile].key = layer::key(near, 0, [0, 1].map(|c| (low[c] + high[c]).div_euclid(2)));
        } else {
            given.tiles[tile].kind = Kind::Rough;
            for pixel in pixels_of(grid, at) {
                let key = if standing.is_at(pixel) { layer::key(0, 0, [0; 2]) } else { told(pixel) };
                given.keys[tile][grid.place(pixel[0], pixel[1]).1] = key;
            }
        }
    }

    // Where surfaces meet, the rim of a surface belongs to what is in front; without depth, the better match is.
    let mut field = empty(grid);
    let can_dilate = !is_flat && guidance.motion().tile() == 1;
    for (tile, at) in tiles(grid) {
        field.tiles[tile] = given.tiles[tile];
        let key = given.tiles[tile].key;
        let is_smooth = given.tiles[tile].kind == Kind::Smooth;
        let around = tiles(grid).filter(|(_, other)| (0..2).all(|c| other[c].abs_diff(at[c]) <= 1));
        let is_apart =
            |(other, _): (usize, _)| given.tiles[other].kind == Kind::Rough || !alike(given.tiles[other].key, key);
        let is_looked_at = can_dilate || is_flat && anchors.is_some();
        if is_smooth && !(is_looked_at && { around }.any(is_apart)) {
            if is_flat {
                field.tiles[tile].key = layer::marked(key, UNKNOWN_MATCH);
            }
            continue;
        }
        let mut is_changed = !is_smooth;
        for [x, y] in pixels_of(grid, at) {
            let own = given.owner(x, y);
            let rim = (y.saturating_sub(1)..(y + 2).min(grid.height))
                .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(grid.width)).map(move |u| [u, v]));
            let nearest = rim.map(|[u, v]| given.owner(u, v)).min().unwrap();
            let key = match anchors {
                Some((previous, current)) if is_flat => {
                    is_changed = true;
                    layer::marked(own, field::match_of(previous, current, [x, y], own))
                }
                _ if can_dilate && is_nearer(nearest, own) && !alike(nearest, own) => {
                    let fits = anchors.is_none_or(|(previous, current)| {
                        let distance = |claim| field::distance(previous, current, [x, y], claim);
                        distance(nearest) <= RIM && distance(nearest) < distance(own)
                    });
                    is_changed |= fits;
                    if fits { nearest } else { own }
                }
                _ => own,
            };
            field.keys[tile][grid.place(x, y).1] = key;
        }
        if is_changed {
            field.tiles[tile] = Tile { kind: Kind::Rough, key: EMPTY, ..Tile::default() };
        }
    }
    field
}

/// The least and the largest of each component of the vectors of claims.
fn range(keys: impl Iterator<Item = Key>) -> [[i32; 2]; 2] {
    keys.map(layer::vector).fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], vector| {
        [[0, 1].map(|c| low[c].min(vector[c])), [0, 1].map(|c| high[c].max(vector[c]))]
    })
}

/// What moves: a smooth tile as a whole, or a pixel.
#[derive(Clone, Copy)]
struct Claim {
    key: Key,
    /// Where it stands.
    at: [i32; 2],
    /// How wide and high it is, for a smooth tile.
    extent: Option<[usize; 2]>,
}

impl Claim {
    fn carried(self, way: Way) -> Self {
        let vector = layer::vector(self.key);
        // A tile goes as its middle does.
        let middle = if self.extent.is_some() { TILE as i32 / 2 } else { 0 };
        let reach = way.reach(self.key, self.at.map(|at| at + middle));
        Self { at: [0, 1].map(|c| landed(self.at[c], vector[c], reach)), ..self }
    }

    fn places(self) -> impl Iterator<Item = [i32; 2]> {
        let [across, down] = self.extent.unwrap_or([1, 1]).map(|v| v as i32);
        (0..down).flat_map(move |j| (0..across).map(move |i| [self.at[0] + i, self.at[1] + j]))
    }
}

/// What a layer claims by itself.
fn claims_of(layer: &Layer) -> Vec<Claim> {
    let grid = layer.grid;
    let mut claims = Vec::new();
    for (tile, at) in tiles(grid) {
        if layer.tiles[tile].kind == Kind::Smooth {
            let corner = at.map(|v| (v * TILE) as i32);
            claims.push(Claim { key: layer.tiles[tile].key, at: corner, extent: Some(grid.extent(at[0], at[1])) });
        } else {
            claims.extend(pixels_of(grid, at).map(|[x, y]| (layer.owner(x, y), [x, y])).filter_map(pixel));
        }
    }
    claims
}

/// What it borrows.
fn borrowed_of(layer: &Layer) -> Vec<Claim> {
    let borrowed = pixels(layer.grid).map(|[x, y]| {
        let (tile, place) = layer.grid.place(x, y);
        (layer.borrowed[tile][place], [x, y])
    });
    borrowed.filter_map(pixel).collect()
}

fn pixel((key, at): (Key, [usize; 2])) -> Option<Claim> {
    (key != EMPTY).then_some(Claim { key, at: at.map(|v| v as i32), extent: None })
}

/// Claims carried some way, and settled.
fn settled(field: &Layer, claims: &[Claim], way: Way) -> Layer {
    gathered(field.grid, &claims.iter().map(|claim| claim.carried(way)).collect::<Vec<_>>())
}

/// What a picture holds on which claims have landed: a tile that smooth ones cover for the most part, and alike, is
/// smooth; in others the nearest gets each place, and cracks are closed.
fn gathered(grid: Grid, claims: &[Claim]) -> Layer {
    let (across, down) = ((grid.columns * TILE) as i32, (grid.rows * TILE) as i32);
    let tile_at = |[x, y]: [i32; 2]| {
        ((0..across).contains(&x) && (0..down).contains(&y))
            .then(|| y as usize / TILE * grid.columns + x as usize / TILE)
    };
    let mut landed = vec![Vec::new(); grid.tiles()];
    let mut is_rough = vec![false; grid.tiles()];
    // With a rim of one place, so that cracks are seen whole.
    let stride = across as usize + 2;
    let mut nearest = vec![EMPTY; stride * (down as usize + 2)];
    for claim in claims {
        for at in claim.places() {
            if let Some(tile) = tile_at(at) {
                landed[tile].push(claim.key);
                is_rough[tile] |= claim.extent.is_none();
            }
            if (-1..=across).contains(&at[0]) && (-1..=down).contains(&at[1]) {
                let place = &mut nearest[(at[1] + 1) as usize * stride + (at[0] + 1) as usize];
                *place = (*place).min(claim.key);
            }
        }
    }
    let at = |x: usize, y: usize, dx: usize, dy: usize| nearest[(y + dy) * stride + x + dx];

    let mut layer = empty(grid);
    for (tile, position) in tiles(grid) {
        let keys = &landed[tile];
        let whole = pixels_of(grid, position).count();
        let [low, high] = range(keys.iter().copied());
        let is_covered = 4 * keys.len() >= 3 * whole;
        let ranks = || keys.iter().map(|&key| layer::rank(key));
        let is_surface = is_covered && ranks().max().unwrap() - ranks().min().unwrap() <= ONE_SURFACE;
        let apart = if is_surface { SLOPE } else { SMOOTH_LANDED };
        if !is_rough[tile] && is_covered && (0..2).all(|c| high[c] - low[c] <= apart) {
            let front = *keys.iter().min().unwrap();
            let mean = [0, 1].map(|c| {
                let sum: i64 = keys.iter().map(|&key| i64::from(layer::vector(key)[c])).sum();
                (2 * sum + keys.len() as i64).div_euclid(2 * keys.len() as i64) as i32
            });
            layer.tiles[tile].key = layer::key(layer::rank(front), layer::mark(front), mean);
            continue;
        }
        layer.tiles[tile].kind = Kind::Rough;
        for [x, y] in pixels_of(grid, position) {
            let mut own = at(x, y, 1, 1);
            for [a, b] in [[at(x, y, 0, 1), at(x, y, 2, 1)], [at(x, y, 1, 0), at(x, y, 1, 2)]] {
                let is_surface = a != EMPTY && b != EMPTY && alike(a, b);
                if is_surface && (own == EMPTY || is_nearer(a.max(b), own) && !alike(a.min(b), own)) {
                    own = a.min(b);
                }
            }
            layer.keys[tile][grid.place(x, y).1] = own;
        }
        let claims = pixels_of(grid, position).map(|[x, y]| layer.owner(x, y));
        let (holes, claims): (Vec<_>, Vec<_>) = claims.partition(|&key| key == EMPTY);
        layer.tiles[tile].holes = holes.len() as u8;
        layer.tiles[tile].key = claims.into_iter().max().unwrap_or(EMPTY);
    }
    layer
}

/// Takes places away from owners that something covers in the previous anchor.
fn uncover(owners: &mut Layer, field: &Layer, past: &Past<'_>) {
    let grid = field.grid;
    let other = |[x, y]: [usize; 2]| {
        let is_smooth = owners.tiles[grid.place(x, y).0].kind == Kind::Smooth;
        let middle = [x, y].map(|at| at / TILE * TILE + TILE / 2);
        past.other(owners.owner(x, y), if is_smooth { middle } else { [x, y] })
    };
    let owned = pixels(grid).filter(|&[x, y]| owners.owner(x, y) != EMPTY);
    let covered: Vec<_> = owned.filter(|&at| past.is_covered(field, at, other(at))).collect();
    covered.into_iter().for_each(|[x, y]| owners.free(x, y));
}

/// Lets every place that nothing claims borrow one.
fn fill<P: Colour>(layer: &mut Layer, evidence: &Evidence<'_, P>) {
    let grid = layer.grid;
    for (tile, position) in tiles(grid) {
        for [x, y] in pixels_of(grid, position) {
            if layer.owner(x, y) != EMPTY {
                continue;
            }
            // Left, right, above, below: the first that is claimed.
            let steps = [[-1, 0], [1, 0], [0, -1], [0, 1]];
            let candidates = steps.into_iter().filter_map(|[dx, dy]| {
                (1..=NEAR).find_map(|step| {
                    let u = x.checked_add_signed(dx * step as isize).filter(|&u| u < grid.width)?;
                    let v = y.checked_add_signed(dy * step as isize).filter(|&v| v < grid.height)?;
                    let key = layer.owner(u, v);
                    (key != EMPTY).then(|| (cost(evidence, grid, [x, y], key, step, [u, v]), key))
                })
            });
            // Of equals the first.
            let best = candidates.reduce(|best, other| if other.0 < best.0 { other } else { best });
            let found = best.map_or(EMPTY, |(_, key)| key);
            let found =
                evidence.past.map_or(found, |past| past.claim_or(evidence.field, [x, y], past.claim([x, y]), found));
            let key = if found == EMPTY { farthest_around(layer, position) } else { found };
            let leaves = evidence.leaving.and_then(|leaving| leaving.claim(x, y));
            layer.borrowed[tile][grid.place(x, y).1] = leaves.unwrap_or(layer::marked(key, evidence.mark));
        }
    }
}

/// How bad a candidate is that was found `step` away at `from`, the worst first: it must be hidden in the current anchor or
/// have left it, else it would have claimed the place; then, for what an anchor shows, how unlike it is and how far away,
/// for what none does, how near its surface is.
fn cost<P: Colour>(
    evidence: &Evidence<'_, P>,
    grid: Grid,
    [x, y]: [usize; 2],
    key: Key,
    step: usize,
    from: [usize; 2],
) -> (bool, u64, u64) {
    let [vx, vy] = layer::vector(key);
    let reach = evidence.way.reach(key, [x as i32, y as i32]);
    let there = [64 * x as i32 - part(vx, reach), 64 * y as i32 - part(vy, reach)];
    let is_contradicted = grid.nearest(there).is_some_and(|[u, v]| {
        let shown = evidence.field.owner(u, v);
        alike(shown, key) || is_nearer(key, shown)
    });
    let nearness = u64::from(u16::MAX - layer::rank(key));
    match evidence.shown {
        Some(shown) => {
            let luma = |[x, y]: [usize; 2]| shown.pixels[y * grid.width + x].luma();
            let unlike = (luma([x, y]) - luma(from)).abs().min(255.0) as u64;
            (is_contradicted, unlike + step as u64, nearness)
        }
        None => (is_contradicted, nearness, step as u64),
    }
}

/// The farthest claim of the least square of 1, 2, 4, 8 and so on tiles around a tile that holds any.
fn farthest_around(layer: &Layer, [column, row]: [usize; 2]) -> Key {
    let grid = layer.grid;
    let squares = (0..).map(|power| {
        let in_square = |at: [usize; 2]| at[0] >> power == column >> power && at[1] >> power == row >> power;
        let keys = tiles(grid).filter(|&(_, at)| in_square(at)).map(|(tile, _)| layer.tiles[tile].key);
        (keys.filter(|&key| key != EMPTY).max(), 1 << power >= grid.columns.max(grid.rows))
    });
    for (key, is_all) in squares {
        match key {
            Some(key) => return key,
            None if is_all => break,
            None => {}
        }
    }
    layer::key(u16::MAX, 0, [0; 2])
}

/// What a picture between two anchors is made of.
struct Shown<'a, P> {
    previous: Source<'a, P>,
    current: Source<'a, P>,
    places: &'a Layer,
    field: &'a Layer,
    owners: &'a Layer,
    phase: i32,
    moment: Moment,
    /// Whether edges are known from pictures alone.
    is_optical_flow: bool,
}

/// The phase at which even motion has what claims a place: with `is_whole` that of its tile, if that is smooth.
fn phase_at(places: &Layer, moment: &Moment, [x, y]: [usize; 2], key: Key, is_whole: bool) -> i32 {
    let grid = places.grid;
    let corner = [x, y].map(|at| at / TILE * TILE);
    let tile = grid.place(x, y).0;
    let is_full = grid.extent(x / TILE, y / TILE) == [TILE, TILE];
    let is_one = is_whole && is_full && places.tiles[tile].kind == Kind::Smooth;
    let at = if is_one { corner.map(|at| at + TILE / 2) } else { [x, y] };
    moment.phase(key, at.map(|at| at as i32))
}

fn render<P: Colour>(shown: &Shown<'_, P>) -> (Raster<P>, f32) {
    let grid = shown.places.grid;
    let mut out = Raster::new(grid.width as u32, grid.height as u32).unwrap();
    let (mut hidden, mut fixed, mut uncovered) = (vec![0; grid.tiles()], vec![0; grid.tiles()], 0);
    for [x, y] in pixels(grid) {
        let (tile, place) = grid.place(x, y);
        let own = shown.places.owner(x, y);
        let key = if own == EMPTY { shown.places.borrowed[tile][place] } else { own };
        uncovered += usize::from(own == EMPTY || layer::mark(own) == ORPHAN);
        match shown.pixel([x, y], tile, own, key) {
            Some((pixel, stands_still)) => {
                out.pixels_mut()[y * grid.width + x] = pixel;
                fixed[tile] |= u64::from(stands_still) << place;
            }
            None => hidden[tile] |= 1 << place,
        }
    }
    let sharp = out.clone();
    for (tile, at) in tiles(grid) {
        shown.soften(tile, at, [hidden[tile], fixed[tile]], &sharp, &mut out);
    }
    painted(grid, &hidden, &mut out);
    (out, uncovered as f32 / (grid.width * grid.height) as f32)
}

fn painted<P: Colour>(grid: Grid, hidden: &[u64], out: &mut Raster<P>) {
    if hidden.iter().any(|&tile| tile != 0) {
        Inpainter::default().paint(grid, hidden, out).unwrap();
    }
}

impl<P: Colour> Shown<'_, P> {
    fn rule(&self, careful: u8) -> Rule {
        let weight = ((self.phase + 16) / 32).clamp(1, 127) as u8;
        Rule { weight, nearer_is_current: 2 * self.phase >= WHOLE, agree: AGREE, careful }
    }

    /// Where the two anchors show what is at (x, y), at the phase of its tile, if that is smooth, or at its own.
    fn spots(&self, [x, y]: [usize; 2], key: Key, is_whole: bool) -> [[i32; 2]; 2] {
        let (vector, phase) = (layer::vector(key), phase_at(self.places, &self.moment, [x, y], key, is_whole));
        let before = [64 * x as i32 + part(vector[0], phase), 64 * y as i32 + part(vector[1], phase)];
        [before, [before[0] - vector[0], before[1] - vector[1]]]
    }

    /// Softens the pixels of a tile that depth does not tell the edges of.
    fn soften(&self, tile: usize, at: [usize; 2], [hidden, fixed]: [u64; 2], sharp: &Raster<P>, out: &mut Raster<P>) {
        let grid = self.places.grid;
        if !self.is_optical_flow
            || self.places.tiles[tile].kind != Kind::Rough
            || grid.extent(at[0], at[1]) != [TILE, TILE]
        {
            return;
        }
        let keys: Vec<Key> = pixels_of(grid, at).map(|[x, y]| self.places.claim(x, y)).collect();
        let is_torn = (0..2).any(|axis| {
            let along = || keys.iter().map(|&key| layer::vector(key)[axis]);
            along().max().unwrap() - along().min().unwrap() > TORN
        });
        let is_in = |mask: u64, x: usize, y: usize| mask >> grid.place(x, y).1 & 1 == 1;
        for ([x, y], &key) in pixels_of(grid, at).zip(&keys) {
            let is_loose = layer::mark(key) == ORPHAN || layer::mark(key) == HOLE;
            if !(is_torn || is_loose) || is_in(hidden | fixed, x, y) {
                continue;
            }
            let beside = [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]].map(|[u, v]| {
                let is_own = [u / TILE, v / TILE] == at && !is_in(hidden, u, v);
                let [u, v] = if is_own { [u, v] } else { [x, y] };
                sharp.pixels()[v * grid.width + u]
            });
            out.pixels_mut()[y * grid.width + x] = sharp.pixels()[y * grid.width + x].softened(beside, SHARE);
        }
    }

    /// The colour at a place, if an anchor shows it, and whether something stands still there.
    fn pixel(&self, at: [usize; 2], tile: usize, own: Key, key: Key) -> Option<(P, bool)> {
        let grid = self.places.grid;
        let [before, after] = self.spots(at, key, true);
        let (of_previous, of_current) = (P::sample(self.previous, before), P::sample(self.current, after));
        let rule = self.rule(careful(self.is_optical_flow));
        let (merged, is_far_apart) = P::merge(of_previous, of_current, &rule);
        let (from, to) = (grid.nearest(before), grid.nearest(after));
        let is_doubtful = is_far_apart || own == EMPTY || layer::mark(own) == ORPHAN || from.is_none() || to.is_none();
        let is_close = !P::merge(of_previous, of_current, &self.rule(STRICT)).1;
        if !is_doubtful && (is_close || self.is_clear(tile)) {
            return Some((merged, false));
        }
        // Beside something in front, or what moves otherwise without depth, it is that thing's if so the anchors agree better.
        let moves_otherwise = |claim: Key| !layer::moves_within(claim, key, DISTINCT);
        let around = (at[1].saturating_sub(1)..(at[1] + 2).min(grid.height))
            .flat_map(|y| (at[0].saturating_sub(1)..(at[0] + 2).min(grid.width)).map(move |x| self.places.claim(x, y)));
        let front = around.filter(|&claim| !self.is_optical_flow || moves_otherwise(claim)).min().unwrap_or(key);
        let [front_before, front_after] = self.spots(at, front, false);
        let is_beside =
            (self.is_optical_flow || is_nearer(front, key)) && moves_otherwise(front) && !self.is_clear(tile);
        if is_beside && grid.holds(front_before) && grid.holds(front_after) {
            let (a, b) = (P::sample(self.previous, front_before), P::sample(self.current, front_after));
            let is_seen = from.is_some_and(|[x, y]| alike(self.owners.claim(x, y), key))
                && to.is_some_and(|[x, y]| alike(self.field.owner(x, y), key));
            let own = if is_seen { apart(of_previous, of_current) } else { unseen(self.is_optical_flow) };
            if apart(a, b) <= RIM_BETWEEN && apart(a, b) < own {
                return Some((P::merge(a, b, &rule).0, false));
            }
        }
        let mark = layer::mark(key);
        let mut is_before = from.is_some_and(|[x, y]| {
            let owner = self.owners.claim(x, y);
            mark == ORPHAN || alike(owner, key) || layer::mark(owner) == ORPHAN && !is_nearer(owner, key)
        });
        let mut is_after = to.is_some_and(|[x, y]| {
            let shown = self.field.owner(x, y);
            alike(shown, key) || mark != ORPHAN && mark != HOLE && is_nearer(key, shown)
        });
        if is_doubtful && (is_before == is_after || from.is_none() || to.is_none()) {
            let overlays = Overlays { previous: self.previous, current: self.current };
            let vector = layer::vector(key);
            if overlays.is_at(at, vector) {
                let place = at[1] * grid.width + at[0];
                return Some((P::merge(self.previous.pixels[place], self.current.pixels[place], &rule).0, true));
            }
            is_before = is_before && !from.is_some_and(|from| overlays.is_before(from, vector));
            is_after = is_after && !to.is_some_and(|to| overlays.is_at(to, vector));
        }
        match (is_before, is_after) {
            (true, true)
                if is_doubtful
                    && is_foreign(of_previous, self.current, after, foreign::margin(self.previous, self.current)) =>
            {
                Some((of_current, false))
            }
            (true, true) => Some((merged, false)),
            (true, false) => Some((of_previous, false)),
            (false, true) => Some((of_current, false)),
            (false, false) => None,
        }
    }

    /// Whether both anchors show all of a tile at phase t: it is smooth, and so are those that it comes from, and alike.
    fn is_clear(&self, tile: usize) -> bool {
        let grid = self.places.grid;
        let at = [tile % grid.columns, tile / grid.columns];
        let Tile { kind, key, .. } = self.places.tiles[tile];
        kind == Kind::Smooth
            && grid.extent(at[0], at[1]) == [TILE, TILE]
            && pixels_of(grid, at).all(|pixel| {
                let is_seen = |layer: &Layer, spot| {
                    grid.nearest(spot).is_some_and(|[x, y]| {
                        let shown = layer.tiles[grid.place(x, y).0];
                        shown.kind == Kind::Smooth && (alike(shown.key, key) || slopes(shown.key, key))
                    })
                };
                let [before, after] = self.spots(pixel, key, true);
                is_seen(self.owners, before) && is_seen(self.field, after)
            })
    }
}
