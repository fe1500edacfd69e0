//! The recorder: it is told each call, with numbers for objects, and finds the rules that the calls break.

use std::backtrace::Backtrace;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use crate::descriptors::{Descriptors, HeapDesc, Slots, View};
use crate::regions::Region;
use crate::root_signature::{DescriptorKind, Parameter, RootSignature};
use crate::rules::{Finding, Rule};
use crate::states::{BarrierPart, Behaviour, ListKind, ResourceStates, State};
use crate::timeline::{Clock, Executed, Id, Timeline};

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
    /// The heap that it is placed in.
    pub heap: Option<Id>,
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
    Transition { resource: Id, subresource: Option<u32>, before: State, after: State, part: BarrierPart },
    UavBarrier(Option<Id>),
    Work { function: &'static str, uses: Vec<Use>, tables: Vec<BoundTable> },
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
    /// Queue and number of its last submission.
    submitted: Option<(usize, u64)>,
}

/// A submission, for what the processor must not change until it is complete.
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
    /// Code address of the call that is told, or 0.
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
}

impl Recorder {
    /// Findings since the last call.
    pub fn take_findings(&mut self) -> Vec<Finding> {
        std::mem::take(&mut self.findings)
    }

    /// The code address that makes the calls which follow. Findings have it.
    pub fn set_caller(&mut self, caller: usize) {
        self.caller = caller;
    }

    /// Asks `completions` for fence values before work counts as unfinished. A program can wait for a fence by an event, which no call to
    /// Direct3D shows.
    pub fn set_completions(&mut self, completions: impl FnMut() -> Vec<(Id, u64)> + Send + 'static) {
        self.completions = Some(Box::new(completions));
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
        let states = ResourceStates::new(behaviour, count, state);
        self.resources.insert(resource, Resource { desc, states, accesses: Vec::new(), mapped: 0 });
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

    // Fences.

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

    // Descriptors.

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
        let placed = |found: &Resource| found.desc.heap == Some(object);
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

    fn heap_of(&self, resource: Id) -> Option<Id> {
        self.resources.get(&resource)?.desc.heap
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

    // Allocators and lists.

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

    fn open(&mut self, list: Id, allocator: Id, pipeline: Option<Id>, function: &'static str) {
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
    fn record(&mut self, list: Id, function: &'static str, kind: ListKind) -> Option<&mut List> {
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
    fn push(&mut self, list: Id, command: Command) {
        let caller = self.caller;
        if let Some(list) = self.lists.get_mut(&list) {
            list.commands.push(Recorded { command, caller });
        }
    }

    /// A command without effects here that only lists of a type have, such as a draw.
    pub fn command(&mut self, list: Id, function: &'static str, kind: ListKind) {
        _ = self.record(list, function, kind);
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
            uses.push(Use { resource, region: Region::Bytes(start..end), state });
        }
        self.work(list, FUNCTION, ListKind::Copy, uses, &[]);
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

    /// A command that uses the resource of a descriptor which lists read at once: a render target, or a view to clear.
    pub fn use_view(&mut self, list: Id, function: &'static str, address: u64, state: State, kind: ListKind) {
        let uses = self.use_of_view(address, state).into_iter().collect();
        self.work(list, function, kind, uses, &[]);
    }

    /// What lists read at once of the descriptor at an address, for a use in a state.
    fn use_of_view(&self, address: u64, state: State) -> Option<Use> {
        let (heap, index) = self.descriptors.by_cpu(address)?;
        let (resource, region) = self.descriptors.read(heap, index)?.resource.clone()?;
        Some(Use { resource, region, state })
    }

    /// `OMSetRenderTargets`: addresses of descriptors, each with the state that draws need.
    pub fn set_targets(&mut self, list: Id, targets: &[(u64, State)]) {
        let function = "ID3D12GraphicsCommandList::OMSetRenderTargets";
        let uses = targets.iter().filter_map(|&(address, state)| self.use_of_view(address, state)).collect();
        if let Some(found) = self.record(list, function, ListKind::Direct) {
            found.targets = uses;
        }
    }

    /// A draw. Of what it uses, only render targets and the depth buffer are checked.
    pub fn draw(&mut self, list: Id, function: &'static str) {
        let targets = self.lists.get(&list).map(|list| list.targets.clone()).unwrap_or_default();
        self.work(list, function, ListKind::Direct, targets, &[]);
    }

    // Bindings.

    /// `SetDescriptorHeaps`.
    pub fn set_heaps(&mut self, list: Id, heaps: Vec<Id>) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetDescriptorHeaps";
        let mut kinds = Vec::new();
        for &heap in &heaps {
            let Some(desc) = self.descriptors.desc(heap) else { continue };
            let (is_visible, has_samplers) = (desc.gpu.is_some(), desc.has_samplers);
            if !is_visible {
                let text = format!("shaders do not see {}", self.label(heap));
                self.find(Rule::SetHeapInvalid, FUNCTION, text);
            }
            if kinds.contains(&has_samplers) {
                let text = format!("{} is the second of its type", self.label(heap));
                self.find(Rule::SetHeapInvalid, FUNCTION, text);
            }
            kinds.push(has_samplers);
        }
        if let Some(found) = self.record(list, FUNCTION, ListKind::Compute) {
            for argument in &mut found.arguments {
                if matches!(argument, Argument::Table(heap, _) if !heaps.contains(heap)) {
                    *argument = Argument::Unset;
                }
            }
            found.used.extend(&heaps);
            found.heaps = heaps;
        }
    }

    /// `SetComputeRootSignature`.
    pub fn set_root(&mut self, list: Id, root: Id) {
        let count = self.roots.get(&root).map_or(0, |root| root.parameters.len());
        let function = "ID3D12GraphicsCommandList::SetComputeRootSignature";
        if let Some(found) = self.record(list, function, ListKind::Compute) {
            found.used.insert(root);
            if found.root != Some(root) {
                found.root = Some(root);
                found.arguments = vec![Argument::Unset; count];
            }
        }
    }

    /// `SetPipelineState`.
    pub fn set_pipeline(&mut self, list: Id, pipeline: Id) {
        let function = "ID3D12GraphicsCommandList::SetPipelineState";
        if let Some(found) = self.record(list, function, ListKind::Compute) {
            found.used.insert(pipeline);
            found.pipeline = Some(pipeline);
        }
    }

    /// The parameter of the list's root signature.
    fn parameter(&self, list: Id, parameter: u32) -> Option<&Parameter> {
        let root = self.lists.get(&list)?.root?;
        self.roots.get(&root)?.parameters.get(parameter as usize)
    }

    fn set_argument(&mut self, list: Id, function: &'static str, parameter: u32, argument: Argument) {
        if let Some(found) = self.record(list, function, ListKind::Compute)
            && let Some(place) = found.arguments.get_mut(parameter as usize)
        {
            if let (Argument::Constants(before), Argument::Constants(more)) = (&*place, &argument) {
                *place = Argument::Constants(before | more);
            } else {
                *place = argument;
            }
        }
    }

    /// `SetComputeRootDescriptorTable`.
    pub fn set_table(&mut self, list: Id, parameter: u32, address: u64) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetComputeRootDescriptorTable";
        if !matches!(self.parameter(list, parameter), Some(Parameter::Table(_))) {
            return self.find(Rule::SetTableInvalid, FUNCTION, format!("parameter {parameter} is no table"));
        }
        let found = self.descriptors.by_gpu(address);
        let heaps = self.lists.get(&list).map(|list| list.heaps.clone()).unwrap_or_default();
        match found.filter(|(heap, _)| heaps.contains(heap)) {
            Some((heap, index)) => self.set_argument(list, FUNCTION, parameter, Argument::Table(heap, index)),
            None => {
                let text = format!("the table at {address:#x} of parameter {parameter} is in no heap that is set");
                self.find(Rule::SetTableInvalid, FUNCTION, text);
            }
        }
    }

    /// `SetComputeRoot32BitConstants`.
    pub fn set_constants(&mut self, list: Id, parameter: u32, first: u32, count: u32) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetComputeRoot32BitConstants";
        match self.parameter(list, parameter) {
            Some(&Parameter::Constants(has)) if first.saturating_add(count) <= has => {
                let set = (first..first + count).fold(0, |set, bit| set | 1 << (bit % 64));
                self.set_argument(list, FUNCTION, parameter, Argument::Constants(set));
            }
            _ => {
                let text = format!("parameter {parameter} has no constants {first}..{}", first.saturating_add(count));
                self.find(Rule::SetConstantInvalid, FUNCTION, text);
            }
        }
    }

    /// The buffer that has an address for shaders, and its bytes from there on.
    pub fn buffer_at(&self, address: u64) -> Option<(Id, Range<u64>)> {
        let (&start, &id) = self.addresses.range(..=address).next_back()?;
        let bytes = self.resources.get(&id)?.desc.bytes;
        (address - start < bytes).then_some((id, address - start..bytes))
    }

    /// `SetComputeRootConstantBufferView` and the others.
    pub fn set_root_view(
        &mut self,
        list: Id,
        function: &'static str,
        parameter: u32,
        kind: DescriptorKind,
        address: u64,
    ) {
        let (rule, state) = match kind {
            DescriptorKind::Cbv => (Rule::SetRootCbvInvalid, State::CONSTANT_BUFFER),
            DescriptorKind::Uav => (Rule::SetRootUavInvalid, State::UNORDERED_ACCESS),
            _ => (Rule::SetRootSrvInvalid, State::NON_PIXEL_SHADER_RESOURCE),
        };
        if self.parameter(list, parameter) != Some(&Parameter::Descriptor(kind)) {
            return self.find(rule, function, format!("parameter {parameter} is no root {kind:?}"));
        }
        match self.buffer_at(address) {
            Some((resource, bytes)) => {
                let one = Use { resource, region: Region::Bytes(bytes), state };
                self.set_argument(list, function, parameter, Argument::Descriptor(one));
            }
            None => self.find(rule, function, format!("no buffer has the address {address:#x}")),
        }
    }

    /// `Dispatch`.
    pub fn dispatch(&mut self, list: Id) {
        self.dispatch_with(list, "ID3D12GraphicsCommandList::Dispatch", Vec::new());
    }

    /// A dispatch by `ExecuteIndirect`, which reads its arguments from a buffer, and their number from another.
    pub fn dispatch_indirect(&mut self, list: Id, arguments: Id, count: Option<Id>) {
        let state = State::INDIRECT_ARGUMENT;
        let uses = [Some(arguments), count].into_iter().flatten();
        let uses = uses.map(|resource| Use { resource, region: Region::All, state }).collect();
        self.dispatch_with(list, "ID3D12GraphicsCommandList::ExecuteIndirect", uses);
    }

    fn dispatch_with(&mut self, list: Id, function: &'static str, mut uses: Vec<Use>) {
        let Some(found) = self.record(list, function, ListKind::Compute) else { return };
        let (root, pipeline, arguments) = (found.root, found.pipeline, found.arguments.clone());
        let label = self.label(list);
        let Some(pipeline) = pipeline else {
            return self.find(Rule::PipelineNotSet, function, format!("{label} has no pipeline"));
        };
        let Some(signature) = root.and_then(|root| self.roots.get(&root)).cloned() else {
            return self.find(Rule::RootSignatureNotSet, function, format!("{label} has no root signature"));
        };
        let of_pipeline = self.pipelines.get(&pipeline).copied().flatten().and_then(|root| self.roots.get(&root));
        if of_pipeline.is_some_and(|other| *other != signature) {
            let text = format!("{} has another root signature", self.label(pipeline));
            self.find(Rule::RootSignatureMismatch, function, text);
        }
        let mut tables = Vec::new();
        for (number, (parameter, argument)) in signature.parameters.iter().zip(arguments).enumerate() {
            let missing = match (parameter, argument) {
                (Parameter::Table(_), Argument::Table(heap, first)) => {
                    tables.push(BoundTable { heap, first, root: signature.clone(), parameter: number });
                    None
                }
                (Parameter::Table(_), _) => Some(Rule::TableNotSet),
                (&Parameter::Constants(count), Argument::Constants(set)) => {
                    (set.count_ones() < count.min(64)).then_some(Rule::RootConstantsNotSet)
                }
                (&Parameter::Constants(count), _) => (count > 0).then_some(Rule::RootConstantsNotSet),
                (Parameter::Descriptor(_), Argument::Descriptor(one)) => {
                    uses.push(one);
                    None
                }
                (Parameter::Descriptor(DescriptorKind::Cbv), _) => Some(Rule::RootCbvNotSet),
                (Parameter::Descriptor(DescriptorKind::Uav), _) => Some(Rule::RootUavNotSet),
                (Parameter::Descriptor(_), _) => Some(Rule::RootSrvNotSet),
            };
            if let Some(rule) = missing {
                self.find(rule, function, format!("root parameter {number} of {label} is not set"));
            }
        }
        if let Some(found) = self.lists.get_mut(&list) {
            found.used.extend(uses.iter().map(|one| one.resource));
            self.push(list, Command::Work { function, uses, tables });
        }
    }

    // Execution.

    /// `ExecuteCommandLists`.
    pub fn execute(&mut self, queue: Id, lists: &[Id]) {
        const FUNCTION: &str = "ID3D12CommandQueue::ExecuteCommandLists";
        let Some(&(queue, queue_kind)) = self.queues.get(&queue) else { return };
        self.complete();
        let caller = self.caller;
        let index = self.timeline.next_submission(queue);
        let mut commands = Vec::new();
        let mut work = InFlight { queue, index, used: HashSet::new(), written: HashSet::new(), slots: Vec::new() };
        for &id in lists {
            let label = self.label(id);
            let Some(list) = self.lists.get_mut(&id) else { continue };
            let (is_open, kind, allocator) = (list.is_open, list.kind, list.allocator);
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

    /// Adds what a table's descriptors use.
    fn resolve(&mut self, function: &'static str, table: &BoundTable, uses: &mut Vec<Use>, work: &mut InFlight) {
        let Some(Parameter::Table(ranges)) = table.root.parameters.get(table.parameter) else { return };
        let size = self.descriptors.desc(table.heap).map_or(0, |desc| desc.count);
        for range in ranges {
            // What a shader uses of a range without a limit is not known.
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
                uses.extend(resource.map(|(resource, region)| Use { resource, region, state }));
            }
        }
    }

    /// Runs the submissions that no fence holds back.
    fn advance(&mut self) {
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
        let mut touched: HashSet<Id> = HashSet::new();
        let mut accesses: HashSet<(Id, Region, bool)> = HashSet::new();
        for Recorded { command, caller } in commands {
            self.caller = *caller;
            match command {
                Command::UavBarrier(None) => unordered.clear(),
                Command::UavBarrier(Some(resource)) => _ = unordered.remove(resource),
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
                    for Use { resource, region, state } in uses {
                        touched.insert(*resource);
                        accesses.insert((*resource, region.clone(), state.writes()));
                        if *state == State::UNORDERED_ACCESS {
                            if unordered.get(resource).is_some_and(|earlier| earlier.iter().any(|r| r.overlaps(region)))
                            {
                                let text = format!("{} is used again", self.label(*resource));
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
