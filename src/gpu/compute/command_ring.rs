//! A ring of command lists with descriptors: one slot per frame in flight.

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::CommandRecorder;
use super::command_recorder::TrackedResource;
use super::frame_timing::FrameTiming;
use crate::gpu::{FencePoint, Gpu, GpuTimeStatistics, Queue, failed_on, open_list};
use crate::object_count::count_object;
use crate::{Error, ErrorKind, Result};

/// How many frames may be recorded before the first of them has run.
pub const FRAMES_IN_FLIGHT: usize = 3;

/// Initial capacity for resources, barriers and shaders of a frame.
const RESOURCES: usize = 64;

/// A ring of slots, each with a command list, an allocator and descriptors for one frame. Creates everything in advance; a frame creates and
/// allocates nothing unless it uses more than 64 resources or shaders.
///
/// Threads: one at a time; may move between them.
pub struct CommandRing {
    gpu: Gpu,
    kind: D3D12_COMMAND_LIST_TYPE,
    pub(super) heap: ID3D12DescriptorHeap,
    /// Size of a descriptor in bytes.
    pub(super) descriptor_size: u32,
    /// Descriptors per frame.
    pub(super) descriptors: u32,
    slots: Vec<FrameSlot>,
    next: usize,
    timing: Option<FrameTiming>,
}

/// The slot of one frame.
pub(super) struct FrameSlot {
    /// Index of its first descriptor.
    pub(super) first: u32,
    allocator: ID3D12CommandAllocator,
    list: ID3D12GraphicsCommandList,
    /// Whether its timestamps have not been read yet.
    pub(super) is_timed: bool,
    /// The fence point until which the device may use it.
    pub(super) in_use_until: Option<FencePoint>,
    /// The resources it uses, held until then.
    pub(super) tracked: Vec<TrackedResource>,
    /// The pipelines it uses, held until then.
    pub(super) kernels: Vec<(ID3D12RootSignature, ID3D12PipelineState)>,
    /// Barriers collected for the next `ResourceBarrier`.
    pub(super) barriers: Vec<D3D12_RESOURCE_BARRIER>,
}

// SAFETY: barriers hold addresses that are read within one call; the objects are free-threaded, and lists are used by one thread
// at a time because that needs the ring exclusively.
unsafe impl Send for FrameSlot {}

impl CommandRing {
    /// A ring for frames on a queue of the type of `queue`, direct or compute, with `descriptors` descriptors per frame.
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
        let descriptor_size =
            unsafe { device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV) };
        let slots =
            (0..FRAMES_IN_FLIGHT as u32).map(|i| FrameSlot::new(gpu, kind, i * descriptors)).collect::<Result<_>>()?;
        let timing = FrameTiming::new(gpu, queue)?;
        Ok(Self { gpu: gpu.clone(), kind, heap, descriptor_size, descriptors, slots, next: 0, timing })
    }

    /// Starts a frame in a command list of the ring, for [`CommandRecorder::submit`]. Waits if [`FRAMES_IN_FLIGHT`] frames are in flight.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn begin(&mut self) -> Result<CommandRecorder<'_>> {
        self.free_next()?;
        let slot = &self.slots[self.next];
        // SAFETY: the allocator's last list has run, or was closed and will never run.
        unsafe { slot.allocator.Reset() }
            .map_err(|e| failed_on(self.gpu.device(), "ID3D12CommandAllocator::Reset", &e))?;
        // SAFETY: a closed list and an allocator that no list is recorded with.
        unsafe { slot.list.Reset(&slot.allocator, None) }
            .map_err(|e| failed_on(self.gpu.device(), "ID3D12GraphicsCommandList::Reset", &e))?;
        let list = slot.list.clone();
        Ok(self.start(list, true))
    }

    /// Starts a frame in an engine's open `list`, which has run once `until` is reached. The engine must signal `until` even if it never
    /// submits the list. Waits if [`FRAMES_IN_FLIGHT`] frames are in flight.
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
        self.slots[self.next].in_use_until = Some(until.clone());
        Ok(self.start(list.clone(), false))
    }

    /// Releases the resources of frames that have run, for example before a swap chain is resized.
    pub fn release_completed(&mut self) {
        for slot in &mut self.slots {
            if slot.in_use_until.as_ref().is_none_or(FencePoint::reached) {
                slot.tracked.clear();
                slot.kernels.clear();
            }
        }
    }

    /// Waits for all frames and releases their resources.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn finish(&mut self) -> Result<()> {
        self.slots.iter().filter_map(|slot| slot.in_use_until.as_ref()).try_for_each(FencePoint::wait)?;
        self.release_completed();
        Ok(())
    }

    /// Waits until the next slot is free, and clears it.
    fn free_next(&mut self) -> Result<()> {
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        let slot = &mut self.slots[self.next];
        if let Some(fence_point) = &slot.in_use_until {
            fence_point.wait()?;
        }
        slot.in_use_until = None;
        slot.tracked.clear();
        slot.kernels.clear();
        slot.barriers.clear();
        self.read_timing(self.next);
        Ok(())
    }

    /// Device time of the frames that have run.
    pub fn gpu_time(&mut self) -> GpuTimeStatistics {
        for slot in 0..self.slots.len() {
            if self.slots[slot].in_use_until.as_ref().is_none_or(FencePoint::reached) {
                self.read_timing(slot);
            }
        }
        self.timing.as_ref().map(|timing| timing.measured).unwrap_or_default()
    }

    /// Reads the timestamps of a frame that has run.
    fn read_timing(&mut self, slot: usize) {
        if std::mem::take(&mut self.slots[slot].is_timed)
            && let Some(timing) = &mut self.timing
        {
            timing.read(slot);
        }
    }

    /// Index of the next frame's slot, below [`FRAMES_IN_FLIGHT`]. After [`begin`](Self::begin), resources of the earlier frame in that
    /// slot can be reused.
    pub(crate) fn next_slot(&self) -> usize {
        self.next
    }

    /// Number of frames in flight.
    pub fn in_flight(&self) -> usize {
        self.slots
            .iter()
            .filter(|slot| slot.in_use_until.as_ref().is_some_and(|fence_point| !fence_point.reached()))
            .count()
    }

    fn start(&mut self, list: ID3D12GraphicsCommandList, own: bool) -> CommandRecorder<'_> {
        let slot = self.next;
        self.next = (slot + 1) % FRAMES_IN_FLIGHT;
        let timing = self.timing.as_ref().map(|timing| (timing, slot));
        CommandRecorder::new(
            &self.gpu,
            &self.heap,
            (self.descriptor_size, self.descriptors),
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
        // The device may still use the slots that are freed next.
        self.slots.iter().filter_map(|slot| slot.in_use_until.as_ref()).for_each(FencePoint::wait_ignoring_loss);
    }
}

impl std::fmt::Debug for CommandRing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let in_use = self.in_flight();
        write!(f, "CommandRing({in_use} of {FRAMES_IN_FLIGHT} under way)")
    }
}

impl FrameSlot {
    fn new(gpu: &Gpu, kind: D3D12_COMMAND_LIST_TYPE, first: u32) -> Result<Self> {
        let (list, allocator) = open_list(gpu, kind)?;
        // SAFETY: an open list without commands.
        unsafe { list.Close() }.map_err(|e| failed_on(gpu.device(), "ID3D12GraphicsCommandList::Close", &e))?;
        let (tracked, barriers) = (Vec::with_capacity(RESOURCES), Vec::with_capacity(RESOURCES));
        let kernels = Vec::with_capacity(RESOURCES);
        Ok(Self { first, allocator, list, is_timed: false, in_use_until: None, tracked, kernels, barriers })
    }

    /// The closed list for [`Queue::submit`].
    pub(super) fn closed(&self, gpu: &Gpu) -> Result<ID3D12CommandList> {
        self.list.cast().map_err(|e| failed_on(gpu.device(), "IUnknown::QueryInterface", &e))
    }
}
