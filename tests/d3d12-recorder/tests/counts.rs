//! The counts of executed work are those of the calls.

use d3d12_recorder::counts::{Counts, to_json};
use d3d12_recorder::descriptors::{HeapDesc, View};
use d3d12_recorder::recorder::{Memory, ObjectKind, Recorder, ResourceDesc};
use d3d12_recorder::regions::Region;
use d3d12_recorder::root_signature::{DescriptorKind, Parameter, Range, RootSignature};
use d3d12_recorder::states::{BarrierPart, ListKind, State};
use d3d12_recorder::timeline::Id;

const BYTES: u64 = 4096;
const CPU: u64 = 0x1000;
const GPU: u64 = 0x9000;
const STEP: u64 = 32;

/// A queue, and a list that dispatches with a view to read 1024 bytes of a buffer and a view to write all of another.
struct Scene {
    recorder: Recorder,
    queue: Id,
    allocator: Id,
    list: Id,
    buffers: [Id; 2],
}

impl Scene {
    fn new() -> Self {
        let mut recorder = Recorder::default();
        let mut create = |kind| recorder.create(kind, format!("{kind:?}"), None);
        let kinds = [ObjectKind::Queue, ObjectKind::Allocator, ObjectKind::List, ObjectKind::DescriptorHeap];
        let [queue, allocator, list, heap] = kinds.map(&mut create);
        let [root, pipeline] = [ObjectKind::RootSignature, ObjectKind::Pipeline].map(&mut create);
        let buffers = [ObjectKind::Resource; 2].map(create);
        recorder.create_queue(queue, ListKind::Direct);
        recorder.create_allocator(allocator, ListKind::Direct);
        recorder.create_list(list, ListKind::Direct, Some(allocator), None);
        for buffer in buffers {
            let desc = ResourceDesc {
                is_buffer: true,
                bytes: BYTES,
                shape: [1; 3],
                memory: Memory::Default,
                is_simultaneous: false,
                allowed: State::UNORDERED_ACCESS,
                state: State::COMMON,
                placed: None,
                layout: None,
                address: None,
            };
            recorder.create_resource(buffer, desc);
        }
        let desc = HeapDesc { cpu: CPU, gpu: Some(GPU), step: STEP, count: 2, has_samplers: false };
        recorder.create_descriptor_heap(heap, desc);
        let range = |kind, offset| Range { kind, count: Some(1), offset };
        let table = Parameter::Table(vec![range(DescriptorKind::Srv, 0), range(DescriptorKind::Uav, 1)]);
        recorder.create_root_signature(root, RootSignature { parameters: vec![table] });
        recorder.create_pipeline(pipeline, Some(root));
        let views = [(DescriptorKind::Srv, Region::Bytes(0..1024)), (DescriptorKind::Uav, Region::All)];
        for ((i, (kind, region)), buffer) in (0..).zip(views).zip(buffers) {
            recorder.write_view("view", CPU + i * STEP, View { kind, resource: Some((buffer, region)) });
        }
        recorder.set_heaps(list, vec![heap]);
        recorder.set_root(list, root);
        recorder.set_pipeline(list, pipeline);
        recorder.set_table(list, 0, GPU);
        Self { recorder, queue, allocator, list, buffers }
    }

    /// A call that records a UAV barrier and a transition of the written buffer.
    fn barriers(&mut self) {
        let (list, written) = (self.list, self.buffers[1]);
        self.recorder.barrier_call(list);
        self.recorder.uav_barrier(list, Some(written));
        let states = (State::UNORDERED_ACCESS, State::COPY_SOURCE);
        self.recorder.transition(list, written, None, states, BarrierPart::Whole);
    }

    fn execute(&mut self) {
        self.recorder.execute(self.queue, &[self.list]);
    }
}

/// Two dispatches, barriers and a copy of 512 bytes.
const LIST: Counts = Counts {
    events: 0,
    submissions: 1,
    lists: 1,
    dispatches: 2,
    copies: 1,
    others: 0,
    barrier_calls: 1,
    transitions: 1,
    uav_barriers: 1,
    other_barriers: 0,
    copied_bytes: 512,
    read_views: 2 * 1024,
    write_views: 2 * BYTES,
};

fn recorded() -> Scene {
    let mut scene = Scene::new();
    scene.recorder.dispatch(scene.list);
    scene.recorder.dispatch(scene.list);
    scene.barriers();
    scene.recorder.copy_buffer(scene.list, (scene.buffers[0], 0), (scene.buffers[1], 0), 512);
    scene.recorder.close(scene.list);
    scene
}

#[test]
fn a_lists_work_counts_each_time_it_is_executed_in_the_event_of_its_submission() {
    let mut scene = recorded();
    assert_eq!(scene.recorder.take_counts().len(), 0, "recorded work has not run");
    scene.execute();
    scene.recorder.begin_event(scene.queue, "pass");
    scene.recorder.begin_event(scene.queue, "a part of it");
    scene.execute();
    scene.recorder.end_event(scene.queue);
    scene.execute();
    scene.recorder.end_event(scene.queue);
    let counts = scene.recorder.take_counts();
    assert_eq!(counts.keys().collect::<Vec<_>>(), ["", "pass"]);
    assert_eq!(counts[""], LIST);
    let twice = |n: u64| 2 * n;
    let expected = Counts {
        events: 1,
        submissions: 2,
        lists: 2,
        dispatches: twice(LIST.dispatches),
        copies: 2,
        others: 0,
        barrier_calls: 2,
        transitions: 2,
        uav_barriers: 2,
        other_barriers: 0,
        copied_bytes: twice(LIST.copied_bytes),
        read_views: twice(LIST.read_views),
        write_views: twice(LIST.write_views),
    };
    assert_eq!(counts["pass"], expected);
    assert_eq!(scene.recorder.take_counts().len(), 0, "counts are taken once");
}

#[test]
fn a_list_that_is_recorded_anew_starts_at_nothing() {
    let mut scene = recorded();
    scene.execute();
    scene.recorder.reset_allocator(scene.allocator);
    scene.recorder.reset_list(scene.list, scene.allocator, None);
    scene.recorder.close(scene.list);
    scene.recorder.take_counts();
    scene.execute();
    let expected = Counts { submissions: 1, lists: 1, ..Counts::default() };
    assert_eq!(scene.recorder.take_counts()[""], expected);
}

#[test]
fn counts_are_written_as_numbers_by_their_names() {
    let mut scene = recorded();
    scene.execute();
    let text = to_json(&scene.recorder.take_counts());
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&json[""]["dispatches"], &json[""]["write_views"]), (&2.into(), &(2 * BYTES).into()));
}
