//! The conditioning of a transformer: the nodes whose values depend on its noise levels alone, or on its controls alone, up to the last products with
//! weights among them.
//!
//! Those of the noise levels embed them and make each layer's scales, shifts and gates. They give the same values in every pass at the same level, so
//! that they can run apart from passes, once for each level; their weights then need no memory of the device while it makes latents. Those of the
//! controls embed them and make what each layer adds of them. They give the same values in every pass of a step, and run once for it.

use std::collections::HashSet;

use super::messages::{GraphProto, TensorProto};
use super::operators::NBITS;
use super::proto::{self, Data, Graph, Tensor};
use super::wire::Fields;
use super::writer::{reserved, with_graph, write_bytes};
use super::{CheckResult, Fault, quoted};
use crate::Result;
use crate::bundle::ModelSource;

/// When a node of a transformer runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Runs {
    /// Once, when its graph is loaded: it reads constants only.
    AtLoad,
    /// Once for each noise level.
    PerLevel,
    /// Once for each step, on its controls.
    PerStep,
    /// In each pass.
    PerPass,
}

/// When each node runs.
pub(super) fn when_nodes_run(graph: &Graph<'_>) -> CheckResult<Vec<Runs>> {
    let mut found = vec![Runs::PerPass; graph.nodes.len()];
    for (input, runs) in [("sigma", Runs::PerLevel), ("controls", Runs::PerStep)] {
        mark_nodes_of(graph, input, runs, &mut found)?;
    }
    Ok(found)
}

/// Marks nodes that read constants only, and those whose values depend on `input` alone, if a product with weights makes or needs them.
fn mark_nodes_of(graph: &Graph<'_>, input: &str, runs: Runs, found: &mut [Runs]) -> CheckResult<()> {
    let outputs: HashSet<&str> = graph.outputs.iter().map(|output| output.name).collect();
    let values = graph.tensors.len() + 2 * graph.nodes.len();
    let (mut constants, mut of_input, mut needed): (HashSet<&str>, HashSet<&str>, HashSet<&str>) = Default::default();
    for set in [&mut constants, &mut of_input, &mut needed] {
        set.try_reserve(values).map_err(Fault::no_memory)?;
    }
    constants.extend(graph.tensors.iter().map(|tensor| tensor.name));
    of_input.insert(input);
    let mut is_product = vec![false; graph.nodes.len()];
    for (i, node) in graph.nodes.iter().enumerate() {
        let read: Vec<&str> = node.inputs.iter().copied().filter(|name| !name.is_empty()).collect();
        let has_constant = read.iter().any(|name| constants.contains(name));
        if read.iter().all(|name| constants.contains(name)) {
            constants.extend(node.outputs.iter().copied());
            found[i] = Runs::AtLoad;
        } else if read.iter().all(|name| constants.contains(name) || of_input.contains(name))
            // A pass must make its own outputs.
            && !node.outputs.iter().any(|name| outputs.contains(name))
        {
            of_input.extend(node.outputs.iter().copied());
            is_product[i] = has_constant && matches!(node.operator, "MatMul" | "Gemm" | NBITS);
        }
    }
    for (i, node) in graph.nodes.iter().enumerate().rev() {
        if is_product[i] || node.outputs.iter().any(|name| of_input.contains(name) && needed.contains(name)) {
            needed.extend(node.inputs.iter().copied());
            found[i] = runs;
        }
    }
    Ok(())
}

/// The model with its weights inside, so that it needs no other file.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks; `OutOfMemory`.
pub(crate) fn with_weights_inside(model: &ModelSource<'_>) -> Result<Vec<u8>> {
    rewrite(model).map_err(Fault::error)
}

fn rewrite(model: &ModelSource<'_>) -> CheckResult<Vec<u8>> {
    let graph = proto::model(model.onnx)?.graph;
    let weights = graph.tensors.iter().map(|tensor| tensor_bytes(tensor, model)).collect::<CheckResult<Vec<_>>>()?;
    let bytes = weights.iter().map(|bytes| bytes.len()).sum::<usize>() + model.onnx.len();
    with_graph(model.onnx, bytes, |graph| {
        let mut written = reserved(bytes)?;
        let (mut fields, mut weights) = (Fields::new("the graph", graph), weights.iter());
        while let Some(field) = fields.next()? {
            match field.number {
                GraphProto::INITIALIZER => {
                    let data = weights.next().ok_or_else(|| Fault::new("the graph has another number of tensors"))?;
                    write_bytes(
                        &mut written,
                        GraphProto::INITIALIZER,
                        &inside(field.message("an initializer")?, data)?,
                    );
                }
                _ => field.write(&mut written),
            }
        }
        Ok(written)
    })
}

/// The numbers of a tensor, as they are stored.
pub(super) fn tensor_bytes<'a>(tensor: &Tensor<'a>, model: &ModelSource<'a>) -> CheckResult<&'a [u8]> {
    let (location, offset, length) = match tensor.data {
        Data::Inline(bytes) => return Ok(bytes),
        Data::External { location, offset, length } => (location, offset, length),
    };
    let file = model.external.iter().find(|(name, _)| *name == location);
    let range = usize::try_from(offset).ok().zip(offset.checked_add(length).and_then(|end| end.try_into().ok()));
    let bytes = file.zip(range).and_then(|((_, file), (start, end)): (_, (usize, usize))| file.get(start..end));
    bytes.ok_or_else(|| Fault::new(format!("initializer {} lies outside its file", quoted(tensor.name))))
}

/// An initializer that has `data` inside.
fn inside(mut fields: Fields<'_>, data: &[u8]) -> CheckResult<Vec<u8>> {
    let mut written = reserved(data.len() + 1024)?;
    while let Some(field) = fields.next()? {
        if !matches!(field.number, TensorProto::RAW_DATA | TensorProto::EXTERNAL_DATA | TensorProto::DATA_LOCATION) {
            field.write(&mut written);
        }
    }
    write_bytes(&mut written, TensorProto::RAW_DATA, data);
    Ok(written)
}
