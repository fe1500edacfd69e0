//! Chooses the next setting of a rollout and its frames, from measured times; it reads no clock.

use std::time::Duration;

/// Latents measured before each decision.
const LATENTS: u32 = 3;
/// Latents and frames in flight when a setting changes; their times belong to the old setting and are ignored.
const STALE_LATENTS: u32 = 1;
const STALE_FRAMES: u64 = 3;
/// Maximum number of consecutive measurements within the budget that are required before a larger setting is tried.
const MOST_PATIENCE: u32 = 64;

/// One setting, as indices in lists whose first entry is the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Setting {
    pub(super) window: usize,
    pub(super) made: usize,
    pub(super) passes: usize,
}

/// A context window that a rollout may have.
#[derive(Debug, Clone)]
pub(super) struct Window {
    pub(super) latents: u32,
    /// Bytes of its ring.
    pub(super) ring: u64,
    /// Whether it may be used.
    pub(super) allowed: bool,
    /// Duration of a pass, relative to a pass of the first window that was measured; `None` before it is measured.
    relative: Option<f64>,
}

impl Window {
    pub(super) fn new(latents: u32, ring: u64, allowed: bool) -> Self {
        Self { latents, ring, allowed, relative: None }
    }
}

/// Why a setting replaces another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
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
    pub(super) why: Why,
    /// Time of a shown frame when it was made.
    pub(super) took: Duration,
}

/// Keeps the device time of each shown frame within a budget.
///
/// ```text
/// frame time          (a latent's time + device time of the frames between it and the next) / frames shown for the latent
/// settings            each window, widest first; of each, generated frames, most first; of each, passes, most first
/// above the budget    the first smaller setting whose expected time is within the budget; if there is none, the next narrower window
///                     with the fewest frames and passes, so that it is measured
/// below the budget    the first setting with an expected time of at most 7/8 of the budget, after a number of calm measurements that
///                     doubles whenever a larger setting proved too slow
/// a latent's time     proportional to its passes + 1; between windows as measured
/// ```
#[derive(Debug, Clone)]
pub(super) struct Choice {
    budget: Option<Duration>,
    multiplier: u32,
    pub(super) windows: Vec<Window>,
    /// Numbers of frames that may be generated for an anchor, descending.
    pub(super) made: Vec<u32>,
    /// Passes of each schedule, descending.
    pub(super) passes: Vec<u32>,
    at: Setting,
    stale_latents: u32,
    stale_frames: u64,
    latents: u32,
    latents_took: Duration,
    frames: u64,
    frames_took: Duration,
    /// Expected duration of a pass of the first measured window when the current window was entered; the reference for this
    /// window's `relative`.
    left: Option<f64>,
    /// Times measured last: of a latent, and of the work on frames for each shown frame.
    latent: Duration,
    frame: Duration,
    calm: u32,
    patience: u32,
    has_grown: bool,
    /// How often the smallest setting took too long.
    pub(super) beyond: u64,
}

impl Choice {
    /// Starts with the first allowed window; at least one is allowed.
    pub(super) fn new(budget: Option<Duration>, multiplier: u32, windows: Vec<Window>, passes: Vec<u32>) -> Self {
        let window = windows.iter().position(|window| window.allowed).unwrap_or(windows.len().saturating_sub(1));
        Self {
            budget,
            multiplier,
            windows,
            made: vec![multiplier],
            passes,
            at: Setting { window, made: 0, passes: 0 },
            stale_latents: 0,
            stale_frames: 0,
            latents: 0,
            latents_took: Duration::ZERO,
            frames: 0,
            frames_took: Duration::ZERO,
            left: None,
            latent: Duration::ZERO,
            frame: Duration::ZERO,
            calm: 0,
            patience: 1,
            has_grown: false,
            beyond: 0,
        }
    }

    pub(super) fn at(&self) -> Setting {
        self.at
    }

    /// Allows fewer generated frames: all divisors of the multiplier.
    pub(super) fn may_make_fewer(&mut self) {
        self.made = (1..=self.multiplier).rev().filter(|made| self.multiplier.is_multiple_of(*made)).collect();
    }

    /// Marks a window as unusable, and sets the one in use to `instead`.
    pub(super) fn refuse(&mut self, window: usize, instead: usize) {
        self.windows[window].allowed = false;
        self.at.window = instead;
        self.begin();
    }

    /// Records the device time of `frames` more frames.
    pub(super) fn note_frames(&mut self, frames: u64, took: Duration) {
        if self.stale_frames > 0 {
            self.stale_frames = self.stale_frames.saturating_sub(frames);
            return;
        }
        self.frames += frames;
        self.frames_took = self.frames_took.saturating_add(took);
    }

    /// Records a latent's time and the bytes of the device's memory budget that are left, negative if it is exceeded. Returns a
    /// decision if the setting changes.
    pub(super) fn note_latent(&mut self, took: Duration, room: Option<i128>) -> Option<Decision> {
        if self.stale_latents > 0 {
            self.stale_latents -= 1;
            return None;
        }
        self.latents += 1;
        self.latents_took = self.latents_took.saturating_add(took);
        if self.latents < LATENTS {
            return None;
        }
        self.latent = self.latents_took / self.latents;
        self.frame = self.frames_took / u32::try_from(self.frames.max(1)).unwrap_or(u32::MAX);
        self.measured();
        let took = self.cost(self.at);
        let decision = self.decide(took, room);
        (self.latents, self.latents_took) = (0, Duration::ZERO);
        (self.frames, self.frames_took) = (0, Duration::ZERO);
        let (setting, why) = decision?;
        if setting.window != self.at.window {
            self.left = self.windows[self.at.window].relative.map(|relative| self.pass() / relative);
        }
        self.at = setting;
        self.begin();
        Some(Decision { why, took })
    }

    /// Records the bytes of the device's memory budget that are left after the budget has changed. If negative, the next narrower
    /// window follows, regardless of the times.
    pub(super) fn note_memory(&mut self, room: i128) -> Option<Decision> {
        let window = self.narrower_for(Some(room))?;
        self.left = self.windows[self.at.window].relative.map(|relative| self.pass() / relative);
        self.at.window = window;
        self.begin();
        Some(Decision { why: Why::MemoryIsShort, took: self.took() })
    }

    /// Time of a shown frame, as measured last.
    pub(super) fn took(&self) -> Duration {
        self.cost(self.at)
    }

    /// Restarts the measurement after a change.
    fn begin(&mut self) {
        (self.stale_latents, self.stale_frames) = (STALE_LATENTS, STALE_FRAMES);
        (self.latents, self.latents_took) = (0, Duration::ZERO);
        (self.frames, self.frames_took) = (0, Duration::ZERO);
        self.calm = 0;
    }

    /// Duration of a pass in seconds; all other work of a latent counts as one pass more.
    fn pass(&self) -> f64 {
        self.latent.as_secs_f64() / f64::from(self.passes[self.at.passes] + 1)
    }

    /// Stores this window's pass duration relative to the first measured window's.
    fn measured(&mut self) {
        let pass = self.pass();
        let relative = match self.left.take() {
            Some(one) if one > 0.0 => pass / one,
            _ => self.windows[self.at.window].relative.unwrap_or(1.0),
        };
        self.windows[self.at.window].relative = Some(relative);
    }

    /// Expected time of a shown frame under `setting`.
    fn cost(&self, setting: Setting) -> Duration {
        let passes = f64::from(self.passes[setting.passes] + 1) / f64::from(self.passes[self.at.passes] + 1);
        let latent = self.latent.as_secs_f64() * passes * self.times(setting.window) / f64::from(self.multiplier);
        let made = f64::from(self.made[setting.made]) / f64::from(self.made[self.at.made]);
        let frame = self.frame.as_secs_f64() * made;
        Duration::try_from_secs_f64(latent + frame).unwrap_or(Duration::MAX)
    }

    /// Expected ratio of a pass's duration in another window to that in the current one. If not measured, a narrower window is
    /// assumed to save nothing, and a wider one to cost in proportion to its length.
    fn times(&self, window: usize) -> f64 {
        let (here, there) = (&self.windows[self.at.window], &self.windows[window]);
        match (there.relative, here.relative) {
            _ if window == self.at.window => 1.0,
            (Some(there), Some(here)) if here > 0.0 => there / here,
            _ => (f64::from(there.latents) / f64::from(here.latents)).max(1.0),
        }
    }

    fn may_have(&self, window: usize, room: Option<i128>) -> bool {
        let more = i128::from(self.windows[window].ring) - i128::from(self.windows[self.at.window].ring);
        self.windows[window].allowed && (more <= 0 || room.is_none_or(|room| more <= room))
    }

    fn narrower(&self, room: Option<i128>) -> Option<usize> {
        (self.at.window + 1..self.windows.len()).find(|window| self.may_have(*window, room))
    }

    /// The next narrower window if the memory budget is exceeded.
    fn narrower_for(&self, room: Option<i128>) -> Option<usize> {
        room.filter(|room| *room < 0).and_then(|_| self.narrower(room))
    }

    fn decide(&mut self, took: Duration, room: Option<i128>) -> Option<(Setting, Why)> {
        if let Some(window) = self.narrower_for(room) {
            return Some((Setting { window, ..self.at }, Why::MemoryIsShort));
        }
        let narrower = self.narrower(room);
        let budget = self.budget?;
        let settings = |window: usize| {
            let (made, passes) = (self.made.len(), self.passes.len());
            (0..made).flat_map(move |made| (0..passes).map(move |passes| Setting { window, made, passes }))
        };
        let all = (0..self.windows.len()).filter(|window| self.may_have(*window, room)).flat_map(settings);
        if took > budget {
            let least = Setting { made: self.made.len() - 1, passes: self.passes.len() - 1, ..self.at };
            let fits = all.filter(|setting| *setting > self.at).find(|setting| self.cost(*setting) <= budget);
            let setting = fits.unwrap_or(Setting { window: narrower.unwrap_or(self.at.window), ..least });
            self.calm = 0;
            if std::mem::take(&mut self.has_grown) {
                self.patience = (2 * self.patience).min(MOST_PATIENCE);
            }
            if setting == self.at {
                self.beyond += 1;
                return None;
            }
            return Some((setting, Why::TooLong));
        }
        let most = budget * 7 / 8;
        let more = all.take_while(|setting| *setting < self.at).find(|setting| self.cost(*setting) <= most);
        self.calm += 1;
        if self.calm < self.patience {
            return None;
        }
        self.calm = 0;
        self.has_grown = more.is_some();
        more.map(|setting| (setting, Why::TimeIsLeft))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_of_memory_that_shrinks_is_obeyed_before_the_next_latent() {
        let mut choice = choice(1_000_000);
        assert_eq!(choice.note_memory(0), None, "what is granted is just enough");
        let decision = choice.note_memory(-1).expect("a narrower window");
        assert_eq!((decision.why, has(&choice).0), (Why::MemoryIsShort, 8));
        assert_eq!(choice.note_memory(-1), None, "there is no narrower one");
        // The wide window returns as after any other change: when there is memory for it, and time.
        let latents = |choice: &mut Choice, room| {
            (0..12).for_each(|_| _ = choice.note_latent(Duration::from_micros(1_000), Some(room)));
            has(choice).0
        };
        assert_eq!(latents(&mut choice, 1 << 20), 8, "its ring would not fit");
        assert_eq!(latents(&mut choice, 1 << 30), 64);
    }

    /// A device's load in microseconds: of a pass at g64, of a pass at g8, of all other work of a latent, of a generated frame, and
    /// of a repeated one.
    #[derive(Clone, Copy)]
    struct Load {
        wide: u32,
        narrow: u32,
        rest: u32,
        made: u32,
        repeated: u32,
    }

    const LIGHT: Load = Load { wide: 2_000, narrow: 1_000, rest: 2_000, made: 1_000, repeated: 100 };

    fn choice(budget: u32) -> Choice {
        let windows = vec![Window::new(64, 64 << 20, true), Window::new(8, 8 << 20, true)];
        let budget = Some(Duration::from_micros(budget.into()));
        let mut choice = Choice::new(budget, 4, windows, vec![4, 2, 1]);
        choice.may_make_fewer();
        choice
    }

    /// The current window, generated frames and passes.
    fn has(choice: &Choice) -> (u32, u32, u32) {
        let at = choice.at();
        (choice.windows[at.window].latents, choice.made[at.made], choice.passes[at.passes])
    }

    /// Time of a latent and of one anchor's frames under a load.
    fn takes(choice: &Choice, load: Load) -> (Duration, Duration) {
        let (window, made, passes) = has(choice);
        let pass = if window == 64 { load.wide } else { load.narrow };
        let latent = Duration::from_micros((pass * passes + load.rest).into());
        (latent, Duration::from_micros((load.made * made + load.repeated * (4 - made)).into()))
    }

    /// Simulates `latents` latents with their frames; returns the number of decisions.
    fn run(choice: &mut Choice, latents: u32, load: Load) -> u32 {
        let mut decisions = 0;
        for _ in 0..latents {
            let (latent, frames) = takes(choice, load);
            choice.note_frames(4, frames);
            decisions += u32::from(choice.note_latent(latent, None).is_some());
        }
        decisions
    }

    fn within(choice: &Choice, load: Load, budget: u32) -> bool {
        let (latent, frames) = takes(choice, load);
        (latent + frames) / 4 <= Duration::from_micros(budget.into())
    }

    #[test]
    fn the_best_setting_that_stays_within_the_budget_is_found_and_kept() {
        // With everything: (4 * 2 + 2 + 4) / 4 = 3.5 ms for each frame.
        for (budget, expected) in [
            (4_500, (64, 4, 4)),
            (3_000, (64, 4, 2)),
            (2_000, (64, 4, 1)),
            (1_600, (64, 2, 1)),
            (1_330, (64, 1, 1)),
            (1_200, (8, 1, 1)),
        ] {
            let mut choice = choice(budget);
            let decisions = run(&mut choice, 400, LIGHT);
            assert_eq!(has(&choice), expected, "{budget} us");
            assert!(within(&choice, LIGHT, budget), "{budget} us");
            assert!(decisions <= 6, "{decisions} decisions at {budget} us");
            assert_eq!(run(&mut choice, 400, LIGHT), 0, "it swings at {budget} us");
        }
    }

    #[test]
    fn a_load_that_comes_and_goes_takes_and_gives_back() {
        let mut choice = choice(4_500);
        let heavy = Load { wide: 12_000, narrow: 4_000, rest: 3_000, made: 2_000, repeated: 100 };
        run(&mut choice, 200, LIGHT);
        assert_eq!(has(&choice), (64, 4, 4));
        run(&mut choice, 200, heavy);
        assert_eq!(has(&choice).0, 64);
        assert!(within(&choice, heavy, 4_500) && has(&choice) != (64, 4, 4), "{:?}", has(&choice));
        run(&mut choice, 200, LIGHT);
        assert_eq!(has(&choice), (64, 4, 4), "what was given up comes back");
        // Under any load the setting becomes stable.
        for factor in 1..40 {
            let load =
                Load { wide: 500 * factor, narrow: 300 * factor, rest: 400 * factor, made: 150 * factor, ..LIGHT };
            run(&mut choice, 600, load);
            assert!(run(&mut choice, 600, load) <= 4, "times {factor}: {:?}", has(&choice));
        }
    }

    #[test]
    fn what_looks_cheap_and_is_not_is_tried_ever_less() {
        let mut choice = choice(3_000);
        let mut decisions = 0;
        for _ in 0..12_000 {
            // Every setting above the smallest costs far more than expected.
            let least = has(&choice) == (8, 1, 1);
            let latent = Duration::from_micros(if least { 1_000 } else { 40_000 });
            choice.note_frames(4, Duration::from_micros(100));
            decisions += u32::from(choice.note_latent(latent, None).is_some());
        }
        assert!(decisions < 400, "{decisions}");
    }

    #[test]
    fn the_least_that_is_too_much_is_counted() {
        let mut choice = choice(100);
        run(&mut choice, 400, LIGHT);
        assert_eq!(has(&choice), (8, 1, 1));
        assert!(choice.beyond > 50, "{}", choice.beyond);
    }

    #[test]
    fn a_window_is_narrowed_where_memory_is_short_and_widened_where_it_is_not() {
        let mut choice = choice(10_000);
        let note = |choice: &mut Choice, latents: u32, room: i128| {
            let mut why = Vec::new();
            for _ in 0..latents {
                let (latent, _) = takes(choice, LIGHT);
                why.extend(choice.note_latent(latent, Some(room)).map(|decision| decision.why));
            }
            why
        };
        assert_eq!(note(&mut choice, 30, 1), []);
        assert_eq!(note(&mut choice, 30, -1), [Why::MemoryIsShort]);
        assert_eq!(has(&choice), (8, 4, 4), "time is no matter");
        // The wider ring takes 56 MiB more.
        assert_eq!(note(&mut choice, 30, (56 << 20) - 1), []);
        assert_eq!(note(&mut choice, 30, 56 << 20), [Why::TimeIsLeft]);
        assert_eq!(has(&choice), (64, 4, 4));
        // A window that turned out to be unusable is not tried again.
        choice.refuse(0, 1);
        assert_eq!(note(&mut choice, 300, 1 << 30), []);
        assert_eq!(has(&choice), (8, 4, 4));
    }

    #[test]
    fn without_a_presenter_no_frame_is_left_out_and_without_a_time_none_counts() {
        let windows = vec![Window::new(8, 1, true)];
        let mut alone = Choice::new(Some(Duration::from_micros(1)), 4, windows.clone(), vec![4, 1]);
        run(&mut alone, 30, LIGHT);
        assert_eq!(has(&alone), (8, 4, 1));
        let mut timeless = Choice::new(None, 4, windows, vec![4, 1]);
        assert_eq!((run(&mut timeless, 30, LIGHT), has(&timeless)), (0, (8, 4, 4)));
    }
}
