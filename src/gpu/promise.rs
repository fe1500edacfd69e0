//! Moments of lists that an engine gives to its queue itself.

use windows::Win32::Graphics::Direct3D12::*;

use super::{Gpu, Moment, failed_on};
use crate::Result;

/// Says beforehand when a list of an engine's will have run: by a fence of its own, which the queue for frames is told to signal once
/// the list must have been given to it, and not when somebody else happens to ask the queue how far it is.
pub(crate) struct Promises {
    gpu: Gpu,
    fence: ID3D12Fence,
    last: u64,
    is_owed: bool,
}

impl Promises {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self> {
        // SAFETY: a live device; the call takes values only.
        let fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateFence", &e))?;
        Ok(Self { gpu: gpu.clone(), fence, last: 0, is_owed: false })
    }

    /// When the list that is recorded next will have run. Whoever takes it calls [`keep`](Self::keep) once the list was given to the
    /// queue, or never will be.
    pub(crate) fn next(&mut self) -> Result<Moment> {
        let moment = Moment::of_engine(&self.gpu, &self.fence, self.last + 1)?;
        self.last += 1;
        self.is_owed = true;
        Ok(moment)
    }

    /// Has the queue signal what was promised, behind all that it has been given.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub(crate) fn keep(&mut self) -> Result<()> {
        if self.is_owed {
            // SAFETY: a live queue and a fence of its device.
            unsafe { self.gpu.frames().d3d12().Signal(&self.fence, self.last) }
                .map_err(|e| failed_on(self.gpu.device(), "ID3D12CommandQueue::Signal", &e))?;
            self.is_owed = false;
        }
        Ok(())
    }
}

impl Drop for Promises {
    fn drop(&mut self) {
        // Whoever waits for it waits for what the queue has; of a device that is gone nobody can be told more.
        _ = self.keep();
    }
}
