//! Keeps a presenter's frames within a budget, its own or a rollout's.

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::super::frame_governor::{self, FrameGovernor};
use super::super::pacing::{Due, DueFrame};
use super::{Presenter, Stream};
use crate::world;
use crate::{Error, ErrorKind, Result};

impl Presenter {
    /// Limits the device time per shown frame, averaged over an interval and including the work done once per anchor; `None` removes the limit. If
    /// the budget is too small, only every second, third or sixth frame of an interval is made, depending on the multiplier's divisors, and the
    /// others repeat the one before; if it suffices again, more frames are made. The decision uses device times of finished frames and has no effect
    /// on frames made on the CPU. Changes are logged and counted in [`statistics`](Self::statistics).
    ///
    /// # Errors
    /// `InvalidArgument` for a time of 0.
    pub fn set_budget(&self, per_frame: Option<Duration>) -> Result<()> {
        if per_frame == Some(Duration::ZERO) {
            return Err(Error::new(ErrorKind::InvalidArgument, "no frame takes no time").field("budget"));
        }
        let governor = per_frame.map(|budget| FrameGovernor::new(budget, self.options.multiplier));
        let mut stream = self.stream.lock();
        stream.statistics.made_to_anchor = self.options.multiplier;
        stream.governor = governor;
        stream.followed = None;
        Ok(())
    }

    /// Makes as many frames per interval as a rollout's governor decides, and reports their device time to it, as long as the rollout is governed.
    /// Replaces [`set_budget`](Self::set_budget), and is ended by it. `None`: makes all frames again. Frames made on the CPU use no device time but
    /// are dropped like others.
    ///
    /// # Errors
    /// `InvalidArgument` for a governor of another multiplier.
    pub fn follow(&self, governor: Option<&Arc<world::Governor>>) -> Result<()> {
        if let Some(theirs) = governor.map(|governor| governor.multiplier())
            && theirs != self.options.multiplier
        {
            let cause = format!("{theirs} frames to an anchor where the presenter shows {}", self.options.multiplier);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("budget.multiplier"));
        }
        if let Some(governor) = governor {
            governor.allow_fewer_frames();
        }
        let mut stream = self.stream.lock();
        stream.governor = None;
        stream.followed = governor.map(Arc::downgrade);
        Ok(())
    }

    /// Records the device time spent on `frames` more frames, and adapts how many frames are made.
    #[cfg_attr(not(any(windows, test)), expect(dead_code, reason = "only frames made on a device have a device time"))]
    pub(super) fn record_device_time(&self, frames: u64, spent: Duration) {
        let mut stream = self.stream.lock();
        if let Some(governor) = stream.followed() {
            drop(stream);
            return governor.record_frames(frames, spent);
        }
        let Stream { governor: Some(governor), statistics, .. } = &mut *stream else { return };
        if let Some(decision) = governor.record(frames, spent) {
            statistics.made_to_anchor = decision.made;
            statistics.budget_changes += 1;
            drop(stream);
            let (before, made, took) = (decision.before, decision.made, decision.took);
            log::info!(
                "{made} frames to an anchor are made instead of {before}: one took {took:?} of the device's time"
            );
        }
    }
}

impl Stream {
    /// The rollout's governor, while it exists.
    pub(super) fn followed(&self) -> Option<Arc<world::Governor>> {
        self.followed.as_ref().and_then(Weak::upgrade)
    }

    /// The frame that is due at `now`, or the earlier frame that replaces it under the budget.
    pub(super) fn due(&mut self, now: u64) -> Option<Due> {
        let due = self.pacer.as_mut()?.due(now)?;
        let followed = self.followed().map(|governor| (governor.multiplier(), governor.generated_frames()));
        let counts = followed.or_else(|| self.governor.as_ref().map(FrameGovernor::counts));
        let Some((multiplier, made)) = counts else { return Some(due) };
        let made_step = |step| frame_governor::made_step(multiplier, made, step);
        let frame = match due.frame {
            DueFrame::Interpolate { previous, step } => match made_step(step) {
                0 => DueFrame::Anchor(previous),
                step => DueFrame::Interpolate { previous, step },
            },
            DueFrame::Extrapolate { last, step } => match made_step(step) {
                0 => DueFrame::Anchor(last),
                step => DueFrame::Extrapolate { last, step },
            },
            other => other,
        };
        Some(Due { frame, ..due })
    }
}
