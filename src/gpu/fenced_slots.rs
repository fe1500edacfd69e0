//! Slots of memory that stay in use until fences signal that the command lists that read them have run.

use super::FencePoint;
use crate::Result;

/// Slots of memory for an engine's command lists. Each list that reads a slot comes with a fence point; the slot is free again when all
/// of them are reached.
///
/// Nothing here waits: an engine may submit a list late, in another order, or never.
pub(crate) struct FencedSlots<M> {
    slots: Vec<FencedSlot<M>>,
    /// Where the search for a free slot starts: after the last one that was returned.
    next: usize,
}

struct FencedSlot<M> {
    memory: M,
    /// One fence point per fence, with the largest value.
    readers: Vec<FencePoint>,
}

/// Initial capacity of `readers`.
const FENCES: usize = 4;

impl<M> FencedSlots<M> {
    /// Without slots.
    pub(crate) fn none() -> Self {
        Self { slots: Vec::new(), next: 0 }
    }

    /// Creates `count` slots.
    pub(crate) fn new(count: usize, mut make: impl FnMut() -> Result<M>) -> Result<Self> {
        let slot = |_| Ok(FencedSlot { memory: make()?, readers: Vec::with_capacity(FENCES) });
        Ok(Self { slots: (0..count).map(slot).collect::<Result<_>>()?, next: 0 })
    }

    /// A free slot; `None` if lists may still read every slot.
    pub(crate) fn free(&mut self) -> Option<usize> {
        self.remove_reached();
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

    /// Records that a list reads the slot until `until` is reached.
    pub(crate) fn mark_in_use_until(&mut self, slot: usize, until: &FencePoint) {
        let readers = &mut self.slots[slot].readers;
        readers.retain(|reader| !reader.reached());
        match readers.iter_mut().find(|reader| reader.fence() == until.fence()) {
            Some(reader) if reader.value() >= until.value() => {}
            Some(reader) => *reader = until.clone(),
            None => readers.push(until.clone()),
        }
    }

    /// Number of slots that lists may still read.
    pub(crate) fn pending(&self) -> usize {
        self.slots.iter().filter(|slot| slot.readers.iter().any(|reader| !reader.reached())).count()
    }

    /// Marks all slots as free. Every list must have run, or must never run.
    pub(crate) fn release(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.readers.clear());
    }

    fn remove_reached(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.readers.retain(|reader| !reader.reached()));
    }
}
