//! The joined pass of a rollout: the cache pass of the finished latent and the first denoise pass of the next, in one run.

use super::bound_transformer::{BoundTransformer, PassInputs};
use super::convert::Uploader;
use super::graph_spec::{JOINED_LATENTS, Shapes};
use super::kv_cache::KvCache;
use super::passes::HIDDEN;
use super::plan::{PendingPlan, RingPlan, StepPlan};
use super::rope::RopeTable;
use super::transformer::Transformer;
use crate::Result;
use crate::allocate;
use crate::bundle::{LayerKind, Precision};
use crate::runtime::{BufferId, ExecutionContext};

/// Inputs of the joined graph, and its bindings. In each input the finished latent comes first.
pub(super) struct JoinedPass {
    shapes: Shapes,
    joined: BoundTransformer,
    uploader: Uploader,
    // Host memory for uploads, reused so that a step allocates nothing.
    rope: [Vec<f32>; 2],
    controls_of_both: Vec<f32>,
    masks: [Vec<f32>; 2],
}

impl JoinedPass {
    /// `x` are the two buffers of the latent that is made, `finished` has the finished one.
    pub(super) fn new(
        context: &mut dyn ExecutionContext,
        joined: &Transformer,
        (shapes, precision): (Shapes, Precision),
        kv: &KvCache,
        x: [BufferId; 2],
        finished: BufferId,
    ) -> Result<Self> {
        let mask_len = |kind| JOINED_LATENTS * shapes.keys_with(kind, JOINED_LATENTS);
        let (angles, control_len) = (JOINED_LATENTS * shapes.rope_len(), JOINED_LATENTS * shapes.controls);
        let tensors = |inputs: &PassInputs, x: BufferId, x_next: BufferId| -> Vec<BufferId> {
            let inputs = [x, finished].into_iter().chain(inputs.in_order());
            inputs.chain(kv.rings()).chain([x_next]).chain(kv.finished_slabs()).collect()
        };
        Ok(Self {
            shapes,
            joined: BoundTransformer::new(context, joined, (&shapes, precision), (JOINED_LATENTS, 1), x, tensors)?,
            uploader: Uploader::new(precision, mask_len(LayerKind::Local).max(mask_len(LayerKind::Global)))?,
            rope: [allocate::zeroed(angles)?, allocate::zeroed(angles)?],
            controls_of_both: allocate::zeroed(control_len)?,
            masks: [allocate::zeroed(mask_len(LayerKind::Local))?, allocate::zeroed(mask_len(LayerKind::Global))?],
        })
    }

    /// Uploads the inputs for the first pass of `plan`, and for the finished latent, whose noise level is 0.
    pub(super) fn prepare(
        &mut self,
        context: &mut dyn ExecutionContext,
        rope: &RopeTable,
        plan: &StepPlan,
        pending: &PendingPlan,
    ) -> Result<()> {
        // An append has no noise level; the pass's result for its latent is ignored.
        let first = |levels: &[f32]| levels.first().copied().unwrap_or(0.0);
        let levels = [0.0, first(&plan.sigmas)];
        if self.joined.reads_levels {
            context.upload(self.joined.inputs.sigma, 0, bytemuck::cast_slice(&levels))?;
        }
        if let Some(conditioning) = &mut self.joined.conditioning {
            conditioning.prepare(context, std::iter::once(&levels[..]))?;
            conditioning.select(context, &levels)?;
        }
        context.upload(self.joined.inputs.dsigma, 0, bytemuck::cast_slice(&[first(&plan.dsigmas)]))?;
        let [cosines, sines] = &mut self.rope;
        let half = self.shapes.rope_len();
        for (time, at) in [(pending.rope_time, 0), (plan.rope_time, half)] {
            rope.fill(time, &mut cosines[at..][..half], &mut sines[at..][..half])?;
        }
        context.upload(self.joined.inputs.rope_cos, 0, bytemuck::cast_slice(cosines))?;
        context.upload(self.joined.inputs.rope_sin, 0, bytemuck::cast_slice(sines))?;
        let (finished, next) = self.controls_of_both.split_at_mut(self.shapes.controls);
        finished.copy_from_slice(&pending.controls);
        next.copy_from_slice(&plan.controls);
        context.upload(self.joined.inputs.controls, 0, bytemuck::cast_slice(&self.controls_of_both))?;
        let [local, global] = &mut self.masks;
        for (mask, buffer, pending, ring) in [
            (local, self.joined.inputs.local_mask, &pending.local, &plan.local),
            (global, self.joined.inputs.global_mask, &pending.global, &plan.global),
        ] {
            fill_masks(mask, pending, ring, self.shapes.tokens);
            self.uploader.upload(context, buffer, mask)?;
        }
        Ok(())
    }

    /// Runs the pass from latent buffer `from`.
    pub(super) fn run(&self, context: &mut dyn ExecutionContext, from: usize) -> Result<()> {
        self.joined.embed_controls(context)?;
        self.joined.run(context, from)
    }
}

/// Fills the masks of both latents: one value for each key of the ring, slot by slot, then the finished latent's keys, then those of the next.
///
/// The finished latent sees what its plan says, and itself. The next one sees what its own plan says, but for the slot that the finished latent will be
/// committed to, which still has an older one: it sees the finished latent's new keys instead, if that is committed to this kind of layer at all.
fn fill_masks(masks: &mut [f32], pending: &RingPlan, next: &RingPlan, tokens: usize) {
    let slots = next.visible.len();
    assert_eq!(masks.len(), JOINED_LATENTS * (slots + JOINED_LATENTS) * tokens, "masks are [2, keys]");
    let (finished_mask, next_mask) = masks.split_at_mut(masks.len() / JOINED_LATENTS);
    let fill = |mask: &mut [f32], key: usize, visible: bool| {
        mask[key * tokens..][..tokens].fill(if visible { 0.0 } else { HIDDEN });
    };
    for slot in 0..slots {
        fill(finished_mask, slot, pending.visible[slot]);
        fill(next_mask, slot, next.visible[slot] && pending.slot != Some(slot));
    }
    let is_seen = pending.slot.is_some_and(|slot| next.visible[slot]);
    for (mask, sees) in [(finished_mask, [true, false]), (next_mask, [is_seen, true])] {
        sees.into_iter().enumerate().for_each(|(latent, visible)| fill(mask, slots + latent, visible));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_latent_sees_the_finished_one_in_place_of_the_slot_it_is_committed_to() {
        let ring = |visible: [bool; 3], slot| RingPlan { visible: visible.to_vec(), slot };
        let masks = |pending: &RingPlan, next: &RingPlan| {
            let mut masks = vec![1.0; 2 * (3 + 2) * 2];
            fill_masks(&mut masks, pending, next, 2);
            let seen: Vec<bool> = masks.chunks(2).map(|key| key == [0.0, 0.0]).collect();
            assert!(masks.iter().all(|&value| value == 0.0 || value == HIDDEN));
            seen
        };
        let committed = masks(&ring([true, false, true], Some(1)), &ring([true, true, false], None));
        assert_eq!(committed[..5], [true, false, true, true, false]);
        assert_eq!(committed[5..], [true, false, false, true, true]);
        let kept_out = masks(&ring([true, true, false], None), &ring([true, true, false], None));
        assert_eq!(kept_out[..5], [true, true, false, true, false]);
        assert_eq!(kept_out[5..], [true, true, false, false, true]);
        // A ring of one slot, which the next latent will overwrite.
        let overwritten = masks(&ring([false, false, false], Some(0)), &ring([false, false, false], Some(0)));
        assert_eq!(overwritten[5..], [false, false, false, false, true]);
    }
}
