//! Frames made on the CPU.

use std::time::Instant;

use super::area::Area;
use super::motion::{Extractors, MotionSource};
use super::presenter::{FrameKey, PendingFrame, Plan, PresenterOptions};
use super::statistics::PresenterStatistics;
use super::upscale::{Filter, Upscaler};
use crate::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome, Phases};
use crate::guidance::{Guidance, paper};
use crate::world::KeptAnchor;
use crate::{Error, ErrorKind, Picture, Result};

/// Makes frames; holds the generator and working memory.
pub(super) struct Drawer {
    generator: Option<Box<dyn FrameGenerator>>,
    extractors: Extractors,
    /// Extracted guidance and its key: epoch and index of the pair's later anchor.
    guidance: Option<((u64, u64), Guidance)>,
    generated: Option<Picture>,
    upscaler: Option<Upscaler>,
    resized: Option<Picture>,
    /// The resized picture with letterbox bars.
    framed: Option<Picture>,
    /// Key of the last frame.
    pub(super) drawn: Option<FrameKey>,
    /// Outcome of the generator's last frame.
    pub(super) outcome: Outcome,
}

impl Drawer {
    pub(super) fn new(generator: Option<Box<dyn FrameGenerator>>) -> Self {
        Self {
            generator,
            extractors: Extractors::default(),
            guidance: None,
            generated: None,
            upscaler: None,
            resized: None,
            framed: None,
            drawn: None,
            outcome: Outcome::Held,
        }
    }

    /// The phases that its generator supports.
    pub(super) fn phases(&self) -> Option<Phases> {
        self.generator.as_ref().map(|generator| generator.phases())
    }

    /// Makes the picture of a pending frame at the size of the frames.
    pub(super) fn make<'a>(
        &'a mut self,
        pending: &'a PendingFrame,
        options: &PresenterOptions,
        size: (u32, u32),
        times: &mut PresenterStatistics,
    ) -> Result<&'a Picture> {
        let again = pending.shown.repeated;
        if !again {
            self.drawn = None;
            self.generate(pending, options.motion, times)?;
        }
        let made = match &pending.plan {
            Plan::Copy { current, picture, .. } => current.anchor.read(*picture)?,
            Plan::Interpolate { .. } | Plan::Extrapolate { .. } => self.generated.as_ref().ok_or_else(nothing_made)?,
        };
        let wanted = pending.size.unwrap_or(made.size());
        if wanted != size {
            let cause = format!("{} x {} pixels where frames have {} x {}", size.0, size.1, wanted.0, wanted.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("target"));
        }
        if wanted == made.size() {
            return Ok(made);
        }
        let start = Instant::now();
        let Area { at, size } = Area::of(made.size(), wanted, options.letterbox);
        if !self.upscaler.as_ref().is_some_and(|u| u.from_size() == made.size() && u.to_size() == size) {
            self.upscaler = Some(Upscaler::new(made.size(), size, Filter::Lanczos3)?);
        }
        let resized = of_size(&mut self.resized, size)?;
        if let Some(upscaler) = self.upscaler.as_mut().filter(|_| !again) {
            upscaler.upscale(made, resized)?;
        }
        let whole = if size == wanted {
            resized
        } else {
            let framed = of_size(&mut self.framed, wanted)?;
            if !again {
                put(resized, at, framed);
            }
            framed
        };
        times.resize += start.elapsed();
        Ok(whole)
    }

    /// Fills `generated` if the plan interpolates or extrapolates.
    fn generate(
        &mut self,
        PendingFrame { plan, epoch, overlay, .. }: &PendingFrame,
        motion: MotionSource,
        times: &mut PresenterStatistics,
    ) -> Result<()> {
        let (previous, current, index, t) = match plan {
            Plan::Copy { .. } => return Ok(()),
            Plan::Interpolate { previous, current, index, t } => (Some(previous), current, *index, *t),
            Plan::Extrapolate { previous, last, index, t } => (previous.as_ref(), last, *index, *t),
        };
        let start = Instant::now();
        if current.guidance.is_none() && self.guidance.as_ref().is_none_or(|(of, _)| *of != (*epoch, index)) {
            let previous = &previous.ok_or_else(nothing_made)?.anchor;
            self.extract(motion, previous, &current.anchor, (*epoch, index))?;
        }
        let guidance = match &current.guidance {
            Some(guidance) => guidance,
            None => self.guidance.as_ref().map(|(_, guidance)| guidance).ok_or_else(nothing_made)?,
        };
        times.guidance += start.elapsed();
        let start = Instant::now();
        let generator = self.generator.as_mut().ok_or_else(nothing_made)?;
        let picture = current.anchor.picture()?;
        let out = of_size(&mut self.generated, picture.size())?;
        let report = match plan {
            Plan::Interpolate { previous, .. } => {
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

    /// Extracts motion and depth of a pair and stores them under `key`.
    fn extract(
        &mut self,
        source: MotionSource,
        previous: &KeptAnchor,
        current: &KeptAnchor,
        key: (u64, u64),
    ) -> Result<()> {
        let (width, height) = current.size();
        let mut guidance = match self.guidance.take() {
            Some((_, guidance)) => guidance,
            None => Guidance::new(width, height, paper::PROJECTION)?,
        };
        self.extractors.fill(source, previous, current, &mut guidance)?;
        self.guidance = Some((key, guidance));
        Ok(())
    }
}

/// Copies a picture to `(x, y)` of a frame and fills the rest with black.
fn put(picture: &Picture, (x, y): (u32, u32), frame: &mut Picture) {
    let (inner, outer) = (picture.width() as usize * 4, frame.width() as usize * 4);
    frame.rgba_mut().as_chunks_mut::<4>().0.fill([0, 0, 0, 255]);
    let rows = frame.rgba_mut().chunks_exact_mut(outer).skip(y as usize);
    for (row, from) in rows.zip(picture.rgba().chunks_exact(inner)) {
        row[x as usize * 4..][..inner].copy_from_slice(from);
    }
}

/// The buffer, reallocated if it does not have `size`.
fn of_size(buffer: &mut Option<Picture>, size: (u32, u32)) -> Result<&mut Picture> {
    if buffer.as_ref().is_none_or(|picture| picture.size() != size) {
        *buffer = Some(Picture::new(size.0, size.1)?);
    }
    buffer.as_mut().ok_or_else(nothing_made)
}

/// Cannot happen: the caller has stored the value just before.
fn nothing_made() -> Error {
    Error::new(ErrorKind::InvalidState, "nothing was generated yet")
}

/// Which frames the CPU makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Draws {
    /// Every frame.
    Frames,
    /// Anchors; the nearest anchor replaces a frame that would be generated.
    Anchors,
}
