//! Reports that the device writes about frames.

use windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COPY_DEST;

use crate::Result;
use crate::framegen::shader::{WORD_OF_CUT, WORD_OF_UNEXPLAINED};
use crate::gpu::compute::{CommandRecorder, FRAMES_IN_FLIGHT, ResourceWithState};
use crate::gpu::{FencePoint, Gpu, Heap, Shared};

/// Bytes of a report.
const BYTES: usize = 4 * (WORD_OF_UNEXPLAINED as usize + 1);

/// One report per slot of the command ring.
pub(super) struct Reports {
    slots: Vec<Slot>,
    cuts: u64,
}

struct Slot {
    memory: Shared,
    /// The fence point at which the frame has run.
    comes: Option<FencePoint>,
    /// Whether a cut in this report is to be counted.
    is_asked: bool,
}

impl Reports {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let slot = || Ok(Slot { memory: Shared::new(gpu, Heap::Readback, BYTES)?, comes: None, is_asked: false });
        Ok(Self { slots: (0..FRAMES_IN_FLIGHT).map(|_| slot()).collect::<Result<_>>()?, cuts: 0 })
    }

    /// Records the copy of a frame's report to slot `place` of the ring.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        place: usize,
        report: &ResourceWithState<'_>,
    ) -> Result<()> {
        // The earlier frame of this slot has run.
        self.read_report(place);
        self.slots[place].comes = None;
        let to =
            ResourceWithState { resource: self.slots[place].memory.resource(), state: D3D12_RESOURCE_STATE_COPY_DEST };
        frame.copy_bytes(report, BYTES as u64, &to, 0)
    }

    /// Sets the fence point at which the report is complete, and whether it may show a cut.
    pub(super) fn comes_at(&mut self, place: usize, fence_point: &FencePoint, may_be_cut: bool) {
        let slot = &mut self.slots[place];
        (slot.comes, slot.is_asked) = (Some(fence_point.clone()), may_be_cut);
    }

    /// Number of frames that have finished since the last call and show an anchor because the device detected a cut.
    pub(super) fn cuts(&mut self) -> u64 {
        for slot in 0..self.slots.len() {
            if self.slots[slot].is_asked && self.slots[slot].comes.as_ref().is_some_and(FencePoint::reached) {
                self.read_report(slot);
            }
        }
        std::mem::take(&mut self.cuts)
    }

    fn read_report(&mut self, slot: usize) {
        let slot = &mut self.slots[slot];
        if std::mem::take(&mut slot.is_asked) {
            self.cuts += u64::from(slot.cut() != 0);
        }
    }
}

impl Slot {
    /// The word of the report that is not 0 at a cut.
    fn cut(&self) -> u32 {
        let mut word = [0; 4];
        self.memory.read_at(4 * WORD_OF_CUT as usize, &mut word);
        u32::from_ne_bytes(word)
    }
}
