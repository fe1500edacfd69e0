//! A rollout's timeline on a Direct3D queue.

use std::ffi::CStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ort::AsPointer;
use ort::ep::directml::{DMLResource, resource_from_d3d};
use ort::memory::{AllocationDevice, AllocatorType, MemoryInfo, MemoryType};
use ort::session::IoBinding;
use ort::value::{Shape, TensorRefMut};
use parking_lot::Mutex;
use windows::Win32::Graphics::Direct3D12::ID3D12Resource;
use windows::core::Interface;

use super::memory::{Heap, Shared, buffer};
use super::recorder::Recorder;
use crate::bundle::Precision;
use crate::gpu::Gpu;
use crate::runtime::Graph;
use crate::runtime::failure::{make, ort_failure};
use crate::runtime::finite::all_finite;
use crate::runtime::graph::TensorSpec;
use crate::runtime::lane::{BindingId, BufferId, Bytes, Lane, Region};
use crate::{Error, Result};

/// Bytes of zeroes that buffers are cleared with.
const ZEROES: usize = 1 << 20;

/// Buffers on the device, and copies and runs on one queue: order there is order here, and nothing waits but what reads.
pub(super) struct DirectMlLane {
    // Bindings hold allocations of buffers: they are dropped first.
    bindings: Vec<Bound>,
    buffers: Vec<Buffer>,
    zeroes: Shared,
    recorder: Mutex<Recorder>,
    gpu: Gpu,
    bytes: Bytes,
    read: AtomicU64,
}

struct Buffer {
    // ONNX Runtime's name for the resource: dropped before it.
    allocation: DMLResource,
    resource: ID3D12Resource,
    bytes: usize,
}

// SAFETY: neither is tied to a thread; the allocation is only an address.
unsafe impl Send for Buffer {}
// SAFETY: shared access only reads the two.
unsafe impl Sync for Buffer {}

/// A session's inputs and outputs, tied to buffers.
struct Bound {
    binding: IoBinding,
    graph: Arc<Graph>,
}

impl DirectMlLane {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let recorder = Mutex::new(Recorder::new(gpu)?);
        // Written here: not every driver gives memory that is zero.
        let mut zeroes = Shared::new(gpu, Heap::Upload, ZEROES)?;
        zeroes.write(0, &vec![0; ZEROES]);
        let (bindings, buffers) = (Vec::new(), Vec::new());
        Ok(Self { bindings, buffers, zeroes, recorder, gpu: gpu.clone(), bytes: Bytes::default(), read: 0.into() })
    }

    /// A failure of ONNX Runtime; where the device is gone, that says more.
    fn or_removed(&self, error: Error) -> Error {
        self.gpu.removed().unwrap_or(error)
    }
}

impl Lane for DirectMlLane {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        let resource = buffer(&self.gpu, Heap::Device, bytes)?;
        // SAFETY: a live resource, which outlives the allocation.
        let take = || unsafe { resource_from_d3d(resource.as_raw().cast()) };
        let allocation = make("take a buffer", take).map_err(|e| self.or_removed(e))?;
        self.buffers.push(Buffer { allocation, resource, bytes });
        let made = BufferId(self.buffers.len() - 1);
        self.clear(made)?;
        Ok(made)
    }

    fn size(&self, of: BufferId) -> usize {
        self.buffers[of.0].bytes
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        assert_eq!(tensors.len(), graph.tensors().len(), "one buffer for each input and output");
        let binding = make("bind a tensor", || graph.session().create_binding());
        let mut binding = binding.map_err(|e| self.or_removed(e))?;
        for (i, ((name, spec), buffer)) in graph.tensors().iter().zip(tensors).enumerate() {
            let memory = &self.buffers[buffer.0];
            assert_eq!(memory.bytes, spec.bytes(), "{}: the buffer fits the tensor", spec.name);
            let input = i < graph.input_count();
            assert!(input || tensors.iter().filter(|b| *b == buffer).count() == 1, "{}: written alone", spec.name);
            make("bind a tensor", || bind_one(&mut binding, name, input, spec, &memory.allocation))
                .map_err(|e| self.or_removed(e))?;
        }
        self.bindings.push(Bound { binding, graph: graph.clone() });
        Ok(BindingId(self.bindings.len() - 1))
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        let buffer = &self.buffers[to.0];
        assert!(at + bytes.len() <= buffer.bytes, "inside the buffer");
        self.recorder.get_mut().upload(&buffer.resource, at, bytes)?;
        self.bytes.uploaded += bytes.len() as u64;
        Ok(())
    }

    fn clear(&mut self, buffer: BufferId) -> Result<()> {
        let buffer = &self.buffers[buffer.0];
        let regions = (0..buffer.bytes).step_by(ZEROES);
        let regions = regions.map(|at| Region { to: at, from: 0, len: ZEROES.min(buffer.bytes - at) });
        self.recorder.get_mut().fill(&buffer.resource, self.zeroes.resource(), regions)
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        assert_ne!(to, from, "two buffers of this lane");
        let (to, from) = (&self.buffers[to.0], &self.buffers[from.0]);
        for r in regions {
            assert!(r.to + r.len <= to.bytes && r.from + r.len <= from.bytes, "inside the buffers");
            self.bytes.copied += r.len as u64;
        }
        self.recorder.get_mut().copy(&to.resource, &from.resource, regions.iter().copied())
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.recorder.get_mut().submit()?;
        let Bound { binding, graph } = &self.bindings[binding.0];
        let run = ort::api().RunWithBinding;
        // SAFETY: a session may run on several threads; this binding and its buffers are used by `&mut self` alone.
        let status = unsafe { run(graph.session().ptr().cast_mut(), std::ptr::null(), binding.ptr()) };
        // SAFETY: the status is what the call above returned, used once.
        unsafe { ort::Error::result_from_status(status) }.map_err(|e| self.or_removed(ort_failure("run a graph", &e)))
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        let buffer = &self.buffers[from.0];
        assert!(at + into.len() <= buffer.bytes, "inside the buffer");
        let readback = Shared::new(&self.gpu, Heap::Readback, into.len())?;
        let region = Region { to: 0, from: at, len: into.len() };
        let moment = {
            let mut recorder = self.recorder.lock();
            recorder.copy(readback.resource(), &buffer.resource, std::iter::once(region))?;
            recorder.now()?
        };
        moment.wait()?;
        readback.read(into);
        self.read.fetch_add(into.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn finite(&self, of: BufferId, precision: Precision) -> Result<bool> {
        let mut bytes = vec![0; self.buffers[of.0].bytes];
        self.read(of, 0, &mut bytes)?;
        Ok(all_finite(&bytes, precision))
    }

    fn bytes(&self) -> Bytes {
        Bytes { read: self.read.load(Ordering::Relaxed), ..self.bytes }
    }
}

impl Drop for DirectMlLane {
    fn drop(&mut self) {
        // The queue may still use what is freed next; of a device that is gone nothing does.
        if let Ok(moment) = self.recorder.get_mut().now() {
            _ = moment.wait();
        }
    }
}

/// Binds one tensor to the buffer behind `allocation`, which is as large as `spec` says and outlives `binding`.
fn bind_one(
    binding: &mut IoBinding,
    name: &CStr,
    input: bool,
    spec: &TensorSpec,
    allocation: &DMLResource,
) -> ort::Result<()> {
    let device = MemoryInfo::new(AllocationDevice::DIRECTML, 0, AllocatorType::Device, MemoryType::Default)?;
    let shape = Shape::new(spec.shape.iter().map(|&d| d as i64));
    let address = **allocation;
    let value = match spec.element {
        Precision::F32 => {
            // SAFETY: the provider's allocation of a buffer of the tensor's size, which outlives the binding.
            unsafe { TensorRefMut::<f32>::from_raw(device, address.cast(), shape) }?.into_dyn()
        }
        Precision::F16 => {
            // SAFETY: as above.
            unsafe { TensorRefMut::<half::f16>::from_raw(device, address.cast(), shape) }?.into_dyn()
        }
    };
    // The crate's own way to bind copies what is borrowed.
    let bind = if input { ort::api().BindInput } else { ort::api().BindOutput };
    // SAFETY: name and value are valid for the call; the binding keeps its own reference to the value.
    let status = unsafe { bind(binding.ptr_mut(), name.as_ptr(), value.ptr()) };
    // SAFETY: the status is what the call above returned, used once.
    unsafe { ort::Error::result_from_status(status) }
}
