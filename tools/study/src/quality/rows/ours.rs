//! Cairn's own generator.

use std::fs;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{DepthMap, Guidance, LatentView, MotionField, MotionOrigin, paper, picture_flow};
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{OperatingPoint, Preset, Rollout, World, WorldOptions};
use cairn::{Error, ErrorKind, Picture, Result};

use super::{Interval, Row};
use crate::inputs;
use crate::progress::Progress;
use crate::quality::clips::Phase;
use crate::quality::store::digest;
use media::describe_io;

/// The generator, with one source of motion and depth.
pub(super) struct Ours {
    build: String,
    generator: CpuGenerator,
    source: Source,
}

/// Where motion and depth come from.
enum Source {
    /// Optical flow between the two anchors.
    Flow { extractor: Box<picture_flow::Extractor>, guidance: Option<Guidance> },
    /// The clip: its true motion and depth, or those that its engine gives.
    Clip,
    /// Zero motion and constant depth.
    NoMotion,
    /// The paper's motion and depth, from the latents that the embedded world's encoder makes of the anchors.
    Paper(Box<Paper>),
}

struct Paper {
    /// Name of the world whose encoder makes the latents.
    world: String,
    rollout: Rollout,
    /// Channels, rows and columns of a latent.
    shape: [usize; 3],
    extractor: paper::Extractor,
}

impl Ours {
    fn new(source: Source) -> Result<Self> {
        Ok(Self { build: build()?, generator: CpuGenerator::new(), source })
    }

    /// With optical flow.
    pub(super) fn flow() -> Result<Self> {
        Self::new(Source::Flow { extractor: Box::default(), guidance: None })
    }

    /// With the clip's motion and depth.
    pub(super) fn of_clip() -> Result<Self> {
        Self::new(Source::Clip)
    }

    /// Without motion.
    pub(super) fn no_motion() -> Result<Self> {
        Self::new(Source::NoMotion)
    }

    /// With the paper's motion. Loads the embedded world on the processor; ONNX Runtime is fetched if it is missing.
    ///
    /// # Errors
    /// No ONNX Runtime.
    pub(super) fn paper(progress: &Progress) -> Result<Self> {
        Self::new(Source::Paper(Box::new(Paper::open(progress)?)))
    }
}

impl Row for Ours {
    fn version(&self) -> String {
        match &self.source {
            Source::Paper(paper) => format!("this program, with the encoder of the world `{}`", paper.world),
            Source::Flow { .. } | Source::Clip | Source::NoMotion => "this program".into(),
        }
    }

    fn key(&self) -> String {
        self.build.clone()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let (previous, current) = (interval.previous(), interval.current());
        let (width, height) = current.size();
        let is_of_clip = matches!(self.source, Source::Clip);
        let made;
        let guidance = match &mut self.source {
            Source::Flow { extractor, guidance } => {
                let guidance = match guidance {
                    Some(guidance) => guidance,
                    none => none.insert(Guidance::new(width, height, picture_flow::PROJECTION)?),
                };
                extractor.extract(previous, current, guidance)?;
                guidance
            }
            Source::Clip => interval
                .guidance
                .ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "nobody knows the clip's motion and depth"))?,
            Source::NoMotion => {
                let mut depth = DepthMap::new(width, height, picture_flow::PROJECTION)?;
                depth.fill(picture_flow::FLAT_DEPTH);
                // Constant depth is what optical flow has, so that this row differs from `cairn-flow` in motion only.
                made = Guidance::from_parts(MotionField::new(width, height)?, depth, MotionOrigin::OpticalFlow)?;
                &made
            }
            Source::Paper(paper) => {
                made = paper.guidance(previous, current)?;
                &made
            }
        };
        let mut pair = AnchorPair::new(previous, current, guidance)?;
        if is_of_clip {
            if let Some(before) = interval.before {
                pair = pair.with_previous_depth(before.depth())?;
            }
            if let Some(overlay) = interval.overlay {
                pair = pair.with_overlay(overlay)?;
            }
        }
        generate(&mut self.generator, &pair, phases)
    }
}

impl Paper {
    fn open(progress: &Progress) -> Result<Self> {
        let (ort, _) = inputs::onnxruntime(progress)?;
        let (bundle, _) = inputs::world(None, progress)?;
        let global = &bundle.geometry().global;
        // Only the encoder matters here, so the world has the smallest declared window.
        let window = global.window.min(global.max_window);
        let point = OperatingPoint { global_window: window, ..Preset::Coherence.operating_point() };
        let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
        let world = World::load(&device, &bundle, WorldOptions::for_point(&point))?;
        let latent = bundle.manifest().geometry.latent;
        Ok(Self {
            world: bundle.manifest().name.clone(),
            rollout: Rollout::new(&world, &point, 0)?,
            shape: [latent.channels, latent.height, latent.width].map(|n| n as usize),
            extractor: paper::Extractor::new(),
        })
    }

    fn guidance(&mut self, previous: &Picture, current: &Picture) -> Result<Guidance> {
        let [before, now] = [self.rollout.encode(previous)?, self.rollout.encode(current)?];
        let [c, h, w] = self.shape;
        let [before, now] = [LatentView::new(c, h, w, &before)?, LatentView::new(c, h, w, &now)?];
        let (width, height) = current.size();
        let mut guidance = Guidance::new(width, height, paper::PROJECTION)?;
        self.extractor.extract(before, now, (width, height), &mut guidance)?;
        Ok(guidance)
    }
}

fn generate(generator: &mut CpuGenerator, pair: &AnchorPair<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
    phases
        .iter()
        .map(|phase| {
            let mut out = Picture::new(pair.size().0, pair.size().1)?;
            let report = generator.generate(pair, phase.value(), &mut out)?;
            if report.outcome == Outcome::CutFallback {
                log::warn!("a cut was found where the clip has none: {} unexplained", report.unexplained);
            }
            Ok(out)
        })
        .collect()
}

/// Identifies this build of the program, which contains the generator.
fn build() -> Result<String> {
    let path =
        std::env::current_exe().map_err(|e| Error::new(ErrorKind::Io, format!("who runs here is unknown: {e}")))?;
    let bytes = fs::read(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
    Ok(format!("build {}", digest([bytes.as_slice()])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth pattern, moved to the right by `shift` pixels.
    fn pattern(shift: f32) -> Picture {
        let value = |x: u32, y: u32, phase: f32| {
            let (x, y) = (x as f32 - shift, y as f32);
            (128.0 + 60.0 * (0.31 * x + phase).sin() + 50.0 * (0.23 * y + 0.07 * x + phase).cos()) as u8
        };
        let (width, height) = (96, 64);
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let rgba = pixels.flat_map(|(x, y)| [value(x, y, 0.0), value(x, y, 1.0), value(x, y, 2.0), 255]).collect();
        Picture::from_rgba(width, height, rgba).unwrap()
    }

    /// Mean absolute difference of the colours inside a border that the motion leaves.
    fn difference(a: &Picture, b: &Picture) -> f64 {
        let width = a.width() as usize;
        let inside = |i: &usize| (16..width - 16).contains(&(i / 4 % width));
        let all: Vec<f64> = (0..a.rgba().len())
            .filter(inside)
            .map(|i| (f64::from(a.rgba()[i]) - f64::from(b.rgba()[i])).abs())
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    }

    fn middle(row: &mut dyn Row, anchors: &[Picture; 2]) -> Picture {
        let interval = Interval { anchors, at: 0, guidance: None, before: None, overlay: None, history: &[] };
        row.make(&interval, &[Phase::HALF]).unwrap().remove(0)
    }

    #[test]
    fn the_row_without_motion_keeps_a_still_picture_and_does_not_follow_a_moving_one() {
        let mut row = Ours::no_motion().unwrap();
        let still = middle(&mut row, &[pattern(0.0), pattern(0.0)]);
        assert!(difference(&still, &pattern(0.0)) < 0.5);
        let moving = [pattern(0.0), pattern(6.0)];
        let truth = pattern(3.0);
        let (without, with) = (middle(&mut row, &moving), middle(&mut Ours::flow().unwrap(), &moving));
        let [without, with] = [without, with].map(|made| difference(&made, &truth));
        assert!(with < 2.0 && without > 3.0 * with, "without motion {without}, with optical flow {with}");
    }
}
