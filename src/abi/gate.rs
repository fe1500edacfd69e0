//! Tracks the calls inside an object, so that its destruction can wait for them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::ThreadId;

use parking_lot::{Condvar, Mutex};

/// Counts calls that use an object, by thread. Its lock is never held while foreign code runs.
#[derive(Debug, Default)]
pub(super) struct Gate {
    inside: Mutex<Inside>,
    left: Condvar,
    poisoned: AtomicBool,
}

#[derive(Debug, Default)]
struct Inside {
    threads: Vec<ThreadId>,
    /// Whether one of them is an exclusive call.
    alone: bool,
}

impl Gate {
    /// Enters a call; `false` if it is exclusive and another exclusive call is inside.
    pub(super) fn enter(&self, alone: bool) -> bool {
        let mut inside = self.inside.lock();
        if alone && inside.alone {
            return false;
        }
        inside.alone |= alone;
        inside.threads.push(current());
        true
    }

    /// Leaves a call that entered with the same `alone`.
    pub(super) fn leave(&self, alone: bool) {
        let me = current();
        let mut inside = self.inside.lock();
        if let Some(at) = inside.threads.iter().rposition(|thread| *thread == me) {
            inside.threads.swap_remove(at);
        }
        inside.alone &= !alone;
        if inside.threads.is_empty() {
            self.left.notify_all();
        }
    }

    /// Whether this thread is inside already: a callback of a call that has not returned.
    pub(super) fn holds_me(&self) -> bool {
        self.inside.lock().threads.contains(&current())
    }

    /// Waits until no call is inside.
    pub(super) fn wait_empty(&self) {
        let mut inside = self.inside.lock();
        while !inside.threads.is_empty() {
            self.left.wait(&mut inside);
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

/// The thread that this call counts for: a thread that runs part of a shared loop counts as the loop's caller.
fn current() -> ThreadId {
    crate::tasks::calling_thread()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_call_alone_and_any_number_beside_it() {
        let gate = Gate::default();
        assert!(gate.enter(true) && gate.enter(false) && gate.enter(false));
        assert!(!gate.enter(true));
        gate.leave(false);
        assert!(!gate.enter(true));
        gate.leave(true);
        assert!(gate.enter(true) && gate.holds_me());
        std::thread::scope(|scope| {
            scope.spawn(|| assert!(!gate.holds_me()));
        });
    }

    #[test]
    fn the_end_waits_for_who_is_inside() {
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
