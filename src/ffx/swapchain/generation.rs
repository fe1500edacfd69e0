//! The callback by which AMD's swap chain has a frame generated within `Present`.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use windows::Win32::Graphics::Direct3D12::{
    D3D12_RESOURCE_DESC, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATES,
    ID3D12GraphicsCommandList, ID3D12Resource,
};
use windows::core::Interface as _;

use super::super::Api;
use super::super::bindings::{DispatchFrameGeneration, RawContext, Resource, ReturnCode};
use crate::gpu::compute::transition;
use crate::locks::ReentrantMutex;

/// State that the `generate` callback reads and writes.
pub(super) struct CallbackData {
    pub(super) api: Api,
    /// The generator's context; the lock serialises its calls. Null without a generator.
    pub(super) context: ReentrantMutex<Cell<RawContext>>,
    /// Id of the frame that is prepared and not yet presented; 0 for none.
    pub(super) prepared: AtomicU64,
    /// Id of the frame that resets the history; 0 for none.
    pub(super) reset: AtomicU64,
    pub(super) generated: AtomicU64,
    /// Number of frames that were shown twice instead.
    pub(super) repeated: AtomicU64,
    /// Return code of the last failed generation; 0 if none failed.
    pub(super) failed: AtomicU32,
    /// A frame was not generated since the last prepared one, so that the history has a gap.
    pub(super) has_gap: AtomicBool,
}

// SAFETY: the context is only used under its lock.
unsafe impl Send for CallbackData {}
// SAFETY: as above.
unsafe impl Sync for CallbackData {}

thread_local! {
    /// Whether AMD's library is generating a frame on this thread. Destroying the swap chain waits for that.
    static IS_GENERATING: Cell<bool> = const { Cell::new(false) };
}

/// Whether AMD's library is generating a frame on this thread, for example while it calls the message callback.
pub(crate) fn is_presenting_thread() -> bool {
    IS_GENERATING.get()
}

/// The generation callback that AMD's swap chain calls within `Present`: forwards the struct to the generator's context.
pub(super) unsafe extern "C" fn generate(request: *mut DispatchFrameGeneration, user: *mut c_void) -> ReturnCode {
    if request.is_null() || user.is_null() {
        return ReturnCode::PARAMETER;
    }
    // SAFETY: the user pointer that `prepare` passed; it lives until generation is turned off.
    let callback_data = unsafe { &*user.cast::<CallbackData>() };
    // SAFETY: the struct that the library has just passed, which the callback may change.
    let request = unsafe { &mut *request };
    // AMD's swap chain also asks for a frame before one that was not prepared, with the id of the last one that was.
    let is_prepared = callback_data.prepared.swap(0, Ordering::Relaxed) == request.frame_id;
    // SAFETY: as above.
    let code = if is_prepared { unsafe { forward(callback_data, request) } } else { ReturnCode::ERROR };
    if code == ReturnCode::OK {
        callback_data.generated.fetch_add(1, Ordering::Relaxed);
        return code;
    }
    if is_prepared {
        callback_data.failed.store(code.0, Ordering::Relaxed);
    }
    callback_data.has_gap.store(true, Ordering::Relaxed);
    // SAFETY: the library's struct; its list is open and its textures live during the callback.
    let is_repeated = unsafe { repeat_frame(request) }.is_some();
    callback_data.repeated.fetch_add(is_repeated.into(), Ordering::Relaxed);
    if is_repeated { ReturnCode::OK } else { code }
}

/// Has the generator record the frame.
///
/// # Safety
/// The library has just passed the struct to the callback.
unsafe fn forward(callback_data: &CallbackData, request: &mut DispatchFrameGeneration) -> ReturnCode {
    let lock = callback_data.context.lock();
    let context = lock.get();
    if context.is_null() {
        return ReturnCode::ERROR;
    }
    request.reset |= request.frame_id == callback_data.reset.load(Ordering::Relaxed);
    let before = IS_GENERATING.replace(true);
    // SAFETY: a live context, and the caller's promise.
    let code = unsafe { callback_data.api.forward(context, std::ptr::from_ref(request).cast()) };
    IS_GENERATING.set(before);
    code
}

/// Copies the rendered frame into the outputs for generated ones; `None`, before anything is recorded, if it cannot be copied.
///
/// AMD's swap chain shows an output whatever the callback returns, with what an earlier frame has left there. And after a callback that fails, it
/// does not close the command list, whose allocator it resets later (`FrameInterpolationSwapchainDX12.cpp` of SDK 2.1, function
/// `dispatchInterpolationCommands`, and `Dx12Commands` in its helpers).
///
/// # Safety
/// The list is open, and the textures are live and in the stated states.
unsafe fn repeat_frame(request: &DispatchFrameGeneration) -> Option<()> {
    // SAFETY: the caller's promise.
    let list = unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&request.command_list) }?;
    // SAFETY: as above.
    let (frame, state) = unsafe { texture(&request.present_color) }?;
    let kind = |texture: &ID3D12Resource| {
        let D3D12_RESOURCE_DESC { Dimension, Width, Height, DepthOrArraySize, MipLevels, Format, SampleDesc, .. } =
            // SAFETY: as above.
            unsafe { texture.GetDesc() };
        (Dimension, Width, Height, DepthOrArraySize, MipLevels, Format, SampleDesc)
    };
    let outputs = request.outputs.get(..request.frames as usize)?;
    for output in outputs {
        // SAFETY: as above.
        let (output, _) = unsafe { texture(output) }?;
        if kind(output) != kind(frame) {
            return None;
        }
    }
    let (read, written) = (D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATE_COPY_DEST);
    // SAFETY: as above.
    unsafe {
        list.ResourceBarrier(&[transition(frame, state, read)]);
        for output in outputs {
            let (output, state) = texture(output)?;
            list.ResourceBarrier(&[transition(output, state, written)]);
            list.CopyResource(output, frame);
            list.ResourceBarrier(&[transition(output, written, state)]);
        }
        list.ResourceBarrier(&[transition(frame, read, state)]);
    }
    Some(())
}

/// A described texture with its state.
///
/// # Safety
/// It is live, or null.
unsafe fn texture(given: &Resource) -> Option<(&ID3D12Resource, D3D12_RESOURCE_STATES)> {
    let state = D3D12_RESOURCE_STATES(given.state.to_d3d12()?.cast_signed());
    // SAFETY: the caller's promise.
    Some((unsafe { ID3D12Resource::from_raw_borrowed(&given.resource) }?, state))
}
