//! Samples, tiles and blocks of pixels.

use half::f16;

use super::super::scalar;
use super::*;

/// A pixel type of which tests make pictures.
trait Painted: Sampled {
    fn painted(random: &mut Random, kind: u64, place: usize) -> Self;
    fn beside(self, random: &mut Random) -> Self;
    /// A value that no kernel writes in these tests.
    const GUARD: Self;
}

impl Painted for [u8; 4] {
    fn painted(random: &mut Random, kind: u64, place: usize) -> Self {
        match kind {
            0 => random.bits().to_le_bytes()[..4].try_into().unwrap(),
            1 => [1, 2, 3, 5].map(|v| (place as u64 * v + random.below(3)) as u8),
            _ => std::array::from_fn(|_| 255 * random.below(2) as u8),
        }
    }

    fn beside(self, random: &mut Random) -> Self {
        self.map(|v| v.saturating_add(random.below(4) as u8))
    }

    const GUARD: Self = [0xa5; 4];
}

impl Painted for [f16; 4] {
    fn painted(random: &mut Random, kind: u64, place: usize) -> Self {
        match kind {
            0 => std::array::from_fn(|_| f16::from_bits(random.bits() as u16)),
            1 => [0.01, 0.2, 3.0, 1.0].map(|v| f16::from_f32(place as f32 * v + random.below(100) as f32 / 64.0)),
            _ => std::array::from_fn(|_| {
                [f16::ZERO, f16::MAX, f16::MIN, f16::INFINITY, f16::NAN, f16::from_bits(1)][random.below(6) as usize]
            }),
        }
    }

    fn beside(self, random: &mut Random) -> Self {
        self.map(|v| f16::from_f32(v.to_f32() * (1.0 + random.below(8) as f32 / 512.0)))
    }

    const GUARD: Self = [f16::from_bits(0x1234); 4];
}

/// Two pictures of one size, partly similar.
struct Pictures<P> {
    width: usize,
    height: usize,
    previous: Vec<P>,
    current: Vec<P>,
}

impl<P: Painted> Pictures<P> {
    fn new(random: &mut Random, width: usize, height: usize) -> Self {
        let kind = random.below(3);
        let previous: Vec<P> = (0..width * height).map(|i| P::painted(random, kind, i)).collect();
        let current = previous
            .iter()
            .enumerate()
            .map(|(i, &pixel)| match random.below(3) {
                0 => P::painted(random, kind, i),
                1 => pixel.beside(random),
                _ => pixel,
            })
            .collect();
        Self { width, height, previous, current }
    }

    fn sources(&self) -> [Source<'_, P>; 2] {
        [&self.previous, &self.current].map(|pixels| Source { pixels, width: self.width, height: self.height })
    }
}

const SIZES: [(usize, usize); 12] =
    [(1, 1), (7, 3), (3, 40), (8, 8), (11, 11), (16, 12), (19, 27), (27, 40), (45, 29), (64, 33), (131, 21), (200, 90)];

/// A position, usually inside the picture; sometimes a whole one, or far outside.
fn position(random: &mut Random, (width, height): (usize, usize)) -> [i32; 2] {
    let mut on_axis = |len: usize| match random.below(12) {
        0 => random.bits() as i32,
        1 => [i32::MIN, i32::MAX, -64, 0][random.below(4) as usize],
        2 | 3 => 64 * random.below(len as u64) as i32,
        _ => random.below(64 * (len as u64 + 12)) as i32 - 64 * 8,
    };
    [on_axis(width), on_axis(height)]
}

fn rule(random: &mut Random) -> MergeRule {
    MergeRule {
        weight: random.below(256) as u8,
        nearer_is_current: random.below(2) == 0,
        max_equal_difference: random.below(8) as u8,
        doubt_threshold: [0, 3, 20, 255][random.below(4) as usize],
    }
}

/// The bits as text, since values may be NaN.
fn bits<P: Painted>(pixels: &[P]) -> String {
    format!("{pixels:?}")
}

fn all_instruction_sets_make_the_same_tiles<P: Painted>() {
    let mut random = Random(1);
    for size in SIZES.into_iter().cycle().take(20 * SIZES.len()) {
        let pictures = Pictures::<P>::new(&mut random, size.0, size.1);
        let [previous, current] = pictures.sources();
        for _ in 0..20 {
            let (a, b, rule) = (position(&mut random, size), position(&mut random, size), rule(&mut random));
            let stride = TILE + random.below(4) as usize;
            let (previous, current) = (TileSource { picture: previous, at: a }, TileSource { picture: current, at: b });
            let make = |level: Option<SimdLevel>| {
                // The last row ends with the tile: not a pixel more may be read or written.
                let mut out = [P::GUARD; 3 * 8 * 12];
                let len = 7 * stride + TILE;
                let (merged, rest) = out.split_at_mut(len);
                let mask = match level {
                    Some(level) => P::merge_tile(level, previous, current, &rule, merged, stride),
                    None => scalar::merge_tile(previous, current, &rule, merged, stride),
                };
                match level {
                    Some(level) => P::sample_tile(level, current, &mut rest[..len], stride),
                    None => scalar::sample_tile(current, &mut rest[..len], stride),
                }
                (mask, bits(&out))
            };
            let expected = make(None);
            for level in SimdLevel::available() {
                assert!(make(Some(level)) == expected, "{} at {a:?} {b:?} in {size:?}, {rule:?}", level.name());
            }
        }
    }
}

fn all_instruction_sets_make_the_same_pixels<P: Painted>() {
    let mut random = Random(2);
    for size in SIZES.into_iter().cycle().take(8 * SIZES.len()) {
        let pictures = Pictures::<P>::new(&mut random, size.0, size.1);
        let [previous, current] = pictures.sources();
        // Every pixel anywhere, or in a few contiguous groups.
        let positions = |random: &mut Random| {
            let corners: [[i32; 2]; 4] = std::array::from_fn(|_| position(random, size));
            let (groups, strays) = (random.below(5) as usize, 1 + random.below(8));
            let all: [[i32; 2]; BLOCK] = std::array::from_fn(|place| {
                if groups == 0 || random.below(8 * strays) == 0 {
                    return position(random, size);
                }
                let [x, y] = corners[(place + place / TILE) * groups / (2 * TILE) % corners.len()];
                [x.wrapping_add(64 * (place % TILE) as i32), y.wrapping_add(64 * (place / TILE) as i32)]
            });
            Positions { x: all.map(|at| at[0]), y: all.map(|at| at[1]) }
        };
        let (a, b, rule) = (positions(&mut random), positions(&mut random), rule(&mut random));
        let wanted = [u64::MAX, random.bits(), random.bits() & random.bits() & random.bits(), 0];
        let wanted = wanted[random.below(4) as usize];
        let make = |level: Option<SimdLevel>| {
            let mut out = Block { previous: [P::GUARD; BLOCK], current: [P::GUARD; BLOCK], merged: [P::GUARD; BLOCK] };
            for (source, at, samples) in [(previous, &a, &mut out.previous), (current, &b, &mut out.current)] {
                match level {
                    Some(level) => P::sample_pixels(level, source, at, wanted, samples),
                    None => scalar::sample_pixels(source, at, wanted, samples),
                }
            }
            let mask = match level {
                Some(level) => P::merge_block(level, &rule, &mut out),
                None => scalar::merge_block(&rule, &mut out),
            };
            (mask, bits(&out.previous), bits(&out.current), bits(&out.merged))
        };
        let expected = make(None);
        for level in SimdLevel::available() {
            assert!(make(Some(level)) == expected, "{} in {size:?}, {rule:?}", level.name());
        }
    }
}

#[test]
fn all_instruction_sets_make_the_same_tiles_of_bytes() {
    all_instruction_sets_make_the_same_tiles::<[u8; 4]>();
}

#[test]
fn all_instruction_sets_make_the_same_pixels_of_bytes() {
    all_instruction_sets_make_the_same_pixels::<[u8; 4]>();
}

#[test]
fn all_instruction_sets_make_the_same_tiles_of_half_floats() {
    all_instruction_sets_make_the_same_tiles::<[f16; 4]>();
}

#[test]
fn all_instruction_sets_make_the_same_pixels_of_half_floats() {
    all_instruction_sets_make_the_same_pixels::<[f16; 4]>();
}

fn all_instruction_sets_find_the_same_lumas<P: Painted>() {
    let mut random = Random(5);
    for width in [1, 7, 8, 31, 64, 200] {
        for kind in 0..3 {
            let row: Vec<P> = (0..width).map(|i| P::painted(&mut random, kind, i)).collect();
            let find = |level| {
                // One more element than pixels, which must stay unchanged.
                let (mut lumas, mut sums) = (vec![9; width + 1], vec![[9; 4]; width + 1]);
                P::lumas(level, &row, &mut lumas);
                (0..3).for_each(|_| P::add_levels(level, &row, &mut sums));
                (lumas, sums)
            };
            let expected = find(SimdLevel::SCALAR);
            assert_eq!((expected.0[width], expected.1[width]), (9, [9; 4]));
            for level in SimdLevel::available() {
                assert_eq!(find(level), expected, "{} of {width}, kind {kind}", level.name());
            }
        }
    }
}

#[test]
fn all_instruction_sets_find_the_same_lumas_of_bytes() {
    all_instruction_sets_find_the_same_lumas::<[u8; 4]>();
}

#[test]
fn all_instruction_sets_find_the_same_lumas_of_half_floats() {
    all_instruction_sets_find_the_same_lumas::<[f16; 4]>();
}

#[test]
fn half_floats_of_bytes_have_their_levels() {
    for value in 0..=255_u8 {
        let half = f16::from_f32(f32::from(value) / 255.0);
        assert_eq!([half, half, half, f16::INFINITY].levels(), [value, value, value, 255]);
    }
    assert_eq!([f16::NAN, f16::NEG_INFINITY, f16::MAX, f16::from_f32(-0.5)].levels(), [0, 0, 255, 0]);
}
