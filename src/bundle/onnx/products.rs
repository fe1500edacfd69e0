//! Rewrites fused products for providers without `FusedMatMul`.

use std::collections::HashMap;

use half::f16;

use super::check::opset;
use super::messages::GraphProto;
use super::model_writer::{attribute, node, tensor};
use super::proto::{self, Attribute, Graph, Model, Node};
use super::shape_inference::{Input, infer_sizes, named_shapes};
use super::wire::Fields;
use super::writer::{reserved, with_graph, write_bytes};
use super::{CheckResult, DataType, Fault, Shape, quoted};
use crate::Result;

/// Prefix of the names of additional values and constants. `cairn.build` makes no name that begins so.
const PREFIX: &str = "cairn.product";
const FUSED: &str = "FusedMatMul";

/// A checked model in which operators that every provider has replace each `FusedMatMul`: `Mul` by alpha unless that is 1, `Transpose` of the
/// second input if it is transposed, and `MatMul`. `None` if no node is a `FusedMatMul`. Products of constants are copied: a session computes
/// them when it is made. `sizes` are the dimensions of the model's inputs and outputs, by name.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks, or whose shapes do not follow from `sizes`; `OutOfMemory`.
pub(crate) fn without_fused_products(onnx: &[u8], sizes: &[(&str, &[usize])]) -> Result<Option<Vec<u8>>> {
    rewrite(onnx, sizes).map_err(Fault::error)
}

/// Type and number of dimensions of a product's inputs.
struct Operands {
    element: DataType,
    /// Of the second input.
    rank: usize,
}

/// The fused products of values, by the names of their results.
type Fused<'a> = HashMap<&'a str, Operands>;

fn rewrite(onnx: &[u8], sizes: &[(&str, &[usize])]) -> CheckResult<Option<Vec<u8>>> {
    let model = proto::model(onnx)?;
    let graph = &model.graph;
    if !graph.nodes.iter().any(|node| node.operator == FUSED) {
        return Ok(None);
    }
    let fused = fused_products(&model, sizes)?;
    let added: usize = graph.nodes.iter().filter(|node| node.operator == FUSED).map(Node::replacement_bytes).sum();
    let bytes = onnx.len() + added;
    let rewrite = |fields: &[u8]| rewrite_graph(graph, &fused, Fields::new("the graph", fields), reserved(bytes)?);
    with_graph(onnx, bytes, rewrite).map(Some)
}

/// Finds the `FusedMatMul` nodes that have an input which is not constant.
fn fused_products<'a>(model: &'a Model<'a>, sizes: &[(&str, &[usize])]) -> CheckResult<Fused<'a>> {
    let graph = &model.graph;
    let (inputs, outputs) = (named_shapes(&graph.inputs, sizes)?, named_shapes(&graph.outputs, sizes)?);
    let mut fused = Fused::new();
    fused.try_reserve(graph.nodes.len()).map_err(Fault::no_memory)?;
    let mut visitor = |node: &'a Node<'a>, inputs: &[Input<'_>], results: &[Shape]| {
        if node.operator == FUSED
            && let ([_, right], [result]) = (inputs, results)
        {
            let operands = Operands { element: result.element, rank: right.shape.dims.len() };
            fused.insert(node.outputs[0], operands);
        }
    };
    infer_sizes(graph, opset(model)?, &inputs, &outputs, &mut visitor)?;
    Ok(fused)
}

/// Writes the graph into `written`.
fn rewrite_graph(
    graph: &Graph<'_>,
    fused: &Fused<'_>,
    mut fields: Fields<'_>,
    mut written: Vec<u8>,
) -> CheckResult<Vec<u8>> {
    let mut nodes = graph.nodes.iter().enumerate();
    while let Some(field) = fields.next()? {
        let node = (field.number == GraphProto::NODE).then(|| nodes.next()).flatten();
        match node.and_then(|(i, node)| Some((i, node, fused.get(*node.outputs.first()?)?))) {
            Some((i, node, operands)) => write_product(&mut written, i, node, operands)?,
            _ => field.write(&mut written),
        }
    }
    Ok(written)
}

fn write_product(graph: &mut Vec<u8>, i: usize, fused: &Node<'_>, operands: &Operands) -> CheckResult<()> {
    let (mut alpha, mut is_transposed) = (1.0, false);
    for (name, value) in &fused.attributes {
        match (*name, value) {
            ("alpha", Attribute::Float(value)) => alpha = *value,
            ("transB", Attribute::Int(value)) => is_transposed = *value != 0,
            _ => return Err(Fault::new(format!("{FUSED} has the attribute {}", quoted(name)))),
        }
    }
    let [left, right] = fused.inputs[..] else { return Err(Fault::new(format!("{FUSED} has not two inputs"))) };
    let [scaled, constant, transposed] = ["scaled", "alpha", "transposed"].map(|what| format!("{PREFIX}.{i}.{what}"));
    let (left, right) = (
        match alpha == 1.0 {
            true => left,
            false => {
                let (element, bytes) = match operands.element {
                    DataType::F16 => (DataType::F16, f16::from_f32(alpha).to_le_bytes().to_vec()),
                    _ => (DataType::F32, alpha.to_le_bytes().to_vec()),
                };
                write_bytes(graph, GraphProto::INITIALIZER, &tensor(&constant, element, &[1], &bytes));
                write_bytes(graph, GraphProto::NODE, &node("Mul", &scaled, &[left, &constant], &[&scaled], &[]));
                &scaled
            }
        },
        match is_transposed {
            false => right,
            true => {
                let mut axes: Vec<i64> = (0..operands.rank as i64).collect();
                axes[operands.rank - 2..].reverse();
                let order = [attribute("perm", &axes, true)];
                write_bytes(graph, GraphProto::NODE, &node("Transpose", &transposed, &[right], &[&transposed], &order));
                &transposed
            }
        },
    );
    write_bytes(graph, GraphProto::NODE, &node("MatMul", fused.name, &[left, right], &fused.outputs, &[]));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::messages::{AttributeProto, ModelProto, NodeProto, OperatorSetIdProto, attribute_type};
    use super::super::model_writer::value_info;
    use super::super::split_k::tests::with_sizes;
    use super::super::writer::write_int;
    use super::*;
    use crate::bundle::{Bundle, GraphKind, OpenOptions, Precision};

    #[test]
    fn products_are_rewritten_and_all_else_is_kept() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        for precision in Precision::ALL {
            let onnx = bundle.model(GraphKind::Transformer, precision).unwrap().onnx;
            let before = proto::model(onnx).unwrap().graph;
            let tokens = bundle.manifest().geometry.tokens as usize;
            let rewrite =
                |onnx: &[u8]| with_sizes(&before, tokens, |sizes| without_fused_products(onnx, sizes)).unwrap();
            let written = rewrite(onnx).expect("products");
            let after = proto::model(&written).unwrap().graph;
            let fused = before.nodes.iter().filter(|node| node.operator == FUSED).count();
            assert!(fused > 0 && after.nodes.iter().all(|node| node.operator != FUSED));
            let added = after.nodes.len() - before.nodes.len();
            assert_eq!(added, 2 * fused, "{precision:?}");
            let outputs =
                |graph: &Graph<'_>| graph.nodes.iter().map(|node| node.outputs[0].to_owned()).collect::<Vec<_>>();
            let kept: Vec<_> = outputs(&after).into_iter().filter(|name| !name.starts_with(PREFIX)).collect();
            assert_eq!(kept, outputs(&before), "{precision:?}");
            assert_eq!(rewrite(&written), None);
        }
    }

    #[test]
    fn products_of_any_rank_and_type_are_rewritten() {
        for (element, rank) in [(DataType::F32, 2), (DataType::F16, 3)] {
            let dims = |rows, columns| [&[1; 2][..rank - 2], &[rows, columns]].concat();
            let (mut graph, mut onnx) = (Vec::new(), Vec::new());
            let attributes = [attribute("transB", &[1], false), alpha(0.5)];
            let mut product = node(FUSED, "y", &["x", "w"], &["y"], &attributes);
            write_bytes(&mut product, NodeProto::DOMAIN, proto::CONTRIB.as_bytes());
            // Weights of a float32 graph are stored in float16.
            let is_cast = element == DataType::F32;
            if is_cast {
                let to_float32 = attribute("to", &[DataType::F32 as i64], false);
                write_bytes(&mut graph, GraphProto::NODE, &node("Cast", "w", &["stored"], &["w"], &[to_float32]));
            }
            write_bytes(&mut graph, GraphProto::NODE, &product);
            let stored = if is_cast { "stored" } else { "w" };
            write_bytes(&mut graph, GraphProto::INITIALIZER, &tensor(stored, DataType::F16, &dims(4, 3), &[0; 24]));
            write_bytes(&mut graph, GraphProto::INPUT, &value_info("x", element, &dims(2, 3)));
            write_bytes(&mut graph, GraphProto::OUTPUT, &value_info("y", element, &dims(2, 4)));
            write_int(&mut onnx, ModelProto::IR_VERSION, 8);
            write_bytes(&mut onnx, ModelProto::GRAPH, &graph);
            for (domain, version) in [("", 17), (proto::CONTRIB, 1)] {
                let mut opset = Vec::new();
                write_bytes(&mut opset, OperatorSetIdProto::DOMAIN, domain.as_bytes());
                write_int(&mut opset, OperatorSetIdProto::VERSION, version);
                write_bytes(&mut onnx, ModelProto::OPSET_IMPORT, &opset);
            }
            let sizes = [("x", dims(2, 3)), ("y", dims(2, 4))];
            let sizes = sizes.each_ref().map(|(name, dims)| (*name, dims.as_slice()));
            let written = without_fused_products(&onnx, &sizes).unwrap().expect("a product");
            let after = proto::model(&written).unwrap().graph;
            let operators: Vec<_> = after.nodes.iter().map(|node| node.operator).collect();
            assert_eq!(operators[usize::from(is_cast)..], ["Mul", "Transpose", "MatMul"]);
            let axes: &[i64] = if rank == 2 { &[1, 0] } else { &[0, 2, 1] };
            assert!(
                matches!(&after.nodes[1 + usize::from(is_cast)].attributes[..], [("perm", Attribute::Ints(found))] if found == axes)
            );
            let factor = after.tensors.iter().find(|tensor| tensor.name.starts_with(PREFIX)).unwrap();
            assert_eq!(factor.data_type, element as i64);
        }
    }

    fn alpha(value: f32) -> Vec<u8> {
        let mut attribute = Vec::new();
        write_bytes(&mut attribute, AttributeProto::NAME, b"alpha");
        attribute.extend([(AttributeProto::F as u8) << 3 | 5].into_iter().chain(value.to_le_bytes()));
        write_int(&mut attribute, AttributeProto::TYPE, attribute_type::FLOAT.cast_unsigned());
        attribute
    }
}
