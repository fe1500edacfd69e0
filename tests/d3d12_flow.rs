//! Optical flow between two pictures on the device, compared with the processor's. On Windows, or in the lab.
#![cfg(windows)]

use cairn::gpu::Gpu;
use cairn::gpu::compute::{CommandRecorder, CommandRing, Transfer};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::picture_flow::{DESCRIPTORS, GpuExtractor};
use cairn::{ErrorKind, Picture};
use gpu_testing::flow::{
    Extraction, Vectors, compare, compare_scene, distances, expected, ground, moving_scene, picture, upload_picture,
};
use half::f16;
use test_support::allocations::{CountingAllocator, allocations};
use test_support::d3d12::resources::{TestResource, upload_texture, writable_texture};
use test_support::frame_cases::Random;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn gpu() -> Gpu {
    Gpu::on_adapter(None).expect("a device")
}

#[test]
fn motion_equals_the_processors() {
    let gpu = gpu();
    for (number, size) in [(160, 90), (97, 61), (256, 144)].into_iter().enumerate() {
        let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, [1, 8, 16][number]);
        for case in 0..3 {
            let [previous, current] = moving_scene(&mut Random(10 * number as u64 + case), size);
            compare_scene(&mut extraction, [&previous, &current], &format!("{size:?}, case {case}"));
        }
    }
}

#[test]
fn a_small_object_that_moves_far_is_found_as_on_the_processor() {
    let gpu = gpu();
    let size = (320, 180);
    let object = |x: f32, y: f32| ground(1.7 * y, 1.7 * x).map(|v| 255.0 - v);
    let draw = |shift: [f32; 2]| {
        picture(size, |x, y| {
            let [u, v] = [x + shift[0], y + shift[1]];
            let is_object = (150.0..182.0).contains(&u) && (70.0..102.0).contains(&v);
            if is_object { object(u, v) } else { ground(x, y).map(|v| 0.5 * v + 20.0) }
        })
    };
    let (previous, current) = (draw([0.0; 2]), draw([27.0, -15.0]));
    let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 8);
    compare_scene(&mut extraction, [&previous, &current], "a small object");
    let (found, wanted) = (extraction.vectors([&previous, &current]), expected(&previous, &current));
    for y in 91..111 {
        for x in 129..149 {
            let [u, v] = found[y * 320 + x];
            assert!((u - 27.0).hypot(v + 15.0) < 0.2, "({x}, {y}): {u} {v}");
            assert_eq!([u, v], wanted[y * 320 + x], "({x}, {y})");
        }
    }
}

/// Grey noise of squares of `side` pixels.
fn noise(random: &mut Random, size: (u32, u32), side: u32) -> Picture {
    let across = size.0.div_ceil(side);
    let levels: Vec<f32> = (0..across * size.1.div_ceil(side)).map(|_| 128.0 + 127.0 * random.signed_unit()).collect();
    picture(size, |x, y| [levels[(y as u32 / side * across + x as u32 / side) as usize]; 3])
}

/// Waves of colours, longer than a patch, under a faint grid of two pixels.
fn blurred(random: &mut Random, size: (u32, u32)) -> Picture {
    let waves: Vec<_> = (0..6).map(|_| [0.06, 0.06, 3.0, 30.0].map(|most| most * random.signed_unit())).collect();
    let grid: [f32; 4] = std::array::from_fn(|_| 8.0 * random.signed_unit());
    picture(size, |x, y| {
        let level = |channel: f32| {
            128.0 + waves.iter().map(|[a, b, phase, most]| most * (a * x + b * y + phase + channel).sin()).sum::<f32>()
        };
        [0.0, 1.0, 2.0].map(|channel| level(channel) + grid[x as usize % 2 + 2 * (y as usize % 2)])
    })
}

/// Where two pictures have nothing in common, every match is poor and many are nearly as good: the last bit of a number decides.
#[test]
fn motion_of_pictures_without_a_common_scene_equals_the_processors() {
    let gpu = gpu();
    for (seed, size) in (0..).zip([(128, 72), (97, 61), (25, 47), (160, 90), (320, 180)]) {
        let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 8);
        let mut random = Random(seed);
        let drawings: [&dyn Fn(&mut Random) -> Picture; 5] = [
            &|random| noise(random, size, 1),
            &|random| noise(random, size, 2),
            &|random| noise(random, size, 5),
            &|random| blurred(random, size),
            &|random| blurred(random, size),
        ];
        for (number, draw) in drawings.into_iter().enumerate() {
            let (previous, current) = (draw(&mut random), draw(&mut random));
            let (found, _) = compare(&mut extraction, [&previous, &current], &format!("{size:?}, drawing {number}"));
            assert!(found.iter().all(|v| v[0].abs() <= size.0 as f32 && v[1].abs() <= size.1 as f32));
        }
    }
}

#[test]
fn motion_equals_the_processors_at_unusual_sizes() {
    let gpu = gpu();
    let sizes = [(1, 1), (1, 50), (50, 1), (7, 9), (23, 200), (24, 24), (25, 47), (131, 33)];
    for (seed, size) in (0..).zip(sizes) {
        let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 16);
        let [previous, current] = moving_scene(&mut Random(seed), size);
        compare_scene(&mut extraction, [&previous, &current], &format!("{size:?}"));
        // For equal pictures the motion is exactly zero.
        assert!(extraction.vectors([&current, &current]).iter().all(|v| v.map(f32::to_bits) == [0, 0]), "{size:?}");
    }
}

#[test]
fn a_large_picture_is_searched_at_half_its_size() {
    let gpu = gpu();
    let size = (1401, 801);
    let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 16);
    let [previous, current] = moving_scene(&mut Random(3), size);
    compare_scene(&mut extraction, [&previous, &current], "large");
}

#[test]
fn linear_colours_give_the_motion_of_srgb_colours() {
    let gpu = gpu();
    let size = (160, 90);
    let pair = moving_scene(&mut Random(6), size);
    let wanted = {
        let pair = pair.each_ref().map(|picture| upload_picture(&gpu, picture));
        Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 16).bytes([&pair[0], &pair[1]], 4)
    };
    let typed =
        pair.each_ref().map(|picture| upload_texture(&gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, picture.rgba()));
    let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 16);
    assert!(extraction.bytes([&typed[0], &typed[1]], 4) == wanted);

    // In scRGB the values are nearly the same.
    let light = |level: u8| {
        let shown = f64::from(level) / 255.0;
        f16::from_f64(if shown <= 0.04045 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) })
    };
    let halves = pair.each_ref().map(|picture| {
        let bytes: Vec<u8> = picture.rgba().iter().flat_map(|&level| light(level).to_le_bytes()).collect();
        upload_texture(&gpu, size, DXGI_FORMAT_R16G16B16A16_FLOAT, &bytes)
    });
    extraction.extractor = extraction.extractor.with_transfer(Transfer::Linear);
    let found = extraction.bytes([&halves[0], &halves[1]], 4);
    let vectors = |bytes: &[u8]| -> Vectors {
        let half = |bytes: &[u8]| f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        bytes.chunks(4).map(|vector| [half(vector), half(&vector[2..])]).collect()
    };
    let apart = distances(&vectors(&found), &vectors(&wanted));
    assert!(apart[apart.len() * 99 / 100] <= 0.25, "{} px", apart[apart.len() * 99 / 100]);
}

#[test]
fn motion_across_a_cut_is_bounded_and_deterministic() {
    let gpu = gpu();
    let size = (192, 108);
    let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 8);
    let [previous, _] = moving_scene(&mut Random(1), size);
    let mut noise = Random(5);
    let noise: Vec<f32> = (0..size.0 * size.1).map(|_| 128.0 + 127.0 * noise.signed_unit()).collect();
    let noise = picture(size, |x, y| [noise[(y * size.0 as f32 + x) as usize]; 3]);
    for pair in [[&previous, &noise], [&noise, &previous]] {
        let found = extraction.vectors(pair);
        assert!(found.iter().all(|v| v[0].abs() <= size.0 as f32 && v[1].abs() <= size.1 as f32));
        assert_eq!(found, extraction.vectors(pair));
    }
}

#[test]
fn motion_does_not_depend_on_earlier_pairs() {
    let gpu = gpu();
    let size = (160, 90);
    let [first, second] =
        [1, 2].map(|seed| moving_scene(&mut Random(seed), size).map(|picture| upload_picture(&gpu, &picture)));
    let mut one = Extraction::new(&gpu, size, DXGI_FORMAT_R32G32_FLOAT, 8);
    let mut other = Extraction::new(&gpu, size, DXGI_FORMAT_R32G32_FLOAT, 8);
    let wanted = one.bytes([&second[0], &second[1]], 8);
    other.bytes([&first[0], &first[1]], 8);
    assert!(other.bytes([&second[0], &second[1]], 8) == wanted);
    // Both texture formats hold the same half floats.
    let mut halves = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 8);
    let rounded = halves.bytes([&second[0], &second[1]], 4);
    for (float, half) in wanted.chunks(4).zip(rounded.chunks(2)) {
        let float = f32::from_le_bytes([float[0], float[1], float[2], float[3]]);
        assert_eq!(float, f16::from_le_bytes([half[0], half[1]]).to_f32());
    }
}

#[test]
fn an_extraction_allocates_nothing() {
    let gpu = gpu();
    let size = (64, 48);
    let mut extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 16);
    let [previous, current] = moving_scene(&mut Random(4), size).map(|picture| upload_picture(&gpu, &picture));
    let mut one = || {
        let mut frame: CommandRecorder<'_> = extraction.frames.begin().expect("a frame");
        let (motion, depth) = (extraction.motion.with_state(), extraction.depth.with_state());
        extraction
            .extractor
            .record(&mut frame, &previous.with_state(), &current.with_state(), &motion, &depth)
            .expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission")
    };
    one();
    let before = allocations();
    let last = (0..4).map(|_| one()).last().expect("four frames");
    assert_eq!(allocations(), before);
    last.wait().expect("it is done");
}

#[test]
fn invalid_arguments_are_refused_by_name() {
    let (gpu, other) = (gpu(), self::gpu());
    let common = D3D12_RESOURCE_STATE_COMMON;
    let size = (40, 24);
    let extraction = Extraction::new(&gpu, size, DXGI_FORMAT_R16G16_FLOAT, 8);
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let good = writable_texture(&gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, common);
    let swapped = writable_texture(&gpu, size, DXGI_FORMAT_B8G8R8A8_UNORM, common);
    let small = writable_texture(&gpu, (40, 23), DXGI_FORMAT_R8G8B8A8_UNORM, common);
    let foreign = writable_texture(&other, size, DXGI_FORMAT_R8G8B8A8_UNORM, common);
    let motion = writable_texture(&gpu, (5, 3), DXGI_FORMAT_R16G16_FLOAT, common);
    let depth = writable_texture(&gpu, (4, 3), DXGI_FORMAT_R32_FLOAT, common);
    let (to, beside) = (&extraction.motion, &extraction.depth);
    for (previous, current, motion, depth, field) in [
        (&swapped, &good, to, beside, "previous"),
        (&good, &small, to, beside, "current"),
        (&foreign, &good, to, beside, "previous"),
        (&good, &good, &motion, beside, "motion"),
        (&good, &good, &good, beside, "motion"),
        (&good, &good, to, &depth, "depth"),
        (&good, &good, to, &good, "depth"),
    ] {
        let mut frame = frames.begin().expect("a frame");
        let [previous, current] = [previous, current].map(TestResource::with_state);
        let refused = extraction
            .extractor
            .record(&mut frame, &previous, &current, &motion.with_state(), &depth.with_state())
            .expect_err("it is refused");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    for size in [(0, 4), (4, cairn::MAX_SIDE + 1)] {
        let refused = GpuExtractor::new(&gpu, size).expect_err("no such size");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("size")));
    }
}
