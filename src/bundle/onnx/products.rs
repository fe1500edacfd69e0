//! Rewrites the products of attention for providers without `FusedMatMul`.

use half::f16;

use super::model_writer::{attribute, node, tensor};
use super::proto::{self, Attribute, Graph, Node};
use super::wire::Fields;
use super::writer::{reserved, with_graph, write_bytes};
use super::{CheckResult, DataType, Fault, quoted};
use crate::Result;

/// Prefix of the names of additional values and constants. `cairn.build` makes no name that begins so.
const PREFIX: &str = "cairn.product";
const FUSED: &str = "FusedMatMul";

/// A checked model with each `FusedMatMul` as three operators that every provider has: the first input times `alpha`, the second one
/// transposed, and `MatMul`. `None` if it has none.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks.
pub(crate) fn without_fused_products(onnx: &[u8]) -> Result<Option<Vec<u8>>> {
    rewrite(onnx).map_err(Fault::error)
}

fn rewrite(onnx: &[u8]) -> CheckResult<Option<Vec<u8>>> {
    let graph = proto::model(onnx)?.graph;
    if !graph.nodes.iter().any(|node| node.operator == FUSED) {
        return Ok(None);
    }
    let added: usize = graph.nodes.iter().filter(|node| node.operator == FUSED).map(Node::replacement_bytes).sum();
    let bytes = onnx.len() + added;
    let rewrite = |fields: &[u8]| rewrite_graph(&graph, Fields::new("the graph", fields), reserved(bytes)?);
    with_graph(onnx, bytes, rewrite).map(Some)
}

/// Writes the graph into `written`.
fn rewrite_graph(graph: &Graph<'_>, mut fields: Fields<'_>, mut written: Vec<u8>) -> CheckResult<Vec<u8>> {
    let element = key_element(graph)?;
    let mut nodes = graph.nodes.iter().enumerate();
    while let Some(field) = fields.next()? {
        match (field.number == 1).then(|| nodes.next()).flatten() {
            Some((i, node)) if node.operator == FUSED => write_product(&mut written, i, node, element)?,
            _ => field.write(&mut written),
        }
    }
    Ok(written)
}

/// The type of both inputs: queries and keys are multiplied in the type that keys are stored in.
fn key_element(graph: &Graph<'_>) -> CheckResult<DataType> {
    let past = graph.inputs.iter().find(|input| input.name.starts_with("past."));
    let past = past.ok_or_else(|| Fault::new(format!("{FUSED} is used, and no input holds keys")))?;
    DataType::of(past.data_type)
}

fn write_product(graph: &mut Vec<u8>, i: usize, fused: &Node<'_>, element: DataType) -> CheckResult<()> {
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
                let (element, bytes) = match element {
                    DataType::F16 => (DataType::F16, f16::from_f32(alpha).to_le_bytes().to_vec()),
                    _ => (DataType::F32, alpha.to_le_bytes().to_vec()),
                };
                write_bytes(graph, 5, &tensor(&constant, element, &[1], &bytes));
                write_bytes(graph, 1, &node("Mul", &scaled, &[left, &constant], &[&scaled], &[]));
                &scaled
            }
        },
        match is_transposed {
            false => right,
            true => {
                // Attention's matrices have four dimensions: batch, heads, rows and columns.
                let order = [attribute("perm", &[0, 1, 3, 2], true)];
                write_bytes(graph, 1, &node("Transpose", &transposed, &[right], &[&transposed], &order));
                &transposed
            }
        },
    );
    write_bytes(graph, 1, &node("MatMul", fused.name, &[left, right], &fused.outputs, &[]));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::{Bundle, GraphKind, OpenOptions, Precision};

    #[test]
    fn products_are_rewritten_and_all_else_is_kept() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        for precision in Precision::ALL {
            let onnx = bundle.model(GraphKind::Transformer, precision).unwrap().onnx;
            let before = proto::model(onnx).unwrap().graph;
            let written = without_fused_products(onnx).unwrap().expect("products");
            let after = proto::model(&written).unwrap().graph;
            let fused = before.nodes.iter().filter(|node| node.operator == FUSED).count();
            assert!(fused > 0 && after.nodes.iter().all(|node| node.operator != FUSED));
            let added = after.nodes.len() - before.nodes.len();
            assert_eq!(added, 2 * fused, "{precision:?}");
            let outputs =
                |graph: &Graph<'_>| graph.nodes.iter().map(|node| node.outputs[0].to_owned()).collect::<Vec<_>>();
            let kept: Vec<_> = outputs(&after).into_iter().filter(|name| !name.starts_with(PREFIX)).collect();
            assert_eq!(kept, outputs(&before), "{precision:?}");
            assert_eq!(without_fused_products(&written).unwrap(), None);
        }
    }
}
