//! Values that pass between the Direct3D 12 entry points and the platform's backend. COM objects are untyped pointers here, because systems
//! without Direct3D have no types for them.

use std::ffi::c_void;
use std::time::Duration;

use crate::gpu_time::GpuTimeStatistics;
use crate::present::Selection;
use crate::present::presenter::FrameInfo;

/// A fence with the value to wait for. One that the backend returns owns a reference to the fence.
pub(in crate::abi) struct FenceValue {
    /// An ID3D12Fence.
    pub(in crate::abi) fence: *mut c_void,
    pub(in crate::abi) value: u64,
}

/// A picture of an anchor: a texture, with an owned reference, and the fence value that guards it.
pub(in crate::abi) struct AnchorTexture {
    /// An ID3D12Resource.
    pub(in crate::abi) texture: *mut c_void,
    pub(in crate::abi) guard: FenceValue,
}

/// How worlds run on a Direct3D 12 device.
#[cfg_attr(not(windows), expect(dead_code, reason = "read on Windows only"))]
pub(in crate::abi) struct WorldOptions {
    pub(in crate::abi) deterministic: bool,
    /// Largest number of captured passes per graph.
    pub(in crate::abi) captured_passes: usize,
    /// Longest work that may be queued at a time; `None` for no limit.
    pub(in crate::abi) longest_submission: Option<Duration>,
}

/// The preparation of frames. Sizes are in pixels.
#[cfg_attr(not(windows), expect(dead_code, reason = "read on Windows only"))]
pub(in crate::abi) struct FramePreparation {
    /// Size of the targets; `None` for that of the presenter's frames.
    pub(in crate::abi) size: Option<(u32, u32)>,
    /// Size of the anchors; `None` for that of the anchors that have arrived.
    pub(in crate::abi) anchor_size: Option<(u32, u32)>,
    /// DXGI_FORMAT of the targets; 0 for any.
    pub(in crate::abi) format: u32,
    /// How many recorded frames may wait for their lists to run; `None` for the default.
    pub(in crate::abi) lists: Option<usize>,
    /// Pictures per anchor.
    pub(in crate::abi) pictures: usize,
    /// Channels, height and width of the anchors' latents.
    pub(in crate::abi) latent: [u32; 3],
    /// As cairn_pipelines_load_callback.
    pub(in crate::abi) load: Option<unsafe extern "C" fn(*mut c_void, u64, *mut c_void) -> u64>,
    /// As cairn_pipelines_store_callback.
    pub(in crate::abi) store: Option<unsafe extern "C" fn(*const c_void, u64, *mut c_void)>,
    /// Argument of both.
    pub(in crate::abi) user: *mut c_void,
}

/// Destination of a frame.
#[cfg_attr(not(windows), expect(dead_code, reason = "read on Windows only"))]
pub(in crate::abi) struct FrameTarget {
    /// The engine's ID3D12GraphicsCommandList, and the engine's fence that is signalled once the list has run; `None` to submit the frame.
    pub(in crate::abi) list: Option<(*mut c_void, FenceValue)>,
    /// An ID3D12Resource.
    pub(in crate::abi) texture: *mut c_void,
    /// D3D12_RESOURCE_STATES before the frame.
    pub(in crate::abi) before: u32,
    /// D3D12_RESOURCE_STATES after the frame.
    pub(in crate::abi) after: u32,
}

/// Result of a frame for Direct3D 12.
#[cfg_attr(not(windows), expect(dead_code, reason = "frames are made on Windows only"))]
pub(in crate::abi) enum FrameResult {
    /// No anchor has arrived yet.
    NotReady,
    /// Every slot holds a recorded frame whose list may not have run.
    QueueFull,
    /// It was made. A submitted frame comes with the fence value that guards its target.
    Frame(FrameInfo, Option<FenceValue>),
}

/// Statistics of frames made on a Direct3D 12 device.
#[derive(Default)]
pub(in crate::abi) struct FrameStatistics {
    /// Submitted frames that have not run.
    pub(in crate::abi) in_flight: u32,
    /// Recorded frames whose lists may not have run.
    pub(in crate::abi) lists_pending: u32,
    /// Device times of frames that have run.
    pub(in crate::abi) frames: GpuTimeStatistics,
    /// Device times of the lists that prepare the frames' inputs.
    pub(in crate::abi) lists: GpuTimeStatistics,
    /// Generator of the last frame; `None` before the first frame.
    pub(in crate::abi) generator: Option<Selection>,
    /// Upscaler of the last frame; `None` if the CPU made it.
    pub(in crate::abi) upscaler: Option<Selection>,
}

/// Statistics of a rollout's passes on a Direct3D 12 device.
#[derive(Default, Clone, Copy)]
pub(in crate::abi) struct RolloutStatistics {
    pub(in crate::abi) passes: GpuTimeStatistics,
    pub(in crate::abi) decodes: GpuTimeStatistics,
    pub(in crate::abi) commits: GpuTimeStatistics,
    /// Wall time inside ONNX Runtime.
    pub(in crate::abi) in_onnxruntime: Duration,
    /// Wall time of waiting for the device.
    pub(in crate::abi) waiting_for_device: Duration,
    /// Number of waits because of the limit on queued work.
    pub(in crate::abi) yields: u64,
    /// Passes that run from captured commands.
    pub(in crate::abi) captured: usize,
    /// Passes that do not.
    pub(in crate::abi) others: usize,
}
