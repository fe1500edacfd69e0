//! Records live input as a control script.

use crate::world::controls::ControlInput;
use crate::world::script::{Action, ControlScript, MAX_EVENT_MOUSE, MAX_EVENT_SCROLL, MAX_EVENTS, ScriptEvent};
use crate::world::time::{MAX_SECONDS, MICROS, WorldTime, format_micros};
use crate::world::virtual_keys::{Key, KeySet};
use crate::{Error, ErrorKind, Result};

/// Collects input events as they happen, or the controls of whole latent steps, and makes a [`ControlScript`] of them.
///
/// Times are kept to the microsecond. Feed events with [`key`](Self::key), [`mouse`](Self::mouse) and
/// [`scroll`](Self::scroll), or steps with [`step`](Self::step); mixing both in one recording is allowed.
#[derive(Debug, Clone, Default)]
pub struct ScriptRecorder {
    events: Vec<ScriptEvent>,
    held: KeySet,
}

impl ScriptRecorder {
    /// An empty recording.
    pub fn new() -> Self {
        Self::default()
    }

    /// Records that a key went down or up. If it was already, nothing is recorded, because keyboards repeat.
    ///
    /// # Errors
    /// `InvalidArgument` when the recording is full.
    pub fn key(&mut self, at: WorldTime, key: Key, down: bool) -> Result<()> {
        self.key_at(if down { at.ceil_micros() } else { at.floor_micros() }, key, down)
    }

    /// Records a mouse motion of dx and dy counts.
    ///
    /// # Errors
    /// `InvalidArgument` for a motion that is not finite, or when the recording is full.
    pub fn mouse(&mut self, at: WorldTime, motion: [f32; 2]) -> Result<()> {
        if motion.iter().any(|counts| !counts.is_finite()) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a motion of {motion:?} counts is no input"))
                .field("mouse"));
        }
        if motion == [0.0; 2] {
            return Ok(());
        }
        let motion = motion.map(shortest);
        self.push(at.ceil_micros(), Action::Mouse { motion, until: None })
    }

    /// Records a wheel motion in notches, up positive.
    ///
    /// # Errors
    /// `InvalidArgument` when the recording is full.
    pub fn scroll(&mut self, at: WorldTime, notches: i32) -> Result<()> {
        if notches == 0 {
            return Ok(());
        }
        self.push(at.ceil_micros(), Action::Scroll(notches))
    }

    /// Records the controls of a latent step from `start` to `end`. The script's [`span`](ControlScript::span) from `start` to
    /// `end` returns the same controls, bit for bit, if every step is recorded, in order and without a gap. (A motion below 10^-9
    /// counts becomes none.)
    ///
    /// # Errors
    /// `InvalidArgument` when the span contains no whole microsecond, or when the recording is full.
    pub fn step(&mut self, start: WorldTime, end: WorldTime, input: &ControlInput) -> Result<()> {
        // Presses and motion get the first microsecond of the span, releases the last whole microsecond that is not after its
        // start.
        let (before, within) = (start.floor_micros(), start.ceil_micros());
        if WorldTime::from_micros(within) >= end {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a step from {start} to {end} is too short to record"),
            )
            .field("span"));
        }
        let (recorded, held) = (self.events.len(), self.held);
        let mut record = || {
            for key in held.iter().filter(|key| !input.keys().contains(*key)) {
                self.key_at(before, key, false)?;
            }
            for key in input.keys().iter() {
                self.key_at(within, key, true)?;
            }
            self.mouse(start, input.mouse())?;
            self.scroll(start, input.scroll() as i32)
        };
        record().inspect_err(|_| {
            self.events.truncate(recorded);
            self.held = held;
        })
    }

    /// Ends the recording; keys that are still held are released.
    ///
    /// # Errors
    /// As [`ControlScript::from_events`], for instance when an event is after `end`.
    pub fn finish(mut self, end: WorldTime) -> Result<ControlScript> {
        // Like every release, at the last microsecond that is not in the following span.
        let last = self.events.last().map_or(0, |event| event.at);
        let at = end.floor_micros().max(last);
        self.events.extend(self.held.iter().map(|key| ScriptEvent { at, action: Action::Up(key) }));
        ControlScript::from_events(self.events, Some(end.ceil_micros()))
    }

    fn key_at(&mut self, at: u64, key: Key, down: bool) -> Result<()> {
        if self.held.contains(key) == down {
            return Ok(());
        }
        let action = if down { Action::Down(key) } else { Action::Up(key) };
        self.push(at, action)?;
        if down {
            self.held.insert(key);
        } else {
            self.held.remove(key);
        }
        Ok(())
    }

    fn push(&mut self, at: u64, action: Action) -> Result<()> {
        // Reserves one event for the release of each key at the end.
        if self.events.len() + 256 >= MAX_EVENTS {
            return Err(Error::new(ErrorKind::InvalidArgument, "the recording is full")
                .field("script")
                .remedy("Finish it and start another"));
        }
        let refuse = |what: String, remedy: String| {
            Err(Error::new(ErrorKind::InvalidArgument, what).field("script").remedy(remedy))
        };
        if at > MAX_SECONDS * MICROS {
            return refuse(
                format!("an event at {} s", format_micros(at)),
                format!("A script ends after {MAX_SECONDS} s: finish it and start another"),
            );
        }
        match action {
            Action::Mouse { motion, .. } if motion.iter().any(|counts| counts.abs() > MAX_EVENT_MOUSE) => {
                return refuse(format!("a motion of {motion:?} counts"), format!("Use {MAX_EVENT_MOUSE:e} at most"));
            }
            Action::Scroll(notches) if notches.unsigned_abs() > MAX_EVENT_SCROLL.unsigned_abs() => {
                return refuse(format!("a turn of {notches} notches"), format!("Use {MAX_EVENT_SCROLL} at most"));
            }
            _ => {}
        }
        // A clock that steps back must not reorder a press and its release.
        let at = self.events.last().map_or(at, |last| at.max(last.at));
        self.events.push(ScriptEvent { at, action });
        Ok(())
    }
}

/// The f64 with the shortest decimal form that still rounds to `value`, so that recordings are readable.
fn shortest(value: f32) -> f64 {
    let short: f64 = value.to_string().parse().unwrap_or(f64::NAN);
    if short as f32 == value { short } else { f64::from(value) }
}
