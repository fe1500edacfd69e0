//! Sizes, phases and motion vectors at and beyond their limits.

use half::f16;

use super::synthetic::{draw, generate, guide, landscape, noise, texture, unlike, worst};
use crate::framegen::cpu::CpuGenerator;
use crate::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome, Phases};
use crate::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};
use crate::tasks::Pool;
use crate::{ErrorKind, Picture, PictureF16};

fn extrapolate(anchor: &Anchor<'_>, t: f32) -> (Picture, Outcome) {
    let (width, height) = anchor.picture().size();
    let mut out = Picture::new(width, height).unwrap();
    let report = CpuGenerator::new().extrapolate(anchor, t, &mut out).unwrap();
    (out, report.outcome)
}

#[test]
fn every_size_works_and_a_still_picture_stays_as_it_is() {
    for (width, height) in [(1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (17, 9), (33, 1), (1, 33), (67, 43)] {
        let picture = draw(width, height, noise);
        let still = guide(width, height, |_, _| ([0.0; 2], 0.5));
        let moving = guide(width, height, |x, y| ([x - 3.0, 2.0 - y], 0.5));
        for t in [f32::MIN_POSITIVE, 0.25, 1.0 / 3.0, 0.5, 2.0 / 3.0, 1.0 - f32::EPSILON] {
            assert_eq!(
                worst(&generate(&picture, &picture, &still, t).0, &picture, |_, _| true).0,
                0,
                "{width} x {height}"
            );
            // Contradicted by the pictures, these vectors must only stay within bounds.
            generate(&picture, &picture, &moving, t);
        }
    }
}

#[test]
fn a_generator_takes_sizes_in_any_order() {
    let mut generator = CpuGenerator::new();
    for (width, height) in [(64, 40), (8, 8), (80, 64), (1, 1), (64, 40)] {
        let (before, after) = (draw(width, height, texture), draw(width, height, |x, y| texture(x - 2.0, y)));
        let guidance = guide(width, height, |_, _| ([-2.0, 0.0], 0.5));
        let mut out = Picture::new(width, height).unwrap();
        let pair = AnchorPair::new(&before, &after, &guidance).unwrap();
        let report = generator.generate(&pair, 0.5, &mut out).unwrap();
        assert_eq!((out, report), generate(&before, &after, &guidance, 0.5));
    }
}

#[test]
fn hostile_vectors_neither_panic_nor_smear() {
    let picture = draw(40, 30, noise);
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 65504.0, -65504.0, 1e9, -1e9, 6e-8, -0.0, 39.0];
    for (i, &x) in odd.iter().enumerate() {
        for &y in &odd[i..] {
            let mut guidance = Guidance::new(40, 30, paper::PROJECTION).unwrap();
            guidance.motion_mut().vectors_mut().fill([f16::from_f32(x), f16::from_f32(y)]);
            guidance.depth_mut().depth_mut().fill(y);
            for t in [0.25, 0.5, 0.75] {
                let (out, report) = generate(&picture, &picture, &guidance, t);
                assert_eq!(report.outcome, Outcome::Generated);
                // Static content explains the pictures better than those vectors wherever the noise has contrast.
                let wrong = unlike(&out, &picture, 1, |_, _| true);
                assert!(wrong.len() <= 12, "({x}, {y}) at {t}: {} pixels, the first at {:?}", wrong.len(), wrong[0]);
            }
            extrapolate(&Anchor::new(&picture, &guidance).unwrap(), 0.5);
        }
    }
}

#[test]
fn a_repeated_frame_stays_whatever_its_vectors() {
    let picture = draw(64, 48, noise);
    for vector in [[3.5, -2.0], [0.25, 0.0], [-20.0, 11.0]] {
        let (out, report) = generate(&picture, &picture, &guide(64, 48, |_, _| (vector, 0.5)), 0.5);
        assert_eq!(report.outcome, Outcome::Generated);
        let wrong = unlike(&out, &picture, 24, |_, _| true);
        assert!(wrong.len() <= 30, "{vector:?}: {} pixels, the first at {:?}", wrong.len(), wrong[0]);
    }
}

#[test]
fn fades_and_flashes_change_only_brightness() {
    let ground = draw(64, 48, landscape);
    let still = guide(64, 48, |_, _| ([0.0; 2], 0.5));
    for lit in [
        draw(64, 48, |x, y| landscape(x, y).map(|v| v / 3)),
        draw(64, 48, |x, y| landscape(x, y).map(|v| v.saturating_add(90))),
        draw(64, 48, |_, _| [255; 3]),
        draw(64, 48, |_, _| [0; 3]),
    ] {
        for (before, after) in [(&ground, &lit), (&lit, &ground)] {
            for t in [0.25, 0.5, 0.75] {
                let (out, report) = generate(before, after, &still, t);
                assert_ne!(report.outcome, Outcome::Held);
                let mixture = |a: u8, b: u8| (f32::from(a) + (f32::from(b) - f32::from(a)) * t).round() as u8;
                for ((out, a), b) in out.rgba().iter().zip(before.rgba()).zip(after.rgba()) {
                    let is_mixture = out.abs_diff(mixture(*a, *b)) <= 1;
                    assert!(is_mixture || report.outcome == Outcome::CutFallback && (out == a || out == b));
                }
            }
        }
    }
}

#[test]
fn nan_and_infinity_do_not_spread() {
    let (width, height) = (48, 40);
    let scene = |t: f64| {
        let bytes = draw(width, height, |x, y| texture(x - 6.0 * t, y));
        let mut picture = PictureF16::new(width, height).unwrap();
        for (half, pixel) in picture.pixels_mut().iter_mut().zip(bytes.pixels()) {
            *half = pixel.map(|v| f16::from_f32(f32::from(v) / 255.0));
        }
        picture
    };
    let guidance = guide(width, height, |_, _| ([-6.0, 0.0], 0.5));
    let at = |x: u32, y: u32| (y * width + x) as usize;
    let made = |bad: Option<f16>| {
        let (mut before, mut after) = (scene(0.0), scene(1.0));
        if let Some(bad) = bad {
            before.pixels_mut()[at(20, 20)] = [bad; 4];
            after.pixels_mut()[at(26, 20)] = [bad; 4];
        }
        let mut out = PictureF16::new(width, height).unwrap();
        let pair = AnchorPair::new(&before, &after, &guidance).unwrap();
        assert_eq!(CpuGenerator::new().generate(&pair, 0.5, &mut out).unwrap().outcome, Outcome::Generated);
        out
    };
    let clean = made(None);
    for bad in [f16::NAN, f16::INFINITY, f16::NEG_INFINITY, f16::MAX] {
        let out = made(Some(bad));
        for (i, (a, b)) in out.pixels().iter().zip(clean.pixels()).enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            // Samples reach three pixels, and overlay detection uses patches of three.
            let is_near = x.abs_diff(23) <= 6 && y.abs_diff(20) <= 3;
            assert!(is_near || a == b, "{bad} at ({x}, {y})");
            assert!(a.iter().all(|v| v.is_finite()), "{bad} at ({x}, {y})");
        }
    }
}

#[test]
fn a_picture_of_8k_is_generated() {
    let (width, height) = (7680_u32, 4320_u32);
    let scene = |shift: u32| {
        let mut picture = Picture::new(width, height).unwrap();
        for (y, row) in picture.pixels_mut().chunks_mut(width as usize).enumerate() {
            for (x, pixel) in row.iter_mut().enumerate() {
                let level = (x as u32 + 64 - shift) / 16 * 37 + y as u32 / 16 * 101;
                *pixel = [level as u8, (level >> 1) as u8, (level * 3) as u8, 255];
            }
        }
        picture
    };
    let mut motion = MotionField::tiled(width, height, 16).unwrap();
    motion.vectors_mut().fill([f16::from_f32(-32.0), f16::ZERO]);
    let mut depth = DepthMap::tiled(width, height, 16, paper::PROJECTION).unwrap();
    depth.depth_mut().fill(0.5);
    let guidance = Guidance::from_parts(motion, depth, MotionOrigin::Geometry).unwrap();
    let (picture, report) = generate(&scene(0), &scene(32), &guidance, 0.5);
    assert_eq!(report.outcome, Outcome::Generated);
    assert_eq!(unlike(&picture, &scene(16), 0, |_, _| true), []);
}

#[test]
fn vectors_that_are_not_finite_are_no_motion() {
    let (before, after) = (draw(48, 32, texture), draw(48, 32, |x, y| texture(x + 1.0, y)));
    let still = guide(48, 32, |_, _| ([0.0; 2], 0.5));
    for bad in [[f16::NAN, f16::ONE], [f16::ONE, f16::INFINITY], [f16::NEG_INFINITY, f16::NAN]] {
        let mut guidance = still.clone();
        guidance.motion_mut().vectors_mut().fill(bad);
        assert_eq!(generate(&before, &after, &guidance, 0.5), generate(&before, &after, &still, 0.5));
    }
}

#[test]
fn extrapolation_goes_on_for_one_interval_and_then_holds() {
    let scene = |t: f64| draw(96, 64, |x, y| noise(x - 12.0 * t, y));
    let guidance = guide(96, 64, |_, _| ([-12.0, 0.0], 0.5));
    let now = scene(1.0);
    let anchor = Anchor::new(&now, &guidance).unwrap();
    for t in [0.25, 0.5, 0.75, 1.0] {
        let (picture, outcome) = extrapolate(&anchor, t);
        assert_eq!(outcome, Outcome::Generated);
        // Content that enters at the left is in no anchor.
        let unseen = (12.0 * t) as i64;
        assert_eq!(worst(&picture, &scene(1.0 + f64::from(t)), |x, _| x >= unseen).0, 0, "t = {t}");
    }
    let last = extrapolate(&anchor, 1.0).0;
    for t in [1.001, 2.0, 1e30] {
        assert_eq!(extrapolate(&anchor, t), (last.clone(), Outcome::Held));
    }
    assert_eq!(extrapolate(&anchor.with_cut(true), 0.5), (now.clone(), Outcome::Held));
}

#[test]
fn a_stated_cut_is_used() {
    let picture = draw(32, 24, texture);
    let other = draw(32, 24, |x, y| texture(x - 1.0, y));
    let guidance = guide(32, 24, |_, _| ([-1.0, 0.0], 0.5));
    let pair = AnchorPair::new(&picture, &other, &guidance).unwrap().with_cut(true);
    let mut out = Picture::new(32, 24).unwrap();
    for (t, nearer) in [(0.4, &picture), (0.6, &other)] {
        let report = CpuGenerator::new().generate(&pair, t, &mut out).unwrap();
        assert_eq!((report.outcome, &out), (Outcome::CutFallback, nearer));
    }
}

#[test]
fn wrong_sizes_and_phases_are_refused() {
    let (picture, small) = (draw(32, 24, texture), draw(24, 32, texture));
    let guidance = guide(32, 24, |_, _| ([0.0; 2], 0.5));
    let small_guidance = guide(31, 24, |_, _| ([0.0; 2], 0.5));
    let field = |e: crate::Error| (e.kind(), e.offending_field().map(str::to_owned));
    let bad = |name: &str| (ErrorKind::InvalidArgument, Some(name.to_owned()));
    assert_eq!(field(AnchorPair::new(&small, &picture, &guidance).unwrap_err()), bad("previous"));
    assert_eq!(field(AnchorPair::new(&picture, &picture, &small_guidance).unwrap_err()), bad("guidance"));
    let pair = AnchorPair::new(&picture, &picture, &guidance).unwrap();
    assert_eq!(field(pair.with_previous_depth(small_guidance.depth()).unwrap_err()), bad("previous_depth"));
    assert_eq!(field(Anchor::new(&picture, &small_guidance).unwrap_err()), bad("guidance"));

    let mut generator = CpuGenerator::new();
    assert_eq!((generator.name(), generator.phases()), ("cpu", Phases::Any));
    let pair = AnchorPair::new(&picture, &picture, &guidance).unwrap();
    let anchor = Anchor::new(&picture, &guidance).unwrap();
    let mut wrong = small.clone();
    assert_eq!(field(generator.generate(&pair, 0.5, &mut wrong).unwrap_err()), bad("out"));
    assert_eq!(field(generator.extrapolate(&anchor, 0.5, &mut wrong).unwrap_err()), bad("out"));
    let mut out = picture.clone();
    for t in [0.0, 1.0, -0.5, 1.5, f32::NAN, f32::INFINITY] {
        assert_eq!(field(generator.generate(&pair, t, &mut out).unwrap_err()), bad("t"));
    }
    for t in [0.0, -0.5, f32::NAN, f32::INFINITY] {
        assert_eq!(field(generator.extrapolate(&anchor, t, &mut out).unwrap_err()), bad("t"));
    }
}

#[test]
fn the_number_of_threads_and_earlier_calls_change_no_bit() {
    let (before, after) = (draw(90, 70, texture), draw(90, 70, |x, y| texture(x * 0.97 - 3.0, y + 2.0)));
    // Motion vectors that collide, diverge and leave the picture, so that many pixels depend on the order of depth
    // keys.
    let guidance = guide(90, 70, |x, y| ([(y * 0.7).sin() * 9.0 - x * 0.1, (x * 0.5).cos() * 7.0], 0.5));
    let mut generator = CpuGenerator::new();
    let mut pictures = Vec::new();
    for threads in [1, 2, 5] {
        let pool = Pool::new(threads).unwrap();
        let pair = AnchorPair::new(&before, &after, &guidance).unwrap();
        for _ in 0..3 {
            let mut out = Picture::new(90, 70).unwrap();
            let report = pool.install(|| generator.generate(&pair, 1.0 / 3.0, &mut out)).unwrap();
            assert_eq!(report.outcome, Outcome::Generated);
            pictures.push((out, report));
        }
        generator.reset();
    }
    assert!(pictures.iter().all(|p| *p == pictures[0]));
}

#[test]
fn phases_contain_what_they_name() {
    assert!(Phases::OnlyHalf.contains(0.5) && !Phases::OnlyHalf.contains(0.25));
    assert!(Phases::Any.contains(0.25) && !Phases::Any.contains(0.0) && !Phases::Any.contains(f32::NAN));
}
