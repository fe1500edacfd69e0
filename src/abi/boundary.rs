//! Wrapper of every entry point: runs the work, stores errors for the thread, catches panics, returns a result code.

use super::results::{AbiResult, cairn_result, set_last_error};
use crate::error::catch_panic;

/// Runs the body of the entry point `function` and returns its result code. A failure's message becomes the thread's last error. A
/// panic is caught here and becomes CAIRN_ERROR_INTERNAL; objects that the body had entered are poisoned.
pub(super) fn call(function: &str, work: impl FnOnce() -> AbiResult) -> cairn_result {
    // Unwind safety: state that a panic leaves inconsistent belongs to an object, whose gate is then poisoned, or to this call alone.
    match catch_panic(work) {
        Ok(result) => result,
        Err(failure) => {
            set_last_error(function, &failure);
            failure.code
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::results::{CAIRN_ERROR_INTERNAL, CAIRN_ERROR_IO, CAIRN_OK, Failure};
    use super::*;

    #[test]
    fn failures_and_panics_become_result_codes() {
        assert_eq!(call("f", || Ok(CAIRN_OK)), CAIRN_OK);
        assert_eq!(call("f", || Err(Failure::new(CAIRN_ERROR_IO, "x"))), CAIRN_ERROR_IO);
        assert_eq!(call("f", || panic!("a {}", "text")), CAIRN_ERROR_INTERNAL);
        assert_eq!(call("f", || std::panic::panic_any(7)), CAIRN_ERROR_INTERNAL);
        struct PanicsInDrop;
        impl Drop for PanicsInDrop {
            fn drop(&mut self) {
                panic!("again");
            }
        }
        assert_eq!(call("f", || std::panic::panic_any(PanicsInDrop)), CAIRN_ERROR_INTERNAL);
    }
}
