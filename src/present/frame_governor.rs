//! Keeps a presenter's frames within a budget of device time.

use std::time::Duration;

/// Decides how many frames of an interval are made, so that the device time per shown frame stays within a budget; the other frames repeat the
/// one before. It relies only on measured device times.
///
/// ```text
/// time per frame   device time of an interval's frames, divided by the number of shown frames
/// fewer are made   if it exceeds the budget
/// more are made    if it would be at most 3/4 of the budget after growing in proportion to their number, which is an upper bound
/// ```
#[derive(Debug, Clone)]
pub(super) struct FrameGovernor {
    /// Device time per shown frame.
    budget: Duration,
    /// Frames shown per interval.
    multiplier: u32,
    /// Frames made per interval: a divisor of the multiplier.
    made: u32,
    /// Number of frames still to ignore because they began under the previous decision.
    stale: u64,
    /// Shown frames since the last decision.
    shown: u64,
    /// Device time of these frames.
    spent: Duration,
    /// Intervals to measure before more frames are made; doubles when an increase turned out to be too much.
    patience: u64,
    /// Whether the last decision was an increase.
    has_grown: bool,
}

/// A change of the number of frames made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decision {
    /// Frames made per interval before.
    pub(super) before: u32,
    /// Frames made per interval from now on.
    pub(super) made: u32,
    /// Device time per shown frame.
    pub(super) took: Duration,
}

/// Intervals to measure before fewer frames are made.
const INTERVALS: u64 = 2;
/// Largest number of intervals to measure before more frames are made.
const MAX_PATIENCE: u64 = 256;
/// Frames that may be in flight when a decision is made.
const IN_FLIGHT: u64 = 3;

/// The frame that is shown as frame `step` of an interval of `multiplier` frames, `made` of which are made: the last one made up to it.
pub(super) fn made_step(multiplier: u32, made: u32, step: u32) -> u32 {
    step - step % (multiplier / made)
}

impl FrameGovernor {
    /// For `multiplier` frames per interval, all of which are made at first.
    pub(super) fn new(budget: Duration, multiplier: u32) -> Self {
        Self {
            budget,
            multiplier,
            made: multiplier,
            stale: 0,
            shown: 0,
            spent: Duration::ZERO,
            patience: INTERVALS,
            has_grown: false,
        }
    }

    /// Frames per interval, and how many of them are made.
    pub(super) fn counts(&self) -> (u32, u32) {
        (self.multiplier, self.made)
    }

    /// Records the device time `spent` on `frames` more frames; returns a decision if the number of frames made changes.
    pub(super) fn record(&mut self, frames: u64, spent: Duration) -> Option<Decision> {
        if self.stale > 0 {
            self.stale = self.stale.saturating_sub(frames);
            return None;
        }
        self.shown += frames;
        self.spent = self.spent.saturating_add(spent);
        let intervals = self.shown / u64::from(self.multiplier);
        if intervals < INTERVALS {
            return None;
        }
        let took = self.spent / u32::try_from(self.shown).unwrap_or(u32::MAX);
        let divisors = |range: std::ops::RangeInclusive<u32>| range.filter(|n| self.multiplier.is_multiple_of(*n));
        if took > self.budget {
            let fewer = divisors(1..=self.made.saturating_sub(1)).next_back();
            if std::mem::take(&mut self.has_grown) {
                self.patience = (2 * self.patience).min(MAX_PATIENCE);
            }
            return self.decide(fewer, took);
        }
        if intervals < self.patience {
            return None;
        }
        let more = divisors(self.made + 1..=self.multiplier).next();
        let more = more.filter(|more| took * *more / self.made <= self.budget * 3 / 4);
        self.has_grown = more.is_some();
        self.decide(more, took)
    }

    /// Restarts the measurement and applies the new number, if any.
    fn decide(&mut self, made: Option<u32>, took: Duration) -> Option<Decision> {
        (self.shown, self.spent) = (0, Duration::ZERO);
        let made = made?;
        let before = std::mem::replace(&mut self.made, made);
        self.stale = IN_FLIGHT;
        Some(Decision { before, made, took })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Simulates a device that takes `made` for a made frame, `repeated` for a repeated one, and `anchor` once per interval. Returns the number of
    /// frames made per interval after `intervals` intervals, and how often it changed.
    fn run(governor: &mut FrameGovernor, intervals: u32, [made, repeated, anchor]: [Duration; 3]) -> (u32, u32) {
        let mut changes = 0;
        for _ in 0..intervals {
            for at in 0..governor.multiplier {
                let is_made = made_step(governor.multiplier, governor.made, at) == at;
                let spent = if is_made { made } else { repeated } + if at == 0 { anchor } else { Duration::ZERO };
                changes += u32::from(governor.record(1, spent).is_some());
            }
        }
        (governor.made, changes)
    }

    #[test]
    fn as_many_frames_are_made_as_fit_into_the_budget() {
        for (budget, expected) in [(40, 6), (21, 6), (12, 3), (9, 2), (8, 1), (1, 1)] {
            let mut governor = FrameGovernor::new(budget * MS, 6);
            // Per shown frame: 3 ms for the anchor, and 3 ms for each of the six frames that is made.
            let (made, changes) = run(&mut governor, 400, [18 * MS, Duration::ZERO, 18 * MS]);
            assert_eq!(made, expected, "{budget} ms");
            assert!(changes <= 3, "{changes} changes at {budget} ms");
        }
    }

    #[test]
    fn cheaper_frames_are_made_again_and_failed_increases_are_retried_less_often() {
        let mut governor = FrameGovernor::new(10 * MS, 4);
        assert_eq!(run(&mut governor, 40, [30 * MS, MS, MS]).0, 1);
        assert_eq!(run(&mut governor, 40, [5 * MS, MS, MS]).0, 4);
        // Near the limit: four frames exceed the budget, two are within it.
        let (_, changes) = run(&mut governor, 4_000, [13 * MS, Duration::ZERO, Duration::ZERO]);
        assert!(changes < 60, "{changes}");
        let mut alternating = FrameGovernor::new(10 * MS, 2);
        let mut changes = 0;
        for _ in 0..4_000 {
            // Two frames per interval cost more than three times as much as one, not twice as much.
            let spent = if alternating.made == 2 { 11 * MS } else { 3 * MS };
            changes += u32::from(alternating.record(2, 2 * spent).is_some());
        }
        assert!(changes < 60, "{changes}");
    }

    #[test]
    fn other_frames_repeat_the_last_made_frame() {
        let mut governor = FrameGovernor::new(MS, 6);
        let shown = |governor: &FrameGovernor| {
            let (multiplier, made) = governor.counts();
            (0..6).map(|at| made_step(multiplier, made, at)).collect::<Vec<_>>()
        };
        assert_eq!(shown(&governor), [0, 1, 2, 3, 4, 5]);
        for expected in [[0, 0, 2, 2, 4, 4], [0, 0, 0, 3, 3, 3], [0; 6], [0; 6]] {
            let decisions: Vec<_> = (0..18).filter_map(|_| governor.record(1, 9 * MS)).collect();
            assert_eq!(shown(&governor), expected);
            assert!(decisions.iter().all(|decision| decision.took == 9 * MS && decision.made < decision.before));
        }
    }
}
