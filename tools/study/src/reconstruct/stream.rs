//! The main loop: an anchor, its motion, the frames before it, and the true frames for comparison.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, picture_flow};
use cairn::{Error, ErrorKind, Picture, Result};

use super::panels::Panels;
use super::scores::{Entry, Score, Scores};
use super::walk::{Walk, write_guidance};
use super::{ANCHOR_RATE, ReconstructCounts, ReconstructSettings, TruthOrPicture};
use crate::metrics::Lpips;
use crate::sheet::Sheet;
use crate::text::{SMALL, fit, write};
use media::Recorder;

/// State of the stream.
pub(super) struct Stream {
    walk: Walk,
    multiplier: u32,
    source: TruthOrPicture,
    flow: picture_flow::Extractor,
    guidance: Guidance,
    /// Guidance of the previous anchor.
    before: Guidance,
    generator: Box<dyn FrameGenerator>,
    lpips: Option<Lpips>,
    panels: Panels,
    pub(super) sheet: Sheet,
    pub(super) scores: Scores,
    pub(super) counts: ReconstructCounts,
    pub(super) times: BTreeMap<&'static str, Duration>,
}

/// Outputs for frames.
struct Outlets<'a> {
    stream: &'a Recorder,
    comparison: &'a Recorder,
}

impl Stream {
    pub(super) fn new(settings: &ReconstructSettings, walk: Walk, lpips: Option<Lpips>) -> Result<Self> {
        let size = settings.size.into();
        Ok(Self {
            guidance: walk.guidance()?,
            before: walk.guidance()?,
            walk,
            multiplier: settings.multiplier,
            source: settings.guidance,
            flow: picture_flow::Extractor::new(),
            generator: settings.generator.make(None, 1000.0 / ANCHOR_RATE as f32)?,
            lpips,
            panels: Panels::new(size)?,
            sheet: Sheet::new(size, "anchor"),
            scores: Scores::default(),
            counts: ReconstructCounts::default(),
            times: BTreeMap::new(),
        })
    }

    /// `(width, height)` of the comparison's video.
    pub(super) fn comparison_size(&self) -> (u32, u32) {
        self.panels.size()
    }

    /// Makes `limit` frames; `false` if `stop` was set or a recorder has stopped.
    pub(super) fn run(
        &mut self,
        limit: u64,
        stream: &Recorder,
        comparison: &Recorder,
        stop: &AtomicBool,
        mut progress: impl FnMut(u64),
    ) -> Result<bool> {
        let outlets = Outlets { stream, comparison };
        let mut previous: Option<Picture> = None;
        for number in 0.. {
            // Checked only here, so that the frames made do not depend on the exact time of the request.
            if stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let anchor = self.make_anchor(number, previous.as_ref())?;
            let first = number.saturating_sub(1) * u64::from(self.multiplier) + 1;
            if let Some(previous) = &previous {
                for (frame, part) in (first..limit).zip(1..self.multiplier) {
                    if !self.make_between(frame, number, part, [previous, &anchor], &outlets)? {
                        return Ok(false);
                    }
                    progress(frame + 1);
                }
            }
            let frame = number * u64::from(self.multiplier);
            if frame >= limit {
                break;
            }
            if !self.present(frame, [&anchor, &anchor], "an anchor, which is true", &outlets)? {
                return Ok(false);
            }
            self.scores.entries.push(Entry { frame, anchor: number, part: None });
            progress(frame + 1);
            if frame + 1 == limit {
                break;
            }
            previous = Some(anchor);
        }
        Ok(true)
    }

    /// Renders an anchor and finds its motion to the previous one.
    fn make_anchor(&mut self, number: u64, previous: Option<&Picture>) -> Result<Picture> {
        let anchor = self.find_motion(number, previous)?;
        self.counts.anchors += 1;
        if self.sheet.wants(number) {
            let start = Instant::now();
            let time = number as f64 / f64::from(ANCHOR_RATE);
            self.sheet.add(number, time, &anchor, previous.map(|_| &self.guidance))?;
            self.spend("contact_sheet", start);
        }
        Ok(anchor)
    }

    fn find_motion(&mut self, number: u64, previous: Option<&Picture>) -> Result<Picture> {
        let start = Instant::now();
        let frame = self.walk.anchor(number).ok_or_else(missing_frame)?;
        self.spend("rendering", start);
        let start = Instant::now();
        match (self.source, previous) {
            (TruthOrPicture::Truth, _) => {
                std::mem::swap(&mut self.guidance, &mut self.before);
                write_guidance(&frame, &mut self.guidance);
            }
            (TruthOrPicture::Picture, None) => {}
            (TruthOrPicture::Picture, Some(previous)) => {
                self.flow.extract(previous, &frame.picture, &mut self.guidance)?;
            }
        }
        self.spend("motion", start);
        Ok(frame.picture)
    }

    /// Generates, scores and presents one frame between two anchors; `false` if a recorder has stopped.
    fn make_between(
        &mut self,
        frame: u64,
        number: u64,
        part: u32,
        [previous, anchor]: [&Picture; 2],
        outlets: &Outlets<'_>,
    ) -> Result<bool> {
        let start = Instant::now();
        let truth = self.walk.truth(frame).ok_or_else(missing_frame)?;
        self.spend("rendering", start);
        let (made, outcome) = self.generate(part, previous, anchor)?;
        let start = Instant::now();
        let nearer = if 2 * part < self.multiplier { previous } else { anchor };
        let score = Score::of(&made, &truth, nearer, self.lpips.as_ref())?;
        self.spend("scoring", start);
        self.sheet.add_between(number, part as f32 / self.multiplier as f32, &made)?;
        let label = self.label(part, &score, outcome);
        if !self.present(frame, [&truth, &made], &label, outlets)? {
            return Ok(false);
        }
        self.scores.entries.push(Entry { frame, anchor: number, part: Some((part, score, outcome)) });
        self.counts.generated += 1;
        self.counts.cut_fallbacks += u64::from(outcome == Outcome::CutFallback);
        Ok(true)
    }

    fn generate(&mut self, part: u32, previous: &Picture, anchor: &Picture) -> Result<(Picture, Outcome)> {
        let start = Instant::now();
        let mut made = Picture::new(anchor.width(), anchor.height())?;
        let mut pair = AnchorPair::new(previous, anchor, &self.guidance)?;
        if self.source == TruthOrPicture::Truth {
            pair = pair.with_previous_depth(self.before.depth())?;
        }
        let report = self.generator.generate(&pair, part as f32 / self.multiplier as f32, &mut made)?;
        self.spend("generation", start);
        Ok((made, report.outcome))
    }

    fn truth_label(&self, frame: u64) -> String {
        let seconds = frame as f64 / f64::from(ANCHOR_RATE * self.multiplier);
        format!("truth, frame {frame}, {seconds:.3} s")
    }

    fn label(&self, part: u32, score: &Score, outcome: Outcome) -> String {
        let what = if outcome == Outcome::Generated { "generated" } else { "nearer anchor" };
        format!("{:.1} dB, {what} {part}/{}", score.psnr, self.multiplier)
    }

    /// Passes one frame on, alone and beside the truth.
    fn present(
        &mut self,
        frame: u64,
        [truth, made]: [&Picture; 2],
        label: &str,
        outlets: &Outlets<'_>,
    ) -> Result<bool> {
        let truth_label = self.truth_label(frame);
        let start = Instant::now();
        let (width, height) = self.panels.size();
        let mut wide = outlets.comparison.recycled().map_or_else(|| Picture::new(width, height), Ok)?;
        self.panels.clear(&mut wide);
        self.panels.draw([truth, made], [&truth_label, label], &mut wide, 0)?;
        let mut alone = outlets.stream.recycled().map_or_else(|| Picture::new(made.width(), made.height()), Ok)?;
        alone.rgba_mut().copy_from_slice(made.rgba());
        self.spend("comparison", start);
        let start = Instant::now();
        let taken = outlets.stream.push(alone) && outlets.comparison.push(wide);
        self.spend("waiting_for_recorder", start);
        self.counts.presented += u64::from(taken);
        Ok(taken)
    }

    /// The median and the worst generated frame beside the truth; `None` if nothing was generated.
    pub(super) fn compare(&mut self, title: &str) -> Result<Option<Picture>> {
        const TITLE: u32 = 28;
        let shown = self.scores.median_and_worst();
        if shown.is_empty() {
            return Ok(None);
        }
        let (width, height) = self.panels.size();
        let mut out = Picture::new(width, TITLE + shown.len() as u32 * height)?;
        self.panels.clear(&mut out);
        write(&mut out, &fit(title, width, SMALL), (4, 6), SMALL, [235, 235, 230]);
        for ((name, entry), row) in shown.into_iter().zip(0..) {
            let Some((part, score, outcome)) = entry.part else { continue };
            // The frames are generated again instead of being kept until the end. The bits are the same, except with AMD's generator,
            // which has memory of earlier frames and here starts from nothing.
            let previous = self.walk.anchor(entry.anchor.saturating_sub(1)).ok_or_else(missing_frame)?.picture;
            let anchor = self.find_motion(entry.anchor, Some(&previous))?;
            let (made, _) = self.generate(part, &previous, &anchor)?;
            let truth = self.walk.truth(entry.frame).ok_or_else(missing_frame)?;
            let truth_label = self.truth_label(entry.frame);
            let label = format!("{name}: {}", self.label(part, &score, outcome));
            self.panels.draw([&truth, &made], [&truth_label, &label], &mut out, TITLE + row * height)?;
        }
        Ok(Some(out))
    }

    fn spend(&mut self, stage: &'static str, start: Instant) {
        *self.times.entry(stage).or_default() += start.elapsed();
    }
}

/// Error for an internal inconsistency.
fn missing_frame() -> Error {
    Error::new(ErrorKind::InvalidState, "a frame behind the end of the walk").remedy("Report this with the manifest")
}
