//! How long frames take on the device.

use std::time::Duration;

use windows::Win32::Graphics::Direct3D12::*;

use super::frames::FRAMES_IN_FLIGHT;
use crate::Result;
use crate::gpu::{Gpu, Heap, Queue, Shared, failed_on};

/// Time that frames of a ring have taken on the device, from the first to the last of their commands. What else a queue runs at the
/// same time is in it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Spent {
    /// Frames whose time is known.
    pub frames: u64,
    /// All of them together.
    pub total: Duration,
    /// The longest.
    pub longest: Duration,
    /// The one that was looked at last.
    pub last: Duration,
}

/// The clock's marks before and behind each frame of a ring.
pub(super) struct Timing {
    heap: ID3D12QueryHeap,
    marks: Shared,
    /// Ticks in a second.
    rate: u64,
    /// The first mark of each slot as it was seen last: a list that was never run leaves it there.
    seen: [u64; FRAMES_IN_FLIGHT],
    pub(super) spent: Spent,
}

/// Bytes of a mark, and of a frame's two.
const MARK: usize = size_of::<u64>();
const MARKS: usize = 2 * MARK;

impl Timing {
    /// For frames on a queue like `queue`; none where that has no clock.
    pub(super) fn new(gpu: &Gpu, queue: &Queue) -> Result<Option<Self>> {
        // SAFETY: a live queue; the call takes nothing.
        let Ok(rate) = (unsafe { queue.d3d12().GetTimestampFrequency() }) else { return Ok(None) };
        if rate == 0 {
            return Ok(None);
        }
        let count = 2 * FRAMES_IN_FLIGHT as u32;
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: count, NodeMask: 0 };
        let mut heap: Option<ID3D12QueryHeap> = None;
        // SAFETY: a live device; description and place live during the call.
        unsafe { gpu.device().CreateQueryHeap(&wanted, &mut heap) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateQueryHeap", &e))?;
        let Some(heap) = heap else { return Ok(None) };
        let marks = Shared::new(gpu, Heap::Readback, MARKS * FRAMES_IN_FLIGHT)?;
        Ok(Some(Self { heap, marks, rate, seen: [0; FRAMES_IN_FLIGHT], spent: Spent::default() }))
    }

    /// Marks the start of a frame.
    pub(super) fn start(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        // SAFETY: an open list and a live heap with two places to a slot, which the ring keeps until the list has run.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, 2 * slot as u32) };
    }

    /// Marks its end, and has both marks written down.
    pub(super) fn end(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        let (first, at) = (2 * slot as u32, (MARKS * slot) as u64);
        // SAFETY: as above.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first + 1) };
        // SAFETY: as above; the buffer has room for two marks to a slot.
        unsafe {
            list.ResolveQueryData(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first, 2, self.marks.resource(), at);
        };
    }

    /// Counts a frame that has run.
    pub(super) fn look(&mut self, slot: usize) {
        let mut marks = [0; MARKS];
        self.marks.read_at(MARKS * slot, &mut marks);
        let [start, end] = [0, MARK].map(|at| u64::from_le_bytes(std::array::from_fn(|i| marks[at + i])));
        if start == self.seen[slot] || end < start {
            return;
        }
        self.seen[slot] = start;
        let nanoseconds = u128::from(end - start) * 1_000_000_000 / u128::from(self.rate);
        let took = Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(u64::MAX));
        self.spent.frames += 1;
        self.spent.total = self.spent.total.saturating_add(took);
        self.spent.longest = self.spent.longest.max(took);
        self.spent.last = took;
    }
}
