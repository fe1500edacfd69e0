//! What the device says of frames that have run.

use windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COPY_DEST;

use crate::Result;
use crate::framegen::shader::{WORD_OF_CUT, WORD_OF_UNEXPLAINED};
use crate::gpu::compute::{FRAMES_IN_FLIGHT, Frame, Resting};
use crate::gpu::{Gpu, Heap, Moment, Shared};

/// Bytes of a report.
const BYTES: usize = 4 * (WORD_OF_UNEXPLAINED as usize + 1);

/// A report to each place of the ring of frames.
pub(super) struct Reports {
    slots: Vec<Slot>,
    cuts: u64,
}

struct Slot {
    memory: Shared,
    /// When a report that somebody wants is there.
    comes: Option<Moment>,
}

impl Reports {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let slot = || Ok(Slot { memory: Shared::new(gpu, Heap::Readback, BYTES)?, comes: None });
        Ok(Self { slots: (0..FRAMES_IN_FLIGHT).map(|_| slot()).collect::<Result<_>>()?, cuts: 0 })
    }

    /// Records that a frame, which was begun in a place, brings a report.
    pub(super) fn record(&mut self, frame: &mut Frame<'_>, place: usize, report: &Resting<'_>) -> Result<()> {
        // What was there before has run.
        self.look(place);
        let to = Resting { resource: self.slots[place].memory.resource(), state: D3D12_RESOURCE_STATE_COPY_DEST };
        frame.copy_bytes(report, BYTES as u64, &to, 0)
    }

    /// The report of a frame is there at `moment`; looked at only where it may be that there is a cut.
    pub(super) fn comes_at(&mut self, place: usize, moment: &Moment, may_be_cut: bool) {
        self.slots[place].comes = may_be_cut.then(|| moment.clone());
    }

    /// How many frames that have run since it was asked are anchors and not generated, as a cut was found.
    pub(super) fn cuts(&mut self) -> u64 {
        for slot in 0..self.slots.len() {
            if self.slots[slot].comes.as_ref().is_some_and(Moment::reached) {
                self.look(slot);
            }
        }
        std::mem::take(&mut self.cuts)
    }

    fn look(&mut self, slot: usize) {
        let Slot { memory, comes } = &mut self.slots[slot];
        if comes.take().is_some() {
            let mut bytes = [0; BYTES];
            memory.read(&mut bytes);
            let words = bytes.as_chunks::<4>().0;
            self.cuts += u64::from(words[WORD_OF_CUT as usize] != [0; 4]);
        }
    }
}
