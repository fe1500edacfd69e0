//! Runs worlds on a graphics adapter through ONNX Runtime's WebGPU provider, a plugin that uses Vulkan on Linux, and Direct3D 12 or Vulkan on
//! Windows.
//!
//! All values stay in buffers on the adapter. The provider gives no access to its queue, so moves and checks of values are small graphs of
//! their own ([`helper_graphs`]).

mod adapter_errors;
mod adapters;
mod buffer;
mod context;
mod helper_graphs;
mod pictures;
mod plugin;
mod value;

use std::path::PathBuf;
use std::sync::Arc;

use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};

use super::DeviceMemory;
use super::device::{Backend, DeviceKind};
use super::failure::make;
use super::graph::TensorSpec;
use super::{ContextLimits, ExecutionContext, Graph, Ort, self_test};
use crate::bundle::{ModelSource, Precision, largest_weight, with_split_k, without_fused_products};
use crate::{Error, ErrorKind, LibrarySearch, Result};
pub(super) use adapter_errors::note;
use context::WebGpuContext;
pub use plugin::WebGpuOptions;
use plugin::{LOCK, Plugin};

/// An adapter for [`Device::webgpu`](super::Device::webgpu).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WebGpuAdapter {
    /// Name, for people.
    pub name: String,
    /// PCI identifier of its maker.
    pub vendor: u32,
    /// Bytes of its own memory.
    pub memory: u64,
    /// Whether the processor emulates it.
    pub software: bool,
}

/// Lists the adapters that Vulkan has, in its order, which [`WebGpuOptions::adapter`] counts by. Empty without Vulkan, and on systems other
/// than Linux, where only the provider knows them.
pub fn webgpu_adapters() -> Vec<WebGpuAdapter> {
    adapters::list().unwrap_or_else(|error| {
        log::info!("{error}");
        Vec::new()
    })
}

/// The requirements of a WebGPU device besides ONNX Runtime's own library.
pub(crate) struct WebGpuRequirements {
    /// The provider's library, or why it cannot be used.
    pub(crate) library: Result<PathBuf>,
    /// The adapter that would be used if none is named, or why there is none.
    pub(crate) adapter: Result<String>,
}

impl WebGpuRequirements {
    /// Loads the provider's library, which stays loaded, and looks for an adapter.
    pub(crate) fn find(ort: &Ort, libraries: &LibrarySearch) -> Self {
        let (library, adapter) = plugin::requirements(ort, libraries);
        Self { library, adapter }
    }
}

/// The backend of [`Device::webgpu`](super::Device::webgpu).
pub(super) struct WebGpuBackend {
    plugin: Arc<Plugin>,
    precision: Precision,
    deterministic: bool,
}

impl WebGpuBackend {
    pub(super) fn new(ort: &Ort, options: &WebGpuOptions) -> Result<Self> {
        match Self::load(ort, options) {
            Err(error) if error.kind() == ErrorKind::DeviceRemoved => {
                plugin::unload_lost_device(ort)?;
                Self::load(ort, options)
            }
            loaded => loaded,
        }
    }

    fn load(ort: &Ort, options: &WebGpuOptions) -> Result<Self> {
        let plugin = Arc::new(Plugin::load(ort, options)?);
        let computes = |precision| {
            let model = self_test::model(precision);
            helper_graphs::passes_self_test(&plugin, &model, precision)
        };
        if !computes(Precision::F32)? {
            let cause = format!("{} gives a wrong sum", plugin.describe());
            return Err(Error::new(ErrorKind::Device, cause).remedy("Update its driver, or use a CPU device"));
        }
        // Without half floats the adapter refuses the graph, or the processor would run it, which is refused too.
        let has_half = computes(Precision::F16).unwrap_or_else(|refusal| {
            log::info!("worlds are float32 on {}: {refusal}", plugin.describe());
            false
        });
        let precision = if has_half { Precision::F16 } else { Precision::F32 };
        Ok(Self { plugin, precision, deterministic: options.deterministic })
    }

    /// The session options that all graphs share.
    fn session(&self, dimensions: &[(&str, usize)]) -> ort::Result<SessionBuilder> {
        let mut builder = self.plugin.session(self.deterministic)?;
        for &(name, size) in dimensions {
            builder = builder.with_dimension_override(name, i64::try_from(size).unwrap_or(i64::MAX))?;
        }
        Ok(builder)
    }
}

impl Backend for WebGpuBackend {
    fn describe(&self) -> String {
        // Without ", deterministic": the provider has no such kernels to choose (`docs/providers.md`).
        self.plugin.describe().to_owned()
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn threads(&self) -> usize {
        1
    }

    fn kind(&self) -> DeviceKind {
        DeviceKind::WebGpu
    }

    fn memory(&self) -> Option<DeviceMemory> {
        self.plugin.memory_use()
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
        let tensors = inputs.iter().chain(&outputs).map(|spec| (spec.name.clone(), spec.bytes() as u64));
        for (tensor, bytes) in tensors.chain(largest_weight(model.onnx)?) {
            self.plugin.check_fits(what, &tensor, bytes)?;
        }
        let sizes: Vec<_> =
            inputs.iter().chain(&outputs).map(|spec| (spec.name.as_str(), spec.shape.as_slice())).collect();
        let rewritten = without_fused_products(model.onnx, &sizes)?;
        let onnx = rewritten.as_deref().unwrap_or(model.onnx);
        let split = with_split_k(onnx, &sizes)?;
        let model = ModelSource { onnx: split.as_deref().unwrap_or(onnx), external: model.external.clone() };
        let builder = make("prepare a session", || self.session(dimensions))?;
        let graph = adapter_errors::call_provider(|| {
            let graph = Graph::commit(builder, what, &model, inputs, &[], outputs)?;
            plugin::refuse_other_providers(graph.session(), what, self.plugin.describe())?;
            Ok(graph)
        })?;
        // Not before: a refused graph is dropped above, where the lock is held.
        Ok(Arc::new(graph.with_drop_lock(&LOCK, self.plugin.registration())))
    }

    fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>> {
        Ok(Box::new(WebGpuContext::new(&self.plugin, limits)))
    }
}

impl Plugin {
    /// The options of every session on the adapter.
    fn session(&self, deterministic: bool) -> ort::Result<SessionBuilder> {
        let builder = Session::builder(self.environment())?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_parallel_execution(false)?
            .with_intra_threads(1)?
            .with_deterministic_compute(deterministic)?
            .with_config_entry(plugin::RECORD_PROVIDERS, "1")?;
        Ok(builder.with_devices([self.device()], Some(self.provider_options()))?)
    }
}
