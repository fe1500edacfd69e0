//! Frames held to a budget of the device's time.

use std::time::Duration;

/// Decides how many of the frames of an interval are made so that the device's time for a frame that is shown stays within a budget; the
/// others repeat the one before. It knows nothing beforehand: it goes by the times that the device says.
///
/// ```text
/// time of a frame   all that the device did for frames of an interval, divided by how many were shown
/// fewer are made    when it is above the budget
/// more are made     when it were at most 3/4 of the budget if it grew as much as their number, which is more than it can
/// ```
#[derive(Debug, Clone)]
pub(super) struct Governor {
    budget: Duration,
    multiplier: u32,
    /// Frames of an interval that are made: a divisor of the multiplier.
    made: u32,
    /// Frames whose time was not counted yet as they were begun under another decision.
    stale: u64,
    shown: u64,
    spent: Duration,
    /// Intervals that are looked at before more are made; grows when that was too much.
    patience: u64,
    has_grown: bool,
}

/// What was decided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decision {
    /// Frames of an interval that were made until now.
    pub(super) before: u32,
    /// Those that are from now on.
    pub(super) made: u32,
    /// Time of the device for a frame that was shown.
    pub(super) took: Duration,
}

/// Intervals that are looked at before fewer are made.
const INTERVALS: u64 = 2;
/// Intervals that are looked at before more are, at most.
const MOST_PATIENCE: u64 = 256;
/// Frames that may be under way when a decision is made.
const UNDER_WAY: u64 = 3;

/// The frame of an interval of `multiplier`, of which `made` are made, that is shown as frame `step` of it: the last one that is made.
pub(super) fn step(multiplier: u32, made: u32, step: u32) -> u32 {
    step - step % (multiplier / made)
}

impl Governor {
    /// For `multiplier` frames to an interval, of which all are made at first.
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

    /// Frames of an interval, and those of them that are made.
    pub(super) fn held(&self) -> (u32, u32) {
        (self.multiplier, self.made)
    }

    /// Takes note of what the device has spent on so many frames more; what follows from it, if anything.
    pub(super) fn note(&mut self, frames: u64, spent: Duration) -> Option<Decision> {
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
                self.patience = (2 * self.patience).min(MOST_PATIENCE);
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

    /// Begins to look anew.
    fn decide(&mut self, made: Option<u32>, took: Duration) -> Option<Decision> {
        (self.shown, self.spent) = (0, Duration::ZERO);
        let made = made?;
        let before = std::mem::replace(&mut self.made, made);
        self.stale = UNDER_WAY;
        Some(Decision { before, made, took })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Frames of a device that takes `made` for one that is made, `repeated` for one that is not, and `anchor` once an interval; the
    /// number that is made after `intervals` intervals, and how often it changed.
    fn run(governor: &mut Governor, intervals: u32, [made, repeated, anchor]: [Duration; 3]) -> (u32, u32) {
        let mut changes = 0;
        for _ in 0..intervals {
            for at in 0..governor.multiplier {
                let is_made = step(governor.multiplier, governor.made, at) == at;
                let spent = if is_made { made } else { repeated } + if at == 0 { anchor } else { Duration::ZERO };
                changes += u32::from(governor.note(1, spent).is_some());
            }
        }
        (governor.made, changes)
    }

    #[test]
    fn as_many_frames_are_made_as_the_budget_has_room_for() {
        for (budget, expected) in [(40, 6), (21, 6), (12, 3), (9, 2), (8, 1), (1, 1)] {
            let mut governor = Governor::new(budget * MS, 6);
            // Per frame that is shown: 3 for the anchor, and 3 for each of the six that is made.
            let (made, changes) = run(&mut governor, 400, [18 * MS, Duration::ZERO, 18 * MS]);
            assert_eq!(made, expected, "{budget} ms");
            assert!(changes <= 3, "{changes} changes at {budget} ms");
        }
    }

    #[test]
    fn what_has_become_cheaper_is_made_again_and_what_was_too_much_is_tried_ever_less() {
        let mut governor = Governor::new(10 * MS, 4);
        assert_eq!(run(&mut governor, 40, [30 * MS, MS, MS]).0, 1);
        assert_eq!(run(&mut governor, 40, [5 * MS, MS, MS]).0, 4);
        // Beside the limit: one looks cheap and two are too much.
        let (_, changes) = run(&mut governor, 4_000, [13 * MS, Duration::ZERO, Duration::ZERO]);
        assert!(changes < 60, "{changes}");
        let mut swinging = Governor::new(10 * MS, 2);
        let mut changes = 0;
        for _ in 0..4_000 {
            // Two to an interval cost three times as much as they should.
            let spent = if swinging.made == 2 { 11 * MS } else { 3 * MS };
            changes += u32::from(swinging.note(2, 2 * spent).is_some());
        }
        assert!(changes < 60, "{changes}");
    }

    #[test]
    fn the_others_repeat_the_last_one_that_is_made() {
        let mut governor = Governor::new(MS, 6);
        let shown = |governor: &Governor| {
            let (multiplier, made) = governor.held();
            (0..6).map(|at| step(multiplier, made, at)).collect::<Vec<_>>()
        };
        assert_eq!(shown(&governor), [0, 1, 2, 3, 4, 5]);
        for expected in [[0, 0, 2, 2, 4, 4], [0, 0, 0, 3, 3, 3], [0; 6], [0; 6]] {
            let decisions: Vec<_> = (0..18).filter_map(|_| governor.note(1, 9 * MS)).collect();
            assert_eq!(shown(&governor), expected);
            assert!(decisions.iter().all(|decision| decision.took == 9 * MS && decision.made < decision.before));
        }
    }
}
