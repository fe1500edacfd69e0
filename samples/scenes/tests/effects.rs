//! Edits, the head-up display, and effects on pictures.

use cairn::Picture;
use cairn::world::ControlScript;
use glam::Vec2;
use scenes::film::{FilmGrain, FilmOptions, MotionBlur, TemporalAntiAliasing, halton_jitter, mean_picture};
use scenes::{Clip, ClipFrame, ClipOptions, Effects, Family, Moment, Quality, Scene, Start, hud, render};

const SIZE: (u32, u32) = (160, 90);
const WALK: &str = "cairn-controls 1\n0..9 hold W\n0..9 mouse 1800 0\n9 end\n";
const STILL: &str = "cairn-controls 1\n9 end\n";

/// The first `count` frames of a walk through a desert.
fn frames(scene: &Scene, script: &str, rate: u32, samples: u32, count: usize, effects: Effects) -> Vec<ClipFrame> {
    let script = ControlScript::parse(script).expect("a script");
    let options =
        ClipOptions { width: SIZE.0, height: SIZE.1, rate, quality: Quality { samples }, ..ClipOptions::default() };
    let mut clip = Clip::with_effects(scene, &script, options, effects).expect("a rate in range");
    (0..count).map(|_| clip.next_frame().expect("a frame")).collect()
}

fn edits(text: &str) -> Effects {
    Effects { edits: text.parse().expect("edits"), ..Effects::default() }
}

fn film(options: FilmOptions) -> Effects {
    Effects { film: options, ..Effects::default() }
}

fn code_values(picture: &Picture) -> impl Iterator<Item = f64> {
    picture.pixels().iter().flat_map(|p| [p[0], p[1], p[2]]).map(f64::from)
}

fn psnr(a: &Picture, b: &Picture) -> f64 {
    let squares: f64 = code_values(a).zip(code_values(b)).map(|(a, b)| (a - b).powi(2)).sum();
    10.0 * (255.0 * 255.0 * code_values(a).count() as f64 / squares).log10()
}

#[test]
fn a_cut_jumps_counts_the_shot_and_has_no_motion() {
    let scene = Scene::new(Family::Desert, 1);
    let start: Start = "-20,30,120".parse().expect("a start");
    let frames = frames(&scene, WALK, 30, 1, 9, edits("0.2 cut -20,30,120"));
    for (n, f) in frames.iter().enumerate() {
        assert_eq!(f.now.shot, u32::from(n >= 6), "frame {n}");
        let finite = f.frame.motion.iter().filter(|m| m.is_finite()).count();
        let camera = f.frame.camera_motion.iter().filter(|m| m.is_finite()).count();
        if n == 6 {
            assert_eq!((finite, camera), (0, 0), "motion across the cut");
        } else {
            assert!(finite > f.frame.motion.len() * 9 / 10 && camera == finite, "frame {n}: {finite} finite vectors");
        }
        assert!((f.now.time - n as f32 / 30.0).abs() < 1e-5, "the world's time goes on");
    }
    let first = frames[6].now.camera;
    let at = Vec2::new(first.position.x, first.position.z);
    assert!(at.distance(start.at) < 0.3 && (first.yaw - start.yaw).abs() < 1e-6, "{first:?}");
    assert_eq!(frames[6].before.shot, 0);
    assert_eq!(frames[7].before, frames[6].now);
    // The script goes on: the new shot turns and walks.
    assert!(frames[8].now.camera.yaw > first.yaw + 0.01 && frames[8].now.walked > 0.0);
    assert!(frames.is_sorted_by_key(|f| hud::HudValues::at(&f.now).score), "the score falls");
    assert!(hud::HudValues::at(&frames[5].now).score > 0);
}

#[test]
fn a_cross_fade_mixes_both_shots_and_has_the_incoming_ones_motion() {
    let scene = Scene::new(Family::Desert, 1);
    let count = 15;
    let mixed = frames(&scene, WALK, 20, 1, count, edits("0.2..0.6 cross-fade -20,30,120"));
    let outgoing = frames(&scene, WALK, 20, 1, count, Effects::default());
    let incoming = frames(&scene, WALK, 20, 1, count, edits("0.2 cut -20,30,120"));
    for n in 0..count {
        let share = ((n as f64 / 20.0 - 0.2) / 0.4).clamp(0.0, 1.0);
        let pictures = [&outgoing[n], &incoming[n], &mixed[n]].map(|f| code_values(&f.frame.picture));
        let [below, above, have] = pictures;
        for ((below, above), have) in below.zip(above).zip(have) {
            let expected = below + (above - below) * share;
            assert!((have - expected).abs() <= 0.51, "frame {n}: {have} for {expected}");
        }
        let bits = |f: &ClipFrame| f.frame.motion.iter().map(|m| m.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        assert_eq!(bits(&mixed[n]), bits(&incoming[n]), "frame {n}");
        assert_eq!(mixed[n].frame.depth, incoming[n].frame.depth, "frame {n}");
    }
}

#[test]
fn fades_and_flashes_change_the_frames_at_their_times() {
    let scene = Scene::new(Family::Desert, 1);
    let plain = frames(&scene, WALK, 20, 1, 9, Effects::default());
    let faded = frames(&scene, WALK, 20, 1, 9, edits("0.1..0.3 fade-out black; 0.4..0.5 fade-in white"));
    for (n, darkness) in [(1, 0.0), (2, 0.0), (3, 0.25), (4, 0.5), (5, 0.75), (6, 1.0), (7, 1.0)] {
        for (was, is) in code_values(&plain[n].frame.picture).zip(code_values(&faded[n].frame.picture)) {
            assert!((is - was * (1.0 - darkness)).abs() <= 0.51, "frame {n}: {was} became {is}");
        }
    }
    assert!(code_values(&faded[8].frame.picture).all(|code| code == 255.0));
    assert_eq!(plain[8].frame.depth, faded[8].frame.depth);
}

/// The picture of one colour with the head-up display of `moment`, and its mask.
fn hud_over(scene: &Scene, moment: &Moment, (width, height): (u32, u32), code: u8) -> (Picture, Vec<u8>) {
    let pixels = [code, code, code, 255].repeat((width * height) as usize);
    let mut picture = Picture::from_rgba(width, height, pixels).expect("a picture");
    let mask = hud::draw(&mut picture, scene, moment);
    (picture, mask)
}

#[test]
fn the_mask_of_the_head_up_display_covers_what_it_changes_and_nothing_else() {
    let scene = Scene::new(Family::Forest, 1);
    let moment = frames(&scene, WALK, 30, 1, 1, Effects::default())[0].now;
    let size = (426, 240);
    let [(dark, mask), (bright, same)] = [0, 255].map(|code| hud_over(&scene, &moment, size, code));
    assert_eq!(mask, same);
    for (k, ((dark, bright), opacity)) in dark.pixels().iter().zip(bright.pixels()).zip(&mask).enumerate() {
        let changed = dark[..3] != [0; 3] || bright[..3] != [255; 3];
        assert_eq!(changed, *opacity > 0, "pixel {k}: opacity {opacity}, {dark:?}, {bright:?}");
        if *opacity == 255 {
            assert_eq!(dark, bright, "pixel {k} shows what is behind");
        }
    }
    let covered = mask.iter().filter(|opacity| **opacity > 0).count() as f64 / mask.len() as f64;
    let partly = mask.iter().filter(|opacity| (1..255).contains(*opacity)).count();
    assert!((0.08..0.35).contains(&covered) && partly > 1000, "{covered} covered, {partly} pixels in part");
    // In a picture twice as high it covers the same share.
    let (_, large) = hud_over(&scene, &moment, (852, 480), 0);
    let share = large.iter().filter(|opacity| **opacity > 0).count() as f64 / large.len() as f64;
    assert!((share / covered - 1.0).abs() < 0.05, "{share} instead of {covered}");
}

#[test]
fn the_head_up_display_changes_with_time_and_its_map_with_the_view() {
    let scene = Scene::new(Family::Forest, 1);
    let moment = frames(&scene, WALK, 30, 1, 1, Effects::default())[0].now;
    let size = (426, 240);
    let changed = |other: &Moment| {
        let [a, b] = [&moment, other].map(|moment| hud_over(&scene, moment, size, 90).0);
        let differs = |k: usize| a.pixels()[k] != b.pixels()[k];
        (0..a.pixels().len()).filter(|k| differs(*k)).map(|k| (k % 426, k / 426)).collect::<Vec<_>>()
    };
    let mut turned = moment;
    turned.camera.yaw += 0.7;
    let map = changed(&turned);
    assert!(map.len() > 500, "only {} pixels turned", map.len());
    assert!(map.iter().all(|&(x, y)| x > 300 && y < 80), "turning changes more than the map");
    let later = changed(&Moment { time: moment.time + 2.5, walked: moment.walked + 4.0, ..moment });
    let near = |x0, x1, y0, y1| later.iter().any(|&(x, y)| (x0..x1).contains(&x) && (y0..y1).contains(&y));
    assert!(near(0, 100, 0, 24) && near(180, 250, 0, 24), "score and timer");
    assert!(near(0, 110, 200, 240) && near(360, 426, 210, 240), "health and ammunition");
    let values = hud::HudValues::at(&Moment { time: 83.456, walked: 12.0, ..moment });
    assert_eq!((values.timer, values.score), ([1, 23, 46], 120 + 4100));
    let clip = frames(&scene, WALK, 30, 1, 1, Effects { hud: true, ..Effects::default() });
    assert!(clip[0].hud.as_ref().is_some_and(|mask| mask.len() == clip[0].frame.depth.len()));
}

#[test]
fn jitter_is_the_halton_sequence() {
    let expected = [(0.0, -1.0 / 6.0), (-0.25, 1.0 / 6.0), (0.25, -7.0 / 18.0), (-0.375, -1.0 / 18.0)];
    for (n, (x, y)) in expected.into_iter().enumerate() {
        let found = halton_jitter(n as u64, 8);
        assert!((found - Vec2::new(x, y)).abs().max_element() < 1e-6, "{n}: {found}");
        assert_eq!(found, halton_jitter(n as u64 + 8, 8));
    }
}

#[test]
fn anti_aliasing_of_a_still_camera_converges_to_the_supersampled_picture() {
    let scene = Scene::new(Family::Desert, 1);
    let options = FilmOptions { anti_aliasing: Some(32), ..FilmOptions::default() };
    let frames = frames(&scene, STILL, 30, 1, 32, Effects { jitter: Some(32), ..film(options) });
    let now = Moment { jitter: Vec2::ZERO, ..frames[0].now };
    let truth = render(&scene, &now, &now, SIZE.0, SIZE.1, Quality { samples: 8 }).picture;
    let after = [0, 1, 3, 7, 15, 31].map(|n| psnr(&frames[n].frame.picture, &truth));
    println!("PSNR after 1, 2, 4, 8, 16 and 32 frames: {after:.1?}");
    // From some dozen frames on, the clamp to the newest frame's neighbours takes back about as much as a further frame adds.
    assert!(after[..5].is_sorted(), "{after:?}");
    assert!(after[4..].iter().all(|psnr| *psnr > after[0] + 9.0), "{after:?}");
}

#[test]
fn anti_aliasing_of_a_moving_camera_follows_the_motion() {
    let scene = Scene::new(Family::Desert, 1);
    let effects = Effects { jitter: Some(8), ..Effects::default() };
    let raw = frames(&scene, WALK, 60, 1, 25, effects);
    let last = raw.last().expect("frames");
    let now = Moment { jitter: Vec2::ZERO, ..last.now };
    let truth = render(&scene, &now, &now, SIZE.0, SIZE.1, Quality { samples: 8 }).picture;
    let resolve = |with_motion: bool| {
        let mut filter = TemporalAntiAliasing::new(8);
        let pictures = raw.iter().map(|f| {
            let mut frame = f.frame.clone();
            if !with_motion {
                frame.motion.fill(f.before.jitter - f.now.jitter);
            }
            filter.resolve(&frame, &f.now, &f.before)
        });
        psnr(&pictures.last().expect("frames"), &truth)
    };
    let unfiltered = psnr(&last.frame.picture, &truth);
    let (followed, in_place) = (resolve(true), resolve(false));
    println!("PSNR: unfiltered {unfiltered:.1}, along the motion {followed:.1}, in place {in_place:.1} dB");
    assert!(followed > unfiltered + 2.0 && followed > in_place + 2.0);
}

#[test]
fn blur_of_a_still_picture_is_the_picture_and_blur_of_a_walk_the_mean_of_its_moments() {
    let scene = Scene::new(Family::Desert, 1);
    let blur = MotionBlur::shutter(360.0, 30, 5);
    let sharp = frames(&scene, STILL, 30, 1, 3, Effects::default());
    let blurred = frames(&scene, STILL, 30, 1, 3, film(FilmOptions { blur: Some(blur), ..FilmOptions::default() }));
    assert_eq!(sharp[2].frame.picture, blurred[2].frame.picture);

    // The middles of two halves of 4/120 s lie on the walker's steps 3 and 1 before the frame.
    let blur = MotionBlur { exposure: 4.0 / 120.0, subframes: 2 };
    let steps = frames(&scene, WALK, 120, 1, 17, Effects::default());
    let blurred = frames(&scene, WALK, 15, 1, 3, film(FilmOptions { blur: Some(blur), ..FilmOptions::default() }));
    let expected = mean_picture(&scene, &[steps[13].now, steps[15].now], SIZE.0, SIZE.1, Quality { samples: 1 });
    assert_eq!(blurred[2].frame.picture, expected);
    assert_ne!(blurred[2].frame.picture, steps[16].frame.picture);
    assert_eq!(blurred[2].frame.depth, steps[16].frame.depth);
    // Before the first step there is nothing to average.
    assert_eq!(blurred[0].frame.picture, steps[0].frame.picture);
}

#[test]
fn grain_has_its_deviation_and_repeats_with_its_seed() {
    let grey = Picture::from_rgba(256, 256, [128, 128, 128, 255].repeat(256 * 256)).expect("a picture");
    let noisy = |deviation: f32, seed: u64, number: u64| {
        let mut picture = grey.clone();
        FilmGrain { deviation, seed }.apply(&mut picture, number);
        picture.pixels().iter().map(|p| f64::from(p[0])).collect::<Vec<_>>()
    };
    let covariance = |a: &[f64], b: &[f64]| {
        let [ma, mb] = [a, b].map(|v| v.iter().sum::<f64>() / v.len() as f64);
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / a.len() as f64
    };
    for deviation in [2.0, 6.0] {
        let noise = noisy(deviation, 7, 3);
        let mean = noise.iter().sum::<f64>() / noise.len() as f64;
        // Rounding to code values adds a variance of 1/12.
        let found = (covariance(&noise, &noise) - 1.0 / 12.0).sqrt();
        assert!((mean - 128.0).abs() < 0.1, "mean {mean}");
        assert!((found / f64::from(deviation) - 1.0).abs() < 0.02, "{found} instead of {deviation}");
        assert_eq!(noise, noisy(deviation, 7, 3));
        for other in [noisy(deviation, 8, 3), noisy(deviation, 7, 4)] {
            let correlation = covariance(&noise, &other) / found / found;
            assert!(correlation.abs() < 0.02, "correlation {correlation}");
        }
        for shift in [1, 256] {
            let correlation = covariance(&noise[shift..], &noise[..noise.len() - shift]) / found / found;
            assert!(correlation.abs() < 0.02, "correlation {correlation} at a distance of {shift} pixels");
        }
    }
}

#[test]
fn all_effects_together_have_the_same_bytes_whatever_the_thread_count() {
    let scene = Scene::new(Family::Sword, 2);
    let effects = Effects {
        edits: "0.1..0.3 cross-fade 10,10,45; 0.15..0.3 flash 0.5".parse().expect("edits"),
        film: FilmOptions {
            blur: Some(MotionBlur::shutter(180.0, 30, 2)),
            anti_aliasing: Some(8),
            grain: Some(FilmGrain { deviation: 3.0, seed: 1 }),
        },
        jitter: None,
        hud: true,
    };
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| frames(&scene, WALK, 30, 1, 6, effects.clone()))
    };
    for (one, four) in draw(1).iter().zip(draw(4)) {
        assert_eq!(one.frame.picture, four.frame.picture);
        assert_eq!(one.hud, four.hud);
        assert_eq!(one.now.jitter, halton_jitter(one.number, scenes::TAA_PHASES));
    }
}
