//! The device's own clock: marks in a queue's work, and the time between two of them.

use std::time::Duration;

use windows::Win32::Graphics::Direct3D12::*;

use super::{Gpu, Heap, Queue, Shared, count_object, failed_on};
use crate::Result;

/// Time that frames, or a world's passes, have taken on the device, from the first to the last of their commands. What else a queue
/// runs at the same time is in it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Spent {
    /// Frames or passes whose time is known.
    pub frames: u64,
    /// All of them together.
    pub total: Duration,
    /// The longest.
    pub longest: Duration,
    /// The one that was looked at last.
    pub last: Duration,
}

impl Spent {
    /// Counts one more.
    pub(crate) fn add(&mut self, took: Duration) {
        self.frames += 1;
        self.total = self.total.saturating_add(took);
        self.longest = self.longest.max(took);
        self.last = took;
    }

    /// Both, where `later` follows.
    pub(crate) fn and(self, later: Self) -> Self {
        Self {
            frames: self.frames + later.frames,
            total: self.total.saturating_add(later.total),
            longest: self.longest.max(later.longest),
            last: if later.frames > 0 { later.last } else { self.last },
        }
    }
}

/// Pairs of the clock's marks, one before some work and one behind it.
pub(crate) struct Marks {
    heap: ID3D12QueryHeap,
    marks: Shared,
    /// Ticks in a second.
    rate: u64,
}

/// Bytes of a mark, and of a pair.
const MARK: usize = size_of::<u64>();
const PAIR: usize = 2 * MARK;

impl Marks {
    /// So many pairs for work on a queue like `queue`; none where that has no clock.
    pub(crate) fn new(gpu: &Gpu, queue: &Queue, pairs: usize) -> Result<Option<Self>> {
        // SAFETY: a live queue; the call takes nothing.
        let Ok(rate) = (unsafe { queue.d3d12().GetTimestampFrequency() }) else { return Ok(None) };
        if rate == 0 {
            return Ok(None);
        }
        let count = 2 * pairs as u32;
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: count, NodeMask: 0 };
        let mut heap: Option<ID3D12QueryHeap> = None;
        count_object();
        // SAFETY: a live device; description and place live during the call.
        unsafe { gpu.device().CreateQueryHeap(&wanted, &mut heap) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateQueryHeap", &e))?;
        let Some(heap) = heap else { return Ok(None) };
        Ok(Some(Self { heap, marks: Shared::new(gpu, Heap::Readback, PAIR * pairs)?, rate }))
    }

    /// Marks the start of some work in an open list. The marks must live until it has run.
    pub(crate) fn start(&self, list: &ID3D12GraphicsCommandList, pair: usize) {
        // SAFETY: an open list and a live heap with two places to a pair.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, 2 * pair as u32) };
    }

    /// Marks its end in the same list or a later one of the queue, and has both marks written down.
    pub(crate) fn end(&self, list: &ID3D12GraphicsCommandList, pair: usize) {
        let (first, at) = (2 * pair as u32, (PAIR * pair) as u64);
        // SAFETY: as above.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first + 1) };
        // SAFETY: as above; the buffer has room for each pair.
        unsafe {
            list.ResolveQueryData(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first, 2, self.marks.resource(), at);
        };
    }

    /// The first mark of a pair, as a name for this use of it, and the time between the two, once their lists have run; no time where
    /// the clock was set back meanwhile.
    pub(crate) fn read(&self, pair: usize) -> (u64, Option<Duration>) {
        let mut marks = [0; PAIR];
        self.marks.read_at(PAIR * pair, &mut marks);
        let [start, end] = [0, MARK].map(|at| u64::from_le_bytes(std::array::from_fn(|i| marks[at + i])));
        let nanoseconds = |ticks: u64| u128::from(ticks) * 1_000_000_000 / u128::from(self.rate);
        let took = end.checked_sub(start).map(|ticks| u64::try_from(nanoseconds(ticks)).unwrap_or(u64::MAX));
        (start, took.map(Duration::from_nanos))
    }
}
