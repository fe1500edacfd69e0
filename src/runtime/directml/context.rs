//! The execution context of one rollout on a Direct3D 12 device.

use std::ffi::CStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::locks::Mutex;
use ort::AsPointer;
use ort::ep::directml::{DMLResource, resource_from_d3d};
use ort::memory::{AllocationDevice, AllocatorType, MemoryInfo, MemoryType};
use ort::session::IoBinding;
use ort::value::{Shape, TensorRefMut};
use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};
use windows::core::Interface;

use super::capture::{CaptureRunOptions, CaptureState};
use super::device::DirectMlDevice;
use super::finite_check::FiniteCheck;
use super::graph_data::DirectMlGraph;
use super::interval_times::WorkKind;
use super::recorder::Recorder;
use super::reusable_list::ReusableList;
use super::snapshot::Snapshot;
use super::submission_throttle::SubmissionThrottle;
use crate::Result;
use crate::bundle::Precision;
use crate::gpu::compute::{CommandRing, ResourceWithState};
use crate::gpu::{
    FencePoint, Gpu, GpuTimeStatistics, Heap, MappedBuffer, Pipeline, Planes, ResidencySet, Resize, buffer,
};
use crate::runtime::Graph;
use crate::runtime::execution_context::{
    Backup, BindingId, BufferId, Bytes, CaptureStatistics, ContextLimits, Decoded, ExecutionContext, ExternalTimes,
    FiniteCheckId, MAX_GROUPS, RecordedCopiesId, RecordedCopy, Region, Work,
};
use crate::runtime::failure::{make, ort_failure};
use crate::runtime::graph::{ElementType, TensorSpec};

/// The shader that checks whether all values of a buffer are finite.
const FINITE: &[u8] = include_bytes!("../../gpu/shaders/compiled/finite.dxbc");
/// Threads in a thread group of these shaders, as in their source.
const GROUP: u32 = 256;
/// Maximum number of thread groups: each thread then checks many values, and a large adapter is still fully used.
const GROUPS: u32 = 1024;

/// Pictures converted by one command recorder.
const PICTURES: usize = 8;

/// Size in bytes of the buffer of zeroes that buffers are cleared from.
const ZEROES: usize = 1 << 20;

/// The shader that compares two buffers.
const EQUAL: &[u8] = include_bytes!("../../gpu/shaders/compiled/equal.dxbc");

/// Buffers, copies and graph runs on one queue, executed in the order of submission. Only reads wait, and runs that exceed the
/// submission limit.
pub(super) struct DirectMlContext {
    // Bindings hold allocations of buffers: they are dropped first.
    pub(super) bindings: Vec<Bound>,
    pub(super) buffers: Vec<Buffer>,
    /// Residency of the buffers; every use of a buffer makes them resident first.
    residency: Mutex<ResidencySet>,
    /// Graphs whose weights are kept resident as long as the buffers are, without duplicates.
    graphs_with_weights: Vec<Arc<Graph>>,
    /// Recorded copies, each with the bytes that it moves.
    recorded: Vec<(ReusableList, u64)>,
    finite_checks: Vec<FiniteCheck>,
    copying: WorkKind,
    pub(super) zeroes: MappedBuffer,
    /// A 32-bit word that a shader sets, and its readback buffer, with one word for each group of a finite check.
    pub(super) check_result: ID3D12Resource,
    pub(super) check_readback: MappedBuffer,
    pub(super) recorder: Mutex<Recorder>,
    pub(super) kernels: Arc<Kernels>,
    /// Converts pictures to textures; made with the first snapshot.
    frames: Option<CommandRing>,
    /// Copies of outputs of normal runs, to compare with captured ones.
    pub(super) expected: Vec<ID3D12Resource>,
    /// Options for runs without capture; set once a bound session allows capture.
    uncaptured_options: Option<CaptureRunOptions>,
    pub(super) gpu: Gpu,
    directml: DirectMlDevice,
    bytes: Bytes,
    read: Arc<AtomicU64>,
    /// Time spent inside ONNX Runtime.
    in_onnxruntime: Duration,
    /// Nanoseconds spent waiting for the device.
    waited: AtomicU64,
    limits: ContextLimits,
    pub(super) throttle: SubmissionThrottle,
}

pub(super) struct Buffer {
    // The provider's handle of the resource: dropped before it.
    allocation: DMLResource,
    pub(super) resource: ID3D12Resource,
    pub(super) bytes: usize,
}

impl Buffer {
    pub(super) fn new(gpu: &Gpu, bytes: usize) -> Result<Self> {
        let resource = buffer(gpu, Heap::Device, bytes)?;
        // SAFETY: a live resource, which outlives the allocation.
        let take = || unsafe { resource_from_d3d(resource.as_raw().cast()) };
        let allocation = make("take a buffer", take).map_err(|e| gpu.removed().unwrap_or(e))?;
        Ok(Self { allocation, resource, bytes })
    }
}

// SAFETY: neither field is tied to a thread; the allocation is only an address.
unsafe impl Send for Buffer {}
// SAFETY: shared access only reads the fields.
unsafe impl Sync for Buffer {}

/// Number of thread groups, and of threads in all groups, for a shader over `words` 32-bit words.
pub(super) fn groups_for(words: u32) -> (u32, u32) {
    let groups = words.div_ceil(GROUP).clamp(1, GROUPS);
    (groups, groups * GROUP)
}

/// The shaders of a device's contexts, compiled once.
pub(super) struct Kernels {
    pub(super) finite: Pipeline,
    pub(super) equal: Pipeline,
    resize: Resize,
}

impl Kernels {
    pub(super) fn new(gpu: &Gpu) -> Result<Arc<Self>> {
        let finite = Pipeline::new(gpu, FINITE, 4, 1, 1)?;
        Ok(Arc::new(Self { finite, equal: Pipeline::new(gpu, EQUAL, 2, 2, 1)?, resize: Resize::new(gpu)? }))
    }
}

/// A session with its inputs and outputs bound to buffers.
pub(super) struct Bound {
    binding: IoBinding,
    pub(super) graph: Arc<Graph>,
    pub(super) outputs: Vec<BufferId>,
    pub(super) capture: CaptureState,
    /// Reached when the device has executed the last submission of the capture's command lists.
    captured_lists_run_until: Option<FencePoint>,
    /// Timing category of its runs; all bindings of one graph share it.
    kind: WorkKind,
}

impl DirectMlContext {
    pub(super) fn new(
        gpu: &Gpu,
        directml: &DirectMlDevice,
        kernels: &Arc<Kernels>,
        limits: ContextLimits,
    ) -> Result<Self> {
        // Some drivers do not fail when objects are created on a removed device.
        if let Some(gone) = directml.removed() {
            return Err(gone);
        }
        let mut recorder = Recorder::new(gpu)?;
        let copying = recorder.kind();
        // Written explicitly: not every driver returns zeroed memory.
        let mut zeroes = MappedBuffer::new(gpu, Heap::Upload, ZEROES)?;
        zeroes.write(0, &vec![0; ZEROES]);
        let check_result = buffer(gpu, Heap::Device, size_of::<u32>())?;
        let check_readback = MappedBuffer::new(gpu, Heap::Readback, MAX_GROUPS * size_of::<u32>())?;
        Ok(Self {
            bindings: Vec::new(),
            buffers: Vec::new(),
            residency: Mutex::new(ResidencySet::new()),
            graphs_with_weights: Vec::new(),
            recorded: Vec::new(),
            finite_checks: Vec::new(),
            copying,
            zeroes,
            check_result,
            check_readback,
            recorder: Mutex::new(recorder),
            kernels: kernels.clone(),
            frames: None,
            expected: Vec::new(),
            uncaptured_options: None,
            gpu: gpu.clone(),
            directml: directml.clone(),
            bytes: Bytes::default(),
            read: Arc::default(),
            in_onnxruntime: Duration::ZERO,
            waited: AtomicU64::new(0),
            throttle: SubmissionThrottle::new(limits.longest_submission),
            limits,
        })
    }

    /// Runs a binding without capture.
    pub(super) fn run_uncaptured(&mut self, id: BindingId) -> Result<()> {
        let options = self.uncaptured_options.as_ref().map_or(std::ptr::null(), CaptureRunOptions::ptr);
        self.run_timed(id, options)
    }

    /// Runs a binding by its capture; the first run with a capture name records the capture.
    pub(super) fn run_named(&mut self, id: BindingId, name: &CaptureRunOptions) -> Result<()> {
        self.recorder.get_mut().submit()?;
        self.wait_for_captured_lists(id)?;
        self.run_with(id, name.ptr())?;
        self.mark_captured_lists(id)
    }

    /// Waits until the device has executed the command lists of a binding's capture, which ONNX Runtime submits again without a check.
    fn wait_for_captured_lists(&self, id: BindingId) -> Result<()> {
        match &self.bindings[id.0].captured_lists_run_until {
            Some(fence_point) if !fence_point.reached() => self.wait_for(fence_point),
            _ => Ok(()),
        }
    }

    /// Records that the command lists of a binding's capture were submitted.
    fn mark_captured_lists(&mut self, id: BindingId) -> Result<()> {
        self.bindings[id.0].captured_lists_run_until = Some(self.gpu.anchors().signal()?);
        Ok(())
    }

    fn run_timed(&mut self, id: BindingId, options: *const ort::sys::OrtRunOptions) -> Result<()> {
        self.wait_for_queue_space(self.bindings[id.0].kind)?;
        let interval = self.recorder.get_mut().start(self.bindings[id.0].kind)?;
        let ran = self.run_with(id, options);
        match ran {
            Ok(()) => self.recorder.get_mut().end(interval),
            Err(_) => self.recorder.get_mut().cancel(interval),
        }
        ran
    }

    /// Runs a binding in ONNX Runtime; `options` are null or live.
    fn run_with(&mut self, id: BindingId, options: *const ort::sys::OrtRunOptions) -> Result<()> {
        // ONNX Runtime would submit its work first and check for a removed device after that. DirectML's device can be removed alone, and
        // then binds nothing.
        if let Some(gone) = self.directml.removed() {
            return Err(gone);
        }
        let Bound { binding, graph, .. } = &self.bindings[id.0];
        let run = ort::api().RunWithBinding;
        let start = Instant::now();
        let run_lock = DirectMlGraph::of(graph).run_lock().lock();
        let session = graph.session().ptr().cast_mut();
        // SAFETY: one run of the session at a time; this binding and its buffers are used by `&mut self` alone.
        let run = || unsafe { run(session, options, binding.ptr()) };
        let status = self.gpu.anchors().with_event(DirectMlGraph::of(graph).title(), run);
        drop(run_lock);
        self.in_onnxruntime += start.elapsed();
        // SAFETY: the status is what the call above returned, used once.
        unsafe { ort::Error::result_from_status(status) }
            .map_err(|e| self.directml.or_removed(ort_failure("run a graph", &e)))
    }

    /// Fills a buffer with zeroes, including the padding of its last 32-bit word, which shaders read.
    pub(super) fn clear_buffer(&mut self, buffer: BufferId) -> Result<()> {
        let buffer = &self.buffers[buffer.0];
        self.recorder.get_mut().copy_from_upload(&buffer.resource, self.zeroes.resource(), zeroed_regions(buffer.bytes))
    }

    /// Makes buffers and weights resident for everything submitted from now on: all of them or none.
    fn make_resident(&self) -> Result<()> {
        let mut residency = self.residency.lock();
        if residency.is_resident() {
            return Ok(());
        }
        let mut held = 0;
        let mut hold = |graph: &Arc<Graph>| {
            DirectMlGraph::of(graph).weights().hold(&self.gpu)?;
            held += 1;
            Ok(())
        };
        let all = self.graphs_with_weights.iter().try_for_each(&mut hold);
        let all = all.and_then(|()| residency.make_resident(&self.gpu, self.gpu.anchors()));
        if all.is_err() {
            self.release(&self.graphs_with_weights[..held]);
        }
        all
    }

    /// Releases weights. No submitted work may use them any more.
    fn release(&self, of: &[Arc<Graph>]) {
        of.iter().for_each(|graph| DirectMlGraph::of(graph).weights().release(&self.gpu));
    }

    /// Waits until `fence_point`, which follows all submitted work, is reached, and adds the time to `waited`.
    pub(super) fn wait(&self, fence_point: &FencePoint) -> Result<()> {
        let reached = self.wait_for(fence_point);
        self.throttle.clear();
        reached
    }

    /// Waits until `fence_point` is reached, and adds the time to `waited`.
    fn wait_for(&self, fence_point: &FencePoint) -> Result<()> {
        let start = Instant::now();
        let reached = fence_point.wait();
        let nanoseconds = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.waited.fetch_add(nanoseconds, Ordering::Relaxed);
        reached
    }
}

/// The copies from the buffer of zeroes that clear a buffer of `bytes`.
fn zeroed_regions(bytes: usize) -> impl Iterator<Item = Region> {
    let bytes = bytes.next_multiple_of(size_of::<u32>());
    (0..bytes).step_by(ZEROES).map(move |at| Region { to: at, from: 0, len: ZEROES.min(bytes - at) })
}

impl ExecutionContext for DirectMlContext {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        self.make_resident()?;
        let made = Buffer::new(&self.gpu, bytes)?;
        self.residency.get_mut().add(&self.gpu, &made.resource)?;
        self.buffers.push(made);
        let made = BufferId(self.buffers.len() - 1);
        let buffer = &self.buffers[made.0];
        let regions = zeroed_regions(buffer.bytes).collect();
        self.recorder.get_mut().clear_new(&buffer.resource, self.zeroes.resource(), regions)?;
        Ok(made)
    }

    fn size(&self, of: BufferId) -> usize {
        self.buffers[of.0].bytes
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        self.make_resident()?;
        if !self.graphs_with_weights.iter().any(|held| Arc::ptr_eq(held, graph)) {
            DirectMlGraph::of(graph).weights().hold(&self.gpu)?;
            self.graphs_with_weights.push(graph.clone());
        }
        assert_eq!(tensors.len(), graph.tensors().len(), "one buffer for each input and output");
        let binding = make("bind a tensor", || graph.session().create_binding());
        let mut binding = binding.map_err(|e| self.directml.or_removed(e))?;
        for (i, ((name, spec), buffer)) in graph.tensors().iter().zip(tensors).enumerate() {
            let memory = &self.buffers[buffer.0];
            assert_eq!(memory.bytes, spec.bytes(), "{}: the buffer fits the tensor", spec.name);
            let input = i < graph.input_count();
            assert!(input || tensors.iter().filter(|b| *b == buffer).count() == 1, "{}: written alone", spec.name);
            make("bind a tensor", || bind_one(&mut binding, name, input, spec, &memory.allocation))
                .map_err(|e| self.directml.or_removed(e))?;
        }
        for (name, spec, memory) in DirectMlGraph::of(graph).weights().inputs() {
            make("bind a weight", || bind_one(&mut binding, name, true, spec, &memory.allocation))
                .map_err(|e| self.directml.or_removed(e))?;
        }
        let same = self.bindings.iter().find(|bound| Arc::ptr_eq(&bound.graph, graph));
        let kind = same.map(|bound| bound.kind).unwrap_or_else(|| self.recorder.get_mut().kind());
        let (outputs, capture) =
            (tensors[graph.input_count()..].to_vec(), DirectMlGraph::of(graph).captures().initial_state());
        if !matches!(capture, CaptureState::Never(_)) && self.uncaptured_options.is_none() {
            self.uncaptured_options = Some(CaptureRunOptions::none()?);
        }
        let (graph, captured_lists_run_until) = (graph.clone(), None);
        self.bindings.push(Bound { binding, graph, outputs, capture, captured_lists_run_until, kind });
        Ok(BindingId(self.bindings.len() - 1))
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.make_resident()?;
        let buffer = &self.buffers[to.0];
        assert!(at + bytes.len() <= buffer.bytes, "inside the buffer");
        self.recorder.get_mut().upload(&buffer.resource, at, bytes)?;
        self.bytes.uploaded += bytes.len() as u64;
        Ok(())
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        self.make_resident()?;
        let mut staged =
            MappedBuffer::new(&self.gpu, Heap::Upload, contents.iter().map(|(_, bytes)| bytes.len()).sum())?;
        let recorder = self.recorder.get_mut();
        recorder.submit_and_reserve()?;
        let mut from = 0;
        for (to, bytes) in contents {
            let to = &self.buffers[to.0];
            assert_eq!(bytes.len(), to.bytes, "a whole buffer");
            staged.write(from, bytes);
            let whole = Region { to: 0, from, len: bytes.len() };
            recorder.copy_from_upload(&to.resource, staged.resource(), std::iter::once(whole))?;
            from += bytes.len();
        }
        recorder.hold(staged);
        recorder.submit()?;
        self.bytes.uploaded += from as u64;
        Ok(())
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        self.make_resident()?;
        self.recorder.get_mut().submit_and_reserve()?;
        buffers.iter().try_for_each(|buffer| self.clear_buffer(*buffer))?;
        self.recorder.get_mut().submit()
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.make_resident()?;
        assert_ne!(to, from, "two buffers of this context");
        let (to, from) = (&self.buffers[to.0], &self.buffers[from.0]);
        for r in regions {
            assert!(r.to + r.len <= to.bytes && r.from + r.len <= from.bytes, "inside the buffers");
            self.bytes.copied += r.len as u64;
        }
        self.recorder.get_mut().copy(&to.resource, &from.resource, regions.iter().copied())
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        let resources = |copy: &RecordedCopy| (&self.buffers[copy.to.0].resource, &self.buffers[copy.from.0].resource);
        let resolved = copies.iter().map(|copy| (resources(copy), copy.regions.as_slice()));
        let list = ReusableList::new(&self.gpu, resolved)?;
        let bytes = copies.iter().flat_map(|copy| &copy.regions).map(|region| region.len as u64).sum();
        self.recorded.push((list, bytes));
        Ok(RecordedCopiesId(self.recorded.len() - 1))
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.make_resident()?;
        copies.iter().try_for_each(|copies| self.recorded[copies.0].0.ready())?;
        let recorder = self.recorder.get_mut();
        let interval = recorder.start(self.copying)?;
        let lists = copies.iter().map(|copies| self.recorded[copies.0].0.list().clone()).collect();
        let fence_point = self.gpu.anchors().with_event(c"Cairn: commit", || recorder.submit_after(lists, interval))?;
        for copies in copies {
            let (list, bytes) = &mut self.recorded[copies.0];
            list.runs_until(&fence_point);
            self.bytes.copied += *bytes;
        }
        Ok(())
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        self.make_resident()?;
        let resources = of.iter().map(|buffer| &self.buffers[buffer.0]);
        let contents: Vec<_> = resources.map(|buffer| (&buffer.resource, buffer.bytes)).collect();
        self.recorder.get_mut().submit()?;
        super::DeviceBackup::new(&self.gpu, &contents).map(Backup::new)
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        let backup = backup.into_contents::<super::DeviceBackup>();
        let recorder = self.recorder.get_mut();
        // Commands recorded before the failure may write to the restored buffers, so they must run first or be discarded.
        recorder.submit().or_else(|_| recorder.discard())?;
        backup.restore_backup(&self.gpu)
    }

    fn lost_submissions(&self) -> u64 {
        self.recorder.lock().lost_submissions()
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.limits.check_stop()?;
        self.make_resident()?;
        match &self.bindings[binding.0].capture {
            CaptureState::Never(_) => self.run_uncaptured(binding),
            CaptureState::Untried | CaptureState::Checked(..) => self.run_and_compare(binding),
            CaptureState::Used(name) => {
                let options = name.ptr();
                self.wait_for_captured_lists(binding)?;
                self.run_timed(binding, options)?;
                self.mark_captured_lists(binding)
            }
        }
    }

    fn capture_statistics(&self) -> Option<CaptureStatistics> {
        let mut statistics = CaptureStatistics::default();
        self.bindings.iter().for_each(|bound| bound.capture.count_in(&mut statistics));
        Some(statistics)
    }

    fn gpu_time(&mut self, on: Work<'_>) -> Option<GpuTimeStatistics> {
        let kind = match on {
            Work::Runs(graph) => self.bindings.iter().find(|bound| Arc::ptr_eq(&bound.graph, graph))?.kind,
            Work::RecordedCopies => self.copying,
        };
        Some(self.recorder.get_mut().gpu_time(kind))
    }

    fn external_times(&self) -> Option<ExternalTimes> {
        let waited = Duration::from_nanos(self.waited.load(Ordering::Relaxed));
        Some(ExternalTimes {
            in_onnxruntime: self.in_onnxruntime,
            waiting_for_device: waited,
            yields: self.throttle.yields(),
        })
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        self.make_resident()?;
        let buffer = &self.buffers[from.0];
        assert!(at + into.len() <= buffer.bytes, "inside the buffer");
        let readback = MappedBuffer::new(&self.gpu, Heap::Readback, into.len())?;
        let region = Region { to: 0, from: at, len: into.len() };
        let fence_point = {
            let mut recorder = self.recorder.lock();
            // First, because a list that cannot be submitted stays open, and this one refers to a buffer of this call.
            recorder.reserve()?;
            recorder.copy(readback.resource(), &buffer.resource, std::iter::once(region))?;
            recorder.submit_and_signal()?
        };
        self.wait(&fence_point)?;
        readback.read(into);
        self.read.fetch_add(into.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        let finite_check = FiniteCheck::new(self, groups, precision)?;
        self.finite_checks.push(finite_check);
        Ok(FiniteCheckId(self.finite_checks.len() - 1))
    }

    fn find_not_finite(&mut self, finite_check: FiniteCheckId) -> Result<Option<usize>> {
        self.make_resident()?;
        self.finite_checks[finite_check.0].ready()?;
        let list = self.finite_checks[finite_check.0].list().clone();
        let recorder = self.recorder.get_mut();
        let fence_point =
            self.gpu.anchors().with_event(c"Cairn: check for NaN and infinity", || recorder.submit_then(list))?;
        self.finite_checks[finite_check.0].runs_until(&fence_point);
        self.wait(&fence_point)?;
        Ok(self.finite_checks[finite_check.0].read(&self.check_readback))
    }

    fn rest(&mut self) -> Result<()> {
        if self.is_resting() {
            return Ok(());
        }
        // Recorded commands that are not submitted yet use the buffers as well.
        let fence_point = self.recorder.get_mut().submit_and_signal()?;
        self.wait(&fence_point)?;
        self.residency.get_mut().evict(&self.gpu)?;
        self.release(&self.graphs_with_weights);
        Ok(())
    }

    fn is_resting(&self) -> bool {
        !self.residency.lock().is_resident()
    }

    fn bytes(&self) -> Bytes {
        Bytes { read: self.read.load(Ordering::Relaxed), ..self.bytes }
    }

    fn allocate_snapshot(&mut self, latent: BufferId, pictures: usize, size: (u32, u32)) -> Result<Option<Snapshot>> {
        if self.frames.is_none() {
            self.frames = Some(CommandRing::new(&self.gpu, self.gpu.anchors(), 2 * PICTURES as u32)?);
        }
        Snapshot::new(&self.gpu, pictures, size, self.size(latent), &self.read).map(Some)
    }

    fn fill_snapshot(&mut self, decoded: &Decoded<'_>, latent: BufferId, into: &mut Snapshot) -> Result<()> {
        self.make_resident()?;
        let frames = self.frames.as_mut().expect("made with the room");
        let state = D3D12_RESOURCE_STATE_COMMON;
        let latent = &self.buffers[latent.0];
        let buffer = ResourceWithState { resource: &self.buffers[decoded.planes.0].resource, state };
        for at in (0..decoded.pictures.len()).step_by(PICTURES) {
            let mut frame = frames.begin()?;
            if at == 0 {
                let (from, to) = (ResourceWithState { resource: &latent.resource, state }, into.latent());
                frame.copy_bytes(&from, latent.bytes as u64, &ResourceWithState { resource: to, state }, 0)?;
                self.bytes.copied += latent.bytes as u64;
            }
            for (picture, texture) in decoded.pictures.iter().zip(into.textures()).skip(at).take(PICTURES) {
                let half = decoded.precision == Precision::F16;
                let planes = Planes { buffer, picture: *picture, size: decoded.size, half };
                self.kernels.resize.record(&mut frame, &planes, &ResourceWithState { resource: texture, state })?;
            }
            into.set_fence_point(frame.submit(self.gpu.anchors())?);
        }
        Ok(())
    }
}

impl Drop for DirectMlContext {
    fn drop(&mut self) {
        // The queue may still use the resources that are freed next, and those that ONNX Runtime frees after them.
        self.gpu.anchors().wait_ignoring_loss();
        if self.residency.get_mut().is_resident() {
            self.release(&self.graphs_with_weights);
        }
    }
}

/// Binds one tensor to the buffer of `allocation`. The buffer must have the size of `spec` and outlive `binding`.
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
        ElementType::F32 => {
            // SAFETY: the provider's allocation of a buffer of the tensor's size, which outlives the binding.
            unsafe { TensorRefMut::<f32>::from_raw(device, address.cast(), shape) }?.into_dyn()
        }
        ElementType::F16 => {
            // SAFETY: as above.
            unsafe { TensorRefMut::<half::f16>::from_raw(device, address.cast(), shape) }?.into_dyn()
        }
        ElementType::U8 => {
            // SAFETY: as above.
            unsafe { TensorRefMut::<u8>::from_raw(device, address.cast(), shape) }?.into_dyn()
        }
    };
    // The `ort` crate's own method copies borrowed tensors.
    let bind = if input { ort::api().BindInput } else { ort::api().BindOutput };
    // SAFETY: name and value are valid for the call; the binding keeps its own reference to the value.
    let status = unsafe { bind(binding.ptr_mut(), name.as_ptr(), value.ptr()) };
    // SAFETY: the status is what the call above returned, used once.
    unsafe { ort::Error::result_from_status(status) }
}
