//! Things that move have exact motion and depth, and the walk of each family's script meets them.

mod common;

use cairn::world::ControlScript;
use common::Reprojection;
use glam::{Vec2, Vec3};
use scenes::camera::{FAR, device_depth, view_distance};
use scenes::{
    Cast, Clip, ClipOptions, FAMILIES, Family, Frame, LANDSCAPES, Moment, Quality, Scene, SurfaceKind, render,
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

fn colour(frame: &Frame, x: i32, y: i32) -> Vec3 {
    let x = x.clamp(0, SIZE.0 as i32 - 1);
    let y = y.clamp(0, SIZE.1 as i32 - 1);
    let p = frame.picture.pixels()[(y * SIZE.0 as i32 + x) as usize];
    Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2]))
}

/// Catmull-Rom sampling at a pixel position, in code values.
fn sample(frame: &Frame, at: Vec2) -> Vec3 {
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
            sum += colour(frame, low.x as i32 + i as i32 - 1, low.y as i32 + j as i32 - 1) * wx * wy;
        }
    }
    sum
}

/// Whether the 5 x 5 pixels around (x, y) show one smooth surface of one kind: no silhouette passes there.
fn inside(frame: &Frame, x: i32, y: i32) -> bool {
    let (w, h) = (SIZE.0 as i32, SIZE.1 as i32);
    if x < 2 || y < 2 || x + 2 >= w || y + 2 >= h {
        return false;
    }
    let at = |x: i32, y: i32| view_distance(frame.depth[(y * w + x) as usize]);
    let kind = frame.surfaces[(y * w + x) as usize];
    let here = at(x, y);
    (-2..=2).all(|j| {
        (-2..=2).all(|i| {
            // On a plane depth is linear in 1/z: opposite neighbours average to the middle.
            let (a, b) = (1.0 / at(x + i, y + j), 1.0 / at(x - i, y - j));
            ((a + b) * 0.5 * here - 1.0).abs() < 0.004 && frame.surfaces[((y + j) * w + x + i) as usize] == kind
        })
    })
}

/// Sum of squared errors of a colour component, and pixels.
#[derive(Default)]
struct Score {
    error: f64,
    pixels: u32,
}

impl Score {
    fn add(&mut self, difference: Vec3) {
        self.error += f64::from(difference.length_squared()) / 3.0;
        self.pixels += 1;
    }

    fn psnr(&self) -> f64 {
        10.0 * (255.0 * 255.0 / (self.error / f64::from(self.pixels)).max(1e-9)).log10()
    }
}

#[test]
fn motion_of_moving_surfaces_leads_to_the_same_point_of_the_previous_picture() {
    let cast: Cast = "figures,birds,bodies,wind,doors".parse().expect("a cast");
    let (mut rigid, mut skinned, mut by_camera) = (Score::default(), Score::default(), Score::default());
    for family in LANDSCAPES {
        let mut scene = Scene::with_cast(family, SEED, cast);
        uniform_light(&mut scene);
        let mut all = Score::default();
        for (now, before) in moments(&scene, &[60, 150, 260, 370]) {
            let current = draw(&scene, &now, &before, 4);
            let previous = draw(&scene, &before, &before, 4);
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
                    // Visible in both: the same kind of surface, and the previous depth there is that of a point close by.
                    let p = (py * SIZE.0 as i32 + px) as usize;
                    let (old, new) = (view_distance(previous.depth[p]), view_distance(current.depth[k]));
                    if previous.surfaces[p] != current.surfaces[k] || (old / new - 1.0).abs() > 0.05 {
                        continue;
                    }
                    let difference = sample(&previous, there) - colour(&current, x, y);
                    all.add(difference);
                    match current.surfaces[k] {
                        SurfaceKind::Rigid => rigid.add(difference),
                        SurfaceKind::Skinned => skinned.add(difference),
                        _ => continue,
                    }
                    let still = Vec2::new(x as f32, y as f32) + 0.5 + current.camera_motion[k];
                    if still.is_finite() && (still - there).length() > 0.5 {
                        by_camera.add(sample(&previous, still) - colour(&current, x, y));
                    }
                }
            }
        }
        println!("{family}: {:.1} dB over {} pixels", all.psnr(), all.pixels);
        assert!(all.pixels > SIZE.0 * SIZE.1 / 2, "{family}: only {} pixels compared", all.pixels);
        assert!(all.psnr() >= 45.0, "{family}: re-projection is {:.1} dB", all.psnr());
    }
    for (name, score) in [("rigid", &rigid), ("skinned", &skinned), ("by the camera's motion", &by_camera)] {
        println!("{name}: {:.1} dB over {} pixels", score.psnr(), score.pixels);
        assert!(score.pixels > 500, "{name}: only {} pixels compared", score.pixels);
    }
    assert!(rigid.psnr() >= 45.0 && skinned.psnr() >= 45.0, "{:.1} and {:.1} dB", rigid.psnr(), skinned.psnr());
    // The camera's motion alone does not explain what moves: the test can tell them apart.
    assert!(by_camera.psnr() < 40.0, "{:.1} dB", by_camera.psnr());
}

/// Where a ray meets a triangle: distance in units of `direction`, and weights of the second and third corner (Moeller and Trumbore).
fn meets(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f32, [f32; 2])> {
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let det = u.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = (origin - a) / det;
    let (x, q) = (s.dot(p), s.cross(u));
    let (y, t) = (direction.dot(q), v.dot(q));
    (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.1).then_some((t, [x, y]))
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
        let moving = |k: usize| matches!(frame.surfaces[k], SurfaceKind::Rigid | SurfaceKind::Skinned);
        // Some pixels of everything, and as many of what moves.
        let pixels: Vec<usize> = (0..frame.depth.len()).collect();
        let movers: Vec<usize> = pixels.iter().copied().filter(|&k| moving(k)).collect();
        assert!(movers.len() > 200, "{family}: {} moving pixels", movers.len());
        let chosen = pixels.iter().step_by(pixels.len() / 40).chain(movers.iter().step_by(movers.len() / 40));
        let (mut agree, mut asked) = (0, 0);
        for &k in chosen {
            let pixel = Vec2::new((k % SIZE.0 as usize) as f32, (k / SIZE.0 as usize) as f32) + 0.5;
            let ray = view.to_world(view.ray(pixel));
            let mut first: (f32, Option<Vec3>) = (f32::MAX, None);
            for (chunk, here, there) in &placed {
                for t in &chunk.mesh.triangles {
                    let Some((far, [v, w])) = meets(view.eye, ray, t.map(|i| here[i as usize])) else { continue };
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
        ("figures", Family::Desert, SurfaceKind::Skinned),
        ("birds", Family::Snow, SurfaceKind::Skinned),
        ("bodies", Family::Sword, SurfaceKind::Rigid),
        ("wind", Family::Forest, SurfaceKind::Skinned),
        ("doors", Family::Desert, SurfaceKind::Rigid),
        ("figures", Family::Indoors, SurfaceKind::Skinned),
        ("birds", Family::Indoors, SurfaceKind::Skinned),
        ("bodies", Family::Indoors, SurfaceKind::Rigid),
        ("figures", Family::Town, SurfaceKind::Skinned),
        ("birds", Family::Town, SurfaceKind::Skinned),
        ("bodies", Family::Town, SurfaceKind::Rigid),
        ("wind", Family::Town, SurfaceKind::Skinned),
        ("doors", Family::Town, SurfaceKind::Rigid),
        ("doors", Family::Indoors, SurfaceKind::Rigid),
    ] {
        let scene = Scene::with_cast(family, SEED, one(name));
        let mut met = 0;
        for (now, before) in moments(&scene, &wanted) {
            let frame = draw(&scene, &now, &before, 1);
            let moving = (frame.motion.iter().zip(&frame.camera_motion).zip(&frame.surfaces))
                .filter(|((all, camera), shown)| **shown == kind && all.is_finite() && all.distance(**camera) > 0.05)
                .count();
            assert!(
                frame
                    .surfaces
                    .iter()
                    .all(|s| [SurfaceKind::Sky, SurfaceKind::Still, SurfaceKind::Held, kind].contains(s))
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
        let same =
            a.depth[k] == b.depth[k] && a.surfaces[k] == SurfaceKind::Still && b.surfaces[k] == SurfaceKind::Still;
        let (x, y) = ((k % SIZE.0 as usize) as i32, (k / SIZE.0 as usize) as i32);
        changed += u32::from(same && (colour(a, x, y) - colour(b, x, y)).length() > codes);
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

/// FNV-1a hash of a frame's bytes.
fn hash(frame: &Frame) -> u64 {
    let numbers = frame.depth.iter().copied().chain(frame.motion.iter().flat_map(|m| [m.x, m.y]));
    let bytes = frame.picture.pixels().iter().flatten().copied().chain(numbers.flat_map(|x| x.to_bits().to_le_bytes()));
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn a_place_is_the_same_for_every_cast() {
    for family in FAMILIES {
        let full = Scene::with_cast(family, SEED, Cast { water: false, ..Cast::all() });
        let bare = Scene::new(family, SEED);
        assert_eq!(bare.obstacles, full.obstacles, "{family}");
        assert_eq!(bare.objects, full.objects, "{family}");
        let explicit = Scene::with_cast(family, SEED, Cast::none());
        let (now, before) = moments(&bare, &[30])[0];
        assert_eq!(hash(&draw(&bare, &now, &before, 1)), hash(&draw(&explicit, &now, &before, 1)), "{family}");
        let frame = draw(&bare, &now, &before, 1);
        assert!(frame.surfaces.iter().all(|s| !matches!(s, SurfaceKind::Rigid | SurfaceKind::Skinned)), "{family}");
    }
}

fn moves(frame: &Frame, k: usize) -> bool {
    matches!(frame.surfaces[k], SurfaceKind::Rigid | SurfaceKind::Skinned)
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
fn water_mirrors_what_is_above_it() {
    let mut rippling = 0;
    for family in FAMILIES {
        let scene = Scene::with_cast(family, 6, "water".parse().expect("a cast"));
        let dry = Scene::with_cast(family, 6, Cast::none());
        let (mut wet, mut mirrored) = (0, 0);
        for (now, before) in moments(&scene, &[30, 90, 150, 210, 270, 330]) {
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
        assert!(wet > 100, "{family}: only {wet} pixels of water");
        rippling += mirrored;
    }
    // Far from the viewer ripples are smaller than a pixel.
    assert!(rippling > 2000, "only {rippling} pixels ripple");
}
