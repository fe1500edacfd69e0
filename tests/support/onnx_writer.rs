//! Writes ONNX models field by field, also ones that no honest exporter would write.

/// A protobuf message in the making.
#[derive(Default, Clone)]
pub(crate) struct Message(pub(crate) Vec<u8>);

impl Message {
    fn raw_varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    pub(crate) fn int(mut self, field: u32, value: i64) -> Self {
        self.raw_varint(u64::from(field) << 3);
        self.raw_varint(value as u64);
        self
    }

    pub(crate) fn float(mut self, field: u32, value: f32) -> Self {
        self.raw_varint(u64::from(field) << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn bytes(mut self, field: u32, bytes: impl AsRef<[u8]>) -> Self {
        self.raw_varint(u64::from(field) << 3 | 2);
        self.raw_varint(bytes.as_ref().len() as u64);
        self.0.extend(bytes.as_ref());
        self
    }

    pub(crate) fn message(self, field: u32, message: Self) -> Self {
        self.bytes(field, message.0)
    }

    /// Bytes as they are, which may be no field at all.
    pub(crate) fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    pub(crate) fn fold<T>(self, items: &[T], add: impl Fn(Self, &T) -> Self) -> Self {
        items.iter().fold(self, add)
    }
}

pub(crate) const F32: i64 = 1;
pub(crate) const I64: i64 = 7;
pub(crate) const F16: i64 = 10;

#[derive(Clone)]
pub(crate) struct Model {
    pub(crate) ir_version: i64,
    pub(crate) opsets: Vec<(String, i64)>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) tensors: Vec<Tensor>,
    pub(crate) inputs: Vec<Value>,
    pub(crate) outputs: Vec<Value>,
    /// Types stated of inner values.
    pub(crate) value_info: Vec<Value>,
    /// Appended to the graph's bytes.
    pub(crate) more_graph: Message,
    /// Appended to the model's bytes.
    pub(crate) more: Message,
}

#[derive(Clone, Default)]
pub(crate) struct Node {
    pub(crate) operator: String,
    pub(crate) inputs: Vec<String>,
    pub(crate) outputs: Vec<String>,
    pub(crate) domain: Option<String>,
    /// Each an encoded attribute.
    pub(crate) attributes: Vec<Message>,
    pub(crate) more: Message,
}

#[derive(Clone)]
pub(crate) struct Tensor {
    pub(crate) name: String,
    pub(crate) dims: Vec<i64>,
    pub(crate) data_type: i64,
    pub(crate) data: Data,
    pub(crate) more: Message,
}

#[derive(Clone)]
pub(crate) enum Data {
    Inside(Vec<u8>),
    External(Vec<(String, String)>),
}

#[derive(Clone)]
pub(crate) struct Value {
    pub(crate) name: String,
    pub(crate) data_type: i64,
    pub(crate) dims: Vec<Dim>,
}

#[derive(Clone)]
pub(crate) enum Dim {
    Number(i64),
    Symbol(String),
    Open,
}

pub(crate) fn strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

pub(crate) fn node(operator: &str, inputs: &[&str], outputs: &[&str], attributes: Vec<Message>) -> Node {
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

pub(crate) fn int(name: &str, value: i64) -> Message {
    attribute(name, 2).int(3, value)
}

pub(crate) fn float(name: &str, value: f32) -> Message {
    attribute(name, 1).float(2, value)
}

pub(crate) fn text(name: &str, value: &str) -> Message {
    attribute(name, 3).bytes(4, value)
}

pub(crate) fn ints(name: &str, values: &[i64]) -> Message {
    attribute(name, 7).fold(values, |m, &v| m.int(8, v))
}

/// A subgraph, as control flow has it.
pub(crate) fn subgraph(name: &str) -> Message {
    attribute(name, 5).message(6, Message::default().bytes(2, "body"))
}

pub(crate) fn external(name: &str, dims: &[i64], location: &str, offset: u64) -> Tensor {
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

pub(crate) fn inside_ints(name: &str, values: &[i64]) -> Tensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let dims = vec![values.len() as i64];
    Tensor { name: name.to_owned(), dims, data_type: I64, data: Data::Inside(bytes), more: Message::default() }
}

pub(crate) fn inside_floats(name: &str, dims: &[i64], values: &[f32]) -> Tensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Tensor {
        name: name.to_owned(),
        dims: dims.to_vec(),
        data_type: F32,
        data: Data::Inside(bytes),
        more: Message::default(),
    }
}

pub(crate) fn value(name: &str, data_type: i64, dims: &[i64]) -> Value {
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
    pub(crate) fn encode(&self) -> Vec<u8> {
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

    pub(crate) fn node(&mut self, operator: &str) -> &mut Node {
        self.nodes.iter_mut().find(|node| node.operator == operator).expect("the toy model has this operator")
    }

    pub(crate) fn tensor(&mut self, name: &str) -> &mut Tensor {
        self.tensors.iter_mut().find(|tensor| tensor.name == name).expect("the toy model has this initializer")
    }
}
