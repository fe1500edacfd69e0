//! Faults that a wrong library could have, put into plans from outside: the rollout executes any plan to the letter, so
//! the library needs no hook for them.

use cairn::world::{CachePass, Planner, Ring, RingPlan, StepPlan};
use clap::ValueEnum;

/// One fault. What it does to the plan of a latent is the whole fault; all else runs as always.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Mutant {
    /// Every commit goes to the slot after the right one.
    SlotOffByOne,
    /// The slot about to be overwritten is still seen.
    EvictedSlotVisible,
    /// A latent between two buckets is counted to the one before, floor(t / d), instead of the one it waits for,
    /// ceil(t / d): the newest bucket passes for its own and is hidden.
    BucketFloorForCeil,
    /// Generated latents rotate by the next latent's time.
    RopeTimeOffByOne,
    /// Every latent is given the controls of the one before.
    ControlOfNeighbourStep,
    /// Every denoise pass is told the noise level of the one after.
    SigmaOfNeighbourStep,
    /// Denoising alone, which must leave the ring as it is, commits what its last pass made.
    SlotWrittenOnFrozenPass,
    /// The decoder starts without being fed the first latent three times.
    UnprimedDecoder,
}

impl Mutant {
    /// Puts the fault into the plan of a latent; `previous` are the controls of the latent before it.
    pub(crate) fn apply(self, planner: &Planner, previous: &[f32], plan: &mut StepPlan) {
        let clock = plan.ring_clock;
        match self {
            Self::SlotOffByOne => {
                for (ring, slots) in rings(planner, plan) {
                    slots.slot = slots.slot.map(|slot| (slot + 1) % ring.buckets());
                }
            }
            Self::EvictedSlotVisible => {
                for (ring, slots) in rings(planner, plan) {
                    slots.visible.copy_from_slice(ring.written());
                }
            }
            Self::BucketFloorForCeil => {
                for (ring, slots) in rings(planner, plan) {
                    let bucket = clock / u64::from(ring.dilation());
                    slots.visible[(bucket % ring.buckets() as u64) as usize] = false;
                }
            }
            Self::RopeTimeOffByOne if plan.noise.is_some() => plan.rope_time += 1,
            Self::ControlOfNeighbourStep if plan.noise.is_some() => plan.controls.copy_from_slice(previous),
            Self::SigmaOfNeighbourStep if plan.noise.is_some() => {
                plan.sigmas.rotate_left(1);
                plan.sigmas[plan.dsigmas.len() - 1] = 0.0;
            }
            Self::UnprimedDecoder => plan.prime = 0,
            Self::RopeTimeOffByOne
            | Self::ControlOfNeighbourStep
            | Self::SigmaOfNeighbourStep
            | Self::SlotWrittenOnFrozenPass => {}
        }
    }

    /// Puts the fault into a plan of denoise passes that must not commit; `plan` is the step's whole plan.
    pub(crate) fn apply_frozen(self, plan: &StepPlan, frozen: &mut StepPlan) {
        if self == Self::SlotWrittenOnFrozenPass {
            frozen.cache = CachePass::Fused;
            frozen.local.slot = plan.local.slot;
            frozen.global.slot = plan.global.slot;
        }
    }
}

/// Both rings with their part of the plan.
fn rings<'a>(planner: &'a Planner, plan: &'a mut StepPlan) -> [(&'a Ring, &'a mut RingPlan); 2] {
    [(planner.local(), &mut plan.local), (planner.global(), &mut plan.global)]
}
