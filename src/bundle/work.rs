//! What the graphs of a bundle do in one run, counted from the graphs themselves.

use super::{Bundle, GraphKind, Precision};
use crate::Result;

/// What one run of a graph does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphWork {
    /// Multiplications of `MatMul` and `Conv`, each with the addition that follows it; twice as many floating-point
    /// operations. What other operators do is left out.
    ///
    /// ```text
    /// MatMul [.., m, k] x [.., k, n]             m n k for each pair of matrices
    /// Conv   [o, i, kh, kw] -> [b, o, h, w]      b o h w i kh kw
    /// ```
    pub multiply_adds: u64,
    /// Bytes that its nodes read and write, each node on its own; `Reshape` moves none. A runtime that fuses nodes, or whose
    /// caches hold what comes next, moves fewer.
    pub bytes: u64,
}

/// What a world does at one global window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// One pass of the transformer: a denoise pass or a cache pass.
    pub pass: GraphWork,
    /// A picture made a latent.
    pub encode: GraphWork,
    /// A latent made pictures.
    pub decode: GraphWork,
}

impl Bundle {
    /// What its graphs do at the global window `g`, exactly as they are written down; nothing runs.
    ///
    /// # Errors
    /// As [`memory_need`](Self::memory_need).
    pub fn work(&self, precision: Precision, g: u32) -> Result<Work> {
        self.geometry().check_window(g)?;
        let [pass, encode, decode] =
            GraphKind::ALL.map(|kind| self.footprint(kind, precision, g).map(|footprint| footprint.work));
        Ok(Work { pass: pass?, encode: encode?, decode: decode? })
    }
}
