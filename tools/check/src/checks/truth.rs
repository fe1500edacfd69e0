//! Scenes whose frames, motion and depth are known exactly, and the distance of generated frames from their truth.

use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{Guidance, MotionOrigin, Projection};
use cairn::world::ControlScript;
use cairn::{Picture, Result};
use half::f16;
use scenes::camera::{FAR, NEAR};
use scenes::{Clip, ClipOptions, Family, Moment, Quality, Scene};

/// Size of the frames.
pub(super) const SIZE: (u32, u32) = (320, 180);
/// Anchors a second, with one frame between two.
const RATE: u32 = 15;

/// Two anchors, the frame half way between them, and motion and depth of the later one.
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) anchors: [Picture; 2],
    pub(super) middle: Picture,
    pub(super) guidance: Guidance,
}

/// Pairs of anchors from walks through two landscapes, and a street.
pub(super) fn cases(is_quick: bool) -> Result<Vec<Case>> {
    let families = [Family::Desert, Family::Forest, Family::Town];
    families.iter().take(if is_quick { 1 } else { 3 }).map(|family| case(*family, 41)).collect()
}

fn case(family: Family, seed: u64) -> Result<Case> {
    let scene = Scene::new(family, seed);
    let script = ControlScript::parse(family.script())?;
    let aspect = SIZE.0 as f32 / SIZE.1 as f32;
    let options = ClipOptions { width: SIZE.0, height: SIZE.1, rate: 2 * RATE, aspect, ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options)?;
    let mut moments: Vec<Moment> = Vec::new();
    // The walk has gained its speed then.
    for _ in 0..2 * RATE + 3 {
        moments.push(clip.advance()?.0);
    }
    let [before, middle, after] = std::array::from_fn(|i| &moments[moments.len() - 3 + i]);
    let draw = |now, before| scenes::render(&scene, now, before, SIZE.0, SIZE.1, Quality::default());
    let (first, last) = (draw(before, before), draw(after, before));
    let projection = Projection::new(NEAR, FAR, after.camera.vertical_fov)?;
    let mut guidance = Guidance::new(SIZE.0, SIZE.1, projection)?;
    for (vector, motion) in guidance.motion_mut().vectors_mut().iter_mut().zip(&last.motion) {
        *vector = [f16::from_f32(motion.x), f16::from_f32(motion.y)];
    }
    guidance.depth_mut().depth_mut().copy_from_slice(&last.depth);
    let guidance = Guidance::from_parts(guidance.motion().clone(), guidance.depth().clone(), MotionOrigin::Geometry)?;
    Ok(Case {
        name: family.name(),
        middle: draw(middle, middle).picture,
        anchors: [first.picture, last.picture],
        guidance,
    })
}

/// A frame half way, by a generator.
pub(super) fn generate(generator: &mut dyn FrameGenerator, case: &Case) -> Result<Picture> {
    let mut out = Picture::new(SIZE.0, SIZE.1)?;
    let pair = AnchorPair::new(&case.anchors[0], &case.anchors[1], &case.guidance)?;
    generator.generate(&pair, 0.5, &mut out)?;
    gpu_testing::fault::alter(out.rgba_mut());
    Ok(out)
}

/// The mean of both anchors: the frame of a generator that knows nothing.
pub(super) fn blend(case: &Case) -> Result<Picture> {
    let mut out = case.anchors[0].clone();
    for (to, other) in out.rgba_mut().iter_mut().zip(case.anchors[1].rgba()) {
        *to = u16::midpoint(u16::from(*to), u16::from(*other)) as u8;
    }
    Ok(out)
}

/// Peak signal-to-noise ratio in dB over R, G and B, peak 255; 100 for equal pictures.
pub(super) fn psnr(truth: &Picture, picture: &Picture) -> f64 {
    let squares: u64 = truth
        .pixels()
        .iter()
        .zip(picture.pixels())
        .flat_map(|(a, b)| (0..3).map(|c| u64::from(a[c].abs_diff(b[c])).pow(2)))
        .sum();
    let error = squares as f64 / (3.0 * truth.pixels().len() as f64);
    if error == 0.0 { 100.0 } else { 10.0 * (255.0 * 255.0 / error).log10() }
}
