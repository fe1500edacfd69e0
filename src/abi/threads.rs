//! Threads that share the library's work: its own, or the host's job system.

use std::ffi::c_void;
use std::sync::Arc;

use super::boundary::call;
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{check_zero, describe, read, read_or_default};
use crate::tasks::{MAX_THREADS, Priority, Scheduler, ThreadOptions, set_scheduler, set_threads};

/// The library's own threads run below normal priority, so that a game's threads run first: THREAD_PRIORITY_BELOW_NORMAL on Windows,
/// a nice value raised by 5 on Linux.
pub const CAIRN_PRIORITY_BELOW_NORMAL: u32 = 0;
/// The library's own threads run at normal priority; on Linux at that of the thread whose call starts them.
pub const CAIRN_PRIORITY_NORMAL: u32 = 1;
/// The library's own threads run at the lowest priority: THREAD_PRIORITY_LOWEST on Windows, a nice value raised by 10 on Linux.
pub const CAIRN_PRIORITY_LOWEST: u32 = 2;
/// The largest number of the library's own threads, and the largest concurrency of a host's job system.
pub const CAIRN_MAX_THREADS: u32 = 1024;

/// Options of the library's own threads. They share work on pictures with the calling thread: frame generation on the processor,
/// motion, resampling.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_thread_options {
    /// sizeof(cairn_thread_options)
    pub struct_size: u32,
    /// Number of threads, 1 to CAIRN_MAX_THREADS, in addition to the calling ones; 0 for one less than the physical cores that this
    /// process may use, but at least one.
    pub threads: u32,
    /// CAIRN_PRIORITY_BELOW_NORMAL, CAIRN_PRIORITY_NORMAL or CAIRN_PRIORITY_LOWEST
    pub priority: u32,
    /// 0
    pub reserved: u32,
}
describe!(cairn_thread_options, [], { struct_size, threads, priority, reserved });

/// Does one share of the library's work; data is the pointer that cairn_run_callback got. May be called on any thread. If the work is
/// already complete, the call returns at once; it must not come after the library is unloaded.
pub type cairn_job = Option<unsafe extern "C" fn(data: *mut c_void)>;

/// Calls job(data) up to jobs times, on any number of threads at the same time, including the calling one, and returns when these
/// calls have returned. Each call does a different share of the work. When the callback has made fewer calls, or none, the library
/// does the rest on the calling thread, and it waits for calls that have not returned. user is the pointer in cairn_scheduler.
///
/// It is called on threads that call the library, also on several at once, without any lock held, and never within a job. It may call
/// Cairn, but must not destroy an object that a call further up the stack is using, and must not throw.
pub type cairn_run_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, jobs: u32, job: cairn_job, data: *mut c_void)>;

/// A host's job system.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_scheduler {
    /// sizeof(cairn_scheduler)
    pub struct_size: u32,
    /// The largest number of jobs that run at the same time, 1 to CAIRN_MAX_THREADS.
    pub concurrency: u32,
    /// Runs jobs; required.
    pub run: cairn_run_callback,
    /// Passed to the callback.
    pub user: *mut c_void,
}
describe!(cairn_scheduler, [], { struct_size, concurrency, run, user });

/// Sets the number and the priority of the library's own threads, for the whole process. They start with the first work that is
/// shared, and have ended when the call that destroys the last object returns. Their number changes no result.
///
/// options: may be null for the defaults.
///
/// Ownership: options stays the caller's, on success and on failure; a failure changes nothing.
/// Threads: any thread, while there is no object of this library.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while there is an object.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_set_threads(options: *const cairn_thread_options) -> cairn_result {
    call("cairn_set_threads", || {
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read_or_default(options, "options") }?;
        set_threads(thread_options(&options)?)?;
        Ok(CAIRN_OK)
    })
}

/// Makes the library share its work on the host's job system instead of starting threads of its own, for the whole process. This
/// changes no result.
///
/// scheduler: null for the library's own threads.
///
/// Ownership: scheduler stays the caller's and is copied; on success its user must live until another is set, on failure nothing
/// changes.
/// Threads: any thread, while there is no object of this library.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while there is an object.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_set_scheduler(scheduler: *const cairn_scheduler) -> cairn_result {
    call("cairn_set_scheduler", || {
        let scheduler = if scheduler.is_null() {
            None
        } else {
            // SAFETY: the host's promise about `scheduler`.
            Some(Arc::new(host_scheduler(&unsafe { read(scheduler, "scheduler") }?)?) as Arc<dyn Scheduler>)
        };
        set_scheduler(scheduler)?;
        Ok(CAIRN_OK)
    })
}

fn thread_options(options: &cairn_thread_options) -> AbiResult<ThreadOptions> {
    let refuse = |field: &str, why: String| Err(Failure::argument(&format!("options.{field}"), why));
    let threads = match options.threads {
        0 => None,
        threads @ 1..=CAIRN_MAX_THREADS => Some(threads as usize),
        other => return refuse("threads", format!("{other} are more than {CAIRN_MAX_THREADS}")),
    };
    let priority = match options.priority {
        CAIRN_PRIORITY_BELOW_NORMAL => Priority::BelowNormal,
        CAIRN_PRIORITY_NORMAL => Priority::Normal,
        CAIRN_PRIORITY_LOWEST => Priority::Lowest,
        other => return refuse("priority", format!("{other} is no priority")),
    };
    check_zero(options.reserved, "options.reserved")?;
    Ok(ThreadOptions { threads, priority })
}

/// The host's job system.
struct HostScheduler {
    run: unsafe extern "C" fn(*mut c_void, u32, cairn_job, *mut c_void),
    user: *mut c_void,
    concurrency: usize,
}

// SAFETY: the pointer is the host's; the documentation of the callback says that it is used on any thread.
unsafe impl Send for HostScheduler {}
// SAFETY: as above.
unsafe impl Sync for HostScheduler {}

const _: () = assert!(CAIRN_MAX_THREADS as usize == MAX_THREADS);

fn host_scheduler(scheduler: &cairn_scheduler) -> AbiResult<HostScheduler> {
    let concurrency = scheduler.concurrency;
    if !(1..=CAIRN_MAX_THREADS).contains(&concurrency) {
        return Err(Failure::argument("scheduler.concurrency", format!("{concurrency} jobs at the same time"))
            .remedy(format!("Use 1 to {CAIRN_MAX_THREADS}")));
    }
    let run = scheduler.run.ok_or_else(|| Failure::argument("scheduler.run", "it is null"))?;
    Ok(HostScheduler { run, user: scheduler.user, concurrency: concurrency as usize })
}

impl Scheduler for HostScheduler {
    fn concurrency(&self) -> usize {
        self.concurrency
    }

    fn run(&self, jobs: usize, job: unsafe extern "C" fn(*mut c_void), data: *mut c_void) {
        // SAFETY: the host promised at `cairn_set_scheduler` that it may be called with its own pointer.
        unsafe { (self.run)(self.user, jobs as u32, Some(job), data) };
    }
}

#[cfg(test)]
mod tests;
