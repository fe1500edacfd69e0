//! Finished frames that lists of an engine's copy into its textures.

use windows::Win32::Graphics::Direct3D12::*;

use super::super::presenter::FrameKey;
use crate::Result;
use crate::gpu::compute::pictures::{Format, pitch};
use crate::gpu::{FencePoint, Gpu, Heap, RecordedMemory, Target, buffer};

/// A ring of finished frames. Each slot is filled by a list of ours and then only read, by any number of lists of an engine's, until the fences
/// that came with these have their values.
pub(super) struct RecordedFrames {
    gpu: Option<Gpu>,
    slots: RecordedMemory<ID3D12Resource>,
    size: [u32; 2],
    /// The slot that was filled last, and the frame in it.
    last: Option<(usize, FrameKey, Format)>,
}

impl RecordedFrames {
    /// Without memory: no frame can be recorded.
    pub(super) fn none() -> Self {
        Self { gpu: None, slots: RecordedMemory::none(), size: [0; 2], last: None }
    }

    /// So many frames of `size`, with so many bytes to a pixel at most.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn new(gpu: &Gpu, count: usize, (width, height): (u32, u32), pixel: u32) -> Result<Self> {
        if count == 0 {
            return Ok(Self::none());
        }
        let bytes = pitch(width, pixel) as usize * height as usize;
        let slots = RecordedMemory::new(count, || buffer(gpu, Heap::Device, bytes))?;
        Ok(Self { gpu: Some(gpu.clone()), slots, size: [width, height], last: None })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.gpu.is_none()
    }

    /// The slot that holds that frame in that format.
    pub(super) fn again(&self, key: FrameKey, format: Format) -> Option<usize> {
        self.last.filter(|(_, of, held)| (*of, *held) == (key, format)).map(|(slot, ..)| slot)
    }

    /// A slot that no list reads any more; its frame is forgotten. None where every slot has one that may not have run.
    pub(super) fn free(&mut self) -> Option<usize> {
        let slot = self.slots.free()?;
        self.last = None;
        Some(slot)
    }

    pub(super) fn memory(&self, slot: usize) -> &ID3D12Resource {
        self.slots.memory(slot)
    }

    /// A frame was made in the slot.
    pub(super) fn holds(&mut self, slot: usize, key: FrameKey, format: Format) {
        self.last = Some((slot, key, format));
    }

    /// Records the copy of a slot's frame over `target` into an engine's open list, which has run when `until` is reached.
    pub(super) fn record(
        &mut self,
        slot: usize,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) {
        let Some((_, _, format)) = self.last else { return };
        let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: format.rows(self.size) };
        // A buffer is in the state COMMON when a list starts, and becomes what it is first used as.
        target.record_copy(list, self.slots.memory(slot), rows);
        self.slots.read_until(slot, until);
    }

    /// Frames that lists may still read.
    pub(super) fn pending(&self) -> usize {
        self.slots.pending()
    }

    /// Every list has run, or never will.
    pub(super) fn release(&mut self) {
        self.slots.release();
    }
}

impl Drop for RecordedFrames {
    fn drop(&mut self) {
        // The queue may still read what is freed next. Lists that it was not given are the engine's to drop first.
        if let Some(gpu) = self.gpu.as_ref().filter(|_| self.pending() > 0) {
            gpu.frames().wait_ignoring_loss();
        }
    }
}

/// Frames of a drawer that is gone, which lists of an engine's may still read.
#[derive(Default)]
pub struct RetiredFrames(Vec<RecordedFrames>);

impl RetiredFrames {
    pub(super) fn push(&mut self, frames: RecordedFrames) {
        if frames.pending() > 0 {
            self.0.push(frames);
        }
    }

    /// Takes others in.
    pub fn append(&mut self, mut others: Self) {
        self.0.append(&mut others.0);
    }

    /// Frees what no list reads any more; how many recorded frames lists may still read.
    pub fn pending(&mut self) -> usize {
        self.0.retain(|frames| frames.pending() > 0);
        self.0.iter().map(RecordedFrames::pending).sum()
    }

    /// Every list has run, or never will.
    pub fn release(&mut self) {
        self.0.iter_mut().for_each(RecordedFrames::release);
        self.0.clear();
    }
}
