//! What a presenter has done.

use std::time::Duration;

use super::presenter::{FrameInfo, FrameSource};

/// What a presenter has done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PresenterStatistics {
    /// Anchors pushed.
    pub anchors: u64,
    /// Those that came after they were due.
    pub late: u64,
    /// How long time has stood still for them, in nanoseconds.
    pub slipped_ns: u64,
    /// Frames drawn, by what they were made of; one drawn again counts once more, under `repeated` too.
    pub shown_anchors: u64,
    /// See `shown_anchors`.
    pub decoded: u64,
    /// See `shown_anchors`.
    pub generated: u64,
    /// See `shown_anchors`.
    pub extrapolated: u64,
    /// See `shown_anchors`.
    pub held: u64,
    /// See `shown_anchors`.
    pub repeated: u64,
    /// Held ones among them for which there was a cut.
    pub cuts: u64,
    /// Frames of an interval that are made, where frames are held to a budget; the others repeat the one before.
    pub made_to_anchor: u32,
    /// How often that has changed.
    pub budget_changes: u64,
    /// Frames in whose place an anchor was shown, as they were not prepared.
    pub unprepared: u64,
    /// Objects of Direct3D and contexts of AMD's that were made while frames were recorded or submitted.
    pub objects_made: u64,
    /// Time spent on motion and depth.
    pub guidance: Duration,
    /// Time spent on generating.
    pub generate: Duration,
    /// Time spent on resizing.
    pub resize: Duration,
}

impl PresenterStatistics {
    pub(super) fn count(&mut self, shown: &FrameInfo, times: &Self) {
        let of = match shown.source {
            FrameSource::Anchor => &mut self.shown_anchors,
            FrameSource::Decoded => &mut self.decoded,
            FrameSource::Generated => &mut self.generated,
            FrameSource::Extrapolated => &mut self.extrapolated,
            FrameSource::Held => &mut self.held,
        };
        *of += 1;
        self.repeated += u64::from(shown.repeated);
        self.cuts += u64::from(shown.cut);
        self.unprepared += u64::from(shown.unprepared);
        self.guidance += times.guidance;
        self.generate += times.generate;
        self.resize += times.resize;
    }
}
