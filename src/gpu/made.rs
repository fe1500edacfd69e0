//! How many objects a thread has made: what a frame makes on an engine's render thread is a hitch.

use std::cell::Cell;

thread_local! {
    static MADE: Cell<u64> = const { Cell::new(0) };
}

/// Counts an object of Direct3D or a context of AMD's that this thread has made.
pub(crate) fn count_object() {
    MADE.with(|made| made.set(made.get() + 1));
}

/// What `work` returns, and how many objects this thread has made in it.
pub(crate) fn counted<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let before = MADE.with(Cell::get);
    let done = work();
    (done, MADE.with(Cell::get) - before)
}
