//! Scores generated frames at every phase, between anchors of the renderer and of the world, against the true frames.

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{Guidance, picture_flow};
use cairn::world::{ControlScript, Rollout};
use cairn::{Error, Picture, Result};
use scenes::Scene;

use crate::experiment::{Bench, missing_frame};
use crate::metrics::Score;
use crate::progress::check_stop;
use crate::reconstruct::walk::{Walk, write_guidance};
use crate::scene_id::SceneId;
use crate::seed_picture;

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
pub(super) enum Method {
    /// Repeats the nearer anchor.
    Repeat,
    /// Generates with optical flow between the two anchors.
    Pictures,
    /// Generates with the renderer's motion and depth.
    Truth,
}

/// All methods, in the order of the tables.
pub(super) const METHODS: [Method; 3] = [Method::Repeat, Method::Pictures, Method::Truth];

impl Method {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Repeat => "repeat",
            Self::Pictures => "picture-flow",
            Self::Truth => "truth",
        }
    }
}

/// Score of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    pub(super) scene: SceneId,
    pub(super) source: Source,
    pub(super) cadence: Cadence,
    pub(super) method: Method,
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

/// Makes the frames of intervals.
struct Maker {
    flow: picture_flow::Extractor,
    generator: CpuGenerator,
    guidance: Guidance,
}

/// Pictures of an interval from anchor to anchor, with the renderer's motion and depth at its end and its beginning.
struct Interval<'a> {
    pictures: &'a [Picture],
    truth: Option<[&'a Guidance; 2]>,
}

impl Maker {
    fn new((width, height): (u32, u32)) -> Result<Self> {
        Ok(Self {
            flow: picture_flow::Extractor::new(),
            generator: CpuGenerator::new(),
            guidance: Guidance::new(width, height, picture_flow::PROJECTION)?,
        })
    }

    /// Makes the frames between the anchors.
    fn make(&mut self, interval: &Interval<'_>, method: Method) -> Result<Vec<Picture>> {
        let Interval { pictures, truth } = interval;
        let [previous, between @ .., current] = pictures else { return Ok(Vec::new()) };
        if method == Method::Pictures {
            self.flow.extract(previous, current, &mut self.guidance)?;
        }
        let parts = between.len() as f32 + 1.0;
        let mut made = Vec::new();
        for (_, part) in between.iter().zip(1_u32..) {
            let t = part as f32 / parts;
            let mut frame = if t <= 0.5 { previous.clone() } else { current.clone() };
            match (method, truth) {
                (Method::Repeat, _) => {}
                (Method::Truth, Some([guidance, before])) => {
                    let pair = AnchorPair::new(previous, current, guidance)?.with_previous_depth(before.depth())?;
                    self.generator.generate(&pair, t, &mut frame)?;
                }
                _ => {
                    let pair = AnchorPair::new(previous, current, &self.guidance)?;
                    self.generator.generate(&pair, t, &mut frame)?;
                }
            }
            made.push(frame);
        }
        Ok(made)
    }
}

/// The measurement of one scene.
struct Measurement<'a> {
    scene: SceneId,
    bench: &'a Bench<'a>,
    maker: Maker,
    records: Vec<Record>,
    strips: Vec<Strip>,
}

/// Scores every cadence in a scene. Returns one interval of the first cadence of each source as well, for the figure.
///
/// # Errors
/// Errors of making latents; `Cancelled` when `bench.stop` was set.
pub(super) fn score(scene: SceneId, bench: &Bench<'_>) -> Result<(Vec<Record>, Vec<Strip>)> {
    let maker = Maker::new(bench.world.render_size())?;
    let mut measurement = Measurement { scene, bench, maker, records: Vec::new(), strips: Vec::new() };
    measurement.rendered()?;
    measurement.decoded()?;
    Ok((measurement.records, measurement.strips))
}

impl Measurement<'_> {
    /// Scores the renderer's walk: some of its frames are anchors, the others are the truth.
    fn rendered(&mut self) -> Result<()> {
        let SceneId { family, seed } = self.scene;
        let size = self.bench.world.render_size();
        let moments = if self.bench.quick { &MOMENTS[..FEW] } else { &MOMENTS[..] };
        for cadence in CADENCES {
            let multiplier = u64::from(cadence.multiplier());
            let end_of = |moment: u32| u64::from(moment) * u64::from(cadence.anchors);
            let frames = moments.iter().map(|moment| end_of(*moment)).max().unwrap_or(0) * multiplier + 1;
            let walk = Walk::new(family, seed, size, [cadence.anchors, cadence.multiplier()], frames)?;
            for &moment in moments {
                check_stop(self.bench.stop)?;
                let end = end_of(moment);
                let [before, now] = [end - 1, end].map(|n| walk.anchor(n).ok_or_else(missing_frame));
                let (before, now) = (before?, now?);
                let mut truth = [walk.guidance()?, walk.guidance()?];
                write_guidance(&now, &mut truth[0]);
                write_guidance(&before, &mut truth[1]);
                let mut pictures = vec![before.picture];
                for frame in (end - 1) * multiplier + 1..end * multiplier {
                    pictures.push(walk.truth(frame).ok_or_else(missing_frame)?);
                }
                pictures.push(now.picture);
                let interval = Interval { pictures: &pictures, truth: Some([&truth[0], &truth[1]]) };
                let end = u64::from(moment) * u64::from(FINEST);
                self.score_interval(Source::Drawn, cadence, end, &interval)?;
            }
        }
        Ok(())
    }

    /// Scores the world's own walk: some of its pictures are anchors, the others are the truth.
    fn decoded(&mut self) -> Result<()> {
        let pictures = self.rollout()?;
        for cadence in CADENCES {
            let stride = cadence.stride();
            let step = stride / cadence.multiplier() as usize;
            for first in (0..pictures.len().saturating_sub(stride)).step_by(stride) {
                check_stop(self.bench.stop)?;
                let pictures: Vec<Picture> =
                    (first..=first + stride).step_by(step).map(|n| pictures[n].clone()).collect();
                let interval = Interval { pictures: &pictures, truth: None };
                let end = (first + stride) as u64;
                self.score_interval(Source::World, cadence, end, &interval)?;
            }
        }
        Ok(())
    }

    /// Every picture that the decoder makes of a walk, from world time zero.
    fn rollout(&self) -> Result<Vec<Picture>> {
        let (SceneId { family, seed }, point) = (self.scene, self.bench.point);
        let (width, height) = self.bench.world.render_size();
        let script = ControlScript::parse(family.script())?;
        let mut rollout = Rollout::new(self.bench.world, point, seed)?;
        rollout.append(&seed_picture::draw(&Scene::new(family, seed), width, height)?)?;
        let read = |rollout: &mut Rollout, i: u32| {
            let mut picture = Picture::new(width, height)?;
            rollout.read_picture(i, &mut picture)?;
            Ok::<_, Error>(picture)
        };
        // Of the seed's own pictures only the last is at world time zero.
        let mut pictures = vec![read(&mut rollout, point.pictures_per_latent - 1)?];
        let seconds = SECONDS[usize::from(self.bench.quick)];
        for q in 1..=u64::from(seconds * point.latents_per_second) {
            check_stop(self.bench.stop)?;
            let (start, end) = point.span_of_latent(q);
            rollout.step(&script.span(start, end)?)?;
            for i in 0..point.pictures_per_latent {
                pictures.push(read(&mut rollout, i)?);
            }
        }
        Ok(pictures)
    }

    /// Makes the frames of an interval with every method and records their scores; `end` is in frames of the finest stream.
    fn score_interval(&mut self, source: Source, cadence: Cadence, end: u64, interval: &Interval<'_>) -> Result<()> {
        let [previous, between @ .., current] = interval.pictures else { return Ok(()) };
        let scene = self.scene;
        for method in METHODS.into_iter().filter(|method| *method != Method::Truth || interval.truth.is_some()) {
            let made = self.maker.make(interval, method)?;
            for ((truth, frame), part) in between.iter().zip(&made).zip(1..) {
                let lpips = self.bench.lpips.map(|lpips| lpips.compare(truth, frame)).transpose()?;
                let score = Score::new(truth, frame, lpips)?;
                self.records.push(Record { scene, source, cadence, method, end, part, score });
            }
            let in_figure = cadence == CADENCES[0] && method == Method::Pictures;
            if in_figure && self.strips.iter().all(|strip| strip.source != source) {
                let made = std::iter::once(previous.clone()).chain(made).chain([current.clone()]).collect();
                self.strips.push(Strip { source, truth: interval.pictures.to_vec(), made });
            }
        }
        Ok(())
    }
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
