//! Things that move have exact motion and depth, and the walk of each family's script meets them.

mod common;

use cairn::world::ControlScript;
use common::{Reprojection, intersect_triangle, sample};
use glam::{Vec2, Vec3};
use scenes::camera::{FAR, device_depth, view_distance};
use scenes::{
    Cast, Clip, ClipOptions, FAMILIES, Family, Frame, LANDSCAPES, Moment, MotionKind, Quality, Scene, render,
};

const SIZE: (u32, u32) = (320, 180);
const SEED: u64 = 3;

/// Frames `wanted` of the family's own walk at 30 frames per second, each with its previous moment.
fn moments(scene: &Scene, wanted: &[u32]) -> Vec<(Moment, Moment)> {
    let script = ControlScript::parse(scene.family.script()).expect("a script");
    let mut clip = Clip::new(scene, &script, ClipOptions::default()).expect("30 divides 120");
    let last = wanted.iter().max().copied().unwrap_or_default();
    let all: Vec<_> = (0..=last).map(|_| clip.advance().expect("a step")).collect();
    wanted.iter().map(|&n| all[n as usize]).collect()
}

/// Light under which a surface's colour depends on the point of the surface alone: no sun, no shadow, no mirrored sky, no fog.
fn uniform_light(scene: &mut Scene) {
    scene.weather.sun_light = Vec3::ZERO;
    (scene.weather.zenith, scene.weather.horizon) = (Vec3::ZERO, Vec3::ZERO);
    (scene.weather.sky_light, scene.weather.ground_light) = (Vec3::splat(1.6), Vec3::splat(1.6));
    (scene.weather.fog, scene.weather.clouds) = (0.0, 0.0);
}

fn draw(scene: &Scene, now: &Moment, before: &Moment, samples: u32) -> Frame {
    render(scene, now, before, SIZE.0, SIZE.1, Quality { samples })
}

/// Colour of a pixel in code values.
fn colour(frame: &Frame, k: usize) -> Vec3 {
    let p = frame.picture.pixels()[k];
    Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2]))
}

/// Whether a pixel shows something that moves through the world.
fn moves(frame: &Frame, k: usize) -> bool {
    matches!(frame.surfaces[k], MotionKind::Rigid | MotionKind::Skinned)
}

/// Whether the 5 x 5 pixels around pixel `k`, which is no closer to the border, show one kind of surface.
fn is_of_one_kind(frame: &Frame, k: usize) -> bool {
    let w = frame.picture.width() as usize;
    (0..5).all(|j| (0..5).all(|i| frame.surfaces[k + i + j * w - 2 * w - 2] == frame.surfaces[k]))
}

#[test]
fn motion_of_moving_surfaces_leads_to_the_same_point_of_the_previous_picture() {
    let cast: Cast = "figures,birds,bodies,wind,doors".parse().expect("a cast");
    let [mut rigid, mut skinned, mut by_camera] = std::array::from_fn(|_| Reprojection::default());
    for family in LANDSCAPES {
        let mut scene = Scene::with_cast(family, SEED, cast);
        uniform_light(&mut scene);
        let mut all = Reprojection::default();
        for (now, before) in moments(&scene, &[60, 150, 260, 370]) {
            let current = draw(&scene, &now, &before, 4);
            let previous = draw(&scene, &before, &before, 4);
            let shows_same = |k: usize, was: usize| {
                current.surfaces[k] == previous.surfaces[was]
                    && is_of_one_kind(&current, k)
                    && is_of_one_kind(&previous, was)
            };
            all.add(&current, &previous, &current.motion, shows_same);
            for (score, kind) in [(&mut rigid, MotionKind::Rigid), (&mut skinned, MotionKind::Skinned)] {
                let is_compared = |k, was| current.surfaces[k] == kind && shows_same(k, was);
                score.add(&current, &previous, &current.motion, is_compared);
            }
            let differs = |k: usize| (current.camera_motion[k] - current.motion[k]).length() > 0.5;
            let is_compared =
                |k, was| moves(&current, k) && current.camera_motion[k].is_finite() && differs(k) && shows_same(k, was);
            by_camera.add(&current, &previous, &current.camera_motion, is_compared);
        }
        println!("{family}: {:.1} dB over {} pixels", all.psnr(), all.count);
        assert!(all.count > SIZE.0 * SIZE.1 / 2, "{family}: only {} pixels compared", all.count);
        assert!(all.psnr() >= 45.0, "{family}: re-projection is {:.1} dB", all.psnr());
    }
    for (name, score) in [("rigid", &rigid), ("skinned", &skinned), ("by the camera's motion", &by_camera)] {
        println!("{name}: {:.1} dB over {} pixels", score.psnr(), score.count);
        assert!(score.count > 500, "{name}: only {} pixels compared", score.count);
    }
    assert!(rigid.psnr() >= 45.0 && skinned.psnr() >= 45.0, "{:.1} and {:.1} dB", rigid.psnr(), skinned.psnr());
    // The camera's motion alone does not explain what moves: the test can tell them apart.
    assert!(by_camera.psnr() < 40.0, "{:.1} dB", by_camera.psnr());
}

#[test]
fn depth_and_motion_are_those_of_the_first_triangle_at_both_times() {
    for family in FAMILIES {
        let scene = Scene::with_cast(family, SEED, Cast::all());
        let (now, before) = moments(&scene, &[150])[0];
        let frame = draw(&scene, &now, &before, 1);
        let (view, past) = (now.camera.view(SIZE.0, SIZE.1), before.camera.view(SIZE.0, SIZE.1));
        let placed: Vec<_> =
            scene.chunks.iter().map(|c| (c, c.positions_at(now.time), c.positions_at(before.time))).collect();
        // Some pixels of everything, and as many of what moves.
        let pixels: Vec<usize> = (0..frame.depth.len()).collect();
        let movers: Vec<usize> = pixels.iter().copied().filter(|&k| moves(&frame, k)).collect();
        assert!(movers.len() > 200, "{family}: {} moving pixels", movers.len());
        let chosen = pixels.iter().step_by(pixels.len() / 40).chain(movers.iter().step_by(movers.len() / 40));
        let (mut agree, mut asked) = (0, 0);
        for &k in chosen {
            let pixel = Vec2::new((k % SIZE.0 as usize) as f32, (k / SIZE.0 as usize) as f32) + 0.5;
            let ray = view.to_world(view.ray(pixel));
            let mut first: (f32, Option<Vec3>) = (f32::MAX, None);
            for (chunk, here, there) in &placed {
                for t in &chunk.mesh.triangles {
                    let Some((far, [v, w])) = intersect_triangle(view.eye, ray, t.map(|i| here[i as usize])) else {
                        continue;
                    };
                    if far < first.0 {
                        let [a, b, c] = t.map(|i| there[i as usize]);
                        first = (far, Some(a * (1.0 - v - w) + b * v + c * w));
                    }
                }
            }
            let (nearest, was) = first;
            let expected = view_distance(if nearest > FAR { 1.0 } else { device_depth(nearest) });
            let found = view_distance(frame.depth[k]);
            let moved = was.filter(|_| nearest < FAR).is_none_or(|was| {
                let expected = past.project(past.to_view(was)) - pixel;
                (expected - frame.motion[k]).length() < 0.02 + 0.01 * expected.length()
            });
            asked += 1;
            agree += u32::from((found / expected - 1.0).abs() < 2e-3 && moved);
        }
        // A ray through an edge may take either side.
        assert!(asked > 75 && agree + 2 >= asked, "{family}: {agree} of {asked} agree");
    }
}

#[test]
fn the_walk_meets_every_member_of_the_cast() {
    let one = |name: &str| name.parse::<Cast>().expect("a member");
    let wanted = [20, 60, 100, 140, 180, 220, 260, 300, 340, 380, 420];
    for (name, family, kind) in [
        ("figures", Family::Desert, MotionKind::Skinned),
        ("birds", Family::Snow, MotionKind::Skinned),
        ("bodies", Family::Sword, MotionKind::Rigid),
        ("wind", Family::Forest, MotionKind::Skinned),
        ("doors", Family::Desert, MotionKind::Rigid),
        ("figures", Family::Indoors, MotionKind::Skinned),
        ("birds", Family::Indoors, MotionKind::Skinned),
        ("bodies", Family::Indoors, MotionKind::Rigid),
        ("figures", Family::Town, MotionKind::Skinned),
        ("birds", Family::Town, MotionKind::Skinned),
        ("bodies", Family::Town, MotionKind::Rigid),
        ("wind", Family::Town, MotionKind::Skinned),
        ("doors", Family::Town, MotionKind::Rigid),
        ("doors", Family::Indoors, MotionKind::Rigid),
    ] {
        let scene = Scene::with_cast(family, SEED, one(name));
        let mut met = 0;
        for (now, before) in moments(&scene, &wanted) {
            let frame = draw(&scene, &now, &before, 1);
            let moving = (frame.motion.iter().zip(&frame.camera_motion).zip(&frame.surfaces))
                .filter(|((all, camera), shown)| **shown == kind && all.is_finite() && all.distance(**camera) > 0.05)
                .count();
            assert!(
                frame.surfaces.iter().all(|s| [MotionKind::Sky, MotionKind::Still, MotionKind::Held, kind].contains(s))
            );
            met += u32::from(moving > 25);
        }
        println!("{name} in {family}: seen to move in {met} of {} frames", wanted.len());
        assert!(met >= 4, "{name} in {family}: seen to move in {met} frames");
    }
}

/// Fraction of the pixels that show the same still surface in both frames and differ by more than `codes` in brightness.
fn shading_differs(a: &Frame, b: &Frame, codes: f32) -> f32 {
    let mut changed = 0;
    for k in 0..a.depth.len() {
        let same = a.depth[k] == b.depth[k] && a.surfaces[k] == MotionKind::Still && b.surfaces[k] == MotionKind::Still;
        changed += u32::from(same && (colour(a, k) - colour(b, k)).length() > codes);
    }
    changed as f32 / a.depth.len() as f32
}

#[test]
fn shadows_and_lights_move_over_ground_that_stands_still() {
    let wanted = [60, 140, 220, 300, 380];
    for (name, least) in [("figures", 0.0005), ("wind", 0.005), ("lights", 0.02)] {
        let scene = Scene::with_cast(Family::Forest, SEED, name.parse().expect("a member"));
        let bare = Scene::new(Family::Forest, SEED);
        let mut most = 0.0_f32;
        for (now, _) in moments(&scene, &wanted) {
            // The eye rests while time goes on. Lights are compared with the scene that has none: a headlamp rests with the eye.
            let later = Moment { time: now.time + 0.4, ..now };
            let frames = if name == "lights" {
                [draw(&scene, &now, &now, 1), draw(&bare, &now, &now, 1)]
            } else {
                [draw(&scene, &now, &now, 1), draw(&scene, &later, &now, 1)]
            };
            most = most.max(shading_differs(&frames[0], &frames[1], 8.0));
        }
        println!("{name}: up to {most:.4} of the picture");
        assert!(most >= least, "{name} change the shading of {most} of the picture");
    }
    let still = Scene::new(Family::Forest, SEED);
    let (now, _) = moments(&still, &[60])[0];
    let later = Moment { time: now.time + 0.4, ..now };
    assert_eq!(draw(&still, &now, &now, 1).picture, draw(&still, &later, &now, 1).picture);
}

#[test]
fn a_frame_with_a_cast_has_the_same_bits_whatever_the_thread_count() {
    let frame = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let scene = Scene::with_cast(Family::Sword, SEED, Cast::all());
            let (now, before) = moments(&scene, &[120])[0];
            draw(&scene, &now, &before, 2)
        })
    };
    let (one, three) = (frame(1), frame(3));
    assert_eq!(one.picture, three.picture);
    let bits = |f: &Frame| {
        let vectors = f.motion.iter().chain(&f.camera_motion).flat_map(|m| [m.x.to_bits(), m.y.to_bits()]);
        vectors.chain(f.depth.iter().map(|d| d.to_bits())).collect::<Vec<_>>()
    };
    assert_eq!(bits(&one), bits(&three));
    assert_eq!(one.surfaces, three.surfaces);
}

#[test]
fn a_place_is_the_same_for_every_cast() {
    for family in FAMILIES {
        // Water is in a basin, wind bends plants, and doors that move replace some that stand ajar.
        let cast = Cast { water: false, wind: false, doors: false, ..Cast::all() };
        let [bare, full] = [Cast::none(), cast].map(|cast| Scene::with_cast(family, SEED, cast));
        assert_eq!(bare.obstacles, full.obstacles, "{family}");
        assert_eq!(bare.objects, full.objects, "{family}");
        let (mut still, mut bowls, mut lit_alike, mut other_colour) = (0, 0, 0, 0);
        for (now, before) in moments(&bare, &[30, 150, 300]) {
            let [bare, full] = [&bare, &full].map(|scene| draw(scene, &now, &before, 1));
            assert!(!(0..bare.depth.len()).any(|k| moves(&bare, k)), "{family}");
            for k in (0..full.depth.len()).filter(|&k| !moves(&full, k)) {
                assert!(full.depth[k] <= bare.depth[k], "{family}: a part is missing at pixel {k}");
                still += 1;
                // The bowls that the fires burn in.
                if full.depth[k] < bare.depth[k] {
                    bowls += 1;
                } else if !full.changing_light[k] && full.particle_cover[k] == 0.0 {
                    lit_alike += 1;
                    other_colour += u32::from(full.picture.pixels()[k] != bare.picture.pixels()[k]);
                }
            }
        }
        println!("{family}: {still} pixels, {bowls} of bowls; {other_colour} of {lit_alike} have another colour");
        assert!(still > 140_000 && bowls * 100 < still, "{family}: {still} pixels, {bowls} of bowls");
        // The bowls' own shadows.
        assert!(lit_alike > 30_000 && other_colour * 100 < lit_alike, "{family}: {other_colour} of {lit_alike}");
    }
}

/// Frames of the family's walk with motion, and the frames that the motion points to.
fn pairs(scene: &Scene, seconds: [u32; 2]) -> Vec<(Frame, Frame)> {
    let quality = Quality { samples: 3 };
    let draw = |(now, before): (Moment, Moment)| {
        [(now, before), (before, before)].map(|(now, before)| render(scene, &now, &before, 480, 270, quality))
    };
    moments(scene, &seconds.map(|s| s * 30))
        .into_iter()
        .map(draw)
        .map(|[current, previous]| (current, previous))
        .collect()
}

/// Whether a pixel shows the same kind of surface in both pictures, and nothing changes its colour.
fn is_lit_alike(current: &Frame, previous: &Frame, k: usize, was: usize) -> bool {
    let is_clear = |frame: &Frame, k: usize| !frame.changing_light[k] && frame.particle_cover[k] < 1e-3;
    is_clear(current, k) && is_clear(previous, was) && current.surfaces[k] == previous.surfaces[was]
}

#[test]
fn what_stands_still_in_built_places_keeps_its_exact_motion() {
    for family in [Family::Indoors, Family::Town] {
        // A headlamp and a muzzle's flash change the light on everything near.
        let scene = Scene::with_cast(family, 3, Cast { lights: false, flashes: false, ..Cast::all() });
        let mut still = Reprojection::default();
        for (current, previous) in &pairs(&scene, [2, 8]) {
            let is_still = |k: usize, was: usize| is_lit_alike(current, previous, k, was) && !moves(current, k);
            still.add(current, previous, &current.motion, is_still);
        }
        println!("{family}: {:.1} dB over {} pixels", still.psnr(), still.count);
        assert!(still.count > 5000, "{family}: only {} pixels compared", still.count);
        assert!(still.psnr() >= 45.0, "{family}: re-projection is {:.1} dB", still.psnr());
    }
}

#[test]
fn particles_and_flashes_change_colours_and_nothing_else() {
    for family in [Family::Snow, Family::Indoors, Family::Town] {
        let frames = |cast: &str| -> Vec<Frame> {
            let scene = Scene::with_cast(family, 6, cast.parse().expect("a cast"));
            // A quarter of a second into a burst the muzzle flashes.
            let at =
                moments(&scene, &[60, 120]).into_iter().map(|(now, before)| (Moment { time: 2.47, ..now }, before));
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
fn water_ripples() {
    let mut rippling = 0;
    for family in FAMILIES {
        let scene = Scene::with_cast(family, 6, "water".parse().expect("a cast"));
        let dry = Scene::with_cast(family, 6, Cast::none());
        let (mut wet, mut changed) = (0, 0);
        for (now, before) in moments(&scene, &[30, 90, 150, 210, 270, 330]) {
            let frame = render(&scene, &now, &before, 320, 180, Quality { samples: 1 });
            let without = render(&dry, &now, &before, 320, 180, Quality { samples: 1 });
            let later = Moment { time: now.time + 0.4, ..now };
            let rippled = render(&scene, &later, &before, 320, 180, Quality { samples: 1 });
            for k in 0..frame.depth.len() {
                let is_water = frame.changing_light[k] && frame.depth[k].to_bits() != without.depth[k].to_bits();
                wet += u32::from(is_water);
                changed += u32::from(is_water && frame.picture.pixels()[k] != rippled.picture.pixels()[k]);
                assert!(!is_water || frame.depth[k].to_bits() == rippled.depth[k].to_bits(), "ripples have no depth");
            }
        }
        println!("{family}: {wet} pixels of water, {changed} of them ripple");
        assert!(wet > 100, "{family}: only {wet} pixels of water");
        rippling += changed;
    }
    // Far from the viewer ripples are smaller than a pixel.
    assert!(rippling > 2000, "only {rippling} pixels ripple");
}

/// Light of a colour in code values: the inverse of sRGB's curve and of Narkowicz's fit of the ACES curve.
fn scene_light(colour: Vec3, exposure: f32) -> Vec3 {
    colour.map(|code| {
        let x = code / 255.0;
        let y = if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
        // The positive root x of y = x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14).
        let (a, b, c) = (2.51 - 2.43 * y, 0.03 - 0.59 * y, -0.14 * y);
        (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a) / 0.6 / exposure
    })
}

/// Whether the colours of the 3 x 3 pixels around pixel `k` differ little.
fn is_plain(frame: &Frame, k: usize) -> bool {
    let w = frame.picture.width() as usize;
    (0..3).all(|j| (0..3).all(|i| (colour(frame, k + i + j * w - w - 1) - colour(frame, k)).length() < 24.0))
}

#[test]
fn water_mirrors_what_is_above_it() {
    // Pixels so large that they resolve few ripples.
    let (width, height) = (160, 90);
    let quality = Quality { samples: 1 };
    let mut errors = Vec::new();
    for family in LANDSCAPES {
        let mut scene = Scene::with_cast(family, 6, "water".parse().expect("a cast"));
        let dry = Scene::with_cast(family, 6, Cast::none());
        // Light from below only: water, which faces up, has no light but what it mirrors, and the sky is black.
        uniform_light(&mut scene);
        (scene.weather.sky_light, scene.weather.ground_light) = (Vec3::ZERO, Vec3::splat(3.0));
        let (mut sky, mut bright_sky) = (0, 0);
        for (now, before) in moments(&scene, &[30, 90, 150, 210, 270, 330]) {
            scene.weather.exposure = 1.0;
            let frame = render(&scene, &now, &before, width, height, quality);
            let without = render(&dry, &now, &before, width, height, quality);
            // What water mirrors is dim.
            scene.weather.exposure = 8.0;
            let [bright, rippled] = [now.time, now.time + 0.4]
                .map(|time| render(&scene, &Moment { time, ..now }, &before, width, height, quality).picture);
            let view = now.view(width, height);
            for k in 0..frame.depth.len() {
                let is_water = frame.changing_light[k] && frame.depth[k].to_bits() != without.depth[k].to_bits();
                if !is_water || bright.pixels()[k] != rippled.pixels()[k] {
                    continue;
                }
                let [r, g, b, _] = bright.pixels()[k].map(f32::from);
                let found = scene_light(Vec3::new(r, g, b), 8.0);
                let pixel = Vec2::new((k as u32 % width) as f32, (k as u32 / width) as f32) + 0.5;
                let ray = view.to_world(view.ray(pixel));
                let point = view.eye + ray * view_distance(frame.depth[k]);
                let mirrored = Vec3::new(ray.x, -ray.y, ray.z);
                let axis = mirrored.normalize();
                let is_near = |&(centre, radius): &(Vec3, f32)| (centre - point).reject_from(axis).length() <= radius;
                let chunks = scene.chunks.iter().filter(|c| !c.held && is_near(&c.ball()));
                let meshes = chunks.map(|c| &c.mesh);
                let nearest = meshes
                    .flat_map(|mesh| mesh.triangles.iter().map(|t| t.map(|i| mesh.positions[i as usize])))
                    .filter_map(|corners| Some(intersect_triangle(point, mirrored, corners)?.0))
                    .fold(f32::MAX, f32::min);
                if nearest == f32::MAX {
                    sky += 1;
                    bright_sky += u32::from(found != Vec3::ZERO);
                    continue;
                }
                // The picture itself shows the mirrored point, unless something hides it.
                let above = view.to_view(point + mirrored * nearest);
                let at = view.project(above);
                let (x, y) = (at.x as usize, at.y as usize);
                if above.z < 0.5 || x < 1 || y < 1 || x + 2 > width as usize || y + 2 > height as usize {
                    continue;
                }
                let shown = y * width as usize + x;
                let is_visible = (view_distance(frame.depth[shown]) / above.z - 1.0).abs() < 0.02;
                if is_visible && is_plain(&frame, shown) {
                    // Schlick's approximation of water's reflectance.
                    let share = 0.02 + 0.98 * (1.0 + ray.normalize().y).powi(5);
                    let expected = scene_light(sample(&frame, at), 1.0) * share;
                    errors.push((found - expected).length() / expected.length());
                }
            }
        }
        println!("{family}: {bright_sky} of {sky} pixels that mirror the sky are bright, {} points", errors.len());
        assert!(bright_sky * 100 <= sky, "{family}: {bright_sky} of {sky} pixels that mirror the sky are bright");
    }
    errors.sort_by(f32::total_cmp);
    let median = errors[errors.len() / 2];
    println!("the light of {} points with a median error of {:.1} %", errors.len(), 100.0 * median);
    assert!(errors.len() > 50 && median < 0.03, "{} points with a median error of {median}", errors.len());
}
