//! What stands beside the places of a tile.

use super::super::super::key_buffer::{self, EMPTY, Key};
use super::super::candidates::{self, Beside, Beyond, SIDES};
use super::*;

#[test]
fn all_levels_find_the_same_beside_holes() {
    let mut random = Random(34);
    for round in 0..2000 {
        let key = |random: &mut Random| {
            let component = |random: &mut Random| random.below(2000) as i32 - 1000;
            key_buffer::key(random.bits() as u16, random.below(255) as u8, [component(random), component(random)])
        };
        // Few claims, many, or none.
        let claims = match round % 3 {
            0 => random.bits() & random.bits() & random.bits(),
            1 => random.bits() | random.bits(),
            _ => 0,
        };
        let holes = !claims & if round % 2 == 0 { u64::MAX } else { random.bits() };
        let own: [Key; BLOCK] = std::array::from_fn(|i| if claims >> i & 1 == 1 { key(&mut random) } else { EMPTY });
        let lumas: [f32; BLOCK] = std::array::from_fn(|_| random.below(1000) as f32 - 200.0);
        let mut beyond = Beyond::NOTHING;
        for (side, line) in (0..SIDES).flat_map(|side| (0..TILE).map(move |line| (side, line))) {
            if random.below(3) > 0 {
                let away = random.below(24) as i32 + 1;
                beyond.keys[side][line] = key(&mut random);
                let along = if side.is_multiple_of(2) { -away } else { TILE as i32 - 1 + away };
                beyond.along[side][line] = along as u32;
                beyond.lumas[side][line] = random.below(256) as f32;
            }
        }
        let found = |level| {
            let mut beside = Beside::NOTHING;
            candidates::find(level, &own, claims, holes, &beyond, &mut beside);
            let mut orders = [[[u32::MAX; BLOCK]; SIDES]; 2];
            candidates::order_by_likeness(level, &beside, &lumas, claims, holes, &beyond, &mut orders[0]);
            candidates::order_by_nearness(level, &beside, &mut orders[1]);
            // Where there is something: how far away nothing is does not matter.
            let places = (0..SIDES).flat_map(|side| (0..BLOCK).map(move |place| (side, place)));
            let places = places.filter(|&(_, place)| holes >> place & 1 == 1);
            places
                .map(|(side, place)| {
                    let key = beside.keys[side][place];
                    let away = if key == EMPTY { 0 } else { beside.away[side][place] };
                    (key, away, [orders[0][side][place], orders[1][side][place]])
                })
                .collect::<Vec<_>>()
        };
        assert!(Level::available().all(|level| candidates::claimed(level, &own) == claims), "{claims:x}");
        let truth = found(Level::SCALAR);
        assert!(Level::available().all(|level| found(level) == truth), "{claims:x} {holes:x}");
        assert!(truth.iter().all(|&(key, away, _)| key == EMPTY || (1..=24).contains(&away)));
    }
}
