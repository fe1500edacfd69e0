//! World time: exact fractions of a second, so that steps of 1/15 s never drift.

use std::cmp::Ordering;
use std::fmt;

use crate::{Error, ErrorKind, Result};

/// The latest world time in a script or duration: one day, in whole seconds.
pub const MAX_SECONDS: u64 = 86_400;

/// Microseconds in a second.
pub(crate) const MICROS: u64 = 1_000_000;

/// A point in world time, or a duration: an exact fraction of seconds, never negative.
///
/// Two values are equal if they are the same time, however they were made: 2/30 s is 1/15 s.
#[derive(Clone, Copy)]
pub struct WorldTime {
    ticks: u64,
    per_second: u32,
}

impl WorldTime {
    /// The time of the seed picture.
    pub const ZERO: Self = Self { ticks: 0, per_second: 1 };

    /// `ticks / per_second` seconds; a `per_second` of zero counts as one.
    pub const fn new(ticks: u64, per_second: u32) -> Self {
        Self { ticks, per_second: if per_second == 0 { 1 } else { per_second } }
    }

    /// Whole microseconds.
    pub const fn from_micros(micros: u64) -> Self {
        Self { ticks: micros, per_second: MICROS as u32 }
    }

    /// Reads seconds as a decimal number with at most six decimals, from 0 to [`MAX_SECONDS`]: `2`, `0.25`.
    ///
    /// # Errors
    /// `InvalidArgument` for anything else; signs, exponents and words such as `nan` are refused.
    pub fn parse(text: &str) -> Result<Self> {
        parse_micros(text).map(Self::from_micros).map_err(|cause| {
            Error::new(ErrorKind::InvalidArgument, cause)
                .field("time")
                .remedy(format!("Write seconds from 0 to {MAX_SECONDS} with at most six decimals, such as 2.5"))
        })
    }

    /// Seconds, rounded to f64: for display, not for decisions.
    pub fn seconds(self) -> f64 {
        self.ticks as f64 / f64::from(self.per_second)
    }

    /// This time in microseconds, rounded up; `u64::MAX` if out of range.
    pub fn ceil_micros(self) -> u64 {
        let micros = (u128::from(self.ticks) * u128::from(MICROS)).div_ceil(u128::from(self.per_second));
        u64::try_from(micros).unwrap_or(u64::MAX)
    }

    /// This time in microseconds, rounded down; `u64::MAX` if out of range.
    pub fn floor_micros(self) -> u64 {
        let micros = u128::from(self.ticks) * u128::from(MICROS) / u128::from(self.per_second);
        u64::try_from(micros).unwrap_or(u64::MAX)
    }

    /// Number of steps of `1 / rate` seconds in this duration, rounded down; saturates.
    pub fn whole_steps(self, rate: u32) -> u64 {
        let steps = u128::from(self.ticks) * u128::from(rate) / u128::from(self.per_second);
        u64::try_from(steps).unwrap_or(u64::MAX)
    }

    /// Number of steps of `1 / rate` seconds in this duration, rounded up; saturates.
    pub fn covering_steps(self, rate: u32) -> u64 {
        let steps = (u128::from(self.ticks) * u128::from(rate)).div_ceil(u128::from(self.per_second));
        u64::try_from(steps).unwrap_or(u64::MAX)
    }

    /// Converts `start`, `end` and, by the returned function, microseconds to integers of one unit, so that they can be compared,
    /// subtracted and divided exactly. The unit is a second divided by 10^6 and by both denominators.
    pub(crate) fn to_common_unit(start: Self, end: Self) -> (u128, u128, impl Fn(u64) -> u128) {
        let (a, b) = (u128::from(start.per_second), u128::from(end.per_second));
        let micros = u128::from(MICROS);
        (
            (u128::from(start.ticks) * b).saturating_mul(micros),
            (u128::from(end.ticks) * a).saturating_mul(micros),
            move |m| u128::from(m).saturating_mul(a * b),
        )
    }
}

/// Parses decimal seconds to microseconds. The error is the cause alone, without field or remedy.
pub(crate) fn parse_micros(text: &str) -> std::result::Result<u64, String> {
    let bad = || format!("{:?} is no time in seconds", clip(text));
    let (whole, decimals) = text.split_once('.').unwrap_or((text, "0"));
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    if !digits(whole) || !digits(decimals) {
        return Err(bad());
    }
    if decimals.len() > 6 {
        return Err(format!("{:?} has more than six decimals", clip(text)));
    }
    let whole: u64 = whole.parse().map_err(|_| bad())?;
    let micros: u64 = format!("{decimals:0<6}").parse().map_err(|_| bad())?;
    let total = whole.checked_mul(MICROS).and_then(|w| w.checked_add(micros));
    match total {
        Some(total) if total <= MAX_SECONDS * MICROS => Ok(total),
        _ => Err(format!("{:?} is later than {MAX_SECONDS} seconds", clip(text))),
    }
}

/// Writes microseconds as decimal seconds, as short as possible.
pub(crate) fn format_micros(micros: u64) -> String {
    let (whole, part) = (micros / MICROS, micros % MICROS);
    if part == 0 {
        return whole.to_string();
    }
    format!("{whole}.{part:06}").trim_end_matches('0').to_owned()
}

/// The first 40 characters of untrusted text, for a message.
pub(crate) fn clip(text: &str) -> &str {
    match text.char_indices().nth(40) {
        Some((end, _)) => &text[..end],
        None => text,
    }
}

impl PartialEq for WorldTime {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for WorldTime {}

impl PartialOrd for WorldTime {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for WorldTime {
    fn cmp(&self, other: &Self) -> Ordering {
        let left = u128::from(self.ticks) * u128::from(other.per_second);
        left.cmp(&(u128::from(other.ticks) * u128::from(self.per_second)))
    }
}

impl fmt::Debug for WorldTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{} s", self.ticks, self.per_second)
    }
}

impl fmt::Display for WorldTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} s", self.seconds())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_times_compare_equal_however_made() {
        assert_eq!(WorldTime::new(2, 30), WorldTime::new(1, 15));
        assert_eq!(WorldTime::from_micros(1_500_000), WorldTime::new(3, 2));
        assert!(WorldTime::new(1, 15) > WorldTime::from_micros(66_666));
        assert!(WorldTime::new(1, 15) < WorldTime::from_micros(66_667));
        assert_eq!(WorldTime::new(5, 0), WorldTime::new(5, 1));
    }

    #[test]
    fn steps_are_counted_exactly_over_a_day() {
        for rate in [15, 30, 60] {
            let day = WorldTime::new(MAX_SECONDS, 1);
            assert_eq!(day.whole_steps(rate), MAX_SECONDS * u64::from(rate));
            let last = WorldTime::new(MAX_SECONDS * u64::from(rate) - 1, rate);
            assert_eq!(last.whole_steps(rate), MAX_SECONDS * u64::from(rate) - 1);
        }
        assert_eq!(WorldTime::parse("0.1").unwrap().whole_steps(15), 1);
        assert_eq!(WorldTime::parse("0.1").unwrap().covering_steps(15), 2);
        assert_eq!(WorldTime::new(1, 15).covering_steps(15), 1);
    }

    #[test]
    fn decimal_seconds_read_and_write_to_the_microsecond() {
        for (text, micros, canonical) in
            [("0", 0, "0"), ("2.50", 2_500_000, "2.5"), ("0.000001", 1, "0.000001"), ("86400", 86_400_000_000, "86400")]
        {
            assert_eq!(parse_micros(text), Ok(micros));
            assert_eq!(format_micros(micros), canonical);
        }
        for bad in ["", ".", "1.", ".5", "-1", "+1", "1e3", "nan", "inf", "1.0000001", "86400.000001", "1 ", "١"] {
            assert!(parse_micros(bad).is_err(), "{bad:?}");
        }
        assert!(parse_micros(&"9".repeat(400)).is_err());
    }

    #[test]
    fn the_first_microsecond_of_a_step_is_in_it() {
        for q in 0..1000 {
            let micros = WorldTime::from_micros(WorldTime::new(q, 15).ceil_micros());
            assert!(micros >= WorldTime::new(q, 15) && micros < WorldTime::new(q + 1, 15));
        }
        assert_eq!(WorldTime::new(u64::MAX, 1).ceil_micros(), u64::MAX);
        assert_eq!((WorldTime::new(1, 15).floor_micros(), WorldTime::new(1, 15).ceil_micros()), (66_666, 66_667));
        assert_eq!((WorldTime::new(3, 15).floor_micros(), WorldTime::new(3, 15).ceil_micros()), (200_000, 200_000));
    }
}
