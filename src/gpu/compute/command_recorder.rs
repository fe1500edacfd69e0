//! Records the commands of one frame and tracks the states of its resources.

use std::ffi::CStr;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::barrier::{transition, uav_barrier, uav_barrier_of_all};
use super::command_ring::FrameSlot;
use super::frame_timing::FrameTiming;
use super::{Kernel, ResourceWithState, View};
use crate::gpu::queue::EVENT_OF_BYTES;
use crate::gpu::{FencePoint, Gpu, Queue, failed_on, texture};
use crate::{Error, ErrorKind, Result};

/// The state in which a shader reads a resource.
const SHADER_READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
/// The state in which a shader writes a resource.
const SHADER_WRITE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Records one frame. If it is dropped before it is submitted, a frame in the ring's own list is discarded; a frame in an engine's
/// list keeps its recorded commands, and every resource is returned to its initial state.
pub struct CommandRecorder<'a> {
    gpu: &'a Gpu,
    heap: &'a ID3D12DescriptorHeap,
    /// Size of a descriptor in bytes.
    descriptor_size: u32,
    free_descriptors: u32,
    /// Index of the next free descriptor.
    next: u32,
    kind: D3D12_COMMAND_LIST_TYPE,
    /// The ring's timestamps, and the frame's slot.
    timing: Option<(&'a FrameTiming, usize)>,
    slot: &'a mut FrameSlot,
    list: ID3D12GraphicsCommandList,
    is_own_list: bool,
    is_open: bool,
    /// Whether writes of the last dispatch may be incomplete, so that the next dispatch needs a UAV barrier.
    has_pending_writes: bool,
}

/// A descriptor table: inputs, then outputs.
pub(crate) struct Table {
    handle: D3D12_GPU_DESCRIPTOR_HANDLE,
    inputs: u32,
    outputs: u32,
}

/// A resource of a frame with its current state, and the state to leave it in at the end: its initial one, unless
/// [`set_final_state`](CommandRecorder::set_final_state) was called.
pub(super) struct TrackedResource {
    resource: ID3D12Resource,
    final_state: D3D12_RESOURCE_STATES,
    current: D3D12_RESOURCE_STATES,
}

/// Whether lists of a compute queue may name this state.
pub(crate) fn compute_queue_knows(state: D3D12_RESOURCE_STATES) -> bool {
    let known = SHADER_WRITE
        | SHADER_READ
        | D3D12_RESOURCE_STATE_COPY_DEST
        | D3D12_RESOURCE_STATE_COPY_SOURCE
        | D3D12_RESOURCE_STATE_VERTEX_AND_CONSTANT_BUFFER
        | D3D12_RESOURCE_STATE_INDIRECT_ARGUMENT;
    state & !known == D3D12_RESOURCE_STATE_COMMON
}

impl<'a> CommandRecorder<'a> {
    #[expect(clippy::too_many_arguments, reason = "the parts of the ring that a frame has")]
    pub(super) fn new(
        gpu: &'a Gpu,
        heap: &'a ID3D12DescriptorHeap,
        (descriptor_size, free_descriptors): (u32, u32),
        kind: D3D12_COMMAND_LIST_TYPE,
        timing: Option<(&'a FrameTiming, usize)>,
        slot: &'a mut FrameSlot,
        list: ID3D12GraphicsCommandList,
        is_own_list: bool,
    ) -> Self {
        let next = slot.first;
        let (is_open, has_pending_writes) = (true, false);
        let frame = Self {
            gpu,
            heap,
            descriptor_size,
            free_descriptors,
            next,
            kind,
            timing,
            slot,
            list,
            is_own_list,
            is_open,
            has_pending_writes,
        };
        if let Some((timing, slot)) = frame.timing {
            timing.start(&frame.list, slot);
        }
        frame.resume();
        frame
    }

    /// Closes the frame and submits it to `queue`, of the ring's queue type; returns the fence point of its completion.
    ///
    /// # Errors
    /// `InvalidArgument` for a frame in an engine's list, which the engine submits, and for a queue of another kind;
    /// `DeviceRemoved`.
    pub fn submit(mut self, queue: &Queue) -> Result<FencePoint> {
        let refuse = |why: &str, field: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        if !self.is_own_list {
            return refuse("the frame is in an engine's list, which the engine submits", "frame");
        }
        if queue.kind() != self.kind {
            return refuse("the queue is of another kind than the frame's list", "queue");
        }
        self.gpu.owns(queue.d3d12(), "queue")?;
        self.end();
        let device = self.gpu.device();
        // SAFETY: an open list.
        unsafe { self.list.Close() }.map_err(|e| failed_on(device, "ID3D12GraphicsCommandList::Close", &e))?;
        self.is_open = false;
        let fence_point = queue.submit(&[self.slot.closed(self.gpu)?])?;
        self.slot.in_use_until = Some(fence_point.clone());
        Ok(fence_point)
    }

    /// Binds resources and dispatches a shader with `groups` thread groups, after a barrier for earlier writes of the frame.
    ///
    /// # Errors
    /// As for [`bind`](Self::bind). Nothing is recorded then.
    pub(crate) fn run(
        &mut self,
        kernel: &Kernel,
        constants: &[u32],
        inputs: &[View<'_>],
        outputs: &[View<'_>],
        groups: [u32; 3],
    ) -> Result<()> {
        let table = self.bind(inputs, outputs)?;
        self.dispatch(&table, kernel, constants, groups);
        Ok(())
    }

    /// Transitions resources to the states for shader reads and writes, and writes their descriptors. The table is valid for any number of
    /// dispatches until something else is recorded.
    ///
    /// # Errors
    /// `InvalidArgument` for a resource in a state that the queue does not know, or given in two states; `Unsupported` when the
    /// frame has no descriptor left. Nothing is recorded then.
    pub(crate) fn bind(&mut self, inputs: &[View<'_>], outputs: &[View<'_>]) -> Result<Table> {
        let read = |view: &View<'_>| inputs.iter().any(|input| input.resource().resource == view.resource().resource);
        assert!(!outputs.iter().any(read), "a dispatch does not write what it reads");
        self.check_descriptors((inputs.len() + outputs.len()) as u32)?;
        inputs.iter().chain(outputs).try_for_each(|view| self.check_state(&view.resource()))?;

        inputs.iter().for_each(|view| self.require_state(&view.resource(), SHADER_READ));
        outputs.iter().for_each(|view| self.require_state(&view.resource(), SHADER_WRITE));
        self.flush();
        self.has_pending_writes = false;
        let handle = self.describe(inputs, outputs);
        Ok(Table { handle, inputs: inputs.len() as u32, outputs: outputs.len() as u32 })
    }

    /// Checks that `descriptors` descriptors are free.
    pub(crate) fn check_descriptors(&self, descriptors: u32) -> Result<()> {
        if descriptors > self.free_descriptors {
            return Err(Error::new(ErrorKind::Unsupported, "the frame has no descriptor left")
                .remedy("Make the ring with more descriptors"));
        }
        Ok(())
    }

    /// Dispatches a shader with `groups` thread groups and the last bound table, after a barrier for the previous dispatch's writes.
    pub(crate) fn dispatch(&mut self, table: &Table, kernel: &Kernel, constants: &[u32], groups: [u32; 3]) {
        let found = [constants.len() as u32, table.inputs, table.outputs];
        let expected = [kernel.shape.constants, kernel.shape.inputs, kernel.shape.outputs];
        assert_eq!(found, expected, "constants, inputs and outputs are the kernel's");
        if self.has_pending_writes {
            // SAFETY: an open list.
            unsafe { self.list.ResourceBarrier(&[uav_barrier_of_all()]) };
        }
        self.has_pending_writes = true;
        if !self.slot.kernels.iter().any(|(_, pipeline)| *pipeline == kernel.pipeline) {
            self.slot.kernels.push((kernel.root.clone(), kernel.pipeline.clone()));
        }
        // SAFETY: an open list; the ring holds kernel, heap and resources until it has run.
        unsafe {
            self.list.SetComputeRootSignature(&kernel.root);
            self.list.SetPipelineState(&kernel.pipeline);
            self.list.SetComputeRoot32BitConstants(0, constants.len() as u32, constants.as_ptr().cast(), 0);
            self.list.SetComputeRootDescriptorTable(1, table.handle);
            self.list.Dispatch(groups[0], groups[1], groups[2]);
        }
    }

    /// Copies a picture from a buffer, laid out as `rows`, to a whole texture.
    ///
    /// # Errors
    /// `InvalidArgument` for a resource in a state that the queue does not know, or given in two states. Nothing is recorded then.
    pub(crate) fn copy_rows(
        &mut self,
        from: &ResourceWithState<'_>,
        rows: D3D12_PLACED_SUBRESOURCE_FOOTPRINT,
        to: &ResourceWithState<'_>,
    ) -> Result<()> {
        self.check_state(from)?;
        self.check_state(to)?;
        self.require_state(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.require_state(to, D3D12_RESOURCE_STATE_COPY_DEST);
        self.flush();
        // The ring holds both resources.
        texture::copy(&self.list, &texture::first_level(to.resource), &texture::placed(from.resource, rows));
        Ok(())
    }

    /// Copies the first `bytes` bytes of a buffer to byte `at` of another.
    ///
    /// # Errors
    /// As for [`copy_rows`](Self::copy_rows).
    pub(crate) fn copy_bytes(
        &mut self,
        from: &ResourceWithState<'_>,
        bytes: u64,
        to: &ResourceWithState<'_>,
        at: u64,
    ) -> Result<()> {
        self.check_state(from)?;
        self.check_state(to)?;
        self.require_state(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.require_state(to, D3D12_RESOURCE_STATE_COPY_DEST);
        self.flush();
        // SAFETY: an open list, and live buffers of its device in the states for it, which the ring holds.
        unsafe { self.list.CopyBufferRegion(to.resource, at, from.resource, 0, bytes) };
        Ok(())
    }

    /// Sets the state in which a resource is left at the end of the frame, instead of its initial state.
    pub(crate) fn set_final_state(&mut self, resource: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        if let Some(at) = self.index_of_tracked(resource) {
            self.slot.tracked[at].final_state = state;
        }
    }

    /// Begins a named event that lasts until [`end_event`](Self::end_event), for GPU profilers.
    pub(crate) fn begin_event(&self, name: &CStr) {
        let bytes = name.to_bytes_with_nul();
        // SAFETY: an open list, and a text of that length, which is copied.
        unsafe { self.list.BeginEvent(EVENT_OF_BYTES, Some(bytes.as_ptr().cast()), bytes.len() as u32) };
    }

    /// Ends the last PIX event.
    pub(crate) fn end_event(&self) {
        // SAFETY: an open list, in which an event was begun.
        unsafe { self.list.EndEvent() };
    }

    /// Transitions a resource to `state` and holds it, for other code that records into [`list`](Self::list) and must leave it in that state.
    ///
    /// # Errors
    /// `InvalidArgument` for a resource in a state that the queue does not know, or given in two states.
    pub(crate) fn transition_to(&mut self, given: &ResourceWithState<'_>, state: D3D12_RESOURCE_STATES) -> Result<()> {
        self.check_state(given)?;
        // Exactly that state, not one that contains it: the other code may record barriers that begin with it.
        self.require(given, state, true);
        self.flush();
        Ok(())
    }

    /// The command list.
    pub(crate) fn list(&self) -> &ID3D12GraphicsCommandList {
        &self.list
    }

    /// Sets the descriptor heap again after other code has recorded into the list and set heaps of its own.
    pub(crate) fn resume(&self) {
        // SAFETY: an open list and a live heap, which the ring keeps until the list has run.
        unsafe { self.list.SetDescriptorHeaps(&[Some(self.heap.clone())]) };
    }

    /// Checks a resource's state: the queue's type must support it, and earlier uses in this frame must have given the same state.
    pub(crate) fn check_state(&self, given: &ResourceWithState<'_>) -> Result<()> {
        let refuse = |why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field("state"));
        // A resource of an upload heap is always in GENERIC_READ.
        let fixed = given.state == D3D12_RESOURCE_STATE_GENERIC_READ;
        if self.kind == D3D12_COMMAND_LIST_TYPE_COMPUTE && !fixed && !compute_queue_knows(given.state) {
            return refuse("a compute queue does not know this state of a resource");
        }
        match self.index_of_tracked(given.resource) {
            Some(at) if self.slot.tracked[at].final_state != given.state => refuse("a resource is given in two states"),
            _ => Ok(()),
        }
    }

    fn index_of_tracked(&self, resource: &ID3D12Resource) -> Option<usize> {
        self.slot.tracked.iter().position(|known| known.resource.as_raw() == resource.as_raw())
    }

    /// Collects a barrier for the state that the next command needs.
    fn require_state(&mut self, given: &ResourceWithState<'_>, needed: D3D12_RESOURCE_STATES) {
        self.require(given, needed, false);
    }

    /// Collects a barrier for a state. Unless `is_exact`, a combined read state that contains the needed one will do.
    fn require(&mut self, given: &ResourceWithState<'_>, needed: D3D12_RESOURCE_STATES, is_exact: bool) {
        let at = self.index_of_tracked(given.resource).unwrap_or_else(|| {
            let (resource, final_state) = (given.resource.clone(), given.state);
            self.slot.tracked.push(TrackedResource { resource, final_state, current: final_state });
            self.slot.tracked.len() - 1
        });
        let FrameSlot { tracked, barriers, .. } = &mut *self.slot;
        let known = &mut tracked[at];
        // Above all GENERIC_READ of upload heaps.
        let is_read = !is_exact && (needed == SHADER_READ || needed == D3D12_RESOURCE_STATE_COPY_SOURCE);
        if known.current == SHADER_WRITE && needed == SHADER_WRITE {
            barriers.push(uav_barrier(&known.resource));
        } else if !(is_read && known.current.contains(needed)) && known.current != needed {
            barriers.push(transition(&known.resource, known.current, needed));
            known.current = needed;
        }
    }

    /// Records the collected barriers.
    fn flush(&mut self) {
        if !self.slot.barriers.is_empty() {
            // SAFETY: an open list; the resources are held and in the states before.
            unsafe { self.list.ResourceBarrier(&self.slot.barriers) };
            self.slot.barriers.clear();
        }
    }

    /// Writes the descriptors of a table; returns its handle.
    fn describe(&mut self, inputs: &[View<'_>], outputs: &[View<'_>]) -> D3D12_GPU_DESCRIPTOR_HANDLE {
        // SAFETY: a live heap that shaders see.
        let (cpu, gpu) =
            unsafe { (self.heap.GetCPUDescriptorHandleForHeapStart(), self.heap.GetGPUDescriptorHandleForHeapStart()) };
        let table = gpu.ptr + u64::from(self.next * self.descriptor_size);
        for (i, view) in inputs.iter().chain(outputs).enumerate() {
            let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: cpu.ptr + (self.next * self.descriptor_size) as usize };
            if i < inputs.len() {
                view.describe_input(self.gpu.device(), at);
            } else {
                view.describe_output(self.gpu.device(), at);
            }
            self.next += 1;
            self.free_descriptors -= 1;
        }
        D3D12_GPU_DESCRIPTOR_HANDLE { ptr: table }
    }

    /// Transitions every resource to its final state, and records the end timestamp.
    fn end(&mut self) {
        let FrameSlot { tracked, barriers, .. } = &mut *self.slot;
        for known in tracked {
            if known.current != known.final_state {
                barriers.push(transition(&known.resource, known.current, known.final_state));
                known.current = known.final_state;
            }
        }
        self.flush();
        if let Some((timing, slot)) = self.timing {
            timing.end(&self.list, slot);
            self.slot.is_timed = true;
        }
    }
}

impl Drop for CommandRecorder<'_> {
    fn drop(&mut self) {
        if !self.is_open {
            return;
        }
        if self.is_own_list {
            // The list is reset before it is submitted again; a failed `Close` is reported then.
            // SAFETY: an open list.
            _ = unsafe { self.list.Close() };
        } else {
            self.end();
        }
    }
}

impl std::fmt::Debug for CommandRecorder<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "CommandRecorder({} resources)", self.slot.tracked.len())
    }
}
