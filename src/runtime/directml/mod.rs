//! Runs worlds on a Direct3D 12 device: ONNX Runtime's DirectML provider over buffers of our own. Windows only.

mod backup;
mod capture;
mod capture_check;
mod context;
mod device;
mod finite_check;
mod graph_data;
mod interval_times;
mod library;
mod recorder;
mod reusable_list;
mod snapshot;
mod submission_throttle;
mod weights;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::locks::Mutex;
use ort::AsPointer;
use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use windows::core::Interface;

use super::device::{Backend, DeviceKind, DeviceMemory};
use super::failure::make;
use super::graph::TensorSpec;
use super::{ContextLimits, ExecutionContext, Graph, Ort};
use backup::DeviceBackup;
use device::DirectMlDevice;
use graph_data::DirectMlGraph;
pub(crate) use snapshot::Snapshot;

use capture::CaptureQuota;
use weights::Weights;

use crate::bundle::{ModelSource, Precision, weights_as_inputs};
use crate::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// Options of a DirectML device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DirectMlOptions {
    /// Uses ONNX Runtime's deterministic kernels only, and no captured passes. The metacommands of a driver stay enabled: the
    /// provider has no switch for them on an engine's device.
    pub deterministic: bool,
    /// Maximum number of passes of each graph that ONNX Runtime may capture: it keeps their commands and submits them again, which
    /// saves almost all of a pass's processor time. A rollout has at most two per graph, and ONNX Runtime keeps those of dropped
    /// rollouts as long as the world is loaded. A captured pass is used only if it gives the same bits as a normal one; the first
    /// runs of each pass check this, and [`Rollout::capture_statistics`](crate::world::Rollout::capture_statistics) reports it. 0, the default, turns
    /// capture off, as memory grows with each rollout that is made. 16 are enough for eight rollouts.
    pub captured_passes: usize,
    /// Maximum work of a rollout on the queue for anchors at a time, in device time, so that an engine's frames get their turn in
    /// between: before a pass that would exceed it, the rollout waits until the queued work is done. A pass is divided only if its world is in
    /// [slices](crate::world::WorldOptions::slices): [`DeviceTimes`](crate::world::DeviceTimes) has the longest slice and the number of waits.
    /// `None`, the default, sets no limit.
    pub longest_submission: Option<Duration>,
    /// Makes ONNX Runtime write a profile with the provider and duration of each node: a JSON file for each session, complete when
    /// the session is dropped. The file name begins with this path; the session's number, date and time follow. Costs time in every
    /// pass, and no pass is captured.
    pub profile: Option<PathBuf>,
}

impl DirectMlOptions {
    /// How many passes of a session may be captured, or why none may.
    fn captures(&self) -> std::result::Result<usize, &'static str> {
        match self {
            Self { deterministic: true, .. } => Err("the device is deterministic"),
            Self { captured_passes: 0, .. } => Err("it is turned off"),
            Self { profile: Some(_), .. } => Err("a profile needs every node to be run"),
            Self { captured_passes, .. } => Ok(*captured_passes),
        }
    }
}

/// The backend of [`Device::directml`](super::Device::directml).
pub(super) struct DirectMlBackend {
    ort: Ort,
    pub(super) gpu: Gpu,
    device: DirectMlDevice,
    precision: Precision,
    kernels: Arc<context::Kernels>,
    name: String,
    /// For worlds that are loaded and rollouts that are made from now on.
    pub(super) options: Mutex<DirectMlOptions>,
}

impl DirectMlBackend {
    pub(super) fn new(ort: &Ort, gpu: &Gpu, options: DirectMlOptions) -> Result<Self> {
        // Checked first: DirectML.dll is missing beside most builds without the provider, and adding it would not help.
        provider().map_err(|_| no_provider(ort))?;
        let library = library::load(ort)?;
        let device = DirectMlDevice::new(library.device(gpu)?, gpu);
        let precision = if device.has_float16() { Precision::F16 } else { Precision::F32 };
        let name = gpu.adapter_name().unwrap_or_else(|| format!("adapter {:#x}", gpu.luid()));
        let kernels = context::Kernels::new(gpu)?;
        Ok(Self { ort: ort.clone(), gpu: gpu.clone(), device, precision, kernels, name, options: Mutex::new(options) })
    }

    /// The session options that all graphs share.
    fn session(
        &self,
        options: &DirectMlOptions,
        dimensions: &[(&str, usize)],
        is_captured: bool,
    ) -> ort::Result<SessionBuilder> {
        let mut builder = Session::builder(self.ort.environment())?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            // Required by the provider: it runs nodes in order and manages its own memory.
            .with_parallel_execution(false)?
            .with_memory_pattern(false)?
            // Every session would make a pool of as many threads as the processor has cores, which a graphics device has no work for.
            .with_intra_threads(1)?
            // A node that falls back to the processor would copy its tensors to the host and back in every pass.
            .with_config_entry("session.disable_cpu_ep_fallback", "1")?
            .with_deterministic_compute(options.deterministic)?;
        if is_captured {
            let (name, value) = capture::ALLOWED;
            builder = builder.with_config_entry(name, value)?;
        }
        if let Some(path) = &options.profile {
            // ONNX Runtime appends the time in whole seconds: sessions made in the same second would overwrite each other's files.
            static SESSIONS: AtomicUsize = AtomicUsize::new(0);
            let mut path = path.clone().into_os_string();
            path.push(format!("_{}", SESSIONS.fetch_add(1, Ordering::Relaxed)));
            builder = builder.with_profiling(path)?;
        }
        for &(name, size) in dimensions {
            builder = builder.with_dimension_override(name, i64::try_from(size).unwrap_or(i64::MAX))?;
        }
        let api = provider()?;
        let queue = self.gpu.anchors().d3d12();
        let append = api.SessionOptionsAppendExecutionProvider_DML1;
        // SAFETY: live options, device and queue; the provider takes references of its own.
        let status = unsafe { append(builder.ptr_mut(), self.device.raw().cast(), queue.as_raw().cast()) };
        // SAFETY: the status is what the call above returned, used once.
        unsafe { ort::Error::result_from_status(status) }?;
        Ok(builder)
    }
}

impl Backend for DirectMlBackend {
    fn describe(&self) -> String {
        let deterministic = if self.options.lock().deterministic { ", deterministic" } else { "" };
        format!("ONNX Runtime {} DirectML on {}{deterministic}", self.ort.version(), self.name)
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn threads(&self) -> usize {
        1
    }

    fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
        shared: Option<&Arc<Graph>>,
    ) -> Result<Arc<Graph>> {
        if let Some(gone) = self.device.removed() {
            return Err(gone);
        }
        let options = self.options.lock().clone();
        // ONNX Runtime keeps weights inside a session until the session is dropped. Weights that are inputs can be evicted while no
        // rollout uses them.
        let (onnx, weights) = weights_as_inputs(model)?;
        let model = ModelSource { onnx: &onnx, external: model.external.clone() };
        let specs: Vec<_> = weights.iter().map(weights::spec).collect();
        let commit = |is_captured| {
            let builder = make("prepare a session", || self.session(&options, dimensions, is_captured));
            builder.and_then(|builder| Graph::commit(builder, what, &model, inputs.clone(), &specs, outputs.clone()))
        };
        let (graph, captures) = match options.captures() {
            Err(why) => (commit(false), CaptureQuota::refused(why)),
            Ok(count) => match commit(true) {
                Ok(graph) => (Ok(graph), CaptureQuota::up_to(count)),
                Err(e) => {
                    log::warn!("the {what} is made without captured passes: {e}");
                    (commit(false), CaptureQuota::refused(e.to_string()))
                }
            },
        };
        let with_data = |graph: Graph| {
            let shared = shared.map(|graph| DirectMlGraph::of(graph).weights()).filter(|shared| shared.are(&weights));
            let weights = match shared {
                Some(shared) => shared.clone(),
                None => Arc::new(Weights::new(&self.gpu, &weights)?),
            };
            let data = DirectMlGraph::new(what, captures, weights);
            Ok(Arc::new(graph.with_data(data)))
        };
        graph.and_then(with_data).map_err(|e| self.device.removed().unwrap_or(e))
    }

    fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>> {
        let longest = [self.options.lock().longest_submission, limits.longest_submission].into_iter().flatten().min();
        let limits = ContextLimits { longest_submission: longest, ..limits };
        Ok(Box::new(context::DirectMlContext::new(&self.gpu, &self.device, &self.kernels, limits)?))
    }

    fn kind(&self) -> DeviceKind {
        DeviceKind::Direct3d12
    }

    fn memory(&self) -> Option<DeviceMemory> {
        let budget = self.gpu.budget().ok().flatten()?;
        Some(DeviceMemory { granted: budget.granted, used: budget.used })
    }

    fn directml(&self) -> Option<&DirectMlBackend> {
        Some(self)
    }
}

/// The functions of ONNX Runtime's DirectML provider.
fn provider() -> ort::Result<&'static ort::sys::OrtDmlApi> {
    ort::ep::directml::api().ok_or_else(|| ort::Error::new("this build of ONNX Runtime has no DirectML provider"))
}

fn no_provider(ort: &Ort) -> Error {
    let cause = format!("this build of ONNX Runtime, {}, has no DirectML provider", ort.version());
    Error::new(ErrorKind::Unsupported, cause).field(ort.path().display().to_string()).remedy(
        "A process uses one file of ONNX Runtime: start it with onnxruntime.dll of the PyPI package onnxruntime-directml 1.24.4 and \
         its DirectML.dll, which also run worlds on the CPU and through the WebGPU plugin; or use a CPU device",
    )
}

/// An `Unsupported` error with the advice to use a CPU device.
fn unsupported(cause: String) -> Error {
    Error::new(ErrorKind::Unsupported, cause).remedy("Use a CPU device")
}
