//! What the loops of the whole process run on, and for how long.

use std::ffi::c_void;
use std::sync::Arc;

use parking_lot::Mutex;

use super::jobs::{Loop, Loops};
use super::pool::Pool;
use super::{EXECUTOR, Executor, Set};
use crate::{Error, ErrorKind, Result};

/// The most threads of a pool, and the most that a host's job system may have.
pub const MAX_THREADS: usize = 1024;

/// How a pool's threads are scheduled by the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// Below those of a game: `THREAD_PRIORITY_BELOW_NORMAL` on Windows, a nice value raised by 5 on Linux.
    #[default]
    BelowNormal,
    /// As the thread that starts the first loop has it, where the system hands that on: on Linux. On Windows `THREAD_PRIORITY_NORMAL`.
    Normal,
    /// Behind all others: `THREAD_PRIORITY_LOWEST` on Windows, a nice value raised by 10 on Linux.
    Lowest,
}

/// The library's own threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadOptions {
    /// Threads of the pool, 1 to [`MAX_THREADS`], beside those that call the library. `None`: one less than the physical cores
    /// this process may use, at least one.
    pub threads: Option<usize>,
    /// Their priority.
    pub priority: Priority,
}

/// A host's job system.
pub trait Scheduler: Send + Sync {
    /// The most threads that run jobs at the same time, the one that calls [`run`](Self::run) among them.
    fn concurrency(&self) -> usize;

    /// Calls `job(data)` up to `jobs` times, at the same time where it can, and returns when those calls have. What it leaves undone is
    /// done by the thread that called it.
    fn run(&self, jobs: usize, job: unsafe extern "C" fn(*mut c_void), data: *mut c_void);
}

static STATE: Mutex<State> = Mutex::new(State {
    uses: 0,
    pool: None,
    scheduler: None,
    options: ThreadOptions { threads: None, priority: Priority::BelowNormal },
});

/// The loops that a host's job system shares. Its jobs name them by ticket, so that a job that comes late finds nothing.
static HOSTED: Loops = Loops::new();

struct State {
    /// `Use`s that live.
    uses: usize,
    /// Started by the first loop while there are uses.
    pool: Option<Arc<Pool>>,
    scheduler: Option<Arc<dyn Scheduler>>,
    options: ThreadOptions,
}

/// Sets how many threads of its own the library starts, and their priority. They start with the first loop after that.
///
/// # Errors
/// `InvalidArgument` for a number of threads outside 1 to [`MAX_THREADS`]; `Busy` while an object lives that uses them.
pub fn set_threads(options: ThreadOptions) -> Result<()> {
    if let Some(threads) = options.threads.filter(|threads| !(1..=MAX_THREADS).contains(threads)) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads"))
            .field("threads")
            .remedy(format!("Use 1 to {MAX_THREADS}")));
    }
    idle()?.options = options;
    Ok(())
}

/// Sets a host's job system that loops run on in place of the library's own threads; `None` for these.
///
/// # Errors
/// `InvalidArgument` when its concurrency is outside 1 to [`MAX_THREADS`]; `Busy` while an object lives that uses threads.
pub fn set_scheduler(scheduler: Option<Arc<dyn Scheduler>>) -> Result<()> {
    if let Some(threads) = scheduler.as_ref().map(|s| s.concurrency()).filter(|n| !(1..=MAX_THREADS).contains(n)) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads share a job system"))
            .field("concurrency")
            .remedy(format!("Use 1 to {MAX_THREADS}")));
    }
    let former = {
        let mut state = idle()?;
        if scheduler.is_some() {
            HOSTED.reserve()
        } else {
            HOSTED.release()
        }
        std::mem::replace(&mut state.scheduler, scheduler)
    };
    // Dropped without the lock: it is foreign.
    drop(former);
    Ok(())
}

/// The state while nothing uses it.
fn idle() -> Result<parking_lot::MutexGuard<'static, State>> {
    let state = STATE.lock();
    if state.uses > 0 {
        return Err(Error::new(ErrorKind::Busy, "objects live that use the threads there are")
            .remedy("Set them before the first object is made, or when all are destroyed"));
    }
    Ok(state)
}

/// Physical cores, or fewer where the process may use fewer processors.
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
    Use::of_another().map_or(1, |using| using.concurrency())
}

pub(super) fn has_scheduler() -> bool {
    STATE.lock().scheduler.is_some()
}

/// Held by what has loops. While one lives the process has the threads to share them; the last one ends these.
#[derive(Debug)]
pub(crate) struct Use {
    _private: (),
}

/// What a loop runs on.
pub(super) struct Using {
    of: On,
    // Given back last.
    _held: Use,
}

enum On {
    Pool(Arc<Pool>),
    Scheduler(Arc<dyn Scheduler>),
}

impl Use {
    pub(crate) fn new() -> Self {
        STATE.lock().uses += 1;
        Self { _private: () }
    }

    /// What there is to run a loop on while another use lives.
    pub(super) fn of_another() -> Option<Using> {
        let (using, failed) = {
            let mut state = STATE.lock();
            if state.uses == 0 {
                return None;
            }
            let (of, failed) = match &state.scheduler {
                Some(scheduler) => (On::Scheduler(scheduler.clone()), None),
                None => {
                    let (pool, failed) = state.pool();
                    (On::Pool(pool), failed)
                }
            };
            state.uses += 1;
            (Using { of, _held: Self { _private: () } }, failed)
        };
        // Without the lock, as a host's log callback may call the library.
        if let Some(e) = failed {
            log::warn!("fewer threads than were asked for share the library's work, as the system gives no more: {e}");
        }
        Some(using)
    }
}

impl Default for Use {
    fn default() -> Self {
        Self::new()
    }
}

impl Clone for Use {
    fn clone(&self) -> Self {
        Self::new()
    }
}

impl Drop for Use {
    fn drop(&mut self) {
        let ended = {
            let mut state = STATE.lock();
            state.uses -= 1;
            if state.uses == 0 { state.pool.take() } else { None }
        };
        // Joined without the lock, and never by a thread of its own: these work for a loop only, which holds a use.
        drop(ended);
    }
}

impl State {
    /// The pool; where it was started for that, also why it has fewer threads than it should.
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

impl Using {
    pub(super) fn concurrency(&self) -> usize {
        match &self.of {
            On::Pool(pool) => pool.concurrency(),
            On::Scheduler(scheduler) => scheduler.concurrency(),
        }
    }

    pub(super) fn run(&self, this: &Loop<'_>) {
        match &self.of {
            On::Pool(pool) => pool.run(this),
            On::Scheduler(scheduler) => {
                // Not every job system bears loops within jobs.
                let _alone = Set::new(&EXECUTOR, Executor::Alone);
                HOSTED.run(this, |ticket| scheduler.run(this.threads, job, std::ptr::without_provenance_mut(ticket)));
            }
        }
    }
}

/// What a host's job system calls.
unsafe extern "C" fn job(ticket: *mut c_void) {
    HOSTED.share(ticket.addr(), Executor::Alone);
}

impl Priority {
    /// Gives this thread the priority. One that the system does not give stays as it was.
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
    /// From `sys/resource.h`. On Linux this with 0 is the calling thread.
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
