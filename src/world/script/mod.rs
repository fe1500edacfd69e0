//! Control scripts: a player's input by world time. The text format is `docs/control-script.md`.

mod recorder;
#[cfg(test)]
mod tests;
mod text;

use std::fmt;

use crate::world::controls::ControlInput;
use crate::world::time::{MAX_SECONDS, MICROS, WorldTime, format_micros};
use crate::world::virtual_keys::{Key, KeySet};
use crate::{Error, ErrorKind, Result};

pub use recorder::ScriptRecorder;
pub use text::{MAX_SCRIPT_BYTES, SCRIPT_VERSION};

/// Maximum number of events of a script.
pub const MAX_EVENTS: usize = 200_000;
/// Maximum mouse motion of one event, in counts, on either axis and in either direction.
pub const MAX_EVENT_MOUSE: f64 = 1.0e9;
/// Maximum wheel motion of one event, in notches, in either direction.
pub const MAX_EVENT_SCROLL: i32 = 1_000_000;
/// Smaller motions, in counts, are set to zero, so that every number has a short decimal form.
const LEAST_MOTION: f64 = 1.0e-9;

/// One input event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScriptEvent {
    /// Start time, in microseconds of world time.
    pub at: u64,
    /// The input.
    pub action: Action,
}

/// The input of a [`ScriptEvent`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// A key goes down.
    Down(Key),
    /// A held key goes up.
    Up(Key),
    /// The mouse moves by dx (right positive) and dy (down positive) counts: at once, or evenly until a later time.
    Mouse {
        /// dx and dy, each from -[`MAX_EVENT_MOUSE`] to [`MAX_EVENT_MOUSE`].
        motion: [f64; 2],
        /// The end of the motion in microseconds, not included; `None` for a motion at once.
        until: Option<u64>,
    },
    /// The wheel turns by this many notches, up positive, at most [`MAX_EVENT_SCROLL`] in either direction.
    Scroll(i32),
}

/// A valid control script.
///
/// Time is exact: over adjacent spans of 1/15 s, [`ControlScript::span`] counts every event once, however long the script is.
#[derive(Debug, Clone)]
pub struct ControlScript {
    /// Sorted by time; events at the same time keep their order.
    events: Vec<ScriptEvent>,
    end: Option<u64>,
    /// Keys held before event i, and after the last one: one entry more than events.
    held: Vec<KeySet>,
    /// Events that move the mouse over a span, sorted by start.
    ramps: Vec<Ramp>,
}

/// A mouse motion over a span of time.
#[derive(Debug, Clone, Copy)]
struct Ramp {
    from: u64,
    until: u64,
    motion: [f64; 2],
    /// The latest `until` of this ramp and all before it.
    latest: u64,
}

/// Position of an event in the text or the list that it comes from, for messages.
#[derive(Debug, Clone, Copy)]
enum SourcePosition {
    Text { line: usize, column: usize },
    Index(usize),
}

impl fmt::Display for SourcePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text { line, column } => write!(f, "line {line}, column {column}"),
            Self::Index(index) => write!(f, "event {index}"),
        }
    }
}

impl ControlScript {
    /// A script of these events, in any order; events at the same time keep theirs. At `end` (microseconds), if given, all keys are
    /// released and the script ends.
    ///
    /// # Errors
    /// `InvalidArgument`, with the event's index, for a time after [`MAX_SECONDS`] or after the end, a motion that is not finite or
    /// too large, a motion that ends before it starts, a key that goes down while held or up while not held; and for more than
    /// [`MAX_EVENTS`] events.
    pub fn from_events(events: Vec<ScriptEvent>, end: Option<u64>) -> Result<Self> {
        Self::build(events.into_iter().enumerate().map(|(i, event)| (event, SourcePosition::Index(i))).collect(), end)
    }

    fn build(mut events: Vec<(ScriptEvent, SourcePosition)>, end: Option<u64>) -> Result<Self> {
        if events.len() > MAX_EVENTS {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("the script has {} events", events.len()))
                .field("script")
                .remedy(format!("Use at most {MAX_EVENTS}")));
        }
        if let Some(end) = end.filter(|end| *end > MAX_SECONDS * MICROS) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("the script ends at {} s", format_micros(end)))
                .field("script.end")
                .remedy(format!("End it at {MAX_SECONDS} s or before")));
        }
        events.sort_by_key(|(event, _)| event.at);
        let mut script = Self { events: Vec::new(), end, held: vec![KeySet::NONE], ramps: Vec::new() };
        for (event, position) in events {
            script.push(event).map_err(|cause| {
                Error::new(ErrorKind::InvalidArgument, cause)
                    .field(position.to_string())
                    .remedy("See docs/control-script.md for what a script may say")
            })?;
        }
        if let Some(end) = end {
            // Keys held at the end are released by explicit events, so that a written script contains the releases.
            let events = script.events.len() + script.held_at_end().iter().count();
            if events > MAX_EVENTS {
                let cause = format!("the script has {events} events, with those that release keys at its end");
                return Err(Error::new(ErrorKind::InvalidArgument, cause)
                    .field("script.end")
                    .remedy(format!("Use at most {MAX_EVENTS}")));
            }
            for key in script.held_at_end().iter() {
                script
                    .push(ScriptEvent { at: end, action: Action::Up(key) })
                    .map_err(|cause| Error::new(ErrorKind::InvalidArgument, cause).field("script.end"))?;
            }
        }
        Ok(script)
    }

    fn held_at_end(&self) -> KeySet {
        self.held.last().copied().unwrap_or_default()
    }

    /// Adds the next event in order of time. The error is the cause alone, without field or remedy.
    fn push(&mut self, mut event: ScriptEvent) -> std::result::Result<(), String> {
        let mut held = self.held_at_end();
        let latest = self.end.unwrap_or(MAX_SECONDS * MICROS);
        let check_time = |at: u64| {
            if at <= latest {
                return Ok(());
            }
            let what = if self.end.is_some() { "after the end" } else { "too late" };
            Err(format!("{} s is {what}: the script lasts {} s at most", format_micros(at), format_micros(latest)))
        };
        check_time(event.at)?;
        match &mut event.action {
            Action::Down(key) if held.contains(*key) => return Err(format!("{key} goes down, but it is held already")),
            Action::Down(key) => held.insert(*key),
            Action::Up(key) if !held.contains(*key) => return Err(format!("{key} goes up, but it is not held")),
            Action::Up(key) => held.remove(*key),
            Action::Mouse { motion, until } => {
                for counts in motion.iter_mut() {
                    // A NaN fails the comparison.
                    if !matches!(counts.abs().partial_cmp(&MAX_EVENT_MOUSE), Some(order) if order.is_le()) {
                        return Err(format!("a motion of {counts} counts is too large or no number"));
                    }
                    if counts.abs() < LEAST_MOTION {
                        *counts = 0.0;
                    }
                }
                if let Some(until) = *until {
                    check_time(until)?;
                    if until <= event.at {
                        return Err("the motion ends before it starts".into());
                    }
                    let latest = self.ramps.last().map_or(until, |ramp| ramp.latest.max(until));
                    self.ramps.push(Ramp { from: event.at, until, motion: *motion, latest });
                }
            }
            Action::Scroll(notches) if notches.unsigned_abs() > MAX_EVENT_SCROLL.unsigned_abs() => {
                return Err(format!("a wheel motion of {notches} notches is too large"));
            }
            Action::Scroll(_) => {}
        }
        self.events.push(event);
        self.held.push(held);
        Ok(())
    }

    /// The events, by time.
    pub fn events(&self) -> &[ScriptEvent] {
        &self.events
    }

    /// The script's explicit end, in microseconds.
    pub fn end(&self) -> Option<u64> {
        self.end
    }

    /// Its duration: to its explicit end, if any, else to the end of its last event or motion.
    pub fn duration(&self) -> WorldTime {
        let last_event = self.events.last().map_or(0, |event| event.at);
        let last_motion = self.ramps.last().map_or(0, |ramp| ramp.latest);
        WorldTime::from_micros(self.end.unwrap_or(last_event.max(last_motion)))
    }

    /// The controls of the span from `start` (included) to `end` (not included): the motion of mouse and wheel within it, and every
    /// key that is held at any time in it, so that even the shortest tap counts.
    ///
    /// # Errors
    /// `InvalidArgument` when `start` is after `end`, or when the motion of the span exceeds
    /// [`MAX_MOUSE`](crate::world::MAX_MOUSE).
    pub fn span(&self, start: WorldTime, end: WorldTime) -> Result<ControlInput> {
        if start > end {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a span from {start} to {end} runs backwards"))
                .field("span"));
        }
        if start == end {
            return Ok(ControlInput::IDLE);
        }
        let first = self.events.partition_point(|event| WorldTime::from_micros(event.at) < start);
        let end_index = self.events.partition_point(|event| WorldTime::from_micros(event.at) < end);
        let mut keys = self.held[first];
        let (mut pressed, mut mouse, mut notches) = (KeySet::NONE, [0.0f64; 2], 0i64);
        for event in &self.events[first..end_index] {
            match event.action {
                Action::Down(key) => {
                    keys.insert(key);
                    pressed.insert(key);
                }
                // Released at the start of the span, so it was held before the span and not in it.
                Action::Up(key) if WorldTime::from_micros(event.at) == start && !pressed.contains(key) => {
                    keys.remove(key);
                }
                Action::Up(_) => {}
                Action::Mouse { motion, until: None } => {
                    mouse[0] += motion[0];
                    mouse[1] += motion[1];
                }
                Action::Mouse { until: Some(_), .. } => {}
                Action::Scroll(n) => notches += i64::from(n),
            }
        }
        self.add_ramps(start, end, &mut mouse);
        ControlInput::new(mouse.map(|counts| counts as f32), keys, notches.signum() as f32)
            .map_err(|error| error.remedy(format!("Spread the motion between {start} and {end} of the script")))
    }

    /// Adds the share of each mouse motion over a span that falls into `start..end`, by exact fractions of time.
    fn add_ramps(&self, start: WorldTime, end: WorldTime, mouse: &mut [f64; 2]) {
        let end_index = self.ramps.partition_point(|ramp| WorldTime::from_micros(ramp.from) < end);
        let first = self.ramps.partition_point(|ramp| WorldTime::from_micros(ramp.latest) <= start);
        let (start, end, scale) = WorldTime::to_common_unit(start, end);
        for ramp in self.ramps.get(first..end_index).unwrap_or_default() {
            let (from, until) = (scale(ramp.from), scale(ramp.until));
            let overlap = until.min(end).saturating_sub(from.max(start));
            let share = overlap as f64 / (until - from) as f64;
            mouse[0] += ramp.motion[0] * share;
            mouse[1] += ramp.motion[1] * share;
        }
    }
}

impl PartialEq for ControlScript {
    /// Compares events and end; the other fields follow from them.
    fn eq(&self, other: &Self) -> bool {
        self.events == other.events && self.end == other.end
    }
}
