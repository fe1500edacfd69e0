//! Explains why a provider cannot load a world with small weights, and names the bundle that would work.

use crate::bundle::Manifest;
use crate::{Error, ErrorKind};

/// The operator that multiplies by matrices in 8 or 4 bits.
const OPERATOR: &str = "MatMulNBits";
/// What ONNX Runtime says if a node would run on the processor and that is forbidden. It does not name the node.
const FALLBACK: &str = "fallback to CPU EP";
/// The entry of the provenance that names the bundle with 16-bit weights.
const ORIGIN: &str = "quantised_from";

/// `error`, except that a failure for want of the operator becomes `Unsupported`, with the operator and the bundle that `device` can load.
pub(super) fn explain(error: Error, manifest: &Manifest, device: &str) -> Error {
    let Some(quantisation) = &manifest.quantisation else { return error };
    let is_missing = [OPERATOR, FALLBACK].iter().any(|text| error.cause().contains(text));
    if error.kind() != ErrorKind::Device || !is_missing {
        return error;
    }
    let origin = manifest.provenance.get(ORIGIN).map_or_else(String::new, |name| format!(": {name}"));
    Error::new(
        ErrorKind::Unsupported,
        format!(
            "{device} has no {OPERATOR} for weights of {} bits in blocks of {}: {}",
            quantisation.bits,
            quantisation.block,
            error.cause()
        ),
    )
    .field("quantisation")
    .remedy(format!(
        "Load the bundle with 16-bit weights that this one was made from{origin}; or use ONNX Runtime 1.24.4"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::Quantisation;
    use crate::world::fixture;

    /// A manifest of a world with 8-bit weights.
    fn small() -> Manifest {
        let mut manifest = fixture::manifest();
        let kept_in_16_bits = vec!["blocks.0".to_owned()];
        manifest.quantisation = Some(Quantisation { bits: 8, block: 32, activation_bits: 16, kept_in_16_bits });
        manifest.provenance.insert(ORIGIN.to_owned(), "Place, 0123abcd".to_owned());
        manifest
    }

    #[test]
    fn a_provider_without_the_operator_is_told_from_other_failures() {
        // Messages of ONNX Runtime 1.24: no kernel, no such operator, other bits, and a node that only the processor can run.
        for message in [
            "Could not find an implementation for MatMulNBits(1) node with name 'blocks.0.attn.qkv/MatMulNBits'",
            "Fatal error: com.microsoft:MatMulNBits(-1) is not a registered function/op",
            "nbits_ == 4 was false. Only 4b quantization is supported for MatMulNBits op",
            "This session contains graph nodes that are assigned to the default CPU EP, but fallback to CPU EP has been explicitly disabled \
             by the user.",
        ] {
            let failure = || Error::new(ErrorKind::Device, message);
            let error = explain(failure(), &small(), "ONNX Runtime 1.19.0 CPU");
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some("quantisation")));
            let text = error.to_string();
            for part in
                ["1.19.0 CPU has no MatMulNBits for weights of 8 bits in blocks of 32", message, "Place, 0123abcd"]
            {
                assert!(text.contains(part), "{text}");
            }
            let same = explain(failure(), &fixture::manifest(), "CPU");
            assert_eq!((same.kind(), same.cause()), (ErrorKind::Device, message));
        }
        let exhausted = explain(Error::new(ErrorKind::OutOfMemory, "MatMulNBits"), &small(), "CPU");
        assert_eq!(exhausted.kind(), ErrorKind::OutOfMemory);
        let other = explain(Error::new(ErrorKind::Device, "no space left"), &small(), "CPU");
        assert_eq!((other.kind(), other.cause()), (ErrorKind::Device, "no space left"));
    }
}
