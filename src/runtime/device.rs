//! Where worlds run.

use std::sync::Arc;

use super::cpu::{CpuBackend, CpuOptions};
use super::graph::TensorSpec;
use super::{ExecutionContext, Graph, Ort};
use crate::bundle::{ModelSource, Precision};
use crate::{LibrarySearch, Result};

/// What a device must be able to do.
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
    ) -> Result<Arc<Graph>>;

    fn context(&self) -> Result<Box<dyn ExecutionContext>>;

    /// The Direct3D 12 device it is, where it is one.
    #[cfg(windows)]
    fn gpu(&self) -> Option<&crate::gpu::Gpu> {
        None
    }

    /// How DirectML is used, where it is.
    #[cfg(windows)]
    fn directml_options(&self) -> Option<&parking_lot::Mutex<super::DirectMlOptions>> {
        None
    }
}

/// Memory of a graphics device, in bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceMemory {
    /// What the system grants to this process: beyond it, it makes room by moving things out, and everything is slow.
    pub granted: u64,
    /// What the process uses already, an engine's textures and worlds alike.
    pub used: u64,
}

/// Notices that the system grants another amount of a graphics device's memory.
#[derive(Debug)]
#[cfg(windows)]
pub(crate) struct MemoryChanges(crate::gpu::BudgetChanges);

/// There is none on other systems.
#[derive(Debug)]
#[cfg(not(windows))]
pub(crate) enum MemoryChanges {}

impl MemoryChanges {
    /// Whether it did since this was asked last. Does not wait.
    pub(crate) fn come(&self) -> bool {
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
    /// The host's processor, by ONNX Runtime's CPU provider.
    ///
    /// # Errors
    /// `InvalidArgument` for a thread count of 0 or above 1024.
    pub fn cpu(ort: &Ort, options: CpuOptions) -> Result<Device> {
        Ok(Self::of(Arc::new(CpuBackend::new(ort, options)?)))
    }

    /// A Direct3D 12 device, by ONNX Runtime's DirectML provider: a world's passes run on its queue for anchors.
    ///
    /// # Errors
    /// `RuntimeMissing` when the DirectML.dll that belongs to ONNX Runtime is not beside it; `Unsupported` when one
    /// older than 1.15 is in the process already, or the adapter cannot do DirectML's feature level 5.0; `DeviceRemoved`.
    #[cfg(windows)]
    pub fn directml(ort: &Ort, gpu: &crate::gpu::Gpu, options: super::DirectMlOptions) -> Result<Device> {
        Ok(Self::of(Arc::new(super::directml::DirectMlBackend::new(ort, gpu, options)?)))
    }

    fn of(backend: Arc<dyn Backend>) -> Self {
        Self { backend, libraries: Arc::default() }
    }

    /// The same device with another answer to [`library_search`](Self::library_search), which is the default at first.
    pub fn with_library_search(self, search: LibrarySearch) -> Self {
        Self { libraries: Arc::new(search), ..self }
    }

    /// Where whoever uses this device looks for libraries of others, such as AMD's.
    pub fn library_search(&self) -> &LibrarySearch {
        &self.libraries
    }

    /// What it is, for people and manifests, e.g. `ONNX Runtime 1.24.4 CPU, 8 threads, deterministic`.
    pub fn describe(&self) -> String {
        self.backend.describe()
    }

    /// The precision this device computes in unless told otherwise.
    pub fn precision(&self) -> Precision {
        self.backend.precision()
    }

    /// The Direct3D 12 device it is, where it is one.
    #[cfg(windows)]
    pub fn gpu(&self) -> Option<&crate::gpu::Gpu> {
        self.backend.gpu()
    }

    /// How it uses DirectML, where it does.
    #[cfg(windows)]
    pub fn directml_options(&self) -> Option<super::DirectMlOptions> {
        self.backend.directml_options().map(|options| options.lock().clone())
    }

    /// Has it use DirectML otherwise: for worlds that are loaded and rollouts that are made from now on.
    ///
    /// # Errors
    /// `Unsupported` on a device that is no Direct3D 12 one.
    #[cfg(windows)]
    pub fn set_directml_options(&self, options: super::DirectMlOptions) -> Result<()> {
        let ours = self.backend.directml_options().ok_or_else(|| {
            let cause = format!("{} does not use DirectML", self.describe());
            crate::Error::new(crate::ErrorKind::Unsupported, cause).remedy("Set them on a Direct3D 12 device")
        })?;
        *ours.lock() = options;
        Ok(())
    }

    /// Whether it is a graphics device: a Direct3D 12 one.
    pub fn is_gpu(&self) -> bool {
        #[cfg(windows)]
        return self.gpu().is_some();
        #[cfg(not(windows))]
        false
    }

    /// What may be used of the memory of a graphics device, as the system says at this moment; none for a processor, and where the system does
    /// not say.
    pub fn memory(&self) -> Option<DeviceMemory> {
        #[cfg(windows)]
        return self
            .gpu()
            .and_then(|gpu| gpu.budget().ok().flatten())
            .map(|budget| DeviceMemory { granted: budget.granted, used: budget.used });
        #[cfg(not(windows))]
        None
    }

    /// Notices that the system grants another amount of its memory; none for a processor, and where the system does not say.
    pub(crate) fn memory_changes(&self) -> Option<MemoryChanges> {
        #[cfg(windows)]
        return self.gpu().and_then(crate::gpu::BudgetChanges::of).map(MemoryChanges);
        #[cfg(not(windows))]
        None
    }

    /// Bytes that may still be used of the memory of a graphics device, as the system says at this moment; none for a processor, whose
    /// memory is the system's, and where nobody says.
    pub fn room(&self) -> Option<u64> {
        self.memory().map(|memory| memory.granted.saturating_sub(memory.used))
    }

    /// Threads that share one pass, the caller's own among them.
    pub fn threads(&self) -> usize {
        self.backend.threads()
    }

    pub(crate) fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
    ) -> Result<Arc<Graph>> {
        self.backend.graph(what, model, dimensions, inputs, outputs)
    }

    pub(crate) fn context(&self) -> Result<Box<dyn ExecutionContext>> {
        self.backend.context()
    }
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Device({})", self.describe())
    }
}
