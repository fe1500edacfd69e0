//! Frames that a device makes: the presenter decides which frame is due and hands the request to a [`DeviceDrawer`]; reports come back as values.

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use super::super::device::{DeviceDrawer, FrameResult, Preparation, check_recording};
use super::super::frame::{FrameInfo, FrameRequest, FrameTimes};
use super::{Presenter, PresenterOptions};
use crate::Result;
use crate::framegen::Phases;
use crate::gpu::{FencePoint, Target};

impl Presenter {
    /// Creates everything in `drawer` that this presenter's frames of this preparation need. Another size or a wider format needs another call.
    ///
    /// # Errors
    /// `Unsupported` for more pixels than fit into the buffers of Direct3D, and if a required upscaler cannot be used;
    /// `OutOfMemory`, `DeviceRemoved`, `Device`. Nothing is prepared then.
    pub fn prepare(&self, drawer: &mut DeviceDrawer, preparation: &Preparation) -> Result<()> {
        let PresenterOptions { motion, letterbox, .. } = self.options;
        drawer.prepare(preparation, motion, letterbox, self.brings_all(preparation.pictures))
    }

    /// Makes the frame that is due at `now` and records its copy over `target` into `list`, an engine's open list. The result is the same as that
    /// of [`draw`](Self::draw). A cut that only the generator detects is counted once the frame has run.
    ///
    /// The list's state does not change except for the state of the target. The frame's memory is reused once `until` is reached, a fence point of
    /// the engine that is signalled after the list has run, early or late, in any order. If no slot is free, the call returns at once.
    ///
    /// # Errors
    /// `InvalidArgument` for a list or target that frames cannot be recorded into, for a fence that has its value already, or if latents
    /// are needed and the anchors have none; `OutOfMemory`; `DeviceRemoved`. No frame is recorded then.
    pub fn record(
        &self,
        now: u64,
        drawer: &mut DeviceDrawer,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) -> Result<FrameResult<FrameInfo>> {
        check_recording(drawer.gpu(), list, until)?;
        if !drawer.can_record() {
            return Ok(FrameResult::NotPrepared);
        }
        let Some(mut request) = self.device_request(now, drawer)? else { return Ok(FrameResult::NoAnchor) };
        let made = drawer.record(&mut request, list, target, until)?;
        Ok(made.map(|times| self.count_request(&request, &times)))
    }

    /// Makes the frame that is due at `now` on the device's queue for frames, after all earlier work of that queue; also returns the fence point at
    /// which `target` holds it.
    ///
    /// # Errors
    /// As for [`record`](Self::record).
    pub fn submit(
        &self,
        now: u64,
        drawer: &mut DeviceDrawer,
        target: &Target,
    ) -> Result<FrameResult<(FrameInfo, FencePoint)>> {
        let Some(mut request) = self.device_request(now, drawer)? else { return Ok(FrameResult::NoAnchor) };
        let made = drawer.submit(&mut request, target)?;
        Ok(made.map(|(fence_point, times)| (self.count_request(&request, &times), fence_point)))
    }

    /// Adds reports and device times of frames that have run since to [`statistics`](Self::statistics).
    pub fn collect_reports(&self, drawer: &mut DeviceDrawer) {
        let report = drawer.report();
        self.count_cuts(report.cuts);
        if report.frames > 0 {
            self.record_device_time(report.frames, report.spent);
        }
    }

    /// The frame that is due at `now`, after the reports of earlier frames were counted: they may change how many frames are made.
    fn device_request(&self, now: u64, drawer: &mut DeviceDrawer) -> Result<Option<FrameRequest>> {
        if let Some(removed) = drawer.gpu().removed() {
            return Err(removed);
        }
        self.collect_reports(drawer);
        Ok(self.request(now, Some(Phases::Any)))
    }

    /// Counts a frame that was made, and returns its information.
    fn count_request(&self, request: &FrameRequest, times: &FrameTimes) -> FrameInfo {
        self.count(&request.info, times);
        request.info
    }

    /// Recounts frames as held with a cut that were counted as generated: the device detected a cut in them afterwards.
    fn count_cuts(&self, frames: u64) {
        let statistics = &mut self.stream.lock().statistics;
        statistics.generated = statistics.generated.saturating_sub(frames);
        statistics.held += frames;
        statistics.cuts += frames;
    }
}
