//! Allocators, and the commands of lists.

use std::collections::HashSet;
use std::ops::Range;

use super::{Command, List, Recorded, Recorder, Use};
use crate::regions::Region;
use crate::rules::Rule;
use crate::states::{BarrierPart, Behaviour, ListKind, State};
use crate::timeline::Id;

impl Recorder {
    /// `ID3D12CommandAllocator::Reset`.
    pub fn reset_allocator(&mut self, allocator: Id) {
        const FUNCTION: &str = "ID3D12CommandAllocator::Reset";
        let label = self.label(allocator);
        let Some(found) = self.allocators.get_mut(&allocator) else { return };
        found.resets += 1;
        if let Some(list) = found.recording {
            let text = format!("{label} is reset while {} is recorded", self.label(list));
            self.find(Rule::AllocatorRecording, FUNCTION, text);
        }
        if self.is_in_flight(|work| work.used.contains(&allocator)) {
            self.find(Rule::AllocatorInUse, FUNCTION, format!("{label} is reset while its commands may still run"));
        }
    }

    /// `ID3D12GraphicsCommandList::Reset`.
    pub fn reset_list(&mut self, list: Id, allocator: Id, pipeline: Option<Id>) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::Reset";
        if self.lists.get(&list).is_some_and(|list| list.is_open) {
            let text = format!("{} is open", self.label(list));
            return self.find(Rule::ListOpen, FUNCTION, text);
        }
        self.open(list, allocator, pipeline, FUNCTION);
    }

    pub(super) fn open(&mut self, list: Id, allocator: Id, pipeline: Option<Id>, function: &'static str) {
        let label = self.label(list);
        let Some(found) = self.lists.get_mut(&list) else { return };
        let Some(memory) = self.allocators.get_mut(&allocator) else { return };
        let (kind, other) = (memory.kind, memory.recording.replace(list));
        let own = found.kind;
        *found = List {
            kind: own,
            allocator,
            allocator_resets: memory.resets,
            is_open: true,
            commands: Vec::new(),
            used: HashSet::from([allocator]),
            heaps: Vec::new(),
            root: None,
            arguments: Vec::new(),
            pipeline,
            targets: Vec::new(),
            barrier_calls: 0,
            submitted: None,
        };
        found.used.extend(pipeline);
        if kind != own {
            let text = format!("{label} is of type {own:?}, {} of {kind:?}", self.label(allocator));
            self.find(Rule::AllocatorType, function, text);
        }
        if let Some(other) = other.filter(|other| *other != list) {
            let text = format!("{} records {} already", self.label(allocator), self.label(other));
            self.find(Rule::AllocatorContention, function, text);
        }
    }

    /// `ID3D12GraphicsCommandList::Close`.
    pub fn close(&mut self, list: Id) {
        let Some(found) = self.record(list, "ID3D12GraphicsCommandList::Close", ListKind::Copy) else { return };
        found.is_open = false;
        let allocator = found.allocator;
        if let Some(allocator) = self.allocators.get_mut(&allocator)
            && allocator.recording == Some(list)
        {
            allocator.recording = None;
        }
    }

    /// A list for a command that lists of type `kind` have, if it is open.
    pub(super) fn record(&mut self, list: Id, function: &'static str, kind: ListKind) -> Option<&mut List> {
        let found = self.lists.get(&list)?;
        let (is_open, own) = (found.is_open, found.kind);
        let has = match kind {
            ListKind::Direct => own == ListKind::Direct,
            ListKind::Compute => own != ListKind::Copy,
            ListKind::Copy => true,
        };
        if !is_open {
            let text = format!("{} is closed", self.label(list));
            self.find(Rule::ListClosed, function, text);
            return None;
        }
        if !has {
            let text = format!("{} is of type {own:?}", self.label(list));
            self.find(Rule::CommandListType, function, text);
        }
        self.lists.get_mut(&list)
    }

    /// Adds a command to an open list.
    pub(super) fn push(&mut self, list: Id, command: Command) {
        let caller = self.caller;
        if let Some(list) = self.lists.get_mut(&list) {
            list.commands.push(Recorded { command, caller });
        }
    }

    /// A command without effects here that only lists of a type have, such as a draw.
    pub fn command(&mut self, list: Id, function: &'static str, kind: ListKind) {
        _ = self.record(list, function, kind);
    }

    /// A call that records barriers, whatever their number.
    pub fn barrier_call(&mut self, list: Id) {
        if let Some(found) = self.lists.get_mut(&list) {
            found.barrier_calls += 1;
        }
    }

    /// A transition barrier; without a subresource, of all of them.
    pub fn transition(
        &mut self,
        list: Id,
        resource: Id,
        subresource: Option<u32>,
        (before, after): (State, State),
        part: BarrierPart,
    ) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::ResourceBarrier";
        let label = self.label(resource);
        let Some(found) = self.record(list, FUNCTION, ListKind::Copy) else { return };
        let kind = found.kind;
        found.used.insert(resource);
        self.push(list, Command::Transition { resource, subresource, before, after, part });
        let Some(found) = self.resources.get(&resource) else { return };
        let (desc, count, behaviour) = (found.desc.clone(), found.states.count(), found.states.behaviour());
        let change = format!("{label}: a barrier from {before:?} to {after:?}");
        if before == after {
            self.find(Rule::BarrierMatchingStates, FUNCTION, change.clone());
        }
        if !before.is_valid() || !after.is_valid() {
            self.find(Rule::BarrierInvalidCombination, FUNCTION, change.clone());
        }
        let flagged = State::UNORDERED_ACCESS.0 | State::RENDER_TARGET.0 | State::DEPTH_WRITE.0 | State::DEPTH_READ.0;
        if (before.0 | after.0) & flagged & !desc.allowed.0 != 0 {
            self.find(Rule::BarrierMissingFlag, FUNCTION, change.clone());
        }
        if behaviour == Behaviour::Fixed {
            self.find(Rule::BarrierInvalidHeap, FUNCTION, change.clone());
        }
        if !before.is_in(kind) || !after.is_in(kind) {
            self.find(Rule::BarrierInvalidListType, FUNCTION, format!("{change} in a list of type {kind:?}"));
        }
        if let Some(subresource) = subresource.filter(|subresource| *subresource as usize >= count) {
            self.find(Rule::BarrierInvalidSubresource, FUNCTION, format!("{label} has no subresource {subresource}"));
        }
    }

    /// A UAV barrier; without a resource, for all.
    pub fn uav_barrier(&mut self, list: Id, resource: Option<Id>) {
        if let Some(found) = self.record(list, "ID3D12GraphicsCommandList::ResourceBarrier", ListKind::Compute) {
            found.used.extend(resource);
            self.push(list, Command::UavBarrier(resource));
        }
    }

    /// A command that uses resources and other objects.
    pub fn work(&mut self, list: Id, function: &'static str, kind: ListKind, uses: Vec<Use>, others: &[Id]) {
        if let Some(found) = self.record(list, function, kind) {
            found.used.extend(uses.iter().map(|one| one.resource));
            found.used.extend(others);
            self.push(list, Command::Work { function, uses, tables: Vec::new() });
        }
    }

    /// `CopyBufferRegion`.
    pub fn copy_buffer(&mut self, list: Id, to: (Id, u64), from: (Id, u64), bytes: u64) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::CopyBufferRegion";
        let sides = [
            (to, State::COPY_DEST, Rule::CopyDestinationOutOfBounds),
            (from, State::COPY_SOURCE, Rule::CopySourceOutOfBounds),
        ];
        let mut uses = Vec::new();
        for ((resource, start), state, rule) in sides {
            let end = start.saturating_add(bytes);
            if self.resources.get(&resource).is_some_and(|found| end > found.desc.bytes) {
                let text = format!("bytes {start}..{end} of {}", self.label(resource));
                self.find(rule, FUNCTION, text);
            }
            uses.push(Use::new(resource, Region::Bytes(start..end), state));
        }
        self.work(list, FUNCTION, ListKind::Copy, uses, &[]);
    }

    /// Number of a resource's subresources.
    pub fn subresources(&self, resource: Id) -> u32 {
        self.resources.get(&resource).map_or(0, |found| found.states.count() as u32)
    }

    /// The region of one subresource of a resource.
    pub fn subresource(&self, resource: Id, number: u32) -> Region {
        match self.resources.get(&resource) {
            Some(found) if !found.desc.is_buffer => {
                Region::subresource(number, found.desc.shape[0], found.desc.shape[1])
            }
            _ => Region::All,
        }
    }

    /// A clear of a descriptor's resource: of all of its part, or of rectangles in it.
    pub fn clear(
        &mut self,
        list: Id,
        function: &'static str,
        address: u64,
        (state, kind): (State, ListKind),
        is_whole: bool,
    ) {
        let uses = self.use_of_view(address, state).map(|one| Use { initialises: is_whole, ..one });
        self.work(list, function, kind, uses.into_iter().collect(), &[]);
    }

    /// `DiscardResource` of these subresources, or of rectangles in them.
    pub fn discard(&mut self, list: Id, resource: Id, subresources: Range<u32>, is_whole: bool) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::DiscardResource";
        let kind = self.lists.get(&list).map_or(ListKind::Direct, |list| list.kind);
        let Some(found) = self.resources.get(&resource) else { return };
        let (allowed, count) = (found.desc.allowed, found.states.count());
        let state = match kind {
            ListKind::Direct if allowed.includes(State::RENDER_TARGET) => State::RENDER_TARGET,
            ListKind::Direct if allowed.includes(State::DEPTH_WRITE) => State::DEPTH_WRITE,
            _ => State::UNORDERED_ACCESS,
        };
        if subresources.start > subresources.end || subresources.end as usize > count {
            let text = format!("subresources {subresources:?} of {}, which has {count}", self.label(resource));
            return self.find(Rule::DiscardOutOfBounds, FUNCTION, text);
        }
        let parts = subresources.map(|number| self.subresource(resource, number));
        let uses = parts.map(|region| Use { initialises: is_whole, ..Use::new(resource, region, state) }).collect();
        self.work(list, FUNCTION, ListKind::Compute, uses, &[]);
    }

    /// What lists read at once of the descriptor at an address, for a use in a state.
    fn use_of_view(&self, address: u64, state: State) -> Option<Use> {
        let (heap, index) = self.descriptors.by_cpu(address)?;
        let (resource, region) = self.descriptors.read(heap, index)?.resource.clone()?;
        Some(Use::new(resource, region, state))
    }

    /// `OMSetRenderTargets`: addresses of descriptors, each with the state that draws need.
    pub fn set_targets(&mut self, list: Id, targets: &[(u64, State)]) {
        let function = "ID3D12GraphicsCommandList::OMSetRenderTargets";
        let uses = targets.iter().filter_map(|&(address, state)| self.use_of_view(address, state)).collect();
        if let Some(found) = self.record(list, function, ListKind::Direct) {
            found.targets = uses;
        }
    }

    /// A draw. Only its render targets and depth buffer are checked.
    pub fn draw(&mut self, list: Id, function: &'static str) {
        let targets = self.lists.get(&list).map(|list| list.targets.clone()).unwrap_or_default();
        self.work(list, function, ListKind::Direct, targets, &[]);
    }
}
