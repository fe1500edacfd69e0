//! Fence points: a fence and a value.

use std::time::{Duration, Instant};

use windows::Win32::Foundation::{CloseHandle, HANDLE, WAIT_OBJECT_0, WAIT_TIMEOUT};
use windows::Win32::Graphics::Direct3D12::{ID3D12Device, ID3D12Fence};
use windows::Win32::System::Threading::{CreateEventW, WaitForSingleObject};

use super::failure::removed;
use crate::{Error, ErrorKind, Result};

/// Time between two checks for device removal while waiting, in milliseconds: not every driver signals fences when the device is removed.
const SLICE_MS: u32 = 100;
/// Time between two looks at the fence where there is no event to wait for.
const POLLING: Duration = Duration::from_millis(1);
/// How long to wait for work of a removed device.
const PATIENCE: Duration = Duration::from_secs(10);

/// A fence value on a queue, reached when all work submitted before it has completed. Cheap to clone.
///
/// Threads: may be used from any thread at any time.
#[derive(Clone)]
pub struct FencePoint {
    fence: ID3D12Fence,
    value: u64,
    device: ID3D12Device,
}

impl FencePoint {
    pub(super) fn new(fence: &ID3D12Fence, value: u64, device: &ID3D12Device) -> Self {
        Self { fence: fence.clone(), value, device: device.clone() }
    }

    /// The point at which `fence`, an engine's fence of the same device, reaches `value`.
    ///
    /// # Errors
    /// `InvalidArgument` when the fence is another device's.
    pub fn of_engine(gpu: &super::Gpu, fence: &ID3D12Fence, value: u64) -> Result<Self> {
        gpu.owns(fence, "fence")?;
        Ok(Self::new(fence, value, gpu.device()))
    }

    /// Checks that the fence has not reached the value yet: otherwise it cannot signal future work.
    ///
    /// # Errors
    /// `InvalidArgument`.
    pub(crate) fn check_pending(&self) -> Result<()> {
        if !self.reached() {
            return Ok(());
        }
        let why = format!("the fence has the value {} already, before the list has run", self.value);
        Err(Error::new(ErrorKind::InvalidArgument, why)
            .field("fence_value")
            .remedy("Pass a value that the queue gives the fence after the list"))
    }

    /// The fence.
    pub fn fence(&self) -> &ID3D12Fence {
        &self.fence
    }

    /// The fence value to reach.
    pub fn value(&self) -> u64 {
        self.value
    }

    /// Whether it is reached; always true on a removed device.
    pub fn reached(&self) -> bool {
        // SAFETY: a live fence; the call takes nothing.
        unsafe { self.fence.GetCompletedValue() >= self.value }
    }

    /// Waits until the work has stopped, before its resources are freed. Unlike [`wait`](Self::wait), also waits on a removed device, since not
    /// every driver drops submitted work when the device is removed.
    pub(crate) fn wait_ignoring_loss(&self) {
        let (event, mut removed_since) = (self.event(), None);
        while !self.reached() && !pause(event.as_ref()) {
            if removed(&self.device).is_some() && removed_since.get_or_insert_with(Instant::now).elapsed() >= PATIENCE {
                return;
            }
        }
    }

    /// Blocks this thread until it is reached.
    ///
    /// # Errors
    /// `DeviceRemoved` if the device is removed before or during the wait; the work may then be half done.
    pub fn wait(&self) -> Result<()> {
        if !self.reached() {
            let event = self.event();
            while !pause(event.as_ref()) && !self.reached() {
                if let Some(gone) = removed(&self.device) {
                    self.wait_ignoring_loss();
                    return Err(gone);
                }
            }
        }
        removed(&self.device).map_or(Ok(()), Err)
    }

    /// An event that is signalled when it is reached; `None` if the system is short of memory.
    fn event(&self) -> Option<Event> {
        let event = Event::new().ok()?;
        // SAFETY: a live fence and a live event; the fence may signal a closed handle later without effect.
        unsafe { self.fence.SetEventOnCompletion(self.value, event.0) }.ok()?;
        Some(event)
    }
}

/// Waits for one slice; returns whether the event was signalled. Without an event it sleeps for a part of a slice: the device goes on using what
/// the caller frees next, so that a wait may not fail for want of memory.
fn pause(event: Option<&Event>) -> bool {
    event.and_then(Event::wait).unwrap_or_else(|| {
        std::thread::sleep(POLLING);
        false
    })
}

impl std::fmt::Debug for FencePoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FencePoint({}, {})", self.value, if self.reached() { "reached" } else { "to come" })
    }
}

/// A Win32 event, closed on drop.
struct Event(HANDLE);

impl Event {
    fn new() -> windows::core::Result<Self> {
        // SAFETY: no name and no security attributes are given.
        unsafe { CreateEventW(None, true, false, None) }.map(Self)
    }

    /// Waits for one slice; returns whether the event was signalled, or `None` if the system cannot wait.
    fn wait(&self) -> Option<bool> {
        // SAFETY: the handle is open.
        match unsafe { WaitForSingleObject(self.0, SLICE_MS) } {
            WAIT_OBJECT_0 => Some(true),
            WAIT_TIMEOUT => Some(false),
            _ => None,
        }
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        // SAFETY: the handle is open and owned by this value.
        _ = unsafe { CloseHandle(self.0) };
    }
}
