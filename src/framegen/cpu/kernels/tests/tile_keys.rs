//! Claims of tiles.

use super::super::super::camera_fit::{Moment, Perspective, Way};
use super::super::super::key_buffer::{self, ALIKE, EMPTY, HOLE, Key, LONGEST, ORPHAN, WHOLE};
use super::super::tile_keys::{self, Around, Places};
use super::*;

/// A claim of one of few surfaces, or any.
fn claim(random: &mut Random) -> Key {
    let near = |random: &mut Random, v: i32| v + random.below(5) as i32 * 32 - 64;
    match random.below(10) {
        0 => EMPTY,
        1 => {
            let component = |random: &mut Random| random.below(2 * LONGEST as u64 + 1) as i32 - LONGEST;
            key_buffer::key(
                random.bits() as u16,
                [0, 24, ORPHAN, HOLE][random.below(4) as usize],
                [component(random), component(random)],
            )
        }
        2..5 => key_buffer::key(40_000 + random.below(65) as u16, 0, [near(random, 700), near(random, -90)]),
        5 => key_buffer::key(u16::MAX - random.below(40) as u16, ORPHAN, [near(random, -64), 0]),
        _ => key_buffer::key(20_000, 0, [64 * 3, near(random, 0)]),
    }
}

/// Some change of distances, or none.
fn perspective(random: &mut Random) -> Perspective {
    if random.below(3) == 0 {
        return Perspective::default();
    }
    let mut part = |most: f32| (random.below(2001) as f32 / 1000.0 - 1.0) * most;
    let slope = [part(0.01), part(0.01)];
    Perspective { nearness: part(2.0), slope, corner: part(0.5), least: -0.25 - part(0.25), most: 0.45 + part(0.45) }
}

/// A tile in which rows of one surface are common.
fn tile(random: &mut Random) -> [Key; BLOCK] {
    let mut keys = [EMPTY; BLOCK];
    for line in keys.chunks_mut(TILE) {
        let one = claim(random);
        let is_mixed = random.below(2) == 0;
        line.iter_mut().for_each(|key| *key = if is_mixed { claim(random) } else { one });
    }
    keys
}

#[test]
fn all_levels_carry_claims_to_the_same_places() {
    let mut random = Random(21);
    for (columns, lines) in [(1_usize, 3_usize), (3, 10), (4, 18), (9, 7)] {
        let stride = columns * TILE + 2;
        let rough = (columns + 2) * (lines.div_ceil(TILE) + 1);
        for _ in 0..200 {
            let keys = tile(&mut random);
            let at = [0, 1].map(|_| random.below(120) as i32);
            let shift = [0, 1].map(|_| random.below(80) as i32 - 60);
            let phase = random.below(2 * WHOLE as u64 + 1) as i32;
            let way = if phase > WHOLE || random.below(2) == 0 { Way::from_current } else { Way::from_previous };
            let way = way(Moment::new(phase, perspective(&mut random)));
            let ground: Vec<Key> = (0..stride * lines).map(|_| claim(&mut random)).collect();
            let laid = claim(&mut random);
            let carried = |level| {
                let (mut places, mut is_rough) = (ground.clone(), vec![false; rough]);
                tile_keys::carry(
                    level,
                    &keys,
                    at,
                    shift,
                    way,
                    &mut Places { keys: &mut places, stride, is_rough: &mut is_rough },
                );
                tile_keys::lay(level, laid, &mut places, stride, stride + 1, [TILE - lines % 2, 2]);
                (places, is_rough)
            };
            let truth = carried(Level::SCALAR);
            assert!(Level::available().all(|level| carried(level) == truth), "from {at:?} by {way:?}");
        }
    }
}

#[test]
fn a_row_that_stays_together_lands_as_pixels_do() {
    // From the very first place to the very last, and one beyond at each end.
    let (columns, lines) = (2, 3);
    let stride = columns * TILE + 2;
    let key = key_buffer::key(5, 0, [-64, 128]);
    let mut keys = [EMPTY; BLOCK];
    keys[..TILE].fill(key);
    for level in Level::available() {
        for (x, y) in (-1..12).flat_map(|x| (-1..4).map(move |y| (x, y))) {
            let (mut places, mut is_rough) = (vec![EMPTY; stride * lines], vec![false; 3 * (columns + 2)]);
            let mut room = Places { keys: &mut places, stride, is_rough: &mut is_rough };
            tile_keys::carry(level, &keys, [x + 1, y - 2], [0, 0], Way::from_current(Moment::previous()), &mut room);
            for (place, &found) in places.iter().enumerate() {
                let [u, v] = [place % stride, place / stride].map(|at| at as i32);
                assert_eq!(found == key, v == y && (x..x + TILE as i32).contains(&u), "{x}, {y}");
            }
            let touched = is_rough.iter().filter(|is_rough| **is_rough).count();
            assert_eq!(touched > 0, places.contains(&key));
        }
    }
}

#[test]
fn all_levels_find_the_same_in_tiles() {
    let mut random = Random(22);
    for _ in 0..2000 {
        let keys = tile(&mut random);
        let mut around: Around = [[EMPTY; TILE + 2]; TILE + 2];
        around.iter_mut().for_each(|line| line.iter_mut().for_each(|key| *key = claim(&mut random)));
        let size = [0, 1].map(|_| 1 + random.below(200) as usize);
        let at = [0, 1].map(|_| random.below(200) as i32);
        let moment = Moment::new(random.below(WHOLE as u64) as i32, perspective(&mut random));
        let limit = [0, 8, ALIKE][random.below(3) as usize];
        let asked = random.bits() & random.bits();
        let found = |level| {
            let mut nearest = [EMPTY; BLOCK];
            let mut closed = [EMPTY; BLOCK];
            let changes = tile_keys::nearest_around(level, &around, limit, &mut nearest);
            let mut others = [EMPTY; BLOCK];
            let moving = tile_keys::other_around(level, &around, limit, asked, &mut others);
            let left = tile_keys::close(level, around.as_flattened(), TILE + 2, &mut closed);
            let empty = Positions { x: [0; BLOCK], y: [0; BLOCK] };
            let (mut before, mut after) = (empty, empty);
            let beyond = tile_keys::spots(level, &keys, at, moment, size, &mut before, &mut after);
            let spots = [before.x, before.y, after.x, after.y];
            let marks = [0, 24, ORPHAN, HOLE].map(|mark| tile_keys::having(level, &keys, mark));
            (nearest, changes, others, moving, closed, left, beyond, spots, marks, tile_keys::span(level, &keys))
        };
        let truth = found(Level::SCALAR);
        assert!(Level::available().all(|level| found(level) == truth));
    }
}

#[test]
fn what_moves_otherwise_is_found_whatever_its_rank() {
    let claim = |mark, x| key_buffer::key(30_000, mark, [x, 0]);
    let own = claim(5, 0);
    let mut around: Around = [[own; TILE + 2]; TILE + 2];
    // A pixel that moves nearly as the others, one that does not, one that matches better, and nothing.
    (around[1][1], around[2][3], around[2][4], around[5][5]) = (claim(1, 8), claim(9, 9), claim(3, -64), EMPTY);
    // One at a place that is not asked for.
    around[9][9] = claim(0, 640);
    for level in Level::available() {
        let mut others = [EMPTY; BLOCK];
        let moving = tile_keys::other_around(level, &around, 8, !(1 << 63), &mut others);
        for (place, &other) in others.iter().enumerate() {
            // In `around` this is the place (i + 1, j + 1).
            let (i, j) = (place % TILE, place / TILE);
            let is_beside = |x: usize, y: usize| (i + 1).abs_diff(x) <= 1 && (j + 1).abs_diff(y) <= 1;
            let wanted = match (i + 1, j + 1) {
                (5, 5) => EMPTY,
                // To these two all others move otherwise, and the best match of them is taken.
                (3, 2) => claim(3, -64),
                (4, 2) => own,
                _ if is_beside(4, 2) => claim(3, -64),
                _ if is_beside(3, 2) => claim(9, 9),
                _ => EMPTY,
            };
            assert_eq!(other, wanted, "{i}, {j}");
            assert_eq!(moving >> place & 1 == 1, wanted != EMPTY, "{i}, {j}");
        }
    }
}
