//! Keeps the wall time of each latent within a budget, by the number of its denoise passes.

use std::time::Duration;

use super::latent_time::{LatentCost, LatentTime};
use super::schedule::{Schedule, pass_counts};
use crate::bundle::Sampler;
use crate::{Error, ErrorKind, Result};

/// Latents measured before each decision.
const LATENTS: u32 = 3;

/// A time budget for each latent, and the schedules that may be used to keep it.
#[derive(Debug, Clone)]
pub(super) struct LatentBudget {
    schedules: Vec<Schedule>,
    controller: PassController,
}

impl LatentBudget {
    /// A budget of `per_latent` for latents that start with the first of `schedules`, of which there is at least one.
    pub(super) fn new(per_latent: Duration, schedules: &[Schedule], sampler: &Sampler) -> Result<Self> {
        if per_latent.is_zero() {
            return Err(Error::new(ErrorKind::InvalidArgument, "no latent takes no time").field("per_latent"));
        }
        let passes = pass_counts(schedules, sampler, "schedules")?;
        Ok(Self { schedules: schedules.to_vec(), controller: PassController::new(per_latent, passes) })
    }

    /// Records the time of a latent. Returns the new schedule and the mean time of the last latents if the schedule changes.
    pub(super) fn record_latent(&mut self, time: LatentTime) -> Option<(&Schedule, Duration)> {
        let (schedule, mean) = self.controller.record_latent(time)?;
        Some((&self.schedules[schedule], mean))
    }
}

/// Chooses the number of passes of latents, by the measured time of a pass and of all other work. On a graphics device the wall times of the two are
/// not known; all other work then counts as one pass. This may underestimate fewer passes, which the next measurement corrects, and overestimates
/// more passes, so that these stay within the budget.
#[derive(Debug, Clone)]
struct PassController {
    budget: Duration,
    /// Passes of each schedule, descending.
    passes: Vec<u32>,
    /// Index of the schedule in use.
    schedule: usize,
    /// Latents of the measurement in progress, and the sum of their times.
    latents: u32,
    time: LatentTime,
}

impl PassController {
    fn new(budget: Duration, passes: Vec<u32>) -> Self {
        Self { budget, passes, schedule: 0, latents: 0, time: LatentTime::default() }
    }

    /// Records the time of a latent. Returns the index of the new schedule and the mean time of the last latents if the schedule
    /// changes.
    fn record_latent(&mut self, time: LatentTime) -> Option<(usize, Duration)> {
        self.latents += 1;
        self.time.add(time);
        if self.latents < LATENTS {
            return None;
        }
        let mean = self.time.total / self.latents;
        let cost = LatentCost::of(self.time, self.latents, self.passes[self.schedule]);
        (self.latents, self.time) = (0, LatentTime::default());
        let expected =
            |i: usize| Duration::try_from_secs_f64(cost.seconds(self.passes[i], 1.0)).unwrap_or(Duration::MAX);
        let last = self.passes.len() - 1;
        let schedule = if mean > self.budget {
            // At least the next schedule, even if none is expected to fit.
            (self.schedule + 1..=last).find(|i| expected(*i) <= self.budget).unwrap_or(last)
        } else {
            (0..self.schedule).find(|i| expected(*i) <= self.budget - self.budget / 8).unwrap_or(self.schedule)
        };
        (std::mem::replace(&mut self.schedule, schedule) != schedule).then_some((schedule, mean))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Simulates latents on a device that takes `pass` for each pass and `rest` for all other work; returns how often the schedule
    /// changed.
    fn run(controller: &mut PassController, latents: u32, pass: Duration, rest: Duration) -> u32 {
        let time = |controller: &PassController| {
            let passes = controller.passes[controller.schedule];
            LatentTime::undivided(pass * passes + rest, passes)
        };
        (0..latents).filter(|_| controller.record_latent(time(controller)).is_some()).count() as u32
    }

    #[test]
    fn latents_have_as_many_passes_as_there_is_time_for() {
        for (budget, expected) in [(200, 9), (100, 9), (99, 4), (50, 4), (49, 2), (30, 2), (29, 1), (1, 1)] {
            let mut controller = PassController::new(budget * MS, vec![9, 4, 2, 1]);
            let changes = run(&mut controller, 60, 10 * MS, 10 * MS);
            assert_eq!(
                (controller.passes[controller.schedule], changes <= 3),
                (expected, true),
                "{budget} ms, {changes} changes"
            );
        }
    }

    #[test]
    fn a_known_decoder_time_is_not_expected_to_shrink() {
        // 20 ms of passes and 60 ms of other work: 66 ms need three passes fewer, which the proportional estimate takes for one.
        let mut controller = PassController::new(66 * MS, vec![4, 3, 1]);
        let time = LatentTime { total: 80 * MS, passes: 20 * MS, count: 4 };
        let decision = (0..3).filter_map(|_| controller.record_latent(time)).next();
        assert_eq!(decision, Some((2, 80 * MS)));
    }

    #[test]
    fn passes_return_when_there_is_time_and_do_not_oscillate() {
        let mut controller = PassController::new(60 * MS, vec![9, 4, 2]);
        run(&mut controller, 30, 30 * MS, 10 * MS);
        assert_eq!(controller.passes[controller.schedule], 2);
        // The game no longer uses the device.
        assert_eq!(run(&mut controller, 30, 4 * MS, 4 * MS), 1);
        assert_eq!(controller.passes[controller.schedule], 9);
        // Work that does not depend on the passes dominates: fewer passes help little, and must not make the schedule oscillate.
        assert!(run(&mut controller, 300, 6 * MS, 40 * MS) <= 3);
    }
}
