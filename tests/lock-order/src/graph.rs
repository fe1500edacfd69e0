//! The graph of all locks of the process, and the locks that each thread holds.

use std::backtrace::Backtrace;
use std::cell::RefCell;
use std::collections::HashMap;
use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// A lock's node.
pub(crate) struct Lock {
    /// 0 until it is first taken.
    id: AtomicU64,
}

/// Places where a thread that held one lock took another; shared, since a cycle may be long.
type Place = Arc<Backtrace>;

#[derive(Default)]
struct Graph {
    /// For each lock, those that were taken while it was held, with the place of the first time.
    after: HashMap<u64, HashMap<u64, Place>>,
}

static GRAPH: LazyLock<Mutex<Graph>> = LazyLock::new(Mutex::default);

thread_local! {
    /// Locks that this thread holds, in the order in which it took them.
    static HELD: RefCell<Vec<u64>> = const { RefCell::new(Vec::new()) };
}

impl Lock {
    /// A lock that was never taken.
    #[allow(clippy::declare_interior_mutable_const, reason = "each use is a lock of its own")]
    pub(crate) const NEW: Self = Self { id: AtomicU64::new(0) };

    fn id(&self) -> u64 {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        match self.id.load(Ordering::Relaxed) {
            0 => {
                let new = NEXT.fetch_add(1, Ordering::Relaxed);
                self.id.compare_exchange(0, new, Ordering::Relaxed, Ordering::Relaxed).map_or_else(|id| id, |_| new)
            }
            id => id,
        }
    }

    /// Before a thread waits for the lock: ends the process if its order could deadlock.
    pub(crate) fn before(&self) {
        let id = self.id();
        // At a thread's end its locks are gone, as are most of its objects.
        let cycle = HELD.try_with(|held| {
            let held = held.borrow();
            if held.is_empty() {
                return None;
            }
            let mut graph = GRAPH.lock().unwrap_or_else(PoisonError::into_inner);
            held.iter().find_map(|before| graph.add(*before, id))
        });
        if let Ok(Some(places)) = cycle {
            report(&places);
        }
    }

    /// After the lock was taken.
    pub(crate) fn taken(&self) {
        _ = HELD.try_with(|held| held.borrow_mut().push(self.id()));
    }

    /// Before the lock is released.
    pub(crate) fn released(&self) {
        let id = self.id();
        _ = HELD.try_with(|held| {
            let mut held = held.borrow_mut();
            if let Some(place) = held.iter().rposition(|held| *held == id) {
                held.remove(place);
            }
        });
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        let id = *self.id.get_mut();
        if id == 0 {
            return;
        }
        let mut graph = GRAPH.lock().unwrap_or_else(PoisonError::into_inner);
        graph.after.remove(&id);
        graph.after.values_mut().for_each(|after| _ = after.remove(&id));
        graph.after.retain(|_, after| !after.is_empty());
    }
}

impl Graph {
    /// Adds an edge; returns the places of the cycle that it closes, if it does.
    fn add(&mut self, before: u64, after: u64) -> Option<Vec<Place>> {
        if before == after {
            return Some(Vec::new());
        }
        if self.after.get(&before).is_some_and(|known| known.contains_key(&after)) {
            return None;
        }
        let back = self.path(after, before);
        if back.is_none() {
            // Captured where RUST_BACKTRACE is set.
            self.after.entry(before).or_default().insert(after, Arc::new(Backtrace::capture()));
        }
        back
    }

    /// Places of a path from one lock to another.
    fn path(&self, from: u64, to: u64) -> Option<Vec<Place>> {
        let mut seen = vec![from];
        let mut paths = vec![(from, Vec::new())];
        while let Some((at, path)) = paths.pop() {
            if at == to {
                return Some(path);
            }
            for (next, place) in self.after.get(&at).into_iter().flatten() {
                if !seen.contains(next) {
                    seen.push(*next);
                    paths.push((*next, path.iter().chain([place]).cloned().collect()));
                }
            }
        }
        None
    }
}

/// Reports a cycle and ends the process: a panic could be caught.
fn report(places: &[Place]) -> ! {
    let mut text = format!(
        "lock order: a thread takes a lock while it holds another, which {}: this could deadlock.\n\nIt takes the lock here:\n{}\n",
        if places.is_empty() { "is the same one" } else { "was taken in the opposite order before" },
        Backtrace::force_capture()
    );
    for place in places {
        text.push_str(&format!(
            "\nBefore, one lock was taken while another was held (RUST_BACKTRACE=1 says where):\n{place}\n"
        ));
    }
    // Directly: tests capture what macros print.
    _ = std::io::stderr().write_all(text.as_bytes());
    std::process::abort()
}
