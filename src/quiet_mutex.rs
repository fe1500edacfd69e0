//! A lock under which log messages wait. A host gets each message in a callback, from which it may call Cairn: under a lock that such a call
//! needs, the thread would wait for itself.

use std::cell::RefCell;
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};

use crate::locks::{Mutex, MutexGuard};

/// As [`Mutex`]. Messages that a thread logs while it holds one reach the host's callback once it holds none any more.
pub(crate) struct QuietMutex<T>(Mutex<T>);

impl<T> QuietMutex<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(Mutex::new(value))
    }

    /// Waits for the lock.
    pub(crate) fn lock(&self) -> QuietGuard<'_, T> {
        let delay = Delay::new();
        QuietGuard { guard: self.0.lock(), _delay: delay }
    }
}

/// The lock, held until this is dropped.
pub(crate) struct QuietGuard<'a, T> {
    // Fields are dropped in order: the messages are logged after the lock is released.
    guard: MutexGuard<'a, T>,
    _delay: Delay,
}

impl<T> Deref for QuietGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.guard
    }
}

impl<T> DerefMut for QuietGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.guard
    }
}

/// The messages of a thread that wait.
struct Delayed {
    /// How many locks of this kind it holds.
    locks: usize,
    messages: Vec<Message>,
}

struct Message {
    level: log::Level,
    target: String,
    text: String,
}

thread_local! {
    // Without a destructor, which would keep the library loaded until the thread ends. No message stays in it, so nothing leaks.
    static DELAYED: ManuallyDrop<RefCell<Delayed>> =
        const { ManuallyDrop::new(RefCell::new(Delayed { locks: 0, messages: Vec::new() })) };
}

/// Delays the messages of this thread until it is dropped, for locks of other kinds.
pub(crate) struct Delay(());

impl Delay {
    pub(crate) fn new() -> Self {
        _ = DELAYED.try_with(|delayed| delayed.borrow_mut().locks += 1);
        Self(())
    }
}

impl Drop for Delay {
    fn drop(&mut self) {
        let released = DELAYED.try_with(|delayed| {
            let mut delayed = delayed.borrow_mut();
            delayed.locks -= 1;
            if delayed.locks == 0 { std::mem::take(&mut delayed.messages) } else { Vec::new() }
        });
        for Message { level, target, text } in released.unwrap_or_default() {
            log::logger()
                .log(&log::Record::builder().level(level).target(&target).args(format_args!("{text}")).build());
        }
    }
}

/// Delays a message if this thread holds such a lock: it is logged again when the last one is released. Returns whether it is delayed.
pub(crate) fn delays(record: &log::Record<'_>) -> bool {
    let delay = |delayed: &ManuallyDrop<RefCell<Delayed>>| {
        let mut delayed = delayed.borrow_mut();
        if delayed.locks > 0 {
            let (target, text) = (record.target().to_owned(), record.args().to_string());
            delayed.messages.push(Message { level: record.level(), target, text });
        }
        delayed.locks > 0
    };
    DELAYED.try_with(delay).unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_wait_until_the_last_lock_is_released() {
        let (outer, inner) = (QuietMutex::new(1), QuietMutex::new(2));
        let delays = |text| delays(&log::Record::builder().args(format_args!("{text}")).build());
        let waiting = || DELAYED.with(|delayed| delayed.borrow().messages.len());
        assert!(!delays("before"));
        let mut held = outer.lock();
        assert!(delays("one"));
        drop(inner.lock());
        *held += 1;
        assert!(delays("two") && *held == 2 && waiting() == 2);
        let other_delays = std::thread::spawn(|| super::delays(&log::Record::builder().build()));
        assert!(!other_delays.join().unwrap());
        drop(held);
        assert!(!delays("after") && waiting() == 0);
    }
}
