//! Frames made on the CPU.

use std::time::Instant;

use super::area::Area;
use super::frame::{FrameKey, FramePlan, FrameRequest, FrameTimes};
use super::motion::Extractors;
use super::upscale::{Filter, Upscaler};
use crate::framegen::{Anchor, AnchorId, AnchorPair, FrameGenerator, Outcome, Phases};
use crate::guidance::{Guidance, paper};
use crate::world::{GuidanceSource, KeptAnchor};
use crate::{Error, ErrorKind, Picture, Result};

/// Makes frames on the CPU; holds the generator and working memory.
pub(super) struct CpuDrawer {
    generator: Option<Box<dyn FrameGenerator>>,
    extractors: Extractors,
    /// Extracted guidance, and the later anchor of its pair.
    guidance: Option<(AnchorId, Guidance)>,
    generated: Option<Picture>,
    upscaler: Option<Upscaler>,
    resized: Option<Picture>,
    /// The resized picture with letterbox bars.
    framed: Option<Picture>,
    /// Key of the last frame.
    pub(super) last: Option<FrameKey>,
    /// Pictures made or begun so far: the number of the last one.
    pub(super) pictures: u64,
    /// Outcome of the generator's last frame.
    pub(super) outcome: Outcome,
}

impl CpuDrawer {
    pub(super) fn new(generator: Option<Box<dyn FrameGenerator>>) -> Self {
        Self {
            generator,
            extractors: Extractors::default(),
            guidance: None,
            generated: None,
            upscaler: None,
            resized: None,
            framed: None,
            last: None,
            pictures: 0,
            outcome: Outcome::Held,
        }
    }

    /// The phases that its generator supports.
    pub(super) fn phases(&self) -> Option<Phases> {
        self.generator.as_ref().map(|generator| generator.phases())
    }

    /// Makes the picture of a requested frame. `size` is that of the caller's target and must be the frame's.
    pub(super) fn make<'a>(
        &'a mut self,
        request: &'a FrameRequest,
        size: (u32, u32),
        times: &mut FrameTimes,
    ) -> Result<&'a Picture> {
        let is_repeated = request.info.repeated;
        if !is_repeated {
            self.last = None;
            self.generate(request, times)?;
        }
        let made = match &request.plan {
            FramePlan::Copy { current, picture, .. } => current.anchor.read(*picture)?,
            FramePlan::Interpolate { .. } | FramePlan::Extrapolate { .. } => {
                self.generated.as_ref().ok_or_else(nothing_generated)?
            }
        };
        let frame_size = request.key.size.unwrap_or(made.size());
        if frame_size != size {
            let cause = format!("{} x {} pixels where frames have {} x {}", size.0, size.1, frame_size.0, frame_size.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("target"));
        }
        if frame_size == made.size() {
            return Ok(made);
        }
        let start = Instant::now();
        let Area { at, size } = Area::of(made.size(), frame_size, request.letterbox);
        if !self.upscaler.as_ref().is_some_and(|u| u.from_size() == made.size() && u.to_size() == size) {
            self.upscaler = Some(Upscaler::new(made.size(), size, Filter::Lanczos3)?);
        }
        let resized = resized_buffer(&mut self.resized, size)?;
        if let Some(upscaler) = self.upscaler.as_mut().filter(|_| !is_repeated) {
            upscaler.upscale(made, resized)?;
        }
        let frame = if size == frame_size {
            resized
        } else {
            let framed = resized_buffer(&mut self.framed, frame_size)?;
            if !is_repeated {
                copy_into(resized, at, framed);
            }
            framed
        };
        times.resize += start.elapsed();
        Ok(frame)
    }

    /// Fills `generated` if the plan interpolates or extrapolates.
    fn generate(
        &mut self,
        FrameRequest { plan, overlay, motion, .. }: &FrameRequest,
        times: &mut FrameTimes,
    ) -> Result<()> {
        let (previous, current, id, t) = match plan {
            FramePlan::Copy { .. } => return Ok(()),
            FramePlan::Interpolate { previous, current, id, t } => (Some(previous), current, *id, *t),
            FramePlan::Extrapolate { previous, last, id, t } => (previous.as_ref(), last, *id, *t),
        };
        let start = Instant::now();
        if current.guidance.is_none() && self.guidance.as_ref().is_none_or(|(cached, _)| *cached != id) {
            let previous = &previous.ok_or_else(nothing_generated)?.anchor;
            self.extract(*motion, previous, &current.anchor, id)?;
        }
        let guidance = match &current.guidance {
            Some(guidance) => guidance,
            None => self.guidance.as_ref().map(|(_, guidance)| guidance).ok_or_else(nothing_generated)?,
        };
        times.guidance += start.elapsed();
        let start = Instant::now();
        let generator = self.generator.as_mut().ok_or_else(nothing_generated)?;
        let picture = current.anchor.picture()?;
        let out = resized_buffer(&mut self.generated, picture.size())?;
        let report = match plan {
            FramePlan::Interpolate { previous, .. } => {
                let mut pair = AnchorPair::new(previous.anchor.picture()?, picture, guidance)?;
                if let Some(guidance) = &previous.guidance {
                    pair = pair.with_previous_depth(guidance.depth())?;
                }
                if let Some(overlay) = overlay {
                    pair = pair.with_overlay(&overlay.mask)?;
                }
                generator.generate(&pair, t, out)?
            }
            _ => {
                let mut anchor = Anchor::new(picture, guidance)?;
                if let Some(overlay) = overlay {
                    anchor = anchor.with_overlay(&overlay.mask)?;
                }
                generator.extrapolate(&anchor, t, out)?
            }
        };
        self.outcome = report.outcome;
        times.generate += start.elapsed();
        Ok(())
    }

    /// Extracts motion and depth of the pair that ends with the anchor `id`, and stores them.
    fn extract(
        &mut self,
        source: GuidanceSource,
        previous: &KeptAnchor,
        current: &KeptAnchor,
        id: AnchorId,
    ) -> Result<()> {
        let (width, height) = current.size();
        let mut guidance = match self.guidance.take() {
            Some((_, guidance)) => guidance,
            None => Guidance::new(width, height, paper::PROJECTION)?,
        };
        self.extractors.fill(source, previous, current, &mut guidance)?;
        self.guidance = Some((id, guidance));
        Ok(())
    }
}

/// Copies a picture to `(x, y)` of a frame and fills the rest with black.
fn copy_into(picture: &Picture, (x, y): (u32, u32), frame: &mut Picture) {
    let (inner, outer) = (picture.width() as usize * 4, frame.width() as usize * 4);
    frame.rgba_mut().as_chunks_mut::<4>().0.fill([0, 0, 0, 255]);
    let rows = frame.rgba_mut().chunks_exact_mut(outer).skip(y as usize);
    for (row, from) in rows.zip(picture.rgba().chunks_exact(inner)) {
        row[x as usize * 4..][..inner].copy_from_slice(from);
    }
}

/// The buffer, reallocated if it does not have `size`.
fn resized_buffer(buffer: &mut Option<Picture>, size: (u32, u32)) -> Result<&mut Picture> {
    if buffer.as_ref().is_none_or(|picture| picture.size() != size) {
        *buffer = Some(Picture::new(size.0, size.1)?);
    }
    buffer.as_mut().ok_or_else(nothing_generated)
}

/// Cannot happen: the caller has stored the value just before.
fn nothing_generated() -> Error {
    Error::new(ErrorKind::InvalidState, "nothing was generated yet")
}
