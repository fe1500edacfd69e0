//! Execution of lists: states of resources, hazards, and the order of queues.

use std::collections::{HashMap, HashSet};

use super::aliasing::AliasedUses;
use super::{BoundTable, Command, InFlight, PastAccess, Recorded, Recorder, Use};
use crate::counts::Counts;
use crate::descriptors::Slots;
use crate::layouts::Access;
use crate::regions::Region;
use crate::root_signature::{DescriptorKind, Parameter};
use crate::rules::Rule;
use crate::states::{Behaviour, ListKind, State};
use crate::timeline::{Clock, Executed, Id};

impl Recorder {
    /// `ExecuteCommandLists`.
    pub fn execute(&mut self, queue: Id, lists: &[Id]) {
        const FUNCTION: &str = "ID3D12CommandQueue::ExecuteCommandLists";
        let id_of_queue = queue;
        let Some(&(queue, queue_kind)) = self.queues.get(&queue) else { return };
        self.complete();
        let caller = self.caller;
        let mut counts = Counts { submissions: 1, ..Counts::default() };
        let index = self.timeline.next_submission(queue);
        let mut commands = Vec::new();
        let mut work = InFlight { queue, index, used: HashSet::new(), written: HashSet::new(), slots: Vec::new() };
        for &id in lists {
            let label = self.label(id);
            let Some(list) = self.lists.get_mut(&id) else { continue };
            let (is_open, kind, allocator) = (list.is_open, list.kind, list.allocator);
            let barrier_calls = list.barrier_calls;
            let before = list.submitted.replace((queue, index));
            let (recorded, used, resets) = (list.commands.clone(), list.used.clone(), list.allocator_resets);
            if is_open {
                self.find(Rule::ExecuteOpenList, FUNCTION, format!("{label} is open"));
                continue;
            }
            if kind != queue_kind {
                let text = format!("{label} is of type {kind:?}, the queue of {queue_kind:?}");
                self.find(Rule::ExecuteListType, FUNCTION, text);
            }
            if before.is_some_and(|(queue, index)| !self.timeline.is_complete(queue, index)) {
                self.find(Rule::ListInUse, FUNCTION, format!("{label} may still run"));
            }
            if self.allocators.get(&allocator).is_some_and(|allocator| allocator.resets != resets) {
                self.find(
                    Rule::AllocatorReset,
                    FUNCTION,
                    format!("the allocator of {label} was reset since it was closed"),
                );
            }
            counts.lists += 1;
            counts.barrier_calls += barrier_calls;
            work.used.extend(used);
            commands.extend(recorded);
        }
        for command in &mut commands {
            if let Command::Work { function, uses, tables } = &mut command.command {
                self.caller = command.caller;
                for table in std::mem::take(tables) {
                    self.resolve(function, &table, uses, &mut work);
                }
                work.used.extend(uses.iter().map(|one| one.resource));
                work.written.extend(uses.iter().filter(|one| one.state.writes()).map(|one| one.resource));
            }
        }
        commands.iter().for_each(|recorded| self.count(&recorded.command, &mut counts));
        self.counts.of(id_of_queue).add(&counts);
        self.caller = caller;
        let mut used: Vec<Id> = work.used.iter().copied().collect();
        used.sort_unstable();
        for id in used {
            if !self.objects.contains_key(&id) {
                self.find(Rule::DeletedInUse, FUNCTION, format!("commands use the released object {id}"));
            } else if self.evicted.contains(&id) || self.heap_of(id).is_some_and(|heap| self.evicted.contains(&heap)) {
                let text = format!("commands use {}, which is evicted", self.label(id));
                self.find(Rule::NotResident, FUNCTION, text);
            }
        }
        self.in_flight.push(work);
        self.timeline.execute(queue, commands);
        self.advance();
    }

    /// Adds a command whose tables are resolved.
    fn count(&self, command: &Command, to: &mut Counts) {
        match command {
            Command::Transition { .. } => to.transitions += 1,
            Command::UavBarrier(_) => to.uav_barriers += 1,
            Command::AliasingBarrier { .. } | Command::EnhancedBarrier { .. } => to.other_barriers += 1,
            Command::Present(_) | Command::MapTiles { .. } | Command::CopyTileMappings { .. } => {}
            Command::Work { function, uses, .. } => {
                let bytes = |writes: bool| {
                    let chosen = uses.iter().filter(|one| one.state.writes() == writes);
                    chosen.map(|one| self.bytes_of(one)).sum::<u64>()
                };
                match function.rsplit(':').next().unwrap_or_default() {
                    "Dispatch" | "ExecuteIndirect" => {
                        to.dispatches += 1;
                        to.read_views += bytes(false);
                        to.write_views += bytes(true);
                    }
                    "CopyBufferRegion" | "CopyTextureRegion" | "CopyResource" | "CopyTiles" => {
                        to.copies += 1;
                        to.copied_bytes += bytes(true);
                    }
                    _ => to.others += 1,
                }
            }
        }
    }

    /// Bytes of a use of a buffer; 0 for a texture.
    fn bytes_of(&self, one: &Use) -> u64 {
        match (&one.region, self.resources.get(&one.resource)) {
            (Region::Bytes(range), _) => range.end - range.start,
            (Region::All, Some(found)) if found.desc.is_buffer => found.desc.bytes,
            _ => 0,
        }
    }

    /// `IDXGISwapChain::Present` of a buffer, on the swap chain's queue.
    pub fn present(&mut self, queue: Id, buffer: Id) {
        self.queue_command(queue, Command::Present(buffer));
    }

    /// A command that is in no list.
    pub(super) fn queue_command(&mut self, queue: Id, command: Command) {
        let Some(&(queue, _)) = self.queues.get(&queue) else { return };
        self.complete();
        self.timeline.execute(queue, vec![Recorded { command, caller: self.caller }]);
        self.advance();
    }

    /// Adds the uses of a table's descriptors.
    fn resolve(&mut self, function: &'static str, table: &BoundTable, uses: &mut Vec<Use>, work: &mut InFlight) {
        let Some(Parameter::Table(ranges)) = table.root.parameters.get(table.parameter) else { return };
        let size = self.descriptors.desc(table.heap).map_or(0, |desc| desc.count);
        for range in ranges {
            // The descriptors that a shader accesses in an unbounded range are unknown.
            let Some(count) = range.count else { continue };
            let start = table.first.saturating_add(range.offset);
            let end = start.saturating_add(count);
            if end > size {
                let text = format!("descriptors {start}..{end} of {}, which has {size}", self.label(table.heap));
                self.find(Rule::TableOutOfBounds, function, text);
            }
            work.slots.push(Slots { heap: table.heap, indices: start..end });
            for index in start..end.min(size) {
                let Some(view) = self.descriptors.read(table.heap, index) else {
                    let text = format!("descriptor {index} of {} was never written", self.label(table.heap));
                    self.find(Rule::DescriptorUninitialized, function, text);
                    continue;
                };
                let (kind, resource) = (view.kind, view.resource.clone());
                if kind != range.kind {
                    let text = format!(
                        "descriptor {index} of {} is a {kind:?}, where the root signature has a {:?}",
                        self.label(table.heap),
                        range.kind
                    );
                    self.find(Rule::DescriptorTypeMismatch, function, text);
                }
                let state = match kind {
                    DescriptorKind::Srv => State::NON_PIXEL_SHADER_RESOURCE,
                    DescriptorKind::Uav => State::UNORDERED_ACCESS,
                    DescriptorKind::Cbv => State::CONSTANT_BUFFER,
                    DescriptorKind::Sampler | DescriptorKind::Target => continue,
                };
                uses.extend(resource.map(|(resource, region)| Use::new(resource, region, state)));
            }
        }
    }

    /// Runs the submissions that no fence holds back.
    pub(super) fn advance(&mut self) {
        let caller = self.caller;
        for Executed { queue, index, clock, work } in self.timeline.advance() {
            self.run(queue, index, &clock, &work);
            self.caller = caller;
        }
    }

    fn run(&mut self, queue: usize, index: u64, clock: &Clock, commands: &[Recorded]) {
        const BARRIER: &str = "ID3D12GraphicsCommandList::ResourceBarrier";
        let kind =
            self.queues.values().find(|(number, _)| *number == queue).map_or(ListKind::Direct, |(_, kind)| *kind);
        // Accesses through unordered access views since the last barrier.
        let mut unordered: HashMap<Id, Vec<Region>> = HashMap::new();
        let mut aliased = AliasedUses::default();
        let mut touched: HashSet<Id> = HashSet::new();
        let mut accesses: HashSet<(Id, Region, bool)> = HashSet::new();
        for Recorded { command, caller } in commands {
            self.caller = *caller;
            match command {
                Command::UavBarrier(None) => unordered.clear(),
                Command::UavBarrier(Some(resource)) => _ = unordered.remove(resource),
                &Command::Present(buffer) => {
                    const FUNCTION: &str = "IDXGISwapChain::Present";
                    accesses.insert((buffer, Region::All, false));
                    let found = self.resources.get(&buffer).and_then(|found| found.states.not_common());
                    if let Some(state) = found {
                        let text = format!("{} is presented in {state}", self.label(buffer));
                        self.find(Rule::InvalidState, FUNCTION, text);
                    }
                }
                Command::EnhancedBarrier { resource: None, barrier, .. } => {
                    self.run_global_barrier(barrier, &touched, &mut unordered, &mut aliased);
                }
                Command::EnhancedBarrier { resource: Some(resource), numbers, barrier, discards } => {
                    touched.insert(*resource);
                    if barrier.before.access.may_be(Access::UNORDERED_ACCESS) {
                        unordered.remove(resource);
                    }
                    let has_layout = self.run_enhanced_barrier(*resource, numbers, barrier);
                    if has_layout && !barrier.keeps_layout() {
                        accesses.extend(
                            numbers.iter().map(|&number| (*resource, self.subresource(*resource, number as u32), true)),
                        );
                    }
                    self.alias_by_barrier(&mut aliased, *resource, numbers, barrier, *discards);
                }
                &Command::AliasingBarrier { before, after } => self.apply_aliasing_barrier(&mut aliased, before, after),
                Command::MapTiles { resource, mappings } => self.set_tiles(*resource, mappings.clone()),
                Command::CopyTileMappings { to, from, tiles } => {
                    let mappings = self.source_mappings(*from, tiles);
                    self.set_tiles(*to, mappings);
                }
                &Command::Transition { resource, subresource, before, after, part } => {
                    unordered.remove(&resource);
                    touched.insert(resource);
                    let region = subresource.map_or(Region::All, |number| self.subresource(resource, number));
                    let Some(found) = self.resources.get_mut(&resource) else { continue };
                    let numbers = found.numbers(&region);
                    let broken = found.states.transition(&numbers, before, after, part);
                    if found.states.behaviour() == Behaviour::Texture {
                        accesses.insert((resource, region, true));
                    }
                    for (rule, text) in broken {
                        let text = format!("{}, {text}", self.label(resource));
                        self.find(rule, BARRIER, text);
                    }
                }
                Command::Work { function, uses, .. } => {
                    let mut now: Vec<(Id, Region)> = Vec::new();
                    for one in uses {
                        self.check_aliased_use(&mut aliased, function, one);
                        let Use { resource, region, state, .. } = one;
                        touched.insert(*resource);
                        accesses.insert((*resource, region.clone(), state.writes()));
                        if *state == State::UNORDERED_ACCESS {
                            let earlier = unordered.get(resource).into_iter().flatten();
                            if let Some(earlier) = earlier.into_iter().find(|earlier| earlier.overlaps(region)) {
                                let text = format!("{}: {region:?} after {earlier:?}", self.label(*resource));
                                self.find(Rule::UavWithoutBarrier, function, text);
                            }
                            now.push((*resource, region.clone()));
                        }
                        let Some(found) = self.resources.get_mut(resource) else { continue };
                        let numbers = found.numbers(region);
                        if let Some((rule, text)) = found.states.require(&numbers, *state) {
                            let text = format!("{}, {text}", self.label(*resource));
                            self.find(rule, function, text);
                        }
                    }
                    for (resource, region) in now {
                        unordered.entry(resource).or_default().push(region);
                    }
                }
            }
        }
        for resource in touched {
            if let Some(found) = self.resources.get_mut(&resource) {
                found.states.decay(kind);
            }
        }
        self.order(queue, index, clock, accesses);
    }

    /// Checks accesses against those of other queues that are not ordered before.
    fn order(&mut self, queue: usize, index: u64, clock: &Clock, accesses: HashSet<(Id, Region, bool)>) {
        for (id, region, writes) in accesses {
            let Some(found) = self.resources.get_mut(&id) else { continue };
            let timeline = &self.timeline;
            found.accesses.retain(|past| !timeline.is_complete(past.queue, past.index));
            let conflicts = |past: &PastAccess| {
                past.queue != queue
                    && clock.get(past.queue) < past.index
                    && (writes || past.writes)
                    && past.region.overlaps(&region)
            };
            let other = found.accesses.iter().find(|past| conflicts(past)).map(|past| (past.queue, past.index));
            let is_same = |past: &PastAccess| past.queue == queue && past.writes == writes && past.region == region;
            match found.accesses.iter_mut().find(|past| is_same(past)) {
                Some(past) => past.index = index,
                None => found.accesses.push(PastAccess { queue, index, region, writes }),
            }
            if let Some((other, submission)) = other {
                let text = format!(
                    "{}: submission {index} of queue {queue} and submission {submission} of queue {other}",
                    self.label(id)
                );
                self.find(Rule::QueuesNotOrdered, "ID3D12CommandQueue::ExecuteCommandLists", text);
            }
        }
    }
}
