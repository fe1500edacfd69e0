//! What the previous anchor alone shows, where its depth is known.
//!
//! In a world at rest, motion and depth of the current anchor tell how the camera goes (see `perspective`), and with that a
//! depth in the previous anchor tells where what is there has gone to. What the current anchor hides, and what has left it,
//! needs no guess then: not how it moves, nor that it stood in front of what the current anchor shows.

use super::camera_fit::{Back, Perspective, Seen, nearness, rank_of};
use super::kernels::candidates::{Beside, all, floor, packed};
use super::kernels::{BLOCK, Level, TILE, at_every_level};
use super::key_buffer::{self, EMPTY, Grid, Key, Kind, LONGEST, Layer, ORPHAN, Tile, alike, is_nearer};
use crate::guidance::DepthMap;
use crate::tasks::{Parallel, ParallelSliceMut};

/// What is nearer than what a place shows by more than this part of `1 / w` is something else.
const OTHER: f32 = 1.125;
/// What is as far away differs by no more than this part.
const AS_FAR: f32 = 1.0 / 32.0;
/// Tiles ahead of the one that is uncovered whose keys are asked for.
const AHEAD: usize = 2;

/// How near what has a depth is; what is farthest, and what is no depth between the planes, is not near at all.
#[inline(always)]
fn nearness_of(depth: f32) -> f32 {
    if depth > 0.0 && depth < 1.0 { 1.0 - depth } else { 0.0 }
}

/// What a pixel claims that shows something so near, or [`EMPTY`]; no component of its vector is beyond `limit`.
#[inline(always)]
fn claim_of(back: &Back, limit: [f32; 2], [x, y]: [usize; 2], near: f32) -> Key {
    let at = [x as i32 as f32, y as i32 as f32];
    let (was, there, can_be) = back.follow(at, near);
    // What is longer has left the picture all the same.
    let along = |c: usize| {
        let along = 64.0 * (at[c] - was[c]);
        let along = if along < limit[c] { along } else { limit[c] };
        let along = if along > -limit[c] { along } else { -limit[c] };
        floor(along + 0.5)
    };
    let key = key_buffer::key(rank_of(there), ORPHAN, [along(0), along(1)]);
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
    /// Keeps the claims of a tile that are asked for (bit `8 j + i`), with [`EMPTY`] in place of others. For each where it
    /// leads to in the current anchor, tile by tile; the bits of the result say which there are, and which lead into the
    /// picture.
    fn lead(claims: &mut [Key; BLOCK], asked: u64, corner: [usize; 2], grid: Grid, places: &mut [u32; BLOCK]) -> [u64; 2]
        = scalar::lead | lead_in_rows
}

#[inline(always)]
fn lead_in_rows(
    claims: &mut [Key; BLOCK],
    asked: u64,
    corner: [usize; 2],
    grid: Grid,
    places: &mut [u32; BLOCK],
) -> [u64; 2] {
    let [width, height, columns] = [grid.width, grid.height, grid.columns].map(|len| len as u32);
    let (mut some, mut inside) = ([0; TILE], [0; TILE]);
    for j in (0..TILE).rev() {
        let asked = (asked >> (j * TILE) & 0xff) as u32;
        for (i, (some, inside)) in some.iter_mut().zip(&mut inside).enumerate() {
            let place = j * TILE + i;
            let key = claims[place];
            let is_some = (key != EMPTY) & (asked & 1 << i != 0);
            let [x, y] = key_buffer::vector(key);
            // As unsigned numbers, what is negative is far beyond.
            let u = ((64 * (corner[0] + i) as i32 - x + 32) >> 6) as u32;
            let v = ((64 * (corner[1] + j) as i32 - y + 32) >> 6) as u32;
            let is_inside = is_some & (u < width) & (v < height);
            let tile = (v >> 3).wrapping_mul(columns).wrapping_add(u >> 3);
            places[place] = tile << 6 | (v & 7) << 3 | (u & 7);
            claims[place] = if is_some { key } else { EMPTY };
            *some = *some << TILE | u64::from(is_some);
            *inside = *inside << TILE | u64::from(is_inside);
        }
    }
    [some, inside].map(all)
}

at_every_level! {
    /// How near what the pixels of a tile show is, and the nearest of it; nothing is near beyond the far edges. `depths`
    /// begin with its first, rows being `width` apart.
    fn nears_of(depths: &[f32], width: usize, extent: [usize; 2], nears: &mut [f32; BLOCK]) -> f32
        = scalar::nears | nears_in_rows
}

#[inline(always)]
fn nears_in_rows(depths: &[f32], width: usize, [across, down]: [usize; 2], nears: &mut [f32; BLOCK]) -> f32 {
    if [across, down] != [TILE; 2] {
        return scalar::nears(depths, width, [across, down], nears);
    }
    let mut nearest = [0.0; TILE];
    for j in 0..TILE {
        let depths: &[f32; TILE] = depths[j * width..].first_chunk().expect("a row of eight");
        for i in 0..TILE {
            let near = nearness_of(depths[i]);
            nears[j * TILE + i] = near;
            nearest[i] = if near > nearest[i] { near } else { nearest[i] };
        }
    }
    nearest.into_iter().fold(0.0, |a, b| if b > a { b } else { a })
}

at_every_level! {
    /// Which of these are nearer than `bound`: bit `8 j + i`.
    fn nearer(nears: &[f32; BLOCK], bound: f32) -> u64 = nearer_in_rows | nearer_in_rows
}

#[inline(always)]
fn nearer_in_rows(nears: &[f32; BLOCK], bound: f32) -> u64 {
    let mut nearer = 0;
    for (j, nears) in nears.as_chunks::<TILE>().0.iter().enumerate() {
        nearer |= packed(nears.map(|near| u8::from(near > bound))) << (j * TILE);
    }
    nearer
}

/// Whether what is as near as `near`, and is taken to be at rest, rather goes with what was found beside it.
#[inline(always)]
fn is_carried(claim: Key, near: f32, found: Key) -> bool {
    (found != EMPTY) & !alike(found, claim) & ((nearness(found) - near).abs() <= AS_FAR * near)
}

at_every_level! {
    /// Which of the pixels of a tile that are asked for (bit `8 j + i`) [`is_carried`] by any of what stands beside them.
    fn carried(claims: &[Key; BLOCK], nears: &[f32; BLOCK], asked: u64, beside: &Beside) -> u64
        = carried_in_rows | carried_in_rows
}

#[inline(always)]
fn carried_in_rows(claims: &[Key; BLOCK], nears: &[f32; BLOCK], asked: u64, beside: &Beside) -> u64 {
    let mut carried = 0;
    for j in 0..TILE {
        if asked >> (j * TILE) & 0xff == 0 {
            continue;
        }
        let mut is = [0; TILE];
        for keys in &beside.keys {
            for (i, is) in is.iter_mut().enumerate() {
                let place = j * TILE + i;
                *is |= u8::from(is_carried(claims[place], nears[place], keys[place]));
            }
        }
        carried |= packed(is) << (j * TILE);
    }
    carried & asked
}

/// The same, place by place.
mod scalar {
    use super::{BLOCK, EMPTY, Grid, Key, TILE, key_buffer, nearness_of};

    pub(super) fn lead(
        claims: &mut [Key; BLOCK],
        asked: u64,
        corner: [usize; 2],
        grid: Grid,
        places: &mut [u32; BLOCK],
    ) -> [u64; 2] {
        let (mut some, mut inside) = (0, 0);
        for (place, claim) in claims.iter_mut().enumerate() {
            if *claim == EMPTY || asked >> place & 1 == 0 {
                *claim = EMPTY;
                continue;
            }
            some |= 1 << place;
            let ([x, y], at) = (key_buffer::vector(*claim), [corner[0] + place % TILE, corner[1] + place / TILE]);
            if let Some([u, v]) = grid.nearest([64 * at[0] as i32 - x, 64 * at[1] as i32 - y]) {
                let (tile, at) = grid.place(u, v);
                places[place] = (tile * BLOCK + at) as u32;
                inside |= 1 << place;
            }
        }
        [some, inside]
    }

    pub(super) fn nears(depths: &[f32], width: usize, [across, down]: [usize; 2], nears: &mut [f32; BLOCK]) -> f32 {
        nears.fill(0.0);
        for (row, nears) in depths.chunks(width).zip(nears.chunks_mut(TILE)).take(down) {
            nears.iter_mut().zip(&row[..across]).for_each(|(near, &depth)| *near = nearness_of(depth));
        }
        nears.iter().copied().fold(0.0, f32::max)
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
    for j in (0..TILE).rev() {
        for (i, others) in others.iter_mut().enumerate() {
            let place = j * TILE + i;
            let is_other = (keys[place] != EMPTY) & (nears[place] > other(perspective, keys[place], [x + i, y + j]));
            *others = *others << TILE | u64::from(is_other);
        }
    }
    all(others)
}

/// How near something in the previous anchor is at least that is not what claims a pixel there.
#[inline(always)]
fn other(perspective: &Perspective, key: Key, at: [usize; 2]) -> f32 {
    OTHER * nearness(key) / (1.0 + perspective.change(key, at.map(|at| at as i32)))
}

/// Whether the current anchor shows a claim, or what is behind it, where it shows what claims to be there as `shown`.
#[inline(always)]
fn is_shown(shown: Key, claim: Key) -> bool {
    alike(shown, claim) | is_nearer(claim, shown)
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

    /// How near what it shows in a tile is, and the nearest of it; nothing is near beyond the far edges.
    #[inline(always)]
    pub(super) fn nears(&self, level: Level, [x, y]: [usize; 2], extent: [usize; 2], nears: &mut [f32; BLOCK]) -> f32 {
        if self.depth.tile() > 1 {
            let near = self.near([x, y]);
            nears.fill(if extent == [TILE; 2] { near } else { 0.0 });
            if extent != [TILE; 2] {
                nears.chunks_mut(TILE).take(extent[1]).for_each(|row| row[..extent[0]].fill(near));
            }
            return near;
        }
        let width = self.depth.width() as usize;
        nears_of(level, &self.depth.depth()[y * width + x..], width, extent, nears)
    }

    /// What a pixel of the previous anchor claims if it is at rest, or [`EMPTY`]. What is farthest claims nothing.
    #[cfg(test)]
    pub(super) fn claim(&self, at: [usize; 2]) -> Key {
        claim_of(&self.back, self.limit, at, self.near(at))
    }

    /// What those pixels of a tile claim that are asked for (bit `8 j + i`), given how near what they show is, where it can
    /// be; [`EMPTY`] elsewhere. The bits of the result say where it can.
    #[inline(always)]
    pub(super) fn claims(
        &self,
        level: Level,
        field: &Layer,
        corner: [usize; 2],
        nears: &[f32; BLOCK],
        asked: u64,
        claims: &mut [Key; BLOCK],
    ) -> u64 {
        claims_of(level, &self.back, self.limit, corner, nears, claims);
        let mut places = [0; BLOCK];
        let [mut can_be, mut inside] = lead(level, claims, asked, corner, field.grid, &mut places);
        while inside != 0 {
            let place = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            let (tile, at) = (places[place] as usize / BLOCK, places[place] as usize % BLOCK);
            let shown = match field.tiles[tile].kind {
                Kind::Smooth => field.tiles[tile].key,
                Kind::Rough => field.keys[tile][at],
            };
            if is_shown(shown, claims[place]) {
                claims[place] = EMPTY;
                can_be &= !(1 << place);
            }
        }
        can_be
    }

    /// Which of the pixels of a tile that are asked for (bit `8 j + i`) may go with some of what is beside them, although what
    /// they claim can be.
    #[inline(always)]
    pub(super) fn carried(
        &self,
        level: Level,
        claims: &[Key; BLOCK],
        nears: &[f32; BLOCK],
        asked: u64,
        beside: &Beside,
    ) -> u64 {
        carried(level, claims, nears, asked, beside)
    }

    /// Whether a claim from the previous anchor cannot be: the current one shows it, or what is behind it.
    #[cfg(test)]
    fn is_contradicted(&self, field: &Layer, [x, y]: [usize; 2], claim: Key) -> bool {
        let [vx, vy] = key_buffer::vector(claim);
        field
            .grid
            .nearest([64 * x as i32 - vx, 64 * y as i32 - vy])
            .is_some_and(|[u, v]| is_shown(field.owner(u, v), claim))
    }

    /// What claims a pixel of the previous anchor that nothing in the current one does: what is at rest there (`claim`),
    /// if that can be, or `found` beside it. What is as far away as that and moves otherwise is carried along.
    #[cfg(test)]
    pub(super) fn claim_or(&self, field: &Layer, at: [usize; 2], claim: Key, found: Key) -> Key {
        if claim == EMPTY || self.is_contradicted(field, at, claim) {
            return found;
        }
        if self.is_carried(at, claim, found) { found } else { claim }
    }

    /// Whether what a pixel claims, which can be, rather goes with what was found beside it.
    #[inline(always)]
    pub(super) fn is_carried(&self, at: [usize; 2], claim: Key, found: Key) -> bool {
        is_carried(claim, self.near(at), found)
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
    #[cfg(test)]
    pub(super) fn is_covered(&self, field: &Layer, at: [usize; 2], other: f32) -> bool {
        let claim = if self.near(at) > other { self.claim(at) } else { EMPTY };
        claim != EMPTY && !self.is_contradicted(field, at, claim)
    }

    /// Takes pixels of the previous anchor away from owners that something covers there.
    pub(super) fn uncover(&self, level: Level, owners: &mut Layer, field: &Layer) {
        let grid = owners.grid;
        let tiles = owners.tiles.par_chunks_mut(grid.columns).zip(owners.keys.par_chunks_mut(grid.columns));
        tiles.enumerate().for_each(|(row, (tiles, keys))| {
            for column in 0..tiles.len() {
                if tiles.get(column + AHEAD).is_some_and(|next| next.kind == Kind::Rough && next.key != EMPTY) {
                    Layer::fetch_keys(&keys[column + AHEAD]);
                }
                self.uncover_tile(level, [column, row], field, &mut tiles[column], &mut keys[column]);
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
        let mut nears = [0.0; BLOCK];
        if self.nears(level, corner, extent, &mut nears) <= of_tile {
            return;
        }
        let others = if is_smooth {
            // What is beyond the far edges is not near.
            nearer(level, &nears, of_tile)
        } else {
            others_of(level, &self.perspective, corner, keys, &nears)
        };
        if others == 0 {
            return;
        }
        let mut claims = [EMPTY; BLOCK];
        let mut covered = self.claims(level, field, corner, &nears, others, &mut claims);
        while covered != 0 {
            tile.free(keys, extent, covered.trailing_zeros() as usize);
            covered &= covered - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera_fit::tests::{SIZE, guidance, key_of, seen, shown, walk};
    use super::super::key_buffer::rank;
    use super::super::static_mask::Standing;
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
            let apart = [0, 1].map(|c| (f64::from(key_buffer::vector(claim)[c]) / 64.0 - vector[c]).abs());
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
