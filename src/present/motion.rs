//! Extracts motion and depth for anchors without guidance.

use crate::guidance::{Guidance, LatentView, latent_flow, paper, picture_flow};
use crate::world::{GuidanceSource, KeptAnchor};
use crate::{Error, ErrorKind, Result};

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
pub fn extract(source: GuidanceSource, previous: &KeptAnchor, current: &KeptAnchor) -> Result<Guidance> {
    let (width, height) = current.size();
    let mut guidance = Guidance::new(width, height, paper::PROJECTION)?;
    Extractors::default().fill(source, previous, current, &mut guidance)?;
    Ok(guidance)
}

impl Extractors {
    /// Extracts motion and depth of a pair into `out`.
    pub(super) fn fill(
        &mut self,
        source: GuidanceSource,
        previous: &KeptAnchor,
        current: &KeptAnchor,
        out: &mut Guidance,
    ) -> Result<()> {
        match source {
            GuidanceSource::PictureFlow => self.flow.extract(previous.picture()?, current.picture()?, out),
            GuidanceSource::Paper => self.paper.extract(view(previous)?, view(current)?, current.size(), out),
            GuidanceSource::LatentFlow => self.latents.extract(view(previous)?, view(current)?, current.size(), out),
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
