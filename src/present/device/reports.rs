//! Reports of the device on frames that have run: detected cuts and device times.

use std::time::Duration;

use super::cut_reports::CutReports;
use crate::Result;
use crate::gpu::Gpu;
use crate::gpu::compute::GpuTimeStatistics;

/// Results of the frames that have finished since the last report.
#[derive(Debug, Clone, Copy)]
pub(in crate::present) struct DeviceReport {
    /// Frames counted as generated that show an anchor, because the device detected a cut.
    pub(in crate::present) cuts: u64,
    /// Frames whose device time is known.
    pub(in crate::present) frames: u64,
    /// Device time of these frames, and of the work on anchors since the last report with frames.
    pub(in crate::present) spent: Duration,
}

/// Collects cuts and device times of finished frames.
pub(super) struct ReportCollector {
    pub(super) cuts: CutReports,
    /// Repeated frames that a list of the engine's copied from memory, without other work of the device.
    repeats: u64,
    /// Frames that were reported before.
    reported_frames: u64,
    /// Device time that was reported before.
    reported_time: Duration,
}

impl ReportCollector {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self { cuts: CutReports::new(gpu)?, repeats: 0, reported_frames: 0, reported_time: Duration::ZERO })
    }

    /// Counts a repeated frame that took no work of the device.
    pub(super) fn count_repeat(&mut self) {
        self.repeats += 1;
    }

    /// The next report. `cuts`: of frames that have finished since the last one. `frames` and `anchors`: device times since the drawer was created.
    pub(super) fn next(&mut self, cuts: u64, frames: GpuTimeStatistics, anchors: GpuTimeStatistics) -> DeviceReport {
        let count = frames.count + self.repeats;
        if count <= self.reported_frames {
            // Work on anchors without a new frame is reported with the next frame.
            return DeviceReport { cuts, frames: 0, spent: Duration::ZERO };
        }
        let time = frames.total.saturating_add(anchors.total);
        let spent = time.saturating_sub(self.reported_time);
        let new_frames = count - self.reported_frames;
        (self.reported_frames, self.reported_time) = (count, time);
        DeviceReport { cuts, frames: new_frames, spent }
    }
}
