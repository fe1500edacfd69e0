//! A loop that several threads share, and the list of such loops.

use std::any::Any;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::ThreadId;

use crate::locks::{Condvar, Mutex};

use super::{Executor, LoopBody, ScopedValue, calling_thread};

/// Maximum number of shared loops at a time. The list never grows, so no loop allocates memory. If the list is full, a loop runs on the
/// calling thread alone.
const CAPACITY: usize = 256;
/// Number of parts per thread into which the remaining indices of a loop are divided.
const PARTS_PER_THREAD: usize = 4;
/// Spin iterations of an idle thread, some ten microseconds in all, before it sleeps: the loops of a frame follow each other
/// closely. It does not yield, because on a busy machine it would resume much later than a thread that is woken.
const SPIN_ROUNDS: usize = 64;
/// Processor pauses in one spin iteration.
const PAUSES: usize = 8;

fn pause() {
    (0..PAUSES).for_each(|_| std::hint::spin_loop());
}

/// A loop, stored on the stack of the thread that started it.
pub(super) struct Loop<'a> {
    len: usize,
    /// Minimum number of indices that a thread claims at a time.
    min_len: usize,
    /// Maximum number of threads that may share it, its own included.
    pub(super) threads: usize,
    body: &'a LoopBody<'a>,
    caller: ThreadId,
    /// The first unclaimed index.
    next: AtomicUsize,
    panic: Mutex<Option<Box<dyn Any + Send>>>,
}

impl<'a> Loop<'a> {
    pub(super) fn new(len: usize, min_len: usize, threads: usize, body: &'a LoopBody<'a>) -> Self {
        let caller = calling_thread();
        Self { len, min_len, threads, body, caller, next: AtomicUsize::new(0), panic: Mutex::new(None) }
    }

    /// Claims a part of the remaining indices. Parts become smaller towards the end, so that all threads end at about the same
    /// time.
    fn claim(&self) -> Option<Range<usize>> {
        let mut start = self.next.load(Ordering::Relaxed);
        while start < self.len {
            let left = self.len - start;
            let part = left / self.threads.saturating_mul(PARTS_PER_THREAD);
            let end = start + part.max(self.min_len).min(left);
            match self.next.compare_exchange_weak(start, end, Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return Some(start..end),
                Err(now) => start = now,
            }
        }
        None
    }

    fn is_claimed(&self) -> bool {
        self.next.load(Ordering::Relaxed) >= self.len
    }

    /// Runs unclaimed indices until there are none. The first panic ends the loop, and is stored for the thread that started it.
    fn work(&self, slot: usize) {
        let worked = catch_unwind(AssertUnwindSafe(|| {
            while let Some(range) = self.claim() {
                (self.body)(slot, range);
            }
        }));
        if let Err(payload) = worked {
            self.end_by_panic(payload);
        }
    }

    /// Ends the loop by a panic. The first one is stored.
    fn end_by_panic(&self, payload: Box<dyn Any + Send>) {
        self.next.store(self.len, Ordering::Relaxed);
        let mut kept = self.panic.lock();
        match &*kept {
            None => *kept = Some(payload),
            // Dropping a panic's payload runs foreign code, which may panic again.
            Some(_) => std::mem::forget(payload),
        }
    }
}

/// A loop in the list.
struct Entry {
    ticket: usize,
    /// Valid as long as the entry is in the list: the calling thread removes the entry, after all other threads have left, before it
    /// returns.
    target: *const Loop<'static>,
    /// Number of threads that have entered so far, the calling one included. It is the slot of the next thread.
    slots: usize,
    /// Number of other threads that are working on it.
    inside: usize,
}

// SAFETY: a `Loop` is shared by threads on purpose: all of its fields are `Sync`.
unsafe impl Send for Entry {}

/// The loops that other threads may share.
pub(super) struct LoopList {
    list: Mutex<List>,
    /// Signalled when a loop is published, or the pool closes.
    work: Condvar,
    /// Signalled when a thread has left a loop.
    left: Condvar,
    /// Counts published loops, so that spinning threads can detect a new one without the lock.
    published: AtomicUsize,
}

struct List {
    entries: Vec<Entry>,
    tickets: usize,
    closing: bool,
}

impl LoopList {
    pub(super) const fn new() -> Self {
        let list = List { entries: Vec::new(), tickets: 0, closing: false };
        Self { list: Mutex::new(list), work: Condvar::new(), left: Condvar::new(), published: AtomicUsize::new(0) }
    }

    /// Frees the list's memory if it is empty.
    pub(super) fn release(&self) {
        let mut list = self.list.lock();
        if list.entries.is_empty() {
            list.entries = Vec::new();
        }
    }

    /// Allocates the list; without it no loop is shared.
    pub(super) fn reserve(&self) {
        let mut list = self.list.lock();
        let more = CAPACITY - list.entries.len();
        // If this fails, loops run on their own threads.
        _ = list.entries.try_reserve_exact(more);
    }

    /// Runs a loop on this thread and on the threads that `call` makes available; `call` gets the loop's ticket. Returns when all
    /// of the loop has run and no other thread is inside.
    pub(super) fn run(&self, this: &Loop<'_>, call: impl FnOnce(usize)) {
        let ticket = self.publish(this);
        if let Some(ticket) = ticket {
            // `call` runs a host's function; its panic must not leave the loop in the list.
            let called = catch_unwind(AssertUnwindSafe(|| call(ticket)));
            if let Err(payload) = called {
                this.end_by_panic(payload);
            }
        }
        this.work(0);
        if let Some(ticket) = ticket {
            self.withdraw(ticket);
        }
        if let Some(payload) = this.panic.lock().take() {
            resume_unwind(payload);
        }
    }

    fn publish(&self, this: &Loop<'_>) -> Option<usize> {
        let mut list = self.list.lock();
        if list.entries.len() == list.entries.capacity() {
            return None;
        }
        list.tickets = list.tickets.wrapping_add(1);
        let ticket = list.tickets;
        let target = std::ptr::from_ref(this).cast();
        list.entries.push(Entry { ticket, target, slots: 1, inside: 0 });
        self.published.fetch_add(1, Ordering::Release);
        Some(ticket)
    }

    /// Waits until no other thread works on a loop whose indices are all claimed, and removes it from the list.
    fn withdraw(&self, ticket: usize) {
        for _ in 0..SPIN_ROUNDS {
            if self.list.lock().try_remove(ticket) {
                return;
            }
            pause();
        }
        let mut list = self.list.lock();
        while !list.try_remove(ticket) {
            self.left.wait(&mut list);
        }
    }

    /// Wakes up to `threads` threads of a pool for a loop.
    pub(super) fn wake(&self, threads: usize) {
        for _ in 0..threads {
            self.work.notify_one();
        }
    }

    /// Works on the loop of a ticket until all of it is claimed. Does nothing if there is no such loop any more.
    pub(super) fn share(&self, ticket: usize, executor: Executor) {
        let entered = self.list.lock().enter(|entry| entry.ticket == ticket);
        if let Some(entered) = entered {
            self.work_in(&entered, executor);
        }
    }

    /// The main function of a pool's thread.
    pub(super) fn serve(&self, executor: Executor) {
        let mut last_published = usize::MAX;
        loop {
            for _ in 0..SPIN_ROUNDS {
                if self.published.load(Ordering::Acquire) != last_published {
                    break;
                }
                pause();
            }
            let entered = {
                let mut list = self.list.lock();
                loop {
                    if list.closing {
                        return;
                    }
                    last_published = self.published.load(Ordering::Acquire);
                    if let Some(entered) = list.enter(|_| true) {
                        break entered;
                    }
                    self.work.wait(&mut list);
                }
            };
            self.work_in(&entered, executor);
        }
    }

    fn work_in(&self, entered: &Entered, executor: Executor) {
        {
            // SAFETY: this thread is counted as inside, so the loop stays valid.
            let this = unsafe { &*entered.target };
            let _executor = ScopedValue::new(&super::EXECUTOR, executor);
            let _caller = ScopedValue::new(&super::CALLER, Some(this.caller));
            this.work(entered.slot);
        }
        let mut list = self.list.lock();
        if let Some(entry) = list.entries.iter_mut().find(|entry| entry.ticket == entered.ticket) {
            entry.inside -= 1;
        }
        drop(list);
        self.left.notify_all();
    }

    /// Ends all threads in [`serve`](Self::serve).
    pub(super) fn close(&self) {
        self.list.lock().closing = true;
        self.published.fetch_add(1, Ordering::Release);
        self.work.notify_all();
    }
}

/// A thread's entry into a loop.
struct Entered {
    ticket: usize,
    target: *const Loop<'static>,
    slot: usize,
}

impl List {
    /// Enters the latest loop for which `is_wanted` holds and that has work and a slot left. The latest comes first because other
    /// loops may wait for it.
    fn enter(&mut self, is_wanted: impl Fn(&Entry) -> bool) -> Option<Entered> {
        let entry = self.entries.iter_mut().rev().filter(|entry| is_wanted(entry)).find(|entry| {
            // SAFETY: the loop is valid as long as its entry exists.
            let this = unsafe { &*entry.target };
            entry.slots < this.threads && !this.is_claimed()
        })?;
        let entered = Entered { ticket: entry.ticket, target: entry.target, slot: entry.slots };
        entry.slots += 1;
        entry.inside += 1;
        Some(entered)
    }

    /// Removes the loop of a ticket unless other threads are working on it; returns whether it is gone.
    fn try_remove(&mut self, ticket: usize) -> bool {
        match self.entries.iter().position(|entry| entry.ticket == ticket) {
            Some(at) if self.entries[at].inside > 0 => false,
            Some(at) => {
                self.entries.remove(at);
                true
            }
            None => true,
        }
    }
}
