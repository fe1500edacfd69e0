//! What is where between the anchors, as a camera sees it that goes straight on.
//!
//! A point that moves evenly in space does not move evenly on the screen: what comes nearer gets faster. With distances
//! `w0` and `w1` from the camera's plane in the two anchors it is at phase t where even motion has it at
//! `t w1 / ((1 - t) w0 + t w1)`. In a world at rest `w0 / w1 - 1` is `tau / w1 + alpha x + beta y` for a camera that goes
//! forward by `tau` and turns by `alpha` and `beta`; `1 / w1` is but for a factor and a small constant what device depth
//! has left to 1. Motion and depth of the current anchor tell all of it: where (x, y) comes from (u, v),
//!
//! `u (1 + alpha x + beta y + tau q) = x + a x + b y + c + d q`, and so does `v` with four numbers of its own.
//!
//! These eleven numbers are found by least squares from a few hundred pixels; where not nearly all of them agree, from
//! those that agree with the best of several guesses (M. A. Fischler and R. C. Bolles, Random sample consensus, 1981). What
//! moves by itself and what a camera carries along is left over then. Where no motion explains half of the pixels,
//! everything is taken to move evenly.

use super::kernels::TILE;
use super::key_buffer::{Key, WHOLE};
use super::static_mask::Standing;
use crate::guidance::Guidance;

/// Pixels that are asked, across and down.
const ASKED: [usize; 2] = [20, 12];
/// Pixels within which a place agrees with what is expected of it.
const AGREED: f64 = 0.5;
/// Guesses, and the pixels that each is made from: one more equation than there are numbers.
const GUESSES: usize = 24;
const GUESSED_FROM: usize = 6;
/// How often those that agree are asked once more.
const ROUNDS: usize = 2;
/// Numbers that are searched for.
const NUMBERS: usize = 11;
/// Where pixels cannot tell, the numbers are near zero: the square of the noise of vectors over that of the numbers.
const PRIOR: f64 = 1e-6;
/// Distances change by no more than this between two anchors: from half as far before to nearly twice.
const CHANGES: [f64; 2] = [-0.5, 0.9];
/// Phases are within three intervals of the earlier anchor, so that a reach of a vector can be computed in 32 bits.
const LATEST: f32 = (3 * WHOLE - 2) as f32;

/// How much farther off everything was in the previous anchor: `w0 / w1 - 1` of what is seen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Perspective {
    /// For what is at the near plane, and in proportion to `1 / w1`.
    pub(super) nearness: f32,
    /// For each pixel to the right, and down.
    pub(super) slope: [f32; 2],
    /// At the first pixel.
    pub(super) corner: f32,
    /// It is no less than this, which is at most 0,
    pub(super) least: f32,
    /// and no more than this, which is at least 0.
    pub(super) most: f32,
}

/// From pixels of the previous anchor back to where they are in the current one, for a world at rest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Back {
    /// What a place and one, and how near it is, count with for a place and one, but for a factor.
    rows: [[f32; 4]; 3],
    middle: [f32; 2],
    width: f32,
}

/// What motion and depth tell of how the camera goes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    pub(super) perspective: Perspective,
    /// Where there are depths.
    pub(super) back: Option<Back>,
}

/// A time, as seen by the claims of the current anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    phase: f32,
    /// The part of the interval that is left.
    left: f32,
    perspective: Perspective,
}

/// From an anchor to a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Way {
    from: i32,
    to: Moment,
}

/// What ranks are made from, see `kernels::ranges`.
const LEAST: u32 = 103 << 23;

/// The rank of what is so near.
#[inline(always)]
pub(super) fn rank_of(nearness: f32) -> u16 {
    u16::MAX - (nearness.min(1.0).to_bits().saturating_sub(LEAST) >> 12) as u16
}

/// How near what claims a place is: 1 at the near plane, 0 at the far one.
#[inline(always)]
pub(super) fn nearness(key: Key) -> f32 {
    f32::from_bits(LEAST + ((u32::from(u16::MAX) - (key >> 48) as u32) << 12))
}

impl Moment {
    /// `phase` of [`WHOLE`] after the previous anchor, at most two intervals.
    pub(super) fn new(phase: i32, perspective: Perspective) -> Self {
        Self { phase: phase as f32, left: (WHOLE - phase) as f32 / WHOLE as f32, perspective }
    }

    /// The previous anchor.
    pub(super) fn previous() -> Self {
        Self::new(0, Perspective::default())
    }

    /// The phase at which even motion has what claims the pixel (x, y).
    #[inline(always)]
    pub(super) fn phase(&self, key: Key, at: [i32; 2]) -> i32 {
        // At the previous anchor, and where all moves evenly, it is that of the clock.
        if self.phase == 0.0 || self.perspective.least >= self.perspective.most {
            return self.phase as i32;
        }
        self.at(self.perspective.change(key, at))
    }

    /// The same for eight pixels beside each other, the first at (x, y).
    #[inline(always)]
    pub(super) fn phases(&self, keys: &[Key; TILE], [x, y]: [i32; 2]) -> [i32; TILE] {
        let mut phases = [0; TILE];
        for i in 0..TILE {
            phases[i] = self.phase(keys[i], [x + i as i32, y]);
        }
        phases
    }

    /// The phase of all of a smooth tile.
    #[inline(always)]
    pub(super) fn phase_of_tile(&self, key: Key, corner: [usize; 2]) -> i32 {
        self.phase(key, corner.map(|at| (at + TILE / 2) as i32))
    }

    #[inline(always)]
    fn at(&self, change: f32) -> i32 {
        // Where singles are whole numbers, adding rounds; the number is in the lower bits.
        const ROUNDING: f32 = 12_582_912.0;
        let phase = self.phase / (1.0 + self.left * change);
        let phase = if phase < LATEST { phase } else { LATEST };
        (phase + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
    }
}

impl Way {
    pub(super) fn from_current(to: Moment) -> Self {
        Self { from: WHOLE, to }
    }

    pub(super) fn from_previous(to: Moment) -> Self {
        Self { from: 0, to }
    }

    /// The part of its vector that what claims the pixel (x, y) goes.
    #[inline(always)]
    pub(super) fn reach(&self, key: Key, at: [i32; 2]) -> i32 {
        self.from - self.to.phase(key, at)
    }

    /// See [`Moment::phases`].
    #[inline(always)]
    pub(super) fn reaches(&self, keys: &[Key; TILE], at: [i32; 2]) -> [i32; TILE] {
        let mut reaches = self.to.phases(keys, at);
        for reach in &mut reaches {
            *reach = self.from - *reach;
        }
        reaches
    }

    /// See [`Moment::phase_of_tile`].
    #[inline(always)]
    pub(super) fn reach_of_tile(&self, key: Key, corner: [usize; 2]) -> i32 {
        self.from - self.to.phase_of_tile(key, corner)
    }

    /// No claim goes less or more than this.
    pub(super) fn bounds(&self) -> [i32; 2] {
        let ends = [self.to.perspective.least, self.to.perspective.most].map(|change| self.from - self.to.at(change));
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    }
}

/// A pixel of the current anchor at (x, y), where it was in the previous one, and how near it is. Lengths are in widths
/// of the picture from its middle.
#[derive(Debug, Clone, Copy, Default)]
struct Sample {
    at: [f64; 2],
    was: [f64; 2],
    near: f64,
}

type Numbers = [f64; NUMBERS];

impl Sample {
    /// What the eleven numbers count with in the equation of one component, and what is left without them.
    fn equation(&self, component: usize) -> (Numbers, f64) {
        let ([x, y], was) = (self.at, self.was[component]);
        let mut counts = [0.0; NUMBERS];
        counts[4 * component..][..4].copy_from_slice(&[x, y, 1.0, self.near]);
        counts[8..].copy_from_slice(&[-was * x, -was * y, -was * self.near]);
        (counts, was - self.at[component])
    }

    /// `w0 / w1 - 1`.
    fn change(&self, n: &Numbers) -> f64 {
        n[8] * self.at[0] + n[9] * self.at[1] + n[10] * self.near
    }

    /// The square of how far it was from where it is expected.
    fn error(&self, n: &Numbers) -> f64 {
        let [x, y] = self.at;
        let whole = 1.0 + self.change(n);
        let expected =
            |c: usize| (self.at[c] + n[4 * c] * x + n[4 * c + 1] * y + n[4 * c + 2] + n[4 * c + 3] * self.near) / whole;
        let [x, y] = [expected(0) - self.was[0], expected(1) - self.was[1]];
        x * x + y * y
    }
}

impl Back {
    fn new(n: &Numbers, nearest: f64, size: [usize; 2]) -> Option<Self> {
        // With A for what places count with and k for nearness, A (x, y, 1) + k q = s (u, v, 1), where q = s r and r is the
        // nearness in the previous anchor: (x, y, 1) = s A^-1 ((u, v, 1) - k r).
        let a = [[1.0 + n[0], n[1], n[2]], [n[4], 1.0 + n[5], n[6]], [n[8], n[9], 1.0]];
        let minor = |i: usize, j: usize| {
            let [i, j] = [[(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]];
            a[i[0]][j[0]] * a[i[1]][j[1]] - a[i[0]][j[1]] * a[i[1]][j[0]]
        };
        let whole = a[0][0] * minor(0, 0) + a[0][1] * minor(0, 1) + a[0][2] * minor(0, 2);
        let k = [n[3], n[7], n[10]].map(|v| v / nearest);
        let rows = [0, 1, 2].map(|i| {
            let row = [0, 1, 2].map(|j| minor(j, i) / whole);
            let of_nearness = -(row[0] * k[0] + row[1] * k[1] + row[2] * k[2]);
            [row[0], row[1], row[2], of_nearness].map(|v| v as f32)
        });
        let is_finite = rows.iter().flatten().all(|v| v.is_finite());
        is_finite.then_some(Self { rows, middle: size.map(|len| middle(len) as f32), width: size[0] as f32 })
    }

    /// Where in the current anchor what the previous one shows at a place is, in pixels, and how near it is there; and
    /// whether that can be followed.
    #[inline(always)]
    pub(super) fn follow(&self, [u, v]: [f32; 2], near: f32) -> ([f32; 2], f32, bool) {
        let [u, v] = [(u - self.middle[0]) / self.width, (v - self.middle[1]) / self.width];
        let along = |row: [f32; 4]| (row[0] * u + row[1] * v) + (row[2] + row[3] * near);
        let [x, y, z] = [along(self.rows[0]), along(self.rows[1]), along(self.rows[2])];
        let at = [x / z * self.width + self.middle[0], y / z * self.width + self.middle[1]];
        // What comes from behind the camera, or much nearer, is nothing to be followed.
        (at, near / z, z > 0.25)
    }
}

impl Perspective {
    /// `w0 / w1 - 1` of what claims the pixel (x, y).
    #[inline(always)]
    pub(super) fn change(&self, key: Key, [x, y]: [i32; 2]) -> f32 {
        let Self { nearness: of_nearness, slope, corner, least, most } = *self;
        let change = of_nearness * nearness(key) + (slope[0] * x as f32 + (slope[1] * y as f32 + corner));
        let change = if change < most { change } else { most };
        if change > least { change } else { least }
    }
}

impl Seen {
    /// What a guidance tells, but of what stands still in front.
    pub(super) fn find(guidance: &Guidance, standing: &Standing<'_>) -> Self {
        let (width, height) = (guidance.motion().width() as usize, guidance.motion().height() as usize);
        if width < ASKED[0] || height < ASKED[1] {
            return Self::default();
        }
        let mut room = [Sample::default(); ASKED[0] * ASKED[1]];
        let (mut count, mut nearest, mut farthest) = (0, 0.0_f64, 1.0_f64);
        let size = [width, height];
        for number in 0..room.len() {
            let place = [number % ASKED[0], number / ASKED[0]];
            let at = [0, 1].map(|c| (2 * place[c] + 1) * size[c] / (2 * ASKED[c]));
            if standing.is_at(at) {
                continue;
            }
            if let Some(sample) = sample(guidance, at) {
                (nearest, farthest) = (nearest.max(sample.near), farthest.min(sample.near));
                (room[count], count) = (sample, count + 1);
            }
        }
        let samples = &mut room[..count];
        if samples.len() * 2 < ASKED[0] * ASKED[1] {
            return Self::default();
        }
        // Without depths forward motion cannot be told from a picture that grows.
        let has_depth = farthest < 0.75 * nearest;
        samples.iter_mut().for_each(|sample| sample.near = if has_depth { sample.near / nearest } else { 0.0 });
        let Some(numbers) = agreed(samples, AGREED / width as f64) else { return Self::default() };

        let bound = (AGREED / width as f64).powi(2);
        let changes = samples.iter().filter(|s| s.error(&numbers) <= bound).map(|s| s.change(&numbers));
        let [least, most] = changes.fold([0.0_f64; 2], |[least, most], v| [least.min(v), most.max(v)]);
        let [least, most] = [1.25 * least - 0.02, 1.25 * most + 0.02].map(|v| v.clamp(CHANGES[0], CHANGES[1]) as f32);
        let slope = [numbers[8], numbers[9]].map(|v| v / width as f64);
        let perspective = Perspective {
            nearness: if has_depth { (numbers[10] / nearest) as f32 } else { 0.0 },
            slope: slope.map(|v| v as f32),
            corner: (-slope[0] * middle(width) - slope[1] * middle(height)) as f32,
            least,
            most,
        };
        let back = if has_depth { Back::new(&numbers, nearest, size) } else { None };
        Self { perspective, back }
    }
}

fn middle(len: usize) -> f64 {
    (len - 1) as f64 / 2.0
}

/// What a guidance says about a pixel, or about the tile that it is in.
fn sample(guidance: &Guidance, [x, y]: [usize; 2]) -> Option<Sample> {
    let (motion, map) = (guidance.motion(), guidance.depth());
    let vector = motion.at(x as u32, y as u32).map(|v| f64::from(v.to_f32()));
    let tile = map.tile() as usize;
    let depth = map.depth()[y / tile * map.columns() as usize + x / tile];
    if !(vector[0].is_finite() && vector[1].is_finite() && (0.0..=1.0).contains(&depth)) {
        return None;
    }
    let side = motion.tile() as usize;
    let [width, height] = [motion.width(), motion.height()].map(|len| len as usize);
    let center = |at: usize, len: usize| (at / side * side) as f64 + (side - 1) as f64 / 2.0 - middle(len);
    let at = [center(x, width), center(y, height)];
    let was = [at[0] + vector[0], at[1] + vector[1]];
    let in_widths = |v: [f64; 2]| v.map(|v| v / width as f64);
    Some(Sample { at: in_widths(at), was: in_widths(was), near: f64::from(1.0 - depth) })
}

/// The numbers that agree with most samples, if these are at least half of them.
fn agreed(samples: &[Sample], within: f64) -> Option<Numbers> {
    let bound = within * within;
    let agree = |numbers: &Numbers| samples.iter().filter(|sample| sample.error(numbers) <= bound).count();
    let mut best = solved(samples.iter())?;
    let mut most = agree(&best);
    let mut random = 1_u64;
    for _ in 0..GUESSES {
        if 10 * most >= 9 * samples.len() {
            break;
        }
        // Numbers that look random (Knuth's MMIX generator), the same at every call.
        let some: [Sample; GUESSED_FROM] = std::array::from_fn(|_| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            samples[(random >> 33) as usize % samples.len()]
        });
        let Some(guess) = solved(some.iter()) else { continue };
        let count = agree(&guess);
        if count > most {
            (best, most) = (guess, count);
        }
    }
    for _ in 0..ROUNDS {
        best = solved(samples.iter().filter(|sample| sample.error(&best) <= bound))?;
    }
    (2 * agree(&best) >= samples.len()).then_some(best)
}

/// The numbers that fit some samples best: normal equations, by Cholesky's method.
fn solved<'a>(samples: impl Iterator<Item = &'a Sample>) -> Option<Numbers> {
    let mut matrix = [[0.0; NUMBERS]; NUMBERS];
    let mut right = [0.0; NUMBERS];
    for sample in samples {
        for component in 0..2 {
            let (counts, left) = sample.equation(component);
            let these = || (4 * component..4 * component + 4).chain(8..NUMBERS);
            for i in these() {
                these().take_while(|&j| j <= i).for_each(|j| matrix[i][j] += counts[i] * counts[j]);
                right[i] += counts[i] * left;
            }
        }
    }
    for i in 0..NUMBERS {
        matrix[i][i] += PRIOR;
        for j in 0..=i {
            let sum = (0..j).fold(matrix[i][j], |sum, k| sum - matrix[i][k] * matrix[j][k]);
            matrix[i][j] = if i == j { sum.sqrt() } else { sum / matrix[j][j] };
        }
        let sum = (0..i).fold(right[i], |sum, k| sum - matrix[i][k] * right[k]);
        right[i] = sum / matrix[i][i];
    }
    for i in (0..NUMBERS).rev() {
        let sum = (i + 1..NUMBERS).fold(right[i], |sum, k| sum - matrix[k][i] * right[k]);
        right[i] = sum / matrix[i][i];
    }
    right.iter().all(|v| v.is_finite()).then_some(right)
}

#[cfg(test)]
pub(super) mod tests {
    use half::f16;

    use super::super::key_buffer;
    use super::*;
    use crate::guidance::{DepthMap, MotionField, MotionOrigin, paper};

    pub(in super::super) const SIZE: [u32; 2] = [320, 180];
    /// Of the camera, in pixels.
    const FOCAL: f64 = 200.0;
    const NEAR: f64 = 0.1;

    /// Where a point of the current camera's space is at phase t, for a camera that has gone ahead and turned: in pixels.
    pub(in super::super) fn seen([x, y, z]: [f64; 3], t: f64) -> [f64; 2] {
        // Straight on in space, so that the same holds as for a turn of few degrees.
        let (turn, ahead, aside) = (0.05, 0.12, 0.04);
        let was = [x + turn * z + aside, y, z - turn * x + ahead];
        let at = |c: usize| was[c] + ([x, y, z][c] - was[c]) * t;
        [middle(SIZE[0] as usize) + FOCAL * at(0) / at(2), middle(SIZE[1] as usize) + FOCAL * at(1) / at(2)]
    }

    /// What a pixel of the current anchor shows: ground, and two posts on it.
    pub(in super::super) fn shown(x: f64, y: f64) -> [f64; 3] {
        let ray = [(x - middle(SIZE[0] as usize)) / FOCAL, (y - middle(SIZE[1] as usize)) / FOCAL];
        let ground = if ray[1] > 0.02 { 1.6 / ray[1] } else { 80.0 };
        let z = match x as u32 {
            40..70 => ground.min(4.0),
            200..220 => ground.min(2.5),
            _ => ground,
        };
        [ray[0] * z, ray[1] * z, z]
    }

    pub(in super::super) fn guidance(motion: impl Fn(f64, f64) -> ([f64; 2], f64), tile: u32) -> Guidance {
        let mut vectors = MotionField::tiled(SIZE[0], SIZE[1], tile).unwrap();
        let mut depths = DepthMap::tiled(SIZE[0], SIZE[1], tile, paper::PROJECTION).unwrap();
        let columns = vectors.columns();
        for i in 0..vectors.vectors().len() {
            let [x, y] =
                [i as u32 % columns, i as u32 / columns].map(|v| f64::from(v * tile) + f64::from(tile - 1) / 2.0);
            let (vector, depth) = motion(x, y);
            vectors.vectors_mut()[i] = vector.map(f16::from_f64);
            depths.depth_mut()[i] = depth as f32;
        }
        Guidance::from_parts(vectors, depths, MotionOrigin::Geometry).unwrap()
    }

    /// Motion and depth of the world at rest.
    pub(in super::super) fn walk(x: f64, y: f64) -> ([f64; 2], f64) {
        let point = shown(x, y);
        let was = seen(point, 0.0);
        ([was[0] - x, was[1] - y], 1.0 - NEAR / point[2])
    }

    pub(in super::super) fn key_of((vector, depth): ([f64; 2], f64)) -> Key {
        let rank = u16::MAX - ((((1.0 - depth) as f32).to_bits() - (103 << 23)) >> 12) as u16;
        key_buffer::key(rank, 0, vector.map(|v| (64.0 * v).round() as i32))
    }

    /// By how many pixels claims of the world at rest are beside the truth at most, for t from 0 to 2.
    fn worst(perspective: Perspective) -> f64 {
        let mut worst = 0.0_f64;
        for (x, y) in (0..180).step_by(9).flat_map(|y| (0..320).step_by(7).map(move |x| (x, y))) {
            let at = [f64::from(x), f64::from(y)];
            let (vector, depth) = walk(at[0], at[1]);
            for phase in [WHOLE / 4, WHOLE / 2, 3 * WHOLE / 4, 3 * WHOLE / 2] {
                let way = Way::from_current(Moment::new(phase, perspective));
                let reach = f64::from(way.reach(key_of((vector, depth)), [x, y])) / f64::from(WHOLE);
                let truth = seen(shown(at[0], at[1]), f64::from(phase) / f64::from(WHOLE));
                (0..2).for_each(|c| worst = worst.max((at[c] + reach * vector[c] - truth[c]).abs()));
            }
        }
        worst
    }

    #[test]
    fn a_walk_with_a_turn_is_followed() {
        let even = worst(Perspective::default());
        assert!(even > 0.5, "{even}");
        for tile in [1, 8] {
            let found = worst(Seen::find(&guidance(walk, tile), &Standing::default()).perspective);
            assert!(found < 0.05 * even, "{found} of {even}, tiles of {tile}");
        }
    }

    #[test]
    fn what_moves_by_itself_and_what_is_carried_along_count_for_nothing() {
        let motion = |x: f64, y: f64| match (x as u32, y as u32) {
            (180.., 110..) => ([0.0; 2], 0.3),
            (90..150, 70..120) => ([9.0, -3.0], 0.98),
            _ => walk(x, y),
        };
        let (found, even) =
            (worst(Seen::find(&guidance(motion, 1), &Standing::default()).perspective), worst(Perspective::default()));
        assert!(found < 0.1 * even, "{found} of {even}");
    }

    #[test]
    fn motion_that_tells_nothing_is_even() {
        let any = |x: f64, y: f64| f64::from((x as u32 * 7919 + y as u32 * 104_729) % 257) / 16.0;
        let wild = guidance(|x, y| ([any(x, y), any(y, x)], 1.0 - 0.1 / (1.0 + any(x + 3.0, y))), 1);
        assert_eq!(Seen::find(&wild, &Standing::default()).perspective, Perspective::default());
        let nothing = guidance(|_, _| ([f64::NAN, f64::INFINITY], f64::NAN), 1);
        assert_eq!(Seen::find(&nothing, &Standing::default()).perspective, Perspective::default());
        // Without depth, what grows may lie in the picture.
        let growing = guidance(|x, y| ([0.05 * (160.0 - x), 0.05 * (90.0 - y)], 0.5), 1);
        let moment = Moment::new(WHOLE / 2, Seen::find(&growing, &Standing::default()).perspective);
        assert!(
            [[0, 0], [319, 0], [160, 179]]
                .iter()
                .all(|&at| (moment.phase(key_of(([0.0; 2], 0.5)), at) - WHOLE / 2).abs() <= 4)
        );
    }

    #[test]
    fn anchors_are_where_they_are_and_bounds_hold() {
        let perspective = Seen::find(&guidance(walk, 1), &Standing::default()).perspective;
        for phase in [0, 1, WHOLE / 3, WHOLE, 2 * WHOLE] {
            let way = Way::from_current(Moment::new(phase, perspective));
            let [least, most] = way.bounds();
            assert!(2 * WHOLE > most && least >= 2 - 2 * WHOLE, "{least}..={most}");
            for (rank, x, y) in
                [(0, 0, 0), (16_383, 319, 0), (30_000, 0, 179), (50_000, 100, 90), (u16::MAX, -9000, 9000)]
            {
                let reach = way.reach(key_buffer::key(rank, 0, [0; 2]), [x, y]);
                assert!((least..=most).contains(&reach));
                if phase % WHOLE == 0 && phase <= WHOLE {
                    assert_eq!(reach, WHOLE - phase);
                }
            }
        }
    }
}
