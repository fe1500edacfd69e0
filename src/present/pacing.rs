//! Which frame is due at a time, when anchors arrive at irregular times.
//!
//! A [`Timeline`](super::timeline::Timeline) knows all times in advance; here anchors are pushed one by one, some of them
//! late, and the caller requests the frame that is due at a time. All times are whole nanoseconds on the caller's clock:
//!
//! ```text
//! anchor i is due at   origin + i I         I: the interval of anchors, origin: the first one's arrival + the delay
//! position at a time   floor((time - origin) m / I), not below 0              m: frames per anchor
//! frame of position p  p % m frames after anchor p / m
//! ```
//!
//! A frame between two anchors is generated if both have arrived. Otherwise the last anchor is extrapolated for at most one
//! interval, and then held. An anchor that arrives after it was due moves the origin so that it is due on arrival: a world
//! that is too slow delays the stream, and no frame is skipped.

use crate::{Error, ErrorKind, Result};

/// Nanoseconds in a second.
const SECOND: u64 = 1_000_000_000;

/// The longest interval between anchors, and the longest delay: a minute.
pub const MAX_INTERVAL_NS: u64 = 60 * SECOND;

/// The time from one anchor to the next, exact even if it is no whole number of nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interval {
    /// Length of [`parts`](Self::parts) intervals together, in nanoseconds.
    ns: u64,
    parts: u64,
}

impl Interval {
    /// The interval of `rate` anchors per second.
    ///
    /// # Errors
    /// `InvalidArgument` for a rate of 0.
    pub fn per_second(rate: u32) -> Result<Self> {
        match rate {
            0 => Err(Error::new(ErrorKind::InvalidArgument, "no anchors come at a rate of 0").field("rate")),
            rate => Ok(Self { ns: SECOND, parts: rate.into() }),
        }
    }

    /// Anchors that are `ns` nanoseconds apart, 1 to [`MAX_INTERVAL_NS`].
    ///
    /// # Errors
    /// `InvalidArgument` for an interval outside that range.
    pub fn of_ns(ns: u64) -> Result<Self> {
        match ns {
            1..=MAX_INTERVAL_NS => Ok(Self { ns, parts: 1 }),
            _ => Err(Error::new(ErrorKind::InvalidArgument, format!("anchors cannot be {ns} nanoseconds apart"))
                .field("interval_ns")
                .remedy(format!("Use 1 to {MAX_INTERVAL_NS}"))),
        }
    }

    /// Its length, rounded up to whole nanoseconds.
    pub fn ns(self) -> u64 {
        self.ns.div_ceil(self.parts)
    }

    /// When position `position` begins, in nanoseconds after position 0, rounded up; there are `multiplier` positions per interval.
    fn start(self, position: u64, multiplier: u32) -> i128 {
        let numerator = u128::from(position) * u128::from(self.ns);
        // `ns` is at most 6e10, so the product is below 2^100 and fits into an i128.
        numerator.div_ceil(u128::from(self.parts) * u128::from(multiplier)).cast_signed()
    }

    /// The position at `ns` nanoseconds after position 0; 0 before it.
    fn position(self, ns: i128, multiplier: u32) -> u64 {
        let Ok(ns) = u64::try_from(ns.max(0)) else { return u64::MAX };
        let position = u128::from(ns) * u128::from(self.parts * u64::from(multiplier)) / u128::from(self.ns);
        u64::try_from(position).unwrap_or(u64::MAX)
    }
}

/// How a stream is paced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pacing {
    /// Frames per anchor: 1 shows anchors only.
    pub multiplier: u32,
    /// How long after its arrival an anchor is due, in nanoseconds: the slack for late anchors. In-between frames need the next
    /// anchor, so use at least (multiplier - 1) / multiplier of an interval to miss none.
    pub delay_ns: u64,
    /// After a stall, shows frames earlier by a quarter of a frame's duration per anchor, until anchors are due `delay_ns` after
    /// their arrival again.
    pub catch_up: bool,
}

/// The frame that is due and its times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Due {
    /// Position in the stream, `multiplier` positions per anchor. It steps back when a late anchor arrives.
    pub position: u64,
    /// When it became due.
    pub since_ns: u64,
    /// When the next one is due, unless an anchor arrives late.
    pub until_ns: u64,
    /// The frame to show.
    pub frame: DueFrame,
}

/// The frame to show; anchors are numbered from 0 in the order they were pushed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DueFrame {
    /// An anchor itself.
    Anchor(u64),
    /// The frame `step / multiplier` of the way from anchor `previous` to the next.
    Interpolate {
        /// The earlier anchor.
        previous: u64,
        /// 1 to `multiplier - 1`.
        step: u32,
    },
    /// The next anchor is late: the frame extrapolated by `step / multiplier` of an interval from the last.
    Extrapolate {
        /// The last anchor.
        last: u64,
        /// 1 to `multiplier`.
        step: u32,
    },
    /// The next anchor is late by more than an interval.
    Stalled {
        /// The last anchor.
        last: u64,
    },
}

/// Paces a stream. It depends on its arguments only and reads no clock of its own.
#[derive(Debug, Clone)]
pub struct Pacer {
    interval: Interval,
    pacing: Pacing,
    /// When position 0 is due; `None` before the first anchor.
    origin: Option<i128>,
    anchors: u64,
    late: u64,
    slipped_ns: u64,
    /// The latest time passed so far: times read on two threads may come in the wrong order.
    now: u64,
}

impl Pacer {
    /// A pacer for anchors that arrive once per `interval`.
    ///
    /// # Errors
    /// `InvalidArgument` for a multiplier of 0 or above 64, or a delay above [`MAX_INTERVAL_NS`].
    pub fn new(interval: Interval, pacing: Pacing) -> Result<Self> {
        if !(1..=64).contains(&pacing.multiplier) {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("there cannot be {} frames to an anchor", pacing.multiplier),
            )
            .field("multiplier")
            .remedy("Use 1 to 64"));
        }
        if pacing.delay_ns > MAX_INTERVAL_NS {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a delay of {} nanoseconds", pacing.delay_ns))
                .field("delay_ns")
                .remedy(format!("Use at most {MAX_INTERVAL_NS}")));
        }
        Ok(Self { interval, pacing, origin: None, anchors: 0, late: 0, slipped_ns: 0, now: 0 })
    }

    /// Anchors pushed.
    pub fn anchors(&self) -> u64 {
        self.anchors
    }

    /// Anchors that arrived after they were due.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// How far late anchors have moved the origin, in nanoseconds.
    pub fn slipped_ns(&self) -> u64 {
        self.slipped_ns
    }

    /// Records the arrival of an anchor at `now`.
    pub fn push(&mut self, now: u64) {
        let now = self.advance(now);
        let after = self.interval.start(self.anchors, 1);
        match &mut self.origin {
            None => self.origin = Some(i128::from(now) + i128::from(self.pacing.delay_ns)),
            Some(origin) => {
                let early = *origin + after - i128::from(now);
                if early < 0 {
                    *origin -= early;
                    self.late += 1;
                    self.slipped_ns = self.slipped_ns.saturating_add(u64::try_from(-early).unwrap_or(u64::MAX));
                } else if self.pacing.catch_up {
                    let sooner = i128::from(self.interval.ns() / (4 * u64::from(self.pacing.multiplier)));
                    *origin -= sooner.min((early - i128::from(self.pacing.delay_ns)).max(0));
                }
            }
        }
        self.anchors += 1;
    }

    /// The frame that is due at `now`; `None` before the first anchor arrived. Until the first anchor is due, it is that anchor.
    pub fn due(&mut self, now: u64) -> Option<Due> {
        let now = self.advance(now);
        let origin = self.origin?;
        let multiplier = self.pacing.multiplier;
        let position = self.interval.position(i128::from(now) - origin, multiplier);
        let (anchor, step) = (position / u64::from(multiplier), (position % u64::from(multiplier)) as u32);
        let last = self.anchors - 1;
        let steps = position.saturating_sub(last.saturating_mul(multiplier.into()));
        let frame = match u32::try_from(steps) {
            Ok(0) if step == 0 => DueFrame::Anchor(anchor),
            Ok(0) => DueFrame::Interpolate { previous: anchor, step },
            Ok(step) if step <= multiplier => DueFrame::Extrapolate { last, step },
            _ => DueFrame::Stalled { last },
        };
        let at =
            |position| u64::try_from((origin + self.interval.start(position, multiplier)).max(0)).unwrap_or(u64::MAX);
        Some(Due { position, since_ns: at(position), until_ns: at(position.saturating_add(1)), frame })
    }

    /// Anchors that have arrived and are not due yet.
    pub fn waiting(&mut self, now: u64) -> u64 {
        let Some(due) = self.due(now) else { return 0 };
        self.anchors.saturating_sub(1 + due.position / u64::from(self.pacing.multiplier))
    }

    /// Discards the anchors and their times; the next anchor is the first again. Counters are kept.
    pub fn reset(&mut self) {
        self.origin = None;
        self.anchors = 0;
    }

    /// The latest time so far, so that time never runs backwards.
    fn advance(&mut self, now: u64) -> u64 {
        self.now = self.now.max(now);
        self.now
    }
}

#[cfg(test)]
mod tests;
