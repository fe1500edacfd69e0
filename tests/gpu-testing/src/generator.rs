//! Frames of the compute shader generator, compared with the processor's.

use std::collections::HashMap;
use std::ops::Range;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::shader::{
    DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair, WORD_OF_CUT, WORD_OF_UNCOVERED, WORD_OF_UNEXPLAINED,
};
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome};
use cairn::gpu::Gpu;
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R8_UNORM;

use crate::comparison::{ComparablePixel, DeviceGuidance, Differences, depth_texture, raster, target, upload_picture};
use crate::frame_cases::{self, Random};
use crate::resources::{TestResource, read_texture, read_words, upload_texture};

/// Compares the device's report of a frame with the processor's.
fn check_report(gpu: &Gpu, generator: &ShaderGenerator, wanted: &GenerateReport, size: (u32, u32), what: &str) {
    let words: [u32; 32] = read_words(gpu, &generator.report());
    let of = |word: u32| words[word as usize];
    assert_eq!(of(WORD_OF_CUT) == 1, wanted.outcome == Outcome::CutFallback, "{what}");
    let uncovered = of(WORD_OF_UNCOVERED) as f32 / (size.0 * size.1) as f32;
    let unexplained = f32::from_bits(of(WORD_OF_UNEXPLAINED));
    assert!((uncovered - wanted.uncovered).abs() <= 1e-3, "{what}: {uncovered} for {wanted:?}");
    assert!((unexplained - wanted.unexplained).abs() <= 1e-6, "{what}: {unexplained} for {wanted:?}");
}

/// Frames of random cases, compared with the processor's.
#[derive(Debug, Clone, Copy)]
pub struct FrameComparison {
    /// Frames between two anchors.
    pub interpolated: Differences,
    /// Frames after the last anchor.
    pub extrapolated: Differences,
    /// Pairs of anchors that the processor takes for a cut.
    pub cuts: usize,
}

impl FrameComparison {
    /// Whether at most one pixel of 10,000 differs by more than a level of 255: a tenth of the documented tolerance, as only the device's division
    /// may differ.
    pub fn is_within_tolerance(&self) -> bool {
        [self.interpolated, self.extrapolated].iter().all(|all| 10_000 * all.far <= all.pixels)
    }
}

/// Makes frames of the random cases of these seeds on the device and on the processor.
pub fn compare<P: ComparablePixel>(gpu: &Gpu, cases: Range<u64>) -> FrameComparison
where
    CpuGenerator: FrameGenerator<P>,
{
    let mut frames = CommandRing::new(gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut cpu = CpuGenerator::new();
    let (mut interpolated, mut extrapolated, mut cuts) = (Differences::default(), Differences::default(), 0);
    let mut generators = HashMap::new();
    for seed in cases {
        let mut random = Random(seed);
        let sizes = [(1, 1), (1, 40), (40, 1), (8, 8), (16, 24), (33, 17), (64, 40), (95, 70), (130, 81)];
        let size = sizes[random.below(sizes.len() as u64) as usize];
        let guidance = frame_cases::guidance(&mut random, size);
        let [previous, current] = frame_cases::pictures(&mut random, size).map(|levels| raster::<P>(size, &levels));
        let t = [0.5, 1.0 / 3.0, 0.25, 0.75, f32::MIN_POSITIVE, 1.0 - f32::EPSILON, 0.1, 0.9][random.below(8) as usize];
        let depth = frame_cases::previous_depth(&mut random, guidance.depth());
        let has_depth = random.below(3) != 0;
        let mut pair = AnchorPair::new(&previous, &current, &guidance).expect("a pair");
        if has_depth {
            pair = pair.with_previous_depth(&depth).expect("a depth");
        }
        let mut anchor = Anchor::new(&current, &guidance).expect("an anchor");
        let mask = frame_cases::overlay(&mut random, size);
        let hud = (random.below(2) == 0).then(|| upload_texture(gpu, size, DXGI_FORMAT_R8_UNORM, &mask));
        if hud.is_some() {
            pair = pair.with_overlay(&mask).expect("a mask");
            anchor = anchor.with_overlay(&mask).expect("a mask");
        }
        let mut wanted = previous.clone();
        let report = FrameGenerator::<P>::generate(&mut cpu, &pair, t, &mut wanted).expect("a frame");
        cuts += usize::from(report.outcome == Outcome::CutFallback);

        let generator = generators.entry(size).or_insert_with(|| ShaderGenerator::new(gpu, size).expect("a generator"));
        let (before, after, guided) =
            (upload_picture(gpu, &previous), upload_picture(gpu, &current), DeviceGuidance::new(gpu, &guidance));
        let depth = depth_texture(gpu, &depth);
        let guidance_textures =
            GuidanceTextures { hud: hud.as_ref().map(TestResource::with_state), ..guided.textures() };
        let textures = TexturePair {
            previous: before.with_state(),
            current: after.with_state(),
            guidance: guidance_textures,
            previous_depth: has_depth.then(|| (depth.with_state(), guidance.depth().tile())),
            cut: false,
        };
        let out = target(gpu, size, P::FORMAT);
        let mut frame = frames.begin().expect("a frame");
        generator.generate(&mut frame, &textures, t, &out.with_state()).expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        let row = size.0 as usize * size_of::<P>();
        let what = format!("case {seed}, {size:?}, t = {t}, {:?}", report.outcome);
        interpolated.compare(&read_texture(gpu, &out, row), &wanted, &what);
        check_report(gpu, generator, &report, size, &what);

        let report = FrameGenerator::<P>::extrapolate(&mut cpu, &anchor, t, &mut wanted).expect("a frame");
        let mut frame = frames.begin().expect("a frame");
        generator
            .extrapolate(&mut frame, &after.with_state(), &guidance_textures, false, t, &out.with_state())
            .expect("it is recorded");
        frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
        extrapolated.compare(
            &read_texture(gpu, &out, row),
            &wanted,
            &format!("case {seed}, {size:?}, t = {t}, extrapolated"),
        );
        check_report(gpu, generator, &report, size, &format!("case {seed}, extrapolated"));
    }
    FrameComparison { interpolated, extrapolated, cuts }
}
