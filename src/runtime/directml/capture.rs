//! Graph capture: ONNX Runtime keeps the commands of a pass and submits them again.
//!
//! Without capture, the provider rewrites the addresses of a binding's buffers whenever another binding ran in between, and waits
//! for the device before it does so. A captured pass costs the processor next to nothing. It is used only where it gives the same
//! bits: the first runs of each binding are done with and without capture, and the device compares their outputs.

use std::sync::atomic::{AtomicUsize, Ordering};

use ort::AsPointer;
use ort::session::{NoSelectedOutputs, RunOptions};
use parking_lot::Mutex;

use crate::Result;
use crate::runtime::failure::make;

/// ONNX Runtime's session option that allows capture.
pub(super) const ALLOWED: (&str, &str) = ("ep.dml.enable_graph_capture", "1");
/// Its run option that names the capture, and the value that means no capture.
const NAME: &str = "gpu_graph_id";
const NONE: i32 = -1;

/// Comparisons of a binding's captured and normal runs that must agree before only captured ones are used.
const CHECKS: u32 = 2;

/// How many passes are captured, and why others are not. A pass here is a graph with one set of bound buffers.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Captured {
    /// Passes that run by capture.
    pub used: usize,
    /// Passes that have not run yet, or whose captured runs are still compared with normal ones.
    pub unproven: usize,
    /// Passes that run without capture.
    pub unused: usize,
    /// Why one of the `unused` passes is not captured.
    pub reason: Option<String>,
}

/// How many captures a session still allows, or why it allows none.
pub(crate) struct Captures {
    /// Captures of this session that may still be made. ONNX Runtime frees captures only with the session.
    left: AtomicUsize,
    next: AtomicUsize,
    refused: Option<String>,
    /// Held during each run: ONNX Runtime lets captured runs of two threads into the provider at once, and the provider is not made
    /// for that.
    pub(super) one: Mutex<()>,
}

impl Captures {
    /// For a session that allows `count` captures.
    pub(super) fn up_to(count: usize) -> Self {
        Self { left: AtomicUsize::new(count), next: AtomicUsize::new(1), refused: None, one: Mutex::new(()) }
    }

    /// For a session that allows no capture, with the reason.
    pub(in crate::runtime) fn refused(why: impl Into<String>) -> Self {
        Self { refused: Some(why.into()), ..Self::up_to(0) }
    }

    /// The capture state of a new binding.
    pub(super) fn begin(&self) -> Capture {
        match &self.refused {
            Some(why) => Capture::Never(why.clone()),
            None => Capture::Untried,
        }
    }

    /// A new capture name, unique in the session; `None` when no more captures are allowed.
    pub(super) fn take(&self) -> Option<Named> {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).ok()?;
        let name = self.next.fetch_add(1, Ordering::Relaxed);
        Named::new(i32::try_from(name).ok()?).ok()
    }
}

/// Run options that hold a capture's name.
pub(super) struct Named(RunOptions<NoSelectedOutputs>);

impl Named {
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
pub(super) enum Capture {
    /// Without capture, for this reason.
    Never(String),
    /// Not run yet.
    Untried,
    /// With and without capture; the captured runs have matched this many times so far.
    Checked(Named, u32),
    /// By capture only.
    Used(Named),
}

impl Capture {
    /// The state after one more comparison.
    pub(super) fn judged(name: Named, times: u32, is_same: bool) -> Self {
        match (is_same, times + 1) {
            (false, _) => Self::Never("a captured pass gave other bits than the same pass run anew".to_owned()),
            (true, CHECKS..) => Self::Used(name),
            (true, times) => Self::Checked(name, times),
        }
    }

    /// Counts this binding in a context's statistics.
    pub(super) fn tell(&self, told: &mut Captured) {
        match self {
            Self::Used(_) => told.used += 1,
            Self::Untried | Self::Checked(..) => told.unproven += 1,
            Self::Never(why) => {
                told.unused += 1;
                told.reason = Some(why.clone());
            }
        }
    }
}
