//! A queue and its timeline.

use std::ffi::CStr;

use parking_lot::Mutex;
use windows::Win32::Graphics::Direct3D12::{
    D3D12_COMMAND_LIST_TYPE, D3D12_COMMAND_QUEUE_DESC, D3D12_FENCE_FLAG_NONE, ID3D12CommandList, ID3D12CommandQueue,
    ID3D12Device, ID3D12Fence,
};
use windows::core::Interface;

use super::FencePoint;
use super::failure::{failed_on, removed};
use crate::Result;

/// How PIX's events say that their name is a text of bytes with a zero at its end.
pub(super) const EVENT_OF_BYTES: u32 = 1;

/// A queue of a [`Gpu`](super::Gpu), with a fence of our own that counts what we gave it. The queue may be an engine's, which
/// gives it work beside ours.
///
/// Threads: may be used from any thread at any time.
pub struct Queue {
    queue: ID3D12CommandQueue,
    device: ID3D12Device,
    fence: ID3D12Fence,
    kind: D3D12_COMMAND_LIST_TYPE,
    /// The fence's last value that was asked for. Held while one is, so that values reach the queue in their order.
    last: Mutex<u64>,
}

impl Queue {
    /// A queue that is there already.
    pub(super) fn of_engine(device: &ID3D12Device, queue: &ID3D12CommandQueue) -> Result<Self> {
        // SAFETY: a live device; the call takes values only.
        let fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateFence", &e))?;
        // SAFETY: a live queue.
        let kind = unsafe { queue.GetDesc() }.Type;
        Ok(Self { queue: queue.clone(), device: device.clone(), fence, kind, last: Mutex::new(0) })
    }

    /// A new queue.
    pub(super) fn new(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE) -> Result<Self> {
        let wanted = D3D12_COMMAND_QUEUE_DESC { Type: kind, ..Default::default() };
        // SAFETY: a live device and a description that lives during the call.
        let queue = unsafe { device.CreateCommandQueue(&wanted) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandQueue", &e))?;
        Self::of_engine(device, &queue)
    }

    /// Direct3D's own.
    pub fn d3d12(&self) -> &ID3D12CommandQueue {
        &self.queue
    }

    /// The kind of command lists that it takes.
    pub fn kind(&self) -> D3D12_COMMAND_LIST_TYPE {
        self.kind
    }

    /// Gives it closed command lists; the moment when they are done. They and what they use must live until then.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn submit(&self, lists: &[ID3D12CommandList]) -> Result<FencePoint> {
        // Not every driver drops what a device that is gone is given, and whoever is told so lets go of what the lists use.
        if let Some(gone) = removed(&self.device) {
            return Err(gone);
        }
        // An interface is a pointer that is not null, which an Option of it may be.
        // SAFETY: both have the layout of a pointer.
        let lists: &[Option<ID3D12CommandList>] =
            unsafe { std::slice::from_raw_parts(lists.as_ptr().cast(), lists.len()) };
        // SAFETY: live lists of this device; an open one makes Direct3D remove the device, which `now` reports.
        unsafe { self.queue.ExecuteCommandLists(lists) };
        self.now().inspect_err(|_| self.wait_ignoring_loss())
    }

    /// The moment when everything that it has been given so far is done, by whomever.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn now(&self) -> Result<FencePoint> {
        let mut last = self.last.lock();
        // Checked first: a queue that is gone may never come to what it is told now.
        if let Some(gone) = removed(&self.device) {
            return Err(gone);
        }
        // SAFETY: a live queue and a fence of its device.
        unsafe { self.queue.Signal(&self.fence, *last + 1) }
            .map_err(|e| failed_on(&self.device, "ID3D12CommandQueue::Signal", &e))?;
        *last += 1;
        Ok(FencePoint::new(&self.fence, *last, &self.device))
    }

    /// Names what it is given during `work`, for tools that show the device's work.
    pub(crate) fn named<T>(&self, name: &CStr, work: impl FnOnce() -> T) -> T {
        let bytes = name.to_bytes_with_nul();
        // SAFETY: a live queue, and a text of so many bytes that is copied.
        unsafe { self.queue.BeginEvent(EVENT_OF_BYTES, Some(bytes.as_ptr().cast()), bytes.len() as u32) };
        let done = work();
        // SAFETY: a live queue, on which an event was begun.
        unsafe { self.queue.EndEvent() };
        done
    }

    /// Waits until nothing that it has been given runs any more, before what that uses is freed; also on a device that is gone.
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

    /// Lets what it is given from now on wait for `fence_point`, of another queue or an engine's own; this thread does not wait.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn wait(&self, fence_point: &FencePoint) -> Result<()> {
        // What stands before in the same queue is waited for anyway.
        if fence_point.fence().as_raw() == self.fence.as_raw() {
            return Ok(());
        }
        // SAFETY: a live queue and a live fence.
        unsafe { self.queue.Wait(fence_point.fence(), fence_point.value()) }
            .map_err(|e| failed_on(&self.device, "ID3D12CommandQueue::Wait", &e))
    }
}
