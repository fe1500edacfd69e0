//! Where worlds run.

use std::sync::Arc;

use super::cpu::{CpuBackend, CpuOptions};
use super::graph::TensorSpec;
use super::{Graph, Lane, Ort};
use crate::Result;
use crate::bundle::{ModelSource, Precision};

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

    fn lane(&self) -> Result<Box<dyn Lane>>;
}

/// A device that runs worlds. Cheap to clone; every clone is the same device.
///
/// Threads: may be used from any thread at any time.
#[derive(Clone)]
pub struct Device(Arc<dyn Backend>);

impl Device {
    /// The host's processor, by ONNX Runtime's CPU provider.
    ///
    /// # Errors
    /// `InvalidArgument` for a thread count of 0 or above 1024.
    pub fn cpu(ort: &Ort, options: CpuOptions) -> Result<Device> {
        Ok(Device(Arc::new(CpuBackend::new(ort, options)?)))
    }

    /// What it is, for people and manifests, e.g. `ONNX Runtime 1.24.4 CPU, 8 threads, deterministic`.
    pub fn describe(&self) -> String {
        self.0.describe()
    }

    /// The precision this device computes in unless told otherwise.
    pub fn precision(&self) -> Precision {
        self.0.precision()
    }

    /// Threads that share one pass, the caller's own among them.
    pub fn threads(&self) -> usize {
        self.0.threads()
    }

    pub(crate) fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
    ) -> Result<Arc<Graph>> {
        self.0.graph(what, model, dimensions, inputs, outputs)
    }

    pub(crate) fn lane(&self) -> Result<Box<dyn Lane>> {
        self.0.lane()
    }
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Device({})", self.describe())
    }
}
