//! AMD's swap chain, for engines that want AMD to present. The implementation is built for Windows only.

use std::ffi::c_void;

use crate::locks::Mutex;

use super::boundary::call;
use super::d3d12::{ID3D12GraphicsCommandList, ID3D12Resource, check_not_null};
use super::device::cairn_device;
use super::handles::{Handle, Kind, Object, destroy, enter, enter_before_destruction, enter_serialized, insert_to};
use super::results::{CAIRN_ERROR_BUSY, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_flags, check_out, read};

#[cfg_attr(windows, path = "swapchain/windows.rs")]
#[cfg_attr(not(windows), path = "swapchain/unsupported.rs")]
mod backend;
#[cfg(any(windows, test))]
mod convert;
pub mod structs;

use backend::{SwapchainObject, is_presenting_thread};
pub use structs::*;

/// DXGI's own, declared so that its header is not needed.
pub struct IDXGIFactory(());

/// DXGI's own, declared so that its header is not needed.
pub struct IDXGISwapChain(());

/// DXGI's own, declared so that its header is not needed.
pub struct IDXGISwapChain4(());

/// DXGI's own, declared so that its header is not needed.
pub struct DXGI_SWAP_CHAIN_DESC(());

/// DXGI's own, declared so that its header is not needed.
pub struct DXGI_SWAP_CHAIN_DESC1(());

/// DXGI's own, declared so that its header is not needed.
pub struct DXGI_SWAP_CHAIN_FULLSCREEN_DESC(());

/// AMD's swap chain, which presents generated frames between an engine's own and paces them. A presenter's frames do not need it: they go
/// into textures, which the engine presents as it likes. Experimental, like all of this chapter; not available if the library has no
/// Direct3D 12 part.
///
/// The engine draws into its buffers and calls Present as usual; before that it records the frame's motion and depth with
/// cairn_swapchain_prepare. AMD's swap chain presents on threads of its own. AMD's libraries are searched for as cairn_device_options
/// says.
///
/// Threads: a call on the DXGI swap chain, such as Present, counts as a call on this object.
pub struct cairn_swapchain(());

impl Handle for cairn_swapchain {
    const KIND: Kind = Kind::Swapchain;
    const NAME: &'static str = "cairn_swapchain";
    type Object = Mutex<SwapchainObject>;
}

impl Object for Mutex<SwapchainObject> {
    fn is_on_own_thread(&self) -> bool {
        is_presenting_thread()
    }
}

/// Replaces an engine's swap chain by AMD's. It must be windowed, *own must be the only reference to it, and none of its buffers may be
/// referenced.
///
/// device: its queue for frames must be the direct queue that the engine draws on.
/// options: may be null for the defaults.
/// own: becomes null once AMD's library gets the swap chain, even if that library then fails; an earlier failure leaves it unchanged.
///
/// Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy, and the reference in *own is gone; on failure
/// *swapchain is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also where AMD's library would hang or crash: for a queue
/// that is not direct, and a swap chain that is full screen, has no size, has other references or has a number of buffers other than 2 to 16,
/// with AMD's SDK 1.1 2 to 6; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED, also if no provider passes the self-test, and for frames
/// without user interface in a format of their own with AMD's SDK 1.1.2 and earlier; CAIRN_ERROR_RUNTIME_MISSING if AMD's libraries are missing;
/// CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_wrap(
    device: *const cairn_device,
    options: *const cairn_swapchain_options,
    own: *mut *mut IDXGISwapChain,
    swapchain: *mut *mut cairn_swapchain,
) -> cairn_result {
    call("cairn_swapchain_wrap", || {
        let device = enter(device)?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { checked_options(options) }?;
        check_out(own, "own")?;
        check_out(swapchain, "swapchain")?;
        // SAFETY: checked above, and the host's promise about it and its object.
        let made = unsafe { backend::wrap(&device, &options, &mut *own) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to(Mutex::new(made), swapchain) }
    })
}

/// Creates AMD's swap chain as IDXGIFactory::CreateSwapChain does.
///
/// device, options: as for cairn_swapchain_wrap.
/// description: of the swap chain, which must be windowed.
///
/// Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy; on failure it is not written. factory stays the
/// caller's.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_create(
    device: *const cairn_device,
    options: *const cairn_swapchain_options,
    factory: *mut IDXGIFactory,
    description: *const DXGI_SWAP_CHAIN_DESC,
    swapchain: *mut *mut cairn_swapchain,
) -> cairn_result {
    call("cairn_swapchain_create", || {
        let device = enter(device)?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { checked_options(options) }?;
        check_not_null(factory, "factory")?;
        check_not_null(description.cast_mut(), "description")?;
        check_out(swapchain, "swapchain")?;
        // SAFETY: the host's promise about its object and its struct.
        let made = unsafe { backend::create(&device, &options, factory, description) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to(Mutex::new(made), swapchain) }
    })
}

/// Creates AMD's swap chain for a window as IDXGIFactory2::CreateSwapChainForHwnd does.
///
/// device, options: as for cairn_swapchain_wrap.
/// window: a HWND that outlives the swap chain.
/// fullscreen: may be null; otherwise its Windowed must be true.
///
/// Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy; on failure it is not written. factory stays the
/// caller's.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_create_for_window(
    device: *const cairn_device,
    options: *const cairn_swapchain_options,
    factory: *mut IDXGIFactory,
    window: *mut c_void,
    description: *const DXGI_SWAP_CHAIN_DESC1,
    fullscreen: *const DXGI_SWAP_CHAIN_FULLSCREEN_DESC,
    swapchain: *mut *mut cairn_swapchain,
) -> cairn_result {
    call("cairn_swapchain_create_for_window", || {
        let device = enter(device)?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { checked_options(options) }?;
        check_not_null(factory, "factory")?;
        check_not_null(window, "window")?;
        check_not_null(description.cast_mut(), "description")?;
        check_out(swapchain, "swapchain")?;
        // SAFETY: the host's promise about its object and its structs.
        let made = unsafe { backend::create_for_window(&device, &options, factory, window, description, fullscreen) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to(Mutex::new(made), swapchain) }
    })
}

/// Gives the DXGI swap chain, into whose buffers the engine draws and which it presents.
///
/// Ownership: on success *dxgi is a new reference, which the caller releases before cairn_swapchain_destroy; on failure it is not
/// written.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_get_dxgi(
    swapchain: *mut cairn_swapchain,
    dxgi: *mut *mut IDXGISwapChain4,
) -> cairn_result {
    call("cairn_swapchain_get_dxgi", || {
        check_out(dxgi, "dxgi")?;
        let object = enter_serialized(swapchain)?;
        let reference = object.lock().dxgi();
        // SAFETY: checked above; writable by the host's promise.
        unsafe { dxgi.write(reference) };
        Ok(CAIRN_OK)
    })
}

/// Records motion and depth of the frame that is presented next; Present then also shows a frame generated between it and the previous
/// one. A frame without this recording is presented twice, unless generation is paused, and the next one has no history. The list's
/// descriptor heaps, compute root signature and pipeline are replaced; the rest of its state does not change.
///
/// list: open for recording, for the device's queue; execute it there before Present.
///
/// Ownership: everything stays the caller's, on success and on failure. What frame points to must live until the list has run, and
/// textures that are read within Present until it returns, with CAIRN_SWAPCHAIN_ASYNC until the next Present returns.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT with nothing recorded; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE if buffers were resized and cairn_swapchain_fit was not called; CAIRN_ERROR_OUT_OF_MEMORY;
/// CAIRN_ERROR_DEVICE and CAIRN_ERROR_DEVICE_REMOVED, after which the list may hold a part of the work.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_prepare(
    swapchain: *mut cairn_swapchain,
    list: *mut ID3D12GraphicsCommandList,
    frame: *const cairn_swapchain_frame,
) -> cairn_result {
    call("cairn_swapchain_prepare", || {
        check_not_null(list, "list")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { read(frame, "frame") }?;
        check_frame(&frame)?;
        let object = enter_serialized(swapchain)?;
        // SAFETY: the host's promise about its objects.
        unsafe { object.lock().prepare(list, &frame) }?;
        Ok(CAIRN_OK)
    })
}

/// Sets the picture of the user interface, which is composited over real and generated frames from the next Present on. Waits for frames
/// that show the previous picture.
///
/// picture: of the buffers' size, with alpha; null for none. It is read within Present and after it; without CAIRN_INTERFACE_COPIED do not
/// draw to it before cairn_swapchain_wait.
/// state: the picture's D3D12_RESOURCE_STATES whenever the library reads it.
/// flags: CAIRN_INTERFACE_PREMULTIPLIED, CAIRN_INTERFACE_COPIED
///
/// Ownership: picture stays the caller's; on success the swap chain keeps a reference until another picture is set; on failure it keeps
/// the previous one.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
/// CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_set_interface(
    swapchain: *mut cairn_swapchain,
    picture: *mut ID3D12Resource,
    state: u32,
    flags: u32,
) -> cairn_result {
    call("cairn_swapchain_set_interface", || {
        check_flags(flags, CAIRN_INTERFACE_PREMULTIPLIED | CAIRN_INTERFACE_COPIED, "flags")?;
        let object = enter_serialized(swapchain)?;
        // SAFETY: the host's promise about its object.
        unsafe { object.lock().set_interface(picture, state, flags) }?;
        Ok(CAIRN_OK)
    })
}

/// Sets the pacing of presents.
///
/// pacing: null for AMD's defaults.
///
/// Ownership: pacing is read during the call; nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_UNSUPPORTED with AMD's SDK 1.1.2 and earlier; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_set_pacing(
    swapchain: *mut cairn_swapchain,
    pacing: *const cairn_swapchain_pacing,
) -> cairn_result {
    call("cairn_swapchain_set_pacing", || {
        // SAFETY: the host's promise about `pacing`.
        let pacing = unsafe { checked_pacing(pacing) }?;
        enter_serialized(swapchain)?.lock().set_pacing(pacing.as_ref())?;
        Ok(CAIRN_OK)
    })
}

/// Disables generated frames until a frame is prepared again. Waits until all frames are shown.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_pause(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_pause", || {
        enter_serialized(swapchain)?.lock().pause()?;
        Ok(CAIRN_OK)
    })
}

/// Waits until all frames that were given to Present are shown.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_wait(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_wait", || {
        enter_serialized(swapchain)?.lock().wait()?;
        Ok(CAIRN_OK)
    })
}

/// Adapts to the current size and format of the buffers: call it after ResizeBuffers, before the next frame is prepared. An interface of
/// another size is removed. After a failure no frames are generated until it succeeds.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_fit(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_fit", || {
        enter_serialized(swapchain)?.lock().fit()?;
        Ok(CAIRN_OK)
    })
}

/// Gives counters and memory use of a swap chain.
///
/// Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
/// Threads: any thread, at any time; waits for another call on the swap chain.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_DEVICE;
/// CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_get_statistics(
    swapchain: *const cairn_swapchain,
    statistics: *mut cairn_swapchain_statistics,
) -> cairn_result {
    call("cairn_swapchain_get_statistics", || {
        // SAFETY: the host's promise about `statistics`.
        let statistics = unsafe { Out::new(statistics, "statistics") }?;
        let object = enter(swapchain)?;
        let current = object.lock_part(&*object)?.statistics()?;
        statistics.write(&current);
        Ok(CAIRN_OK)
    })
}

/// Destroys a swap chain in the order that AMD requires: disables generation, finishes presenting, destroys the generator, the swap chain
/// and its pacing. Null is allowed. The engine must first release every reference to the DXGI swap chain and its buffers.
///
/// Ownership: on success swapchain is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the swap chain.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY while there are references to the DXGI swap chain, and from within a
/// callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_destroy(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_destroy", || {
        if !swapchain.is_null() {
            // A reference that is left could present with destroyed objects.
            let object = enter_before_destruction(swapchain.cast_const())?;
            let references = object.lock_part(&*object)?.external_references();
            if references > 0 {
                let why = format!("references to the DXGI swap chain that are left: {references}");
                return Err(Failure::new(CAIRN_ERROR_BUSY, why).field("swapchain").remedy("Release them first"));
            }
        }
        destroy(swapchain)
    })
}
