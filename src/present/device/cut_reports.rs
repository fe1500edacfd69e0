//! Cuts that the device detects: each frame leaves a report in readback memory.

use windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COPY_DEST;

use crate::Result;
use crate::framegen::shader::{WORD_OF_CUT, WORD_OF_UNEXPLAINED};
use crate::gpu::compute::{CommandRecorder, FRAMES_IN_FLIGHT, ResourceWithState};
use crate::gpu::{FencePoint, Gpu, Heap, MappedBuffer};

/// Bytes of a report.
const BYTES: usize = 4 * (WORD_OF_UNEXPLAINED as usize + 1);

/// One report per slot of the command ring.
pub(super) struct CutReports {
    slots: Vec<ReportSlot>,
    /// Cuts in reports that were read and not counted by the caller yet.
    cuts: u64,
}

/// Memory of one report.
struct ReportSlot {
    memory: MappedBuffer,
    /// The fence point at which the frame has run.
    finished: Option<FencePoint>,
    /// Whether this report may show a cut that was not counted yet.
    may_be_cut: bool,
}

impl CutReports {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let slot = || {
            Ok(ReportSlot { memory: MappedBuffer::new(gpu, Heap::Readback, BYTES)?, finished: None, may_be_cut: false })
        };
        Ok(Self { slots: (0..FRAMES_IN_FLIGHT).map(|_| slot()).collect::<Result<_>>()?, cuts: 0 })
    }

    /// Records the copy of a frame's report to slot `slot` of the ring.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        slot: usize,
        report: &ResourceWithState<'_>,
    ) -> Result<()> {
        // The earlier frame of this slot has run.
        self.read(slot);
        self.slots[slot].finished = None;
        let to =
            ResourceWithState { resource: self.slots[slot].memory.resource(), state: D3D12_RESOURCE_STATE_COPY_DEST };
        frame.copy_bytes(report, BYTES as u64, &to, 0)
    }

    /// Sets the fence point at which the report is complete, and whether it may show a cut.
    pub(super) fn set_fence_point(&mut self, slot: usize, fence_point: &FencePoint, may_be_cut: bool) {
        let slot = &mut self.slots[slot];
        (slot.finished, slot.may_be_cut) = (Some(fence_point.clone()), may_be_cut);
    }

    /// Number of frames that have finished since the last call and show an anchor because the device detected a cut.
    pub(super) fn take_count(&mut self) -> u64 {
        for slot in 0..self.slots.len() {
            if self.slots[slot].may_be_cut && self.slots[slot].finished.as_ref().is_some_and(FencePoint::reached) {
                self.read(slot);
            }
        }
        std::mem::take(&mut self.cuts)
    }

    /// Counts the cut of a finished report once.
    fn read(&mut self, slot: usize) {
        let slot = &mut self.slots[slot];
        if std::mem::take(&mut slot.may_be_cut) {
            self.cuts += u64::from(slot.cut() != 0);
        }
    }
}

impl ReportSlot {
    /// The word of the report that is not 0 at a cut.
    fn cut(&self) -> u32 {
        let mut word = [0; 4];
        self.memory.read_at(4 * WORD_OF_CUT as usize, &mut word);
        u32::from_ne_bytes(word)
    }
}
