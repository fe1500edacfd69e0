//! A moment on a queue's timeline.

use windows::Win32::Foundation::{CloseHandle, HANDLE, WAIT_OBJECT_0, WAIT_TIMEOUT};
use windows::Win32::Graphics::Direct3D12::{ID3D12Device, ID3D12Fence};
use windows::Win32::System::Threading::{CreateEventW, WaitForSingleObject};

use super::failure::{failed_on, removed};
use crate::{Error, ErrorKind, Result};

/// How long is waited before it is looked whether the device is still there: not every driver lets the waiting go when it is not.
const SLICE_MS: u32 = 100;
/// How many such slices are waited for work of a device that is gone.
const PATIENCE: u32 = 100;

/// What a queue had been given up to some time: it is reached when all of that is done. Cheap to clone.
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

    /// When `fence`, an engine's own of the same device, has `value`.
    ///
    /// # Errors
    /// `InvalidArgument` when the fence is another device's.
    pub fn of_engine(gpu: &super::Gpu, fence: &ID3D12Fence, value: u64) -> Result<Self> {
        gpu.owns(fence, "fence")?;
        Ok(Self::new(fence, value, gpu.device()))
    }

    /// Refuses a value that the fence has already: it says nothing of work that is to come.
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

    /// The fence that has the value once the moment is reached.
    pub fn fence(&self) -> &ID3D12Fence {
        &self.fence
    }

    /// The value of the fence.
    pub fn value(&self) -> u64 {
        self.value
    }

    /// Whether it is reached; that of a removed device always is.
    pub fn reached(&self) -> bool {
        // SAFETY: a live fence; the call takes nothing.
        unsafe { self.fence.GetCompletedValue() >= self.value }
    }

    /// Waits until nothing of it runs any more, before what it uses is freed: as [`wait`](Self::wait), but also on a device that is
    /// gone, as not every driver drops what such a device was given.
    pub(crate) fn wait_ignoring_loss(&self) {
        let Ok(event) = Event::new() else { return };
        // SAFETY: as in `wait`.
        if unsafe { self.fence.SetEventOnCompletion(self.value, event.0) }.is_err() {
            return;
        }
        let mut patience = PATIENCE;
        while patience > 0 && !self.reached() && event.wait().is_ok_and(|came| !came) {
            patience -= u32::from(removed(&self.device).is_some());
        }
    }

    /// Waits for it with this thread.
    ///
    /// # Errors
    /// `DeviceRemoved` when the device is gone, before or meanwhile; the work may then be half done.
    pub fn wait(&self) -> Result<()> {
        if !self.reached() {
            let event = Event::new().map_err(|e| failed_on(&self.device, "CreateEventW", &e))?;
            // SAFETY: a live fence and a live event, which stays until after the wait; what the fence does to a closed handle
            // later is nothing.
            unsafe { self.fence.SetEventOnCompletion(self.value, event.0) }
                .map_err(|e| failed_on(&self.device, "ID3D12Fence::SetEventOnCompletion", &e))?;
            while !event.wait()? && !self.reached() {
                if let Some(gone) = removed(&self.device) {
                    self.wait_ignoring_loss();
                    return Err(gone);
                }
            }
        }
        removed(&self.device).map_or(Ok(()), Err)
    }
}

impl std::fmt::Debug for FencePoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Moment({}, {})", self.value, if self.reached() { "reached" } else { "to come" })
    }
}

/// An event of the system's, closed in the end.
struct Event(HANDLE);

impl Event {
    fn new() -> windows::core::Result<Self> {
        // SAFETY: no name and no security attributes are given.
        unsafe { CreateEventW(None, true, false, None) }.map(Self)
    }

    /// Waits a slice of time; whether the event came.
    fn wait(&self) -> Result<bool> {
        // SAFETY: the handle is open.
        match unsafe { WaitForSingleObject(self.0, SLICE_MS) } {
            WAIT_OBJECT_0 => Ok(true),
            WAIT_TIMEOUT => Ok(false),
            other => Err(Error::new(ErrorKind::Device, format!("WaitForSingleObject gave {:#x}", other.0))),
        }
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        // SAFETY: the handle is open and nobody else's.
        _ = unsafe { CloseHandle(self.0) };
    }
}
