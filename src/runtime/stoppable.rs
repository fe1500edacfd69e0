//! An execution context that can be stopped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::execution_context::{
    Backup, BindingId, BufferId, Bytes, DecodedPicture, ExecutionContext, FiniteCheckId, RecordedCopiesId,
    RecordedCopy, Region,
};
use super::{Device, Graph};
use crate::bundle::Precision;
use crate::{Error, ErrorKind, Picture, Result};

/// A context whose runs fail with `Cancelled` while its flag is set. All other calls work, so that the state can be restored after
/// a failed run.
pub(crate) struct StoppableContext {
    inner: Box<dyn ExecutionContext>,
    stop: Arc<AtomicBool>,
}

impl StoppableContext {
    /// A context of `device` that is stopped by `stop`, with a [limit](Device::context_with_limit) on queued work.
    pub(crate) fn new(device: &Device, longest_submission: Option<Duration>, stop: Arc<AtomicBool>) -> Result<Self> {
        Ok(Self { inner: device.context_with_limit(longest_submission)?, stop })
    }
}

impl ExecutionContext for StoppableContext {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        self.inner.buffer(bytes)
    }

    fn size(&self, of: BufferId) -> usize {
        self.inner.size(of)
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        self.inner.bind(graph, tensors)
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.inner.upload(to, at, bytes)
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        self.inner.replace(contents)
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        self.inner.clear(buffers)
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.inner.copy(to, from, regions)
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.inner.record_copies(copies)
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.inner.run_copies(copies)
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        self.inner.back_up(of)
    }

    fn undo_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.inner.undo_copies(copies)
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        self.inner.restore_backup(backup)
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        if self.stop.load(Ordering::SeqCst) {
            return Err(Error::new(ErrorKind::Cancelled, "the step was cancelled"));
        }
        self.inner.run(binding)
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        self.inner.read(from, at, into)
    }

    fn prepare_read_picture(&mut self, from: &DecodedPicture<'_>) -> Result<()> {
        self.inner.prepare_read_picture(from)
    }

    fn read_picture(&mut self, from: &DecodedPicture<'_>, into: &mut Picture) -> Result<bool> {
        self.inner.read_picture(from, into)
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        self.inner.add_finite_check(groups, precision)
    }

    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>> {
        self.inner.find_not_finite(check)
    }

    fn rest(&mut self) -> Result<()> {
        self.inner.rest()
    }

    fn is_resting(&self) -> bool {
        self.inner.is_resting()
    }

    fn bytes(&self) -> Bytes {
        self.inner.bytes()
    }

    #[cfg(windows)]
    fn gpu_time(&mut self, on: super::Work<'_>) -> Option<crate::gpu::GpuTimeStatistics> {
        self.inner.gpu_time(on)
    }

    #[cfg(windows)]
    fn external_times(&self) -> Option<super::ExternalTimes> {
        self.inner.external_times()
    }

    #[cfg(windows)]
    fn capture_statistics(&self) -> Option<super::CaptureStatistics> {
        self.inner.capture_statistics()
    }

    #[cfg(windows)]
    fn allocate_snapshot(
        &mut self,
        latent: BufferId,
        pictures: usize,
        size: (u32, u32),
    ) -> Result<Option<super::Snapshot>> {
        self.inner.allocate_snapshot(latent, pictures, size)
    }

    #[cfg(windows)]
    fn fill_snapshot(
        &mut self,
        decoded: &super::Decoded<'_>,
        latent: BufferId,
        into: &mut super::Snapshot,
    ) -> Result<()> {
        self.inner.fill_snapshot(decoded, latent, into)
    }
}
