//! A transformer in a rollout's context: the buffers of its inputs beside latents and rings, and its bindings.

use super::conditioning::LevelInputs;
use super::graph_spec::Shapes;
use super::transformer::{PassBinding, Transformer};
use crate::Result;
use crate::bundle::{LayerKind, Precision};
use crate::runtime::{BindingId, BufferId, ExecutionContext, element_size};

/// A transformer bound to buffers of a context, with its conditioning.
pub(super) struct BoundTransformer {
    pub(super) inputs: PassInputs,
    /// `bindings[i]` reads latent buffer `i` and writes the other.
    bindings: [PassBinding; 2],
    /// Embeds the controls of a step.
    controls: Option<BindingId>,
    pub(super) conditioning: Option<LevelInputs>,
    /// Whether passes read noise levels, beside the conditioning.
    pub(super) reads_levels: bool,
}

impl BoundTransformer {
    /// Binds `transformer`, whose runs are of `latents` latents, with memory for the conditioning at `kept_levels` levels. `tensors` are its
    /// inputs and outputs in order, for its own inputs and a latent buffer that is read and one that is written; `x` are those two.
    pub(super) fn new(
        context: &mut dyn ExecutionContext,
        transformer: &Transformer,
        (shapes, precision): (&Shapes, Precision),
        (latents, kept_levels): (usize, usize),
        x: [BufferId; 2],
        tensors: impl Fn(&PassInputs, BufferId, BufferId) -> Vec<BufferId>,
    ) -> Result<Self> {
        let inputs = PassInputs::new(context, shapes, precision, latents)?;
        let shared = transformer.shared_buffers(context)?;
        let conditioning = LevelInputs::of(context, transformer, &shared, kept_levels)?;
        let [first, second] = [tensors(&inputs, x[0], x[1]), tensors(&inputs, x[1], x[0])];
        let controls = transformer.bind_controls(context, &first, &shared)?;
        let mut bind = |tensors: &[BufferId]| transformer.bind(context, tensors, &shared);
        let bindings = [bind(&first)?, bind(&second)?];
        Ok(Self { inputs, bindings, controls, conditioning, reads_levels: transformer.reads_levels() })
    }

    /// Embeds the controls of the prepared step, which its passes need.
    pub(super) fn embed_controls(&self, context: &mut dyn ExecutionContext) -> Result<()> {
        self.controls.map_or(Ok(()), |controls| context.run(controls))
    }

    /// Runs the pass from latent buffer `from`.
    pub(super) fn run(&self, context: &mut dyn ExecutionContext, from: usize) -> Result<()> {
        self.bindings[from].run(context)
    }
}

/// Inputs of a graph that runs `latents` latents at once.
#[derive(Clone, Copy)]
pub(super) struct PassInputs {
    pub(super) sigma: BufferId,
    pub(super) dsigma: BufferId,
    pub(super) rope_cos: BufferId,
    pub(super) rope_sin: BufferId,
    pub(super) controls: BufferId,
    pub(super) local_mask: BufferId,
    pub(super) global_mask: BufferId,
}

impl PassInputs {
    fn new(context: &mut dyn ExecutionContext, shapes: &Shapes, precision: Precision, latents: usize) -> Result<Self> {
        let (element, f32_size) = (element_size(precision), element_size(Precision::F32));
        let mut buffer = |len: usize, size| context.buffer(len * size);
        Ok(Self {
            sigma: buffer(latents, f32_size)?,
            dsigma: buffer(1, f32_size)?,
            rope_cos: buffer(latents * shapes.rope_len(), f32_size)?,
            rope_sin: buffer(latents * shapes.rope_len(), f32_size)?,
            controls: buffer(latents * shapes.controls, f32_size)?,
            local_mask: buffer(latents * shapes.keys_with(LayerKind::Local, latents), element)?,
            global_mask: buffer(latents * shapes.keys_with(LayerKind::Global, latents), element)?,
        })
    }

    /// In the order of the graph's inputs.
    pub(super) fn in_order(&self) -> [BufferId; 7] {
        [self.sigma, self.dsigma, self.rope_cos, self.rope_sin, self.controls, self.local_mask, self.global_mask]
    }
}
