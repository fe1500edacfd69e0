//! A level: a scene that hills close, where a walk stays.

mod common;

use cairn::world::ControlScript;
use common::{Reprojection, count_matching_depths};
use glam::Vec2;
use scenes::{Cast, Clip, ClipOptions, Family, LANDSCAPES, Moment, Quality, Scene, Start, render, render_picture};

const SIZE: (u32, u32) = (320, 180);
const SEED: u64 = 1001;

/// A walk with W held for `seconds`, from (east, north) at a direction in degrees: a moment each thirtieth of a second.
fn walk(scene: &Scene, at: Vec2, degrees: f32, seconds: usize) -> Vec<Moment> {
    let script = ControlScript::parse(&format!("cairn-controls 1\n0..{seconds} hold W SHIFT\n{seconds} end\n"));
    let start = Some(Start { at, yaw: degrees.to_radians() });
    let script = script.expect("a script");
    let options = ClipOptions { start, ..ClipOptions::default() };
    let mut clip = Clip::new(scene, &script, options).expect("30 divides 120");
    (0..=30 * seconds).map(|_| clip.advance().expect("a step").0).collect()
}

#[test]
fn a_level_is_the_scene_itself_within_forty_metres_and_hills_stand_around_it() {
    for family in LANDSCAPES {
        let (open, level) = (Scene::new(family, SEED), Scene::level(family, SEED, Cast::none()));
        assert!(level.terrain.is_closed() && !open.terrain.is_closed());
        let (mut lowest, mut highest) = (f32::MAX, f32::MIN);
        for k in 0..360 {
            let towards = Vec2::from_angle((k as f32).to_radians());
            let square = towards / towards.abs().max_element();
            assert_eq!(open.terrain.height(square * 39.0), level.terrain.height(square * 39.0), "{family}: {k}");
            let rise = |metres: f32| level.terrain.height(square * metres) - open.terrain.height(square * metres);
            lowest = lowest.min(rise(65.0));
            highest = highest.max(rise(42.0));
        }
        assert!(lowest > 6.0, "{family}: the hills are {lowest} m high somewhere");
        assert!(highest < 0.5, "{family}: the ground within 42 m is {highest} m higher");
        assert_eq!(open.obstacles, level.obstacles, "{family}: other things stand there");
    }
}

#[test]
fn a_walker_stops_at_the_hills_and_slides_along_them() {
    for family in LANDSCAPES {
        let level = Scene::level(family, SEED, Cast::none());
        for k in 0..12 {
            let moments = walk(&level, Vec2::new(20.0, -15.0), 17.0 + 30.0 * k as f32, 60);
            let at = moments.iter().map(|m| Vec2::new(m.camera.position.x, m.camera.position.z));
            let farthest = at.clone().map(|p| p.abs().max_element()).fold(0.0, f32::max);
            assert!(farthest < 52.0, "{family} {k}: the walk got {farthest} m from the origin");
            assert!(farthest > 30.0, "{family} {k}: the walk got no farther than {farthest} m");
        }
        // Towards the northern hills at a slant: what is left of the motion leads along them.
        let at = walk(&level, Vec2::new(-30.0, 49.0), 60.0, 4).last().map(|m| m.camera.position).expect("moments");
        assert!(at.x > -29.0, "{family}: the walker sticks to the hills at {at}");
    }
    let open = Scene::new(Family::Desert, SEED);
    let last = walk(&open, Vec2::new(40.0, 0.0), 90.0, 20).last().map(|m| m.camera.position.x);
    assert!(last > Some(60.0), "a scene that is not closed ends at {last:?} m");
}

#[test]
fn depth_and_motion_are_true_at_the_hills_and_a_picture_alone_is_the_same() {
    for family in LANDSCAPES {
        let level = Scene::level(family, SEED, Cast::none());
        let moments = walk(&level, Vec2::new(30.0, 30.0), 45.0, 1);
        let (before, now) = (moments[moments.len() - 2], moments[moments.len() - 1]);
        let quality = Quality { samples: 4 };
        let current = render(&level, &now, &before, SIZE.0, SIZE.1, quality);
        let previous = render(&level, &before, &before, SIZE.0, SIZE.1, quality);
        let mut found = Reprojection::default();
        found.add(&current, &previous, &current.motion, |_, _| true);
        assert!(found.count > SIZE.0 * SIZE.1 / 5, "{family}: only {} pixels compared", found.count);
        assert!(found.psnr() >= 44.0, "{family}: re-projection is {:.1} dB", found.psnr());
        if family != Family::Sword {
            let (agree, asked) = count_matching_depths(&level, &now, &current, 1571);
            assert!(agree + 1 >= asked, "{family}: {agree} of {asked} depths agree");
        }
        assert_eq!(current.picture, render_picture(&level, &now, SIZE.0, SIZE.1, quality), "{family}");
        let fast = Quality { samples: 1 };
        let whole = render(&level, &now, &before, SIZE.0, SIZE.1, fast).picture;
        assert_eq!(whole, render_picture(&level, &now, SIZE.0, SIZE.1, fast), "{family}");
    }
}
