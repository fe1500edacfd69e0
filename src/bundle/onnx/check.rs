//! Checks a whole model against `docs/bundle.md` section 4.

use super::blocks::{Scales, check_blocks};
use super::interface::Interface;
use super::operators::check_node;
use super::proto::{self, Data, Model, Tensor};
use super::residual::ResidualStream;
use super::shape_inference::{Footprint, NodeVisitor, infer_sizes, tensor_shape};
use super::{CheckResult, DataType, Fault, quoted};
use crate::bundle::{GraphKind, Manifest, Precision, invalid, names};
use crate::{Error, ErrorKind, Result};

/// The largest model without its weights, in bytes.
const MAX_MODEL: usize = 8 << 20;
/// The largest initializer stored in the model file, in bytes.
const MAX_INLINE: usize = 64 << 10;
const IR_VERSIONS: std::ops::RangeInclusive<i64> = 8..=10;
const OPSETS: std::ops::RangeInclusive<i64> = 17..=20;

/// External data that a checked model refers to.
pub(in crate::bundle) struct ExternalData {
    /// Each external location as written in the graph, with the bundle file it names; no duplicates.
    pub(in crate::bundle) external: Vec<(String, String)>,
    /// Scales of matrices in fewer than 16 bits, whose numbers are still to be checked.
    pub(in crate::bundle) scales: Vec<Scales>,
}

/// Identifies a model: the bundle's manifest, and the graph's kind and precision.
#[derive(Clone, Copy)]
pub(in crate::bundle) struct ModelContext<'a> {
    pub(in crate::bundle) manifest: &'a Manifest,
    pub(in crate::bundle) kind: GraphKind,
    pub(in crate::bundle) precision: Precision,
}

impl ModelContext<'_> {
    fn path(&self) -> &str {
        // A manifest may lack the joined graph alone.
        self.manifest.graphs.of(self.precision).and_then(|files| files.of(self.kind)).unwrap_or("joined")
    }

    /// The error for the model, with `cause`.
    pub(in crate::bundle) fn invalid(&self, cause: String) -> crate::Error {
        invalid(self.path(), cause, "Build the model again, or convert it as docs/bundle.md section 4 says")
    }

    /// The error for the model, of a fault.
    pub(super) fn to_error(self, fault: Fault) -> crate::Error {
        if fault.is_out_of_memory {
            return Error::new(ErrorKind::OutOfMemory, fault.cause).field(self.path());
        }
        self.invalid(fault.cause)
    }
}

/// Checks the model `onnx` against section 4 of the format.
///
/// # Errors
/// `InvalidBundle` with the model's file name; `OutOfMemory`.
pub(in crate::bundle) fn check(onnx: &[u8], context: ModelContext<'_>) -> Result<ExternalData> {
    check_model(onnx, context).map_err(|fault| context.to_error(fault))
}

/// Memory and cost of a checked model at a global window of `g` latents.
///
/// # Errors
/// `InvalidBundle` if shape inference fails at this window; `OutOfMemory`.
pub(in crate::bundle) fn footprint(onnx: &[u8], context: ModelContext<'_>, g: u32) -> Result<Footprint> {
    parse(onnx)
        .and_then(|model| footprint_at(&model, context, g, &mut |_, _, _| ()))
        .map_err(|fault| context.to_error(fault))
}

/// Parses a model that is not too large.
pub(super) fn parse(onnx: &[u8]) -> CheckResult<Model<'_>> {
    if onnx.len() > MAX_MODEL {
        return Err(Fault::new(format!("the model has {} bytes, at most {MAX_MODEL} are read", onnx.len())));
    }
    proto::model(onnx)
}

/// The version of the default domain. ONNX Runtime's domain may follow it.
pub(super) fn opset(model: &Model<'_>) -> CheckResult<i64> {
    match model.opsets.as_slice() {
        [("" | "ai.onnx", version)] | [("" | "ai.onnx", version), (proto::CONTRIB, 1)] if OPSETS.contains(version) => {
            Ok(*version)
        }
        other => {
            let list: Vec<String> = other.iter().map(|(domain, v)| format!("{} {v}", quoted(domain))).collect();
            Err(Fault::new(format!(
                "the opsets are [{}]; the default domain, 17 to 20, is allowed, and after it {} 1",
                list.join(", "),
                proto::CONTRIB
            )))
        }
    }
}

fn check_model(onnx: &[u8], context: ModelContext<'_>) -> CheckResult<ExternalData> {
    let model = parse(onnx)?;
    if !IR_VERSIONS.contains(&model.ir_version) {
        return Err(Fault::new(format!("the IR version is {}, 8 to 10 are allowed", model.ir_version)));
    }
    opset(&model)?;
    let has_contrib = model.opsets.len() > 1;
    for node in &model.graph.nodes {
        check_node(node, has_contrib).map_err(|fault| fault.within(&format!("node {}", quoted(node.name))))?;
    }
    Interface::of(context.kind, context.precision, context.manifest)
        .check(&model.graph.inputs, &model.graph.outputs)?;
    let external = check_tensors(&model.graph.tensors, context)?;
    let scales = check_blocks(&model.graph, context.kind, context.manifest.quantisation.as_ref())?;
    // Shape inference must succeed at the smallest, the stock and the largest window. Other windows are checked when used.
    let window = context.manifest.geometry.global;
    for g in [window.dilation, window.window, window.max_window] {
        footprint_at(&model, context, g, &mut |_, _, _| ())?;
    }
    if matches!(context.kind, GraphKind::Transformer | GraphKind::Joined) && context.precision == Precision::F16 {
        residual_stream(&model, context)?.check(context.manifest.residual, context.manifest.geometry.layers)?;
    }
    Ok(ExternalData { external, scales })
}

/// The residual stream of a transformer.
fn residual_stream<'a>(model: &'a Model<'a>, context: ModelContext<'_>) -> CheckResult<ResidualStream<'a>> {
    let mut stream = ResidualStream::new(&context.manifest.geometry, context.kind);
    visit_nodes(model, context, &mut |node, inputs, outputs| stream.read(node, inputs, outputs))?;
    Ok(stream)
}

/// Hands the nodes of a model to `visitor`, with shapes at the narrowest window.
pub(super) fn visit_nodes<'a>(
    model: &'a Model<'a>,
    context: ModelContext<'_>,
    visitor: NodeVisitor<'_, 'a>,
) -> CheckResult<()> {
    footprint_at(model, context, context.manifest.geometry.global.dilation, visitor).map(drop)
}

/// Infers the sizes of a model at a global window of `g` latents, and hands the nodes that run to `visitor`.
pub(super) fn footprint_at<'a>(
    model: &'a Model<'a>,
    context: ModelContext<'_>,
    g: u32,
    visitor: NodeVisitor<'_, 'a>,
) -> CheckResult<Footprint> {
    let Interface { inputs, outputs } = Interface::of(context.kind, context.precision, context.manifest);
    let inputs: Vec<_> = inputs.iter().map(|port| (port.name.as_str(), port.shape(context.manifest, g))).collect();
    let outputs: Vec<_> = outputs.iter().map(|port| (port.name.as_str(), port.shape(context.manifest, g))).collect();
    infer_sizes(&model.graph, opset(model)?, &inputs, &outputs, visitor)
}

fn check_tensors(tensors: &[Tensor<'_>], context: ModelContext<'_>) -> CheckResult<Vec<(String, String)>> {
    let mut external: Vec<(String, String)> = Vec::new();
    for tensor in tensors {
        let fault = |cause: String| Fault::new(format!("initializer {}: {cause}", quoted(tensor.name)));
        let shape = tensor_shape(tensor).map_err(|inner| fault(inner.cause))?;
        let bytes = shape.count().and_then(|n| n.checked_mul(shape.element.bytes()));
        match tensor.data {
            Data::Inline(data) => {
                if data.len() > MAX_INLINE {
                    return Err(fault(format!(
                        "{} bytes inside the model, at most {MAX_INLINE} are allowed",
                        data.len()
                    )));
                }
                if bytes != Some(data.len() as u64) {
                    return Err(fault(format!("{} bytes of data for {} {:?}", data.len(), shape.element, shape.dims)));
                }
            }
            Data::External { location, offset, length } => {
                if !matches!(shape.element, DataType::F16 | DataType::U8) {
                    return Err(fault(format!("external data is float16 or uint8, this is {}", shape.element)));
                }
                if bytes != Some(length) {
                    return Err(fault(format!("{length} bytes of data for {} {:?}", shape.element, shape.dims)));
                }
                let file = resolve(location, context).map_err(|inner| fault(inner.cause))?;
                let size = context.manifest.file(&file).map_or(0, |entry| entry.size);
                if !offset.is_multiple_of(2) || offset.checked_add(length).is_none_or(|end| end > size) {
                    return Err(fault(format!("bytes {offset} + {length} of `{file}`, which has {size}")));
                }
                if !external.iter().any(|(known, _)| known == location) {
                    external.push((location.to_owned(), file));
                }
            }
        }
    }
    Ok(external)
}

/// The listed file that an external location names; locations are relative to the model's folder.
fn resolve(location: &str, context: ModelContext<'_>) -> CheckResult<String> {
    if let Some(cause) = names::violation(location) {
        return Err(Fault::new(format!("the location {} is refused: {cause}", quoted(location))));
    }
    let file = match context.path().rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/{location}"),
        None => location.to_owned(),
    };
    let graph = context.manifest.graphs.paths().any(|(_, _, path)| path == file);
    if graph || context.manifest.file(&file).is_none() {
        return Err(Fault::new(format!("the location {} is no listed file of weights", quoted(location))));
    }
    Ok(file)
}
