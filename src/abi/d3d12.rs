//! Direct3D 12: entry points that take an engine's own objects. `backend` is their implementation, on Windows or on other systems.

use std::ffi::c_void;
use std::time::Duration;

use super::anchor::{cairn_anchor, check_index};
use super::boundary::call;
use super::device::{DeviceOptions, cairn_device, cairn_device_options};
use super::handles::{busy_in_callback, enter, enter_serialized, insert_to};
use super::presenter::{cairn_frame, cairn_presenter, to_c_frame};
use super::results::{AbiResult, CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, Failure, cairn_result};
use super::rollout::{cairn_rollout, cairn_step_info, step_info};
use super::structs::{Out, check_flags, check_out, check_zero, describe, read};
use crate::runtime::{Device, DeviceKind};
use crate::world::Job;
use types::{AnchorTexture, FenceValue, FramePreparation, FrameResult, FrameTarget, WorldOptions};

#[cfg_attr(windows, path = "d3d12/windows.rs")]
#[cfg_attr(not(windows), path = "d3d12/unsupported.rs")]
pub(super) mod backend;
pub(super) mod types;

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

/// Creates a device on an engine's own Direct3D 12 device. Experimental: this chapter may change without a new CAIRN_ABI_VERSION. If the
/// library has no Direct3D 12 part, every function of the chapter returns CAIRN_ERROR_UNSUPPORTED.
///
/// d3d12, queue: the engine's; frames are generated and copied on the queue, which must be of type direct or compute.
/// anchors: a compute queue of the same device for the world's passes, so that they do not delay frames; null for one of the library's
/// own.
/// options: may be null for the defaults.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy, and holds a reference to each object until it is
/// destroyed; on failure it is not written and no reference is held. What options point to is read during the call only.
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
        check_not_null(d3d12, "d3d12")?;
        check_not_null(queue, "queue")?;
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        // SAFETY: the host's promise about its objects.
        let made = unsafe { backend::of_engine(d3d12.cast(), queue.cast(), anchors.cast(), options) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_device>(made, device) }
    })
}

/// Creates a device on an adapter, for hosts without an engine: with a Direct3D 12 device of the library's own.
///
/// luid: LUID of the adapter, as in cairn_adapter.
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
        let made = backend::on_adapter(luid, options)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_device>(made, device) }
    })
}

/// A flag of cairn_d3d12_options: uses ONNX Runtime's deterministic kernels only, and captures no passes.
pub const CAIRN_D3D12_DETERMINISTIC: u32 = 1;

/// Options of worlds on a Direct3D 12 device. All zero: the options of a new device.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_options {
    /// sizeof(cairn_d3d12_options)
    pub struct_size: u32,
    /// CAIRN_D3D12_DETERMINISTIC, or 0.
    pub flags: u32,
    /// Largest number of passes of each of a world's graphs that ONNX Runtime may capture: it keeps their commands, and such a pass takes
    /// almost no time of the processor. A rollout has at most two per graph; those of destroyed rollouts are kept as long as the world. A
    /// captured pass is used only if it gives the same bits as a normal one, which its first runs show. 0 for none.
    pub captured_passes: u32,
    /// Longest work of a rollout that may be queued on the anchors' queue at a time, in microseconds of the device's clock, so that the
    /// engine's frames run in between. A pass that would exceed it waits for the work that is queued already. Passes are split only into
    /// the slices of their world (cairn_world_options): cairn_rollout_statistics has the longest one and the number of waits. 0 for no limit.
    pub longest_submission_us: u32,
}
describe!(cairn_d3d12_options, [], { struct_size, flags, captured_passes, longest_submission_us });

/// Sets the options of a device for worlds that are loaded, and rollouts that are created, from now on.
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
        check_flags(options.flags, CAIRN_D3D12_DETERMINISTIC, "options.flags")?;
        let longest = Some(options.longest_submission_us).filter(|microseconds| *microseconds > 0);
        let options = WorldOptions {
            deterministic: options.flags & CAIRN_D3D12_DETERMINISTIC != 0,
            captured_passes: options.captured_passes as usize,
            longest_submission: longest.map(|microseconds| Duration::from_micros(microseconds.into())),
        };
        backend::set_options(&device, &options)?;
        Ok(CAIRN_OK)
    })
}

/// Returns the Direct3D 12 device and the queue that a device runs on.
///
/// Ownership: on success *d3d12 and *queue each have one more reference, which the caller releases; on failure neither is written.
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
        let (own, frames) = backend::device_and_queue(&device).ok_or_else(Failure::no_d3d12)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { d3d12.write(own.cast()) };
        // SAFETY: as above.
        unsafe { queue.write(frames.cast()) };
        Ok(CAIRN_OK)
    })
}

/// Appends a texture, as cairn_rollout_append appends a picture: the seed, or an edit of the scene.
///
/// picture: two-dimensional, RGBA8 or BGRA8, one slice. It is read on the device's queue after the work that the queue already has, and must
/// live until this returns.
/// state: D3D12_RESOURCE_STATES of the texture when it is read; it is left in that state.
/// info: may be null.
///
/// Ownership: the texture stays the caller's; info is filled on success; on failure it is not written and the rollout is as it was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
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
        let running = enter_serialized(rollout)?;
        check_not_null(picture, "picture")?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::optional(info, "info") }?;
        let device = running.lock_between_steps(running.is_nested())?.rollout.world().device().clone();
        // SAFETY: the host's promise about its objects.
        let picture = unsafe { backend::read_texture(&device, picture.cast(), state) }?;
        let made = running.run(&Job::Append(vec![picture]))?;
        info.into_iter().for_each(|info| info.write(&step_info(&made)));
        Ok(CAIRN_OK)
    })
}

/// Returns a picture of an anchor as a texture, with the fence value that guards it.
///
/// index: 0 to pictures - 1, in order of time.
/// texture: gets a texture in RGBA8 of the anchor's size, in state COMMON, in which it must be left.
/// fence, value: get the fence and the value to wait for before the texture is read. Once the fence has the value, the texture does not
/// change. Read it on the device's queue, or on another one while no presenter or rollout of the device works: their lists change its
/// state and back.
///
/// Ownership: on success *texture and *fence each have one more reference, which the caller releases; on failure nothing is written.
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
        let AnchorTexture { texture: picture, guard } = backend::anchor_texture(&anchor, index)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { texture.write(picture.cast()) };
        // SAFETY: as above.
        unsafe { fence.write(guard.fence.cast()) };
        // SAFETY: as above.
        unsafe { value.write(guard.value) };
        Ok(CAIRN_OK)
    })
}

/// Largest number of recorded frames whose lists may not have run: see cairn_d3d12_preparation.lists.
pub const CAIRN_MAX_LISTS: u32 = 16;
/// A flag of cairn_d3d12_preparation: frames are only submitted, so no memory is allocated for recorded ones.
pub const CAIRN_PREPARE_SUBMIT_ONLY: u32 = 1;

/// Returns pipelines that cairn_pipelines_store_callback received in an earlier run. Called on the preparing thread: first with null and 0,
/// to return the number of bytes, 0 for none; then with memory of that size, to fill it and return the same number.
pub type cairn_pipelines_load_callback =
    Option<unsafe extern "C" fn(bytes: *mut c_void, capacity: u64, user: *mut c_void) -> u64>;

/// Receives the pipelines of a device. Called on the preparing thread; the bytes are valid during the call only. Bytes of another adapter,
/// driver or version of the library, and damaged ones, are ignored when they are loaded.
pub type cairn_pipelines_store_callback =
    Option<unsafe extern "C" fn(bytes: *const c_void, size: u64, user: *mut c_void)>;

/// Sizes and formats to prepare frames for Direct3D 12 for. All zero: frames of the presenter's size in any format, from anchors of the size
/// of those that have arrived.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_preparation {
    /// sizeof(cairn_d3d12_preparation)
    pub struct_size: u32,
    /// DXGI_FORMAT of the targets; 0 for any supported format, with memory for the widest.
    pub format: u32,
    /// Width of the targets in pixels; 0 in width and height for the size of the presenter's frames.
    pub width: u32,
    /// Height of the targets in pixels.
    pub height: u32,
    /// Width of the anchors in pixels, 1 to 16384; 0 in anchor_width and anchor_height for the size of the anchors that have arrived.
    pub anchor_width: u32,
    /// Height of the anchors in pixels, 1 to 16384.
    pub anchor_height: u32,
    /// Pictures per anchor, as cairn_anchor_info.pictures; 0 for 1.
    pub anchor_pictures: u32,
    /// As in cairn_anchor_info, if options.motion is CAIRN_MOTION_PAPER; else 0, like latent_height and latent_width.
    pub latent_channels: u32,
    /// As in cairn_anchor_info.
    pub latent_height: u32,
    /// As in cairn_anchor_info.
    pub latent_width: u32,
    /// Largest number of frames recorded into the engine's lists that may not have run, 1 to CAIRN_MAX_LISTS; 0 for 4. Each takes the memory
    /// of a frame.
    pub lists: u32,
    /// CAIRN_PREPARE_SUBMIT_ONLY, or 0.
    pub flags: u32,
    /// Returns pipelines of an earlier run; may be null.
    pub load: cairn_pipelines_load_callback,
    /// Receives pipelines for the next run; may be null.
    pub store: cairn_pipelines_store_callback,
    /// Passed to both callbacks.
    pub user: *mut c_void,
}
describe!(cairn_d3d12_preparation, [], {
    struct_size, format, width, height, anchor_width, anchor_height, anchor_pictures, latent_channels, latent_height,
    latent_width, lists, flags, load, store, user,
});

/// Creates everything that frames for Direct3D 12 need: pipelines, textures, memory, AMD's libraries with their contexts, and the test that
/// these must pass. Afterwards cairn_presenter_record_d3d12 and cairn_presenter_submit_d3d12 create nothing for frames of these sizes and
/// this format. Call it on a loading thread: it blocks until all is created, for seconds the first time.
///
/// Until it was called, and for frames of another size, format or device, those two show the nearest anchor instead of each frame, resized on
/// the processor and flagged with CAIRN_FRAME_UNPREPARED: call it again when targets change their size. The preparation before is used until
/// the call returns, and stays in use if the call fails, unless there is no memory for both.
///
/// Pipelines live as long as the device, and its presenters share them. With callbacks the host keeps them from one run of the program to the
/// next, if the driver supports it; the library writes no file. load is called once per device; store is called if pipelines were compiled
/// that were neither loaded nor stored before, with all pipelines of the device.
///
/// device: the device on whose queue frames will be made.
///
/// Ownership: preparation is read during the call; user stays the caller's; nothing is handed over, on success or on failure.
/// Threads: any thread, also while another one pushes, queries, records or submits; a second one that prepares the same presenter gets
/// CAIRN_ERROR_BUSY. Callbacks may call any function but those that destroy the presenter or the device.
/// Results: CAIRN_OK; CAIRN_NOT_READY if no anchor has arrived and the preparation has no anchor size;
/// CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU
/// device and if a required generator or upscaler cannot be used; CAIRN_ERROR_RUNTIME_MISSING if AMD's libraries are required and
/// missing; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_prepare_d3d12(
    presenter: *const cairn_presenter,
    device: *const cairn_device,
    preparation: *const cairn_d3d12_preparation,
) -> cairn_result {
    call("cairn_presenter_prepare_d3d12", || {
        let object = enter(presenter)?;
        if object.is_nested() {
            // Replacing the preparation would wait for the frame that made this callback.
            return Err(busy_in_callback());
        }
        let device = enter(device)?;
        // SAFETY: the host's promise about `preparation`.
        let preparation = unsafe { read(preparation, "preparation") }?;
        let refuse = |field: &str, cause: String| Err(Failure::argument(&format!("preparation.{field}"), cause));
        let sides = 1..=crate::MAX_SIDE;
        for (field, size) in [
            ("width", (preparation.width, preparation.height)),
            ("anchor_width", (preparation.anchor_width, preparation.anchor_height)),
        ] {
            if size != (0, 0) && !(sides.contains(&size.0) && sides.contains(&size.1)) {
                return refuse(field, format!("{} x {} pixels", size.0, size.1));
            }
        }
        if preparation.lists > CAIRN_MAX_LISTS {
            return refuse("lists", format!("{} recorded frames cannot be kept", preparation.lists));
        }
        check_flags(preparation.flags, CAIRN_PREPARE_SUBMIT_ONLY, "preparation.flags")?;
        check_gpu(&device)?;
        let nonzero = |size: (u32, u32)| (size != (0, 0)).then_some(size);
        let preparation = FramePreparation {
            size: nonzero((preparation.width, preparation.height)),
            anchor_size: nonzero((preparation.anchor_width, preparation.anchor_height)),
            format: preparation.format,
            lists: match preparation.lists {
                _ if preparation.flags & CAIRN_PREPARE_SUBMIT_ONLY != 0 => Some(0),
                0 => None,
                lists => Some(lists as usize),
            },
            pictures: preparation.anchor_pictures as usize,
            latent: [preparation.latent_channels, preparation.latent_height, preparation.latent_width],
            load: preparation.load,
            store: preparation.store,
            user: preparation.user,
        };
        let is_known = backend::prepare(&object.renderer, &object.presenter, &device, &preparation)?;
        Ok(if is_known { CAIRN_OK } else { CAIRN_NOT_READY })
    })
}

/// A command list of the engine's that a frame is recorded into, and the frame's target.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_d3d12_recording {
    /// sizeof(cairn_d3d12_recording)
    pub struct_size: u32,
    /// D3D12_RESOURCE_STATES of the target before the frame.
    pub state_before: u32,
    /// D3D12_RESOURCE_STATES of the target after the frame.
    pub state_after: u32,
    /// 0
    pub reserved: u32,
    /// Command list, open for recording, of the type of the device's queue.
    pub list: *mut ID3D12GraphicsCommandList,
    /// Texture of the frames' size, two-dimensional with one mip level, slice and sample; RGBA8, BGRA8, RGB10A2, RGBA16F or R11G11B10_FLOAT,
    /// including the sRGB and typeless variants; RGBA16F or R11G11B10_FLOAT if the presenter's colour space is CAIRN_COLOUR_LINEAR.
    pub target: *mut ID3D12Resource,
    /// A fence of the host's, of the same device.
    pub fence: *mut ID3D12Fence,
    /// Value that the host signals on the queue that executes the list, after the list.
    pub fence_value: u64,
}
describe!(cairn_d3d12_recording, [], {
    struct_size, state_before, state_after, reserved, list, target, fence, fence_value,
});

/// Makes the frame that is due on the device's queue, the same frame that cairn_presenter_draw writes into memory, and records its copy into
/// the engine's command list. Compute shaders make it unless options.shader is CAIRN_PREFER_NEVER; if they cannot be used, the processor
/// makes it: cairn_presenter_get_statistics tells which, and why. Records a barrier, a copy and a barrier into the list; changes nothing else of
/// it.
///
/// The list may be executed early or late, in another order than it was recorded in, or never. The memory that it copies from is reused once
/// the fence has its value, and not before; nothing waits for it. Several lists may share a value that is signalled after all of them. If a
/// list is dropped, the host signals its value, or calls cairn_presenter_release_d3d12.
///
/// Across a cut that only the generator detects, the nearer anchor is shown, too. frame tells so only if the processor made the frame; the
/// statistics count the cut once the frame has run.
///
/// device: the device on whose queue the list will run; on another queue the list must wait for the work that the device's queue has so far.
/// now_ns: when it will be shown, on the host's clock.
/// recording: its two states must be ones that the list can name: a compute list cannot name RENDER_TARGET. The presenter must live until the
/// list has run.
/// frame: may be null.
///
/// Ownership: all objects stay the caller's, and the presenter holds a reference to the fence until it has its value; on success frame is
/// filled; on failure it is not written and no frame is recorded.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY. Does not wait for a thread that prepares.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_QUEUE_FULL if as many lists as were prepared may not have
/// run: nothing is recorded, and the target keeps its contents; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also without a fence,
/// for a fence of another device or one that has the value already, and if CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS is used with an anchor
/// without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU device; CAIRN_ERROR_OUT_OF_MEMORY;
/// CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
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
        let object = enter_serialized(presenter)?;
        let device = enter(device)?;
        // SAFETY: the host's promise about `recording`.
        let recording = unsafe { read(recording, "recording") }?;
        check_not_null(recording.list, "recording.list")?;
        check_not_null(recording.target, "recording.target")?;
        if recording.fence.is_null() {
            return Err(Failure::argument("recording.fence", "without a fence it is not known when the list has run")
                .remedy("Pass a fence that the queue signals after the list, or use cairn_presenter_submit_d3d12"));
        }
        check_zero(recording.reserved, "recording.reserved")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        let cairn_d3d12_recording { state_before, state_after, list, target, fence, fence_value, .. } = recording;
        let guard = FenceValue { fence: fence.cast(), value: fence_value };
        let list = Some((list.cast(), guard));
        let to = FrameTarget { list, texture: target.cast(), before: state_before, after: state_after };
        check_gpu(&device)?;
        // SAFETY: the host's promise about its objects.
        match unsafe { backend::record(&object.renderer, &object.presenter, &device, now_ns, &to) }? {
            FrameResult::NotReady => Ok(CAIRN_NOT_READY),
            FrameResult::QueueFull => Ok(CAIRN_QUEUE_FULL),
            FrameResult::Frame(info, _) => {
                frame.into_iter().for_each(|frame| frame.write(&to_c_frame(&info)));
                Ok(CAIRN_OK)
            }
        }
    })
}

/// Makes the frame that is due in a texture, in a list of the presenter's own that it submits to the device's queue after all earlier work.
/// Waits if three earlier frames have not run.
///
/// device, now_ns, frame: as for cairn_presenter_record_d3d12.
/// target, before, after: the texture and its states, as in cairn_d3d12_recording. The presenter may hold a reference to target until the third
/// frame after it is made or cairn_presenter_release_d3d12 is called.
/// fence, value: get the fence and the value to wait for before the frame is read outside the queue, and before target is freed.
///
/// Ownership: target stays the caller's; on success *fence has one more reference, which the caller releases, and frame is filled;
/// on failure nothing is written and no frame was submitted.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY. The queue may be used by others at the same time.
/// Results: CAIRN_OK; CAIRN_NOT_READY, CAIRN_QUEUE_FULL and the errors, as of cairn_presenter_record_d3d12.
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
        let object = enter_serialized(presenter)?;
        let device = enter(device)?;
        check_not_null(target, "target")?;
        check_out(fence, "fence")?;
        check_out(value, "value")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        let to = FrameTarget { list: None, texture: target.cast(), before, after };
        check_gpu(&device)?;
        // SAFETY: the host's promise about its objects.
        let made = unsafe { backend::record(&object.renderer, &object.presenter, &device, now_ns, &to) }?;
        let (info, guard) = match made {
            FrameResult::Frame(info, Some(guard)) => (info, guard),
            FrameResult::QueueFull => return Ok(CAIRN_QUEUE_FULL),
            FrameResult::Frame(_, None) | FrameResult::NotReady => return Ok(CAIRN_NOT_READY),
        };
        // SAFETY: checked above; writable by the host's promise.
        unsafe { fence.write(guard.fence.cast()) };
        // SAFETY: as above.
        unsafe { value.write(guard.value) };
        frame.into_iter().for_each(|frame| frame.write(&to_c_frame(&info)));
        Ok(CAIRN_OK)
    })
}

/// Waits until all frames have run and releases their targets, as a swap chain requires before its buffers are resized. Every list that a
/// frame was recorded into must have been submitted to the queue, or must never run: the memory it copies from is reused whether or not its
/// fence has its value.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_release_d3d12(presenter: *mut cairn_presenter) -> cairn_result {
    call("cairn_presenter_release_d3d12", || {
        let object = enter_serialized(presenter)?;
        // The call is made in a callback of a preparation, whose lock the release would wait for.
        if object.is_nested() {
            return Err(busy_in_callback());
        }
        backend::release(&object.renderer)?;
        Ok(CAIRN_OK)
    })
}

/// Refuses a device that is not a Direct3D 12 device.
fn check_gpu(device: &Device) -> AbiResult<()> {
    if device.kind() == DeviceKind::Direct3d12 { Ok(()) } else { Err(Failure::no_d3d12()) }
}

/// Refuses a null pointer to a Direct3D object.
pub(super) fn check_not_null<T>(pointer: *mut T, name: &str) -> AbiResult<()> {
    if pointer.is_null() { Err(Failure::argument(name, "a null pointer")) } else { Ok(()) }
}
