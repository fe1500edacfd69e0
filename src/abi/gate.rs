//! Tracks the calls that are using an object, so that its destruction can wait for them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::ThreadId;

use crate::locks::{Condvar, Mutex};

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
    /// Whether one of them is an exclusive call.
    exclusive: bool,
}

impl Gate {
    /// Enters a call; `false` if it is exclusive and another exclusive call is active.
    pub(super) fn enter(&self, exclusive: bool) -> bool {
        let mut calls = self.calls.lock();
        if exclusive && calls.exclusive {
            return false;
        }
        calls.exclusive |= exclusive;
        calls.threads.push(counted_thread());
        true
    }

    /// Leaves a call that entered with the same `exclusive`.
    pub(super) fn leave(&self, exclusive: bool) {
        let thread = counted_thread();
        let mut calls = self.calls.lock();
        if let Some(at) = calls.threads.iter().rposition(|active| *active == thread) {
            calls.threads.swap_remove(at);
        }
        calls.exclusive &= !exclusive;
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
    use super::*;

    #[test]
    fn one_exclusive_call_and_any_number_of_shared_calls() {
        let gate = Gate::default();
        assert!(gate.enter(true) && gate.enter(false) && gate.enter(false));
        assert!(!gate.enter(true));
        gate.leave(false);
        assert!(!gate.enter(true));
        gate.leave(true);
        assert!(gate.enter(true) && gate.has_call_of_this_thread());
        std::thread::scope(|scope| {
            scope.spawn(|| assert!(!gate.has_call_of_this_thread()));
        });
    }

    #[test]
    fn wait_empty_waits_for_active_calls() {
        let gate = Gate::default();
        let waited = AtomicBool::new(false);
        assert!(gate.enter(false));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                gate.wait_empty();
                assert!(waited.load(Ordering::SeqCst));
            });
            std::thread::sleep(std::time::Duration::from_millis(20));
            waited.store(true, Ordering::SeqCst);
            gate.leave(false);
        });
    }
}
