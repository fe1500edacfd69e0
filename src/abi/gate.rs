//! Tracks the calls that are using an object, so that its destruction can wait for them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::ThreadId;

use crate::locks::{Condvar, Mutex};

/// How a call shares an object with other calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CallKind {
    /// It may run at the same time as any other.
    Concurrent,
    /// It may run at the same time as concurrent calls, and not as another serialized one.
    Serialized,
}

/// The calls that are using an object, by thread. Its lock is never held while foreign code runs.
#[derive(Debug, Default)]
pub(super) struct Gate {
    calls: Mutex<ActiveCalls>,
    empty: Condvar,
    poisoned: AtomicBool,
}

#[derive(Debug, Default)]
struct ActiveCalls {
    /// The thread of each call; a thread with nested calls is in it several times.
    threads: Vec<ThreadId>,
    /// Whether one of them is serialized.
    has_serialized: bool,
}

impl Gate {
    /// Enters a call; `false` if it is serialized and another such call is active.
    pub(super) fn enter(&self, kind: CallKind) -> bool {
        let is_serialized = kind == CallKind::Serialized;
        let mut calls = self.calls.lock();
        if is_serialized && calls.has_serialized {
            return false;
        }
        calls.has_serialized |= is_serialized;
        calls.threads.push(counted_thread());
        true
    }

    /// Leaves a call that entered with the same `kind`.
    pub(super) fn leave(&self, kind: CallKind) {
        let thread = counted_thread();
        let mut calls = self.calls.lock();
        if let Some(at) = calls.threads.iter().rposition(|active| *active == thread) {
            calls.threads.swap_remove(at);
        }
        calls.has_serialized &= kind != CallKind::Serialized;
        if calls.threads.is_empty() {
            self.empty.notify_all();
        }
    }

    /// Whether this thread has an active call: then this is a callback of that call.
    pub(super) fn has_call_of_this_thread(&self) -> bool {
        self.calls.lock().threads.contains(&counted_thread())
    }

    /// Waits until no call is active.
    pub(super) fn wait_empty(&self) {
        let mut calls = self.calls.lock();
        while !calls.threads.is_empty() {
            self.empty.wait(&mut calls);
        }
    }

    /// Marks the object as possibly broken.
    pub(super) fn poison(&self) {
        self.poisoned.store(true, Ordering::Release);
    }

    pub(super) fn is_poisoned(&self) -> bool {
        self.poisoned.load(Ordering::Acquire)
    }
}

/// The thread that a call is counted for: within a share of a parallel loop, the thread that called the loop.
fn counted_thread() -> ThreadId {
    crate::tasks::calling_thread()
}

#[cfg(test)]
mod tests {
    use super::CallKind::{Concurrent, Serialized};
    use super::*;

    #[test]
    fn one_serialized_call_and_any_number_of_concurrent_calls() {
        let gate = Gate::default();
        assert!(gate.enter(Serialized) && gate.enter(Concurrent) && gate.enter(Concurrent));
        assert!(!gate.enter(Serialized));
        gate.leave(Concurrent);
        assert!(!gate.enter(Serialized));
        gate.leave(Serialized);
        assert!(gate.enter(Serialized) && gate.has_call_of_this_thread());
        std::thread::scope(|scope| {
            scope.spawn(|| assert!(!gate.has_call_of_this_thread()));
        });
    }

    #[test]
    fn wait_empty_waits_for_active_calls() {
        let gate = Gate::default();
        let waited = AtomicBool::new(false);
        assert!(gate.enter(Concurrent));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                gate.wait_empty();
                assert!(waited.load(Ordering::SeqCst));
            });
            std::thread::sleep(std::time::Duration::from_millis(20));
            waited.store(true, Ordering::SeqCst);
            gate.leave(Concurrent);
        });
    }
}
