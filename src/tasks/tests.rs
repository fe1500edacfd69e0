use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::locks::Mutex;

use super::*;
use crate::ErrorKind;

/// The settings are global to the process: tests that change them run one after the other.
static SETTINGS: Mutex<()> = Mutex::new(());

type Job = unsafe extern "C" fn(*mut c_void);

/// Calls `set_scheduler`, and retries while objects of other tests exist.
fn set(scheduler: Option<Arc<dyn Scheduler>>) {
    while let Err(e) = set_scheduler(scheduler.clone()) {
        assert_eq!(e.kind(), ErrorKind::Busy);
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Results of a loop with float sums, which must not depend on the order of its items.
fn mixed() -> Vec<f32> {
    let given: Vec<f32> = (0..10_007).map(|i| (i as f32 * 0.37).sin()).collect();
    let mut out = vec![0.0_f32; given.len()];
    let chunks = out.par_chunks_mut(61).zip(given.par_chunks(61));
    chunks.with_min_len(2).enumerate().for_each(|(n, (out, given))| {
        let mut sum = n as f32;
        for (out, given) in out.iter_mut().zip(given) {
            sum = sum * 0.5 + given;
            *out = sum;
        }
    });
    out
}

#[test]
fn every_index_runs_once_whatever_shares_the_loop() {
    for concurrency in [1, 2, 3, 9] {
        let pool = Pool::new(concurrency).unwrap();
        for len in [0, 1, 2, 7, 64, 1000] {
            for min_len in [0, 1, 5, 2000] {
                let runs: Vec<_> = (0..len).map(|_| AtomicUsize::new(0)).collect();
                pool.install(|| {
                    for_each_range(len, min_len, |range| {
                        range.for_each(|index| _ = runs[index].fetch_add(1, Ordering::Relaxed));
                    });
                });
                assert!(runs.iter().all(|runs| runs.load(Ordering::Relaxed) == 1));
            }
        }
    }
}

#[test]
fn items_are_those_of_a_plain_loop() {
    let pool = Pool::new(4).unwrap();
    let alone = Pool::new(1).unwrap();
    assert_eq!(pool.install(mixed), alone.install(mixed));
    let (mut values, others) = (vec![0_usize; 100], [7_usize; 90]);
    pool.install(|| {
        values
            .par_iter_mut()
            .zip(others.par_iter())
            .take(50)
            .enumerate()
            .for_each(|(i, (value, other))| *value = i + other);
    });
    assert!(values.iter().enumerate().all(|(i, value)| *value == if i < 50 { i + 7 } else { 0 }));
}

#[test]
fn slots_are_never_used_by_two_calls_at_a_time() {
    let pool = Pool::new(6).unwrap();
    let slots: Vec<_> = (0..3).map(|_| Mutex::new(0_usize)).collect();
    let mut values = [0_u8; 500];
    pool.install(|| {
        values.par_iter_mut().for_each_in_slot(slots.len(), |slot, _| {
            *slots[slot].try_lock().expect("nobody else has this slot") += 1;
            std::thread::yield_now();
        });
    });
    assert_eq!(slots.iter().map(|slot| *slot.lock()).sum::<usize>(), 500);
}

#[test]
fn nested_loops_and_joins_end() {
    let pool = Pool::new(3).unwrap();
    let count = AtomicUsize::new(0);
    let inner = || for_each_index(50, |_| _ = count.fetch_add(1, Ordering::Relaxed));
    let (a, b) = pool.install(|| {
        for_each_index(20, |_| inner());
        join_loops(
            || {
                inner();
                1
            },
            || {
                inner();
                "two"
            },
        )
    });
    assert_eq!((a, b, count.load(Ordering::Relaxed)), (1, "two", 22 * 50));
}

#[test]
fn a_panic_reaches_the_thread_that_started_the_loop_and_no_other() {
    let pool = Pool::new(4).unwrap();
    for _ in 0..20 {
        let result = catch_unwind(AssertUnwindSafe(|| {
            pool.install(|| for_each_index(100, |index| assert!(index != 50, "fifty")));
        }));
        assert!(crate::error::panic_text(&*result.unwrap_err()).is_some_and(|text| text.contains("fifty")));
        // The pool still works.
        assert_eq!(pool.install(mixed).len(), 10_007);
    }
}

#[test]
fn a_thread_that_shares_a_loop_works_for_the_one_that_started_it() {
    let pool = Pool::new(4).unwrap();
    let me = std::thread::current().id();
    pool.install(|| {
        for_each_index(64, |_| {
            assert_eq!(calling_thread(), me);
            for_each_index(4, |_| assert_eq!(calling_thread(), me));
            std::thread::yield_now();
        });
    });
    assert_eq!(calling_thread(), me);
}

#[cfg(all(target_os = "linux", not(miri)))]
#[test]
fn threads_of_a_pool_have_their_priority() {
    unsafe extern "C" {
        safe fn getpriority(which: i32, who: u32) -> i32;
    }
    let nice = || getpriority(0, 0);
    let (own, me) = (nice(), std::thread::current().id());
    for (priority, raised) in [(Priority::Normal, 0), (Priority::BelowNormal, 5), (Priority::Lowest, 10)] {
        let (pool, failed) = Pool::start(1, priority);
        assert!(failed.is_none());
        // Both threads that share the loop must take part.
        let (meet, found) = (std::sync::Barrier::new(2), Mutex::new(None));
        pool.install(|| {
            for_each_index(2, |_| {
                meet.wait();
                if std::thread::current().id() != me {
                    *found.lock() = Some(nice());
                }
            });
        });
        assert_eq!(found.into_inner(), Some((own + raised).min(19)), "{priority:?}");
    }
}

#[test]
fn thread_counts_out_of_range_are_refused() {
    for concurrency in [0, MAX_THREADS + 2, usize::MAX] {
        assert_eq!(Pool::new(concurrency).unwrap_err().kind(), ErrorKind::InvalidArgument);
    }
    for threads in [0, MAX_THREADS + 1] {
        let options = ThreadOptions { threads: Some(threads), ..ThreadOptions::default() };
        assert_eq!(set_threads(options).unwrap_err().kind(), ErrorKind::InvalidArgument);
    }
}

#[test]
fn settings_cannot_change_while_an_object_lives() {
    let _lock = SETTINGS.lock();
    let object = PoolLease::new();
    assert_eq!(set_threads(ThreadOptions::default()).unwrap_err().kind(), ErrorKind::Busy);
    assert_eq!(set_scheduler(None).unwrap_err().kind(), ErrorKind::Busy);
    drop(object);
    set(None);
}

/// Behaviour of a host's job system.
#[derive(Clone, Copy, PartialEq)]
enum JobBehaviour {
    /// Runs them as documented.
    Good,
    /// Runs none.
    None,
    /// Runs one, on the calling thread.
    One,
    /// Runs all of them many times.
    Many,
    /// Runs all of them on other threads, and does not wait.
    Later,
    /// Runs all of them after it has returned and the loop is over.
    Late,
}

struct Host {
    manner: JobBehaviour,
    started: Mutex<Vec<std::thread::JoinHandle<()>>>,
    late: Mutex<Vec<(Job, usize)>>,
}

thread_local! {
    /// Whether this thread is within a job. Other tests' threads use the job system meanwhile.
    static IS_WITHIN: Cell<bool> = const { Cell::new(false) };
}

impl Scheduler for Host {
    fn concurrency(&self) -> usize {
        4
    }

    fn run(&self, jobs: usize, job: Job, data: *mut c_void) {
        assert!((2..=4).contains(&jobs));
        assert!(!IS_WITHIN.get(), "never within a job");
        let data = data.addr();
        // SAFETY: the library's own job and data.
        let call = move || unsafe { job(std::ptr::without_provenance_mut(data)) };
        match self.manner {
            JobBehaviour::Good => std::thread::scope(|scope| {
                for _ in 1..jobs {
                    scope.spawn(call);
                }
                call();
            }),
            JobBehaviour::None => {}
            JobBehaviour::One => call(),
            JobBehaviour::Many => std::thread::scope(|scope| {
                for _ in 0..3 * jobs {
                    scope.spawn(move || (0..5).for_each(|_| call()));
                }
            }),
            JobBehaviour::Later => self.started.lock().extend((0..jobs).map(|_| std::thread::spawn(call))),
            JobBehaviour::Late => self.late.lock().push((job, data)),
        }
    }
}

#[test]
fn loops_are_right_whatever_a_host_s_job_system_does_with_jobs() {
    let _lock = SETTINGS.lock();
    let expected = Pool::new(1).unwrap().install(mixed);
    for manner in [
        JobBehaviour::Good,
        JobBehaviour::None,
        JobBehaviour::One,
        JobBehaviour::Many,
        JobBehaviour::Later,
        JobBehaviour::Late,
    ] {
        let (started, late) = (Mutex::default(), Mutex::default());
        let host = Arc::new(Host { manner, started, late });
        set(Some(host.clone()));
        {
            let _object = PoolLease::new();
            assert_eq!(concurrency(), 4);
            for _ in 0..10 {
                assert!(mixed() == expected);
            }
            // Loops within its jobs do not use it.
            for_each_index(20, |_| {
                IS_WITHIN.set(true);
                for_each_index(20, |_| {});
                IS_WITHIN.set(false);
            });
            let result = catch_unwind(|| for_each_index(100, |index| assert!(index != 50, "fifty")));
            assert!(result.is_err(), "a panic is the caller's");
        }
        set(None);
        for thread in host.started.lock().drain(..) {
            thread.join().expect("no panic gets into the host's threads");
        }
        for (job, data) in host.late.lock().drain(..) {
            // SAFETY: the library's own; the loop is over, and it finds none.
            unsafe { job(std::ptr::without_provenance_mut(data)) };
        }
    }
}

#[test]
fn loops_are_not_shared_without_an_object() {
    let _lock = SETTINGS.lock();
    let host = |manner| {
        let (started, late) = (Mutex::default(), Mutex::default());
        Arc::new(Host { manner, started, late })
    };
    let host = host(JobBehaviour::Late);
    set(Some(host.clone()));
    // Objects of other tests may share the loop.
    let me = std::thread::current().id();
    for_each_index(100, |_| assert_eq!(calling_thread(), me));
    set(None);
}
