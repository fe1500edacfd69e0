use std::ptr::null;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::results::{CAIRN_ERROR_BUSY, CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_ERROR_STRUCT_SIZE};
use super::*;
use crate::tasks::PoolLease;

const OPTIONS: cairn_thread_options = cairn_thread_options {
    struct_size: size_of::<cairn_thread_options>() as u32,
    threads: 0,
    priority: 0,
    reserved: 0,
};
const SCHEDULER: cairn_scheduler = cairn_scheduler {
    struct_size: size_of::<cairn_scheduler>() as u32,
    concurrency: 2,
    run: Some(count),
    user: std::ptr::null_mut(),
};

static RUNS: AtomicUsize = AtomicUsize::new(0);

unsafe extern "C" fn count(_: *mut c_void, _: u32, job: cairn_job, data: *mut c_void) {
    RUNS.fetch_add(1, Ordering::SeqCst);
    if let Some(job) = job {
        // SAFETY: the library's own.
        unsafe { job(data) };
    }
}

fn threads(options: cairn_thread_options) -> cairn_result {
    // SAFETY: a struct of its own size.
    unsafe { cairn_set_threads(&options) }
}

fn scheduler(scheduler: cairn_scheduler) -> cairn_result {
    // SAFETY: a struct of its own size, whose callback needs no user.
    unsafe { cairn_set_scheduler(&scheduler) }
}

#[test]
fn refuses_invalid_options_and_schedulers() {
    // Objects of tests that run at the same time prevent a change of the settings, but not their check.
    for options in [
        cairn_thread_options { threads: CAIRN_MAX_THREADS + 1, ..OPTIONS },
        cairn_thread_options { priority: CAIRN_PRIORITY_LOWEST + 1, ..OPTIONS },
        cairn_thread_options { reserved: 1, ..OPTIONS },
    ] {
        assert_eq!(threads(options), CAIRN_ERROR_INVALID_ARGUMENT);
    }
    assert_eq!(threads(cairn_thread_options { struct_size: 3, ..OPTIONS }), CAIRN_ERROR_STRUCT_SIZE);
    for invalid in [
        cairn_scheduler { concurrency: 0, ..SCHEDULER },
        cairn_scheduler { concurrency: CAIRN_MAX_THREADS + 1, ..SCHEDULER },
        cairn_scheduler { run: None, ..SCHEDULER },
    ] {
        assert_eq!(scheduler(invalid), CAIRN_ERROR_INVALID_ARGUMENT);
    }
    assert_eq!(scheduler(cairn_scheduler { struct_size: 0, ..SCHEDULER }), CAIRN_ERROR_STRUCT_SIZE);
}

#[test]
fn refuses_changes_while_an_object_exists() {
    let object = PoolLease::new();
    assert_eq!(threads(OPTIONS), CAIRN_ERROR_BUSY);
    assert_eq!(scheduler(SCHEDULER), CAIRN_ERROR_BUSY);
    // SAFETY: null stands for the defaults.
    unsafe {
        assert_eq!(cairn_set_threads(null()), CAIRN_ERROR_BUSY);
        assert_eq!(cairn_set_scheduler(null()), CAIRN_ERROR_BUSY);
    }
    assert_eq!(RUNS.load(Ordering::SeqCst), 0);
    drop(object);
}
