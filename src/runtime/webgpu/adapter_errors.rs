//! Errors of the adapter that no call returns: WebGPU's implementation gives them to a callback, on the thread of the call, and the provider logs
//! them. A buffer for which there was no memory is such an error; work that names it is dropped.

use std::sync::atomic::{AtomicBool, Ordering};

use super::plugin::LOCK;
use crate::locks::Mutex;
use crate::runtime::failure::FAILED_WAIT;
use crate::{Error, ErrorKind, Result};

/// The provider's words before the error's type.
const START: &str = "WebGPU device error(";
/// `WGPUErrorType_OutOfMemory` of `webgpu.h`.
const OUT_OF_MEMORY: &str = "3";

/// Whether a wait for the device has failed in this process. The provider then leaves the wait's callback behind. When the provider is unloaded, the
/// callback would write to a stack frame that is gone.
pub(super) static WAIT_FAILED: AtomicBool = AtomicBool::new(false);

/// The first error since the last call that asked.
static FOUND: Mutex<Option<Error>> = Mutex::new(None);

/// Notes a message of ONNX Runtime's if it is such an error.
pub(in crate::runtime) fn note(message: &str) {
    if let Some(error) = error_of(message) {
        FOUND.lock().get_or_insert(error);
    }
}

fn error_of(message: &str) -> Option<Error> {
    let (_, rest) = message.split_once(START)?;
    let (kind, text) = rest.split_once(')')?;
    let text = text.trim_start_matches(':').trim();
    Some(if kind == OUT_OF_MEMORY {
        Error::new(ErrorKind::OutOfMemory, format!("the adapter has no memory left: {text}"))
            .remedy("Free memory of the adapter, or load the world at a smaller global window")
    } else {
        Error::new(ErrorKind::Device, format!("the adapter reports an error: {text}"))
    })
}

/// Makes a call that reaches the provider, under its lock. An error that the provider only logs is the call's.
///
/// # Errors
/// As `call`; `OutOfMemory` or `Device` for an error of the adapter.
pub(super) fn call_provider<T>(call: impl FnOnce() -> Result<T>) -> Result<T> {
    // Until the result, which may be an object of the provider's, is dropped.
    let _held = LOCK.lock();
    FOUND.lock().take();
    let done = call();
    if done.as_ref().is_err_and(|error| error.cause().contains(FAILED_WAIT)) {
        WAIT_FAILED.store(true, Ordering::Relaxed);
    }
    // Not in the match, where it would be locked while a result is dropped, of which the provider may log an error.
    let found = FOUND.lock().take();
    match (done, found) {
        (Err(error), _) if error.kind() == ErrorKind::DeviceRemoved => Err(error),
        (_, Some(error)) => Err(error),
        (done, None) => done,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_known_by_their_type() {
        let kind = |message| error_of(message).map(|error| error.kind());
        assert_eq!(kind("WebGPU device error(3): vkAllocateMemory failed"), Some(ErrorKind::OutOfMemory));
        assert_eq!(kind("[E] WebGPU device error(2): [Invalid Buffer] is invalid."), Some(ErrorKind::Device));
        assert_eq!(kind("WebGPU device lost (1): reset"), None);
    }
}
