//! Records copies and dispatches in a command list, and submits it to the queue for anchors when later work depends on it.

use std::collections::VecDeque;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::interval_times::{IntervalTimes, TimedInterval, WorkKind};
use crate::gpu::compute::transition;
use crate::gpu::{FencePoint, Gpu, GpuTimeStatistics, Heap, MappedBuffer, Pipeline, failed_on, open_list};
use crate::runtime::execution_context::Region;
use crate::{Error, Result};

/// Size in bytes of a page of upload memory: more than a latent step at 720p uploads.
const PAGE: usize = 1 << 20;

/// An open command list, its upload memory, and the memory and allocators that the queue still uses.
///
/// Two lists take turns. The second is opened before the first is closed, because opening may fail: the recorded commands are then
/// either submitted, or stay recorded for the next attempt.
pub(super) struct Recorder {
    gpu: Gpu,
    list: ID3D12GraphicsCommandList,
    allocator: ID3D12CommandAllocator,
    other: ID3D12GraphicsCommandList,
    /// The allocator of the other list while that is open.
    next: Option<ID3D12CommandAllocator>,
    /// Whether the open list has recorded commands.
    pending: bool,
    /// Number of lists with recorded work that could not be submitted.
    lost_submissions: u64,
    /// Buffers that the open list uses, by address, with their current state.
    used: Vec<(usize, D3D12_RESOURCE_STATES)>,
    /// Clearings of new buffers in the open list. If it is not submitted, they are recorded again: no later call repeats them.
    clearings: Vec<Clearing>,
    /// Upload pages that the open list reads; `filled` bytes of the last are in use.
    pages: Vec<MappedBuffer>,
    filled: usize,
    /// Allocators and pages of submitted lists, with the fence point at which they may be reused.
    in_flight: VecDeque<(FencePoint, ID3D12CommandAllocator, Vec<MappedBuffer>)>,
    /// Upload pages that are not in use.
    free: Vec<MappedBuffer>,
    times: IntervalTimes,
}

/// The copies by which a new buffer is cleared.
struct Clearing {
    buffer: ID3D12Resource,
    zeroes: ID3D12Resource,
    regions: Vec<Region>,
}

impl Recorder {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let (list, allocator) = open_list(gpu, gpu.anchors().kind())?;
        let (other, next) = open_list(gpu, gpu.anchors().kind())?;
        let (gpu, next) = (gpu.clone(), Some(next));
        let (used, pages, free, clearings) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (in_flight, times) = (VecDeque::new(), IntervalTimes::new(&gpu)?);
        let (pending, lost_submissions, filled) = (false, 0, 0);
        Ok(Self {
            gpu,
            list,
            allocator,
            other,
            next,
            pending,
            lost_submissions,
            used,
            clearings,
            pages,
            filled,
            in_flight,
            free,
            times,
        })
    }

    /// Writes `bytes` into `to` from byte `at` on; `bytes` may be reused at once.
    pub(super) fn upload(&mut self, to: &ID3D12Resource, at: usize, bytes: &[u8]) -> Result<()> {
        // Recording does not fail on a removed device; only the next submission would, and it may never come.
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        self.submit_if_written(to)?;
        let mut at = at;
        for piece in bytes.chunks(PAGE) {
            if self.pages.is_empty() || self.filled + piece.len() > PAGE {
                let page = match self.free.pop() {
                    Some(page) => page,
                    None => MappedBuffer::new(&self.gpu, Heap::Upload, PAGE)?,
                };
                self.pages.push(page);
                self.filled = 0;
            }
            self.require_state(to, D3D12_RESOURCE_STATE_COPY_DEST);
            let page = self.pages.last_mut().expect("a page was pushed above");
            page.write(self.filled, piece);
            // SAFETY: an open list; both buffers are held until it has run, and the ranges are inside them.
            unsafe {
                self.list.CopyBufferRegion(to, at as u64, page.resource(), self.filled as u64, piece.len() as u64);
            }
            self.filled += piece.len();
            at += piece.len();
            self.pending = true;
        }
        Ok(())
    }

    /// Copies regions of `from` into `to`, two different buffers of the device; `to` may be a readback buffer.
    pub(super) fn copy(
        &mut self,
        to: &ID3D12Resource,
        from: &ID3D12Resource,
        regions: impl Iterator<Item = Region>,
    ) -> Result<()> {
        self.submit_if_written(to)?;
        self.require_state(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.regions(to, from, regions);
        Ok(())
    }

    /// Copies regions of `from`, an upload buffer, whose state never changes, into `to`.
    pub(super) fn copy_from_upload(
        &mut self,
        to: &ID3D12Resource,
        from: &ID3D12Resource,
        regions: impl Iterator<Item = Region>,
    ) -> Result<()> {
        self.submit_if_written(to)?;
        self.regions(to, from, regions);
        Ok(())
    }

    /// Clears a new buffer from an upload buffer of zeroes, even if the next submissions fail.
    pub(super) fn clear_new(
        &mut self,
        buffer: &ID3D12Resource,
        zeroes: &ID3D12Resource,
        regions: Vec<Region>,
    ) -> Result<()> {
        self.copy_from_upload(buffer, zeroes, regions.iter().copied())?;
        self.clearings.push(Clearing { buffer: buffer.clone(), zeroes: zeroes.clone(), regions });
        Ok(())
    }

    /// How often recorded work was lost because it could not be submitted.
    pub(super) fn lost_submissions(&self) -> u64 {
        self.lost_submissions
    }

    /// Starts an open list after one that was not submitted.
    fn begin_again(&mut self) {
        self.begin();
        let clearings = std::mem::take(&mut self.clearings);
        for Clearing { buffer, zeroes, regions } in &clearings {
            self.regions(buffer, zeroes, regions.iter().copied());
        }
        self.clearings = clearings;
    }

    fn regions(&mut self, to: &ID3D12Resource, from: &ID3D12Resource, regions: impl Iterator<Item = Region>) {
        self.require_state(to, D3D12_RESOURCE_STATE_COPY_DEST);
        for r in regions {
            // SAFETY: an open list; both buffers are held until it has run, and the ranges are inside them.
            unsafe { self.list.CopyBufferRegion(to, r.to as u64, from, r.from as u64, r.len as u64) };
            self.pending = true;
        }
    }

    /// Dispatches `groups` thread groups of a shader that reads and writes buffers of the device.
    pub(super) fn dispatch(
        &mut self,
        pipeline: &Pipeline,
        constants: &[u32],
        reads: &[&ID3D12Resource],
        writes: &[&ID3D12Resource],
        groups: u32,
    ) {
        for buffer in reads {
            self.require_state(buffer, D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE);
        }
        for buffer in writes {
            self.require_state(buffer, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        }
        pipeline.record(&self.list, constants, reads, writes, groups);
        self.pending = true;
    }

    /// A new kind of work that is timed on the device.
    pub(super) fn kind(&mut self) -> WorkKind {
        self.times.kind()
    }

    /// Records a timestamp for the start of an interval after all recorded commands, and submits.
    pub(super) fn start(&mut self, kind: WorkKind) -> Result<Option<TimedInterval>> {
        let interval = self.times.start(&self.list, kind);
        self.pending |= interval.is_some();
        match self.submit() {
            Ok(()) => Ok(interval),
            Err(error) => {
                self.cancel(interval);
                Err(error)
            }
        }
    }

    /// Records the end timestamp of an interval. It is submitted with the commands recorded next.
    pub(super) fn end(&mut self, interval: Option<TimedInterval>) {
        if let Some(interval) = interval {
            self.times.end(&self.list, interval);
            self.pending = true;
        }
    }

    /// Discards an interval whose work failed: its time is not counted.
    pub(super) fn cancel(&mut self, interval: Option<TimedInterval>) {
        if let Some(interval) = interval {
            self.times.cancel(interval);
        }
    }

    /// Device time of all completed work of a kind.
    pub(super) fn gpu_time(&mut self, kind: WorkKind) -> GpuTimeStatistics {
        self.times.gpu_time(kind)
    }

    /// Submits the recorded commands.
    pub(super) fn submit(&mut self) -> Result<()> {
        if !self.pending {
            return Ok(());
        }
        self.prepare()?;
        self.submit_list(Vec::new(), None).map(drop)
    }

    /// Submits the recorded commands and opens the other list. The commands recorded next can then be submitted without an
    /// allocation, if no buffer is written twice.
    pub(super) fn submit_and_reserve(&mut self) -> Result<()> {
        self.submit()?;
        self.prepare()
    }

    /// Opens the other list, so that the recorded commands can be submitted without an allocation.
    pub(super) fn reserve(&mut self) -> Result<()> {
        self.prepare()
    }

    /// Submits closed lists, whose work `interval` measures, and after them the recorded commands: all or nothing.
    pub(super) fn submit_after(
        &mut self,
        lists: Vec<ID3D12CommandList>,
        interval: Option<TimedInterval>,
    ) -> Result<FencePoint> {
        if let Err(error) = self.prepare() {
            self.cancel(interval);
            return Err(error);
        }
        self.end(interval);
        self.submit_list(lists, None)
    }

    /// Submits the recorded commands, and after them a closed list, which expects all buffers in the state COMMON.
    pub(super) fn submit_then(&mut self, list: ID3D12CommandList) -> Result<FencePoint> {
        // Within one call of ExecuteCommandLists, buffers keep their state from list to list; they decay to COMMON only at its end.
        if !self.used.is_empty() {
            self.submit()?;
        }
        if !self.pending {
            return self.gpu.anchors().submit(&[list]);
        }
        self.prepare()?;
        self.submit_list(Vec::new(), Some(list))
    }

    /// Discards the recorded commands.
    pub(super) fn discard(&mut self) -> Result<()> {
        let failed = |call: &str, e: &windows::core::Error| -> Error { failed_on(self.gpu.device(), call, e) };
        self.lost_submissions += 1;
        // SAFETY: an open list.
        _ = unsafe { self.list.Close() };
        // SAFETY: no list recorded with it was submitted.
        unsafe { self.allocator.Reset() }.map_err(|e| failed("ID3D12CommandAllocator::Reset", &e))?;
        // SAFETY: a closed list and an allocator that no open list uses.
        unsafe { self.list.Reset(&self.allocator, None) }
            .map_err(|e| failed("ID3D12GraphicsCommandList::Reset", &e))?;
        self.times.discard_open();
        self.begin_again();
        Ok(())
    }

    /// Keeps memory that the open list reads until the list has run.
    pub(super) fn hold(&mut self, memory: MappedBuffer) {
        self.pages.push(memory);
        // It is not an upload page: the next upload starts a new one.
        self.filled = PAGE;
    }

    /// Opens the other list, with an allocator that is no longer in use.
    fn prepare(&mut self) -> Result<()> {
        if self.next.is_some() {
            return Ok(());
        }
        let failed = |call: &str, e: &windows::core::Error| -> Error { failed_on(self.gpu.device(), call, e) };
        let mut reusable = None;
        while self.in_flight.front().is_some_and(|(fence_point, ..)| fence_point.reached()) {
            if let Some((_, allocator, pages)) = self.in_flight.pop_front() {
                self.free.extend(pages.into_iter().filter(|memory| memory.len() == PAGE));
                reusable = Some(allocator);
            }
        }
        let next = match reusable {
            Some(allocator) => {
                // SAFETY: all lists recorded with it have run.
                unsafe { allocator.Reset() }.map_err(|e| failed("ID3D12CommandAllocator::Reset", &e))?;
                allocator
            }
            None => allocator(&self.gpu)?,
        };
        // SAFETY: a closed list and an allocator that no open list uses.
        unsafe { self.other.Reset(&next, None) }.map_err(|e| failed("ID3D12GraphicsCommandList::Reset", &e))?;
        self.next = Some(next);
        Ok(())
    }

    /// Closes the open list and submits it after `lists` and before `last`. The other list must be open.
    fn submit_list(
        &mut self,
        mut lists: Vec<ID3D12CommandList>,
        last: Option<ID3D12CommandList>,
    ) -> Result<FencePoint> {
        // SAFETY: an open list.
        let closed = unsafe { self.list.Close() };
        let closed = closed.and_then(|()| self.list.cast());
        let submitted = match closed {
            Ok(list) => {
                lists.push(list);
                lists.extend(last);
                self.gpu.anchors().submit(&lists)
            }
            Err(e) => {
                // The list is recorded anew next, for which it must not be open.
                // SAFETY: a list that may be open.
                _ = unsafe { self.list.Close() };
                Err(failed_on(self.gpu.device(), "ID3D12GraphicsCommandList::Close", &e))
            }
        };
        if let Some(next) = self.next.take() {
            std::mem::swap(&mut self.list, &mut self.other);
            let closed = std::mem::replace(&mut self.allocator, next);
            match &submitted {
                Ok(fence_point) => {
                    self.times.submitted(fence_point);
                    self.in_flight.push_back((fence_point.clone(), closed, std::mem::take(&mut self.pages)));
                }
                Err(_) => self.times.discard_open(),
            }
        }
        match submitted {
            Ok(_) => {
                self.clearings.clear();
                self.begin();
            }
            Err(_) => {
                self.lost_submissions += 1;
                self.begin_again();
            }
        }
        submitted
    }

    /// Resets the state that belongs to the previous list.
    fn begin(&mut self) {
        self.pages.clear();
        self.used.clear();
        self.filled = 0;
        self.pending = false;
    }

    /// Submits, and returns the fence point at which all submitted work is done, ONNX Runtime's work on the queue included.
    pub(super) fn submit_and_signal(&mut self) -> Result<FencePoint> {
        self.submit()?;
        self.gpu.anchors().signal()
    }

    /// Submits if the open list already writes `to`: nothing orders two copies to one buffer within a list.
    fn submit_if_written(&mut self, to: &ID3D12Resource) -> Result<()> {
        let key = to.as_raw() as usize;
        let written =
            self.used.iter().any(|&(address, state)| address == key && state == D3D12_RESOURCE_STATE_COPY_DEST);
        if written { self.submit() } else { Ok(()) }
    }

    /// Transitions a buffer to the state that a copy or a shader needs.
    fn require_state(&mut self, buffer: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        let key = buffer.as_raw() as usize;
        let Some(entry) = self.used.iter_mut().find(|(address, _)| *address == key) else {
            // The first use in a list promotes the buffer from COMMON; after execution it decays to COMMON.
            self.used.push((key, state));
            return;
        };
        let before = std::mem::replace(&mut entry.1, state);
        if before != state {
            // SAFETY: an open list and a live buffer in the state before.
            unsafe { self.list.ResourceBarrier(&[transition(buffer, before, state)]) };
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // The queue may still read the memory that is freed next.
        if let Some((fence_point, ..)) = self.in_flight.back() {
            fence_point.wait_ignoring_loss();
        }
    }
}

fn allocator(gpu: &Gpu) -> Result<ID3D12CommandAllocator> {
    // SAFETY: a live device.
    unsafe { gpu.device().CreateCommandAllocator(gpu.anchors().kind()) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateCommandAllocator", &e))
}
