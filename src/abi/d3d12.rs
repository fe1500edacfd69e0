//! Direct3D 12: the doors that an engine's own objects come through. What stands behind them is built for Windows only.

use std::time::Duration;

use super::anchor::{cairn_anchor, check_index};
use super::boundary::call;
use super::device::{DeviceOptions, cairn_device, cairn_device_options};
use super::handles::{enter, enter_alone, insert};
use super::presenter::{cairn_frame, cairn_presenter, to_header};
use super::results::{CAIRN_NOT_READY, CAIRN_OK, Failure, Outcome, cairn_result};
use super::rollout::{cairn_rollout, cairn_step_info, step_info};
use super::structs::{Out, check_out, describe, read};
use super::worker::Job;

#[cfg_attr(windows, path = "d3d12/windows.rs")]
#[cfg_attr(not(windows), path = "d3d12/elsewhere.rs")]
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

/// What frames for Direct3D 12 have taken on the device.
#[derive(Default)]
pub(super) struct DeviceFigures {
    /// Frames that have not run.
    pub(super) under_way: u32,
    /// Frames that have.
    pub(super) frames: DeviceTimes,
    /// Lists that bring what they are made of.
    pub(super) lists: DeviceTimes,
}

/// What a rollout has taken on the device, and how its passes run there.
#[derive(Default, Clone, Copy)]
pub(super) struct RolloutFigures {
    pub(super) passes: DeviceTimes,
    pub(super) decodes: DeviceTimes,
    pub(super) commits: DeviceTimes,
    /// Inside ONNX Runtime.
    pub(super) inside: Duration,
    /// Waiting for the device.
    pub(super) waited: Duration,
    pub(super) yields: u64,
    /// Passes that run by capture.
    pub(super) captured: usize,
    /// Those that do not.
    pub(super) others: usize,
}

/// How often, and how long.
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
    /// Microseconds of work, by the device's own clock, that a rollout may have on the queue for anchors at a time, so that the engine's
    /// frames get their turn in between: before a pass that would make it more, the rollout waits for what is there. A pass is never
    /// divided: cairn_rollout_statistics has the longest, and how often was waited. 0 for no limit.
    pub longest_submission_us: u32,
}
describe!(cairn_d3d12_options, [], { struct_size, flags, captured_passes, longest_submission_us });

/// Says how a device runs worlds that are loaded, and rollouts that are made, from now on.
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

/// Gives what a device runs on.
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
        let device = running.look()?.rollout.world().device().clone();
        // SAFETY: the host's promise about its objects.
        let picture = unsafe { behind::read(&device, picture, state) }?;
        let made = running.run(&Job::Append(picture))?;
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

/// Records the frame that is due into the engine's command list, as cairn_presenter_draw writes it into memory. Compute shaders make it
/// on the device unless options.shader is CAIRN_PREFER_NEVER; where they cannot, the processor does, and the list copies it from memory of
/// the presenter's: cairn_presenter_get_statistics says which, and why. target needs no view and no access for shaders. Shaders leave
/// another pipeline, compute root signature and descriptor heaps in the list. Waits where three lists before it have not run yet; work
/// on anchors is waited for on the queue and not here.
///
/// A cut that only the generator finds shows the nearer anchor as well, but frame says so only where the processor made it; the
/// statistics count it once the list has run.
///
/// device: the one on whose queue the list will run.
/// now_ns: when it will be shown, on the host's clock.
/// list: open for recording, of the queue's type; to be given to the queue before the next frame is recorded.
/// target: of the frames' size, two-dimensional with one level, slice and sample; RGBA8, BGRA8, RGB10A2 or RGBA16F, views for sRGB and
/// typeless ones included; RGBA16F where the presenter's colour space is CAIRN_COLOUR_LINEAR. In before on entry and in after on
/// exit, both D3D12_RESOURCE_STATES that the list can name: a compute list cannot name RENDER_TARGET. It and the presenter must live
/// until the list has run.
/// frame: may be null.
///
/// Ownership: list and target stay the caller's, and the presenter may hold a reference to target until the frame after next but one is
/// recorded or cairn_presenter_release_d3d12 is called; frame is filled on success; on failure it is not written and no frame is recorded.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also
/// when CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS meets an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for
/// a CPU device, and where options.shader is CAIRN_PREFER_REQUIRE and shaders cannot make it; CAIRN_ERROR_OUT_OF_MEMORY;
/// CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_record_d3d12(
    presenter: *mut cairn_presenter,
    device: *const cairn_device,
    now_ns: u64,
    list: *mut ID3D12GraphicsCommandList,
    target: *mut ID3D12Resource,
    before: u32,
    after: u32,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_record_d3d12", || {
        let presenting = enter_alone(presenter)?;
        let device = enter(device)?;
        given(list, "list")?;
        given(target, "target")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        let target = To { list, target, before, after };
        // SAFETY: the host's promise about its objects.
        let made = unsafe { presenting.record(&device, now_ns, &target) }?;
        let Some((shown, _)) = made else { return Ok(CAIRN_NOT_READY) };
        frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
        Ok(CAIRN_OK)
    })
}

/// Has the frame that is due written to a texture on the device's queue, as cairn_presenter_record_d3d12 records it, in a list of the
/// presenter's own and behind all that the queue has been given.
///
/// device, now_ns, target, before, after, frame: as for cairn_presenter_record_d3d12.
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
        let target = To { list: std::ptr::null_mut(), target, before, after };
        // SAFETY: the host's promise about its objects.
        let made = unsafe { presenting.record(&device, now_ns, &target) }?;
        let Some((shown, Some(guard))) = made else { return Ok(CAIRN_NOT_READY) };
        // SAFETY: checked above; writable by the host's promise.
        unsafe { fence.write(guard.fence) };
        // SAFETY: as above.
        unsafe { value.write(guard.value) };
        frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
        Ok(CAIRN_OK)
    })
}

/// Waits until all frames have run and lets go of their targets, as a swap chain wants it before its buffers are resized. Lists that were
/// recorded must have been given to the queue, or never will be.
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

/// Where a frame is recorded to.
#[cfg_attr(not(windows), expect(dead_code, reason = "what stands behind the door reads it"))]
pub(super) struct To {
    list: *mut ID3D12GraphicsCommandList,
    target: *mut ID3D12Resource,
    before: u32,
    after: u32,
}

/// Refuses a null pointer to an object of Direct3D.
pub(super) fn given<T>(pointer: *mut T, name: &str) -> Outcome<()> {
    if pointer.is_null() { Err(Failure::argument(name, "a null pointer")) } else { Ok(()) }
}
