//! Sets a rollout's limits, measures its latents for them, and applies what a budget or a governor chooses.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Rollout;
use super::limits::{LatentStart, Limits};
use crate::Result;
use crate::world::governor::{Budget, Governor, GovernorSettings};
use crate::world::latent_budget::LatentBudget;
use crate::world::latent_time::LatentTime;
use crate::world::schedule::Schedule;
use crate::world::statistics::StepInfo;
use crate::world::world::World;

impl Rollout {
    /// Changes the noise levels of all following latents; memory, clocks and seed stay.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `OutOfMemory` and `Device` if what passes need of noise levels that no preset has cannot be computed. Nothing has
    /// changed then.
    pub fn set_schedule(&mut self, schedule: &Schedule) -> Result<()> {
        let table = schedule.table(&self.world.manifest().sampler)?;
        self.world.prepare_levels(&table)?;
        self.device.prepare_levels(&table)?;
        self.planner.set_table(table);
        self.point.schedule = schedule.clone();
        Ok(())
    }

    /// Keeps latents within `per_latent` of wall time each, decoding included, until the budget is changed: they use the first of
    /// `schedules` until that takes too long, then one with fewer passes, and one with more again when there is time. Decisions use
    /// the mean time of three latents at a time, so the same controls may give other pictures the next time. A restored state ends
    /// the budget. An empty list ends it too, and keeps the current schedule.
    ///
    /// Changes are logged; [`StepInfo`](crate::world::StepInfo) has the number of passes of a latent, and
    /// [`operating_point`](Self::operating_point) the schedule of the next one.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for more than eight schedules, for one that does not have fewer passes than
    /// the one before it, and for a time of 0. Nothing has changed then.
    pub fn set_budget(&mut self, per_latent: Duration, schedules: &[Schedule]) -> Result<()> {
        let Some(first) = schedules.first() else {
            if matches!(self.limits, Limits::Latents(_)) {
                self.limits = Limits::None;
            }
            return Ok(());
        };
        let budget = LatentBudget::new(per_latent, schedules, &self.world.manifest().sampler)?;
        prepare_levels(&self.world, schedules)?;
        self.set_schedule(first)?;
        self.limits = Limits::Latents(budget);
        Ok(())
    }

    /// Keeps this rollout, and the presenters that follow the returned governor, within a budget. Latents start with the first of
    /// the schedules, in the widest of `worlds` that the memory allows and whose slices keep to
    /// [`longest_submission`](crate::world::WorldOptions::longest_submission), if any does. Measured times decide when they get fewer passes or a
    /// narrower window: device times where available, else wall time. `worlds` are further worlds of the same bundle, loaded with
    /// other windows, that the rollout may [`move_to`](Self::move_to) by itself before a latent; if empty, it stays in its own. All
    /// given worlds take memory as long as they are loaded; only the world in use has a ring.
    ///
    /// It loads no world itself: making sessions takes seconds to minutes and needs the weights' memory once more, which no step
    /// may cost, least of all when memory is short. A host loads the windows that it may want beforehand, on a thread of its own.
    /// Without other worlds, only passes and frames are reduced, and
    /// [`over_budget`](crate::world::GovernorStatistics::over_budget) counts how often that was not enough.
    ///
    /// The same controls may give other pictures the next time. A restored state, [`set_budget`](Self::set_budget) and
    /// [`ungovern`](Self::ungovern) end the budget and keep the current setting.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for a budget without limits or with a time of 0, a multiplier outside 1 to 64,
    /// more than eight schedules or worlds, schedules that do not decrease in passes, two worlds with one window, and worlds of
    /// another bundle or precision, or without joined passes if its own has them; `OutOfMemory`, with figures, if even the narrowest window needs too much. Nothing has changed
    /// then.
    pub fn govern(&mut self, budget: &Budget, worlds: &[Arc<World>]) -> Result<Arc<Governor>> {
        let settings = GovernorSettings::new(budget, worlds, &self.world, &self.point.schedule)?;
        let schedules = [std::slice::from_ref(&self.point.schedule), &budget.schedules].concat();
        worlds.iter().chain([&self.world]).try_for_each(|world| prepare_levels(world, &schedules))?;
        let governor = settings.governor().clone();
        self.limits = Limits::Frames(settings);
        Ok(governor)
    }

    /// Ends the budget that [`govern`](Self::govern) set. Presenters that followed the governor generate all frames again.
    pub fn ungovern(&mut self) {
        if matches!(self.limits, Limits::Frames(_)) {
            self.limits = Limits::None;
        }
    }

    /// Its governor; `None` if [`govern`](Self::govern) has set none.
    pub fn governor(&self) -> Option<&Arc<Governor>> {
        self.limits.governor()
    }

    /// Applies its governor's decision. [`step`](Self::step) does this too; a host calls it to choose when a move to another
    /// window, which takes a while, is made. A move that fails is logged and not tried again.
    pub fn apply_decision(&mut self) {
        let Limits::Frames(settings) = &self.limits else { return };
        settings.check_memory(|| memory_left(&self.world));
        let (world, schedule) = settings.current();
        let (world, schedule) = (world.clone(), schedule.clone());
        if world.global_window() != self.point.global_window
            && let Err(why) = self.move_to(&world)
        {
            log::warn!("g{} cannot be had: {why}", world.global_window());
            if let Limits::Frames(settings) = &self.limits
                && !settings.exclude(world.global_window(), self.point.global_window)
            {
                log::warn!("the budget ends: none of its worlds has g{}", self.point.global_window);
                self.limits = Limits::None;
            }
        }
        if schedule != self.point.schedule
            && let Err(why) = self.set_schedule(&schedule)
        {
            // The schedule was checked when the budget was set, so that only the device can have failed.
            log::warn!("schedule {schedule} cannot be used: {why}");
        }
    }

    /// Reads the clocks before a latent.
    pub(super) fn start_latent(&mut self) -> LatentStart {
        let device = match self.limits {
            Limits::Frames(_) => self.times.total_device_time(&mut *self.device.context, &self.world),
            Limits::None | Limits::Latents(_) => None,
        };
        LatentStart { wall: Instant::now(), device }
    }

    /// Reports the time of a finished latent to the limits. A latent budget's new schedule is applied at once, a governor's decision
    /// before the next step.
    pub(super) fn finish_latent(&mut self, start: &LatentStart, step: &StepInfo) {
        let wall = LatentTime::of_step(start.wall.elapsed(), &step.stages, self.world.device().is_gpu());
        match &mut self.limits {
            Limits::None => {}
            Limits::Latents(budget) => {
                let Some((schedule, mean)) = budget.record_latent(wall) else { return };
                let schedule = schedule.clone();
                // The schedule was checked when the budget was set, so that only the device can fail.
                match self.set_schedule(&schedule) {
                    Ok(()) => {
                        log::info!("latents take {mean:?} each: they are made by schedule {schedule} from now on")
                    }
                    Err(why) => log::warn!("schedule {schedule} cannot be used: {why}"),
                }
            }
            Limits::Frames(settings) => {
                let now = self.times.total_device_time(&mut *self.device.context, &self.world);
                let passes = step.stages.denoise.count as u32;
                let device = now.zip(start.device).map(|(now, before)| now.since(before, passes));
                settings.governor().record_latent(device.unwrap_or(wall), memory_left(&self.world));
            }
        }
    }
}

/// Computes what passes of `world` need of the noise levels of all of `schedules`, so that no step has to when the schedule changes.
fn prepare_levels(world: &World, schedules: &[Schedule]) -> Result<()> {
    let tables = schedules.iter().map(|schedule| schedule.table(&world.manifest().sampler));
    tables.into_iter().try_for_each(|table| world.prepare_levels(&table?))
}

/// Bytes of the device's memory budget that are left, negative if it is exceeded; `None` if unknown.
fn memory_left(world: &World) -> Option<i128> {
    let memory = world.device().memory()?;
    Some(i128::from(memory.granted) - i128::from(memory.used))
}
