//! The transformer of one rollout: its input buffers and the passes that read them.

use super::bound_transformer::{BoundTransformer, PassInputs};
use super::convert::{self, Uploader};
use super::graph_spec::Shapes;
use super::joined_pass::JoinedPass;
use super::kv_cache::KvCache;
use super::plan::{PendingPlan, RingPlan, StepPlan};
use super::rope::RopeTable;
use super::schedule::{MAX_POINTS, SigmaTable};
use super::world::World;
use crate::Result;
use crate::allocate;
use crate::bundle::{LayerKind, Precision};
use crate::runtime::{BufferId, ExecutionContext, Region, element_size};

/// The mask value of a hidden key: representable in f16, and far below any attention score.
pub(super) const HIDDEN: f32 = -10_000.0;

/// Bytes of a row of the sigma table: sigma and dsigma, both f32.
const ROW: usize = 8;

/// Inputs, outputs and bindings of the transformer.
///
/// Two latent buffers alternate: a pass reads one and writes the other, so passes follow each other on the device without a copy.
/// The finished latent is always in the first, [`latent`](Self::latent).
pub(super) struct Passes {
    shapes: Shapes,
    precision: Precision,
    rope: RopeTable,
    x: [BufferId; 2],
    transformer: BoundTransformer,
    /// All sigmas of a latent step, a [`ROW`] for each pass; each pass copies its row on the device.
    table: BufferId,
    joined: Option<JoinedPass>,
    uploader: Uploader,
    staging: Staging,
}

/// Host memory for uploads, reused so that a step allocates nothing.
struct Staging {
    x: Vec<f32>,
    rope_cos: Vec<f32>,
    rope_sin: Vec<f32>,
    local_mask: Vec<f32>,
    global_mask: Vec<f32>,
    table: Vec<[f32; 2]>,
}

impl Passes {
    /// `finished` has the last latent from the end of its step on.
    pub(super) fn new(
        context: &mut dyn ExecutionContext,
        world: &World,
        kv: &KvCache,
        finished: BufferId,
    ) -> Result<Self> {
        let (shapes, precision) = (world.shapes, world.precision());
        let element = element_size(precision);
        let rope = RopeTable::new(&world.manifest().geometry)?;
        assert_eq!(rope.len(), shapes.rope_len(), "rope angles are [T, head_width / 2]");
        let x = [context.buffer(shapes.latent_len() * element)?, context.buffer(shapes.latent_len() * element)?];
        let table = context.buffer(MAX_POINTS * ROW)?;
        let tensors = |inputs: &PassInputs, x: BufferId, x_next: BufferId| -> Vec<BufferId> {
            let inputs = [x].into_iter().chain(inputs.in_order());
            inputs.chain(kv.rings()).chain([x_next]).chain(kv.slabs()).collect()
        };
        let levels = world.kept_levels();
        let transformer =
            BoundTransformer::new(context, &world.transformer, (&shapes, precision), (1, levels), x, tensors)?;
        let joined = world
            .joined
            .as_ref()
            .map(|joined| JoinedPass::new(context, joined, (shapes, precision), kv, x, finished))
            .transpose()?;
        let staging = Staging {
            x: allocate::zeroed(shapes.latent_len())?,
            rope_cos: allocate::zeroed(rope.len())?,
            rope_sin: allocate::zeroed(rope.len())?,
            local_mask: allocate::zeroed(shapes.attended_keys(LayerKind::Local))?,
            global_mask: allocate::zeroed(shapes.attended_keys(LayerKind::Global))?,
            table: Vec::with_capacity(MAX_POINTS),
        };
        let largest = shapes
            .latent_len()
            .max(shapes.attended_keys(LayerKind::Global))
            .max(shapes.attended_keys(LayerKind::Local));
        Ok(Self {
            shapes,
            precision,
            rope,
            x,
            transformer,
            table,
            joined,
            uploader: Uploader::new(precision, largest)?,
            staging,
        })
    }

    /// The buffer of the finished latent. An appended latent is written to it.
    pub(super) fn latent(&self) -> BufferId {
        self.x[0]
    }

    /// Maximum number of denoise passes; the extra pass after them is not counted.
    pub(super) fn max_passes(&self) -> usize {
        MAX_POINTS - 1
    }

    /// Uploads the inputs that all passes of `plan` share, and its sigma table. `extra_row` is sigma and dsigma of the extra pass.
    pub(super) fn prepare(
        &mut self,
        context: &mut dyn ExecutionContext,
        plan: &StepPlan,
        extra_row: [f32; 2],
    ) -> Result<()> {
        let s = &mut self.staging;
        self.rope.fill(plan.rope_time, &mut s.rope_cos, &mut s.rope_sin)?;
        context.upload(self.transformer.inputs.rope_cos, 0, bytemuck::cast_slice(&s.rope_cos))?;
        context.upload(self.transformer.inputs.rope_sin, 0, bytemuck::cast_slice(&s.rope_sin))?;
        assert_eq!(plan.controls.len(), self.shapes.controls, "controls are [mouse + buttons + scroll]");
        context.upload(self.transformer.inputs.controls, 0, bytemuck::cast_slice(&plan.controls))?;
        for (mask, buffer, ring) in [
            (&mut s.local_mask, self.transformer.inputs.local_mask, &plan.local),
            (&mut s.global_mask, self.transformer.inputs.global_mask, &plan.global),
        ] {
            fill_mask(mask, ring, self.shapes.tokens);
            self.uploader.upload(context, buffer, mask)?;
        }
        s.table.clear();
        s.table.extend(plan.sigmas.iter().zip(&plan.dsigmas).map(|(&sigma, &dsigma)| [sigma, dsigma]));
        s.table.push(extra_row);
        if let Some(conditioning) = &mut self.transformer.conditioning {
            conditioning.prepare(context, s.table.iter().map(|row| &row[..1]))?;
        }
        context.upload(self.table, 0, bytemuck::cast_slice(&s.table))
    }

    /// Uploads what passes need of the noise levels of a schedule, so that no step allocates memory for it.
    pub(super) fn prepare_levels(&mut self, context: &mut dyn ExecutionContext, table: &SigmaTable) -> Result<()> {
        let conditioning = self.transformer.conditioning.as_mut();
        conditioning.map_or(Ok(()), |conditioning| conditioning.prepare(context, table.sigmas.chunks(1)))
    }

    /// Embeds the controls of the prepared plan, which its passes need.
    pub(super) fn embed_controls(&self, context: &mut dyn ExecutionContext) -> Result<()> {
        self.transformer.embed_controls(context)
    }

    /// Uploads the noise that the prepared plan starts from, if any.
    pub(super) fn start(&mut self, context: &mut dyn ExecutionContext, plan: &StepPlan) -> Result<()> {
        let Some(key) = plan.noise else { return Ok(()) };
        key.fill(&mut self.staging.x);
        // Starts in the buffer from which n passes end in the first one.
        self.uploader.upload(context, self.x[plan.sigmas.len() % 2], &self.staging.x)
    }

    /// Runs the first denoise pass of the prepared plan together with the cache pass of the finished latent, whose K and V are in the finished
    /// slabs then. For an append, which has no denoise pass, it only makes these.
    pub(super) fn joined_pass(
        &mut self,
        context: &mut dyn ExecutionContext,
        plan: &StepPlan,
        pending: &PendingPlan,
    ) -> Result<()> {
        let joined = self.joined.as_mut().expect("a rollout with deferred commits is of a world with the joined graph");
        joined.prepare(context, &self.rope, plan, pending)?;
        joined.run(context, plan.sigmas.len() % 2)
    }

    /// Runs the denoise passes of the prepared plan from pass `first` on.
    pub(super) fn denoise(&self, context: &mut dyn ExecutionContext, plan: &StepPlan, first: usize) -> Result<()> {
        let n = plan.sigmas.len();
        (first..n).try_for_each(|pass| self.run(context, pass, (n - pass) % 2))
    }

    /// Runs the extra pass on the finished latent, at the noise level of `prepare`'s `extra_row`. A cache pass uses its slabs and
    /// ignores its `x_next`.
    pub(super) fn extra_pass(&self, context: &mut dyn ExecutionContext, plan: &StepPlan) -> Result<()> {
        self.run(context, plan.sigmas.len(), 0)
    }

    fn run(&self, context: &mut dyn ExecutionContext, row: usize, from: usize) -> Result<()> {
        let mut copy = |buffer, offset| {
            context.copy(buffer, self.table, &[Region { to: 0, from: row * ROW + offset, len: ROW / 2 }])
        };
        if self.transformer.reads_levels {
            copy(self.transformer.inputs.sigma, 0)?;
        }
        copy(self.transformer.inputs.dsigma, ROW / 2)?;
        if let Some(conditioning) = &self.transformer.conditioning {
            conditioning.select(context, &self.staging.table[row][..1])?;
        }
        self.transformer.run(context, from)
    }

    /// Uploads a latent from the caller.
    pub(super) fn set_latent(&mut self, context: &mut dyn ExecutionContext, latent: &[f32]) -> Result<()> {
        assert_eq!(latent.len(), self.shapes.latent_len(), "a latent is [C, h, w]");
        self.uploader.upload(context, self.x[0], latent)
    }

    /// Reads `x_next` of the extra pass.
    pub(super) fn read_next(&self, context: &dyn ExecutionContext, x_next: &mut [f32]) -> Result<()> {
        convert::read(context, self.precision, self.x[1], 0, x_next)
    }
}

/// Fills one value for each key, slot by slot, then the keys of the current latent, which is always visible.
fn fill_mask(mask: &mut [f32], ring: &RingPlan, tokens: usize) {
    assert_eq!(mask.len(), (ring.visible.len() + 1) * tokens, "a mask is [keys]");
    let current = std::iter::once(&true);
    for (keys, &visible) in mask.chunks_exact_mut(tokens).zip(ring.visible.iter().chain(current)) {
        keys.fill(if visible { 0.0 } else { HIDDEN });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_hides_whole_latents_and_never_the_current_one() {
        let mut mask = vec![1.0; 6];
        fill_mask(&mut mask, &RingPlan { visible: vec![false, true], slot: None }, 2);
        assert_eq!(mask, [HIDDEN, HIDDEN, 0.0, 0.0, 0.0, 0.0]);
    }
}
