//! Divides float16 products by weights into sums of fewer numbers, for providers that add float16 in float16.
//!
//! The rounding error of a sum of K numbers grows with the square root of K. So the K rows of a matrix are divided into parts, all parts are
//! multiplied as one batch, and their results are added: a sum of K / parts numbers, and one of `parts` numbers.

use std::collections::HashMap;

use super::check::opset;
use super::model_writer::{ValueType, attribute, node, tensor};
use super::proto::{self, Graph, Node};
use super::shape_inference::infer_sizes;
use super::wire::Fields;
use super::writer::{write_bytes, write_int};
use super::{Check, Element, Fault, Shape, quoted};
use crate::Result;

/// Prefix of the names of additional values and constants. `cairn.build` makes no name that begins so.
const PREFIX: &str = "cairn.sum";

/// Fewest rows of a part. Shorter sums gain little: the errors of the other operators are as large.
const LEAST_ROWS: u64 = 64;

/// A product that is divided.
struct Product {
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
/// A part has at least [`LEAST_ROWS`] rows, and twice as many as the activations have: then the results of the parts are no more numbers than
/// the weights, which bounds the additional memory traffic.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks, or whose shapes do not follow from `sizes`.
pub(crate) fn with_partial_sums(onnx: &[u8], sizes: &[(&str, &[usize])]) -> Result<Option<Vec<u8>>> {
    rewrite(onnx, sizes).map_err(Fault::error)
}

fn rewrite(onnx: &[u8], sizes: &[(&str, &[usize])]) -> Check<Option<Vec<u8>>> {
    let model = proto::model(onnx)?;
    let weights = divisible_weights(&model.graph)?;
    if weights.is_empty() {
        return Ok(None);
    }
    let named = |values: &[proto::ValueInfo<'_>]| -> Check<Vec<(String, Shape)>> {
        let shape = |value: &proto::ValueInfo<'_>| {
            let size = sizes.iter().find(|(name, _)| *name == value.name);
            let (_, size) = size.ok_or_else(|| Fault::new(format!("{} has no known size", quoted(value.name))))?;
            let dims = size.iter().map(|&n| n as u64).collect();
            Ok((value.name.to_owned(), Shape { element: Element::of(value.data_type)?, dims }))
        };
        values.iter().map(shape).collect()
    };
    let [inputs, outputs] = [named(&model.graph.inputs)?, named(&model.graph.outputs)?];
    let [inputs, outputs] = [&inputs, &outputs]
        .map(|list| list.iter().map(|(name, shape)| (name.as_str(), shape.clone())).collect::<Vec<_>>());
    let mut products = HashMap::new();
    let mut reader = |node: &Node<'_>, shapes: &[Option<&Shape>], results: &[Shape]| {
        if let (true, [_, weights_name], [Some(left), None], [result]) =
            (node.operator == "MatMul", &node.inputs[..], shapes, results)
            && let Some(dims) = weights.get(weights_name)
            && let Some(product) = Product::of(left, dims, result)
        {
            products.insert(node.outputs[0].to_owned(), product);
        }
    };
    infer_sizes(&model.graph, opset(&model)?, &inputs, &outputs, &mut reader)?;
    if products.is_empty() {
        return Ok(None);
    }
    let mut written = Vec::with_capacity(onnx.len());
    let mut fields = Fields::new("the model", onnx);
    while let Some(field) = fields.next()? {
        match field.number {
            7 => write_bytes(&mut written, 7, &rewrite_graph(&model.graph, &products, field.message("the graph")?)?),
            _ => field.write(&mut written),
        }
    }
    Ok(Some(written))
}

/// Dimensions of the float16 tensors that one node reads, by name.
fn divisible_weights<'a>(graph: &Graph<'a>) -> Check<HashMap<&'a str, Vec<u64>>> {
    let mut uses: HashMap<&str, u32> = HashMap::new();
    graph.nodes.iter().flat_map(|node| &node.inputs).for_each(|name| *uses.entry(name).or_default() += 1);
    let is_read_by_products = |name: &str| {
        uses.get(name) == Some(&1)
            && graph.nodes.iter().any(|node| node.operator == "MatMul" && node.inputs.get(1) == Some(&name))
    };
    let mut found = HashMap::new();
    for tensor in &graph.tensors {
        if Element::of(tensor.data_type)? == Element::F16 && is_read_by_products(tensor.name) {
            found.insert(tensor.name, super::shape_inference::tensor_shape(tensor)?.dims);
        }
    }
    Ok(found)
}

impl Product {
    /// `None` for a product that needs no parts, or that has none of equal size.
    fn of(left: &Shape, weights: &[u64], result: &Shape) -> Option<Self> {
        let ([batch @ .., rows, columns], [leading @ .., _]) = (weights, &left.dims[..]) else { return None };
        // A batch of weights multiplies one matrix.
        if result.element != Element::F16 || batch.len() > 1 || (!batch.is_empty() && leading.len() > 1) {
            return None;
        }
        let tokens: u64 = leading.iter().product();
        let least = LEAST_ROWS.max(2 * tokens);
        let parts = (2..=rows / least).rev().find(|parts| rows.is_multiple_of(*parts))?;
        let result = result.dims.clone();
        Some(Self { batch: batch.to_vec(), parts, rows: rows / parts, columns: *columns, result })
    }

    /// Dimensions of the weights in parts.
    fn weights(&self) -> Vec<u64> {
        [&self.batch[..], &[self.parts, self.rows, self.columns]].concat()
    }

    fn write(&self, graph: &mut Vec<u8>, i: usize, product: &Node<'_>) {
        let name = |what: &str| format!("{PREFIX}.{i}.{what}");
        let mut integers = |what: &str, values: &[i64]| {
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            write_bytes(graph, 5, &tensor(&name(what), ValueType::I64, &[values.len()], &bytes));
        };
        let is_matrix = self.result.len() == self.batch.len() + 2;
        integers("left.size", &[-1, self.parts.cast_signed(), self.rows.cast_signed()]);
        integers("axis", &[self.batch.len() as i64]);
        if !is_matrix {
            integers("size", &self.result.iter().map(|n| n.cast_signed()).collect::<Vec<_>>());
        }
        let sum = if is_matrix { product.outputs[0].to_owned() } else { name("rows") };
        let [columns, left, parts] = ["columns", "left", "parts"].map(name);
        let mut add = |operator: &str, inputs: &[&str], output: &str, attributes: &[Vec<u8>]| {
            write_bytes(graph, 1, &node(operator, output, inputs, &[output], attributes));
        };
        // From [.., tokens, K] to [parts, tokens, rows].
        add("Reshape", &[product.inputs[0], &name("left.size")], &columns, &[]);
        add("Transpose", &[&columns], &left, &[attribute("perm", &[1, 0, 2], true)]);
        add("MatMul", &[&left, product.inputs[1]], &parts, &[]);
        add("ReduceSum", &[&parts, &name("axis")], &sum, &[attribute("keepdims", &[0], false)]);
        if !is_matrix {
            add("Reshape", &[&sum, &name("size")], product.outputs[0], &[]);
        }
    }
}

fn rewrite_graph(graph: &Graph<'_>, products: &HashMap<String, Product>, mut fields: Fields<'_>) -> Check<Vec<u8>> {
    let divided: HashMap<&str, &Product> =
        graph.nodes.iter().filter_map(|node| Some((*node.inputs.get(1)?, products.get(node.outputs[0])?))).collect();
    let (mut written, mut nodes, mut tensors) = (Vec::new(), graph.nodes.iter().enumerate(), graph.tensors.iter());
    while let Some(field) = fields.next()? {
        match field.number {
            1 => match nodes.next().and_then(|(i, node)| Some((i, node, products.get(node.outputs[0])?))) {
                Some((i, node, product)) => product.write(&mut written, i, node),
                None => field.write(&mut written),
            },
            5 => match tensors.next().and_then(|tensor| divided.get(tensor.name)) {
                Some(product) => {
                    write_bytes(&mut written, 5, &with_dims(field.message("an initializer")?, &product.weights())?)
                }
                None => field.write(&mut written),
            },
            _ => field.write(&mut written),
        }
    }
    Ok(written)
}

/// The same tensor with other dimensions.
fn with_dims(mut fields: Fields<'_>, dims: &[u64]) -> Check<Vec<u8>> {
    let mut written = Vec::new();
    dims.iter().for_each(|&n| write_int(&mut written, 1, n));
    while let Some(field) = fields.next()? {
        if field.number != 1 {
            field.write(&mut written);
        }
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use crate::bundle::{Bundle, GraphKind, OpenOptions, Precision};

    /// The shape of `x` times weights, as they are divided.
    fn divided(left: &[u64], weights: &[u64], result: &[u64]) -> Option<Vec<u64>> {
        let shape = |dims: &[u64]| Shape { element: Element::F16, dims: dims.to_vec() };
        Some(Product::of(&shape(left), weights, &shape(result))?.weights())
    }

    #[test]
    fn parts_are_equal_and_their_results_are_no_more_than_the_weights() {
        assert_eq!(divided(&[1, 32, 256], &[256, 512], &[1, 32, 512]), Some(vec![4, 64, 512]));
        assert_eq!(divided(&[8, 256], &[6, 256, 256], &[6, 8, 256]), Some(vec![6, 4, 64, 256]));
        assert_eq!(divided(&[1, 256, 2048], &[2048, 8192], &[1, 256, 8192]), Some(vec![4, 512, 8192]));
        // 259 = 7 * 37.
        assert_eq!(divided(&[1, 259], &[259, 1024], &[1, 1024]), None);
        assert_eq!(divided(&[1, 2048, 2048], &[2048, 2048], &[1, 2048, 2048]), None);
        // A batch of matrices on both sides.
        assert_eq!(divided(&[6, 8, 256], &[6, 256, 256], &[6, 8, 256]), None);
        let wide = Shape { element: Element::F32, dims: vec![1, 4] };
        assert!(Product::of(&Shape { element: Element::F32, dims: vec![1, 256] }, &[256, 4], &wide).is_none());
    }

    #[test]
    fn the_embedded_worlds_products_are_divided_and_all_else_is_kept() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        for precision in Precision::ALL {
            let onnx = bundle.model(GraphKind::Transformer, precision).unwrap().onnx;
            let before = proto::model(onnx).unwrap().graph;
            // The window: a past of two frames.
            let tokens = bundle.manifest().geometry.tokens as usize;
            let size = |value: &proto::ValueInfo<'_>| {
                let dims = value.dims.iter().map(|dim| match dim {
                    proto::Dim::Number(n) => usize::try_from(*n).unwrap(),
                    proto::Dim::Symbol(name) => tokens * if name.ends_with("keys") { 3 } else { 2 },
                    proto::Dim::Unknown => panic!("{}", value.name),
                });
                (value.name.to_owned(), dims.collect::<Vec<_>>())
            };
            let sizes: Vec<_> = before.inputs.iter().chain(&before.outputs).map(size).collect();
            let sizes: Vec<_> = sizes.iter().map(|(name, dims)| (name.as_str(), dims.as_slice())).collect();
            let written = with_partial_sums(onnx, &sizes).unwrap();
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
        let refused = with_partial_sums(onnx, &[]).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::InvalidBundle);
        assert!(refused.cause().contains("no known size"), "{refused}");
    }
}
