//! Descriptor heaps and their contents.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use crate::regions::Region;
use crate::root_signature::DescriptorKind;
use crate::timeline::Id;

/// A written descriptor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct View {
    /// Its kind.
    pub kind: DescriptorKind,
    /// The resource and its part; `None` for a null descriptor, and for samplers.
    pub resource: Option<(Id, Region)>,
}

/// Description of a new heap.
#[derive(Debug, Clone)]
pub struct HeapDesc {
    /// Address of the first descriptor for the processor.
    pub cpu: u64,
    /// Address of the first descriptor for shaders; `None` for a heap that they do not see.
    pub gpu: Option<u64>,
    /// Distance of descriptors in bytes.
    pub step: u64,
    /// Number of descriptors.
    pub count: u32,
    /// Whether it has samplers.
    pub has_samplers: bool,
}

struct Heap {
    desc: HeapDesc,
    views: HashMap<u32, View>,
}

/// All descriptor heaps.
#[derive(Default)]
pub struct Descriptors {
    heaps: HashMap<Id, Heap>,
    /// Heaps by the address of their first descriptor.
    by_cpu: BTreeMap<u64, Id>,
    by_gpu: BTreeMap<u64, Id>,
}

impl Descriptors {
    /// A new heap.
    pub fn add(&mut self, heap: Id, desc: HeapDesc) {
        self.by_cpu.insert(desc.cpu, heap);
        if let Some(gpu) = desc.gpu {
            self.by_gpu.insert(gpu, heap);
        }
        self.heaps.insert(heap, Heap { desc, views: HashMap::new() });
    }

    /// A heap was released.
    pub fn remove(&mut self, heap: Id) {
        if let Some(Heap { desc, .. }) = self.heaps.remove(&heap) {
            self.by_cpu.retain(|_, other| *other != heap);
            if desc.gpu.is_some() {
                self.by_gpu.retain(|_, other| *other != heap);
            }
        }
    }

    /// Description of a heap.
    pub fn desc(&self, heap: Id) -> Option<&HeapDesc> {
        self.heaps.get(&heap).map(|heap| &heap.desc)
    }

    /// Heap and index of a descriptor's address for the processor.
    pub fn by_cpu(&self, address: u64) -> Option<(Id, u32)> {
        self.find(&self.by_cpu, address, |desc| Some(desc.cpu))
    }

    /// Heap and index of a descriptor's address for shaders.
    pub fn by_gpu(&self, address: u64) -> Option<(Id, u32)> {
        self.find(&self.by_gpu, address, |desc| desc.gpu)
    }

    fn find(&self, of: &BTreeMap<u64, Id>, address: u64, start: fn(&HeapDesc) -> Option<u64>) -> Option<(Id, u32)> {
        let (_, &heap) = of.range(..=address).next_back()?;
        let desc = self.desc(heap)?;
        let index = (address - start(desc)?) / desc.step.max(1);
        (index < u64::from(desc.count)).then_some((heap, index as u32))
    }

    /// Writes a descriptor.
    pub fn write(&mut self, (heap, index): (Id, u32), view: View) {
        if let Some(heap) = self.heaps.get_mut(&heap) {
            heap.views.insert(index, view);
        }
    }

    /// A descriptor, if it was written.
    pub fn read(&self, heap: Id, index: u32) -> Option<&View> {
        self.heaps.get(&heap)?.views.get(&index)
    }
}

/// Consecutive descriptors of a heap.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slots {
    /// The heap.
    pub heap: Id,
    /// Their indices.
    pub indices: Range<u32>,
}

impl Slots {
    /// Whether a descriptor is one of them.
    pub fn has(&self, (heap, index): (Id, u32)) -> bool {
        self.heap == heap && self.indices.contains(&index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_found_only_inside_of_live_heaps() {
        let mut all = Descriptors::default();
        all.add(7, HeapDesc { cpu: 1000, gpu: Some(5000), step: 32, count: 4, has_samplers: false });
        all.add(8, HeapDesc { cpu: 2000, gpu: None, step: 8, count: 1, has_samplers: false });
        assert_eq!((all.by_cpu(1000), all.by_cpu(1096), all.by_cpu(1128)), (Some((7, 0)), Some((7, 3)), None));
        assert_eq!((all.by_gpu(5032), all.by_gpu(5128), all.by_cpu(2000)), (Some((7, 1)), None, Some((8, 0))));
        all.remove(7);
        assert_eq!((all.by_cpu(1000), all.by_gpu(5032)), (None, None));
    }

    #[test]
    fn a_descriptor_has_what_was_written_last() {
        let mut all = Descriptors::default();
        all.add(7, HeapDesc { cpu: 1000, gpu: None, step: 32, count: 4, has_samplers: false });
        assert_eq!(all.read(7, 1), None);
        for resource in [1, 2] {
            all.write((7, 1), View { kind: DescriptorKind::Srv, resource: Some((resource, Region::All)) });
        }
        assert_eq!(all.read(7, 1).and_then(|view| view.resource.clone()), Some((2, Region::All)));
        assert!(Slots { heap: 7, indices: 1..2 }.has((7, 1)) && !Slots { heap: 7, indices: 1..2 }.has((7, 2)));
    }
}
