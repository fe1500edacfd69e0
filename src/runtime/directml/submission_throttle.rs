//! How much work the queue for anchors is given at a time.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::context::DirectMlContext;
use super::times::Kind;
use crate::Result;

/// A context's work that nobody has waited for, against what it may be.
pub(super) struct SubmissionThrottle {
    longest: Option<Duration>,
    /// Nanoseconds, as passes took before; 1 at least where there is any.
    queued: AtomicU64,
    yields: u64,
}

impl SubmissionThrottle {
    pub(super) fn new(longest: Option<Duration>) -> Self {
        Self { longest, queued: AtomicU64::new(0), yields: 0 }
    }

    /// The device has done all that it was given.
    pub(super) fn clear(&self) {
        self.queued.store(0, Ordering::Relaxed);
    }

    /// How often was waited.
    pub(super) fn yields(&self) -> u64 {
        self.yields
    }

    /// Whether a pass that takes so long comes only after what is queued; one of which nothing is known is taken to be as long as may be.
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
    /// Waits for what the queue has been given where a pass of a kind would make it more than it may be.
    pub(super) fn wait_for_room(&mut self, kind: Kind) -> Result<()> {
        if self.throttle.longest.is_none() {
            return Ok(());
        }
        let takes = self.recorder.get_mut().spent(kind).last;
        if self.throttle.is_too_long(takes) {
            let fence_point = self.recorder.get_mut().now()?;
            self.wait(&fence_point)?;
            self.throttle.yields += 1;
        }
        self.throttle.add(takes);
        Ok(())
    }
}
