//! An engine's command lists: invalid ones, and lists that run late, in another order or never.

use super::*;

#[test]
fn invalid_recordings_are_refused_and_leave_list_and_target_unchanged() {
    let (engine, other) = (Engine::create(), Engine::create());
    let (direct, compute) = (device(&engine, &engine.direct), device(&engine, &engine.compute));
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO);
    let good = TextureDesc { size: SIZE, ..TextureDesc::default() };
    let texture = good.create(&engine.device);
    prepare(presenter, direct, 0);
    let list = |kind| Recording::new(&engine.device, kind);
    let (for_direct, for_compute) = (list(D3D12_COMMAND_LIST_TYPE_DIRECT), list(D3D12_COMMAND_LIST_TYPE_COMPUTE));
    let (for_copies, elsewhere) = (list(D3D12_COMMAND_LIST_TYPE_COPY), Recording::on(&other.device, &other.direct));
    let buffer = textures::readback(&engine.device, 4096);
    let rendered = TextureDesc { flags: D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, ..good };
    let common = [D3D12_RESOURCE_STATE_COMMON; 2];
    let states = |before, after| [before, after];
    let rest = D3D12_RESOURCE_STATE_COMMON;
    let make = |wanted: TextureDesc| wanted.create(&engine.device);
    let cases = [
        ("another size", direct, &for_direct, make(TextureDesc { size: (SIZE.0 + 1, SIZE.1), ..good }), common),
        ("two levels", direct, &for_direct, make(TextureDesc { levels: 2, ..good }), common),
        ("two slices", direct, &for_direct, make(TextureDesc { slices: 2, ..good }), common),
        ("a format", direct, &for_direct, make(TextureDesc { format: DXGI_FORMAT_R32_FLOAT, ..good }), common),
        ("a buffer", direct, &for_direct, buffer, common),
        ("another device's target", direct, &for_direct, good.create(&other.device), common),
        ("another device's list", direct, &elsewhere, texture.clone(), common),
        ("a list for copies", direct, &for_copies, texture.clone(), common),
        ("a list of another type than the queue", direct, &for_compute, texture.clone(), common),
        ("a list of another type than the queue", compute, &for_direct, texture.clone(), common),
        ("no render target", direct, &for_direct, texture.clone(), states(rest, D3D12_RESOURCE_STATE_RENDER_TARGET)),
        (
            "no unordered access",
            direct,
            &for_direct,
            texture.clone(),
            states(D3D12_RESOURCE_STATE_UNORDERED_ACCESS, rest),
        ),
        ("a state of depths", direct, &for_direct, texture.clone(), states(D3D12_RESOURCE_STATE_DEPTH_WRITE, rest)),
        ("no state", direct, &for_direct, texture.clone(), states(rest, D3D12_RESOURCE_STATES(-1))),
        (
            "a state that compute lists do not support",
            compute,
            &for_compute,
            make(rendered),
            states(D3D12_RESOURCE_STATE_RENDER_TARGET, rest),
        ),
    ];
    for (what, device, recording, target, states) in &cases {
        let (device, states) = (*device, *states);
        let call = Call { presenter, device, now: INTERVAL, recording, target, states };
        assert_eq!(call.record().0, CAIRN_ERROR_INVALID_ARGUMENT, "{what}");
    }
    // This presenter has no anchors.
    // SAFETY: a variable for the handle.
    let empty = create_handle(|to| unsafe { cairn_presenter_create(std::ptr::null(), to) });
    let call =
        Call { presenter: empty, device: direct, now: 0, recording: &for_direct, target: &texture, states: common };
    assert_eq!(call.record().0, CAIRN_NOT_READY);
    // All refused lists are unchanged, and so is the device.
    for_direct.submit(&engine.direct);
    for_compute.submit(&engine.compute);
    textures::wait(&engine.device, &engine.direct);
    textures::wait(&engine.device, &engine.compute);
    let recording = Recording::on(&engine.device, &engine.direct);
    let call =
        Call { presenter, device: direct, now: INTERVAL, recording: &recording, target: &texture, states: common };
    assert_eq!(call.record().0, CAIRN_OK);
    recording.submit(&engine.direct);
    textures::wait(&engine.device, &engine.direct);

    // Executing a list that is still open removes the device.
    let open = Recording::on(&engine.device, &engine.direct);
    let list: ID3D12CommandList = open.list().cast().expect("a command list");
    // SAFETY: a live queue and list.
    unsafe { engine.direct.ExecuteCommandLists(&[Some(list)]) };
    let call = Call { recording: &open, ..call };
    assert_eq!(call.record().0, CAIRN_ERROR_DEVICE_REMOVED);
    destroy([presenter, empty], [direct, compute]);
}

#[test]
fn repeated_frames_are_copied_and_not_generated_again() {
    const HOUR: u64 = 3_600_000_000_000;
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO);
    prepare(presenter, direct, 0);
    let states = [D3D12_RESOURCE_STATE_PRESENT; 2];
    let frame_at = |now| {
        let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
        let recording = Recording::on(&engine.device, &engine.direct);
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states };
        let (result, frame) = call.record();
        assert_eq!(result, CAIRN_OK);
        recording.submit(&engine.direct);
        (frame, textures::read(&engine.device, &engine.direct, &texture, states[1]))
    };
    // An engine without vertical synchronisation draws far more often than there are new frames.
    let start = INTERVAL * 5 / 4;
    let (first, made) = frame_at(start);
    assert_eq!((first.source, first.flags), (CAIRN_FRAME_GENERATED, 0));
    for millisecond in 1..16 {
        let (frame, pixels) = frame_at(start + millisecond * 1_000_000);
        assert_eq!((frame.position, frame.flags), (first.position, CAIRN_FRAME_REPEATED));
        assert!(pixels == made, "the same bits");
    }
    // First the engine's clock pauses, then it jumps ahead by an hour: the last picture is held.
    let now = start + 15_000_000;
    assert_eq!(frame_at(now).0.flags, CAIRN_FRAME_REPEATED);
    assert_eq!(frame_at(start + INTERVAL / 4).0.position, first.position + 1, "it continues from the same position");
    let (held, stands) = frame_at(start + HOUR);
    assert_eq!((held.source, held.previous), (CAIRN_FRAME_HELD, 1));
    let (again, same) = frame_at(start + 2 * HOUR);
    assert_eq!((again.source, again.flags), (CAIRN_FRAME_HELD, CAIRN_FRAME_REPEATED));
    assert!(stands == same);
    push(presenter, 2, start + 2 * HOUR + INTERVAL);
    let (next, _) = frame_at(start + 2 * HOUR + INTERVAL);
    assert_eq!((next.source, next.previous), (CAIRN_FRAME_ANCHOR, 2));
    let done = statistics(presenter);
    assert_eq!((done.repeated, done.shown_generated, done.shown_held, done.late_anchors), (17, 18, 2, 1));
    destroy([presenter], [direct]);
}

/// Frames recorded into lists that the engine holds back.
struct PendingLists {
    engine: Engine,
    device: *mut cairn_device,
    presenter: *mut cairn_presenter,
    held: Vec<(Recording, ID3D12Resource, Picture)>,
}

/// Number of lists that the presenter is prepared for.
const LISTS: u32 = 4;

impl PendingLists {
    fn new(shader: u32) -> Self {
        let engine = Engine::create();
        let device = device(&engine, &engine.direct);
        let presenter = presenter(CAIRN_COLOUR_SRGB, shader);
        prepare(presenter, device, LISTS);
        Self { engine, device, presenter, held: Vec::new() }
    }

    /// Records the frame a quarter of an interval after anchor `number - 1`.
    fn record(&mut self, number: u64) -> cairn_result {
        if number > 1 {
            push(self.presenter, number, number * INTERVAL);
        }
        let now = number * INTERVAL + INTERVAL / 4;
        let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&self.engine.device);
        let recording = Recording::on(&self.engine.device, &self.engine.direct);
        let states = [D3D12_RESOURCE_STATE_COMMON; 2];
        let Self { presenter, device, .. } = *self;
        let call = Call { presenter, device, now, recording: &recording, target: &texture, states };
        let (result, _) = call.record();
        // Waits for the presenter's work for the frame on the queue.
        textures::wait(&self.engine.device, &self.engine.direct);
        if result == CAIRN_OK {
            self.held.push((recording, texture, draw(self.presenter, now)));
        }
        result
    }

    /// Submits a list, and checks the pixels that it copied.
    fn submit(&self, place: usize) {
        let (recording, texture, expected) = &self.held[place];
        recording.submit(&self.engine.direct);
        let state = D3D12_RESOURCE_STATE_COMMON;
        let found = textures::read(&self.engine.device, &self.engine.direct, texture, state);
        let differences = found.iter().zip(expected.rgba()).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert_eq!(differences, 0, "list {place} of {} copies the recorded frame", self.held.len());
    }

    fn pending(&self) -> u32 {
        statistics(self.presenter).lists_pending
    }
}

#[test]
fn lists_may_run_late_in_any_order_or_never() {
    for shader in [CAIRN_PREFER_AUTO, CAIRN_PREFER_NEVER] {
        for order in [[0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1]] {
            let mut lists = PendingLists::new(shader);
            (1..=4).for_each(|number| assert_eq!(lists.record(number), CAIRN_OK));
            // Memory for further lists is used up: calls fail without waiting, and no recorded frame is overwritten.
            assert_eq!([lists.record(5), lists.record(6)], [CAIRN_QUEUE_FULL; 2]);
            assert_eq!(lists.pending(), LISTS);
            order.into_iter().for_each(|place| lists.submit(place));
            assert_eq!((lists.pending(), lists.record(7)), (0, CAIRN_OK));
            lists.submit(4);
            // Dropped lists: the engine signals their fences, or releases all recordings.
            (8..=11).for_each(|number| assert_eq!(lists.record(number), CAIRN_OK));
            lists.held[6].0.drop_list();
            assert_eq!((lists.pending(), lists.record(12), lists.record(13)), (3, CAIRN_OK, CAIRN_QUEUE_FULL));
            // SAFETY: a live handle.
            assert_eq!(unsafe { cairn_presenter_release_d3d12(lists.presenter) }, CAIRN_OK);
            assert_eq!((lists.pending(), lists.record(14)), (0, CAIRN_OK));
            lists.submit(lists.held.len() - 1);
            destroy([lists.presenter], [lists.device]);
        }
    }
}

#[test]
fn earlier_preparations_live_as_long_as_lists_may_read_them() {
    for shader in [CAIRN_PREFER_AUTO, CAIRN_PREFER_NEVER] {
        let mut lists = PendingLists::new(shader);
        (1..=3).for_each(|number| assert_eq!(lists.record(number), CAIRN_OK));
        prepare(lists.presenter, lists.device, LISTS);
        assert_eq!(lists.pending(), 3);
        (4..=7).for_each(|number| assert_eq!(lists.record(number), CAIRN_OK));
        (0..7).rev().for_each(|place| lists.submit(place));
        assert_eq!(lists.pending(), 0);
        destroy([lists.presenter], [lists.device]);
    }
}

#[test]
fn fences_that_cannot_signal_the_end_of_a_list_are_refused() {
    let (engine, other) = (Engine::create(), Engine::create());
    let direct = device(&engine, &engine.direct);
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO);
    prepare(presenter, direct, 0);
    let fence_of = |device: &ID3D12Device, value| -> ID3D12Fence {
        // SAFETY: a live device.
        unsafe { device.CreateFence(value, D3D12_FENCE_FLAG_NONE) }.expect("a fence")
    };
    let (own, foreign) = (fence_of(&engine.device, 7), fence_of(&other.device, 0));
    let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
    let recording = Recording::on(&engine.device, &engine.direct);
    let states = [D3D12_RESOURCE_STATE_COMMON; 2];
    let call = |now| Call { presenter, device: direct, now, recording: &recording, target: &texture, states };
    let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
    let mut record = |now: u64, fence: *mut std::ffi::c_void, value: u64, size: u32, reserved: u32| {
        let mut wanted: cairn_d3d12_recording = with_struct_size(|r: &mut cairn_d3d12_recording| &mut r.struct_size);
        (wanted.list, wanted.target) = (recording.list().as_raw().cast(), texture.as_raw().cast());
        (wanted.fence, wanted.fence_value) = (fence.cast(), value);
        (wanted.struct_size, wanted.reserved) = (wanted.struct_size + size, reserved);
        call(now).record_as(&wanted, &mut frame)
    };
    for (what, fence, value) in [
        ("none", null_mut(), 8),
        ("another device's", foreign.as_raw(), 8),
        ("an object of another kind", texture.as_raw(), 8),
        ("a value that it has", own.as_raw(), 7),
        ("one that it had", own.as_raw(), 6),
        ("one that every fence has", own.as_raw(), 0),
    ] {
        assert_eq!(record(INTERVAL, fence, value, 0, 0), CAIRN_ERROR_INVALID_ARGUMENT, "{what}");
    }
    assert_eq!(record(INTERVAL, own.as_raw(), 8, 0, 1), CAIRN_ERROR_INVALID_ARGUMENT, "a reserved field");
    assert_eq!(record(INTERVAL, own.as_raw(), 8, 4, 0), CAIRN_ERROR_STRUCT_SIZE);
    let done = statistics(presenter);
    assert_eq!((done.lists_pending, done.shown_anchors + done.shown_generated), (0, 0), "nothing was recorded");
    // Values may come in any order, and one value may cover several frames.
    for (quarter, value) in [(0, 10), (1, 9), (2, 9), (3, 10)] {
        assert_eq!(record(INTERVAL + quarter * INTERVAL / 4, own.as_raw(), value, 0, 0), CAIRN_OK, "{value}");
    }
    let reach = |value| {
        // SAFETY: a live fence.
        unsafe { own.Signal(value) }.expect("a signal");
        statistics(presenter).lists_pending
    };
    assert_eq!([reach(8), reach(9), reach(10)], [4, 2, 0]);
    // The list contains all four frames.
    recording.submit(&engine.direct);
    let found = textures::read(&engine.device, &engine.direct, &texture, states[1]);
    let memory = draw(presenter, INTERVAL * 7 / 4);
    assert!(found.iter().zip(memory.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1), "the last one");
    destroy([presenter], [direct]);
}
