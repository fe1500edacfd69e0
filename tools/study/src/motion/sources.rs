//! Sources of motion and depth, and the pairs that are compared.

use cairn::guidance::{
    DepthMap, Guidance, LatentView, MotionField, MotionOrigin, camera, latent_flow, paper, picture_flow,
};
use cairn::world::{ControlInput, ControlScript, GuidanceSource, WorldTime};
use cairn::{Picture, Result};
use scenes::{EASE, EYE, MAX_PITCH, RUN, TURN_PER_COUNT, WALK};

/// Source of motion, in the order of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Motion {
    None,
    Paper,
    Calibrated,
    Latents,
    Controls,
    Pictures,
    Truth,
}

/// All of them.
pub(super) const MOTIONS: [Motion; 7] = [
    Motion::None,
    Motion::Paper,
    Motion::Calibrated,
    Motion::Latents,
    Motion::Controls,
    Motion::Pictures,
    Motion::Truth,
];

/// Source of depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    /// Constant depth.
    Flat,
    /// The first channel of the latent, as in the paper.
    Paper,
    /// Depth of level ground.
    Level,
    Truth,
}

/// Motion and depth that frames are made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Row {
    pub(super) motion: Motion,
    pub(super) depth: Depth,
}

/// The compared pairs in the order of the tables: every source of motion with its own depth, then pairs that show the value of depth.
pub(super) const ROWS: [Row; 12] = [
    Row { motion: Motion::None, depth: Depth::Flat },
    Row { motion: Motion::Paper, depth: Depth::Paper },
    Row { motion: Motion::Calibrated, depth: Depth::Paper },
    Row { motion: Motion::Latents, depth: Depth::Flat },
    Row { motion: Motion::Controls, depth: Depth::Level },
    Row { motion: Motion::Pictures, depth: Depth::Flat },
    Row { motion: Motion::Truth, depth: Depth::Truth },
    Row { motion: Motion::Paper, depth: Depth::Flat },
    Row { motion: Motion::Pictures, depth: Depth::Paper },
    Row { motion: Motion::Pictures, depth: Depth::Truth },
    Row { motion: Motion::Truth, depth: Depth::Flat },
    Row { motion: Motion::Truth, depth: Depth::Paper },
];

impl Row {
    /// The origin that generators are given: optical flow for motion without depth, whatever its source, so that rows of one depth differ
    /// in motion only.
    pub(super) fn origin(self) -> MotionOrigin {
        if self.depth == Depth::Flat { MotionOrigin::OpticalFlow } else { MotionOrigin::Geometry }
    }
}

impl Motion {
    /// Name in CSV files.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Paper => "paper",
            Self::Calibrated => "paper-calibrated",
            Self::Latents => "latent-flow",
            Self::Controls => "controls",
            Self::Pictures => "picture-flow",
            Self::Truth => "truth",
        }
    }

    /// Description in one sentence.
    pub(super) fn description(self) -> &'static str {
        match self {
            Self::None => "Nothing moves: the two anchors are blended.",
            Self::Paper => "`paper`, as published: the spatial gradient of the two latents' mean difference, times 8.",
            Self::Calibrated => "The same with the factor that fits the true motion best, calibrated in other places.",
            Self::Latents => "`latent_flow`: block matching between the cells of the two latents.",
            Self::Controls => {
                "`camera`: the camera that the controls move, over level ground, with the scenes' own camera constants."
            }
            Self::Pictures => "`picture_flow`: dense inverse search between the two pictures.",
            Self::Truth => "The renderer's motion.",
        }
    }

    /// Name in a world's operating point, for sources that need anchors only.
    pub(super) fn guidance_source(self) -> Option<GuidanceSource> {
        match self {
            Self::Paper => Some(GuidanceSource::Paper),
            Self::Latents => Some(GuidanceSource::LatentFlow),
            Self::Pictures => Some(GuidanceSource::PictureFlow),
            Self::None | Self::Calibrated | Self::Controls | Self::Truth => None,
        }
    }
}

impl Depth {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Paper => "paper",
            Self::Level => "level ground",
            Self::Truth => "truth",
        }
    }
}

/// Input of the sources: two anchors.
pub(super) struct Pair<'a> {
    pub(super) pictures: [&'a Picture; 2],
    pub(super) latents: [LatentView<'a>; 2],
    pub(super) truth: &'a Guidance,
    /// Guidance from the controls, by [`ControlTracker`].
    pub(super) controls: &'a Guidance,
}

/// All sources of motion, with their working memory.
pub(super) struct Extractors {
    paper: paper::Extractor,
    calibrated: paper::Extractor,
    latents: latent_flow::Extractor,
    pictures: picture_flow::Extractor,
    found: Guidance,
}

impl Extractors {
    /// `scale` is the calibrated extractor's.
    pub(super) fn new(scale: f32, (width, height): (u32, u32)) -> Result<Self> {
        Ok(Self {
            paper: paper::Extractor::new(),
            calibrated: paper::Extractor::scaled(scale),
            latents: latent_flow::Extractor::new(),
            pictures: picture_flow::Extractor::new(),
            found: Guidance::new(width, height, paper::PROJECTION)?,
        })
    }

    /// The motion of a pair.
    pub(super) fn motion(&mut self, source: Motion, pair: &Pair<'_>) -> Result<MotionField> {
        let (size, [before, now]) = (pair.pictures[1].size(), pair.latents);
        match source {
            Motion::None => return MotionField::new(size.0, size.1),
            Motion::Truth => return Ok(pair.truth.motion().clone()),
            Motion::Controls => return Ok(pair.controls.motion().clone()),
            Motion::Paper => self.paper.extract(before, now, size, &mut self.found)?,
            Motion::Calibrated => self.calibrated.extract(before, now, size, &mut self.found)?,
            Motion::Latents => self.latents.extract(before, now, size, &mut self.found)?,
            Motion::Pictures => self.pictures.extract(pair.pictures[0], pair.pictures[1], &mut self.found)?,
        }
        Ok(self.found.motion().clone())
    }

    /// The depth of a pair.
    pub(super) fn depth(&mut self, source: Depth, pair: &Pair<'_>) -> Result<DepthMap> {
        let (size, [before, now]) = (pair.pictures[1].size(), pair.latents);
        match source {
            Depth::Flat => {
                let mut depth = DepthMap::new(size.0, size.1, picture_flow::PROJECTION)?;
                depth.fill(picture_flow::FLAT_DEPTH);
                Ok(depth)
            }
            Depth::Paper => {
                self.paper.extract(before, now, size, &mut self.found)?;
                Ok(self.found.depth().clone())
            }
            Depth::Level => Ok(pair.controls.depth().clone()),
            Depth::Truth => Ok(pair.truth.depth().clone()),
        }
    }
}

/// Derives motion from the controls of a walk, from anchor to anchor.
pub(super) struct ControlTracker {
    extractor: camera::Extractor,
    script: ControlScript,
    rate: u32,
    at: u64,
    size: (u32, u32),
}

impl ControlTracker {
    /// For a walk under `script` with `rate` anchors a second that starts at the camera `start`; pictures have `size`.
    pub(super) fn new(
        script: ControlScript,
        start: &scenes::camera::Camera,
        rate: u32,
        size: (u32, u32),
    ) -> Result<Self> {
        let eye = camera::WalkingCamera {
            vertical_fov: start.vertical_fov,
            turn_per_count: TURN_PER_COUNT,
            max_pitch: MAX_PITCH,
            walk: WALK,
            run: RUN,
            ease: EASE,
            height: EYE,
        };
        Ok(Self { extractor: camera::Extractor::new(eye, start.pitch)?, script, rate, at: 0, size })
    }

    /// Motion and depth of anchor `number`, which must be later than any before.
    pub(super) fn advance_to(&mut self, number: u64, out: &mut Guidance) -> Result<()> {
        while self.at < number {
            let span = [self.at, self.at + 1].map(|n| WorldTime::new(n, self.rate));
            let controls: ControlInput = self.script.span(span[0], span[1])?;
            self.extractor.extract(&controls, WorldTime::new(1, self.rate), self.size, out)?;
            self.at += 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_source_of_motion_has_a_row_and_every_choice_of_the_library_a_source() {
        for motion in MOTIONS {
            assert!(ROWS.iter().any(|row| row.motion == motion), "{motion:?}");
        }
        for source in ["paper", "picture", "latent", "best"] {
            let source: GuidanceSource = source.parse().unwrap();
            assert!(MOTIONS.iter().any(|motion| motion.guidance_source() == Some(source)), "{source}");
        }
    }
}
