//! Buffers of the transformer's inputs beside latents and rings.

use super::graph_spec::Shapes;
use crate::Result;
use crate::bundle::{LayerKind, Precision};
use crate::runtime::{BufferId, ExecutionContext, element_size};

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
    pub(super) fn new(
        context: &mut dyn ExecutionContext,
        shapes: &Shapes,
        precision: Precision,
        latents: usize,
    ) -> Result<Self> {
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
