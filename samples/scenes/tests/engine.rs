//! What engines give, against the truth that it was made from.

use cairn::guidance::DepthEncoding;
use cairn::world::ControlScript;
use glam::{Vec2, Vec3};
use scenes::camera::view_distance;
use scenes::engine::{Engine, EngineOptions, MotionFormat};
use scenes::{Clip, ClipFrame, ClipOptions, Effects, Family, Frame, MotionKind, Quality, Scene, render};

const SIZE: (u32, u32) = (320, 180);
const SCRIPT: &str = "cairn-controls 1\n0..9 hold W\n0..9 mouse 1800 0\n9 end\n";

fn frames(scene: &Scene, rate: u32, samples: u32, count: usize, effects: Effects) -> Vec<ClipFrame> {
    let script = ControlScript::parse(SCRIPT).expect("a script");
    let options =
        ClipOptions { width: SIZE.0, height: SIZE.1, rate, quality: Quality { samples }, ..ClipOptions::default() };
    let mut clip = Clip::with_effects(scene, &script, options, effects).expect("a rate in range");
    (0..count).map(|_| clip.next_frame().expect("a frame")).collect()
}

fn centre(k: usize) -> Vec2 {
    Vec2::new((k % SIZE.0 as usize) as f32, (k / SIZE.0 as usize) as f32) + 0.5
}

/// Depth as the reciprocal of the distance, which is linear over a plane, of the 3 x 3 pixels around a position; `None` at the border.
fn around(frame: &Frame, at: Vec2) -> Option<[f32; 9]> {
    let (x, y) = (at.x.floor() as i32, at.y.floor() as i32);
    let inside = x >= 1 && y >= 1 && x + 1 < SIZE.0 as i32 && y + 1 < SIZE.1 as i32;
    let near = |k: i32| 1.0 / view_distance(frame.depth[((y + k / 3 - 1) * SIZE.0 as i32 + x + k % 3 - 1) as usize]);
    inside.then(|| std::array::from_fn(|k| near(k as i32)))
}

/// Whether one surface is visible at `at` and all around it, at a distance that differs by at most 5 % from `distance`.
fn one_surface(frame: &Frame, at: Vec2, distance: f32) -> bool {
    around(frame, at).is_some_and(|near| {
        let smooth = (0..4).all(|k| ((near[k] + near[8 - k]) * 0.5 / near[4] - 1.0).abs() < 0.004);
        smooth && (1.0 / near[4] / distance - 1.0).abs() < 0.05
    })
}

#[test]
fn composed_vectors_equal_the_vectors_over_all_frames() {
    for (family, span) in [(Family::Forest, 2), (Family::Desert, 4)] {
        let scene = Scene::new(family, 3);
        let frames = frames(&scene, 60, 1, 30, Effects::default());
        let mut engine = Engine::new(EngineOptions { frames: span as u32, ..Default::default() }).expect("options");
        let inputs = frames.iter().map(|f| engine.push(&f.frame, &f.now, &f.before)).last().expect("frames");
        let [now, then] = [29, 29 - span].map(|n: usize| frames[n].now);
        let exact = render(&scene, &now, &then, SIZE.0, SIZE.1, Quality { samples: 1 });
        assert!(!inputs.reset);
        let (mut compared, mut worst, mut longest) = (0, 0.0_f32, 0.0_f32);
        for (k, exact_motion) in exact.motion.iter().enumerate() {
            let distance = view_distance(exact.depth[k]);
            if distance > 900.0 || !one_surface(&exact, centre(k), distance) {
                continue;
            }
            // Where the point is in every frame on the way, by its exact motion, it is visible with all that is around it.
            let visible = (1..=span).all(|back| {
                let then = frames[29 - back].now.view(SIZE.0, SIZE.1);
                let view = now.view(SIZE.0, SIZE.1);
                let point = view.eye + view.to_world(view.ray(centre(k)) * distance);
                let seen = then.to_view(point);
                seen.z > 0.1 && one_surface(&frames[29 - back].frame, then.project(seen), seen.z)
            });
            if visible {
                compared += 1;
                worst = worst.max(inputs.motion.vectors[k].distance(*exact_motion));
                longest = longest.max(exact_motion.length());
            }
        }
        println!("{family}: {compared} vectors up to {longest:.1} px differ by at most {worst:.4} px");
        assert!(compared > 5000 && longest > 4.0, "{family}: {compared} vectors up to {longest} px");
        assert!(worst < 0.1, "{family}: {worst} px");
    }
}

#[test]
fn formats_keep_their_error_bound_and_reach_it() {
    let size = Vec2::new(1280.0, 720.0);
    for format in [MotionFormat::Half, MotionFormat::Unorm16, MotionFormat::Unorm16Root, MotionFormat::Unorm8Root] {
        let mut reached = 0.0_f32;
        for k in 0..40_000 {
            let angle = k as f32 * 2.399_963;
            let motion = Vec2::from_angle(angle) * 1.0003_f32.powi(k % 20_000) * 0.5;
            let error = (format.round_trip(motion, size) - motion).abs();
            // Vectors are single-precision numbers.
            let rounding = motion.abs() * 2e-7;
            let bound = format.error_bound(motion, size) + rounding;
            assert!(error.cmple(bound).all(), "{format:?}: {motion} is off by {error}, bound {bound}");
            reached = reached.max((error / bound).max_element());
        }
        assert!(reached > 0.97, "{format:?}: only {reached} of the bound is reached");
        assert_eq!(format.round_trip(Vec2::ZERO, size), Vec2::ZERO, "{format:?}");
        assert_eq!(format.round_trip(Vec2::NAN, size), Vec2::ZERO, "{format:?}");
    }
    // Unreal's step in pixels: the width / 2, over 65535 codes of which 0.2495 make one unit.
    let step = MotionFormat::Unorm16.error_bound(Vec2::ZERO, size).x * 2.0;
    assert!((step - 640.0 / 65535.0 / 0.2495).abs() < 1e-5, "{step}");
    assert_eq!(MotionFormat::Float32.round_trip(Vec2::new(0.1, -77.7), size), Vec2::new(0.1, -77.7));
}

#[test]
fn dilation_takes_the_vector_of_the_nearest_neighbour() {
    let scene = Scene::new(Family::Forest, 3);
    let frames = frames(&scene, 30, 1, 10, Effects::default());
    let last = frames.last().expect("frames");
    let mut engine = Engine::new(EngineOptions { dilate: true, ..Default::default() }).expect("options");
    let inputs = frames.iter().map(|f| engine.push(&f.frame, &f.now, &f.before)).last().expect("frames");
    let (w, h) = (SIZE.0 as i32, SIZE.1 as i32);
    let mut changed = 0;
    for y in 0..h {
        for x in 0..w {
            let neighbours = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (x + i, y + j)));
            let inside = neighbours.filter(|&(x, y)| (0..w).contains(&x) && (0..h).contains(&y));
            let indices: Vec<usize> = inside.map(|(x, y)| (y * w + x) as usize).collect();
            let least = indices.iter().map(|k| last.frame.depth[*k]).fold(f32::MAX, f32::min);
            let k = (y * w + x) as usize;
            let taken = inputs.motion.vectors[k];
            let nearest = indices.iter().filter(|k| last.frame.depth[**k] == least);
            assert!(nearest.clone().any(|k| last.frame.motion[*k] == taken), "({x}, {y}): {taken}");
            changed += u32::from(taken.distance(last.frame.motion[k]) > 0.25);
        }
    }
    assert!(changed > 300, "only {changed} vectors changed");
}

/// Bilinear sample of a picture at a pixel position.
fn sample(frame: &Frame, at: Vec2) -> Vec3 {
    let at = at - 0.5;
    let (low, part) = (at.floor(), at - at.floor());
    let pixel = |dx: i32, dy: i32| {
        let (x, y) = ((low.x as i32 + dx).clamp(0, SIZE.0 as i32 - 1), (low.y as i32 + dy).clamp(0, SIZE.1 as i32 - 1));
        let p = frame.picture.pixels()[(y * SIZE.0 as i32 + x) as usize];
        Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2]))
    };
    pixel(0, 0).lerp(pixel(1, 0), part.x).lerp(pixel(0, 1).lerp(pixel(1, 1), part.x), part.y)
}

#[test]
fn jitter_can_be_kept_in_vectors_or_removed() {
    let scene = Scene::new(Family::Desert, 3);
    let jittered = frames(&scene, 30, 4, 20, Effects { jitter: Some(8), ..Effects::default() });
    let (now, before) = (&jittered[19], &jittered[18]);
    let shift = before.now.jitter - now.now.jitter;
    assert!(shift.length() > 0.3, "{shift}");
    let give = |keep_jitter: bool| {
        let mut engine = Engine::new(EngineOptions { keep_jitter, ..Default::default() }).expect("options");
        jittered.iter().map(|f| engine.push(&f.frame, &f.now, &f.before)).last().expect("frames")
    };
    let (kept, removed) = (give(true), give(false));
    assert_eq!(kept.jitter, now.now.jitter);
    let (mut of_kept, mut of_removed, mut count) = (0.0, 0.0, 0);
    for k in 0..kept.motion.vectors.len() {
        let (kept, removed) = (kept.motion.vectors[k], removed.motion.vectors[k]);
        assert!((kept - removed - shift).length() < 1e-4, "{kept} {removed}");
        let there = centre(k) + kept;
        let distance = view_distance(now.frame.depth[k]);
        if distance < 200.0
            && one_surface(&now.frame, centre(k), distance)
            && one_surface(&before.frame, there, distance)
        {
            let here = sample(&now.frame, centre(k));
            let square = |at: Vec2| f64::from((sample(&before.frame, at) - here).length_squared()) / 3.0;
            of_kept += square(there);
            of_removed += square(centre(k) + removed);
            count += 1;
        }
    }
    let [kept, removed] = [of_kept, of_removed].map(|sum| 10.0 * (255.0 * 255.0 * f64::from(count) / sum).log10());
    println!("{count} pixels: {kept:.1} dB with the jitter in vectors, {removed:.1} dB without");
    assert!(count > 5000 && kept > 40.0 && kept > removed + 3.0);

    // Without the jitter, motion is that of the pictures without jitter at the same place of the content.
    let still = frames(&scene, 30, 1, 20, Effects::default());
    let exact = &still[19].frame;
    let (mut worst, mut compared) = (0.0_f32, 0);
    for k in 0..exact.motion.len() {
        let distance = view_distance(exact.depth[k]);
        let smooth = one_surface(exact, centre(k), distance) && one_surface(&now.frame, centre(k), distance);
        if smooth && distance > 3.0 && distance < 900.0 {
            worst = worst.max(exact.motion[k].distance(now.frame.motion[k] - shift));
            compared += 1;
        }
    }
    println!("{compared} vectors differ from those without jitter by at most {worst:.3} px");
    assert!(compared > 5000 && worst < 0.1);
}

#[test]
fn skinned_meshes_have_the_cameras_motion_where_the_engine_says_so_and_nothing_else_has() {
    let scene = Scene::new(Family::Sword, 3);
    let mut frames = frames(&scene, 30, 1, 10, Effects::default());
    // The held item counts as a skinned mesh: its own motion is not the camera's.
    for f in &mut frames {
        for kind in f.frame.surfaces.iter_mut().filter(|kind| **kind == MotionKind::Held) {
            *kind = MotionKind::Skinned;
        }
    }
    let give = |skinned_from_camera: bool| {
        let mut engine = Engine::new(EngineOptions { skinned_from_camera, ..Default::default() }).expect("options");
        frames.iter().map(|f| engine.push(&f.frame, &f.now, &f.before)).last().expect("frames").motion
    };
    let (exact, camera) = (give(false), give(true));
    let frame = &frames[9].frame;
    let mut skinned = 0;
    for k in 0..exact.vectors.len() {
        assert_eq!(exact.vectors[k], frame.motion[k]);
        if frame.surfaces[k] == MotionKind::Skinned {
            assert_eq!(camera.vectors[k], frame.camera_motion[k]);
            assert!(camera.vectors[k].distance(exact.vectors[k]) > 1.0, "{} {}", camera.vectors[k], exact.vectors[k]);
            skinned += 1;
        } else {
            assert_eq!(camera.vectors[k], exact.vectors[k]);
        }
    }
    assert!(skinned > 500, "only {skinned} pixels of the mesh");
}

#[test]
fn depth_comes_in_every_encoding_and_guidance_undoes_it() {
    let scene = Scene::new(Family::Desert, 3);
    let frame = &frames(&scene, 30, 1, 1, Effects::default())[0];
    let device = DepthEncoding::default();
    for depth in [device, DepthEncoding { inverted: true, ..device }, DepthEncoding { linear: true, ..device }] {
        let mut engine = Engine::new(EngineOptions { depth, ..Default::default() }).expect("options");
        let inputs = engine.push(&frame.frame, &frame.now, &frame.before);
        let guidance = inputs.guidance().expect("guidance");
        for (k, truth) in frame.frame.depth.iter().enumerate() {
            let expected = match depth {
                DepthEncoding { linear: true, .. } => view_distance(*truth),
                DepthEncoding { inverted: true, .. } => 1.0 - truth,
                DepthEncoding { .. } => *truth,
            };
            assert_eq!(inputs.depth[k], expected);
            assert!((guidance.depth().depth()[k] - truth).abs() < 2e-6, "{depth:?}: pixel {k}");
        }
        assert_eq!(guidance.depth().projection().vertical_fov(), frame.now.camera.vertical_fov);
    }
}

#[test]
fn vectors_come_in_squares_of_pixels() {
    let scene = Scene::new(Family::Desert, 3);
    let frames = frames(&scene, 30, 1, 5, Effects::default());
    let truth = &frames[4].frame.motion;
    for texel in [1, 2, 8, 16] {
        let mut engine = Engine::new(EngineOptions { texel, ..Default::default() }).expect("options");
        let inputs = frames.iter().map(|f| engine.push(&f.frame, &f.now, &f.before)).last().expect("frames");
        let motion = &inputs.motion;
        assert_eq!((motion.columns, motion.rows), (SIZE.0.div_ceil(texel), SIZE.1.div_ceil(texel)));
        let guidance = inputs.guidance().expect("guidance");
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                let middle =
                    [(x, SIZE.0), (y, SIZE.1)].map(|(at, side)| (at / texel * texel + texel / 2).min(side - 1));
                let expected = truth[(middle[1] * SIZE.0 + middle[0]) as usize];
                assert_eq!(motion.at(x, y), expected, "({x}, {y}) in squares of {texel}");
                let [u, v] = guidance.motion().at(x, y).map(f32::from);
                assert!((Vec2::new(u, v) - expected).length() < 0.02, "({x}, {y}) in squares of {texel}");
            }
        }
    }
}

#[test]
fn a_cut_and_the_start_are_resets_for_as_many_frames_as_a_vector_spans() {
    let scene = Scene::new(Family::Desert, 3);
    let effects = Effects { edits: "0.2 cut 10,10,90".parse().expect("edits"), ..Effects::default() };
    let frames = frames(&scene, 30, 1, 10, effects);
    for span in [1, 3] {
        let mut engine = Engine::new(EngineOptions { frames: span, ..Default::default() }).expect("options");
        for (n, f) in frames.iter().enumerate() {
            let inputs = engine.push(&f.frame, &f.now, &f.before);
            let expected = n < span as usize || (6..6 + span as usize).contains(&n);
            assert_eq!(inputs.reset, expected, "frame {n}, vectors over {span} frames");
            assert!(inputs.motion.vectors.iter().all(|v| v.is_finite()));
            assert_eq!(inputs.motion.vectors.iter().all(|v| *v == Vec2::ZERO), inputs.reset, "frame {n}");
        }
    }
}

#[test]
fn impossible_options_are_refused() {
    let both = DepthEncoding { inverted: true, linear: true };
    let base = EngineOptions::default();
    for (options, field) in [
        (EngineOptions { frames: 0, ..base }, "frames"),
        (EngineOptions { frames: 65, ..base }, "frames"),
        (EngineOptions { texel: 4, ..base }, "texel"),
        (EngineOptions { depth: both, ..base }, "depth"),
    ] {
        assert_eq!(Engine::new(options).expect_err(field).offending_field(), Some(field));
    }
}
