//! Every call to Direct3D fails in turn, once for lack of memory, or with all later ones since the device is removed, while a host calls the C
//! interface: each of its calls returns an error with a message or succeeds, and after a failure the same call succeeds, or the device is said
//! to be removed. Results are right, rules are kept, and no reference stays.

use cairn::abi::results::{
    CAIRN_ERROR_DEVICE, CAIRN_ERROR_DEVICE_REMOVED, CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_OK, cairn_last_error, cairn_result,
};
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::d3d12::recorder::{Failure, set_failure, while_failing};

mod frames;
mod worlds;

/// Calls of the C interface with a failing call to Direct3D.
struct Trial<'a> {
    engine: &'a Engine,
    failure: Option<Failure>,
    /// Calls to Direct3D so far.
    calls: u64,
    /// Calls of the C interface that failed.
    failed: u32,
}

impl Trial<'_> {
    /// Makes a call, and once more if it fails: then it succeeds, unless the device was removed. Returns whether it succeeded.
    fn call(&mut self, what: &str, call: impl Fn() -> cairn_result) -> bool {
        let (result, calls) = while_failing(&call);
        self.calls = calls;
        if result == CAIRN_OK {
            return true;
        }
        self.failed += 1;
        let how = format!("{what} with {:?}: {result}, {}", self.failure, message());
        assert!(!message().is_empty(), "{how}");
        if let Some(Failure::Removal(_)) = self.failure {
            let (again, _) = while_failing(&call);
            assert_eq!([result, again], [CAIRN_ERROR_DEVICE_REMOVED; 2], "{how}");
            return false;
        }
        assert!([CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_ERROR_DEVICE].contains(&result), "{how}");
        assert_eq!(call(), CAIRN_OK, "{how}; again: {}", message());
        true
    }

    /// Ends an object, which always succeeds.
    fn end(&mut self, what: &str, end: impl Fn() -> cairn_result) {
        let (ended, calls) = while_failing(end);
        self.calls = calls;
        assert_eq!(ended, CAIRN_OK, "{what} with {:?}: {}", self.failure, message());
    }
}

/// The last error's message.
fn message() -> String {
    let mut text = [0; 512];
    let mut length = 0;
    // SAFETY: a buffer of that size and a variable.
    unsafe { cairn_last_error(text.as_mut_ptr(), text.len(), &mut length) };
    let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Lets calls of `act` fail in turn: about `count` of them, or all where `CAIRN_EVERY_FAILURE` is set. Broken rules are printed, since the list
/// of known ones is the runner's.
fn fail_each(failure: fn(u64) -> Failure, count: u64, act: impl Fn(&mut Trial<'_>)) {
    let engine = Engine::create();
    let references = || [reference_count(&engine.device), reference_count(&engine.direct)];
    let before = references();
    let trial = |failure| {
        set_failure(failure);
        let mut trial = Trial { engine: &engine, failure, calls: 0, failed: 0 };
        act(&mut trial);
        wait_for_counts(references, before);
        (trial.calls, trial.failed)
    };
    let (all, failed) = trial(None);
    assert_eq!(failed, 0, "nothing fails");
    assert!(all > 50, "{all} calls were counted");
    let is_every = std::env::var_os("CAIRN_EVERY_FAILURE").is_some();
    let step = if is_every { 1 } else { (all / count).max(1) };
    let failures: u32 = (1..=all).step_by(step as usize).map(|call| trial(Some(failure(call))).1).sum();
    println!("{all} calls; {failures} calls of the C interface failed");
    assert!(failures > 0, "failures reach the host");
}
