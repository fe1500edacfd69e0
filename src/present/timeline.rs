//! Schedule of a stream: which picture is shown at which time.
//!
//! A rollout makes latents, a latent decodes to pictures, and a stream presents frames at a steady rate. This module is
//! the arithmetic between them, exact and without any state:
//!
//! - A **native** stream shows decoded pictures one by one, after leaving out the first few.
//! - A **generated** stream shows an anchor (a latent's last picture) when one is due, and otherwise the picture at the phase between the two
//!   anchors around it. Presentation frame k is at k / rate seconds after the first anchor.

use std::ops::Range;

use crate::world::{OperatingPoint, Presentation};
use crate::{Error, ErrorKind, Result};

/// Kind of stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stream {
    /// Decoded pictures only, after the first `dropped` ones. The presentation rate is that of the pictures.
    Native {
        /// Leading pictures that are not shown.
        dropped: u32,
    },
    /// Anchors, and generated frames between them.
    Generated {
        /// Frames shown in a second; need not be a multiple of the anchor rate.
        rate: u32,
    },
}

/// The timeline of one stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeline {
    latents_per_second: u32,
    pictures_per_latent: u32,
    stream: Stream,
}

/// One frame as it is presented.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PresentedFrame {
    /// Index in the stream, from 0.
    pub index: u64,
    /// When it is due, in seconds after frame 0.
    pub time: f64,
    /// Where the picture comes from.
    pub source: Source,
}

/// Where a presented picture comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// A picture the autoencoder decoded.
    Native {
        /// Number of the latent, from 0 for the seed's own.
        latent: u64,
        /// Index among the latent's requested pictures, from 0.
        picture: u32,
    },
    /// A picture between two anchors.
    Generated {
        /// Latent of the earlier anchor.
        previous_latent: u64,
        /// Latent of the later anchor; the one after `previous_latent`.
        current_latent: u64,
        /// Phase inside (0, 1).
        t: f32,
    },
}

impl Timeline {
    /// A timeline for latents that come at `latents_per_second` of world time and decode to `pictures_per_latent` each.
    ///
    /// # Errors
    /// `InvalidArgument` when a rate or count is 0, or a generated stream is requested for more than one picture per
    /// latent: guidance belongs to pairs of anchors.
    pub fn new(latents_per_second: u32, pictures_per_latent: u32, stream: Stream) -> Result<Self> {
        let refuse = |field: &str, cause: &str| Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
        if latents_per_second == 0 {
            return refuse("latents_per_second", "no latents come at a rate of 0");
        }
        if pictures_per_latent == 0 {
            return refuse("pictures_per_latent", "a latent decodes to one picture at least");
        }
        if let Stream::Generated { rate } = stream {
            if rate == 0 {
                return refuse("rate", "no frame is presented at a rate of 0");
            }
            if pictures_per_latent != 1 {
                return refuse("pictures_per_latent", "frames are generated between anchors, one picture per latent");
            }
        }
        Ok(Self { latents_per_second, pictures_per_latent, stream })
    }

    /// The timeline of an operating point. A native stream leaves out the pictures before world time zero.
    ///
    /// # Errors
    /// As [`OperatingPoint::check`].
    pub fn of(point: &OperatingPoint) -> Result<Self> {
        point.check()?;
        let stream = match point.presentation {
            Presentation::Native => Stream::Native { dropped: point.dropped_pictures() },
            Presentation::Generated { rate, .. } => Stream::Generated { rate },
        };
        Self::new(point.latents_per_second, point.pictures_per_latent, stream)
    }

    /// Frames presented in a second.
    pub fn rate(&self) -> u64 {
        match self.stream {
            Stream::Native { .. } => u64::from(self.latents_per_second) * u64::from(self.pictures_per_latent),
            Stream::Generated { rate } => u64::from(rate),
        }
    }

    /// How many frames `latents` latents suffice for, the seed's own included.
    pub fn frame_count(&self, latents: u64) -> u64 {
        let count = match self.stream {
            Stream::Native { dropped } => {
                (u128::from(latents) * u128::from(self.pictures_per_latent)).saturating_sub(u128::from(dropped))
            }
            Stream::Generated { .. } if latents == 0 => 0,
            Stream::Generated { rate } => {
                u128::from(latents - 1) * u128::from(rate) / u128::from(self.latents_per_second) + 1
            }
        };
        u64::try_from(count).unwrap_or(u64::MAX)
    }

    /// The frames that can be shown once latent number `latent` is available, and not before.
    pub fn frames_completed_by(&self, latent: u64) -> Range<u64> {
        self.frame_count(latent)..self.frame_count(latent.saturating_add(1))
    }

    /// Frame number `index`.
    pub fn frame(&self, index: u64) -> PresentedFrame {
        let source = match self.stream {
            Stream::Native { dropped } => {
                let picture = u128::from(index) + u128::from(dropped);
                let per_latent = u128::from(self.pictures_per_latent);
                Source::Native { latent: (picture / per_latent) as u64, picture: (picture % per_latent) as u32 }
            }
            Stream::Generated { rate } => {
                // The position on the anchors' clock, as a whole number and a fraction of `rate`.
                let position = u128::from(index) * u128::from(self.latents_per_second);
                let (previous, part) = (position / u128::from(rate), position % u128::from(rate));
                let previous_latent = u64::try_from(previous).unwrap_or(u64::MAX);
                match part {
                    0 => Source::Native { latent: previous_latent, picture: 0 },
                    part => Source::Generated {
                        previous_latent,
                        current_latent: previous_latent.saturating_add(1),
                        t: phase(part as u32, rate),
                    },
                }
            }
        };
        PresentedFrame { index, time: index as f64 / self.rate() as f64, source }
    }

    /// All frames that `latents` latents suffice for.
    pub fn frames(&self, latents: u64) -> impl ExactSizeIterator<Item = PresentedFrame> + use<> {
        let timeline = *self;
        let count = usize::try_from(self.frame_count(latents)).unwrap_or(usize::MAX);
        (0..count).map(move |index| timeline.frame(index as u64))
    }
}

/// `part / rate`, clamped to the open interval (0, 1) against rounding.
fn phase(part: u32, rate: u32) -> f32 {
    let t = (f64::from(part) / f64::from(rate)) as f32;
    t.clamp(f32::MIN_POSITIVE, 1.0 - f32::EPSILON / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Preset, WorldTime};

    fn native(latents_per_second: u32, pictures_per_latent: u32, dropped: u32) -> Timeline {
        Timeline::new(latents_per_second, pictures_per_latent, Stream::Native { dropped }).unwrap()
    }

    fn generated(latents_per_second: u32, rate: u32) -> Timeline {
        Timeline::new(latents_per_second, 1, Stream::Generated { rate }).unwrap()
    }

    #[test]
    fn the_counts_and_rates_of_the_clock_table() {
        for (preset, latents, frames, rate) in [
            (Preset::Coherence, 226, 451, 30),
            (Preset::Baseline128, 226, 451, 30),
            (Preset::Baseline112, 226, 451, 30),
            (Preset::BaselineDoubled, 451, 451, 30),
            (Preset::Decoded60, 226, 901, 60),
            (Preset::Heavy, 226, 451, 30),
            (Preset::Stock, 226, 901, 60),
        ] {
            let point = preset.operating_point();
            let timeline = Timeline::of(&point).unwrap();
            assert_eq!((timeline.frame_count(latents), timeline.rate()), (frames, rate), "{preset:?}");
            assert_eq!(timeline.frames(latents).len() as u64, frames, "{preset:?}");
            // The operating point computes the counts independently.
            let counts = point.counts(WorldTime::new(15, 1));
            assert_eq!((counts.latents, counts.presented), (latents, frames), "{preset:?}");
        }
    }

    #[test]
    fn an_inconsistent_operating_point_is_refused() {
        let mut point = Preset::Coherence.operating_point();
        point.pictures_per_latent = 2;
        assert!(Timeline::of(&point).is_err());
    }

    #[test]
    fn a_doubled_stream_alternates_anchors_and_middles() {
        let frames: Vec<_> = generated(15, 30).frames(226).collect();
        let natives = frames.iter().filter(|f| matches!(f.source, Source::Native { .. })).count();
        assert_eq!((natives, frames.len() - natives), (226, 225));
        assert_eq!(frames[0].source, Source::Native { latent: 0, picture: 0 });
        assert_eq!(frames[449].source, Source::Generated { previous_latent: 224, current_latent: 225, t: 0.5 });
        assert_eq!(
            frames[450],
            PresentedFrame { index: 450, time: 15.0, source: Source::Native { latent: 225, picture: 0 } }
        );
    }

    #[test]
    fn every_stream_of_fifteen_seconds_ends_on_the_same_picture_at_the_same_time() {
        for (timeline, latents) in
            [(generated(15, 30), 226), (native(15, 2, 1), 226), (native(15, 4, 3), 226), (native(30, 1, 0), 451)]
        {
            let last = timeline.frames(latents).last().unwrap();
            assert_eq!(last.time, 15.0);
            let Source::Native { latent, picture } = last.source else { panic!("{last:?}") };
            assert_eq!((latent, picture), (latents - 1, timeline.pictures_per_latent - 1));
        }
    }

    #[test]
    fn dropping_leaves_the_first_pictures_out() {
        let pictures: Vec<_> = native(15, 4, 3).frames(2).map(|f| f.source).collect();
        let native = |latent, picture| Source::Native { latent, picture };
        assert_eq!(pictures, [native(0, 3), native(1, 0), native(1, 1), native(1, 2), native(1, 3)]);
        assert_eq!(super::tests::native(15, 4, 3).frame_count(0), 0);
    }

    #[test]
    fn any_rate_gets_its_phases() {
        let phases = |rate| -> Vec<_> {
            generated(15, rate)
                .frames(2)
                .map(|f| match f.source {
                    Source::Native { .. } => 0.0,
                    Source::Generated { t, .. } => t,
                })
                .collect()
        };
        assert_eq!(phases(60), [0.0, 0.25, 0.5, 0.75, 0.0]);
        assert_eq!(phases(45), [0.0, 1.0 / 3.0, 2.0 / 3.0, 0.0]);
        assert_eq!(phases(24), [0.0, 0.625]);
        assert_eq!(phases(15), [0.0, 0.0]);
        assert_eq!(generated(15, 144).frame_count(16), 145);
        assert_eq!(generated(15, 10).frame_count(4), 3);
    }

    #[test]
    fn frames_arrive_with_the_latents_that_complete_them() {
        for timeline in [generated(15, 30), generated(15, 144), generated(15, 10), native(15, 4, 3), native(15, 2, 1)] {
            let mut next = 0;
            for latent in 0..40 {
                let completed = timeline.frames_completed_by(latent);
                assert_eq!(completed.start, next);
                next = completed.end;
                for index in completed {
                    let (Source::Native { latent: newest, .. } | Source::Generated { current_latent: newest, .. }) =
                        timeline.frame(index).source;
                    // A stream slower than the anchors may show one that arrived earlier.
                    assert!(newest <= latent, "frame {index} of {timeline:?} needs latent {newest}");
                }
            }
            assert_eq!(next, timeline.frame_count(40));
        }
    }

    #[test]
    fn distant_frames_neither_overflow_nor_leave_the_phase_range() {
        let timeline = generated(u32::MAX, u32::MAX - 1);
        assert!(timeline.frame(u64::MAX).time.is_finite());
        assert_eq!(timeline.frame_count(u64::MAX), u64::MAX - 4_294_967_297);
        let Source::Generated { t, .. } = generated(1, u32::MAX).frame(u64::from(u32::MAX) - 1).source else {
            panic!("a phase")
        };
        assert!(t < 1.0);
    }

    #[test]
    fn invalid_clocks_are_refused() {
        let field = |r: Result<Timeline>| r.unwrap_err().offending_field().map(str::to_owned);
        assert_eq!(field(Timeline::new(0, 1, Stream::Native { dropped: 0 })), Some("latents_per_second".into()));
        assert_eq!(field(Timeline::new(15, 0, Stream::Native { dropped: 0 })), Some("pictures_per_latent".into()));
        assert_eq!(field(Timeline::new(15, 1, Stream::Generated { rate: 0 })), Some("rate".into()));
        assert_eq!(field(Timeline::new(15, 2, Stream::Generated { rate: 30 })), Some("pictures_per_latent".into()));
    }
}
