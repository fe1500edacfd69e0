//! The four levels that the embedded world knows, and the walks through them that its training never saw.

use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Result};
use scenes::{Cast, Family, Scene, Start};

use crate::manifest::sha256;

/// Scene seed of every level, as in `samples/worlds/miniature/miniature/levels.py`.
pub(crate) const SEED: u64 = 1001;
/// Held-out walks of each level.
pub(crate) const HELD_OUT_WALKS: u32 = 8;
/// Length of a held-out walk in seconds.
pub(crate) const HELD_OUT_SECONDS: u32 = 60;
/// Half the side of the square in which walks start, in metres.
pub(crate) const REACH: f32 = 50.0;

/// The trainer's list of the walks that it refuses: a SHA-256 and a comment in each line.
const LIST: &str = include_str!("../../../samples/worlds/miniature/held-out-walks.txt");
/// Start of the comment that gives a walk's start.
const START: &str = "# start ";

/// The level of a family: nothing moves in it.
pub(crate) fn scene(family: Family) -> Scene {
    Scene::level(family, SEED, Cast::none())
}

/// A held-out walk through a level.
#[derive(Debug)]
pub(crate) struct HeldOutWalk {
    pub(crate) script: ControlScript,
    /// Where it starts; `None` for the path at the origin.
    pub(crate) start: Option<Start>,
}

macro_rules! scripts {
    ($($family:ident $name:literal),*) => {
        [$((Family::$family, scripts!(@numbers $name 0 1 2 3 4 5 6 7))),*]
    };
    (@numbers $name:literal $($number:literal)*) => {
        [$(include_str!(concat!("../../../samples/worlds/miniature/held-out-walks/", $name, "-", $number, ".txt"))),*]
    };
}

/// The scripts of all held-out walks.
const SCRIPTS: [(Family, [&str; HELD_OUT_WALKS as usize]); 4] =
    scripts!(Forest "forest", Sword "sword", Desert "desert", Snow "snow");

/// The script of held-out walk `number`, from 0, of a level.
///
/// # Errors
/// `InvalidArgument` for a family that is no landscape, or a number from [`HELD_OUT_WALKS`] on.
fn script(family: Family, number: u32) -> Result<&'static str> {
    let of_family = SCRIPTS.iter().find(|(of, _)| *of == family);
    of_family.and_then(|(_, scripts)| scripts.get(number as usize)).copied().ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("there is no held-out walk {number} of a level of {family}"))
    })
}

/// Checks a choice of held-out walks: their number in each level, and the seconds of each.
///
/// # Errors
/// `InvalidArgument` for walks that do not exist, of the option that chose them.
pub(crate) fn check_held_out(walks: u32, seconds: u32) -> Result<()> {
    let limits = [("--walks", walks, HELD_OUT_WALKS), ("--seconds", seconds, HELD_OUT_SECONDS)];
    let Some((option, value, most)) = limits.into_iter().find(|(_, value, most)| !(1..=*most).contains(value)) else {
        return Ok(());
    };
    Err(Error::new(ErrorKind::InvalidArgument, format!("{value} is not from 1 to {most}"))
        .field(option)
        .remedy(format!("There are {HELD_OUT_WALKS} held-out walks of {HELD_OUT_SECONDS} s in each level")))
}

/// Held-out walk `number`, from 0, of a level.
///
/// # Errors
/// As [`script`]; `InvalidState` for a walk that the trainer's list does not have: a world may have been trained on it.
pub(crate) fn held_out_walk(family: Family, number: u32) -> Result<HeldOutWalk> {
    let text = script(family, number)?;
    require_held_out(family, text)?;
    let start = text
        .lines()
        .find_map(|line| line.strip_prefix(START))
        .map(|start| start.parse().map_err(|why: String| Error::new(ErrorKind::InvalidState, why)));
    Ok(HeldOutWalk { script: ControlScript::parse(text)?, start: start.transpose()? })
}

/// Fails for a walk through a level that the trainer's list does not have.
fn require_held_out(family: Family, script: &str) -> Result<()> {
    let digest = sha256(format!("{family} {SEED}\n{script}").as_bytes());
    if LIST.lines().any(|line| line.split_whitespace().next() == Some(digest.as_str())) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::InvalidState, format!("a walk through the level of {family} is not held out"))
        .remedy("Write the scripts again: python -m miniature held-out-walks"))
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use scenes::LANDSCAPES;

    use super::*;

    #[test]
    fn every_walk_is_on_the_trainers_list() {
        for family in LANDSCAPES {
            for number in 0..HELD_OUT_WALKS {
                let walk = held_out_walk(family, number).unwrap();
                let start = walk.start.map_or(0.0, |start| start.at.abs().max_element());
                assert!(start <= REACH, "{family} {number} starts {start} m from the origin");
            }
            assert!(held_out_walk(family, HELD_OUT_WALKS).is_err());
        }
        assert!(held_out_walk(Family::Town, 0).is_err());
        assert_eq!(held_out_walk(Family::Snow, 3).unwrap().start.unwrap().at, Vec2::new(25.88, 4.16));
        assert!(held_out_walk(Family::Forest, 0).unwrap().start.is_none());
    }

    #[test]
    fn a_walk_that_differs_is_refused() {
        let text = script(Family::Desert, 2).unwrap();
        require_held_out(Family::Desert, text).unwrap();
        for (family, text) in [(Family::Snow, text.to_owned()), (Family::Desert, text.replace("hold W", "hold S"))] {
            assert!(require_held_out(family, &text).unwrap_err().to_string().contains("not held out"));
        }
    }
}
