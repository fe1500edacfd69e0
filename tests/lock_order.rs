//! The library that tests are built with records the order of its locks: two of them that are taken in opposite orders end the process.

use std::process::Command;

use cairn::locks::Mutex;

#[test]
fn locks_of_the_library_in_opposite_orders_end_the_process() {
    const VARIABLE: &str = "CAIRN_LOCK_ORDER_TEST";
    if std::env::var_os(VARIABLE).is_some() {
        let (a, b) = (Mutex::new(()), Mutex::new(()));
        for (first, second) in [(&a, &b), (&b, &a)] {
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let _first = first.lock();
                    let _second = second.lock();
                });
            });
        }
        return;
    }
    let own = std::env::current_exe().expect("our own path");
    let ended = Command::new(own).args(["--nocapture"]).env(VARIABLE, "1").output().expect("a process");
    let text = String::from_utf8_lossy(&ended.stderr);
    assert!(!ended.status.success() && text.contains("was taken in the opposite order before"), "{text}");
}
