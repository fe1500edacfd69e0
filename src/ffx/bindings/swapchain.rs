//! The swapchain that presents generated frames.

use std::ffi::c_void;

use super::{Creates, Dimensions, InterfaceFlags, MemoryUsage, Resource, SurfaceFormat, described, open_set, plain};

open_set! {
    /// What [`ConfigureSwapchainKeyValue`] sets.
    SwapchainKey: u64 {
        /// What is called while waiting.
        WAIT_CALLBACK = 0,
        /// A [`PacingTuning`].
        PACING_TUNING = 2,
    }
}

plain! {
    /// How presents are spread over time.
    PacingTuning, 20 align 4: {
        /// Milliseconds that are taken off. 0.1 where nothing is said.
        0 4 safety_margin: f32,
        /// Share of the variance that is taken off, 0 to 1. 0.1 where nothing is said.
        4 4 variance_factor: f32,
        /// Wait by sleeping, then by spinning.
        8 1 hybrid_spin: bool,
        /// How long by spinning, in ticks of the timer. 2 where nothing is said.
        12 4 hybrid_spin_time: u32,
        /// Let the system wake the thread at a fence.
        16 1 wait_on_fence: bool,
    }
}

described! {
    /// Takes over a swapchain.
    CreateSwapchainWrap = SWAPCHAIN_WRAP, 32: {
        /// In: the host's, which is let go; out: AMD's. `IDXGISwapChain4`.
        16 8 swapchain: *mut *mut c_void,
        /// `ID3D12CommandQueue`, direct.
        24 8 queue: *mut c_void,
    }
}

described! {
    /// Makes a swapchain.
    CreateSwapchainNew = SWAPCHAIN_NEW, 48: {
        /// Gets it. `IDXGISwapChain4`.
        16 8 swapchain: *mut *mut c_void,
        /// `DXGI_SWAP_CHAIN_DESC`.
        24 8 description: *mut c_void,
        /// `IDXGIFactory`.
        32 8 factory: *mut c_void,
        /// `ID3D12CommandQueue`, direct.
        40 8 queue: *mut c_void,
    }
}

described! {
    /// Makes a swapchain of a window.
    CreateSwapchainForWindow = SWAPCHAIN_FOR_WINDOW, 64: {
        /// Gets it. `IDXGISwapChain4`.
        16 8 swapchain: *mut *mut c_void,
        /// `HWND`.
        24 8 window: *mut c_void,
        /// `DXGI_SWAP_CHAIN_DESC1`.
        32 8 description: *mut c_void,
        /// `DXGI_SWAP_CHAIN_FULLSCREEN_DESC`.
        40 8 fullscreen: *mut c_void,
        /// `IDXGIFactory`.
        48 8 factory: *mut c_void,
        /// `ID3D12CommandQueue`, direct.
        56 8 queue: *mut c_void,
    }
}

described! {
    /// As [`CreateFrameGenerationVersion`](super::CreateFrameGenerationVersion).
    CreateSwapchainVersion = SWAPCHAIN_VERSION
        extends [CreateSwapchainWrap, CreateSwapchainNew, CreateSwapchainForWindow], 24: {
        /// That number.
        16 4 version: u32,
    }
}

impl From<u32> for CreateSwapchainVersion {
    fn from(version: u32) -> Self {
        Self { version, ..Self::default() }
    }
}

/// 3.1.6, of SDK 2.1.
const WRITTEN_FOR: u32 = 3 << 22 | 1 << 12 | 6;

impl Creates for CreateSwapchainWrap {
    type Version = CreateSwapchainVersion;
    const WRITTEN_FOR: u32 = WRITTEN_FOR;
}

impl Creates for CreateSwapchainNew {
    type Version = CreateSwapchainVersion;
    const WRITTEN_FOR: u32 = WRITTEN_FOR;
}

impl Creates for CreateSwapchainForWindow {
    type Version = CreateSwapchainVersion;
    const WRITTEN_FOR: u32 = WRITTEN_FOR;
}

described! {
    /// The interface's picture.
    ConfigureInterface = SWAPCHAIN_INTERFACE, 72: {
        /// May be none.
        16 48 interface: Resource,
        /// How it is laid over frames.
        64 4 flags: InterfaceFlags,
    }
}

described! {
    /// A setting by its number.
    ConfigureSwapchainKeyValue = SWAPCHAIN_KEY_VALUE, 40: {
        /// Which.
        16 8 key: SwapchainKey,
        /// Its value, where that is a number.
        24 8 number: u64,
        /// Its value, where that is something else.
        32 8 pointer: *mut c_void,
    }
}

described! {
    /// Asks for the list to record generation into, where there is no callback for it.
    QueryCommandList = SWAPCHAIN_COMMAND_LIST, 24: {
        /// Gets it.
        16 8 list: *mut *mut c_void,
    }
}

described! {
    /// Asks for the texture to generate into.
    QueryTexture = SWAPCHAIN_TEXTURE, 24: {
        /// Gets it.
        16 8 texture: *mut Resource,
    }
}

described! {
    /// Waits for all that is to be presented.
    DispatchWait = SWAPCHAIN_WAIT, 16: {}
}

described! {
    /// Asks for the memory of a context. SDK 1.1.2 and later.
    QuerySwapchainMemory = SWAPCHAIN_MEMORY, 24: {
        /// Gets it.
        16 8 usage: *mut MemoryUsage,
    }
}

described! {
    /// Asks for the memory of a context to come. SDK 2.0 and later.
    QuerySwapchainMemoryV2 = SWAPCHAIN_MEMORY_V2, 64: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The size shown.
        24 8 display_size: Dimensions,
        /// Of its buffers.
        32 4 back_buffer_format: SurfaceFormat,
        /// How many.
        36 4 back_buffers: u32,
        /// Of no size without one.
        40 8 interface_size: Dimensions,
        /// Unknown without one.
        48 4 interface_format: SurfaceFormat,
        /// How it is laid over frames.
        52 4 flags: InterfaceFlags,
        /// Gets it.
        56 8 usage: *mut MemoryUsage,
    }
}
