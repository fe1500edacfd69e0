//! The library's own thread pool.

use std::sync::Arc;
use std::thread::JoinHandle;

use super::jobs::{Loop, LoopList};
use super::settings::{MAX_THREADS, Priority};
use super::{EXECUTOR, Executor, ScopedValue};
use crate::{Error, ErrorKind, Result};

/// Threads that share the loops of calling threads. They are joined when the pool is dropped.
///
/// Threads: may be used from any thread, by several at a time.
pub struct Pool {
    state: Arc<PoolState>,
    threads: Vec<JoinHandle<()>>,
}

pub(super) struct PoolState {
    loops: LoopList,
    threads: usize,
}

impl Pool {
    /// A pool in which `concurrency` threads share a loop, 1 to 1025, the calling one included.
    ///
    /// # Errors
    /// `InvalidArgument` for another number, `OutOfMemory` when the system cannot start a thread.
    pub fn new(concurrency: usize) -> Result<Self> {
        if !(1..=MAX_THREADS + 1).contains(&concurrency) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{concurrency} threads"))
                .field("concurrency")
                .remedy(format!("Use 1 to {}", MAX_THREADS + 1)));
        }
        let (pool, failed) = Self::start(concurrency - 1, Priority::Normal);
        match failed {
            Some(e) => Err(Error::new(ErrorKind::OutOfMemory, format!("the system gives no thread: {e}"))),
            None => Ok(pool),
        }
    }

    /// Starts up to `threads` threads; also returns the error if the system starts fewer.
    pub(super) fn start(threads: usize, priority: Priority) -> (Self, Option<std::io::Error>) {
        let state = Arc::new(PoolState { loops: LoopList::new(), threads });
        state.loops.reserve();
        let mut pool = Self { state, threads: Vec::new() };
        for _ in 0..threads {
            let state = pool.state.clone();
            let work = move || {
                priority.apply();
                let executor = Executor::Pool(Arc::as_ptr(&state));
                state.loops.serve(executor);
            };
            match std::thread::Builder::new().name("cairn-pool".into()).spawn(work) {
                Ok(thread) => pool.threads.push(thread),
                Err(e) => return (pool, Some(e)),
            }
        }
        (pool, None)
    }

    /// Runs `work` on this thread; the library's loops in it are shared with this pool only.
    pub fn install<R>(&self, work: impl FnOnce() -> R) -> R {
        let _set = ScopedValue::new(&EXECUTOR, Executor::Pool(Arc::as_ptr(&self.state)));
        work()
    }

    pub(super) fn concurrency(&self) -> usize {
        self.state.concurrency()
    }

    pub(super) fn run(&self, this: &Loop<'_>) {
        // Loops inside of it use the pool as well.
        self.install(|| self.state.run(this));
    }
}

impl PoolState {
    /// Threads that may share a loop, its own included.
    pub(super) fn concurrency(&self) -> usize {
        self.threads + 1
    }

    pub(super) fn run(&self, this: &Loop<'_>) {
        self.loops.run(this, |_| self.loops.wake(this.threads - 1));
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.state.loops.close();
        for thread in self.threads.drain(..) {
            // Panics in loops do not reach the thread's main function.
            _ = thread.join();
        }
    }
}

impl std::fmt::Debug for Pool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pool({} threads)", self.threads.len())
    }
}
