//! Pairs of pictures for the metrics: rendered scenes, and the same after typical distortions.

use std::io::Cursor;

use cairn::Picture;
use cairn::world::ControlScript;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use scenes::{Clip, ClipOptions, Family, Quality, Scene};

/// A true picture and one that is scored against it.
pub struct Pair {
    pub name: &'static str,
    pub truth: Picture,
    pub candidate: Picture,
}

/// The pairs, the same bytes every time.
pub fn pairs() -> Vec<Pair> {
    let [forest, _] = walk(Family::Forest, (160, 90));
    let [sword, sword_next] = walk(Family::Sword, (128, 96));
    let [desert, desert_next] = walk(Family::Desert, (97, 61));
    let [snow, snow_next] = walk(Family::Snow, (131, 83));
    let pair = |name, truth: &Picture, candidate: Picture| Pair { name, truth: truth.clone(), candidate };
    vec![
        pair("forest blurred", &forest, blurred(&forest)),
        pair("forest shifted by a quarter of a pixel", &forest, shifted(&forest, 0.25, 0.25)),
        pair("forest as JPEG of quality 25", &forest, jpeg(&forest, 25)),
        pair("forest brighter by 24", &forest, changed(&forest, |v| v + 24.0)),
        pair("sword, the next frame", &sword, sword_next.clone()),
        pair("sword, the average of two frames", &sword, average(&sword, &sword_next)),
        pair("sword shifted by a pixel and a half", &sword, shifted(&sword, 1.5, 0.0)),
        pair("desert with much noise", &desert, noisy(&desert, 40.0)),
        pair("desert with hardly any noise", &desert, noisy(&desert, 2.0)),
        pair("desert, the next frame in the lower half", &desert, torn(&desert, &desert_next)),
        pair("snow with a gamma of 1.4", &snow, changed(&snow, |v| 255.0 * (v / 255.0).powf(1.4))),
        pair("snow with less colour", &snow, grey(&snow)),
        pair("snow, a wrong corner", &snow, patched(&snow, &snow_next)),
        pair("snow, nothing but black", &snow, changed(&snow, |_| 0.0)),
    ]
}

/// Pairs that are large enough for five scales, most of them of odd sizes.
pub fn large_pairs() -> Vec<Pair> {
    let [forest, _] = walk(Family::Forest, (301, 203));
    let [sword, sword_next] = walk(Family::Sword, (256, 176));
    let [desert, desert_next] = walk(Family::Desert, (355, 241));
    let [snow, _] = walk(Family::Snow, (161, 163));
    let pair = |name, truth: &Picture, candidate: Picture| Pair { name, truth: truth.clone(), candidate };
    vec![
        pair("large forest blurred", &forest, blurred(&forest)),
        pair("large forest as JPEG of quality 25", &forest, jpeg(&forest, 25)),
        pair("large sword, the next frame", &sword, sword_next.clone()),
        pair("large sword shifted by a pixel and a half", &sword, shifted(&sword, 1.5, 0.0)),
        pair("large desert with much noise", &desert, noisy(&desert, 40.0)),
        pair("large desert, the next frame in the lower half", &desert, torn(&desert, &desert_next)),
        pair("large snow with a gamma of 1.4", &snow, changed(&snow, |v| 255.0 * (v / 255.0).powf(1.4))),
        pair("large snow upside down in brightness", &snow, changed(&snow, |v| 255.0 - v)),
    ]
}

/// Two frames of a walk, a fifteenth of a second apart.
fn walk(family: Family, (width, height): (u32, u32)) -> [Picture; 2] {
    let scene = Scene::new(family, 2);
    let script = ControlScript::parse("cairn-controls 1\n0..9 hold W\n0..2 mouse 200 0\n9 end\n").unwrap();
    let options = ClipOptions { width, height, rate: 15, quality: Quality { samples: 2 }, ..Default::default() };
    let mut clip = Clip::new(&scene, &script, options).unwrap();
    for _ in 0..8 {
        clip.advance().unwrap();
    }
    [clip.frame().unwrap().picture, clip.frame().unwrap().picture]
}

/// Each colour value changed on its own.
fn changed(picture: &Picture, change: impl Fn(f32) -> f32) -> Picture {
    let mut out = picture.clone();
    for px in out.pixels_mut() {
        px[..3].iter_mut().for_each(|v| *v = byte(change(f32::from(*v))));
    }
    out
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Bilinear, with the border repeated.
fn shifted(picture: &Picture, dx: f32, dy: f32) -> Picture {
    filtered(picture, |at, x, y| {
        let (x, y) = (x as f32 + dx, y as f32 + dy);
        let (fx, fy) = (x.fract(), y.fract());
        let (x, y) = (x as i32, y as i32);
        (1.0 - fy) * ((1.0 - fx) * at(x, y) + fx * at(x + 1, y))
            + fy * ((1.0 - fx) * at(x, y + 1) + fx * at(x + 1, y + 1))
    })
}

fn blurred(picture: &Picture) -> Picture {
    filtered(picture, |at, x, y| {
        (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j))).map(|(i, j)| at(x + i, y + j)).sum::<f32>() / 25.0
    })
}

/// Every value from those of its own channel, which are read at any position.
fn filtered(picture: &Picture, value: impl Fn(&dyn Fn(i32, i32) -> f32, i32, i32) -> f32) -> Picture {
    let (width, height) = (picture.width() as i32, picture.height() as i32);
    let mut out = picture.clone();
    for (i, px) in out.pixels_mut().iter_mut().enumerate() {
        let (x, y) = (i as i32 % width, i as i32 / width);
        for (channel, out) in px[..3].iter_mut().enumerate() {
            let at = |x: i32, y: i32| {
                let place = y.clamp(0, height - 1) * width + x.clamp(0, width - 1);
                f32::from(picture.pixels()[place as usize][channel])
            };
            *out = byte(value(&at, x, y));
        }
    }
    out
}

fn average(a: &Picture, b: &Picture) -> Picture {
    let mut out = a.clone();
    out.rgba_mut().iter_mut().zip(b.rgba()).for_each(|(a, b)| *a = u16::midpoint(u16::from(*a), u16::from(*b)) as u8);
    out
}

fn noisy(picture: &Picture, strength: f32) -> Picture {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut out = picture.clone();
    for px in out.pixels_mut() {
        for value in &mut px[..3] {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
            *value = byte(f32::from(*value) + strength * uniform);
        }
    }
    out
}

fn grey(picture: &Picture) -> Picture {
    let mut out = picture.clone();
    for px in out.pixels_mut() {
        let mean = px[..3].iter().map(|v| f32::from(*v)).sum::<f32>() / 3.0;
        px[..3].iter_mut().for_each(|v| *v = byte(0.5 * (f32::from(*v) + mean)));
    }
    out
}

fn torn(upper: &Picture, lower: &Picture) -> Picture {
    let half = upper.pixels().len() / 2;
    let mut out = upper.clone();
    out.pixels_mut()[half..].copy_from_slice(&lower.pixels()[half..]);
    out
}

/// The middle of another picture in the upper left corner.
fn patched(picture: &Picture, other: &Picture) -> Picture {
    let mut out = picture.clone();
    let width = picture.width() as usize;
    for y in 0..40 {
        let from = (y + 30) * width + 50;
        out.pixels_mut()[y * width..][..50].copy_from_slice(&other.pixels()[from..][..50]);
    }
    out
}

fn jpeg(picture: &Picture, quality: u8) -> Picture {
    let rgb: Vec<u8> = picture.pixels().iter().flat_map(|px| [px[0], px[1], px[2]]).collect();
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality)
        .encode(&rgb, picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .unwrap();
    let image = image::load(Cursor::new(file), ImageFormat::Jpeg).unwrap().into_rgba8();
    Picture::from_rgba(picture.width(), picture.height(), image.into_raw()).unwrap()
}
