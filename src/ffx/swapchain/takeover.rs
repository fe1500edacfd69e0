//! Checks whether an engine's swap chain can be taken over, and counts references to it.

use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT;
use windows::Win32::Graphics::Dxgi::IDXGISwapChain4;
use windows::core::Interface as _;

use crate::gpu::{Gpu, failed_on};
use crate::{Error, ErrorKind, Result};

/// Checks that a swap chain can be taken over; returns its size, width and height, and format.
pub(super) fn check_wrappable(gpu: &Gpu, swapchain: &IDXGISwapChain4) -> Result<(u32, u32, DXGI_FORMAT)> {
    let refuse = |why: String| Error::new(ErrorKind::InvalidArgument, why).field("swapchain");
    let failed = |call| move |e: windows::core::Error| failed_on(gpu.device(), call, &e);
    // SAFETY: a live swap chain.
    let (desc, fullscreen) = unsafe {
        (
            swapchain.GetDesc1().map_err(failed("IDXGISwapChain1::GetDesc1"))?,
            swapchain.GetFullscreenDesc().map_err(failed("IDXGISwapChain1::GetFullscreenDesc"))?,
        )
    };
    // SAFETY: as above.
    if unsafe { swapchain.GetHwnd() }.is_err() {
        return Err(refuse("it is of no window".to_owned()));
    }
    if !fullscreen.Windowed.as_bool() {
        return Err(refuse("it is full screen, and AMD's swap chain lives in a window".to_owned()));
    }
    let held = references(swapchain);
    if held > 1 {
        return Err(refuse(format!("somebody else holds {} references to it", held - 1))
            .remedy("Let go of all references to it and to its buffers but the one that is handed over"));
    }
    Ok((desc.Width, desc.Height, desc.Format))
}

/// The reference count of a swap chain.
pub(super) fn references(swapchain: &IDXGISwapChain4) -> u32 {
    // `Release` returns the count left after the clone's reference is gone.
    let (raw, vtable) = (swapchain.clone().into_raw(), IDXGISwapChain4::vtable(swapchain));
    // SAFETY: the reference that the clone took.
    unsafe { (vtable.base__.base__.base__.base__.base__.base__.base__.Release)(raw) }
}
