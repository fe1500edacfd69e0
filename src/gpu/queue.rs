//! A command queue with its own fence.

use std::ffi::CStr;

use crate::locks::Mutex;
use windows::Win32::Graphics::Direct3D12::{
    D3D12_COMMAND_LIST_TYPE, D3D12_COMMAND_LIST_TYPE_COMPUTE, D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_COMMAND_QUEUE_DESC,
    D3D12_COMMAND_QUEUE_FLAG_DISABLE_GPU_TIMEOUT, D3D12_COMMAND_QUEUE_FLAG_NONE, D3D12_COMMAND_QUEUE_FLAGS,
    D3D12_FENCE_FLAG_NONE, ID3D12CommandList, ID3D12CommandQueue, ID3D12Device, ID3D12Fence,
};
use windows::core::Interface;

use super::FencePoint;
use super::failure::{failed_on, removed};
use crate::Result;

/// Metadata value of a PIX event whose name is a zero-terminated byte string.
pub(super) const EVENT_OF_BYTES: u32 = 1;

/// A queue of a [`Gpu`](super::Gpu), with a fence of our own that is signalled after our submissions. The queue may be an engine's, which
/// submits work of its own to it.
///
/// Threads: may be used from any thread at any time.
pub struct Queue {
    queue: ID3D12CommandQueue,
    device: ID3D12Device,
    fence: ID3D12Fence,
    kind: D3D12_COMMAND_LIST_TYPE,
    /// The last value that was signalled. Locked during `Signal`, so that values reach the queue in order.
    last: Mutex<u64>,
}

impl Queue {
    /// Wraps an existing queue.
    pub(super) fn of_engine(device: &ID3D12Device, queue: &ID3D12CommandQueue) -> Result<Self> {
        // SAFETY: a live device; the call takes values only.
        let fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateFence", &e))?;
        // SAFETY: a live queue.
        let kind = unsafe { queue.GetDesc() }.Type;
        Ok(Self { queue: queue.clone(), device: device.clone(), fence, kind, last: Mutex::new(0) })
    }

    /// A new queue for anchors. A pass on a slow adapter may take longer than the two seconds after which Windows resets an adapter, and with
    /// it the engine's device, so that does not apply here. ONNX Runtime makes its own queues in the same way.
    pub(super) fn for_anchors(device: &ID3D12Device) -> Result<Self> {
        Self::new(device, D3D12_COMMAND_LIST_TYPE_COMPUTE, D3D12_COMMAND_QUEUE_FLAG_DISABLE_GPU_TIMEOUT)
    }

    /// A new queue for frames.
    pub(super) fn for_frames(device: &ID3D12Device) -> Result<Self> {
        Self::new(device, D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_COMMAND_QUEUE_FLAG_NONE)
    }

    fn new(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE, flags: D3D12_COMMAND_QUEUE_FLAGS) -> Result<Self> {
        let wanted = D3D12_COMMAND_QUEUE_DESC { Type: kind, Flags: flags, ..Default::default() };
        // SAFETY: a live device and a description that lives during the call.
        let queue = unsafe { device.CreateCommandQueue(&wanted) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandQueue", &e))?;
        Self::of_engine(device, &queue)
    }

    /// The Direct3D object.
    pub fn d3d12(&self) -> &ID3D12CommandQueue {
        &self.queue
    }

    /// The type of its command lists.
    pub fn kind(&self) -> D3D12_COMMAND_LIST_TYPE {
        self.kind
    }

    /// Submits closed command lists; returns the fence point of their completion. Lists and resources must live until then.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn submit(&self, lists: &[ID3D12CommandList]) -> Result<FencePoint> {
        // Not every driver drops work that is submitted to a removed device, and the caller frees the lists' resources on that error.
        if let Some(gone) = removed(&self.device) {
            return Err(gone);
        }
        // An interface is a non-null pointer, so `Option` of it has the same layout.
        // SAFETY: both have the layout of a pointer.
        let lists: &[Option<ID3D12CommandList>] =
            unsafe { std::slice::from_raw_parts(lists.as_ptr().cast(), lists.len()) };
        // SAFETY: live lists of this device; an open one makes Direct3D remove the device, which `signal` reports.
        unsafe { self.queue.ExecuteCommandLists(lists) };
        self.signal().inspect_err(|_| self.wait_ignoring_loss())
    }

    /// Signals the queue's fence after everything submitted to the queue so far, by anyone; returns the fence point.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn signal(&self) -> Result<FencePoint> {
        let mut last = self.last.lock();
        // Checked first: the queue of a removed device may never reach a new value.
        if let Some(gone) = removed(&self.device) {
            return Err(gone);
        }
        // SAFETY: a live queue and a fence of its device.
        unsafe { self.queue.Signal(&self.fence, *last + 1) }
            .map_err(|e| failed_on(&self.device, "ID3D12CommandQueue::Signal", &e))?;
        *last += 1;
        Ok(FencePoint::new(&self.fence, *last, &self.device))
    }

    /// Runs `work` with its submissions inside a named PIX event.
    pub(crate) fn with_event<T>(&self, name: &CStr, work: impl FnOnce() -> T) -> T {
        let bytes = name.to_bytes_with_nul();
        // SAFETY: a live queue, and a text of that length, which is copied.
        unsafe { self.queue.BeginEvent(EVENT_OF_BYTES, Some(bytes.as_ptr().cast()), bytes.len() as u32) };
        let done = work();
        // SAFETY: a live queue, on which an event was begun.
        unsafe { self.queue.EndEvent() };
        done
    }

    /// Waits until all submitted work has stopped, before its resources are freed; also on a removed device.
    pub(crate) fn wait_ignoring_loss(&self) {
        let fence_point = {
            let mut last = self.last.lock();
            // SAFETY: a live queue and a fence of its device.
            if unsafe { self.queue.Signal(&self.fence, *last + 1) }.is_err() {
                return;
            }
            *last += 1;
            FencePoint::new(&self.fence, *last, &self.device)
        };
        fence_point.wait_ignoring_loss();
    }

    /// Makes later work of this queue wait for `fence_point`, of another queue or an engine's fence; the calling thread does not wait.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn wait(&self, fence_point: &FencePoint) -> Result<()> {
        // Work of one queue runs in order anyway.
        if fence_point.fence().as_raw() == self.fence.as_raw() {
            return Ok(());
        }
        // SAFETY: a live queue and a live fence.
        unsafe { self.queue.Wait(fence_point.fence(), fence_point.value()) }
            .map_err(|e| failed_on(&self.device, "ID3D12CommandQueue::Wait", &e))
    }
}
