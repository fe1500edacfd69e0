//! Generation from and into pictures in memory, as tools use it.

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::device::DeviceGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome, Phases};
use cairn::guidance::MotionOrigin;
use cairn::present::device::PictureUpscaler;

use super::presenter_upscaling::upscaled_anchors;
use super::*;

/// Guidance with motion of one step and depth, in tiles.
fn guidance(tile: u32) -> Guidance {
    let mut motion = MotionField::tiled(SIZE.0, SIZE.1, tile).expect("a field");
    motion.vectors_mut().fill([f16::from_f32(-STEP as f32), f16::ZERO]);
    let mut depth = DepthMap::new(SIZE.0, SIZE.1, paper::PROJECTION).expect("a depth map");
    depth.fill(0.5);
    Guidance::from_parts(motion, depth, MotionOrigin::OpticalFlow).expect("guidance")
}

fn apart(a: &Picture, b: &Picture) -> u8 {
    a.rgba().iter().zip(b.rgba()).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

/// The overlay's colour.
const OVER: [u8; 4] = [255, 0, 255, 255];

/// A mask of an overlay in some columns.
fn over_columns() -> Vec<u8> {
    (0..SIZE.0 * SIZE.1).map(|place| u8::from((40..56).contains(&(place % SIZE.0)))).collect()
}

/// Whether a picture differs from an anchor inside and outside a mask.
fn moved_under(mask: &[u8], made: &Picture, anchor: &Picture) -> [bool; 2] {
    let pixels = made.pixels().iter().zip(anchor.pixels()).zip(mask);
    pixels.fold([false; 2], |mut moved, ((made, anchor), mask)| {
        moved[usize::from(*mask == 0)] |= made != anchor;
        moved
    })
}

#[test]
fn pictures_in_memory_give_the_cpu_generator_s_result() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let (mut shader, mut cpu) = (DeviceGenerator::of_shaders(&gpu), CpuGenerator::new());
    assert_eq!((shader.name(), shader.phases()), ("shader", Phases::Any));
    let [mut made, mut wanted] = [(); 2].map(|()| Picture::new(SIZE.0, SIZE.1).expect("a picture"));
    let (first, second, guidance) = (moved(0), moved(STEP), guidance(8));
    let pair = AnchorPair::new(&first, &second, &guidance).expect("a pair");
    for t in [0.25, 0.5] {
        let reports = [shader.generate(&pair, t, &mut made), cpu.generate(&pair, t, &mut wanted)];
        let [a, b] = reports.map(|report| report.expect("generated"));
        assert_eq!((a.outcome, b.outcome), (Outcome::Generated, Outcome::Generated));
        assert!(
            (a.uncovered - b.uncovered).abs() < 1e-3 && (a.unexplained - b.unexplained).abs() < 1e-3,
            "{a:?} {b:?}"
        );
        assert!(apart(&made, &wanted) <= 1, "{t}");
    }
    let anchor = Anchor::new(&second, &guidance).expect("an anchor");
    for t in [0.5, 2.0] {
        let reports = [shader.extrapolate(&anchor, t, &mut made), cpu.extrapolate(&anchor, t, &mut wanted)];
        let [a, b] = reports.map(|report| report.expect("generated"));
        assert_eq!(a.outcome, b.outcome, "{t}");
        assert!(apart(&made, &wanted) <= 1, "{t} beyond");
    }
    let cut = pair.with_cut(true);
    let reports = [shader.generate(&cut, 0.5, &mut made), cpu.generate(&cut, 0.5, &mut wanted)];
    assert_eq!(reports.map(|report| report.expect("generated").outcome), [Outcome::CutFallback; 2]);
    assert!(made == wanted);
    // A static overlay in both anchors.
    let mask = over_columns();
    let [first, second] = [first, second].map(|mut picture| {
        picture.pixels_mut().iter_mut().zip(&mask).filter(|(_, mask)| **mask > 0).for_each(|(pixel, _)| *pixel = OVER);
        picture
    });
    let pair = AnchorPair::new(&first, &second, &guidance).expect("a pair").with_overlay(&mask).expect("a mask");
    let anchor = Anchor::new(&second, &guidance).expect("an anchor").with_overlay(&mask).expect("a mask");
    for refused in [pair.with_overlay(&mask[1..]).err(), anchor.with_overlay(&mask[1..]).err()] {
        assert_eq!(refused.expect("a byte too few").offending_field(), Some("overlay"));
    }
    for is_pair in [true, false] {
        let frames: [(&mut dyn FrameGenerator, &mut Picture); 2] = [(&mut shader, &mut made), (&mut cpu, &mut wanted)];
        for (generator, out) in frames {
            let report =
                if is_pair { generator.generate(&pair, 0.5, out) } else { generator.extrapolate(&anchor, 0.5, out) };
            assert_eq!(report.expect("generated").outcome, Outcome::Generated);
            assert_eq!(moved_under(&mask, out, &second), [false, true], "{}", generator.name());
        }
        assert!(apart(&made, &wanted) <= 1, "a pair: {is_pair}");
    }
}

#[test]
fn pictures_in_memory_use_a_provider() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
    let library = double.load().expect("loaded");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let mut fsr = DeviceGenerator::of_amd(&gpu, api, Choice::Any, 1000.0 / 15.0);
    assert_eq!((fsr.name(), fsr.phases()), ("fsr", Phases::OnlyHalf));
    let mut made = Picture::new(SIZE.0, SIZE.1).expect("a picture");
    let guidance = guidance(1);
    let tested = 2;
    // Two consecutive pairs, and one that is not: for it the provider gets the earlier anchor first.
    for (from, asked) in [(0, 2), (STEP, 3), (5 * STEP, 5)] {
        let (first, second) = (moved(from), moved(from + STEP));
        let pair = AnchorPair::new(&first, &second, &guidance).expect("a pair");
        let report = fsr.generate(&pair, 0.5, &mut made).expect("generated");
        assert_eq!(report.outcome, Outcome::Generated);
        let error = off(made.rgba(), &moved(from + STEP / 2));
        assert!(error <= 3, "from {from}: {error}");
        assert_eq!(pictures(&double), tested + asked, "from {from}");
        assert!(fsr.generate(&pair, 0.25, &mut made).is_err(), "no other phase");
        let cut = fsr.generate(&pair.with_cut(true), 0.5, &mut made).expect("an anchor");
        assert_eq!((cut.outcome, made == second), (Outcome::CutFallback, true));
    }
    // The first pair after a reset is another one than the first pair before it.
    let mut fsr = DeviceGenerator::of_amd(&gpu, api, Choice::Any, 1000.0 / 15.0);
    assert!(fsr.provider().is_none());
    for from in [0, 5 * STEP] {
        let (first, second) = (moved(from), moved(from + STEP));
        let pair = AnchorPair::new(&first, &second, &guidance).expect("a pair");
        fsr.generate(&pair, 0.5, &mut made).expect("generated");
        let error = off(made.rgba(), &moved(from + STEP / 2));
        assert!(error <= 3, "from {from}: {error}");
        fsr.reset();
    }
    assert_eq!(fsr.provider().map(|version| version.name.as_str()), Some("4.0.1"));
    let (first, second, mask) = (moved(0), moved(STEP), over_columns());
    let pair = AnchorPair::new(&first, &second, &guidance).expect("a pair").with_overlay(&mask).expect("a mask");
    fsr.generate(&pair, 0.5, &mut made).expect("generated");
    assert_eq!(moved_under(&mask, &made, &second), [false, true], "what lies over it stands still");
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn pictures_in_memory_are_upscaled() {
    let double = with_upscaler(&[]);
    let library = double.load().expect("loaded");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let api = library.api(Effect::Upscaling).expect("there");
    let interval = 1000.0 / 15.0;
    let mut upscaler = PictureUpscaler::new(&gpu, api, Choice::Any, SIZE, LARGE, interval).expect("an upscaler");
    assert_eq!(upscaler.version().name, "4.0.3");
    // The same picture twice: with guidance the previous frame is blended in along the motion, without guidance there is no
    // history.
    let mut made = Vec::new();
    for (by, tile) in [(0, None), (STEP, Some(8)), (2 * STEP, Some(1)), (2 * STEP, None)] {
        let guidance = tile.map(guidance);
        let larger = upscaler.upscale(&moved(by), guidance.as_ref()).expect("upscaled");
        let error = off(larger.rgba(), &drawn(LARGE, by));
        assert!(larger.size() == LARGE && error <= 8, "{by}, {tile:?}: {error} off");
        made.push(larger);
    }
    assert!(made[2] != made[3], "the one before counts where it is led to");
    assert_eq!(upscaled_anchors(&double), 4);
    let refused = upscaler.upscale(&drawn(LARGE, 0), None).expect_err("of another size");
    assert_eq!(refused.offending_field(), Some("picture"));
    let refused = PictureUpscaler::new(&gpu, api, Choice::Any, LARGE, SIZE, interval).expect_err("smaller");
    assert_eq!(refused.offending_field(), Some("size"));
    drop(upscaler);
    assert_eq!(double.violations(), [""; 0]);
}
