//! Properties on synthetic pictures.

use half::f16;

use super::*;
use crate::guidance::{DepthMap, MotionField, MotionOrigin};
use crate::tasks::Pool;

/// A smooth random texture at any position in pixels, in code values around 128.
fn texture(x: f32, y: f32) -> f32 {
    let waves = [(0.11, 0.07, 0.3), (-0.19, 0.23, 1.7), (0.31, 0.13, 4.1), (0.05, -0.29, 2.2), (0.41, -0.37, 5.0)];
    128.0 + waves.iter().map(|(a, b, phase)| 18.0 * (a * x + b * y + phase).sin()).sum::<f32>()
}

/// A grey picture with level `value` at each pixel.
fn picture(width: u32, height: u32, value: impl Fn(f32, f32) -> f32) -> Picture {
    let mut picture = Picture::new(width, height).unwrap();
    for (k, pixel) in (0..).zip(picture.pixels_mut()) {
        let v = value((k % width) as f32, (k / width) as f32).round().clamp(0.0, 255.0) as u8;
        *pixel = [v, v, v, 255];
    }
    picture
}

fn flow(previous: &Picture, current: &Picture) -> Guidance {
    let mut out = Guidance::new(1, 1, PROJECTION).unwrap();
    extract(previous, current, &mut out).unwrap();
    assert_eq!(out.size(), current.size());
    out
}

fn vector(guidance: &Guidance, x: u32, y: u32) -> [f32; 2] {
    guidance.motion().vectors()[(y * guidance.size().0 + x) as usize].map(f32::from)
}

/// The largest error against `truth`, over all pixels at least `margin` pixels from the border.
fn worst(guidance: &Guidance, margin: u32, truth: impl Fn(f32, f32) -> [f32; 2]) -> f32 {
    let (width, height) = guidance.size();
    let mut worst = 0.0_f32;
    for y in margin..height - margin {
        for x in margin..width - margin {
            let ([u, v], [tu, tv]) = (vector(guidance, x, y), truth(x as f32, y as f32));
            worst = worst.max((u - tu).hypot(v - tv));
        }
    }
    worst
}

#[test]
fn translations_are_found() {
    let pans = [
        // Whole pixels first. Sub-pixel motion has larger errors, from 8-bit values and bilinear sampling.
        ([1.0, 0.0], 0.05),
        ([0.0, -3.0], 0.05),
        ([7.0, 4.0], 0.05),
        ([-12.0, 5.0], 0.06),
        ([0.5, 0.25], 0.15),
        ([-2.3, 6.7], 0.15),
    ];
    for (shift, most) in pans {
        let previous = picture(161, 99, texture);
        // The pattern now at x was at x + shift.
        let current = picture(161, 99, |x, y| texture(x + shift[0], y + shift[1]));
        let error = worst(&flow(&previous, &current), 16, |_, _| shift);
        assert!(error < most, "{shift:?}: off by {error} px");
    }
}

#[test]
fn a_rotation_is_found() {
    let (sin, cos) = 0.03_f32.sin_cos();
    let before = |x: f32, y: f32| {
        let (dx, dy) = (x - 80.0, y - 50.0);
        [80.0 + cos * dx - sin * dy, 50.0 + sin * dx + cos * dy]
    };
    let current = picture(161, 101, |x, y| {
        let [px, py] = before(x, y);
        texture(px, py)
    });
    let error = worst(&flow(&picture(161, 101, texture), &current), 12, |x, y| {
        let [px, py] = before(x, y);
        [px - x, py - y]
    });
    assert!(error < 0.35, "off by {error} px");
}

#[test]
fn long_motion_is_found_where_texture_repeats() {
    // Fast camera rotation while walking: up to 28 pixels of motion over a pattern with a period of 14.
    let stripes = |x: f32, y: f32| 0.5 * texture(x, y) + 64.0 + 30.0 * (0.45 * x + 0.02 * y).sin() * (0.4 * y).sin();
    let before = |x: f32, y: f32| [160.0 + 1.1 * (x - 160.0) + 12.0, 90.0 + 1.1 * (y - 90.0) + 3.0];
    let current = picture(320, 180, |x, y| {
        let [px, py] = before(x, y);
        stripes(px, py)
    });
    let out = flow(&picture(320, 180, stripes), &current);
    let mut wrong = 0;
    for y in 0..180 {
        for x in 0..320 {
            let [px, py] = before(x as f32, y as f32);
            let [u, v] = vector(&out, x, y);
            wrong += u32::from((u - px + x as f32).hypot(v - py + y as f32) > 1.0);
        }
    }
    // Some of the motion leads out of the picture.
    assert!(wrong < 320 * 180 / 10, "{wrong} of 57600 pixels are off");
}

#[test]
fn a_change_of_brightness_gives_no_motion() {
    let previous = picture(128, 96, |x, y| 0.8 * texture(x, y));
    let current = picture(128, 96, |x, y| 25.0 + 0.76 * texture(x + 3.0, y - 2.0));
    let error = worst(&flow(&previous, &current), 16, |_, _| [3.0, -2.0]);
    assert!(error < 0.3, "off by {error} px");
}

#[test]
fn a_square_moves_over_a_static_ground() {
    // The ground is dark and the square light, so that the edge between them is visible.
    let ground = |x: f32, y: f32| 0.4 * texture(x, y) + 10.0;
    let held = |x: f32, y: f32| (60.0..100.0).contains(&x) && (40.0..80.0).contains(&y);
    let other = |x: f32, y: f32| 0.4 * texture(1.3 * y, x) + 140.0;
    let draw =
        |shift: f32| picture(160, 120, move |x, y| if held(x + shift, y) { other(x + shift, y) } else { ground(x, y) });
    // The square moves six pixels to the right.
    let out = flow(&draw(0.0), &draw(-6.0));
    let [u, v] = vector(&out, 86, 60);
    assert!((u + 6.0).abs() < 0.1 && v.abs() < 0.1, "{u} {v}");
    for (x, y) in [(30, 30), (130, 60), (86, 100), (40, 60)] {
        let [u, v] = vector(&out, x, y);
        assert!(u.hypot(v) < 0.1, "({x}, {y}): {u} {v}");
    }
}

#[test]
fn a_small_square_that_moves_far_is_found() {
    // On the level where it moves less than a patch's side it is smaller than a patch.
    let ground = |x: f32, y: f32| 0.5 * texture(x, y) + 20.0;
    let held = |x: f32, y: f32| (150.0..182.0).contains(&x) && (70.0..102.0).contains(&y);
    let other = |x: f32, y: f32| 0.8 * texture(1.7 * y, 1.7 * x) + 40.0;
    let draw = |shift: [f32; 2]| {
        picture(320, 180, move |x, y| {
            let (x, y) = (x + shift[0], y + shift[1]);
            if held(x, y) { other(x, y) } else { ground(x - shift[0], y - shift[1]) }
        })
    };
    // It moves 27 pixels to the left and 15 down.
    let out = flow(&draw([0.0; 2]), &draw([27.0, -15.0]));
    for (x, y) in [(139, 101), (133, 95), (145, 107)] {
        let [u, v] = vector(&out, x, y);
        assert!((u - 27.0).abs() < 0.1 && (v + 15.0).abs() < 0.1, "({x}, {y}): {u} {v}");
    }
    for (x, y) in [(60, 60), (250, 120), (139, 40)] {
        let [u, v] = vector(&out, x, y);
        assert!(u.hypot(v) < 0.1, "({x}, {y}): {u} {v}");
    }
}

#[test]
fn inconsistent_motion_is_replaced_from_neighbours_of_similar_colour() {
    // Dark left of column 16, light from there on; each half has its own motion, and columns 12 to 19 are given a wrong one.
    let half = |x: usize| if x < 16 { [0.0, 1.0] } else { [-3.0, 0.0] };
    let wrong = |x: usize| (12..20).contains(&x);
    let field = |value: &dyn Fn(usize) -> [f32; 2]| {
        let mut dense = Dense::default();
        let plane = pyramid::Plane { width: 32, height: 16, luma: vec![0.0; 32 * 16] };
        let mut grid = Grid::default();
        grid.search(Level::new(), &plane, &plane, None, FirstSearch { stride: grid::STRIDE, is_wide: true }).unwrap();
        grid.smooth(Level::new()).unwrap();
        dense.densify(Level::new(), &plane, &plane, &grid).unwrap();
        for (k, flow) in dense.flow.iter_mut().enumerate() {
            *flow = value(k % 32);
        }
        dense
    };
    let flow = field(&|x| if wrong(x) { [4.0, -4.0] } else { half(x) });
    let back = field(&|x| half(x).map(|v| -v));
    let seen = picture(32, 16, |x, _| if x < 16.0 { 40.0 } else { 200.0 });
    let mut consistency = Consistency::default();
    consistency.check(&flow, &back, 0, Rules::default()).unwrap();
    let y = 8;
    for x in 0..32 {
        assert_eq!(consistency.row(y)[x], !wrong(x), "{x}");
        let [u, v] = if wrong(x) { consistency.fill_from_rays(&flow, &seen, 0, x, y) } else { flow.flow[y * 32 + x] };
        let [tu, tv] = half(x);
        assert!((u - tu).hypot(v - tv) < 0.05, "column {x}: {u} {v}");
    }
    // At the lower edge the left half's motion leads out of the picture and cannot be checked.
    assert!(!consistency.row(15)[3] && consistency.row(14)[3]);
}

#[test]
fn equal_and_flat_pictures_have_no_motion_at_all() {
    let still = |previous: &Picture, current: &Picture| {
        let out = flow(previous, current);
        assert!(out.motion().vectors().iter().all(|v| v.map(f16::to_bits) == [0, 0]), "{:?}", current.size());
        assert!(out.depth().depth().iter().all(|d| *d == FLAT_DEPTH));
    };
    for (width, height) in [(1, 1), (1, 40), (37, 1), (2, 3), (7, 9), (25, 24), (100, 51)] {
        let one = picture(width, height, texture);
        still(&one, &one);
        still(&picture(width, height, |_, _| 90.0), &picture(width, height, |_, _| 90.0));
        still(&picture(width, height, |_, _| 10.0), &picture(width, height, |_, _| 250.0));
    }
}

#[test]
fn unrelated_pictures_give_finite_motion_inside_the_picture() {
    let noise = |seed: u32| {
        move |x: f32, y: f32| {
            let k = (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b) ^ seed;
            let k = (k ^ (k >> 15)).wrapping_mul(0x2c1b_3c6d);
            (((k ^ (k >> 12)).wrapping_mul(0x297a_2d39) >> 13) & 255) as f32
        }
    };
    for (width, height) in [(1, 1), (3, 2), (5, 64), (97, 61)] {
        let out = flow(&picture(width, height, noise(1)), &picture(width, height, noise(77)));
        for [u, v] in out.motion().vectors() {
            assert!(u.to_f32().abs() <= width as f32 && v.to_f32().abs() <= height as f32, "{u} {v}");
        }
    }
}

#[test]
fn results_do_not_depend_on_threads_or_earlier_pictures() {
    let previous = picture(131, 77, texture);
    let current = picture(131, 77, |x, y| texture(x * 1.02 + 2.0, y * 0.99 - 1.0));
    let with = |threads: usize| {
        let pool = Pool::new(threads).unwrap();
        pool.install(|| {
            let mut extractor = Extractor::new();
            let mut out = Guidance::new(131, 77, PROJECTION).unwrap();
            if threads == 3 {
                // The extractor first gets a larger picture, and the pair in reverse order.
                let large = picture(200, 150, texture);
                extractor.extract(&large, &large, &mut out).unwrap();
                extractor.extract(&current, &previous, &mut out).unwrap();
            }
            extractor.extract(&previous, &current, &mut out).unwrap();
            out
        })
    };
    let one = with(1);
    assert!(one.motion().peak() > 1.0);
    assert!(one == with(2) && one == with(3));
}

#[test]
fn results_do_not_depend_on_vector_instructions() {
    let best = Level::new();
    let mut levels = vec![Level::baseline(), best];
    #[cfg(target_arch = "x86_64")]
    {
        levels.extend(best.as_sse4_2().map(Level::Sse4_2));
        levels.extend(best.as_avx2().map(Level::Avx2));
    }
    // The larger picture has more than a megapixel. In both, blocks extend outside the picture.
    for (width, height) in [(131, 77), (1253, 841)] {
        let previous = picture(width, height, texture);
        // A patch with its own motion covers part of the picture, so that there are motion edges.
        let current = picture(width, height, |x, y| {
            if (40.0..83.0).contains(&x) { texture(x + 9.0, y) } else { texture(x * 1.01 + 2.0, y * 0.99 - 1.0) }
        });
        let at = |level: Level| {
            let mut out = Guidance::new(width, height, PROJECTION).unwrap();
            Extractor::at(level).extract(&previous, &current, &mut out).unwrap();
            out
        };
        let plain = at(levels[0]);
        assert!(plain.motion().peak() > 1.0);
        for &level in &levels[1..] {
            assert!(at(level) == plain, "{level:?} at {width} x {height}");
        }
    }
}

#[test]
fn tiled_guidance_becomes_per_pixel() {
    let one = picture(40, 30, texture);
    let mut out = Guidance::from_parts(
        MotionField::tiled(40, 30, 8).unwrap(),
        DepthMap::tiled(40, 30, 8, PROJECTION).unwrap(),
        MotionOrigin::Geometry,
    )
    .unwrap();
    extract(&one, &one, &mut out).unwrap();
    assert!(out == flow(&one, &one));
    assert_eq!(out.motion().vectors().len(), 1200);
}

#[test]
fn pictures_of_two_sizes_are_refused() {
    let mut out = Guidance::new(4, 4, PROJECTION).unwrap();
    let error = extract(&Picture::new(4, 4).unwrap(), &Picture::new(4, 5).unwrap(), &mut out).unwrap_err();
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("previous")));
}
