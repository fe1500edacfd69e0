//! One budget for a rollout and the frames between its anchors: device time for each shown frame, and memory.

mod choice;

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use self::choice::{Choice, Decision, Setting, Why, Window};
use super::budget::passes_of;
use super::rollout::Rollout;
use super::schedule::Schedule;
use super::world::World;
use crate::runtime::MemoryChanges;
use crate::{Error, ErrorKind, Result};

/// Maximum number of windows of a budget.
const MOST_WINDOWS: usize = 8;
/// Maximum number of frames shown for each anchor.
const MOST_FRAMES: u32 = 64;

/// Limits of a rollout and its frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Budget {
    /// Device time for each shown frame, anchors' passes included; `None` sets no limit.
    pub frame: Option<Duration>,
    /// Bytes that the world in use and its rollout may need, as in [`World::memory_need`]; `None` sets no limit.
    pub memory: Option<u64>,
    /// Frames shown for each anchor, 1 to 64.
    pub multiplier: u32,
    /// Schedules that latents may use, each with fewer passes than the one before; if empty, only the rollout's own.
    pub schedules: Vec<Schedule>,
}

/// Chooses from measured device times how many denoise passes latents have, how long their context window is, and how many of the
/// frames between anchors are generated, so that a shown frame stays within the budget. It reduces passes first, then frames, and
/// the window last; it restores them when there is time. [`Rollout::govern`] makes one.
///
/// Threads: may be used from any thread at any time.
#[derive(Debug)]
pub struct Governor {
    multiplier: u32,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    choice: Choice,
    figures: GovernorStatistics,
}

/// Statistics and current setting of a governor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GovernorStatistics {
    /// Device time for a shown frame, as measured last.
    pub frame: Duration,
    /// Latents measured.
    pub latents: u64,
    /// Frames measured.
    pub frames: u64,
    /// How often the setting was reduced because frames took too long.
    pub less: u64,
    /// How often the setting was raised again.
    pub more: u64,
    /// How often the window became shorter because the device's memory was short.
    pub short_of_memory: u64,
    /// How often frames took too long with nothing left to reduce.
    pub beyond: u64,
    /// Denoise passes of a latent.
    pub passes: u32,
    /// Context window, in latents.
    pub window: u32,
    /// Frames generated for each anchor.
    pub made: u32,
}

/// A rollout's governor, and the worlds and schedules that it chooses from.
pub(super) struct Governed {
    governor: Arc<Governor>,
    /// The widest window first.
    worlds: Vec<Arc<World>>,
    schedules: Vec<Schedule>,
    /// Notification of changes of the device's memory budget, where the system supports it.
    memory_changes: Option<MemoryChanges>,
}

impl Governor {
    fn new(choice: Choice, multiplier: u32) -> Self {
        Self { multiplier, state: Mutex::new(State { choice, figures: GovernorStatistics::default() }) }
    }

    /// A governor for one window and schedules with these numbers of passes.
    #[cfg(test)]
    pub(crate) fn of_passes(frame: Option<Duration>, multiplier: u32, passes: Vec<u32>) -> Self {
        Self::new(Choice::new(frame, multiplier, vec![Window::new(8, 0, true)], passes), multiplier)
    }

    /// Its statistics.
    pub fn statistics(&self) -> GovernorStatistics {
        let state = self.state.lock();
        let (choice, at) = (&state.choice, state.choice.at());
        GovernorStatistics {
            frame: choice.took(),
            beyond: choice.beyond,
            passes: choice.passes[at.passes],
            window: choice.windows[at.window].latents,
            made: choice.made[at.made],
            ..state.figures
        }
    }

    /// Frames shown for each anchor.
    pub fn multiplier(&self) -> u32 {
        self.multiplier
    }

    /// Frames generated for each anchor.
    pub(crate) fn made(&self) -> u32 {
        let choice = &self.state.lock().choice;
        choice.made[choice.at().made]
    }

    /// Records that a presenter follows [`made`](Self::made), so fewer frames may be generated.
    pub(crate) fn makes_frames(&self) {
        self.state.lock().choice.may_make_fewer();
    }

    /// Records the device time of `frames` more frames.
    pub(crate) fn note_frames(&self, frames: u64, took: Duration) {
        let mut state = self.state.lock();
        state.figures.frames += frames;
        state.choice.note_frames(frames, took);
    }

    /// Records the time of a latent, and how much of the device's memory budget is left.
    pub(crate) fn note_latent(&self, took: Duration, room: Option<i128>) {
        let mut state = self.state.lock();
        state.figures.latents += 1;
        let Some(decision) = state.choice.note_latent(took, room) else { return };
        drop(state);
        self.carry_out(decision);
    }

    /// Records that the device's memory budget has changed, and how much of it is left. If it is exceeded, the window becomes
    /// shorter at once, without waiting for the next measurement.
    pub(crate) fn note_memory(&self, room: i128) {
        let decision = self.state.lock().choice.note_memory(room);
        decision.into_iter().for_each(|decision| self.carry_out(decision));
    }

    /// Counts and logs a decision.
    fn carry_out(&self, Decision { why, took }: Decision) {
        let mut state = self.state.lock();
        let (count, cause) = match why {
            Why::TooLong => (&mut state.figures.less, "that is too long"),
            Why::TimeIsLeft => (&mut state.figures.more, "there is time for more"),
            Why::MemoryIsShort => (&mut state.figures.short_of_memory, "the device's memory is short"),
        };
        *count += 1;
        drop(state);
        let GovernorStatistics { passes, window, made, .. } = self.statistics();
        let of = self.multiplier;
        log::info!("a frame takes {took:?}; {cause}: {passes} passes at g{window}, {made} of {of} frames from now on");
    }

    fn setting(&self) -> Setting {
        self.state.lock().choice.at()
    }
}

impl Rollout {
    /// Keeps this rollout, and the presenters that follow the returned governor, within a budget. Latents start with the first of
    /// the schedules, in the widest of `worlds` that the memory allows. Measured times decide when they get fewer passes or a
    /// narrower window: device times where available, else wall time. `worlds` are further worlds of the same bundle, loaded with
    /// other windows, that the rollout may [`move_to`](Self::move_to) by itself before a latent; if empty, it stays in its own. All
    /// given worlds take memory as long as they are loaded; only the world in use has a ring.
    ///
    /// It loads no world itself: making sessions takes seconds to minutes and needs the weights' memory once more, which no step
    /// may cost, least of all when memory is short. A host loads the windows that it may want beforehand, on a thread of its own.
    /// Without other worlds, only passes and frames are reduced, and [`beyond`](GovernorStatistics::beyond) counts how often that
    /// was not enough.
    ///
    /// The same controls may give other pictures the next time. A restored state, [`set_budget`](Self::set_budget) and
    /// [`ungovern`](Self::ungovern) end the budget and keep the current setting.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for a budget without limits or with a time of 0, a multiplier outside 1 to 64,
    /// more than eight schedules or worlds, schedules that do not decrease in passes, two worlds with one window, and worlds of
    /// another bundle or precision; `OutOfMemory`, with figures, if even the narrowest window needs too much. Nothing has changed
    /// then.
    pub fn govern(&mut self, budget: &Budget, worlds: &[Arc<World>]) -> Result<Arc<Governor>> {
        let refuse = |field: &str, why: String| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        if budget.frame.is_none() && budget.memory.is_none() {
            return refuse("budget", "neither time nor memory is limited".into());
        }
        if budget.frame.is_some_and(|frame| frame.is_zero()) {
            return refuse("budget.frame", "no frame takes no time".into());
        }
        if !(1..=MOST_FRAMES).contains(&budget.multiplier) {
            return refuse("budget.multiplier", format!("{} frames to an anchor cannot be shown", budget.multiplier));
        }
        let schedules = match budget.schedules.as_slice() {
            [] => vec![self.point.schedule.clone()],
            some => some.to_vec(),
        };
        let passes = passes_of(&schedules, &self.world().manifest().sampler, "budget.schedules")?;
        let mut all = worlds.to_vec();
        if !all.iter().any(|world| world.global_window() == self.world().global_window()) {
            all.push(self.world().clone());
        }
        all.sort_by_key(|world| std::cmp::Reverse(world.global_window()));
        if all.len() > MOST_WINDOWS {
            return refuse("worlds", format!("{} are more than {MOST_WINDOWS}", all.len()));
        }
        let same = |world: &Arc<World>| {
            world.digest() == self.world().digest() && world.precision() == self.world().precision()
        };
        if !all.iter().all(same) {
            return refuse("worlds", "one is of another bundle or precision".into());
        }
        if let Some(two) = all.windows(2).find(|two| two[0].global_window() == two[1].global_window()) {
            return refuse("worlds", format!("two have g{}", two[0].global_window()));
        }
        let fits = |world: &Arc<World>| budget.memory.is_none_or(|limit| world.memory_need().total <= limit);
        if let (Some(limit), Some(narrowest), false) = (budget.memory, all.last(), all.iter().any(fits)) {
            let narrower = |e: Error| {
                let (g, least) = (narrowest.global_window(), narrowest.manifest().geometry.global.dilation);
                e.field("worlds").remedy(match g > least {
                    true => {
                        format!("Load the bundle at a window below g{g} and give that world too, or allow more memory")
                    }
                    false => "Allow more memory, or use a smaller bundle".to_owned(),
                })
            };
            narrowest.memory_need().check_fits(limit).map_err(narrower)?;
        }
        let window = |world: &Arc<World>| Window::new(world.global_window(), world.memory_need().ring, fits(world));
        let windows = all.iter().map(window).collect();
        let choice = Choice::new(budget.frame, budget.multiplier, windows, passes);
        let governor = Arc::new(Governor::new(choice, budget.multiplier));
        self.budget = None;
        let memory_changes = self.world().device().memory_changes();
        self.governed = Some(Governed { governor: governor.clone(), worlds: all, schedules, memory_changes });
        Ok(governor)
    }

    /// Ends the budget that [`govern`](Self::govern) set. Presenters that followed the governor generate all frames again.
    pub fn ungovern(&mut self) {
        self.governed = None;
    }

    /// Its governor; `None` without a budget.
    pub fn governor(&self) -> Option<&Arc<Governor>> {
        self.governed.as_ref().map(|governed| &governed.governor)
    }

    /// Applies its governor's decision. [`step`](Self::step) does this too; a host calls it to choose when a move to another
    /// window, which takes a while, is made. A move that fails is logged and not tried again.
    pub fn apply_decision(&mut self) {
        let Some(governed) = self.governed.take() else { return };
        if governed.memory_changes.as_ref().is_some_and(MemoryChanges::changed)
            && let Some(room) = self.memory_left()
        {
            governed.governor.note_memory(room);
        }
        let Setting { window, passes, .. } = governed.governor.setting();
        let (world, schedule) = (governed.worlds[window].clone(), governed.schedules[passes].clone());
        // `move_to` moves it to the new rollout.
        self.governed = Some(governed);
        if world.global_window() != self.point.global_window
            && let Err(why) = self.move_to(&world)
        {
            log::warn!("g{} cannot be had: {why}", world.global_window());
            if let Some(governed) = &self.governed {
                let same = |world: &Arc<World>| world.global_window() == self.point.global_window;
                let here = governed.worlds.iter().position(same).unwrap_or(window);
                governed.governor.state.lock().choice.refuse(window, here);
            }
        }
        if schedule != self.point.schedule
            && let Err(why) = self.set_schedule(&schedule)
        {
            // Does not fail: the schedule was checked when the budget was set.
            log::warn!("schedule {schedule} cannot be used: {why}");
        }
    }

    /// Device time so far; `None` if the device does not measure it.
    pub(super) fn spent_on_device(&mut self) -> Option<Duration> {
        #[cfg(windows)]
        return self
            .device_times()
            .map(|times| times.encode.total + times.passes.total + times.decode.total + times.commit.total)
            .filter(|total| !total.is_zero());
        #[cfg(not(windows))]
        None
    }

    /// Reports a latent to its governor. `start` is the time at which it was begun, `before` the device time spent until then.
    pub(super) fn report_to_governor(&mut self, start: Instant, before: Option<Duration>) {
        let Some(governor) = self.governor().cloned() else { return };
        let spent = self.spent_on_device().zip(before).map(|(now, before)| now.saturating_sub(before));
        let took = spent.unwrap_or_else(|| start.elapsed());
        governor.note_latent(took, self.memory_left());
    }

    /// Bytes of the device's memory budget that are left, negative if it is exceeded; `None` if unknown.
    fn memory_left(&self) -> Option<i128> {
        let memory = self.world().device().memory()?;
        Some(i128::from(memory.granted) - i128::from(memory.used))
    }
}
