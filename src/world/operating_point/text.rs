//! Operating points as text, for command lines, manifests and saved states.

use std::fmt;
use std::str::FromStr;

use super::{CacheMode, GuidanceSource, MAX_INTERVAL, OperatingPoint, Presentation};
use crate::world::preset::Preset;
use crate::world::time::clip;
use crate::{Error, ErrorKind, Result};

impl fmt::Display for CacheMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Separate => f.write_str("separate"),
            Self::Fused => f.write_str("fused"),
            Self::Interval(k) => write!(f, "interval:{k}"),
            Self::Joined => f.write_str("joined"),
        }
    }
}

impl FromStr for CacheMode {
    type Err = Error;

    /// Reads `separate`, `fused`, `interval:4` or `joined`.
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "separate" => return Ok(Self::Separate),
            "fused" => return Ok(Self::Fused),
            "joined" => return Ok(Self::Joined),
            _ => {}
        }
        text.strip_prefix("interval:")
            .and_then(|k| k.parse().ok())
            .filter(|k| (1..=MAX_INTERVAL).contains(k))
            .map(Self::Interval)
            .ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, format!("{:?} is no cache mode", clip(text)))
                    .field("cache_mode")
                    .remedy(format!("Write separate, fused, joined, or interval:1 to interval:{MAX_INTERVAL}"))
            })
    }
}

impl fmt::Display for GuidanceSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Paper => f.write_str("paper"),
            Self::PictureFlow => f.write_str("picture"),
            Self::LatentFlow => f.write_str("latent"),
        }
    }
}

impl FromStr for GuidanceSource {
    type Err = Error;

    /// Reads `paper`, `picture`, `latent`, or `best` for [`GuidanceSource::BEST`].
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "paper" => Ok(Self::Paper),
            "picture" => Ok(Self::PictureFlow),
            "latent" => Ok(Self::LatentFlow),
            "best" => Ok(Self::BEST),
            _ => Err(Error::new(ErrorKind::InvalidArgument, format!("{:?} is no source of guidance", clip(text)))
                .field("guidance")
                .remedy("Write best, picture, latent or paper")),
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

    /// Reads `native`, `generated:30` or `generated:30:paper`. Without a guidance source, the default one is used.
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
            None => (rest, GuidanceSource::default()),
        };
        Ok(Self::Generated { rate: rate.parse().map_err(|_| wrong())?, guidance })
    }
}

impl OperatingPoint {
    /// Sets the presentation from its text form. If the text names no guidance source, the current one stays, or the default one is
    /// used if there is none.
    ///
    /// # Errors
    /// `InvalidArgument` for anything else.
    pub fn set_presentation(&mut self, text: &str) -> Result<()> {
        let mut read: Presentation = text.parse()?;
        let names_source = text.matches(':').count() > 1;
        if let (Presentation::Generated { guidance, .. }, Presentation::Generated { guidance: kept, .. }) =
            (&mut read, self.presentation)
            && !names_source
        {
            *guidance = kept;
        }
        self.presentation = read;
        Ok(())
    }
}

/// Reads a global window: `g384`, or only the number.
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
    /// Writes all six items; reading them gives an equal point.
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

    /// Reads comma-separated items: first a preset's name, or none for `stock`, then the differences from it, such as
    /// `coherence,g256,refined:12,interval:4,latents:15,pictures:1,generated:60`; presentation as in [`OperatingPoint::set_presentation`].
    /// The result passes [`OperatingPoint::check`].
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
                // `stock` is a preset as the first item, and the schedule elsewhere.
                "stock" | "refined" | "explicit" => point.schedule = item.parse()?,
                "separate" | "fused" | "interval" | "joined" => point.cache_mode = item.parse()?,
                "native" | "generated" => point.set_presentation(item)?,
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
    use crate::world::schedule::Schedule;

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
        for (text, shown) in [
            ("coherence,generated:60", "generated:60:paper"),
            ("coherence,generated:60:picture", "generated:60:picture"),
            ("coherence,generated:60:picture,generated:45", "generated:45:picture"),
            ("stock,pictures:1,generated:60", "generated:60:picture"),
            ("stock,pictures:1,generated:60:paper", "generated:60:paper"),
        ] {
            let point: OperatingPoint = text.parse().unwrap();
            assert_eq!(point.presentation.to_string(), shown, "{text}");
            assert_eq!(point.to_string().parse::<OperatingPoint>().unwrap(), point);
        }
        let stock: OperatingPoint = "coherence,stock,native".parse().unwrap();
        assert_eq!((stock.schedule, stock.global_window), (Schedule::Stock, 384));
    }

    #[test]
    fn every_valid_point_reads_back() {
        for seed in 0..2_000 {
            let mut rng = crate::world::fixture::TestRng(seed);
            let mut points: Vec<f64> = (0..rng.below(6)).map(|_| 1.0 / (1.0 + rng.below(999) as f64)).collect();
            points.extend([1.0, 0.0]);
            points.sort_by(|a, b| b.total_cmp(a));
            points.dedup();
            let point = OperatingPoint {
                global_window: 1 + rng.below(5_000) as u32,
                schedule: match rng.below(3) {
                    0 => Schedule::Stock,
                    1 => Schedule::Refined(rng.below(70) as u32),
                    _ => Schedule::Explicit(points),
                },
                cache_mode: match rng.below(4) {
                    0 => CacheMode::Separate,
                    1 => CacheMode::Fused,
                    2 => CacheMode::Joined,
                    _ => CacheMode::Interval(rng.below(5_000) as u32),
                },
                latents_per_second: rng.below(300) as u32,
                pictures_per_latent: rng.below(5) as u32,
                presentation: match rng.below(2) {
                    0 => Presentation::Native,
                    _ => Presentation::Generated {
                        rate: rng.below(1_100) as u32,
                        guidance: match rng.below(3) {
                            0 => GuidanceSource::Paper,
                            1 => GuidanceSource::LatentFlow,
                            _ => GuidanceSource::PictureFlow,
                        },
                    },
                },
            };
            let read = point.to_string().parse::<OperatingPoint>();
            match point.check() {
                Ok(()) => assert_eq!(read.unwrap(), point),
                Err(_) => assert!(read.is_err(), "{point}"),
            }
        }
    }

    #[test]
    fn the_best_source_is_written_with_its_own_name() {
        let point: OperatingPoint = "coherence,generated:30:best".parse().unwrap();
        let Presentation::Generated { guidance, .. } = point.presentation else { panic!("{point}") };
        assert_eq!(guidance, GuidanceSource::BEST);
        assert!(point.to_string().ends_with(&format!(",generated:30:{}", GuidanceSource::BEST)), "{point}");
        assert_eq!(GuidanceSource::BEST, GuidanceSource::default());
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
}
