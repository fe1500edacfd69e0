//! The text form of control scripts, read and written: `docs/control-script.md`.

use std::fmt::Write as _;

use crate::world::script::{Action, ControlScript, MAX_EVENTS, ScriptEvent, SourcePosition};
use crate::world::time::{clip, format_micros, parse_micros};
use crate::world::virtual_keys::Key;
use crate::{Error, ErrorKind, Result};

/// The version this library writes, and the newest it reads.
pub const SCRIPT_VERSION: u32 = 1;
/// Maximum length of a script, in bytes: more than [`MAX_EVENTS`] of the longest events that are written take.
pub const MAX_SCRIPT_BYTES: usize = 32 << 20;
/// Maximum length of a line, in bytes.
const MAX_LINE: usize = 1_000;
const HEADER: &str = "cairn-controls";

impl ControlScript {
    /// Reads a script from the bytes of a file: as [`ControlScript::parse`], and the bytes must be UTF-8.
    ///
    /// # Errors
    /// As [`ControlScript::parse`].
    pub fn parse_bytes(bytes: &[u8]) -> Result<Self> {
        check_size(bytes.len())?;
        let text = std::str::from_utf8(bytes).map_err(|error| {
            let line = bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count() + 1;
            Error::new(ErrorKind::InvalidArgument, "the script is not UTF-8 text")
                .field(format!("line {line}"))
                .remedy("Save it as UTF-8")
        })?;
        Self::parse(text)
    }

    /// Reads a script.
    ///
    /// # Errors
    /// `Unsupported` for a newer version. `InvalidArgument` for a text that is not a script or breaks a rule of
    /// `docs/control-script.md`; the field has line and column.
    pub fn parse(text: &str) -> Result<Self> {
        check_size(text.len())?;
        let mut lines = text.strip_prefix('\u{feff}').unwrap_or(text).lines();
        check_header(lines.next().unwrap_or(""))?;
        let mut reader = Reader { events: Vec::new(), end: None };
        for (number, line) in (2..).zip(lines) {
            reader.read(&Line { text: line, number })?;
        }
        Self::build(reader.events, reader.end.map(|(end, _)| end))
    }

    /// Writes the script in canonical form; [`ControlScript::parse`] reads an equal script from it.
    pub fn write(&self) -> String {
        let mut out = format!("{HEADER} {SCRIPT_VERSION}\n");
        for event in &self.events {
            out.push_str(&format_micros(event.at));
            // Writing to a string cannot fail.
            let _ = match event.action {
                Action::Down(key) => writeln!(out, " down {key}"),
                Action::Up(key) => writeln!(out, " up {key}"),
                Action::Mouse { motion: [dx, dy], until: None } => writeln!(out, " mouse {dx} {dy}"),
                Action::Mouse { motion: [dx, dy], until: Some(until) } => {
                    writeln!(out, "..{} mouse {dx} {dy}", format_micros(until))
                }
                Action::Scroll(notches) => writeln!(out, " scroll {notches}"),
            };
        }
        if let Some(end) = self.end {
            let _ = writeln!(out, "{} end", format_micros(end));
        }
        out
    }
}

fn check_size(bytes: usize) -> Result<()> {
    if bytes > MAX_SCRIPT_BYTES {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("the script has {bytes} bytes"))
            .field("script")
            .remedy(format!("Use at most {MAX_SCRIPT_BYTES}")));
    }
    Ok(())
}

fn check_header(line: &str) -> Result<()> {
    let mut words = line.split('#').next().unwrap_or("").split_whitespace();
    let no_script = || {
        Error::new(ErrorKind::InvalidArgument, "the text is no control script")
            .field("line 1, column 1")
            .remedy(format!("Start it with the line: {HEADER} {SCRIPT_VERSION}"))
    };
    if words.next() != Some(HEADER) {
        return Err(no_script());
    }
    let version = words.next().filter(|word| !word.is_empty() && word.bytes().all(|b| b.is_ascii_digit()));
    let version = version.ok_or_else(no_script)?;
    if words.next().is_some() {
        return Err(no_script());
    }
    match version.parse::<u32>() {
        Ok(SCRIPT_VERSION) => Ok(()),
        Ok(0) => Err(no_script()),
        // A number that does not fit in u32 is a newer version too.
        _ => Err(Error::new(
            ErrorKind::Unsupported,
            format!("the script has version {}, this library reads version {SCRIPT_VERSION}", clip(version)),
        )
        .field("line 1, column 1")
        .remedy("Use a newer library, or write the script in the older version")),
    }
}

/// One line of a script.
struct Line<'a> {
    text: &'a str,
    /// From 1.
    number: usize,
}

impl<'a> Line<'a> {
    fn position(&self, word: &str) -> SourcePosition {
        // `word` is a slice of the line, so the difference of their addresses is its byte offset.
        let bytes = (word.as_ptr() as usize).saturating_sub(self.text.as_ptr() as usize).min(self.text.len());
        let column = self.text.get(..bytes).map_or(bytes, |before| before.chars().count()) + 1;
        SourcePosition::Text { line: self.number, column }
    }

    fn error(&self, word: &str, cause: String, remedy: &str) -> Error {
        Error::new(ErrorKind::InvalidArgument, cause).field(self.position(word).to_string()).remedy(remedy)
    }

    /// The words before a comment.
    fn words(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.text.split('#').next().unwrap_or("").split_whitespace()
    }

    /// The empty string at the end of the words, which has the position of a missing word.
    fn end(&self) -> &'a str {
        let text = self.text.split('#').next().unwrap_or("").trim_end();
        &text[text.len()..]
    }

    /// Reads the time `1.5` or the span `1.5..2`, in seconds; returns microseconds.
    fn time(&self, when: &str) -> Result<(u64, Option<u64>)> {
        let micros = |word: &str| {
            let remedy = "Write seconds with at most six decimals, such as 1.5, or a span, such as 1.5..2";
            parse_micros(word).map_err(|cause| self.error(when, cause, remedy))
        };
        match when.split_once("..") {
            None => Ok((micros(when)?, None)),
            Some((from, until)) => {
                let (from, until) = (micros(from)?, micros(until)?);
                if until <= from {
                    return Err(self.error(
                        when,
                        "the span ends before it starts".into(),
                        "Write the earlier time first",
                    ));
                }
                Ok((from, Some(until)))
            }
        }
    }

    fn counts(&self, word: Option<&str>) -> Result<f64> {
        let word = word.unwrap_or_else(|| self.end());
        plain_number(word).ok_or_else(|| {
            let cause = format!("{:?} is no number of counts", clip(word));
            self.error(word, cause, "Write dx and dy as decimal numbers, such as 12 -3.5")
        })
    }
}

struct Reader {
    events: Vec<(ScriptEvent, SourcePosition)>,
    /// The explicit end, and the number of its line.
    end: Option<(u64, usize)>,
}

impl Reader {
    fn read(&mut self, line: &Line<'_>) -> Result<()> {
        if line.text.len() > MAX_LINE {
            let cause = format!("the line has {} bytes", line.text.len());
            return Err(line.error(line.text, cause, &format!("Use at most {MAX_LINE}")));
        }
        let mut words = line.words();
        let Some(when) = words.next() else { return Ok(()) };
        let (at, until) = line.time(when)?;
        let Some(verb) = words.next() else {
            return Err(line.error(line.end(), "a time, but nothing that happens".into(), VERBS));
        };
        let over_span = matches!(verb, "mouse" | "hold");
        match until {
            Some(_) if !over_span => {
                let cause = format!("{:?} happens at one moment, not over a span", clip(verb));
                return Err(line.error(verb, cause, "Write one time, or use hold or mouse"));
            }
            None if verb == "hold" => {
                return Err(line.error(when, "a key is held over a span".into(), "Write it as 1.5..2 hold W"));
            }
            _ => {}
        }
        match verb {
            "down" | "up" | "hold" => {
                let mut any = false;
                for word in words.by_ref() {
                    any = true;
                    let key = Key::from_name(word).ok_or_else(|| {
                        let cause = format!("{:?} is no key", clip(word));
                        line.error(word, cause, "Use names such as W, SPACE, LEFT, MOUSE_LEFT or VK_0x57")
                    })?;
                    let first = if verb == "up" { Action::Up(key) } else { Action::Down(key) };
                    self.add(line, word, at, first)?;
                    if let Some(until) = until {
                        self.add(line, word, until, Action::Up(key))?;
                    }
                }
                if !any {
                    return Err(line.error(line.end(), "no key is named".into(), "Name one or more keys"));
                }
            }
            "mouse" => {
                let motion = [line.counts(words.next())?, line.counts(words.next())?];
                self.add(line, when, at, Action::Mouse { motion, until })?;
            }
            "scroll" => {
                let word = words.next().unwrap_or_else(|| line.end());
                let notches = plain_number(word).filter(|_| !word.contains('.')).and_then(|_| word.parse().ok());
                let notches = notches.ok_or_else(|| {
                    let cause = format!("{:?} is no whole number of notches", clip(word));
                    line.error(word, cause, "Write a whole number such as -1")
                })?;
                self.add(line, word, at, Action::Scroll(notches))?;
            }
            "end" => {
                if let Some((_, number)) = self.end {
                    let cause = format!("the script has ended already on line {number}");
                    return Err(line.error(verb, cause, "Keep one of the two"));
                }
                self.end = Some((at, line.number));
            }
            _ => return Err(line.error(verb, format!("{:?} is nothing that happens", clip(verb)), VERBS)),
        }
        match words.next() {
            Some(extra) => {
                let cause = format!("{:?} is more than the line needs", clip(extra));
                Err(line.error(extra, cause, "Put each event on a line of its own"))
            }
            None => Ok(()),
        }
    }

    fn add(&mut self, line: &Line<'_>, word: &str, at: u64, action: Action) -> Result<()> {
        if self.events.len() >= MAX_EVENTS {
            let cause = "the script has too many events".to_owned();
            return Err(line.error(word, cause, &format!("Use at most {MAX_EVENTS}")));
        }
        self.events.push((ScriptEvent { at, action }, line.position(word)));
        Ok(())
    }
}

const VERBS: &str = "Write one of: down, up, hold, mouse, scroll, end";

/// Reads a decimal number: optional sign, digits, optional point and decimals; no exponent, no word.
fn plain_number(word: &str) -> Option<f64> {
    let digits = word.strip_prefix(['-', '+']).unwrap_or(word);
    let (whole, decimals) = digits.split_once('.').unwrap_or((digits, "0"));
    let all_digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    (word.len() <= 64 && all_digits(whole) && all_digits(decimals)).then(|| word.parse().ok()).flatten()
}
