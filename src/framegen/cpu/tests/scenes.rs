//! Scenes whose true frame is known at every phase.

use super::synthetic::{draw, generate, guide, landscape, mean_difference, noise, texture, unlike};
use crate::Picture;
use crate::framegen::Outcome;
use crate::guidance::Guidance;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const FAR: f32 = 0.9;
const NEAR: f32 = 0.2;
/// Phases at which a shift of 12 pixels is a whole number of pixels.
const WHOLE_PHASES: [f32; 5] = [0.25, 1.0 / 3.0, 0.5, 2.0 / 3.0, 0.75];

/// Picture of a scene at phase t.
type Scene<'a> = &'a dyn Fn(f64) -> Picture;

/// Includes every pixel.
fn anywhere(_: i64, _: i64) -> bool {
    true
}

/// Asserts that generated frames equal the truth at all such phases where `inside` holds, and that they were generated.
fn assert_exact(scene: Scene<'_>, guidance: &Guidance, inside: impl Fn(i64, i64) -> bool + Copy) {
    assert_exact_but(0, scene, guidance, inside);
}

/// The same, except for a few pixels: dilation goes by colour, and a noise pixel may match another position by chance.
fn assert_exact_but(few: usize, scene: Scene<'_>, guidance: &Guidance, inside: impl Fn(i64, i64) -> bool + Copy) {
    for t in WHOLE_PHASES {
        let (picture, report) = generate(&scene(0.0), &scene(1.0), guidance, t);
        assert_eq!(report.outcome, Outcome::Generated);
        let wrong = unlike(&picture, &scene(f64::from(t)), 0, inside);
        assert!(wrong.len() <= few, "{} pixels, the first at {:?}, t = {t}", wrong.len(), wrong[0]);
    }
}

/// Asserts that frames have a mean difference of at most `bound` levels from the truth, and a seventh of that of a
/// plain blend of the anchors. Not exact, because tiles of 8x8 pixels share one vector if their vectors differ by less
/// than three quarters of a pixel.
fn assert_close(scene: Scene<'_>, guidance: &Guidance, bound: f64) {
    let (before, after) = (scene(0.0), scene(1.0));
    for t in [0.25, 0.5, 0.75] {
        let truth = scene(f64::from(t));
        let (picture, report) = generate(&before, &after, guidance, t);
        assert_eq!(report.outcome, Outcome::Generated);
        let mut mixture = before.clone();
        for (value, &other) in mixture.rgba_mut().iter_mut().zip(after.rgba()) {
            *value = (f32::from(*value) + (f32::from(other) - f32::from(*value)) * t + 0.5) as u8;
        }
        let (difference, mixed) = (mean_difference(&picture, &truth), mean_difference(&mixture, &truth));
        assert!(difference <= bound && difference * 7.0 <= mixed, "t = {t}: {difference}, mixture {mixed}");
    }
}

/// The ground moves by (dx, dy) from one anchor to the next.
fn pan(ground: fn(f64, f64) -> [u8; 3], dx: f64, dy: f64) -> impl Fn(f64) -> Picture {
    move |t| draw(WIDTH, HEIGHT, |x, y| ground((x - t * dx).round(), (y - t * dy).round()))
}

#[test]
fn a_uniform_pan_is_met_exactly_up_to_the_edges() {
    for (dx, dy) in [(12.0, 0.0), (-12.0, 0.0), (0.0, 12.0), (0.0, -12.0)] {
        let guidance = guide(WIDTH, HEIGHT, |_, _| ([-dx, -dy], 0.5));
        assert_exact(&pan(noise, dx, dy), &guidance, anywhere);
    }
    // With diagonal motion, neither anchor shows two of the corners.
    let guidance = guide(WIDTH, HEIGHT, |_, _| ([-12.0, 24.0], 0.5));
    assert_exact(&pan(noise, 12.0, -24.0), &guidance, |x, y| (12..84).contains(&x) || (24..40).contains(&y));
}

#[test]
fn a_pan_by_parts_of_pixels_is_met_closely() {
    let scene = |t: f64| draw(WIDTH, HEIGHT, |x, y| texture(x - t * 5.0, y - t * 2.3));
    assert_close(&scene, &guide(WIDTH, HEIGHT, |_, _| ([-5.0, -2.3], 0.5)), 0.7);
}

#[test]
fn the_uncovered_share_is_reported() {
    let scene = pan(noise, 12.0, 0.0);
    let guidance = guide(WIDTH, HEIGHT, |_, _| ([-12.0, 0.0], 0.5));
    let (_, report) = generate(&scene(0.0), &scene(1.0), &guidance, 0.5);
    // Half way, the current anchor's pixels are displaced by 6 columns, which leaves 6 at the right uncovered.
    assert_eq!(report.uncovered, 6.0 / 96.0);
}

/// Whether (x, y) is on the box, which moves by 12 pixels, at phase t.
fn on_box(x: f64, y: f64, t: f64) -> bool {
    let left = (30.0 + 12.0 * t).round();
    (left..left + 20.0).contains(&x) && (20.0..44.0).contains(&y)
}

fn box_over_ground(t: f64) -> Picture {
    draw(WIDTH, HEIGHT, |x, y| if on_box(x, y, t) { noise((x - 12.0 * t).round() + 500.0, y) } else { noise(x, y) })
}

#[test]
fn a_box_over_a_still_background_is_met_exactly_on_both_sides() {
    let guidance = guide(WIDTH, HEIGHT, |x, y| if on_box(x, y, 1.0) { ([-12.0, 0.0], NEAR) } else { ([0.0; 2], FAR) });
    assert_exact_but(1, &box_over_ground, &guidance, anywhere);
}

#[test]
fn a_box_without_depth_is_met_except_beside_its_leading_edge() {
    let guidance = guide(WIDTH, HEIGHT, |x, y| (if on_box(x, y, 1.0) { [-12.0, 0.0] } else { [0.0; 2] }, 0.5));
    // Right of the box, the current anchor occludes the ground; without depth, both surfaces around it are equally
    // likely.
    assert_exact(&box_over_ground, &guidance, |x, y| !((50..62).contains(&x) && (20..44).contains(&y)));
}

#[test]
fn a_box_against_a_moving_background_is_met_exactly() {
    let scene = |t: f64| {
        draw(WIDTH, HEIGHT, |x, y| {
            if on_box(x, y, t) { noise((x - 12.0 * t).round() + 500.0, y) } else { noise((x + 12.0 * t).round(), y) }
        })
    };
    let guidance =
        guide(WIDTH, HEIGHT, |x, y| if on_box(x, y, 1.0) { ([-12.0, 0.0], NEAR) } else { ([12.0, 0.0], FAR) });
    assert_exact(&scene, &guidance, anywhere);
}

#[test]
fn rotation_is_met_closely() {
    let (cx, cy, angle) = (47.5, 31.5, 0.12_f64);
    let turned = |x: f64, y: f64, by: f64| {
        let (sin, cos) = by.sin_cos();
        [cx + cos * (x - cx) - sin * (y - cy), cy + sin * (x - cx) + cos * (y - cy)]
    };
    let scene = |t: f64| {
        draw(WIDTH, HEIGHT, |x, y| {
            let [x, y] = turned(x, y, -angle * t);
            texture(x, y)
        })
    };
    let guidance = guide(WIDTH, HEIGHT, |x, y| {
        let [px, py] = turned(x, y, -angle);
        ([px - x, py - y], 0.5)
    });
    assert_close(&scene, &guidance, 0.75);
}

#[test]
fn zooms_in_and_out_are_met_closely() {
    for scale in [1.15, 1.0 / 1.15] {
        let zoomed = |x: f64, y: f64, t: f64| {
            let s = 1.0 + (scale - 1.0) * t;
            [47.5 + (x - 47.5) / s, 31.5 + (y - 31.5) / s]
        };
        let scene = |t: f64| {
            draw(WIDTH, HEIGHT, |x, y| {
                let [x, y] = zoomed(x, y, t);
                texture(x, y)
            })
        };
        let guidance = guide(WIDTH, HEIGHT, |x, y| {
            let [px, py] = zoomed(x, y, 1.0);
            ([px - x, py - y], 0.5)
        });
        assert_close(&scene, &guidance, 0.7);
    }
}

#[test]
fn a_still_hud_over_a_pan_stays_still_although_its_vectors_move() {
    let on_hud = |x: f64, y: f64| (40.0..56.0).contains(&x) && (8.0..16.0).contains(&y);
    let scene = |t: f64| {
        draw(WIDTH, HEIGHT, |x, y| if on_hud(x, y) { noise(x + 900.0, y) } else { noise((x - 12.0 * t).round(), y) })
    };
    let guidance = guide(WIDTH, HEIGHT, |_, _| ([-12.0, 0.0], 0.5));
    assert_exact_but(2, &scene, &guidance, anywhere);
}

#[test]
fn a_periodic_texture_is_met_exactly() {
    // Stripes with a period of 8 pixels that move by 12: no motion, and several wrong motions, match as well.
    let stripes = |x: f64, _: f64| if x.rem_euclid(8.0) < 4.0 { [230, 30, 90] } else { [20, 160, 220] };
    let scene = pan(stripes, 12.0, 0.0);
    assert_exact(&scene, &guide(WIDTH, HEIGHT, |_, _| ([-12.0, 0.0], 0.5)), anywhere);
}

#[test]
fn letterbox_bars_stay_black_and_the_picture_between_them_moves() {
    let on_bar = |y: f64| !(10.0..54.0).contains(&y);
    for (dx, dy) in [(12.0, 0.0), (0.0, 12.0), (0.0, -12.0)] {
        let scene = |t: f64| {
            draw(
                WIDTH,
                HEIGHT,
                |x, y| {
                    if on_bar(y) { [0; 3] } else { noise((x - t * dx).round(), (y - t * dy).round()) }
                },
            )
        };
        // With and without guidance that includes the bars.
        let knowing = guide(WIDTH, HEIGHT, |_, y| if on_bar(y) { ([0.0; 2], 0.0) } else { ([-dx, -dy], 0.5) });
        assert_exact_but(6, &scene, &knowing, anywhere);
        let unknowing = guide(WIDTH, HEIGHT, |_, _| ([-dx, -dy], 0.5));
        assert_exact_but(6, &scene, &unknowing, anywhere);
    }
}

#[test]
fn a_cut_shows_the_nearer_anchor_and_never_a_mixture() {
    let before = draw(WIDTH, HEIGHT, landscape);
    let after = draw(WIDTH, HEIGHT, |x, y| landscape(y + 400.0, x - 300.0));
    let noisy = [draw(WIDTH, HEIGHT, noise), draw(WIDTH, HEIGHT, |x, y| noise(x + 5000.0, y - 700.0))];
    let still = guide(WIDTH, HEIGHT, |_, _| ([0.0; 2], 0.5));
    let moving = guide(WIDTH, HEIGHT, |_, _| ([-9.0, 4.0], 0.5));
    for (before, after) in [(&before, &after), (&after, &before), (&noisy[0], &noisy[1]), (&before, &noisy[0])] {
        for guidance in [&still, &moving] {
            for (t, nearer) in [(0.25, before), (0.5, after), (0.75, after)] {
                let (picture, report) = generate(before, after, guidance, t);
                assert_eq!(report.outcome, Outcome::CutFallback, "{report:?}");
                assert!(picture == *nearer && report.unexplained >= 0.5, "t = {t}, {report:?}");
            }
        }
    }
}

#[test]
fn flashes_fades_and_fast_turns_are_no_cuts() {
    let ground = draw(WIDTH, HEIGHT, landscape);
    let still = guide(WIDTH, HEIGHT, |_, _| ([0.0; 2], 0.5));
    for lit in [
        draw(WIDTH, HEIGHT, |x, y| landscape(x, y).map(|v| v.saturating_add(60))),
        draw(WIDTH, HEIGHT, |x, y| landscape(x, y).map(|v| v / 2 + 40)),
    ] {
        let (_, report) = generate(&ground, &lit, &still, 0.5);
        assert_eq!(report.outcome, Outcome::Generated, "{report:?}");
    }
    // A third of the picture within one interval, and no motion vectors for it.
    let turned = draw(WIDTH, HEIGHT, |x, y| landscape(x - 32.0, y));
    let (_, report) = generate(&ground, &turned, &still, 0.5);
    assert_eq!(report.outcome, Outcome::Generated, "{report:?}");
}
