//! Resources that have the same memory of a heap: the barriers between their uses, and their first use. A use of one of them makes the
//! others' contents undefined.

use std::collections::{BTreeMap, BTreeSet};

use super::{Command, HeapRange, Recorder, Use};
use crate::rules::Rule;
use crate::states::{ListKind, State};
use crate::timeline::Id;

/// Memory of a resource in heaps, and what was done with it.
#[derive(Default)]
pub(super) struct Backing {
    pub(super) ranges: Vec<HeapRange>,
    /// Of a reserved resource, by number.
    tiles: BTreeMap<u32, HeapRange>,
    /// Other resources that have some of this memory.
    aliases: BTreeSet<Id>,
    /// For each subresource, whether it was initialised since another resource used its memory; empty where that is not needed.
    initialised: Vec<bool>,
}

/// Resources in heaps that a submission has used. An aliasing barrier removes those whose memory may be used by another resource after it.
/// Submissions of a queue need none between each other.
#[derive(Default)]
pub(super) struct AliasedUses(BTreeSet<Id>);

impl Recorder {
    /// Registers the memory of a new resource; `None` for one that is committed or reserved.
    pub(super) fn register_memory(&mut self, resource: Id, range: Option<HeapRange>) {
        let Some(found) = self.resources.get_mut(&resource) else { return };
        let has_metadata = found.desc.allowed.0 & (State::RENDER_TARGET.0 | State::DEPTH_WRITE.0) != 0;
        let count = if has_metadata && !found.desc.is_buffer { found.states.count() } else { 0 };
        found.backing = Backing { initialised: vec![false; count], ..Backing::default() };
        self.set_memory(resource, range.into_iter().collect());
    }

    /// The memory of a resource from now on.
    fn set_memory(&mut self, resource: Id, ranges: Vec<HeapRange>) {
        let overlaps = |other: &[HeapRange]| ranges.iter().any(|range| other.iter().any(|other| range.overlaps(other)));
        let others = self.resources.iter().filter(|(id, other)| **id != resource && overlaps(&other.backing.ranges));
        let aliases: BTreeSet<Id> = others.map(|(&id, _)| id).collect();
        for (&id, other) in &mut self.resources {
            match aliases.contains(&id) {
                true => _ = other.backing.aliases.insert(resource),
                false => _ = other.backing.aliases.remove(&resource),
            }
        }
        if let Some(found) = self.resources.get_mut(&resource) {
            (found.backing.ranges, found.backing.aliases) = (ranges, aliases);
        }
    }

    /// `UpdateTileMappings`: tiles of a reserved resource get other memory, or none, after the queue's earlier work.
    pub fn map_tiles(&mut self, queue: Id, resource: Id, mappings: Vec<(u32, Option<HeapRange>)>) {
        self.queue_command(queue, Command::MapTiles { resource, mappings });
    }

    /// `CopyTileMappings`: tiles of a reserved resource get the memory of another's, after the queue's earlier work. Pairs are of destination
    /// and source.
    pub fn copy_tile_mappings(&mut self, queue: Id, to: Id, from: Id, tiles: Vec<(u32, u32)>) {
        self.queue_command(queue, Command::CopyTileMappings { to, from, tiles });
    }

    /// Numbers of destination tiles, and the heap ranges of their source tiles.
    pub(super) fn source_mappings(&self, from: Id, tiles: &[(u32, u32)]) -> Vec<(u32, Option<HeapRange>)> {
        let Some(found) = self.resources.get(&from) else { return Vec::new() };
        tiles.iter().map(|(to, from)| (*to, found.backing.tiles.get(from).cloned())).collect()
    }

    /// Tiles of a reserved resource have other memory, or none, from now on.
    pub(super) fn set_tiles(&mut self, resource: Id, mappings: Vec<(u32, Option<HeapRange>)>) {
        let Some(found) = self.resources.get_mut(&resource) else { return };
        found.backing.initialised.fill(false);
        for (tile, memory) in mappings {
            match memory {
                Some(memory) => _ = found.backing.tiles.insert(tile, memory),
                None => _ = found.backing.tiles.remove(&tile),
            }
        }
        let mut ranges: Vec<HeapRange> = Vec::new();
        for next in found.backing.tiles.values() {
            match ranges.last_mut() {
                Some(last) if last.heap == next.heap && last.bytes.end == next.bytes.start => {
                    last.bytes.end = next.bytes.end;
                }
                _ => ranges.push(next.clone()),
            }
        }
        self.set_memory(resource, ranges);
    }

    /// Forgets the memory of a released resource.
    pub(super) fn release_memory(&mut self, resource: Id) {
        self.set_memory(resource, Vec::new());
    }

    /// An aliasing barrier. Without resources, for all that could be before or after it.
    pub fn aliasing_barrier(&mut self, list: Id, before: Option<Id>, after: Option<Id>) {
        if let Some(found) = self.record(list, "ID3D12GraphicsCommandList::ResourceBarrier", ListKind::Copy) {
            found.used.extend(before.iter().chain(&after));
            self.push(list, Command::AliasingBarrier { before, after });
        }
    }

    /// Applies an aliasing barrier of a submission: from `before`, or if there is none to `after`.
    pub(super) fn apply_aliasing_barrier(&self, uses: &mut AliasedUses, before: Option<Id>, after: Option<Id>) {
        match (before, after) {
            (Some(before), _) => _ = uses.0.remove(&before),
            (None, Some(after)) => {
                let Some(after) = self.resources.get(&after) else { return };
                uses.0.retain(|used| !after.backing.aliases.contains(used));
            }
            (None, None) => uses.0.clear(),
        }
    }

    /// A command or a barrier initialises subresources.
    pub(super) fn initialise(&mut self, resource: Id, numbers: &[usize]) {
        if let Some(found) = self.resources.get_mut(&resource) {
            for &number in numbers {
                if let Some(one) = found.backing.initialised.get_mut(number) {
                    *one = true;
                }
            }
        }
    }

    /// Reports a use without an aliasing barrier or of memory that is not initialised, and marks the resources that share the memory as undefined.
    pub(super) fn check_aliased_use(&mut self, uses: &mut AliasedUses, function: &'static str, one: &Use) {
        let Some(found) = self.resources.get(&one.resource) else { return };
        if found.backing.ranges.is_empty() {
            return;
        }
        let aliases = found.backing.aliases.clone();
        if let Some(&other) = aliases.iter().find(|other| uses.0.contains(other)) {
            let text = format!("{} after {}, which has the same memory", self.label(one.resource), self.label(other));
            self.find(Rule::AliasingBarrierMissing, function, text);
        }
        uses.0.retain(|used| !aliases.contains(used));
        uses.0.insert(one.resource);
        for alias in aliases {
            if let Some(alias) = self.resources.get_mut(&alias) {
                alias.backing.initialised.fill(false);
            }
        }
        let Some(found) = self.resources.get(&one.resource) else { return };
        let numbers = found.numbers(&one.region);
        let initialised = &found.backing.initialised;
        let missing = numbers.iter().find(|&&number| initialised.get(number) == Some(&false));
        if let Some(number) = missing.filter(|_| !one.initialises) {
            let text = format!("{}, subresource {number}", self.label(one.resource));
            self.find(Rule::PlacedNotInitialized, function, text);
        }
        self.initialise(one.resource, &numbers);
    }
}
