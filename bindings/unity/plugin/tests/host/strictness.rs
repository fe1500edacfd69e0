//! Tests of the stand-in for Unity: it must reject what Unity would reject, and the recorder what Direct3D's debug layer would reject. Each case
//! breaks one rule.

use std::ffi::c_void;
use std::ptr::null_mut;

use cairn::gpu::compute::transition;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn_unity::interfaces::*;

use super::unity::{CallContext, UnityHandle, table};
use super::{READ, SIZE, texture};
use test_support::d3d12::recorder;
use test_support::d3d12::textures::{Recording, TextureDesc};

const RESTS: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;
const IS_READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COPY_SOURCE;
const IS_WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COPY_DEST;

/// Unity's functions, from the version that has all of them.
fn functions() -> Direct3d12V8 {
    // SAFETY: `T` is the type of the table with that GUID.
    unsafe { table::<Direct3d12V8>(Direct3d12V8::GUID) }
}

/// Asserts that one of the violations contains the given text.
#[track_caller]
fn assert_violation(unity: &UnityHandle, part: &str) {
    let wrong = unity.take_violations();
    assert!(wrong.iter().any(|why| why.contains(part)), "{part}: {wrong:?}");
}

/// Identifiers of the debug layer's messages.
const WRONG_STATE: &str = "D3D12_MESSAGE_ID_INVALID_SUBRESOURCE_STATE";
const WRONG_BARRIER: &str = "D3D12_MESSAGE_ID_RESOURCE_BARRIER_BEFORE_AFTER_MISMATCH";

/// Asserts that work breaks this rule of Direct3D, and no other.
#[track_caller]
fn assert_finding(id: &str, work: impl FnOnce()) {
    let found: Vec<String> = recorder::findings_of(work).into_iter().map(|finding| finding.id).collect();
    assert_eq!(found, [id]);
}

/// A texture that belongs to the plugin and that Unity does not know.
fn plugin_texture(unity: &UnityHandle) -> ID3D12Resource {
    TextureDesc { size: SIZE, format: super::DXGI_FORMAT_R8G8B8A8_TYPELESS, state: RESTS, ..TextureDesc::default() }
        .create(&unity.device())
}

/// The list that Unity is recording, as an event gets it.
fn list() -> ID3D12GraphicsCommandList {
    let mut state = RecordingState { list: null_mut() };
    // SAFETY: a place for the list.
    assert_eq!(unsafe { functions().command_recording_state.expect("it")(&mut state) }, 1);
    // SAFETY: Unity's list.
    unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&state.list) }.expect("a list").clone()
}

/// Copies as the plugin does.
fn copy(list: &ID3D12GraphicsCommandList, to: &ID3D12Resource, from: &ID3D12Resource) {
    // SAFETY: an open list and live textures.
    unsafe {
        list.ResourceBarrier(&[transition(from, RESTS, IS_READ)]);
        list.CopyResource(to, from);
        list.ResourceBarrier(&[transition(from, IS_READ, RESTS)]);
    }
}

/// An open list of the plugin's own with one copy in it.
fn record_copy(unity: &UnityHandle, to: &ID3D12Resource, from: &ID3D12Resource) -> (Recording, ID3D12CommandAllocator) {
    let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
    let made = Recording::new(&unity.device(), kind);
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator = unsafe { unity.device().CreateCommandAllocator(kind) }.expect("one");
    // SAFETY: an open list.
    unsafe { made.list().Close() }.expect("a list that can be closed");
    // SAFETY: a closed list and an allocator that nobody uses.
    unsafe { made.list().Reset(&allocator, None) }.expect("an open list");
    copy(made.list(), to, from);
    (made, allocator)
}

/// Passes a list to Unity, with the state of a texture before and after it.
fn execute(list: &ID3D12GraphicsCommandList, states: &mut [ResourceState]) -> u64 {
    let execute = functions().execute_command_list.expect("it");
    // SAFETY: a live list, and the stated number of states.
    unsafe { execute(list.as_raw(), states.len() as i32, states.as_mut_ptr()) }
}

/// Passes a list to Unity in an event. `closes`: before it is passed, as Direct3D requires; otherwise after it.
fn pass_to_unity(unity: &UnityHandle, made: &Recording, states: &[ResourceState], closes: bool) {
    let list = made.list().clone();
    let states: Vec<_> = states.iter().map(|state| (state.resource.addr(), state.expected, state.current)).collect();
    unity.act(CallContext::Unconfigured, move || {
        let state = |(resource, expected, current)| ResourceState {
            resource: std::ptr::without_provenance_mut::<c_void>(resource),
            expected,
            current,
        };
        let mut states: Vec<_> = states.into_iter().map(state).collect();
        // SAFETY: an open list.
        let close = || unsafe { list.Close() }.expect("a list that can be closed");
        if closes {
            close();
        }
        execute(&list, &mut states);
        if !closes {
            close();
        }
    });
}

fn state(texture: &ID3D12Resource, expected: D3D12_RESOURCE_STATES, current: D3D12_RESOURCE_STATES) -> ResourceState {
    ResourceState { resource: texture.as_raw(), expected: expected.0, current: current.0 }
}

#[test]
fn functions_are_refused_where_they_must_not_be_called() {
    let unity = UnityHandle::start(8);
    let object = |get: Option<GetObject>, place, name: &str| {
        // SAFETY: a function that takes nothing.
        unity.act(place, move || _ = unsafe { get.expect("it")() });
        if !name.is_empty() {
            assert_violation(&unity, name);
        }
        assert_eq!(unity.take_violations(), [""; 0]);
    };
    let all = functions();
    object(all.get_device, CallContext::Game, "GetDevice");
    object(all.get_frame_fence, CallContext::Game, "GetFrameFence");
    object(all.get_command_queue, CallContext::Recording, "GetCommandQueue");
    object(all.get_command_queue, CallContext::Submitting, "");
    let mut place = RecordingState { list: null_mut() };
    let at = (&raw mut place).addr();
    // SAFETY: a struct for the list, which lives during the call.
    let recording = move || unsafe { all.command_recording_state.expect("it")(at as *mut RecordingState) };
    unity.act(CallContext::Submitting, move || assert_eq!(recording(), 0));
    assert_violation(&unity, "CommandRecordingState");
    let config = EventConfig { queue_access: QUEUE_ALLOWED, flags: FLUSH_COMMAND_BUFFERS, binds_render_texture: 0 };
    // SAFETY: a struct that is read during the call.
    let configure = move |event| unsafe { all.configure_event.expect("it")(event, &config) };
    unity.act(CallContext::Recording, move || configure(4711));
    assert_violation(&unity, "ConfigureEvent");
    unity.act(CallContext::Starting, move || configure(4713));
    assert_violation(&unity, "not the plugin's");
    // SAFETY: a function that takes nothing.
    unity.act(CallContext::Game, move || _ = unsafe { all.get_next_frame_fence_value.expect("it")() });
    assert_violation(&unity, "GetNextFrameFenceValue");
    // A texture that Unity does not know, and null.
    let foreign = plugin_texture(&unity);
    for texture in [foreign.as_raw(), null_mut()].map(|texture: *mut c_void| texture.addr()) {
        unity.act(CallContext::Recording, move || {
            // SAFETY: a live texture, or null.
            unsafe { all.request_resource_state.expect("it")(texture as *mut c_void, IS_WRITTEN.0) };
        });
        assert_violation(&unity, "RequestResourceState");
    }
    assert_eq!(unity.take_violations(), [""; 0]);
}

#[test]
fn textures_in_other_states_are_refused() {
    let unity = UnityHandle::start(8);
    let (target, from) = (texture(&unity, SIZE, 1), plugin_texture(&unity));
    let (request, notify) = (functions().request_resource_state, functions().notify_resource_state);
    // SAFETY: a live texture.
    let into = || unsafe { request.expect("it")(target.as_raw(), IS_WRITTEN.0) };
    // The correct sequence.
    unity.act(CallContext::Recording, || {
        into();
        copy(&list(), &target, &from);
    });
    unity.end_frame();
    assert_eq!(unity.take_violations(), [""; 0]);
    // Unity uses the texture for reading again, and the plugin does not request it.
    unity.transition(&target, READ);
    assert_finding(WRONG_STATE, || {
        unity.act(CallContext::Recording, || copy(&list(), &target, &from));
        unity.end_frame();
    });
    // The texture is moved to another state: first Unity is not notified, then it is notified of a wrong state.
    unity.act(CallContext::Recording, || {
        into();
        // SAFETY: an open list and a live texture.
        unsafe { list().ResourceBarrier(&[transition(&target, IS_WRITTEN, READ)]) };
    });
    unity.end_frame();
    assert_violation(&unity, "what Unity was told");
    // SAFETY: a live texture.
    unity.act(CallContext::Recording, || unsafe { notify.expect("it")(target.as_raw(), RESTS.0, 0) });
    unity.end_frame();
    assert_violation(&unity, "what Unity was told");
    // A barrier from a state that the texture is not in.
    assert_finding(WRONG_BARRIER, || {
        unity.act(CallContext::Recording, || {
            // SAFETY: as above.
            unsafe { list().ResourceBarrier(&[transition(&from, IS_WRITTEN, RESTS)]) };
        });
        unity.end_frame();
    });
    // Textures must outlive the queue's use of them.
    unity.wait_ignoring_loss();
}

#[test]
fn open_lists_and_wrong_states_are_refused() {
    let unity = UnityHandle::start(8);
    let (target, from) = (texture(&unity, SIZE, 1), plugin_texture(&unity));
    // The correct sequence.
    let (right, allocator) = record_copy(&unity, &target, &from);
    pass_to_unity(&unity, &right, &[state(&target, IS_WRITTEN, IS_WRITTEN)], true);
    unity.end_frame();
    unity.wait_ignoring_loss();
    // SAFETY: its list has executed.
    unsafe { allocator.Reset() }.expect("an allocator");
    assert_eq!(unity.take_violations(), [""; 0]);
    // The texture is not passed with the list.
    unity.transition(&target, READ);
    let (silent, _silent) = record_copy(&unity, &target, &from);
    assert_finding(WRONG_STATE, || {
        pass_to_unity(&unity, &silent, &[], true);
        unity.end_frame();
    });
    // The texture is passed with a wrong state after the list.
    let (other, _other) = record_copy(&unity, &target, &from);
    pass_to_unity(&unity, &other, &[state(&target, IS_WRITTEN, READ)], true);
    unity.end_frame();
    assert_violation(&unity, "what Unity was told");
    unity.wait_ignoring_loss();
    // The list is still open.
    let again = texture(&unity, SIZE, 1);
    let (open, _open) = record_copy(&unity, &again, &from);
    pass_to_unity(&unity, &open, &[state(&again, IS_WRITTEN, IS_WRITTEN)], false);
    assert_violation(&unity, "not closed");
    unity.end_frame();
    unity.wait_ignoring_loss();
}
