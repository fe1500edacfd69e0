//! A device with two queues, as an engine makes them, and its reference counts.

use cairn::gpu::windows::Win32::Graphics::Direct3D::D3D_FEATURE_LEVEL_11_0;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{IUnknown, Interface};

/// An engine's objects.
pub(crate) struct Engine {
    pub(crate) device: ID3D12Device,
    pub(crate) direct: ID3D12CommandQueue,
    pub(crate) compute: ID3D12CommandQueue,
}

pub(crate) fn engine() -> Engine {
    let mut device: Option<ID3D12Device> = None;
    // SAFETY: the variable lives during the call.
    unsafe { D3D12CreateDevice(None, D3D_FEATURE_LEVEL_11_0, &mut device) }.expect("a device");
    let device = device.expect("a device");
    let direct = queue(&device, D3D12_COMMAND_LIST_TYPE_DIRECT);
    let compute = queue(&device, D3D12_COMMAND_LIST_TYPE_COMPUTE);
    Engine { device, direct, compute }
}

pub(crate) fn queue(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE) -> ID3D12CommandQueue {
    let wanted = D3D12_COMMAND_QUEUE_DESC { Type: kind, ..Default::default() };
    // SAFETY: the description lives during the call.
    unsafe { device.CreateCommandQueue(&wanted) }.expect("a queue")
}

/// A fence of value 0.
pub(crate) fn fence(device: &ID3D12Device) -> ID3D12Fence {
    // SAFETY: a live device.
    unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence")
}

/// The object's reference count, including ours.
pub(crate) fn references(object: &impl Interface) -> u32 {
    let unknown = std::mem::ManuallyDrop::new(object.cast::<IUnknown>().expect("IUnknown"));
    // SAFETY: releases the reference that the cast above took, and counts the rest.
    unsafe { (Interface::vtable(&*unknown).Release)(unknown.as_raw()) }
}

/// Number of polls for reference counts to return, and the delay between them. A leak never goes away, so the limit is generous: on a
/// busy machine a driver's thread may run late.
const LOOKS: u32 = 12_000;
const BETWEEN: std::time::Duration = std::time::Duration::from_millis(10);

/// Waits for `count` to become `expected`: a driver's own thread may release a fence a little after it has signalled it.
pub(crate) fn comes_back<const N: usize>(count: impl Fn() -> [u32; N], expected: [u32; N]) {
    for _ in 0..LOOKS {
        if count() == expected {
            return;
        }
        std::thread::sleep(BETWEEN);
    }
    assert_eq!(count(), expected, "references come back");
}
