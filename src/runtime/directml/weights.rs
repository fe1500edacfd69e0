//! A graph's large weights in our own device memory: below the engine's in residency priority, and evicted while all rollouts rest.

use std::ffi::{CStr, CString};

use crate::locks::Mutex;

use super::context::Buffer;
use super::recorder::Recorder;
use crate::bundle::Weight;
use crate::gpu::{Gpu, ResidencySet};
use crate::runtime::graph::{ElementType, TensorSpec};
use crate::{Error, ErrorKind, Result};

/// Maximum bytes of weights in flight to the device while a graph is loaded.
const MAX_IN_FLIGHT: usize = 64 << 20;

/// Weights that a session takes as inputs. Each context that may run the session holds them while it is not resting.
pub(crate) struct Weights {
    inputs: Vec<(CString, TensorSpec, Buffer)>,
    /// Where each was read from: address and length of its bytes in the bundle, which is not freed while a world is loaded from it.
    sources: Vec<(usize, usize)>,
    residency: Mutex<Residency>,
}

struct Residency {
    set: ResidencySet,
    /// Contexts that hold the weights. At 0 the weights may be resident or evicted.
    holders: usize,
}

/// The session's input for a weight.
pub(super) fn spec(weight: &Weight<'_>) -> TensorSpec {
    let element = if weight.is_integer { ElementType::U8 } else { ElementType::F16 };
    TensorSpec::new(weight.name, element, &weight.shape)
}

fn source(weight: &Weight<'_>) -> (usize, usize) {
    (weight.bytes.as_ptr().addr(), weight.bytes.len())
}

impl Weights {
    /// Copies the weights to the device, and waits for that.
    pub(super) fn new(gpu: &Gpu, weights: &[Weight<'_>]) -> Result<Self> {
        let mut set = ResidencySet::new();
        let mut recorder = Recorder::new(gpu)?;
        let mut inputs = Vec::with_capacity(weights.len());
        let mut in_flight = 0;
        for weight in weights {
            let name = CString::new(weight.name)
                .map_err(|_| Error::new(ErrorKind::InvalidBundle, "a weight's name holds a NUL"))?;
            let memory = Buffer::new(gpu, weight.bytes.len())?;
            set.add(gpu, &memory.resource)?;
            for (i, piece) in weight.bytes.chunks(MAX_IN_FLIGHT).enumerate() {
                recorder.upload(&memory.resource, i * MAX_IN_FLIGHT, piece)?;
                in_flight += piece.len();
                if in_flight >= MAX_IN_FLIGHT {
                    recorder.submit_and_signal()?.wait()?;
                    in_flight = 0;
                }
            }
            inputs.push((name, spec(weight), memory));
        }
        recorder.submit_and_signal()?.wait()?;
        Ok(Self {
            inputs,
            sources: weights.iter().map(source).collect(),
            residency: Mutex::new(Residency { set, holders: 0 }),
        })
    }

    /// Whether these are `weights`, in the same order, read from the same bytes.
    pub(super) fn are(&self, weights: &[Weight<'_>]) -> bool {
        let is_same = |((name, own, _), weight): (&(CString, TensorSpec, Buffer), &Weight<'_>)| {
            name.to_bytes() == weight.name.as_bytes() && *own == spec(weight)
        };
        weights.iter().map(source).eq(self.sources.iter().copied()) && self.inputs.iter().zip(weights).all(is_same)
    }

    /// The weights as session inputs, which follow the graph's own inputs.
    pub(super) fn inputs(&self) -> impl Iterator<Item = (&CStr, &TensorSpec, &Buffer)> {
        self.inputs.iter().map(|(name, spec, memory)| (name.as_c_str(), spec, memory))
    }

    /// Makes the weights resident for everything submitted to the queue for anchors from now on, until [`release`](Self::release) was
    /// called as often.
    ///
    /// # Errors
    /// As [`ResidencySet::make_resident`]; the weights are not held then.
    pub(super) fn hold(&self, gpu: &Gpu) -> Result<()> {
        let mut residency = self.residency.lock();
        residency.set.make_resident(gpu, gpu.anchors())?;
        residency.holders += 1;
        Ok(())
    }

    /// Releases the weights for one holder, and evicts them with the last. No submitted work of this holder may use them any more.
    pub(super) fn release(&self, gpu: &Gpu) {
        let evicted = {
            let mut residency = self.residency.lock();
            residency.holders -= 1;
            if residency.holders == 0 { residency.set.evict(gpu) } else { Ok(()) }
        };
        // Logged without the lock: the host's callback may use the weights.
        if let Err(e) = evicted {
            // They stay resident, and nothing else changes.
            log::warn!("weights are not evicted: {e}");
        }
    }
}
