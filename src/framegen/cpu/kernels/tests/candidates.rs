//! Candidates for the holes of a tile.

use super::super::super::splat_key::{self, EMPTY, Key};
use super::super::candidates::{self, Candidates, OutsideCandidates, SIDES};
use super::*;

#[test]
fn all_instruction_sets_find_the_same_candidates() {
    let mut random = Random(34);
    for round in 0..2000 {
        let key = |random: &mut Random| {
            let component = |random: &mut Random| random.below(2000) as i32 - 1000;
            splat_key::pack(random.bits() as u16, random.below(255) as u8, [component(random), component(random)])
        };
        // Few covered pixels, many, or none.
        let covered = match round % 3 {
            0 => random.bits() & random.bits() & random.bits(),
            1 => random.bits() | random.bits(),
            _ => 0,
        };
        let holes = !covered & if round % 2 == 0 { u64::MAX } else { random.bits() };
        let own: [Key; BLOCK] = std::array::from_fn(|i| if covered >> i & 1 == 1 { key(&mut random) } else { EMPTY });
        let lumas: [f32; BLOCK] = std::array::from_fn(|_| random.below(1000) as f32 - 200.0);
        let mut outside = OutsideCandidates::NONE;
        for (side, line) in (0..SIDES).flat_map(|side| (0..TILE).map(move |line| (side, line))) {
            if random.below(3) > 0 {
                let distance = random.below(24) as i32 + 1;
                outside.keys[side][line] = key(&mut random);
                let position = if side.is_multiple_of(2) { -distance } else { TILE as i32 - 1 + distance };
                outside.position[side][line] = position as u32;
                outside.lumas[side][line] = random.below(256) as f32;
            }
        }
        let found = |level| {
            let mut candidates = Candidates::NONE;
            candidates::find(level, &own, covered, holes, &outside, &mut candidates);
            let mut costs = [[[u32::MAX; BLOCK]; SIDES]; 2];
            candidates::cost_by_luma(level, &candidates, &lumas, covered, holes, &outside, &mut costs[0]);
            candidates::cost_by_depth(level, &candidates, &mut costs[1]);
            // Only candidates that exist are compared; the distance of others is undefined.
            let places = (0..SIDES).flat_map(|side| (0..BLOCK).map(move |place| (side, place)));
            let places = places.filter(|&(_, place)| holes >> place & 1 == 1);
            places
                .map(|(side, place)| {
                    let key = candidates.keys[side][place];
                    let distance = if key == EMPTY { 0 } else { candidates.distance[side][place] };
                    (key, distance, [costs[0][side][place], costs[1][side][place]])
                })
                .collect::<Vec<_>>()
        };
        assert!(SimdLevel::available().all(|level| candidates::covered_pixels(level, &own) == covered), "{covered:x}");
        let truth = found(SimdLevel::SCALAR);
        assert!(SimdLevel::available().all(|level| found(level) == truth), "{covered:x} {holes:x}");
        assert!(truth.iter().all(|&(key, distance, _)| key == EMPTY || (1..=24).contains(&distance)));
    }
}
