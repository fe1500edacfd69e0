//! The extractor against numpy's results, and properties that follow from the formulas.

use serde::Deserialize;

use super::*;
use crate::ErrorKind;
use crate::guidance::MotionField;

/// A file written by `golden/make_paper.py`.
#[derive(Deserialize)]
struct Golden {
    shape: [usize; 3],
    render: (u32, u32),
    z0: Vec<f32>,
    z1: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    depth: Vec<f32>,
}

fn view(shape: [usize; 3], values: &[f32]) -> LatentView<'_> {
    LatentView::new(shape[0], shape[1], shape[2], values).unwrap()
}

/// Extracts from latents of `shape` into fresh guidance of `render` size.
fn extracted(shape: [usize; 3], z0: &[f32], z1: &[f32], render: (u32, u32)) -> Guidance {
    let mut out = Guidance::new(render.0, render.1, PROJECTION).unwrap();
    extract(view(shape, z0), view(shape, z1), render, &mut out).unwrap();
    out
}

/// Latent values without a pattern.
fn values(len: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    std::iter::repeat_with(|| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    })
    .take(len)
    .collect()
}

fn vectors(motion: &MotionField) -> Vec<[f32; 2]> {
    motion.vectors().iter().map(|v| v.map(f16::to_f32)).collect()
}

#[test]
fn results_match_numpy() {
    for text in [
        include_str!("../golden/paper_grid.json"),
        include_str!("../golden/paper_clamped.json"),
        include_str!("../golden/paper_one_wide.json"),
        include_str!("../golden/paper_smaller.json"),
    ] {
        let golden: Golden = serde_json::from_str(text).unwrap();
        let out = extracted(golden.shape, &golden.z0, &golden.z1, golden.render);
        let expected = golden.x.iter().zip(&golden.y);
        assert_eq!(out.motion().vectors().len(), golden.x.len());
        for (i, ([x, y], (&gx, &gy))) in vectors(out.motion()).into_iter().zip(expected).enumerate() {
            for (have, want) in [(x, gx), (y, gy)] {
                // Half a step of f16 at that size, and the rounding of f32 before it.
                assert!((have - want).abs() <= want.abs() * 0.0005 + 2e-6, "{have} for {want} at {i}");
            }
        }
        for (have, want) in out.depth().depth().iter().zip(&golden.depth) {
            assert!((have - want).abs() <= 1e-6, "{have} for {want}");
        }
    }
}

#[test]
fn another_scale_changes_only_motion() {
    let (shape, render) = ([3, 4, 6], (32, 24));
    let (z0, z1) = (values(72, 1), values(72, 2));
    let published = extracted(shape, &z0, &z1, render);
    let with = |scale: f32| {
        let mut out = Guidance::new(render.0, render.1, PROJECTION).unwrap();
        Extractor::scaled(scale).extract(view(shape, &z0), view(shape, &z1), render, &mut out).unwrap();
        out
    };
    assert_eq!(with(COMPRESSION), published);
    let halved = with(COMPRESSION / 2.0);
    assert_eq!(halved.depth(), published.depth());
    for (a, b) in vectors(halved.motion()).into_iter().flatten().zip(vectors(published.motion()).into_iter().flatten())
    {
        assert!((a - b / 2.0).abs() <= b.abs() * 0.001 + 1e-6, "{a} {b}");
    }
    assert!(vectors(with(f32::NAN).motion()).into_iter().flatten().all(|v| v == 0.0));
}

#[test]
fn motion_is_opposite_to_the_gradient_of_the_difference() {
    // The difference grows by 0.25 a column and falls by 0.5 a row, so d = (0.25, -0.5) and m = -8 d, everywhere.
    let (height, width) = (4, 6);
    let z0 = vec![0.0; 3 * height * width];
    let z1: Vec<f32> = (0..3 * height * width)
        .map(|i| (i % width) as f32 * 0.25 - (i / width % height) as f32 * 0.5 + (i / (width * height)) as f32)
        .collect();
    let out = extracted([3, height, width], &z0, &z1, (32, 24));
    assert!(vectors(out.motion()).iter().all(|&v| v == [-2.0, 4.0]));
}

#[test]
fn equal_latents_give_no_motion_and_swapped_latents_the_opposite() {
    let (a, b) = (values(4 * 5 * 6, 1), values(4 * 5 * 6, 2));
    let still = extracted([4, 5, 6], &a, &a, (18, 17));
    assert!(still.motion().vectors().iter().flatten().all(|v| v.to_bits() == 0));
    let there = vectors(extracted([4, 5, 6], &a, &b, (18, 17)).motion());
    let back = vectors(extracted([4, 5, 6], &b, &a, (18, 17)).motion());
    assert!(there.iter().zip(&back).all(|(t, b)| *t == b.map(|v| 0.0 - v)));
}

#[test]
fn motion_is_clamped_to_the_render_size() {
    let z1 = [0.0, 1e30, -1e30, 3e38, -3e38, 0.0];
    let out = extracted([1, 2, 3], &[0.0; 6], &z1, (48, 20));
    let (mut x_peak, mut y_peak) = (0.0_f32, 0.0_f32);
    for [x, y] in vectors(out.motion()) {
        (x_peak, y_peak) = (x_peak.max(x.abs()), y_peak.max(y.abs()));
    }
    assert_eq!((x_peak, y_peak), (48.0, 20.0));
}

#[test]
fn depth_spans_zero_to_one_and_a_constant_is_zero() {
    let z = [3.0, -1.0, 7.0, 7.0, 9.0, 9.0, 9.0, 9.0];
    let out = extracted([2, 2, 2], &z, &z, (2, 2));
    assert_eq!(out.depth().depth(), [0.5, 0.0, 1.0, 1.0]);
    assert_eq!(out.depth().projection(), PROJECTION);
    let flat = extracted([1, 2, 2], &[0.0; 4], &[5.0; 4], (3, 3));
    assert!(flat.depth().depth().iter().all(|&v| v == 0.0));
}

#[test]
fn non_finite_values_give_zero_in_their_cells() {
    let mut z1 = values(3 * 5 * 5, 3);
    let clean = extracted([3, 5, 5], &[0.0; 75], &z1, (5, 5));
    z1[12] = f32::NAN;
    let out = extracted([3, 5, 5], &[0.0; 75], &z1, (5, 5));
    for (i, (have, was)) in vectors(out.motion()).into_iter().zip(vectors(clean.motion())).enumerate() {
        // The centre is cell (2, 2): the x gradient beside it, the y gradient above and below it.
        let expected = match i {
            11 | 13 => [0.0, was[1]],
            7 | 17 => [was[0], 0.0],
            _ => was,
        };
        assert_eq!(have, expected, "cell {i}");
    }
    assert_eq!(out.depth().depth()[12], 0.0);

    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let out = extracted([2, 3, 3], &[bad; 18], &[bad; 18], (7, 5));
        assert!(out.motion().vectors().iter().flatten().all(|v| v.to_bits() == 0));
        assert!(out.depth().depth().iter().all(|&v| v == 0.0));
    }
}

#[test]
fn output_and_working_memory_are_resized_as_needed() {
    let mut extractor = Extractor::new();
    let mut out = Guidance::new(1, 1, Projection::new(1.0, 2.0, 0.5).unwrap()).unwrap();
    for (shape, render) in [([3, 4, 5], (16, 9)), ([1, 1, 1], (4, 4)), ([2, 8, 8], (1, 1)), ([3, 4, 5], (16, 9))] {
        let len = shape.iter().product();
        let (a, b) = (values(len, 4), values(len, 5));
        extractor.extract(view(shape, &a), view(shape, &b), render, &mut out).unwrap();
        assert_eq!((out.size(), out.depth().projection()), (render, PROJECTION));
        assert_eq!(out, extracted(shape, &a, &b, render));
    }
}

#[test]
fn latents_that_do_not_match_are_refused() {
    let values = [0.0; 12];
    let mut out = Guidance::new(4, 4, PROJECTION).unwrap();
    let mut run = |a, b, render| extract(view(a, &values), view(b, &values), render, &mut out).unwrap_err();
    assert_eq!(run([1, 3, 4], [1, 4, 3], (4, 4)).offending_field(), Some("z0"));
    assert_eq!(run([1, 3, 4], [1, 3, 4], (0, 4)).kind(), ErrorKind::InvalidArgument);
    assert_eq!(run([1, 3, 4], [1, 3, 4], (4, 65_536)).kind(), ErrorKind::InvalidArgument);
    for shape in [[1, 3, 5], [0, 3, 4], [usize::MAX, 2, 2]] {
        assert_eq!(
            LatentView::new(shape[0], shape[1], shape[2], &values).unwrap_err().offending_field(),
            Some("latent")
        );
    }
    assert!(LatentView::new(0, 0, 0, &[]).is_err());
}
