//! Walks that a world is judged on: held-out walks through the levels that it knows, and walks through places outside them.

use std::fmt;

use cairn::Result;
use cairn::world::ControlScript;
use scenes::{Clip, ClipOptions, Family, LANDSCAPES, Scene, Start};
use serde::{Deserialize, Serialize};

use crate::level;

/// A row of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Group {
    /// A level that the world was trained in.
    Level(Family),
    /// Scenes that it was not trained in.
    Unseen,
}

impl Group {
    /// All rows, in their order.
    pub(super) fn all() -> impl Iterator<Item = Self> + Clone {
        LANDSCAPES.into_iter().map(Self::Level).chain([Self::Unseen])
    }

    /// Its name in tables.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Level(family) => family.name(),
            Self::Unseen => "unseen",
        }
    }
}

/// One walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TestWalk {
    /// A held-out walk through a level, by its number.
    Level(Family, u32),
    /// A scene that no world was trained on, by its seed, with the script that was written for its family.
    Unseen(Family, u64),
}

/// A number of a family in [`LANDSCAPES`], as records and classifiers have it.
pub(super) fn kind(family: Family) -> usize {
    LANDSCAPES.iter().position(|other| *other == family).unwrap_or(LANDSCAPES.len())
}

impl TestWalk {
    /// `walks` held-out walks of each level and as many scenes that were never seen, one of each family for each seed in turn. The first walks of
    /// all come first, so that those that were made can be shown at any time.
    pub(super) fn all(walks: u32, seeds: &[u64]) -> Vec<Self> {
        let mut unseen = seeds.iter().flat_map(|seed| LANDSCAPES.map(|family| Self::Unseen(family, *seed)));
        let round = |number| LANDSCAPES.map(|family| Self::Level(family, number)).into_iter().chain(unseen.next());
        (0..walks).flat_map(round).collect()
    }

    pub(super) fn group(self) -> Group {
        match self {
            Self::Level(family, _) => Group::Level(family),
            Self::Unseen(..) => Group::Unseen,
        }
    }

    pub(super) fn family(self) -> Family {
        match self {
            Self::Level(family, _) | Self::Unseen(family, _) => family,
        }
    }

    /// Seed of the rollout's noise.
    pub(super) fn noise(self) -> u64 {
        match self {
            Self::Level(_, number) => 1 + u64::from(number),
            Self::Unseen(_, seed) => seed,
        }
    }

    /// Name without spaces, for files and CSV.
    pub(super) fn key(self) -> String {
        self.to_string().replace(' ', "-")
    }

    /// The scene, the controls and the start of the walk.
    ///
    /// # Errors
    /// As [`level::held_out_walk`].
    pub(super) fn course(self) -> Result<Course> {
        match self {
            Self::Level(family, number) => {
                let walk = level::held_out_walk(family, number)?;
                Ok(Course { scene: level::scene(family), script: walk.script, start: walk.start })
            }
            Self::Unseen(family, seed) => {
                let script = ControlScript::parse(family.script())?;
                Ok(Course { scene: Scene::new(family, seed), script, start: None })
            }
        }
    }
}

impl fmt::Display for TestWalk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Level(family, number) => write!(f, "{family} {number}"),
            Self::Unseen(family, seed) => write!(f, "unseen {family} {seed}"),
        }
    }
}

/// Scene, controls and start of a walk.
pub(super) struct Course {
    pub(super) scene: Scene,
    pub(super) script: ControlScript,
    pub(super) start: Option<Start>,
}

impl Course {
    /// The true walk with `rate` frames a second.
    ///
    /// # Errors
    /// `InvalidArgument` for a rate out of range.
    pub(super) fn clip(&self, size: (u32, u32), rate: u32) -> Result<Clip<'_>> {
        self.clip_of(&self.script, self.start, size, rate)
    }

    /// The true walk with other controls from another start.
    ///
    /// # Errors
    /// As [`clip`](Self::clip).
    pub(super) fn clip_of<'a>(
        &'a self,
        script: &'a ControlScript,
        start: Option<Start>,
        (width, height): (u32, u32),
        rate: u32,
    ) -> Result<Clip<'a>> {
        let options = ClipOptions { width, height, rate, start, ..ClipOptions::default() };
        Clip::new(&self.scene, script, options)
    }
}

/// Result of the classifiers for a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Recognised {
    /// Number of a family in [`LANDSCAPES`].
    pub(super) kind: usize,
    /// Patch of the level; 0 where the place is none.
    pub(super) patch: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_walk_of_every_row_comes_before_the_second() {
        let all = TestWalk::all(2, &[41, 42]);
        let names: Vec<String> = all.iter().map(|place| place.key()).collect();
        assert_eq!(
            names,
            [
                "forest-0",
                "sword-0",
                "desert-0",
                "snow-0",
                "unseen-forest-41",
                "forest-1",
                "sword-1",
                "desert-1",
                "snow-1",
                "unseen-sword-41"
            ]
        );
        assert_eq!(all[..5], TestWalk::all(1, &[41]));
        assert_eq!(TestWalk::all(8, &[41, 42]).last(), Some(&TestWalk::Unseen(Family::Snow, 42)));
        assert_eq!(Group::all().map(Group::name).collect::<Vec<_>>(), ["forest", "sword", "desert", "snow", "unseen"]);
    }
}
