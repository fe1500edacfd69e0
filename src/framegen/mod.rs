//! Generated frames: pictures between two anchors, or extrapolated from the last one.

pub mod cpu;
#[cfg(windows)]
pub(crate) mod densify;
#[cfg(windows)]
pub mod device;
#[cfg(windows)]
pub mod fsr;
mod pair;
#[cfg(windows)]
pub mod shader;

pub use pair::{Anchor, AnchorId, AnchorPair};

use crate::{Pixel, Raster, Result};

/// Makes pictures at phases between two anchors, or extrapolated from the last one.
///
/// `P` is the pixel type of its pictures: `[u8; 4]` by default, or `[f16; 4]`.
///
/// A generator belongs to one stream and one thread at a time; it may be sent to another thread between calls.
pub trait FrameGenerator<P: Pixel = [u8; 4]>: Send {
    /// A short lower-case name, e.g. `cpu`.
    fn name(&self) -> &str;

    /// The phases that this generator supports.
    fn phases(&self) -> Phases;

    /// Makes the picture at phase `t` of `pair`: 0 is the previous anchor, 1 the current one.
    /// `out` is always overwritten completely; the report describes its contents.
    ///
    /// # Errors
    /// `InvalidArgument` if `t` is not inside (0, 1) or not a supported phase, or `out` has another size than the pair; `OutOfMemory`. After
    /// an error the contents of `out` are undefined.
    fn generate(&mut self, pair: &AnchorPair<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport>;

    /// Extrapolates the picture `t` anchor intervals after `anchor` along its motion, for a late next anchor.
    /// Limited to one interval: after that, and after a cut, a picture is held, as the report tells.
    ///
    /// # Errors
    /// `InvalidArgument` if `t` is not above 0 and finite, or `out` has another size than the anchor; `OutOfMemory`. After an error the contents
    /// of `out` are undefined.
    fn extrapolate(&mut self, anchor: &Anchor<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport>;

    /// Discards all state of earlier calls, so that the next picture depends on its arguments only.
    fn reset(&mut self);
}

/// The phases that a generator supports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Phases {
    /// Every phase inside (0, 1).
    Any,
    /// Only the middle, t = 1/2.
    OnlyHalf,
}

impl Phases {
    /// Whether `t` is one of these phases.
    pub fn contains(self, t: f32) -> bool {
        match self {
            Self::Any => t > 0.0 && t < 1.0,
            Self::OnlyHalf => t == 0.5,
        }
    }
}

/// Content of an output picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Outcome {
    /// A picture at the requested phase.
    Generated,
    /// The nearer anchor unchanged, because of a cut between the two.
    CutFallback,
    /// A held picture: after the limit of extrapolation, or without motion to extrapolate.
    Held,
}

/// Result of one call of a generator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GenerateReport {
    /// Content of the picture.
    pub outcome: Outcome,
    /// Share of the picture, 0 to 1, to which no visible pixel of the current anchor is warped: areas hidden in that anchor or
    /// outside its borders.
    pub uncovered: f32,
    /// Share of the picture, 0 to 1, without a counterpart in the previous anchor: the evidence for a cut.
    /// 0 if no cut detection was run.
    pub unexplained: f32,
}
