//! When the list of a presented frame has run.

use windows::Win32::Graphics::Direct3D12::*;

use crate::Result;
use crate::gpu::{FencePoint, Gpu, failed_on};

/// A fence that the queue for frames is told to signal when the next frame is prepared. The list of the frame before has been given to the queue by
/// then: AMD's swap chain demands it before that frame's `Present`, and the next frame is prepared after that.
pub(super) struct PresentFence {
    gpu: Gpu,
    fence: ID3D12Fence,
    last: u64,
    is_owed: bool,
}

impl PresentFence {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        // SAFETY: a live device; the call takes values only.
        let fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateFence", &e))?;
        Ok(Self { gpu: gpu.clone(), fence, last: 0, is_owed: false })
    }

    /// When the list that is recorded next will have run.
    pub(super) fn next(&mut self) -> Result<FencePoint> {
        let fence_point = FencePoint::of_engine(&self.gpu, &self.fence, self.last + 1)?;
        self.last += 1;
        self.is_owed = true;
        Ok(fence_point)
    }

    /// The frame was presented, or never will be: has the queue signal the fence behind all that it has been given.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub(super) fn presented(&mut self) -> Result<()> {
        if self.is_owed {
            // SAFETY: a live queue and a fence of its device.
            unsafe { self.gpu.frames().d3d12().Signal(&self.fence, self.last) }
                .map_err(|e| failed_on(self.gpu.device(), "ID3D12CommandQueue::Signal", &e))?;
            self.is_owed = false;
        }
        Ok(())
    }
}

impl Drop for PresentFence {
    fn drop(&mut self) {
        // Whoever waits for it waits for what the queue has; of a device that is gone nobody can be told more.
        _ = self.presented();
    }
}
