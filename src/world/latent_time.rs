//! Time of latents, divided into what depends on the number of passes and what does not, to predict that of latents with more or fewer of them.

use std::time::Duration;

use super::statistics::Stages;

/// Measured time of one or more latents.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LatentTime {
    pub(crate) total: Duration,
    /// The part of `total` that transformer passes took.
    pub(crate) passes: Duration,
    /// Number of these passes: denoise passes, and cache passes where they are passes of their own.
    pub(crate) count: u64,
}

impl LatentTime {
    /// The time of a latent of `passes` denoise passes of which nothing else is known: all other work, the cache pass included, is taken for one
    /// pass more.
    pub(crate) fn undivided(total: Duration, passes: u32) -> Self {
        Self { total, passes: total, count: u64::from(passes) + 1 }
    }

    /// The wall time of a step, with the times of its stages. On a graphics device passes are only submitted in the time of their stages, so it cannot
    /// be divided.
    pub(crate) fn of_step(total: Duration, stages: &Stages, is_gpu: bool) -> Self {
        let Stages { denoise, cache, .. } = stages;
        match is_gpu {
            true => Self::undivided(total, denoise.count as u32),
            false => Self { total, passes: denoise.time + cache.time, count: denoise.count + cache.count },
        }
    }

    /// The time between two measurements since the same start; `undivided` for one in which no pass was counted.
    pub(crate) fn since(self, before: Self, passes: u32) -> Self {
        let total = self.total.saturating_sub(before.total);
        match self.count.saturating_sub(before.count) {
            0 => Self::undivided(total, passes),
            count => Self { total, passes: self.passes.saturating_sub(before.passes).min(total), count },
        }
    }

    pub(crate) fn add(&mut self, other: Self) {
        self.total = self.total.saturating_add(other.total);
        self.passes = self.passes.saturating_add(other.passes);
        self.count = self.count.saturating_add(other.count);
    }
}

/// Mean cost of a latent.
///
/// ```text
/// time of a latent of n denoise passes = (n + other_passes) * pass + rest
/// ```
///
/// The costs are measured where they arise. So they are those of the weights' precision: weights in 4 bits shorten a pass, and not the decoder. And
/// they contain what it costs to run a pass in slices.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LatentCost {
    /// Seconds of a pass.
    pub(crate) pass: f64,
    /// Passes of a latent that are no denoise passes.
    other_passes: f64,
    /// Seconds of all other work.
    rest: f64,
}

impl LatentCost {
    /// The mean over `latents` latents of `passes` denoise passes each, which took `time` together.
    pub(crate) fn of(time: LatentTime, latents: u32, passes: u32) -> Self {
        let (latents, count) = (f64::from(latents.max(1)), time.count.max(1) as f64);
        Self {
            pass: time.passes.as_secs_f64() / count,
            // Negative if the device had not measured all denoise passes yet.
            other_passes: count / latents - f64::from(passes),
            rest: time.total.saturating_sub(time.passes).as_secs_f64() / latents,
        }
    }

    /// Seconds of a latent of `passes` denoise passes, each of which takes `ratio` times as long as those measured.
    pub(crate) fn seconds(&self, passes: u32, ratio: f64) -> f64 {
        (f64::from(passes) + self.other_passes).max(0.0) * self.pass * ratio + self.rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::statistics::StageTotals;

    const MS: Duration = Duration::from_millis(1);

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn other_work_does_not_become_shorter_with_fewer_passes() {
        // Three latents of four denoise passes and a cache pass of 2 ms each, and 40 ms for the decoder.
        let mut time = LatentTime::default();
        (0..3).for_each(|_| time.add(LatentTime { total: 50 * MS, passes: 10 * MS, count: 5 }));
        let cost = LatentCost::of(time, 3, 4);
        assert!(near(cost.seconds(4, 1.0), 0.050) && near(cost.seconds(1, 1.0), 0.044), "{cost:?}");
        assert!(near(cost.seconds(4, 0.5), 0.045), "a shorter window makes passes shorter only");
        // Without a cache pass of its own.
        let fused = LatentCost::of(LatentTime { total: 50 * MS, passes: 8 * MS, count: 4 }, 1, 4);
        assert!(near(fused.seconds(1, 1.0), 0.044), "{fused:?}");
    }

    #[test]
    fn a_time_that_is_not_divided_is_proportional_to_the_passes_and_one_more() {
        let cost = LatentCost::of(LatentTime::undivided(50 * MS, 4), 1, 4);
        assert!(near(cost.seconds(4, 1.0), 0.050) && near(cost.seconds(1, 1.0), 0.020), "{cost:?}");
        let start = LatentTime { total: 7 * MS, passes: 3 * MS, count: 9 };
        let later = LatentTime { total: 57 * MS, ..start };
        assert_eq!(later.since(start, 4), LatentTime::undivided(50 * MS, 4), "no pass was counted");
        let later = LatentTime { total: 57 * MS, passes: 13 * MS, count: 14 };
        assert_eq!(later.since(start, 4), LatentTime { total: 50 * MS, passes: 10 * MS, count: 5 });
    }

    #[test]
    fn a_step_is_divided_where_its_passes_run_in_their_stages() {
        let stage = |count, time| StageTotals { count, time: time * MS };
        let stages = Stages {
            denoise: stage(4, 8),
            cache: stage(1, 2),
            commit: stage(1, 3),
            decode: stage(1, 30),
            ..Stages::default()
        };
        let of = |is_gpu| LatentTime::of_step(50 * MS, &stages, is_gpu);
        assert_eq!(of(false), LatentTime { total: 50 * MS, passes: 10 * MS, count: 5 });
        assert_eq!(of(true), LatentTime::undivided(50 * MS, 4));
    }

    #[test]
    fn nothing_measured_costs_nothing() {
        assert_eq!(LatentCost::of(LatentTime::default(), 0, 4).seconds(4, 1.0), 0.0);
    }
}
