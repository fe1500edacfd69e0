//! Latents held to a budget of time.

use std::time::Duration;

use super::{Rollout, Schedule};
use crate::bundle::Sampler;
use crate::{Error, ErrorKind, Result};

/// Latents that are looked at before anything is changed.
const LATENTS: u32 = 3;
/// Schedules of a budget, at most.
const MOST_SCHEDULES: usize = 8;

/// Holds a rollout's latents to so much time each.
#[derive(Debug, Clone)]
pub(super) struct LatentBudget {
    schedules: Vec<Schedule>,
    governor: Governor,
}

/// Decides with how many passes latents are made. A latent is taken to cost as much as its passes, and one more for all that does not
/// depend on their number: too little for fewer, so that the next latents tell, and too much for more, so that these stay within the budget.
#[derive(Debug, Clone)]
struct Governor {
    budget: Duration,
    /// Of each schedule, descending.
    passes: Vec<u32>,
    /// Which one is in use.
    at: usize,
    latents: u32,
    spent: Duration,
}

impl Rollout {
    /// Changes the noise levels of the latents that follow; memory, clocks and seed stay.
    ///
    /// # Errors
    /// As for [`Schedule::table`]. Nothing has changed then.
    pub fn set_schedule(&mut self, schedule: &Schedule) -> Result<()> {
        let table = schedule.table(&self.world().manifest().sampler)?;
        self.planner.set_table(table);
        self.point.schedule = schedule.clone();
        Ok(())
    }

    /// Holds latents to `per_latent` of wall time each, decoding and all, for as long as a host likes: they are made by the first of
    /// `schedules` until that takes too long, then by one with fewer passes, and by one with more again where there is time. It goes by the
    /// times of the latents before, three at a time, so that the same controls may give other pictures the next time. A restored state
    /// ends it. An empty list ends it too, and leaves the schedule as it is.
    ///
    /// What it does is logged; [`StepInfo`](super::StepInfo) says with how many passes a latent was made, and
    /// [`operating_point`](Self::operating_point) has the schedule of the next one.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for more than eight schedules, for one that has not fewer passes than the one before
    /// it, and for a time of 0. Nothing has changed then.
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

    /// Takes note of how long a latent has taken.
    pub(super) fn note_latent(&mut self, took: Duration) {
        let Some(mut budget) = self.budget.take() else { return };
        if let Some((at, mean)) = budget.governor.note(took) {
            let schedule = &budget.schedules[at];
            // It was checked when the budget was set.
            match self.set_schedule(schedule) {
                Ok(()) => log::info!("latents take {mean:?} each: they are made by schedule {schedule} from now on"),
                Err(why) => log::warn!("schedule {schedule} cannot be used: {why}"),
            }
        }
        self.budget = Some(budget);
    }
}

/// Passes of schedules of which each has fewer than the one before.
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

    /// Takes note of a latent; the schedule that is used from now on and how long latents took, where it is another.
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

    /// So many latents on a device that takes `pass` for each pass and `rest` for all else; how often the schedule changed.
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
        // The game leaves the device alone.
        assert_eq!(run(&mut governor, 30, 4 * MS, 4 * MS), 1);
        assert_eq!(governor.passes[governor.at], 9);
        // What does not depend on the passes is large: fewer help little, and it is no reason to go back and forth.
        assert!(run(&mut governor, 300, 6 * MS, 40 * MS) <= 3);
    }
}
