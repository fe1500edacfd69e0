//! The ground truth is true: motion by re-projection, depth by intersection, and the same bytes every time.

mod common;

use cairn::world::ControlScript;
use common::{Reprojection, count_matching_depths};
use glam::Vec3;
use scenes::camera::view_distance;
use scenes::{Clip, ClipOptions, FAMILIES, Family, Frame, LANDSCAPES, Moment, Quality, Scene, render};

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

#[test]
fn motion_leads_to_the_same_point_of_the_previous_picture() {
    for family in FAMILIES {
        let scene = Scene::new(family, 3);
        let (now, before) = moments(&scene);
        let quality = Quality { samples: 4 };
        let current = render(&scene, &now, &before, SIZE.0, SIZE.1, quality);
        let previous = render(&scene, &before, &before, SIZE.0, SIZE.1, quality);
        let mut found = Reprojection::default();
        let is_lit_alike = |k: usize, was: usize| !current.changing_light[k] && !previous.changing_light[was];
        found.add(&current, &previous, &current.motion, is_lit_alike);
        let psnr = found.psnr();
        println!("{family}: {psnr:.1} dB over {} pixels, up to {:.1} pixels of motion", found.count, found.longest);
        assert!(found.count > SIZE.0 * SIZE.1 / 4, "{family}: only {} pixels compared", found.count);
        assert!(found.longest > 3.0, "{family}: nothing moved");
        assert!(psnr >= 45.0, "{family}: re-projection is {psnr:.1} dB");
    }
}

#[test]
fn depth_is_where_the_ray_meets_the_first_triangle() {
    for family in [Family::Forest, Family::Desert, Family::Snow, Family::Indoors, Family::Town] {
        let scene = Scene::new(family, 5);
        let (now, before) = moments(&scene);
        let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
        let (agree, asked) = count_matching_depths(&scene, &now, &frame, 1571);
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
