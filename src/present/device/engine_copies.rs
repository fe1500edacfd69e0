//! Finished frames that an engine's lists copy, of the current preparation and of earlier ones.

use windows::Win32::Graphics::Direct3D12::{ID3D12GraphicsCommandList, ID3D12Resource};

use super::super::frame::FrameKey;
use super::recorded::{RecordedFrames, RetiredFrames};
use crate::Result;
use crate::gpu::compute::picture_formats::PictureFormat;
use crate::gpu::{FencePoint, Gpu, Target};

/// Memory of frames that an engine records into its own lists.
pub(super) struct EngineCopies {
    frames: RecordedFrames,
    /// Frames of earlier preparations that an engine's lists may still copy from.
    retired: RetiredFrames,
}

impl EngineCopies {
    /// Without memory: no frame can be recorded.
    pub(super) fn none() -> Self {
        Self { frames: RecordedFrames::none(), retired: RetiredFrames::default() }
    }

    /// Allocates `count` slots for frames of `size` with at most `pixel_bytes` bytes per pixel, and retires the slots before.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn replace(&mut self, gpu: &Gpu, count: usize, size: (u32, u32), pixel_bytes: u32) -> Result<()> {
        let frames = RecordedFrames::new(gpu, count, size, pixel_bytes)?;
        self.retired.push(std::mem::replace(&mut self.frames, frames));
        Ok(())
    }

    /// Whether there are no slots.
    pub(super) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// The last filled slot, if it holds this frame in this format.
    pub(super) fn find(&self, key: FrameKey, format: PictureFormat) -> Option<usize> {
        self.frames.find(key, format)
    }

    /// A slot that no list reads any more; its frame is discarded. `None` if each slot has a list that may not have run.
    pub(super) fn free_slot(&mut self) -> Option<usize> {
        self.frames.free_slot()
    }

    /// Memory of a slot.
    pub(super) fn memory(&self, slot: usize) -> &ID3D12Resource {
        self.frames.memory(slot)
    }

    /// Records that the slot holds this frame.
    pub(super) fn set_frame(&mut self, slot: usize, key: FrameKey, format: PictureFormat) {
        self.frames.set_frame(slot, key, format);
    }

    /// Records the copy of a slot's frame over `target` into an engine's open list, which has run once `until` is reached.
    pub(super) fn record_copy(
        &mut self,
        slot: usize,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) {
        self.frames.record_copy(slot, list, target, until);
    }

    /// Number of frames that lists may still read.
    pub(super) fn pending(&mut self) -> usize {
        self.frames.pending() + self.retired.pending()
    }

    /// Releases all frames. Every list must have run, or must never run.
    pub(super) fn release(&mut self) {
        self.frames.release();
        self.retired.release();
    }

    /// The frames that lists may still read.
    pub(super) fn retire(self) -> RetiredFrames {
        let Self { frames, mut retired } = self;
        retired.push(frames);
        retired
    }
}
