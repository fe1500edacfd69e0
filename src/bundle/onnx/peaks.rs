//! A float32 transformer with additional outputs: the largest magnitudes of the values that the float16 transformer holds in float16.

use std::collections::HashMap;

use super::check::visit_nodes;
use super::messages::GraphProto;
use super::model_writer::{attribute, node, value_info};
use super::operators::NBITS;
use super::proto;
use super::residual::ResidualStream;
use super::writer::{with_graph, write_bytes};
use super::{CheckResult, DataType, ModelContext};
use crate::Result;
use crate::bundle::{Bundle, GraphKind, Precision};

/// Prefix of the names of additional values and outputs. `cairn.build` makes no name that begins so.
const PREFIX: &str = "cairn.peak";

/// A value that the float16 transformer holds in float16.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct HalfValue {
    /// Its name in both transformers.
    pub(crate) name: String,
    /// Whether it is a sum of the residual stream.
    pub(crate) is_residual: bool,
}

/// A float32 transformer that also returns the largest magnitude of each of `values`: outputs of their own after those of the format, float32 and
/// without dimensions.
pub(crate) struct ModelWithPeaks {
    pub(crate) onnx: Vec<u8>,
    /// In the order of the nodes.
    pub(crate) values: Vec<HalfValue>,
}

impl ModelWithPeaks {
    /// Name of the output with the largest magnitude of value `i`.
    pub(crate) fn output(i: usize) -> String {
        format!("{PREFIX}.{i}")
    }
}

impl Bundle {
    /// The float32 transformer with the largest magnitudes of the values that are float16 in the float16 transformer. Values are matched by name, so
    /// there are none where the two name theirs differently.
    ///
    /// # Errors
    /// `Unsupported` where the bundle has no float16 graphs.
    pub(crate) fn transformer_with_peaks(&self) -> Result<ModelWithPeaks> {
        let context = |precision| ModelContext { manifest: &self.manifest, kind: GraphKind::Transformer, precision };
        let [wide, half] = Precision::ALL.map(|precision| Ok(self.model(GraphKind::Transformer, precision)?.onnx));
        let (wide, half): (&[u8], &[u8]) = (wide?, half?);
        let found =
            half_values(half, context(Precision::F16)).map_err(|fault| context(Precision::F16).to_error(fault))?;
        let written = with_peaks(wide, context(Precision::F32), found);
        written.map_err(|fault| context(Precision::F32).to_error(fault))
    }
}

/// Values that a pass makes and holds in float16, with their dimensions: sums, products, and the inputs of a `Cast` to float16. Attention's
/// scores and shares are left out. They have bounds, because queries and keys are normalised, and are by far the largest values.
fn half_values(onnx: &[u8], context: ModelContext<'_>) -> CheckResult<Vec<(HalfValue, Vec<u64>)>> {
    let model = proto::model(onnx)?;
    let mut stream = ResidualStream::new(&context.manifest.geometry, context.kind);
    let mut made: Vec<(&str, Vec<u64>)> = Vec::new();
    visit_nodes(&model, context, &mut |node, inputs, outputs| {
        stream.read(node, inputs, outputs);
        let (Some(output), Some(shape)) = (node.outputs.first(), outputs.first()) else { return };
        if shape.element != DataType::F16 {
            return;
        }
        let is_flat = shape.dims.len() <= 3;
        let source = match node.operator {
            "Cast" => node.inputs.first(),
            "Conv" => Some(output),
            "Add" | "Mul" | "MatMul" | NBITS if is_flat => Some(output),
            _ => None,
        };
        made.extend(source.map(|name| (*name, shape.dims.clone())));
    })?;
    let sums: Vec<&str> = stream.names().collect();
    let value =
        |(name, dims): (&str, _)| (HalfValue { name: name.to_owned(), is_residual: sums.contains(&name) }, dims);
    Ok(made.into_iter().map(value).collect())
}

/// The model with the magnitudes of those `values` that it makes in float32 with the same dimensions.
fn with_peaks(
    onnx: &[u8],
    context: ModelContext<'_>,
    values: Vec<(HalfValue, Vec<u64>)>,
) -> CheckResult<ModelWithPeaks> {
    let model = proto::model(onnx)?;
    let mut made: HashMap<&str, Vec<u64>> = HashMap::new();
    visit_nodes(&model, context, &mut |node, _, outputs| {
        let named = node.outputs.iter().zip(outputs).filter(|(_, shape)| shape.element == DataType::F32);
        made.extend(named.map(|(name, shape)| (*name, shape.dims.clone())));
    })?;
    let mut kept: Vec<HalfValue> = Vec::new();
    for (value, dims) in values {
        if made.get(value.name.as_str()) == Some(&dims) && !kept.iter().any(|known| known.name == value.name) {
            kept.push(value);
        }
    }
    let written = with_graph(onnx, onnx.len(), |graph| Ok(graph_with_peaks(graph, &kept)))?;
    Ok(ModelWithPeaks { onnx: written, values: kept })
}

/// `GraphProto` with two more nodes and one more output for each value.
fn graph_with_peaks(graph: &[u8], values: &[HalfValue]) -> Vec<u8> {
    // Fields of a list may stand anywhere in a message, so the new ones follow all others.
    let mut written = graph.to_vec();
    for (i, value) in values.iter().enumerate() {
        let (magnitudes, peak) = (format!("{PREFIX}.magnitudes.{i}"), ModelWithPeaks::output(i));
        let scalar = attribute("keepdims", &[0], false);
        for node in [
            node("Abs", &magnitudes, &[&value.name], &[&magnitudes], &[]),
            node("ReduceMax", &peak, &[&magnitudes], &[&peak], &[scalar]),
        ] {
            write_bytes(&mut written, GraphProto::NODE, &node);
        }
        write_bytes(&mut written, GraphProto::OUTPUT, &value_info(&peak, DataType::F32, &[]));
    }
    written
}
