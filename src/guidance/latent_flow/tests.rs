//! Properties on synthetic latents.

use super::*;
use crate::tasks::Pool;

const SHAPE: [usize; 3] = [6, 10, 16];

/// A smooth random texture of a channel at any position in cells.
fn texture(channel: usize, x: f32, y: f32) -> f32 {
    let waves = [(0.61, 0.37, 0.3), (-0.59, 0.83, 1.7), (0.91, 0.43, 4.1), (0.25, -0.89, 2.2)];
    let turn = channel as f32 * 1.3;
    let of = |(i, (a, b, phase)): (usize, &(f32, f32, f32))| {
        (a * x + b * y + phase + turn * (i as f32 + 1.0)).sin() * (1.0 + channel as f32)
    };
    waves.iter().enumerate().map(of).sum::<f32>() + 10.0 * channel as f32
}

fn latent(value: impl Fn(usize, f32, f32) -> f32) -> Vec<f32> {
    let [channels, height, width] = SHAPE;
    let indices = (0..channels).flat_map(|c| (0..height).flat_map(move |y| (0..width).map(move |x| (c, x, y))));
    indices.map(|(c, x, y)| value(c, x as f32, y as f32)).collect()
}

fn view(values: &[f32]) -> LatentView<'_> {
    let [channels, height, width] = SHAPE;
    LatentView::new(channels, height, width, values).unwrap()
}

fn flow(z0: &[f32], z1: &[f32], render: (u32, u32)) -> Guidance {
    let mut out = Guidance::new(1, 1, PROJECTION).unwrap();
    extract(view(z0), view(z1), render, &mut out).unwrap();
    assert_eq!(out.size(), render);
    out
}

fn vector(guidance: &Guidance, x: u32, y: u32) -> [f32; 2] {
    guidance.motion().vectors()[(y * guidance.size().0 + x) as usize].map(f32::from)
}

#[test]
fn a_shift_in_cells_is_motion_in_pixels_of_the_picture() {
    let z0 = latent(texture);
    for shift in [[1.0, 0.0], [0.0, -1.0], [0.5, 0.25], [-1.75, 0.75], [0.1, -0.4]] {
        // The pattern now at x was at x + shift.
        let z1 = latent(|c, x, y| texture(c, x + shift[0], y + shift[1]));
        // A cell has 20 pixels across and 18 down.
        let out = flow(&z0, &z1, (320, 180));
        for (x, y) in [(160, 90), (110, 70), (200, 110)] {
            let [u, v] = vector(&out, x, y);
            let apart = (u - 20.0 * shift[0]).hypot(v - 18.0 * shift[1]);
            assert!(apart < 3.0, "{shift:?}: {u} {v} at {x} {y}");
        }
        assert!(out.depth().depth().iter().all(|depth| *depth == picture_flow::FLAT_DEPTH));
    }
}

#[test]
fn two_halves_move_apart() {
    let z0 = latent(texture);
    let shift = |x: f32| if x < 8.0 { 1.0 } else { -1.0 };
    let z1 = latent(|c, x, y| texture(c, x + shift(x), y));
    let out = flow(&z0, &z1, (320, 180));
    let [left, right] = [70, 250].map(|x| vector(&out, x, 90)[0]);
    assert!((left - 20.0).abs() < 4.0 && (right + 20.0).abs() < 4.0, "{left} {right}");
}

#[test]
fn equal_latents_and_latents_without_texture_have_no_motion() {
    let z0 = latent(texture);
    let even = latent(|c, _, _| c as f32);
    for (before, now) in [(&z0, &z0), (&even, &even)] {
        assert!(flow(before, now, (64, 40)).motion().vectors().iter().all(|v| *v == [f16::ZERO; 2]));
    }
}

#[test]
fn a_channel_of_large_amplitude_does_not_outweigh_the_others() {
    // One channel does not move and has a thousand times the amplitude.
    let loud = |shift: f32| {
        move |c: usize, x: f32, y: f32| {
            if c == 5 { 1000.0 * texture(c, x, y) } else { texture(c, x + shift, y) }
        }
    };
    let out = flow(&latent(loud(0.0)), &latent(loud(1.0)), (320, 180));
    let [u, v] = vector(&out, 160, 90);
    // One of six channels votes for no motion, with a sixth of the weight.
    assert!((14.0..20.5).contains(&u) && v.abs() < 3.0, "{u} {v}");
}

#[test]
fn non_finite_values_and_odd_shapes_are_accepted() {
    let mut broken = latent(texture);
    broken[7] = f32::NAN;
    broken[300] = f32::INFINITY;
    let out = flow(&broken, &latent(texture), (33, 17));
    assert!(out.motion().vectors().iter().flatten().all(|v| v.is_finite()));
    let (one, other) = ([1.0_f32], [2.0_f32]);
    let cell = |values| LatentView::new(1, 1, 1, values).unwrap();
    let mut out = Guidance::new(3, 5, PROJECTION).unwrap();
    extract(cell(&one), cell(&other), (3, 5), &mut out).unwrap();
    assert!(out.motion().vectors().iter().all(|v| *v == [f16::ZERO; 2]));
    let error = extract(cell(&one), view(&broken), (3, 5), &mut out).unwrap_err();
    assert_eq!(error.offending_field(), Some("z0"));
}

#[test]
fn threads_change_nothing() {
    let (z0, z1) = (latent(texture), latent(|c, x, y| texture(c, 1.1 * x - 0.7, 1.1 * y)));
    let alone = Pool::new(1).unwrap();
    let several = Pool::new(5).unwrap();
    let [a, b] = [alone, several].map(|pool| pool.install(|| flow(&z0, &z1, (320, 180))));
    assert_eq!(a, b);
}
