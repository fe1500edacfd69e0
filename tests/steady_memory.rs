//! After the first frame, guidance, frame generation and upscaling allocate nothing.

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{DepthMap, Guidance, LatentView, MotionField, MotionOrigin, latent_flow, paper, picture_flow};
use cairn::present::upscale::{Filter, Upscaler};
use cairn::{Picture, Pixel, Raster};
use half::f16;
use test_support::allocations::{CountingAllocator, allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Runs `work` on one worker thread, once to warm up, and counts the allocations of the next five times.
fn allocations_when_warm(mut work: impl FnMut() + Send) -> usize {
    let pool = cairn::tasks::Pool::new(1).expect("a thread");
    pool.install(|| {
        work();
        let before = allocations();
        for _ in 0..5 {
            work();
        }
        allocations() - before
    })
}

#[test]
fn frames_are_made_without_allocating() {
    let latents: Vec<f32> = (0..4 * 8 * 16).map(|i| (i as f32 * 0.7).sin()).collect();
    let view = |values| LatentView::new(2, 8, 16, values).expect("a latent");
    let (z0, z1) = latents.split_at(latents.len() / 2);
    let mut guidance = Guidance::new(128, 72, paper::PROJECTION).expect("guidance");
    let mut extractor = paper::Extractor::new();
    assert_eq!(
        allocations_when_warm(|| {
            extractor.extract(view(z0), view(z1), (128, 72), &mut guidance).expect("motion and depth");
        }),
        0,
        "guidance"
    );
    let mut found = Guidance::new(128, 72, latent_flow::PROJECTION).expect("guidance");
    let mut extractor = latent_flow::Extractor::new();
    assert_eq!(
        allocations_when_warm(|| {
            extractor.extract(view(z0), view(z1), (128, 72), &mut found).expect("motion");
        }),
        0,
        "motion from latents"
    );

    let mut previous = Picture::new(128, 72).expect("a picture");
    for (i, value) in previous.rgba_mut().iter_mut().enumerate() {
        *value = ((i * i) >> 7) as u8;
    }
    let mut current = previous.clone();
    current.rgba_mut().rotate_right(8);
    let mut flow = Guidance::new(128, 72, picture_flow::PROJECTION).expect("guidance");
    let mut extractor = picture_flow::Extractor::new();
    assert_eq!(
        allocations_when_warm(|| {
            extractor.extract(&previous, &current, &mut flow).expect("motion");
        }),
        0,
        "motion from pictures"
    );

    let mut out = previous.clone();
    let mut generator = CpuGenerator::new();
    assert_eq!(
        allocations_when_warm(|| {
            let pair = AnchorPair::new(&previous, &current, &guidance).expect("a pair");
            let report = generator.generate(&pair, 0.5, &mut out).expect("a frame");
            assert_eq!(report.outcome, Outcome::Generated);
            // Some pixels need hole filling, or that code would not be tested.
            assert!(report.uncovered > 0.0);
            generator
                .extrapolate(&Anchor::new(&current, &guidance).expect("an anchor"), 0.5, &mut out)
                .expect("a frame");
        }),
        0,
        "frame generation"
    );

    let mut upscaler = Upscaler::new((128, 72), (192, 108), Filter::Lanczos3).expect("tables");
    let mut large = Picture::new(192, 108).expect("a picture");
    assert_eq!(allocations_when_warm(|| upscaler.upscale(&previous, &mut large).expect("a picture")), 0, "upscaling");
}

/// Motion towards the centre with disocclusions and occlusions and a box in front; or no motion, with constant depth.
fn guidance((width, height): (u32, u32), tile: u32, moves: bool) -> Guidance {
    let mut motion = MotionField::tiled(width, height, tile).expect("motion");
    let mut depth = DepthMap::tiled(width, height, tile, paper::PROJECTION).expect("depth");
    let columns = motion.columns();
    for (i, (vector, z)) in motion.vectors_mut().iter_mut().zip(depth.depth_mut()).enumerate() {
        let (x, y) = (i as u32 % columns * tile, i as u32 / columns * tile);
        let is_box = x > width / 3 && x < width / 2 && y > height / 3;
        let ground = [x as f32 / width as f32 * 30.0 - 15.0, y as f32 / height as f32 * 20.0 - 10.0];
        (*vector, *z) = match (moves, is_box) {
            (false, _) => ([f16::ZERO; 2], 0.9),
            (true, true) => ([f16::from_f32(-13.0), f16::from_f32(4.0)], 0.2),
            (true, false) => (ground.map(f16::from_f32), 0.9),
        };
    }
    Guidance::from_parts(motion, depth, MotionOrigin::Geometry).expect("guidance")
}

/// Frames of one kind of pixel: only the first, of a static picture, may allocate; later ones with motion, disocclusions, static
/// overlays or cuts may not.
fn frames_do_not_allocate<P: Pixel>(kind: &str, pixel: impl Fn(u8) -> P)
where
    CpuGenerator: FrameGenerator<P>,
{
    for (size, tile) in [((1, 1), 1), ((67, 41), 1), ((128, 72), 8), ((320, 180), 1), ((200, 333), 16)] {
        let picture = |seed: usize| {
            let mut picture = Raster::<P>::new(size.0, size.1).expect("a picture");
            let levels = (0..).map(|i: usize| ((i * i * seed) >> 7) as u8);
            picture.pixels_mut().iter_mut().zip(levels).for_each(|(to, level)| *to = pixel(level));
            picture
        };
        let (previous, other) = (picture(1), picture(7));
        let (no_motion, moving) = (guidance(size, tile, false), guidance(size, tile, true));
        let (mut out, mut is_first) = (previous.clone(), true);
        let mut generator = CpuGenerator::new();
        let count = allocations_when_warm(|| {
            let guidance = if std::mem::take(&mut is_first) { &no_motion } else { &moving };
            let pair = AnchorPair::new(&previous, &previous, guidance).expect("a pair");
            generator.generate(&pair, 0.5, &mut out).expect("a frame");
            if std::ptr::eq(guidance, &moving) {
                let cut = AnchorPair::new(&previous, &other, guidance).expect("a pair");
                generator.generate(&cut, 0.5, &mut out).expect("a frame");
                let anchor = Anchor::new(&previous, guidance).expect("an anchor");
                generator.extrapolate(&anchor, 0.5, &mut out).expect("a frame");
            }
        });
        assert_eq!(count, 0, "{kind}, {size:?}");
    }
}

#[test]
fn frames_of_every_kind_and_size_are_made_without_allocating() {
    frames_do_not_allocate("bytes", |level| [level, level / 2, 255 - level, 255]);
    frames_do_not_allocate("half floats", |level| {
        [level, level / 2, 255 - level, 255].map(|v| f16::from_f32(f32::from(v) / 255.0))
    });
}
