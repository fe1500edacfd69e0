//! What the previous anchor alone shows, where its depth is known.
//!
//! In a world at rest, motion and depth of the current anchor tell how the camera goes (see `perspective`), and with that a
//! depth in the previous anchor tells where what is there has gone to. What the current anchor hides, and what has left it,
//! needs no guess then: not how it moves, nor that it stood in front of what the current anchor shows.

use rayon::prelude::*;

use super::kernels::{BLOCK, Level, TILE, at_every_level};
use super::layer::{self, EMPTY, Key, Kind, LONGEST, Layer, ORPHAN, Tile, alike, is_nearer};
use super::perspective::{Back, Perspective, Seen, nearness, rank_of};
use crate::guidance::DepthMap;

/// What is nearer than what a place shows by more than this part of `1 / w` is something else.
const OTHER: f32 = 1.125;
/// What is as far away differs by no more than this part.
const AS_FAR: f32 = 1.0 / 32.0;

/// How near what has a depth is; what is farthest, and what is no depth between the planes, is not near at all.
#[inline(always)]
fn nearness_of(depth: f32) -> f32 {
    if depth > 0.0 && depth < 1.0 { 1.0 - depth } else { 0.0 }
}

/// The largest whole number that is no larger; processors without an instruction for it need none.
#[inline(always)]
fn floored(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from(whole as f32 > v)
}

/// What a pixel claims that shows something so near, or [`EMPTY`]; no component of its vector is beyond `limit`.
#[inline(always)]
fn claim_of(back: &Back, limit: [f32; 2], [x, y]: [usize; 2], near: f32) -> Key {
    let at = [x as i32 as f32, y as i32 as f32];
    let (was, there, can_be) = back.follow(at, near);
    // What is longer has left the picture all the same.
    let along = |c: usize| floored((64.0 * (at[c] - was[c])).clamp(-limit[c], limit[c]) + 0.5);
    let key = layer::key(rank_of(there), ORPHAN, [along(0), along(1)]);
    if can_be & (near > 0.0) { key } else { EMPTY }
}

at_every_level! {
    /// [`claim_of`] for the pixels of a tile.
    fn claims_of(back: &Back, limit: [f32; 2], corner: [usize; 2], nears: &[f32; BLOCK], claims: &mut [Key; BLOCK])
        = claims_in_rows | claims_in_rows
}

#[inline(always)]
fn claims_in_rows(back: &Back, limit: [f32; 2], [x, y]: [usize; 2], nears: &[f32; BLOCK], claims: &mut [Key; BLOCK]) {
    for j in 0..TILE {
        for i in 0..TILE {
            claims[j * TILE + i] = claim_of(back, limit, [x + i, y + j], nears[j * TILE + i]);
        }
    }
}

at_every_level! {
    /// Which pixels of a tile show something nearer than [`other`] says of what claims them: bit `8 j + i`.
    fn others_of(perspective: &Perspective, corner: [usize; 2], keys: &[Key; BLOCK], nears: &[f32; BLOCK]) -> u64
        = others_in_rows | others_in_rows
}

#[inline(always)]
fn others_in_rows(perspective: &Perspective, [x, y]: [usize; 2], keys: &[Key; BLOCK], nears: &[f32; BLOCK]) -> u64 {
    let mut others = [0; TILE];
    for j in 0..TILE {
        for (i, others) in others.iter_mut().enumerate() {
            let place = j * TILE + i;
            let is_other = (keys[place] != EMPTY) & (nears[place] > other(perspective, keys[place], [x + i, y + j]));
            *others |= u64::from(is_other) << place;
        }
    }
    others.into_iter().fold(0, |all, bits| all | bits)
}

/// How near something in the previous anchor is at least that is not what claims a pixel there.
#[inline(always)]
fn other(perspective: &Perspective, key: Key, at: [usize; 2]) -> f32 {
    OTHER * nearness(key) / (1.0 + perspective.change(key, at.map(|at| at as i32)))
}

/// The world at rest, as the previous anchor shows it.
pub(super) struct Past<'a> {
    depth: &'a DepthMap,
    perspective: Perspective,
    back: Back,
    /// The longest components of vectors, in 1/64 px.
    limit: [f32; 2],
}

impl<'a> Past<'a> {
    /// What a previous anchor's `depth` tells, if it is that of the current one's camera and how that goes is known.
    pub(super) fn new(seen: &Seen, depth: Option<&'a DepthMap>, current: &DepthMap) -> Option<Self> {
        let depth = depth.filter(|depth| depth.projection() == current.projection())?;
        let limit = [depth.width(), depth.height()].map(|side| (64 * side as i32).min(LONGEST) as f32);
        Some(Self { depth, perspective: seen.perspective, back: seen.back?, limit })
    }

    /// How near what the previous anchor shows at a pixel is.
    #[inline(always)]
    fn near(&self, [x, y]: [usize; 2]) -> f32 {
        // Tiles are of 1, 8 or 16 pixels.
        let shift = self.depth.tile().trailing_zeros();
        nearness_of(self.depth.depth()[(y >> shift) * self.depth.columns() as usize + (x >> shift)])
    }

    /// How near the nearest thing is that it shows in a tile.
    #[inline(always)]
    fn nearest(&self, [x, y]: [usize; 2], [across, down]: [usize; 2]) -> f32 {
        if self.depth.tile() > 1 {
            return self.near([x, y]);
        }
        let width = self.depth.width() as usize;
        let mut nearest = [0.0; TILE];
        for row in self.depth.depth()[y * width..].chunks(width).take(down) {
            for (nearest, &depth) in nearest.iter_mut().zip(&row[x..x + across]) {
                let near = nearness_of(depth);
                *nearest = if near > *nearest { near } else { *nearest };
            }
        }
        nearest.into_iter().fold(0.0, f32::max)
    }

    /// How near what it shows in a tile is; nothing is near beyond the far edges.
    #[inline(always)]
    fn nears(&self, [x, y]: [usize; 2], [across, down]: [usize; 2]) -> [f32; BLOCK] {
        let mut nears = [0.0; BLOCK];
        let width = self.depth.width() as usize;
        for (j, nears) in nears.as_chunks_mut::<TILE>().0.iter_mut().enumerate().take(down) {
            if self.depth.tile() > 1 {
                nears[..across].fill(self.near([x, y]));
            } else {
                let depths = &self.depth.depth()[(y + j) * width + x..][..across];
                nears.iter_mut().zip(depths).for_each(|(near, &depth)| *near = nearness_of(depth));
            }
        }
        nears
    }

    /// What a pixel of the previous anchor claims if it is at rest, or [`EMPTY`]. What is farthest claims nothing.
    #[inline(always)]
    pub(super) fn claim(&self, at: [usize; 2]) -> Key {
        claim_of(&self.back, self.limit, at, self.near(at))
    }

    /// The same for the pixels of a tile.
    #[inline(always)]
    pub(super) fn claims(&self, level: Level, corner: [usize; 2], extent: [usize; 2]) -> [Key; BLOCK] {
        let mut claims = [EMPTY; BLOCK];
        claims_of(level, &self.back, self.limit, corner, &self.nears(corner, extent), &mut claims);
        claims
    }

    /// Whether a claim from the previous anchor cannot be: the current one shows it, or what is behind it.
    #[inline(always)]
    pub(super) fn is_contradicted(&self, field: &Layer, [x, y]: [usize; 2], claim: Key) -> bool {
        let [vx, vy] = layer::vector(claim);
        field.grid.nearest([64 * x as i32 - vx, 64 * y as i32 - vy]).is_some_and(|[u, v]| {
            let shown = field.owner(u, v);
            alike(shown, claim) || is_nearer(claim, shown)
        })
    }

    /// What claims a pixel of the previous anchor that nothing in the current one does: what is at rest there (`claim`),
    /// if that can be, or `found` beside it. What is as far away as that and moves otherwise is carried along.
    #[inline(always)]
    pub(super) fn claim_or(&self, field: &Layer, at: [usize; 2], claim: Key, found: Key) -> Key {
        if claim == EMPTY || self.is_contradicted(field, at, claim) {
            return found;
        }
        let is_carried = || (nearness(found) - self.near(at)).abs() <= AS_FAR * self.near(at);
        if found != EMPTY && !alike(found, claim) && is_carried() { found } else { claim }
    }

    /// How near something in the previous anchor is at least that is not what claims a pixel there.
    #[inline(always)]
    pub(super) fn other(&self, key: Key, at: [usize; 2]) -> f32 {
        other(&self.perspective, key, at)
    }

    /// It is no less than this for claims that are no farther than `key`.
    #[inline(always)]
    fn least(&self, key: Key) -> f32 {
        OTHER * nearness(key) / (1.0 + self.perspective.most)
    }

    /// Whether something stands in front of what claims a pixel of the previous anchor, and nearer than `other`, of which
    /// the current anchor knows nothing.
    #[inline(always)]
    pub(super) fn is_covered(&self, field: &Layer, at: [usize; 2], other: f32) -> bool {
        let claim = if self.near(at) > other { self.claim(at) } else { EMPTY };
        claim != EMPTY && !self.is_contradicted(field, at, claim)
    }

    /// Takes pixels of the previous anchor away from owners that something covers there.
    pub(super) fn uncover(&self, level: Level, owners: &mut Layer, field: &Layer) {
        let grid = owners.grid;
        let tiles = owners.tiles.par_chunks_mut(grid.columns).zip(owners.keys.par_chunks_mut(grid.columns));
        tiles.enumerate().for_each(|(row, (tiles, keys))| {
            for (column, (tile, keys)) in tiles.iter_mut().zip(keys).enumerate() {
                self.uncover_tile(level, [column, row], field, tile, keys);
            }
        });
    }

    #[inline(never)]
    fn uncover_tile(
        &self,
        level: Level,
        [column, row]: [usize; 2],
        field: &Layer,
        tile: &mut Tile,
        keys: &mut [Key; BLOCK],
    ) {
        let extent = field.grid.extent(column, row);
        let corner = [column * TILE, row * TILE];
        let is_smooth = tile.kind == Kind::Smooth;
        let of_tile =
            if is_smooth { self.other(tile.key, corner.map(|at| at + TILE / 2)) } else { self.least(tile.key) };
        if self.nearest(corner, extent) <= of_tile {
            return;
        }
        let nears = self.nears(corner, extent);
        let mut others = if is_smooth {
            // What is beyond the far edges is not near.
            (0..BLOCK).fold(0, |others, place| others | u64::from(nears[place] > of_tile) << place)
        } else {
            others_of(level, &self.perspective, corner, keys, &nears)
        };
        while others != 0 {
            let place = others.trailing_zeros() as usize;
            others &= others - 1;
            let at = [corner[0] + place % TILE, corner[1] + place / TILE];
            let other = if is_smooth { of_tile } else { self.other(keys[place], at) };
            if self.is_covered(field, at, other) {
                tile.free(keys, extent, place);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layer::{Grid, rank};
    use super::super::perspective::tests::{SIZE, guidance, key_of, seen, shown, walk};
    use super::super::standing::Standing;
    use super::*;
    use crate::guidance::{Guidance, Projection};

    /// The depths of the previous anchor, as far as pixels of the current one land there; `post` pixels from the left
    /// stands something at half a metre.
    fn depths(post: u32) -> DepthMap {
        let mut depth = guidance(walk, 1).depth().clone();
        let values = depth.depth_mut();
        values.fill(1.0);
        for (x, y) in
            (0..4 * SIZE[1]).flat_map(|y| (0..4 * SIZE[0]).map(move |x| (f64::from(x) / 4.0, f64::from(y) / 4.0)))
        {
            let point = shown(x, y);
            let was = seen(point, 0.0).map(|v| v.round());
            if (0..2).all(|c| (0.0..f64::from(SIZE[c])).contains(&was[c])) {
                let value = &mut values[(was[1] * f64::from(SIZE[0]) + was[0]) as usize];
                // From the turn and the way ahead that the camera of `seen` makes.
                *value = value.min(1.0 - (0.1 / (point[2] - 0.05 * point[0] + 0.12)) as f32);
            }
        }
        values.chunks_mut(SIZE[0] as usize).for_each(|row| row[..post as usize].fill(0.8));
        depth
    }

    fn field(guidance: &Guidance) -> Layer {
        let mut field = Layer::default();
        field.reserve(Grid::new((SIZE[0], SIZE[1]))).unwrap();
        for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
            let (tile, place) = field.grid.place(x as usize, y as usize);
            field.tiles[tile].kind = Kind::Rough;
            let vector = guidance.motion().at(x, y).map(|v| f64::from(v.to_f32()));
            let depth = f64::from(guidance.depth().depth()[(y * SIZE[0] + x) as usize]);
            field.keys[tile][place] = key_of((vector, depth));
        }
        field
    }

    #[test]
    fn what_is_at_rest_is_followed_to_the_current_anchor() {
        let guidance = guidance(walk, 1);
        let seen_by = Seen::find(&guidance, &Standing::default());
        let depth = depths(0);
        let past = Past::new(&seen_by, Some(&depth), guidance.depth()).unwrap();
        let mut followed = 0;
        for (x, y) in (20..160).step_by(10).flat_map(|y| (30..290).step_by(10).map(move |x| (x, y))) {
            let (vector, at_depth) = walk(f64::from(x), f64::from(y));
            let was = [f64::from(x) + vector[0], f64::from(y) + vector[1]].map(|v| v.round() as usize);
            let claim = past.claim(was);
            assert_ne!(claim, EMPTY);
            let apart = [0, 1].map(|c| (f64::from(layer::vector(claim)[c]) / 64.0 - vector[c]).abs());
            // Ground at the next pixel is another.
            if rank(claim).abs_diff(rank(key_of((vector, at_depth)))) < 100 {
                followed += usize::from(apart[0] < 0.6 && apart[1] < 0.6);
            }
        }
        assert!(followed > 300, "{followed} of 364");
    }

    #[test]
    fn what_stood_in_front_and_has_left_uncovers_its_places() {
        let guidance = guidance(walk, 1);
        let (seen_by, field) = (Seen::find(&guidance, &Standing::default()), field(&guidance));
        let mut owners = Layer::default();
        owners.reserve(field.grid).unwrap();
        owners.tiles.iter_mut().for_each(|tile| tile.key = key_of(([0.0; 2], 0.99)));
        let depth = depths(6);
        Past::new(&seen_by, Some(&depth), guidance.depth()).unwrap().uncover(Level::detect(), &mut owners, &field);
        let is_free = |x: usize| (0..SIZE[1] as usize).filter(|&y| owners.owner(x, y) == EMPTY).count();
        assert!(is_free(0) > 170 && is_free(5) > 170, "{} and {} of 180", is_free(0), is_free(5));
        assert_eq!(is_free(8), 0);
    }

    #[test]
    fn another_camera_and_no_way_tell_nothing() {
        let (guidance, depth) = (guidance(walk, 1), depths(0));
        let found = Seen::find(&guidance, &Standing::default());
        let mut other = depth.clone();
        other.set_projection(Projection::new(0.2, 50.0, 1.0).unwrap());
        assert!(Past::new(&found, Some(&depth), guidance.depth()).is_some());
        assert!(Past::new(&found, Some(&other), guidance.depth()).is_none());
        assert!(Past::new(&found, None, guidance.depth()).is_none());
        assert!(Past::new(&Seen::default(), Some(&depth), guidance.depth()).is_none());
    }
}
