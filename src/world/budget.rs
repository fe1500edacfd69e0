//! Keeps latents within a time budget.

use std::time::Duration;

use super::{Rollout, Schedule};
use crate::bundle::Sampler;
use crate::{Error, ErrorKind, Result};

/// Latents measured before each decision.
const LATENTS: u32 = 3;
/// Maximum number of schedules of a budget.
const MOST_SCHEDULES: usize = 8;

/// Keeps the time of each latent of a rollout within a budget.
#[derive(Debug, Clone)]
pub(super) struct LatentBudget {
    schedules: Vec<Schedule>,
    governor: Governor,
}

/// Chooses the number of passes of latents. A latent's cost is assumed to be proportional to its passes + 1, where the 1 stands for
/// all work that does not depend on their number. This may underestimate fewer passes, which the next measurement corrects, and
/// overestimates more passes, so that these stay within the budget.
#[derive(Debug, Clone)]
struct Governor {
    budget: Duration,
    /// Passes of each schedule, descending.
    passes: Vec<u32>,
    /// Index of the schedule in use.
    at: usize,
    latents: u32,
    spent: Duration,
}

impl Rollout {
    /// Changes the noise levels of all following latents; memory, clocks and seed stay.
    ///
    /// # Errors
    /// As for [`Schedule::table`]. Nothing has changed then.
    pub fn set_schedule(&mut self, schedule: &Schedule) -> Result<()> {
        let table = schedule.table(&self.world().manifest().sampler)?;
        self.planner.set_table(table);
        self.point.schedule = schedule.clone();
        Ok(())
    }

    /// Keeps latents within `per_latent` of wall time each, decoding included, until the budget is changed: they use the first of
    /// `schedules` until that takes too long, then one with fewer passes, and one with more again when there is time. Decisions use
    /// the mean time of three latents at a time, so the same controls may give other pictures the next time. A restored state ends
    /// the budget. An empty list ends it too, and keeps the current schedule.
    ///
    /// Changes are logged; [`StepInfo`](super::StepInfo) has the number of passes of a latent, and
    /// [`operating_point`](Self::operating_point) the schedule of the next one.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for more than eight schedules, for one that does not have fewer passes than
    /// the one before it, and for a time of 0. Nothing has changed then.
    pub fn set_budget(&mut self, per_latent: Duration, schedules: &[Schedule]) -> Result<()> {
        let refuse = |field: &str, why: String| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        let Some(first) = schedules.first() else {
            self.budget = None;
            return Ok(());
        };
        if per_latent.is_zero() {
            return refuse("per_latent", "no latent takes no time".into());
        }
        let passes = passes_of(schedules, &self.world().manifest().sampler, "schedules")?;
        self.set_schedule(first)?;
        self.governed = None;
        self.budget = Some(LatentBudget { schedules: schedules.to_vec(), governor: Governor::new(per_latent, passes) });
        Ok(())
    }

    /// Records the time of a latent, and applies a changed schedule.
    pub(super) fn note_latent(&mut self, took: Duration) {
        let Some(mut budget) = self.budget.take() else { return };
        if let Some((at, mean)) = budget.governor.note(took) {
            let schedule = &budget.schedules[at];
            // Does not fail: the schedule was checked when the budget was set.
            match self.set_schedule(schedule) {
                Ok(()) => log::info!("latents take {mean:?} each: they are made by schedule {schedule} from now on"),
                Err(why) => log::warn!("schedule {schedule} cannot be used: {why}"),
            }
        }
        self.budget = Some(budget);
    }
}

/// The passes of schedules, each of which must have fewer than the one before.
pub(super) fn passes_of(schedules: &[Schedule], sampler: &Sampler, field: &str) -> Result<Vec<u32>> {
    let refuse = |why: String| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
    if schedules.len() > MOST_SCHEDULES {
        return refuse(format!("{} are more than {MOST_SCHEDULES}", schedules.len()));
    }
    let passes = |schedule: &Schedule| Ok(schedule.table(sampler)?.passes() as u32);
    let passes = schedules.iter().map(passes).collect::<Result<Vec<_>>>()?;
    if !passes.windows(2).all(|pair| pair[0] > pair[1]) {
        return refuse(format!("{passes:?} passes: each must have fewer than the one before"));
    }
    Ok(passes)
}

impl Governor {
    fn new(budget: Duration, passes: Vec<u32>) -> Self {
        Self { budget, passes, at: 0, latents: 0, spent: Duration::ZERO }
    }

    /// Records the time of a latent. Returns the index of the new schedule and the mean time of the last latents if the schedule
    /// changes.
    fn note(&mut self, took: Duration) -> Option<(usize, Duration)> {
        self.latents += 1;
        self.spent = self.spent.saturating_add(took);
        if self.latents < LATENTS {
            return None;
        }
        let mean = self.spent / self.latents;
        (self.latents, self.spent) = (0, Duration::ZERO);
        let cost = |at: usize| mean.saturating_mul(self.passes[at] + 1) / (self.passes[self.at] + 1);
        let last = self.passes.len() - 1;
        let at = if mean > self.budget {
            // At least one fewer.
            (self.at + 1..=last).find(|at| cost(*at) <= self.budget).unwrap_or(last)
        } else {
            (0..self.at).find(|at| cost(*at) <= self.budget * 7 / 8).unwrap_or(self.at)
        };
        (std::mem::replace(&mut self.at, at) != at).then_some((at, mean))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Simulates latents on a device that takes `pass` for each pass and `rest` for all other work; returns how often the schedule
    /// changed.
    fn run(governor: &mut Governor, latents: u32, pass: Duration, rest: Duration) -> u32 {
        let took = |governor: &Governor| pass * governor.passes[governor.at] + rest;
        (0..latents).filter(|_| governor.note(took(governor)).is_some()).count() as u32
    }

    #[test]
    fn latents_have_as_many_passes_as_there_is_time_for() {
        for (budget, expected) in [(200, 9), (100, 9), (99, 4), (50, 4), (49, 2), (30, 2), (29, 1), (1, 1)] {
            let mut governor = Governor::new(budget * MS, vec![9, 4, 2, 1]);
            let changes = run(&mut governor, 60, 10 * MS, 10 * MS);
            assert_eq!(
                (governor.passes[governor.at], changes <= 3),
                (expected, true),
                "{budget} ms, {changes} changes"
            );
        }
    }

    #[test]
    fn more_passes_come_back_where_there_is_time_and_nothing_swings() {
        let mut governor = Governor::new(60 * MS, vec![9, 4, 2]);
        run(&mut governor, 30, 30 * MS, 10 * MS);
        assert_eq!(governor.passes[governor.at], 2);
        // The game no longer uses the device.
        assert_eq!(run(&mut governor, 30, 4 * MS, 4 * MS), 1);
        assert_eq!(governor.passes[governor.at], 9);
        // Work that does not depend on the passes dominates: fewer passes help little, and must not make the schedule oscillate.
        assert!(run(&mut governor, 300, 6 * MS, 40 * MS) <= 3);
    }
}
