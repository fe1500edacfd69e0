//! Frames of a presenter, recorded into an engine's list or submitted in one of ours.

use super::*;

impl Presenter {
    /// Makes the frame that is due at `now` and records its copy over `target` into `list`, an engine's open list. The result is the same as that
    /// of [`draw`](Self::draw). A cut that only the generator detects is counted once the frame has run.
    ///
    /// The list's state does not change except for the state of the target. The frame's memory is reused once `until` is reached, a fence point of
    /// the engine that is signalled after the list has run, early or late, in any order. If no slot is free, the call returns at once.
    ///
    /// # Errors
    /// `InvalidArgument` for a list or target that frames cannot be recorded into, for a fence that has its value already, or where latents are
    /// needed and the anchors have none; `OutOfMemory`; `DeviceRemoved`. No frame is recorded then.
    pub fn record(
        &self,
        now: u64,
        drawer: &mut DeviceDrawer,
        list: &ID3D12GraphicsCommandList,
        target: &Target,
        until: &FencePoint,
    ) -> Result<FrameResult<FrameInfo>> {
        check_recording(&drawer.gpu, list, until)?;
        if drawer.recorded.is_empty() {
            return Ok(FrameResult::NotPrepared);
        }
        let ready = match self.begin(now, drawer, target)? {
            FrameResult::Made(ready) => ready,
            FrameResult::NoAnchor => return Ok(FrameResult::NoAnchor),
            FrameResult::NotPrepared => return Ok(FrameResult::NotPrepared),
            FrameResult::QueueFull => return Ok(FrameResult::QueueFull),
        };
        let Ready { pending, format, .. } = &ready;
        let (slot, times) = match drawer.recorded.again(pending.key, *format) {
            Some(slot) => {
                drawer.copied += 1;
                (slot, PresenterStatistics::default())
            }
            None => {
                let Some(slot) = drawer.recorded.free() else { return Ok(FrameResult::QueueFull) };
                let times = self.finish(drawer, &ready, To::Recorded(slot))?.1;
                drawer.recorded.holds(slot, pending.key, *format);
                (slot, times)
            }
        };
        drawer.recorded.record(slot, list, target, until);
        self.count(&pending.shown, &times);
        Ok(FrameResult::Made(pending.shown))
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
        let ready = match self.begin(now, drawer, target)? {
            FrameResult::Made(ready) => ready,
            FrameResult::NoAnchor => return Ok(FrameResult::NoAnchor),
            FrameResult::NotPrepared => return Ok(FrameResult::NotPrepared),
            FrameResult::QueueFull => return Ok(FrameResult::QueueFull),
        };
        let (fence_point, times) = self.finish(drawer, &ready, To::Target(target))?;
        self.count(&ready.pending.shown, &times);
        Ok(FrameResult::Made((ready.pending.shown, fence_point)))
    }

    /// Selects the frame that is due at `now` and checks that it can be made.
    fn begin(&self, now: u64, drawer: &mut DeviceDrawer, target: &Target) -> Result<FrameResult<Ready>> {
        if let Some(gone) = drawer.gpu.removed() {
            return Err(gone);
        }
        self.collect_reports(drawer);
        let Some(mut pending) = self.take(now, Some(Phases::Any)) else { return Ok(FrameResult::NoAnchor) };
        let anchors = pending.plan.size();
        let size = pending.size.unwrap_or(anchors);
        if anchors != drawer.size {
            return Ok(FrameResult::NotPrepared);
        }
        target.check(&drawer.gpu, drawer.gpu.frames().kind(), size, drawer.colours)?;
        let resting = ResourceWithState { resource: &target.texture, state: target.before };
        let format = format_of(&drawer.gpu, &resting, [size.0, size.1])?;
        if !drawer.is_prepared(size, format.bytes, self.keeps_shape()) {
            return Ok(FrameResult::NotPrepared);
        }
        pending.shown.repeated = drawer.drawn == Some(pending.key);
        Ok(FrameResult::Made(Ready { pending, format }))
    }

    /// Makes the frame.
    fn finish(
        &self,
        drawer: &mut DeviceDrawer,
        Ready { pending, format }: &Ready,
        to: To<'_>,
    ) -> Result<(FencePoint, PresenterStatistics)> {
        drawer.drawn = None;
        let mut times = PresenterStatistics::default();
        let fence_point = drawer.make(pending, self, *format, to, &mut times)?;
        drawer.drawn = Some(pending.key);
        Ok((fence_point, times))
    }

    /// Adds reports and device times of frames that have run since to [`statistics`](Self::statistics).
    pub fn collect_reports(&self, drawer: &mut DeviceDrawer) {
        self.count_cuts(drawer.reports.cuts());
        let (frames, lists) = (drawer.spent(), drawer.spent_on_anchors());
        let known = (frames.frames + drawer.copied, frames.total.saturating_add(lists.total));
        let (before, spent) = std::mem::replace(&mut drawer.noted, known);
        if known.0 > before {
            self.note_spent(known.0 - before, known.1.saturating_sub(spent));
        } else {
            // Anchor work without a new frame is counted with the next frame.
            drawer.noted.1 = spent;
        }
    }
}
