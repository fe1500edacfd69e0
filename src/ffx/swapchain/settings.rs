//! What a swap chain of AMD's is made of, and what it is told.

use std::ptr::null_mut;

use windows::Win32::Foundation::HWND;
use windows::Win32::Graphics::Dxgi::{
    DXGI_SWAP_CHAIN_DESC, DXGI_SWAP_CHAIN_DESC1, DXGI_SWAP_CHAIN_FULLSCREEN_DESC, IDXGIFactory, IDXGISwapChain4,
};
use windows::core::Interface as _;

use crate::Result;
use crate::ffx::bindings::{
    CreateFlags, Dimensions, InterfaceFlags, MemoryUsage, QuerySwapchainMemoryV2, SurfaceFormat,
};
use crate::ffx::memory::known;
use crate::ffx::{Api, Chain, Choice};
use crate::gpu::Gpu;
use crate::gpu::compute::ResourceWithState;

/// How a swap chain of AMD's is made.
#[derive(Debug, Clone, Copy)]
pub struct SwapchainOptions {
    /// Whose generator.
    pub choice: Choice,
    /// The largest size that motion and depth are rendered at; None for that of the buffers, whatever it becomes.
    pub max_render_size: Option<Dimensions>,
    /// How the generator is made. [`CreateFlags::ASYNC_WORKLOAD`]: frames are generated on a compute queue of the swap chain's.
    pub flags: CreateFlags,
    /// The format of frames without interface, where it is another than that of the buffers.
    pub hudless: Option<SurfaceFormat>,
    /// Whether the provider has to show that it puts a picture of known motion where it belongs.
    pub self_test: bool,
}

impl SwapchainOptions {
    /// Any provider, tested, for motion and depth of that size.
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

/// What becomes a swap chain of AMD's.
pub enum Paced<'a> {
    /// An engine's own, in a window, which is taken out when AMD's library gets it and let go of there: this must be the only
    /// reference to it, and none to its buffers may be left.
    Wrap(&'a mut Option<IDXGISwapChain4>),
    /// A new one, as `IDXGIFactory::CreateSwapChain` makes it.
    New(&'a IDXGIFactory, DXGI_SWAP_CHAIN_DESC),
    /// A new one for a window, as `IDXGIFactory2::CreateSwapChainForHwnd` makes it.
    ForWindow(&'a IDXGIFactory, HWND, DXGI_SWAP_CHAIN_DESC1, Option<DXGI_SWAP_CHAIN_FULLSCREEN_DESC>),
}

/// Motion and depth of a frame that an engine draws. Each is a texture of two dimensions with one level, layer and sample, and in the
/// state it rests in when the list is run, before and after.
#[derive(Clone, Copy)]
pub struct PacedPictures<'a> {
    /// Device depth, of the size rendered at.
    pub depth: ResourceWithState<'a>,
    /// From this frame to the one before; see [`Pictures::motion`](crate::ffx::Pictures::motion).
    pub motion: ResourceWithState<'a>,
    /// The frame without interface, of the size shown. It is read within `Present`, and must not be drawn to before that came back; with
    /// [`CreateFlags::ASYNC_WORKLOAD`] not before the next one did.
    pub hudless: Option<ResourceWithState<'a>>,
    /// See [`Pictures::distortion`](crate::ffx::Pictures::distortion).
    pub distortion: Option<ResourceWithState<'a>>,
}

/// An interface that AMD's swap chain lays over real and generated frames alike.
#[derive(Clone, Copy)]
pub struct Interface<'a> {
    /// Of the size shown, with alpha. It is read within `Present` and after it, in that state; unless it is copied, it must not be
    /// drawn to before [`Swapchain::wait`](super::Swapchain::wait).
    pub picture: ResourceWithState<'a>,
    /// Its colours are multiplied by its alpha.
    pub premultiplied: bool,
    /// The swap chain copies it within `Present`, so that the next one may be drawn at once.
    pub copied: bool,
}

/// How presents are spread over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pacing {
    /// Milliseconds that are taken off the time from one present to the next, 0 or more.
    pub safety_margin_ms: f32,
    /// How much of the variance of frame times is taken off besides, from 0 to 1.
    pub variance_factor: f32,
    /// Waits by sleeping, and at the end for so many ticks of the timer by spinning; None by spinning alone.
    pub hybrid_spin: Option<u32>,
    /// Lets the system wake a thread at a fence, and not by spinning.
    pub wait_on_fence: bool,
}

impl Default for Pacing {
    /// AMD's own.
    fn default() -> Self {
        Self { safety_margin_ms: 0.1, variance_factor: 0.1, hybrid_spin: None, wait_on_fence: false }
    }
}

impl Pacing {
    /// What AMD advises where the default is stuck at a low rate: a margin of 0.01 ms, and 0.3 of the variance.
    pub const LOOSE: Self =
        Self { safety_margin_ms: 0.01, variance_factor: 0.3, hybrid_spin: None, wait_on_fence: false };
}

/// What a swap chain of AMD's keeps on the device, in bytes.
#[derive(Debug, Clone, Copy)]
pub struct SwapchainMemory {
    /// The generator, as its provider reports it; None where it cannot say.
    pub generator: Option<MemoryUsage>,
    /// The swap chain; None where it cannot say.
    pub swapchain: Option<MemoryUsage>,
}

/// What a context that paces would keep on `gpu`, for buffers of that size and format and an interface of the same size, if there is one.
/// None where the library cannot say: SDK 2.0 and later can.
///
/// # Errors
/// What the library answers.
pub fn swapchain_memory_needed(
    gpu: &Gpu,
    api: &Api,
    display_size: Dimensions,
    back_buffer_format: SurfaceFormat,
    back_buffers: u32,
    interface: Option<SurfaceFormat>,
) -> Result<Option<MemoryUsage>> {
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
    // SAFETY: no context; a live device, and a place for the answer that lives during the call.
    let known = known(unsafe { api.query(null_mut(), &mut query) })?;
    Ok(known.then_some(usage))
}
