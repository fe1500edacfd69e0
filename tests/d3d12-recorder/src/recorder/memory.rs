//! Descriptors, residency and mapped memory.

use std::collections::HashSet;
use std::ops::Range;

use super::{Memory, Recorder, Resource};
use crate::descriptors::View;
use crate::root_signature::DescriptorKind;
use crate::rules::Rule;
use crate::timeline::Id;

impl Recorder {
    /// A view is written.
    pub fn write_view(&mut self, function: &'static str, address: u64, view: View) {
        let Some(slot) = self.descriptors.by_cpu(address) else {
            return self.find(
                Rule::DescriptorHandleInvalid,
                function,
                format!("no heap has the descriptor at {address:#x}"),
            );
        };
        if self.is_in_flight(|work| work.slots.iter().any(|slots| slots.has(slot))) {
            let text =
                format!("descriptor {} of {} is written while queued commands use it", slot.1, self.label(slot.0));
            self.find(Rule::DescriptorInUse, function, text);
        }
        if let Some((resource, region)) = &view.resource
            && let Some(found) = self.resources.get(resource)
            && !region.is_within(found.desc.bytes, found.desc.shape)
        {
            let rule = match view.kind {
                DescriptorKind::Uav => Rule::UavOutOfBounds,
                DescriptorKind::Cbv => Rule::CbvOutOfBounds,
                _ => Rule::SrvOutOfBounds,
            };
            let text = format!("{region:?} of {}", self.label(*resource));
            self.find(rule, function, text);
        }
        self.descriptors.write(slot, view);
    }

    /// A descriptor is copied.
    pub fn copy_view(&mut self, function: &'static str, to: u64, from: u64) {
        let Some((heap, index)) = self.descriptors.by_cpu(from) else {
            return self.find(
                Rule::DescriptorHandleInvalid,
                function,
                format!("no heap has the descriptor at {from:#x}"),
            );
        };
        if let Some(view) = self.descriptors.read(heap, index).cloned() {
            self.write_view(function, to, view);
        }
    }

    /// Distance of the descriptors of the heap that has an address.
    pub fn descriptor_step(&self, address: u64) -> Option<u64> {
        Some(self.descriptors.desc(self.descriptors.by_cpu(address)?.0)?.step)
    }

    // Residency.

    /// `Evict`.
    pub fn evict(&mut self, function: &'static str, object: Id) {
        let placed = |found: &Resource| found.desc.placed.as_ref().is_some_and(|placed| placed.heap == object);
        let parts: HashSet<Id> = self.resources.iter().filter(|(_, found)| placed(found)).map(|(&id, _)| id).collect();
        if self.is_in_flight(|work| work.used.contains(&object) || !work.used.is_disjoint(&parts)) {
            let text = format!("{} is evicted while queued commands use it", self.label(object));
            self.find(Rule::EvictedInUse, function, text);
        }
        self.evicted.insert(object);
    }

    /// `MakeResident`.
    pub fn make_resident(&mut self, object: Id) {
        self.evicted.remove(&object);
    }

    pub(super) fn heap_of(&self, resource: Id) -> Option<Id> {
        Some(self.resources.get(&resource)?.desc.placed.as_ref()?.heap)
    }

    // Memory of the processor.

    /// `ID3D12Resource::Map`. `read` is the range that is read; `None` for all of it.
    pub fn map(&mut self, resource: Id, subresource: u32, read: Option<Range<u64>>) {
        const FUNCTION: &str = "ID3D12Resource::Map";
        let label = self.label(resource);
        let Some(found) = self.resources.get_mut(&resource) else { return };
        found.mapped += 1;
        let (desc, count) = (found.desc.clone(), found.states.count());
        if desc.memory == Memory::Default {
            return self.find(Rule::MapInvalidHeap, FUNCTION, format!("{label} is in a default heap"));
        }
        if subresource as usize >= count {
            return self.find(
                Rule::MapInvalidSubresource,
                FUNCTION,
                format!("{label} has no subresource {subresource}"),
            );
        }
        if let Some(read) =
            read.as_ref().filter(|read| read.start > read.end || desc.is_buffer && read.end > desc.bytes)
        {
            self.find(Rule::MapInvalidRange, FUNCTION, format!("{label} is read at {read:?}"));
        }
        let reads = read.is_none_or(|read| read.start < read.end) && desc.memory == Memory::Readback;
        if reads && self.is_in_flight(|work| work.written.contains(&resource)) {
            self.find(
                Rule::MapInUse,
                FUNCTION,
                format!("{label} is mapped for reading while queued commands write it"),
            );
        }
    }

    /// `ID3D12Resource::Unmap`. `written` is the range that was written; `None` for all of it.
    pub fn unmap(&mut self, resource: Id, written: Option<Range<u64>>) {
        const FUNCTION: &str = "ID3D12Resource::Unmap";
        let label = self.label(resource);
        let Some(found) = self.resources.get_mut(&resource) else { return };
        let was_mapped = found.mapped > 0;
        found.mapped = found.mapped.saturating_sub(1);
        let desc = found.desc.clone();
        if !was_mapped {
            return self.find(Rule::UnmapNotMapped, FUNCTION, format!("{label} is not mapped"));
        }
        if let Some(range) = written.filter(|range| range.start > range.end || desc.is_buffer && range.end > desc.bytes)
        {
            self.find(Rule::UnmapInvalidRange, FUNCTION, format!("{label} was written at {range:?}"));
        }
    }
}
