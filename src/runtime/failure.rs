//! ONNX Runtime's failures in this library's words.

use crate::{Error, ErrorKind};

/// Turns a failure of ONNX Runtime while it did `what` into an [`Error`].
///
/// It has no status code of its own for exhausted memory, so its message decides.
pub(super) fn ort_failure<R>(what: &str, error: &ort::Error<R>) -> Error {
    let message = error.message();
    let exhausted = ["Failed to allocate memory", "bad_alloc", "bad allocation"].iter().any(|s| message.contains(s));
    let kind = if exhausted { ErrorKind::OutOfMemory } else { ErrorKind::Device };
    Error::new(kind, format!("ONNX Runtime could not {what}: {}", message.trim_end_matches(['.', '\n'])))
}
