//! Limits the work that a context has on the queue for anchors at a time.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::context::DirectMlContext;
use super::interval_times::WorkKind;
use crate::Result;

/// Estimated duration of a context's queued work, against the limit of
/// [`longest_submission`](super::DirectMlOptions::longest_submission). A pass here is one run of a graph: each slice of a transformer is one.
pub(super) struct SubmissionThrottle {
    longest: Option<Duration>,
    /// Nanoseconds of queued work, estimated from each pass's last duration; at least 1 for each queued pass.
    queued: AtomicU64,
    yields: u64,
}

impl SubmissionThrottle {
    pub(super) fn new(longest: Option<Duration>) -> Self {
        Self { longest, queued: AtomicU64::new(0), yields: 0 }
    }

    /// Records that the device has completed all submitted work.
    pub(super) fn clear(&self) {
        self.queued.store(0, Ordering::Relaxed);
    }

    /// How often the context waited because of the limit.
    pub(super) fn yields(&self) -> u64 {
        self.yields
    }

    /// Whether submitting a pass of this duration would exceed the limit. A duration of 0 is unmeasured and counts as the whole
    /// limit. A pass is always submitted when nothing is queued.
    fn is_too_long(&self, takes: Duration) -> bool {
        let queued = Duration::from_nanos(self.queued.load(Ordering::Relaxed));
        let fits = |longest| !takes.is_zero() && queued.saturating_add(takes) <= longest;
        !queued.is_zero() && self.longest.is_some_and(|longest| !fits(longest))
    }

    fn add(&self, takes: Duration) {
        let nanoseconds = u64::try_from(takes.as_nanos()).unwrap_or(u64::MAX).max(1);
        let sum = self.queued.load(Ordering::Relaxed).saturating_add(nanoseconds);
        self.queued.store(sum, Ordering::Relaxed);
    }
}

impl DirectMlContext {
    /// Waits for all submitted work if a pass of this kind would exceed the limit, then counts the pass as queued.
    pub(super) fn wait_for_queue_space(&mut self, kind: WorkKind) -> Result<()> {
        if self.throttle.longest.is_none() {
            return Ok(());
        }
        let takes = self.recorder.get_mut().gpu_time(kind).last;
        if self.throttle.is_too_long(takes) {
            let fence_point = self.recorder.get_mut().submit_and_signal()?;
            self.wait(&fence_point)?;
            self.throttle.yields += 1;
        }
        self.throttle.add(takes);
        Ok(())
    }
}
