//! How a world is run: context window, noise schedule, cache mode and clocks.

mod text;

use crate::bundle::Geometry;
use crate::world::schedule::Schedule;
use crate::world::time::WorldTime;
use crate::{Error, ErrorKind, Result};

pub use text::parse_global_window;

/// Maximum latents per second of world time.
pub const MAX_LATENT_RATE: u32 = 240;
/// Maximum pictures presented per second of world time.
pub const MAX_PRESENTED_RATE: u32 = 960;
/// Maximum interval of [`CacheMode::Interval`], in generated latents.
pub const MAX_INTERVAL: u32 = 4_096;

/// Which keys and values a generated latent commits to the ring.
///
/// An appended picture always has its own cache pass at sigma 0 and commits, in every mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CacheMode {
    /// A separate forward pass at sigma 0 with the same controls, as in the paper and in Waypoint.
    Separate,
    /// The keys and values of the last denoise pass.
    Fused,
    /// As separate, but only every k-th generated latent commits, the first one being number 1; k is 1 to [`MAX_INTERVAL`]. A
    /// latent that does not commit changes no slot and no flag. The ring clock counts commits, the RoPE clock counts latents.
    Interval(u32),
    /// As separate, but the cache pass of each latent runs together with the first denoise pass of the next, which reads all weights once less.
    /// Latents are those of separate but for rounding. The world must be loaded with [`WorldOptions::joined`](crate::world::WorldOptions::joined).
    Joined,
}

/// Source of motion and depth for generated frames.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum GuidanceSource {
    /// The paper's method, from a pair of latents (`guidance::paper`).
    Paper,
    /// Optical flow between a pair of decoded anchors (`guidance::picture_flow`). The default source, except in the paper's
    /// presets.
    #[default]
    PictureFlow,
    /// Correspondence between a pair of latents (`guidance::latent_flow`).
    LatentFlow,
}

impl GuidanceSource {
    /// The source with the nearest frames on the scenes of this repository, of those that need only anchors: `docs/motion.md`.
    pub const BEST: Self = Self::PictureFlow;
}

/// Which pictures are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Presentation {
    /// The decoded pictures themselves, at `latents_per_second * pictures_per_latent`.
    Native,
    /// Frames generated between anchors, at this many pictures per second of world time.
    Generated {
        /// Presented pictures per second, more than anchors per second, at most [`MAX_PRESENTED_RATE`].
        rate: u32,
        /// Source of motion and depth.
        guidance: GuidanceSource,
    },
}

/// How a world is run. Make one from a [`Preset`](crate::world::Preset), from text, or field by field; [`OperatingPoint::check`]
/// checks that it is valid.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatingPoint {
    /// g: the global window in latents, a multiple of the dilation.
    pub global_window: u32,
    /// Noise levels of a latent step.
    pub schedule: Schedule,
    /// Which keys and values a latent commits to the ring.
    pub cache_mode: CacheMode,
    /// Latents per second of world time, 1 to [`MAX_LATENT_RATE`]; one latent step is the reciprocal of this in seconds.
    pub latents_per_second: u32,
    /// How many of a latent's decoded pictures are used: 1 (the last: the anchor), 2 (second and last) or 4.
    pub pictures_per_latent: u32,
    /// Which pictures are shown.
    pub presentation: Presentation,
}

/// Numbers of latents, pictures and frames for a duration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Latents, the seed's own included.
    pub latents: u64,
    /// Latent steps: all latents but the seed's.
    pub steps: u64,
    /// Decoded pictures that are used, `pictures_per_latent` of each latent.
    pub pictures: u64,
    /// Pictures of the seed's latent before world time zero, which are not shown.
    pub dropped: u64,
    /// Frames shown, from world time zero to the end, both included.
    pub presented: u64,
}

impl OperatingPoint {
    /// Checks rates, counts, interval and presentation, without a world.
    ///
    /// # Errors
    /// `InvalidArgument`, with the field that is out of range.
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
    /// As [`OperatingPoint::check`], and `InvalidArgument` when g is not a multiple of the dilation or exceeds the bundle's largest
    /// window, or when a latent does not decode to a multiple of `pictures_per_latent`.
    pub fn check_for(&self, geometry: &Geometry) -> Result<()> {
        self.check()?;
        geometry.check_window(self.global_window)?;
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

    /// Number of pictures of the first latent before world time zero, which are not shown.
    pub fn dropped_pictures(&self) -> u32 {
        self.pictures_per_latent.saturating_sub(1)
    }

    /// Index of the decoded picture that is the `i`-th used one, both from 0, of a latent that decodes to `temporal` pictures;
    /// `None` past the last.
    pub fn decoded_index(&self, i: u32, temporal: u32) -> Option<u32> {
        let every = temporal.checked_div(self.pictures_per_latent).filter(|every| *every > 0)?;
        (i < self.pictures_per_latent).then(|| (i + 1) * every - 1)
    }

    /// World time of the last picture of latent number `latent`; the seed's is zero.
    pub fn time_of_latent(&self, latent: u64) -> WorldTime {
        WorldTime::new(latent, self.latents_per_second)
    }

    /// The world time span of latent number `latent`, as start (included) and end (not included); its controls come from this span.
    /// Empty at zero for the seed's latent.
    pub fn span_of_latent(&self, latent: u64) -> (WorldTime, WorldTime) {
        (self.time_of_latent(latent.saturating_sub(1)), self.time_of_latent(latent))
    }

    /// Numbers of latents, pictures and frames that show the world from time zero to `duration`, both included.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::preset::Preset;

    #[test]
    fn used_pictures_are_evenly_spaced_and_end_with_the_last() {
        let indices = |pictures_per_latent| {
            let point = OperatingPoint { pictures_per_latent, ..Preset::Stock.operating_point() };
            (0..5).map_while(|i| point.decoded_index(i, 4)).collect::<Vec<_>>()
        };
        assert_eq!((indices(1), indices(2), indices(4)), (vec![3], vec![1, 3], vec![0, 1, 2, 3]));
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
    fn durations_between_steps_are_covered() {
        let point = Preset::Coherence.operating_point();
        let counts = |micros| point.counts(WorldTime::from_micros(micros));
        assert_eq!(counts(0), Counts { latents: 1, steps: 0, pictures: 1, dropped: 0, presented: 1 });
        let short = counts(100_000);
        assert_eq!((short.steps, short.presented), (2, 4));
        assert_eq!(counts(4_000_000).presented, 121);
        let endless = point.counts(WorldTime::new(u64::MAX, 1));
        assert_eq!(endless.latents, u64::MAX);
    }
}
