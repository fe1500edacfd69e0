//! Parallel loops: over the library's own pool, over a host's job system, or on the calling thread alone.
//!
//! Threads claim a loop's indices from one counter, so each index runs exactly once, on any thread, and no result depends on which.
//! The pool's threads start with the first loop while a `PoolLease` exists, and are joined when the last `PoolLease` is dropped: no thread of
//! the library outlives its last object.

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
pub(crate) use settings::{PoolLease, physical_cores};

use jobs::Loop;

/// Executor of this thread's loops.
#[derive(Clone, Copy)]
enum Executor {
    /// The process's setting: pool or host's job system.
    Process,
    /// This pool, which outlives the setting.
    Pool(*const pool::PoolState),
    /// The calling thread alone.
    ThisThread,
}

thread_local! {
    // Without destructors, which would keep the library loaded or run after it is unloaded.
    static EXECUTOR: Cell<Executor> = const { Cell::new(Executor::Process) };
    static CALLER: Cell<Option<ThreadId>> = const { Cell::new(None) };
}

/// The thread that the current thread works for: itself, or the one that started the loop it shares.
pub(crate) fn calling_thread() -> ThreadId {
    CALLER.get().unwrap_or_else(|| std::thread::current().id())
}

/// Maximum number of threads that may share a loop of this thread, itself included.
pub(crate) fn concurrency() -> usize {
    match EXECUTOR.get() {
        Executor::Process => settings::concurrency(),
        // SAFETY: the pool outlives the setting.
        Executor::Pool(pool) => unsafe { &*pool }.concurrency(),
        Executor::ThisThread => 1,
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

/// Runs `body(slot, index)` for all of `0..len`. No two concurrent calls have the same slot, and slots are below `slots` (at least
/// 1).
fn for_each_in_slot(len: usize, min_len: usize, slots: usize, body: impl Fn(usize, usize) + Sync) {
    run(len, min_len, slots, &|slot, range| range.for_each(|index| body(slot, index)));
}

/// Runs both closures, on two threads if there are two.
pub(crate) fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    use crate::locks::Mutex;
    enum Work<F, R> {
        Pending(F),
        Running,
        Done(R),
    }
    fn run_pending<F: FnOnce() -> R, R>(work: &Mutex<Work<F, R>>) {
        let current = std::mem::replace(&mut *work.lock(), Work::Running);
        if let Work::Pending(f) = current {
            let done = f();
            *work.lock() = Work::Done(done);
        }
    }
    let (a, b) = (Mutex::new(Work::Pending(a)), Mutex::new(Work::Pending(b)));
    run(2, 1, 2, &|_, range| {
        for index in range {
            if index == 0 { run_pending(&a) } else { run_pending(&b) }
        }
    });
    match (a.into_inner(), b.into_inner()) {
        (Work::Done(a), Work::Done(b)) => (a, b),
        _ => unreachable!("a loop ends when all of its indices have run"),
    }
}

/// As [`join`], for closures that contain loops. On a host's job system they run one after the other, because not every job system
/// supports jobs that wait for others.
pub(crate) fn join_loops<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    if matches!(EXECUTOR.get(), Executor::Process) && settings::has_scheduler() { (a(), b()) } else { join(a, b) }
}

/// The body of a loop: gets the thread's slot and a range of indices.
type LoopBody<'a> = dyn Fn(usize, Range<usize>) + Sync + 'a;

fn run(len: usize, min_len: usize, slots: usize, body: &LoopBody<'_>) {
    let min_len = min_len.max(1);
    let shared_by = |threads: usize| threads.min(slots).min(len.div_ceil(min_len));
    match EXECUTOR.get() {
        _ if len <= min_len || slots <= 1 => body(0, 0..len),
        Executor::ThisThread => body(0, 0..len),
        Executor::Pool(pool) => {
            // SAFETY: the pool outlives the setting.
            let pool = unsafe { &*pool };
            pool.run(&Loop::new(len, min_len, shared_by(pool.concurrency()), body));
        }
        Executor::Process => {
            let Some(executor) = PoolLease::current_executor() else { return body(0, 0..len) };
            executor.run(&Loop::new(len, min_len, shared_by(executor.concurrency()), body));
        }
    }
}

/// Sets a thread-local value; restores the previous one when dropped.
struct ScopedValue<T: Copy + 'static> {
    cell: &'static std::thread::LocalKey<Cell<T>>,
    before: T,
}

impl<T: Copy> ScopedValue<T> {
    fn new(cell: &'static std::thread::LocalKey<Cell<T>>, value: T) -> Self {
        Self { cell, before: cell.replace(value) }
    }
}

impl<T: Copy> Drop for ScopedValue<T> {
    fn drop(&mut self) {
        self.cell.set(self.before);
    }
}

#[cfg(test)]
mod tests;
