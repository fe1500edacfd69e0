//! Split-K: divides float16 products by weights into sums of fewer numbers, for providers that add float16 in float16.
//!
//! The rounding error of a sum of K numbers grows with the square root of K. So the K rows of a matrix are divided into parts, all parts are
//! multiplied as one batch, and their results are added: a sum of K / parts numbers, and one of `parts` numbers.

use std::collections::HashMap;

use super::check::opset;
use super::messages::{GraphProto, TensorProto};
use super::model_writer::{attribute, node, tensor};
use super::proto::{self, Graph, Node};
use super::shape_inference::{Input, infer_sizes, named_shapes, tensor_shape};
use super::wire::Fields;
use super::writer::{reserved, with_graph, write_bytes, write_int};
use super::{CheckResult, DataType, Fault, Shape};
use crate::Result;

/// Prefix of the names of additional values and constants. `cairn.build` makes no name that begins so.
const PREFIX: &str = "cairn.sum";

/// Fewest rows of a part. Shorter sums gain little: the errors of the other operators are as large.
const MIN_ROWS: u64 = 64;

/// A product that is divided.
struct SplitMatMul {
    /// Dimensions of the weights before their rows and columns; empty, or the batch.
    batch: Vec<u64>,
    parts: u64,
    /// Rows of a part.
    rows: u64,
    columns: u64,
    /// Dimensions of the result.
    result: Vec<u64>,
}

/// A checked model in which float16 products by weights are divided into parts; `None` if there are none. `sizes` are the dimensions of its
/// inputs and outputs, by name.
///
/// A part has at least [`MIN_ROWS`] rows, and at least twice as many as the activations: so writing and reading the results of the parts moves no
/// more bytes than the weights.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks, or whose shapes do not follow from `sizes`; `OutOfMemory`.
pub(crate) fn with_split_k(onnx: &[u8], sizes: &[(&str, &[usize])]) -> Result<Option<Vec<u8>>> {
    rewrite(onnx, sizes).map_err(Fault::error)
}

fn rewrite(onnx: &[u8], sizes: &[(&str, &[usize])]) -> CheckResult<Option<Vec<u8>>> {
    let model = proto::model(onnx)?;
    let weights = single_use_matmul_weights(&model.graph)?;
    if weights.is_empty() {
        return Ok(None);
    }
    let [inputs, outputs] = [&model.graph.inputs, &model.graph.outputs].map(|values| named_shapes(values, sizes));
    let (inputs, outputs) = (inputs?, outputs?);
    let mut products = Splits::new();
    products.try_reserve(weights.len()).map_err(Fault::no_memory)?;
    let mut visitor = |node: &Node<'_>, inputs: &[Input<'_>], results: &[Shape]| {
        if let (true, [_, name], [Input { shape: left, is_constant: false }, _], [result]) =
            (node.operator == "MatMul", &node.inputs[..], inputs, results)
            && let Some((&name, dims)) = weights.get_key_value::<str>(name)
            && let Some(product) = SplitMatMul::of(left, dims, result)
        {
            // One node reads these weights.
            products.insert(name, product);
        }
    };
    infer_sizes(&model.graph, opset(&model)?, &inputs, &outputs, &mut visitor)?;
    if products.is_empty() {
        return Ok(None);
    }
    let split = model.graph.nodes.iter().filter(|node| split_of(&products, node).is_some());
    let bytes = onnx.len() + split.map(Node::replacement_bytes).sum::<usize>();
    let rewrite =
        |fields: &[u8]| rewrite_graph(&model.graph, &products, Fields::new("the graph", fields), reserved(bytes)?);
    with_graph(onnx, bytes, rewrite).map(Some)
}

/// The products that are divided, by the names of their weights.
type Splits<'a> = HashMap<&'a str, SplitMatMul>;

/// How the product of a node is divided.
fn split_of<'p>(products: &'p Splits<'_>, node: &Node<'_>) -> Option<&'p SplitMatMul> {
    products.get(*node.inputs.get(1)?)
}

/// Dimensions of the float16 initializers that are read once, as the right operand of a `MatMul`, by name.
fn single_use_matmul_weights<'a>(graph: &Graph<'a>) -> CheckResult<HashMap<&'a str, Vec<u64>>> {
    let mut found = HashMap::new();
    found.try_reserve(graph.tensors.len()).map_err(Fault::no_memory)?;
    for tensor in &graph.tensors {
        if DataType::of(tensor.data_type)? == DataType::F16 {
            found.insert(tensor.name, (tensor_shape(tensor)?.dims, 0_u32));
        }
    }
    for node in &graph.nodes {
        for (i, name) in node.inputs.iter().enumerate() {
            if let Some((_, uses)) = found.get_mut(name) {
                // Any other use counts twice.
                *uses += if node.operator == "MatMul" && i == 1 { 1 } else { 2 };
            }
        }
    }
    Ok(found.into_iter().filter(|(_, (_, uses))| *uses == 1).map(|(name, (dims, _))| (name, dims)).collect())
}

impl SplitMatMul {
    /// `None` for a product that needs no parts, or that has none of equal size.
    fn of(left: &Shape, weights: &[u64], result: &Shape) -> Option<Self> {
        let ([batch @ .., rows, columns], [leading @ .., _]) = (weights, &left.dims[..]) else { return None };
        // Batched weights are split only if the left operand is one matrix, and there is one dimension of batches.
        if result.element != DataType::F16 || batch.len() > 1 || (!batch.is_empty() && leading.len() > 1) {
            return None;
        }
        let tokens: u64 = leading.iter().product();
        let least = MIN_ROWS.max(2 * tokens);
        let parts = (2..=rows / least).rev().find(|parts| rows.is_multiple_of(*parts))?;
        let result = result.dims.clone();
        Some(Self { batch: batch.to_vec(), parts, rows: rows / parts, columns: *columns, result })
    }

    /// Dimensions of the weights in parts.
    fn weights(&self) -> Vec<u64> {
        [&self.batch[..], &[self.parts, self.rows, self.columns]].concat()
    }

    /// Writes the nodes and constants that replace `product`, node `i` of the graph.
    fn write_nodes(&self, graph: &mut Vec<u8>, i: usize, product: &Node<'_>) {
        let name = |what: &str| format!("{PREFIX}.{i}.{what}");
        let mut integers = |what: &str, values: &[i64]| {
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            write_bytes(graph, GraphProto::INITIALIZER, &tensor(&name(what), DataType::I64, &[values.len()], &bytes));
        };
        let is_matrix = self.result.len() == self.batch.len() + 2;
        integers("left.size", &[-1, self.parts.cast_signed(), self.rows.cast_signed()]);
        integers("axis", &[self.batch.len() as i64]);
        if !is_matrix {
            integers("size", &self.result.iter().map(|n| n.cast_signed()).collect::<Vec<_>>());
        }
        let sum = if is_matrix { product.outputs[0].to_owned() } else { name("rows") };
        let [left_parts, left, parts] = ["left.parts", "left", "parts"].map(name);
        let mut add = |operator: &str, inputs: &[&str], output: &str, attributes: &[Vec<u8>]| {
            write_bytes(graph, GraphProto::NODE, &node(operator, output, inputs, &[output], attributes));
        };
        // From [.., tokens, K] to [parts, tokens, rows].
        add("Reshape", &[product.inputs[0], &name("left.size")], &left_parts, &[]);
        add("Transpose", &[&left_parts], &left, &[attribute("perm", &[1, 0, 2], true)]);
        add("MatMul", &[&left, product.inputs[1]], &parts, &[]);
        add("ReduceSum", &[&parts, &name("axis")], &sum, &[attribute("keepdims", &[0], false)]);
        if !is_matrix {
            add("Reshape", &[&sum, &name("size")], product.outputs[0], &[]);
        }
    }
}

/// Writes the graph into `written`.
fn rewrite_graph(
    graph: &Graph<'_>,
    products: &Splits<'_>,
    mut fields: Fields<'_>,
    mut written: Vec<u8>,
) -> CheckResult<Vec<u8>> {
    let (mut nodes, mut tensors) = (graph.nodes.iter().enumerate(), graph.tensors.iter());
    while let Some(field) = fields.next()? {
        match field.number {
            GraphProto::NODE => match nodes.next().and_then(|(i, node)| Some((i, node, split_of(products, node)?))) {
                Some((i, node, product)) => product.write_nodes(&mut written, i, node),
                None => field.write(&mut written),
            },
            GraphProto::INITIALIZER => match tensors.next().and_then(|tensor| products.get(tensor.name)) {
                Some(product) => {
                    let tensor = with_dims(field.message("an initializer")?, &product.weights())?;
                    write_bytes(&mut written, GraphProto::INITIALIZER, &tensor);
                }
                None => field.write(&mut written),
            },
            _ => field.write(&mut written),
        }
    }
    Ok(written)
}

/// The same tensor with other dimensions.
fn with_dims(mut fields: Fields<'_>, dims: &[u64]) -> CheckResult<Vec<u8>> {
    let mut written = Vec::new();
    dims.iter().for_each(|&n| write_int(&mut written, TensorProto::DIMS, n));
    while let Some(field) = fields.next()? {
        if field.number != TensorProto::DIMS {
            field.write(&mut written);
        }
    }
    Ok(written)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::proto::ValueInfo;
    use super::*;
    use crate::ErrorKind;
    use crate::bundle::{Bundle, GraphKind, OpenOptions, Precision};

    /// The shape of `x` times weights, as they are divided.
    fn weights_in_parts(left: &[u64], weights: &[u64], result: &[u64]) -> Option<Vec<u64>> {
        let shape = |dims: &[u64]| Shape { element: DataType::F16, dims: dims.to_vec() };
        Some(SplitMatMul::of(&shape(left), weights, &shape(result))?.weights())
    }

    #[test]
    fn parts_are_equal_and_their_results_are_no_more_than_the_weights() {
        assert_eq!(weights_in_parts(&[1, 32, 256], &[256, 512], &[1, 32, 512]), Some(vec![4, 64, 512]));
        assert_eq!(weights_in_parts(&[8, 256], &[6, 256, 256], &[6, 8, 256]), Some(vec![6, 4, 64, 256]));
        assert_eq!(weights_in_parts(&[1, 256, 2048], &[2048, 8192], &[1, 256, 8192]), Some(vec![4, 512, 8192]));
        // 259 = 7 * 37.
        assert_eq!(weights_in_parts(&[1, 259], &[259, 1024], &[1, 1024]), None);
        assert_eq!(weights_in_parts(&[1, 2048, 2048], &[2048, 2048], &[1, 2048, 2048]), None);
        // A batch of matrices on both sides.
        assert_eq!(weights_in_parts(&[6, 8, 256], &[6, 256, 256], &[6, 8, 256]), None);
        let wide = Shape { element: DataType::F32, dims: vec![1, 4] };
        assert!(SplitMatMul::of(&Shape { element: DataType::F32, dims: vec![1, 256] }, &[256, 4], &wide).is_none());
    }

    /// Calls `with` with the sizes of a transformer's inputs and outputs, for a past of two latents.
    pub(in super::super) fn with_sizes<T>(
        graph: &Graph<'_>,
        tokens: usize,
        with: impl Fn(&[(&str, &[usize])]) -> T,
    ) -> T {
        let dims_of = |value: &ValueInfo<'_>| -> Vec<usize> {
            let dims = value.dims.iter().map(|dim| match dim {
                proto::Dim::Number(n) => usize::try_from(*n).unwrap(),
                proto::Dim::Symbol(name) => tokens * if name.ends_with("keys") { 3 } else { 2 },
                proto::Dim::Unknown => panic!("{}", value.name),
            });
            dims.collect()
        };
        let values = || graph.inputs.iter().chain(&graph.outputs);
        let sizes: Vec<_> = values().map(dims_of).collect();
        with(&values().zip(&sizes).map(|(value, dims)| (value.name, dims.as_slice())).collect::<Vec<_>>())
    }

    #[test]
    fn the_embedded_worlds_products_are_divided_and_all_else_is_kept() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        for precision in Precision::ALL {
            let onnx = bundle.model(GraphKind::Transformer, precision).unwrap().onnx;
            let before = proto::model(onnx).unwrap().graph;
            let tokens = bundle.manifest().geometry.tokens as usize;
            let written = with_sizes(&before, tokens, |sizes| with_split_k(onnx, sizes)).unwrap();
            assert_eq!(written.is_some(), precision == Precision::F16);
            let Some(written) = written else { continue };
            let after = proto::model(&written).unwrap().graph;
            let sums = after.nodes.iter().filter(|node| node.operator == "ReduceSum").count();
            let count = |graph: &Graph<'_>| graph.nodes.iter().filter(|node| node.operator == "MatMul").count();
            assert!(sums >= 40 && count(&before) == count(&after), "{sums} of {} products", count(&before));
            for (tensor, divided) in
                before.tensors.iter().zip(after.tensors.iter().filter(|t| !t.name.starts_with(PREFIX)))
            {
                assert_eq!(tensor.name, divided.name);
                assert_eq!(
                    tensor.dims.iter().product::<i64>(),
                    divided.dims.iter().product::<i64>(),
                    "{}",
                    tensor.name
                );
            }
            let made = |graph: &Graph<'_>| {
                let names = graph.nodes.iter().flat_map(|node| &node.outputs).map(|name| (*name).to_owned());
                names.filter(|name| !name.starts_with(PREFIX)).collect::<Vec<_>>()
            };
            assert_eq!(made(&before), made(&after), "every value is made, in the same order");
        }
    }

    #[test]
    fn sizes_that_are_unknown_or_impossible_are_refused() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        let onnx = bundle.model(GraphKind::Transformer, Precision::F16).unwrap().onnx;
        let refused = with_split_k(onnx, &[]).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::InvalidBundle);
        assert!(refused.cause().contains("no known size"), "{refused}");
    }
}
