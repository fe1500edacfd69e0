//! Inputs of a generator.

use crate::guidance::{DepthMap, Guidance};
use crate::{Error, ErrorKind, Pixel, Raster, Result};

/// Identity of an anchor in a stream. Consecutive anchors have the same epoch and consecutive indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AnchorId {
    /// Number of resets of the stream before the anchor.
    pub epoch: u64,
    /// Index of the anchor since the last reset, from 0.
    pub index: u64,
}

impl AnchorId {
    /// The anchor before this one; `None` for the first.
    pub fn before(self) -> Option<Self> {
        Some(Self { index: self.index.checked_sub(1)?, ..self })
    }
}

/// Two consecutive anchors and the guidance from the current one back to the previous one, all of one size.
#[derive(Debug, Clone, Copy)]
pub struct AnchorPair<'a, P: Pixel = [u8; 4]> {
    previous: &'a Raster<P>,
    current: &'a Raster<P>,
    guidance: &'a Guidance,
    previous_depth: Option<&'a DepthMap>,
    overlay: Option<&'a [u8]>,
    cut: bool,
}

impl<'a, P: Pixel> AnchorPair<'a, P> {
    /// Creates a pair.
    ///
    /// # Errors
    /// `InvalidArgument` if the pictures and the guidance do not all have the same size.
    pub fn new(previous: &'a Raster<P>, current: &'a Raster<P>, guidance: &'a Guidance) -> Result<Self> {
        check_size(previous.size(), current.size(), "previous")?;
        check_size(guidance.size(), current.size(), "guidance")?;
        Ok(Self { previous, current, guidance, previous_depth: None, overlay: None, cut: false })
    }

    /// Adds the depth of the previous anchor, for its pixels that the current anchor hides or that have left the picture. It is used only if it
    /// has the projection of the current anchor's depth.
    ///
    /// # Errors
    /// `InvalidArgument` if it has another size than the pair.
    pub fn with_previous_depth(mut self, depth: &'a DepthMap) -> Result<Self> {
        check_size(depth.size(), self.size(), "previous_depth")?;
        self.previous_depth = Some(depth);
        Ok(self)
    }

    /// Sets the mask of a static overlay over the current anchor, such as a HUD: one byte per pixel, row by row, 0 where there is none. A generator
    /// adds the static pixels that it detects itself.
    ///
    /// # Errors
    /// `InvalidArgument` for another number of bytes than the pair has pixels.
    pub fn with_overlay(mut self, mask: &'a [u8]) -> Result<Self> {
        check_overlay(mask, self.size())?;
        self.overlay = Some(mask);
        Ok(self)
    }

    /// States that there is a cut between the two (a scene edit, a reset), so that nothing is generated across it.
    /// Otherwise a generator detects cuts itself.
    #[must_use]
    pub fn with_cut(mut self, cut: bool) -> Self {
        self.cut = cut;
        self
    }

    /// The earlier anchor.
    pub fn previous(&self) -> &'a Raster<P> {
        self.previous
    }

    /// The later anchor.
    pub fn current(&self) -> &'a Raster<P> {
        self.current
    }

    /// Motion from the current anchor back to the previous one, and the current anchor's depth.
    pub fn guidance(&self) -> &'a Guidance {
        self.guidance
    }

    /// The previous anchor's depth, if it is known.
    pub fn previous_depth(&self) -> Option<&'a DepthMap> {
        self.previous_depth
    }

    /// Mask of the static overlay over the current anchor, if it is known.
    pub fn overlay(&self) -> Option<&'a [u8]> {
        self.overlay
    }

    /// Whether the caller stated a cut.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// `(width, height)` of the pair.
    pub fn size(&self) -> (u32, u32) {
        self.current.size()
    }
}

/// One anchor and the guidance that led to it.
#[derive(Debug, Clone, Copy)]
pub struct Anchor<'a, P: Pixel = [u8; 4]> {
    picture: &'a Raster<P>,
    guidance: &'a Guidance,
    overlay: Option<&'a [u8]>,
    after_cut: bool,
}

impl<'a, P: Pixel> Anchor<'a, P> {
    /// Creates an anchor.
    ///
    /// # Errors
    /// `InvalidArgument` if the picture and the guidance differ in size.
    pub fn new(picture: &'a Raster<P>, guidance: &'a Guidance) -> Result<Self> {
        check_size(guidance.size(), picture.size(), "guidance")?;
        Ok(Self { picture, guidance, overlay: None, after_cut: false })
    }

    /// Sets the mask of its static overlay, as [`AnchorPair::with_overlay`] does.
    ///
    /// # Errors
    /// `InvalidArgument` for another number of bytes than the anchor has pixels.
    pub fn with_overlay(mut self, mask: &'a [u8]) -> Result<Self> {
        check_overlay(mask, self.picture.size())?;
        self.overlay = Some(mask);
        Ok(self)
    }

    /// States that a cut precedes this anchor, so that its motion is invalid.
    #[must_use]
    pub fn with_cut(mut self, after_cut: bool) -> Self {
        self.after_cut = after_cut;
        self
    }

    /// The picture.
    pub fn picture(&self) -> &'a Raster<P> {
        self.picture
    }

    /// Motion from this anchor back to the one before, and this anchor's depth.
    pub fn guidance(&self) -> &'a Guidance {
        self.guidance
    }

    /// Mask of its static overlay, if it is known.
    pub fn overlay(&self) -> Option<&'a [u8]> {
        self.overlay
    }

    /// Whether the caller stated a cut before this anchor.
    pub fn is_after_cut(&self) -> bool {
        self.after_cut
    }
}

/// Checks that a mask has one byte per pixel.
fn check_overlay(mask: &[u8], (width, height): (u32, u32)) -> Result<()> {
    if mask.len() as u64 != u64::from(width) * u64::from(height) {
        let cause = format!("{} bytes for {width} x {height} pixels", mask.len());
        return Err(Error::new(ErrorKind::InvalidArgument, cause).field("overlay"));
    }
    Ok(())
}

/// Checks that `have` equals `want`.
pub(super) fn check_size(have: (u32, u32), want: (u32, u32), field: &str) -> Result<()> {
    if have != want {
        return Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("{} x {} pixels do not match the current anchor's {} x {}", have.0, have.1, want.0, want.1),
        )
        .field(field));
    }
    Ok(())
}
