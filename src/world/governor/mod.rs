//! One budget for a rollout and the frames between its anchors: of the device's time for each frame that is shown, and of memory.

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

/// Windows of a budget, at most.
const MOST_WINDOWS: usize = 8;
/// Frames shown for an anchor, at most.
const MOST_FRAMES: u32 = 64;

/// What a rollout and its frames may take.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Budget {
    /// Time of the device for each frame that is shown, anchors' passes and all; none: as long as it takes.
    pub frame: Option<Duration>,
    /// Bytes that the world in use and its rollout may need, as [`World::memory_need`] has it; none: as much as there is.
    pub memory: Option<u64>,
    /// Frames that are shown for each anchor, 1 to 64.
    pub multiplier: u32,
    /// Schedules that latents may be made by, each with fewer passes than the one before; none: the rollout's own alone.
    pub schedules: Vec<Schedule>,
}

/// Decides, from what the device has taken so far, how many passes latents have, how far back they see, and how many of the frames between
/// anchors are made, so that a frame that is shown takes no more than it may. Passes are given up first, then frames, the window last; what was
/// given up comes back where there is time. [`Rollout::govern`] makes one.
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

/// What a governor has done, and what it has settled on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GovernorStatistics {
    /// Time of the device for a frame that was shown, as measured last.
    pub frame: Duration,
    /// Latents measured.
    pub latents: u64,
    /// Frames measured.
    pub frames: u64,
    /// How often something was given up as frames took too long.
    pub less: u64,
    /// How often something came back.
    pub more: u64,
    /// How often the window became narrower as the device's memory was short.
    pub short_of_memory: u64,
    /// How often frames took too long although nothing was left to give up.
    pub beyond: u64,
    /// Passes that latents have.
    pub passes: u32,
    /// The window that they see, in latents.
    pub window: u32,
    /// Frames to an anchor that are made.
    pub made: u32,
}

/// What a rollout is told by a governor, and has to do it with.
pub(super) struct Governed {
    governor: Arc<Governor>,
    /// Widest window first.
    worlds: Vec<Arc<World>>,
    schedules: Vec<Schedule>,
    /// The device's memory budget, where the system tells of its changes.
    memory_changes: Option<MemoryChanges>,
}

impl Governor {
    fn new(choice: Choice, multiplier: u32) -> Self {
        Self { multiplier, state: Mutex::new(State { choice, figures: GovernorStatistics::default() }) }
    }

    /// One of a rollout that has one window and schedules of so many passes.
    #[cfg(test)]
    pub(crate) fn of_passes(frame: Option<Duration>, multiplier: u32, passes: Vec<u32>) -> Self {
        Self::new(Choice::new(frame, multiplier, vec![Window::new(8, 0, true)], passes), multiplier)
    }

    /// What it has done.
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

    /// Frames that are shown for each anchor.
    pub fn multiplier(&self) -> u32 {
        self.multiplier
    }

    /// Frames to an anchor that are made.
    pub(crate) fn made(&self) -> u32 {
        let choice = &self.state.lock().choice;
        choice.made[choice.at().made]
    }

    /// Somebody makes as few frames as it says.
    pub(crate) fn makes_frames(&self) {
        self.state.lock().choice.may_make_fewer();
    }

    /// Takes note of what the device has spent on so many frames more.
    pub(crate) fn note_frames(&self, frames: u64, took: Duration) {
        let mut state = self.state.lock();
        state.figures.frames += frames;
        state.choice.note_frames(frames, took);
    }

    /// Takes note of what a latent has taken, and of what is left of the device's memory.
    pub(crate) fn note_latent(&self, took: Duration, room: Option<i128>) {
        let mut state = self.state.lock();
        state.figures.latents += 1;
        let Some(decision) = state.choice.note_latent(took, room) else { return };
        drop(state);
        self.carry_out(decision);
    }

    /// Records that the device's memory budget has changed, with what is left of it: where that is too little, the window becomes narrower at
    /// once, and not after the next latents.
    pub(crate) fn note_memory(&self, room: i128) {
        let decision = self.state.lock().choice.note_memory(room);
        decision.into_iter().for_each(|decision| self.carry_out(decision));
    }

    /// Counts and logs what was decided.
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
    /// Holds this rollout, and the presenters that follow the governor it gives, to a budget, for as long as a host likes. Latents are made by
    /// the first of the schedules, in the widest of `worlds` that the memory allows, and with fewer passes or in a narrower one as measured
    /// times ask for it: those of the device where it says, else wall time. `worlds` are further ones of the same bundle, loaded with other
    /// windows, that it may [`move_to`](Self::move_to) by itself, before a latent; none: its own alone. All that are given take memory as long
    /// as they are loaded, and the ring only of the one in use.
    ///
    /// It loads no world itself: making sessions takes seconds to minutes and the weights' memory once more, which no step may, least of all
    /// when memory is short. A host loads the windows that it may want beforehand, on a thread of its own; where there is no other, passes
    /// and frames are all that is given up, and [`beyond`](GovernorStatistics::beyond) counts what that does not help.
    ///
    /// The same controls may give other pictures the next time. A restored state, [`set_budget`](Self::set_budget) and
    /// [`ungovern`](Self::ungovern) end it, and leave things as they are.
    ///
    /// # Errors
    /// As for [`Schedule::table`]; `InvalidArgument` for a budget of nothing or of no time, a multiplier outside 1 to 64, schedules or worlds
    /// that are more than eight or of which one does not follow from the one before, and worlds of another bundle or precision;
    /// `OutOfMemory`, with figures, where even the narrowest window needs too much. Nothing has changed then.
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

    /// Ends what [`govern`](Self::govern) began. Presenters that followed make all frames again.
    pub fn ungovern(&mut self) {
        self.governed = None;
    }

    /// What it is governed by.
    pub fn governor(&self) -> Option<&Arc<Governor>> {
        self.governed.as_ref().map(|governed| &governed.governor)
    }

    /// Does what its governor has decided: [`step`](Self::step) does it too, so this is for hosts that want to choose the moment at which a
    /// move to another window, which takes a while, is made. One that cannot be made is logged and not tried again.
    pub fn obey(&mut self) {
        let Some(governed) = self.governed.take() else { return };
        if governed.memory_changes.as_ref().is_some_and(MemoryChanges::come)
            && let Some(room) = self.memory_left()
        {
            governed.governor.note_memory(room);
        }
        let Setting { window, passes, .. } = governed.governor.setting();
        let (world, schedule) = (governed.worlds[window].clone(), governed.schedules[passes].clone());
        // The move takes it along.
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
            // It was checked when the budget was given.
            log::warn!("schedule {schedule} cannot be used: {why}");
        }
    }

    /// Time on the device so far; none where it does not say.
    pub(super) fn spent_on_device(&mut self) -> Option<Duration> {
        #[cfg(windows)]
        return self
            .device_times()
            .map(|times| times.encode.total + times.passes.total + times.decode.total + times.commit.total)
            .filter(|total| !total.is_zero());
        #[cfg(not(windows))]
        None
    }

    /// Tells its governor of a latent that was begun at `start`, when the device had spent `before`.
    pub(super) fn tell_governor(&mut self, start: Instant, before: Option<Duration>) {
        let Some(governor) = self.governor().cloned() else { return };
        let spent = self.spent_on_device().zip(before).map(|(now, before)| now.saturating_sub(before));
        let took = spent.unwrap_or_else(|| start.elapsed());
        governor.note_latent(took, self.memory_left());
    }

    /// Bytes of the device's memory budget that are left, less than none where more is used than is granted; none where nobody says.
    fn memory_left(&self) -> Option<i128> {
        let memory = self.world().device().memory()?;
        Some(i128::from(memory.granted) - i128::from(memory.used))
    }
}
