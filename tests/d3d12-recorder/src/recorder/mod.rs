//! The recorder: a method for each call, with numbers for objects. It finds the rules that the calls break.

mod aliasing;
mod bindings;
pub mod enhanced;
mod execution;
mod lists;
mod memory;

use std::backtrace::Backtrace;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use self::aliasing::Backing;
use crate::counts::{Counts, EventCounts};
use crate::descriptors::{Descriptors, HeapDesc, Slots};
use crate::layouts::{EnhancedBarrier, Layout};
use crate::regions::Region;
use crate::root_signature::RootSignature;
use crate::rules::{Finding, Rule};
use crate::states::{BarrierPart, Behaviour, ListKind, ResourceStates, State};
use crate::timeline::{Id, Timeline};

/// Kind of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum ObjectKind {
    Device,
    Queue,
    Allocator,
    List,
    Fence,
    Resource,
    Heap,
    DescriptorHeap,
    QueryHeap,
    RootSignature,
    Pipeline,
}

impl ObjectKind {
    /// The rule that is broken by an object that is alive at the end.
    fn live_rule(self) -> Rule {
        match self {
            Self::Device => Rule::LiveDevice,
            Self::Queue => Rule::LiveQueue,
            Self::Allocator => Rule::LiveAllocator,
            Self::List => Rule::LiveList,
            Self::Fence => Rule::LiveFence,
            Self::Resource => Rule::LiveResource,
            Self::Heap => Rule::LiveHeap,
            Self::DescriptorHeap => Rule::LiveDescriptorHeap,
            Self::QueryHeap => Rule::LiveQueryHeap,
            Self::RootSignature => Rule::LiveRootSignature,
            Self::Pipeline => Rule::LivePipeline,
        }
    }
}

/// A live object.
struct Object {
    kind: ObjectKind,
    label: String,
    stack: Option<Backtrace>,
    /// Whether another object, such as a swap chain, keeps it when the program has released it.
    is_kept: bool,
}

/// Type of the heap that has a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// Only the device accesses it.
    Default,
    /// The processor writes it.
    Upload,
    /// The processor reads it.
    Readback,
    /// The processor may access it.
    Custom,
}

/// Memory of a heap.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HeapRange {
    /// The heap.
    pub heap: Id,
    /// Its bytes.
    pub bytes: Range<u64>,
}

impl HeapRange {
    fn overlaps(&self, other: &Self) -> bool {
        self.heap == other.heap && self.bytes.start < other.bytes.end && other.bytes.start < self.bytes.end
    }
}

/// Description of a new resource.
#[derive(Debug, Clone)]
pub struct ResourceDesc {
    /// Whether it is a buffer.
    pub is_buffer: bool,
    /// Bytes of a buffer.
    pub bytes: u64,
    /// Mipmap levels, array slices and planes.
    pub shape: [u32; 3],
    /// Type of its heap.
    pub memory: Memory,
    /// Whether queues may access it at the same time.
    pub is_simultaneous: bool,
    /// The states that its flags allow besides reads and copies.
    pub allowed: State,
    /// State after creation.
    pub state: State,
    /// Layout after creation, where the resource has one instead of a state.
    pub layout: Option<Layout>,
    /// Its memory, where it is placed in a heap.
    pub placed: Option<HeapRange>,
    /// Address of a buffer for shaders.
    pub address: Option<u64>,
}

/// An access by another queue is checked against these.
struct PastAccess {
    queue: usize,
    index: u64,
    region: Region,
    writes: bool,
}

struct Resource {
    desc: ResourceDesc,
    states: ResourceStates,
    accesses: Vec<PastAccess>,
    mapped: u32,
    backing: Backing,
}

impl Resource {
    fn numbers(&self, region: &Region) -> Vec<usize> {
        let [levels, slices, planes] = self.desc.shape;
        region.numbers(levels, slices, planes)
    }
}

/// A use of a part of a resource by a command.
#[derive(Debug, Clone)]
pub struct Use {
    /// The resource.
    pub resource: Id,
    /// Its part.
    pub region: Region,
    /// The state that is needed.
    pub state: State,
    /// Whether it writes the whole part without regard to what was in it: a clear, a discard or a copy.
    pub initialises: bool,
}

impl Use {
    /// A use of what is in a part of a resource.
    pub fn new(resource: Id, region: Region, state: State) -> Self {
        Self { resource, region, state, initialises: false }
    }
}

/// A descriptor table that a dispatch uses. Its descriptors are read when the list is executed.
#[derive(Debug, Clone)]
struct BoundTable {
    heap: Id,
    first: u32,
    root: Arc<RootSignature>,
    parameter: usize,
}

#[derive(Debug, Clone)]
enum Command {
    Transition {
        resource: Id,
        subresource: Option<u32>,
        before: State,
        after: State,
        part: BarrierPart,
    },
    UavBarrier(Option<Id>),
    /// A swap chain presents a buffer.
    Present(Id),
    /// An enhanced barrier of subresources; without a resource, of everything.
    EnhancedBarrier {
        resource: Option<Id>,
        numbers: Vec<usize>,
        barrier: EnhancedBarrier,
        discards: bool,
    },
    AliasingBarrier {
        before: Option<Id>,
        after: Option<Id>,
    },
    /// Tiles of a reserved resource get other memory, or none.
    MapTiles {
        resource: Id,
        mappings: Vec<(u32, Option<HeapRange>)>,
    },
    /// Tiles of a reserved resource get the memory of another's, by pairs of destination and source.
    CopyTileMappings {
        to: Id,
        from: Id,
        tiles: Vec<(u32, u32)>,
    },
    Work {
        function: &'static str,
        uses: Vec<Use>,
        tables: Vec<BoundTable>,
    },
}

/// A command with the code address that recorded it.
#[derive(Debug, Clone)]
struct Recorded {
    command: Command,
    caller: usize,
}

/// Value of a root parameter.
#[derive(Debug, Clone)]
enum Argument {
    Unset,
    Table(Id, u32),
    /// The constants that are set, one bit each.
    Constants(u64),
    Descriptor(Use),
}

struct Allocator {
    kind: ListKind,
    /// Number of its resets.
    resets: u64,
    recording: Option<Id>,
}

struct List {
    kind: ListKind,
    allocator: Id,
    /// Resets of the allocator when the list was opened.
    allocator_resets: u64,
    is_open: bool,
    commands: Vec<Recorded>,
    used: HashSet<Id>,
    heaps: Vec<Id>,
    root: Option<Id>,
    arguments: Vec<Argument>,
    pipeline: Option<Id>,
    /// Render targets and depth buffer.
    targets: Vec<Use>,
    /// Calls that recorded barriers.
    barrier_calls: u64,
    /// Queue and number of its last submission.
    submitted: Option<(usize, u64)>,
}

/// A submission, and the objects that the processor must not change until it is complete.
struct InFlight {
    queue: usize,
    index: u64,
    used: HashSet<Id>,
    written: HashSet<Id>,
    slots: Vec<Slots>,
}

type Submission = Vec<Recorded>;

/// Fence values that the processor may have waited for since the last call.
type Completions = Box<dyn FnMut() -> Vec<(Id, u64)> + Send>;

/// The recorder of a process.
#[derive(Default)]
pub struct Recorder {
    last_id: Id,
    findings: Vec<Finding>,
    /// Code address that makes the current call, or 0.
    caller: usize,
    completions: Option<Completions>,
    objects: HashMap<Id, Object>,
    /// Objects that were reported to be alive.
    reported: HashSet<Id>,
    resources: HashMap<Id, Resource>,
    /// Buffers by their address for shaders.
    addresses: BTreeMap<u64, Id>,
    descriptors: Descriptors,
    roots: HashMap<Id, Arc<RootSignature>>,
    pipelines: HashMap<Id, Option<Id>>,
    allocators: HashMap<Id, Allocator>,
    lists: HashMap<Id, List>,
    queues: HashMap<Id, (usize, ListKind)>,
    evicted: HashSet<Id>,
    timeline: Timeline<Submission>,
    in_flight: Vec<InFlight>,
    counts: EventCounts,
}

impl Recorder {
    /// Findings since the last call.
    pub fn take_findings(&mut self) -> Vec<Finding> {
        std::mem::take(&mut self.findings)
    }

    /// Counts of the work that was executed since the last call, by the name of its event; outside of events an empty name.
    pub fn take_counts(&mut self) -> BTreeMap<String, Counts> {
        self.counts.take()
    }

    /// `ID3D12CommandQueue::BeginEvent`.
    pub fn begin_event(&mut self, queue: Id, name: &str) {
        self.counts.begin(queue, name);
    }

    /// `ID3D12CommandQueue::EndEvent`.
    pub fn end_event(&mut self, queue: Id) {
        self.counts.end(queue);
    }

    /// The code address that makes the calls which follow. Findings have it.
    pub fn set_caller(&mut self, caller: usize) {
        self.caller = caller;
    }

    /// Code address of the call that is being recorded; 0 if it is unknown.
    pub fn caller(&self) -> usize {
        self.caller
    }

    /// Asks `completions` for fence values before work counts as unfinished. A program can wait for a fence by an event, which no call to
    /// Direct3D shows.
    pub fn set_completions(&mut self, completions: impl FnMut() -> Vec<(Id, u64)> + Send + 'static) {
        self.completions = Some(Box::new(completions));
    }

    /// The one state of all subresources after everything that was submitted; `None` where they differ, where enhanced barriers gave them a
    /// layout, or while a queue waits for a fence.
    pub fn state_of(&self, resource: Id) -> Option<State> {
        self.resources.get(&resource).filter(|_| self.timeline.is_idle())?.states.common_state()
    }

    /// Whether a list is being recorded.
    pub fn is_open(&self, list: Id) -> bool {
        self.lists.get(&list).is_some_and(|list| list.is_open)
    }

    fn find(&mut self, rule: Rule, function: &'static str, text: impl Into<String>) {
        self.findings.push(Finding { rule, function, text: text.into(), caller: self.caller });
    }

    fn label(&self, id: Id) -> String {
        match self.objects.get(&id) {
            Some(object) => format!("{} {id}", object.label),
            None => format!("released object {id}"),
        }
    }

    // Objects.

    /// A new object; returns its number.
    pub fn create(&mut self, kind: ObjectKind, label: impl Into<String>, stack: Option<Backtrace>) -> Id {
        self.last_id += 1;
        self.objects.insert(self.last_id, Object { kind, label: label.into(), stack, is_kept: false });
        self.last_id
    }

    /// Kind of a live object.
    pub fn kind(&self, id: Id) -> Option<ObjectKind> {
        self.objects.get(&id).map(|object| object.kind)
    }

    /// The object was made by something else than a call, such as a swap chain, which keeps it: that it is released and alive is no fault.
    pub fn keep(&mut self, id: Id) {
        if let Some(object) = self.objects.get_mut(&id) {
            object.is_kept = true;
        }
    }

    /// The object is a queue.
    pub fn create_queue(&mut self, queue: Id, kind: ListKind) {
        let number = self.timeline.add_queue();
        self.queues.insert(queue, (number, kind));
    }

    /// The object is a fence.
    pub fn create_fence(&mut self, fence: Id, value: u64) {
        self.timeline.add_fence(fence, value);
    }

    /// The object is a descriptor heap.
    pub fn create_descriptor_heap(&mut self, heap: Id, desc: HeapDesc) {
        self.descriptors.add(heap, desc);
    }

    /// The object is a root signature.
    pub fn create_root_signature(&mut self, root: Id, signature: RootSignature) {
        self.roots.insert(root, Arc::new(signature));
    }

    /// The object is a compute pipeline with a root signature.
    pub fn create_pipeline(&mut self, pipeline: Id, root: Option<Id>) {
        self.pipelines.insert(pipeline, root);
    }

    /// The object is a resource.
    pub fn create_resource(&mut self, resource: Id, desc: ResourceDesc) {
        let behaviour = match desc.memory {
            Memory::Upload | Memory::Readback => Behaviour::Fixed,
            _ if desc.is_buffer || desc.is_simultaneous => Behaviour::Simultaneous,
            _ => Behaviour::Texture,
        };
        if let Some(address) = desc.address {
            self.addresses.insert(address, resource);
        }
        let count = desc.shape.iter().product::<u32>() as usize;
        // Buffers are created in COMMON whatever the caller asks for.
        let state = if behaviour == Behaviour::Simultaneous && desc.is_buffer { State::COMMON } else { desc.state };
        let mut states = ResourceStates::new(behaviour, count, state);
        if let Some(layout) = desc.layout {
            states.set_layout(layout);
        }
        let placed = desc.placed.clone();
        let (accesses, backing) = (Vec::new(), Backing::default());
        self.resources.insert(resource, Resource { desc, states, accesses, mapped: 0, backing });
        self.register_memory(resource, placed);
    }

    /// The object is an allocator.
    pub fn create_allocator(&mut self, allocator: Id, kind: ListKind) {
        self.allocators.insert(allocator, Allocator { kind, resets: 0, recording: None });
    }

    /// The object is a list: open where it has an allocator.
    pub fn create_list(&mut self, list: Id, kind: ListKind, allocator: Option<Id>, pipeline: Option<Id>) {
        let empty = List {
            kind,
            // No object has this number.
            allocator: allocator.unwrap_or(0),
            allocator_resets: 0,
            is_open: false,
            commands: Vec::new(),
            used: HashSet::new(),
            heaps: Vec::new(),
            root: None,
            arguments: Vec::new(),
            pipeline: None,
            targets: Vec::new(),
            barrier_calls: 0,
            submitted: None,
        };
        self.lists.insert(list, empty);
        if let Some(allocator) = allocator {
            self.open(list, allocator, pipeline, "ID3D12Device::CreateCommandList");
        }
    }

    /// The last reference of an object was released.
    pub fn release(&mut self, id: Id) {
        let Some(object) = self.objects.get(&id).filter(|object| !object.is_kept) else { return };
        let kind = object.kind;
        // A list's commands are in its allocator, and queues keep what they need of fences.
        let is_kept = matches!(kind, ObjectKind::List | ObjectKind::Fence | ObjectKind::Queue | ObjectKind::Device);
        if !is_kept && self.is_in_flight(|work| work.used.contains(&id)) {
            let text = format!("{} is released while queued commands use it", self.label(id));
            self.find(Rule::DeletedInUse, "IUnknown::Release", text);
        }
        self.objects.remove(&id);
        self.release_memory(id);
        if let Some(resource) = self.resources.remove(&id)
            && let Some(address) = resource.desc.address
            && self.addresses.get(&address) == Some(&id)
        {
            self.addresses.remove(&address);
        }
        self.descriptors.remove(id);
        self.roots.remove(&id);
        self.pipelines.remove(&id);
        self.allocators.remove(&id);
        if let Some(list) = self.lists.remove(&id)
            && let Some(allocator) = self.allocators.get_mut(&list.allocator)
            && allocator.recording == Some(id)
        {
            allocator.recording = None;
        }
        self.queues.remove(&id);
        self.evicted.remove(&id);
    }

    /// Reports the objects that are alive, at the end of a program; each object once.
    pub fn report_live(&mut self) {
        let is_new = |id: &Id, object: &Object| !object.is_kept && !self.reported.contains(id);
        let alive = self.objects.iter().filter(|(id, object)| is_new(id, object));
        let mut ids: Vec<Id> = alive.map(|(&id, _)| id).collect();
        ids.sort_unstable();
        for id in ids {
            let object = &self.objects[&id];
            let rule = object.kind.live_rule();
            let stack = object.stack.as_ref().map_or_else(String::new, |stack| format!("; created at\n{stack}"));
            let text = format!("{} is alive at the end{stack}", self.label(id));
            self.find(rule, "IUnknown::Release", text);
            self.reported.insert(id);
        }
    }

    /// `ID3D12CommandQueue::Signal`.
    pub fn signal(&mut self, queue: Id, fence: Id, value: u64) {
        self.complete();
        if let Some(&(queue, _)) = self.queues.get(&queue) {
            self.timeline.signal(queue, fence, value);
            self.advance();
        }
    }

    /// `ID3D12CommandQueue::Wait`.
    pub fn wait(&mut self, queue: Id, fence: Id, value: u64) {
        self.complete();
        if let Some(&(queue, _)) = self.queues.get(&queue) {
            self.timeline.wait(queue, fence, value);
            self.advance();
        }
    }

    /// `ID3D12Fence::Signal`.
    pub fn signal_by_host(&mut self, fence: Id, value: u64) {
        self.timeline.signal_by_host(fence, value);
        self.advance();
    }

    /// The processor found this value of a fence.
    pub fn observe(&mut self, fence: Id, value: u64) {
        self.timeline.observe(fence, value);
    }

    /// The device is removed, as the processor knows: nothing that was submitted runs any more.
    pub fn remove_device(&mut self) {
        self.timeline.complete_all();
    }

    /// Observes fence values that the processor may have waited for by an event.
    fn complete(&mut self) {
        let values = self.completions.as_mut().map(|completions| completions()).unwrap_or_default();
        for (fence, value) in values {
            self.timeline.observe(fence, value);
        }
    }

    /// Whether a submission may still run, as far as the processor knows, that is like this.
    fn is_in_flight(&mut self, is_like: impl Fn(&InFlight) -> bool) -> bool {
        if !self.in_flight.iter().any(&is_like) {
            return false;
        }
        self.complete();
        let timeline = &self.timeline;
        self.in_flight.retain(|work| !timeline.is_complete(work.queue, work.index));
        self.in_flight.iter().any(is_like)
    }
}
