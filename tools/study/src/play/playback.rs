//! Frames on the display: a presenter, made anew when the pace or the number of frames changes, without a jump.

use std::sync::Arc;

use cairn::framegen::FrameGenerator;
use cairn::framegen::cpu::CpuGenerator;
use cairn::guidance::Guidance;
use cairn::present::pacing::{Interval, MAX_INTERVAL_NS};
use cairn::present::presenter::{FrameInfo, Presenter, PresenterOptions};
use cairn::world::KeptAnchor;
use cairn::{Picture, Result};

use super::pacing::Pace;

/// Numbers of frames per anchor to choose from.
pub(crate) const MULTIPLIERS: [u32; 9] = [1, 2, 3, 4, 6, 8, 12, 16, 24];

/// Frames between anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InBetweenMode {
    /// Generated from the two anchors.
    Generated,
    /// The pictures that the world's decoder made.
    Decoded,
    /// None: each anchor is held until the next.
    Nothing,
}

impl InBetweenMode {
    pub(super) fn next(self) -> Self {
        match self {
            Self::Generated => Self::Decoded,
            Self::Decoded => Self::Nothing,
            Self::Nothing => Self::Generated,
        }
    }

    /// Description for the status line.
    pub(super) fn describe(self, multiplier: u32, pictures: u32) -> String {
        match self {
            Self::Generated if multiplier > 1 => format!("anchors and {} generated frames after each", multiplier - 1),
            Self::Decoded if pictures > 1 => format!("all {pictures} pictures of a latent"),
            _ => "anchors only".to_owned(),
        }
    }
}

/// The next larger or smaller multiplier.
pub(super) fn next_multiplier(multiplier: u32, larger: bool) -> u32 {
    let found = match larger {
        true => MULTIPLIERS.into_iter().find(|m| *m > multiplier),
        false => MULTIPLIERS.into_iter().rev().find(|m| *m < multiplier),
    };
    found.unwrap_or(multiplier)
}

/// An anchor with the motion and depth from it to the one before.
#[derive(Clone)]
pub(super) struct GuidedAnchor {
    pub(super) anchor: Arc<KeptAnchor>,
    /// `None` for the first of a walk.
    pub(super) guidance: Option<Arc<Guidance>>,
}

/// Shows anchors at the pace at which they arrive.
pub(super) struct Playback {
    presenter: Presenter,
    pub(super) pace: Pace,
    pub(super) between: InBetweenMode,
    pub(super) multiplier: u32,
    pictures: u32,
    previous: Option<GuidedAnchor>,
    current: Option<GuidedAnchor>,
    /// When `current` arrived, in nanoseconds.
    arrived: u64,
}

impl Playback {
    /// For a world of `latents_per_second` and `pictures` per latent.
    ///
    /// # Errors
    /// `InvalidArgument` for a multiplier that the presenter refuses.
    pub(super) fn new(latents_per_second: u32, pictures: u32, multiplier: u32) -> Result<Self> {
        let (pace, between) = (Pace::new(latents_per_second), InBetweenMode::Generated);
        let presenter = presenter(between, multiplier, pictures, pace.interval())?;
        Ok(Self { presenter, pace, between, multiplier, pictures, previous: None, current: None, arrived: 0 })
    }

    /// Takes an anchor that arrived at `now`, in nanoseconds. One that does not follow the last starts anew.
    ///
    /// # Errors
    /// Errors of the presenter.
    pub(super) fn push(&mut self, anchor: GuidedAnchor, now: u64) -> Result<()> {
        let number = anchor.anchor.number();
        let follows = self.current.as_ref().is_some_and(|last| last.anchor.number() + 1 == number);
        if !follows {
            self.pace.interrupt();
            self.presenter.reset();
        }
        let changed = self.pace.arrived(now);
        self.previous = self.current.take().filter(|_| follows);
        self.current = Some(anchor.clone());
        self.arrived = now;
        let pushed = !changed && self.presenter.push(anchor.anchor, anchor.guidance, now)?;
        // A full presenter lags behind, so it starts again with the last two anchors.
        if pushed { Ok(()) } else { self.rebuild() }
    }

    /// Sets the frames between anchors.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub(super) fn set(&mut self, between: InBetweenMode, multiplier: u32) -> Result<()> {
        (self.between, self.multiplier) = (between, multiplier);
        self.rebuild()
    }

    /// A new presenter, in which the anchor before the last is due when the last arrived, as always with a delay of one interval.
    fn rebuild(&mut self) -> Result<()> {
        let interval = self.pace.interval();
        self.presenter = presenter(self.between, self.multiplier, self.pictures, interval)?;
        let times = [self.arrived.saturating_sub(interval), self.arrived];
        for (anchor, at) in [&self.previous, &self.current].into_iter().zip(times) {
            if let Some(GuidedAnchor { anchor, guidance }) = anchor.clone() {
                self.presenter.push(anchor, guidance, at)?;
            }
        }
        Ok(())
    }

    /// Number of the last anchor that arrived.
    pub(super) fn last(&self) -> Option<u64> {
        self.current.as_ref().map(|current| current.anchor.number())
    }

    /// The frame that is due.
    pub(super) fn query(&self, now: u64) -> Option<FrameInfo> {
        self.presenter.query(now)
    }

    /// Makes the frame that is due at the anchors' size, and passes it to `write`.
    ///
    /// # Errors
    /// Errors of the presenter and its generator.
    pub(super) fn draw(&self, now: u64, write: impl FnOnce(&Picture)) -> Result<Option<FrameInfo>> {
        match self.presenter.anchor_size() {
            Some(size) => self.presenter.draw(now, size, write),
            None => Ok(None),
        }
    }

    /// Motion and depth of the pair that the display is at; `None` at the start of a walk.
    pub(super) fn guidance(&self, info: &FrameInfo) -> Option<Arc<Guidance>> {
        let of = |number: u64| {
            let anchors = [&self.current, &self.previous].into_iter().flatten();
            anchors.into_iter().find(|anchor| anchor.anchor.number() == number)
        };
        of(info.current).or(self.current.as_ref())?.guidance.clone()
    }
}

fn presenter(between: InBetweenMode, multiplier: u32, pictures: u32, interval: u64) -> Result<Presenter> {
    let (multiplier, decoded) = match between {
        InBetweenMode::Generated => (multiplier, false),
        InBetweenMode::Decoded => (pictures, true),
        InBetweenMode::Nothing => (1, false),
    };
    let options = PresenterOptions {
        interval: Some(Interval::of_ns(interval.clamp(1, MAX_INTERVAL_NS))?),
        multiplier,
        catch_up: true,
        extrapolate: false,
        decoded,
        ..PresenterOptions::default()
    };
    let generator =
        (between == InBetweenMode::Generated).then(|| Box::new(CpuGenerator::new()) as Box<dyn FrameGenerator>);
    Presenter::new(options, generator)
}

#[cfg(test)]
mod tests {
    use cairn::guidance::picture_flow;
    use cairn::present::presenter::FrameSource;

    use super::*;

    const MS: u64 = 1_000_000;

    fn anchor(number: u64) -> GuidedAnchor {
        let mut picture = Picture::new(64, 36).unwrap();
        picture.pixels_mut().fill([20 * number as u8, 0, 0, 255]);
        let guidance = Guidance::new(64, 36, picture_flow::PROJECTION).unwrap();
        GuidedAnchor {
            anchor: Arc::new(KeptAnchor::of_picture(picture, number, number == 0)),
            guidance: (number > 0).then(|| Arc::new(guidance)),
        }
    }

    /// Ten anchors, 400 ms apart.
    fn slow() -> Playback {
        let mut playback = Playback::new(15, 4, 4).unwrap();
        for i in 0..10 {
            playback.push(anchor(i), i * 400 * MS).unwrap();
        }
        playback
    }

    #[test]
    fn frames_of_a_slow_world_are_spread_over_its_interval() {
        let playback = slow();
        let start = 9 * 400 * MS;
        let (mut sources, mut last) = (Vec::new(), None);
        for now in (start..start + 424 * MS).step_by(5 * MS as usize) {
            let info = playback.query(now).unwrap();
            if last.replace(info.t) != Some(info.t) {
                sources.push((info.source, info.previous, info.t));
            }
        }
        let generated = |t| (FrameSource::Generated, 8, t);
        assert_eq!(sources[sources.len() - 3..], [generated(0.25), generated(0.5), generated(0.75)]);
    }

    #[test]
    fn another_number_of_frames_starts_where_the_display_is() {
        let mut playback = slow();
        let now = 9 * 400 * MS + 200 * MS;
        let before = playback.query(now).unwrap();
        playback.set(InBetweenMode::Generated, 24).unwrap();
        let after = playback.query(now).unwrap();
        assert_eq!((before.previous, after.previous), (8, 8));
        assert!((before.t - after.t).abs() <= 0.25, "{} then {}", before.t, after.t);
        playback.set(InBetweenMode::Nothing, 24).unwrap();
        assert_eq!(playback.query(now).unwrap().source, FrameSource::Anchor);
    }

    #[test]
    fn a_new_walk_shows_its_first_anchor() {
        let mut playback = slow();
        playback.push(anchor(0), 5_000 * MS).unwrap();
        let info = playback.query(5_001 * MS).unwrap();
        assert_eq!((info.previous, info.current), (0, 0));
        assert!(playback.guidance(&info).is_none());
    }

    #[test]
    fn multipliers_are_stepped_and_end() {
        assert_eq!((next_multiplier(4, true), next_multiplier(4, false)), (6, 3));
        assert_eq!((next_multiplier(24, true), next_multiplier(1, false)), (24, 1));
    }
}
