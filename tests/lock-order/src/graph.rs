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

/// Where a thread that held one lock took another; `None` unless [`PLACES`] is set. Shared, since a cycle may be long.
type AcquisitionSite = Option<Arc<Backtrace>>;

/// Environment variable with which places are recorded, which is slow and allocates.
const PLACES: &str = "CAIRN_LOCK_ORDER_PLACES";

/// Room that is reserved at the start, so that tests which count allocations see none for a new edge.
const EDGES: usize = 1 << 14;
const NODES: usize = 1 << 12;

struct Graph {
    /// Pairs of a lock and one that was taken while it was held, with the place of the first time.
    edges: HashMap<(u64, u64), AcquisitionSite>,
    /// Scratch of the search: the locks that were reached, each with the position of the one before it.
    reached: Vec<(u64, usize)>,
    records_places: bool,
}

impl Default for Graph {
    fn default() -> Self {
        Self {
            edges: HashMap::with_capacity(EDGES),
            reached: Vec::with_capacity(NODES),
            records_places: std::env::var_os(PLACES).is_some(),
        }
    }
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
                // With the first lock, so that no test that counts allocations meets it later.
                LazyLock::force(&GRAPH);
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
        graph.edges.retain(|(before, after), _| *before != id && *after != id);
    }
}

impl Graph {
    /// Adds an edge; returns the places of the cycle that it closes, if it does.
    fn add(&mut self, before: u64, after: u64) -> Option<Vec<AcquisitionSite>> {
        if before == after {
            return Some(Vec::new());
        }
        if self.edges.contains_key(&(before, after)) {
            return None;
        }
        let back = self.path(after, before);
        if back.is_none() {
            let place = self.records_places.then(|| Arc::new(Backtrace::force_capture()));
            self.edges.insert((before, after), place);
        }
        back
    }

    /// Places of a path from one lock to another, the last first.
    fn path(&mut self, from: u64, to: u64) -> Option<Vec<AcquisitionSite>> {
        let Self { edges, reached, .. } = self;
        reached.clear();
        reached.push((from, 0));
        let mut next = 0;
        while next < reached.len() {
            let at = reached[next].0;
            if at == to {
                let mut places = Vec::new();
                while next > 0 {
                    let (lock, before) = reached[next];
                    places.extend(edges.get(&(reached[before].0, lock)).cloned());
                    next = before;
                }
                return Some(places);
            }
            for (_, after) in edges.keys().filter(|(before, _)| *before == at) {
                if !reached.iter().any(|(lock, _)| lock == after) {
                    reached.push((*after, next));
                }
            }
            next += 1;
        }
        None
    }
}

/// Reports a cycle and ends the process: a panic could be caught.
fn report(places: &[AcquisitionSite]) -> ! {
    let mut text = format!(
        "lock order: a thread takes a lock while it holds another, which {}: this could deadlock.\n\nIt takes the lock here:\n{}\n",
        if places.is_empty() { "is the same one" } else { "was taken in the opposite order before" },
        Backtrace::force_capture()
    );
    for place in places {
        let place =
            place.as_ref().map_or_else(|| format!("not recorded; {PLACES}=1 records it"), |place| place.to_string());
        text.push_str(&format!("\nBefore, one lock was taken while another was held, here:\n{place}\n"));
    }
    // Directly: tests capture what macros print.
    _ = std::io::stderr().write_all(text.as_bytes());
    std::process::abort()
}
