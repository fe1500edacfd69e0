//! Memory test: turn away, wait, turn back, and compare with the original view and with other places.

use std::sync::Arc;

use cairn::world::{ControlScript, World};
use cairn::{Picture, Result};
use scenes::TURN_PER_COUNT;
use serde::{Deserialize, Serialize};

use super::place::{Course, TestWalk};
use super::walk::{Tools, begin, picture_of, step, step_at};
use crate::level::{HELD_OUT_WALKS, held_out_walk};
use crate::metrics::{psnr, ssim};
use crate::progress::check_stop;

/// Angle of the turn in degrees; the field of view is 94 wide.
const TURN: f32 = 120.0;
/// Duration of a turn in seconds.
const TURNING: f64 = 1.0;
/// Delay in seconds between the end of the turn back and the comparison.
const SETTLING: f64 = 0.2;

/// Result of the test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct MemoryScore {
    /// Seconds spent turned away.
    pub(super) away: f64,
    /// PSNR of the picture after the turn back against the truth, in dB.
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    /// PSNR of the autoencoder's reconstruction of the first picture against the truth, in dB: an upper bound.
    pub(super) most: f64,
    /// Highest PSNR in dB of the picture after the turn back against the true picture of another place.
    pub(super) elsewhere: f64,
    /// Whether the truth is nearer than every other place: by LPIPS if it is measured, otherwise by PSNR.
    pub(super) is_right: bool,
}

/// The script, without walking.
fn script(away: f64) -> Result<ControlScript> {
    let counts = TURN.to_radians() / TURN_PER_COUNT;
    let (back, home) = (TURNING + away, 2.0 * TURNING + away);
    ControlScript::parse(&format!(
        "cairn-controls 1\n0..{TURNING} mouse {counts:.2} 0\n{back}..{home} mouse {:.2} 0\n{} end\n",
        -counts,
        home + SETTLING
    ))
}

/// Turns away from the start of a walk for each of the times `away`, which must be ascending, and back. One rollout waits, and its state is
/// saved where a way back begins. The other places are the starts of the level's other held-out walks, and the view while turned away.
///
/// # Errors
/// As [`score`](super::walk::score).
pub(super) fn turn_away_and_back(
    place: TestWalk,
    course: &Course,
    away: &[f64],
    world: &Arc<World>,
    tools: &Tools<'_>,
) -> Result<Vec<MemoryScore>> {
    let (point, size) = (tools.point, world.render_size());
    let Some(&longest) = away.last() else { return Ok(Vec::new()) };
    let waiting = script(longest)?;
    let true_picture = |script: &ControlScript, seconds: f64| {
        let mut clip = course.clip_of(script, course.start, size, point.latents_per_second)?;
        for _ in 0..step_at(point, seconds) {
            clip.advance()?;
        }
        Ok::<_, cairn::Error>(clip.frame()?.picture)
    };
    let first = true_picture(&waiting, 0.0)?;
    let mut others = other_starts(place, course, size)?;
    others.push(true_picture(&waiting, TURNING)?);

    let mut rollout = begin(place, &first, world, point)?;
    let reconstruction = picture_of(&mut rollout, world, point)?;
    let mut scores = Vec::new();
    let mut q = 0;
    for &away in away {
        while q < step_at(point, TURNING + away) {
            check_stop(tools.stop)?;
            q += 1;
            step(&mut rollout, &waiting, point, q)?;
        }
        let (state, back) = (rollout.save()?, script(away)?);
        for q in q + 1..=step_at(point, 2.0 * TURNING + away + SETTLING) {
            check_stop(tools.stop)?;
            step(&mut rollout, &back, point, q)?;
        }
        let last = picture_of(&mut rollout, world, point)?;
        rollout.restore(&state)?;
        let truth = true_picture(&back, 2.0 * TURNING + away + SETTLING)?;
        scores.push(MemoryScore {
            away,
            psnr: psnr(&truth, &last)?,
            ssim: ssim(&truth, &last)?,
            most: psnr(&truth, &reconstruction)?,
            elsewhere: greatest(others.iter().map(|other| psnr(other, &last)))?,
            is_right: nearness(tools, &truth, &last)?
                > greatest(others.iter().map(|other| nearness(tools, other, &last)))?,
        });
    }
    Ok(scores)
}

/// Larger for a nearer picture.
fn nearness(tools: &Tools<'_>, truth: &Picture, picture: &Picture) -> Result<f64> {
    tools.lpips.map_or_else(|| psnr(truth, picture), |lpips| Ok(-lpips.compare(truth, picture)?))
}

fn greatest(mut values: impl Iterator<Item = Result<f64>>) -> Result<f64> {
    values.try_fold(f64::NEG_INFINITY, |greatest, value| Ok(greatest.max(value?)))
}

/// First true pictures of the level's other held-out walks; none for a place that is no level.
fn other_starts(place: TestWalk, course: &Course, size: (u32, u32)) -> Result<Vec<Picture>> {
    let TestWalk::Level(family, number) = place else { return Ok(Vec::new()) };
    let mut pictures = Vec::new();
    for other in (0..HELD_OUT_WALKS).filter(|other| *other != number) {
        let start = held_out_walk(family, other)?.start;
        // Two walks may start at the origin.
        if start != course.start {
            pictures.push(course.clip_of(&course.script, start, size, 1)?.frame()?.picture);
        }
    }
    Ok(pictures)
}

#[cfg(test)]
mod tests {
    use cairn::world::WorldTime;
    use scenes::Family;

    use super::*;

    #[test]
    fn the_eye_comes_back_to_where_it_was() {
        let script = script(2.0).unwrap();
        let [there, _] = script.span(WorldTime::new(0, 1), WorldTime::new(1, 1)).unwrap().mouse();
        let [stays, _] = script.span(WorldTime::new(1, 1), WorldTime::new(3, 1)).unwrap().mouse();
        let [all, _] = script.span(WorldTime::new(0, 1), WorldTime::new(5, 1)).unwrap().mouse();
        assert!(
            (there * TURN_PER_COUNT).to_degrees() > 119.0 && stays == 0.0 && all.abs() < 0.01,
            "{there} {stays} {all}"
        );
    }

    #[test]
    fn other_places_are_the_other_starts_of_the_level() {
        // Walks 5 and 6 through the snow both start at the origin.
        let starts = |place: TestWalk| other_starts(place, &place.course().unwrap(), (32, 18)).unwrap();
        assert_eq!(starts(TestWalk::Level(Family::Snow, 5)).len(), 6);
        let others = starts(TestWalk::Level(Family::Snow, 0));
        assert!(others.len() == 7 && others[0] != others[1]);
        assert!(starts(TestWalk::Unseen(Family::Snow, 41)).is_empty());
    }
}
