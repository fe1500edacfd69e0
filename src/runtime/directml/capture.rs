//! Graph capture: ONNX Runtime records the commands of a pass once and submits them again.
//!
//! Without capture, the provider rewrites the addresses of a binding's buffers whenever another binding ran in between, and waits
//! for the device before it does so. A captured pass costs the processor next to nothing. It is used only where it gives the same
//! bits: the first runs of each binding are repeated with capture, and the device compares the outputs.

use std::sync::atomic::{AtomicUsize, Ordering};

use ort::AsPointer;
use ort::session::{NoSelectedOutputs, RunOptions};

use crate::Result;
use crate::runtime::execution_context::CaptureStatistics;
use crate::runtime::failure::make;

/// ONNX Runtime's session option that allows capture: its key and value.
pub(super) const ALLOWED: (&str, &str) = ("ep.dml.enable_graph_capture", "1");
/// Key of the run option that names the capture.
const NAME: &str = "gpu_graph_id";
/// Its value for a run without capture.
const NONE: i32 = -1;

/// Comparisons of a binding's captured and normal runs that must agree before only captured ones are used.
const CHECKS: u32 = 2;

/// How many captures a session still allows, or why it allows none.
pub(super) struct CaptureQuota {
    /// Captures of this session that may still be made. ONNX Runtime frees captures only with the session.
    left: AtomicUsize,
    /// Name of the next capture.
    next: AtomicUsize,
    /// Why no capture is allowed; `None` if captures are allowed.
    refused: Option<String>,
}

impl CaptureQuota {
    /// For a session that allows `count` captures.
    pub(super) fn up_to(count: usize) -> Self {
        Self { left: AtomicUsize::new(count), next: AtomicUsize::new(1), refused: None }
    }

    /// For a session that allows no capture, with the reason.
    pub(super) fn refused(why: impl Into<String>) -> Self {
        Self { refused: Some(why.into()), ..Self::up_to(0) }
    }

    /// The capture state of a new binding.
    pub(super) fn initial_state(&self) -> CaptureState {
        match &self.refused {
            Some(why) => CaptureState::Never(why.clone()),
            None => CaptureState::Untried,
        }
    }

    /// A new capture name, unique in the session; `None` when no more captures are allowed.
    pub(super) fn next_capture(&self) -> Option<CaptureRunOptions> {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).ok()?;
        let name = self.next.fetch_add(1, Ordering::Relaxed);
        CaptureRunOptions::new(i32::try_from(name).ok()?).ok()
    }
}

/// Run options that hold a capture's name.
pub(super) struct CaptureRunOptions(RunOptions<NoSelectedOutputs>);

impl CaptureRunOptions {
    fn new(name: i32) -> Result<Self> {
        make("name a run", || {
            let mut options = RunOptions::new()?;
            options.set(NAME, name.to_string())?;
            Ok(options)
        })
        .map(Self)
    }

    /// Options for runs without capture, in a session that allows capture.
    pub(super) fn none() -> Result<Self> {
        Self::new(NONE)
    }

    pub(super) fn ptr(&self) -> *const ort::sys::OrtRunOptions {
        self.0.ptr()
    }
}

/// How a binding's graph is run.
pub(super) enum CaptureState {
    /// Without capture, for this reason.
    Never(String),
    /// Not run yet.
    Untried,
    /// With and without capture; the outputs have been equal in this many comparisons so far.
    Checked(CaptureRunOptions, u32),
    /// By capture only.
    Used(CaptureRunOptions),
}

impl CaptureState {
    /// The state after one more comparison.
    pub(super) fn after_comparison(name: CaptureRunOptions, times: u32, is_same: bool) -> Self {
        match (is_same, times + 1) {
            (false, _) => Self::Never("a captured pass gave other bits than the same pass run anew".to_owned()),
            (true, CHECKS..) => Self::Used(name),
            (true, times) => Self::Checked(name, times),
        }
    }

    /// Counts this binding in a context's statistics.
    pub(super) fn count_in(&self, statistics: &mut CaptureStatistics) {
        match self {
            Self::Used(_) => statistics.used += 1,
            Self::Untried | Self::Checked(..) => statistics.unproven += 1,
            Self::Never(why) => {
                statistics.unused += 1;
                statistics.reason = Some(why.clone());
            }
        }
    }
}
