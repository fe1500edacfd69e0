//! Scores generated frames at every phase, between anchors of the renderer and of the world, against the true frames.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{Guidance, picture_flow};
use cairn::world::{ControlScript, OperatingPoint, Rollout, World};
use cairn::{Error, ErrorKind, Picture, Result};

use crate::metrics::{Lpips, psnr, ssim};
use crate::motion::Place;
use crate::place;
use crate::progress::Progress;
use crate::reconstruct::script_of;
use crate::reconstruct::walk::{Walk, tell};

/// PSNR that equal pictures count as in means, in dB; no other pair reaches it.
const EQUAL: f64 = 100.0;
/// Frames a second of the finest stream, as the decoder makes them.
pub(super) const FINEST: u32 = 60;
/// Seconds of a walk at which one interval of every cadence ends, independent of the script.
const MOMENTS: [u32; 7] = [1, 3, 5, 7, 9, 11, 13];
/// Number of [`MOMENTS`] used by `--quick`.
const FEW: usize = 1;
/// Seconds of the world's own walk: usual, and with `--quick`.
const SECONDS: [u32; 2] = [2, 1];

/// Anchors a second, and presented frames a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cadence {
    pub(super) anchors: u32,
    pub(super) frames: u32,
}

/// All of them, in the order of the tables.
pub(super) const CADENCES: [Cadence; 4] = [
    Cadence { anchors: 10, frames: 60 },
    Cadence { anchors: 15, frames: 60 },
    Cadence { anchors: 15, frames: 30 },
    Cadence { anchors: 30, frames: 60 },
];

impl Cadence {
    /// Presented frames per anchor, the anchor itself included.
    pub(super) fn multiplier(self) -> u32 {
        self.frames / self.anchors
    }

    /// Number of frames of the finest stream from one anchor to the next.
    fn stride(self) -> usize {
        (FINEST / self.anchors) as usize
    }
}

impl std::fmt::Display for Cadence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} -> {}", self.anchors, self.frames)
    }
}

/// Source of the anchors and of the true frames between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// The renderer.
    Drawn,
    /// The world's own: pictures that its decoder makes, 60 a second.
    World,
}

/// Method that makes the frames between anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// Repeats the nearer anchor.
    Repeat,
    /// Generates with optical flow between the two anchors.
    Pictures,
    /// Generates with the renderer's motion and depth.
    Truth,
}

/// All methods, in the order of the tables.
pub(super) const WAYS: [Way; 3] = [Way::Repeat, Way::Pictures, Way::Truth];

impl Way {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Repeat => "repeat",
            Self::Pictures => "picture-flow",
            Self::Truth => "truth",
        }
    }
}

/// Distance of a frame from the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Score {
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    pub(super) lpips: Option<f64>,
}

/// Score of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    pub(super) place: Place,
    pub(super) source: Source,
    pub(super) cadence: Cadence,
    pub(super) way: Way,
    /// End of the interval, in frames of the finest stream.
    pub(super) end: u64,
    /// Phase: number of presented frames after the previous anchor.
    pub(super) part: u32,
    pub(super) score: Score,
}

/// One interval for the figure: true frames and generated ones.
pub(super) struct Strip {
    pub(super) source: Source,
    /// True frames, with the anchors at both ends.
    pub(super) truth: Vec<Picture>,
    pub(super) made: Vec<Picture>,
}

/// World, settings and tools for the measurement.
pub(super) struct Tools<'a> {
    pub(super) world: &'a Arc<World>,
    pub(super) point: &'a OperatingPoint,
    pub(super) lpips: Option<&'a Lpips>,
    pub(super) quick: bool,
    pub(super) progress: &'a Progress,
    pub(super) stop: &'a AtomicBool,
}

/// Generator and metrics for one interval.
struct Bench<'a> {
    lpips: Option<&'a Lpips>,
    flow: picture_flow::Extractor,
    generator: CpuGenerator,
    guidance: Guidance,
}

/// Pictures of an interval from anchor to anchor, with the renderer's motion and depth at its end and its beginning.
struct Interval<'a> {
    pictures: &'a [Picture],
    truth: Option<[&'a Guidance; 2]>,
}

impl Bench<'_> {
    /// Makes the frames between the anchors and scores each.
    fn make(&mut self, interval: &Interval<'_>, way: Way) -> Result<Vec<(Picture, Score)>> {
        let Interval { pictures, truth } = interval;
        let [previous, between @ .., current] = pictures else { return Ok(Vec::new()) };
        if way == Way::Pictures {
            self.flow.extract(previous, current, &mut self.guidance)?;
        }
        let parts = between.len() as f32 + 1.0;
        let mut made = Vec::new();
        for (truth_of_frame, part) in between.iter().zip(1_u32..) {
            let t = part as f32 / parts;
            let mut frame = if t <= 0.5 { previous.clone() } else { current.clone() };
            match (way, truth) {
                (Way::Repeat, _) => {}
                (Way::Truth, Some([guidance, before])) => {
                    let pair = AnchorPair::new(previous, current, guidance)?.with_previous_depth(before.depth())?;
                    self.generator.generate(&pair, t, &mut frame)?;
                }
                _ => {
                    let pair = AnchorPair::new(previous, current, &self.guidance)?;
                    self.generator.generate(&pair, t, &mut frame)?;
                }
            }
            let lpips = self.lpips.map(|lpips| lpips.compare(truth_of_frame, &frame)).transpose()?;
            let psnr = psnr(truth_of_frame, &frame)?.min(EQUAL);
            let score = Score { psnr, ssim: ssim(truth_of_frame, &frame)?, lpips };
            made.push((frame, score));
        }
        Ok(made)
    }
}

impl Tools<'_> {
    /// Scores every cadence in a place. Returns one interval of the first cadence for the figure.
    ///
    /// # Errors
    /// Errors of making latents; `Cancelled` when `stop` was set.
    pub(super) fn score(&self, place: Place) -> Result<(Vec<Record>, Vec<Strip>)> {
        self.progress.phase(&format!("{} {}", place.family, place.seed));
        let size = self.world.render_size();
        let mut bench = Bench {
            lpips: self.lpips,
            flow: picture_flow::Extractor::new(),
            generator: CpuGenerator::new(),
            guidance: Guidance::new(size.0, size.1, picture_flow::PROJECTION)?,
        };
        let (mut records, mut strips) = (Vec::new(), Vec::new());
        self.drawn(place, size, &mut bench, &mut records, &mut strips)?;
        self.own(place, &mut bench, &mut records, &mut strips)?;
        Ok((records, strips))
    }

    fn drawn(
        &self,
        place: Place,
        size: (u32, u32),
        bench: &mut Bench<'_>,
        records: &mut Vec<Record>,
        strips: &mut Vec<Strip>,
    ) -> Result<()> {
        let moments = if self.quick { &MOMENTS[..FEW] } else { &MOMENTS[..] };
        for cadence in CADENCES {
            let multiplier = u64::from(cadence.multiplier());
            let end_of = |moment: u32| u64::from(moment) * u64::from(cadence.anchors);
            let frames = moments.iter().map(|moment| end_of(*moment)).max().unwrap_or(0) * multiplier + 1;
            let walk = Walk::new(place.family, place.seed, size, [cadence.anchors, cadence.multiplier()], frames)?;
            for &moment in moments {
                self.go_on()?;
                let end = end_of(moment);
                let [before, now] = [end - 1, end].map(|n| walk.anchor(n).ok_or_else(behind_the_end));
                let (before, now) = (before?, now?);
                let mut truth = [walk.guidance()?, walk.guidance()?];
                tell(&now, &mut truth[0]);
                tell(&before, &mut truth[1]);
                let mut pictures = vec![before.picture];
                for frame in (end - 1) * multiplier + 1..end * multiplier {
                    pictures.push(walk.truth(frame).ok_or_else(behind_the_end)?);
                }
                pictures.push(now.picture);
                let interval = Interval { pictures: &pictures, truth: Some([&truth[0], &truth[1]]) };
                let end = u64::from(moment) * u64::from(FINEST);
                self.note(place, Source::Drawn, cadence, end, &interval, bench, records, strips)?;
            }
        }
        Ok(())
    }

    /// Scores the world's own walk: some of its pictures are anchors, the others are the truth.
    fn own(
        &self,
        place: Place,
        bench: &mut Bench<'_>,
        records: &mut Vec<Record>,
        strips: &mut Vec<Strip>,
    ) -> Result<()> {
        let pictures = self.walk(place)?;
        for cadence in CADENCES {
            let stride = cadence.stride();
            let step = stride / cadence.multiplier() as usize;
            for first in (0..pictures.len().saturating_sub(stride)).step_by(stride) {
                self.go_on()?;
                let pictures: Vec<Picture> =
                    (first..=first + stride).step_by(step).map(|n| pictures[n].clone()).collect();
                let interval = Interval { pictures: &pictures, truth: None };
                let end = (first + stride) as u64;
                self.note(place, Source::World, cadence, end, &interval, bench, records, strips)?;
            }
        }
        Ok(())
    }

    /// Every picture that the decoder makes of a walk, from world time zero.
    fn walk(&self, place: Place) -> Result<Vec<Picture>> {
        let (width, height) = self.world.render_size();
        let script = ControlScript::parse(script_of(place.family))?;
        let mut rollout = Rollout::new(self.world, self.point, place.seed)?;
        rollout.append(&place::draw(place.family, place.seed, width, height)?)?;
        let read = |rollout: &mut Rollout, i: u32| {
            let mut picture = Picture::new(width, height)?;
            rollout.read_picture(i, &mut picture)?;
            Ok::<_, Error>(picture)
        };
        // Of the seed's own pictures only the last is at world time zero.
        let mut pictures = vec![read(&mut rollout, self.point.pictures_per_latent - 1)?];
        let seconds = SECONDS[usize::from(self.quick)];
        for q in 1..=u64::from(seconds * self.point.latents_per_second) {
            self.go_on()?;
            let (start, end) = self.point.span_of_latent(q);
            rollout.step(&script.span(start, end)?)?;
            for i in 0..self.point.pictures_per_latent {
                pictures.push(read(&mut rollout, i)?);
            }
        }
        Ok(pictures)
    }

    #[expect(clippy::too_many_arguments, reason = "everything about one interval, from two callers")]
    fn note(
        &self,
        place: Place,
        source: Source,
        cadence: Cadence,
        end: u64,
        interval: &Interval<'_>,
        bench: &mut Bench<'_>,
        records: &mut Vec<Record>,
        strips: &mut Vec<Strip>,
    ) -> Result<()> {
        for way in WAYS.into_iter().filter(|way| *way != Way::Truth || interval.truth.is_some()) {
            let made = bench.make(interval, way)?;
            let scores = made.iter().zip(1..);
            records.extend(scores.map(|((_, score), part)| Record {
                place,
                source,
                cadence,
                way,
                end,
                part,
                score: *score,
            }));
            let is_shown = cadence == CADENCES[0] && way == Way::Pictures;
            if is_shown && strips.iter().all(|strip| strip.source != source) {
                let [previous, .., current] = interval.pictures else { continue };
                let made = made.into_iter().map(|(picture, _)| picture);
                let made = std::iter::once(previous.clone()).chain(made).chain([current.clone()]).collect();
                strips.push(Strip { source, truth: interval.pictures.to_vec(), made });
            }
        }
        Ok(())
    }

    /// Fails with `Cancelled` when `stop` was set.
    fn go_on(&self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::new(ErrorKind::Cancelled, "interrupted"));
        }
        Ok(())
    }
}

/// Error for an internal inconsistency.
fn behind_the_end() -> Error {
    Error::new(ErrorKind::InvalidState, "a frame behind the end of the walk")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cadence_is_a_part_of_the_finest_stream() {
        for cadence in CADENCES {
            assert_eq!(cadence.stride() as u32 * cadence.anchors, FINEST, "{cadence}");
            assert_eq!(cadence.stride() as u32 % cadence.multiplier(), 0, "{cadence}");
        }
        assert_eq!(CADENCES.map(Cadence::multiplier), [6, 4, 2, 2]);
        assert_eq!(CADENCES[0].to_string(), "10 -> 60");
    }
}
