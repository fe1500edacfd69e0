//! ONNX Runtime's failures in this library's words.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::panic_text;
use crate::{Error, ErrorKind, Result};

/// Turns a failure of ONNX Runtime while it did `what` into an [`Error`].
///
/// It has no status code of its own for exhausted memory, so its message decides.
pub(super) fn ort_failure<R>(what: &str, error: &ort::Error<R>) -> Error {
    said(what, error.message())
}

fn said(what: &str, message: &str) -> Error {
    let exhausted = ["Failed to allocate memory", "bad_alloc", "bad allocation"].iter().any(|s| message.contains(s));
    let kind = if exhausted { ErrorKind::OutOfMemory } else { ErrorKind::Device };
    Error::new(kind, format!("ONNX Runtime could not {what}: {}", message.trim_end_matches(['.', '\n'])))
}

/// Does `work`, which only makes things, and turns its failure to do `what` into an [`Error`]. So with a panic, in which the
/// crate that binds ONNX Runtime ends where a call fails that it takes for infallible.
pub(super) fn make<T, R>(what: &str, work: impl FnOnce() -> Result<T, ort::Error<R>>) -> Result<T> {
    // What it had begun is dropped with it, and it changes nothing else.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(made) => made.map_err(|e| ort_failure(what, &e)),
        Err(payload) => Err(said(what, panic_text(&*payload).unwrap_or("a call that should not fail did"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_while_something_is_made_is_an_error() {
        assert_eq!(make::<_, ()>("count", || Ok(3)).unwrap(), 3);
        let error = make::<(), ()>("count", || panic!("no {}", "fingers.")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Device);
        assert!(error.to_string().contains("ONNX Runtime could not count: no fingers"), "{error}");
        let error = make::<(), ()>("count", || panic!("Failed to allocate memory")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::OutOfMemory);
    }
}
