//! One frame's commands.

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

/// What a shader may read a resource in.
const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
/// What a shader writes a resource in.
const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// A frame that is being recorded. Dropped before it is handed on, one in a list of the ring's is forgotten, and one in an engine's
/// list leaves what it has recorded there, with every resource in the state it rests in.
pub struct CommandRecorder<'a> {
    gpu: &'a Gpu,
    heap: &'a ID3D12DescriptorHeap,
    /// Bytes from one descriptor to the next.
    step: u32,
    /// Descriptors that are left.
    room: u32,
    /// The next descriptor.
    next: u32,
    kind: D3D12_COMMAND_LIST_TYPE,
    /// The ring's clock, and the frame's place in it.
    timing: Option<(&'a Timing, usize)>,
    slot: &'a mut Slot,
    list: ID3D12GraphicsCommandList,
    own: bool,
    open: bool,
    /// Whether what the last dispatch wrote may still be on its way.
    is_written: bool,
}

/// Views that a frame's shaders see.
pub(crate) struct Table {
    place: D3D12_GPU_DESCRIPTOR_HANDLE,
    inputs: u32,
    outputs: u32,
}

/// A resource of a frame.
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

    /// Ends the frame and gives it to `queue`, of the kind that the ring was made for; the moment when it has run.
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

    /// Runs a shader over `groups` of its threads. What it needs of the frame before is there: writes are waited for.
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

    /// Brings resources into the states in which shaders read and write them, for one dispatch or several until anything else is
    /// recorded.
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

    /// Refuses where fewer than so many descriptors are left.
    pub(crate) fn fits(&self, descriptors: u32) -> Result<()> {
        if descriptors > self.room {
            return Err(Error::new(ErrorKind::Unsupported, "the frame has no descriptor left")
                .remedy("Make the ring with more descriptors"));
        }
        Ok(())
    }

    /// Runs a shader over `groups` of its threads with what was bound last. Writes of the dispatch before are waited for.
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

    /// Copies a picture's rows, which lie in a buffer as `rows` says, over all of a texture.
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

    /// Has a resource of the frame left in `state` in the end, and not in the one that it came in.
    pub(crate) fn leave(&mut self, resource: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        if let Some(at) = self.tracked(resource) {
            self.slot.tracked[at].resting = state;
        }
    }

    /// Names what is recorded from now on until [`end_stage`](Self::end_stage), for tools that show the device's work.
    pub(crate) fn stage(&self, name: &CStr) {
        let bytes = name.to_bytes_with_nul();
        // SAFETY: an open list, and a text of so many bytes that is copied.
        unsafe { self.list.BeginEvent(EVENT_OF_BYTES, Some(bytes.as_ptr().cast()), bytes.len() as u32) };
    }

    /// Ends the stage that was named last.
    pub(crate) fn end_stage(&self) {
        // SAFETY: an open list, in which a stage was begun.
        unsafe { self.list.EndEvent() };
    }

    /// Brings a resource into `state`, and holds it, for what somebody else records into [`list`](Self::list), who leaves it so.
    ///
    /// # Errors
    /// `InvalidArgument` for a resource in a state that the queue does not know, or given in two states.
    pub(crate) fn bring(&mut self, given: &ResourceWithState<'_>, state: D3D12_RESOURCE_STATES) -> Result<()> {
        self.takes(given)?;
        self.becomes(given, state);
        self.flush();
        Ok(())
    }

    /// What it is recorded into.
    pub(crate) fn list(&self) -> &ID3D12GraphicsCommandList {
        &self.list
    }

    /// Goes on after somebody else has recorded into the list, who set heaps of their own.
    pub(crate) fn resume(&self) {
        // SAFETY: an open list and a live heap, which the ring keeps until the list has run.
        unsafe { self.list.SetDescriptorHeaps(&[Some(self.heap.clone())]) };
    }

    /// Refuses a resource whose state does not fit: one that the queue does not know, or another than it was given in before.
    pub(crate) fn takes(&self, given: &ResourceWithState<'_>) -> Result<()> {
        let known = WRITTEN
            | READ
            | D3D12_RESOURCE_STATE_COPY_DEST
            | D3D12_RESOURCE_STATE_COPY_SOURCE
            | D3D12_RESOURCE_STATE_VERTEX_AND_CONSTANT_BUFFER
            | D3D12_RESOURCE_STATE_INDIRECT_ARGUMENT;
        let refuse = |why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field("state"));
        // A heap that the processor writes rests in a state of its own, which never changes.
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

    /// Brings a resource into the state that the next dispatch needs.
    fn becomes(&mut self, given: &ResourceWithState<'_>, needed: D3D12_RESOURCE_STATES) {
        let at = self.tracked(given.resource).unwrap_or_else(|| {
            let (resource, resting) = (given.resource.clone(), given.state);
            self.slot.tracked.push(Tracked { resource, resting, current: resting });
            self.slot.tracked.len() - 1
        });
        let Slot { tracked, barriers, .. } = &mut *self.slot;
        let known = &mut tracked[at];
        // What may be read in several ways at once needs no change: the memory that the processor writes for the device, above all.
        let is_read = needed == READ || needed == D3D12_RESOURCE_STATE_COPY_SOURCE;
        if known.current == WRITTEN && needed == WRITTEN {
            barriers.push(written(&known.resource));
        } else if !(is_read && known.current.contains(needed)) && known.current != needed {
            barriers.push(transition(&known.resource, known.current, needed));
            known.current = needed;
        }
    }

    /// Records the barriers that were collected.
    fn flush(&mut self) {
        if !self.slot.barriers.is_empty() {
            // SAFETY: an open list; the resources are held and in the states before.
            unsafe { self.list.ResourceBarrier(&self.slot.barriers) };
            self.slot.barriers.clear();
        }
    }

    /// Writes the table of a dispatch.
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

    /// Brings every resource back into the state it rests in.
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
            // It is recorded anew before anything is submitted; a failure to close shows then.
            // SAFETY: an open list.
            _ = unsafe { self.list.Close() };
        } else {
            self.end();
        }
    }
}

impl std::fmt::Debug for CommandRecorder<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Frame({} resources)", self.slot.tracked.len())
    }
}
