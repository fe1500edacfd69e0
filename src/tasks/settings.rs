//! Process-wide settings of loops, and the lifetime of the pool.

use std::ffi::c_void;
use std::sync::Arc;

use crate::locks::Mutex;

use super::jobs::{Loop, LoopList};
use super::pool::Pool;
use super::{EXECUTOR, Executor, ScopedValue};
use crate::{Error, ErrorKind, Result};

/// Maximum number of threads of a pool, and of a host's job system.
pub const MAX_THREADS: usize = 1024;

/// System priority of a pool's threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// Below a game's threads: `THREAD_PRIORITY_BELOW_NORMAL` on Windows, a nice value raised by 5 on Linux.
    #[default]
    BelowNormal,
    /// On Linux the priority of the thread that starts the first loop, which is inherited; on Windows `THREAD_PRIORITY_NORMAL`.
    Normal,
    /// Below all other threads: `THREAD_PRIORITY_LOWEST` on Windows, a nice value raised by 10 on Linux.
    Lowest,
}

/// Settings of the library's own threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadOptions {
    /// Threads of the pool, 1 to [`MAX_THREADS`], in addition to those that call the library. `None`: one less than the physical
    /// cores that this process may use, at least one.
    pub threads: Option<usize>,
    /// Their priority.
    pub priority: Priority,
}

/// A host's job system.
pub trait Scheduler: Send + Sync {
    /// Maximum number of threads that run jobs at the same time, the caller of [`run`](Self::run) included.
    fn concurrency(&self) -> usize;

    /// Calls `job(data)` up to `jobs` times, concurrently if possible, and returns when those calls have returned. The calling
    /// thread does the remaining work.
    fn run(&self, jobs: usize, job: unsafe extern "C" fn(*mut c_void), data: *mut c_void);
}

static STATE: Mutex<State> = Mutex::new(State {
    uses: 0,
    pool: None,
    scheduler: None,
    options: ThreadOptions { threads: None, priority: Priority::BelowNormal },
});

/// The loops that run on the host's job system. Jobs find their loop by its ticket, so a job that runs too late finds none.
static HOST_LOOPS: LoopList = LoopList::new();

struct State {
    /// Number of existing `PoolLease`s.
    uses: usize,
    /// Started by the first loop while `uses` is not 0.
    pool: Option<Arc<Pool>>,
    scheduler: Option<Arc<dyn Scheduler>>,
    options: ThreadOptions,
}

/// Sets the number and priority of the library's own threads. They start with the next loop.
///
/// # Errors
/// `InvalidArgument` for a number of threads outside 1 to [`MAX_THREADS`]; `Busy` while an object that uses them exists.
pub fn set_threads(options: ThreadOptions) -> Result<()> {
    if let Some(threads) = options.threads.filter(|threads| !(1..=MAX_THREADS).contains(threads)) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads"))
            .field("threads")
            .remedy(format!("Use 1 to {MAX_THREADS}")));
    }
    lock_if_unused()?.options = options;
    Ok(())
}

/// Makes loops run on a host's job system; `None` for the library's own threads.
///
/// # Errors
/// `InvalidArgument` when its concurrency is outside 1 to [`MAX_THREADS`]; `Busy` while an object that uses threads exists.
pub fn set_scheduler(scheduler: Option<Arc<dyn Scheduler>>) -> Result<()> {
    if let Some(threads) = scheduler.as_ref().map(|s| s.concurrency()).filter(|n| !(1..=MAX_THREADS).contains(n)) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads share a job system"))
            .field("concurrency")
            .remedy(format!("Use 1 to {MAX_THREADS}")));
    }
    let former = {
        let mut state = lock_if_unused()?;
        if scheduler.is_some() {
            HOST_LOOPS.reserve()
        } else {
            HOST_LOOPS.release()
        }
        std::mem::replace(&mut state.scheduler, scheduler)
    };
    // Dropped without the lock, because its destructor is foreign code.
    drop(former);
    Ok(())
}

/// The locked state; `Busy` if any `PoolLease` exists.
fn lock_if_unused() -> Result<crate::locks::MutexGuard<'static, State>> {
    let state = STATE.lock();
    if state.uses > 0 {
        return Err(Error::new(ErrorKind::Busy, "objects live that use the threads there are")
            .remedy("Set them before the first object is made, or when all are destroyed"));
    }
    Ok(state)
}

/// Number of physical cores, but at most the processors that the process may use.
pub(crate) fn physical_cores() -> usize {
    let allowed = std::thread::available_parallelism().map_or(1, usize::from);
    sysinfo::System::physical_core_count().unwrap_or(allowed).clamp(1, allowed)
}

impl ThreadOptions {
    fn threads(self) -> usize {
        self.threads.unwrap_or_else(|| (physical_cores() - 1).max(1))
    }
}

pub(super) fn concurrency() -> usize {
    PoolLease::current_executor().map_or(1, |executor| executor.concurrency())
}

pub(super) fn has_scheduler() -> bool {
    STATE.lock().scheduler.is_some()
}

/// Keeps the process's threads for loops available while it exists; objects that run loops hold one. Dropping the last one joins the
/// pool's threads.
#[derive(Debug)]
pub(crate) struct PoolLease {
    _private: (),
}

/// The pool or job system that runs a loop, kept alive while the loop runs.
pub(super) struct LoopExecutor {
    target: ExecutorTarget,
    // Dropped last.
    _held: PoolLease,
}

enum ExecutorTarget {
    Pool(Arc<Pool>),
    Scheduler(Arc<dyn Scheduler>),
}

impl PoolLease {
    pub(crate) fn new() -> Self {
        STATE.lock().uses += 1;
        Self { _private: () }
    }

    /// The pool or job system for a loop; `None` if no `PoolLease` exists.
    pub(super) fn current_executor() -> Option<LoopExecutor> {
        let (executor, failed) = {
            let mut state = STATE.lock();
            if state.uses == 0 {
                return None;
            }
            let (target, failed) = match &state.scheduler {
                Some(scheduler) => (ExecutorTarget::Scheduler(scheduler.clone()), None),
                None => {
                    let (pool, failed) = state.pool();
                    (ExecutorTarget::Pool(pool), failed)
                }
            };
            state.uses += 1;
            (LoopExecutor { target, _held: Self { _private: () } }, failed)
        };
        // Without the lock, because a host's log callback may call the library.
        if let Some(e) = failed {
            log::warn!("fewer threads than were asked for share the library's work, as the system gives no more: {e}");
        }
        Some(executor)
    }
}

impl Default for PoolLease {
    fn default() -> Self {
        Self::new()
    }
}

impl Clone for PoolLease {
    fn clone(&self) -> Self {
        Self::new()
    }
}

impl Drop for PoolLease {
    fn drop(&mut self) {
        let ended = {
            let mut state = STATE.lock();
            state.uses -= 1;
            if state.uses == 0 { state.pool.take() } else { None }
        };
        // Joined without the lock, and never by a thread of the pool: these run only loops, which hold a use.
        drop(ended);
    }
}

impl State {
    /// The pool; if this call started it with fewer threads than requested, also the error.
    fn pool(&mut self) -> (Arc<Pool>, Option<std::io::Error>) {
        if let Some(pool) = &self.pool {
            return (pool.clone(), None);
        }
        let (pool, failed) = Pool::start(self.options.threads(), self.options.priority);
        let pool = Arc::new(pool);
        self.pool = Some(pool.clone());
        (pool, failed)
    }
}

impl LoopExecutor {
    pub(super) fn concurrency(&self) -> usize {
        match &self.target {
            ExecutorTarget::Pool(pool) => pool.concurrency(),
            // A host that answers 0 later than at `set_scheduler` still has the calling thread.
            ExecutorTarget::Scheduler(scheduler) => scheduler.concurrency().max(1),
        }
    }

    pub(super) fn run(&self, this: &Loop<'_>) {
        match &self.target {
            ExecutorTarget::Pool(pool) => pool.run(this),
            ExecutorTarget::Scheduler(scheduler) => {
                // Not every job system supports loops within jobs.
                let _alone = ScopedValue::new(&EXECUTOR, Executor::ThisThread);
                HOST_LOOPS
                    .run(this, |ticket| scheduler.run(this.threads, job, std::ptr::without_provenance_mut(ticket)));
            }
        }
    }
}

/// The job that a host's job system calls.
unsafe extern "C" fn job(ticket: *mut c_void) {
    HOST_LOOPS.share(ticket.addr(), Executor::ThisThread);
}

impl Priority {
    /// Sets this thread's priority. If the system refuses, it stays unchanged.
    pub(super) fn apply(self) {
        platform::apply(self);
    }
}

#[cfg(windows)]
mod platform {
    use windows::Win32::System::Threading::{
        GetCurrentThread, SetThreadPriority, THREAD_PRIORITY_BELOW_NORMAL, THREAD_PRIORITY_LOWEST,
        THREAD_PRIORITY_NORMAL,
    };

    use super::Priority;

    pub(super) fn apply(priority: Priority) {
        let priority = match priority {
            Priority::BelowNormal => THREAD_PRIORITY_BELOW_NORMAL,
            Priority::Normal => THREAD_PRIORITY_NORMAL,
            Priority::Lowest => THREAD_PRIORITY_LOWEST,
        };
        // SAFETY: the handle is of this very thread, and needs no closing.
        _ = unsafe { SetThreadPriority(GetCurrentThread(), priority) };
    }
}

#[cfg(all(target_os = "linux", not(miri)))]
mod platform {
    use std::ffi::c_int;

    use super::Priority;

    unsafe extern "C" {
        safe fn getpriority(which: c_int, who: u32) -> c_int;
        safe fn setpriority(which: c_int, who: u32, nice: c_int) -> c_int;
    }
    /// From `sys/resource.h`. On Linux, with id 0 it means the calling thread.
    const PRIO_PROCESS: c_int = 0;

    pub(super) fn apply(priority: Priority) {
        let raised = match priority {
            Priority::BelowNormal => 5,
            Priority::Normal => return,
            Priority::Lowest => 10,
        };
        setpriority(PRIO_PROCESS, 0, (getpriority(PRIO_PROCESS, 0) + raised).min(19));
    }
}

#[cfg(not(any(windows, all(target_os = "linux", not(miri)))))]
mod platform {
    pub(super) fn apply(_: super::Priority) {}
}
