//! What is in buffers, kept on the device.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::reusable_list::ReusableList;
use crate::Result;
use crate::gpu::{FencePoint, Gpu, Heap, buffer};
use crate::runtime::execution_context::Region;

/// A copy of buffers, and the list that brings it back: recorded with it, so that nothing is asked for when that is needed.
pub(crate) struct Backup {
    back: ReusableList,
    /// The list that made the copy, and where that is.
    _forth: ReusableList,
    _copy: ID3D12Resource,
    /// When nothing of it is used any more.
    last: FencePoint,
}

impl Backup {
    /// Copies buffers, each of so many bytes, behind all that the queue for anchors was given.
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

    /// Brings it back, behind all that the queue for anchors was given.
    pub(super) fn put_back(mut self, gpu: &Gpu) -> Result<()> {
        self.last = gpu.anchors().submit(std::slice::from_ref(self.back.list()))?;
        Ok(())
    }
}

impl Drop for Backup {
    fn drop(&mut self) {
        // The queue may still use what is freed next.
        self.last.wait_ignoring_loss();
    }
}
