//! Writes small models: those that move and check values on a device.

use super::DataType;
use super::messages::{
    AttributeProto, DimensionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, TensorProto,
    TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, attribute_type,
};
use super::writer::{write_bytes, write_int};

/// A type of a constant's elements.
pub(crate) trait Number: Copy {
    const TYPE: DataType;

    /// Its bytes in a model: little-endian.
    fn to_bytes(self) -> impl IntoIterator<Item = u8>;
}

macro_rules! numbers {
    ($($number:ty => $value_type:ident),*) => {$(
        impl Number for $number {
            const TYPE: DataType = DataType::$value_type;

            fn to_bytes(self) -> impl IntoIterator<Item = u8> {
                self.to_le_bytes()
            }
        }
    )*};
}

numbers!(i32 => I32, i64 => I64, f32 => F32);

/// Version of the operators: one that ONNX Runtime has from 1.24 on, on every provider.
const OPSET: u64 = 21;
/// Version of the file format that belongs to it.
const IR_VERSION: u64 = 10;

/// A model that is being written. Names must be unique; nodes stand in the order in which they run.
#[derive(Default)]
pub(crate) struct ModelWriter {
    /// The fields of the `GraphProto`. Their order is free.
    graph: Vec<u8>,
}

impl ModelWriter {
    pub(crate) fn input(&mut self, name: &str, element: DataType, dims: &[usize]) {
        write_bytes(&mut self.graph, GraphProto::INPUT, &value_info(name, element, dims));
    }

    pub(crate) fn output(&mut self, name: &str, element: DataType, dims: &[usize]) {
        write_bytes(&mut self.graph, GraphProto::OUTPUT, &value_info(name, element, dims));
    }

    /// A constant of shape `dims`.
    pub(crate) fn constant<T: Number>(&mut self, name: &str, dims: &[usize], values: &[T]) {
        assert_eq!(values.len(), dims.iter().product::<usize>(), "{name}: one number for each element");
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_bytes()).collect();
        write_bytes(&mut self.graph, GraphProto::INITIALIZER, &tensor(name, T::TYPE, dims, &bytes));
    }

    /// A node of ONNX's own operators, with attributes that are integers.
    pub(crate) fn node(&mut self, operator: &str, inputs: &[&str], outputs: &[&str], attributes: &[(&str, i64)]) {
        let attributes: Vec<_> = attributes.iter().map(|(name, value)| attribute(name, &[*value], false)).collect();
        write_bytes(&mut self.graph, GraphProto::NODE, &node(operator, outputs[0], inputs, outputs, &attributes));
    }

    /// The model.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        write_bytes(&mut self.graph, GraphProto::NAME, b"cairn");
        let (mut opset, mut model) = (Vec::new(), Vec::new());
        write_int(&mut opset, OperatorSetIdProto::VERSION, OPSET);
        write_int(&mut model, ModelProto::IR_VERSION, IR_VERSION);
        write_bytes(&mut model, ModelProto::OPSET_IMPORT, &opset);
        write_bytes(&mut model, ModelProto::GRAPH, &self.graph);
        model
    }
}

/// `NodeProto`, with attributes that were written before.
pub(super) fn node(operator: &str, name: &str, inputs: &[&str], outputs: &[&str], attributes: &[Vec<u8>]) -> Vec<u8> {
    let mut node = Vec::new();
    inputs.iter().for_each(|input| write_bytes(&mut node, NodeProto::INPUT, input.as_bytes()));
    outputs.iter().for_each(|output| write_bytes(&mut node, NodeProto::OUTPUT, output.as_bytes()));
    write_bytes(&mut node, NodeProto::NAME, name.as_bytes());
    write_bytes(&mut node, NodeProto::OP_TYPE, operator.as_bytes());
    attributes.iter().for_each(|attribute| write_bytes(&mut node, NodeProto::ATTRIBUTE, attribute));
    node
}

/// `AttributeProto`: a list of integers, or one integer.
pub(super) fn attribute(name: &str, values: &[i64], is_list: bool) -> Vec<u8> {
    let mut attribute = Vec::new();
    write_bytes(&mut attribute, AttributeProto::NAME, name.as_bytes());
    let (field, kind) =
        if is_list { (AttributeProto::INTS, attribute_type::INTS) } else { (AttributeProto::I, attribute_type::INT) };
    values.iter().for_each(|value| write_int(&mut attribute, field, value.cast_unsigned()));
    write_int(&mut attribute, AttributeProto::TYPE, kind.cast_unsigned());
    attribute
}

/// `TensorProto` with its elements in little-endian bytes.
pub(super) fn tensor(name: &str, element: DataType, dims: &[usize], bytes: &[u8]) -> Vec<u8> {
    let mut tensor = Vec::new();
    dims.iter().for_each(|&n| write_int(&mut tensor, TensorProto::DIMS, n as u64));
    write_int(&mut tensor, TensorProto::DATA_TYPE, element as u64);
    write_bytes(&mut tensor, TensorProto::NAME, name.as_bytes());
    write_bytes(&mut tensor, TensorProto::RAW_DATA, bytes);
    tensor
}

/// `ValueInfoProto`, with its `TypeProto`, `TypeProto.Tensor` and `TensorShapeProto`.
pub(super) fn value_info(name: &str, element: DataType, dims: &[usize]) -> Vec<u8> {
    let (mut shape, mut tensor, mut kind, mut value) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for &n in dims {
        let mut dimension = Vec::new();
        write_int(&mut dimension, DimensionProto::DIM_VALUE, n as u64);
        write_bytes(&mut shape, TensorShapeProto::DIM, &dimension);
    }
    write_int(&mut tensor, TensorTypeProto::ELEM_TYPE, element as u64);
    write_bytes(&mut tensor, TensorTypeProto::SHAPE, &shape);
    write_bytes(&mut kind, TypeProto::TENSOR_TYPE, &tensor);
    write_bytes(&mut value, ValueInfoProto::NAME, name.as_bytes());
    write_bytes(&mut value, ValueInfoProto::TYPE, &kind);
    value
}

#[cfg(test)]
mod tests {
    use super::super::proto::{self, Attribute, Data};
    use super::*;

    #[test]
    fn a_written_model_is_read_back() {
        let mut model = ModelWriter::default();
        model.input("x", DataType::F32, &[2, 3]);
        model.constant("two", &[2], &[2, -2]);
        model.node("Mul", &["x", "two"], &["doubled"], &[]);
        model.node("ReduceMax", &["doubled"], &["y"], &[("keepdims", 0)]);
        model.output("y", DataType::F32, &[]);
        let written = model.finish();
        let read = proto::model(&written).unwrap();
        assert_eq!((read.ir_version, read.opsets), (10, vec![("", 21)]));
        let graph = read.graph;
        assert_eq!(graph.nodes.iter().map(|node| node.operator).collect::<Vec<_>>(), ["Mul", "ReduceMax"]);
        assert_eq!(graph.nodes[1].attributes, [("keepdims", Attribute::Int(0))]);
        assert_eq!((graph.inputs[0].name, graph.inputs[0].data_type, graph.outputs[0].name), ("x", 1, "y"));
        let Data::Inline(bytes) = graph.tensors[0].data else { panic!("bytes of a constant") };
        assert_eq!((&*graph.tensors[0].dims, bytes), (&[2][..], &[2, 0, 0, 0, 254, 255, 255, 255][..]));
    }
}
