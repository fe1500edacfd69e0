//! Copies of buffers on the device, and how they are restored.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::reusable_list::ReusableList;
use crate::Result;
use crate::gpu::{FencePoint, Gpu, Heap, buffer};
use crate::runtime::execution_context::Region;

/// A copy of buffers, with the command list that restores them. That list is recorded together with the copy, so restoring
/// allocates nothing.
pub(crate) struct DeviceBackup {
    back: ReusableList,
    /// The list that made the copy, and the buffer with the copy.
    _forth: ReusableList,
    _copy: ID3D12Resource,
    /// Reached when the queue no longer uses the copy or the lists.
    last: FencePoint,
}

impl DeviceBackup {
    /// Copies buffers, each given with its size in bytes, after all work submitted to the queue for anchors.
    pub(super) fn new(gpu: &Gpu, of: &[(&ID3D12Resource, usize)]) -> Result<Self> {
        let copy = buffer(gpu, Heap::Device, of.iter().map(|(_, bytes)| bytes).sum())?;
        let (mut forth, mut back) = (Vec::with_capacity(of.len()), Vec::with_capacity(of.len()));
        let mut at = 0;
        for &(_, len) in of {
            forth.push([Region { to: at, from: 0, len }]);
            back.push([Region { to: 0, from: at, len }]);
            at += len;
        }
        let forth = of.iter().zip(&forth).map(|((buffer, _), regions)| ((&copy, *buffer), regions.as_slice()));
        let forth = ReusableList::new(gpu, forth)?;
        let back = of.iter().zip(&back).map(|((buffer, _), regions)| ((*buffer, &copy), regions.as_slice()));
        let back = ReusableList::new(gpu, back)?;
        let last = gpu.anchors().submit(std::slice::from_ref(forth.list()))?;
        Ok(Self { back, _forth: forth, _copy: copy, last })
    }

    /// Restores the buffers, after all work submitted to the queue for anchors.
    pub(super) fn restore_backup(mut self, gpu: &Gpu) -> Result<()> {
        self.last = gpu.anchors().submit(std::slice::from_ref(self.back.list()))?;
        Ok(())
    }
}

impl Drop for DeviceBackup {
    fn drop(&mut self) {
        // The queue may still use the resources that are freed next.
        self.last.wait_ignoring_loss();
    }
}
