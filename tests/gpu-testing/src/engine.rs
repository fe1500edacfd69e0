//! An engine's device with two queues, and their reference counts.

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D::D3D_FEATURE_LEVEL_11_0;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{IUnknown, Interface};

/// An engine's objects.
pub struct Engine {
    /// Device.
    pub device: ID3D12Device,
    /// Queue for command lists of every type.
    pub direct: ID3D12CommandQueue,
    /// Queue for compute and copy lists.
    pub compute: ID3D12CommandQueue,
}

impl Engine {
    /// A device on the first adapter, and its queues.
    pub fn create() -> Self {
        let mut device: Option<ID3D12Device> = None;
        // SAFETY: the variable lives during the call.
        unsafe { D3D12CreateDevice(None, D3D_FEATURE_LEVEL_11_0, &mut device) }.expect("a device");
        let device = device.expect("a device");
        let direct = queue(&device, D3D12_COMMAND_LIST_TYPE_DIRECT);
        let compute = queue(&device, D3D12_COMMAND_LIST_TYPE_COMPUTE);
        Self { device, direct, compute }
    }

    /// The device and the queues of `gpu`.
    pub fn of(gpu: &Gpu) -> Self {
        let (device, direct, compute) =
            (gpu.device().clone(), gpu.frames().d3d12().clone(), gpu.anchors().d3d12().clone());
        Self { device, direct, compute }
    }
}

/// A command queue.
pub fn queue(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE) -> ID3D12CommandQueue {
    let desc = D3D12_COMMAND_QUEUE_DESC { Type: kind, ..Default::default() };
    // SAFETY: the description lives during the call.
    unsafe { device.CreateCommandQueue(&desc) }.expect("a queue")
}

/// A fence of value 0.
pub fn fence(device: &ID3D12Device) -> ID3D12Fence {
    // SAFETY: a live device.
    unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence")
}

/// A closed direct list without commands, whose table of functions is that of all lists.
pub fn closed_list(device: &ID3D12Device) -> ID3D12GraphicsCommandList {
    let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }.expect("an allocator");
    // SAFETY: a live device and allocator.
    let list: ID3D12GraphicsCommandList =
        unsafe { device.CreateCommandList(0, kind, &allocator, None) }.expect("a list");
    // SAFETY: an open list.
    unsafe { list.Close() }.expect("it is empty");
    list
}

/// The object's reference count, including the caller's.
pub fn reference_count(object: &impl Interface) -> u32 {
    let unknown = std::mem::ManuallyDrop::new(object.cast::<IUnknown>().expect("IUnknown"));
    // SAFETY: releases the reference that the cast above took, and counts the rest.
    unsafe { (Interface::vtable(&*unknown).Release)(unknown.as_raw()) }
}

/// Number of polls, and the delay between them. A leak never goes away, so the limit is generous: on a busy machine a driver's thread may
/// run late.
const POLLS: u32 = 12_000;
const POLL_INTERVAL: std::time::Duration = std::time::Duration::from_millis(10);

/// Waits for `count` to return `expected`: a driver's own thread may release a fence a little after it has signalled it.
pub fn wait_for_counts<const N: usize>(count: impl Fn() -> [u32; N], expected: [u32; N]) {
    for _ in 0..POLLS {
        if count() == expected {
            return;
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    assert_eq!(count(), expected, "references come back");
}
