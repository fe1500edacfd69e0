//! The residual stream of a transformer: the sums that each layer adds to, and their type.

use std::collections::HashSet;

use super::operators::NBITS;
use super::proto::Node;
use super::shape_inference::Input;
use super::{CheckResult, DataType, Fault, Shape, quoted};
use crate::bundle::{Geometry, GraphKind, Residual};

/// Finds the sums of the residual stream while the nodes of a transformer are read in order.
///
/// The stream begins as the tokens: what `Conv`, `MatMul`, `Cast`, `Reshape`, `Transpose` and, in a joined graph, `Concat` make of `x`. A sum is
/// an `Add` of two values `[latents, T, D]`, neither of them a constant, one of which belongs to the stream. Norms end the stream, so a branch
/// does not belong to it.
pub(super) struct ResidualStream<'a> {
    dims: [u64; 3],
    values: HashSet<&'a str>,
    sums: Vec<(&'a str, DataType)>,
}

impl<'a> ResidualStream<'a> {
    /// The stream that starts at the input `x`.
    pub(super) fn new(geometry: &Geometry, kind: GraphKind) -> Self {
        let dims = [kind.latents().into(), geometry.tokens.into(), geometry.width.into()];
        Self { dims, values: HashSet::from(["x"]), sums: Vec::new() }
    }

    /// Reads the next node that runs.
    pub(super) fn read(&mut self, node: &'a Node<'a>, inputs: &[Input<'_>], outputs: &[Shape]) {
        let (Some(&first), Some(&output), Some(shape)) = (node.inputs.first(), node.outputs.first(), outputs.first())
        else {
            return;
        };
        let is_from_stream = node.inputs.iter().any(|name| self.values.contains(name));
        let continues = match node.operator {
            "Add" => is_from_stream,
            // Of the two latents.
            "Concat" => self.dims[0] > 1 && is_from_stream,
            "Cast" | "Reshape" | "Transpose" | "Conv" | "MatMul" | NBITS => self.values.contains(first),
            _ => false,
        };
        if !continues || self.values.try_reserve(1).is_err() {
            return;
        }
        self.values.insert(output);
        let has_dims = |shape: &Shape| shape.dims == self.dims;
        if node.operator == "Add"
            && has_dims(shape)
            && inputs.iter().all(|input| !input.is_constant && has_dims(input.shape))
        {
            self.sums.push((output, shape.element));
        }
    }

    /// Names of the sums, in order.
    pub(super) fn names(&self) -> impl Iterator<Item = &'a str> {
        self.sums.iter().map(|&(name, _)| name)
    }

    /// Checks the sums of a float16 transformer: all are float16, or all are float32 if the manifest says so, two for each layer at least.
    pub(super) fn check(&self, stated: Option<Residual>, layers: u32) -> CheckResult<()> {
        let (wanted, statement) = match stated {
            None => (DataType::F16, "states no `residual`"),
            Some(Residual::Float32) => (DataType::F32, "states the `residual` float32"),
        };
        if let Some((name, element)) = self.sums.iter().find(|(_, element)| *element != wanted) {
            let cause =
                format!("the sum {} of the residual stream is {element}, and the manifest {statement}", quoted(name));
            return Err(Fault::new(cause));
        }
        let least = 2 * layers as usize;
        if stated.is_some() && self.sums.len() < least {
            let found = self.sums.len();
            let cause = format!(
                "the manifest {statement}, and the residual stream has {found} sums; {layers} layers have {least}"
            );
            return Err(Fault::new(cause));
        }
        Ok(())
    }
}
