//! Runs worlds on the host's processor: ONNX Runtime's CPU provider over memory of our own.

use std::sync::Arc;

use ort::AsPointer;
use ort::memory::{AllocationDevice, AllocatorType, MemoryInfo, MemoryType};
use ort::session::builder::{AutoDevicePolicy, GraphOptimizationLevel, SessionBuilder};
use ort::session::{IoBinding, Session};
use ort::value::{Shape, TensorRefMut};

use super::aligned_buffer::AlignedBuffer;
use super::device::{Backend, DeviceKind};
use super::execution_context::{
    Backup, BindingId, BufferId, Bytes, ContextLimits, ExecutionContext, FiniteCheckId, MAX_GROUPS, RecordedCopiesId,
    RecordedCopy, Region,
};
use super::failure::{make, ort_failure};
use super::finite::all_finite;
use super::graph::{ElementType, TensorSpec};
use super::{Graph, Ort};
use crate::allocate;
use crate::bundle::{ModelSource, Precision};
use crate::tasks::physical_cores;
use crate::{Error, ErrorKind, Result};

const MAX_THREADS: usize = 1024;

/// Options of a CPU device.
///
/// A rollout's results depend on the thread count in their last bits; the same count gives the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CpuOptions {
    /// Threads that share one pass, 1 to 1024, the caller's own included. `None`: one for each physical core that this process may
    /// use; a second thread of a core only competes for its vector units.
    pub threads: Option<usize>,
    /// Uses ONNX Runtime's deterministic kernels only. Its CPU kernels are repeatable at a fixed thread count without this option,
    /// too.
    pub deterministic: bool,
}

/// The backend of [`Device::cpu`](super::Device::cpu).
pub(super) struct CpuBackend {
    ort: Ort,
    threads: usize,
    deterministic: bool,
}

impl CpuOptions {
    /// Checks the options.
    pub(crate) fn check(&self) -> Result<()> {
        match self.threads {
            Some(threads) if threads == 0 || threads > MAX_THREADS => {
                Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads cannot share a pass"))
                    .field("threads")
                    .remedy(format!("Use 1 to {MAX_THREADS}")))
            }
            _ => Ok(()),
        }
    }
}

impl CpuBackend {
    pub(super) fn new(ort: &Ort, options: CpuOptions) -> Result<Self> {
        options.check()?;
        let threads = options.threads.unwrap_or_else(physical_cores);
        Ok(Self { ort: ort.clone(), threads, deterministic: options.deterministic })
    }

    /// The session options that all graphs share.
    fn session(&self, dimensions: &[(&str, usize)]) -> ort::Result<SessionBuilder> {
        let mut builder = Session::builder(self.ort.environment())?
            .with_auto_device(AutoDevicePolicy::PreferCPU)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_parallel_execution(false)?
            .with_intra_threads(self.threads)?
            .with_deterministic_compute(self.deterministic)?
            // Workers spin between the hundreds of small operators of a pass, because sleeping costs more than an operator. They
            // stop when the pass ends, so that the host's own threads get the processor at once.
            .with_intra_op_spinning(true)?
            .with_config_entry("session.force_spinning_stop", "1")?;
        for &(name, size) in dimensions {
            builder = builder.with_dimension_override(name, i64::try_from(size).unwrap_or(i64::MAX))?;
        }
        Ok(builder)
    }
}

impl Backend for CpuBackend {
    fn describe(&self) -> String {
        let plural = if self.threads == 1 { "" } else { "s" };
        let deterministic = if self.deterministic { ", deterministic" } else { "" };
        format!("ONNX Runtime {} CPU, {} thread{plural}{deterministic}", self.ort.version(), self.threads)
    }

    fn precision(&self) -> Precision {
        Precision::F32
    }

    fn threads(&self) -> usize {
        self.threads
    }

    fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
        _shared: Option<&Arc<Graph>>,
    ) -> Result<Arc<Graph>> {
        let builder = make("prepare a session", || self.session(dimensions))?;
        Graph::commit(builder, what, model, inputs, &[], outputs).map(Arc::new)
    }

    fn kind(&self) -> DeviceKind {
        DeviceKind::Cpu
    }

    fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>> {
        let (memories, bindings, recorded, finite_checks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Ok(Box::new(CpuContext {
            memories,
            bindings,
            recorded,
            finite_checks,
            limits,
            bytes: Bytes::default(),
            read: 0.into(),
        }))
    }
}

/// Executes all work in the call that submits it, so nothing waits later.
struct CpuContext {
    // Bindings hold addresses of memories: they are dropped first.
    bindings: Vec<Bound>,
    memories: Vec<AlignedBuffer>,
    recorded: Vec<Vec<RecordedCopy>>,
    /// Recorded finite checks: groups of buffers, and their element type.
    finite_checks: Vec<(Vec<Vec<BufferId>>, Precision)>,
    limits: ContextLimits,
    bytes: Bytes,
    read: std::sync::atomic::AtomicU64,
}

/// Buffers with copies of their contents.
type HostBackup = Vec<(BufferId, Vec<u8>)>;

/// A session with its inputs and outputs bound to addresses.
struct Bound {
    binding: IoBinding,
    graph: Arc<Graph>,
}

impl ExecutionContext for CpuContext {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        self.memories.push(AlignedBuffer::zeroed(bytes)?);
        Ok(BufferId(self.memories.len() - 1))
    }

    fn size(&self, of: BufferId) -> usize {
        self.memories[of.0].len()
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        assert_eq!(tensors.len(), graph.tensors().len(), "one buffer for each input and output");
        let mut binding = make("bind a tensor", || graph.session().create_binding())?;
        for (i, ((name, spec), buffer)) in graph.tensors().iter().zip(tensors).enumerate() {
            let memory = &self.memories[buffer.0];
            assert_eq!(memory.len(), spec.bytes(), "{}: the buffer fits the tensor", spec.name);
            let input = i < graph.input_count();
            assert!(input || tensors.iter().filter(|b| *b == buffer).count() == 1, "{}: written alone", spec.name);
            bind_one(&mut binding, name, input, spec, memory.address())?;
        }
        self.bindings.push(Bound { binding, graph: graph.clone() });
        Ok(BindingId(self.bindings.len() - 1))
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.memories[to.0].bytes_mut()[at..at + bytes.len()].copy_from_slice(bytes);
        self.bytes.uploaded += bytes.len() as u64;
        Ok(())
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        contents.iter().try_for_each(|(to, bytes)| {
            assert_eq!(bytes.len(), self.size(*to), "a whole buffer");
            self.upload(*to, 0, bytes)
        })
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        buffers.iter().for_each(|buffer| self.memories[buffer.0].bytes_mut().fill(0));
        Ok(())
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        let [to, from] = self.memories.get_disjoint_mut([to.0, from.0]).expect("two buffers of this context");
        let (to, from) = (to.bytes_mut(), from.bytes());
        for r in regions {
            to[r.to..r.to + r.len].copy_from_slice(&from[r.from..r.from + r.len]);
            self.bytes.copied += r.len as u64;
        }
        Ok(())
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.recorded.push(copies);
        Ok(RecordedCopiesId(self.recorded.len() - 1))
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        copies.iter().try_for_each(|copies| {
            // Moved out of `self`, because `copy` borrows the whole context.
            let recorded = std::mem::take(&mut self.recorded[copies.0]);
            let done = recorded.iter().try_for_each(|copy| self.copy(copy.to, copy.from, &copy.regions));
            self.recorded[copies.0] = recorded;
            done
        })
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        let copy = |buffer: &BufferId| Ok((*buffer, allocate::copy_of(self.memories[buffer.0].bytes())?));
        of.iter().map(copy).collect::<Result<HostBackup>>().map(Backup::new)
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        let copies = backup.into_contents::<HostBackup>();
        copies.iter().for_each(|(to, bytes)| self.memories[to.0].bytes_mut().copy_from_slice(bytes));
        Ok(())
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.limits.check_stop()?;
        let Bound { binding, graph } = &self.bindings[binding.0];
        let run = ort::api().RunWithBinding;
        // SAFETY: a session may run on several threads; this binding and its memories are used by `&mut self` alone.
        let status = unsafe { run(graph.session().ptr().cast_mut(), std::ptr::null(), binding.ptr()) };
        // SAFETY: the status is what the call above returned, used once.
        unsafe { ort::Error::result_from_status(status) }.map_err(|e| ort_failure("run a graph", &e))
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        into.copy_from_slice(&self.memories[from.0].bytes()[at..at + into.len()]);
        self.read.fetch_add(into.len() as u64, std::sync::atomic::Ordering::Relaxed);
        Ok(())
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        assert!(groups.len() <= MAX_GROUPS, "groups that can be told apart");
        self.finite_checks.push((groups.iter().map(|group| group.to_vec()).collect(), precision));
        Ok(FiniteCheckId(self.finite_checks.len() - 1))
    }

    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>> {
        let (groups, precision) = &self.finite_checks[check.0];
        let is_finite = |buffer: &BufferId| all_finite(self.memories[buffer.0].bytes(), *precision);
        Ok(groups.iter().position(|group| !group.iter().all(is_finite)))
    }

    fn bytes(&self) -> Bytes {
        Bytes { read: self.read.load(std::sync::atomic::Ordering::Relaxed), ..self.bytes }
    }
}

/// Binds one tensor at `address`. The memory must have the size of `spec` and outlive `binding`.
fn bind_one(
    binding: &mut IoBinding,
    name: &std::ffi::CStr,
    input: bool,
    spec: &TensorSpec,
    address: *mut u8,
) -> Result<()> {
    let shape = Shape::new(spec.shape.iter().map(|&d| d as i64));
    let value = make("bind a tensor", || {
        let host = MemoryInfo::new(AllocationDevice::CPU, 0, AllocatorType::Device, MemoryType::Default)?;
        match spec.element {
            ElementType::F32 => {
                // SAFETY: the address is host memory of the tensor's size that outlives the binding.
                unsafe { TensorRefMut::<f32>::from_raw(host, address.cast(), shape) }.map(TensorRefMut::into_dyn)
            }
            ElementType::F16 => {
                // SAFETY: as above.
                unsafe { TensorRefMut::<half::f16>::from_raw(host, address.cast(), shape) }.map(TensorRefMut::into_dyn)
            }
            ElementType::U8 => {
                // SAFETY: as above.
                unsafe { TensorRefMut::<u8>::from_raw(host, address.cast(), shape) }.map(TensorRefMut::into_dyn)
            }
        }
    })?;
    let bind = if input { ort::api().BindInput } else { ort::api().BindOutput };
    // SAFETY: name and value are valid for the call; the binding keeps its own reference to the value.
    let status = unsafe { bind(binding.ptr_mut(), name.as_ptr(), value.ptr()) };
    // SAFETY: the status is what the call above returned, used once.
    unsafe { ort::Error::result_from_status(status) }.map_err(|e| ort_failure("bind a tensor", &e))
}
