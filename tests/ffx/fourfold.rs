//! Three frames between two, by two generators.

use cairn::ffx::FourfoldGenerator;

use super::*;

/// The frames at a quarter, the half and three quarters between two that `draw` gives, 0 and 1.
fn fourfold(
    textures: &Textures,
    gpu: &Gpu,
    generator: &mut FourfoldGenerator,
    draw: impl Fn(i32, u32, u32) -> [u8; 4],
) -> [Vec<[u8; 4]>; 3] {
    let [first, last] = [(); 2].map(|()| Textures::new(gpu, SIZE).output);
    for number in [0, 1] {
        textures.fill(&textures.color, |x, y| draw(number, x, y));
        let shot = Shot { reset: number == 0, ..Shot::of(SIZE) };
        let quarters = [first.resting(), last.resting()];
        generator.generate(&of(textures), quarters, &shot).expect("generated").wait().expect("it has run");
        if number == 0 {
            // Nothing is between after a cut.
            for found in [&first, &textures.output, &last] {
                assert_eq!(off(&textures.pixels(found), INNER, |x, y| draw(0, x, y)), 0);
            }
        }
    }
    [&first, &textures.output, &last].map(|found| textures.pixels(found))
}

#[test]
fn three_frames_between_two_lie_at_their_quarters() {
    for release in [["sdk 2.0", ANALYTIC_20], ["sdk 2.1", ML]] {
        let stage = Stage::empty().with(Part::FrameGeneration, &release);
        let (gpu, library) = (gpu(), stage.load().expect("loaded"));
        let api = library.api(Effect::FrameGeneration).expect("there");
        let mut generator = FourfoldGenerator::new(&gpu, api, &options()).expect("two generators");
        let textures = panning(&gpu);
        let found = fourfold(&textures, &gpu, &mut generator, |number, x, y| moved(STEP * number)(x, y));
        for (found, at) in found.iter().zip([STEP / 4, HALF, STEP - STEP / 4]) {
            assert!(off(found, INNER, moved(at)) <= 3, "{release:?}: at {at}: {}", off(found, INNER, moved(at)));
        }
        let [half, quarters] = generator.memory().expect("an answer");
        assert!(quarters.own > half.own && quarters.provider.is_some());

        // What is near goes over what stands: half way it is where its motion has led it, and so is its motion.
        let left = |number: i32| 40 + STEP * number;
        let in_front = |at: i32, x: u32| (at..at + 24).contains(&x.cast_signed());
        textures.fill(&textures.depth, |x, _| if in_front(left(1), x) { 0.25_f32 } else { 0.5 }.to_le_bytes());
        textures.fill(&textures.motion, |x, _| halves(if in_front(left(1), x) { -STEP as f32 } else { 0.0 }, 0.0));
        let thing = |at: i32, x: u32, y: u32| endless(3 * (x.cast_signed() - at) + 500, 2 * y.cast_signed());
        let draw = |number: i32, x: u32, y: u32| {
            if in_front(left(number), x) { thing(left(number), x, y) } else { [20, 30, 40, 255] }
        };
        let [first, half, last] = fourfold(&textures, &gpu, &mut generator, draw);
        // The first where it is at the half and is no more at the end: there the later frame's motion is that of what stands.
        for (found, at, part) in
            [(&first, 4, [52, 0, 55, 96]), (&half, 8, [58, 0, 70, 96]), (&last, 12, [61, 0, 70, 96])]
        {
            let error = off(found, part, |x, y| thing(left(0) + at, x, y));
            assert!(error <= 4, "{release:?}: moved by {at}: {error}");
        }
        assert!(gpu.removed().is_none());
        assert_eq!(stage.judgement(), [""; 0]);
    }
}

#[test]
fn an_interface_stands_in_all_three_and_a_lens_counts_in_each() {
    let (stage, library) = playing(&[]);
    let gpu = gpu();
    let api = library.api(Effect::FrameGeneration).expect("there");
    let mut generator = FourfoldGenerator::new(&gpu, api, &options()).expect("generators");
    let textures = panning(&gpu);
    let [first, last] = [(); 2].map(|()| Textures::new(&gpu, SIZE).output);
    let quarters = [first.resting(), last.resting()];
    let hudless = texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
    let sign = [250, 10, 240, 255];
    let in_sign = |x: u32, y: u32| (48..80).contains(&x) && (32..64).contains(&y);
    // Without an interface first: with the first frame that has one history starts anew, of all of them.
    textures.fill(&textures.color, moved(-STEP));
    generator.generate(&of(&textures), quarters, &Shot::of(SIZE)).expect("generated").wait().expect("it has run");
    let without = generator.memory().expect("an answer")[1];
    for number in [0, 1, 2] {
        textures.fill(&hudless, moved(STEP * number));
        textures.fill(&textures.color, |x, y| if in_sign(x, y) { sign } else { moved(STEP * number)(x, y) });
        let with = Pictures { hudless: Some(hudless.resting()), ..of(&textures) };
        generator.generate(&with, quarters, &Shot::of(SIZE)).expect("generated").wait().expect("it has run");
        for (found, part) in [(&first, STEP / 4), (&textures.output, HALF), (&last, STEP - STEP / 4)] {
            let at = if number == 0 { 0 } else { STEP * (number - 1) + part };
            let expected = |x: u32, y: u32| if in_sign(x, y) { sign } else { moved(at)(x, y) };
            let error = off(&textures.pixels(found), INNER, expected);
            assert!(error <= 3, "frame {number}, {part} of {STEP}: {error}");
        }
    }
    let with = generator.memory().expect("an answer")[1];
    assert!(with.own > without.own, "a third generator is counted");
    let totals = [with, without].map(|memory| memory.provider.expect("it can say").total);
    assert!(totals[0] > totals[1]);

    // A lens that moves nothing is none; one that does shows in each.
    let lens = texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
    let mut seen = Vec::new();
    for by in [None, Some(0.0), Some(-4.0)] {
        let mut generator = FourfoldGenerator::new(&gpu, api, &options()).expect("generators");
        by.inspect(|by| textures.fill(&lens, |_, _| halves(by / SIZE.width as f32, 0.0)));
        let pictures = Pictures { distortion: by.map(|_| lens.resting()), ..of(&textures) };
        for number in [0, 1] {
            textures.fill(&textures.color, moved(STEP * number));
            generator.generate(&pictures, quarters, &Shot::of(SIZE)).expect("generated").wait().expect("it has run");
        }
        seen.push([&first, &textures.output, &last].map(|found| textures.pixels(found)));
    }
    assert!(seen[0] == seen[1], "no lens, and one that does nothing");
    assert!(seen[0].iter().zip(&seen[2]).all(|(without, with)| without != with));
    assert!(gpu.removed().is_none());
    assert_eq!(stage.judgement(), [""; 0]);
}

#[test]
fn bars_and_jitter_count_in_all_three() {
    let (stage, library) = playing(&[]);
    let gpu = gpu();
    let api = library.api(Effect::FrameGeneration).expect("there");
    let textures = panning(&gpu);
    let [first, last] = [(); 2].map(|()| Textures::new(&gpu, SIZE).output);
    let quarters = [first.resting(), last.resting()];
    let mut options = options();
    options.head.flags = CreateFlags::MOTION_JITTER;
    let mut generator = FourfoldGenerator::new(&gpu, api, &options).expect("two generators");
    let rect = Rect { left: 0, top: 16, width: SIZE.width.cast_signed(), height: 64 };
    // Motion holds what jitter has changed by since the frame before, of which each half of the way has its half.
    let jitters = [1.5, -2.5, 3.5];
    for (number, x) in (0..).zip(jitters) {
        let before = jitters[usize::try_from(number).expect("few").saturating_sub(1)];
        textures.fill(&textures.motion, |_, _| halves(-STEP as f32 + before - x, 0.0));
        textures.fill(&textures.color, moved(STEP * number));
        let shot = Shot { rect, jitter: Coordinates { x, y: 0.0 }, reset: number == 0, ..Shot::of(SIZE) };
        generator.generate(&of(&textures), quarters, &shot).expect("generated").wait().expect("it has run");
        for (found, part) in [(&first, STEP / 4), (&textures.output, HALF), (&last, STEP - STEP / 4)] {
            let found = textures.pixels(found);
            for bar in [[0, 0, SIZE.width, 16], [0, 80, SIZE.width, SIZE.height]] {
                assert_eq!(off(&found, bar, moved(STEP * number)), 0, "frame {number}: the frame's own");
            }
            let at = if number == 0 { 0 } else { STEP * (number - 1) + part };
            let error = off(&found, [32, 16, 96, 80], moved(at));
            assert!(error <= 3, "frame {number}, {part} of {STEP}: {error}");
        }
    }
    assert!(gpu.removed().is_none());
    assert_eq!(stage.judgement(), [""; 0]);
}

#[test]
fn what_does_not_fit_is_refused_and_a_failure_starts_anew() {
    let (stage, library) = playing(&[]);
    let gpu = gpu();
    let api = library.api(Effect::FrameGeneration).expect("there");
    let mut generator = FourfoldGenerator::new(&gpu, api, &options()).expect("two generators");
    let textures = panning(&gpu);
    let [first, last] = [(); 2].map(|()| Textures::new(&gpu, SIZE).output);
    let small = Textures::new(&gpu, Dimensions { width: 64, height: 96 });
    let quarters = [first.resting(), last.resting()];
    let pictures = of(&textures);
    for (field, spoilt, quarters) in [
        ("hudless", Pictures { hudless: Some(small.color.resting()), ..pictures }, quarters),
        ("output", pictures, [small.output.resting(), quarters[1]]),
        ("depth", Pictures { depth: small.depth.resting(), ..pictures }, quarters),
    ] {
        let refused = generator.generate(&spoilt, quarters, &Shot::of(SIZE)).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)), "{refused}");
    }
    // As the first frame again: all three are this one.
    textures.fill(&textures.color, moved(5));
    generator.generate(&pictures, quarters, &Shot::of(SIZE)).expect("generated").wait().expect("it has run");
    for found in [&first, &textures.output, &last] {
        assert_eq!(off(&textures.pixels(found), INNER, moved(5)), 0);
    }
    assert_eq!(stage.judgement(), [""; 0]);
}
