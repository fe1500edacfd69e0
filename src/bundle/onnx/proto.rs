//! Parser of the ONNX messages that a bundle may contain.
//!
//! Unknown fields are refused, so the runtime gets nothing that was not checked here.

use super::messages::{
    AttributeProto, DimensionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, attribute_type, data_location,
};
use super::wire::{Field, Fields};
use super::{CheckResult, Fault, quoted};

/// The longest name of a value, node, graph or dimension, in bytes.
const MAX_TEXT: usize = 512;
/// The longest documentation string, in bytes.
const MAX_DOC: usize = 1 << 16;
const MAX_NODES: usize = 1 << 16;
const MAX_TENSORS: usize = 1 << 14;
const MAX_VALUES: usize = 1 << 17;
/// The most inputs, or outputs, of a node or a graph.
const MAX_ARITY: usize = 4096;
const MAX_ATTRIBUTES: usize = 16;
const MAX_INTS: usize = 64;
/// The highest rank of a tensor.
pub(super) const MAX_RANK: usize = 8;
/// The domain of ONNX Runtime's own operators.
pub(super) const CONTRIB: &str = "com.microsoft";

pub(super) struct Model<'a> {
    pub(super) ir_version: i64,
    /// Domain and version.
    pub(super) opsets: Vec<(&'a str, i64)>,
    pub(super) graph: Graph<'a>,
}

#[derive(Default)]
pub(super) struct Graph<'a> {
    pub(super) nodes: Vec<Node<'a>>,
    pub(super) tensors: Vec<Tensor<'a>>,
    pub(super) inputs: Vec<ValueInfo<'a>>,
    pub(super) outputs: Vec<ValueInfo<'a>>,
    pub(super) value_info: Vec<ValueInfo<'a>>,
}

#[derive(Default)]
pub(super) struct Node<'a> {
    pub(super) name: &'a str,
    pub(super) operator: &'a str,
    /// Whether it is of ONNX Runtime's domain, [`CONTRIB`], and not of the default one.
    pub(super) is_contrib: bool,
    pub(super) inputs: Vec<&'a str>,
    pub(super) outputs: Vec<&'a str>,
    pub(super) attributes: Vec<(&'a str, Attribute<'a>)>,
}

impl Node<'_> {
    /// Most bytes that a few nodes in its place and their constants take, in a model that is rewritten.
    pub(super) fn replacement_bytes(&self) -> usize {
        2048 + 4 * self.inputs.iter().chain(&self.outputs).chain([&self.name]).map(|name| name.len()).sum::<usize>()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Attribute<'a> {
    Float(f32),
    Int(i64),
    Text(&'a str),
    Ints(Vec<i64>),
}

pub(super) struct Tensor<'a> {
    pub(super) name: &'a str,
    pub(super) dims: Vec<i64>,
    pub(super) data_type: i64,
    pub(super) data: Data<'a>,
}

/// Location of a tensor's elements.
pub(super) enum Data<'a> {
    Inline(&'a [u8]),
    External { location: &'a str, offset: u64, length: u64 },
}

pub(super) struct ValueInfo<'a> {
    pub(super) name: &'a str,
    pub(super) data_type: i64,
    pub(super) dims: Vec<Dim<'a>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dim<'a> {
    Number(i64),
    Symbol(&'a str),
    Unknown,
}

/// Appends to a list of at most `most` entries.
fn push<T>(field: &Field<'_>, list: &mut Vec<T>, most: usize, value: T) -> CheckResult<()> {
    if list.len() >= most {
        return Err(field.fault(format!("comes more than {most} times")));
    }
    list.try_reserve(1).map_err(Fault::no_memory)?;
    list.push(value);
    Ok(())
}

pub(super) fn model(bytes: &[u8]) -> CheckResult<Model<'_>> {
    let (mut ir_version, mut graph_found, mut opsets) = (None, None, Vec::new());
    let (mut producer, mut producer_version, mut domain, mut version, mut doc) = (None, None, None, None, None);
    let mut fields = Fields::new("the model", bytes);
    while let Some(f) = fields.next()? {
        match f.number {
            ModelProto::IR_VERSION => f.once(&mut ir_version, f.int()?)?,
            ModelProto::PRODUCER_NAME => f.once(&mut producer, f.text(MAX_TEXT)?)?,
            ModelProto::PRODUCER_VERSION => f.once(&mut producer_version, f.text(MAX_TEXT)?)?,
            ModelProto::DOMAIN => f.once(&mut domain, f.text(MAX_TEXT)?)?,
            ModelProto::MODEL_VERSION => f.once(&mut version, f.int()?)?,
            ModelProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            ModelProto::GRAPH => f.once(&mut graph_found, graph(f.message("the graph")?)?)?,
            ModelProto::OPSET_IMPORT => push(&f, &mut opsets, 8, opset(f.message("an opset")?)?)?,
            ModelProto::METADATA_PROPS => f.refuse("metadata")?,
            ModelProto::TRAINING_INFO => f.refuse("training information")?,
            ModelProto::FUNCTIONS => f.refuse("functions")?,
            _ => f.refuse("an unknown part of a model")?,
        }
    }
    Ok(Model {
        ir_version: ir_version.ok_or_else(|| Fault::new("the model has no IR version"))?,
        opsets,
        graph: graph_found.ok_or_else(|| Fault::new("the model has no graph"))?,
    })
}

fn opset<'a>(mut fields: Fields<'a>) -> CheckResult<(&'a str, i64)> {
    let (mut domain, mut version) = (None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            OperatorSetIdProto::DOMAIN => f.once(&mut domain, f.text(MAX_TEXT)?)?,
            OperatorSetIdProto::VERSION => f.once(&mut version, f.int()?)?,
            _ => f.refuse("an unknown part of an opset")?,
        }
    }
    Ok((domain.unwrap_or(""), version.unwrap_or(0)))
}

fn graph<'a>(mut fields: Fields<'a>) -> CheckResult<Graph<'a>> {
    let mut graph = Graph::default();
    let (mut name, mut doc) = (None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            GraphProto::NODE => push(&f, &mut graph.nodes, MAX_NODES, node(f.message("a node")?)?)?,
            GraphProto::NAME => f.once(&mut name, f.text(MAX_TEXT)?)?,
            GraphProto::INITIALIZER => {
                push(&f, &mut graph.tensors, MAX_TENSORS, tensor(f.message("an initializer")?)?)?
            }
            GraphProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            GraphProto::INPUT => push(&f, &mut graph.inputs, MAX_ARITY, value_info(f.message("an input")?)?)?,
            GraphProto::OUTPUT => push(&f, &mut graph.outputs, MAX_ARITY, value_info(f.message("an output")?)?)?,
            GraphProto::VALUE_INFO => {
                push(&f, &mut graph.value_info, MAX_VALUES, value_info(f.message("a value's type")?)?)?
            }
            GraphProto::SPARSE_INITIALIZER => f.refuse("a sparse initializer")?,
            _ => f.refuse("an unknown part of a graph")?,
        }
    }
    Ok(graph)
}

fn node<'a>(mut fields: Fields<'a>) -> CheckResult<Node<'a>> {
    let mut node = Node::default();
    let (mut name, mut operator, mut doc, mut domain) = (None, None, None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            NodeProto::INPUT => push(&f, &mut node.inputs, MAX_ARITY, f.text(MAX_TEXT)?)?,
            NodeProto::OUTPUT => push(&f, &mut node.outputs, MAX_ARITY, f.text(MAX_TEXT)?)?,
            NodeProto::NAME => f.once(&mut name, f.text(MAX_TEXT)?)?,
            NodeProto::OP_TYPE => f.once(&mut operator, f.text(MAX_TEXT)?)?,
            NodeProto::ATTRIBUTE => {
                push(&f, &mut node.attributes, MAX_ATTRIBUTES, attribute(f.message("an attribute")?)?)?
            }
            NodeProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            NodeProto::DOMAIN => f.once(&mut domain, f.text(MAX_TEXT)?)?,
            _ => f.refuse("an unknown part of a node")?,
        }
    }
    node.name = name.unwrap_or("");
    node.operator = operator.unwrap_or("");
    match domain.unwrap_or("") {
        "" | "ai.onnx" => Ok(node),
        CONTRIB => {
            node.is_contrib = true;
            Ok(node)
        }
        other => Err(Fault::new(format!("node {} is of the custom domain {}", quoted(node.name), quoted(other)))),
    }
}

fn attribute<'a>(mut fields: Fields<'a>) -> CheckResult<(&'a str, Attribute<'a>)> {
    let (mut name, mut kind, mut float, mut int, mut text, mut doc) = (None, None, None, None, None, None);
    let mut ints = Vec::new();
    while let Some(f) = fields.next()? {
        match f.number {
            AttributeProto::NAME => f.once(&mut name, f.text(MAX_TEXT)?)?,
            AttributeProto::F => f.once(&mut float, f.float()?)?,
            AttributeProto::I => f.once(&mut int, f.int()?)?,
            AttributeProto::S => f.once(&mut text, f.text(MAX_TEXT)?)?,
            AttributeProto::G | AttributeProto::GRAPHS => f.refuse("a subgraph: control flow")?,
            AttributeProto::INTS => f.ints(&mut ints, MAX_INTS)?,
            AttributeProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            AttributeProto::TYPE => f.once(&mut kind, f.int()?)?,
            AttributeProto::REF_ATTR_NAME => f.refuse("a reference to a function's attribute")?,
            _ => f.refuse("a kind of attribute that no allowed operator has")?,
        }
    }
    let name = name.unwrap_or("");
    let fault = || Fault::new(format!("attribute {} does not hold exactly one value of its type", quoted(name)));
    let given = [float.is_some(), int.is_some(), text.is_some(), !ints.is_empty()];
    // A 0, an empty string and an empty list may be omitted from the file.
    let alone = |own: usize| (0..given.len()).all(|i| i == own || !given[i]);
    let (own, value) = match kind {
        Some(attribute_type::FLOAT) => (0, Attribute::Float(float.unwrap_or(0.0))),
        Some(attribute_type::INT) => (1, Attribute::Int(int.unwrap_or(0))),
        Some(attribute_type::STRING) => (2, Attribute::Text(text.unwrap_or(""))),
        Some(attribute_type::INTS) => (3, Attribute::Ints(ints)),
        _ => return Err(fault()),
    };
    if alone(own) { Ok((name, value)) } else { Err(fault()) }
}

fn tensor<'a>(mut fields: Fields<'a>) -> CheckResult<Tensor<'a>> {
    let (mut name, mut data_type, mut raw, mut storage, mut doc) = (None, None, None, None, None);
    let (mut dims, mut external) = (Vec::new(), Vec::new());
    while let Some(f) = fields.next()? {
        match f.number {
            TensorProto::DIMS => f.ints(&mut dims, MAX_RANK)?,
            TensorProto::DATA_TYPE => f.once(&mut data_type, f.int()?)?,
            TensorProto::NAME => f.once(&mut name, f.text(MAX_TEXT)?)?,
            TensorProto::RAW_DATA => f.once(&mut raw, f.bytes()?)?,
            TensorProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            TensorProto::EXTERNAL_DATA => push(&f, &mut external, 8, entry(f.message("an entry of external data")?)?)?,
            TensorProto::DATA_LOCATION => f.once(&mut storage, f.int()?)?,
            TensorProto::FLOAT_DATA..=TensorProto::INT64_DATA | TensorProto::DOUBLE_DATA | TensorProto::UINT64_DATA => {
                f.refuse("numbers outside `raw_data`")?
            }
            _ => f.refuse("an unknown part of a tensor")?,
        }
    }
    let name = name.unwrap_or("");
    let data = match (storage.unwrap_or(data_location::DEFAULT), raw, external.is_empty()) {
        (data_location::DEFAULT, Some(bytes), true) => Data::Inline(bytes),
        (data_location::EXTERNAL, None, false) => external_data(name, &external)?,
        _ => return Err(Fault::new(format!("initializer {} is neither inside the model nor external", quoted(name)))),
    };
    let data_type = data_type.ok_or_else(|| Fault::new(format!("initializer {} has no type", quoted(name))))?;
    Ok(Tensor { name, dims, data_type, data })
}

fn external_data<'a>(tensor: &str, entries: &[(&'a str, &'a str)]) -> CheckResult<Data<'a>> {
    let fault = |cause: &str| Fault::new(format!("initializer {}: its external data {cause}", quoted(tensor)));
    let (mut location, mut offset, mut length) = (None, None, None);
    for &(key, value) in entries {
        let slot = match key {
            "location" => &mut location,
            "offset" => &mut offset,
            "length" => &mut length,
            _ => return Err(fault("has an entry beside `location`, `offset` and `length`")),
        };
        if slot.replace(value).is_some() {
            return Err(fault("has an entry twice"));
        }
    }
    // Decimal digits only: readers differ on signs, spaces and hexadecimal.
    let number = |text: Option<&str>| {
        let digits = text.filter(|t| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit()));
        digits.and_then(|t| t.parse::<u64>().ok()).ok_or_else(|| fault("has no `offset` or `length` in decimal digits"))
    };
    Ok(Data::External {
        location: location.ok_or_else(|| fault("has no `location`"))?,
        offset: number(offset)?,
        length: number(length)?,
    })
}

fn entry<'a>(mut fields: Fields<'a>) -> CheckResult<(&'a str, &'a str)> {
    let (mut key, mut value) = (None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            StringStringEntryProto::KEY => f.once(&mut key, f.text(MAX_TEXT)?)?,
            StringStringEntryProto::VALUE => f.once(&mut value, f.text(MAX_TEXT)?)?,
            _ => f.refuse("an unknown part of an entry")?,
        }
    }
    Ok((key.unwrap_or(""), value.unwrap_or("")))
}

fn value_info<'a>(mut fields: Fields<'a>) -> CheckResult<ValueInfo<'a>> {
    let (mut name, mut kind, mut doc) = (None, None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            ValueInfoProto::NAME => f.once(&mut name, f.text(MAX_TEXT)?)?,
            ValueInfoProto::TYPE => f.once(&mut kind, type_proto(f.message("a type")?)?)?,
            ValueInfoProto::DOC_STRING => f.once(&mut doc, f.text(MAX_DOC)?)?,
            _ => f.refuse("an unknown part of a value")?,
        }
    }
    let name = name.unwrap_or("");
    let (data_type, dims) = kind.ok_or_else(|| Fault::new(format!("value {} has no type", quoted(name))))?;
    Ok(ValueInfo { name, data_type, dims })
}

fn type_proto<'a>(mut fields: Fields<'a>) -> CheckResult<(i64, Vec<Dim<'a>>)> {
    let mut tensor = None;
    while let Some(f) = fields.next()? {
        match f.number {
            TypeProto::TENSOR_TYPE => f.once(&mut tensor, tensor_type(f.message("a tensor's type")?)?)?,
            _ => f.refuse("a type other than a tensor's")?,
        }
    }
    tensor.ok_or_else(|| Fault::new("a type is not a tensor's"))
}

fn tensor_type<'a>(mut fields: Fields<'a>) -> CheckResult<(i64, Vec<Dim<'a>>)> {
    let (mut element, mut shape) = (None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            TensorTypeProto::ELEM_TYPE => f.once(&mut element, f.int()?)?,
            TensorTypeProto::SHAPE => f.once(&mut shape, dims(f.message("a shape")?)?)?,
            _ => f.refuse("an unknown part of a tensor's type")?,
        }
    }
    match (element, shape) {
        (Some(element), Some(shape)) => Ok((element, shape)),
        _ => Err(Fault::new("a tensor's type lacks its element type or its shape")),
    }
}

fn dims<'a>(mut fields: Fields<'a>) -> CheckResult<Vec<Dim<'a>>> {
    let mut list = Vec::new();
    while let Some(f) = fields.next()? {
        match f.number {
            TensorShapeProto::DIM => push(&f, &mut list, MAX_RANK, dim(f.message("a dimension")?)?)?,
            _ => f.refuse("an unknown part of a shape")?,
        }
    }
    Ok(list)
}

fn dim<'a>(mut fields: Fields<'a>) -> CheckResult<Dim<'a>> {
    let (mut dim, mut meaning) = (None, None);
    while let Some(f) = fields.next()? {
        match f.number {
            DimensionProto::DIM_VALUE => f.once(&mut dim, Dim::Number(f.int()?))?,
            DimensionProto::DIM_PARAM => f.once(&mut dim, Dim::Symbol(f.text(MAX_TEXT)?))?,
            DimensionProto::DENOTATION => f.once(&mut meaning, f.text(MAX_TEXT)?)?,
            _ => f.refuse("an unknown part of a dimension")?,
        }
    }
    Ok(dim.unwrap_or(Dim::Unknown))
}
