//! Operation counts of a bundle's graphs, computed from the graphs themselves.

use super::{Bundle, GraphKind, Precision};
use crate::Result;

/// Cost of one run of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphCost {
    /// Multiply-add operations of `MatMul`, `FusedMatMul`, `MatMulNBits` and `Conv`; each is two floating-point operations. Other operators are not
    /// counted.
    ///
    /// ```text
    /// MatMul [.., m, k] x [.., k, n]             m n k for each pair of matrices, as FusedMatMul and MatMulNBits
    /// Conv   [o, i, kh, kw] -> [b, o, h, w]      b o h w i kh kw
    /// ```
    pub multiply_adds: u64,
    /// Bytes read and written, summed over the nodes; `Reshape` moves none. A runtime that fuses nodes, or finds inputs in caches,
    /// moves fewer.
    pub bytes: u64,
}

/// Cost of a world's graphs at one global window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WorldCost {
    /// One pass of the transformer: a denoise pass or a cache pass, without the conditioning: what depends on the noise level alone
    /// or on the controls alone.
    pub pass: GraphCost,
    /// Embedding the controls of a latent, once for all of its passes.
    pub controls: GraphCost,
    /// Encoding pictures into a latent.
    pub encode: GraphCost,
    /// Decoding a latent into pictures.
    pub decode: GraphCost,
}

impl Bundle {
    /// Costs of the graphs at a global window of `g` latents, counted from the graphs; nothing runs.
    ///
    /// # Errors
    /// As [`memory_need`](Self::memory_need).
    pub fn cost(&self, precision: Precision, g: u32) -> Result<WorldCost> {
        self.geometry().check_window(g)?;
        let [encode, decode] = [GraphKind::Encoder, GraphKind::Decoder]
            .map(|kind| self.footprint(kind, precision, g).map(|footprint| footprint.cost));
        let splitting = self.splitting(GraphKind::Transformer, precision, g)?;
        let pass = splitting.split(1)?.models.first().map(|model| model.footprint.cost).unwrap_or_default();
        let controls = splitting.conditioning()?.of_controls.map(|model| model.footprint.cost).unwrap_or_default();
        Ok(WorldCost { pass, controls, encode: encode?, decode: decode? })
    }
}
