//! Device time of frames.

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use super::command_ring::FRAMES_IN_FLIGHT;
use crate::Result;
use crate::gpu::{Gpu, Queue, Spent, TimestampPairs};

/// Timestamps at the start and end of each frame of a ring.
pub(super) struct Timing {
    marks: TimestampPairs,
    /// The last start timestamp that was read from each slot: it is unchanged if the list never ran.
    seen: [u64; FRAMES_IN_FLIGHT],
    pub(super) spent: Spent,
}

impl Timing {
    /// For frames on a queue of the type of `queue`; `None` if it has no timestamps.
    pub(super) fn new(gpu: &Gpu, queue: &Queue) -> Result<Option<Self>> {
        let marks = TimestampPairs::new(gpu, queue, FRAMES_IN_FLIGHT)?;
        Ok(marks.map(|marks| Self { marks, seen: [0; FRAMES_IN_FLIGHT], spent: Spent::default() }))
    }

    /// Records the timestamp at the start of a frame.
    pub(super) fn start(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.marks.start(list, slot);
    }

    /// Records the timestamp at its end.
    pub(super) fn end(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.marks.end(list, slot);
    }

    /// Adds the time of a frame that has run.
    pub(super) fn read(&mut self, slot: usize) {
        if let (start, Some(took)) = self.marks.read(slot)
            && start != self.seen[slot]
        {
            self.seen[slot] = start;
            self.spent.add(took);
        }
    }
}
