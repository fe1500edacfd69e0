//! The memory, bound graphs and ordered work of one rollout on a device.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::Graph;
use crate::bundle::Precision;
use crate::{Error, ErrorKind, Picture, Result};

/// Handle of a buffer of one context.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BufferId(pub(super) usize);

/// Handle of a graph with all inputs and outputs bound to buffers of one context.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BindingId(pub(super) usize);

/// Handle of copies that one context recorded once and runs often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RecordedCopiesId(pub(super) usize);

/// Handle of a finite check that one context recorded once and runs often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FiniteCheckId(pub(super) usize);

/// A copy between two different buffers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RecordedCopy {
    pub(crate) to: BufferId,
    pub(crate) from: BufferId,
    pub(crate) regions: Vec<Region>,
}

/// Maximum number of buffer groups that one finite check distinguishes.
pub(crate) const MAX_GROUPS: usize = 4;

/// One range of a copy between buffers: offsets and length in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    pub(crate) to: usize,
    pub(crate) from: usize,
    pub(crate) len: usize,
}

/// Bytes that a context has moved since it was created, outside of graphs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bytes {
    /// From the host to the device.
    pub uploaded: u64,
    /// From buffer to buffer on the device.
    pub copied: u64,
    /// From the device to the host, on request.
    pub read: u64,
}

impl std::ops::Sub for Bytes {
    type Output = Bytes;

    /// The bytes moved since `earlier`.
    fn sub(self, earlier: Bytes) -> Bytes {
        Bytes {
            uploaded: self.uploaded - earlier.uploaded,
            copied: self.copied - earlier.copied,
            read: self.read - earlier.read,
        }
    }
}

impl std::ops::Add for Bytes {
    type Output = Bytes;

    fn add(self, other: Bytes) -> Bytes {
        Bytes {
            uploaded: self.uploaded + other.uploaded,
            copied: self.copied + other.copied,
            read: self.read + other.read,
        }
    }
}

/// Limits of a context's work.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContextLimits {
    /// The context waits before it queues more work on a graphics device than this, as one does whose device has that limit. The smaller of
    /// both limits holds; a processor has no queue.
    #[cfg_attr(not(windows), expect(dead_code, reason = "Direct3D 12 queues alone are limited"))]
    pub(crate) longest_submission: Option<Duration>,
    /// While it is set, runs of graphs fail with `Cancelled`. All other calls work, so that the state can be restored after a failed run.
    pub(crate) stop: Option<Arc<AtomicBool>>,
}

impl ContextLimits {
    /// Fails with `Cancelled` while `stop` is set.
    pub(super) fn check_stop(&self) -> Result<()> {
        match &self.stop {
            Some(stop) if stop.load(Ordering::SeqCst) => {
                Err(Error::new(ErrorKind::Cancelled, "the step was cancelled"))
            }
            _ => Ok(()),
        }
    }
}

/// Memory, bound graphs and the work submitted to them, in order. All of it belongs to the context, so a handle never outlives its
/// object; a context belongs to one user at a time.
///
/// Calls that write submit work and may return before it is done; `read`, `find_not_finite` and `rest` wait for it.
///
/// Calls marked "all or nothing" are atomic: if one fails, every buffer keeps its contents, also after later submissions, unless
/// the device was removed.
pub(crate) trait ExecutionContext: Send {
    /// Creates a zeroed buffer of `bytes` bytes.
    fn buffer(&mut self, bytes: usize) -> Result<BufferId>;

    /// A buffer's size in bytes.
    fn size(&self, of: BufferId) -> usize;

    /// Binds `graph` to buffers permanently: `tensors` are its inputs in order, then its outputs in order. An output's buffer must
    /// not be bound twice in one binding.
    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId>;

    /// Writes `bytes` into `to` from byte `at` on. `bytes` may be reused at once.
    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()>;

    /// How often recorded work was lost because it could not be submitted: uploads that earlier calls recorded may not have reached their
    /// buffers.
    fn lost_submissions(&self) -> u64 {
        0
    }

    /// Replaces the contents of whole buffers: all or nothing.
    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()>;

    /// Fills buffers with zeroes: all or nothing.
    fn clear(&mut self, buffers: &[BufferId]) -> Result<()>;

    /// Copies regions of `from` into `to`, two different buffers.
    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()>;

    /// Records copies. None may read or write a buffer that another one writes.
    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId>;

    /// Runs recorded copies, each once: all or nothing.
    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()>;

    /// As [`run_copies`](Self::run_copies), to undo other copies. Allocates nothing, because it runs after failures.
    fn undo_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.run_copies(copies)
    }

    /// Copies the contents of buffers, for [`restore_backup`](Self::restore_backup).
    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup>;

    /// Restores the contents of buffers that this context backed up. Allocates nothing, because it runs after failures.
    fn restore_backup(&mut self, backup: Backup) -> Result<()>;

    /// Runs a bound graph. Fails with `Cancelled` while the context [is stopped](ContextLimits::stop).
    fn run(&mut self, binding: BindingId) -> Result<()>;

    /// Waits, then reads `into.len()` bytes of `from` from byte `at` on.
    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()>;

    /// Makes what [`read_picture`](Self::read_picture) needs for pictures like this one, so that it allocates nothing later.
    fn prepare_read_picture(&mut self, from: &DecodedPicture<'_>) -> Result<()> {
        let _ = from;
        Ok(())
    }

    /// Waits, then reads a decoded picture that the device has converted. Returns false, and does nothing, if the device converts no
    /// pictures: then the caller reads the planes and converts them.
    fn read_picture(&mut self, from: &DecodedPicture<'_>, into: &mut Picture) -> Result<bool> {
        let _ = (from, into);
        Ok(false)
    }

    /// Records a finite check of buffers of `precision`, in at most [`MAX_GROUPS`] groups.
    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId>;

    /// Waits, then returns the first group that holds a value that is not finite. The values stay on the device.
    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>>;

    /// Waits, then evicts the context's device memory until the next call that needs it. That call makes it resident first, and
    /// changes nothing if this fails. Does nothing for host memory.
    fn rest(&mut self) -> Result<()> {
        Ok(())
    }

    /// Whether its memory is evicted after a [`rest`](Self::rest).
    fn is_resting(&self) -> bool {
        false
    }

    /// Bytes moved so far.
    fn bytes(&self) -> Bytes;

    /// Device time of completed runs or copies; `None` if the device is not a Direct3D 12 device.
    #[cfg(windows)]
    fn gpu_time(&mut self, on: Work<'_>) -> Option<crate::gpu::GpuTimeStatistics> {
        let _ = on;
        None
    }

    /// Wall time spent outside of this library; `None` if the device is not a Direct3D 12 device.
    #[cfg(windows)]
    fn external_times(&self) -> Option<ExternalTimes> {
        None
    }

    /// How many bindings are captured; `None` if the device is not a Direct3D 12 device.
    #[cfg(windows)]
    fn capture_statistics(&self) -> Option<CaptureStatistics> {
        None
    }

    /// Allocates device memory for a copy of `latent` and for `pictures` pictures of `size`; `None` if the device is not a Direct3D
    /// 12 device.
    #[cfg(windows)]
    fn allocate_snapshot(
        &mut self,
        latent: BufferId,
        pictures: usize,
        size: (u32, u32),
    ) -> Result<Option<super::Snapshot>> {
        let _ = (latent, pictures, size);
        Ok(None)
    }

    /// Submits the copies of a latent and its pictures into `into`, which this context allocated. Does not wait, and allocates
    /// nothing.
    #[cfg(windows)]
    fn fill_snapshot(&mut self, decoded: &Decoded<'_>, latent: BufferId, into: &mut super::Snapshot) -> Result<()> {
        let _ = (decoded, latent, into);
        Err(crate::Error::new(crate::ErrorKind::Unsupported, "the device keeps no pictures"))
    }
}

/// Backed-up contents of buffers of one context, in the form that its backend keeps them in.
pub(crate) struct Backup(Box<dyn Any>);

impl Backup {
    pub(super) fn new(contents: impl Any) -> Self {
        Self(Box::new(contents))
    }

    /// The contents. Only the backend that made the backup is given it.
    pub(super) fn into_contents<T: Any>(self) -> Box<T> {
        self.0.downcast().expect("a backup of this context")
    }
}

/// How many passes are captured, and why others are not. A pass here is a graph with one set of bound buffers.
#[cfg(windows)]
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CaptureStatistics {
    /// Passes that run by capture.
    pub used: usize,
    /// Passes that have not run yet, or whose captured runs are still compared with normal ones.
    pub unproven: usize,
    /// Passes that run without capture.
    pub unused: usize,
    /// Why one of the `unused` passes is not captured.
    pub reason: Option<String>,
}

/// Wall time that a context spent outside of this library's own code.
#[cfg(windows)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExternalTimes {
    /// Inside ONNX Runtime, which records the command lists and submits them.
    pub in_onnxruntime: std::time::Duration,
    /// Time spent waiting for the device.
    pub waiting_for_device: std::time::Duration,
    /// Number of waits for queued work because of the submission limit, which lets other queues' work run.
    pub yields: u64,
}

#[cfg(windows)]
impl ExternalTimes {
    /// The sum of both.
    pub(crate) fn merge(self, other: Self) -> Self {
        Self {
            in_onnxruntime: self.in_onnxruntime.saturating_add(other.in_onnxruntime),
            waiting_for_device: self.waiting_for_device.saturating_add(other.waiting_for_device),
            yields: self.yields + other.yields,
        }
    }
}

/// Work whose device time a context measures.
#[cfg(windows)]
#[derive(Clone, Copy)]
pub(crate) enum Work<'a> {
    /// Runs of a graph, through any of its bindings in the context.
    Runs(&'a Arc<Graph>),
    /// Recorded copies.
    RecordedCopies,
}

/// The source position of one output row or column of a resampling: at fraction `t` between rows or columns `low` and `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tap {
    pub(crate) low: usize,
    pub(crate) high: usize,
    pub(crate) t: f32,
}

/// A picture among a decoder's output, and how it is resampled.
pub(crate) struct DecodedPicture<'a> {
    /// `[pictures, 3, height, width]`
    pub(crate) planes: BufferId,
    pub(crate) pictures: usize,
    /// Height and width.
    pub(crate) size: [usize; 2],
    pub(crate) precision: Precision,
    /// Number of the picture, from 0.
    pub(crate) index: usize,
    /// The resampled picture's rows and columns.
    pub(crate) rows: &'a [Tap],
    pub(crate) columns: &'a [Tap],
}

/// A decoder's output in a buffer of one context.
#[cfg(windows)]
pub(crate) struct Decoded<'a> {
    /// `[pictures, 3, height, width]`
    pub(crate) planes: BufferId,
    /// Indices of the pictures to use, from 0.
    pub(crate) pictures: &'a [u32],
    /// Width and height.
    pub(crate) size: (u32, u32),
    pub(crate) precision: Precision,
}
