//! Measures how long a context's runs and copies take on the device, with timestamp queries.

use std::collections::VecDeque;

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use crate::Result;
use crate::gpu::{FencePoint, Gpu, Spent, TimestampPairs};

/// Intervals whose time may be unknown at once, more than two latent steps have. Further ones are not timed.
const PAIRS: usize = 64;

/// Names a kind of work of one context. The times of all intervals of a kind are added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind(usize);

/// An interval that has a start timestamp.
pub(super) struct TimedInterval {
    pair: usize,
    kind: Kind,
}

/// Timestamp pairs around intervals of work, and the times measured so far.
pub(super) struct Times {
    marks: Option<TimestampPairs>,
    /// Timestamp pairs that are not in use.
    free: Vec<usize>,
    /// Intervals with both timestamps recorded, and the fence point of their list; `None` while the list is open.
    ended: VecDeque<(TimedInterval, Option<FencePoint>)>,
    /// Measured times, indexed by kind.
    spent: Vec<Spent>,
}

impl Times {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let marks = TimestampPairs::new(gpu, gpu.anchors(), PAIRS)?;
        Ok(Self { marks, free: (0..PAIRS).collect(), ended: VecDeque::with_capacity(PAIRS), spent: Vec::new() })
    }

    /// A new kind of work.
    pub(super) fn kind(&mut self) -> Kind {
        self.spent.push(Spent::default());
        Kind(self.spent.len() - 1)
    }

    /// Records the start timestamp in an open list; `None` where the queue has no clock, or all pairs are in use.
    pub(super) fn start(&mut self, list: &ID3D12GraphicsCommandList, kind: Kind) -> Option<TimedInterval> {
        self.collect();
        let marks = self.marks.as_ref()?;
        let pair = self.free.pop()?;
        marks.start(list, pair);
        Some(TimedInterval { pair, kind })
    }

    /// Records the end timestamp in an open list of the same queue.
    pub(super) fn end(&mut self, list: &ID3D12GraphicsCommandList, begun: TimedInterval) {
        if let Some(marks) = &self.marks {
            marks.end(list, begun.pair);
            self.ended.push_back((begun, None));
        }
    }

    /// Frees the pair of an interval that gets no end.
    pub(super) fn forget(&mut self, begun: TimedInterval) {
        self.free.push(begun.pair);
    }

    /// The commands of the open list are lost: frees the pairs of all intervals that end in it.
    pub(super) fn lost(&mut self) {
        while let Some((begun, _)) = self.ended.pop_back_if(|(_, until)| until.is_none()) {
            self.free.push(begun.pair);
        }
    }

    /// The open list was submitted, and has run when `fence_point` is reached.
    pub(super) fn submitted(&mut self, fence_point: &FencePoint) {
        for (_, until) in self.ended.iter_mut().rev().take_while(|(_, until)| until.is_none()) {
            *until = Some(fence_point.clone());
        }
    }

    /// Time of all completed intervals of a kind.
    pub(super) fn spent(&mut self, kind: Kind) -> Spent {
        self.collect();
        self.spent[kind.0]
    }

    fn collect(&mut self) {
        while let Some((_, Some(fence_point))) = self.ended.front()
            && fence_point.reached()
            && let Some((begun, _)) = self.ended.pop_front()
        {
            if let Some((_, Some(took))) = self.marks.as_ref().map(|marks| marks.read(begun.pair)) {
                self.spent[begun.kind.0].add(took);
            }
            self.free.push(begun.pair);
        }
    }
}
