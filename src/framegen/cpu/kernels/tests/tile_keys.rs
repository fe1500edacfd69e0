//! Kernels over the keys of a tile.

use super::super::super::splat_key::{self, EMPTY, HOLE, Key, MAX_COMPONENT, PHASE_ONE, PREVIOUS_ONLY, SIMILAR_MOTION};
use super::super::super::warp::{DepthChange, Warp, WarpTime};
use super::super::tile_keys::{self, PaddedTile, SplatTarget};
use super::*;

/// A key of one of a few surfaces, or any key.
fn random_key(random: &mut Random) -> Key {
    let near = |random: &mut Random, v: i32| v + random.below(5) as i32 * 32 - 64;
    match random.below(10) {
        0 => EMPTY,
        1 => {
            let component = |random: &mut Random| random.below(2 * MAX_COMPONENT as u64 + 1) as i32 - MAX_COMPONENT;
            splat_key::pack(
                random.bits() as u16,
                [0, 24, PREVIOUS_ONLY, HOLE][random.below(4) as usize],
                [component(random), component(random)],
            )
        }
        2..5 => splat_key::pack(40_000 + random.below(65) as u16, 0, [near(random, 700), near(random, -90)]),
        5 => splat_key::pack(u16::MAX - random.below(40) as u16, PREVIOUS_ONLY, [near(random, -64), 0]),
        _ => splat_key::pack(20_000, 0, [64 * 3, near(random, 0)]),
    }
}

/// A random change of distance, or none.
fn depth_change(random: &mut Random) -> DepthChange {
    if random.below(3) == 0 {
        return DepthChange::default();
    }
    let mut range = |max: f32| (random.below(2001) as f32 / 1000.0 - 1.0) * max;
    let slope = [range(0.01), range(0.01)];
    DepthChange {
        inverse_depth: range(2.0),
        slope,
        origin: range(0.5),
        min: -0.25 - range(0.25),
        max: 0.45 + range(0.45),
    }
}

/// A tile in which many rows have a single key.
fn tile(random: &mut Random) -> [Key; BLOCK] {
    let mut keys = [EMPTY; BLOCK];
    for line in keys.chunks_mut(TILE) {
        let one = random_key(random);
        let is_mixed = random.below(2) == 0;
        line.iter_mut().for_each(|key| *key = if is_mixed { random_key(random) } else { one });
    }
    keys
}

#[test]
fn all_instruction_sets_splat_alike() {
    let mut random = Random(21);
    for (columns, lines) in [(1_usize, 3_usize), (3, 10), (4, 18), (9, 7)] {
        let stride = columns * TILE + 2;
        let rough = (columns + 2) * (lines.div_ceil(TILE) + 1);
        for _ in 0..200 {
            let keys = tile(&mut random);
            let at = [0, 1].map(|_| random.below(120) as i32);
            let shift = [0, 1].map(|_| random.below(80) as i32 - 60);
            let phase = random.below(2 * PHASE_ONE as u64 + 1) as i32;
            let warp = if phase > PHASE_ONE || random.below(2) == 0 { Warp::from_current } else { Warp::from_previous };
            let warp = warp(WarpTime::new(phase, depth_change(&mut random)));
            let before: Vec<Key> = (0..stride * lines).map(|_| random_key(&mut random)).collect();
            let rectangle = random_key(&mut random);
            let splatted = |level| {
                let (mut keys_out, mut is_mixed) = (before.clone(), vec![false; rough]);
                tile_keys::splat_pixels(
                    level,
                    &keys,
                    at,
                    shift,
                    warp,
                    &mut SplatTarget { keys: &mut keys_out, stride, is_mixed: &mut is_mixed },
                );
                tile_keys::splat_rectangle(level, rectangle, &mut keys_out, stride, stride + 1, [TILE - lines % 2, 2]);
                (keys_out, is_mixed)
            };
            let truth = splatted(SimdLevel::SCALAR);
            assert!(SimdLevel::available().all(|level| splatted(level) == truth), "from {at:?} by {warp:?}");
        }
    }
}

#[test]
fn a_contiguous_row_is_splatted_like_single_pixels() {
    // From the first pixel to the last, and one outside at each end.
    let (columns, lines) = (2, 3);
    let stride = columns * TILE + 2;
    let key = splat_key::pack(5, 0, [-64, 128]);
    let mut keys = [EMPTY; BLOCK];
    keys[..TILE].fill(key);
    for level in SimdLevel::available() {
        for (x, y) in (-1..12).flat_map(|x| (-1..4).map(move |y| (x, y))) {
            let (mut keys_out, mut is_mixed) = (vec![EMPTY; stride * lines], vec![false; 3 * (columns + 2)]);
            let mut room = SplatTarget { keys: &mut keys_out, stride, is_mixed: &mut is_mixed };
            tile_keys::splat_pixels(
                level,
                &keys,
                [x + 1, y - 2],
                [0, 0],
                Warp::from_current(WarpTime::previous_anchor()),
                &mut room,
            );
            for (place, &found) in keys_out.iter().enumerate() {
                let [u, v] = [place % stride, place / stride].map(|at| at as i32);
                assert_eq!(found == key, v == y && (x..x + TILE as i32).contains(&u), "{x}, {y}");
            }
            let touched = is_mixed.iter().filter(|is_mixed| **is_mixed).count();
            assert_eq!(touched > 0, keys_out.contains(&key));
        }
    }
}

#[test]
fn all_instruction_sets_agree_on_tiles_of_keys() {
    let mut random = Random(22);
    for _ in 0..2000 {
        let keys = tile(&mut random);
        let mut padded: PaddedTile = [[EMPTY; TILE + 2]; TILE + 2];
        padded.iter_mut().for_each(|line| line.iter_mut().for_each(|key| *key = random_key(&mut random)));
        let size = [0, 1].map(|_| 1 + random.below(200) as usize);
        let at = [0, 1].map(|_| random.below(200) as i32);
        let time = WarpTime::new(random.below(PHASE_ONE as u64) as i32, depth_change(&mut random));
        let limit = [0, 8, SIMILAR_MOTION][random.below(3) as usize];
        let wanted = random.bits() & random.bits();
        let found = |level| {
            let mut nearest = [EMPTY; BLOCK];
            let mut closed = [EMPTY; BLOCK];
            let changes = tile_keys::nearest_neighbours(level, &padded, limit, &mut nearest);
            let mut others = [EMPTY; BLOCK];
            let moving = tile_keys::nearest_other_motion(level, &padded, limit, wanted, &mut others);
            let left = tile_keys::close_cracks(level, padded.as_flattened(), TILE + 2, &mut closed);
            let empty = Positions { x: [0; BLOCK], y: [0; BLOCK] };
            let (mut before, mut after) = (empty, empty);
            let outside = tile_keys::source_positions(level, &keys, at, time, size, &mut before, &mut after);
            let source_positions = [before.x, before.y, after.x, after.y];
            let masks = [0, 24, PREVIOUS_ONLY, HOLE].map(|tag| tile_keys::tagged(level, &keys, tag));
            (
                nearest,
                changes,
                others,
                moving,
                closed,
                left,
                outside,
                source_positions,
                masks,
                tile_keys::vector_range(level, &keys),
            )
        };
        let truth = found(SimdLevel::SCALAR);
        assert!(SimdLevel::available().all(|level| found(level) == truth));
    }
}

#[test]
fn different_motion_is_found_at_any_depth() {
    let key = |tag, x| splat_key::pack(30_000, tag, [x, 0]);
    let own = key(5, 0);
    let mut padded: PaddedTile = [[own; TILE + 2]; TILE + 2];
    // A pixel with nearly the same motion, one without, one with a smaller match error, and a hole.
    (padded[1][1], padded[2][3], padded[2][4], padded[5][5]) = (key(1, 8), key(9, 9), key(3, -64), EMPTY);
    // Beside the pixel that is not wanted.
    padded[9][9] = key(0, 640);
    for level in SimdLevel::available() {
        let mut others = [EMPTY; BLOCK];
        let moving = tile_keys::nearest_other_motion(level, &padded, 8, !(1 << 63), &mut others);
        for (place, &other) in others.iter().enumerate() {
            // Pixel (i + 1, j + 1) of `padded`.
            let (i, j) = (place % TILE, place / TILE);
            let is_beside = |x: usize, y: usize| (i + 1).abs_diff(x) <= 1 && (j + 1).abs_diff(y) <= 1;
            let wanted = match (i + 1, j + 1) {
                (5, 5) => EMPTY,
                // These two have other motion than all their neighbours; the one with the smallest match error is
                // taken.
                (3, 2) => key(3, -64),
                (4, 2) => own,
                _ if is_beside(4, 2) => key(3, -64),
                _ if is_beside(3, 2) => key(9, 9),
                _ => EMPTY,
            };
            assert_eq!(other, wanted, "{i}, {j}");
            assert_eq!(moving >> place & 1 == 1, wanted != EMPTY, "{i}, {j}");
        }
    }
}
