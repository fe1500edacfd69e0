//! The ground truth of things that move: motion by re-projection, depth by intersection, and that each of them is seen.

mod common;

use cairn::world::ControlScript;
use common::{Reprojection, depths_by_intersection};
use scenes::{Cast, Clip, ClipOptions, FAMILIES, Family, Frame, Moment, Quality, Scene, SurfaceKind, render};

const SIZE: (u32, u32) = (480, 270);

/// Moments of the family's own walk at `seconds`, and those a thirtieth of a second before.
fn moments(scene: &Scene, seconds: &[u32]) -> Vec<(Moment, Moment)> {
    let script = ControlScript::parse(scene.family.script()).expect("a script");
    let mut clip = Clip::new(scene, &script, ClipOptions::default()).expect("30 divides 120");
    let last = seconds.iter().max().expect("a second") * 30;
    (0..=last)
        .map(|_| clip.advance().expect("a step"))
        .enumerate()
        .filter(|(n, _)| seconds.iter().any(|s| *n == *s as usize * 30))
        .map(|(_, m)| m)
        .collect()
}

fn moves(frame: &Frame, k: usize) -> bool {
    matches!(frame.surfaces[k], SurfaceKind::Rigid | SurfaceKind::Skinned)
}

/// Frames of the family's walk with motion, and the frames that the motion points to.
fn pairs(scene: &Scene, seconds: &[u32]) -> Vec<(Frame, Frame)> {
    let quality = Quality { samples: 3 };
    let draw = |(now, before): (Moment, Moment)| {
        [(now, before), (before, before)].map(|(now, before)| render(scene, &now, &before, SIZE.0, SIZE.1, quality))
    };
    moments(scene, seconds).into_iter().map(draw).map(|[current, previous]| (current, previous)).collect()
}

/// Whether a pixel shows the same kind of surface in both pictures, and nothing changes its colour.
fn is_lit_alike(current: &Frame, previous: &Frame, k: usize, was: usize) -> bool {
    let is_clear = |frame: &Frame, k: usize| !frame.changing_light[k] && frame.particle_cover[k] < 1e-3;
    is_clear(current, k) && is_clear(previous, was) && current.surfaces[k] == previous.surfaces[was]
}

#[test]
fn what_stands_still_among_moving_things_keeps_its_exact_motion() {
    for family in FAMILIES {
        // A headlamp and a muzzle's flash change the light on everything near.
        let scene = Scene::with_cast(family, 3, Cast { lights: false, flashes: false, ..Cast::all() });
        let mut still = Reprojection::default();
        for (current, previous) in &pairs(&scene, &[2, 8]) {
            let is_still = |k: usize, was: usize| is_lit_alike(current, previous, k, was) && !moves(current, k);
            still.add(current, previous, &current.motion, is_still);
        }
        println!("{family}: {:.1} dB over {} pixels", still.psnr(), still.count);
        assert!(still.count > 5000, "{family}: only {} pixels compared", still.count);
        assert!(still.psnr() >= 45.0, "{family}: re-projection is {:.1} dB", still.psnr());
    }
}

#[test]
fn motion_leads_to_the_same_point_of_a_moving_thing() {
    for family in FAMILIES {
        let scene = Scene::with_cast(family, 3, "figures,bodies".parse().expect("a cast"));
        let [mut with_motion, mut with_camera] = [(); 2].map(|()| Reprojection::default());
        for (current, previous) in &pairs(&scene, &[2, 5, 8]) {
            let is_moving = |k: usize, was: usize| is_lit_alike(current, previous, k, was) && moves(current, k);
            with_motion.add(current, previous, &current.motion, is_moving);
            with_camera.add(current, previous, &current.camera_motion, is_moving);
        }
        let (found, camera) = (with_motion.psnr(), with_camera.psnr());
        println!(
            "{family}: {found:.1} dB over {} pixels, with the camera's motion alone {camera:.1} dB",
            with_motion.count
        );
        // The light on a thing that turns or walks through shadows changes, so it is not as near as what stands still.
        assert!(with_motion.count > 300, "{family}: only {} pixels compared", with_motion.count);
        assert!(
            found >= 30.0 && found >= camera + 3.0,
            "{family}: {found:.1} dB, with the camera's motion alone {camera:.1} dB"
        );
    }
}

#[test]
fn depth_is_where_the_ray_meets_the_first_triangle() {
    for family in FAMILIES {
        let scene = Scene::with_cast(family, 5, Cast::all());
        let (now, before) = moments(&scene, &[4])[0];
        let frame = render(&scene, &now, &before, SIZE.0, SIZE.1, Quality { samples: 1 });
        let (agree, asked) = depths_by_intersection(&scene, &now, &frame, 1571);
        // A ray through an edge may take either side.
        assert!(agree + 2 >= asked, "{family}: {agree} of {asked} depths agree");
    }
}

#[test]
fn every_member_of_the_cast_is_seen_and_moves() {
    for family in FAMILIES {
        // Plants bend slowly; what is far away moves by less than a tenth of a pixel in a thirtieth of a second.
        for (member, frames, least) in
            [("figures", 4, 0.5), ("birds", 3, 0.5), ("bodies", 4, 0.5), ("wind", 4, 0.05), ("doors", 2, 0.25)]
        {
            if (family, member) == (Family::Indoors, "wind") {
                continue;
            }
            let scene = Scene::with_cast(family, 6, member.parse().expect("a member"));
            let (mut shown, mut moved) = (0, 0);
            for (now, before) in moments(&scene, &[1, 3, 5, 7, 9, 11, 13]) {
                let frame = render(&scene, &now, &before, 320, 180, Quality { samples: 1 });
                let own = |k: &usize| (frame.motion[*k] - frame.camera_motion[*k]).length() > least;
                let here = (0..frame.surfaces.len()).filter(|k| moves(&frame, *k)).filter(own).count();
                moved += here;
                shown += u32::from(here > 20);
            }
            // Little grows in a desert, and a corridor's doors move for a second each.
            let (frames, fewest) = match (family, member) {
                (Family::Desert, "wind") => (1, 20),
                (Family::Indoors, "doors") => (1, 100),
                _ => (frames, 150),
            };
            println!("{family} {member}: in {shown} of 7 frames, {moved} pixels");
            assert!(shown >= frames && moved > fewest, "{family} {member}: in {shown} of 7 frames, {moved} pixels");
        }
        let scene = Scene::with_cast(family, 6, "figures,lights".parse().expect("members"));
        let (now, before) = moments(&scene, &[3])[0];
        let lit = render(&scene, &now, &before, 320, 180, Quality { samples: 1 });
        let dark = Scene::with_cast(family, 6, "figures".parse().expect("a member"));
        let dark = render(&dark, &now, &before, 320, 180, Quality { samples: 1 });
        let changed = |k: &usize| lit.picture.pixels()[*k] != dark.picture.pixels()[*k];
        let all: Vec<usize> = (0..lit.surfaces.len()).filter(changed).collect();
        assert!(all.len() > 2000, "{family}: lamps light only {} pixels", all.len());
        // The lantern is one thing more to be seen.
        let untold = all.iter().filter(|k| !lit.changing_light[**k] && !moves(&lit, **k)).count();
        assert!(untold * 100 < all.len(), "{family}: {untold} of {} lit pixels count as unchanged", all.len());
    }
}

#[test]
fn particles_and_flashes_change_colours_and_nothing_else() {
    for family in [Family::Snow, Family::Indoors, Family::Town] {
        let frames = |cast: &str| -> Vec<Frame> {
            let scene = Scene::with_cast(family, 6, cast.parse().expect("a cast"));
            // A quarter of a second into a burst the muzzle flashes.
            let at = moments(&scene, &[2, 4]).into_iter().map(|(now, before)| (Moment { time: 2.47, ..now }, before));
            at.map(|(now, before)| render(&scene, &now, &before, 320, 180, Quality { samples: 1 })).collect()
        };
        let (with, without) = (frames("particles,flashes"), frames("none"));
        let (mut changed, mut untold, mut covered, mut bowls) = (0, 0, 0, 0);
        for (with, without) in with.iter().zip(&without) {
            for k in 0..with.depth.len() {
                // The bowls that the fires burn in are solid.
                if with.depth[k].to_bits() != without.depth[k].to_bits() {
                    bowls += 1;
                    continue;
                }
                assert_eq!(with.motion[k].to_array().map(f32::to_bits), without.motion[k].to_array().map(f32::to_bits));
                let differs = with.picture.pixels()[k] != without.picture.pixels()[k];
                let is_told = with.changing_light[k] || with.particle_cover[k] > 0.0;
                untold += u32::from(differs && !is_told);
                changed += u32::from(differs);
                covered += u32::from(with.particle_cover[k] > 0.05);
            }
        }
        // The bowls' own shadows.
        assert!(untold * 50 < changed, "{family}: {untold} of {changed} pixels differ without a reason");
        println!("{family}: {changed} pixels change, {covered} behind particles, {bowls} of bowls");
        assert!(changed > 10_000 && covered > 1000 && bowls < 8000, "{family}: {changed}, {covered}, {bowls}");
    }
}

#[test]
fn water_mirrors_what_is_above_it() {
    for family in FAMILIES {
        let scene = Scene::with_cast(family, 6, "water".parse().expect("a cast"));
        let dry = Scene::with_cast(family, 6, Cast::none());
        let (mut wet, mut mirrored) = (0, 0);
        for (now, before) in moments(&scene, &[1, 3, 5, 7, 9, 11]) {
            let frame = render(&scene, &now, &before, 320, 180, Quality { samples: 1 });
            let without = render(&dry, &now, &before, 320, 180, Quality { samples: 1 });
            let later = Moment { time: now.time + 0.4, ..now };
            let rippled = render(&scene, &later, &before, 320, 180, Quality { samples: 1 });
            for k in 0..frame.depth.len() {
                let is_water = frame.changing_light[k] && frame.depth[k].to_bits() != without.depth[k].to_bits();
                wet += u32::from(is_water);
                mirrored += u32::from(is_water && frame.picture.pixels()[k] != rippled.picture.pixels()[k]);
                assert!(!is_water || frame.depth[k].to_bits() == rippled.depth[k].to_bits(), "ripples have no depth");
            }
        }
        println!("{family}: {wet} pixels of water, {mirrored} of them ripple");
        assert!(wet > 100 && mirrored > 60, "{family}: {wet} pixels of water, {mirrored} of them ripple");
    }
}

#[test]
fn a_moving_thing_casts_a_moving_shadow() {
    for family in [Family::Desert, Family::Snow, Family::Sword] {
        let [with, without] = ["figures,bodies", "none"].map(|cast| {
            let scene = Scene::with_cast(family, 6, cast.parse().expect("a cast"));
            let (now, before) = moments(&scene, &[3])[0];
            render(&scene, &now, &before, 320, 180, Quality { samples: 1 })
        });
        let luma = |frame: &Frame, k: usize| frame.picture.pixels()[k][..3].iter().map(|c| u32::from(*c)).sum::<u32>();
        let shaded: Vec<usize> = (0..with.surfaces.len())
            .filter(|k| with.surfaces[*k] == SurfaceKind::Still && luma(&with, *k) + 20 < luma(&without, *k))
            .collect();
        assert!(shaded.len() > 100, "{family}: only {} pixels in shadow", shaded.len());
        assert!(shaded.iter().all(|k| with.changing_light[*k]), "{family}: a shadow without its mark");
    }
}

#[test]
fn a_frame_has_the_same_bits_whatever_the_thread_count() {
    for family in [Family::Forest, Family::Town] {
        let scene = Scene::with_cast(family, 2, Cast::all());
        let (now, before) = moments(&scene, &[3])[0];
        let draw = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| render(&scene, &now, &before, 160, 90, Quality::default()))
        };
        let (one, four) = (draw(1), draw(4));
        assert_eq!(one.picture, four.picture);
        assert_eq!((&one.surfaces, &one.changing_light), (&four.surfaces, &four.changing_light));
        let bits = |f: &Frame| f.motion.iter().flat_map(|m| m.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        assert_eq!(bits(&one), bits(&four));
        let again = Scene::with_cast(family, 2, Cast::all());
        assert_eq!(one.picture, render(&again, &now, &before, 160, 90, Quality::default()).picture);
    }
}
