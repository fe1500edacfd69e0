//! Counts the objects created by a thread: creating one while recording a frame causes a hitch on the engine's render thread.

use std::cell::Cell;

thread_local! {
    static MADE: Cell<u64> = const { Cell::new(0) };
}

/// Counts one Direct3D object or AMD context created by this thread.
pub(crate) fn count_object() {
    MADE.with(|made| made.set(made.get() + 1));
}

/// Runs `work`; returns its result and the number of objects this thread created meanwhile.
#[cfg_attr(not(windows), expect(dead_code, reason = "frames are recorded on Direct3D 12 alone"))]
pub(crate) fn counted<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let before = MADE.with(Cell::get);
    let done = work();
    (done, MADE.with(Cell::get) - before)
}
