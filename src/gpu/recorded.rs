//! Memory that command lists of an engine's read, and the engine's own fences that say when they have run.

use super::FencePoint;
use crate::Result;

/// Slots of memory, each of which lists of an engine's may read until the fences that came with them have their values.
///
/// Nothing here waits: an engine may submit a list late, in another order, or never. A slot that a list may still read is not handed out.
pub(crate) struct RecordedMemory<M> {
    slots: Vec<Slot<M>>,
    /// Where the search for a free slot begins: the slot that was handed out longest ago.
    next: usize,
}

struct Slot<M> {
    memory: M,
    /// One for each fence: the largest of its values.
    readers: Vec<FencePoint>,
}

/// Fences of a slot for which there is room from the start.
const FENCES: usize = 4;

impl<M> RecordedMemory<M> {
    /// Without a slot.
    pub(crate) fn none() -> Self {
        Self { slots: Vec::new(), next: 0 }
    }

    /// So many slots.
    pub(crate) fn new(count: usize, mut make: impl FnMut() -> Result<M>) -> Result<Self> {
        let slot = |_| Ok(Slot { memory: make()?, readers: Vec::with_capacity(FENCES) });
        Ok(Self { slots: (0..count).map(slot).collect::<Result<_>>()?, next: 0 })
    }

    /// A slot that no list reads any more; none where every slot has one that may not have run.
    pub(crate) fn free(&mut self) -> Option<usize> {
        self.tidy();
        let count = self.slots.len();
        let found = (0..count).map(|i| (self.next + i) % count).find(|slot| self.slots[*slot].readers.is_empty())?;
        self.next = (found + 1) % count;
        Some(found)
    }

    pub(crate) fn memory(&self, slot: usize) -> &M {
        &self.slots[slot].memory
    }

    pub(crate) fn memory_mut(&mut self, slot: usize) -> &mut M {
        &mut self.slots[slot].memory
    }

    /// A list reads the slot until that moment.
    pub(crate) fn read_until(&mut self, slot: usize, until: &FencePoint) {
        let readers = &mut self.slots[slot].readers;
        readers.retain(|reader| !reader.reached());
        match readers.iter_mut().find(|reader| reader.fence() == until.fence()) {
            Some(reader) if reader.value() >= until.value() => {}
            Some(reader) => *reader = until.clone(),
            None => readers.push(until.clone()),
        }
    }

    /// Slots that lists may still read.
    pub(crate) fn pending(&self) -> usize {
        self.slots.iter().filter(|slot| slot.readers.iter().any(|reader| !reader.reached())).count()
    }

    /// Every list has run, or never will.
    pub(crate) fn release(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.readers.clear());
    }

    fn tidy(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.readers.retain(|reader| !reader.reached()));
    }
}
