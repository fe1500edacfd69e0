//! Copies and shaders on a queue's timeline: recorded as they come, given to the queue when something must see them.

use std::collections::VecDeque;
use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::times::{Begun, Kind, Times};
use crate::gpu::{Gpu, Heap, Moment, Pipeline, Shared, Spent, failed_on};
use crate::runtime::lane::Region;
use crate::{Error, Result};

/// Bytes of a page of upload memory: more than a latent step of 720p sends up.
const PAGE: usize = 1 << 20;

/// An open command list, the memory its uploads lie in, and what the queue still works on.
pub(super) struct Recorder {
    gpu: Gpu,
    list: ID3D12GraphicsCommandList,
    allocator: ID3D12CommandAllocator,
    /// Whether anything is recorded.
    pending: bool,
    /// Buffers the open list uses, by address, and as what.
    used: Vec<(usize, D3D12_RESOURCE_STATES)>,
    /// Pages the open list reads, the last with `filled` bytes taken.
    pages: Vec<Shared>,
    filled: usize,
    /// What submitted lists use, until their moment.
    working: VecDeque<(Moment, ID3D12CommandAllocator, Vec<Shared>)>,
    /// Pages that nobody uses.
    free: Vec<Shared>,
    times: Times,
}

impl Recorder {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let allocator = allocator(gpu)?;
        let kind = gpu.anchors().kind();
        // SAFETY: a live device and allocator.
        let list = unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateCommandList", &e))?;
        let gpu = gpu.clone();
        let (used, pages, free) = (Vec::new(), Vec::new(), Vec::new());
        let (working, times) = (VecDeque::new(), Times::new(&gpu)?);
        Ok(Self { gpu, list, allocator, pending: false, used, pages, filled: 0, working, free, times })
    }

    /// Writes `bytes` into `to` from byte `at` on; they may be reused at once.
    pub(super) fn upload(&mut self, to: &ID3D12Resource, at: usize, bytes: &[u8]) -> Result<()> {
        // What is only uploaded would show it at the next submission, which may never come.
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        self.written_once(to)?;
        let mut at = at;
        for piece in bytes.chunks(PAGE) {
            if self.pages.is_empty() || self.filled + piece.len() > PAGE {
                let page = match self.free.pop() {
                    Some(page) => page,
                    None => Shared::new(&self.gpu, Heap::Upload, PAGE)?,
                };
                self.pages.push(page);
                self.filled = 0;
            }
            self.becomes(to, D3D12_RESOURCE_STATE_COPY_DEST);
            let page = self.pages.last_mut().expect("a page was pushed above");
            page.write(self.filled, piece);
            // SAFETY: an open list; both buffers are held until it has run, and the stretches lie inside them.
            unsafe {
                self.list.CopyBufferRegion(to, at as u64, page.resource(), self.filled as u64, piece.len() as u64);
            }
            self.filled += piece.len();
            at += piece.len();
            self.pending = true;
        }
        Ok(())
    }

    /// Copies regions of `from` into `to`, two different buffers of the device; `to` may be one that the processor reads.
    pub(super) fn copy(
        &mut self,
        to: &ID3D12Resource,
        from: &ID3D12Resource,
        regions: impl Iterator<Item = Region>,
    ) -> Result<()> {
        self.written_once(to)?;
        self.becomes(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.regions(to, from, regions);
        Ok(())
    }

    /// Copies regions of `from`, which the processor has written and whose state never changes, into `to`.
    pub(super) fn fill(
        &mut self,
        to: &ID3D12Resource,
        from: &ID3D12Resource,
        regions: impl Iterator<Item = Region>,
    ) -> Result<()> {
        self.written_once(to)?;
        self.regions(to, from, regions);
        Ok(())
    }

    fn regions(&mut self, to: &ID3D12Resource, from: &ID3D12Resource, regions: impl Iterator<Item = Region>) {
        self.becomes(to, D3D12_RESOURCE_STATE_COPY_DEST);
        for r in regions {
            // SAFETY: an open list; both buffers are held until it has run, and the stretches lie inside them.
            unsafe { self.list.CopyBufferRegion(to, r.to as u64, from, r.from as u64, r.len as u64) };
            self.pending = true;
        }
    }

    /// Runs a shader in `groups` groups, which reads and writes buffers of the device.
    pub(super) fn dispatch(
        &mut self,
        pipeline: &Pipeline,
        constants: &[u32],
        reads: &[&ID3D12Resource],
        writes: &[&ID3D12Resource],
        groups: u32,
    ) {
        for buffer in reads {
            self.becomes(buffer, D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE);
        }
        for buffer in writes {
            self.becomes(buffer, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        }
        pipeline.record(&self.list, constants, reads, writes, groups);
        self.pending = true;
    }

    /// A new kind of work that is timed on the device.
    pub(super) fn kind(&mut self) -> Kind {
        self.times.kind()
    }

    /// Marks the start of a piece of work behind all that is recorded, and gives the mark to the queue.
    pub(super) fn start(&mut self, kind: Kind) -> Result<Option<Begun>> {
        let begun = self.times.start(&self.list, kind);
        self.pending |= begun.is_some();
        self.submit()?;
        Ok(begun)
    }

    /// Marks its end, which goes to the queue with what is recorded next.
    pub(super) fn end(&mut self, begun: Option<Begun>) {
        if let Some(begun) = begun {
            self.times.end(&self.list, begun);
            self.pending = true;
        }
    }

    /// Lets go of a piece of work that failed: it has no time.
    pub(super) fn forget(&mut self, begun: Option<Begun>) {
        if let Some(begun) = begun {
            self.times.forget(begun);
        }
    }

    /// Time on the device of the work of a kind that has run.
    pub(super) fn spent(&mut self, kind: Kind) -> Spent {
        self.times.spent(kind)
    }

    /// Gives what is recorded to the queue.
    pub(super) fn submit(&mut self) -> Result<()> {
        if !self.pending {
            return Ok(());
        }
        let failed = |call: &str, e: &windows::core::Error| -> Error { failed_on(self.gpu.device(), call, e) };
        // First, as it may fail, and a list that is closed without another allocator can never be opened again.
        let mut reusable = None;
        while self.working.front().is_some_and(|(moment, ..)| moment.reached()) {
            if let Some((_, allocator, pages)) = self.working.pop_front() {
                self.free.extend(pages);
                reusable = Some(allocator);
            }
        }
        let next = match reusable {
            Some(allocator) => {
                // SAFETY: all lists made with it have run.
                unsafe { allocator.Reset() }.map_err(|e| failed("ID3D12CommandAllocator::Reset", &e))?;
                allocator
            }
            None => allocator(&self.gpu)?,
        };
        // SAFETY: an open list.
        unsafe { self.list.Close() }.map_err(|e| failed("ID3D12GraphicsCommandList::Close", &e))?;
        let list = self.list.cast().map_err(|e| failed("IUnknown::QueryInterface", &e))?;
        let moment = self.gpu.anchors().submit(&[list])?;
        self.times.submitted(&moment);
        // Whatever fails from here on: the queue works on these now.
        self.working.push_back((moment, self.allocator.clone(), std::mem::take(&mut self.pages)));
        self.used.clear();
        self.filled = 0;
        self.pending = false;
        // SAFETY: a closed list and an allocator that no list is recorded with.
        unsafe { self.list.Reset(&next, None) }.map_err(|e| failed("ID3D12GraphicsCommandList::Reset", &e))?;
        self.allocator = next;
        Ok(())
    }

    /// The moment when all that was submitted is done, ONNX Runtime's work on the queue too.
    pub(super) fn now(&mut self) -> Result<Moment> {
        self.submit()?;
        self.gpu.anchors().now()
    }

    /// A second write into a buffer goes into another list, as nothing orders two copies within one.
    fn written_once(&mut self, to: &ID3D12Resource) -> Result<()> {
        let key = to.as_raw() as usize;
        let written =
            self.used.iter().any(|&(address, state)| address == key && state == D3D12_RESOURCE_STATE_COPY_DEST);
        if written { self.submit() } else { Ok(()) }
    }

    /// Brings a buffer into the state that a copy or a shader needs.
    fn becomes(&mut self, buffer: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        let key = buffer.as_raw() as usize;
        let Some(entry) = self.used.iter_mut().find(|(address, _)| *address == key) else {
            // The first use in a list promotes it from COMMON, and the end of the list lets it fall back.
            self.used.push((key, state));
            return;
        };
        let before = std::mem::replace(&mut entry.1, state);
        if before != state {
            let barrier = ManuallyDrop::new(D3D12_RESOURCE_TRANSITION_BARRIER {
                // Borrowed: the call takes no reference.
                // SAFETY: the same pointer, not released by this copy.
                pResource: unsafe { std::mem::transmute_copy(buffer) },
                Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
                StateBefore: before,
                StateAfter: state,
            });
            let barrier = D3D12_RESOURCE_BARRIER {
                Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
                Anonymous: D3D12_RESOURCE_BARRIER_0 { Transition: barrier },
                ..Default::default()
            };
            // SAFETY: an open list and a live buffer in the state before.
            unsafe { self.list.ResourceBarrier(&[barrier]) };
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // The queue may still read what is freed next.
        if let Some((moment, ..)) = self.working.back() {
            moment.settle();
        }
    }
}

fn allocator(gpu: &Gpu) -> Result<ID3D12CommandAllocator> {
    // SAFETY: a live device.
    unsafe { gpu.device().CreateCommandAllocator(gpu.anchors().kind()) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateCommandAllocator", &e))
}
