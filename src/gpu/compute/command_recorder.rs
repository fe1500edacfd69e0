//! Records the commands of one frame.

use std::ffi::CStr;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::barrier::{all_written, borrowed, transition, written};
use super::command_ring::Slot;
use super::timing::Timing;
use super::{Kernel, ResourceWithState, View};
use crate::gpu::queue::EVENT_OF_BYTES;
use crate::gpu::{FencePoint, Gpu, Queue, failed_on};
use crate::{Error, ErrorKind, Result};

/// The state in which a shader reads a resource.
const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
/// The state in which a shader writes a resource.
const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// A frame that is being recorded. If it is dropped before it is submitted, a frame in the ring's list is discarded; a frame in an engine's list
/// keeps its recorded commands, with every resource returned to its initial state.
pub struct CommandRecorder<'a> {
    gpu: &'a Gpu,
    heap: &'a ID3D12DescriptorHeap,
    /// Bytes from one descriptor to the next.
    step: u32,
    /// Number of free descriptors.
    room: u32,
    /// Index of the next free descriptor.
    next: u32,
    kind: D3D12_COMMAND_LIST_TYPE,
    /// The ring's timestamps, and the frame's slot.
    timing: Option<(&'a Timing, usize)>,
    slot: &'a mut Slot,
    list: ID3D12GraphicsCommandList,
    own: bool,
    open: bool,
    /// Whether writes of the last dispatch may be incomplete, so that the next dispatch needs a UAV barrier.
    is_written: bool,
}

/// A descriptor table: inputs, then outputs.
pub(crate) struct Table {
    place: D3D12_GPU_DESCRIPTOR_HANDLE,
    inputs: u32,
    outputs: u32,
}

/// A resource of a frame, with its state outside of the frame and its current state.
pub(super) struct Tracked {
    resource: ID3D12Resource,
    resting: D3D12_RESOURCE_STATES,
    current: D3D12_RESOURCE_STATES,
}

impl<'a> CommandRecorder<'a> {
    #[expect(clippy::too_many_arguments, reason = "the parts of the ring that a frame has")]
    pub(super) fn new(
        gpu: &'a Gpu,
        heap: &'a ID3D12DescriptorHeap,
        (step, room): (u32, u32),
        kind: D3D12_COMMAND_LIST_TYPE,
        timing: Option<(&'a Timing, usize)>,
        slot: &'a mut Slot,
        list: ID3D12GraphicsCommandList,
        own: bool,
    ) -> Self {
        let next = slot.first;
        let (open, is_written) = (true, false);
        let frame = Self { gpu, heap, step, room, next, kind, timing, slot, list, own, open, is_written };
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
        if !self.own {
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
        self.open = false;
        let fence_point = queue.submit(&[self.slot.closed(self.gpu)?])?;
        self.slot.busy = Some(fence_point.clone());
        Ok(fence_point)
    }

    /// Binds resources and dispatches a shader with `groups` thread groups. Earlier writes of the frame are waited for.
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
        let read = |view: &View<'_>| inputs.iter().any(|input| input.resting().resource == view.resting().resource);
        assert!(!outputs.iter().any(read), "a dispatch does not write what it reads");
        self.fits((inputs.len() + outputs.len()) as u32)?;
        inputs.iter().chain(outputs).try_for_each(|view| self.takes(&view.resting()))?;

        inputs.iter().for_each(|view| self.becomes(&view.resting(), READ));
        outputs.iter().for_each(|view| self.becomes(&view.resting(), WRITTEN));
        self.flush();
        self.is_written = false;
        let place = self.describe(inputs, outputs);
        Ok(Table { place, inputs: inputs.len() as u32, outputs: outputs.len() as u32 })
    }

    /// Checks that `descriptors` descriptors are free.
    pub(crate) fn fits(&self, descriptors: u32) -> Result<()> {
        if descriptors > self.room {
            return Err(Error::new(ErrorKind::Unsupported, "the frame has no descriptor left")
                .remedy("Make the ring with more descriptors"));
        }
        Ok(())
    }

    /// Dispatches a shader with `groups` thread groups and the last bound table. Writes of the dispatch before are waited for.
    pub(crate) fn dispatch(&mut self, table: &Table, kernel: &Kernel, constants: &[u32], groups: [u32; 3]) {
        let found = [constants.len() as u32, table.inputs, table.outputs];
        let expected = [kernel.shape.constants, kernel.shape.inputs, kernel.shape.outputs];
        assert_eq!(found, expected, "constants, inputs and outputs are the kernel's");
        if self.is_written {
            // SAFETY: an open list.
            unsafe { self.list.ResourceBarrier(&[all_written()]) };
        }
        self.is_written = true;
        if !self.slot.kernels.iter().any(|(_, pipeline)| *pipeline == kernel.pipeline) {
            self.slot.kernels.push((kernel.root.clone(), kernel.pipeline.clone()));
        }
        // SAFETY: an open list; the ring holds kernel, heap and resources until it has run.
        unsafe {
            self.list.SetComputeRootSignature(&kernel.root);
            self.list.SetPipelineState(&kernel.pipeline);
            self.list.SetComputeRoot32BitConstants(0, constants.len() as u32, constants.as_ptr().cast(), 0);
            self.list.SetComputeRootDescriptorTable(1, table.place);
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
        self.takes(from)?;
        self.takes(to)?;
        self.becomes(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.becomes(to, D3D12_RESOURCE_STATE_COPY_DEST);
        self.flush();
        let from = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(from.resource),
            Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: rows },
        };
        let to = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(to.resource),
            Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
        };
        // SAFETY: an open list, and live resources of its device in the states for it, which the ring holds.
        unsafe { self.list.CopyTextureRegion(&to, 0, 0, 0, &from, None) };
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
        self.takes(from)?;
        self.takes(to)?;
        self.becomes(from, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.becomes(to, D3D12_RESOURCE_STATE_COPY_DEST);
        self.flush();
        // SAFETY: an open list, and live buffers of its device in the states for it, which the ring holds.
        unsafe { self.list.CopyBufferRegion(to.resource, at, from.resource, 0, bytes) };
        Ok(())
    }

    /// Sets the state in which a resource of the frame is left at its end, instead of its initial state.
    pub(crate) fn leave(&mut self, resource: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        if let Some(at) = self.tracked(resource) {
            self.slot.tracked[at].resting = state;
        }
    }

    /// Begins a named event that lasts until [`end_stage`](Self::end_stage), for GPU profilers.
    pub(crate) fn stage(&self, name: &CStr) {
        let bytes = name.to_bytes_with_nul();
        // SAFETY: an open list, and a text of that length, which is copied.
        unsafe { self.list.BeginEvent(EVENT_OF_BYTES, Some(bytes.as_ptr().cast()), bytes.len() as u32) };
    }

    /// Ends the last named event.
    pub(crate) fn end_stage(&self) {
        // SAFETY: an open list, in which a stage was begun.
        unsafe { self.list.EndEvent() };
    }

    /// Transitions a resource to `state` and holds it, for other code that records into [`list`](Self::list) and must leave it in that state.
    ///
    /// # Errors
    /// `InvalidArgument` for a resource in a state that the queue does not know, or given in two states.
    pub(crate) fn bring(&mut self, given: &ResourceWithState<'_>, state: D3D12_RESOURCE_STATES) -> Result<()> {
        self.takes(given)?;
        self.becomes(given, state);
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

    /// Checks a resource's state: the queue's type must support it, and it must be the same state as before in this frame.
    pub(crate) fn takes(&self, given: &ResourceWithState<'_>) -> Result<()> {
        let known = WRITTEN
            | READ
            | D3D12_RESOURCE_STATE_COPY_DEST
            | D3D12_RESOURCE_STATE_COPY_SOURCE
            | D3D12_RESOURCE_STATE_VERTEX_AND_CONSTANT_BUFFER
            | D3D12_RESOURCE_STATE_INDIRECT_ARGUMENT;
        let refuse = |why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field("state"));
        // A resource of an upload heap is always in GENERIC_READ.
        let fixed = given.state == D3D12_RESOURCE_STATE_GENERIC_READ;
        if self.kind == D3D12_COMMAND_LIST_TYPE_COMPUTE && !fixed && given.state & !known != D3D12_RESOURCE_STATE_COMMON
        {
            return refuse("a compute queue does not know this state of a resource");
        }
        match self.tracked(given.resource) {
            Some(at) if self.slot.tracked[at].resting != given.state => refuse("a resource is given in two states"),
            _ => Ok(()),
        }
    }

    fn tracked(&self, resource: &ID3D12Resource) -> Option<usize> {
        self.slot.tracked.iter().position(|known| known.resource.as_raw() == resource.as_raw())
    }

    /// Collects the barrier that brings a resource to the state that the next command needs.
    fn becomes(&mut self, given: &ResourceWithState<'_>, needed: D3D12_RESOURCE_STATES) {
        let at = self.tracked(given.resource).unwrap_or_else(|| {
            let (resource, resting) = (given.resource.clone(), given.state);
            self.slot.tracked.push(Tracked { resource, resting, current: resting });
            self.slot.tracked.len() - 1
        });
        let Slot { tracked, barriers, .. } = &mut *self.slot;
        let known = &mut tracked[at];
        // A combined read state that contains the needed one needs no transition: above all GENERIC_READ of upload heaps.
        let is_read = needed == READ || needed == D3D12_RESOURCE_STATE_COPY_SOURCE;
        if known.current == WRITTEN && needed == WRITTEN {
            barriers.push(written(&known.resource));
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

    /// Writes the descriptors of a table.
    fn describe(&mut self, inputs: &[View<'_>], outputs: &[View<'_>]) -> D3D12_GPU_DESCRIPTOR_HANDLE {
        // SAFETY: a live heap that shaders see.
        let (processors, shaders) =
            unsafe { (self.heap.GetCPUDescriptorHandleForHeapStart(), self.heap.GetGPUDescriptorHandleForHeapStart()) };
        let table = shaders.ptr + u64::from(self.next * self.step);
        for (i, view) in inputs.iter().chain(outputs).enumerate() {
            let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: processors.ptr + (self.next * self.step) as usize };
            if i < inputs.len() {
                view.describe_input(self.gpu.device(), at);
            } else {
                view.describe_output(self.gpu.device(), at);
            }
            self.next += 1;
            self.room -= 1;
        }
        D3D12_GPU_DESCRIPTOR_HANDLE { ptr: table }
    }

    /// Transitions every resource back to its state outside of the frame.
    fn end(&mut self) {
        let Slot { tracked, barriers, .. } = &mut *self.slot;
        for known in tracked {
            if known.current != known.resting {
                barriers.push(transition(&known.resource, known.current, known.resting));
                known.current = known.resting;
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
        if !self.open {
            return;
        }
        if self.own {
            // The list is reset before it is submitted again; a failed `Close` shows then.
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
