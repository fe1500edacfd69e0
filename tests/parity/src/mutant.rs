//! Faults of a wrong library, made by altering plans: the rollout executes any plan exactly, so the library needs no hooks for them.

use cairn::world::{CachePass, Planner, Ring, RingPlan, StepPlan};
use clap::ValueEnum;

/// One fault. It alters the plan of a latent and nothing else.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Mutant {
    /// Every commit goes to the slot after the right one.
    SlotOffByOne,
    /// The slot that will be overwritten is still visible.
    EvictedSlotVisible,
    /// A latent between two buckets belongs to bucket floor(t / d) instead of ceil(t / d), so that the newest bucket is hidden as if it were
    /// its own.
    BucketFloorForCeil,
    /// Generated latents rotate by the next latent's time.
    RopeTimeOffByOne,
    /// Every latent is given the controls of the one before.
    ControlOfNeighbourStep,
    /// Every denoise pass gets the noise level of the next pass.
    SigmaOfNeighbourStep,
    /// Denoise passes without a commit, which must not change the ring, commit the keys and values of the last pass.
    SlotWrittenOnFrozenPass,
    /// The decoder starts without priming: it does not get the first latent three times.
    UnprimedDecoder,
}

impl Mutant {
    /// Puts the fault into the plan of a latent; `previous` are the controls of the latent before it.
    pub(crate) fn apply(self, planner: &Planner, previous: &[f32], plan: &mut StepPlan) {
        let clock = plan.ring_clock;
        match self {
            Self::SlotOffByOne => {
                for (ring, slots) in rings(planner, plan) {
                    slots.slot = slots.slot.map(|slot| (slot + 1) % ring.slot_count());
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
                    slots.visible[(bucket % ring.slot_count() as u64) as usize] = false;
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

    /// Puts the fault into `frozen`, a plan of denoise passes that must not commit; `plan` is the step's complete plan.
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
