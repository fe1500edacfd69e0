//! A world in a part of the frame, which decides what a provider takes depth and motion for: AMD's own and the double must agree.

use cairn::ffx::bindings::{Dimensions, Rect};
use cairn::ffx::{FrameParams, TextureGenerator};
use cairn::gpu::Gpu;

use super::frame_textures::Textures;

/// Motion of the world's upper half from frame to frame, in pixels of motion; half as many on the screen, since the world is half as wide.
const STEP: f32 = 16.0;

/// Pixel of an endless pattern without repetition.
fn pattern(x: f32, y: f32) -> [u8; 4] {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255]
}

/// Generates frames whose world is the lower right quarter and moves in its upper half only, as the upper half of the motion texture says.
///
/// # Panics
/// If a frame is not half way where the world moves, or anything else in it changes.
pub fn check(gpu: &Gpu, generator: &mut TextureGenerator, size: Dimensions) {
    let Dimensions { width, height } = size;
    let (left, top, middle) = (width / 2, height / 2, height / 4 * 3);
    let textures = Textures::new(gpu, size);
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    let [low, high] = half::f16::from_f32(-STEP).to_le_bytes();
    textures.fill(&textures.motion, |_, y| if y < height / 2 { [low, high, 0, 0] } else { [0; 4] });
    let moves = |x: u32, y: u32| x >= left && (top..middle).contains(&y);
    let at = |number: f32| {
        move |x: u32, y: u32| pattern(x as f32 - if moves(x, y) { number * STEP / 2.0 } else { 0.0 }, y as f32)
    };
    let rect = Rect {
        left: left.cast_signed(),
        top: top.cast_signed(),
        width: (width - left).cast_signed(),
        height: (height - top).cast_signed(),
    };
    for number in 1_u8..=3 {
        textures.fill(&textures.color, at(number.into()));
        let params = FrameParams { rect, reset: number == 1, ..FrameParams::of(size) };
        generator.generate(&textures.pictures(), &params).expect("generated").wait().expect("it has run");
    }
    let found = textures.generated();
    let off = |part: &dyn Fn(u32, u32) -> bool, number: f32| {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|(x, y)| part(*x, *y));
        let differences = places.flat_map(|(x, y)| {
            let expected = at(number)(x, y);
            (0..3).map(move |c| (x, y, c, expected[c]))
        });
        differences
            .map(|(x, y, c, expected)| found[(y * width + x) as usize][c].abs_diff(expected))
            .max()
            .unwrap_or(255)
    };
    // What crosses the borders of a part is unknown there.
    let margin = height / 12;
    let inside = |x: u32, from: u32, to: u32, y: u32| {
        (left + margin..width - margin).contains(&x) && (from + margin..to - margin).contains(&y)
    };
    let moving = off(&|x, y| inside(x, top, middle, y), 2.5);
    let still = off(&|x, y| inside(x, middle, height, y), 3.0);
    let outside = off(&|x, y| x < left || y < top, 3.0);
    println!(
        "a world in a quarter of the frame: {moving} off the half step, {still} where it is still, {outside} outside"
    );
    assert!(moving <= 2 && still <= 2 && outside <= 1, "{moving} {still} {outside}");
}
