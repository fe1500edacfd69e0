//! How a world is run: context window, noise schedule, cache mode and clocks.

use std::fmt;
use std::str::FromStr;

use crate::bundle::Geometry;
use crate::world::preset::Preset;
use crate::world::schedule::Schedule;
use crate::world::time::{WorldTime, clip};
use crate::{Error, ErrorKind, Result};

/// The most latents per second of world time.
pub const MAX_LATENT_RATE: u32 = 240;
/// The most pictures presented per second of world time.
pub const MAX_PRESENTED_RATE: u32 = 960;
/// The longest interval of [`CacheMode::Interval`], in generated latents.
pub const MAX_INTERVAL: u32 = 4_096;

/// Where the keys and values come from that a generated latent leaves in the ring.
///
/// An appended picture always runs its own cache pass at sigma 0 and commits, in every mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CacheMode {
    /// Its own forward at sigma 0 with the same controls: the paper's way, and Waypoint's.
    Separate,
    /// Those of the last denoise forward are kept.
    Fused,
    /// As separate, but only generated latents number t with t mod k == 0 commit, t = 1, 2, ... from the first
    /// generated latent; k is 1 to [`MAX_INTERVAL`]. A skipped latent leaves every slot and flag as it was. The ring
    /// clock counts commits, the RoPE clock counts latents.
    Interval(u32),
}

/// Where motion and depth for generated frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum GuidanceSource {
    /// The paper's, from a pair of latents (`guidance::paper`).
    Paper,
}

/// What is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Presentation {
    /// The decoded pictures themselves, at `latents_per_second * pictures_per_latent`.
    Native,
    /// Frames generated between anchors, at this many pictures per second of world time.
    Generated {
        /// Presented pictures per second, more than anchors per second, at most [`MAX_PRESENTED_RATE`].
        rate: u32,
        /// Where motion and depth come from.
        guidance: GuidanceSource,
    },
}

/// How a world is run. Make one from a [`Preset`], from text, or field by field; [`OperatingPoint::check`] says whether
/// it holds together.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatingPoint {
    /// g: the global window in latents, a multiple of the dilation.
    pub global_window: u32,
    /// Noise levels of a latent step.
    pub schedule: Schedule,
    /// What a latent leaves in the ring.
    pub cache_mode: CacheMode,
    /// One latent step stands for the reciprocal of this, in seconds of world time; 1 to [`MAX_LATENT_RATE`].
    pub latents_per_second: u32,
    /// How many of a latent's decoded pictures are used: 1 (the last: the anchor), 2 (second and last) or 4.
    pub pictures_per_latent: u32,
    /// What is shown.
    pub presentation: Presentation,
}

/// How many of what a duration takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Latents, the seed's own included.
    pub latents: u64,
    /// Latent steps: latents less the seed's.
    pub steps: u64,
    /// Decoded pictures that are used, `pictures_per_latent` of each latent.
    pub pictures: u64,
    /// Pictures before world time zero, all of the seed's latent, that are dropped.
    pub dropped: u64,
    /// Frames shown, from world time zero to the end, both included.
    pub presented: u64,
}

impl OperatingPoint {
    /// Checks the point by itself: rates, counts, interval and, where it can be known without a world, the schedule.
    ///
    /// # Errors
    /// `InvalidArgument` with the field that is out of range.
    pub fn check(&self) -> Result<()> {
        let wrong = |field: &str, cause: String, remedy: String| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
        };
        if self.latents_per_second == 0 || self.latents_per_second > MAX_LATENT_RATE {
            return wrong(
                "latents_per_second",
                format!("{} latents per second cannot be made", self.latents_per_second),
                format!("Use 1 to {MAX_LATENT_RATE}"),
            );
        }
        if !matches!(self.pictures_per_latent, 1 | 2 | 4) {
            return wrong(
                "pictures_per_latent",
                format!("{} pictures cannot be taken from a latent", self.pictures_per_latent),
                "Use 1, 2 or 4".into(),
            );
        }
        if let CacheMode::Interval(k) = self.cache_mode
            && (k == 0 || k > MAX_INTERVAL)
        {
            return wrong(
                "cache_mode",
                format!("interval:{k} is out of range"),
                format!("Use interval:1 to interval:{MAX_INTERVAL}"),
            );
        }
        if let Presentation::Generated { rate, .. } = self.presentation {
            if self.pictures_per_latent != 1 {
                return wrong(
                    "presentation",
                    format!("frames are generated between anchors, one a latent, not {}", self.pictures_per_latent),
                    "Use one picture per latent, or present natively".into(),
                );
            }
            if rate <= self.latents_per_second || rate > MAX_PRESENTED_RATE {
                return wrong(
                    "presentation",
                    format!("{} anchors per second cannot be presented as {rate}", self.latents_per_second),
                    format!("Use {} to {MAX_PRESENTED_RATE}, or present natively", self.latents_per_second + 1),
                );
            }
        }
        Ok(())
    }

    /// Checks the point for a world of this geometry.
    ///
    /// # Errors
    /// As [`OperatingPoint::check`], and `InvalidArgument` when g is no multiple of the dilation or past the bundle's
    /// largest window, or when a latent does not decode to a multiple of `pictures_per_latent`.
    pub fn check_for(&self, geometry: &Geometry) -> Result<()> {
        self.check()?;
        global_buckets(geometry, self.global_window)?;
        let temporal = geometry.autoencoder.temporal;
        if temporal == 0 || !temporal.is_multiple_of(self.pictures_per_latent) {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a latent of this world decodes to {temporal} pictures"),
            )
            .field("pictures_per_latent")
            .remedy("Use a number that divides it"));
        }
        Ok(())
    }

    /// Native pictures per second of world time.
    pub fn native_rate(&self) -> u32 {
        self.latents_per_second.saturating_mul(self.pictures_per_latent)
    }

    /// Presented pictures per second of world time.
    pub fn presented_rate(&self) -> u32 {
        match self.presentation {
            Presentation::Native => self.native_rate(),
            Presentation::Generated { rate, .. } => rate,
        }
    }

    /// Pictures of the first latent that lie before world time zero and are not shown.
    pub fn dropped_pictures(&self) -> u32 {
        self.pictures_per_latent.saturating_sub(1)
    }

    /// Which decoded picture is the `i`-th used one, both from 0, of a latent that decodes to `temporal` pictures;
    /// none past the last.
    pub fn decoded_index(&self, i: u32, temporal: u32) -> Option<u32> {
        let every = temporal.checked_div(self.pictures_per_latent).filter(|every| *every > 0)?;
        (i < self.pictures_per_latent).then(|| (i + 1) * every - 1)
    }

    /// When the last picture of latent number `latent` stands: the seed's at zero.
    pub fn time_of_latent(&self, latent: u64) -> WorldTime {
        WorldTime::new(latent, self.latents_per_second)
    }

    /// The world time that latent number `latent` stands for, as start (included) and end (not included): the span
    /// whose controls it is made with. Empty at zero for the seed's latent.
    pub fn span_of_latent(&self, latent: u64) -> (WorldTime, WorldTime) {
        (self.time_of_latent(latent.saturating_sub(1)), self.time_of_latent(latent))
    }

    /// How many latents, pictures and frames show the world from time zero to `duration`, both included.
    pub fn counts(&self, duration: WorldTime) -> Counts {
        let steps = duration.covering_steps(self.latents_per_second);
        let latents = steps.saturating_add(1);
        Counts {
            latents,
            steps,
            pictures: latents.saturating_mul(u64::from(self.pictures_per_latent)),
            dropped: u64::from(self.dropped_pictures()),
            presented: duration.whole_steps(self.presented_rate()).saturating_add(1),
        }
    }
}

/// Buckets of a global layer at window `g`.
///
/// # Errors
/// `InvalidArgument` when g is no positive multiple of the dilation or past the bundle's largest window.
pub fn global_buckets(geometry: &Geometry, g: u32) -> Result<u32> {
    let (dilation, most) = (geometry.global.dilation, geometry.global.max_window);
    if dilation == 0 || g == 0 || !g.is_multiple_of(dilation) || g > most {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("g{g} is no window of this world"))
            .field("global_window")
            .remedy(format!("Use a multiple of {dilation} up to {most}")));
    }
    Ok(g / dilation)
}

impl fmt::Display for CacheMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Separate => f.write_str("separate"),
            Self::Fused => f.write_str("fused"),
            Self::Interval(k) => write!(f, "interval:{k}"),
        }
    }
}

impl FromStr for CacheMode {
    type Err = Error;

    /// Reads `separate`, `fused` or `interval:4`.
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "separate" => return Ok(Self::Separate),
            "fused" => return Ok(Self::Fused),
            _ => {}
        }
        text.strip_prefix("interval:")
            .and_then(|k| k.parse().ok())
            .filter(|k| (1..=MAX_INTERVAL).contains(k))
            .map(Self::Interval)
            .ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, format!("{:?} is no cache mode", clip(text)))
                    .field("cache_mode")
                    .remedy(format!("Write separate, fused, or interval:1 to interval:{MAX_INTERVAL}"))
            })
    }
}

impl fmt::Display for GuidanceSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Paper => f.write_str("paper"),
        }
    }
}

impl FromStr for GuidanceSource {
    type Err = Error;

    /// Reads `paper`.
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "paper" => Ok(Self::Paper),
            _ => Err(Error::new(ErrorKind::InvalidArgument, format!("{:?} is no source of guidance", clip(text)))
                .field("guidance")
                .remedy("Write paper")),
        }
    }
}

impl fmt::Display for Presentation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Native => f.write_str("native"),
            Self::Generated { rate, guidance } => write!(f, "generated:{rate}:{guidance}"),
        }
    }
}

impl FromStr for Presentation {
    type Err = Error;

    /// Reads `native`, `generated:30` or `generated:30:paper`.
    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::new(ErrorKind::InvalidArgument, format!("{:?} is no way to present", clip(text)))
                .field("presentation")
                .remedy("Write native, or generated:30 with the pictures per second")
        };
        if text == "native" {
            return Ok(Self::Native);
        }
        let rest = text.strip_prefix("generated:").ok_or_else(wrong)?;
        let (rate, guidance) = match rest.split_once(':') {
            Some((rate, guidance)) => (rate, guidance.parse()?),
            None => (rest, GuidanceSource::Paper),
        };
        Ok(Self::Generated { rate: rate.parse().map_err(|_| wrong())?, guidance })
    }
}

/// Reads a global window: `g384`, or the bare number.
///
/// # Errors
/// `InvalidArgument` for anything else.
pub fn parse_global_window(text: &str) -> Result<u32> {
    let digits = text.strip_prefix('g').unwrap_or(text);
    digits.parse().ok().filter(|g| *g > 0).ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("{:?} is no window", clip(text)))
            .field("global_window")
            .remedy("Write a number of latents, such as g384")
    })
}

impl fmt::Display for OperatingPoint {
    /// All six items; they read back as the same point.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { global_window, schedule, cache_mode, latents_per_second, pictures_per_latent, presentation } = self;
        write!(
            f,
            "g{global_window},{schedule},{cache_mode},latents:{latents_per_second},pictures:{pictures_per_latent},\
             {presentation}"
        )
    }
}

impl FromStr for OperatingPoint {
    type Err = Error;

    /// Reads items between commas: first a preset's name or nothing (then it starts from `stock`), then what differs:
    /// `coherence,g256,refined:12,interval:4,latents:15,pictures:1,generated:60`. The result passes
    /// [`OperatingPoint::check`].
    fn from_str(text: &str) -> Result<Self> {
        if text.len() > 4_096 {
            return Err(Error::new(ErrorKind::InvalidArgument, "the text is longer than any operating point")
                .field("operating_point"));
        }
        let mut items = text.split(',').map(str::trim).peekable();
        let preset = items.next_if(|first| Preset::from_name(first).is_some()).and_then(Preset::from_name);
        let mut point = preset.unwrap_or(Preset::Stock).operating_point();
        for item in items {
            let (name, value) = item.split_once(':').unwrap_or((item, ""));
            let number = || {
                value.parse::<u32>().map_err(|_| {
                    Error::new(ErrorKind::InvalidArgument, format!("{:?} has no whole number", clip(item)))
                        .field("operating_point")
                })
            };
            match name {
                // `stock` names a preset when it stands first, and the schedule anywhere else.
                "stock" | "refined" | "explicit" => point.schedule = item.parse()?,
                "separate" | "fused" | "interval" => point.cache_mode = item.parse()?,
                "native" | "generated" => point.presentation = item.parse()?,
                "latents" => point.latents_per_second = number()?,
                "pictures" => point.pictures_per_latent = number()?,
                _ if name.starts_with('g') => point.global_window = parse_global_window(item)?,
                _ => {
                    let names: Vec<&str> = Preset::ALL.iter().map(|preset| preset.name()).collect();
                    return Err(Error::new(
                        ErrorKind::InvalidArgument,
                        format!("{:?} is no part of an operating point", clip(item)),
                    )
                    .field("operating_point")
                    .remedy(format!(
                        "Start with a preset ({}) and add what differs: g384, refined:10, separate, latents:15, \
                         pictures:1, native or generated:30",
                        names.join(", ")
                    )));
                }
            }
        }
        point.check()?;
        Ok(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_reads_back_as_the_same_point() {
        for preset in Preset::ALL {
            let point = preset.operating_point();
            assert_eq!(preset.name().parse::<OperatingPoint>().unwrap(), point);
            assert_eq!(point.to_string().parse::<OperatingPoint>().unwrap(), point, "{point}");
        }
        let point: OperatingPoint = "coherence, g256,explicit:1:0.5:0,interval:4,generated:120".parse().unwrap();
        assert_eq!(point.to_string(), "g256,explicit:1:0.5:0,interval:4,latents:15,pictures:1,generated:120:paper");
        assert_eq!(point.to_string().parse::<OperatingPoint>().unwrap(), point);
        let stock: OperatingPoint = "coherence,stock,native".parse().unwrap();
        assert_eq!((stock.schedule, stock.global_window), (Schedule::Stock, 384));
    }

    #[test]
    fn errors_name_the_item_and_a_remedy() {
        for (text, field) in [
            ("", "operating_point"),
            ("nonsense", "operating_point"),
            ("coherence,,g3", "operating_point"),
            ("g", "global_window"),
            ("g0", "global_window"),
            ("g-8", "global_window"),
            ("refined:x", "schedule"),
            ("interval:0", "cache_mode"),
            ("interval:4097", "cache_mode"),
            ("separate:1", "cache_mode"),
            ("latents:0", "latents_per_second"),
            ("latents:241", "latents_per_second"),
            ("latents:x", "operating_point"),
            ("pictures:3", "pictures_per_latent"),
            ("coherence,generated:15", "presentation"),
            ("coherence,generated:961", "presentation"),
            ("coherence,generated:30:magic", "guidance"),
            ("coherence,pictures:2", "presentation"),
            ("native:1", "presentation"),
        ] {
            let error = text.parse::<OperatingPoint>().unwrap_err();
            assert_eq!(error.offending_field(), Some(field), "{text:?}: {error}");
            assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        }
        assert!("g".repeat(5000).parse::<OperatingPoint>().is_err());
    }

    #[test]
    fn used_pictures_are_the_last_of_equal_shares() {
        let of = |pictures_per_latent| {
            let point = OperatingPoint { pictures_per_latent, ..Preset::Stock.operating_point() };
            (0..5).map_while(|i| point.decoded_index(i, 4)).collect::<Vec<_>>()
        };
        assert_eq!((of(1), of(2), of(4)), (vec![3], vec![1, 3], vec![0, 1, 2, 3]));
        assert_eq!(Preset::Stock.operating_point().decoded_index(0, 2), None);
    }

    #[test]
    fn a_latent_ends_where_the_next_begins() {
        for preset in Preset::ALL {
            let point = preset.operating_point();
            assert_eq!(point.span_of_latent(0), (WorldTime::ZERO, WorldTime::ZERO));
            for latent in 1..1000 {
                let (start, end) = point.span_of_latent(latent);
                assert_eq!(start, point.span_of_latent(latent - 1).1);
                assert_eq!(end, WorldTime::new(latent, point.latents_per_second));
            }
        }
    }

    #[test]
    fn odd_durations_are_covered_and_not_overrun() {
        let point = Preset::Coherence.operating_point();
        let of = |micros| point.counts(WorldTime::from_micros(micros));
        assert_eq!(of(0), Counts { latents: 1, steps: 0, pictures: 1, dropped: 0, presented: 1 });
        let c = of(100_000);
        assert_eq!((c.steps, c.presented), (2, 4));
        assert_eq!(of(4_000_000).presented, 121);
        let endless = point.counts(WorldTime::new(u64::MAX, 1));
        assert_eq!(endless.latents, u64::MAX);
    }
}
