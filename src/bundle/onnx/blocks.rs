//! Matrices that are stored as integers of 8 or 4 bits and the scales of their blocks, and the products that read them: `MatMulNBits`.

use std::collections::{HashMap, HashSet};

use half::f16;

use super::operators::{NBITS, int_attribute};
use super::proto::{Data, Graph, Node, Tensor};
use super::{CheckResult, DataType, Fault, quoted};
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
    pub(super) fn of(product: &Node<'_>, element: DataType) -> Self {
        let attribute = |name| int_attribute(product, name).unwrap_or(0);
        let size = |name| u64::try_from(attribute(name)).unwrap_or(0);
        let numbers = size("K").saturating_mul(size("N"));
        // Without 8-bit activations the CPU provider has no kernel for 8 bits, and multiplies in float32.
        let is_unpacked_on_cpu = attribute("bits") == 8 && attribute("accuracy_level") != INT8_ACTIVATIONS;
        let cpu = if is_unpacked_on_cpu { numbers.saturating_mul(DataType::F32.bytes()) } else { 0 };
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
    /// Checks the numbers in `file`, all bytes of the file at [`location`](Self::location), but for those before the even offset `checked`.
    ///
    /// # Errors
    /// The cause, with the tensor's name.
    fn check(&self, file: &[u8], checked: u64) -> Result<(), String> {
        let end = self.offset.checked_add(self.length).and_then(|end| usize::try_from(end).ok());
        let bytes = usize::try_from(self.offset).ok().zip(end).and_then(|(start, end)| file.get(start..end));
        let skipped = usize::try_from(checked.saturating_sub(self.offset)).unwrap_or(usize::MAX);
        let numbers = bytes.map(|bytes| positive(bytes, skipped.min(bytes.len())));
        numbers
            .unwrap_or_else(|| Err("its scales are outside the file".to_owned()))
            .map_err(|cause| format!("initializer {}: {cause}", quoted(&self.tensor)))
    }
}

/// Checks the scales in `file` once each, however many tensors share them. `scales` are all of one file.
///
/// # Errors
/// The first damaged tensor by its offset: its place in `scales` and the cause.
pub(in crate::bundle) fn check_scales(scales: &[&Scales], file: &[u8]) -> Result<(), (usize, String)> {
    let mut by_offset: Vec<usize> = (0..scales.len()).collect();
    by_offset.sort_by_key(|&i| scales[i].offset);
    let mut checked = 0;
    for i in by_offset {
        scales[i].check(file, checked).map_err(|cause| (i, cause))?;
        checked = checked.max(scales[i].offset + scales[i].length);
    }
    Ok(())
}

/// Checks that all of these half floats after the first `skipped` bytes are finite and above 0.
fn positive(bytes: &[u8], skipped: usize) -> Result<(), String> {
    let scales = bytes.as_chunks::<2>().0.iter().map(|&bytes| f16::from_le_bytes(bytes));
    match scales.enumerate().skip(skipped / 2).find(|(_, scale)| !(scale.is_finite() && *scale > f16::ZERO)) {
        Some((i, scale)) => Err(format!("scale {i} is {scale}, a scale is finite and above 0")),
        None => Ok(()),
    }
}

/// Checks that the products of `graph` read stored matrices in the form that the manifest states, and returns their scales.
pub(super) fn check_blocks(
    graph: &Graph<'_>,
    kind: GraphKind,
    stated: Option<&Quantisation>,
) -> CheckResult<Vec<Scales>> {
    let (mut found, mut checked) = (Vec::new(), HashSet::new());
    let stored_tensors = StoredTensors::of(graph);
    for node in graph.nodes.iter().filter(|node| node.operator == NBITS) {
        let within = |fault: Fault| fault.within(&format!("node {}", quoted(node.name)));
        check_form(node, stated).map_err(within)?;
        let [_, numbers, scales, ..] = node.inputs.as_slice() else {
            return Err(within(Fault::new(format!("{NBITS} has {} inputs", node.inputs.len()))));
        };
        stored_tensors.get(numbers, DataType::U8, false).map_err(within)?;
        let scales = stored_tensors.get(scales, DataType::F16, true).map_err(within)?;
        if !checked.insert(scales.name) {
            continue;
        }
        match scales.data {
            Data::Inline(bytes) => {
                let inner = |cause| Fault::new(format!("initializer {}: {cause}", quoted(scales.name)));
                positive(bytes, 0).map_err(inner)?;
            }
            Data::External { location, offset, length } => {
                found.push(Scales { tensor: scales.name.to_owned(), location: location.to_owned(), offset, length });
            }
        }
    }
    let has_products = graph.nodes.iter().any(|node| node.operator == NBITS);
    if matches!(kind, GraphKind::Transformer | GraphKind::Joined) && stated.is_some() && !has_products {
        return Err(Fault::new(format!("the manifest states a `quantisation`, and the graph has no {NBITS}")));
    }
    Ok(found)
}

/// Checks that a product has the bits, blocks and activations that the manifest states.
fn check_form(node: &Node<'_>, stated: Option<&Quantisation>) -> CheckResult<()> {
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

/// A graph's stored tensors and its casts, by name. A graph may have tens of thousands of each.
struct StoredTensors<'g, 'a> {
    tensors: HashMap<&'a str, &'g Tensor<'a>>,
    /// The input of each `Cast`, by its output.
    casts: HashMap<&'a str, &'a str>,
}

impl<'g, 'a> StoredTensors<'g, 'a> {
    fn of(graph: &'g Graph<'a>) -> Self {
        let casts = graph.nodes.iter().filter(|node| node.operator == "Cast");
        Self {
            tensors: graph.tensors.iter().map(|tensor| (tensor.name, tensor)).collect(),
            casts: casts.filter_map(|node| Some((*node.outputs.first()?, *node.inputs.first()?))).collect(),
        }
    }

    /// The stored tensor called `name`, or one that a `Cast` makes it of if `is_cast_allowed`.
    fn get(&self, name: &str, element: DataType, is_cast_allowed: bool) -> CheckResult<&'g Tensor<'a>> {
        let cast = self.casts.get(name).filter(|_| is_cast_allowed);
        let tensor = self.tensors.get(cast.copied().unwrap_or(name)).copied();
        tensor.filter(|tensor| tensor.data_type == element as i64).ok_or_else(|| {
            Fault::new(format!("{NBITS} reads {}, which is no stored tensor of {element}", quoted(name)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_that_is_not_positive_is_found() {
        let bytes = |scales: &[f32]| -> Vec<u8> {
            scales.iter().flat_map(|&scale| f16::from_f32(scale).to_le_bytes()).collect()
        };
        assert_eq!(positive(&bytes(&[1.0, 6e-8, 65504.0]), 0), Ok(()));
        for (scale, text) in
            [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (0.0, "0"), (-0.0, "-0"), (-1.0, "-1"), (1e-9, "0")]
        {
            let cause = positive(&bytes(&[1.0, scale]), 0).unwrap_err();
            assert_eq!(cause, format!("scale 1 is {text}, a scale is finite and above 0"));
        }
        let scales = |offset, length| Scales { tensor: "w.scales".into(), location: "a.bin".into(), offset, length };
        assert!(scales(2, 4).check(&bytes(&[-1.0, 1.0, 1.0, 0.0]), 0).is_ok());
        let cause = scales(2, 4).check(&bytes(&[1.0, 1.0, 0.0]), 0).unwrap_err();
        assert_eq!(cause, "initializer `w.scales`: scale 1 is 0, a scale is finite and above 0");
        let cause = scales(2, 4).check(&bytes(&[1.0, 1.0]), 0).unwrap_err();
        assert_eq!(cause, "initializer `w.scales`: its scales are outside the file");

        // Tensors that overlap, in another order than in the file.
        let shared = [scales(4, 4), scales(0, 4), scales(2, 6), scales(0, 8)];
        let shared: Vec<&Scales> = shared.iter().collect();
        assert_eq!(check_scales(&shared, &bytes(&[1.0; 4])), Ok(()));
        for (wrong, tensor, number) in [(0, 1, 0), (1, 1, 1), (2, 3, 2), (3, 3, 3)] {
            let mut numbers = [1.0; 4];
            numbers[wrong] = 0.0;
            let (found, cause) = check_scales(&shared, &bytes(&numbers)).unwrap_err();
            assert!(found == tensor && cause.contains(&format!("scale {number} is 0")), "{wrong}: {found}, {cause}");
        }
    }
}
