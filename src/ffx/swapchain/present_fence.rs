//! The fence that signals when a presented frame's command list has run.

use windows::Win32::Graphics::Direct3D12::*;

use crate::Result;
use crate::gpu::{FencePoint, Gpu, failed_on};

/// A fence that the frame queue signals when the next frame is prepared. By then the previous frame's list has been submitted:
/// AMD's swap chain requires that before `Present`, and the next frame is prepared after it.
pub(super) struct PresentFence {
    gpu: Gpu,
    fence: ID3D12Fence,
    last: u64,
    is_unsignalled: bool,
}

impl PresentFence {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        // SAFETY: a live device; the call takes values only.
        let fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateFence", &e))?;
        Ok(Self { gpu: gpu.clone(), fence, last: 0, is_unsignalled: false })
    }

    /// The fence point at which the next recorded list will have run.
    pub(super) fn next(&mut self) -> Result<FencePoint> {
        let fence_point = FencePoint::of_engine(&self.gpu, &self.fence, self.last + 1)?;
        self.last += 1;
        self.is_unsignalled = true;
        Ok(fence_point)
    }

    /// Signals the fence after all work submitted to the queue. Call it when the frame was presented, or when it never will be.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub(super) fn signal_presented(&mut self) -> Result<()> {
        if self.is_unsignalled {
            // SAFETY: a live queue and a fence of its device.
            unsafe { self.gpu.frames().d3d12().Signal(&self.fence, self.last) }
                .map_err(|e| failed_on(self.gpu.device(), "ID3D12CommandQueue::Signal", &e))?;
            self.is_unsignalled = false;
        }
        Ok(())
    }
}

impl Drop for PresentFence {
    fn drop(&mut self) {
        // Waiters wait for the work already on the queue. A failure means that the device was removed; there is nobody to report it
        // to.
        _ = self.signal_presented();
    }
}
