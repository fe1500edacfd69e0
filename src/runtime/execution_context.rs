//! One rollout's timeline on a device.

use std::sync::Arc;

use super::Graph;
use crate::Result;
use crate::bundle::Precision;

/// Names a buffer of one context.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BufferId(pub(super) usize);

/// Names a graph of one context with every input and output bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BindingId(pub(super) usize);

/// Names copies of one context that were written down once to be done often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RecordedCopiesId(pub(super) usize);

/// Names a look at buffers of one context that was written down once to be taken often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FiniteCheckId(pub(super) usize);

/// A copy between two different buffers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RecordedCopy {
    pub(crate) to: BufferId,
    pub(crate) from: BufferId,
    pub(crate) regions: Vec<Region>,
}

/// Groups of buffers that one look tells apart.
pub(crate) const MAX_GROUPS: usize = 4;

/// One stretch of a copy between buffers, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    pub(crate) to: usize,
    pub(crate) from: usize,
    pub(crate) len: usize,
}

/// Bytes a context has moved since it was made, outside of graphs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bytes {
    /// From the host to the device.
    pub uploaded: u64,
    /// From buffer to buffer on the device.
    pub copied: u64,
    /// From the device to the host, because somebody asked.
    pub read: u64,
}

impl std::ops::Sub for Bytes {
    type Output = Bytes;

    /// What was moved since `earlier`.
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

/// Memory, bound graphs and the work submitted to them, in order. All of it belongs to the context, so a handle can
/// never outlive what it names; a context belongs to one user at a time.
///
/// What writes submits and may return before the work is done; `read` and `not_finite` wait for it.
///
/// Calls that say "all or nothing" are how state changes: when one fails, every buffer is as it was, now and after whatever is
/// submitted later. Only a device that is gone is beyond that.
pub(crate) trait ExecutionContext: Send {
    /// Makes a zeroed buffer.
    fn buffer(&mut self, bytes: usize) -> Result<BufferId>;

    /// A buffer's size in bytes.
    fn size(&self, of: BufferId) -> usize;

    /// Binds `graph` once and for all: `tensors` are its inputs in order, then its outputs in order. An output's buffer
    /// must not be bound twice in one binding.
    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId>;

    /// Writes `bytes` into `to` from byte `at` on. `bytes` may be reused at once.
    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()>;

    /// Writes buffers anew, each as a whole: all or nothing.
    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()>;

    /// Fills buffers with zeroes: all or nothing.
    fn clear(&mut self, buffers: &[BufferId]) -> Result<()>;

    /// Copies regions of `from` into `to`, two different buffers.
    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()>;

    /// Writes copies down, of which none reads or writes what another one writes.
    fn keep(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId>;

    /// Does copies that were written down, each of these once: all or nothing.
    fn repeat(&mut self, copies: &[RecordedCopiesId]) -> Result<()>;

    /// Copies what is in buffers, for [`put_back`](Self::put_back).
    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup>;

    /// Lets buffers have what they had when this context backed them up. Asks for no memory, as it is what follows a failure.
    fn put_back(&mut self, backup: Backup) -> Result<()>;

    /// Runs a bound graph.
    fn run(&mut self, binding: BindingId) -> Result<()>;

    /// Waits, then reads `into.len()` bytes of `from` from byte `at` on.
    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()>;

    /// Writes down a look at buffers of `precision`, in at most [`MAX_GROUPS`] groups.
    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId>;

    /// Waits, then names the first group of a look that holds a number that is not finite. The numbers stay where they are.
    fn not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>>;

    /// Waits, then lets the device's memory be used by others until the next call that needs it, which brings it back first and fails with
    /// all as it is where that cannot be. Nothing to do where memory is not the device's.
    fn rest(&mut self) -> Result<()> {
        Ok(())
    }

    /// Whether its memory is elsewhere since a [`rest`](Self::rest).
    fn is_resting(&self) -> bool {
        false
    }

    /// What was moved so far.
    fn bytes(&self) -> Bytes;

    /// Time on the device of runs or copies that are done; none on a device that is no Direct3D 12 one.
    #[cfg(windows)]
    fn spent(&mut self, on: Work<'_>) -> Option<crate::gpu::Spent> {
        let _ = on;
        None
    }

    /// What the processor has done besides its own work; none on a device that is no Direct3D 12 one.
    #[cfg(windows)]
    fn external(&self) -> Option<ExternalTimes> {
        None
    }

    /// Which bound runs are captured; none on a device that is no Direct3D 12 one.
    #[cfg(windows)]
    fn captured(&self) -> Option<super::Captured> {
        None
    }

    /// Room on the device for a copy of `latent` and for `pictures` pictures of `size`; none on a device that is no Direct3D 12 one.
    #[cfg(windows)]
    fn room_on_device(
        &mut self,
        latent: BufferId,
        pictures: usize,
        size: (u32, u32),
    ) -> Result<Option<super::Snapshot>> {
        let _ = (latent, pictures, size);
        Ok(None)
    }

    /// Has a latent and its pictures copied into their room, which is of this context. Nothing waits for it, and no memory is asked
    /// for.
    #[cfg(windows)]
    fn keep_on_device(&mut self, decoded: &Decoded<'_>, latent: BufferId, into: &mut super::Snapshot) -> Result<()> {
        let _ = (decoded, latent, into);
        Err(crate::Error::new(crate::ErrorKind::Unsupported, "the device keeps no pictures"))
    }
}

/// What was in buffers of one context.
pub(crate) enum Backup {
    Host(Vec<(BufferId, Vec<u8>)>),
    #[cfg(windows)]
    Device(super::directml::Backup),
}

/// Wall time of a context that is not the library's own.
#[cfg(windows)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExternalTimes {
    /// Inside ONNX Runtime, which makes the device's command lists and gives them to the queue.
    pub inside: std::time::Duration,
    /// Waiting for the device.
    pub waited: std::time::Duration,
    /// How often it waited so that other queues' work gets its turn before more is given to this one.
    pub yields: u64,
}

#[cfg(windows)]
impl ExternalTimes {
    /// Both together.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            inside: self.inside.saturating_add(other.inside),
            waited: self.waited.saturating_add(other.waited),
            yields: self.yields + other.yields,
        }
    }
}

/// What a context times on its device.
#[cfg(windows)]
#[derive(Clone, Copy)]
pub(crate) enum Work<'a> {
    /// Runs of a graph that is bound in the context, through whichever binding.
    Runs(&'a Arc<Graph>),
    /// Copies that were written down once.
    Repeated,
}

/// A decoder's pictures in a buffer of one context.
#[cfg(windows)]
pub(crate) struct Decoded<'a> {
    /// `[pictures, 3, height, width]`
    pub(crate) planes: BufferId,
    /// Which ones of them are meant, counted from 0.
    pub(crate) pictures: &'a [u32],
    /// Width and height.
    pub(crate) size: (u32, u32),
    pub(crate) precision: Precision,
}
