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

/// Limit on the growth of heap and resident memory over a run that is judged by its median window, in bytes: something may be allocated once, at
/// any time.
const GROWTH_OF_RUN: i64 = 2 << 20;

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
    pub fn check(&self, range: Range<u64>, item: impl FnMut(u64)) -> Vec<[i64; 2]> {
        let items = range.end - range.start;
        let (windows, [heap, _]) = self.measure(range, item, |window, [heap, resident]| {
            let allowed = self.heap_per_item * (window.end - window.start);
            assert!(
                heap <= allowed.cast_signed() && resident <= self.resident_per_window.cast_signed(),
                "items {window:?}: the heap grew by {heap} bytes and the resident memory by {resident}"
            );
        });
        let allowed = self.heap_per_item * self.window + HEAP_DRIFT * items;
        assert!(heap <= allowed.cast_signed(), "the heap grew by {heap} bytes in {items} items: {windows:?}");
        windows
    }

    /// As [`check`](Self::check), but bounds the median window and the whole run, for providers whose own threads free memory at times of their own,
    /// and which allocate something once at any time. A leak in each item grows every window.
    ///
    /// # Panics
    /// At the end, if the median window or the whole run grew by more than is allowed.
    pub fn check_median(&self, range: Range<u64>, item: impl FnMut(u64)) -> Vec<[i64; 2]> {
        let (windows, run) = self.measure(range, item, |_, _| ());
        let median = [0, 1].map(|i| {
            let mut sorted: Vec<i64> = windows.iter().map(|window| window[i]).collect();
            sorted.sort_unstable();
            sorted[sorted.len() / 2]
        });
        let allowed = [self.heap_per_item * self.window, self.resident_per_window].map(u64::cast_signed);
        let is_right = |i: usize| median[i] <= allowed[i] && run[i] <= GROWTH_OF_RUN;
        assert!(
            is_right(0) && is_right(1),
            "the median window grew by {median:?} bytes, the run by {run:?}: {windows:?}"
        );
        windows
    }

    /// Growth of heap and resident memory in each window, which `window_done` gets as soon as it is known, and in the whole run.
    fn measure(
        &self,
        range: Range<u64>,
        mut item: impl FnMut(u64),
        window_done: impl Fn(Range<u64>, [i64; 2]),
    ) -> (Vec<[i64; 2]>, [i64; 2]) {
        let memory = || [heap_memory(), resident_memory()].map(u64::cast_signed);
        let grown = |from: [i64; 2], to: [i64; 2]| [0, 1].map(|i| to[i] - from[i]);
        let first = memory();
        let (mut last, mut windows, mut at) = (first, Vec::new(), range.start);
        while at < range.end {
            let end = range.end.min(at + self.window);
            (at..end).for_each(&mut item);
            let now = memory();
            window_done(at..end, grown(last, now));
            windows.push(grown(last, now));
            (last, at) = (now, end);
        }
        (windows, grown(first, last))
    }
}
