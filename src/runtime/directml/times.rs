//! How long a context's runs and copies take on the device.

use std::collections::VecDeque;

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;

use crate::Result;
use crate::gpu::{FencePoint, Gpu, Marks, Spent};

/// Pieces of work whose time may be unknown yet, more than two latent steps have: those beyond are not timed.
const PAIRS: usize = 64;

/// Names a kind of work of one context, all whose pieces are summed up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind(usize);

/// A piece of work that has begun.
pub(super) struct Begun {
    pair: usize,
    kind: Kind,
}

/// Marks of the device's clock before and behind pieces of work, and what is known of them.
pub(super) struct Times {
    marks: Option<Marks>,
    /// Pairs of marks that no piece uses.
    free: Vec<usize>,
    /// Pieces that have ended in an open list, or in one that will have run at a moment.
    ended: VecDeque<(Begun, Option<FencePoint>)>,
    /// By kind.
    spent: Vec<Spent>,
}

impl Times {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let marks = Marks::new(gpu, gpu.anchors(), PAIRS)?;
        Ok(Self { marks, free: (0..PAIRS).collect(), ended: VecDeque::with_capacity(PAIRS), spent: Vec::new() })
    }

    /// A new kind of work.
    pub(super) fn kind(&mut self) -> Kind {
        self.spent.push(Spent::default());
        Kind(self.spent.len() - 1)
    }

    /// Marks the start of a piece in an open list; none where the queue has no clock, or too many pieces are under way.
    pub(super) fn start(&mut self, list: &ID3D12GraphicsCommandList, kind: Kind) -> Option<Begun> {
        self.collect();
        let marks = self.marks.as_ref()?;
        let pair = self.free.pop()?;
        marks.start(list, pair);
        Some(Begun { pair, kind })
    }

    /// Marks its end in an open list of the same queue.
    pub(super) fn end(&mut self, list: &ID3D12GraphicsCommandList, begun: Begun) {
        if let Some(marks) = &self.marks {
            marks.end(list, begun.pair);
            self.ended.push_back((begun, None));
        }
    }

    /// Takes the marks of a piece back that will have no end.
    pub(super) fn forget(&mut self, begun: Begun) {
        self.free.push(begun.pair);
    }

    /// What the open list has is lost, and so are the ends of pieces that it marks.
    pub(super) fn lost(&mut self) {
        while let Some((begun, _)) = self.ended.pop_back_if(|(_, until)| until.is_none()) {
            self.free.push(begun.pair);
        }
    }

    /// The open list is on its way, and will have run at `fence_point`.
    pub(super) fn submitted(&mut self, fence_point: &FencePoint) {
        for (_, until) in self.ended.iter_mut().rev().take_while(|(_, until)| until.is_none()) {
            *until = Some(fence_point.clone());
        }
    }

    /// Time of the pieces of a kind that have run.
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
