//! Measures how long a context's runs and copies take on the device, with timestamp queries.

use std::collections::VecDeque;

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use crate::Result;
use crate::gpu::{FencePoint, Gpu, GpuTimeStatistics, TimestampPairs};

/// Maximum number of intervals in flight; two latent steps of 20 passes in 24 slices have fewer. Further ones are not timed.
const PAIRS: usize = 1024;

/// Handle of a kind of work of one context. The times of all intervals of a kind are added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WorkKind(usize);

/// An interval that has a start timestamp.
pub(super) struct TimedInterval {
    pair: usize,
    kind: WorkKind,
}

/// Timestamp pairs around intervals of work, and the times measured so far.
pub(super) struct IntervalTimes {
    timestamps: Option<TimestampPairs>,
    /// Timestamp pairs that are not in use.
    free: Vec<usize>,
    /// Intervals with both timestamps recorded, and the fence point of their list; `None` while the list is open.
    ended: VecDeque<(TimedInterval, Option<FencePoint>)>,
    /// Measured times, indexed by kind.
    measured: Vec<GpuTimeStatistics>,
}

impl IntervalTimes {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let timestamps = TimestampPairs::new(gpu, gpu.anchors(), PAIRS)?;
        Ok(Self { timestamps, free: (0..PAIRS).collect(), ended: VecDeque::with_capacity(PAIRS), measured: Vec::new() })
    }

    /// A new kind of work.
    pub(super) fn kind(&mut self) -> WorkKind {
        self.measured.push(GpuTimeStatistics::default());
        WorkKind(self.measured.len() - 1)
    }

    /// Records the start timestamp in an open list; `None` if the queue has no timestamps, or all pairs are in use.
    pub(super) fn start(&mut self, list: &ID3D12GraphicsCommandList, kind: WorkKind) -> Option<TimedInterval> {
        self.collect();
        let timestamps = self.timestamps.as_ref()?;
        let pair = self.free.pop()?;
        timestamps.start(list, pair);
        Some(TimedInterval { pair, kind })
    }

    /// Records the end timestamp in an open list of the same queue.
    pub(super) fn end(&mut self, list: &ID3D12GraphicsCommandList, interval: TimedInterval) {
        if let Some(timestamps) = &self.timestamps {
            timestamps.end(list, interval.pair);
            self.ended.push_back((interval, None));
        }
    }

    /// Frees the pair of an interval that gets no end.
    pub(super) fn cancel(&mut self, interval: TimedInterval) {
        self.free.push(interval.pair);
    }

    /// The commands of the open list are lost: frees the pairs of all intervals that end in it.
    pub(super) fn discard_open(&mut self) {
        while let Some((interval, _)) = self.ended.pop_back_if(|(_, until)| until.is_none()) {
            self.free.push(interval.pair);
        }
    }

    /// The open list was submitted, and has run when `fence_point` is reached.
    pub(super) fn submitted(&mut self, fence_point: &FencePoint) {
        for (_, until) in self.ended.iter_mut().rev().take_while(|(_, until)| until.is_none()) {
            *until = Some(fence_point.clone());
        }
    }

    /// Time of all completed intervals of a kind.
    pub(super) fn gpu_time(&mut self, kind: WorkKind) -> GpuTimeStatistics {
        self.collect();
        self.measured[kind.0]
    }

    fn collect(&mut self) {
        while let Some((_, Some(fence_point))) = self.ended.front()
            && fence_point.reached()
            && let Some((interval, _)) = self.ended.pop_front()
        {
            if let Some((_, Some(took))) = self.timestamps.as_ref().map(|timestamps| timestamps.read(interval.pair)) {
                self.measured[interval.kind.0].add(took);
            }
            self.free.push(interval.pair);
        }
    }
}
