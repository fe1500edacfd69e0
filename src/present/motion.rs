//! Extracts motion and depth for anchors without guidance.

use crate::guidance::{Guidance, LatentView, latent_flow, paper, picture_flow};
use crate::world::KeptAnchor;
use crate::{Error, ErrorKind, Result};

/// Source of motion for an anchor that is pushed without guidance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionSource {
    /// Optical flow between the two pictures.
    PictureFlow,
    /// The paper's extractor, from the two latents.
    Paper,
    /// Correspondence between the two latents.
    LatentFlow,
}

impl MotionSource {
    /// The source whose generated frames are nearest to the true ones on the scenes of this repository: `docs/motion.md`.
    pub const BEST: Self = Self::PictureFlow;
}

/// Extractors of motion and depth on the CPU, with their working memory.
#[derive(Default)]
pub(super) struct Extractors {
    flow: picture_flow::Extractor,
    paper: paper::Extractor,
    latents: latent_flow::Extractor,
}

/// Extracts motion and depth of a pair of anchors in a single call.
///
/// # Errors
/// `InvalidArgument` when the pictures differ in size, or latents are needed and are missing or differ in shape;
/// `OutOfMemory`.
pub fn extract(source: MotionSource, previous: &KeptAnchor, current: &KeptAnchor) -> Result<Guidance> {
    let (width, height) = current.size();
    let mut guidance = Guidance::new(width, height, paper::PROJECTION)?;
    Extractors::default().fill(source, previous, current, &mut guidance)?;
    Ok(guidance)
}

impl Extractors {
    /// Extracts motion and depth of a pair into `out`.
    pub(super) fn fill(
        &mut self,
        source: MotionSource,
        previous: &KeptAnchor,
        current: &KeptAnchor,
        out: &mut Guidance,
    ) -> Result<()> {
        match source {
            MotionSource::PictureFlow => self.flow.extract(previous.picture()?, current.picture()?, out),
            MotionSource::Paper => self.paper.extract(view(previous)?, view(current)?, current.size(), out),
            MotionSource::LatentFlow => self.latents.extract(view(previous)?, view(current)?, current.size(), out),
        }
    }
}

fn view(anchor: &KeptAnchor) -> Result<LatentView<'_>> {
    let [channels, height, width] = anchor.latent_shape().map(|n| n as usize);
    LatentView::new(channels, height, width, anchor.latent()?).map_err(|_| {
        Error::new(
            ErrorKind::InvalidArgument,
            "a picture that no world made has no latent, and its motion is asked of it",
        )
        .field("anchor")
        .remedy("Use motion from pictures")
    })
}
