//! How long frames take on the device.

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use super::command_ring::FRAMES_IN_FLIGHT;
use crate::Result;
use crate::gpu::{Gpu, Marks, Queue, Spent};

/// The clock's marks before and behind each frame of a ring.
pub(super) struct Timing {
    marks: Marks,
    /// The first mark of each slot as it was seen last: a list that was never run leaves it there.
    seen: [u64; FRAMES_IN_FLIGHT],
    pub(super) spent: Spent,
}

impl Timing {
    /// For frames on a queue like `queue`; none where that has no clock.
    pub(super) fn new(gpu: &Gpu, queue: &Queue) -> Result<Option<Self>> {
        let marks = Marks::new(gpu, queue, FRAMES_IN_FLIGHT)?;
        Ok(marks.map(|marks| Self { marks, seen: [0; FRAMES_IN_FLIGHT], spent: Spent::default() }))
    }

    /// Marks the start of a frame.
    pub(super) fn start(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.marks.start(list, slot);
    }

    /// Marks its end.
    pub(super) fn end(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.marks.end(list, slot);
    }

    /// Counts a frame that has run.
    pub(super) fn look(&mut self, slot: usize) {
        if let (start, Some(took)) = self.marks.read(slot)
            && start != self.seen[slot]
        {
            self.seen[slot] = start;
            self.spent.add(took);
        }
    }
}
