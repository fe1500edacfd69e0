//! Rewrites a model so that its large weights are inputs. The caller can then supply their memory, which the runtime would own otherwise.

use std::collections::{HashMap, HashSet};

use super::conditioning::tensor_bytes;
use super::messages::{GraphProto, TensorProto};
use super::model_writer::value_info;
use super::operators::NBITS;
use super::proto::{self, Data, Graph};
use super::wire::Fields;
use super::writer::{with_graph, write_bytes};
use super::{CheckResult, DataType, Fault, quoted};
use crate::Result;
use crate::bundle::ModelSource;

/// Weights smaller than this stay constants, in bytes: a Direct3D buffer takes twice as much anyway.
const SMALLEST: u64 = 32 << 10;

/// A weight that became an input.
pub(crate) struct Weight<'a> {
    /// Name in the model.
    pub(crate) name: &'a str,
    /// Whether it holds unsigned bytes, and not half floats.
    pub(crate) is_integer: bool,
    pub(crate) shape: Vec<usize>,
    /// Little-endian.
    pub(crate) bytes: &'a [u8],
}

/// Rewrites a checked model with its large weights as additional inputs after its own; also returns these weights in input order. A
/// weight that is converted before use stays a constant, because the runtime converts it once.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks.
pub(crate) fn weights_as_inputs<'a>(model: &ModelSource<'a>) -> Result<(Vec<u8>, Vec<Weight<'a>>)> {
    rewrite(model).map_err(Fault::error)
}

fn rewrite<'a>(model: &ModelSource<'a>) -> CheckResult<(Vec<u8>, Vec<Weight<'a>>)> {
    let graph = proto::model(model.onnx)?.graph;
    let weights = weights(&graph, model)?;
    let rewrite = |graph: &[u8]| graph_without(&weights, Fields::new("the graph", graph));
    let written = with_graph(model.onnx, model.onnx.len(), rewrite)?;
    Ok((written, weights))
}

fn weights<'a>(graph: &Graph<'a>, model: &ModelSource<'a>) -> CheckResult<Vec<Weight<'a>>> {
    let multiplied = multiplied_constants(graph)?;
    let mut weights = Vec::new();
    for tensor in &graph.tensors {
        let Data::External { length, .. } = tensor.data else { continue };
        let element = DataType::of(tensor.data_type)?;
        if length < SMALLEST || !matches!(element, DataType::F16 | DataType::U8) || !multiplied.contains(tensor.name) {
            continue;
        }
        let bytes = tensor_bytes(tensor, model)?;
        let shape = tensor.dims.iter().map(|&n| usize::try_from(n)).collect::<std::result::Result<_, _>>();
        let shape = shape.map_err(|_| Fault::new(format!("initializer {} is too large", quoted(tensor.name))))?;
        weights.push(Weight { name: tensor.name, is_integer: element == DataType::U8, shape, bytes });
    }
    Ok(weights)
}

/// Names of the initializers that products of values read, and nothing else. What only folded nodes read, or no node, is not among them.
fn multiplied_constants<'a>(graph: &Graph<'a>) -> CheckResult<HashSet<&'a str>> {
    let (mut constants, mut multiplied) = (HashSet::new(), HashMap::new());
    constants.try_reserve(graph.tensors.len() + graph.nodes.len()).map_err(Fault::no_memory)?;
    multiplied.try_reserve(graph.tensors.len()).map_err(Fault::no_memory)?;
    constants.extend(graph.tensors.iter().map(|tensor| tensor.name));
    for node in &graph.nodes {
        let is_folded = node.inputs.iter().all(|input| input.is_empty() || constants.contains(input));
        if is_folded {
            constants.extend(node.outputs.iter().copied());
        }
        let is_product = !is_folded && matches!(node.operator, "MatMul" | "Gemm" | "Conv" | NBITS);
        for input in &node.inputs {
            if constants.contains(input) {
                *multiplied.entry(*input).or_insert(true) &= is_product;
            }
        }
    }
    Ok(multiplied.into_iter().filter(|(_, is_product)| *is_product).map(|(name, _)| name).collect())
}

fn graph_without(weights: &[Weight<'_>], mut fields: Fields<'_>) -> CheckResult<Vec<u8>> {
    let mut written = Vec::new();
    while let Some(field) = fields.next()? {
        if field.number == GraphProto::INITIALIZER {
            let name = name_of(field.message("an initializer")?)?;
            if weights.iter().any(|weight| weight.name == name) {
                continue;
            }
        }
        field.write(&mut written);
    }
    for weight in weights {
        let element = if weight.is_integer { DataType::U8 } else { DataType::F16 };
        write_bytes(&mut written, GraphProto::INPUT, &value_info(weight.name, element, &weight.shape));
    }
    Ok(written)
}

/// A tensor's name.
fn name_of<'a>(mut fields: Fields<'a>) -> CheckResult<&'a str> {
    while let Some(field) = fields.next()? {
        if field.number == TensorProto::NAME {
            return field.text(usize::MAX);
        }
    }
    Ok("")
}

#[cfg(test)]
mod tests {
    use super::super::messages::{ModelProto, StringStringEntryProto, data_location};
    use super::super::model_writer::node;
    use super::super::writer::write_int;
    use super::*;
    use crate::ErrorKind;

    /// An initializer of half floats in `weights.bin`.
    fn initializer(name: &str, dims: &[u64], offset: u64) -> Vec<u8> {
        let mut tensor = Vec::new();
        dims.iter().for_each(|&n| write_int(&mut tensor, TensorProto::DIMS, n));
        write_int(&mut tensor, TensorProto::DATA_TYPE, DataType::F16 as u64);
        write_bytes(&mut tensor, TensorProto::NAME, name.as_bytes());
        let length = 2 * dims.iter().product::<u64>();
        for (key, value) in
            [("location", "weights.bin"), ("offset", &offset.to_string()), ("length", &length.to_string())]
        {
            let mut entry = Vec::new();
            write_bytes(&mut entry, StringStringEntryProto::KEY, key.as_bytes());
            write_bytes(&mut entry, StringStringEntryProto::VALUE, value.as_bytes());
            write_bytes(&mut tensor, TensorProto::EXTERNAL_DATA, &entry);
        }
        write_int(&mut tensor, TensorProto::DATA_LOCATION, data_location::EXTERNAL.cast_unsigned());
        tensor
    }

    fn model(initializers: &[Vec<u8>]) -> Vec<u8> {
        let (mut graph, mut model) = (Vec::new(), Vec::new());
        for (operator, inputs, output) in [
            ("MatMul", ["x", "large"], "a"),
            ("Conv", ["a", "small"], "b"),
            ("MatMul", ["b", "shared"], "c"),
            ("Add", ["c", "shared"], "d"),
            ("Conv", ["d", "filter"], "e"),
            ("MatMul", ["folded", "small"], "constant"),
            ("Add", ["e", "constant"], "y"),
        ] {
            write_bytes(&mut graph, GraphProto::NODE, &node(operator, output, &inputs, &[output], &[]));
        }
        initializers.iter().for_each(|tensor| write_bytes(&mut graph, GraphProto::INITIALIZER, tensor));
        let whole = Weight { name: "x", is_integer: false, shape: vec![1, 256], bytes: &[] };
        write_bytes(&mut graph, GraphProto::INPUT, &value_info(whole.name, DataType::F16, &whole.shape));
        write_bytes(&mut graph, GraphProto::OUTPUT, &value_info("y", DataType::F16, &whole.shape));
        write_int(&mut model, ModelProto::IR_VERSION, 8);
        write_bytes(&mut model, ModelProto::GRAPH, &graph);
        write_bytes(&mut model, ModelProto::OPSET_IMPORT, &[]);
        model
    }

    #[test]
    fn large_weights_that_are_only_multiplied_become_inputs() {
        // Of the four, one is small, one is also read by another operator, one only by a folded node, and one by none.
        let constants = [
            initializer("small", &[1, 16383], 0),
            initializer("shared", &[256, 128], 0),
            initializer("folded", &[128, 256], 0),
            initializer("unused", &[256, 128], 0),
        ];
        let moved = [initializer("large", &[256, 128], 4), initializer("filter", &[1, 4, 64, 64], 2)];
        let onnx = model(&[&moved[..1], &constants, &moved[1..]].concat());
        let file: Vec<u8> = (0..70_000_u32).map(|i| (i % 251) as u8).collect();
        let source = ModelSource { onnx: &onnx, external: vec![("other.bin", &[]), ("weights.bin", &file)] };
        let (written, weights) = weights_as_inputs(&source).unwrap();
        let inputs: Vec<_> = weights.iter().map(|weight| (weight.name, &weight.shape[..], weight.bytes)).collect();
        let expected: [(&str, &[usize], &[u8]); 2] =
            [("large", &[256, 128], &file[4..65540]), ("filter", &[1, 4, 64, 64], &file[2..32770])];
        assert_eq!(inputs, expected);

        // The rest is unchanged, with the weights after the inputs.
        let graph = proto::model(&written).unwrap().graph;
        assert_eq!(graph.nodes.len(), 7);
        assert_eq!(
            graph.tensors.iter().map(|tensor| tensor.name).collect::<Vec<_>>(),
            ["small", "shared", "folded", "unused"]
        );
        let inputs: Vec<_> = graph.inputs.iter().map(|value| (value.name, value.data_type, value.dims.len())).collect();
        assert_eq!(inputs, [("x", 10, 2), ("large", 10, 2), ("filter", 10, 4)]);
        assert_eq!(graph.inputs[2].dims, [1, 4, 64, 64].map(proto::Dim::Number));
        assert_eq!(graph.outputs.len(), 1);

        // Without such weights the model is unchanged.
        let onnx = model(&constants);
        let (written, weights) = weights_as_inputs(&ModelSource { onnx: &onnx, ..source }).unwrap();
        assert!(written == onnx && weights.is_empty());
    }

    #[test]
    fn a_model_that_was_not_checked_is_refused() {
        let outside = model(&[initializer("large", &[256, 128], 5)]);
        for (onnx, location) in [(&outside, "weights.bin"), (&outside, "other.bin"), (&vec![7], "weights.bin")] {
            let source = ModelSource { onnx, external: vec![(location, &[0; 65536])] };
            assert!(weights_as_inputs(&source).is_err_and(|e| e.kind() == ErrorKind::InvalidBundle));
        }
    }
}
