//! One budget for a rollout and the frames between its anchors: device time for each shown frame, and memory. A governor only chooses
//! settings; the rollout applies them.

mod controller;

use std::sync::Arc;
use std::time::Duration;

use crate::locks::Mutex;

use self::controller::{Controller, Decision, Reason, Setting, Window};
use super::latent_time::LatentTime;
use super::schedule::{Schedule, pass_counts};
use super::world::World;
use crate::runtime::MemoryChanges;
use crate::{Error, ErrorKind, Result};

/// Maximum number of windows of a budget.
const MAX_WINDOWS: usize = 8;
/// Maximum number of frames shown for each anchor.
const MAX_MULTIPLIER: u32 = 64;

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

impl Budget {
    /// Checks all limits but the schedules.
    fn check(&self) -> Result<()> {
        if self.frame.is_none() && self.memory.is_none() {
            return invalid("budget", "neither time nor memory is limited".into());
        }
        if self.frame.is_some_and(|frame| frame.is_zero()) {
            return invalid("budget.frame", "no frame takes no time".into());
        }
        if !(1..=MAX_MULTIPLIER).contains(&self.multiplier) {
            return invalid("budget.multiplier", format!("{} frames to an anchor cannot be shown", self.multiplier));
        }
        Ok(())
    }

    fn fits(&self, world: &World) -> bool {
        self.memory.is_none_or(|limit| world.memory_need().total <= limit)
    }

    /// Checks that at least one of `worlds`, the widest window first, is within the memory limit.
    fn check_memory(&self, worlds: &[Arc<World>]) -> Result<()> {
        let (Some(limit), Some(narrowest)) = (self.memory, worlds.last()) else { return Ok(()) };
        if worlds.iter().any(|world| self.fits(world)) {
            return Ok(());
        }
        let (g, dilation) = (narrowest.global_window(), narrowest.manifest().geometry.global.dilation);
        let remedy = match g > dilation {
            true => format!("Load the bundle at a window below g{g} and give that world too, or allow more memory"),
            false => "Allow more memory, or use a smaller bundle".to_owned(),
        };
        narrowest.memory_need().check_fits(limit).map_err(|error| error.field("worlds").remedy(remedy))
    }
}

/// Chooses from measured device times how many denoise passes latents have, how long their context window is, and how many of the
/// frames between anchors are generated, so that a shown frame stays within the budget. It reduces passes first, then frames, and
/// the window last; it restores them when there is time. [`Rollout::govern`](super::Rollout::govern) makes one.
///
/// Device times divide a latent into passes and all other work, so that fewer passes are not expected to shorten the latter. A window in which a slice
/// exceeds [`WorldOptions::longest_submission`](super::WorldOptions::longest_submission) is
/// not used where another does not.
///
/// Threads: may be used from any thread at any time.
#[derive(Debug)]
pub struct Governor {
    multiplier: u32,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    controller: Controller,
    /// Counts only; the current setting and the last frame time are the controller's.
    statistics: GovernorStatistics,
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
    pub reductions: u64,
    /// How often the setting was raised again.
    pub increases: u64,
    /// How often the window became shorter because the device's memory was short.
    pub short_of_memory: u64,
    /// How often frames took too long with nothing left to reduce.
    pub over_budget: u64,
    /// Denoise passes of a latent.
    pub passes: u32,
    /// Context window, in latents.
    pub window: u32,
    /// Different frames shown for each anchor, the anchor included.
    pub generated: u32,
}

impl Governor {
    fn new(controller: Controller, multiplier: u32) -> Self {
        Self { multiplier, state: Mutex::new(State { controller, statistics: GovernorStatistics::default() }) }
    }

    /// A governor for one window and schedules with these numbers of passes.
    #[cfg(test)]
    pub(crate) fn with_passes(frame: Option<Duration>, multiplier: u32, passes: Vec<u32>) -> Self {
        Self::new(Controller::new(frame, multiplier, vec![Window::new(8, 0, true)], passes), multiplier)
    }

    /// Its statistics.
    pub fn statistics(&self) -> GovernorStatistics {
        let state = self.state.lock();
        let (controller, setting) = (&state.controller, state.controller.setting());
        GovernorStatistics {
            frame: controller.frame_time(),
            over_budget: controller.over_budget,
            passes: controller.passes[setting.passes],
            window: controller.windows[setting.window].latents,
            generated: controller.generated[setting.generated],
            ..state.statistics
        }
    }

    /// Frames shown for each anchor.
    pub fn multiplier(&self) -> u32 {
        self.multiplier
    }

    /// Frames to generate for each anchor.
    pub(crate) fn generated_frames(&self) -> u32 {
        let controller = &self.state.lock().controller;
        controller.generated[controller.setting().generated]
    }

    /// Allows fewer generated frames than frames shown, because a presenter follows [`generated_frames`](Self::generated_frames).
    pub(crate) fn allow_fewer_frames(&self) {
        self.state.lock().controller.allow_fewer_frames();
    }

    /// Records the device time of `frames` more frames.
    pub(crate) fn record_frames(&self, frames: u64, time: Duration) {
        let mut state = self.state.lock();
        state.statistics.frames += frames;
        state.controller.record_frames(frames, time);
    }

    /// Records the time of a latent, and the bytes of the device's memory budget that are left, negative if it is exceeded.
    pub(crate) fn record_latent(&self, time: LatentTime, memory_left: Option<i128>) {
        let mut state = self.state.lock();
        state.statistics.latents += 1;
        let Some(decision) = state.controller.record_latent(time, memory_left) else { return };
        drop(state);
        self.log_decision(decision);
    }

    /// Records that the device's memory budget has changed, and the bytes of it that are left. If it is exceeded, the window becomes
    /// shorter at once, without waiting for the next measurement.
    fn record_memory(&self, memory_left: i128) {
        let decision = self.state.lock().controller.record_memory(memory_left);
        decision.into_iter().for_each(|decision| self.log_decision(decision));
    }

    /// Counts and logs a decision.
    fn log_decision(&self, Decision { reason, frame_time }: Decision) {
        let mut state = self.state.lock();
        let (count, cause) = match reason {
            Reason::TooLong => (&mut state.statistics.reductions, "that is too long"),
            Reason::TimeIsLeft => (&mut state.statistics.increases, "there is time for more"),
            Reason::MemoryIsShort => (&mut state.statistics.short_of_memory, "the device's memory is short"),
        };
        *count += 1;
        drop(state);
        let GovernorStatistics { passes, window, generated, .. } = self.statistics();
        let shown = self.multiplier;
        log::info!(
            "a frame takes {frame_time:?}; {cause}: {passes} passes at g{window}, {generated} of {shown} frames from now on"
        );
    }

    fn setting(&self) -> Setting {
        self.state.lock().controller.setting()
    }
}

/// A governor with the worlds and schedules that its settings select.
pub(super) struct GovernorSettings {
    governor: Arc<Governor>,
    /// The widest window first; no two have the same window.
    worlds: Vec<Arc<World>>,
    schedules: Vec<Schedule>,
    /// Notification of changes of the device's memory budget, where the system supports it.
    memory_changes: Option<MemoryChanges>,
}

impl GovernorSettings {
    /// Checks `budget` and makes a governor for a rollout in `current` with `schedule`, which may move to `others`.
    pub(super) fn new(
        budget: &Budget,
        others: &[Arc<World>],
        current: &Arc<World>,
        schedule: &Schedule,
    ) -> Result<Self> {
        budget.check()?;
        let schedules = match budget.schedules.as_slice() {
            [] => vec![schedule.clone()],
            some => some.to_vec(),
        };
        let passes = pass_counts(&schedules, &current.manifest().sampler, "budget.schedules")?;
        let worlds = by_window(others, current)?;
        budget.check_memory(&worlds)?;
        // A window in which one slice holds the device for longer than the host allows is used only if each does.
        let keeps_limit = worlds.iter().any(|world| budget.fits(world) && world.keeps_longest_submission());
        let window = |world: &Arc<World>| {
            let is_allowed = budget.fits(world) && (world.keeps_longest_submission() || !keeps_limit);
            Window::new(world.global_window(), world.rollout_need(), is_allowed)
        };
        let windows = worlds.iter().map(window).collect();
        let controller = Controller::new(budget.frame, budget.multiplier, windows, passes);
        let governor = Arc::new(Governor::new(controller, budget.multiplier));
        Ok(Self { governor, worlds, schedules, memory_changes: current.device().memory_changes() })
    }

    pub(super) fn governor(&self) -> &Arc<Governor> {
        &self.governor
    }

    /// Tells the governor how much of the device's memory budget is left, if the system has changed the budget since the last call.
    pub(super) fn check_memory(&self, memory_left: impl Fn() -> Option<i128>) {
        if self.memory_changes.as_ref().is_some_and(MemoryChanges::changed)
            && let Some(left) = memory_left()
        {
            self.governor.record_memory(left);
        }
    }

    /// World and schedule of the governor's current setting.
    pub(super) fn current(&self) -> (&Arc<World>, &Schedule) {
        let Setting { window, passes, .. } = self.governor.setting();
        (&self.worlds[window], &self.schedules[passes])
    }

    /// Excludes the world with window `refused` from later settings, because the rollout could not move to it and stays at window
    /// `current`. Returns false if none of the worlds has that, because the host has moved the rollout itself: then nothing can be decided.
    pub(super) fn exclude(&self, refused: u32, current: u32) -> bool {
        let index = |g: u32| self.worlds.iter().position(|world| world.global_window() == g);
        let (Some(refused), Some(current)) = (index(refused), index(current)) else { return false };
        self.governor.state.lock().controller.exclude(refused, current);
        true
    }
}

/// `others` and, unless one of them has its window, `current`: the widest window first. Checks that they are one bundle's, at
/// different windows.
fn by_window(others: &[Arc<World>], current: &Arc<World>) -> Result<Vec<Arc<World>>> {
    let mut worlds = others.to_vec();
    if !worlds.iter().any(|world| world.global_window() == current.global_window()) {
        worlds.push(current.clone());
    }
    worlds.sort_by_key(|world| std::cmp::Reverse(world.global_window()));
    if worlds.len() > MAX_WINDOWS {
        return invalid("worlds", format!("{} are more than {MAX_WINDOWS}", worlds.len()));
    }
    let same = |world: &Arc<World>| world.digest() == current.digest() && world.precision() == current.precision();
    if !worlds.iter().all(same) {
        return invalid("worlds", "one is of another bundle or precision".into());
    }
    if current.joined.is_some() && worlds.iter().any(|world| world.joined.is_none()) {
        return invalid("worlds", "one was loaded without joined passes".into());
    }
    if let Some(two) = worlds.windows(2).find(|two| two[0].global_window() == two[1].global_window()) {
        return invalid("worlds", format!("two have g{}", two[0].global_window()));
    }
    Ok(worlds)
}

fn invalid<T>(field: &str, why: String) -> Result<T> {
    Err(Error::new(ErrorKind::InvalidArgument, why).field(field))
}
