//! Data that the DirectML backend keeps with a graph.

use std::ffi::{CStr, CString};
use std::sync::Arc;

use super::capture::CaptureQuota;
use super::weights::Weights;
use crate::quiet_mutex::QuietMutex;
use crate::runtime::Graph;

/// Profiler name, capture quota and weights of a graph. The general [`Graph`](crate::runtime::Graph) only stores it.
pub(super) struct DirectMlGraph {
    /// Name of its runs in GPU profilers.
    title: CString,
    captures: CaptureQuota,
    weights: Arc<Weights>,
    run_lock: QuietMutex<()>,
}

impl DirectMlGraph {
    /// Data of the graph called `what`. Its session allows `captures`, and takes `weights` as inputs after the graph's own inputs.
    pub(super) fn new(what: &str, captures: CaptureQuota, weights: Arc<Weights>) -> Self {
        Self {
            title: CString::new(format!("Cairn: {what}")).unwrap_or_default(),
            captures,
            weights,
            run_lock: QuietMutex::new(()),
        }
    }

    /// The data of a graph of this backend.
    pub(super) fn of(graph: &Graph) -> &Self {
        graph.data()
    }

    /// Name of its runs in GPU profilers.
    pub(super) fn title(&self) -> &CStr {
        &self.title
    }

    /// The captures that the session allows.
    pub(super) fn captures(&self) -> &CaptureQuota {
        &self.captures
    }

    /// Held during each run: the provider keeps the lists and buffers of a session without locks, and ONNX Runtime takes none for it. Runs of
    /// different sessions may overlap.
    pub(super) fn run_lock(&self) -> &QuietMutex<()> {
        &self.run_lock
    }

    /// The weights that are bound as inputs.
    pub(super) fn weights(&self) -> &Arc<Weights> {
        &self.weights
    }
}
