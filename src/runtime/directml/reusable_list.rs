//! Command lists that are recorded once and run often.

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use crate::gpu::{FencePoint, Gpu, failed_on, open_list};
use crate::runtime::execution_context::Region;
use crate::{Error, Result};

/// A closed command list.
pub(super) struct ReusableList {
    list: ID3D12CommandList,
    _allocator: ID3D12CommandAllocator,
    /// Reached when its last submission has run: until then it must not be submitted again.
    last: Option<FencePoint>,
}

impl ReusableList {
    /// Records copies, each of regions of one buffer into another. Buffers are in the state COMMON between lists; each copy
    /// promotes them.
    pub(super) fn new<'a>(
        gpu: &Gpu,
        copies: impl Iterator<Item = ((&'a ID3D12Resource, &'a ID3D12Resource), &'a [Region])>,
    ) -> Result<Self> {
        Self::record(gpu, |list| {
            for ((to, from), regions) in copies {
                for r in regions {
                    // SAFETY: an open list; the context holds both buffers as long as this list, and the ranges are inside them.
                    unsafe { list.CopyBufferRegion(to, r.to as u64, from, r.from as u64, r.len as u64) };
                }
            }
        })
    }

    /// Calls `record` with an open list, which expects all buffers in the state COMMON. The caller keeps the resources that the
    /// list uses alive as long as this list.
    pub(super) fn record(gpu: &Gpu, record: impl FnOnce(&ID3D12GraphicsCommandList)) -> Result<Self> {
        let failed = |call: &str, e: &windows::core::Error| -> Error { failed_on(gpu.device(), call, e) };
        let (list, allocator) = open_list(gpu, gpu.anchors().kind())?;
        record(&list);
        // SAFETY: an open list.
        unsafe { list.Close() }.map_err(|e| failed("ID3D12GraphicsCommandList::Close", &e))?;
        let list = list.cast().map_err(|e| failed("IUnknown::QueryInterface", &e))?;
        Ok(Self { list, _allocator: allocator, last: None })
    }

    /// Waits until the list may be submitted again. Its last run is normally long over, except when a ring slot is used twice
    /// within a short time.
    pub(super) fn ready(&self) -> Result<()> {
        self.last.as_ref().map_or(Ok(()), FencePoint::wait)
    }

    /// The list, in the type that a queue takes.
    pub(super) fn list(&self) -> &ID3D12CommandList {
        &self.list
    }

    /// Records that the list was submitted and has run when `fence_point` is reached.
    pub(super) fn runs_until(&mut self, fence_point: &FencePoint) {
        self.last = Some(fence_point.clone());
    }
}
