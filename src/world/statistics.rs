//! Counts and wall times of a rollout's work.

use std::time::{Duration, Instant};

use crate::runtime::Bytes;

/// Number of runs of a stage and their total time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stage {
    /// Runs: passes of a graph, commits, or pictures resized.
    pub count: u64,
    /// Wall time. On an asynchronous device this is the time to submit and, if a result was requested, to wait.
    pub time: Duration,
}

impl Stage {
    /// Adds `count` runs that began at `start` and end now.
    pub(super) fn add(&mut self, count: u64, start: Instant) {
        self.count += count;
        self.time += start.elapsed();
    }
}

/// Wall times by stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stages {
    /// Resizing and encoding of pictures.
    pub encode: Stage,
    /// Denoise passes.
    pub denoise: Stage,
    /// Cache passes: passes at sigma 0 that make K and V for the ring.
    pub cache: Stage,
    /// Copies of new K and V into the ring.
    pub commit: Stage,
    /// Decoder runs, including those that only prime the decoder.
    pub decode: Stage,
    /// Pictures read and resized.
    pub resize: Stage,
}

impl Stages {
    pub(super) fn add(&mut self, other: &Stages) {
        let pairs = [
            (&mut self.encode, other.encode),
            (&mut self.denoise, other.denoise),
            (&mut self.cache, other.cache),
            (&mut self.commit, other.commit),
            (&mut self.decode, other.decode),
            (&mut self.resize, other.resize),
        ];
        for (sum, stage) in pairs {
            sum.count += stage.count;
            sum.time += stage.time;
        }
    }
}

/// Statistics of a rollout since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Latents made, appended ones included.
    pub latents: u64,
    /// Wall times by stage.
    pub stages: Stages,
    /// Bytes moved outside of graphs.
    pub bytes: Bytes,
    /// The part of `bytes.copied` that went into the ring: the slabs of committed latents, and nothing else.
    pub ring_bytes: u64,
}

/// Statistics of one latent step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StepInfo {
    /// The number of the latent that was made; the first is 0.
    pub latent: u64,
    /// Whether K and V of this latent went into the rings. (A global layer takes every dilation-th commit only.)
    pub committed: bool,
    /// Wall times of this step.
    pub stages: Stages,
    /// Bytes moved outside of graphs by this step.
    pub bytes: Bytes,
    /// The part of `bytes.copied` that went into the ring.
    pub ring_bytes: u64,
}
