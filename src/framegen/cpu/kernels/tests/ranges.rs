//! Ranges, and splat keys of guidance.

use half::f16;

use super::*;

fn motion(random: &mut Random) -> [f16; 2] {
    const ODD: [f16; 8] =
        [f16::NAN, f16::INFINITY, f16::NEG_INFINITY, f16::MAX, f16::MIN, f16::NEG_ZERO, f16::ZERO, f16::from_bits(3)];
    std::array::from_fn(|_| match random.below(8) {
        0 => ODD[random.below(8) as usize],
        1 => f16::from_bits(random.bits() as u16),
        // Includes halves of 1/64 px, for rounding.
        _ => f16::from_f32((random.below(4096) as f32 - 2048.0) / 128.0),
    })
}

fn depth(random: &mut Random) -> f32 {
    const ODD: [f32; 8] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, 0.0, 1.0, 1.0 - f32::EPSILON / 2.0, 2.0];
    match random.below(4) {
        0 => ODD[random.below(8) as usize],
        1 => f32::from_bits(random.bits() as u32),
        _ => 1.0 - random.below(1000) as f32 * 1e-6,
    }
}

#[test]
fn all_instruction_sets_find_the_same_ranges() {
    let mut random = Random(3);
    for (width, rows) in (1..40_usize).flat_map(|width| (1..=8).map(move |rows| (width, rows))) {
        let motion: Vec<[f16; 2]> = (0..width * rows).map(|_| motion(&mut random)).collect();
        let depth: Vec<f32> = (0..width * rows).map(|_| depth(&mut random)).collect();
        let limit = [64 * (1 + random.below(8191) as i32), 64 * width as i32];
        let find = |level| {
            let tiles = width.div_ceil(TILE);
            let mut ranges = (vec![VectorRange::default(); tiles], vec![DepthKeyRange::default(); tiles]);
            motion_ranges(level, &motion, width, limit, &mut ranges.0);
            depth_ranges(level, &depth, width, &mut ranges.1);
            ranges
        };
        let expected = find(SimdLevel::SCALAR);
        for level in SimdLevel::available() {
            assert_eq!(find(level), expected, "{} at {width} x {rows}", level.name());
        }
    }
}

#[test]
fn all_instruction_sets_warp_rows_alike() {
    let mut random = Random(4);
    for round in 0..4000 {
        let len = 1 + round % TILE;
        let motion: Vec<[f16; 2]> = (0..len).map(|_| motion(&mut random)).collect();
        let depth: Vec<f32> = (0..len).map(|_| depth(&mut random)).collect();
        let at = [random.below(16_384) as i32, random.below(16_384) as i32];
        let fraction = random.below(2049) as i32 - 1024;
        let limit = [64 * (1 + random.below(8191) as i32), 64 * 8191];
        let find = |level| {
            let mut out = WarpedRow { x: [7; TILE], y: [7; TILE], keys: [7; TILE] };
            warp_row(level, &motion, &depth, at, fraction, limit, &mut out);
            out
        };
        let expected = find(SimdLevel::SCALAR);
        for level in SimdLevel::available() {
            assert_eq!(find(level), expected, "{}: {motion:?} {depth:?}", level.name());
        }
    }
}

#[test]
fn ranges_are_those_of_sanitised_values() {
    let half = |v: f32| f16::from_f32(v);
    let mut motion = [[half(1.0), half(-2.0)]; 8 * TILE];
    motion[5] = [half(-3.5), half(0.0)];
    motion[60] = [f16::NAN, half(900.0)];
    motion[61] = [half(4000.0), half(0.25)];
    let mut out = [VectorRange::default()];
    for level in SimdLevel::available() {
        motion_ranges(level, &motion, TILE, [64 * 100, 64 * 50], &mut out);
        assert_eq!(out, [VectorRange { low: [-224, -128], high: [6400, 16] }]);
    }
    let mut out = [DepthKeyRange::default()];
    for level in SimdLevel::available() {
        depth_ranges(level, &[0.5, f32::NAN, 0.25], 3, &mut out);
        // Depth keys count octaves of `1 - depth`: 1/2 is one below 1, and 3/4 half an octave.
        assert_eq!(out, [DepthKeyRange { near: 0xffff - 0xc000 + 0x400, far: 0xffff }]);
    }
}

#[test]
fn depth_keys_increase_with_depth_and_resolve_far_depths() {
    let depth_keys = |depths: &[f32]| -> Vec<u16> {
        depths
            .iter()
            .map(|&depth| {
                let mut out = [DepthKeyRange::default()];
                depth_ranges(SimdLevel::SCALAR, &[depth], 1, &mut out);
                assert_eq!(out[0].near, out[0].far);
                out[0].near
            })
            .collect()
    };
    let depth_keys = depth_keys(&[-1.0, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999, 1.0]);
    assert!(depth_keys.is_sorted() && depth_keys.windows(2).all(|pair| pair[0] < pair[1]), "{depth_keys:?}");
}

#[test]
fn all_instruction_sets_pack_tiles_alike() {
    let mut random = Random(5);
    for _ in 0..500 {
        let strides = [TILE + random.below(9) as usize, if random.below(3) == 0 { 0 } else { TILE }];
        let motion: Vec<[f16; 2]> = (0..strides[0] * TILE).map(|_| motion(&mut random)).collect();
        let depth: Vec<f32> = (0..BLOCK).map(|_| depth(&mut random)).collect();
        let limit = [64 * (1 + random.below(8191) as i32), 64 * 4095];
        let find = |level| {
            let mut keys = [7; BLOCK];
            pack_tile(level, &motion, &depth, strides, limit, &mut keys);
            keys
        };
        let mut expected = [0; BLOCK];
        for (j, keys) in expected.chunks_mut(TILE).enumerate() {
            let mut warped_row = WarpedRow::default();
            warp_row(
                SimdLevel::SCALAR,
                &motion[j * strides[0]..],
                &depth[j * strides[1]..],
                [0; 2],
                0,
                limit,
                &mut warped_row,
            );
            keys.copy_from_slice(&warped_row.keys);
        }
        for level in SimdLevel::available() {
            assert_eq!(find(level), expected, "{}", level.name());
        }
    }
}
