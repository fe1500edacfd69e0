//! The swap chain that presents generated frames.

use std::ffi::c_void;

use super::{Creates, Dimensions, InterfaceFlags, MemoryUsage, Resource, SurfaceFormat, ffx_struct, open_set, plain};

open_set! {
    /// Keys of [`ConfigureSwapchainKeyValue`].
    SwapchainKey: u64 {
        /// A callback that is called while waiting.
        WAIT_CALLBACK = 0,
        /// A [`PacingTuning`].
        PACING_TUNING = 2,
    }
}

plain! {
    /// How presents are paced.
    PacingTuning, 20 align 4: {
        /// Milliseconds subtracted from the time between presents. Default 0.1.
        0 4 safety_margin: f32,
        /// Share of the variance of frame times that is subtracted, 0 to 1. Default 0.1.
        4 4 variance_factor: f32,
        /// Waits by sleeping first, then by spinning.
        8 1 hybrid_spin: bool,
        /// How long it spins, in timer ticks. Default 2.
        12 4 hybrid_spin_time: u32,
        /// Waits on a fence event instead of spinning.
        16 1 wait_on_fence: bool,
    }
}

ffx_struct! {
    /// Creates AMD's swap chain from the host's.
    CreateSwapchainWrap = SWAPCHAIN_WRAP, 32: {
        /// In: the host's, which is released; out: AMD's. `IDXGISwapChain4`.
        16 8 swapchain: *mut *mut c_void,
        /// `ID3D12CommandQueue`, direct.
        24 8 queue: *mut c_void,
    }
}

ffx_struct! {
    /// Creates a swap chain.
    CreateSwapchainNew = SWAPCHAIN_NEW, 48: {
        /// Receives it. `IDXGISwapChain4`.
        16 8 swapchain: *mut *mut c_void,
        /// `DXGI_SWAP_CHAIN_DESC`.
        24 8 description: *mut c_void,
        /// `IDXGIFactory`.
        32 8 factory: *mut c_void,
        /// `ID3D12CommandQueue`, direct.
        40 8 queue: *mut c_void,
    }
}

ffx_struct! {
    /// Creates a swap chain for a window.
    CreateSwapchainForWindow = SWAPCHAIN_FOR_WINDOW, 64: {
        /// Receives it. `IDXGISwapChain4`.
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

ffx_struct! {
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

ffx_struct! {
    /// Sets the interface's texture.
    ConfigureInterface = SWAPCHAIN_INTERFACE, 72: {
        /// The texture; may be null.
        16 48 interface: Resource,
        /// How it is drawn over frames.
        64 4 flags: InterfaceFlags,
    }
}

ffx_struct! {
    /// A setting as a key and a value.
    ConfigureSwapchainKeyValue = SWAPCHAIN_KEY_VALUE, 40: {
        /// The key.
        16 8 key: SwapchainKey,
        /// The value, if it is a number.
        24 8 number: u64,
        /// The value, if it is not a number.
        32 8 pointer: *mut c_void,
    }
}

ffx_struct! {
    /// Queries the command list to record generation into, if there is no callback.
    QueryCommandList = SWAPCHAIN_COMMAND_LIST, 24: {
        /// Receives the answer.
        16 8 list: *mut *mut c_void,
    }
}

ffx_struct! {
    /// Queries the texture to generate into.
    QueryTexture = SWAPCHAIN_TEXTURE, 24: {
        /// Receives the answer.
        16 8 texture: *mut Resource,
    }
}

ffx_struct! {
    /// Waits until all pending frames are presented.
    DispatchWait = SWAPCHAIN_WAIT, 16: {}
}

ffx_struct! {
    /// Queries the device memory of a context. SDK 1.1.2 and later.
    QuerySwapchainMemory = SWAPCHAIN_MEMORY, 24: {
        /// Receives the answer.
        16 8 usage: *mut MemoryUsage,
    }
}

ffx_struct! {
    /// Queries the device memory of a context before it is created. SDK 2.0 and later.
    QuerySwapchainMemoryV2 = SWAPCHAIN_MEMORY_V2, 64: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The display size.
        24 8 display_size: Dimensions,
        /// The format of its buffers.
        32 4 back_buffer_format: SurfaceFormat,
        /// The number of its buffers.
        36 4 back_buffers: u32,
        /// The interface's size; 0 for none.
        40 8 interface_size: Dimensions,
        /// The interface's format; `UNKNOWN` for none.
        48 4 interface_format: SurfaceFormat,
        /// How it is drawn over frames.
        52 4 flags: InterfaceFlags,
        /// Receives the answer.
        56 8 usage: *mut MemoryUsage,
    }
}
