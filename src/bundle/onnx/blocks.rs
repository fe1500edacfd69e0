//! Matrices that are stored as integers of 8 or 4 bits and the scales of their blocks, and the products that read them: `MatMulNBits`.

use half::f16;

use super::operators::{NBITS, int_attribute};
use super::proto::{Data, Graph, Node, Tensor};
use super::{Check, Element, Fault, quoted};
use crate::bundle::{GraphKind, Processor, Quantisation};

/// Bytes of the largest stored matrix as each kind of processor unpacks it to multiply by it; 0 if it unpacks none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::bundle) struct Unpacked {
    cpu: u64,
    gpu: u64,
}

impl Unpacked {
    /// Those of `processor`.
    pub(in crate::bundle) fn on(self, processor: Processor) -> u64 {
        match processor {
            Processor::Cpu => self.cpu,
            Processor::Gpu => self.gpu,
        }
    }

    /// The matrix of a product whose activations are of type `element`.
    pub(super) fn of(product: &Node<'_>, element: Element) -> Self {
        let attribute = |name| int_attribute(product, name).unwrap_or(0);
        let size = |name| u64::try_from(attribute(name)).unwrap_or(0);
        let numbers = size("K").saturating_mul(size("N"));
        // Without 8-bit activations the CPU provider has no kernel for 8 bits, and multiplies in float32.
        let is_unpacked_on_cpu = attribute("bits") == 8 && attribute("accuracy_level") != INT8_ACTIVATIONS;
        let cpu = if is_unpacked_on_cpu { numbers.saturating_mul(Element::F32.bytes()) } else { 0 };
        Self { cpu, gpu: numbers.saturating_mul(element.bytes()) }
    }

    /// The larger one on each processor.
    pub(super) fn max(self, other: Self) -> Self {
        Self { cpu: self.cpu.max(other.cpu), gpu: self.gpu.max(other.gpu) }
    }
}

/// The `accuracy_level` that lets the CPU provider round activations to 8 bits.
const INT8_ACTIVATIONS: i64 = 4;

/// Scales of a matrix, whose numbers can be checked once the files of weights are read.
pub(in crate::bundle) struct Scales {
    tensor: String,
    /// Their location as written in the graph.
    pub(in crate::bundle) location: String,
    offset: u64,
    length: u64,
}

impl Scales {
    /// Checks the numbers in `file`, all bytes of the file at [`location`](Self::location).
    ///
    /// # Errors
    /// The cause, with the tensor's name.
    pub(in crate::bundle) fn check(&self, file: &[u8]) -> Result<(), String> {
        let end = self.offset.checked_add(self.length).and_then(|end| usize::try_from(end).ok());
        let bytes = usize::try_from(self.offset).ok().zip(end).and_then(|(start, end)| file.get(start..end));
        let checked = bytes.map_or_else(|| Err("its scales are outside the file".to_owned()), positive);
        checked.map_err(|cause| format!("initializer {}: {cause}", quoted(&self.tensor)))
    }
}

/// Checks that all of these half floats are finite and above 0.
fn positive(bytes: &[u8]) -> Result<(), String> {
    let scales = bytes.as_chunks::<2>().0.iter().map(|&bytes| f16::from_le_bytes(bytes));
    match scales.enumerate().find(|(_, scale)| !(scale.is_finite() && *scale > f16::ZERO)) {
        Some((i, scale)) => Err(format!("scale {i} is {scale}, a scale is finite and above 0")),
        None => Ok(()),
    }
}

/// Checks that the products of `graph` read stored matrices in the form that the manifest states, and returns their scales.
pub(super) fn check_blocks(graph: &Graph<'_>, kind: GraphKind, stated: Option<&Quantisation>) -> Check<Vec<Scales>> {
    let mut found = Vec::new();
    for node in graph.nodes.iter().filter(|node| node.operator == NBITS) {
        let within = |fault: Fault| fault.within(&format!("node {}", quoted(node.name)));
        check_form(node, stated).map_err(within)?;
        let [_, numbers, scales, ..] = node.inputs.as_slice() else {
            return Err(within(Fault::new(format!("{NBITS} has {} inputs", node.inputs.len()))));
        };
        stored(graph, numbers, Element::U8, false).map_err(within)?;
        let scales = stored(graph, scales, Element::F16, true).map_err(within)?;
        match scales.data {
            Data::Inline(bytes) => {
                let inner = |cause| Fault::new(format!("initializer {}: {cause}", quoted(scales.name)));
                positive(bytes).map_err(inner)?;
            }
            Data::External { location, offset, length } => {
                found.push(Scales { tensor: scales.name.to_owned(), location: location.to_owned(), offset, length });
            }
        }
    }
    let has_products = graph.nodes.iter().any(|node| node.operator == NBITS);
    if kind == GraphKind::Transformer && stated.is_some() && !has_products {
        return Err(Fault::new(format!("the manifest states a `quantisation`, and the graph has no {NBITS}")));
    }
    Ok(found)
}

/// Checks that a product has the bits, blocks and activations that the manifest states.
fn check_form(node: &Node<'_>, stated: Option<&Quantisation>) -> Check<()> {
    let Some(stated) = stated else {
        return Err(Fault::new(format!("{NBITS} is there, and the manifest states no `quantisation`")));
    };
    for (name, wanted) in [("bits", stated.bits), ("block_size", stated.block)] {
        let value = int_attribute(node, name);
        if value != Some(i64::from(wanted)) {
            let value = value.map_or("none".to_owned(), |value| value.to_string());
            return Err(Fault::new(format!("{NBITS} has the {name} {value}, the manifest states {wanted}")));
        }
    }
    if int_attribute(node, "accuracy_level") == Some(INT8_ACTIVATIONS) && stated.activation_bits != 8 {
        return Err(Fault::new(format!("{NBITS} rounds activations to 8 bits, the manifest states 16")));
    }
    Ok(())
}

/// The stored tensor called `name`, or one that a `Cast` makes it of if `is_cast_allowed`.
fn stored<'g, 'a>(graph: &'g Graph<'a>, name: &str, element: Element, is_cast_allowed: bool) -> Check<&'g Tensor<'a>> {
    let cast = graph.nodes.iter().find(|node| node.operator == "Cast" && node.outputs.first() == Some(&name));
    let source = cast.filter(|_| is_cast_allowed).and_then(|node| node.inputs.first().copied()).unwrap_or(name);
    let tensor = graph.tensors.iter().find(|tensor| tensor.name == source);
    tensor
        .filter(|tensor| tensor.data_type == element as i64)
        .ok_or_else(|| Fault::new(format!("{NBITS} reads {}, which is no stored tensor of {element}", quoted(name))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_that_is_not_positive_is_found() {
        let bytes = |scales: &[f32]| -> Vec<u8> {
            scales.iter().flat_map(|&scale| f16::from_f32(scale).to_le_bytes()).collect()
        };
        assert_eq!(positive(&bytes(&[1.0, 6e-8, 65504.0])), Ok(()));
        for (scale, text) in
            [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (0.0, "0"), (-0.0, "-0"), (-1.0, "-1"), (1e-9, "0")]
        {
            let cause = positive(&bytes(&[1.0, scale])).unwrap_err();
            assert_eq!(cause, format!("scale 1 is {text}, a scale is finite and above 0"));
        }
        let scales = Scales { tensor: "w.scales".into(), location: "a.bin".into(), offset: 2, length: 4 };
        assert!(scales.check(&bytes(&[-1.0, 1.0, 1.0, 0.0])).is_ok());
        let cause = scales.check(&bytes(&[1.0, 1.0, 0.0])).unwrap_err();
        assert_eq!(cause, "initializer `w.scales`: scale 1 is 0, a scale is finite and above 0");
        let cause = scales.check(&bytes(&[1.0, 1.0])).unwrap_err();
        assert_eq!(cause, "initializer `w.scales`: its scales are outside the file");
    }
}
