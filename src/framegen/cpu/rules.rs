//! The optional rules of the generator, which measurements leave out one at a time.

use crate::rule_set;

/// A rule without which the generator still makes frames. The library applies all of them; `study ablate` measures what each
/// one gains.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Shows the nearer anchor where the two have nothing in common.
    CutDetection,
    /// Treats uniform bars at the picture's borders as static, whatever their vectors say.
    LetterboxBars,
    /// Orders surfaces by how well they match the other anchor where depth is constant.
    MatchAsDepth,
    /// Dilates a nearer surface over its anti-aliased edge where the anchors agree better with it.
    EdgeDilation,
    /// Warps what only the previous anchor shows by that anchor's depth and the camera fit.
    PreviousDepth,
    /// Lets such a pixel follow a neighbouring surface at the same distance that moves by itself.
    NeighboursMotion,
    /// Fits the camera to motion and depth, for perspective-correct phases: approaching surfaces accelerate.
    CameraFit,
    /// Chooses hole filling's candidate by likeness of brightness rather than by distance.
    FillByLikeness,
    /// Closes cracks of one pixel between vectors of one surface.
    CrackClosing,
    /// Gives a pixel beside a foreground edge the foreground's motion where the anchors then agree better.
    ForegroundEdges,
    /// Finds static overlays, such as a head-up display, where the caller gives no mask of them.
    StaticOverlays,
    /// Blends edges that no depth confirms.
    EdgeAntialiasing,
    /// Paints what neither anchor shows from the colours around it.
    Inpainting,
}

impl Rule {
    /// All rules, in the order of the stages that apply them.
    pub const ALL: [Self; 13] = [
        Self::CutDetection,
        Self::LetterboxBars,
        Self::MatchAsDepth,
        Self::EdgeDilation,
        Self::PreviousDepth,
        Self::NeighboursMotion,
        Self::CameraFit,
        Self::FillByLikeness,
        Self::CrackClosing,
        Self::ForegroundEdges,
        Self::StaticOverlays,
        Self::EdgeAntialiasing,
        Self::Inpainting,
    ];
}

impl rule_set::Rule for Rule {
    fn index(self) -> u32 {
        self as u32
    }
}

/// The rules that a generator applies.
pub(super) type Rules = rule_set::RuleSet<Rule>;
