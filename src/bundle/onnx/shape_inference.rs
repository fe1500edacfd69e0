//! Shape inference: sizes of all values of a graph, and from them the memory and the cost of a run.
//!
//! Each shape follows from the inputs' shapes, so one pass over the nodes gives every size. No value may exceed [`MAX_VALUE`]. The
//! memory estimate assumes what the runtime does: values that depend only on weights are folded at load and kept; other values live from
//! the node that produces them to the last node that reads them; `Reshape` shares its input's memory; the caller owns inputs and outputs.

use std::collections::HashMap;

use super::blocks::Unpacked;
use super::operators::{Call, NBITS, Operand, infer};
use super::proto::{Data, Dim, Graph, Node, Tensor, ValueInfo};
use super::{CheckResult, DataType, Fault, Shape, quoted};
use crate::bundle::cost::GraphCost;

/// The largest intermediate value, in bytes of float32: `docs/bundle.md` section 4.
pub(super) const MAX_VALUE: u64 = 256 << 20;
/// Maximum number of values in one graph.
const MAX_VALUES: usize = 1 << 17;

/// Memory of one graph in bytes, without its inputs and outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::bundle) struct Footprint {
    /// Constants that a run reads, in the element type in which it reads them.
    pub(in crate::bundle) weights: u64,
    /// Peak sum of all live intermediate values at any node.
    pub(in crate::bundle) peak: u64,
    /// The largest intermediate value.
    pub(in crate::bundle) largest: u64,
    /// The largest matrix that a product unpacks from 8 or 4 bits.
    pub(in crate::bundle) unpacked: Unpacked,
    /// Cost of a run.
    pub(in crate::bundle) cost: GraphCost,
}

struct Value<'a> {
    shape: Shape,
    data: Option<&'a [u8]>,
    origin: Origin,
    /// The value whose memory this one shares: its own index, except for an output of `Reshape`.
    owner: usize,
    /// The node after which the memory is free.
    last_use: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Origin {
    Input,
    /// Known at load time. `held` becomes `true` when a node that runs reads it.
    Constant {
        held: bool,
    },
    Node(usize),
}

/// Sizes of all values of one graph.
struct SizeInference<'a> {
    values: Vec<Value<'a>>,
    names: HashMap<&'a str, usize>,
    footprint: Footprint,
}

/// Names and shapes of inputs or outputs.
pub(super) type Named<'a> = [(&'a str, Shape)];

/// An input of a node that runs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Input<'r> {
    pub(super) shape: &'r Shape,
    /// Whether it is an initializer, or is computed from initializers alone.
    pub(super) is_constant: bool,
}

/// Gets each node that runs, in order, with its inputs and the shapes of its outputs.
pub(super) type NodeVisitor<'r, 'a> = &'r mut dyn FnMut(&'a Node<'a>, &[Input<'_>], &[Shape]);

/// Names and shapes of inputs or outputs, whose dimensions `sizes` has by name.
pub(super) fn named_shapes<'a>(
    values: &[ValueInfo<'a>],
    sizes: &[(&str, &[usize])],
) -> CheckResult<Vec<(&'a str, Shape)>> {
    let shape = |value: &ValueInfo<'a>| {
        let size = sizes.iter().find(|(name, _)| *name == value.name);
        let (_, size) = size.ok_or_else(|| Fault::new(format!("{} has no known size", quoted(value.name))))?;
        let dims = size.iter().map(|&n| n as u64).collect();
        Ok((value.name, Shape { element: DataType::of(value.data_type)?, dims }))
    };
    values.iter().map(shape).collect()
}

/// Infers all sizes of `graph` from the shapes of `inputs`, and checks that its outputs have the shapes of `outputs`.
pub(super) fn infer_sizes<'a>(
    graph: &'a Graph<'a>,
    opset: i64,
    inputs: &Named<'_>,
    outputs: &Named<'_>,
    visitor: NodeVisitor<'_, 'a>,
) -> CheckResult<Footprint> {
    let mut inference = SizeInference { values: Vec::new(), names: HashMap::new(), footprint: Footprint::default() };
    // The names were compared before.
    for (value, (_, shape)) in graph.inputs.iter().zip(inputs) {
        inference.add(value.name, shape.clone(), None, Origin::Input)?;
    }
    for tensor in &graph.tensors {
        inference.constant(tensor).map_err(|fault| within("initializer", tensor.name, fault))?;
    }
    for (i, node) in graph.nodes.iter().enumerate() {
        inference.node(i, node, opset, visitor).map_err(|fault| within("node", node.name, fault))?;
    }
    inference.check_declared(graph)?;
    let made = outputs.iter().map(|(name, shape)| inference.output(name, shape)).collect::<CheckResult<Vec<_>>>()?;
    inference.footprint.peak = inference.peak(graph.nodes.len(), &made);
    Ok(inference.footprint)
}

fn within(what: &str, name: &str, fault: Fault) -> Fault {
    fault.within(&format!("{what} {}", quoted(name)))
}

/// Size of a value in bytes, within the limit.
fn bytes(shape: &Shape) -> CheckResult<u64> {
    let count = shape.count().filter(|&count| count > 0 && count <= MAX_VALUE / 4);
    let fault =
        || Fault::new(format!("a value of {:?} elements is empty or passes {} MiB", shape.dims, MAX_VALUE >> 20));
    Ok(count.ok_or_else(fault)? * shape.element.bytes())
}

impl<'a> SizeInference<'a> {
    fn add(&mut self, name: &'a str, shape: Shape, data: Option<&'a [u8]>, origin: Origin) -> CheckResult<usize> {
        let index = self.values.len();
        if index >= MAX_VALUES {
            return Err(Fault::new(format!("the graph has more than {MAX_VALUES} values")));
        }
        self.names.try_reserve(1).map_err(Fault::no_memory)?;
        self.values.try_reserve(1).map_err(Fault::no_memory)?;
        if name.is_empty() || self.names.insert(name, index).is_some() {
            return Err(Fault::new(format!("the value {} is made twice, or has no name", quoted(name))));
        }
        self.values.push(Value { shape, data, origin, owner: index, last_use: 0 });
        Ok(index)
    }

    fn constant(&mut self, tensor: &'a Tensor<'a>) -> CheckResult<()> {
        let shape = tensor_shape(tensor)?;
        let data = match tensor.data {
            Data::Inline(bytes) => Some(bytes),
            Data::External { .. } => None,
        };
        self.add(tensor.name, shape, data, Origin::Constant { held: false }).map(drop)
    }

    fn node(&mut self, i: usize, node: &'a Node<'a>, opset: i64, visitor: NodeVisitor<'_, 'a>) -> CheckResult<()> {
        let mut inputs = Vec::with_capacity(node.inputs.len());
        for &name in &node.inputs {
            inputs.push(if name.is_empty() { None } else { Some(self.find(name)?) });
        }
        let operands = inputs.iter().map(|input| {
            let value = &self.values[(*input)?];
            Some(Operand { shape: &value.shape, data: value.data })
        });
        let shapes = infer(&Call { node, opset, inputs: operands.collect() })?;

        let read: Vec<usize> = inputs.into_iter().flatten().collect();
        let known = read.iter().all(|&v| matches!(self.values[v].origin, Origin::Constant { .. }));
        for &v in read.iter().filter(|_| !known) {
            self.read(v, i)?;
        }
        if !known {
            self.add_cost(node, &read, &shapes)?;
            let input = |v: &usize| {
                let Value { shape, origin, .. } = &self.values[*v];
                Input { shape, is_constant: matches!(origin, Origin::Constant { .. }) }
            };
            visitor(node, &read.iter().map(input).collect::<Vec<_>>(), &shapes);
            if node.operator == NBITS
                && let Some(product) = shapes.first()
            {
                self.footprint.unpacked = self.footprint.unpacked.max(Unpacked::of(node, product.element));
            }
        }
        let origin = if known { Origin::Constant { held: false } } else { Origin::Node(i) };
        for (&name, shape) in node.outputs.iter().zip(shapes) {
            let size = bytes(&shape)?;
            let value = self.add(name, shape, None, origin)?;
            if !known {
                self.footprint.largest = self.footprint.largest.max(size);
                let shared = read.first().filter(|_| node.operator == "Reshape");
                self.values[value].owner = shared.map_or(value, |&v| self.values[v].owner);
                self.values[value].last_use = i;
            }
        }
        Ok(())
    }

    /// Adds the cost of a node that runs, reads the values `read` and writes values of `shapes`.
    fn add_cost(&mut self, node: &Node<'_>, read: &[usize], shapes: &[Shape]) -> CheckResult<()> {
        let dims = |n: usize| read.get(n).map_or(&[][..], |&v| &self.values[v].shape.dims);
        // Multiplications for one element of the output.
        let terms = match node.operator {
            "MatMul" | "FusedMatMul" | NBITS => dims(0).last().copied().unwrap_or(0),
            "Conv" => dims(1).iter().skip(1).fold(1_u64, |all, &n| all.saturating_mul(n)),
            _ => 0,
        };
        let (mut numbers, mut moved) = (0_u64, 0_u64);
        for shape in shapes {
            numbers = numbers.saturating_add(shape.count().unwrap_or(u64::MAX));
            moved = moved.saturating_add(bytes(shape)?);
        }
        for &v in read {
            moved = moved.saturating_add(bytes(&self.values[v].shape)?);
        }
        let cost = &mut self.footprint.cost;
        cost.multiply_adds = cost.multiply_adds.saturating_add(numbers.saturating_mul(terms));
        if node.operator != "Reshape" {
            cost.bytes = cost.bytes.saturating_add(moved);
        }
        Ok(())
    }

    /// Records that node `i`, which runs, reads value `v`.
    fn read(&mut self, v: usize, i: usize) -> CheckResult<()> {
        let owner = self.values[v].owner;
        self.values[owner].last_use = i;
        if self.values[v].origin == (Origin::Constant { held: false }) {
            self.values[v].origin = Origin::Constant { held: true };
            let size = bytes(&self.values[v].shape)?;
            self.footprint.weights = self.footprint.weights.saturating_add(size);
        }
        Ok(())
    }

    fn find(&self, name: &str) -> CheckResult<usize> {
        self.names.get(name).copied().ok_or_else(|| Fault::new(format!("{} is read before it is made", quoted(name))))
    }

    fn output(&self, name: &str, expected: &Shape) -> CheckResult<usize> {
        let value = self.find(name)?;
        let Value { shape, origin, .. } = &self.values[value];
        if !matches!(origin, Origin::Node(_)) {
            return Err(Fault::new(format!("the output {} does not depend on the inputs", quoted(name))));
        }
        if shape == expected {
            return Ok(value);
        }
        let (found, wanted) = ((shape.element, &shape.dims), (expected.element, &expected.dims));
        Err(Fault::new(format!(
            "the output {} comes out as {} {:?}, not {} {:?}",
            quoted(name),
            found.0,
            found.1,
            wanted.0,
            wanted.1
        )))
    }

    /// Checks the types that the model declares for intermediate values.
    fn check_declared(&self, graph: &Graph<'_>) -> CheckResult<()> {
        for info in &graph.value_info {
            let value = &self.values[self.find(info.name)?];
            let fits = DataType::of(info.data_type)? == value.shape.element
                && info.dims.len() == value.shape.dims.len()
                && info.dims.iter().zip(&value.shape.dims).all(|(dim, &n)| match dim {
                    Dim::Number(stated) => u64::try_from(*stated) == Ok(n),
                    Dim::Symbol(_) | Dim::Unknown => true,
                });
            if !fits {
                return Err(Fault::new(format!(
                    "the value {} has another type than the model states",
                    quoted(info.name)
                )));
            }
        }
        Ok(())
    }

    /// Largest sum of live bytes at any node.
    fn peak(&self, nodes: usize, outputs: &[usize]) -> u64 {
        let mut made = vec![0_u64; nodes];
        let mut freed = vec![0_u64; nodes];
        for (index, value) in self.values.iter().enumerate() {
            if let Origin::Node(i) = value.origin
                && value.owner == index
                && !outputs.contains(&index)
            {
                let size = value.shape.count().unwrap_or(u64::MAX).saturating_mul(value.shape.element.bytes());
                made[i] = made[i].saturating_add(size);
                freed[value.last_use] = freed[value.last_use].saturating_add(size);
            }
        }
        let (mut live, mut peak) = (0_u64, 0_u64);
        for (made, freed) in made.into_iter().zip(freed) {
            live = live.saturating_add(made);
            peak = peak.max(live);
            live = live.saturating_sub(freed);
        }
        peak
    }
}

/// Type and size of an initializer.
pub(super) fn tensor_shape(tensor: &Tensor<'_>) -> CheckResult<Shape> {
    let dims = tensor.dims.iter().map(|&n| u64::try_from(n)).collect::<Result<_, _>>();
    let shape = Shape {
        element: DataType::of(tensor.data_type)?,
        dims: dims.map_err(|_| Fault::new(format!("it has the dimensions {:?}", tensor.dims)))?,
    };
    bytes(&shape)?;
    Ok(shape)
}
