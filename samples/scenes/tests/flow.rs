//! Motion from pictures alone against the scenes' true motion, between anchors a fifteenth of a second apart.

use std::time::Instant;

use cairn::guidance::{Guidance, picture_flow};
use cairn::world::ControlScript;
use glam::Vec2;
use scenes::camera::view_distance;
use scenes::{Clip, ClipOptions, Frame, LANDSCAPES, Moment, Quality, Scene, render};

const SIZE: (u32, u32) = (640, 360);
const SEEDS: [u64; 3] = [1, 2, 3];
const SCRIPT: &str = "cairn-controls 1\n0..9 hold W\n2..9 mouse 1680 0\n9 end\n";
/// Anchors of 15 a second, in the midst of walking straight on and of walking with a turn, and the pixels that at
/// least half of the picture moves between two.
const MOVES: [(&str, usize, f32); 2] = [("walking", 24, 0.2), ("turning", 36, 8.0)];

/// The moments of anchor `number` and of the one before it.
fn moments(scene: &Scene, number: usize) -> (Moment, Moment) {
    let script = ControlScript::parse(SCRIPT).expect("a script");
    let mut clip =
        Clip::new(scene, &script, ClipOptions { rate: 15, ..ClipOptions::default() }).expect("15 divides 120");
    for _ in 0..number {
        clip.advance().expect("a step");
    }
    clip.advance().expect("a step")
}

/// Whether the point that `current` shows at pixel (x, y) is seen in `previous` too: its true motion ends in the
/// picture, and one of the four pixels around that end lies as far away, to 5 % and the walk of one anchor.
fn seen_in_both(current: &Frame, previous: &Frame, x: u32, y: u32) -> bool {
    let k = (y * SIZE.0 + x) as usize;
    let there = Vec2::new(x as f32, y as f32) + current.motion[k];
    if !there.is_finite() || there.min_element() < 0.0 {
        return false;
    }
    let (left, top) = (there.x as u32, there.y as u32);
    if left + 1 >= SIZE.0 || top + 1 >= SIZE.1 {
        return false;
    }
    let now = view_distance(current.depth[k]);
    [(0, 0), (1, 0), (0, 1), (1, 1)].iter().any(|(dx, dy)| {
        let before = view_distance(previous.depth[((top + dy) * SIZE.0 + left + dx) as usize]);
        (before - now).abs() <= 0.05 * now + 0.3
    })
}

#[test]
fn motion_from_pictures_is_close_to_the_truth() {
    let mut extractor = picture_flow::Extractor::new();
    let mut guidance = Guidance::new(SIZE.0, SIZE.1, picture_flow::PROJECTION).expect("guidance");
    let quality = Quality { samples: 2 };
    for family in LANDSCAPES {
        for (name, number, least) in MOVES {
            let mut errors = Vec::new();
            let (mut lengths, mut taken) = (Vec::new(), 0.0);
            for seed in SEEDS {
                let scene = Scene::new(family, seed);
                let (now, before) = moments(&scene, number);
                let current = render(&scene, &now, &before, SIZE.0, SIZE.1, quality);
                let previous = render(&scene, &before, &before, SIZE.0, SIZE.1, quality);
                let start = Instant::now();
                extractor.extract(&previous.picture, &current.picture, &mut guidance).expect("motion");
                taken += start.elapsed().as_secs_f64();
                for y in 0..SIZE.1 {
                    for x in 0..SIZE.0 {
                        if seen_in_both(&current, &previous, x, y) {
                            let k = (y * SIZE.0 + x) as usize;
                            let [u, v] = guidance.motion().vectors()[k].map(f32::from);
                            errors.push((Vec2::new(u, v) - current.motion[k]).length());
                            lengths.push(current.motion[k].length());
                        }
                    }
                }
            }
            errors.sort_by(f32::total_cmp);
            lengths.sort_by(f32::total_cmp);
            let at = |part: f64| errors[(errors.len() as f64 * part) as usize];
            let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
            println!(
                "{family} {name}: error: median {:.3}, 90 % {:.3}, 95 % {:.3}, mean {mean:.3} px; {} pixels, true motion \
                 of median {:.1}, up to {:.0} px; {:.0} ms a pair",
                at(0.5),
                at(0.9),
                at(0.95),
                errors.len(),
                lengths[lengths.len() / 2],
                lengths[lengths.len() - 1],
                taken * 1000.0 / SEEDS.len() as f64
            );
            // A world at rest would be no test; neither would a few pixels of it.
            assert!(lengths[lengths.len() / 2] > least, "{family} {name}: too little moves");
            assert!(
                errors.len() > (SIZE.0 * SIZE.1) as usize * SEEDS.len() / 2,
                "{family} {name}: too little compared"
            );
            assert!(at(0.5) <= 1.0, "{family} {name}: median error {:.3} px", at(0.5));
            assert!(at(0.9) <= 3.0, "{family} {name}: 90 % of the errors up to {:.3} px", at(0.9));
        }
    }
}
