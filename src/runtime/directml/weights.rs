//! A graph's large weights in memory of our own: below the engine's in rank, and evicted while every rollout rests.

use std::ffi::{CStr, CString};

use parking_lot::Mutex;

use super::context::Buffer;
use super::recorder::Recorder;
use crate::bundle::{Precision, Weight};
use crate::gpu::{Gpu, ResidencySet};
use crate::runtime::graph::TensorSpec;
use crate::{Error, ErrorKind, Result};

/// Bytes that are under way to the device at a time, when a graph is made.
const UNDER_WAY: usize = 64 << 20;

/// Weights that a session takes as inputs. Each context that may run the session holds them while it does not rest.
pub(crate) struct Weights {
    inputs: Vec<(CString, TensorSpec, Buffer)>,
    residency: Mutex<Residency>,
}

struct Residency {
    set: ResidencySet,
    /// Lanes that hold it. At 0 it may be resident or not.
    holders: usize,
}

impl Weights {
    /// Has them copied to the device, and waits for that.
    pub(super) fn new(gpu: &Gpu, weights: &[Weight<'_>]) -> Result<Self> {
        let mut set = ResidencySet::new();
        let mut recorder = Recorder::new(gpu)?;
        let mut inputs = Vec::with_capacity(weights.len());
        let mut under_way = 0;
        for weight in weights {
            let name = CString::new(weight.name)
                .map_err(|_| Error::new(ErrorKind::InvalidBundle, "a weight's name holds a NUL"))?;
            let memory = Buffer::new(gpu, weight.bytes.len())?;
            set.add(gpu, &memory.resource)?;
            for (i, piece) in weight.bytes.chunks(UNDER_WAY).enumerate() {
                recorder.upload(&memory.resource, i * UNDER_WAY, piece)?;
                under_way += piece.len();
                if under_way >= UNDER_WAY {
                    recorder.now()?.wait()?;
                    under_way = 0;
                }
            }
            inputs.push((name, TensorSpec::new(weight.name, Precision::F16, &weight.shape), memory));
        }
        recorder.now()?.wait()?;
        Ok(Self { inputs, residency: Mutex::new(Residency { set, holders: 0 }) })
    }

    /// The session's inputs behind the graph's own.
    pub(super) fn inputs(&self) -> impl Iterator<Item = (&CStr, &TensorSpec, &Buffer)> {
        self.inputs.iter().map(|(name, spec, memory)| (name.as_c_str(), spec, memory))
    }

    /// Has them resident for what the queue for anchors is given from now on, until they are let go as often.
    ///
    /// # Errors
    /// As [`ResidencySet::make_resident`]; they are not held then.
    pub(super) fn hold(&self, gpu: &Gpu) -> Result<()> {
        let mut residency = self.residency.lock();
        residency.set.make_resident(gpu, gpu.anchors())?;
        residency.holders += 1;
        Ok(())
    }

    /// Lets them go. Nothing that this holder has given to the queue uses them any more.
    pub(super) fn let_go(&self, gpu: &Gpu) {
        let mut residency = self.residency.lock();
        residency.holders -= 1;
        if residency.holders == 0
            && let Err(e) = residency.set.evict(gpu)
        {
            // They stay where they are, and all goes on.
            log::warn!("weights are not evicted: {e}");
        }
    }
}
