//! The devices that run worlds.

use std::sync::Arc;

use super::cpu::{CpuBackend, CpuOptions};
use super::graph::TensorSpec;
use super::{ContextLimits, ExecutionContext, Graph, Ort};
use crate::bundle::{ModelSource, Precision};
use crate::{Error, LibrarySearch, Result};

/// Implementation of a [`Device`].
pub(super) trait Backend: Send + Sync {
    fn describe(&self) -> String;

    fn precision(&self) -> Precision;

    fn threads(&self) -> usize;

    fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
        shared: Option<&Arc<Graph>>,
    ) -> Result<Arc<Graph>>;

    fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>>;

    fn kind(&self) -> DeviceKind;

    /// A graphics device's memory budget and use; `None` where there is none or the system reports none.
    fn memory(&self) -> Option<DeviceMemory> {
        None
    }

    /// Itself, if it is DirectML's.
    #[cfg(windows)]
    fn directml(&self) -> Option<&super::directml::DirectMlBackend> {
        None
    }
}

/// What a [`Device`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// The host's processor.
    Cpu,
    /// A Direct3D 12 device, through DirectML.
    Direct3d12,
    /// A graphics adapter, through ONNX Runtime's WebGPU provider.
    WebGpu,
}

impl std::fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Cpu => "the processor",
            Self::Direct3d12 => "Direct3D 12",
            Self::WebGpu => "WebGPU",
        })
    }
}

/// Memory of a graphics device, in bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceMemory {
    /// Memory budget that the system grants to this process. Above it, the system evicts memory, and everything becomes slow.
    pub granted: u64,
    /// Memory that the process uses, an engine's textures and worlds included.
    pub used: u64,
}

/// Notification that the system has changed the memory budget of a graphics device.
#[derive(Debug)]
#[cfg(windows)]
pub(crate) struct MemoryChanges(crate::gpu::BudgetChanges);

/// Not available on other systems.
#[derive(Debug)]
#[cfg(not(windows))]
pub(crate) enum MemoryChanges {}

impl MemoryChanges {
    /// Whether the budget has changed since the last call. Does not wait.
    pub(crate) fn changed(&self) -> bool {
        #[cfg(windows)]
        return self.0.changed();
        #[cfg(not(windows))]
        match *self {}
    }
}

/// A device that runs worlds. Cheap to clone; every clone is the same device.
///
/// Threads: may be used from any thread at any time.
#[derive(Clone)]
pub struct Device {
    backend: Arc<dyn Backend>,
    libraries: Arc<LibrarySearch>,
}

impl Device {
    /// The host's processor, through ONNX Runtime's CPU provider.
    ///
    /// # Errors
    /// `InvalidArgument` for a thread count of 0 or above 1024.
    pub fn cpu(ort: &Ort, options: CpuOptions) -> Result<Device> {
        Ok(Self::of(Arc::new(CpuBackend::new(ort, options)?)))
    }

    /// A Direct3D 12 device, through ONNX Runtime's DirectML provider: a world's passes run on its queue for anchors. The
    /// build of ONNX Runtime must have this provider, as version 1.24.4 of the PyPI package `onnxruntime-directml` has. A process uses
    /// one file of ONNX Runtime, so a host that wants DirectML loads that one also for its CPU and WebGPU devices.
    ///
    /// # Errors
    /// `RuntimeMissing` when the DirectML.dll that belongs to ONNX Runtime is not beside it; `Unsupported` when ONNX Runtime is a build
    /// without DirectML, or the adapter cannot do DirectML's feature level 5.0; `DeviceRemoved`.
    #[cfg(windows)]
    pub fn directml(ort: &Ort, gpu: &crate::gpu::Gpu, options: super::DirectMlOptions) -> Result<Device> {
        Ok(Self::of(Arc::new(super::directml::DirectMlBackend::new(ort, gpu, options)?)))
    }

    /// A graphics adapter, through ONNX Runtime's WebGPU provider: by Vulkan on Linux, and on Windows by Direct3D 12, or by Vulkan
    /// if `vulkan-1.dll` lies beside the plugin's library, which it needs: `libonnxruntime_providers_webgpu.so`, or
    /// `onnxruntime_providers_webgpu.dll`.
    ///
    /// All WebGPU devices of a process share one adapter, and their work takes turns. Worlds are float16 where the adapter has it.
    ///
    /// # Errors
    /// `RuntimeMissing` when the plugin is not there or does not fit ONNX Runtime; `InvalidArgument` when no adapter has the given name;
    /// `Unsupported` when there is no adapter, only one that the processor emulates and that was not named, or another one in use by the
    /// process; `Device` when the adapter does not work; `DeviceRemoved` when the process's device is lost and anything made on it is left.
    pub fn webgpu(ort: &Ort, options: &super::WebGpuOptions) -> Result<Device> {
        let device = Self::of(Arc::new(super::webgpu::WebGpuBackend::new(ort, options)?));
        Ok(device.with_library_search(options.libraries.clone()))
    }

    /// The best device of this machine: an adapter through DirectML on Windows, else one through the WebGPU provider, else the processor.
    /// Adapters that the processor emulates are not taken. `options` are those of the processor; the others take its choice of kernels.
    /// Also returns why better kinds were not taken, the best first.
    ///
    /// # Errors
    /// As [`cpu`](Self::cpu).
    pub fn auto(
        ort: &Ort,
        options: CpuOptions,
        libraries: &LibrarySearch,
    ) -> Result<(Device, Vec<(DeviceKind, Error)>)> {
        options.check()?;
        let mut refusals = Vec::new();
        #[cfg(windows)]
        match Self::on_best_adapter(ort, options.deterministic) {
            Ok(device) => return Ok((device.with_library_search(libraries.clone()), refusals)),
            Err(error) => refusals.push((DeviceKind::Direct3d12, error)),
        }
        let webgpu =
            super::WebGpuOptions { deterministic: options.deterministic, adapter: None, libraries: libraries.clone() };
        match Self::webgpu(ort, &webgpu) {
            Ok(device) => return Ok((device, refusals)),
            Err(error) => refusals.push((DeviceKind::WebGpu, error)),
        }
        Ok((Self::cpu(ort, options)?.with_library_search(libraries.clone()), refusals))
    }

    /// The first Direct3D 12 adapter that the processor does not emulate.
    #[cfg(windows)]
    fn on_best_adapter(ort: &Ort, deterministic: bool) -> Result<Device> {
        let adapters = crate::gpu::adapters()?;
        let adapter = adapters.iter().find(|adapter| !adapter.software).ok_or_else(|| {
            Error::new(crate::ErrorKind::Unsupported, "this machine has no adapter for Direct3D 12 but software")
                .remedy("Install the driver of your graphics adapter")
        })?;
        let gpu = crate::gpu::Gpu::on_adapter(Some(adapter.luid))?;
        Self::directml(ort, &gpu, super::DirectMlOptions { deterministic, ..Default::default() })
    }

    pub(super) fn of(backend: Arc<dyn Backend>) -> Self {
        Self { backend, libraries: Arc::default() }
    }

    /// The same device with another [`library_search`](Self::library_search), which is the default at first.
    pub fn with_library_search(self, search: LibrarySearch) -> Self {
        Self { libraries: Arc::new(search), ..self }
    }

    /// Where users of this device look for third-party libraries, such as AMD's.
    pub fn library_search(&self) -> &LibrarySearch {
        &self.libraries
    }

    /// A description for people and manifests, e.g. `ONNX Runtime 1.24.4 CPU, 8 threads, deterministic`.
    pub fn describe(&self) -> String {
        self.backend.describe()
    }

    /// The precision that this device computes in by default.
    pub fn precision(&self) -> Precision {
        self.backend.precision()
    }

    /// Its Direct3D 12 device; `None` for other devices.
    #[cfg(windows)]
    pub fn gpu(&self) -> Option<&crate::gpu::Gpu> {
        self.backend.directml().map(|backend| &backend.gpu)
    }

    /// Its DirectML options; `None` for a device without DirectML.
    #[cfg(windows)]
    pub fn directml_options(&self) -> Option<super::DirectMlOptions> {
        self.backend.directml().map(|backend| backend.options.lock().clone())
    }

    /// Sets its DirectML options, for worlds that are loaded and rollouts that are made from now on.
    ///
    /// # Errors
    /// `Unsupported` on a device that is not a Direct3D 12 device.
    #[cfg(windows)]
    pub fn set_directml_options(&self, options: super::DirectMlOptions) -> Result<()> {
        let backend = self.backend.directml().ok_or_else(|| {
            let cause = format!("{} does not use DirectML", self.describe());
            Error::new(crate::ErrorKind::Unsupported, cause).remedy("Set them on a Direct3D 12 device")
        })?;
        *backend.options.lock() = options;
        Ok(())
    }

    /// Whether its worlds are in a graphics device's memory.
    pub fn is_gpu(&self) -> bool {
        self.kind() != DeviceKind::Cpu
    }

    /// What it is.
    pub fn kind(&self) -> DeviceKind {
        self.backend.kind()
    }

    /// A graphics device's memory budget and use, as the system reports them now; `None` for a processor, and where the system
    /// reports none.
    pub fn memory(&self) -> Option<DeviceMemory> {
        self.backend.memory()
    }

    /// Notification of changes of its memory budget; `None` for a processor, and where the system reports none.
    pub(crate) fn memory_changes(&self) -> Option<MemoryChanges> {
        #[cfg(windows)]
        return self.gpu().and_then(crate::gpu::BudgetChanges::of).map(MemoryChanges);
        #[cfg(not(windows))]
        None
    }

    /// Bytes of a graphics device's memory budget that are still free, as the system reports now; `None` for a processor, which
    /// uses the system's memory, and where the system reports none.
    pub fn available_memory(&self) -> Option<u64> {
        self.memory().map(|memory| memory.granted.saturating_sub(memory.used))
    }

    /// Threads that share one pass, the caller's own included.
    pub fn threads(&self) -> usize {
        self.backend.threads()
    }

    /// Makes the session of a graph. It uses the weights of `shared`, a graph of this device, if both have the same ones and the device can share
    /// them.
    pub(crate) fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
        shared: Option<&Arc<Graph>>,
    ) -> Result<Arc<Graph>> {
        self.backend.graph(what, model, dimensions, inputs, outputs, shared)
    }

    pub(crate) fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>> {
        self.backend.context(limits)
    }
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Device({})", self.describe())
    }
}
