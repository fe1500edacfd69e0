//! Checks whether an engine's swap chain can be taken over or created, and counts references to it.

use windows::Win32::Graphics::Dxgi::{DXGI_MAX_SWAP_CHAIN_BUFFERS, DXGI_SWAP_CHAIN_DESC1, IDXGISwapChain4};
use windows::core::Interface as _;

use crate::ffx::bindings::StructId;
use crate::ffx::provider::versions_of;
use crate::ffx::{Api, Version};
use crate::gpu::{Gpu, failed_on};
use crate::{Error, ErrorKind, Result};

/// Checks that a swap chain can be taken over; returns its description.
pub(super) fn check_wrappable(gpu: &Gpu, swapchain: &IDXGISwapChain4) -> Result<DXGI_SWAP_CHAIN_DESC1> {
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
    Ok(desc)
}

/// Checks the number of an engine's buffers, for which AMD's library has arrays of a fixed size. `buffers` is the number with the name of its
/// field; `create` is the struct that creates the pacing context.
///
/// AMD's library does not check the number: with none it reads a null pointer, with too many it writes past its arrays
/// (`FrameInterpolationSwapChainDX12::init` of its published source).
pub(super) fn check_buffer_count(gpu: &Gpu, api: &Api, create: StructId, buffers: (u32, &str)) -> Result<()> {
    // SAFETY: a live device.
    let offered = unsafe { versions_of(api, create, gpu.device().as_raw()) }?;
    let (count, field) = buffers;
    let most = offered.iter().map(most_buffers).min().unwrap_or(DXGI_MAX_SWAP_CHAIN_BUFFERS);
    if (2..=most).contains(&count) {
        return Ok(());
    }
    let why = format!("AMD's swap chain has 2 to {most} buffers, and not {count}");
    Err(Error::new(ErrorKind::InvalidArgument, why).field(field))
}

/// `FFX_FRAME_INTERPOLATION_SWAP_CHAIN_MAX_BUFFER_COUNT` of the release with this swap chain.
fn most_buffers(version: &Version) -> u32 {
    let is_of_sdk_1 = version.number().is_some_and(|number| number < [3, 1, 5]);
    if is_of_sdk_1 { 6 } else { DXGI_MAX_SWAP_CHAIN_BUFFERS }
}

/// The reference count of a swap chain.
pub(super) fn references(swapchain: &IDXGISwapChain4) -> u32 {
    // `Release` returns the count left after the clone's reference is gone.
    let (raw, vtable) = (swapchain.clone().into_raw(), IDXGISwapChain4::vtable(swapchain));
    // SAFETY: the reference that the clone took.
    unsafe { (vtable.base__.base__.base__.base__.base__.base__.base__.Release)(raw) }
}
