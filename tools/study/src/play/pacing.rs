//! How fast the world is shown: in real time where it keeps up, else evenly in slow motion. Reads no clock.

use std::collections::VecDeque;

/// Number of steps whose median counts.
const STEPS: usize = 5;
/// Part by which frames are shown slower than anchors arrive, so that a step that takes a little longer is not late.
const SLACK: f64 = 0.06;
/// Relative change of the interval that is worth a change of pace.
const CHANGE: f64 = 0.12;

/// Measures how fast anchors arrive.
#[derive(Debug)]
pub(super) struct Pace {
    /// World time of a latent, in nanoseconds.
    world: u64,
    gaps: VecDeque<u64>,
    last: Option<u64>,
    interval: u64,
}

impl Pace {
    /// For a world of `latents_per_second`, at least 1.
    pub(super) fn new(latents_per_second: u32) -> Self {
        let world = 1_000_000_000 / u64::from(latents_per_second.max(1));
        Self { world, gaps: VecDeque::new(), last: None, interval: world }
    }

    /// Records the arrival of an anchor at `now`, in nanoseconds. Returns whether the [interval](Self::interval) changed.
    pub(super) fn arrived(&mut self, now: u64) -> bool {
        if let Some(last) = self.last.replace(now) {
            if self.gaps.len() == STEPS {
                self.gaps.pop_front();
            }
            self.gaps.push_back(now.saturating_sub(last));
        }
        let Some(median) = self.median() else { return false };
        let wanted = ((median as f64 * (1.0 + SLACK)) as u64).max(self.world);
        let wanted = if median as f64 <= self.world as f64 * (1.0 + SLACK) { self.world } else { wanted };
        let change = (wanted as f64 / self.interval as f64 - 1.0).abs();
        if change > CHANGE || (wanted == self.world && self.interval != self.world) {
            self.interval = wanted;
            return true;
        }
        false
    }

    /// Forgets when the last anchor came, after a pause or at the start of a level.
    pub(super) fn interrupt(&mut self) {
        self.last = None;
    }

    /// Time from one anchor to the next on the display, in nanoseconds.
    pub(super) fn interval(&self) -> u64 {
        self.interval
    }

    /// World time divided by real time, at most 1; `None` before the second anchor.
    pub(super) fn share(&self) -> Option<f64> {
        self.median().map(|median| (self.world as f64 / median.max(1) as f64).min(1.0))
    }

    /// Real time of a latent in nanoseconds; `None` before the second anchor.
    pub(super) fn median(&self) -> Option<u64> {
        let mut sorted: Vec<u64> = self.gaps.iter().copied().collect();
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).copied()
    }
}

/// Text about the pace, for the status line.
pub(super) fn describe(pace: &Pace) -> String {
    match (pace.share(), pace.median()) {
        (Some(share), _) if share > 0.94 => "real time".to_owned(),
        (Some(share), Some(median)) => format!(
            "slow motion: {:.0} % of real time, {:.2} s a latent",
            (100.0 * share).max(1.0),
            median as f64 / 1e9
        ),
        _ => "measuring the pace".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn at(gap: u64, count: u64) -> Pace {
        let mut pace = Pace::new(15);
        for i in 0..count {
            pace.arrived(i * gap);
        }
        pace
    }

    #[test]
    fn a_world_that_keeps_up_is_shown_in_real_time() {
        for gap in [20 * MS, 66 * MS, 69 * MS] {
            let pace = at(gap, 9);
            assert_eq!(pace.interval(), 1_000_000_000 / 15);
            assert_eq!(describe(&pace), "real time");
        }
    }

    #[test]
    fn a_slow_world_is_shown_evenly_and_its_share_is_told() {
        let pace = at(400 * MS, 9);
        assert!((pace.share().unwrap() - 1.0 / 6.0).abs() < 1e-6);
        assert!((400 * MS..440 * MS).contains(&pace.interval()));
        assert_eq!(describe(&pace), "slow motion: 17 % of real time, 0.40 s a latent");
    }

    #[test]
    fn one_slow_step_or_a_pause_changes_nothing() {
        let mut pace = at(400 * MS, 9);
        let interval = pace.interval();
        assert!(!pace.arrived(8 * 400 * MS + 3_000 * MS));
        pace.interrupt();
        assert!(!pace.arrived(99_000 * MS));
        assert!(!pace.arrived(99_400 * MS));
        assert_eq!(pace.interval(), interval);
        let mut now = 99_400 * MS;
        let changed = (0..STEPS).filter(|_| {
            now += 50 * MS;
            pace.arrived(now)
        });
        assert!(changed.count() > 0 && pace.interval() == 1_000_000_000 / 15, "it becomes faster again");
    }

    #[test]
    fn nothing_is_told_before_it_is_measured() {
        assert_eq!(describe(&at(MS, 1)), "measuring the pace");
    }
}
