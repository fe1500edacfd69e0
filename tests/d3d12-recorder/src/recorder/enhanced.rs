//! Enhanced barriers: `ID3D12GraphicsCommandList7::Barrier`.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::aliasing::AliasedUses;
use super::{Command, Recorder, Use};
use crate::layouts::{Access, EnhancedBarrier};
use crate::regions::Region;
use crate::rules::Rule;
use crate::states::{Behaviour, ListKind, State};
use crate::timeline::Id;

const FUNCTION: &str = "ID3D12GraphicsCommandList7::Barrier";

/// `D3D12_BARRIER_SUBRESOURCE_RANGE`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Subresources {
    /// All of them.
    All,
    /// One, by its number.
    One(u32),
    /// Mipmap levels of array slices of planes.
    Ranges {
        /// Mipmap levels.
        levels: Range<u32>,
        /// Array slices.
        slices: Range<u32>,
        /// Planes.
        planes: Range<u32>,
    },
}

impl Subresources {
    /// Their numbers in a texture of these levels, slices and planes; `None` if it has not all of them.
    fn numbers(&self, [levels, slices, planes]: [u32; 3]) -> Option<Vec<usize>> {
        match self {
            Self::All => Some((0..(levels * slices * planes) as usize).collect()),
            Self::One(number) => (*number < levels * slices * planes).then(|| vec![*number as usize]),
            Self::Ranges { levels: l, slices: s, planes: p } => {
                if l.end > levels || s.end > slices || p.end > planes {
                    return None;
                }
                let of_slice = |plane, slice| l.clone().map(move |level| level + levels * (slice + slices * plane));
                let numbers = p.clone().flat_map(|plane| s.clone().flat_map(move |slice| of_slice(plane, slice)));
                Some(numbers.map(|number| number as usize).collect())
            }
        }
    }
}

impl Recorder {
    /// A texture barrier, which may discard the contents.
    pub fn texture_barrier(
        &mut self,
        list: Id,
        resource: Id,
        subresources: &Subresources,
        barrier: EnhancedBarrier,
        discards: bool,
    ) {
        let Some(shape) = self.resources.get(&resource).map(|found| found.desc.shape) else { return };
        if !self.check_barrier(list, resource, &barrier, false) {
            return;
        }
        let Some(numbers) = subresources.numbers(shape) else {
            let text = format!("{subresources:?} of {}", self.label(resource));
            return self.find(Rule::BarrierSubresources, FUNCTION, text);
        };
        self.push(list, Command::EnhancedBarrier { resource: Some(resource), numbers, barrier, discards });
    }

    /// A buffer barrier of `size` bytes; `u64::MAX` for all of them.
    pub fn buffer_barrier(&mut self, list: Id, resource: Id, (offset, size): (u64, u64), barrier: EnhancedBarrier) {
        let Some(bytes) = self.resources.get(&resource).map(|found| found.desc.bytes) else { return };
        if !self.check_barrier(list, resource, &barrier, true) {
            return;
        }
        if offset != 0 || ![bytes, u64::MAX].contains(&size) {
            let text = format!("{size} bytes from {offset} on of {}", self.label(resource));
            self.find(Rule::BarrierBufferRange, FUNCTION, text);
        }
        let command = Command::EnhancedBarrier { resource: Some(resource), numbers: vec![0], barrier, discards: false };
        self.push(list, command);
    }

    /// A global barrier.
    pub fn global_barrier(&mut self, list: Id, barrier: EnhancedBarrier) {
        let Some(kind) = self.record(list, FUNCTION, ListKind::Copy).map(|list| list.kind) else { return };
        self.check_values(kind, &barrier, true, "a global barrier");
        self.push(list, Command::EnhancedBarrier { resource: None, numbers: Vec::new(), barrier, discards: false });
    }

    /// Checks what does not depend on earlier commands. Whether the barrier is recorded.
    fn check_barrier(&mut self, list: Id, resource: Id, barrier: &EnhancedBarrier, is_of_buffer: bool) -> bool {
        let label = self.label(resource);
        let Some(found) = self.record(list, FUNCTION, ListKind::Copy) else { return false };
        let kind = found.kind;
        found.used.insert(resource);
        let Some(found) = self.resources.get(&resource) else { return false };
        let (is_buffer, allowed) = (found.desc.is_buffer, found.desc.allowed);
        let is_simultaneous = found.states.behaviour() != Behaviour::Texture;
        if is_buffer != is_of_buffer {
            let (barrier, of) = if is_of_buffer { ("buffer", "texture") } else { ("texture", "buffer") };
            self.find(Rule::BarrierType, FUNCTION, format!("a {barrier} barrier of the {of} {label}"));
            return false;
        }
        self.check_values(kind, barrier, is_simultaneous, &label);
        if barrier.flagged().0 & !allowed.0 != 0 {
            self.find(Rule::BarrierMissingFlag, FUNCTION, format!("{label}: {barrier:?}"));
        }
        true
    }

    fn check_values(&mut self, kind: ListKind, barrier: &EnhancedBarrier, is_simultaneous: bool, label: &str) {
        if let Some(conflict) = barrier.conflict(is_simultaneous) {
            self.find(Rule::BarrierIncompatibleValues, FUNCTION, format!("{label}: {barrier:?}: {conflict}"));
        }
        if !barrier.is_in(kind) {
            let text = format!("{label}: {barrier:?} in a list of type {kind:?}");
            self.find(Rule::EnhancedBarrierListType, FUNCTION, text);
        }
    }

    /// A barrier of a submission runs. Whether its resource has a layout.
    pub(super) fn run_enhanced_barrier(&mut self, resource: Id, numbers: &[usize], barrier: &EnhancedBarrier) -> bool {
        let Some(found) = self.resources.get_mut(&resource) else { return false };
        let broken = found.states.enhanced_barrier(numbers, barrier);
        let has_layout = found.states.behaviour() == Behaviour::Texture;
        for (rule, text) in broken {
            let text = format!("{}, {text}", self.label(resource));
            self.find(rule, FUNCTION, text);
        }
        has_layout
    }

    /// A global barrier of a submission runs.
    pub(super) fn run_global_barrier(
        &mut self,
        barrier: &EnhancedBarrier,
        touched: &HashSet<Id>,
        unordered: &mut HashMap<Id, Vec<Region>>,
        aliased: &mut AliasedUses,
    ) {
        if barrier.before.access.may_be(Access::UNORDERED_ACCESS) {
            unordered.clear();
        }
        self.apply_aliasing_barrier(aliased, None, None);
        for resource in touched {
            if let Some(found) = self.resources.get_mut(resource) {
                found.states.global_barrier(barrier.before.access);
            }
        }
    }

    /// A barrier of a submission separates uses of the same memory: one from no access begins those of its resource, one to no access ends
    /// them. One that discards initialises subresources.
    pub(super) fn alias_by_barrier(
        &mut self,
        aliased: &mut AliasedUses,
        resource: Id,
        numbers: &[usize],
        barrier: &EnhancedBarrier,
        discards: bool,
    ) {
        if barrier.before.access == Access::NO_ACCESS {
            self.apply_aliasing_barrier(aliased, None, Some(resource));
        }
        if discards {
            for &number in numbers {
                let region = self.subresource(resource, number as u32);
                let one = Use { initialises: true, ..Use::new(resource, region, State::COMMON) };
                self.check_aliased_use(aliased, FUNCTION, &one);
            }
        }
        if barrier.after.access == Access::NO_ACCESS {
            self.apply_aliasing_barrier(aliased, Some(resource), None);
        }
    }
}
