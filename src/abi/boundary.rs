//! The one place where a call from C becomes Rust, and where nothing but a result goes back.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use super::results::{CAIRN_ERROR_INTERNAL, Failure, Outcome, cairn_result, remember};
use crate::error::panic_text;

/// Does the work of `function`: what it answers is given back, a failure's message is kept for the thread, and a panic
/// ends here. Objects that the work had entered are poisoned while it unwinds.
pub(super) fn call(function: &str, work: impl FnOnce() -> Outcome) -> cairn_result {
    match guard(work) {
        Ok(result) => result,
        Err(failure) => {
            remember(function, &failure);
            failure.code
        }
    }
}

/// Does `work`; a panic in it is logged and becomes a failure.
pub(super) fn guard<T>(work: impl FnOnce() -> Outcome<T>) -> Outcome<T> {
    // What a panic may leave half done lies behind a gate, which is poisoned, or is made anew.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let failure = panicked(&*payload);
        discard(payload);
        let _ = catch_unwind(|| log::error!(target: "cairn", "{failure}"));
        Err(failure)
    })
}

/// Drops what a panic threw. That is foreign code and may panic as well: what it throws is kept from dropping unless it is text.
fn discard(payload: Box<dyn Any + Send>) {
    if let Err(again) = catch_unwind(AssertUnwindSafe(|| drop(payload)))
        && !again.is::<&str>()
        && !again.is::<String>()
    {
        std::mem::forget(again);
    }
}

fn panicked(payload: &(dyn Any + Send)) -> Failure {
    let what = panic_text(payload).unwrap_or("no message");
    Failure::new(CAIRN_ERROR_INTERNAL, format!("a fault of the library: {what}")).remedy("Please report it")
}

#[cfg(test)]
mod tests {
    use super::super::results::{CAIRN_ERROR_IO, CAIRN_OK};
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
