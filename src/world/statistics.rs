//! Counts, bytes and wall times of a rollout's work.

use std::time::{Duration, Instant};

use crate::runtime::Bytes;

/// Number of runs of one stage of the work, and their total time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StageTotals {
    /// Runs: passes of a graph, commits, or pictures resized.
    pub count: u64,
    /// Wall time. On an asynchronous device this is the time to submit and, if a result was requested, to wait.
    pub time: Duration,
}

impl StageTotals {
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
    pub encode: StageTotals,
    /// Denoise passes.
    pub denoise: StageTotals,
    /// Cache passes: passes at sigma 0 that make K and V for the ring.
    pub cache: StageTotals,
    /// Copies of new K and V into the ring.
    pub commit: StageTotals,
    /// Decoder runs, including those that only prime the decoder.
    pub decode: StageTotals,
    /// Pictures read and resized.
    pub resize: StageTotals,
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
    /// Latents, generated and appended.
    pub latents: u64,
    /// Wall times by stage.
    pub stages: Stages,
    /// Bytes moved outside of graphs.
    pub bytes: Bytes,
    /// The part of `bytes.copied` that was copied into the rings: the slabs of committed latents.
    pub ring_bytes: u64,
}

/// Statistics of one latent step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StepInfo {
    /// The number of the new latent; the first is 0.
    pub latent: u64,
    /// Whether this step committed K and V: those of its latent, or with joined passes those of the latent before. A global layer stores only every
    /// dilation-th commit.
    pub committed: bool,
    /// Wall times of this step.
    pub stages: Stages,
    /// Bytes that this step moved outside of graphs.
    pub bytes: Bytes,
    /// The part of `bytes.copied` that was copied into the rings.
    pub ring_bytes: u64,
}
