//! AMD's swap chain, for engines that want AMD to present. The implementation is built for Windows only.

use std::ffi::c_void;

use parking_lot::Mutex;

use super::boundary::call;
use super::d3d12::{ID3D12GraphicsCommandList, ID3D12Resource, given};
use super::device::cairn_device;
use super::handles::{Handle, Kind, Object, destroy, enter, enter_alone, insert};
use super::results::{CAIRN_ERROR_BUSY, CAIRN_OK, Failure, Outcome, cairn_result};
use super::structs::{Out, check_out, read};

#[cfg_attr(windows, path = "swapchain/windows.rs")]
#[cfg_attr(not(windows), path = "swapchain/unsupported.rs")]
mod behind;
pub mod structs;
#[cfg(any(windows, test))]
mod told;

use behind::{Showing, is_presenting_thread};
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

/// A swap chain of AMD's, which presents generated frames between an engine's own and spreads them over time. Not needed for frames of a
/// presenter: those go into textures, whoever presents them. Experimental, as all of this chapter; where the library has no Direct3D 12
/// part there is none.
///
/// An engine draws into its buffers and calls Present as ever; before that it has motion and depth of the frame recorded by
/// cairn_swapchain_prepare. AMD's swap chain has threads of its own, which present. AMD's libraries are looked for as
/// cairn_device_requirements says.
///
/// Threads: what is done to the DXGI swap chain, Present among it, counts as a call on this one.
pub struct cairn_swapchain(());

impl Handle for cairn_swapchain {
    const KIND: Kind = Kind::Swapchain;
    const NAME: &'static str = "cairn_swapchain";
    type Object = Mutex<Showing>;
}

impl Object for Mutex<Showing> {
    fn is_on_own_thread(&self) -> bool {
        is_presenting_thread()
    }
}

/// Has AMD take over an engine's swap chain. It must be in a window and *own the only reference to it; none of its buffers may be held.
///
/// device: whose queue for frames is the direct queue that the engine draws on.
/// options: may be null for the defaults.
/// own: becomes null when AMD's library gets the swap chain, also where that fails then; before that a failure leaves it as it was.
///
/// Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy, and the reference in *own is gone; on failure
/// *swapchain is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for what AMD's library would hang or crash on: a queue
/// that is not direct, a swap chain that is full screen, of no size, or that somebody else holds; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_UNSUPPORTED, also where no provider stands the test; CAIRN_ERROR_RUNTIME_MISSING where AMD's libraries are not there;
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
        let made = unsafe { behind::wrap(&device, &options, &mut *own) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { hand_over(made, swapchain) }
    })
}

/// Has AMD make a swap chain as IDXGIFactory::CreateSwapChain does.
///
/// device, options: as for cairn_swapchain_wrap.
/// description: of the swap chain, in a window.
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
        given(factory, "factory")?;
        given(description.cast_mut(), "description")?;
        check_out(swapchain, "swapchain")?;
        // SAFETY: the host's promise about its object and its struct.
        let made = unsafe { behind::create(&device, &options, factory, description) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { hand_over(made, swapchain) }
    })
}

/// Has AMD make a swap chain for a window as IDXGIFactory2::CreateSwapChainForHwnd does.
///
/// device, options: as for cairn_swapchain_wrap.
/// window: a HWND, which lives longer than the swap chain.
/// fullscreen: may be null; else it must say that the swap chain is windowed.
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
        given(factory, "factory")?;
        given(window, "window")?;
        given(description.cast_mut(), "description")?;
        check_out(swapchain, "swapchain")?;
        // SAFETY: the host's promise about its object and its structs.
        let made = unsafe { behind::create_for_window(&device, &options, factory, window, description, fullscreen) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { hand_over(made, swapchain) }
    })
}

/// Gives the swap chain itself, to be drawn into and presented by.
///
/// Ownership: on success *dxgi has a reference more, for the caller to release before cairn_swapchain_destroy; on failure it is not
/// written.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_get_dxgi(
    swapchain: *mut cairn_swapchain,
    dxgi: *mut *mut IDXGISwapChain4,
) -> cairn_result {
    call("cairn_swapchain_get_dxgi", || {
        check_out(dxgi, "dxgi")?;
        let showing = enter_alone(swapchain)?;
        let held = showing.lock().dxgi();
        // SAFETY: checked above; writable by the host's promise.
        unsafe { dxgi.write(held) };
        Ok(CAIRN_OK)
    })
}

/// Records motion and depth of the frame that is presented next; Present then also shows a frame generated between it and the previous
/// one. A frame without a recording is presented alone. The list's descriptor heaps, compute root signature and pipeline are replaced;
/// nothing else of its state changes.
///
/// list: open for recording, of the device's queue; to be given to it before Present.
///
/// Ownership: all stays the caller's, on success and on failure; what frame points to must live until the list has run, and what is
/// read within Present until the next one came back.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT with nothing recorded; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE where buffers were resized and cairn_swapchain_fit was not called; CAIRN_ERROR_OUT_OF_MEMORY;
/// CAIRN_ERROR_DEVICE and CAIRN_ERROR_DEVICE_REMOVED, after which the list may hold a part of the work.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_prepare(
    swapchain: *mut cairn_swapchain,
    list: *mut ID3D12GraphicsCommandList,
    frame: *const cairn_swapchain_frame,
) -> cairn_result {
    call("cairn_swapchain_prepare", || {
        given(list, "list")?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { read(frame, "frame") }?;
        check_frame(&frame)?;
        let showing = enter_alone(swapchain)?;
        // SAFETY: the host's promise about its objects.
        unsafe { showing.lock().prepare(list, &frame) }?;
        Ok(CAIRN_OK)
    })
}

/// Sets the picture composited over real and generated frames from the next Present on; waits for frames that show the previous one.
///
/// picture: of the buffers' size, with alpha; null for nothing. It is read within Present and after it; unless it is copied it must not be
/// drawn to before cairn_swapchain_wait.
/// state: the D3D12_RESOURCE_STATES that it rests in.
/// flags: CAIRN_INTERFACE_PREMULTIPLIED, CAIRN_INTERFACE_COPIED
///
/// Ownership: picture stays the caller's; on success the swap chain holds a reference until another is told; on failure it holds what
/// it did.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
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
        let showing = enter_alone(swapchain)?;
        // SAFETY: the host's promise about its object.
        unsafe { showing.lock().set_interface(picture, state, flags) }?;
        Ok(CAIRN_OK)
    })
}

/// Sets how presents are spread over time.
///
/// pacing: null for AMD's own.
///
/// Ownership: pacing is read during the call; nothing is handed over, on success or on failure.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_UNSUPPORTED of SDK 1.1.1 and earlier; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_set_pacing(
    swapchain: *mut cairn_swapchain,
    pacing: *const cairn_swapchain_pacing,
) -> cairn_result {
    call("cairn_swapchain_set_pacing", || {
        // SAFETY: the host's promise about `pacing`.
        let pacing = unsafe { checked_pacing(pacing) }?;
        enter_alone(swapchain)?.lock().set_pacing(pacing.as_ref())?;
        Ok(CAIRN_OK)
    })
}

/// Disables generated frames: frames are presented as they come until one is prepared again. Waits until all are shown.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_pause(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_pause", || {
        enter_alone(swapchain)?.lock().pause()?;
        Ok(CAIRN_OK)
    })
}

/// Waits until all frames that were given to Present are shown.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_wait(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_wait", || {
        enter_alone(swapchain)?.lock().wait()?;
        Ok(CAIRN_OK)
    })
}

/// Adapts to the current size and format of the buffers: call it after ResizeBuffers, before the next frame is prepared. After a
/// failure frames are presented as they come, until it succeeds.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_fit(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_fit", || {
        enter_alone(swapchain)?.lock().fit()?;
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
        let showing = enter(swapchain)?;
        let figures = showing.lock_part(&*showing)?.statistics()?;
        statistics.write(&figures);
        Ok(CAIRN_OK)
    })
}

/// Destroys a swap chain in the order that AMD requires: disable generation, finish presenting, destroy the generator, the swap chain and
/// its pacing; null is allowed. The engine must first release every reference to the DXGI swap chain and its buffers.
///
/// Ownership: on success swapchain is no handle any more; on failure it is as it was.
/// Threads: any thread; waits for calls in flight on the swap chain.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY where somebody holds the DXGI swap chain, and from within a callback of
/// a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_swapchain_destroy(swapchain: *mut cairn_swapchain) -> cairn_result {
    call("cairn_swapchain_destroy", || {
        if !swapchain.is_null() {
            // AMD's library would present with destroyed objects.
            let showing = enter(swapchain.cast_const())?;
            let others = showing.lock_part(&*showing)?.external_references();
            if others > 0 {
                let why = format!("references to the DXGI swap chain that are left: {others}");
                return Err(Failure::new(CAIRN_ERROR_BUSY, why).field("swapchain").remedy("Release them first"));
            }
        }
        destroy(swapchain)
    })
}

/// Gives a host its handle.
///
/// # Safety
/// `to` can be written.
unsafe fn hand_over(made: Showing, to: *mut *mut cairn_swapchain) -> Outcome {
    let handle = insert::<cairn_swapchain>(Mutex::new(made))?;
    // SAFETY: the caller's promise.
    unsafe { to.write(handle) };
    Ok(CAIRN_OK)
}
