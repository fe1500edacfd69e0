//! The control loop of a governor: chooses the next setting of a rollout and its frames from measured times. It reads no clock.

use std::time::Duration;

use crate::world::latent_time::{LatentCost, LatentTime};

/// Latents measured before each decision.
const LATENTS: u32 = 3;
/// Latents and frames in flight when a setting changes; their times belong to the old setting and are ignored.
const STALE_LATENTS: u32 = 1;
const STALE_FRAMES: u64 = 3;
/// Maximum number of consecutive measurements within the budget that are required before a larger setting is tried.
const MAX_PATIENCE: u32 = 64;

/// One setting, as indices in lists whose first entry is the best: a setting that is greater costs less.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Setting {
    pub(super) window: usize,
    /// Index of the number of generated frames.
    pub(super) generated: usize,
    pub(super) passes: usize,
}

/// A context window that a rollout may have.
#[derive(Debug, Clone)]
pub(super) struct Window {
    pub(super) latents: u32,
    /// Bytes of a rollout in it.
    pub(super) rollout_bytes: u64,
    /// Whether it may be used.
    pub(super) allowed: bool,
    /// Duration of a pass, relative to a pass of the first window that was measured; `None` before it is measured.
    relative_pass: Option<f64>,
}

impl Window {
    pub(super) fn new(latents: u32, rollout_bytes: u64, allowed: bool) -> Self {
        Self { latents, rollout_bytes, allowed, relative_pass: None }
    }
}

/// Why a setting replaces another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// Frames took too long.
    TooLong,
    /// There is time for more.
    TimeIsLeft,
    /// The device's memory is short.
    MemoryIsShort,
}

/// A decision for another setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decision {
    pub(super) reason: Reason,
    /// Time of a shown frame under the setting that is replaced.
    pub(super) frame_time: Duration,
}

/// Keeps the device time of each shown frame within a budget.
///
/// ```text
/// frame time          (a latent's time + device time of the frames between it and the next) / frames shown for the latent
/// settings            each window, widest first; of each, generated frames, most first; of each, passes, most first
/// above the budget    the first smaller setting whose expected time is within the budget; if there is none, the next narrower window
///                     with the fewest frames and passes, so that it is measured
/// below the budget    the first setting with an expected time of at most 7/8 of the budget, after a number of measurements within
///                     the budget that doubles whenever a larger setting proved too slow
/// a latent's time     its passes, each as long as measured in its window, and all other work as measured
/// ```
#[derive(Debug, Clone)]
pub(super) struct Controller {
    budget: Option<Duration>,
    multiplier: u32,
    pub(super) windows: Vec<Window>,
    /// Numbers of frames that may be generated for an anchor, descending.
    pub(super) generated: Vec<u32>,
    /// Passes of each schedule, descending.
    pub(super) passes: Vec<u32>,
    setting: Setting,
    /// Latents and frames to ignore before the next measurement.
    stale_latents: u32,
    stale_frames: u64,
    /// Sums of the measurement in progress.
    latents: u32,
    latents_time: LatentTime,
    frames: u64,
    frames_time: Duration,
    /// Duration in seconds that a pass of the first measured window would have had when the current window was entered: the
    /// reference for the current window's `relative_pass`. Set between the change of window and the next measurement.
    reference_pass: Option<f64>,
    /// The last measurement: of a latent, and of the work on frames for each shown frame.
    latent: LatentCost,
    generation_time: Duration,
    /// Consecutive measurements within the budget, and how many of them are required before a larger setting is tried.
    within_budget: u32,
    patience: u32,
    /// Whether a larger setting was chosen last; if frames then exceed the budget, `patience` doubles.
    has_grown: bool,
    /// How often the smallest setting took too long.
    pub(super) over_budget: u64,
}

impl Controller {
    /// Starts with the first allowed window; at least one is allowed.
    pub(super) fn new(budget: Option<Duration>, multiplier: u32, windows: Vec<Window>, passes: Vec<u32>) -> Self {
        let window = windows.iter().position(|window| window.allowed).unwrap_or(windows.len().saturating_sub(1));
        Self {
            budget,
            multiplier,
            windows,
            generated: vec![multiplier],
            passes,
            setting: Setting { window, generated: 0, passes: 0 },
            stale_latents: 0,
            stale_frames: 0,
            latents: 0,
            latents_time: LatentTime::default(),
            frames: 0,
            frames_time: Duration::ZERO,
            reference_pass: None,
            latent: LatentCost::default(),
            generation_time: Duration::ZERO,
            within_budget: 0,
            patience: 1,
            has_grown: false,
            over_budget: 0,
        }
    }

    pub(super) fn setting(&self) -> Setting {
        self.setting
    }

    /// Allows fewer generated frames: all divisors of the multiplier.
    pub(super) fn allow_fewer_frames(&mut self) {
        self.generated =
            (1..=self.multiplier).rev().filter(|generated| self.multiplier.is_multiple_of(*generated)).collect();
    }

    /// Excludes a window, and sets the one in use to `current`, which is allowed from now on.
    pub(super) fn exclude(&mut self, window: usize, current: usize) {
        self.windows[window].allowed = false;
        self.windows[current].allowed = true;
        self.setting.window = current;
        self.restart_measurement();
    }

    /// Records the device time of `frames` more frames.
    pub(super) fn record_frames(&mut self, frames: u64, time: Duration) {
        if self.stale_frames > 0 {
            self.stale_frames = self.stale_frames.saturating_sub(frames);
            return;
        }
        self.frames += frames;
        self.frames_time = self.frames_time.saturating_add(time);
    }

    /// Records a latent's time and the bytes of the device's memory budget that are left, negative if it is exceeded. Returns a
    /// decision if the setting changes.
    pub(super) fn record_latent(&mut self, time: LatentTime, memory_left: Option<i128>) -> Option<Decision> {
        if self.stale_latents > 0 {
            self.stale_latents -= 1;
            return None;
        }
        self.latents += 1;
        self.latents_time.add(time);
        if self.latents < LATENTS {
            return None;
        }
        self.latent = LatentCost::of(self.latents_time, self.latents, self.passes[self.setting.passes]);
        self.generation_time = self.frames_time / u32::try_from(self.frames.max(1)).unwrap_or(u32::MAX);
        self.update_window();
        let frame_time = self.frame_time();
        let decision = self.decide(frame_time, memory_left);
        (self.latents, self.latents_time) = (0, LatentTime::default());
        (self.frames, self.frames_time) = (0, Duration::ZERO);
        let (setting, reason) = decision?;
        if setting.window != self.setting.window {
            self.set_reference_pass();
        }
        self.setting = setting;
        self.restart_measurement();
        Some(Decision { reason, frame_time })
    }

    /// Records the bytes of the device's memory budget that are left after the budget has changed. If negative, the next narrower
    /// window follows, regardless of the times.
    pub(super) fn record_memory(&mut self, memory_left: i128) -> Option<Decision> {
        let window = self.narrower_if_short(Some(memory_left))?;
        self.set_reference_pass();
        self.setting.window = window;
        self.restart_measurement();
        Some(Decision { reason: Reason::MemoryIsShort, frame_time: self.frame_time() })
    }

    /// Time of a shown frame, as measured last.
    pub(super) fn frame_time(&self) -> Duration {
        self.expected_time(self.setting)
    }

    /// Restarts the measurement after a change.
    fn restart_measurement(&mut self) {
        (self.stale_latents, self.stale_frames) = (STALE_LATENTS, STALE_FRAMES);
        (self.latents, self.latents_time) = (0, LatentTime::default());
        (self.frames, self.frames_time) = (0, Duration::ZERO);
        self.within_budget = 0;
    }

    /// Stores the current window's pass duration relative to the first measured window's.
    fn update_window(&mut self) {
        let relative = match self.reference_pass.take() {
            Some(reference) if reference > 0.0 => self.latent.pass / reference,
            _ => self.windows[self.setting.window].relative_pass.unwrap_or(1.0),
        };
        self.windows[self.setting.window].relative_pass = Some(relative);
    }

    /// Stores what a pass of the first measured window takes now, before the window changes.
    fn set_reference_pass(&mut self) {
        self.reference_pass =
            self.windows[self.setting.window].relative_pass.map(|relative| self.latent.pass / relative);
    }

    /// Expected time of a shown frame under `setting`.
    fn expected_time(&self, setting: Setting) -> Duration {
        let latent = self.latent.seconds(self.passes[setting.passes], self.pass_ratio(setting.window))
            / f64::from(self.multiplier);
        let generated =
            f64::from(self.generated[setting.generated]) / f64::from(self.generated[self.setting.generated]);
        let frame = self.generation_time.as_secs_f64() * generated;
        Duration::try_from_secs_f64(latent + frame).unwrap_or(Duration::MAX)
    }

    /// Expected ratio of a pass's duration in another window to that in the current one. If not measured, a narrower window is
    /// assumed to save nothing, and a wider one to cost in proportion to its length.
    fn pass_ratio(&self, window: usize) -> f64 {
        let (current, other) = (&self.windows[self.setting.window], &self.windows[window]);
        match (other.relative_pass, current.relative_pass) {
            _ if window == self.setting.window => 1.0,
            (Some(other), Some(current)) if current > 0.0 => other / current,
            _ => (f64::from(other.latents) / f64::from(current.latents)).max(1.0),
        }
    }

    /// Whether a window is allowed and a rollout in it fits in the memory that is left.
    fn is_available(&self, window: usize, memory_left: Option<i128>) -> bool {
        let more = i128::from(self.windows[window].rollout_bytes)
            - i128::from(self.windows[self.setting.window].rollout_bytes);
        self.windows[window].allowed && (more <= 0 || memory_left.is_none_or(|left| more <= left))
    }

    fn narrower(&self, memory_left: Option<i128>) -> Option<usize> {
        (self.setting.window + 1..self.windows.len()).find(|window| self.is_available(*window, memory_left))
    }

    /// The next narrower window if the memory budget is exceeded.
    fn narrower_if_short(&self, memory_left: Option<i128>) -> Option<usize> {
        memory_left.filter(|left| *left < 0).and_then(|_| self.narrower(memory_left))
    }

    fn decide(&mut self, frame_time: Duration, memory_left: Option<i128>) -> Option<(Setting, Reason)> {
        if let Some(window) = self.narrower_if_short(memory_left) {
            return Some((Setting { window, ..self.setting }, Reason::MemoryIsShort));
        }
        let narrower = self.narrower(memory_left);
        let budget = self.budget?;
        let settings = |window: usize| {
            let (generated, passes) = (self.generated.len(), self.passes.len());
            (0..generated)
                .flat_map(move |generated| (0..passes).map(move |passes| Setting { window, generated, passes }))
        };
        let all = (0..self.windows.len()).filter(|window| self.is_available(*window, memory_left)).flat_map(settings);
        if frame_time > budget {
            let smallest =
                Setting { generated: self.generated.len() - 1, passes: self.passes.len() - 1, ..self.setting };
            let fits =
                all.filter(|setting| *setting > self.setting).find(|setting| self.expected_time(*setting) <= budget);
            let setting = fits.unwrap_or(Setting { window: narrower.unwrap_or(self.setting.window), ..smallest });
            self.within_budget = 0;
            if std::mem::take(&mut self.has_grown) {
                self.patience = (2 * self.patience).min(MAX_PATIENCE);
            }
            if setting == self.setting {
                self.over_budget += 1;
                return None;
            }
            return Some((setting, Reason::TooLong));
        }
        let limit = budget - budget / 8;
        let larger =
            all.take_while(|setting| *setting < self.setting).find(|setting| self.expected_time(*setting) <= limit);
        self.within_budget += 1;
        if self.within_budget < self.patience {
            return None;
        }
        self.within_budget = 0;
        self.has_grown = larger.is_some();
        larger.map(|setting| (setting, Reason::TimeIsLeft))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_memory_budget_takes_effect_before_the_next_latent() {
        let mut controller = controller(1_000_000);
        assert_eq!(controller.record_memory(0), None, "the granted memory is just enough");
        let decision = controller.record_memory(-1).expect("a narrower window");
        assert_eq!((decision.reason, setting_of(&controller).0), (Reason::MemoryIsShort, 8));
        assert_eq!(controller.record_memory(-1), None, "there is no narrower one");
        // The wide window returns as after any other change: when there is memory for it, and time.
        let latents = |controller: &mut Controller, left| {
            (0..12).for_each(|_| _ = controller.record_latent(undivided(1_000, controller), Some(left)));
            setting_of(controller).0
        };
        assert_eq!(latents(&mut controller, 1 << 20), 8, "its ring would not fit");
        assert_eq!(latents(&mut controller, 1 << 30), 64);
    }

    /// A device's load in microseconds: of a pass at g64, of a pass at g8, of all other work of a latent, of a generated frame, and
    /// of a repeated one.
    #[derive(Clone, Copy)]
    struct Load {
        wide: u32,
        narrow: u32,
        other: u32,
        generated: u32,
        repeated: u32,
        /// Whether the device tells the times of passes apart from other work.
        is_divided: bool,
    }

    const LIGHT: Load =
        Load { wide: 2_000, narrow: 1_000, other: 2_000, generated: 1_000, repeated: 100, is_divided: true };

    /// The time of a latent of which nothing else is known.
    fn undivided(microseconds: u32, controller: &Controller) -> LatentTime {
        let passes = controller.passes[controller.setting().passes];
        LatentTime::undivided(Duration::from_micros(microseconds.into()), passes)
    }

    fn controller(budget: u32) -> Controller {
        let windows = vec![Window::new(64, 64 << 20, true), Window::new(8, 8 << 20, true)];
        let budget = Some(Duration::from_micros(budget.into()));
        let mut controller = Controller::new(budget, 4, windows, vec![4, 2, 1]);
        controller.allow_fewer_frames();
        controller
    }

    /// The current window, generated frames and passes.
    fn setting_of(controller: &Controller) -> (u32, u32, u32) {
        let setting = controller.setting();
        (
            controller.windows[setting.window].latents,
            controller.generated[setting.generated],
            controller.passes[setting.passes],
        )
    }

    /// Time of a latent and of one anchor's frames under a load.
    fn times(controller: &Controller, load: Load) -> (LatentTime, Duration) {
        let (window, generated, passes) = setting_of(controller);
        let microseconds = |number: u32| Duration::from_micros(number.into());
        let of_passes = passes * if window == 64 { load.wide } else { load.narrow };
        let total = of_passes + load.other;
        let latent = match load.is_divided {
            true => LatentTime { total: microseconds(total), passes: microseconds(of_passes), count: passes.into() },
            false => undivided(total, controller),
        };
        (latent, microseconds(load.generated * generated + load.repeated * (4 - generated)))
    }

    /// Simulates `latents` latents with their frames; returns the number of decisions.
    fn run(controller: &mut Controller, latents: u32, load: Load) -> u32 {
        let mut decisions = 0;
        for _ in 0..latents {
            let (latent, frames) = times(controller, load);
            controller.record_frames(4, frames);
            decisions += u32::from(controller.record_latent(latent, None).is_some());
        }
        decisions
    }

    fn within(controller: &Controller, load: Load, budget: u32) -> bool {
        let (latent, frames) = times(controller, load);
        (latent.total + frames) / 4 <= Duration::from_micros(budget.into())
    }

    #[test]
    fn the_largest_setting_within_the_budget_is_found_and_kept() {
        // With everything: (4 * 2 + 2 + 4) / 4 = 3.5 ms for each frame.
        let settings = [
            (4_500, (64, 4, 4)),
            (3_000, (64, 4, 2)),
            (2_000, (64, 4, 1)),
            (1_600, (64, 2, 1)),
            (1_330, (64, 1, 1)),
            (1_200, (8, 1, 1)),
        ];
        for (budget, expected) in settings {
            for load in [LIGHT, Load { is_divided: false, ..LIGHT }] {
                let mut controller = controller(budget);
                let decisions = run(&mut controller, 400, load);
                assert_eq!(setting_of(&controller), expected, "{budget} us");
                assert!(within(&controller, load, budget), "{budget} us");
                assert!(decisions <= 6, "{decisions} decisions at {budget} us");
                assert_eq!(run(&mut controller, 400, load), 0, "it oscillates at {budget} us");
            }
        }
    }

    /// With small weights a pass is short, and a latent is mostly its decoder's work, which no pass less shortens.
    #[test]
    fn passes_are_kept_where_fewer_would_not_help() {
        let small = Load { wide: 200, narrow: 180, other: 6_000, ..LIGHT };
        // With everything 2.7 ms for each frame, with one pass 2.55 ms, with two generated frames 2.25 ms.
        let mut known = controller(2_300);
        assert_eq!((run(&mut known, 400, small), setting_of(&known)), (1, (64, 2, 4)));
        // A device that does not tell the times apart has to try fewer passes first.
        let mut unknown = controller(2_300);
        assert!(run(&mut unknown, 400, Load { is_divided: false, ..small }) > 1);
        assert!(within(&unknown, small, 2_300) && setting_of(&unknown) != (64, 2, 4), "{:?}", setting_of(&unknown));
    }

    #[test]
    fn settings_shrink_under_load_and_recover_afterwards() {
        let mut controller = controller(4_500);
        let heavy = Load { wide: 12_000, narrow: 4_000, other: 3_000, generated: 2_000, ..LIGHT };
        run(&mut controller, 200, LIGHT);
        assert_eq!(setting_of(&controller), (64, 4, 4));
        run(&mut controller, 200, heavy);
        assert_eq!(setting_of(&controller).0, 64);
        assert!(
            within(&controller, heavy, 4_500) && setting_of(&controller) != (64, 4, 4),
            "{:?}",
            setting_of(&controller)
        );
        run(&mut controller, 200, LIGHT);
        assert_eq!(setting_of(&controller), (64, 4, 4), "the full setting returns");
        // Under any load the setting becomes stable.
        for factor in 1..40 {
            let load = Load {
                wide: 500 * factor,
                narrow: 300 * factor,
                other: 400 * factor,
                generated: 150 * factor,
                ..LIGHT
            };
            run(&mut controller, 600, load);
            assert!(run(&mut controller, 600, load) <= 4, "times {factor}: {:?}", setting_of(&controller));
        }
    }

    #[test]
    fn increases_that_prove_too_slow_are_tried_less_and_less_often() {
        let mut controller = controller(3_000);
        let mut decisions = 0;
        for _ in 0..12_000 {
            // Every setting above the smallest costs far more than expected.
            let smallest = setting_of(&controller) == (8, 1, 1);
            let latent = undivided(if smallest { 1_000 } else { 40_000 }, &controller);
            controller.record_frames(4, Duration::from_micros(100));
            decisions += u32::from(controller.record_latent(latent, None).is_some());
        }
        assert!(decisions < 400, "{decisions}");
    }

    #[test]
    fn over_budget_counts_measurements_of_the_smallest_setting() {
        let mut controller = controller(100);
        run(&mut controller, 400, LIGHT);
        assert_eq!(setting_of(&controller), (8, 1, 1));
        assert!(controller.over_budget > 50, "{}", controller.over_budget);
    }

    #[test]
    fn the_window_follows_the_memory_that_is_left() {
        let mut controller = controller(10_000);
        let reasons = |controller: &mut Controller, latents: u32, left: i128| {
            let mut found = Vec::new();
            for _ in 0..latents {
                let (latent, _) = times(controller, LIGHT);
                found.extend(controller.record_latent(latent, Some(left)).map(|decision| decision.reason));
            }
            found
        };
        assert_eq!(reasons(&mut controller, 30, 1), []);
        assert_eq!(reasons(&mut controller, 30, -1), [Reason::MemoryIsShort]);
        assert_eq!(setting_of(&controller), (8, 4, 4), "frames and passes stay");
        // The wider ring takes 56 MiB more.
        assert_eq!(reasons(&mut controller, 30, (56 << 20) - 1), []);
        assert_eq!(reasons(&mut controller, 30, 56 << 20), [Reason::TimeIsLeft]);
        assert_eq!(setting_of(&controller), (64, 4, 4));
        // A window that turned out to be unusable is not tried again, and the one in use is allowed even if it was not.
        controller.windows[1].allowed = false;
        controller.exclude(0, 1);
        assert_eq!(controller.windows.iter().map(|window| window.allowed).collect::<Vec<_>>(), [false, true]);
        assert_eq!(reasons(&mut controller, 300, 1 << 30), []);
        assert_eq!(setting_of(&controller), (8, 4, 4));
    }

    #[test]
    fn without_a_presenter_all_frames_are_generated_and_without_a_time_limit_nothing_changes() {
        let windows = vec![Window::new(8, 1, true)];
        let mut alone = Controller::new(Some(Duration::from_micros(1)), 4, windows.clone(), vec![4, 1]);
        run(&mut alone, 30, LIGHT);
        assert_eq!(setting_of(&alone), (8, 4, 1));
        let mut timeless = Controller::new(None, 4, windows, vec![4, 1]);
        assert_eq!((run(&mut timeless, 30, LIGHT), setting_of(&timeless)), (0, (8, 4, 4)));
    }
}
