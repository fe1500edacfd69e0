//! The ring of frames.

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::CommandRecorder;
use super::command_recorder::Tracked;
use super::timing::Timing;
use crate::gpu::{FencePoint, Gpu, Queue, Spent, failed_on};
use crate::object_count::count_object;
use crate::{Error, ErrorKind, Result};

/// How many frames may be recorded before the first of them has run.
pub const FRAMES_IN_FLIGHT: usize = 3;

/// Resources, barriers and shaders of a frame for which there is room from the start.
const RESOURCES: usize = 64;

/// A ring of frames: the memory of what shaders are run with. Everything is made with it; a frame makes nothing and allocates
/// nothing, but for more than 64 resources or shaders in one.
///
/// Threads: one at a time; may move between them.
pub struct CommandRing {
    gpu: Gpu,
    kind: D3D12_COMMAND_LIST_TYPE,
    pub(super) heap: ID3D12DescriptorHeap,
    /// Bytes from one descriptor to the next.
    pub(super) step: u32,
    /// Descriptors of one frame.
    pub(super) room: u32,
    slots: Vec<Slot>,
    next: usize,
    timing: Option<Timing>,
}

/// One frame's part.
pub(super) struct Slot {
    /// Its first descriptor.
    pub(super) first: u32,
    allocator: ID3D12CommandAllocator,
    list: ID3D12GraphicsCommandList,
    /// Whether its time on the device is still to be looked at.
    pub(super) is_timed: bool,
    /// Until when the device may use it.
    pub(super) busy: Option<FencePoint>,
    /// What it uses, held until then.
    pub(super) tracked: Vec<Tracked>,
    /// The shaders it runs, held as well.
    pub(super) kernels: Vec<(ID3D12RootSignature, ID3D12PipelineState)>,
    /// Barriers that are collected for one call.
    pub(super) barriers: Vec<D3D12_RESOURCE_BARRIER>,
}

// SAFETY: barriers hold addresses that are read within one call; the objects are free-threaded, and lists are used by one thread
// at a time because that needs the ring exclusively.
unsafe impl Send for Slot {}

impl CommandRing {
    /// A ring for frames on a queue like `queue`, direct or compute, each with room for `descriptors` views.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`; `Unsupported` for more descriptors than a heap can have.
    pub fn new(gpu: &Gpu, queue: &Queue, descriptors: u32) -> Result<Self> {
        let kind = queue.kind();
        let all = descriptors.checked_mul(FRAMES_IN_FLIGHT as u32).filter(|all| (1..=1_000_000).contains(all));
        let Some(all) = all else {
            let why = format!("a ring for {descriptors} descriptors a frame cannot be made");
            return Err(Error::new(ErrorKind::Unsupported, why).field("descriptors"));
        };
        let wanted = D3D12_DESCRIPTOR_HEAP_DESC {
            Type: D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV,
            NumDescriptors: all,
            Flags: D3D12_DESCRIPTOR_HEAP_FLAG_SHADER_VISIBLE,
            NodeMask: 0,
        };
        let device = gpu.device();
        count_object();
        // SAFETY: a live device and a description that lives during the call.
        let heap = unsafe { device.CreateDescriptorHeap(&wanted) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateDescriptorHeap", &e))?;
        // SAFETY: a live device.
        let step = unsafe { device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV) };
        let slots =
            (0..FRAMES_IN_FLIGHT as u32).map(|i| Slot::new(gpu, kind, i * descriptors)).collect::<Result<_>>()?;
        let timing = Timing::new(gpu, queue)?;
        Ok(Self { gpu: gpu.clone(), kind, heap, step, room: descriptors, slots, next: 0, timing })
    }

    /// Starts a frame in a command list of the ring's, for [`CommandRecorder::submit`]. Waits where [`FRAMES_IN_FLIGHT`] frames are under way.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn begin(&mut self) -> Result<CommandRecorder<'_>> {
        self.free_next()?;
        let slot = &self.slots[self.next];
        // SAFETY: what was recorded with it has run, or was closed and never will.
        unsafe { slot.allocator.Reset() }
            .map_err(|e| failed_on(self.gpu.device(), "ID3D12CommandAllocator::Reset", &e))?;
        // SAFETY: a closed list and an allocator that no list is recorded with.
        unsafe { slot.list.Reset(&slot.allocator, None) }
            .map_err(|e| failed_on(self.gpu.device(), "ID3D12GraphicsCommandList::Reset", &e))?;
        let list = slot.list.clone();
        Ok(self.start(list, true))
    }

    /// Starts a frame in an engine's open `list`, which will have run at `until`, a moment that must come even if the list is
    /// never given to a queue. Waits where [`FRAMES_IN_FLIGHT`] frames are under way.
    ///
    /// Afterwards the list has another pipeline, compute root signature and descriptor heaps than before.
    ///
    /// # Errors
    /// `InvalidArgument` for a list of another device or of another type than the ring's queue, `DeviceRemoved`.
    pub fn begin_in(&mut self, list: &ID3D12GraphicsCommandList, until: &FencePoint) -> Result<CommandRecorder<'_>> {
        self.gpu.owns(list, "list")?;
        // SAFETY: a live list.
        if unsafe { list.GetType() } != self.kind {
            return Err(Error::new(ErrorKind::InvalidArgument, "the list is of another type than the ring's queue")
                .field("list"));
        }
        self.free_next()?;
        self.slots[self.next].busy = Some(until.clone());
        Ok(self.start(list.clone(), false))
    }

    /// Lets go of the resources of frames that have run: before a swap chain is resized, for one.
    pub fn let_go(&mut self) {
        for slot in &mut self.slots {
            if slot.busy.as_ref().is_none_or(FencePoint::reached) {
                slot.tracked.clear();
                slot.kernels.clear();
            }
        }
    }

    /// Waits for all frames, and lets go of their resources.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn finish(&mut self) -> Result<()> {
        self.slots.iter().filter_map(|slot| slot.busy.as_ref()).try_for_each(FencePoint::wait)?;
        self.let_go();
        Ok(())
    }

    /// Waits until the next slot can be used.
    fn free_next(&mut self) -> Result<()> {
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        let slot = &mut self.slots[self.next];
        if let Some(fence_point) = &slot.busy {
            fence_point.wait()?;
        }
        slot.busy = None;
        slot.tracked.clear();
        slot.kernels.clear();
        slot.barriers.clear();
        self.look(self.next);
        Ok(())
    }

    /// Time on the device of the frames that have run.
    pub fn spent(&mut self) -> Spent {
        for slot in 0..self.slots.len() {
            if self.slots[slot].busy.as_ref().is_none_or(FencePoint::reached) {
                self.look(slot);
            }
        }
        self.timing.as_ref().map(|timing| timing.spent).unwrap_or_default()
    }

    /// Looks at the time of a frame that has run.
    fn look(&mut self, slot: usize) {
        if std::mem::take(&mut self.slots[slot].is_timed)
            && let Some(timing) = &mut self.timing
        {
            timing.look(slot);
        }
    }

    /// Which place of the ring, from 0 to [`FRAMES_IN_FLIGHT`], the next frame takes: what belongs to the frame before it in that place can be
    /// used again once it is begun.
    pub(crate) fn place(&self) -> usize {
        self.next
    }

    /// How many frames are under way.
    pub fn under_way(&self) -> usize {
        self.slots.iter().filter(|slot| slot.busy.as_ref().is_some_and(|fence_point| !fence_point.reached())).count()
    }

    fn start(&mut self, list: ID3D12GraphicsCommandList, own: bool) -> CommandRecorder<'_> {
        let slot = self.next;
        self.next = (slot + 1) % FRAMES_IN_FLIGHT;
        let timing = self.timing.as_ref().map(|timing| (timing, slot));
        CommandRecorder::new(
            &self.gpu,
            &self.heap,
            (self.step, self.room),
            self.kind,
            timing,
            &mut self.slots[slot],
            list,
            own,
        )
    }
}

impl Drop for CommandRing {
    fn drop(&mut self) {
        // The device may still use what is freed next.
        self.slots.iter().filter_map(|slot| slot.busy.as_ref()).for_each(FencePoint::wait_ignoring_loss);
    }
}

impl std::fmt::Debug for CommandRing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let busy = self.under_way();
        write!(f, "Frames({busy} of {FRAMES_IN_FLIGHT} under way)")
    }
}

impl Slot {
    fn new(gpu: &Gpu, kind: D3D12_COMMAND_LIST_TYPE, first: u32) -> Result<Self> {
        let device = gpu.device();
        // An allocator and a list.
        (0..2).for_each(|_| count_object());
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandAllocator", &e))?;
        // SAFETY: a live device and allocator.
        let list: ID3D12GraphicsCommandList = unsafe { device.CreateCommandList(0, kind, &allocator, None) }
            .map_err(|e| failed_on(device, "ID3D12Device::CreateCommandList", &e))?;
        // SAFETY: an open list, in which nothing is.
        unsafe { list.Close() }.map_err(|e| failed_on(device, "ID3D12GraphicsCommandList::Close", &e))?;
        let (tracked, barriers) = (Vec::with_capacity(RESOURCES), Vec::with_capacity(RESOURCES));
        let kernels = Vec::with_capacity(RESOURCES);
        Ok(Self { first, allocator, list, is_timed: false, busy: None, tracked, kernels, barriers })
    }

    /// The closed list as a queue takes it.
    pub(super) fn closed(&self, gpu: &Gpu) -> Result<ID3D12CommandList> {
        self.list.cast().map_err(|e| failed_on(gpu.device(), "IUnknown::QueryInterface", &e))
    }
}
