//! Every call to Direct3D, or to AMD's libraries, fails in turn while a host calls the C interface. One call fails, or it fails with all later ones:
//! to Direct3D since the device is removed. Calls of AMD's libraries also throw C++ exceptions. Each of the host's calls returns an error with a
//! message or succeeds. After a single failure the same call succeeds; after a removal the device is said to be removed; and AMD's libraries are
//! used again once they no longer fail. Results are right, rules are kept, and no reference stays.

use std::collections::HashSet;

use cairn::abi::results::{
    CAIRN_ERROR_DEVICE, CAIRN_ERROR_DEVICE_REMOVED, CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_OK, cairn_last_error, cairn_result,
};
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::d3d12::recorder;
use test_support::ffx::failing_calls::{FailingCalls, Manner};

mod amd;
mod amd_swapchain;
mod frames;
mod worlds;

/// Whose calls fail.
#[derive(Clone, Copy)]
enum Source {
    Direct3d,
    /// To Direct3D, while AMD's libraries use it.
    BeneathAmd(&'static FailingCalls),
    Amd(&'static FailingCalls),
}

/// A call that fails, by its number, from 1 on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Failure {
    /// For lack of memory.
    Once(u64),
    /// With all later ones, since the device is removed.
    Removal(u64),
    /// With all later ones, of AMD's libraries.
    ForEver(u64),
    /// With a C++ exception, of AMD's libraries.
    Throwing(u64),
}

impl Source {
    fn set(self, failure: Option<Failure>) {
        match self {
            Self::Direct3d | Self::BeneathAmd(_) => recorder::set_failure(failure.map(|failure| match failure {
                Failure::Once(call) | Failure::Throwing(call) => recorder::Failure::Once(call),
                Failure::Removal(call) | Failure::ForEver(call) => recorder::Failure::Removal(call),
            })),
            Self::Amd(calls) => match failure {
                None => calls.set(0, Manner::Once),
                Some(Failure::Once(call)) => calls.set(call, Manner::Once),
                Some(Failure::ForEver(call) | Failure::Removal(call)) => calls.set(call, Manner::ForEver),
                Some(Failure::Throwing(call)) => calls.set(call, Manner::Throwing),
            },
        }
    }

    fn while_failing<T>(self, work: impl FnOnce() -> T) -> (T, u64) {
        match self {
            Self::Direct3d | Self::BeneathAmd(_) => recorder::while_failing(work),
            Self::Amd(calls) => calls.while_failing(work),
        }
    }
}

/// Calls of the C interface with a failing call below them.
struct Trial<'a> {
    engine: &'a Engine,
    source: Source,
    failure: Option<Failure>,
    /// Calls below so far.
    calls: u64,
    /// Calls of the C interface that failed.
    failed: u32,
}

impl Trial<'_> {
    /// Makes a call, and again if it fails: then it succeeds, unless the device was removed. Returns whether it succeeded.
    fn call(&mut self, what: &str, call: impl Fn() -> cairn_result) -> bool {
        let result = self.attempt(&call);
        if result == CAIRN_OK {
            return true;
        }
        self.failed += 1;
        let how = format!("{what} with {:?}: {result}, {}", self.failure, message());
        assert!(!message().is_empty(), "{how}");
        if let Some(Failure::Removal(_)) = self.failure {
            let again = self.attempt(&call);
            assert_eq!([result, again], [CAIRN_ERROR_DEVICE_REMOVED; 2], "{how}");
            return false;
        }
        let is_expected = |result| [CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_ERROR_DEVICE].contains(&result);
        assert!(is_expected(result), "{how}");
        if let Some(Failure::ForEver(_)) = self.failure {
            let again = self.attempt(&call);
            assert!(is_expected(again) && !message().is_empty(), "{how}; again: {again}, {}", message());
        }
        assert_eq!(call(), CAIRN_OK, "{how}; again: {}", message());
        true
    }

    /// Does something with the failing call.
    fn attempt<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let (result, calls) = self.source.while_failing(work);
        self.calls = calls;
        result
    }

    /// Ends an object, which always succeeds.
    fn end(&mut self, what: &str, end: impl Fn() -> cairn_result) {
        let ended = self.attempt(end);
        assert_eq!(ended, CAIRN_OK, "{what} with {:?}: {}", self.failure, message());
    }
}

/// The last error's message.
fn message() -> String {
    let mut text = [0; 512];
    let mut length = 0;
    // SAFETY: a buffer of that size and a variable.
    unsafe { cairn_last_error(text.as_mut_ptr(), text.len(), &mut length) };
    text_of(&text)
}

/// A text that ends with a NUL.
fn text_of(text: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Whether failures are to reach the host, in at least one call of the C interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reach {
    Host,
    /// The library falls back to its own code, and no call of the host fails.
    Nobody,
}

/// Numbers of the calls that fail: about `count` of all. Where `CAIRN_EVERY_FAILURE` is set, all, or the first one of each place in the program if
/// it is "places".
fn chosen_calls(source: Source, all: u64, count: u64) -> Vec<u64> {
    let every = std::env::var_os("CAIRN_EVERY_FAILURE");
    match (every.as_ref().map(|every| every == "places"), source) {
        (Some(true), Source::Direct3d | Source::BeneathAmd(_)) => {
            let mut seen = HashSet::new();
            let numbered = (1..).zip(recorder::call_sites());
            numbered.filter(|(_, site)| seen.insert(*site)).map(|(call, _)| call).collect()
        }
        (Some(_), _) => (1..=all).collect(),
        (None, _) => (1..=all).step_by((all / count).max(1) as usize).collect(),
    }
}

/// Lets calls of `act` fail in turn, those of [`chosen_calls`]. Broken rules are printed, since the list
/// of known ones is the runner's.
fn fail_each(source: Source, reach: Reach, failure: fn(u64) -> Failure, count: u64, act: impl Fn(&mut Trial<'_>)) {
    let engine = Engine::create();
    let references = || [reference_count(&engine.device), reference_count(&engine.direct)];
    let before = references();
    let trial = |failure| {
        source.set(failure);
        let mut trial = Trial { engine: &engine, source, failure, calls: 0, failed: 0 };
        act(&mut trial);
        if let Source::Amd(calls) = source {
            // A context that AMD's library does not destroy is lost; no other may stay.
            let (left, not_destroyed) = calls.destroy_contexts();
            assert_eq!(left, not_destroyed, "contexts of AMD's stay with {failure:?}");
        }
        // AMD's own libraries throw where Direct3D fails, and lose what they had created.
        if !(failure.is_some() && matches!(source, Source::BeneathAmd(calls) if calls.is_amds)) {
            wait_for_counts(references, before);
        }
        (trial.calls, trial.failed)
    };
    // The first one may make other calls than those after it: libraries stay loaded.
    assert_eq!(trial(None).1, 0, "nothing fails");
    let (all, failed) = trial(None);
    assert_eq!(failed, 0, "nothing fails again");
    let least = if matches!(source, Source::Amd(_)) { 9 } else { 50 };
    assert!(all > least, "{all} calls were counted");
    let trials = chosen_calls(source, all, count);
    let fail = |(number, call): (usize, &u64)| {
        println!("trial {number} of {}: {:?} of {all} calls", trials.len(), failure(*call));
        trial(Some(failure(*call))).1
    };
    let failures: u32 = (1..).zip(&trials).map(fail).sum();
    println!("{all} calls, of which {} failed; {failures} calls of the C interface failed", trials.len());
    assert_eq!(failures > 0, reach == Reach::Host, "failures reach the host");
}
