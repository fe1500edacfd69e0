//! Generated frames: pictures between two anchors.

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

pub use pair::{Anchor, AnchorPair};

use crate::{Pixel, Raster, Result};

/// Makes pictures at phases between two anchors, or beyond the last one.
///
/// `P` is what a pixel of its pictures is: `[u8; 4]` where nothing is said, or `[f16; 4]`.
///
/// A generator belongs to one stream and one thread at a time; it may be sent to another thread between calls.
pub trait FrameGenerator<P: Pixel = [u8; 4]>: Send {
    /// A short lower-case name, e.g. `cpu`.
    fn name(&self) -> &str;

    /// The phases this generator can do.
    fn phases(&self) -> Phases;

    /// Makes the picture at phase `t` of `pair`: 0 is the previous anchor, 1 the current one.
    /// `out` is overwritten whole, also where nothing could be generated; the report says what it holds.
    ///
    /// # Errors
    /// `InvalidArgument` when `t` is not inside (0, 1) or not a phase this generator can do, or `out` has not the
    /// pair's size; `OutOfMemory` when working memory cannot be had. After an error `out` holds nothing of use.
    fn generate(&mut self, pair: &AnchorPair<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport>;

    /// Makes the picture `t` anchor intervals after `anchor`, as if its motion went on: for an anchor that comes late.
    /// Bounded to one interval: later than that, and after a cut, a picture is held and the report says so.
    ///
    /// # Errors
    /// `InvalidArgument` when `t` is not above 0 and finite, or `out` has not the anchor's size; `OutOfMemory` when
    /// working memory cannot be had. After an error `out` holds nothing of use.
    fn extrapolate(&mut self, anchor: &Anchor<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport>;

    /// Forgets everything that earlier calls left behind, so that the next picture depends on its arguments alone.
    fn reset(&mut self);
}

/// The phases a generator can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Phases {
    /// Every phase inside (0, 1).
    Any,
    /// Only the middle, t = 1/2.
    OnlyHalf,
}

impl Phases {
    /// Whether `t` is one of them.
    pub fn contains(self, t: f32) -> bool {
        match self {
            Self::Any => t > 0.0 && t < 1.0,
            Self::OnlyHalf => t == 0.5,
        }
    }
}

/// What a generated picture holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Outcome {
    /// A picture at the phase asked for.
    Generated,
    /// The nearer anchor unchanged, as a cut lies between the two.
    CutFallback,
    /// An earlier picture once more: past the bound of extrapolation, or nothing to extrapolate from.
    Held,
}

/// What happened in one call of a generator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GenerateReport {
    /// What the picture holds.
    pub outcome: Outcome,
    /// Share of the picture, 0 to 1, that nothing visible in the current anchor lands on: what it hides, and what has
    /// left it.
    pub uncovered: f32,
    /// Share of the picture, 0 to 1, for which no counterpart was found in the previous anchor: the evidence for a cut.
    /// 0 where no evidence was sought.
    pub unexplained: f32,
}
