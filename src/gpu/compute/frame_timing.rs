//! Measures the GPU time of frames with timestamp queries.

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use super::command_ring::FRAMES_IN_FLIGHT;
use crate::Result;
use crate::gpu::{Gpu, GpuTimeStatistics, Queue, TimestampPairs};

/// Timestamps at the start and end of each frame of a ring.
pub(super) struct FrameTiming {
    timestamps: TimestampPairs,
    /// The last start timestamp read from each slot. If a slot's list never ran, the value is unchanged and not counted again.
    last_start: [u64; FRAMES_IN_FLIGHT],
    pub(super) measured: GpuTimeStatistics,
}

impl FrameTiming {
    /// For frames on a queue of the type of `queue`; `None` if it has no timestamps.
    pub(super) fn new(gpu: &Gpu, queue: &Queue) -> Result<Option<Self>> {
        let timestamps = TimestampPairs::new(gpu, queue, FRAMES_IN_FLIGHT)?;
        Ok(timestamps.map(|timestamps| Self {
            timestamps,
            last_start: [0; FRAMES_IN_FLIGHT],
            measured: GpuTimeStatistics::default(),
        }))
    }

    /// Records the timestamp at the start of a frame.
    pub(super) fn start(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.timestamps.start(list, slot);
    }

    /// Records the timestamp at its end.
    pub(super) fn end(&self, list: &ID3D12GraphicsCommandList, slot: usize) {
        self.timestamps.end(list, slot);
    }

    /// Adds the time of a frame that has run.
    pub(super) fn read(&mut self, slot: usize) {
        if let (start, Some(took)) = self.timestamps.read(slot)
            && start != self.last_start[slot]
        {
            self.last_start[slot] = start;
            self.measured.add(took);
        }
    }
}
