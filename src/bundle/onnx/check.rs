//! Checks a whole model against the contract.

use super::interface::Interface;
use super::operators::check_node;
use super::proto::{self, Data, Model, Tensor};
use super::sizes::{Footprint, tensor_shape, walk};
use super::{Check, Element, Fault, quoted};
use crate::bundle::{GraphKind, Manifest, Precision, invalid, names};
use crate::{Error, ErrorKind, Result};

/// The largest model without its weights, in bytes.
const MAX_MODEL: usize = 8 << 20;
/// The largest initializer stored in the model file, in bytes.
const MAX_INSIDE: usize = 64 << 10;
const IR_VERSIONS: std::ops::RangeInclusive<i64> = 8..=10;
const OPSETS: std::ops::RangeInclusive<i64> = 17..=20;

/// External data that a checked model refers to.
pub(in crate::bundle) struct Checked {
    /// Each external location as written in the graph, with the bundle file it names; no duplicates.
    pub(in crate::bundle) external: Vec<(String, String)>,
}

/// Which model of which bundle.
#[derive(Clone, Copy)]
pub(in crate::bundle) struct Subject<'a> {
    pub(in crate::bundle) manifest: &'a Manifest,
    pub(in crate::bundle) kind: GraphKind,
    pub(in crate::bundle) precision: Precision,
}

impl Subject<'_> {
    fn path(&self) -> &str {
        self.manifest.graphs.of(self.precision).map_or("", |files| files.of(self.kind))
    }

    fn refuse(&self, fault: Fault) -> crate::Error {
        if fault.memory {
            return Error::new(ErrorKind::OutOfMemory, fault.cause).field(self.path());
        }
        invalid(self.path(), fault.cause, "Build the model again, or convert it as docs/bundle.md section 4 says")
    }
}

/// Checks the model `onnx` against section 4 of the format.
///
/// # Errors
/// `InvalidBundle` with the model's file name.
pub(in crate::bundle) fn check(onnx: &[u8], subject: Subject<'_>) -> Result<Checked> {
    inspect(onnx, subject).map_err(|fault| subject.refuse(fault))
}

/// The memory of a checked model at the global window `g`.
///
/// # Errors
/// `InvalidBundle` if shape inference fails at this window.
pub(in crate::bundle) fn footprint(onnx: &[u8], subject: Subject<'_>, g: u32) -> Result<Footprint> {
    parse(onnx).and_then(|model| sized(&model, subject, g)).map_err(|fault| subject.refuse(fault))
}

fn parse(onnx: &[u8]) -> Check<Model<'_>> {
    if onnx.len() > MAX_MODEL {
        return Err(Fault::new(format!("the model has {} bytes, at most {MAX_MODEL} are read", onnx.len())));
    }
    proto::model(onnx)
}

fn opset(model: &Model<'_>) -> Check<i64> {
    match model.opsets.as_slice() {
        [("" | "ai.onnx", version)] if OPSETS.contains(version) => Ok(*version),
        other => {
            let list: Vec<String> = other.iter().map(|(domain, v)| format!("{} {v}", quoted(domain))).collect();
            Err(Fault::new(format!(
                "the opsets are [{}]; the default domain alone, 17 to 20, is allowed",
                list.join(", ")
            )))
        }
    }
}

fn inspect(onnx: &[u8], subject: Subject<'_>) -> Check<Checked> {
    let model = parse(onnx)?;
    if !IR_VERSIONS.contains(&model.ir_version) {
        return Err(Fault::new(format!("the IR version is {}, 8 to 10 are allowed", model.ir_version)));
    }
    opset(&model)?;
    for node in &model.graph.nodes {
        check_node(node).map_err(|fault| fault.within(&format!("node {}", quoted(node.name))))?;
    }
    Interface::of(subject.kind, subject.precision, subject.manifest)
        .check(&model.graph.inputs, &model.graph.outputs)?;
    let external = check_tensors(&model.graph.tensors, subject)?;
    // Shape inference must succeed at the smallest, the stock and the largest window. Other windows are checked when used.
    let window = subject.manifest.geometry.global;
    for g in [window.dilation, window.window, window.max_window] {
        sized(&model, subject, g)?;
    }
    Ok(Checked { external })
}

fn sized(model: &Model<'_>, subject: Subject<'_>, g: u32) -> Check<Footprint> {
    let Interface { inputs, outputs } = Interface::of(subject.kind, subject.precision, subject.manifest);
    let inputs: Vec<_> = inputs.iter().map(|port| (port.name.as_str(), port.shape(subject.manifest, g))).collect();
    let outputs: Vec<_> = outputs.iter().map(|port| (port.name.as_str(), port.shape(subject.manifest, g))).collect();
    walk(&model.graph, opset(model)?, &inputs, &outputs)
}

fn check_tensors(tensors: &[Tensor<'_>], subject: Subject<'_>) -> Check<Vec<(String, String)>> {
    let mut external: Vec<(String, String)> = Vec::new();
    for tensor in tensors {
        let fault = |cause: String| Fault::new(format!("initializer {}: {cause}", quoted(tensor.name)));
        let shape = tensor_shape(tensor).map_err(|inner| fault(inner.cause))?;
        let bytes = shape.count().and_then(|n| n.checked_mul(shape.element.bytes()));
        match tensor.data {
            Data::Inside(data) => {
                if data.len() > MAX_INSIDE {
                    return Err(fault(format!(
                        "{} bytes inside the model, at most {MAX_INSIDE} are allowed",
                        data.len()
                    )));
                }
                if bytes != Some(data.len() as u64) {
                    return Err(fault(format!("{} bytes of data for {} {:?}", data.len(), shape.element, shape.dims)));
                }
            }
            Data::External { location, offset, length } => {
                if shape.element != Element::F16 {
                    return Err(fault(format!("external data is float16, this is {}", shape.element)));
                }
                if bytes != Some(length) {
                    return Err(fault(format!("{length} bytes of data for {} {:?}", shape.element, shape.dims)));
                }
                let file = resolve(location, subject).map_err(|inner| fault(inner.cause))?;
                let size = subject.manifest.file(&file).map_or(0, |entry| entry.size);
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

/// The listed file that an external location names, relative to the model's own folder.
fn resolve(location: &str, subject: Subject<'_>) -> Check<String> {
    if let Some(cause) = names::fault(location) {
        return Err(Fault::new(format!("the location {} is refused: {cause}", quoted(location))));
    }
    let file = match subject.path().rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/{location}"),
        None => location.to_owned(),
    };
    let graph = subject.manifest.graphs.paths().any(|(_, _, path)| path == file);
    if graph || subject.manifest.file(&file).is_none() {
        return Err(Fault::new(format!("the location {} is no listed file of weights", quoted(location))));
    }
    Ok(file)
}
