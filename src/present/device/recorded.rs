//! Finished frames that an engine's lists copy into its textures.

use windows::Win32::Graphics::Direct3D12::*;

use super::super::frame::FrameKey;
use crate::Result;
use crate::gpu::compute::picture_formats::{PictureFormat, pitch};
use crate::gpu::{FencePoint, FencedSlots, Gpu, Heap, Target, buffer};

/// A ring of finished frames. A list of ours fills each slot; after that any number of the engine's lists may read it until the fence points
/// that were given with them are reached.
pub(super) struct RecordedFrames {
    gpu: Option<Gpu>,
    slots: FencedSlots<ID3D12Resource>,
    size: [u32; 2],
    /// The last filled slot, with the key and format of its frame.
    last: Option<(usize, FrameKey, PictureFormat)>,
}

impl RecordedFrames {
    /// Without slots: no frame can be recorded.
    pub(super) fn none() -> Self {
        Self { gpu: None, slots: FencedSlots::none(), size: [0; 2], last: None }
    }

    /// `count` slots for frames of `size` with at most `pixel` bytes per pixel.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn new(gpu: &Gpu, count: usize, (width, height): (u32, u32), pixel: u32) -> Result<Self> {
        if count == 0 {
            return Ok(Self::none());
        }
        let bytes = pitch(width, pixel) as usize * height as usize;
        let slots = FencedSlots::new(count, || buffer(gpu, Heap::Device, bytes))?;
        Ok(Self { gpu: Some(gpu.clone()), slots, size: [width, height], last: None })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.gpu.is_none()
    }

    /// The last filled slot, if it holds this frame in this format.
    pub(super) fn find(&self, key: FrameKey, format: PictureFormat) -> Option<usize> {
        self.last.filter(|(_, last, last_format)| (*last, *last_format) == (key, format)).map(|(slot, ..)| slot)
    }

    /// A slot that no list reads any more; its frame is discarded. `None` if each slot has a list that may not have run.
    pub(super) fn free_slot(&mut self) -> Option<usize> {
        let slot = self.slots.free()?;
        self.last = None;
        Some(slot)
    }

    pub(super) fn memory(&self, slot: usize) -> &ID3D12Resource {
        self.slots.memory(slot)
    }

    /// Records that the slot holds this frame.
    pub(super) fn set_frame(&mut self, slot: usize, key: FrameKey, format: PictureFormat) {
        self.last = Some((slot, key, format));
    }

    /// Records the copy of a slot's frame over `target` into an engine's open list, which has run once `until` is reached.
    pub(super) fn record_copy(
        &mut self,
        slot: usize,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) {
        let Some((_, _, format)) = self.last else { return };
        let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: format.rows(self.size) };
        // A buffer is in the state COMMON when a list starts and is promoted implicitly on first use.
        target.record_copy(list, self.slots.memory(slot), rows);
        self.slots.mark_in_use_until(slot, until);
    }

    /// Number of slots that lists may still read.
    pub(super) fn pending(&self) -> usize {
        self.slots.pending()
    }

    /// Releases all frames. Every list must have run, or must never run.
    pub(super) fn release(&mut self) {
        self.slots.release();
    }
}

impl Drop for RecordedFrames {
    fn drop(&mut self) {
        // The queue may still read the memory that is freed next. The engine must drop unsubmitted lists first.
        if let Some(gpu) = self.gpu.as_ref().filter(|_| self.pending() > 0) {
            gpu.frames().wait_ignoring_loss();
        }
    }
}

/// Frames of destroyed drawers and earlier preparations that an engine's lists may still read.
#[derive(Default)]
pub struct RetiredFrames(Vec<RecordedFrames>);

impl RetiredFrames {
    pub(super) fn push(&mut self, frames: RecordedFrames) {
        if frames.pending() > 0 {
            self.0.push(frames);
        }
    }

    /// Adds the frames of `others`.
    pub fn append(&mut self, mut others: Self) {
        self.0.append(&mut others.0);
    }

    /// Frees frames that no list reads any more; returns how many recorded frames lists may still read.
    pub fn pending(&mut self) -> usize {
        self.0.retain(|frames| frames.pending() > 0);
        self.0.iter().map(RecordedFrames::pending).sum()
    }

    /// Releases all frames. Every list must have run, or must never run.
    pub fn release(&mut self) {
        self.0.iter_mut().for_each(RecordedFrames::release);
        self.0.clear();
    }
}
