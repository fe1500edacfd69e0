//! Counts of the work that queues execute, by the events in which it is submitted (`ID3D12CommandQueue::BeginEvent`).

use std::collections::{BTreeMap, HashMap};

use serde_json::json;

use crate::timeline::Id;

/// Work of one event, or of several with the same name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Events.
    pub events: u64,
    /// Calls of `ExecuteCommandLists`.
    pub submissions: u64,
    /// Executed command lists.
    pub lists: u64,
    /// Dispatches, direct and indirect.
    pub dispatches: u64,
    /// Copies of buffers and textures.
    pub copies: u64,
    /// Other work: draws, clears, resolves.
    pub others: u64,
    /// Calls that record barriers.
    pub barrier_calls: u64,
    /// State transitions in these calls.
    pub transitions: u64,
    /// UAV barriers in these calls.
    pub uav_barriers: u64,
    /// Aliasing and enhanced barriers in these calls.
    pub other_barriers: u64,
    /// Bytes that copies between buffers write.
    pub copied_bytes: u64,
    /// Bytes of buffers that dispatches bind for reading only. A range that is bound by several dispatches counts for each.
    pub read_views: u64,
    /// Bytes of buffers that dispatches bind for reading and writing, counted in the same way.
    pub write_views: u64,
}

impl Counts {
    /// The names of the counts and their values.
    fn named(&self) -> [(&'static str, u64); 13] {
        [
            ("events", self.events),
            ("submissions", self.submissions),
            ("lists", self.lists),
            ("dispatches", self.dispatches),
            ("copies", self.copies),
            ("others", self.others),
            ("barrier_calls", self.barrier_calls),
            ("transitions", self.transitions),
            ("uav_barriers", self.uav_barriers),
            ("other_barriers", self.other_barriers),
            ("copied_bytes", self.copied_bytes),
            ("read_views", self.read_views),
            ("write_views", self.write_views),
        ]
    }

    /// Adds other work.
    pub(crate) fn add(&mut self, other: &Self) {
        self.events += other.events;
        self.submissions += other.submissions;
        self.lists += other.lists;
        self.dispatches += other.dispatches;
        self.copies += other.copies;
        self.others += other.others;
        self.barrier_calls += other.barrier_calls;
        self.transitions += other.transitions;
        self.uav_barriers += other.uav_barriers;
        self.other_barriers += other.other_barriers;
        self.copied_bytes += other.copied_bytes;
        self.read_views += other.read_views;
        self.write_views += other.write_views;
    }
}

/// The counts of all queues.
#[derive(Debug, Default)]
pub struct EventCounts {
    /// By the name of the event; work outside of events has an empty one.
    counts: BTreeMap<String, Counts>,
    /// Names of the events that have begun on a queue and not ended, outermost first.
    open: HashMap<Id, Vec<String>>,
}

impl EventCounts {
    /// An event begins on a queue.
    pub(crate) fn begin(&mut self, queue: Id, name: &str) {
        let open = self.open.entry(queue).or_default();
        open.push(name.to_owned());
        if open.len() == 1 {
            self.counts.entry(name.to_owned()).or_default().events += 1;
        }
    }

    /// The last event that has begun on a queue ends.
    pub(crate) fn end(&mut self, queue: Id) {
        if let Some(open) = self.open.get_mut(&queue) {
            open.pop();
        }
    }

    /// The counts of the outermost event on a queue.
    pub(crate) fn of(&mut self, queue: Id) -> &mut Counts {
        let name = self.open.get(&queue).and_then(|open| open.first()).cloned().unwrap_or_default();
        self.counts.entry(name).or_default()
    }

    /// The counts since the last call.
    pub fn take(&mut self) -> BTreeMap<String, Counts> {
        std::mem::take(&mut self.counts)
    }
}

/// Counts as a JSON object: an object of numbers for the name of each event.
pub fn to_json(counts: &BTreeMap<String, Counts>) -> String {
    let of = |counts: &Counts| counts.named().into_iter().map(|(name, n)| (name.to_owned(), json!(n))).collect();
    let all: serde_json::Map<String, serde_json::Value> =
        counts.iter().map(|(name, counts)| (name.clone(), serde_json::Value::Object(of(counts)))).collect();
    serde_json::Value::Object(all).to_string()
}
