//! The walks that are compared: their sample rate, their first turn, and the same walks without the mouse.

use cairn::Result;
use cairn::world::{ControlScript, WorldTime};
use scenes::Family;

/// Samples a second: the rate of the paper's presentation.
pub(crate) const RATE: u32 = 30;
/// Samples between two anchors: the paper compares anchors at 15 Hz.
pub(crate) const STRIDE: u64 = 2;
/// Seconds of a straight walk after the command to turn.
pub(super) const SECONDS_AFTER_TURN: f64 = 2.0;
/// Steps per second of the search through a script.
const GRAIN: u32 = 60;

/// Time of the first turn in the script of a family, in seconds; `None` if it never turns.
///
/// # Errors
/// Only for scripts that do not parse.
pub(super) fn first_turn(family: Family) -> Result<Option<f64>> {
    let script = ControlScript::parse(family.script())?;
    let end = script.duration().whole_steps(GRAIN);
    for step in 0..end {
        let span = script.span(WorldTime::new(step, GRAIN), WorldTime::new(step + 1, GRAIN))?;
        if span.mouse()[0] != 0.0 {
            return Ok(Some(f64::from(step as u32) / f64::from(GRAIN)));
        }
    }
    Ok(None)
}

/// Script of a family without the mouse: the same walk, straight on.
pub(super) fn straight(family: Family) -> String {
    let walks = |line: &&str| line.split_whitespace().nth(1) != Some("mouse");
    family.script().lines().filter(walks).map(|line| format!("{line}\n")).collect()
}

/// Length of the straight walk in decimal seconds; `None` if no turn comes earlier than [`SECONDS_AFTER_TURN`] before the end of `seconds`.
///
/// # Errors
/// `InvalidArgument` if `seconds` is not a time.
pub(super) fn straight_seconds(family: Family, seconds: &str) -> Result<Option<String>> {
    let whole = WorldTime::parse(seconds)?.seconds();
    Ok(first_turn(family)?.map(|at| at + SECONDS_AFTER_TURN).filter(|end| *end <= whole).map(|end| format!("{end:.3}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_turns_early_and_its_straight_walk_never() {
        for (family, seconds) in
            [(Family::Forest, 1.2), (Family::Sword, 1.0), (Family::Desert, 1.5), (Family::Snow, 1.5)]
        {
            let found = first_turn(family).unwrap().unwrap();
            assert!((found - seconds).abs() < 1e-9, "{family}: {found}");
            let walk = ControlScript::parse(&straight(family)).unwrap();
            let all = walk.span(WorldTime::ZERO, walk.duration()).unwrap();
            assert_eq!(all.mouse(), [0.0; 2], "{family}");
            assert_eq!(walk.duration(), ControlScript::parse(family.script()).unwrap().duration());
        }
        assert_eq!(straight_seconds(Family::Forest, "15").unwrap().as_deref(), Some("3.200"));
        assert_eq!(straight_seconds(Family::Forest, "3").unwrap(), None);
    }
}
