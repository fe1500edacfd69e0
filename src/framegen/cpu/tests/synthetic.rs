//! Synthetic scenes, drawn at any phase, with guidance.

use half::f16;

use crate::Picture;
use crate::framegen::{AnchorPair, FrameGenerator, GenerateReport, cpu::CpuGenerator};
use crate::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};

/// Draws a picture from a function of the pixel.
pub(in crate::framegen::cpu) fn draw(width: u32, height: u32, rule: impl Fn(f64, f64) -> [u8; 3]) -> Picture {
    let mut picture = Picture::new(width, height).unwrap();
    for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
        let [r, g, b] = rule((i as u32 % width).into(), (i as u32 / width).into());
        *pixel = [r, g, b, 255];
    }
    picture
}

/// Guidance from a function of the pixel: motion from current to previous, and depth.
pub(in crate::framegen::cpu) fn guide(width: u32, height: u32, rule: impl Fn(f64, f64) -> ([f64; 2], f32)) -> Guidance {
    let (mut motion, mut depth) =
        (MotionField::new(width, height).unwrap(), DepthMap::new(width, height, paper::PROJECTION).unwrap());
    for i in 0..(width * height) {
        let (vector, z) = rule((i % width).into(), (i / width).into());
        motion.vectors_mut()[i as usize] = vector.map(f16::from_f64);
        depth.depth_mut()[i as usize] = z;
    }
    Guidance::from_parts(motion, depth, MotionOrigin::Geometry).unwrap()
}

/// A smooth texture without a short period, so that misplaced pixels differ.
pub(in crate::framegen::cpu) fn texture(x: f64, y: f64) -> [u8; 3] {
    let wave = |a: f64, b: f64, c: f64| {
        let v =
            (x * a + y * b + c).sin() + (x * b * 0.71 - y * a * 1.37 + 2.0 * c).sin() + (x * 0.043 - y * 0.031).cos();
        (127.5 + 40.0 * v) as u8
    };
    [wave(0.31, 0.17, 0.0), wave(-0.23, 0.29, 1.0), wave(0.19, -0.37, 2.0)]
}

/// Noise: an independent value per pixel.
pub(in crate::framegen::cpu) fn noise(x: f64, y: f64) -> [u8; 3] {
    let mut h =
        (x as i64 as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as i64 as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^= h >> 32;
    [h as u8, (h >> 8) as u8, (h >> 16) as u8]
}

/// Fractal noise, similar to a photograph: stronger at larger scales.
pub(in crate::framegen::cpu) fn landscape(x: f64, y: f64) -> [u8; 3] {
    let mut light = 0.0;
    for octave in 0..6 {
        let cell = f64::from(64 >> octave);
        let (column, row) = ((x / cell).floor(), (y / cell).floor());
        let (fx, fy) = (x / cell - column, y / cell - row);
        let corner = |i: f64, j: f64| f64::from(noise(column + i + 1000.0 * f64::from(octave), row + j)[0]) - 127.5;
        let across = |j: f64| corner(0.0, j) + (corner(1.0, j) - corner(0.0, j)) * fx;
        light += (across(0.0) + (across(1.0) - across(0.0)) * fy) * 0.4 * 0.75_f64.powi(octave);
    }
    [110.0 + light, 120.0 + 0.9 * light, 90.0 + 0.7 * light].map(|v| v as u8)
}

/// Generates at `t` with a new generator.
pub(in crate::framegen::cpu) fn generate(
    previous: &Picture,
    current: &Picture,
    guidance: &Guidance,
    t: f32,
) -> (Picture, GenerateReport) {
    let mut out = Picture::new(current.width(), current.height()).unwrap();
    let pair = AnchorPair::new(previous, current, guidance).unwrap();
    let report = CpuGenerator::new().generate(&pair, t, &mut out).unwrap();
    (out, report)
}

/// The largest difference of any channel over the pixels for which `inside` holds, and its position.
pub(in crate::framegen::cpu) fn worst(a: &Picture, b: &Picture, inside: impl Fn(i64, i64) -> bool) -> (u8, (i64, i64)) {
    assert_eq!(a.size(), b.size());
    let width = i64::from(a.width());
    let mut worst = (0, (0, 0));
    for (i, (a, b)) in a.pixels().iter().zip(b.pixels()).enumerate() {
        let place = (i as i64 % width, i as i64 / width);
        let difference = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        if inside(place.0, place.1) && difference > worst.0 {
            worst = (difference, place);
        }
    }
    worst
}

/// Pixels for which `inside` holds where some channel differs by more than `levels`.
pub(in crate::framegen::cpu) fn unlike(
    a: &Picture,
    b: &Picture,
    levels: u8,
    inside: impl Fn(i64, i64) -> bool,
) -> Vec<(i64, i64)> {
    assert_eq!(a.size(), b.size());
    let width = i64::from(a.width());
    let pixels = a.pixels().iter().zip(b.pixels()).enumerate();
    let differs = pixels.filter(|(_, (a, b))| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > levels));
    let places = differs.map(|(i, _)| (i as i64 % width, i as i64 / width));
    places.filter(|&(x, y)| inside(x, y)).collect()
}

/// Mean absolute difference of all channels.
pub(in crate::framegen::cpu) fn mean_difference(a: &Picture, b: &Picture) -> f64 {
    assert_eq!(a.size(), b.size());
    let sum: u64 = a.rgba().iter().zip(b.rgba()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / (a.rgba().len() * 3 / 4) as f64
}
