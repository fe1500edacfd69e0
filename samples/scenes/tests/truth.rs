//! The ground truth is true: motion by re-projection, depth by intersection, and the same bytes every time.

use cairn::world::ControlScript;
use glam::{Vec2, Vec3};
use scenes::camera::{FAR, device_depth, view_distance};
use scenes::{Clip, ClipOptions, Family, Frame, LANDSCAPES, Moment, Quality, Scene, render};

const SIZE: (u32, u32) = (480, 270);

/// A second and a half into a walk with a turn: two moments a thirtieth of a second apart.
fn moments(scene: &Scene) -> (Moment, Moment) {
    let script = ControlScript::parse("cairn-controls 1\n0..9 hold W\n1..2 mouse 160 0\n9 end\n").expect("a script");
    let mut clip = Clip::new(scene, &script, ClipOptions::default()).expect("30 divides 120");
    for _ in 0..45 {
        clip.advance().expect("a step");
    }
    clip.advance().expect("a step")
}

/// Catmull-Rom sampling of an 8-bit picture at a pixel position, in code values.
fn sample(frame: &Frame, at: Vec2) -> Vec3 {
    let (w, h) = (frame.picture.width() as i32, frame.picture.height() as i32);
    let at = at - 0.5;
    let low = at.floor();
    let weights = |t: f32| {
        [
            t * (-0.5 + t * (1.0 - 0.5 * t)),
            1.0 + t * t * (1.5 * t - 2.5),
            t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (0.5 * t - 0.5),
        ]
    };
    let (wx, wy) = (weights(at.x - low.x), weights(at.y - low.y));
    let mut sum = Vec3::ZERO;
    for (j, wy) in wy.into_iter().enumerate() {
        for (i, wx) in wx.into_iter().enumerate() {
            let x = (low.x as i32 + i as i32 - 1).clamp(0, w - 1);
            let y = (low.y as i32 + j as i32 - 1).clamp(0, h - 1);
            let p = frame.picture.pixels()[(y * w + x) as usize];
            sum += Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2])) * wx * wy;
        }
    }
    sum
}

/// Whether depth is smooth over the 5 x 5 pixels around (x, y): no silhouette passes there.
fn inside(frame: &Frame, x: i32, y: i32) -> bool {
    let (w, h) = (frame.picture.width() as i32, frame.picture.height() as i32);
    if x < 2 || y < 2 || x + 2 >= w || y + 2 >= h {
        return false;
    }
    let at = |x: i32, y: i32| view_distance(frame.depth[(y * w + x) as usize]);
    let here = at(x, y);
    (-2..=2).all(|j| {
        (-2..=2).all(|i| {
            // On a plane depth is linear in 1/z: opposite neighbours average to the middle.
            let (a, b) = (1.0 / at(x + i, y + j), 1.0 / at(x - i, y - j));
            ((a + b) * 0.5 * here - 1.0).abs() < 0.004
        })
    })
}

#[test]
fn motion_leads_to_the_same_point_of_the_previous_picture() {
    for family in LANDSCAPES {
        let scene = Scene::new(family, 3);
        let (now, before) = moments(&scene);
        let quality = Quality { samples: 4 };
        let current = render(&scene, &now, &before, SIZE.0, SIZE.1, quality);
        let previous = render(&scene, &before, &before, SIZE.0, SIZE.1, quality);
        let (mut error, mut count, mut moved) = (0.0_f64, 0_u32, 0.0_f32);
        for y in 0..SIZE.1 as i32 {
            for x in 0..SIZE.0 as i32 {
                let k = (y * SIZE.0 as i32 + x) as usize;
                let there = Vec2::new(x as f32, y as f32) + 0.5 + current.motion[k];
                if !there.is_finite() || !inside(&current, x, y) {
                    continue;
                }
                let (px, py) = (there.x.floor() as i32, there.y.floor() as i32);
                if !inside(&previous, px, py) {
                    continue;
                }
                // Visible in both: the previous depth there is that of a point close by.
                let old = view_distance(previous.depth[(py * SIZE.0 as i32 + px) as usize]);
                if (old / view_distance(current.depth[k]) - 1.0).abs() > 0.05 {
                    continue;
                }
                let p = current.picture.pixels()[k];
                let d = sample(&previous, there) - Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2]));
                error += f64::from(d.length_squared()) / 3.0;
                moved = moved.max(current.motion[k].length());
                count += 1;
            }
        }
        let psnr = 10.0 * (255.0 * 255.0 / (error / f64::from(count))).log10();
        println!("{family}: {psnr:.1} dB over {count} pixels, up to {moved:.1} pixels of motion");
        assert!(count > SIZE.0 * SIZE.1 / 4, "{family}: only {count} pixels compared");
        assert!(moved > 3.0, "{family}: nothing moved");
        assert!(psnr >= 45.0, "{family}: re-projection is {psnr:.1} dB");
    }
}

/// Distance along the view axis where a ray meets a triangle (Moeller and Trumbore).
fn meets(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f32> {
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let det = u.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = (origin - a) / det;
    let (x, q) = (s.dot(p), s.cross(u));
    let (y, t) = (direction.dot(q), v.dot(q));
    (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.1).then_some(t)
}

#[test]
fn depth_is_where_the_ray_meets_the_first_triangle() {
    for family in [Family::Forest, Family::Desert, Family::Snow] {
        let scene = Scene::new(family, 5);
        let (now, before) = moments(&scene);
        let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
        let view = now.camera.view(SIZE.0, SIZE.1);
        let (mut agree, mut asked) = (0, 0);
        for k in (0..SIZE.0 * SIZE.1).step_by(1571) {
            let pixel = Vec2::new((k % SIZE.0) as f32, (k / SIZE.0) as f32) + 0.5;
            let ray = view.to_world(view.ray(pixel));
            let nearest = scene
                .chunks
                .iter()
                .flat_map(|c| c.mesh.triangles.iter().map(|t| t.map(|i| c.mesh.positions[i as usize])))
                .filter_map(|t| meets(view.eye, ray, t))
                .fold(f32::MAX, f32::min);
            let expected = if nearest > FAR { 1.0 } else { device_depth(nearest) };
            let (found, expected) = (view_distance(frame.depth[k as usize]), view_distance(expected));
            asked += 1;
            agree += u32::from((found / expected - 1.0).abs() < 2e-3);
        }
        // A ray through an edge may take either side.
        assert!(agree + 1 >= asked, "{family}: {agree} of {asked} depths agree");
    }
}

#[test]
fn a_frame_has_the_same_bits_whatever_the_thread_count() {
    let scene = Scene::new(Family::Sword, 2);
    let (now, before) = moments(&scene);
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| render(&scene, &now, &before, 160, 90, Quality::default()))
    };
    let (one, four) = (draw(1), draw(4));
    assert_eq!(one.picture, four.picture);
    let bits = |f: &Frame| {
        (
            f.depth.iter().map(|d| d.to_bits()).collect::<Vec<_>>(),
            f.motion.iter().map(|m| [m.x.to_bits(), m.y.to_bits()]).collect::<Vec<_>>(),
        )
    };
    assert_eq!(bits(&one), bits(&four));
    let again = Scene::new(Family::Sword, 2);
    assert_eq!(one.picture, render(&again, &now, &before, 160, 90, Quality::default()).picture);
}

#[test]
fn every_place_has_two_hundred_things_and_no_two_seeds_are_alike() {
    for family in LANDSCAPES {
        let mut seen = Vec::new();
        for seed in [1, 2, 9] {
            let scene = Scene::new(family, seed);
            assert!(scene.objects >= 200, "{family} {seed}: {} things", scene.objects);
            let (now, before) = moments(&scene);
            let picture = render(&scene, &now, &before, 64, 36, Quality { samples: 1 }).picture;
            assert!(!seen.contains(&picture), "{family}: seed {seed} repeats another");
            seen.push(picture);
        }
    }
}

#[test]
fn the_held_sword_stays_in_view_while_the_world_moves() {
    let scene = Scene::new(Family::Sword, 4);
    let (now, before) = moments(&scene);
    let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
    let (mut held, mut world) = ((0.0_f32, 0), (0.0_f32, 0));
    for (depth, motion) in frame.depth.iter().zip(&frame.motion) {
        let to = if view_distance(*depth) < 0.9 { &mut held } else { &mut world };
        if motion.is_finite() {
            *to = (to.0 + motion.length(), to.1 + 1);
        }
    }
    assert!(held.1 > 2000, "the sword covers {} pixels", held.1);
    let (held, world) = (held.0 / held.1 as f32, world.0 / world.1 as f32);
    assert!(held < 1.0 && world > 3.0 * held, "mean motion: held {held}, world {world}");
}

#[test]
fn the_sky_turns_with_the_camera_and_does_not_move_with_its_place() {
    let scene = Scene::new(Family::Desert, 4);
    let (now, _) = moments(&scene);
    let mut before = now;
    before.camera.position += Vec3::new(0.3, 0.1, -0.2);
    let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
    let sky: Vec<_> = frame.depth.iter().zip(&frame.motion).filter(|(d, _)| **d >= 1.0).collect();
    assert!(sky.len() > 5000);
    assert!(sky.iter().all(|(_, m)| m.length() < 1e-2));

    // Before, the camera looked farther left: what is seen now was farther right, by the turn's own angle in the middle.
    before.camera.yaw -= 0.02;
    let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
    let focal = now.camera.view(SIZE.0, SIZE.1).focal.x;
    let turned: Vec<_> =
        (frame.depth.iter().zip(&frame.motion)).filter(|(d, _)| **d >= 1.0).map(|(_, m)| m.x).collect();
    assert!(turned.iter().all(|x| *x > focal * 0.015 && *x < focal * 0.06), "the sky does not turn with the camera");
}
