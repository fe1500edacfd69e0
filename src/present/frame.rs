//! Frames as data: the presenter decides which frame is due and how it is made; a drawer makes it from these values alone.

use std::sync::Arc;
use std::time::Duration;

use super::pacing::{Due, DueFrame};
use crate::framegen::AnchorId;
use crate::guidance::Guidance;
use crate::world::{GuidanceSource, KeptAnchor};

/// Information about a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// When it is due, and its position in the stream.
    pub due: Due,
    /// How it is made.
    pub source: FrameSource,
    /// Number of the anchor it shows or starts from.
    pub previous: u64,
    /// Number of the anchor it leads to; `previous` again if it leads to none.
    pub current: u64,
    /// Time after `previous` in intervals, 0 to 1.
    pub t: f32,
    /// Whether a cut keeps it from being generated.
    pub cut: bool,
    /// Whether it is the same picture as the last drawn frame.
    pub repeated: bool,
    /// Whether an anchor replaces it because it was not prepared.
    pub unprepared: bool,
}

/// Source of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSource {
    /// An anchor.
    Anchor,
    /// A decoded picture that belongs to the next anchor.
    Decoded,
    /// Generated between two anchors.
    Generated,
    /// Extrapolated from the last anchor, because the next one is late.
    Extrapolated,
    /// A held picture: nothing may or can be generated.
    Held,
}

/// A frame that is due and not made yet, with everything that a drawer needs to know about it.
pub(super) struct FrameRequest {
    /// The information that the host gets. A drawer sets `repeated` if it made the same frame last.
    pub(super) info: FrameInfo,
    pub(super) plan: FramePlan,
    pub(super) key: FrameKey,
    /// The static overlay over the anchors.
    pub(super) overlay: Option<Arc<OverlayMask>>,
    /// Source of motion for anchors without guidance.
    pub(super) motion: GuidanceSource,
    /// Whether anchors keep their aspect ratio in frames of another.
    pub(super) letterbox: bool,
    /// Frames shown per anchor.
    #[cfg_attr(not(windows), expect(dead_code, reason = "read by the device drawer only"))]
    pub(super) multiplier: u32,
}

/// Cache key of a frame: two frames with the same key are the same picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameKey {
    /// Number of resets of the stream before the frame.
    pub(super) epoch: u64,
    pub(super) frame: DueFrame,
    /// Size of the frame if it is not that of the anchors.
    pub(super) size: Option<(u32, u32)>,
}

/// How a frame is made.
pub(super) enum FramePlan {
    /// Picture number `picture` of the anchor `current`, unchanged.
    #[cfg_attr(not(windows), expect(dead_code, reason = "the device drawer alone reads the anchor before"))]
    Copy {
        previous: Option<StreamAnchor>,
        current: StreamAnchor,
        /// Identity of `current`.
        id: AnchorId,
        picture: usize,
    },
    /// The picture at phase `t` between two anchors.
    Interpolate {
        previous: StreamAnchor,
        current: StreamAnchor,
        /// Identity of `current`.
        id: AnchorId,
        t: f32,
    },
    /// The picture `t` intervals after the anchor `last`.
    Extrapolate {
        previous: Option<StreamAnchor>,
        last: StreamAnchor,
        /// Identity of `last`.
        id: AnchorId,
        t: f32,
    },
}

/// An anchor of the stream, with the guidance that was pushed with it.
#[derive(Clone)]
pub(super) struct StreamAnchor {
    pub(super) anchor: Arc<KeptAnchor>,
    pub(super) guidance: Option<Arc<Guidance>>,
    /// Whether there is a cut between the anchor before and this one.
    pub(super) cut: bool,
}

/// Mask of a static overlay over the anchors, such as a HUD: one byte per pixel, 0 where there is no overlay.
#[derive(Debug)]
pub(super) struct OverlayMask {
    pub(super) size: (u32, u32),
    pub(super) mask: Vec<u8>,
}

/// Wall time spent on a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FrameTimes {
    /// Time spent on motion and depth.
    pub(super) guidance: Duration,
    /// Time spent on generating.
    pub(super) generate: Duration,
    /// Time spent on resizing.
    pub(super) resize: Duration,
}

/// Which frames the CPU makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DrawMode {
    /// Every frame.
    AllFrames,
    /// Anchors; the nearest anchor replaces a frame that would be generated.
    AnchorsOnly,
}

#[cfg(windows)]
mod windows {
    use super::{FramePlan, FrameRequest, OverlayMask, StreamAnchor};
    use crate::framegen::AnchorId;
    use crate::guidance::{Projection, paper};

    impl FrameRequest {
        /// `(width, height)` of the anchors.
        pub(in crate::present) fn anchor_size(&self) -> (u32, u32) {
            self.plan.anchor().anchor.size()
        }

        /// `(width, height)` of the frame.
        pub(in crate::present) fn size(&self) -> (u32, u32) {
            self.key.size.unwrap_or_else(|| self.anchor_size())
        }

        /// Milliseconds from one anchor to the next.
        pub(in crate::present) fn interval_ms(&self) -> f32 {
            let due = &self.info.due;
            due.until_ns.saturating_sub(due.since_ns).max(1) as f32 * self.multiplier as f32 / 1e6
        }
    }

    impl FramePlan {
        /// The anchor that is shown, the later anchor of an interpolation, or the start of an extrapolation.
        pub(in crate::present) fn anchor(&self) -> &StreamAnchor {
            let (Self::Copy { current: anchor, .. }
            | Self::Interpolate { current: anchor, .. }
            | Self::Extrapolate { last: anchor, .. }) = self;
            anchor
        }

        /// Identity of that anchor; `None` for a copy of one of its pictures other than the last.
        pub(in crate::present) fn anchor_id(&self) -> Option<AnchorId> {
            match self {
                Self::Copy { current, picture, .. } if picture + 1 < current.anchor.count() => None,
                Self::Copy { id, .. } | Self::Interpolate { id, .. } | Self::Extrapolate { id, .. } => Some(*id),
            }
        }
    }

    impl StreamAnchor {
        /// Camera projection of the anchor's depth.
        pub(in crate::present) fn projection(&self) -> Projection {
            self.guidance.as_ref().map_or(paper::PROJECTION, |given| given.depth().projection())
        }
    }

    impl OverlayMask {
        /// The mask resized to another size by nearest neighbour.
        pub(in crate::present) fn resized(&self, size: (u32, u32)) -> Vec<u8> {
            let nearest =
                |at: u32, from: u32, to: u32| (u64::from(2 * at + 1) * u64::from(from) / (2 * u64::from(to))) as usize;
            let columns: Vec<_> = (0..size.0).map(|x| nearest(x, self.size.0, size.0)).collect();
            let mut made = Vec::with_capacity(columns.len() * size.1 as usize);
            for y in 0..size.1 {
                let row = &self.mask[nearest(y, self.size.1, size.1) * self.size.0 as usize..];
                made.extend(columns.iter().map(|x| row[*x]));
            }
            made
        }
    }
}
