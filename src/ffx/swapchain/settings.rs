//! Options and settings of AMD's swap chain.

use std::ptr::null_mut;

use windows::Win32::Foundation::HWND;
use windows::Win32::Graphics::Dxgi::{
    DXGI_SWAP_CHAIN_DESC, DXGI_SWAP_CHAIN_DESC1, DXGI_SWAP_CHAIN_FULLSCREEN_DESC, IDXGIFactory, IDXGISwapChain4,
};
use windows::core::Interface as _;

use super::takeover::check_buffer_count;
use crate::Result;
use crate::ffx::bindings::{
    CreateFlags, CreateSwapchainForWindow, Dimensions, InterfaceFlags, MemoryUsage, QuerySwapchainMemoryV2,
    SurfaceFormat,
};
use crate::ffx::memory_usage::is_known;
use crate::ffx::{Api, Chain, Choice, FfxStruct};
use crate::gpu::Gpu;
use crate::gpu::compute::ResourceWithState;

/// How AMD's swap chain is created.
#[derive(Debug, Clone, Copy)]
pub struct SwapchainOptions {
    /// Which provider generates frames.
    pub choice: Choice,
    /// The largest render size of motion and depth; None for the size of the buffers, whatever it becomes.
    pub max_render_size: Option<Dimensions>,
    /// How the generator is created. With [`CreateFlags::ASYNC_WORKLOAD`], frames are generated on a compute queue of the swap
    /// chain's own.
    pub flags: CreateFlags,
    /// The format of HUD-less pictures, if it differs from that of the buffers.
    pub hudless: Option<SurfaceFormat>,
    /// Whether the provider must pass the self-test: a frame of known motion.
    pub self_test: bool,
}

impl SwapchainOptions {
    /// Any provider that passes the self-test, for motion and depth of that size.
    pub fn new(max_render_size: Dimensions) -> Self {
        Self {
            choice: Choice::Any,
            max_render_size: Some(max_render_size),
            flags: CreateFlags::empty(),
            hudless: None,
            self_test: true,
        }
    }
}

/// What AMD's swap chain is created from.
pub enum SwapchainSource<'a> {
    /// The engine's own, in a window. It is taken out of the option, and AMD's library releases it: this must be the only reference
    /// to it, and none to its buffers may be left.
    Wrap(&'a mut Option<IDXGISwapChain4>),
    /// A new one, as `IDXGIFactory::CreateSwapChain` makes it.
    New(&'a IDXGIFactory, DXGI_SWAP_CHAIN_DESC),
    /// A new one for a window, as `IDXGIFactory2::CreateSwapChainForHwnd` makes it.
    ForWindow(&'a IDXGIFactory, HWND, DXGI_SWAP_CHAIN_DESC1, Option<DXGI_SWAP_CHAIN_FULLSCREEN_DESC>),
}

/// Motion and depth of an engine's frame. Each is a 2D texture with one mip level, array layer and sample, in the given state
/// before and after the list runs.
#[derive(Clone, Copy)]
pub struct FrameTextures<'a> {
    /// Device depth at render size.
    pub depth: ResourceWithState<'a>,
    /// Motion vectors from this frame to the previous one; see [`GenerationTextures::motion`](crate::ffx::GenerationTextures::motion).
    pub motion: ResourceWithState<'a>,
    /// The HUD-less frame at display size. `Present` reads it: do not draw to it before `Present` returns, or, with
    /// [`CreateFlags::ASYNC_WORKLOAD`], before the next `Present` returns.
    pub hudless: Option<ResourceWithState<'a>>,
    /// See [`GenerationTextures::distortion`](crate::ffx::GenerationTextures::distortion).
    pub distortion: Option<ResourceWithState<'a>>,
}

/// An interface (HUD) that AMD's swap chain draws over real and generated frames alike.
#[derive(Clone, Copy)]
pub struct Interface<'a> {
    /// Display size, with alpha. It is read during and after `Present`, in the given state; unless it is copied, do not draw to it
    /// before [`Swapchain::wait`](super::Swapchain::wait).
    pub picture: ResourceWithState<'a>,
    /// Its colours are premultiplied by its alpha.
    pub premultiplied: bool,
    /// The swap chain copies it within `Present`, so that the next one may be drawn immediately after. It then forgets it;
    /// [`Swapchain::prepare`](super::Swapchain::prepare) sets it again. Without that call, set it before each `Present`.
    pub copied: bool,
}

/// How presents are paced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pacing {
    /// Milliseconds subtracted from the time between presents, 0 or more.
    pub safety_margin_ms: f32,
    /// Share of the variance of frame times that is subtracted too, from 0 to 1.
    pub variance_factor: f32,
    /// Waits by sleeping, and spins for the last timer ticks, this many; None to spin only.
    pub hybrid_spin: Option<u32>,
    /// Waits on a fence event instead of spinning.
    pub wait_on_fence: bool,
}

impl Default for Pacing {
    /// AMD's defaults.
    fn default() -> Self {
        Self { safety_margin_ms: 0.1, variance_factor: 0.1, hybrid_spin: None, wait_on_fence: false }
    }
}

impl Pacing {
    /// AMD's advice where the defaults keep the rate too low: a margin of 0.01 ms and 0.3 of the variance.
    pub const LOOSE: Self =
        Self { safety_margin_ms: 0.01, variance_factor: 0.3, hybrid_spin: None, wait_on_fence: false };
}

/// Device memory of AMD's swap chain, in bytes.
#[derive(Debug, Clone, Copy)]
pub struct SwapchainMemory {
    /// The generator's memory, as its provider reports it; None if it cannot.
    pub generator: Option<MemoryUsage>,
    /// The swap chain's memory; None if it cannot report it.
    pub swapchain: Option<MemoryUsage>,
}

/// Device memory that a pacing context would use on `gpu`, for buffers of that size and format and, if given, an interface of the
/// same size. None if the library cannot report it: SDK 2.0 and later can.
///
/// # Errors
/// `InvalidArgument` for a number of buffers that [`Swapchain::new`](super::Swapchain::new) refuses; the library's own errors.
pub fn swapchain_memory_needed(
    gpu: &Gpu,
    api: &Api,
    display_size: Dimensions,
    back_buffer_format: SurfaceFormat,
    back_buffers: u32,
    interface: Option<SurfaceFormat>,
) -> Result<Option<MemoryUsage>> {
    check_buffer_count(gpu, api, CreateSwapchainForWindow::ID, (back_buffers, "back_buffers"))?;
    let mut usage = MemoryUsage::default();
    let mut query = Chain::new(QuerySwapchainMemoryV2 {
        device: gpu.device().as_raw(),
        display_size,
        back_buffer_format,
        back_buffers,
        interface_size: interface.map_or_else(Dimensions::default, |_| display_size),
        interface_format: interface.unwrap_or_default(),
        flags: if interface.is_some() { InterfaceFlags::DOUBLE_BUFFERED } else { InterfaceFlags::empty() },
        usage: &mut usage,
        ..Default::default()
    });
    // SAFETY: no context; a live device, and memory for the answer that lives during the call.
    let is_known = is_known(unsafe { api.query(null_mut(), &mut query) })?;
    Ok(is_known.then_some(usage))
}
