//! The compute shader generator, compared with the processor's. On Windows, or in the lab.
#![cfg(windows)]

use std::ops::Range;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::shader::{DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair, WORD_OF_UNCOVERED};
use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::gpu::Gpu;
use cairn::gpu::compute::{CommandRecorder, CommandRing, FRAMES_IN_FLIGHT, ResourceWithState};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::Guidance;
use cairn::{ErrorKind, Picture, Raster};
use gpu_testing::comparison::{ComparablePixel, DeviceGuidance, raster, target};
use half::f16;
use test_support::allocations::{CountingAllocator, allocations};
use test_support::d3d12::resources::{TestResource, read_texture, read_words, run_list, upload_texture};
use test_support::frame_cases::{self, Random};

mod colours;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Compares frames of random cases with the processor's.
fn compare<P: ComparablePixel>(cases: Range<u64>)
where
    CpuGenerator: FrameGenerator<P>,
{
    let compared = gpu_testing::generator::compare::<P>(&Gpu::on_adapter(None).expect("a device"), cases);
    println!("{compared:?}");
    assert!(compared.is_within_tolerance(), "{compared:?}");
}

#[test]
fn frames_in_bytes_equal_the_processors() {
    compare::<[u8; 4]>(0..70);
}

#[test]
fn frames_in_half_floats_equal_the_processors() {
    compare::<[f16; 4]>(0..26);
}

const SIZE: (u32, u32) = (96, 64);

/// A pair of anchors on the device, and the processor's frame of it.
struct Scene {
    guided: DeviceGuidance,
    guidance: Guidance,
    levels: [Vec<[f32; 4]>; 2],
}

impl Scene {
    /// A random case whose two pictures are not a cut.
    fn new(gpu: &Gpu) -> Self {
        let mut random = Random(17);
        let guidance = frame_cases::guidance(&mut random, SIZE);
        Self { guided: DeviceGuidance::new(gpu, &guidance), guidance, levels: frame_cases::pictures(&mut random, SIZE) }
    }

    /// The processor's frame at `t`.
    fn processor_frame<P: ComparablePixel>(&self, t: f32, pixel: impl Fn([f32; 4]) -> P) -> Raster<P>
    where
        CpuGenerator: FrameGenerator<P>,
    {
        let [previous, current] = self.levels.each_ref().map(|levels| {
            let mut picture = Raster::<P>::new(SIZE.0, SIZE.1).expect("a picture");
            picture.pixels_mut().iter_mut().zip(levels).for_each(|(to, levels)| *to = pixel(*levels));
            picture
        });
        let pair = AnchorPair::new(&previous, &current, &self.guidance).expect("a pair");
        let mut wanted = previous.clone();
        let report = FrameGenerator::<P>::generate(&mut CpuGenerator::new(), &pair, t, &mut wanted).expect("a frame");
        assert_eq!(report.outcome, Outcome::Generated);
        wanted
    }

    /// Both anchors in a format of `N` bytes per pixel.
    fn anchors<const N: usize>(
        &self,
        gpu: &Gpu,
        format: DXGI_FORMAT,
        pixel: impl Fn([f32; 4]) -> [u8; N],
    ) -> [TestResource; 2] {
        self.levels.each_ref().map(|levels| {
            let bytes: Vec<u8> = levels.iter().flat_map(|levels| pixel(*levels)).collect();
            upload_texture(gpu, SIZE, format, &bytes)
        })
    }

    fn pair<'a>(&'a self, [previous, current]: &'a [TestResource; 2]) -> TexturePair<'a> {
        TexturePair {
            previous: previous.with_state(),
            current: current.with_state(),
            guidance: self.guided.textures(),
            previous_depth: None,
            cut: false,
        }
    }
}

/// Generates a frame, and reads it back in rows with the given bytes per pixel.
fn generated(
    gpu: &Gpu,
    generator: &mut ShaderGenerator,
    pair: &TexturePair<'_>,
    t: f32,
    target: &TestResource,
    bytes: usize,
) -> Vec<u8> {
    let mut frames = CommandRing::new(gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    generator.generate(&mut frame, pair, t, &target.with_state()).expect("it is recorded");
    frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
    read_texture(gpu, target, SIZE.0 as usize * bytes)
}

fn bytes_of_levels(levels: [f32; 4]) -> [u8; 4] {
    ComparablePixel::from_levels(levels)
}

#[test]
fn the_nearer_anchor_is_shown_across_a_cut() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut scene = Scene::new(&gpu);
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    for is_stated in [true, false] {
        if !is_stated {
            // An unrelated picture, which the processor reports as a cut.
            let mut noise = Random(3);
            scene.levels[1].iter_mut().for_each(|levels| {
                *levels = [
                    255.0 * noise.signed_unit().abs(),
                    255.0 * noise.signed_unit().abs(),
                    255.0 * noise.signed_unit().abs(),
                    255.0,
                ];
            });
        }
        let [previous, current] = scene.levels.each_ref().map(|levels| raster::<[u8; 4]>(SIZE, levels));
        let pair = AnchorPair::new(&previous, &current, &scene.guidance).expect("a pair").with_cut(is_stated);
        let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
        let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
        for (t, nearer) in [(0.3, &previous), (0.499_99, &previous), (0.5, &current), (0.9, &current)] {
            let mut wanted = previous.clone();
            let report = FrameGenerator::generate(&mut CpuGenerator::new(), &pair, t, &mut wanted).expect("a frame");
            assert_eq!(report.outcome, Outcome::CutFallback);
            let textures = TexturePair { cut: is_stated, ..scene.pair(&anchors) };
            let found = generated(&gpu, &mut generator, &textures, t, &out, 4);
            assert!(found == nearer.rgba() && wanted == *nearer, "t = {t}, stated: {is_stated}");
        }
        let (guided, last) = (scene.guided.textures(), anchors[1].with_state());
        let mut frame = frames.begin().expect("a frame");
        generator.extrapolate(&mut frame, &last, &guided, true, 0.5, &out.with_state()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        assert!(read_texture(&gpu, &out, SIZE.0 as usize * 4) == current.rgba(), "a picture after a cut is held");
    }
}

#[test]
fn pixels_in_the_overlay_mask_are_static() {
    const COLOUR: [f32; 4] = [255.0, 0.0, 255.0, 255.0];
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let is_hud = |i: usize| (30..57).contains(&(i % SIZE.0 as usize)) && (20..31).contains(&(i / SIZE.0 as usize));
    // A ground without the overlay's colour, moving by twelve pixels, with motion vectors that ignore the overlay.
    let ground = |x: usize, y: usize| [(x * 37 + y * 101) % 200, (x * 59 + y * 23) % 120 + 80, (x * y + x) % 180];
    let levels = [0, 12].map(|shift| {
        let pixel = |i: usize| {
            let [r, g, b] = ground(i % SIZE.0 as usize + 12 - shift, i / SIZE.0 as usize).map(|v| v as f32);
            if is_hud(i) { COLOUR } else { [r, g, b, 255.0] }
        };
        (0..(SIZE.0 * SIZE.1) as usize).map(pixel).collect::<Vec<_>>()
    });
    let mut guidance = Guidance::new(SIZE.0, SIZE.1, cairn::guidance::paper::PROJECTION).expect("a guidance");
    guidance.motion_mut().vectors_mut().fill([f16::from_f32(-12.0), f16::ZERO]);
    guidance.depth_mut().depth_mut().fill(0.5);
    let scene = Scene { guided: DeviceGuidance::new(&gpu, &guidance), guidance, levels };
    let mask: Vec<u8> = (0..(SIZE.0 * SIZE.1) as usize).map(|i| u8::from(is_hud(i))).collect();
    let mask = upload_texture(&gpu, SIZE, DXGI_FORMAT_R8_UNORM, &mask);
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let guidance_textures = GuidanceTextures { hud: Some(mask.with_state()), ..scene.guided.textures() };
    for t in [0.25, 0.5, 0.75] {
        let pair = TexturePair { guidance: guidance_textures, ..scene.pair(&anchors) };
        let found = generated(&gpu, &mut generator, &pair, t, &out, 4);
        let wrong = found.chunks(4).enumerate().filter(|&(i, pixel)| is_hud(i) != (pixel == bytes_of_levels(COLOUR)));
        assert_eq!(wrong.count(), 0, "t = {t}");
        let shift = (12.0 * t) as usize;
        let moved = found.chunks(4).enumerate().filter(|&(i, pixel)| {
            let [r, g, b] = ground(i % SIZE.0 as usize + 12 - shift, i / SIZE.0 as usize).map(|v| v as u8);
            !is_hud(i) && pixel != [r, g, b, 255]
        });
        // Pixels that the overlay hides in one anchor come from the other.
        assert_eq!(moved.count(), 0, "t = {t}");
    }
}

#[test]
fn frames_follow_each_other_in_an_engines_list_and_allocate_nothing() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
    let pair = scene.pair(&anchors);
    let phases = [0.25, 0.5, 0.75];
    const { assert!(FRAMES_IN_FLIGHT == 3) };
    let targets = phases.map(|_| target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM));
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let done = gpu.frames().signal().expect("a fence point");
    let mut allocated = 0;
    for _ in 0..2 {
        run_list(&gpu, |list| {
            let before = allocations();
            for (t, target) in phases.iter().zip(&targets) {
                let mut frame = frames.begin_in(list, &done).expect("a frame");
                generator.generate(&mut frame, &pair, *t, &target.with_state()).expect("it is recorded");
            }
            allocated = allocations() - before;
        });
    }
    assert_eq!(allocated, 0);
    for (t, target) in phases.iter().zip(&targets) {
        let wanted: Picture = scene.processor_frame(*t, bytes_of_levels);
        assert!(read_texture(&gpu, target, SIZE.0 as usize * 4) == wanted.rgba(), "t = {t}");
    }

    // A compute queue works too, given states that it supports.
    let mut frames = CommandRing::new(&gpu, gpu.anchors(), DESCRIPTORS).expect("a ring");
    let out = upload_texture(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, &[0; 4 * (SIZE.0 * SIZE.1) as usize]);
    let mut frame = frames.begin().expect("a frame");
    let refused = generator.generate(&mut frame, &pair, 0.5, &targets[0].with_state()).expect_err("a render target");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("state")));
    generator.generate(&mut frame, &pair, 0.5, &out.with_state()).expect("it is recorded");
    frame.submit(gpu.anchors()).expect("a submission").wait().expect("it is done");
    let wanted: Picture = scene.processor_frame(0.5, bytes_of_levels);
    assert!(read_texture(&gpu, &out, SIZE.0 as usize * 4) == wanted.rgba(), "on a compute queue");
}

#[test]
fn frames_of_a_prepared_pair_equal_single_frames() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut single = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS / 2).expect("a ring");
    let (mut uncovered, out) = (0, target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM));
    for seed in 0..8 {
        let mut random = Random(seed);
        let guidance = frame_cases::guidance(&mut random, SIZE);
        let scene = Scene {
            guided: DeviceGuidance::new(&gpu, &guidance),
            levels: frame_cases::pictures(&mut random, SIZE),
            guidance,
        };
        let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
        let pair = scene.pair(&anchors);
        let mut frame = frames.begin().expect("a frame");
        generator.prepare(&mut frame, &pair).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission");
        for t in [0.75, 0.25, 0.5, 0.25] {
            let mut frame = frames.begin().expect("a frame");
            generator.interpolate(&mut frame, &pair, t, &out.with_state()).expect("it is recorded");
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
            let found = read_texture(&gpu, &out, SIZE.0 as usize * 4);
            let report: [u32; 32] = read_words(&gpu, &generator.report());
            assert!(found == generated(&gpu, &mut single, &pair, t, &out, 4), "case {seed}, t = {t}");
            assert_eq!(report, read_words(&gpu, &single.report()), "case {seed}, t = {t}");
            uncovered += report[WORD_OF_UNCOVERED as usize];
        }
    }
    assert!(uncovered > 0, "some pixels are uncovered");
}

#[test]
fn only_the_last_prepared_pair_can_be_interpolated() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 4 * DESCRIPTORS).expect("a ring");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let pair = scene.pair(&anchors);
    let turned = TexturePair { previous: pair.current, current: pair.previous, ..pair };
    let mut frame = frames.begin().expect("a frame");
    let refused = |generator: &mut ShaderGenerator, frame: &mut CommandRecorder<'_>, pair: &TexturePair<'_>| {
        let refused = generator.interpolate(frame, pair, 0.5, &out.with_state()).expect_err("another is prepared");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("pair")));
    };
    refused(&mut generator, &mut frame, &pair);
    generator.prepare(&mut frame, &pair).expect("it is recorded");
    refused(&mut generator, &mut frame, &turned);
    refused(&mut generator, &mut frame, &TexturePair { cut: true, ..pair });
    generator.interpolate(&mut frame, &pair, 0.5, &out.with_state()).expect("it is recorded");
    let (guided, last) = (&pair.guidance, &pair.current);
    generator.extrapolate(&mut frame, last, guided, false, 0.5, &out.with_state()).expect("it is recorded");
    refused(&mut generator, &mut frame, &pair);
    generator.generate(&mut frame, &turned, 0.5, &out.with_state()).expect("it is recorded");
    refused(&mut generator, &mut frame, &pair);
}

#[test]
fn invalid_arguments_are_refused_by_name() {
    let (gpu, other) = (Gpu::on_adapter(None).expect("a device"), Gpu::on_adapter(None).expect("a device"));
    for size in [(0, 8), (8, 0), (16_385, 1)] {
        let refused = ShaderGenerator::new(&gpu, size).expect_err("no size of pictures");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("size")));
    }
    let refused = ShaderGenerator::new(&gpu, (16_384, 16_384)).expect_err("larger than a buffer");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("size")));

    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 4 * DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of_levels);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let good = scene.pair(&anchors);
    let rgba = DXGI_FORMAT_R8G8B8A8_UNORM;
    let kept = [
        target(&gpu, (SIZE.0, 63), rgba),
        target(&gpu, SIZE, DXGI_FORMAT_R32_FLOAT),
        target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB),
        target(&gpu, SIZE, DXGI_FORMAT_B8G8R8A8_UNORM),
        target(&other, SIZE, rgba),
    ];
    let [small, grey, srgb, bgra, foreign] = kept.each_ref().map(TestResource::with_state);
    let elsewhere = ResourceWithState { state: D3D12_RESOURCE_STATE_COPY_DEST, ..good.previous };
    let tiled = GuidanceTextures { motion_tile: 4, ..good.guidance };
    let hidden = GuidanceTextures { hud: Some(grey), ..good.guidance };
    let guided_by_grey = GuidanceTextures { motion: grey, ..good.guidance };
    let cases: [(TexturePair<'_>, f32, ResourceWithState<'_>, &str); 15] = [
        (good, 0.0, out.with_state(), "t"),
        (good, 1.0, out.with_state(), "t"),
        (good, f32::NAN, out.with_state(), "t"),
        (good, 0.5, small, "target"),
        (good, 0.5, grey, "target"),
        (good, 0.5, foreign, "target"),
        (TexturePair { previous: small, ..good }, 0.5, out.with_state(), "previous"),
        (TexturePair { previous: bgra, ..good }, 0.5, out.with_state(), "previous"),
        (TexturePair { current: srgb, ..good }, 0.5, out.with_state(), "previous"),
        (TexturePair { current: foreign, ..good }, 0.5, out.with_state(), "current"),
        (TexturePair { guidance: tiled, ..good }, 0.5, out.with_state(), "motion"),
        (TexturePair { guidance: guided_by_grey, ..good }, 0.5, out.with_state(), "motion"),
        (TexturePair { guidance: hidden, ..good }, 0.5, out.with_state(), "hud"),
        (TexturePair { previous_depth: Some((small, 1)), ..good }, 0.5, out.with_state(), "previous_depth"),
        (good, 0.5, elsewhere, "state"),
    ];
    for (i, (pair, t, target, field)) in cases.iter().enumerate() {
        let refused = generator.generate(&mut frame, pair, *t, target).expect_err("invalid arguments");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(*field)), "{i}");
    }
    for t in [0.0, -1.0, f32::INFINITY, f32::NAN] {
        let refused = generator
            .extrapolate(&mut frame, &good.current, &good.guidance, false, t, &out.with_state())
            .expect_err("no time");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("t")));
    }
    drop(frame);
    let mut short = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS - 1).expect("a ring");
    let mut frame = short.begin().expect("a frame");
    let refused = generator.generate(&mut frame, &good, 0.5, &out.with_state()).expect_err("too few descriptors");
    assert_eq!(refused.kind(), ErrorKind::Unsupported);
}
