//! The compute shader generator, compared with the processor's. On Windows, or in the lab.
#![cfg(windows)]

use std::collections::HashMap;
use std::ops::Range;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::shader::{
    DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair, WORD_OF_CUT, WORD_OF_UNCOVERED, WORD_OF_UNEXPLAINED,
};
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome};
use cairn::gpu::Gpu;
use cairn::gpu::compute::{CommandRecorder, CommandRing, FRAMES_IN_FLIGHT, ResourceWithState, Transfer};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::Guidance;
use cairn::{ErrorKind, Picture, PictureF16, Raster};
use half::f16;

#[path = "d3d12/allocations.rs"]
mod allocations;
#[path = "support/frame_cases.rs"]
mod cases;
#[path = "d3d12/compared.rs"]
mod compared;
#[path = "d3d12/hazards.rs"]
mod hazards;
#[path = "d3d12/pictures.rs"]
mod pictures;
#[path = "d3d12/tables.rs"]
mod tables;
use allocations::ALLOCATIONS;
use cases::Dice;
use compared::{Compared, Guided, Tally, depth_texture, raster, target, textured};
use pictures::{Kept, filled, read, run, words};

/// Compares the device's report of a frame with the processor's.
fn assert_reported(gpu: &Gpu, generator: &ShaderGenerator, wanted: &GenerateReport, size: (u32, u32), what: &str) {
    let words: [u32; 32] = words(gpu, &generator.report());
    let of = |word: u32| words[word as usize];
    assert_eq!(of(WORD_OF_CUT) == 1, wanted.outcome == Outcome::CutFallback, "{what}");
    let uncovered = of(WORD_OF_UNCOVERED) as f32 / (size.0 * size.1) as f32;
    let unexplained = f32::from_bits(of(WORD_OF_UNEXPLAINED));
    assert!((uncovered - wanted.uncovered).abs() <= 1e-3, "{what}: {uncovered} for {wanted:?}");
    assert!((unexplained - wanted.unexplained).abs() <= 1e-6, "{what}: {unexplained} for {wanted:?}");
}

/// Compares random cases with the processor's generator.
fn compare<P: Compared>(cases: Range<u64>)
where
    CpuGenerator: FrameGenerator<P>,
{
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut cpu = CpuGenerator::new();
    let (mut between, mut beyond, mut cuts) = (Tally::default(), Tally::default(), 0);
    let mut generators = HashMap::new();
    for seed in cases {
        let mut dice = Dice(seed);
        let sizes = [(1, 1), (1, 40), (40, 1), (8, 8), (16, 24), (33, 17), (64, 40), (95, 70), (130, 81)];
        let size = sizes[dice.below(sizes.len() as u64) as usize];
        let guidance = cases::guidance(&mut dice, size);
        let [previous, current] = cases::pictures(&mut dice, size).map(|levels| raster::<P>(size, &levels));
        let t = [0.5, 1.0 / 3.0, 0.25, 0.75, f32::MIN_POSITIVE, 1.0 - f32::EPSILON, 0.1, 0.9][dice.below(8) as usize];
        let depth = cases::previous_depth(&mut dice, guidance.depth());
        let has_depth = dice.below(3) != 0;
        let mut pair = AnchorPair::new(&previous, &current, &guidance).expect("a pair");
        if has_depth {
            pair = pair.with_previous_depth(&depth).expect("a depth");
        }
        let mut anchor = Anchor::new(&current, &guidance).expect("an anchor");
        let mask = cases::overlay(&mut dice, size);
        let hud = (dice.below(2) == 0).then(|| filled(&gpu, size, DXGI_FORMAT_R8_UNORM, &mask));
        if hud.is_some() {
            pair = pair.with_overlay(&mask).expect("a mask");
            anchor = anchor.with_overlay(&mask).expect("a mask");
        }
        let mut wanted = previous.clone();
        let report = FrameGenerator::<P>::generate(&mut cpu, &pair, t, &mut wanted).expect("a frame");
        cuts += usize::from(report.outcome == Outcome::CutFallback);

        let generator =
            generators.entry(size).or_insert_with(|| ShaderGenerator::new(&gpu, size).expect("a generator"));
        let (before, after, guided) =
            (textured(&gpu, &previous), textured(&gpu, &current), Guided::new(&gpu, &guidance));
        let depth = depth_texture(&gpu, &depth);
        let told = GuidanceTextures { hud: hud.as_ref().map(Kept::resting), ..guided.textures() };
        let textures = TexturePair {
            previous: before.resting(),
            current: after.resting(),
            guidance: told,
            previous_depth: has_depth.then(|| (depth.resting(), guidance.depth().tile())),
            cut: false,
        };
        let out = target(&gpu, size, P::FORMAT);
        let mut frame = frames.begin().expect("a frame");
        generator.generate(&mut frame, &textures, t, &out.resting()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        let row = size.0 as usize * size_of::<P>();
        let what = format!("case {seed}, {size:?}, t = {t}, {:?}", report.outcome);
        between.compare(&read(&gpu, &out, row), &wanted, &what);
        assert_reported(&gpu, generator, &report, size, &what);

        let report = FrameGenerator::<P>::extrapolate(&mut cpu, &anchor, t, &mut wanted).expect("a frame");
        let mut frame = frames.begin().expect("a frame");
        generator.extrapolate(&mut frame, &after.resting(), &told, false, t, &out.resting()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        beyond.compare(&read(&gpu, &out, row), &wanted, &format!("case {seed}, {size:?}, t = {t}, beyond"));
        assert_reported(&gpu, generator, &report, size, &format!("case {seed}, beyond"));
    }
    println!("between {between:?}, {cuts} cuts; beyond {beyond:?}");
    for tally in [between, beyond] {
        // A tenth of the documented tolerance: only the device's division may differ.
        assert!(10_000 * tally.far <= tally.pixels, "{tally:?}");
    }
}

#[test]
fn no_dispatch_uses_what_an_earlier_one_may_still_write() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let (mut generator, scene) = (ShaderGenerator::new(&gpu, SIZE).expect("a generator"), Scene::new(&gpu));
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let checker = hazards::checked(gpu.device(), || {
        generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &out, 4);
        let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
        let mut frame = frames.begin().expect("a frame");
        let (current, guidance) = (anchors[1].resting(), scene.guided.textures());
        generator.extrapolate(&mut frame, &current, &guidance, false, 0.3, &out.resting()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
    });
    assert_eq!(checker.faults, [""; 0]);
    assert!(checker.dispatches > 30, "{}", checker.dispatches);
}

#[test]
fn frames_of_bytes_are_those_of_the_processor() {
    compare::<[u8; 4]>(0..70);
}

#[test]
fn frames_of_half_floats_are_those_of_the_processor() {
    compare::<[f16; 4]>(0..26);
}

const SIZE: (u32, u32) = (96, 64);

/// A pair of anchors on the device, and the processor's frame of it.
struct Scene {
    guided: Guided,
    guidance: Guidance,
    levels: [Vec<[f32; 4]>; 2],
}

impl Scene {
    /// From a case whose two pictures are related.
    fn new(gpu: &Gpu) -> Self {
        let mut dice = Dice(17);
        let guidance = cases::guidance(&mut dice, SIZE);
        Self { guided: Guided::new(gpu, &guidance), guidance, levels: cases::pictures(&mut dice, SIZE) }
    }

    fn made_by_the_processor<P: Compared>(&self, t: f32, pixel: impl Fn([f32; 4]) -> P) -> Raster<P>
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
    ) -> [Kept; 2] {
        self.levels.each_ref().map(|levels| {
            let bytes: Vec<u8> = levels.iter().flat_map(|levels| pixel(*levels)).collect();
            filled(gpu, SIZE, format, &bytes)
        })
    }

    fn pair<'a>(&'a self, [previous, current]: &'a [Kept; 2]) -> TexturePair<'a> {
        TexturePair {
            previous: previous.resting(),
            current: current.resting(),
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
    target: &Kept,
    bytes: usize,
) -> Vec<u8> {
    let mut frames = CommandRing::new(gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    generator.generate(&mut frame, pair, t, &target.resting()).expect("it is recorded");
    frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
    read(gpu, target, SIZE.0 as usize * bytes)
}

fn bytes_of(levels: [f32; 4]) -> [u8; 4] {
    Compared::from_levels(levels)
}

fn tenths_of(levels: [f32; 4]) -> [u32; 4] {
    let [r, g, b, a] = levels.map(|v| v.floor() / 255.0);
    let of = |v: f32, most: f32| (v * most + 0.5) as u32;
    [of(r, 1023.0), of(g, 1023.0), of(b, 1023.0), of(a, 3.0)]
}

#[test]
fn every_format_is_read_and_written() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let wanted: Picture = scene.made_by_the_processor(0.4, bytes_of);
    let swapped = |bytes: &[u8]| bytes.chunks(4).flat_map(|p| [p[2], p[1], p[0], p[3]]).collect::<Vec<_>>();

    let bgra_of = |levels| {
        let [r, g, b, a] = bytes_of(levels);
        [b, g, r, a]
    };
    for anchors in [
        scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_TYPELESS, bytes_of),
        scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, bytes_of),
        scene.anchors(&gpu, DXGI_FORMAT_B8G8R8A8_UNORM, bgra_of),
        scene.anchors(&gpu, DXGI_FORMAT_B8G8R8A8_UNORM_SRGB, bgra_of),
    ] {
        for (format, is_swapped) in [
            (DXGI_FORMAT_R8G8B8A8_UNORM, false),
            (DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, false),
            (DXGI_FORMAT_R8G8B8A8_TYPELESS, false),
            (DXGI_FORMAT_B8G8R8A8_UNORM, true),
            (DXGI_FORMAT_B8G8R8A8_UNORM_SRGB, true),
        ] {
            let out = target(&gpu, SIZE, format);
            let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &out, 4);
            assert_eq!(if is_swapped { swapped(&found) } else { found }, wanted.rgba(), "{format:?}");
        }
    }

    // Ten-bit values are computed as half floats, which represent them exactly.
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R10G10B10A2_UNORM, |levels| {
        let [r, g, b, a] = tenths_of(levels);
        (r | g << 10 | b << 20 | a << 30).to_le_bytes()
    });
    let wanted: PictureF16 = scene.made_by_the_processor(0.4, |levels| {
        let [r, g, b, a] = tenths_of(levels).map(|v| v as f32);
        [r / 1023.0, g / 1023.0, b / 1023.0, a / 3.0].map(f16::from_f32)
    });
    for format in [DXGI_FORMAT_R10G10B10A2_UNORM, DXGI_FORMAT_R16G16B16A16_FLOAT, DXGI_FORMAT_R8G8B8A8_UNORM] {
        let out = target(&gpu, SIZE, format);
        let size = if format == DXGI_FORMAT_R16G16B16A16_FLOAT { 8 } else { 4 };
        let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &out, size);
        let far = found.chunks(size).zip(wanted.pixels()).filter(|(found, wanted)| {
            let part = |c: usize| match format {
                DXGI_FORMAT_R10G10B10A2_UNORM => {
                    let word = u32::from_le_bytes([found[0], found[1], found[2], found[3]]);
                    (word >> (10 * c) & 1023) as f32 / 1023.0
                }
                DXGI_FORMAT_R8G8B8A8_UNORM => f32::from(found[c]) / 255.0,
                _ => f16::from_le_bytes([found[2 * c], found[2 * c + 1]]).to_f32(),
            };
            (0..3).any(|c| (part(c) - wanted[c].to_f32().clamp(0.0, 1.0)).abs() > 1.0 / 255.0)
        });
        assert!(1000 * far.count() <= wanted.pixels().len(), "{format:?}");
    }
}

/// The transfer curve of sRGB, mirrored below 0 and continued above 1.
fn shown_for(light: f64) -> f64 {
    let a = light.abs();
    (if a <= 0.0031308 { 12.92 * a } else { 1.055 * a.powf(1.0 / 2.4) - 0.055 }).copysign(light)
}

fn light_of(shown: f64) -> f64 {
    let a = shown.abs();
    (if a <= 0.04045 { a / 12.92 } else { ((a + 0.055) / 1.055).powf(2.4) }).copysign(shown)
}

#[test]
fn frames_of_light_are_those_of_what_is_shown_for_it() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut scene = Scene::new(&gpu);
    // Up to five times as bright as white, and colours outside sRGB.
    let wide = |levels: [f32; 4]| [2.2 * levels[0] - 30.0, 1.6 * levels[1], levels[2] - 20.0, 255.0];
    scene.levels.iter_mut().flatten().for_each(|levels| *levels = wide(*levels));
    let in_light = |levels: [f32; 4]| {
        let [r, g, b, a] = levels.map(|level| f64::from(level) / 255.0);
        [light_of(r), light_of(g), light_of(b), a].map(f16::from_f64)
    };
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R16G16B16A16_FLOAT, |levels| {
        let halves = in_light(levels).map(f16::to_le_bytes);
        <[u8; 8]>::try_from(halves.as_flattened()).expect("eight bytes")
    });
    let generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut generator = generator.with_transfer(Transfer::Linear);
    let shown = |held: [f16; 4]| {
        let [r, g, b, a] = held.map(f16::to_f64);
        [shown_for(r), shown_for(g), shown_for(b), a]
    };
    let wanted: PictureF16 = scene.made_by_the_processor(0.4, |levels| shown(in_light(levels)).map(f16::from_f64));
    let halves = target(&gpu, SIZE, DXGI_FORMAT_R16G16B16A16_FLOAT);
    let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &halves, 8);
    let (mut far, mut bright) = (0, 0);
    for (found, wanted) in found.chunks(8).zip(wanted.pixels()) {
        let held: [f16; 4] = std::array::from_fn(|c| f16::from_le_bytes([found[2 * c], found[2 * c + 1]]));
        let apart = |(found, wanted): (f64, &f16)| (found - wanted.to_f64()).abs() > 1.0 / 255.0;
        far += usize::from(shown(held).into_iter().zip(wanted).any(apart));
        bright += usize::from(held[0] > f16::from_f32(1.5) || held[0] < f16::ZERO);
    }
    assert!(bright > 100 && 1000 * far <= wanted.pixels().len(), "{far} of {}, {bright} bright", wanted.pixels().len());

    // An 8-bit target gets the sRGB values, clamped at white.
    let bytes = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &bytes, 4);
    let far = found.chunks(4).zip(wanted.pixels()).filter(|(found, wanted)| {
        (0..4).any(|c| (f32::from(found[c]) - 255.0 * wanted[c].to_f32().clamp(0.0, 1.0)).abs() > 1.5)
    });
    assert!(1000 * far.count() <= wanted.pixels().len());

    // A window in scRGB shows anchors in sRGB unchanged.
    let eight = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, |levels| bytes_of(levels.map(|v| v.clamp(0.0, 255.0))));
    let single = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut single = single.with_target_transfer(Transfer::Linear);
    let found = generated(&gpu, &mut single, &scene.pair(&eight), 0.4, &halves, 8);
    let shown = generated(&gpu, &mut single, &scene.pair(&eight), 0.4, &bytes, 4);
    for (light, shown) in found.chunks(2).zip(&shown).enumerate().filter(|(i, _)| i % 4 < 3).map(|(_, both)| both) {
        let (found, wanted) = (f16::from_le_bytes([light[0], light[1]]), light_of(f64::from(*shown) / 255.0));
        assert!((found.to_f64() - wanted).abs() <= 6e-4 * wanted, "{found} for {shown}");
    }

    // A static picture is unchanged, to the bit.
    let still = TexturePair { previous: anchors[1].resting(), ..scene.pair(&anchors) };
    let resting = Guidance::new(SIZE.0, SIZE.1, cairn::guidance::paper::PROJECTION).expect("a guidance");
    let resting = Guided::new(&gpu, &resting);
    let still = TexturePair { guidance: resting.textures(), ..still };
    let found = generated(&gpu, &mut generator, &still, 0.4, &halves, 8);
    assert!(found == read(&gpu, &anchors[1], SIZE.0 as usize * 8));

    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    let refused = generator.prepare(&mut frame, &scene.pair(&eight)).expect_err("bytes hold no light");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("current")));
}

#[test]
fn across_a_cut_the_nearer_anchor_is_shown() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut scene = Scene::new(&gpu);
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    for is_stated in [true, false] {
        if !is_stated {
            // An unrelated picture, which the processor reports as a cut.
            let mut noise = Dice(3);
            scene.levels[1].iter_mut().for_each(|levels| {
                *levels = [255.0 * noise.part().abs(), 255.0 * noise.part().abs(), 255.0 * noise.part().abs(), 255.0];
            });
        }
        let [previous, current] = scene.levels.each_ref().map(|levels| raster::<[u8; 4]>(SIZE, levels));
        let pair = AnchorPair::new(&previous, &current, &scene.guidance).expect("a pair").with_cut(is_stated);
        let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
        let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
        for (t, nearer) in [(0.3, &previous), (0.499_99, &previous), (0.5, &current), (0.9, &current)] {
            let mut wanted = previous.clone();
            let report = FrameGenerator::generate(&mut CpuGenerator::new(), &pair, t, &mut wanted).expect("a frame");
            assert_eq!(report.outcome, Outcome::CutFallback);
            let textures = TexturePair { cut: is_stated, ..scene.pair(&anchors) };
            let found = generated(&gpu, &mut generator, &textures, t, &out, 4);
            assert!(found == nearer.rgba() && wanted == *nearer, "t = {t}, stated: {is_stated}");
        }
        let (guided, last) = (scene.guided.textures(), anchors[1].resting());
        let mut frame = frames.begin().expect("a frame");
        generator.extrapolate(&mut frame, &last, &guided, true, 0.5, &out.resting()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        assert!(read(&gpu, &out, SIZE.0 as usize * 4) == current.rgba(), "a picture after a cut is held");
    }
}

#[test]
fn what_an_engine_says_lies_over_the_picture_stands_still() {
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
    let scene = Scene { guided: Guided::new(&gpu, &guidance), guidance, levels };
    let mask: Vec<u8> = (0..(SIZE.0 * SIZE.1) as usize).map(|i| u8::from(is_hud(i))).collect();
    let mask = filled(&gpu, SIZE, DXGI_FORMAT_R8_UNORM, &mask);
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let told = GuidanceTextures { hud: Some(mask.resting()), ..scene.guided.textures() };
    for t in [0.25, 0.5, 0.75] {
        let pair = TexturePair { guidance: told, ..scene.pair(&anchors) };
        let found = generated(&gpu, &mut generator, &pair, t, &out, 4);
        let wrong = found.chunks(4).enumerate().filter(|&(i, pixel)| is_hud(i) != (pixel == bytes_of(COLOUR)));
        assert_eq!(wrong.count(), 0, "t = {t}");
        let shift = (12.0 * t) as usize;
        let moved = found.chunks(4).enumerate().filter(|&(i, pixel)| {
            let [r, g, b] = ground(i % SIZE.0 as usize + 12 - shift, i / SIZE.0 as usize).map(|v| v as u8);
            !is_hud(i) && pixel != [r, g, b, 255]
        });
        // Pixels that it hides in one anchor come from the other.
        assert_eq!(moved.count(), 0, "t = {t}");
    }
}

#[test]
fn frames_follow_each_other_in_an_engines_list_and_allocate_nothing() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
    let pair = scene.pair(&anchors);
    let phases = [0.25, 0.5, 0.75];
    const { assert!(FRAMES_IN_FLIGHT == 3) };
    let targets = phases.map(|_| target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM));
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let done = gpu.frames().now().expect("a moment");
    let mut allocated = 0;
    for _ in 0..2 {
        run(&gpu, |list| {
            let before = ALLOCATIONS.get();
            for (t, target) in phases.iter().zip(&targets) {
                let mut frame = frames.begin_in(list, &done).expect("a frame");
                generator.generate(&mut frame, &pair, *t, &target.resting()).expect("it is recorded");
            }
            allocated = ALLOCATIONS.get() - before;
        });
    }
    assert_eq!(allocated, 0);
    for (t, target) in phases.iter().zip(&targets) {
        let wanted: Picture = scene.made_by_the_processor(*t, bytes_of);
        assert!(read(&gpu, target, SIZE.0 as usize * 4) == wanted.rgba(), "t = {t}");
    }

    // A compute queue works too, given states that it supports.
    let mut frames = CommandRing::new(&gpu, gpu.anchors(), DESCRIPTORS).expect("a ring");
    let out = filled(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, &[0; 4 * (SIZE.0 * SIZE.1) as usize]);
    let mut frame = frames.begin().expect("a frame");
    let refused = generator.generate(&mut frame, &pair, 0.5, &targets[0].resting()).expect_err("a render target");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("state")));
    generator.generate(&mut frame, &pair, 0.5, &out.resting()).expect("it is recorded");
    frame.submit(gpu.anchors()).expect("a submission").wait().expect("it is done");
    let wanted: Picture = scene.made_by_the_processor(0.5, bytes_of);
    assert!(read(&gpu, &out, SIZE.0 as usize * 4) == wanted.rgba(), "on a compute queue");
}

#[test]
fn frames_of_a_prepared_pair_are_those_made_each_for_itself() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut single = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS / 2).expect("a ring");
    let (mut uncovered, out) = (0, target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM));
    for seed in 0..8 {
        let mut dice = Dice(seed);
        let guidance = cases::guidance(&mut dice, SIZE);
        let scene = Scene { guided: Guided::new(&gpu, &guidance), levels: cases::pictures(&mut dice, SIZE), guidance };
        let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
        let pair = scene.pair(&anchors);
        let mut frame = frames.begin().expect("a frame");
        generator.prepare(&mut frame, &pair).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission");
        for t in [0.75, 0.25, 0.5, 0.25] {
            let mut frame = frames.begin().expect("a frame");
            generator.interpolate(&mut frame, &pair, t, &out.resting()).expect("it is recorded");
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
            let found = read(&gpu, &out, SIZE.0 as usize * 4);
            let report: [u32; 32] = words(&gpu, &generator.report());
            assert!(found == generated(&gpu, &mut single, &pair, t, &out, 4), "case {seed}, t = {t}");
            assert_eq!(report, words(&gpu, &single.report()), "case {seed}, t = {t}");
            uncovered += report[WORD_OF_UNCOVERED as usize];
        }
    }
    assert!(uncovered > 0, "something is counted");
}

#[test]
fn frames_are_made_of_the_pair_that_was_prepared_last_and_of_no_other() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 4 * DESCRIPTORS).expect("a ring");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
    let out = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let pair = scene.pair(&anchors);
    let turned = TexturePair { previous: pair.current, current: pair.previous, ..pair };
    let mut frame = frames.begin().expect("a frame");
    let refused = |generator: &mut ShaderGenerator, frame: &mut CommandRecorder<'_>, pair: &TexturePair<'_>| {
        let refused = generator.interpolate(frame, pair, 0.5, &out.resting()).expect_err("another is prepared");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("pair")));
    };
    refused(&mut generator, &mut frame, &pair);
    generator.prepare(&mut frame, &pair).expect("it is recorded");
    refused(&mut generator, &mut frame, &turned);
    refused(&mut generator, &mut frame, &TexturePair { cut: true, ..pair });
    generator.interpolate(&mut frame, &pair, 0.5, &out.resting()).expect("it is recorded");
    let (guided, last) = (&pair.guidance, &pair.current);
    generator.extrapolate(&mut frame, last, guided, false, 0.5, &out.resting()).expect("it is recorded");
    refused(&mut generator, &mut frame, &pair);
    generator.generate(&mut frame, &turned, 0.5, &out.resting()).expect("it is recorded");
    refused(&mut generator, &mut frame, &pair);
}

#[test]
fn what_cannot_be_made_is_refused_by_name() {
    let (gpu, other) = (Gpu::on_adapter(None).expect("a device"), Gpu::on_adapter(None).expect("a device"));
    for size in [(0, 8), (8, 0), (16_385, 1)] {
        let refused = ShaderGenerator::new(&gpu, size).expect_err("no size of pictures");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("size")));
    }
    let refused = ShaderGenerator::new(&gpu, (16_384, 16_384)).expect_err("beyond what buffers hold");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("size")));

    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 4 * DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, bytes_of);
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
    let [small, grey, srgb, bgra, foreign] = kept.each_ref().map(Kept::resting);
    let elsewhere = ResourceWithState { state: D3D12_RESOURCE_STATE_COPY_DEST, ..good.previous };
    let tiled = GuidanceTextures { motion_tile: 4, ..good.guidance };
    let hidden = GuidanceTextures { hud: Some(grey), ..good.guidance };
    let guided_by_grey = GuidanceTextures { motion: grey, ..good.guidance };
    let cases: [(TexturePair<'_>, f32, ResourceWithState<'_>, &str); 15] = [
        (good, 0.0, out.resting(), "t"),
        (good, 1.0, out.resting(), "t"),
        (good, f32::NAN, out.resting(), "t"),
        (good, 0.5, small, "target"),
        (good, 0.5, grey, "target"),
        (good, 0.5, foreign, "target"),
        (TexturePair { previous: small, ..good }, 0.5, out.resting(), "previous"),
        (TexturePair { previous: bgra, ..good }, 0.5, out.resting(), "previous"),
        (TexturePair { current: srgb, ..good }, 0.5, out.resting(), "previous"),
        (TexturePair { current: foreign, ..good }, 0.5, out.resting(), "current"),
        (TexturePair { guidance: tiled, ..good }, 0.5, out.resting(), "motion"),
        (TexturePair { guidance: guided_by_grey, ..good }, 0.5, out.resting(), "motion"),
        (TexturePair { guidance: hidden, ..good }, 0.5, out.resting(), "hud"),
        (TexturePair { previous_depth: Some((small, 1)), ..good }, 0.5, out.resting(), "previous_depth"),
        (good, 0.5, elsewhere, "state"),
    ];
    for (i, (pair, t, target, field)) in cases.iter().enumerate() {
        let refused = generator.generate(&mut frame, pair, *t, target).expect_err("it cannot be made");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(*field)), "{i}");
    }
    for t in [0.0, -1.0, f32::INFINITY, f32::NAN] {
        let refused = generator
            .extrapolate(&mut frame, &good.current, &good.guidance, false, t, &out.resting())
            .expect_err("no time");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("t")));
    }
    drop(frame);
    let mut short = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS - 1).expect("a ring");
    let mut frame = short.begin().expect("a frame");
    let refused = generator.generate(&mut frame, &good, 0.5, &out.resting()).expect_err("too few descriptors");
    assert_eq!(refused.kind(), ErrorKind::Unsupported);
}
