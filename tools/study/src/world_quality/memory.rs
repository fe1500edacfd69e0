//! Memory test: turn away, wait, turn back, and compare with the original view.

use std::sync::Arc;

use cairn::Result;
use cairn::world::{ControlScript, OperatingPoint, World};
use scenes::TURN_PER_COUNT;

use super::walk::{Tools, Walk, step_at};
use crate::metrics::{psnr, ssim};
use crate::scene_id::SceneId;

/// Angle of the turn in degrees; the field of view is 94 wide.
const TURN: f32 = 120.0;
/// Duration of a turn in seconds.
const TURNING: f64 = 1.0;
/// Delay in seconds between the end of the turn back and the comparison.
const SETTLING: f64 = 0.2;

/// Result of the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MemoryScore {
    /// Seconds spent turned away.
    pub(super) away: f64,
    /// Context window in latents.
    pub(super) window: u32,
    /// PSNR of the picture after the turn back against the truth, in dB.
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    /// PSNR of the autoencoder's reconstruction of the first picture against the truth, in dB: an upper bound.
    pub(super) most: f64,
    /// PSNR in dB of the true picture seen while turned away against the true one after the turn back: the score of another view.
    pub(super) elsewhere: f64,
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

/// Turns away for `away` seconds and back. The context window is the world's.
///
/// # Errors
/// As [`Walk::score`].
pub(super) fn turn_away_and_back(
    scene: SceneId,
    away: f64,
    world: &Arc<World>,
    tools: &Tools<'_>,
) -> Result<MemoryScore> {
    let script = script(away)?;
    let seconds = 2.0 * TURNING + away + SETTLING;
    let walk = Walk { scene, script: &script, seconds };
    let point: &OperatingPoint = tools.point;
    let at = [0, step_at(point, TURNING), step_at(point, seconds)];
    let pictures = walk.pictures(world, tools, &at)?;
    let ([first, _], [_, other], [last, truth]) = (&pictures[0], &pictures[1], &pictures[2]);
    Ok(MemoryScore {
        away,
        window: world.global_window(),
        psnr: psnr(truth, last)?,
        ssim: ssim(truth, last)?,
        most: psnr(truth, first)?,
        elsewhere: psnr(truth, other)?,
    })
}

#[cfg(test)]
mod tests {
    use cairn::world::WorldTime;

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
}
