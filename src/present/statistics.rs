//! Statistics of a presenter.

use std::time::Duration;

use super::frame::{FrameInfo, FrameSource, FrameTimes};

/// Counters and times of a presenter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PresenterStatistics {
    /// Anchors pushed.
    pub anchors: u64,
    /// Anchors that arrived after they were due.
    pub late: u64,
    /// How far late anchors have moved the stream's origin, in nanoseconds.
    pub slipped_ns: u64,
    /// Frames drawn, by source; a frame drawn again counts once more, and also under `repeated`.
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
    /// Frames not generated because of a cut.
    pub cuts: u64,
    /// Frames made per interval if frames are held to a budget; the others repeat the one before.
    pub made_to_anchor: u32,
    /// How often `made_to_anchor` has changed.
    pub budget_changes: u64,
    /// Frames replaced by an anchor because they were not prepared.
    pub unprepared: u64,
    /// Direct3D objects and AMD contexts created while frames were recorded or submitted.
    pub objects_made: u64,
    /// Time spent on motion and depth.
    pub guidance: Duration,
    /// Time spent on generating.
    pub generate: Duration,
    /// Time spent on resizing.
    pub resize: Duration,
}

impl PresenterStatistics {
    /// Counts a frame that was made.
    pub(super) fn count(&mut self, info: &FrameInfo, times: &FrameTimes) {
        let frames = match info.source {
            FrameSource::Anchor => &mut self.shown_anchors,
            FrameSource::Decoded => &mut self.decoded,
            FrameSource::Generated => &mut self.generated,
            FrameSource::Extrapolated => &mut self.extrapolated,
            FrameSource::Held => &mut self.held,
        };
        *frames += 1;
        self.repeated += u64::from(info.repeated);
        self.cuts += u64::from(info.cut);
        self.unprepared += u64::from(info.unprepared);
        self.guidance += times.guidance;
        self.generate += times.generate;
        self.resize += times.resize;
    }
}
