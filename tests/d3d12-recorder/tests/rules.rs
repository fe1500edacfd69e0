//! Every rule is found where calls break it, and correct calls break none.

use std::collections::HashSet;

use d3d12_recorder::descriptors::{HeapDesc, View};
use d3d12_recorder::layouts::{Access, EnhancedBarrier, Layout, Side, Sync};
use d3d12_recorder::recorder::enhanced::Subresources;
use d3d12_recorder::recorder::{HeapRange, Memory, ObjectKind, Recorder, ResourceDesc, Use};
use d3d12_recorder::regions::Region;
use d3d12_recorder::root_signature::{DescriptorKind, Parameter, Range, RootSignature};
use d3d12_recorder::rules::Rule;
use d3d12_recorder::states::{BarrierPart, ListKind, State};
use d3d12_recorder::timeline::Id;

const COMMON: State = State::COMMON;
const WRITE: State = State::UNORDERED_ACCESS;
const READ: State = State::NON_PIXEL_SHADER_RESOURCE;

/// Sides of enhanced barriers of the texture.
const ANY: Side = Side { sync: Sync::ALL, access: Access::COMMON, layout: Layout::COMMON };
const WRITTEN: Side =
    Side { sync: Sync::COMPUTE_SHADING, access: Access::UNORDERED_ACCESS, layout: Layout::UNORDERED_ACCESS };
const READ_BY_SHADERS: Side =
    Side { sync: Sync::COMPUTE_SHADING, access: Access::SHADER_RESOURCE, layout: Layout::SHADER_RESOURCE };
const NOTHING: Side = Side { sync: Sync::NONE, access: Access::NO_ACCESS, layout: Layout::UNDEFINED };

/// A side of an enhanced barrier of a buffer.
const fn of_buffer(sync: Sync, access: Access) -> Side {
    Side { sync, access, layout: Layout::UNDEFINED }
}
const COPIED_TO: Side = of_buffer(Sync::COPY, Access::COPY_DEST);
const COPIED_FROM: Side = of_buffer(Sync::COPY, Access::COPY_SOURCE);
const BUFFER_WRITTEN: Side = of_buffer(Sync::COMPUTE_SHADING, Access::UNORDERED_ACCESS);

/// Addresses of the descriptor heap, for the processor and for shaders, and its descriptors.
const CPU: u64 = 0x1000;
const GPU: u64 = 0x9000;
const STEP: u64 = 32;
const COUNT: u32 = 8;
/// Address of the buffer for shaders.
const BUFFER: u64 = 0x10_0000;
const BYTES: u64 = 4096;

/// A device with a direct queue, and a list that could dispatch at once.
struct Scene {
    recorder: Recorder,
    queue: Id,
    fence: Id,
    signalled: u64,
    allocator: Id,
    list: Id,
    buffer: Id,
    texture: Id,
    upload: Id,
    readback: Id,
    heap: Id,
    root: Id,
    pipeline: Id,
}

fn resource(is_buffer: bool, memory: Memory, state: State) -> ResourceDesc {
    ResourceDesc {
        is_buffer,
        bytes: BYTES,
        shape: [1; 3],
        memory,
        is_simultaneous: false,
        allowed: WRITE,
        state,
        placed: None,
        layout: None,
        address: None,
    }
}

impl Scene {
    fn new() -> Self {
        let mut recorder = Recorder::default();
        let mut create = |kind| recorder.create(kind, format!("{kind:?}"), None);
        let [queue, fence] = [ObjectKind::Queue, ObjectKind::Fence].map(&mut create);
        let [allocator, list] = [ObjectKind::Allocator, ObjectKind::List].map(&mut create);
        let [buffer, texture, upload, readback] = [ObjectKind::Resource; 4].map(&mut create);
        let [heap, root, pipeline] =
            [ObjectKind::DescriptorHeap, ObjectKind::RootSignature, ObjectKind::Pipeline].map(&mut create);
        recorder.create_queue(queue, ListKind::Direct);
        recorder.create_fence(fence, 0);
        recorder.create_allocator(allocator, ListKind::Direct);
        recorder.create_list(list, ListKind::Direct, Some(allocator), None);
        let of_buffer = ResourceDesc { address: Some(BUFFER), ..resource(true, Memory::Default, COMMON) };
        recorder.create_resource(buffer, of_buffer);
        recorder
            .create_resource(texture, ResourceDesc { shape: [2, 1, 1], ..resource(false, Memory::Default, COMMON) });
        recorder.create_resource(upload, resource(true, Memory::Upload, State(0xac3)));
        recorder.create_resource(readback, resource(true, Memory::Readback, State::COPY_DEST));
        let desc = HeapDesc { cpu: CPU, gpu: Some(GPU), step: STEP, count: COUNT, has_samplers: false };
        recorder.create_descriptor_heap(heap, desc);
        let range = |kind, offset| Range { kind, count: Some(1), offset };
        let parameters = vec![
            Parameter::Table(vec![range(DescriptorKind::Srv, 0), range(DescriptorKind::Uav, 1)]),
            Parameter::Constants(2),
            Parameter::Descriptor(DescriptorKind::Cbv),
            Parameter::Descriptor(DescriptorKind::Srv),
            Parameter::Descriptor(DescriptorKind::Uav),
        ];
        recorder.create_root_signature(root, RootSignature { parameters });
        recorder.create_pipeline(pipeline, Some(root));
        let mut scene = Self {
            recorder,
            queue,
            fence,
            signalled: 0,
            allocator,
            list,
            buffer,
            texture,
            upload,
            readback,
            heap,
            root,
            pipeline,
        };
        scene.view(0, DescriptorKind::Srv, scene.texture);
        scene.view(1, DescriptorKind::Uav, scene.buffer);
        scene
    }

    fn view(&mut self, index: u64, kind: DescriptorKind, resource: Id) {
        let view = View { kind, resource: Some((resource, Region::All)) };
        self.recorder.write_view("view", CPU + index * STEP, view);
    }

    /// Sets the pipeline and every root argument that a dispatch needs, except the parameter `without`.
    fn bind(&mut self, without: Option<u32>) {
        let (list, r) = (self.list, &mut self.recorder);
        r.set_heaps(list, vec![self.heap]);
        r.set_root(list, self.root);
        r.set_pipeline(list, self.pipeline);
        if without != Some(0) {
            r.set_table(list, 0, GPU);
        }
        if without != Some(1) {
            r.set_constants(list, 1, 0, 2);
        }
        let kinds = [(2, DescriptorKind::Cbv), (3, DescriptorKind::Srv), (4, DescriptorKind::Uav)];
        for (parameter, kind) in kinds.into_iter().filter(|(parameter, _)| without != Some(*parameter)) {
            // Each part of the buffer is used in one way only, as far as this test goes.
            let address = if kind == DescriptorKind::Uav { BUFFER } else { BUFFER + BYTES / 2 };
            r.set_root_view(list, "root view", parameter, kind, address);
        }
    }

    /// A dispatch that only reads and writes by its table.
    fn dispatch_table(&mut self) {
        self.dispatch_table_from(0);
    }

    /// The same with a table that starts at a descriptor.
    fn dispatch_table_from(&mut self, first: u64) {
        let parameters = vec![self.table_parameter()];
        let root = self.recorder.create(ObjectKind::RootSignature, "root", None);
        self.recorder.create_root_signature(root, RootSignature { parameters });
        let pipeline = self.recorder.create(ObjectKind::Pipeline, "pipeline", None);
        self.recorder.create_pipeline(pipeline, Some(root));
        let list = self.list;
        self.recorder.set_heaps(list, vec![self.heap]);
        self.recorder.set_root(list, root);
        self.recorder.set_pipeline(list, pipeline);
        self.recorder.set_table(list, 0, GPU + first * STEP);
        self.recorder.dispatch(list);
    }

    fn table_parameter(&self) -> Parameter {
        let range = |kind, offset| Range { kind, count: Some(1), offset };
        Parameter::Table(vec![range(DescriptorKind::Srv, 0), range(DescriptorKind::Uav, 1)])
    }

    fn barrier(&mut self, resource: Id, states: (State, State)) {
        self.recorder.transition(self.list, resource, None, states, BarrierPart::Whole);
    }

    /// An enhanced barrier of all of a texture.
    fn enhanced(&mut self, resource: Id, before: Side, after: Side) {
        let barrier = EnhancedBarrier { before, after };
        self.recorder.texture_barrier(self.list, resource, &Subresources::All, barrier, false);
    }

    /// An enhanced barrier of a buffer.
    fn enhanced_of_buffer(&mut self, resource: Id, before: Side, after: Side) {
        self.recorder.buffer_barrier(self.list, resource, (0, u64::MAX), EnhancedBarrier { before, after });
    }

    /// A command that uses the texture.
    fn use_texture(&mut self, state: State) {
        let one = Use::new(self.texture, Region::All, state);
        self.recorder.work(self.list, "use", ListKind::Compute, vec![one], &[]);
    }

    fn copy(&mut self, to: Id, from: Id) {
        self.recorder.copy_buffer(self.list, (to, 0), (from, 0), BYTES);
    }

    fn submit(&mut self) {
        self.recorder.close(self.list);
        self.recorder.execute(self.queue, &[self.list]);
        self.signalled += 1;
        self.recorder.signal(self.queue, self.fence, self.signalled);
    }

    fn wait(&mut self) {
        self.recorder.observe(self.fence, self.signalled);
    }

    fn reset(&mut self) {
        self.recorder.reset_allocator(self.allocator);
        self.recorder.reset_list(self.list, self.allocator, None);
    }

    /// A second queue with an open list.
    fn other_queue(&mut self, kind: ListKind) -> (Id, Id) {
        let r = &mut self.recorder;
        let [queue, allocator, list] =
            [ObjectKind::Queue, ObjectKind::Allocator, ObjectKind::List].map(|kind| r.create(kind, "other", None));
        r.create_queue(queue, kind);
        r.create_allocator(allocator, kind);
        r.create_list(list, kind, Some(allocator), None);
        (queue, list)
    }

    fn new_resource(&mut self, desc: ResourceDesc) -> Id {
        let id = self.recorder.create(ObjectKind::Resource, "new", None);
        self.recorder.create_resource(id, desc);
        id
    }

    /// Two resources in the same bytes of a heap.
    fn aliases(&mut self, desc: &ResourceDesc) -> [Id; 2] {
        let heap = self.recorder.create(ObjectKind::Heap, "heap", None);
        let placed = Some(HeapRange { heap, bytes: 0..BYTES });
        [(); 2].map(|()| self.new_resource(ResourceDesc { placed: placed.clone(), ..desc.clone() }))
    }

    /// A render target in a heap.
    fn placed_target(&mut self) -> Id {
        let allowed = State::RENDER_TARGET;
        self.aliases(&ResourceDesc { allowed, ..resource(false, Memory::Default, allowed) })[0]
    }

    /// A draw to a render target, or another command that writes it.
    fn draw(&mut self, target: Id, initialises: bool) {
        let one = Use { initialises, ..Use::new(target, Region::All, State::RENDER_TARGET) };
        self.recorder.work(self.list, "draw", ListKind::Direct, vec![one], &[]);
    }

    fn rules(&mut self) -> Vec<Rule> {
        self.recorder.take_findings().into_iter().map(|finding| finding.rule).collect()
    }
}

type Break = fn(&mut Scene);

/// Calls that break each rule.
#[rustfmt::skip]
const BREAKS: &[(Rule, Break)] = &[
    (Rule::BarrierBeforeMismatch, |s| { s.barrier(s.texture, (READ, WRITE)); s.submit(); }),
    (Rule::BarrierMatchingStates, |s| s.barrier(s.texture, (COMMON, COMMON))),
    (Rule::BarrierInvalidCombination, |s| s.barrier(s.texture, (COMMON, State(WRITE.0 | READ.0)))),
    (Rule::BarrierMissingFlag, |s| s.barrier(s.texture, (COMMON, State::RENDER_TARGET))),
    (Rule::BarrierInvalidHeap, |s| s.barrier(s.upload, (State(0xac3), State::COPY_SOURCE))),
    (Rule::BarrierInvalidListType, |s| {
        let (_, list) = s.other_queue(ListKind::Compute);
        s.recorder.transition(list, s.texture, None, (COMMON, State::PIXEL_SHADER_RESOURCE), BarrierPart::Whole);
    }),
    (Rule::BarrierInvalidSubresource, |s| {
        s.recorder.transition(s.list, s.texture, Some(2), (COMMON, READ), BarrierPart::Whole);
    }),
    (Rule::BarrierUnmatchedEnd, |s| {
        s.recorder.transition(s.list, s.texture, None, (COMMON, READ), BarrierPart::End);
        s.submit();
    }),
    (Rule::BarrierUnmatchedBegin, |s| {
        s.recorder.transition(s.list, s.texture, None, (COMMON, READ), BarrierPart::Begin);
        s.dispatch_table();
        s.submit();
    }),
    (Rule::BarrierInteropState, |s| {
        s.barrier(s.texture, (COMMON, READ));
        s.enhanced(s.texture, ANY, WRITTEN);
        s.submit();
    }),
    (Rule::BarrierInteropLayout, |s| {
        s.enhanced(s.texture, ANY, WRITTEN);
        s.barrier(s.texture, (WRITE, READ));
        s.submit();
    }),
    (Rule::BarrierLayoutMismatch, |s| { s.enhanced(s.texture, WRITTEN, READ_BY_SHADERS); s.submit(); }),
    (Rule::BarrierAccessMismatch, |s| {
        s.copy(s.buffer, s.upload);
        s.enhanced_of_buffer(s.buffer, BUFFER_WRITTEN, COPIED_FROM);
        s.submit();
    }),
    (Rule::BarrierIncompatibleValues, |s| s.enhanced(s.texture, ANY, Side { sync: Sync::COPY, ..WRITTEN })),
    (Rule::BarrierType, |s| s.enhanced(s.buffer, ANY, WRITTEN)),
    (Rule::BarrierSubresources, |s| {
        let barrier = EnhancedBarrier { before: ANY, after: WRITTEN };
        s.recorder.texture_barrier(s.list, s.texture, &Subresources::One(2), barrier, false);
    }),
    (Rule::BarrierBufferRange, |s| {
        let barrier = EnhancedBarrier { before: COPIED_TO, after: COPIED_FROM };
        s.recorder.buffer_barrier(s.list, s.buffer, (1, BYTES - 1), barrier);
    }),
    (Rule::LayoutIncompatible, |s| { s.enhanced(s.texture, ANY, WRITTEN); s.use_texture(READ); s.submit(); }),
    (Rule::AccessWithoutBarrier, |s| {
        s.enhanced_of_buffer(s.buffer, COPIED_TO, COPIED_FROM);
        s.copy(s.buffer, s.upload);
        s.submit();
    }),
    (Rule::EnhancedBarrierListType, |s| {
        let (_, list) = s.other_queue(ListKind::Compute);
        let after = Side { sync: Sync::PIXEL_SHADING, ..READ_BY_SHADERS };
        let barrier = EnhancedBarrier { before: ANY, after };
        s.recorder.texture_barrier(list, s.texture, &Subresources::All, barrier, false);
    }),
    (Rule::InvalidState, |s| { s.barrier(s.texture, (COMMON, WRITE)); s.dispatch_table(); s.submit(); }),
    (Rule::AllocatorRecording, |s| s.recorder.reset_allocator(s.allocator)),
    (Rule::AllocatorContention, |s| {
        let list = s.recorder.create(ObjectKind::List, "second", None);
        s.recorder.create_list(list, ListKind::Direct, Some(s.allocator), None);
    }),
    (Rule::AllocatorReset, |s| {
        s.recorder.close(s.list);
        s.recorder.reset_allocator(s.allocator);
        s.recorder.execute(s.queue, &[s.list]);
    }),
    (Rule::AllocatorInUse, |s| { s.submit(); s.recorder.reset_allocator(s.allocator); }),
    (Rule::AllocatorType, |s| {
        s.recorder.close(s.list);
        let list = s.recorder.create(ObjectKind::List, "second", None);
        s.recorder.create_list(list, ListKind::Compute, Some(s.allocator), None);
    }),
    (Rule::ListClosed, |s| { s.recorder.close(s.list); s.copy(s.buffer, s.upload); }),
    (Rule::ListOpen, |s| s.recorder.reset_list(s.list, s.allocator, None)),
    (Rule::ListInUse, |s| { s.submit(); s.recorder.execute(s.queue, &[s.list]); }),
    (Rule::ExecuteOpenList, |s| s.recorder.execute(s.queue, &[s.list])),
    (Rule::ExecuteListType, |s| {
        let (_, list) = s.other_queue(ListKind::Compute);
        s.recorder.close(list);
        s.recorder.execute(s.queue, &[list]);
    }),
    (Rule::DeletedInUse, |s| { s.copy(s.buffer, s.upload); s.submit(); s.recorder.release(s.upload); }),
    (Rule::EvictedInUse, |s| { s.copy(s.buffer, s.upload); s.submit(); s.recorder.evict("Evict", s.buffer); }),
    (Rule::NotResident, |s| { s.recorder.evict("Evict", s.buffer); s.copy(s.buffer, s.upload); s.submit(); }),
    (Rule::RootSignatureNotSet, |s| { s.recorder.set_pipeline(s.list, s.pipeline); s.recorder.dispatch(s.list); }),
    (Rule::RootSignatureMismatch, |s| {
        let other = s.recorder.create(ObjectKind::RootSignature, "other", None);
        s.recorder.create_root_signature(other, RootSignature { parameters: Vec::new() });
        s.recorder.set_pipeline(s.list, s.pipeline);
        s.recorder.set_root(s.list, other);
        s.recorder.dispatch(s.list);
    }),
    (Rule::PipelineNotSet, |s| { s.recorder.set_root(s.list, s.root); s.recorder.dispatch(s.list); }),
    (Rule::TableNotSet, |s| { s.bind(Some(0)); s.recorder.dispatch(s.list); }),
    (Rule::RootConstantsNotSet, |s| { s.bind(Some(1)); s.recorder.set_constants(s.list, 1, 0, 1); s.recorder.dispatch(s.list); }),
    (Rule::RootCbvNotSet, |s| { s.bind(Some(2)); s.recorder.dispatch(s.list); }),
    (Rule::RootSrvNotSet, |s| { s.bind(Some(3)); s.recorder.dispatch(s.list); }),
    (Rule::RootUavNotSet, |s| { s.bind(Some(4)); s.recorder.dispatch(s.list); }),
    (Rule::SetHeapInvalid, |s| {
        let hidden = s.recorder.create(ObjectKind::DescriptorHeap, "hidden", None);
        let desc = HeapDesc { cpu: 0x5000, gpu: None, step: STEP, count: 1, has_samplers: false };
        s.recorder.create_descriptor_heap(hidden, desc);
        s.recorder.set_heaps(s.list, vec![hidden]);
    }),
    (Rule::SetTableInvalid, |s| { s.recorder.set_root(s.list, s.root); s.recorder.set_table(s.list, 0, GPU); }),
    (Rule::SetConstantInvalid, |s| { s.recorder.set_root(s.list, s.root); s.recorder.set_constants(s.list, 1, 1, 2); }),
    (Rule::SetRootCbvInvalid, |s| {
        s.recorder.set_root(s.list, s.root);
        s.recorder.set_root_view(s.list, "root view", 3, DescriptorKind::Cbv, BUFFER);
    }),
    (Rule::SetRootSrvInvalid, |s| {
        s.recorder.set_root(s.list, s.root);
        s.recorder.set_root_view(s.list, "root view", 3, DescriptorKind::Srv, BUFFER + BYTES);
    }),
    (Rule::SetRootUavInvalid, |s| {
        s.recorder.set_root(s.list, s.root);
        s.recorder.set_root_view(s.list, "root view", 4, DescriptorKind::Uav, 0);
    }),
    (Rule::TableOutOfBounds, |s| {
        s.view(u64::from(COUNT - 1), DescriptorKind::Srv, s.texture);
        s.dispatch_table_from(u64::from(COUNT - 1));
        s.submit();
    }),
    (Rule::DescriptorUninitialized, |s| { s.view(6, DescriptorKind::Srv, s.texture); s.dispatch_table_from(6); s.submit(); }),
    (Rule::DescriptorTypeMismatch, |s| {
        s.view(1, DescriptorKind::Srv, s.buffer);
        s.dispatch_table();
        s.submit();
    }),
    (Rule::DescriptorHandleInvalid, |s| s.view(u64::from(COUNT), DescriptorKind::Srv, s.texture)),
    (Rule::SrvOutOfBounds, |s| {
        let view = View { kind: DescriptorKind::Srv, resource: Some((s.buffer, Region::Bytes(0..BYTES + 1))) };
        s.recorder.write_view("view", CPU, view);
    }),
    (Rule::UavOutOfBounds, |s| {
        let part = Region::Subresources { levels: 2..3, slices: 0..1 };
        s.recorder.write_view("view", CPU, View { kind: DescriptorKind::Uav, resource: Some((s.texture, part)) });
    }),
    (Rule::CbvOutOfBounds, |s| {
        let view = View { kind: DescriptorKind::Cbv, resource: Some((s.buffer, Region::Bytes(BYTES..BYTES + 256))) };
        s.recorder.write_view("view", CPU, view);
    }),
    (Rule::CopySourceOutOfBounds, |s| s.recorder.copy_buffer(s.list, (s.buffer, 0), (s.upload, BYTES), 1)),
    (Rule::CopyDestinationOutOfBounds, |s| s.recorder.copy_buffer(s.list, (s.buffer, u64::MAX), (s.upload, 0), 1)),
    (Rule::DiscardOutOfBounds, |s| s.recorder.discard(s.list, s.texture, 1..3, true)),
    (Rule::MapInvalidHeap, |s| s.recorder.map(s.buffer, 0, None)),
    (Rule::MapInvalidSubresource, |s| s.recorder.map(s.upload, 1, None)),
    (Rule::MapInvalidRange, |s| s.recorder.map(s.readback, 0, Some(0..BYTES + 1))),
    (Rule::UnmapInvalidRange, |s| { s.recorder.map(s.upload, 0, Some(0..0)); s.recorder.unmap(s.upload, Some(0..BYTES + 1)); }),
    (Rule::UnmapNotMapped, |s| s.recorder.unmap(s.upload, None)),
    (Rule::LiveDevice, |s| { s.recorder.create(ObjectKind::Device, "device", None); s.recorder.report_live(); }),
    (Rule::LiveQueue, |s| s.recorder.report_live()),
    (Rule::LiveAllocator, |s| s.recorder.report_live()),
    (Rule::LivePipeline, |s| s.recorder.report_live()),
    (Rule::LiveList, |s| s.recorder.report_live()),
    (Rule::LiveResource, |s| s.recorder.report_live()),
    (Rule::LiveDescriptorHeap, |s| s.recorder.report_live()),
    (Rule::LiveRootSignature, |s| s.recorder.report_live()),
    (Rule::LiveHeap, |s| { s.recorder.create(ObjectKind::Heap, "heap", None); s.recorder.report_live(); }),
    (Rule::LiveFence, |s| s.recorder.report_live()),
    (Rule::LiveQueryHeap, |s| { s.recorder.create(ObjectKind::QueryHeap, "queries", None); s.recorder.report_live(); }),
    (Rule::UavWithoutBarrier, |s| { s.dispatch_table(); s.dispatch_table(); s.submit(); }),
    (Rule::QueuesNotOrdered, |s| {
        s.copy(s.buffer, s.upload);
        s.submit();
        let (queue, list) = s.other_queue(ListKind::Copy);
        s.recorder.copy_buffer(list, (s.readback, 0), (s.buffer, 0), BYTES);
        s.recorder.close(list);
        s.recorder.execute(queue, &[list]);
    }),
    (Rule::DescriptorInUse, |s| { s.dispatch_table(); s.submit(); s.view(1, DescriptorKind::Uav, s.buffer); }),
    (Rule::MapInUse, |s| { s.copy(s.readback, s.buffer); s.submit(); s.recorder.map(s.readback, 0, None); }),
    (Rule::AliasingBarrierMissing, |s| {
        let [one, other] = s.aliases(&resource(true, Memory::Default, COMMON));
        s.copy(one, s.upload);
        s.copy(other, s.upload);
        s.submit();
    }),
    (Rule::PlacedNotInitialized, |s| { let target = s.placed_target(); s.draw(target, false); s.submit(); }),
    (Rule::CommandListType, |s| {
        let (_, list) = s.other_queue(ListKind::Copy);
        s.recorder.dispatch(list);
    }),
];

#[test]
fn calls_that_break_a_rule_are_found_and_every_rule_is_tried() {
    for (rule, breaks) in BREAKS {
        let mut scene = Scene::new();
        assert_eq!(scene.rules(), [], "the scene itself");
        breaks(&mut scene);
        let found = scene.rules();
        assert!(found.contains(rule), "{rule:?}: {found:?}");
        // Live objects are reported together, and a mismatch of root signatures leaves arguments unset.
        let allowed = |other: &Rule| {
            format!("{other:?}").starts_with("Live")
                || [Rule::BarrierInvalidListType, Rule::EnhancedBarrierListType].contains(rule)
                || *rule == Rule::CommandListType
                || other == rule
        };
        assert!(found.iter().all(allowed), "{rule:?} alone: {found:?}");
    }
    let tried: HashSet<Rule> = BREAKS.iter().map(|(rule, _)| *rule).collect();
    let missing: Vec<_> = Rule::ALL.iter().filter(|rule| !tried.contains(rule)).collect();
    assert!(missing.is_empty(), "rules without a case: {missing:?}");
}

#[test]
fn correct_frames_break_no_rule() {
    let mut scene = Scene::new();
    for _ in 0..3 {
        scene.copy(scene.buffer, scene.upload);
        scene.barrier(scene.buffer, (State::COPY_DEST, WRITE));
        scene.dispatch_table();
        scene.recorder.uav_barrier(scene.list, Some(scene.buffer));
        scene.dispatch_table();
        scene.recorder.uav_barrier(scene.list, None);
        scene.dispatch_table();
        scene.barrier(scene.buffer, (WRITE, State::COPY_SOURCE));
        scene.copy(scene.readback, scene.buffer);
        scene.submit();
        scene.wait();
        scene.recorder.map(scene.readback, 0, None);
        scene.recorder.unmap(scene.readback, Some(0..0));
        scene.view(1, DescriptorKind::Uav, scene.buffer);
        scene.reset();
    }
    assert_eq!(scene.rules(), []);
}

#[test]
fn aliasing_barriers_and_submissions_separate_uses_of_the_same_memory() {
    for (is_before_named, is_after_named) in [(false, false), (false, true), (true, false), (true, true)] {
        let mut scene = Scene::new();
        let [one, other] = scene.aliases(&resource(true, Memory::Default, COMMON));
        scene.copy(one, scene.upload);
        let (before, after) = (is_before_named.then_some(one), is_after_named.then_some(other));
        scene.recorder.aliasing_barrier(scene.list, before, after);
        scene.copy(other, scene.upload);
        scene.submit();
        scene.wait();
        scene.reset();
        scene.copy(one, scene.upload);
        scene.submit();
        assert_eq!(scene.rules(), []);
    }
}

#[test]
fn an_aliasing_barrier_of_other_resources_separates_nothing() {
    let mut scene = Scene::new();
    let [one, other] = scene.aliases(&resource(true, Memory::Default, COMMON));
    scene.copy(one, scene.upload);
    scene.recorder.aliasing_barrier(scene.list, Some(other), Some(one));
    scene.copy(other, scene.upload);
    scene.submit();
    assert_eq!(scene.rules(), [Rule::AliasingBarrierMissing]);
}

#[test]
fn resources_side_by_side_in_a_heap_need_no_aliasing_barrier() {
    let mut scene = Scene::new();
    let heap = scene.recorder.create(ObjectKind::Heap, "heap", None);
    let [one, other] = [0..BYTES, BYTES..2 * BYTES].map(|bytes| {
        let placed = Some(HeapRange { heap, bytes });
        scene.new_resource(ResourceDesc { placed, ..resource(true, Memory::Default, COMMON) })
    });
    scene.copy(one, scene.upload);
    scene.copy(other, scene.upload);
    scene.submit();
    assert_eq!(scene.rules(), []);
}

#[test]
fn a_placed_target_is_initialised_once_and_again_after_another_resource_used_its_memory() {
    let mut scene = Scene::new();
    let allowed = State::RENDER_TARGET;
    let [target, other] = scene.aliases(&ResourceDesc { allowed, ..resource(false, Memory::Default, allowed) });
    scene.draw(target, true);
    scene.draw(target, false);
    scene.recorder.aliasing_barrier(scene.list, None, Some(other));
    scene.recorder.discard(scene.list, other, 0..1, true);
    scene.draw(other, false);
    scene.recorder.aliasing_barrier(scene.list, None, Some(target));
    scene.draw(target, true);
    scene.submit();
    assert_eq!(scene.rules(), []);
    scene.wait();
    scene.reset();
    scene.draw(other, false);
    scene.submit();
    assert_eq!(scene.rules(), [Rule::PlacedNotInitialized]);
}

#[test]
fn a_discard_of_rectangles_initialises_nothing() {
    let mut scene = Scene::new();
    let target = scene.placed_target();
    scene.recorder.discard(scene.list, target, 0..1, false);
    scene.submit();
    assert_eq!(scene.rules(), [Rule::PlacedNotInitialized]);
}

#[test]
fn reserved_resources_have_the_memory_of_their_tiles() {
    const TILE: u64 = 64 * 1024;
    let mut scene = Scene::new();
    let heap = scene.recorder.create(ObjectKind::Heap, "heap", None);
    let [one, other] = [(); 2].map(|()| scene.new_resource(resource(true, Memory::Default, COMMON)));
    let tile = |number: u64| Some(HeapRange { heap, bytes: TILE * number..TILE * (number + 1) });
    scene.recorder.map_tiles(scene.queue, one, vec![(0, tile(0)), (1, tile(1))]);
    scene.recorder.map_tiles(scene.queue, other, vec![(0, tile(1)), (1, tile(2))]);
    let use_both = |scene: &mut Scene| {
        scene.copy(one, scene.upload);
        scene.copy(other, scene.upload);
        scene.submit();
        scene.wait();
        scene.reset();
        scene.rules()
    };
    assert_eq!(use_both(&mut scene), [Rule::AliasingBarrierMissing]);
    scene.recorder.map_tiles(scene.queue, other, vec![(0, None)]);
    assert_eq!(use_both(&mut scene), []);
    scene.recorder.copy_tile_mappings(scene.queue, other, one, vec![(0, 1)]);
    assert_eq!(use_both(&mut scene), [Rule::AliasingBarrierMissing]);
    // Tile 5 has no memory.
    scene.recorder.copy_tile_mappings(scene.queue, other, one, vec![(0, 5)]);
    assert_eq!(use_both(&mut scene), []);
}

#[test]
fn tiles_change_when_the_queue_reaches_the_call() {
    let mut scene = Scene::new();
    let heap = scene.recorder.create(ObjectKind::Heap, "heap", None);
    let [one, other] = [(); 2].map(|()| scene.new_resource(resource(true, Memory::Default, COMMON)));
    let tile = Some(HeapRange { heap, bytes: 0..64 * 1024 });
    scene.recorder.map_tiles(scene.queue, one, vec![(0, tile.clone())]);
    scene.copy(one, scene.upload);
    scene.copy(other, scene.upload);
    let gate = scene.recorder.create(ObjectKind::Fence, "gate", None);
    scene.recorder.create_fence(gate, 0);
    scene.recorder.wait(scene.queue, gate, 1);
    scene.submit();
    // The queued copies use memory that only later is both resources'.
    scene.recorder.map_tiles(scene.queue, other, vec![(0, tile)]);
    scene.recorder.signal_by_host(gate, 1);
    assert_eq!(scene.rules(), []);
}

#[test]
fn the_state_of_a_resource_is_known_unless_a_queue_waits() {
    let mut scene = Scene::new();
    assert_eq!(scene.recorder.state_of(scene.texture), Some(COMMON));
    assert!(scene.recorder.is_open(scene.list));
    scene.barrier(scene.texture, (COMMON, READ));
    let gate = scene.recorder.create(ObjectKind::Fence, "gate", None);
    scene.recorder.create_fence(gate, 0);
    scene.recorder.wait(scene.queue, gate, 1);
    scene.submit();
    assert!(!scene.recorder.is_open(scene.list));
    assert_eq!(scene.recorder.state_of(scene.texture), None);
    scene.recorder.signal_by_host(gate, 1);
    assert_eq!(scene.recorder.state_of(scene.texture), Some(READ));
}

#[test]
fn correct_enhanced_barriers_break_no_rule() {
    let mut scene = Scene::new();
    for _ in 0..2 {
        scene.enhanced(scene.texture, ANY, WRITTEN);
        scene.use_texture(WRITE);
        scene.enhanced(scene.texture, WRITTEN, WRITTEN);
        scene.use_texture(WRITE);
        scene.enhanced(scene.texture, WRITTEN, READ_BY_SHADERS);
        scene.use_texture(READ);
        scene.enhanced(scene.texture, READ_BY_SHADERS, ANY);
        // Back in COMMON, the other kind of barrier may follow.
        scene.barrier(scene.texture, (COMMON, READ));
        scene.use_texture(READ);
        scene.barrier(scene.texture, (READ, COMMON));
        scene.copy(scene.buffer, scene.upload);
        scene.enhanced_of_buffer(scene.buffer, COPIED_TO, BUFFER_WRITTEN);
        scene.enhanced_of_buffer(scene.buffer, BUFFER_WRITTEN, COPIED_FROM);
        scene.copy(scene.readback, scene.buffer);
        scene.submit();
        scene.wait();
        scene.reset();
    }
    assert_eq!(scene.rules(), []);
}

#[test]
fn layouts_stay_between_submissions_and_each_subresource_has_its_own() {
    let mut scene = Scene::new();
    let (list, texture) = (scene.list, scene.texture);
    let to_written = EnhancedBarrier { before: ANY, after: WRITTEN };
    scene.recorder.texture_barrier(list, texture, &Subresources::One(1), to_written, false);
    scene.submit();
    scene.wait();
    scene.reset();
    let to_read = EnhancedBarrier { before: WRITTEN, after: READ_BY_SHADERS };
    let second = Subresources::Ranges { levels: 1..2, slices: 0..1, planes: 0..1 };
    scene.recorder.texture_barrier(list, texture, &second, to_read, false);
    let first = Subresources::Ranges { levels: 0..1, slices: 0..1, planes: 0..1 };
    scene.recorder.texture_barrier(list, texture, &first, to_written, false);
    scene.submit();
    assert_eq!(scene.rules(), []);
}

#[test]
fn a_resource_that_was_created_with_a_layout_is_in_it() {
    let mut scene = Scene::new();
    let layout = Some(Layout::UNORDERED_ACCESS);
    let texture = scene.new_resource(ResourceDesc { layout, ..resource(false, Memory::Default, COMMON) });
    scene.enhanced(texture, WRITTEN, READ_BY_SHADERS);
    scene.submit();
    assert_eq!(scene.rules(), []);
    scene.wait();
    scene.reset();
    let other = scene.new_resource(ResourceDesc { layout, ..resource(false, Memory::Default, COMMON) });
    scene.barrier(other, (WRITE, READ));
    scene.submit();
    assert_eq!(scene.rules(), [Rule::BarrierInteropLayout]);
}

#[test]
fn enhanced_barriers_separate_unordered_accesses_if_they_name_them() {
    for (before, found) in [(BUFFER_WRITTEN, None), (COPIED_TO, Some(Rule::UavWithoutBarrier))] {
        for is_global in [false, true] {
            let mut scene = Scene::new();
            let barrier = EnhancedBarrier { before, after: BUFFER_WRITTEN };
            scene.dispatch_table();
            match is_global {
                true => scene.recorder.global_barrier(scene.list, barrier),
                false => scene.recorder.buffer_barrier(scene.list, scene.buffer, (0, BYTES), barrier),
            }
            scene.dispatch_table();
            scene.submit();
            let rules = scene.rules();
            assert_eq!(rules.contains(&Rule::UavWithoutBarrier), found.is_some(), "{before:?}: {rules:?}");
        }
    }
}

#[test]
fn a_global_barrier_finishes_writes_of_buffers() {
    let mut scene = Scene::new();
    scene.copy(scene.buffer, scene.upload);
    scene.recorder.global_barrier(scene.list, EnhancedBarrier { before: COPIED_TO, after: COPIED_FROM });
    scene.copy(scene.readback, scene.buffer);
    scene.submit();
    assert_eq!(scene.rules(), []);
}

#[test]
fn split_enhanced_barriers_are_paired() {
    let split = |side: Side| Side { sync: Sync::SPLIT, ..side };
    let mut scene = Scene::new();
    scene.enhanced(scene.texture, ANY, split(WRITTEN));
    scene.enhanced(scene.texture, split(ANY), WRITTEN);
    scene.submit();
    assert_eq!(scene.rules(), []);
    scene.wait();
    scene.reset();
    scene.enhanced(scene.texture, split(WRITTEN), READ_BY_SHADERS);
    scene.submit();
    assert_eq!(scene.rules(), [Rule::BarrierUnmatchedEnd; 2], "one of each subresource");
}

#[test]
fn enhanced_barriers_take_the_place_of_aliasing_barriers_and_of_discards() {
    let written = Side { sync: Sync::RENDER_TARGET, access: Access::RENDER_TARGET, layout: Layout::RENDER_TARGET };
    let allowed = State::RENDER_TARGET;
    let desc = ResourceDesc { allowed, layout: Some(Layout::COMMON), ..resource(false, Memory::Default, COMMON) };
    for discards in [true, false] {
        let mut scene = Scene::new();
        let [one, other] = scene.aliases(&desc);
        let first = EnhancedBarrier { before: NOTHING, after: written };
        scene.recorder.texture_barrier(scene.list, one, &Subresources::All, first, true);
        scene.draw(one, false);
        scene.enhanced(one, written, NOTHING);
        let second = EnhancedBarrier { before: NOTHING, after: written };
        scene.recorder.texture_barrier(scene.list, other, &Subresources::All, second, discards);
        scene.draw(other, false);
        scene.submit();
        let expected: &[Rule] = if discards { &[] } else { &[Rule::PlacedNotInitialized] };
        assert_eq!(scene.rules(), expected);
    }
}

#[test]
fn queues_that_a_fence_orders_break_no_rule() {
    let mut scene = Scene::new();
    scene.copy(scene.buffer, scene.upload);
    scene.submit();
    let (queue, list) = scene.other_queue(ListKind::Copy);
    scene.recorder.wait(queue, scene.fence, scene.signalled);
    scene.recorder.copy_buffer(list, (scene.readback, 0), (scene.buffer, 0), BYTES);
    scene.recorder.close(list);
    scene.recorder.execute(queue, &[list]);
    assert_eq!(scene.rules(), []);
}

#[test]
fn an_event_that_is_set_completes_work_and_one_that_is_not_does_not() {
    for is_set in [true, false] {
        let mut scene = Scene::new();
        let (fence, value) = (scene.fence, 1);
        scene.recorder.set_completions(move || if is_set { vec![(fence, value)] } else { Vec::new() });
        scene.submit();
        scene.recorder.reset_allocator(scene.allocator);
        assert_eq!(scene.rules().is_empty(), is_set);
    }
}

#[test]
fn objects_of_a_removed_device_may_be_released() {
    let mut scene = Scene::new();
    scene.copy(scene.buffer, scene.upload);
    scene.submit();
    scene.recorder.remove_device();
    scene.recorder.release(scene.upload);
    assert_eq!(scene.rules(), []);
}

#[test]
fn a_kept_object_may_be_released_in_use_and_be_alive_at_the_end() {
    let mut scene = Scene::new();
    let back_buffer = scene.new_resource(resource(false, Memory::Default, COMMON));
    scene.recorder.keep(back_buffer);
    scene.barrier(back_buffer, (COMMON, WRITE));
    scene.submit();
    scene.recorder.release(back_buffer);
    assert_eq!(scene.rules(), []);
    scene.recorder.report_live();
    let texts: Vec<_> = scene.recorder.take_findings().into_iter().map(|finding| finding.text).collect();
    assert!(!texts.iter().any(|text| text.starts_with("new")), "{texts:?}");
}

#[test]
fn a_buffer_is_presented_in_common_when_its_queue_comes_to_it() {
    let target = State::RENDER_TARGET;
    let present = |is_back: bool, is_held: bool| {
        let mut scene = Scene::new();
        let buffer = scene.new_resource(ResourceDesc { allowed: target, ..resource(false, Memory::Default, COMMON) });
        if is_held {
            scene.recorder.wait(scene.queue, scene.fence, 1);
        }
        scene.barrier(buffer, (COMMON, target));
        scene.draw(buffer, false);
        if is_back {
            scene.barrier(buffer, (target, COMMON));
        }
        scene.recorder.close(scene.list);
        scene.recorder.execute(scene.queue, &[scene.list]);
        scene.recorder.present(scene.queue, buffer);
        scene.recorder.signal_by_host(scene.fence, 1);
        scene.rules()
    };
    for is_held in [false, true] {
        assert_eq!(present(true, is_held), []);
        assert_eq!(present(false, is_held), [Rule::InvalidState]);
    }
}

#[test]
fn a_buffer_is_presented_after_what_another_queue_writes_only_if_a_fence_orders_them() {
    for is_ordered in [true, false] {
        let mut scene = Scene::new();
        let buffer = scene.new_resource(resource(false, Memory::Default, COMMON));
        scene.copy(buffer, scene.upload);
        scene.barrier(buffer, (State::COPY_DEST, COMMON));
        scene.submit();
        let (queue, _) = scene.other_queue(ListKind::Direct);
        if is_ordered {
            scene.recorder.wait(queue, scene.fence, scene.signalled);
        }
        scene.recorder.present(queue, buffer);
        let expected: &[Rule] = if is_ordered { &[] } else { &[Rule::QueuesNotOrdered] };
        assert_eq!(scene.rules(), expected);
    }
}

/// Two dispatches: the first writes a texture, and the second writes or reads it after `between`.
fn dispatches(second: State, between: impl FnOnce(&mut Scene)) -> Vec<Rule> {
    let mut scene = Scene::new();
    let desc = ResourceDesc { state: WRITE, ..resource(false, Memory::Default, WRITE) };
    scene.texture = scene.new_resource(desc);
    scene.use_texture(WRITE);
    between(&mut scene);
    scene.use_texture(second);
    scene.submit();
    scene.rules()
}

#[test]
fn each_missing_barrier_between_dispatches_is_found() {
    let barrier = |states| move |s: &mut Scene| s.barrier(s.texture, states);
    assert_eq!(dispatches(WRITE, |_| {}), [Rule::UavWithoutBarrier], "written twice");
    let of_another = dispatches(WRITE, |s| s.recorder.uav_barrier(s.list, Some(s.buffer)));
    assert_eq!(of_another, [Rule::UavWithoutBarrier], "a barrier for something else");
    assert_eq!(dispatches(WRITE, |s| s.recorder.uav_barrier(s.list, Some(s.texture))), []);
    assert_eq!(dispatches(WRITE, |s| s.recorder.uav_barrier(s.list, None)), []);
    assert_eq!(dispatches(READ, |_| {}), [Rule::InvalidState], "read after it was written");
    assert_eq!(dispatches(READ, barrier((WRITE, READ))), []);
    assert_eq!(dispatches(WRITE, barrier((WRITE, READ))), [Rule::InvalidState], "written as it is to be read");
    let twice = dispatches(READ, |s| (0..2).for_each(|_| s.barrier(s.texture, (WRITE, READ))));
    assert_eq!(twice, [Rule::BarrierBeforeMismatch], "a barrier from a state that it is not in");
}

#[test]
fn a_finding_has_the_address_of_the_code_that_recorded_the_command() {
    let mut scene = Scene::new();
    scene.recorder.set_caller(1);
    scene.barrier(scene.texture, (READ, WRITE));
    scene.recorder.set_caller(2);
    scene.submit();
    let callers: Vec<_> = scene.recorder.take_findings().into_iter().map(|finding| finding.caller).collect();
    assert_eq!(callers, [1, 1], "one of each subresource");
}
