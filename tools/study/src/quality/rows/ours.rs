//! Cairn's own generator.

use std::fs;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, picture_flow};
use cairn::{Error, ErrorKind, Picture, Result};

use super::{Interval, Row};
use crate::media::describe_io;
use crate::quality::clips::Phase;
use crate::quality::store::digest;

/// The generator with optical flow between the two anchors.
pub(super) struct Flow {
    build: String,
    extractor: picture_flow::Extractor,
    generator: CpuGenerator,
    guidance: Option<Guidance>,
}

impl Flow {
    pub(super) fn new() -> Result<Self> {
        let (extractor, generator) = (picture_flow::Extractor::new(), CpuGenerator::new());
        Ok(Self { build: build()?, extractor, generator, guidance: None })
    }
}

impl Row for Flow {
    fn version(&self) -> String {
        "this program".into()
    }

    fn key(&self) -> String {
        self.build.clone()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let (width, height) = interval.current().size();
        let guidance = match &mut self.guidance {
            Some(guidance) => guidance,
            None => self.guidance.insert(Guidance::new(width, height, picture_flow::PROJECTION)?),
        };
        self.extractor.extract(interval.previous(), interval.current(), guidance)?;
        let pair = AnchorPair::new(interval.previous(), interval.current(), guidance)?;
        generate(&mut self.generator, &pair, phases)
    }
}

/// The generator with a clip's true motion and depth.
pub(super) struct Truth {
    build: String,
    generator: CpuGenerator,
}

impl Truth {
    pub(super) fn new() -> Result<Self> {
        Ok(Self { build: build()?, generator: CpuGenerator::new() })
    }
}

impl Row for Truth {
    fn version(&self) -> String {
        "this program".into()
    }

    fn key(&self) -> String {
        self.build.clone()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let guidance = interval
            .guidance
            .ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "nobody knows the clip's motion and depth"))?;
        let mut pair = AnchorPair::new(interval.previous(), interval.current(), guidance)?;
        if let Some(before) = interval.before {
            pair = pair.with_previous_depth(before.depth())?;
        }
        generate(&mut self.generator, &pair, phases)
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
