//! The limits that a rollout keeps, and the clocks that they need.

use std::sync::Arc;
use std::time::Instant;

use crate::world::governor::{Governor, GovernorSettings};
use crate::world::latent_budget::LatentBudget;
use crate::world::latent_time::LatentTime;

/// The limits of a rollout; at most one kind at a time.
#[derive(Default)]
pub(super) enum Limits {
    #[default]
    None,
    /// Wall time of each latent.
    Latents(LatentBudget),
    /// Device time of each shown frame, and memory.
    Frames(GovernorSettings),
}

impl Limits {
    pub(super) fn governor(&self) -> Option<&Arc<Governor>> {
        match self {
            Self::Frames(settings) => Some(settings.governor()),
            Self::None | Self::Latents(_) => None,
        }
    }
}

/// The clocks at the start of a latent.
pub(super) struct LatentStart {
    pub(super) wall: Instant,
    /// Device time so far; `None` if the limits do not need it or the device does not measure it.
    pub(super) device: Option<LatentTime>,
}
