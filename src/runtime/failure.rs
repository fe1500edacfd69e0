//! Converts ONNX Runtime's failures to [`Error`]s.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::panic_text;
use crate::{Error, ErrorKind, Result};

/// The WebGPU provider's words for a wait that ended because the device was lost.
pub(super) const FAILED_WAIT: &str = "Failed to wait for the operation";

/// Converts a failure of ONNX Runtime to an [`Error`]; `what` is the failed operation, in the infinitive.
///
/// ONNX Runtime has no status code for exhausted memory or a lost device, so the message is searched.
pub(super) fn ort_failure<R>(what: &str, error: &ort::Error<R>) -> Error {
    message_error(what, error.message())
}

fn message_error(what: &str, message: &str) -> Error {
    // The number is E_OUTOFMEMORY, as the DirectML provider writes it; the words after it are in the system's language.
    const EXHAUSTED: [&str; 4] = ["Failed to allocate memory", "bad_alloc", "bad allocation", "8007000E"];
    let exhausted = EXHAUSTED.iter().any(|s| message.contains(s));
    let cause = format!("ONNX Runtime could not {what}: {}", message.trim_end_matches(['.', '\n']));
    // The second are Dawn's words, on which the WebGPU provider is built.
    if [FAILED_WAIT, "[Device] is lost"].iter().any(|s| message.contains(s)) {
        return Error::new(ErrorKind::DeviceRemoved, cause)
            .remedy("Release all objects that were made on the lost device, then make a new one");
    }
    Error::new(if exhausted { ErrorKind::OutOfMemory } else { ErrorKind::Device }, cause)
}

/// Calls `work`, which only creates objects, and converts a failure or a panic into an [`Error`] that says what failed, `what`. The
/// `ort` crate panics where it assumes that a call cannot fail.
pub(super) fn make<T, R>(what: &str, work: impl FnOnce() -> Result<T, ort::Error<R>>) -> Result<T> {
    // Unwind safe: objects that `work` created are dropped, and it changes nothing else.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(made) => made.map_err(|e| ort_failure(what, &e)),
        Err(payload) => Err(message_error(what, panic_text(&*payload).unwrap_or("a call that should not fail did"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_in_a_creation_call_is_an_error() {
        assert_eq!(make::<_, ()>("count", || Ok(3)).unwrap(), 3);
        let error = make::<(), ()>("count", || panic!("no {}", "fingers.")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Device);
        assert!(error.to_string().contains("ONNX Runtime could not count: no fingers"), "{error}");
        for (message, kind) in [
            ("Failed to allocate memory", ErrorKind::OutOfMemory),
            (
                "DmlCommittedResourceAllocator.cpp(22) Exception(3) tid(4304) 8007000E Nicht genug Speicher",
                ErrorKind::OutOfMemory,
            ),
            ("MapAsyncStatus value: 4, message: [Device] is lost.", ErrorKind::DeviceRemoved),
            ("Failed to wait for the operation:2", ErrorKind::DeviceRemoved),
        ] {
            assert_eq!(make::<(), ()>("count", || panic!("{message}")).unwrap_err().kind(), kind);
        }
    }
}
