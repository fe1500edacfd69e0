//! The process of a test program.

use std::ops::Range;

/// Resident memory of this process, in bytes.
pub fn resident_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("the process's status");
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its resident size");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") * 1024
}

/// Bytes that the C library's allocator has handed out and that were not given back, on all threads. The global allocator and foreign code use it.
/// Freed chunks that a thread keeps for itself count as handed out: a few KiB per thread.
#[cfg(target_env = "gnu")]
fn heap_memory() -> u64 {
    // SAFETY: the function has no precondition.
    let info = unsafe { libc::mallinfo2() };
    (info.uordblks + info.hblkhd) as u64
}

/// Other C libraries do not count.
#[cfg(not(target_env = "gnu"))]
fn heap_memory() -> u64 {
    0
}

/// Growth of the heap in bytes per item over a whole run, besides one window's. The smallest chunk has 32 bytes, so a leak in one item of 16 exceeds it.
const HEAP_DRIFT: u64 = 2;

/// Growth of the heap and of resident memory, in bytes, over a whole run whose windows may be uneven: what is allocated late, but once.
const LATE_GROWTH: i64 = 2 << 20;

/// What a soak allows.
pub struct MemoryBounds {
    /// Items in a window.
    pub window: u64,
    /// Growth of the heap in bytes per item, over each window.
    pub heap_per_item: u64,
    /// Growth of the resident memory in bytes in one window: memory from elsewhere than the heap, and the drift of the heap's arenas.
    pub resident_per_window: u64,
}

impl MemoryBounds {
    /// Makes the items of `range`, a window at a time, and returns the growth of heap and resident memory in each window.
    ///
    /// # Panics
    /// In the first window that grew by more than is allowed, and at the end if the whole run did.
    pub fn check(&self, range: Range<u64>, mut item: impl FnMut(u64)) -> Vec<[u64; 2]> {
        let memory = || [heap_memory(), resident_memory()];
        let grown = |from: [u64; 2], to: [u64; 2]| [0, 1].map(|i| to[i].saturating_sub(from[i]));
        let first = memory();
        let (mut last, mut windows, mut at) = (first, Vec::new(), range.start);
        while at < range.end {
            let end = range.end.min(at + self.window);
            (at..end).for_each(&mut item);
            let now = memory();
            let [heap, resident] = grown(last, now);
            assert!(
                heap <= self.heap_per_item * (end - at) && resident <= self.resident_per_window,
                "items {at} to {end}: the heap grew by {heap} bytes and the resident memory by {resident}"
            );
            windows.push([heap, resident]);
            (last, at) = (now, end);
        }
        let [heap, _] = grown(first, last);
        let items = range.end - range.start;
        let allowed = self.heap_per_item * self.window + HEAP_DRIFT * items;
        assert!(heap <= allowed, "the heap grew by {heap} bytes in {items} items: {windows:?}");
        windows
    }

    /// As [`check`](Self::check), but bounds the median of the windows, and their sum by a constant: for providers whose own threads give memory
    /// back at their own times, and compile or allocate something late, but once. A leak in each item grows every window.
    ///
    /// # Panics
    /// At the end, if the median of the windows or the whole run grew by more than is allowed.
    pub fn check_median(&self, range: Range<u64>, mut item: impl FnMut(u64)) -> Vec<[i64; 2]> {
        let memory = || [heap_memory(), resident_memory()].map(u64::cast_signed);
        let grown = |from: [i64; 2], to: [i64; 2]| [0, 1].map(|i| to[i] - from[i]);
        let first = memory();
        let (mut last, mut windows, mut at) = (first, Vec::new(), range.start);
        while at < range.end {
            let end = range.end.min(at + self.window);
            (at..end).for_each(&mut item);
            let now = memory();
            windows.push(grown(last, now));
            (last, at) = (now, end);
        }
        let median = [0, 1].map(|i| {
            let mut sorted: Vec<i64> = windows.iter().map(|window| window[i]).collect();
            sorted.sort_unstable();
            sorted[sorted.len() / 2]
        });
        let allowed = [self.heap_per_item * self.window, self.resident_per_window].map(u64::cast_signed);
        let whole = grown(first, last);
        let is_right = |i: usize| median[i] <= allowed[i] && whole[i] <= LATE_GROWTH;
        assert!(
            is_right(0) && is_right(1),
            "the median window grew by {median:?} bytes, the run by {whole:?}: {windows:?}"
        );
        windows
    }
}
