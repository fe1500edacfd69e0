//! Direct3D 12: entry points that take an engine's own objects. The implementation is built for Windows only.

use std::ffi::c_void;
use std::time::Duration;

use super::anchor::{cairn_anchor, check_index};
use super::boundary::call;
use super::device::{DeviceOptions, cairn_device, cairn_device_options};
use super::handles::{enter, enter_alone, insert};
use super::presenter::{cairn_frame, cairn_presenter, to_header};
use super::results::{CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, Failure, Outcome, cairn_result};
use super::rollout::{cairn_rollout, cairn_step_info, step_info};
use super::structs::{Out, check_out, describe, read};
use crate::present::Selection;
use crate::present::presenter::FrameInfo;
use crate::world::Job;

#[cfg_attr(windows, path = "d3d12/windows.rs")]
#[cfg_attr(not(windows), path = "d3d12/unsupported.rs")]
pub(super) mod behind;

/// Direct3D 12's own, declared so that its header is not needed.
pub struct ID3D12Device(());

/// Direct3D 12's own, declared so that its header is not needed.
pub struct ID3D12CommandQueue(());

/// Direct3D 12's own, declared so that its header is not needed.
pub struct ID3D12Resource(());

/// Direct3D 12's own, declared so that its header is not needed.
pub struct ID3D12Fence(());

/// Direct3D 12's own, declared so that its header is not needed.
pub struct ID3D12GraphicsCommandList(());

/// A texture, and the fence with the value that guards it; both with a reference for whoever gets them.
type Guarded = (*mut ID3D12Resource, *mut ID3D12Fence, u64);

/// A fence with the value to wait for, which has a reference for whoever gets it.
pub(super) struct Guard {
    fence: *mut ID3D12Fence,
    value: u64,
}

/// Statistics of frames made on a Direct3D 12 device.
#[derive(Default)]
pub(super) struct DeviceStatistics {
    /// Frames that have not run yet.
    pub(super) under_way: u32,
    /// Recorded frames whose lists may not have run.
    pub(super) lists_pending: u32,
    /// Device times of frames that have run.
    pub(super) frames: DeviceTimes,
    /// Device times of the lists that prepare the frames' inputs.
    pub(super) lists: DeviceTimes,
    /// Generator of the last frame; `None` before the first frame.
    pub(super) generator: Option<Selection>,
    /// Upscaler of the last frame; `None` if the CPU made it.
    pub(super) upscaler: Option<Selection>,
}

/// Statistics of a rollout's passes on the device.
#[derive(Default, Clone, Copy)]
pub(super) struct RolloutStatistics {
    pub(super) passes: DeviceTimes,
    pub(super) decodes: DeviceTimes,
    pub(super) commits: DeviceTimes,
    /// Wall time inside ONNX Runtime.
    pub(super) inside: Duration,
    /// Wall time of waiting for the device.
    pub(super) waited: Duration,
    pub(super) yields: u64,
    /// Passes that run from captured commands.
    pub(super) captured: usize,
    /// Passes that do not.
    pub(super) others: usize,
}

/// Count and durations of a kind of work on the device.
#[derive(Default, Clone, Copy)]
pub(super) struct DeviceTimes {
    pub(super) count: u64,
    pub(super) total: Duration,
    pub(super) longest: Duration,
    pub(super) last: Duration,
}

/// Makes a device of an engine's own. Experimental: this chapter may change without a new CAIRN_ABI_VERSION, and where the library
/// has no Direct3D 12 part every function of it answers CAIRN_ERROR_UNSUPPORTED.
///
/// d3d12, queue: the engine's; frames are generated and copied on the queue, which must be of type direct or compute.
/// anchors: a compute queue of the same device for the world's passes, so that they never stall the frame; null for one of the
/// library's own.
/// options: may be null for the defaults.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy, and holds a reference to each object until it is gone;
/// on failure it is not written and no reference is held. What options point to is read during the call only.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, also for an object of another kind or device; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_RUNTIME_MISSING; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_d3d12(
    d3d12: *mut ID3D12Device,
    queue: *mut ID3D12CommandQueue,
    anchors: *mut ID3D12CommandQueue,
    options: *const cairn_device_options,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_d3d12", || {
        given(d3d12, "d3d12")?;
        given(queue, "queue")?;
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        // SAFETY: the host's promise about its objects.
        let made = unsafe { behind::of_engine(d3d12, queue, anchors, options) }?;
        let handle = insert::<cairn_device>(made)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { device.write(handle) };
        Ok(CAIRN_OK)
    })
}

/// Makes a device of the library's own on an adapter, for hosts that have no engine.
///
/// luid: of the adapter, as cairn_adapters gives it.
/// options: may be null for the defaults.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point to is
/// read during the call only.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for a LUID that no adapter has; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED;
/// CAIRN_ERROR_RUNTIME_MISSING; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_adapter(
    luid: u64,
    options: *const cairn_device_options,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_adapter", || {
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        let handle = insert::<cairn_device>(behind::on_adapter(luid, options)?)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { device.write(handle) };
        Ok(CAIRN_OK)
    })
}

/// A flag of cairn_d3d12_options: ONNX Runtime's deterministic kernels only, and no captured passes.
pub const CAIRN_D3D12_DETERMINISTIC: u32 = 1;

/// How worlds run on a Direct3D 12 device. All zero: as a new device has it.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_options {
    /// sizeof(cairn_d3d12_options)
    pub struct_size: u32,
    /// CAIRN_D3D12_DETERMINISTIC, or 0.
    pub flags: u32,
    /// Passes of each of a world's graphs that ONNX Runtime may capture, at most: it keeps their commands, and such a pass takes the
    /// processor next to nothing. A rollout has two at most to a graph, and those of rollouts that are gone are kept as long as the world.
    /// Captured passes are used where they give the same bits as others, which the first runs of each show. 0 for none.
    pub captured_passes: u32,
    /// Longest work of a rollout that may be queued on the anchors' queue at a time, in microseconds of the device's own clock, so that the
    /// engine's frames run in between. A pass that would exceed it waits for the work already queued. Passes are never split:
    /// cairn_rollout_statistics has the longest pass and the number of waits. 0 for no limit.
    pub longest_submission_us: u32,
}
describe!(cairn_d3d12_options, [], { struct_size, flags, captured_passes, longest_submission_us });

/// Sets how a device runs worlds loaded, and rollouts made, from now on.
///
/// Ownership: options are read during the call; nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED, also
/// for a CPU device.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_set_d3d12(
    device: *const cairn_device,
    options: *const cairn_d3d12_options,
) -> cairn_result {
    call("cairn_device_set_d3d12", || {
        let device = enter(device)?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read(options, "options") }?;
        if options.flags & !CAIRN_D3D12_DETERMINISTIC != 0 {
            return Err(Failure::argument("options.flags", format!("{:#x} has an unknown bit", options.flags)));
        }
        behind::set_options(&device, &options)?;
        Ok(CAIRN_OK)
    })
}

/// Gives the Direct3D 12 device and the queue that a device runs on.
///
/// Ownership: on success *d3d12 and *queue have a reference more each, for the caller to release; on failure neither is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for a CPU device.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_get_d3d12(
    device: *const cairn_device,
    d3d12: *mut *mut ID3D12Device,
    queue: *mut *mut ID3D12CommandQueue,
) -> cairn_result {
    call("cairn_device_get_d3d12", || {
        let device = enter(device)?;
        check_out(d3d12, "d3d12")?;
        check_out(queue, "queue")?;
        let (own, frames) = behind::parts(&device).ok_or_else(Failure::no_d3d12)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { d3d12.write(own) };
        // SAFETY: as above.
        unsafe { queue.write(frames) };
        Ok(CAIRN_OK)
    })
}

/// Appends a texture, as cairn_rollout_append does a picture: the seed, or an edit of the scene.
///
/// picture: two-dimensional, RGBA8 or BGRA8, one slice; in state, a D3D12_RESOURCE_STATES, when it is read on the device's queue,
/// behind what the queue has been given, and left in it; it must live until this returns. info: may be null.
///
/// Ownership: the texture stays the caller's; info is filled on success; on failure it is not written and the rollout is as it was.
/// Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_append_d3d12(
    rollout: *mut cairn_rollout,
    picture: *mut ID3D12Resource,
    state: u32,
    info: *mut cairn_step_info,
) -> cairn_result {
    call("cairn_rollout_append_d3d12", || {
        let running = enter_alone(rollout)?;
        given(picture, "picture")?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::optional(info, "info") }?;
        let device = running.lock_between_steps()?.rollout.world().device().clone();
        // SAFETY: the host's promise about its objects.
        let picture = unsafe { behind::read(&device, picture, state) }?;
        let made = running.run(&Job::Append(vec![picture]))?;
        info.into_iter().for_each(|info| info.write(&step_info(&made)));
        Ok(CAIRN_OK)
    })
}

/// Gives a picture of an anchor as a texture, with the fence value that guards it.
///
/// index: 0 to pictures - 1, in order of time.
/// texture: gets RGBA8 of the anchor's size, in state COMMON; to be left in it.
/// fence, value: get what to wait for before it is read; once the fence has the value, it stays as it is.
///
/// Ownership: on success *texture and *fence have a reference more each, for the caller to release; on failure nothing is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for an anchor that was
/// not made on a Direct3D 12 device.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_get_d3d12(
    anchor: *const cairn_anchor,
    index: u32,
    texture: *mut *mut ID3D12Resource,
    fence: *mut *mut ID3D12Fence,
    value: *mut u64,
) -> cairn_result {
    call("cairn_anchor_get_d3d12", || {
        let anchor = enter(anchor)?;
        check_out(texture, "texture")?;
        check_out(fence, "fence")?;
        check_out(value, "value")?;
        check_index(&anchor, index)?;
        let made = behind::texture(&anchor, index)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { texture.write(made.0) };
        // SAFETY: as above.
        unsafe { fence.write(made.1) };
        // SAFETY: as above.
        unsafe { value.write(made.2) };
        Ok(CAIRN_OK)
    })
}

/// Recorded frames that may not have run, at most: see cairn_d3d12_preparation.lists.
pub const CAIRN_MAX_LISTS: u32 = 16;
/// A flag of cairn_d3d12_preparation: frames are submitted only, and no memory is kept for recorded ones.
pub const CAIRN_PREPARE_SUBMIT_ONLY: u32 = 1;

/// Gives pipelines that cairn_pipelines_store_callback got in an earlier run, on the thread that prepares. Called first with null and 0, to
/// return how many bytes there are, 0 for none; then with memory of that size, to fill it and return the same number.
pub type cairn_pipelines_load_callback =
    Option<unsafe extern "C" fn(bytes: *mut c_void, capacity: u64, user: *mut c_void) -> u64>;

/// Gets the pipelines of a device, on the thread that prepares: bytes are valid during the call only. Bytes of another adapter, driver or
/// version of the library, and damaged ones, are ignored when they are loaded.
pub type cairn_pipelines_store_callback =
    Option<unsafe extern "C" fn(bytes: *const c_void, size: u64, user: *mut c_void)>;

/// What frames for Direct3D 12 are prepared for. All zero: frames of the presenter's size in any format, of the anchors that have come.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_preparation {
    /// sizeof(cairn_d3d12_preparation)
    pub struct_size: u32,
    /// DXGI_FORMAT of the targets; 0 for any that frames can be written in, with memory for the widest.
    pub format: u32,
    /// Size of the targets in pixels; 0 both ways for that of the presenter's frames.
    pub width: u32,
    /// See width.
    pub height: u32,
    /// Size of the anchors in pixels, 1 to 16384 each way; 0 both ways for that of the anchors that have come.
    pub anchor_width: u32,
    /// See anchor_width.
    pub anchor_height: u32,
    /// Pictures that an anchor brings, as cairn_anchor_info.pictures; 0 for 1.
    pub anchor_pictures: u32,
    /// As cairn_anchor_info has it; needed where options.motion is CAIRN_MOTION_PAPER, else 0.
    pub latent_channels: u32,
    /// See latent_channels.
    pub latent_height: u32,
    /// See latent_channels.
    pub latent_width: u32,
    /// Frames recorded into the engine's lists that may not have run, 1 to CAIRN_MAX_LISTS; 0 for 4. Each costs the memory of a frame.
    pub lists: u32,
    /// CAIRN_PREPARE_SUBMIT_ONLY, or 0.
    pub flags: u32,
    /// May be null.
    pub load: cairn_pipelines_load_callback,
    /// May be null.
    pub store: cairn_pipelines_store_callback,
    /// Handed to both.
    pub user: *mut c_void,
}
describe!(cairn_d3d12_preparation, [], {
    struct_size, format, width, height, anchor_width, anchor_height, anchor_pictures, latent_channels, latent_height,
    latent_width, lists, flags, load, store, user,
});

/// Makes all that frames for Direct3D 12 need, on a thread of the host's that loads: pipelines, textures, memory, AMD's libraries with their
/// contexts and the test that these must pass. Afterwards cairn_presenter_record_d3d12 and cairn_presenter_submit_d3d12 make nothing
/// for frames of these sizes and this format. Blocks for as long as that takes, seconds at the first time.
///
/// Until it was called, and for frames of another size, format or device, these show the nearest anchor in place of each frame, resized by
/// the processor, with CAIRN_FRAME_UNPREPARED: so call it again when targets change their size. What was prepared before is used until
/// the call is done, and longer where it fails.
///
/// Pipelines are kept as long as the device, and shared by its presenters. With callbacks they are kept from one run of the program to the next, as
/// far as the driver gives them away; the library writes no file. load is called once for a device, and store where
/// pipelines were compiled that were neither loaded nor stored before, with all of the device's.
///
/// device: the one on whose queue frames will be made.
///
/// Ownership: preparation is read during the call; user stays the caller's; nothing is handed over, on success or on failure.
/// Threads: any thread, also while another one pushes, queries, records or submits; a second one that prepares the same presenter gets
/// CAIRN_ERROR_BUSY. Callbacks may call any function but those that destroy the presenter or the device.
/// Results: CAIRN_OK; CAIRN_NOT_READY where no anchor has come and the preparation does not say how large anchors are;
/// CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU
/// device and where a required generator or upscaler cannot be used; CAIRN_ERROR_RUNTIME_MISSING where AMD's libraries are required and not
/// there; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_prepare_d3d12(
    presenter: *const cairn_presenter,
    device: *const cairn_device,
    preparation: *const cairn_d3d12_preparation,
) -> cairn_result {
    call("cairn_presenter_prepare_d3d12", || {
        let presenting = enter(presenter)?;
        let device = enter(device)?;
        // SAFETY: the host's promise about `preparation`.
        let wanted = unsafe { read(preparation, "preparation") }?;
        let refuse = |field: &str, why: String| Err(Failure::argument(&format!("preparation.{field}"), why));
        let sides = 1..=crate::MAX_SIDE;
        for (field, size) in
            [("width", (wanted.width, wanted.height)), ("anchor_width", (wanted.anchor_width, wanted.anchor_height))]
        {
            if size != (0, 0) && !(sides.contains(&size.0) && sides.contains(&size.1)) {
                return refuse(field, format!("{} x {} pixels", size.0, size.1));
            }
        }
        if wanted.lists > CAIRN_MAX_LISTS {
            return refuse("lists", format!("{} recorded frames cannot be kept", wanted.lists));
        }
        if wanted.flags & !CAIRN_PREPARE_SUBMIT_ONLY != 0 {
            return refuse("flags", format!("{:#x} has an unknown bit", wanted.flags));
        }
        Ok(if presenting.prepare(&device, &wanted)? { CAIRN_OK } else { CAIRN_NOT_READY })
    })
}

/// A list of the engine's that a frame is recorded into.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_recording {
    /// sizeof(cairn_d3d12_recording)
    pub struct_size: u32,
    /// D3D12_RESOURCE_STATES of the target when the list comes to it.
    pub state_before: u32,
    /// D3D12_RESOURCE_STATES that it is left in.
    pub state_after: u32,
    /// 0
    pub reserved: u32,
    /// Open for recording, of the type of the device's queue.
    pub list: *mut ID3D12GraphicsCommandList,
    /// Of the frames' size, two-dimensional with one level, slice and sample; RGBA8, BGRA8, RGB10A2, RGBA16F or R11G11B10_FLOAT, views for
    /// sRGB and typeless ones included; RGBA16F or R11G11B10_FLOAT where the presenter's colour space is CAIRN_COLOUR_LINEAR.
    pub target: *mut ID3D12Resource,
    /// The host's own, of the same device.
    pub fence: *mut ID3D12Fence,
    /// The fence gets it on the queue that executes the list, after the list.
    pub fence_value: u64,
}
describe!(cairn_d3d12_recording, [], {
    struct_size, state_before, state_after, reserved, list, target, fence, fence_value,
});

/// Has the frame that is due made on the device's queue, as cairn_presenter_draw writes it into memory, and records its copy into the engine's
/// command list. Compute shaders make it unless options.shader is CAIRN_PREFER_NEVER; where they cannot, the processor does:
/// cairn_presenter_get_statistics says which, and why. The list gets a barrier, a copy and a barrier, and nothing else of it changes.
///
/// The list may be executed early or late, in another order than it was recorded in, or never. What it copies from is used again once the
/// fence has its value, and not before; nothing waits for it. The same value may stand for several lists if it comes after all of
/// them. Of a list that is dropped the host signals the value itself, or calls cairn_presenter_release_d3d12.
///
/// A cut that only the generator finds shows the nearer anchor as well, but frame says so only where the processor made it; the
/// statistics count it once the frame has been made.
///
/// device: the one on whose queue the list will run; on another queue it must wait for what the device's queue has been given before.
/// now_ns: when it will be shown, on the host's clock.
/// recording: the target is in state_before on entry and in state_after on exit, both D3D12_RESOURCE_STATES that the list can name: a compute list
/// cannot name RENDER_TARGET. The presenter must live until the list has run.
/// frame: may be null.
///
/// Ownership: all objects stay the caller's, and the presenter holds a reference to the fence until it has its value; on success frame is
/// filled; on failure it is not written and no frame is recorded.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY. Not waited for is a thread that prepares.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_QUEUE_FULL where as many lists as were prepared may not have run:
/// nothing is recorded, and the target holds what it did; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also without a fence, for one of
/// another device or that has the value already, and when CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS meets an anchor without a latent;
/// CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU device; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE;
/// CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_record_d3d12(
    presenter: *mut cairn_presenter,
    device: *const cairn_device,
    now_ns: u64,
    recording: *const cairn_d3d12_recording,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_record_d3d12", || {
        let presenting = enter_alone(presenter)?;
        let device = enter(device)?;
        // SAFETY: the host's promise about `recording`.
        let recording = unsafe { read(recording, "recording") }?;
        given(recording.list, "recording.list")?;
        given(recording.target, "recording.target")?;
        if recording.fence.is_null() {
            return Err(Failure::argument("recording.fence", "without a fence it is not known when the list has run")
                .remedy("Pass a fence that the queue signals after the list, or use cairn_presenter_submit_d3d12"));
        }
        if recording.reserved != 0 {
            return Err(Failure::argument("recording.reserved", "it must be 0"));
        }
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        let cairn_d3d12_recording { state_before, state_after, list, target, fence, fence_value, .. } = recording;
        let guard = Guard { fence, value: fence_value };
        let to = To { list: Some((list, guard)), target, before: state_before, after: state_after };
        // SAFETY: the host's promise about its objects.
        match unsafe { presenting.record(&device, now_ns, &to) }? {
            Recorded::NotReady => Ok(CAIRN_NOT_READY),
            Recorded::QueueFull => Ok(CAIRN_QUEUE_FULL),
            Recorded::Frame(shown, _) => {
                frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
                Ok(CAIRN_OK)
            }
        }
    })
}

/// Has the frame that is due written to a texture on the device's queue, in a list of the presenter's own and behind all that the queue has been
/// given. Waits where three frames before it have not run.
///
/// device, now_ns, frame: as for cairn_presenter_record_d3d12; target, before, after: as in cairn_d3d12_recording. The presenter may hold a
/// reference to target until the third frame after it is made or cairn_presenter_release_d3d12 is called.
/// fence, value: get what to wait for before the frame is read elsewhere than on the queue, and before target is freed.
///
/// Ownership: target stays the caller's; on success *fence has a reference more, for the caller to release, and frame is filled;
/// on failure nothing is written and the queue has been given no frame.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY. The queue may be used by others at the same time.
/// Results: CAIRN_OK; CAIRN_NOT_READY, and the errors of cairn_presenter_record_d3d12.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_submit_d3d12(
    presenter: *mut cairn_presenter,
    device: *const cairn_device,
    now_ns: u64,
    target: *mut ID3D12Resource,
    before: u32,
    after: u32,
    frame: *mut cairn_frame,
    fence: *mut *mut ID3D12Fence,
    value: *mut u64,
) -> cairn_result {
    call("cairn_presenter_submit_d3d12", || {
        let presenting = enter_alone(presenter)?;
        let device = enter(device)?;
        given(target, "target")?;
        check_out(fence, "fence")?;
        check_out(value, "value")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        let to = To { list: None, target, before, after };
        // SAFETY: the host's promise about its objects.
        let made = unsafe { presenting.record(&device, now_ns, &to) }?;
        let Recorded::Frame(shown, Some(guard)) = made else { return Ok(CAIRN_NOT_READY) };
        // SAFETY: checked above; writable by the host's promise.
        unsafe { fence.write(guard.fence) };
        // SAFETY: as above.
        unsafe { value.write(guard.value) };
        frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
        Ok(CAIRN_OK)
    })
}

/// Waits until all frames have run and releases their targets, as a swap chain wants it before its buffers are resized. Every list that frames
/// were recorded into must have been given to the queue, or never will be: their memory is free then, whatever their fences say.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_release_d3d12(presenter: *mut cairn_presenter) -> cairn_result {
    call("cairn_presenter_release_d3d12", || {
        enter_alone(presenter)?.release()?;
        Ok(CAIRN_OK)
    })
}

/// Outcome of a frame for Direct3D 12.
#[cfg_attr(not(windows), expect(dead_code, reason = "frames are recorded on Direct3D 12 alone"))]
pub(super) enum Recorded {
    /// No anchor has arrived yet.
    NotReady,
    /// As many lists as may have not run.
    QueueFull,
    /// It is made; with what guards its target where that is submitted.
    Frame(FrameInfo, Option<Guard>),
}

/// Target of a recorded frame.
#[cfg_attr(not(windows), expect(dead_code, reason = "what stands behind the door reads it"))]
pub(super) struct To {
    /// The engine's command list, and the engine's fence that is signalled once the list has run.
    list: Option<(*mut ID3D12GraphicsCommandList, Guard)>,
    target: *mut ID3D12Resource,
    before: u32,
    after: u32,
}

/// Refuses a null pointer to an object of Direct3D.
pub(super) fn given<T>(pointer: *mut T, name: &str) -> Outcome<()> {
    if pointer.is_null() { Err(Failure::argument(name, "a null pointer")) } else { Ok(()) }
}
