//! The operators that a bundle may use, and the rule by which each output's shape follows from the inputs.
//!
//! Meaning of every operator: <https://onnx.ai/onnx/operators/>, opsets 17 to 20, and for ONNX Runtime's own
//! <https://github.com/microsoft/onnxruntime/blob/main/docs/ContribOperators.md>. A rule accepts only forms whose shape can be inferred
//! without running the graph, so bounds, axes and scales must be constants inside the model.

use super::proto::{Attribute, Node};
use super::{CheckResult, DataType, Fault, Shape, quoted};

/// An input of a node.
#[derive(Clone, Copy)]
pub(super) struct Operand<'a> {
    pub(super) shape: &'a Shape,
    /// Little-endian elements of a constant stored inside the model.
    pub(super) data: Option<&'a [u8]>,
}

/// One node with its inputs resolved.
pub(super) struct Call<'a> {
    pub(super) node: &'a Node<'a>,
    pub(super) opset: i64,
    pub(super) inputs: Vec<Option<Operand<'a>>>,
}

#[derive(Clone, Copy)]
enum Kind {
    Float,
    Int,
    Ints,
    Text,
}

struct Operator {
    name: &'static str,
    /// Minimum and maximum number of inputs; those beyond the minimum are optional.
    inputs: (usize, usize),
    /// Maximum number of outputs.
    outputs: usize,
    attributes: &'static [(&'static str, Kind)],
    rule: fn(&Call<'_>) -> CheckResult<Vec<Shape>>,
}

/// The product with a matrix that is stored as integers and scales.
pub(super) const NBITS: &str = "MatMulNBits";

const UNLIMITED: usize = usize::MAX;

/// The allow-list. `docs/bundle.md` section 4 names the same operators; a test compares the two.
#[rustfmt::skip]
const TABLE: &[Operator] = &[
    Operator { name: "Add", inputs: (2, 2), outputs: 1, attributes: &[], rule: broadcast },
    Operator { name: "Cast", inputs: (1, 1), outputs: 1, attributes: &[("to", Kind::Int), ("saturate", Kind::Int)], rule: cast },
    Operator { name: "Clip", inputs: (1, 3), outputs: 1, attributes: &[], rule: clip },
    Operator { name: "Concat", inputs: (1, UNLIMITED), outputs: 1, attributes: &[("axis", Kind::Int)], rule: concat },
    Operator { name: "Conv", inputs: (2, 3), outputs: 1, attributes: &[
        ("dilations", Kind::Ints), ("group", Kind::Int), ("kernel_shape", Kind::Ints), ("pads", Kind::Ints), ("strides", Kind::Ints),
    ], rule: conv },
    Operator { name: "Cos", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "DepthToSpace", inputs: (1, 1), outputs: 1, attributes: &[("blocksize", Kind::Int), ("mode", Kind::Text)], rule: depth_to_space },
    Operator { name: "Div", inputs: (2, 2), outputs: 1, attributes: &[], rule: broadcast },
    Operator { name: "FusedMatMul", inputs: (2, 2), outputs: 1, attributes: &[("alpha", Kind::Float), ("transB", Kind::Int)], rule: fused_matmul },
    Operator { name: "MatMul", inputs: (2, 2), outputs: 1, attributes: &[], rule: matmul },
    Operator { name: NBITS, inputs: (3, 4), outputs: 1, attributes: &[
        ("K", Kind::Int), ("N", Kind::Int), ("accuracy_level", Kind::Int), ("bits", Kind::Int), ("block_size", Kind::Int),
    ], rule: matmul_nbits },
    Operator { name: "Mul", inputs: (2, 2), outputs: 1, attributes: &[], rule: broadcast },
    Operator { name: "ReduceMean", inputs: (1, 2), outputs: 1, attributes: &[
        ("axes", Kind::Ints), ("keepdims", Kind::Int), ("noop_with_empty_axes", Kind::Int),
    ], rule: reduce_mean },
    Operator { name: "Relu", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "Reshape", inputs: (2, 2), outputs: 1, attributes: &[("allowzero", Kind::Int)], rule: reshape },
    Operator { name: "Resize", inputs: (3, 3), outputs: 1, attributes: &[
        ("mode", Kind::Text), ("coordinate_transformation_mode", Kind::Text), ("nearest_mode", Kind::Text),
    ], rule: resize },
    Operator { name: "RotaryEmbedding", inputs: (4, 4), outputs: 1, attributes: &[("interleaved", Kind::Int)], rule: rotary_embedding },
    Operator { name: "Sigmoid", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "SimplifiedLayerNormalization", inputs: (2, 2), outputs: 1, attributes: &[("axis", Kind::Int), ("epsilon", Kind::Float)], rule: rms_norm },
    Operator { name: "Sin", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "Slice", inputs: (3, 5), outputs: 1, attributes: &[], rule: slice },
    Operator { name: "Softmax", inputs: (1, 1), outputs: 1, attributes: &[("axis", Kind::Int)], rule: softmax },
    Operator { name: "Split", inputs: (1, 2), outputs: UNLIMITED, attributes: &[("axis", Kind::Int), ("num_outputs", Kind::Int)], rule: split },
    Operator { name: "Sqrt", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "Sub", inputs: (2, 2), outputs: 1, attributes: &[], rule: broadcast },
    Operator { name: "Tanh", inputs: (1, 1), outputs: 1, attributes: &[], rule: same },
    Operator { name: "Transpose", inputs: (1, 1), outputs: 1, attributes: &[("perm", Kind::Ints)], rule: transpose },
];

/// Those of [`proto::CONTRIB`](super::proto::CONTRIB); all others are of the default domain.
const CONTRIB_OPERATORS: [&str; 3] = ["FusedMatMul", NBITS, "RotaryEmbedding"];

/// The names of the operators a bundle's graphs may use, in order.
pub fn operators() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|operator| operator.name)
}

fn operator(name: &str) -> CheckResult<&'static Operator> {
    TABLE
        .iter()
        .find(|operator| operator.name == name)
        .ok_or_else(|| Fault::new(format!("the operator {} is not on the list", quoted(name))))
}

/// Checks everything about a node that needs no shapes: operator, domain, counts, attributes. `has_contrib` says whether the model names
/// ONNX Runtime's domain.
pub(super) fn check_node(node: &Node<'_>, has_contrib: bool) -> CheckResult<()> {
    let operator = operator(node.operator)?;
    if node.is_contrib != CONTRIB_OPERATORS.contains(&node.operator) || node.is_contrib && !has_contrib {
        return Err(Fault::new(format!(
            "{} is of the wrong domain, or of one that the model does not name",
            node.operator
        )));
    }
    let (min, max) = operator.inputs;
    let given = node.inputs.iter().take(min).filter(|name| !name.is_empty()).count();
    // Only `Resize` may omit one of its first inputs: the region of interest, which must be omitted.
    let holes = usize::from(operator.name == "Resize");
    if given + holes < min || node.inputs.len() < min || node.inputs.len() > max {
        return Err(Fault::new(format!("{} has {} inputs", node.operator, node.inputs.len())));
    }
    if node.outputs.is_empty()
        || node.outputs.len() > operator.outputs
        || node.outputs.iter().any(|name| name.is_empty())
    {
        return Err(Fault::new(format!("{} has {} outputs, or one without a name", node.operator, node.outputs.len())));
    }
    for (i, (name, value)) in node.attributes.iter().enumerate() {
        let kind = operator.attributes.iter().find(|(known, _)| known == name).map(|(_, kind)| *kind);
        let fits = matches!(
            (kind, value),
            (Some(Kind::Float), Attribute::Float(_))
                | (Some(Kind::Int), Attribute::Int(_))
                | (Some(Kind::Ints), Attribute::Ints(_))
                | (Some(Kind::Text), Attribute::Text(_))
        );
        if !fits || node.attributes[..i].iter().any(|(earlier, _)| earlier == name) {
            return Err(Fault::new(format!(
                "{} has an unknown, mistyped or repeated attribute {}",
                node.operator,
                quoted(name)
            )));
        }
    }
    Ok(())
}

/// The shapes of all outputs.
pub(super) fn infer(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let shapes = (operator(call.node.operator)?.rule)(call)?;
    if shapes.len() == call.node.outputs.len() {
        return Ok(shapes);
    }
    Err(Fault::new(format!(
        "{} makes {} values for {} outputs",
        call.node.operator,
        shapes.len(),
        call.node.outputs.len()
    )))
}

impl<'a> Call<'a> {
    fn fault(&self, cause: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{} {cause}", self.node.operator))
    }

    /// A floating-point input.
    fn tensor(&self, i: usize) -> CheckResult<&'a Shape> {
        let operand = self.inputs.get(i).copied().flatten().ok_or_else(|| self.fault(format!("lacks input {i}")))?;
        if !operand.shape.element.is_float() {
            return Err(self.fault("computes with integers"));
        }
        Ok(operand.shape)
    }

    fn absent(&self, i: usize) -> bool {
        self.inputs.get(i).copied().flatten().is_none()
    }

    /// The integers of an input that must be a one-dimensional constant inside the model.
    fn constant_ints(&self, i: usize) -> CheckResult<Vec<i64>> {
        let data = self.constant(i, DataType::I64)?;
        Ok(data.as_chunks::<8>().0.iter().map(|&bytes| i64::from_le_bytes(bytes)).collect())
    }

    fn constant(&self, i: usize, element: DataType) -> CheckResult<&'a [u8]> {
        let operand = self.inputs.get(i).copied().flatten();
        operand
            .filter(|o| o.shape.element == element && o.shape.dims.len() == 1)
            .and_then(|o| o.data)
            .ok_or_else(|| self.fault(format!("has an input {i} that is no list of {element} inside the model")))
    }

    fn attribute(&self, name: &str) -> Option<&'a Attribute<'a>> {
        self.node.attributes.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }

    /// A finite number.
    fn float(&self, name: &str, default: f32) -> CheckResult<f32> {
        match self.attribute(name) {
            Some(Attribute::Float(value)) if value.is_finite() => Ok(*value),
            None => Ok(default),
            Some(value) => Err(self.fault(format!("has the {name} {value:?}"))),
        }
    }

    fn int(&self, name: &str) -> Option<i64> {
        int_attribute(self.node, name)
    }

    fn ints(&self, name: &str) -> Option<&'a [i64]> {
        match self.attribute(name) {
            Some(Attribute::Ints(values)) => Some(values),
            _ => None,
        }
    }

    fn text(&self, name: &str, default: &'static str, allowed: &[&str]) -> CheckResult<&'a str> {
        let value = match self.attribute(name) {
            Some(Attribute::Text(value)) => *value,
            _ => default,
        };
        if allowed.contains(&value) { Ok(value) } else { Err(self.fault(format!("has the {name} {}", quoted(value)))) }
    }

    /// An axis of `rank`, where negative ones count from the end.
    fn axis(&self, axis: i64, rank: usize) -> CheckResult<usize> {
        let rank_signed = rank as i64;
        let counted = if axis < 0 { axis.checked_add(rank_signed) } else { Some(axis) };
        match counted.filter(|n| (0..rank_signed).contains(n)) {
            Some(n) => Ok(n as usize),
            None => Err(self.fault(format!("has the axis {axis} of {rank} dimensions"))),
        }
    }

    /// `n` positive numbers of at most 4096, all 1 where the attribute is absent.
    fn sizes(&self, name: &str, n: usize) -> CheckResult<Vec<u64>> {
        let Some(values) = self.ints(name) else { return Ok(vec![1; n]) };
        if values.len() != n || values.iter().any(|v| !(1..=4096).contains(v)) {
            return Err(self.fault(format!("has the {name} {values:?}")));
        }
        Ok(values.iter().map(|v| v.unsigned_abs()).collect())
    }

    fn one(shape: &Shape, dims: Vec<u64>) -> CheckResult<Vec<Shape>> {
        Ok(vec![Shape { element: shape.element, dims }])
    }
}

/// An integer attribute of a node.
pub(super) fn int_attribute(node: &Node<'_>, name: &str) -> Option<i64> {
    match node.attributes.iter().find(|(known, _)| *known == name)?.1 {
        Attribute::Int(value) => Some(value),
        _ => None,
    }
}

fn same(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    Ok(vec![call.tensor(0)?.clone()])
}

fn cast(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    let to = call.int("to").ok_or_else(|| call.fault("does not say to what"))?;
    match DataType::of(to)? {
        element if element.is_float() => Ok(vec![Shape { element, dims: x.dims.clone() }]),
        _ => Err(call.fault("goes to an integer")),
    }
}

fn clip(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    for i in 1..call.inputs.len() {
        if !call.absent(i) {
            let bound = call.tensor(i)?;
            if bound.element != x.element || bound.count() != Some(1) {
                return Err(call.fault("has a bound that is no single number of its own type"));
            }
        }
    }
    same(call)
}

/// Broadcasts the dimensions of two operands, aligned at the last.
fn broadcast_dims(call: &Call<'_>, a: &[u64], b: &[u64]) -> CheckResult<Vec<u64>> {
    let rank = a.len().max(b.len());
    let at = |dims: &[u64], i: usize| (i + dims.len()).checked_sub(rank).map_or(1, |k| dims[k]);
    let mut dims = Vec::with_capacity(rank);
    for i in 0..rank {
        dims.push(match (at(a, i), at(b, i)) {
            (m, n) if m == n => m,
            (1, n) => n,
            (m, 1) => m,
            _ => return Err(call.fault(format!("joins {a:?} and {b:?}"))),
        });
    }
    Ok(dims)
}

fn float_inputs<'a>(call: &Call<'a>) -> CheckResult<(&'a Shape, &'a Shape)> {
    let (a, b) = (call.tensor(0)?, call.tensor(1)?);
    if a.element == b.element { Ok((a, b)) } else { Err(call.fault(format!("joins {} and {}", a.element, b.element))) }
}

fn broadcast(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let (a, b) = float_inputs(call)?;
    Call::one(a, broadcast_dims(call, &a.dims, &b.dims)?)
}

fn matmul(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let (a, b) = float_inputs(call)?;
    product(call, a, &a.dims, &b.dims)
}

/// Matrices of the dimensions `a` and `b` multiplied, with the element type of `like`.
fn product(call: &Call<'_>, like: &Shape, a: &[u64], b: &[u64]) -> CheckResult<Vec<Shape>> {
    let ([batch_a @ .., m, k], [batch_b @ .., k2, n]) = (a, b) else {
        return Err(call.fault("has an operand of fewer than two dimensions"));
    };
    if k != k2 {
        return Err(call.fault(format!("multiplies {a:?} by {b:?}")));
    }
    let mut dims = broadcast_dims(call, batch_a, batch_b)?;
    dims.extend([*m, *n]);
    Call::one(like, dims)
}

/// `alpha * a b`, or `alpha * a b^T` where `transB` is 1.
fn fused_matmul(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    call.float("alpha", 1.0)?;
    let (a, b) = float_inputs(call)?;
    let mut turned = b.dims.clone();
    match (call.int("transB").unwrap_or(0), turned.as_mut_slice()) {
        (0, _) => {}
        (1, [.., rows, columns]) => std::mem::swap(rows, columns),
        (trans, dims) => return Err(call.fault(format!("has the transB {trans} for {dims:?}"))),
    }
    product(call, a, &a.dims, &turned)
}

/// `a b^T`. Columns of b `[N, K]` are stored in blocks along K, as integers `[N, K / block, block * bits / 8]` and scales `[N, K / block]`; the
/// integer 2^(bits - 1) stands for 0.
fn matmul_nbits(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let (a, scales) = (call.tensor(0)?, call.tensor(2)?);
    let one_of = |name: &str, default: i64, allowed: &[i64]| {
        let value = call.int(name).unwrap_or(default);
        let known = allowed.contains(&value).then_some(value.unsigned_abs());
        known.ok_or_else(|| call.fault(format!("has the {name} {value}, which is none of {allowed:?}")))
    };
    let bits = one_of("bits", 0, &[4, 8])?;
    let block = one_of("block_size", 0, &[16, 32, 64, 128, 256])?;
    one_of("accuracy_level", 0, &[0, 4])?;
    if !call.absent(3) {
        let name = call.node.inputs.get(3).copied().unwrap_or_default();
        return Err(call.fault(format!("has the zero points {}; stored integers are symmetric", quoted(name))));
    }
    let size = |name: &str| call.int(name).and_then(|value| u64::try_from(value).ok()).filter(|&value| value > 0);
    let (Some(rows), Some(columns)) = (size("K"), size("N")) else {
        return Err(call.fault("has no positive K and N"));
    };
    if a.dims.last() != Some(&rows) || !rows.is_multiple_of(block) {
        return Err(call.fault(format!("multiplies {:?} by {rows} rows in blocks of {block}", a.dims)));
    }
    let numbers = call.inputs.get(1).copied().flatten().map(|operand| operand.shape);
    let expected = [columns, rows / block, block * bits / 8];
    if numbers.is_none_or(|shape| shape.element != DataType::U8 || shape.dims != expected) {
        let found = numbers.map_or_else(String::new, |shape| format!("{} {:?}", shape.element, shape.dims));
        return Err(call.fault(format!("reads the integers {found}, its attributes ask for uint8 {expected:?}")));
    }
    if scales.element != a.element || scales.dims != expected[..2] {
        return Err(call.fault(format!(
            "reads the scales {} {:?}, its attributes ask for {} {:?}",
            scales.element,
            scales.dims,
            a.element,
            &expected[..2]
        )));
    }
    let mut dims = a.dims.clone();
    *dims.last_mut().expect("compared above") = columns;
    Call::one(a, dims)
}

/// Normalises the last axis by its root mean square, and multiplies it by a gain.
fn rms_norm(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let (x, gain) = float_inputs(call)?;
    call.float("epsilon", 1e-5)?;
    let axis = call.axis(call.int("axis").unwrap_or(-1), x.dims.len())?;
    if axis + 1 != x.dims.len() || gain.dims != x.dims[axis..] {
        return Err(call.fault(format!("normalises axis {axis} of {:?} with a gain {:?}", x.dims, gain.dims)));
    }
    same(call)
}

/// Rotates pairs j and P + j of heads `[batch, heads, tokens, 2 P]` by a table that starts at the first token: `[tokens, P]` each.
fn rotary_embedding(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    if call.int("interleaved").unwrap_or(0) != 0 || call.constant_ints(1)? != [0] {
        return Err(call.fault("pairs neighbours, or does not start at position 0"));
    }
    for i in [2, 3] {
        let table = call.tensor(i)?;
        let fits = match *x.dims.as_slice() {
            [_, _, tokens, width] => width % 2 == 0 && table.dims == [tokens, width / 2],
            _ => false,
        };
        if !fits || table.element != x.element {
            return Err(call.fault(format!("turns {:?} by a table {:?}", x.dims, table.dims)));
        }
    }
    same(call)
}

fn concat(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let first = call.tensor(0)?;
    let axis = call.axis(call.int("axis").ok_or_else(|| call.fault("has no axis"))?, first.dims.len())?;
    let mut dims = first.dims.clone();
    for i in 1..call.inputs.len() {
        let next = call.tensor(i)?;
        let fits = next.element == first.element
            && next.dims.len() == dims.len()
            && (0..dims.len()).all(|d| d == axis || next.dims[d] == dims[d]);
        let sum = dims[axis].checked_add(*next.dims.get(axis).unwrap_or(&0));
        dims[axis] =
            sum.filter(|_| fits).ok_or_else(|| call.fault(format!("joins {:?} and {:?}", first.dims, next.dims)))?;
    }
    Call::one(first, dims)
}

fn conv(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let (x, w) = float_inputs(call)?;
    let (&[n, c, h, width], &[m, per_group, kh, kw]) = (x.dims.as_slice(), w.dims.as_slice()) else {
        return Err(call.fault("is not two-dimensional"));
    };
    let group = call.int("group").unwrap_or(1);
    let groups =
        u64::try_from(group).ok().filter(|&g| g > 0 && m.is_multiple_of(g) && per_group.checked_mul(g) == Some(c));
    groups.ok_or_else(|| call.fault(format!("has {group} groups of {per_group} for {c} channels")))?;
    if call.ints("kernel_shape").is_some_and(|k| !k.iter().map(|&v| u64::try_from(v).ok()).eq([Some(kh), Some(kw)])) {
        return Err(call.fault("has a kernel_shape that is not its weight's"));
    }
    if !call.absent(2) {
        let bias = call.tensor(2)?;
        if bias.element != x.element || bias.dims != [m] {
            return Err(call.fault(format!("has a bias {:?} for {m} channels", bias.dims)));
        }
    }
    let (strides, dilations) = (call.sizes("strides", 2)?, call.sizes("dilations", 2)?);
    let pads = call.ints("pads").unwrap_or(&[0; 4]);
    if pads.len() != 4 || pads.iter().any(|p| !(0..=4096).contains(p)) {
        return Err(call.fault(format!("has the pads {pads:?}")));
    }
    let mut dims = vec![n, m];
    for (axis, (size, kernel)) in [(h, kh), (width, kw)].into_iter().enumerate() {
        let padded = size.checked_add(pads[axis].unsigned_abs() + pads[axis + 2].unsigned_abs());
        let reach = (kernel - 1).checked_mul(dilations[axis]);
        let steps = padded.zip(reach).and_then(|(padded, reach)| padded.checked_sub(reach)?.checked_sub(1));
        dims.push(steps.ok_or_else(|| call.fault("has a kernel larger than its input"))? / strides[axis] + 1);
    }
    Call::one(x, dims)
}

fn depth_to_space(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    call.text("mode", "DCR", &["DCR", "CRD"])?;
    let block = call.int("blocksize").filter(|b| (1..=64).contains(b)).map_or(0, i64::unsigned_abs);
    match *x.dims.as_slice() {
        [n, c, h, w] if block > 0 && c.is_multiple_of(block * block) => {
            let grown = |side: u64| side.checked_mul(block).ok_or_else(|| call.fault("is too large"));
            Call::one(x, vec![n, c / (block * block), grown(h)?, grown(w)?])
        }
        _ => Err(call.fault(format!("takes blocks of {block} from {:?}", x.dims))),
    }
}

fn reduce_mean(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    // Opset 18 moved the axes from an attribute to an input.
    let axes = match (call.opset >= 18, call.ints("axes"), call.absent(1)) {
        (true, None, false) => call.constant_ints(1)?,
        (false, Some(axes), true) => axes.to_vec(),
        _ => return Err(call.fault("has no axes where its opset has them")),
    };
    // ONNX Runtime keeps the axes only for 1 and drops them for any other number.
    let keep = match call.int("keepdims").unwrap_or(1) {
        0 => false,
        1 => true,
        other => return Err(call.fault(format!("has keepdims {other}, it must be 0 or 1"))),
    };
    let mut reduced = vec![false; x.dims.len()];
    for axis in axes {
        reduced[call.axis(axis, x.dims.len())?] = true;
    }
    if !reduced.contains(&true) {
        return Err(call.fault("has no axes"));
    }
    let dims = x.dims.iter().zip(&reduced).filter(|&(_, &gone)| keep || !gone);
    Call::one(x, dims.map(|(&n, &gone)| if gone { 1 } else { n }).collect())
}

fn reshape(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    let target = call.constant_ints(1)?;
    let fault = || call.fault(format!("turns {:?} into {target:?}", x.dims));
    if call.int("allowzero").unwrap_or(0) != 0 || target.len() > super::proto::MAX_RANK {
        return Err(fault());
    }
    let mut known = 1_u64;
    let mut dims = Vec::with_capacity(target.len());
    let mut open = None;
    for (i, &size) in target.iter().enumerate() {
        let size = match size {
            0 => *x.dims.get(i).ok_or_else(fault)?,
            -1 if open.is_none() => {
                open = Some(i);
                1
            }
            _ => u64::try_from(size).map_err(|_| fault())?,
        };
        known = known.checked_mul(size).ok_or_else(fault)?;
        dims.push(size);
    }
    let count = x.count().ok_or_else(fault)?;
    if let Some(i) = open {
        dims[i] = count.checked_div(known).ok_or_else(fault)?;
        known = known.checked_mul(dims[i]).ok_or_else(fault)?;
    }
    if known == count { Call::one(x, dims) } else { Err(fault()) }
}

fn resize(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    call.text("mode", "nearest", &["nearest", "linear"])?;
    call.text(
        "coordinate_transformation_mode",
        "half_pixel",
        &["half_pixel", "asymmetric", "align_corners", "pytorch_half_pixel"],
    )?;
    call.text("nearest_mode", "round_prefer_floor", &["round_prefer_floor", "round_prefer_ceil", "floor", "ceil"])?;
    if !call.absent(1) {
        return Err(call.fault("has a region of interest"));
    }
    let scales = call.constant(2, DataType::F32)?.as_chunks::<4>().0;
    if scales.len() != x.dims.len() {
        return Err(call.fault("has scales for another rank"));
    }
    let mut dims = Vec::with_capacity(scales.len());
    for (&bytes, &size) in scales.iter().zip(&x.dims) {
        let scale = f32::from_le_bytes(bytes);
        // In float32, as ONNX's shape inference and ONNX Runtime have it: 10 * 0.7 is 7.
        let scaled = (size as f32 * scale).floor();
        if !(scale > 0.0 && scale <= 2.0) || scaled < 1.0 {
            return Err(call.fault(format!("has the scale {scale}, it must be above 0 and at most 2")));
        }
        dims.push(scaled as u64);
    }
    Call::one(x, dims)
}

fn slice(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    let (starts, ends) = (call.constant_ints(1)?, call.constant_ints(2)?);
    let axes = if call.absent(3) { (0..starts.len() as i64).collect() } else { call.constant_ints(3)? };
    let steps = if call.absent(4) { vec![1; starts.len()] } else { call.constant_ints(4)? };
    if [ends.len(), axes.len(), steps.len()] != [starts.len(); 3] {
        return Err(call.fault("has bounds of different lengths"));
    }
    let mut dims = x.dims.clone();
    let mut cut = vec![false; dims.len()];
    for (((&start, &end), &axis), &step) in starts.iter().zip(&ends).zip(&axes).zip(&steps) {
        let axis = call.axis(axis, dims.len())?;
        let size = i64::try_from(dims[axis]).map_err(|_| call.fault("is too large"))?;
        let at = |bound: i64| (if bound < 0 { bound.saturating_add(size) } else { bound }).clamp(0, size);
        let length = at(end) - at(start);
        if step < 1 || length < 1 || std::mem::replace(&mut cut[axis], true) {
            return Err(call.fault(format!("takes {start} to {end} by {step} of {size}")));
        }
        dims[axis] = length.unsigned_abs().div_ceil(step.unsigned_abs());
    }
    Call::one(x, dims)
}

fn softmax(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    call.axis(call.int("axis").unwrap_or(-1), call.tensor(0)?.dims.len())?;
    same(call)
}

fn split(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    let parts = call.node.outputs.len();
    let axis = call.axis(call.int("axis").unwrap_or(0), x.dims.len())?;
    let total = x.dims[axis];
    let fault = || call.fault(format!("cuts {total} into {parts}"));
    let counted = call.int("num_outputs");
    // Opset 18 added the count, and demands it where no sizes are given.
    if counted.is_some_and(|n| n != parts as i64) || counted.is_some() != (call.opset >= 18 && call.absent(1)) {
        return Err(fault());
    }
    let sizes = if call.absent(1) {
        if !total.is_multiple_of(parts as u64) {
            return Err(fault());
        }
        vec![total / parts as u64; parts]
    } else {
        let sizes = call.constant_ints(1)?;
        sizes.iter().map(|&n| u64::try_from(n).map_err(|_| fault())).collect::<CheckResult<Vec<_>>>()?
    };
    if sizes.iter().try_fold(0_u64, |sum, &n| sum.checked_add(n)) != Some(total) {
        return Err(fault());
    }
    let cut = |size| {
        let mut shape = x.clone();
        shape.dims[axis] = size;
        shape
    };
    Ok(sizes.into_iter().map(cut).collect())
}

fn transpose(call: &Call<'_>) -> CheckResult<Vec<Shape>> {
    let x = call.tensor(0)?;
    let rank = x.dims.len();
    let reversed: Vec<i64> = (0..rank as i64).rev().collect();
    let perm = call.ints("perm").unwrap_or(&reversed);
    let mut seen = vec![false; rank];
    let mut dims = Vec::with_capacity(rank);
    for &axis in perm {
        let axis = usize::try_from(axis).ok().filter(|&a| a < rank && !std::mem::replace(&mut seen[a], true));
        dims.push(x.dims[axis.ok_or_else(|| call.fault(format!("orders {rank} axes as {perm:?}")))?]);
    }
    if dims.len() == rank { Call::one(x, dims) } else { Err(call.fault(format!("orders {rank} axes as {perm:?}"))) }
}
