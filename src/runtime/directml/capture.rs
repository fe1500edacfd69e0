//! Passes whose commands ONNX Runtime keeps and submits again: graph capture.
//!
//! Without it the provider writes the addresses of a binding's buffers anew whenever another binding has run in between, and waits
//! for the device before it does. A captured pass costs the processor next to nothing. It is used where it gives the same bits: the
//! first runs of each binding are done both ways, and the device compares what they wrote.

use std::sync::atomic::{AtomicUsize, Ordering};

use ort::AsPointer;
use ort::session::{NoSelectedOutputs, RunOptions};
use parking_lot::Mutex;

use crate::Result;
use crate::runtime::failure::make;

/// ONNX Runtime's option of a session that allows capture.
pub(super) const ALLOWED: (&str, &str) = ("ep.dml.enable_graph_capture", "1");
/// Its option of a run that names the capture, and the name that means none.
const NAME: &str = "gpu_graph_id";
const NONE: i32 = -1;

/// Runs of a binding that are done both ways before captured ones are trusted.
const CHECKS: u32 = 2;

/// How many passes are captured, and why others are not.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Captured {
    /// Passes with buffers of their own that run by capture.
    pub used: usize,
    /// Those that are run both ways to see whether their bits are the same, or were not run yet.
    pub unproven: usize,
    /// Those that run as ever.
    pub unused: usize,
    /// Why, of one of them.
    pub reason: Option<String>,
}

/// What the sessions of a device and one session in particular allow.
pub(crate) struct Captures {
    /// Captures of this session that may still be made; ONNX Runtime lets go of none before the session is gone.
    left: AtomicUsize,
    next: AtomicUsize,
    refused: Option<String>,
    /// ONNX Runtime lets captured runs of two threads into the provider at once, which is not made for it.
    pub(super) one: Mutex<()>,
}

impl Captures {
    /// Of a session that allows so many.
    pub(super) fn up_to(count: usize) -> Self {
        Self { left: AtomicUsize::new(count), next: AtomicUsize::new(1), refused: None, one: Mutex::new(()) }
    }

    /// Of a session that allows none.
    pub(in crate::runtime) fn refused(why: impl Into<String>) -> Self {
        Self { refused: Some(why.into()), ..Self::up_to(0) }
    }

    /// How the runs of a new binding begin.
    pub(super) fn begin(&self) -> Capture {
        match &self.refused {
            Some(why) => Capture::Never(why.clone()),
            None => Capture::Untried,
        }
    }

    /// A name that no other capture of the session has.
    pub(super) fn take(&self) -> Option<Named> {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).ok()?;
        let name = self.next.fetch_add(1, Ordering::Relaxed);
        Named::new(i32::try_from(name).ok()?).ok()
    }
}

/// Options of a run with its capture's name.
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

    /// For runs that are not to be captured, of a session that allows it.
    pub(super) fn none() -> Result<Self> {
        Self::new(NONE)
    }

    pub(super) fn ptr(&self) -> *const ort::sys::OrtRunOptions {
        self.0.ptr()
    }
}

/// How a binding's runs are done.
pub(super) enum Capture {
    /// As ever, for a reason.
    Never(String),
    /// It has not run yet.
    Untried,
    /// Both ways: the captured one has given the same bits so many times.
    Checked(Named, u32),
    /// By capture.
    Used(Named),
}

impl Capture {
    /// The same after one more comparison.
    pub(super) fn judged(name: Named, times: u32, is_same: bool) -> Self {
        match (is_same, times + 1) {
            (false, _) => Self::Never("a captured pass gave other bits than the same pass run anew".to_owned()),
            (true, CHECKS..) => Self::Used(name),
            (true, times) => Self::Checked(name, times),
        }
    }

    /// Adds itself to what is told of a context.
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
