//! Identity of a generated scene: its family and its seed. Reports call a scene a place.

use std::fmt;

use scenes::{Family, LANDSCAPES};

/// One generated scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SceneId {
    pub(crate) family: Family,
    /// Seed of the scene, and of a rollout's noise in it.
    pub(crate) seed: u64,
}

impl SceneId {
    /// Every family with every seed, family by family.
    pub(crate) fn all(seeds: &[u64]) -> Vec<Self> {
        LANDSCAPES.into_iter().flat_map(|family| seeds.iter().map(move |&seed| Self { family, seed })).collect()
    }
}

impl fmt::Display for SceneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.family, self.seed)
    }
}
