//! Frame generation in textures with the double of AMD's libraries: each option changes pixels. On Windows, or in the lab.
#![cfg(windows)]

use cairn::ErrorKind;
use cairn::ffx::bindings::{Coordinates, CreateFlags, Dimensions, Rect, SurfaceFormat, TransferFunction};
use cairn::ffx::{
    Choice, Effect, Family, FrameParams, GenerationCheck, GenerationTextures, Library, LibraryKind, TextureGenerator,
    TextureOptions,
};
use cairn::gpu::compute::ResourceWithState;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{FencePoint, Gpu};
use test_support::d3d12::engine::{self, Engine};
use test_support::d3d12::list_calls::count_list_calls;
use test_support::d3d12::resources::{self, TestResource, run_list, texture_desc, writable_texture};
use test_support::ffx::double_folder::{self, ANALYTIC, ANALYTIC_20, DoubleFolder, ML};
use test_support::ffx::frame_textures::Textures;
use test_support::ffx::world_in_rect;

mod costs;
mod faults;
mod parameters;
mod self_test;

const SIZE: Dimensions = Dimensions { width: 128, height: 96 };

/// Motion of the picture from frame to frame, in pixels.
const STEP: i32 = 16;

fn gpu() -> Gpu {
    Gpu::on_adapter(None).expect("a device")
}

fn options() -> TextureOptions {
    TextureOptions { self_test: false, ..TextureOptions::new(SIZE, SIZE, SurfaceFormat::R8G8B8A8_UNORM) }
}

/// The double with one provider, configured by these lines.
fn set_up_double(lines: &[&str]) -> (DoubleFolder, Library) {
    let lines: Vec<_> = ["sdk 2.1", ML].iter().chain(lines).copied().collect();
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &lines);
    let library = double.load().expect("loaded");
    (double, library)
}

fn made(gpu: &Gpu, library: &Library, options: &TextureOptions) -> cairn::Result<TextureGenerator> {
    TextureGenerator::new(gpu, library.api(Effect::FrameGeneration)?, options)
}

/// Pixel of an endless pattern without repetition.
fn endless(x: i32, y: i32) -> [u8; 4] {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    let (x, y) = (x as f32, y as f32);
    [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255]
}

/// That pattern, moved to the right.
fn moved(by: i32) -> impl Fn(u32, u32) -> [u8; 4] {
    move |x, y| endless(x.cast_signed() - by, y.cast_signed())
}

/// The bytes of two half floats.
fn halves(x: f32, y: f32) -> [u8; 4] {
    let [a, b] = [x, y].map(|v| half::f16::from_f32(v).to_le_bytes());
    [a[0], a[1], b[0], b[1]]
}

/// Textures with constant depth, and motion of one step.
fn panning(gpu: &Gpu) -> Textures {
    let textures = Textures::new(gpu, SIZE);
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    textures.fill(&textures.motion, |_, _| halves(-STEP as f32, 0.0));
    textures
}

/// Inputs of a frame from these textures.
fn of(textures: &Textures) -> GenerationTextures<'_> {
    textures.pictures()
}

/// Passes two frames, one step apart, through `generator`; returns the generated frame.
fn pair(
    generator: &mut TextureGenerator,
    textures: &Textures,
    pictures: &GenerationTextures<'_>,
    params: &FrameParams,
) -> Vec<[u8; 4]> {
    for number in [0, 1] {
        textures.fill(&textures.color, moved(STEP * number));
        let params = FrameParams { reset: number == 0, ..*params };
        generator.generate(pictures, &params).expect("generated").wait().expect("it has run");
    }
    textures.generated()
}

/// Maximum difference of a colour channel from the expected pixels, over a part of the picture. AMD's library writes red into alpha.
fn off(found: &[[u8; 4]], part: [u32; 4], expected: impl Fn(u32, u32) -> [u8; 4]) -> u8 {
    let [left, top, right, bottom] = part;
    let places = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
    let differences = places.flat_map(|(x, y)| {
        let (a, b) = (found[(y * SIZE.width + x) as usize], expected(x, y));
        a.into_iter().zip(b).take(3).map(|(a, b)| a.abs_diff(b))
    });
    differences.max().unwrap_or(0)
}

/// Motion of the generated frame, and the inner part of the picture, which nothing enters from outside.
const HALF: i32 = STEP / 2;
const INNER: [u32; 4] = [32, 0, 96, SIZE.height];

/// As `tests/ffx_amd` finds of AMD's own.
#[test]
fn depth_and_motion_cover_the_part_that_is_generated() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    world_in_rect::check(&gpu, &mut generator, SIZE);
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn a_frame_lies_half_way_and_invalid_motion_is_sanitised() {
    for release in [["sdk 2.0", ANALYTIC_20], ["sdk 2.1", ML]] {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &release);
        let (gpu, library) = (gpu(), double.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        let params = FrameParams::of(SIZE);
        let found = pair(&mut generator, &textures, &of(&textures), &params);
        assert!(off(&found, INNER, moved(HALF)) <= 2, "half way");
        assert!(off(&found, INNER, moved(STEP)) > 20);
        // Vectors that would harm a provider: NaN, infinite, and longer than the picture, which is clamped to its size.
        let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 60000.0];
        textures.fill(&textures.motion, |x, _| match x {
            0..32 => halves(wild[0], -STEP as f32),
            32..64 => halves(0.0, wild[1]),
            64..96 => halves(wild[2], wild[0]),
            _ => halves(wild[3], 0.0),
        });
        let found = pair(&mut generator, &textures, &of(&textures), &params);
        // Zero motion: the mean of both frames, in linear light.
        let mean = |x: u32, y: u32| {
            let (a, b) = (moved(0)(x, y), moved(STEP)(x, y));
            [0, 1, 2, 3].map(|i| mixed(a[i], b[i]))
        };
        assert!(off(&found, [2, 0, 94, SIZE.height], mean) <= 2, "{}", off(&found, [2, 0, 94, SIZE.height], mean));
        // Motion of the picture's width to the right: the left of this frame and the right of the previous one.
        let ends = |x: u32, y: u32| {
            let x = x.cast_signed();
            let at = |x: i32| x.clamp(0, SIZE.width.cast_signed() - 1);
            let (a, b) = (endless(at(x - 64) - STEP, y.cast_signed()), endless(at(x + 64), y.cast_signed()));
            [0, 1, 2, 3].map(|i| mixed(a[i], b[i]))
        };
        assert!(off(&found, [98, 0, 128, SIZE.height], ends) <= 2, "{}", off(&found, [98, 0, 128, SIZE.height], ends));
        drop(generator);
        assert!(gpu.removed().is_none());
        assert_eq!(double.violations(), [""; 0]);
    }
}

/// The mean of two sRGB values, in linear light.
fn mixed(a: u8, b: u8) -> u8 {
    let light = |v: u8| {
        let c = f32::from(v) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    let mean = (light(a) + light(b)) / 2.0;
    let c = if mean <= 0.003_130_8 { mean * 12.92 } else { 1.055 * mean.powf(1.0 / 2.4) - 0.055 };
    (c * 255.0 + 0.5) as u8
}

#[test]
fn scale_depth_and_size_of_motion_change_the_frame() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let textures = panning(&gpu);
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    // Motion as a fraction of the picture.
    textures.fill(&textures.motion, |_, _| halves(-STEP as f32 / SIZE.width as f32, 0.0));
    let scale = Coordinates { x: SIZE.width as f32, y: SIZE.height as f32 };
    let params = FrameParams { motion_scale: scale, ..FrameParams::of(SIZE) };
    let found = pair(&mut generator, &textures, &of(&textures), &params);
    assert!(off(&found, INNER, moved(HALF)) <= 2);

    // Near pixels give their motion to their neighbours: near moving columns between far columns at rest.
    let near = |x: u32| x.is_multiple_of(2);
    for (flags, of_near) in [(CreateFlags::empty(), 0.25_f32), (CreateFlags::DEPTH_INVERTED, 0.75)] {
        let mut options = options();
        options.head.flags = flags;
        let mut generator = made(&gpu, &library, &options).expect("a generator");
        textures.fill(&textures.depth, |x, _| if near(x) { of_near } else { 0.5 }.to_le_bytes());
        textures.fill(&textures.motion, |x, _| halves(if near(x) { -STEP as f32 } else { 0.0 }, 0.0));
        let found = pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        assert!(off(&found, INNER, moved(HALF)) <= 2, "{flags:?}");
    }

    // Half render size; motion of that size in its pixels, or of display size.
    let half = Dimensions { width: SIZE.width / 2, height: SIZE.height / 2 };
    let small = Textures::new(&gpu, half);
    small.fill(&small.depth, |_, _| 0.5_f32.to_le_bytes());
    small.fill(&small.motion, |_, _| halves(-STEP as f32 / 2.0, 0.0));
    textures.fill(&textures.motion, |_, _| halves(-STEP as f32, 0.0));
    for (flags, motion) in
        [(CreateFlags::empty(), &small.motion), (CreateFlags::DISPLAY_RESOLUTION_MOTION, &textures.motion)]
    {
        let mut options = options();
        options.head.flags = flags;
        let mut generator = made(&gpu, &library, &options).expect("a generator");
        let pictures =
            GenerationTextures { depth: small.depth.with_state(), motion: motion.with_state(), ..of(&textures) };
        let found = pair(&mut generator, &textures, &pictures, &FrameParams::of(half));
        assert!(off(&found, INNER, moved(HALF)) <= 2, "{flags:?}");
    }

    // The change of jitter, from 3 to -5, is subtracted from motion if the generator was created for motion with jitter.
    for (flags, is_right) in [(CreateFlags::MOTION_JITTER, true), (CreateFlags::empty(), false)] {
        let mut options = options();
        options.head.flags = flags;
        let mut generator = made(&gpu, &library, &options).expect("a generator");
        textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
        textures.fill(&textures.motion, |_, _| halves(-STEP as f32 + 8.0, 0.0));
        for (number, x) in [(0, 3.0), (1, -5.0)] {
            textures.fill(&textures.color, moved(STEP * number));
            let params = FrameParams { reset: number == 0, jitter: Coordinates { x, y: 0.0 }, ..FrameParams::of(SIZE) };
            generator.generate(&of(&textures), &params).expect("generated").wait().expect("it has run");
        }
        assert_eq!(off(&textures.generated(), INNER, moved(HALF)) <= 2, is_right, "{flags:?}");
    }
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn interface_letterbox_and_lens_distortion_change_the_frame() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let textures = panning(&gpu);
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    // Bars at the top and bottom are copied.
    let rect = Rect { left: 0, top: 16, width: SIZE.width.cast_signed(), height: 64 };
    let found = pair(&mut generator, &textures, &of(&textures), &FrameParams { rect, ..FrameParams::of(SIZE) });
    for bar in [[0, 0, SIZE.width, 16], [0, 80, SIZE.width, SIZE.height]] {
        assert_eq!(off(&found, bar, moved(STEP)), 0, "the frame's own");
    }
    assert!(off(&found, [32, 16, 96, 80], moved(HALF)) <= 2);

    // A static interface in front of a moving world.
    let hudless =
        writable_texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
    let sign = [250, 10, 240, 255];
    let in_sign = |x: u32, y: u32| (48..80).contains(&x) && (32..64).contains(&y);
    for number in [0, 1] {
        textures.fill(&hudless, moved(STEP * number));
        textures.fill(&textures.color, |x, y| if in_sign(x, y) { sign } else { moved(STEP * number)(x, y) });
        let params = FrameParams { reset: number == 0, ..FrameParams::of(SIZE) };
        let with = GenerationTextures { hudless: Some(hudless.with_state()), ..of(&textures) };
        generator.generate(&with, &params).expect("generated").wait().expect("it has run");
    }
    let found = textures.generated();
    let expected = |x: u32, y: u32| if in_sign(x, y) { sign } else { moved(HALF)(x, y) };
    assert!(off(&found, INNER, expected) <= 2, "the interface stands and leaves no trail");

    // HUD-less frames in another format, with another byte order.
    let other = TextureOptions { hudless: Some(SurfaceFormat::B8G8R8A8_UNORM), ..options() };
    let mut generator = made(&gpu, &library, &other).expect("a generator");
    let wanted =
        resources::texture_desc((SIZE.width, SIZE.height), DXGI_FORMAT_B8G8R8A8_UNORM, D3D12_RESOURCE_FLAG_NONE);
    let state = D3D12_RESOURCE_STATE_COMMON;
    let turned =
        TestResource { resource: resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state };
    let pictures = GenerationTextures { hudless: Some(turned.with_state()), ..of(&textures) };
    for number in [0, 1] {
        textures.fill(&turned, |x, y| {
            let [r, g, b, a] = moved(STEP * number)(x, y);
            [b, g, r, a]
        });
        textures.fill(&textures.color, |x, y| if in_sign(x, y) { sign } else { moved(STEP * number)(x, y) });
        let params = FrameParams { reset: number == 0, ..FrameParams::of(SIZE) };
        generator.generate(&pictures, &params).expect("generated").wait().expect("it has run");
    }
    assert!(off(&textures.generated(), INNER, expected) <= 2, "in another format");
    let refused = GenerationTextures { hudless: Some(hudless.with_state()), ..of(&textures) };
    let refused = generator.generate(&refused, &FrameParams::of(SIZE)).expect_err("of the format of frames");
    assert_eq!(refused.offending_field(), Some("hudless"));

    // A lens distortion that moves everything right by 4 of 128 pixels.
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let lens = writable_texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
    textures.fill(&lens, |_, _| halves(-4.0 / SIZE.width as f32, 0.0));
    let pictures = GenerationTextures { distortion: Some(lens.with_state()), ..of(&textures) };
    let found = pair(&mut generator, &textures, &pictures, &FrameParams::of(SIZE));
    assert!(off(&found, INNER, moved(HALF + 4)) <= 2);
    // The next frames have none.
    let found = pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
    assert!(off(&found, INNER, moved(HALF)) <= 2, "no lens distortion is left");
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn high_dynamic_range_shows() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let textures = panning(&gpu);
    textures.fill(&textures.motion, |_, _| halves(0.0, 0.0));
    let mut options = options();
    options.head.flags = CreateFlags::HIGH_DYNAMIC_RANGE;
    let between = |transfer, luminance, values: [u8; 2]| {
        let mut generator = made(&gpu, &library, &options).expect("a generator");
        for (number, value) in values.into_iter().enumerate() {
            textures.fill(&textures.color, |_, _| [value, value, value, 255]);
            let params = FrameParams { reset: number == 0, transfer, luminance, ..FrameParams::of(SIZE) };
            generator.generate(&of(&textures), &params).expect("generated").wait().expect("it has run");
        }
        textures.generated()[(48 * SIZE.width + 64) as usize][0]
    };
    // Half the light of code values at 10 % and 75 % of the range: 2.4 and 983 nits in PQ; linear values in scRGB.
    let pq = between(TransferFunction::PQ, [0.0, 1000.0], [26, 191]);
    let scrgb = between(TransferFunction::SCRGB, [0.0, 1000.0], [26, 191]);
    let srgb = between(TransferFunction::SRGB, [0.0, 1000.0], [26, 191]);
    assert!(
        pq.abs_diff(173) <= 2 && scrgb.abs_diff(109) <= 1 && srgb.abs_diff(mixed(26, 191)) <= 1,
        "{pq} {scrgb} {srgb}"
    );
    // Brighter light is clamped to the display's maximum.
    let dim = between(TransferFunction::PQ, [0.0, 100.0], [26, 191]);
    assert!(dim.abs_diff(112) <= 3, "{dim}");
    // Darker light is clamped to the display's minimum: half the light of 200 and 983 nits.
    let pale = between(TransferFunction::PQ, [200.0, 1000.0], [26, 191]);
    assert!(pale.abs_diff(177) <= 2, "{pale}");
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn a_target_that_shaders_cannot_write_and_textures_in_any_state_are_left_as_they_were() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let textures = panning(&gpu);
    let wanted = resources::texture_desc(
        (SIZE.width, SIZE.height),
        DXGI_FORMAT_R8G8B8A8_UNORM,
        D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET,
    );
    for state in [D3D12_RESOURCE_STATE_PRESENT, D3D12_RESOURCE_STATE_RENDER_TARGET, D3D12_RESOURCE_STATE_COPY_SOURCE] {
        let target =
            TestResource { resource: resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state };
        let pictures = GenerationTextures { output: target.with_state(), ..of(&textures) };
        pair(&mut generator, &textures, &pictures, &FrameParams::of(SIZE));
        // Read in the state that it was given with.
        let found = textures.pixels(&target);
        assert!(off(&found, INNER, moved(HALF)) <= 2, "{state:?}");
    }
    let depth = writable_texture(
        &gpu,
        (SIZE.width, SIZE.height),
        DXGI_FORMAT_R32_FLOAT,
        D3D12_RESOURCE_STATE_ALL_SHADER_RESOURCE,
    );
    textures.fill(&depth, |_, _| 0.5_f32.to_le_bytes());
    let pictures = GenerationTextures { depth: depth.with_state(), ..of(&textures) };
    let found = pair(&mut generator, &textures, &pictures, &FrameParams::of(SIZE));
    assert!(off(&found, INNER, moved(HALF)) <= 2);
    // The library copies the picture, so its barriers begin with the state that it was told.
    let color = writable_texture(
        &gpu,
        (SIZE.width, SIZE.height),
        DXGI_FORMAT_R8G8B8A8_UNORM,
        D3D12_RESOURCE_STATE_ALL_SHADER_RESOURCE,
    );
    let pictures = GenerationTextures { color: color.with_state(), ..of(&textures) };
    for number in [0, 1] {
        textures.fill(&color, moved(STEP * number));
        let params = FrameParams { reset: number == 0, ..FrameParams::of(SIZE) };
        generator.generate(&pictures, &params).expect("generated").wait().expect("it has run");
    }
    assert!(off(&textures.generated(), INNER, moved(HALF)) <= 2);
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn frames_run_in_an_engine_s_list_and_on_a_compute_queue() {
    let (double, library) = set_up_double(&[]);
    let engine = Engine::create();
    for (queue, is_compute) in [(&engine.direct, false), (&engine.compute, true)] {
        let gpu = Gpu::of_engine(&engine.device, queue, None).expect("a device");
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        let found = pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        assert!(off(&found, INNER, moved(HALF)) <= 2, "compute: {is_compute}");
        // The same in an engine's list, with the previous frame as history.
        // SAFETY: values only.
        let fence: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
        let until = FencePoint::of_engine(&gpu, &fence, 1).expect("its own");
        textures.fill(&textures.color, moved(2 * STEP));
        run_list(&gpu, |list| {
            generator.record(list, &until, &of(&textures), &FrameParams::of(SIZE)).expect("recorded")
        });
        // SAFETY: a live fence.
        unsafe { fence.Signal(1) }.expect("a signal");
        assert!(off(&textures.generated(), INNER, moved(STEP + HALF)) <= 2, "compute: {is_compute}");
    }
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn at_most_three_frames_are_in_flight() {
    let (double, library) = set_up_double(&["slow 200"]);
    let gpu = gpu();
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let textures = panning(&gpu);
    textures.fill(&textures.color, moved(0));
    // SAFETY: values only.
    let fence: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    let gate = FencePoint::of_engine(&gpu, &fence, 1).expect("its own");
    gpu.frames().wait(&gate).expect("it waits");
    let mut fence_points = Vec::new();
    for _ in 0..3 {
        fence_points.push(generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated"));
    }
    assert!(fence_points.iter().all(|fence_point| !fence_point.reached()));
    std::thread::scope(|scope| {
        let opener = scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(300));
            // SAFETY: a live fence.
            unsafe { fence.Signal(1) }.expect("a signal");
        });
        // Waits until the first frame has run.
        let fourth = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated");
        assert!(fence_points[0].reached());
        opener.join().expect("no panic");
        fourth.wait().expect("it has run");
    });
    // Dropped while a frame is in flight: the drop waits for it, and the frame's resources are held.
    _ = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated");
    drop(textures);
    drop(generator);
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn the_self_test_rejects_providers_with_wrong_frames() {
    let gpu = gpu();
    let tested = TextureOptions { self_test: true, ..options() };
    for (plays, why) in [
        ("plays through", "passes frames through"),
        ("plays black", "it is black"),
        ("plays backwards", "the sign is wrong"),
        ("plays upside-down", "against vertical motion"),
        ("plays farthest", "the order of depths is wrong"),
    ] {
        let (double, library) = set_up_double(&[plays]);
        let refused = made(&gpu, &library, &tested).expect_err(plays);
        assert_eq!(
            (refused.kind(), refused.offending_field()),
            (ErrorKind::Unsupported, Some("provider")),
            "{refused}"
        );
        assert!(refused.cause().contains(why), "{plays}: {refused}");
        // Without the self-test the provider is accepted.
        assert!(made(&gpu, &library, &options()).is_ok());
        assert_eq!(double.violations(), [""; 0]);
    }
    // A correct provider has no history after the test.
    for format in [SurfaceFormat::R8G8B8A8_UNORM, SurfaceFormat::R16G16B16A16_FLOAT, SurfaceFormat::R10G10B10A2_UNORM] {
        let (double, library) = set_up_double(&[]);
        let mut tested = tested;
        tested.head.back_buffer_format = format;
        let mut generator = made(&gpu, &library, &tested).expect("a generator");
        assert!(generator.refused().is_empty());
        if format == SurfaceFormat::R8G8B8A8_UNORM {
            let textures = panning(&gpu);
            textures.fill(&textures.color, moved(0));
            generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated").wait().expect("it has run");
            assert_eq!(
                off(&textures.generated(), [0, 0, SIZE.width, SIZE.height], moved(0)),
                0,
                "there is none before"
            );
        }
        drop(generator);
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn another_provider_is_used_if_one_fails_the_self_test_unless_it_is_required() {
    let gpu = gpu();
    let tested = TextureOptions { self_test: true, ..options() };
    let (double, library) = set_up_double(&[ANALYTIC, "plays through", "only 4.0.1"]);
    for choice in [Choice::Any, Choice::Prefer(Family::Ml)] {
        let generator = made(&gpu, &library, &TextureOptions { choice, ..tested }).expect("a generator");
        assert_eq!(generator.provider().version.name, "3.1.6");
        let [(version, why)] = generator.refused() else { panic!("{:?}", generator.refused()) };
        assert!(version.name == "4.0.1" && why.cause().contains("passes frames through"), "{why}");
    }
    let required = TextureOptions { choice: Choice::Require(Family::Ml), ..tested };
    assert!(made(&gpu, &library, &required).is_err());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn pass_through_is_detected_if_enabled() {
    let gpu = gpu();
    for (plays, expected) in [
        ("slow 0", GenerationCheck::Generated),
        ("plays through", GenerationCheck::PassedThrough),
        ("plays black", GenerationCheck::Black),
    ] {
        let (double, library) = set_up_double(&[plays]);
        let mut generator =
            made(&gpu, &library, &TextureOptions { detect_pass_through: true, ..options() }).expect("a generator");
        assert_eq!(generator.last_check(), None);
        let textures = panning(&gpu);
        pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        assert_eq!(generator.last_check(), Some(expected), "{plays}");
        // Without motion the check is undecided.
        textures.fill(&textures.motion, |_, _| halves(0.0, 0.0));
        pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        assert_eq!(generator.last_check(), Some(GenerationCheck::Unknown));
        assert_eq!(double.violations(), [""; 0]);
    }
    // A provider that detects a cut returns input frames for a while; this is detected, and ends.
    let (double, library) = set_up_double(&["cuts 3"]);
    let mut generator =
        made(&gpu, &library, &TextureOptions { detect_pass_through: true, ..options() }).expect("a generator");
    let textures = panning(&gpu);
    for number in 0..8 {
        textures.fill(&textures.color, moved(STEP * number));
        generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated").wait().expect("it has run");
        let is_cut = (2..6).contains(&number);
        let expected = if is_cut { GenerationCheck::PassedThrough } else { GenerationCheck::Generated };
        assert_eq!(generator.last_check(), (number > 0).then_some(expected), "frame {number}");
        let place = if is_cut { STEP * number } else { STEP * number - HALF };
        assert!(number == 0 || off(&textures.generated(), INNER, moved(place)) <= 2, "frame {number}");
    }
    assert_eq!(double.violations(), [""; 0]);
    // Without the watch there is no result.
    let (_, library) = set_up_double(&["plays through"]);
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let textures = panning(&gpu);
    pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
    assert_eq!(generator.last_check(), None);
}

#[test]
fn a_removed_device_is_reported_and_nothing_hangs() {
    double_folder::in_new_process("a_removed_device_is_reported_and_nothing_hangs", || {
        let (double, library) = set_up_double(&["removes 2"]);
        let gpu = gpu();
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        textures.fill(&textures.color, moved(0));
        generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated").wait().expect("it has run");
        for _ in 0..2 {
            let gone = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect_err("it is gone");
            assert_eq!(gone.kind(), ErrorKind::DeviceRemoved, "{gone}");
        }
        drop(generator);
        assert_eq!(double.violations(), [""; 0], "a frame that was recorded and never runs is not waited for");
    });
}

#[test]
fn invalid_inputs_are_refused_with_the_field_s_name() {
    let (double, library) = set_up_double(&[]);
    let (gpu, other) = (gpu(), self::gpu());
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let (textures, foreign) = (panning(&gpu), panning(&other));
    let small = Textures::new(&gpu, Dimensions { width: 64, height: 96 });
    let pictures = of(&textures);
    let deep =
        writable_texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R16G16B16A16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
    // As engines make a depth buffer that no shader reads.
    let flags = D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL | D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE;
    let unreadable = texture_desc((SIZE.width, SIZE.height), DXGI_FORMAT_D32_FLOAT, flags);
    let state = D3D12_RESOURCE_STATE_DEPTH_WRITE;
    let resource = resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &unreadable, state);
    let unreadable = TestResource { resource, state };
    for (invalid, field) in [
        (GenerationTextures { depth: unreadable.with_state(), ..pictures }, "depth"),
        (GenerationTextures { color: foreign.color.with_state(), ..pictures }, "color"),
        (GenerationTextures { output: small.output.with_state(), ..pictures }, "output"),
        (GenerationTextures { output: deep.with_state(), ..pictures }, "output"),
        (GenerationTextures { depth: small.depth.with_state(), ..pictures }, "depth"),
        (GenerationTextures { motion: small.motion.with_state(), ..pictures }, "motion"),
        (GenerationTextures { motion: textures.depth.with_state(), ..pictures }, "motion"),
        (GenerationTextures { hudless: Some(deep.with_state()), ..pictures }, "hudless"),
        (GenerationTextures { hudless: Some(foreign.color.with_state()), ..pictures }, "hudless"),
        (GenerationTextures { distortion: Some(small.motion.with_state()), ..pictures }, "distortion"),
        (GenerationTextures { output: pictures.color, ..pictures }, "output"),
        (
            GenerationTextures {
                hudless: Some(ResourceWithState { state: D3D12_RESOURCE_STATE_COMMON, ..pictures.color }),
                ..pictures
            },
            "state",
        ),
    ] {
        let refused = generator.generate(&invalid, &FrameParams::of(SIZE)).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)), "{refused}");
    }
    let refused =
        generator.generate(&pictures, &FrameParams { frame_time: -1.0, ..FrameParams::of(SIZE) }).expect_err("time");
    assert_eq!(refused.offending_field(), Some("frame_time"));
    // An engine's list stays empty.
    // SAFETY: values only.
    let fence: ID3D12Fence = unsafe { gpu.device().CreateFence(1, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    let until = FencePoint::of_engine(&gpu, &fence, 1).expect("its own");
    let valid = FrameParams::of(SIZE);
    let outside = Rect { left: 1, top: 0, width: SIZE.width.cast_signed(), height: SIZE.height.cast_signed() };
    for (params, field) in [
        (FrameParams { frame_time: -1.0, ..valid }, "frame_time"),
        (FrameParams { rect: outside, ..valid }, "rect"),
        (FrameParams { motion_scale: Coordinates { x: f32::NAN, y: 1.0 }, ..valid }, "motion_scale"),
    ] {
        run_list(&gpu, |list| {
            let mut refused = None;
            let calls = count_list_calls(list, || refused = generator.record(list, &until, &pictures, &params).err());
            assert_eq!((refused.expect(field).offending_field(), calls), (Some(field), 0));
        });
    }
    run_list(&gpu, |list| {
        let mut recorded = Ok(());
        let calls = count_list_calls(list, || recorded = generator.record(list, &until, &pictures, &valid));
        recorded.expect("recorded");
        assert!(calls > 0, "a frame that is not refused is recorded");
    });
    // The failures above left the generator usable.
    let found = pair(&mut generator, &textures, &pictures, &FrameParams::of(SIZE));
    assert!(off(&found, INNER, moved(HALF)) <= 2);
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}
