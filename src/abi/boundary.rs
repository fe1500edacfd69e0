//! Wrapper of every entry point: runs the work, stores errors for the thread, catches panics, returns a result code.

use super::results::{Outcome, cairn_result, remember};
use crate::error::catch_panic;

/// Does the work of `function`: what it answers is given back, a failure's message is kept for the thread, and a panic
/// ends here. Objects that the work had entered are poisoned while it unwinds.
pub(super) fn call(function: &str, work: impl FnOnce() -> Outcome) -> cairn_result {
    // What a panic may leave half done lies behind a gate, which is poisoned, or is made anew.
    match catch_panic(work) {
        Ok(result) => result,
        Err(failure) => {
            remember(function, &failure);
            failure.code
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::results::{CAIRN_ERROR_INTERNAL, CAIRN_ERROR_IO, CAIRN_OK, Failure};
    use super::*;

    #[test]
    fn results_pass_and_failures_and_panics_become_codes() {
        assert_eq!(call("f", || Ok(CAIRN_OK)), CAIRN_OK);
        assert_eq!(call("f", || Err(Failure::new(CAIRN_ERROR_IO, "x"))), CAIRN_ERROR_IO);
        assert_eq!(call("f", || panic!("a {}", "text")), CAIRN_ERROR_INTERNAL);
        assert_eq!(call("f", || std::panic::panic_any(7)), CAIRN_ERROR_INTERNAL);
        struct Spiteful;
        impl Drop for Spiteful {
            fn drop(&mut self) {
                panic!("again");
            }
        }
        assert_eq!(call("f", || std::panic::panic_any(Spiteful)), CAIRN_ERROR_INTERNAL);
    }
}
