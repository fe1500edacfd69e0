//! Orders that could deadlock end a process, and others do not.

use std::process::Command;
use std::thread;
use std::time::Duration;

use lock_order::{Condvar, Mutex, ReentrantMutex, RwLock};

/// Runs a test in a process of its own; returns what it printed, and whether it came to its end.
fn in_new_process(test: &str, act: fn()) -> Option<(String, bool)> {
    const VARIABLE: &str = "CAIRN_LOCK_ORDER_TEST";
    if std::env::var_os(VARIABLE).is_some_and(|name| name == test) {
        act();
        return None;
    }
    let own = std::env::current_exe().expect("our own path");
    let ended = Command::new(own).args(["--exact", test, "--nocapture"]).env(VARIABLE, test).output();
    let ended = ended.expect("a process");
    Some((String::from_utf8_lossy(&ended.stderr).into_owned(), ended.status.success()))
}

/// Tests whose order is reported.
macro_rules! reported {
    ($($name:ident: $why:literal, $act:expr;)*) => {$(
        #[test]
        fn $name() {
            let Some((text, ended)) = in_new_process(stringify!($name), || { ($act)(); }) else { return };
            assert!(!ended, "it ends the process");
            assert!(text.contains("lock order: ") && text.contains($why), "{text}");
        }
    )*};
}

const OPPOSITE: &str = "was taken in the opposite order before";

/// Does something on a thread, to its end.
fn on_thread(work: impl FnOnce() + Send) {
    thread::scope(|scope| _ = scope.spawn(work));
}

reported! {
    opposite_orders_of_two_threads_are_reported_though_neither_waited: "opposite order", || {
        let (a, b) = (Mutex::new(()), Mutex::new(()));
        on_thread(|| {
            let _a = a.lock();
            let _b = b.lock();
        });
        on_thread(|| {
            let _b = b.lock();
            let _a = a.lock();
        });
    };
    a_circle_of_three_locks_is_reported: "opposite order", || {
        let locks = [(); 3].map(Mutex::new);
        for place in 0..3 {
            on_thread(|| {
                let _first = locks[place].lock();
                let _second = locks[(place + 1) % 3].lock();
            });
        }
    };
    readers_count_like_writers: "opposite order", || {
        let (a, b) = (Mutex::new(()), RwLock::new(()));
        on_thread(|| {
            let _a = a.lock();
            let _b = b.read();
        });
        on_thread(|| {
            let _b = b.write();
            let _a = a.lock();
        });
    };
    a_lock_that_was_tried_counts_once_it_is_held: "opposite order", || {
        let (a, b) = (Mutex::new(()), Mutex::new(()));
        on_thread(|| {
            let _a = a.try_lock().expect("nobody has it");
            let _b = b.lock();
        });
        on_thread(|| {
            let _b = b.lock();
            let _a = a.lock();
        });
    };
    a_lock_that_its_own_thread_holds_is_reported: "is the same one", || {
        let a = Mutex::new(());
        let _a = a.lock();
        let _again = a.lock();
    };
    waiting_with_a_later_lock_held_is_reported: "opposite order", || {
        let (a, b, changed) = (Mutex::new(()), Mutex::new(()), Condvar::new());
        let mut guard = a.lock();
        let _b = b.lock();
        changed.wait_for(&mut guard, Duration::from_millis(1));
    };
}

#[test]
fn both_places_are_named_with_backtraces() {
    let act = || {
        let (a, b) = (Mutex::new(()), Mutex::new(()));
        let first = || {
            let _a = a.lock();
            let _b = b.lock();
        };
        first();
        let _b = b.lock();
        let _a = a.lock();
    };
    let own = std::env::current_exe().expect("our own path");
    if std::env::var_os("CAIRN_LOCK_ORDER_PLACES").is_some() {
        return act();
    }
    let mut command = Command::new(own);
    command.args(["--exact", "both_places_are_named_with_backtraces", "--nocapture"]);
    let ended = command.env("CAIRN_LOCK_ORDER_PLACES", "1").env("RUST_BACKTRACE", "1").output().expect("a process");
    let text = String::from_utf8_lossy(&ended.stderr);
    assert!(!ended.status.success() && text.contains(OPPOSITE), "{text}");
    assert!(text.contains("It takes the lock here:") && text.contains("Before, one lock was taken"), "{text}");
    assert!(text.matches("\n   0: ").count() >= 2, "{text}");
}

#[test]
fn orders_that_cannot_deadlock_pass() {
    let (a, b, changed) = (Mutex::new(0), Mutex::new(0), Condvar::new());
    let (reentrant, readers) = (ReentrantMutex::new(()), RwLock::new(()));
    for _ in 0..2 {
        on_thread(|| {
            let _a = a.lock();
            let _b = b.lock();
            let _reentrant = reentrant.lock();
            let _readers = readers.read();
            let _again = reentrant.lock();
        });
        // A lock that is tried never waits.
        on_thread(|| {
            let _b = b.lock();
            assert!(a.try_lock().is_some());
        });
        // One after the other.
        on_thread(|| {
            *b.lock() += 1;
            *a.lock() += 1;
        });
    }
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut guard = a.lock();
            while *guard < 10 {
                changed.wait(&mut guard);
            }
        });
        for _ in 0..10 {
            *a.lock() += 1;
            changed.notify_all();
        }
    });
    // Locks that are gone have no order.
    let a = Mutex::new(());
    for _ in 0..100 {
        let b = Mutex::new(());
        let (_a, _b) = (a.lock(), b.lock());
    }
    let b = Mutex::new(());
    let (_b, _a) = (b.lock(), a.lock());
}
