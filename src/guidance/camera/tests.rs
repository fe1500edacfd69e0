//! Expected motion and depth of a camera over level ground.

use super::*;
use crate::guidance::paper;
use crate::world::KeySet;

const SIZE: (u32, u32) = (320, 180);

fn camera() -> WalkingCamera {
    WalkingCamera {
        vertical_fov: std::f32::consts::FRAC_PI_2,
        turn_per_count: 0.002,
        max_pitch: 1.2,
        walk: 1.5,
        run: 2.0,
        ease: 0.1,
        height: 1.7,
    }
}

fn controls(mouse: [f32; 2], keys: &[u8]) -> ControlInput {
    let mut held = KeySet::NONE;
    keys.iter().for_each(|key| held.insert(Key(*key)));
    ControlInput::new(mouse, held, 0.0).unwrap()
}

fn extractor() -> Extractor {
    Extractor::new(camera(), 0.0).unwrap()
}

fn step(extractor: &mut Extractor, controls: &ControlInput, seconds: u64) -> Guidance {
    let mut out = Guidance::new(1, 1, paper::PROJECTION).unwrap();
    extractor.extract(controls, WorldTime::new(seconds, 1), SIZE, &mut out).unwrap();
    out
}

fn vector(guidance: &Guidance, x: u32, y: u32) -> [f32; 2] {
    guidance.motion().vectors()[(y * SIZE.0 + x) as usize].map(f32::from)
}

#[test]
fn a_camera_at_rest_gives_no_motion_and_the_depth_of_the_ground() {
    let out = step(&mut extractor(), &ControlInput::IDLE, 1);
    assert!(out.motion().vectors().iter().flatten().all(|v| v.to_f32().abs() < 1e-3));
    // A focal length of 90 pixels: 45 rows below the middle the ground is 1.7 * 90 / 45 away.
    let depth = |y: usize| out.depth().depth()[y * SIZE.0 as usize + 160];
    let expected = out.depth().projection().device_depth(1.7 * 90.0 / 45.5);
    assert!((depth(135) - expected).abs() < 1e-6, "{} {expected}", depth(135));
    assert_eq!((depth(10), depth(89)), (1.0, 1.0), "the sky");
    assert!(depth(179) < depth(120) && depth(120) < 1.0);
}

#[test]
fn a_turn_to_the_right_gives_motion_from_the_right() {
    // Two tenths of a radian.
    let out = step(&mut extractor(), &controls([100.0, 0.0], &[]), 1);
    let [u, v] = vector(&out, 160, 20);
    // The point now at the centre was 0.2 rad to the right of it.
    assert!((u - 90.0 * 0.2_f32.tan()).abs() < 0.6 && v.abs() < 1.5, "{u} {v}");
    // When the camera tilts up, points at the top of the picture were outside the previous one.
    let [u, v] = vector(&step(&mut extractor(), &controls([0.0, -100.0], &[]), 1), 160, 90);
    assert!(u.abs() < 0.2 && (v + 90.0 * 0.2_f32.tan()).abs() < 0.6, "{u} {v}");
}

#[test]
fn walking_forwards_brings_the_ground_nearer() {
    let mut walker = extractor();
    // After ten time constants the speed is constant.
    step(&mut walker, &controls([0.0; 2], b"W"), 1);
    let out = step(&mut walker, &controls([0.0; 2], b"W"), 1);
    // On row 135 the ground is 3.363 away and was 4.863: it stood 90 * 1.7 / 4.863 below the middle.
    let [u, v] = vector(&out, 160, 135);
    assert!(u.abs() < 0.2 && (v - (90.0 * 1.7 / 4.863 - 45.5)).abs() < 0.1, "{u} {v}");
    assert!(vector(&out, 160, 40)[1].abs() < 1e-3, "the sky stays");
    let mut runner = extractor();
    step(&mut runner, &controls([0.0; 2], &[b'W', 0x10]), 1);
    let faster = step(&mut runner, &controls([0.0; 2], &[b'W', 0x10]), 1);
    assert!(vector(&faster, 160, 135)[1] < v);
    let mut back = extractor();
    step(&mut back, &controls([0.0; 2], b"S"), 1);
    assert!(vector(&step(&mut back, &controls([0.0; 2], b"S"), 1), 160, 135)[1] > 0.0);
}

#[test]
fn it_walks_in_the_direction_of_view() {
    // A half turn, then walking backwards: the scene ahead recedes as if the camera had not turned.
    let mut walker = extractor();
    step(&mut walker, &controls([std::f32::consts::PI / 0.002, 0.0], &[]), 1);
    step(&mut walker, &controls([0.0; 2], b"W"), 1);
    let turned = step(&mut walker, &controls([0.0; 2], b"W"), 1);
    let mut straight = extractor();
    step(&mut straight, &controls([0.0; 2], b"W"), 1);
    let straight = step(&mut straight, &controls([0.0; 2], b"W"), 1);
    for (x, y) in [(100, 140), (160, 120), (300, 170)] {
        let ([a, b], [c, d]) = (vector(&turned, x, y), vector(&straight, x, y));
        assert!((a - c).hypot(b - d) < 0.1, "{a} {b} for {c} {d}");
    }
    // A step to the right: the ground shifts, the sky does not.
    let mut aside = extractor();
    step(&mut aside, &controls([0.0; 2], b"D"), 1);
    let aside = step(&mut aside, &controls([0.0; 2], b"D"), 1);
    assert!(vector(&aside, 160, 150)[0] > 1.0 && vector(&aside, 160, 30) == [0.0; 2]);
}

#[test]
fn speed_changes_gradually_and_pitch_is_limited() {
    let mut walker = extractor();
    let travelled = |walker: &mut Extractor, keys: &[u8]| walker.advance(&controls([0.0; 2], keys), 0.05)[1];
    let (first, second) = (travelled(&mut walker, b"W"), travelled(&mut walker, b"W"));
    assert!(0.0 < first && first < second && second < 1.5 * 0.05, "{first} {second}");
    let after = travelled(&mut walker, b"");
    assert!(0.0 < after && after < second);
    walker.advance(&controls([0.0, -30_000.0], &[]), 0.05);
    assert!((walker.pitch - 1.2).abs() < 1e-6);
    let out = step(&mut walker, &controls([0.0, 30_000.0], b"WA"), 1);
    assert!(out.motion().vectors().iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn impossible_cameras_are_refused() {
    for (camera, field) in [
        (WalkingCamera { vertical_fov: 3.2, ..camera() }, "vertical_fov"),
        (WalkingCamera { vertical_fov: 0.0, ..camera() }, "vertical_fov"),
        (WalkingCamera { turn_per_count: f32::NAN, ..camera() }, "turn_per_count"),
        (WalkingCamera { max_pitch: 1.6, ..camera() }, "max_pitch"),
        (WalkingCamera { walk: f32::INFINITY, ..camera() }, "walk"),
        (WalkingCamera { height: -1.0, ..camera() }, "height"),
    ] {
        assert_eq!(Extractor::new(camera, 0.0).unwrap_err().offending_field(), Some(field));
    }
    assert_eq!(Extractor::new(camera(), 1.3).unwrap_err().offending_field(), Some("pitch"));
}
