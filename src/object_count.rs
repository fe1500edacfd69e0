//! Counts the Direct3D objects that a thread creates: creating one while a frame is recorded stalls the engine's render thread.

use std::cell::Cell;

thread_local! {
    static CREATED: Cell<u64> = const { Cell::new(0) };
}

/// Counts one Direct3D object or AMD context created by this thread.
pub(crate) fn count_object() {
    CREATED.with(|made| made.set(made.get() + 1));
}

/// Runs `work`; returns its result and the number of objects this thread created meanwhile.
#[cfg_attr(not(windows), expect(dead_code, reason = "frames are recorded on Direct3D 12 alone"))]
pub(crate) fn count_created<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let before = CREATED.with(Cell::get);
    let done = work();
    (done, CREATED.with(Cell::get) - before)
}
