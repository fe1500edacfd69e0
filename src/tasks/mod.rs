//! Loops that several threads share: over the library's own pool, over a host's job system, or on the calling thread alone.
//!
//! A loop's pieces are claimed by index from one counter, so each runs exactly once, on whichever thread comes first, and no
//! result depends on which one that was. The pool's threads start with the first loop that runs while a `Use` lives, and are
//! joined when the last one is dropped: nothing of the library runs after its last object.

mod jobs;
mod parallel;
mod pool;
mod settings;

use std::cell::Cell;
use std::ops::Range;
use std::thread::ThreadId;

pub(crate) use parallel::{Parallel, ParallelSlice, ParallelSliceMut};
pub use pool::Pool;
pub use settings::{MAX_THREADS, Priority, Scheduler, ThreadOptions, set_scheduler, set_threads};
pub(crate) use settings::{Use, physical_cores};

use jobs::Loop;

/// What runs the loops of this thread.
#[derive(Clone, Copy)]
enum Executor {
    /// What the process is set to.
    Process,
    /// A pool that outlives the setting.
    Pool(*const pool::Shared),
    /// This thread alone.
    Alone,
}

thread_local! {
    // Without destructors: those would keep the library loaded, or run after it is gone.
    static EXECUTOR: Cell<Executor> = const { Cell::new(Executor::Process) };
    static WORKS_FOR: Cell<Option<ThreadId>> = const { Cell::new(None) };
}

/// The thread whose call the current thread works for: itself, or the one that started the loop it shares.
pub(crate) fn calling_thread() -> ThreadId {
    WORKS_FOR.get().unwrap_or_else(|| std::thread::current().id())
}

/// The most threads that may share a loop of this thread, itself among them.
pub(crate) fn concurrency() -> usize {
    match EXECUTOR.get() {
        Executor::Process => settings::concurrency(),
        // SAFETY: the pool outlives the setting.
        Executor::Pool(pool) => unsafe { &*pool }.concurrency(),
        Executor::Alone => 1,
    }
}

/// Runs `body` for all of `0..len`, in ranges of at least `min_len`.
fn for_each_range(len: usize, min_len: usize, body: impl Fn(Range<usize>) + Sync) {
    run(len, min_len, usize::MAX, &|_, range| body(range));
}

/// Runs `body` for all of `0..len`.
pub(crate) fn for_each_index(len: usize, body: impl Fn(usize) + Sync) {
    for_each_range(len, 1, |range| range.for_each(&body));
}

/// Runs `body(slot, index)` for all of `0..len`. No two calls that run at the same time have the same slot, and slots are
/// below `slots` (at least 1).
fn for_each_in_slot(len: usize, min_len: usize, slots: usize, body: impl Fn(usize, usize) + Sync) {
    run(len, min_len, slots, &|slot, range| range.for_each(|index| body(slot, index)));
}

/// Runs both works, on two threads where there are two.
pub(crate) fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    use parking_lot::Mutex;
    enum Work<F, R> {
        Waits(F),
        Runs,
        Done(R),
    }
    fn advance<F: FnOnce() -> R, R>(work: &Mutex<Work<F, R>>) {
        let taken = std::mem::replace(&mut *work.lock(), Work::Runs);
        if let Work::Waits(f) = taken {
            let done = f();
            *work.lock() = Work::Done(done);
        }
    }
    let (a, b) = (Mutex::new(Work::Waits(a)), Mutex::new(Work::Waits(b)));
    run(2, 1, 2, &|_, range| {
        for index in range {
            if index == 0 { advance(&a) } else { advance(&b) }
        }
    });
    match (a.into_inner(), b.into_inner()) {
        (Work::Done(a), Work::Done(b)) => (a, b),
        _ => unreachable!("a loop ends when all of its indices have run"),
    }
}

/// As [`join`], for works that have loops of their own. A host's job system gets those one after the other, as not every one
/// bears a job that waits for others.
pub(crate) fn join_loops<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    if matches!(EXECUTOR.get(), Executor::Process) && settings::has_scheduler() { (a(), b()) } else { join(a, b) }
}

/// What a loop calls: with the slot of the thread, and the indices it has claimed.
type Body<'a> = dyn Fn(usize, Range<usize>) + Sync + 'a;

fn run(len: usize, min_len: usize, slots: usize, body: &Body<'_>) {
    let min_len = min_len.max(1);
    let shared_by = |threads: usize| threads.min(slots).min(len.div_ceil(min_len));
    match EXECUTOR.get() {
        _ if len <= min_len || slots <= 1 => body(0, 0..len),
        Executor::Alone => body(0, 0..len),
        Executor::Pool(pool) => {
            // SAFETY: the pool outlives the setting.
            let pool = unsafe { &*pool };
            pool.run(&Loop::new(len, min_len, shared_by(pool.concurrency()), body));
        }
        Executor::Process => {
            let Some(using) = Use::of_another() else { return body(0, 0..len) };
            using.run(&Loop::new(len, min_len, shared_by(using.concurrency()), body));
        }
    }
}

/// Sets a thread's value for as long as it lives.
struct Set<T: Copy + 'static> {
    cell: &'static std::thread::LocalKey<Cell<T>>,
    before: T,
}

impl<T: Copy> Set<T> {
    fn new(cell: &'static std::thread::LocalKey<Cell<T>>, value: T) -> Self {
        Self { cell, before: cell.replace(value) }
    }
}

impl<T: Copy> Drop for Set<T> {
    fn drop(&mut self) {
        self.cell.set(self.before);
    }
}

#[cfg(test)]
mod tests;
