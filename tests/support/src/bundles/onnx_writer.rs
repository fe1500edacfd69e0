//! Writes ONNX models field by field, including invalid ones.

/// A protobuf message, as the bytes of its fields so far.
#[derive(Default, Clone)]
pub struct Message(pub Vec<u8>);

impl Message {
    fn raw_varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    /// Adds a varint field.
    pub fn int(mut self, field: u32, value: i64) -> Self {
        self.raw_varint(u64::from(field) << 3);
        self.raw_varint(value as u64);
        self
    }

    /// Adds a 32-bit float field.
    pub fn float(mut self, field: u32, value: f32) -> Self {
        self.raw_varint(u64::from(field) << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Adds a field of bytes.
    pub fn bytes(mut self, field: u32, bytes: impl AsRef<[u8]>) -> Self {
        self.raw_varint(u64::from(field) << 3 | 2);
        self.raw_varint(bytes.as_ref().len() as u64);
        self.0.extend(bytes.as_ref());
        self
    }

    /// Adds a message as a field.
    pub fn message(self, field: u32, message: Self) -> Self {
        self.bytes(field, message.0)
    }

    /// Appends bytes, which need not form a field.
    pub fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    /// Adds fields for each of `items`.
    pub fn fold<T>(self, items: &[T], add: impl Fn(Self, &T) -> Self) -> Self {
        items.iter().fold(self, add)
    }
}

/// ONNX's number of the type `FLOAT`.
pub const F32: i64 = 1;
/// ONNX's number of the type `UINT8`.
pub const U8: i64 = 2;
/// ONNX's number of the type `INT64`.
pub const I64: i64 = 7;
/// ONNX's number of the type `FLOAT16`.
pub const F16: i64 = 10;

/// A model with its graph.
#[derive(Clone)]
pub struct Model {
    /// Version of the file format.
    pub ir_version: i64,
    /// Operator sets: domain and version.
    pub opsets: Vec<(String, i64)>,
    /// The graph's nodes.
    pub nodes: Vec<Node>,
    /// The graph's initializers.
    pub tensors: Vec<Tensor>,
    /// The graph's inputs.
    pub inputs: Vec<Value>,
    /// The graph's outputs.
    pub outputs: Vec<Value>,
    /// Types of intermediate values.
    pub value_info: Vec<Value>,
    /// Appended to the graph's bytes.
    pub more_graph: Message,
    /// Appended to the model's bytes.
    pub more: Message,
}

/// An operator in a graph.
#[derive(Clone, Default)]
pub struct Node {
    /// The operator's name.
    pub operator: String,
    /// Names of its inputs.
    pub inputs: Vec<String>,
    /// Names of its outputs.
    pub outputs: Vec<String>,
    /// The operator's domain, if it is written.
    pub domain: Option<String>,
    /// Encoded attributes.
    pub attributes: Vec<Message>,
    /// Appended to the node's bytes.
    pub more: Message,
}

/// An initializer of a graph.
#[derive(Clone)]
pub struct Tensor {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub dims: Vec<i64>,
    /// ONNX's number of its type.
    pub data_type: i64,
    /// Its contents.
    pub data: Data,
    /// Appended to the tensor's bytes.
    pub more: Message,
}

/// Contents of a tensor.
#[derive(Clone)]
pub enum Data {
    /// Bytes in the model.
    Inside(Vec<u8>),
    /// Keys and values that describe the place in another file.
    External(Vec<(String, String)>),
}

/// An input, output or intermediate value of a graph.
#[derive(Clone)]
pub struct Value {
    /// Its name.
    pub name: String,
    /// ONNX's number of its type.
    pub data_type: i64,
    /// Its shape.
    pub dims: Vec<Dim>,
}

/// A dimension of a value.
#[derive(Clone)]
pub enum Dim {
    /// Of a fixed size.
    Number(i64),
    /// Of a size with a name.
    Symbol(String),
    /// Of any size.
    Open,
}

/// Owned strings.
pub fn strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

/// A node of the default domain.
pub fn node(operator: &str, inputs: &[&str], outputs: &[&str], attributes: Vec<Message>) -> Node {
    Node {
        operator: operator.to_owned(),
        inputs: strings(inputs),
        outputs: strings(outputs),
        attributes,
        ..Node::default()
    }
}

fn attribute(name: &str, kind: i64) -> Message {
    Message::default().bytes(1, name).int(20, kind)
}

/// An integer attribute.
pub fn int(name: &str, value: i64) -> Message {
    attribute(name, 2).int(3, value)
}

/// A float attribute.
pub fn float(name: &str, value: f32) -> Message {
    attribute(name, 1).float(2, value)
}

/// A string attribute.
pub fn text(name: &str, value: &str) -> Message {
    attribute(name, 3).bytes(4, value)
}

/// An attribute with several integers.
pub fn ints(name: &str, values: &[i64]) -> Message {
    attribute(name, 7).fold(values, |m, &v| m.int(8, v))
}

/// An attribute with a subgraph, as operators for control flow have.
pub fn subgraph(name: &str) -> Message {
    attribute(name, 5).message(6, Message::default().bytes(2, "body"))
}

/// A half-precision tensor in the file `location`.
pub fn external(name: &str, dims: &[i64], location: &str, offset: u64) -> Tensor {
    let length = dims.iter().product::<i64>() * 2;
    let entries = [("location", location.to_owned()), ("offset", offset.to_string()), ("length", length.to_string())];
    let entries = entries.map(|(key, value)| (key.to_owned(), value));
    Tensor {
        name: name.to_owned(),
        dims: dims.to_vec(),
        data_type: F16,
        data: Data::External(entries.into()),
        more: Message::default(),
    }
}

/// A tensor of 64-bit integers in the model.
pub fn inside_ints(name: &str, values: &[i64]) -> Tensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let dims = vec![values.len() as i64];
    Tensor { name: name.to_owned(), dims, data_type: I64, data: Data::Inside(bytes), more: Message::default() }
}

/// A tensor of floats in the model.
pub fn inside_floats(name: &str, dims: &[i64], values: &[f32]) -> Tensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Tensor {
        name: name.to_owned(),
        dims: dims.to_vec(),
        data_type: F32,
        data: Data::Inside(bytes),
        more: Message::default(),
    }
}

/// A value with a fixed shape.
pub fn value(name: &str, data_type: i64, dims: &[i64]) -> Value {
    Value { name: name.to_owned(), data_type, dims: dims.iter().map(|&n| Dim::Number(n)).collect() }
}

impl Value {
    fn encode(&self) -> Message {
        let shape = Message::default().fold(&self.dims, |m, dim| {
            let dim = match dim {
                Dim::Number(n) => Message::default().int(1, *n),
                Dim::Symbol(name) => Message::default().bytes(2, name),
                Dim::Open => Message::default(),
            };
            m.message(1, dim)
        });
        let tensor = Message::default().int(1, self.data_type).message(2, shape);
        Message::default().bytes(1, &self.name).message(2, Message::default().message(1, tensor))
    }
}

impl Tensor {
    fn encode(&self) -> Message {
        let message =
            Message::default().fold(&self.dims, |m, &n| m.int(1, n)).int(2, self.data_type).bytes(8, &self.name);
        let message = match &self.data {
            Data::Inside(bytes) => message.bytes(9, bytes),
            Data::External(entries) => message
                .fold(entries, |m, (key, value)| m.message(13, Message::default().bytes(1, key).bytes(2, value)))
                .int(14, 1),
        };
        message.raw(&self.more.0)
    }
}

impl Node {
    fn encode(&self) -> Message {
        let message = Message::default().fold(&self.inputs, |m, name| m.bytes(1, name));
        let message = message.fold(&self.outputs, |m, name| m.bytes(2, name)).bytes(4, &self.operator);
        let message = message.fold(&self.attributes, |m, attribute| m.message(5, attribute.clone()));
        let message = self.domain.iter().fold(message, |m, domain| m.bytes(7, domain));
        message.raw(&self.more.0)
    }
}

impl Model {
    /// The model's bytes.
    pub fn encode(&self) -> Vec<u8> {
        let graph = Message::default()
            .fold(&self.nodes, |m, node| m.message(1, node.encode()))
            .bytes(2, "toy")
            .fold(&self.tensors, |m, tensor| m.message(5, tensor.encode()))
            .fold(&self.inputs, |m, value| m.message(11, value.encode()))
            .fold(&self.outputs, |m, value| m.message(12, value.encode()))
            .fold(&self.value_info, |m, value| m.message(13, value.encode()))
            .raw(&self.more_graph.0);
        let message = Message::default().int(1, self.ir_version).bytes(2, "toy").message(7, graph);
        let message = message.fold(&self.opsets, |m, (domain, version)| {
            m.message(8, Message::default().bytes(1, domain).int(2, *version))
        });
        message.raw(&self.more.0).0
    }

    /// The first node with this operator.
    pub fn node(&mut self, operator: &str) -> &mut Node {
        self.nodes.iter_mut().find(|node| node.operator == operator).expect("the toy model has this operator")
    }

    /// The initializer with this name.
    pub fn tensor(&mut self, name: &str) -> &mut Tensor {
        self.tensors.iter_mut().find(|tensor| tensor.name == name).expect("the toy model has this initializer")
    }
}
