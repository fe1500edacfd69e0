//! Whether numbers in buffers are finite: a look at them that is written down once.

use windows::Win32::Graphics::Direct3D12::*;

use super::context::{DirectMlContext, groups_for};
use super::reusable_list::ReusableList;
use crate::Result;
use crate::bundle::Precision;
use crate::gpu::compute::transition;
use crate::gpu::{FencePoint, Shared};
use crate::runtime::execution_context::{BufferId, MAX_GROUPS};
use crate::runtime::finite::exponents;

/// A list that has shaders look through groups of buffers, and then says of each group whether it or one before it holds a number
/// that is not finite.
pub(super) struct FiniteCheck {
    list: ReusableList,
    groups: usize,
}

/// Bytes of a verdict.
const WORD: usize = size_of::<u32>();

impl FiniteCheck {
    /// Of buffers of a context, with which it ends.
    pub(super) fn new(context: &DirectMlContext, groups: &[&[BufferId]], precision: Precision) -> Result<Self> {
        assert!(groups.len() <= MAX_GROUPS, "groups that can be told apart");
        let [low, high] = exponents(precision);
        let (verdict, answer) = (&context.verdict, context.answer.resource());
        let becomes = |list: &ID3D12GraphicsCommandList, before, after| {
            // SAFETY: an open list and a live buffer in the state before.
            unsafe { list.ResourceBarrier(&[transition(verdict, before, after)]) };
        };
        let list = ReusableList::record(&context.gpu, |list| {
            // SAFETY: an open list and buffers that the context holds, with room for a word.
            unsafe { list.CopyBufferRegion(verdict, 0, context.zeroes.resource(), 0, WORD as u64) };
            let mut before = D3D12_RESOURCE_STATE_COPY_DEST;
            for (i, group) in groups.iter().enumerate() {
                becomes(list, before, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
                for buffer in group.iter().map(|buffer| &context.buffers[buffer.0]) {
                    let words = u32::try_from(buffer.bytes.div_ceil(WORD)).unwrap_or(u32::MAX);
                    let (count, threads) = groups_for(words);
                    let constants = [words, low, high, threads];
                    // The first use of a buffer in a list brings it from COMMON into the state of what is read.
                    context.kernels.finite.record(list, &constants, &[&buffer.resource], &[verdict], count);
                }
                becomes(list, D3D12_RESOURCE_STATE_UNORDERED_ACCESS, D3D12_RESOURCE_STATE_COPY_SOURCE);
                before = D3D12_RESOURCE_STATE_COPY_SOURCE;
                // SAFETY: as above; the answer has room for a word of each group.
                unsafe { list.CopyBufferRegion(answer, (i * WORD) as u64, verdict, 0, WORD as u64) };
            }
        })?;
        Ok(Self { list, groups: groups.len() })
    }

    /// Waits until it may be given to a queue.
    pub(super) fn ready(&self) -> Result<()> {
        self.list.ready()
    }

    /// The list as a queue takes it.
    pub(super) fn list(&self) -> &ID3D12CommandList {
        self.list.list()
    }

    /// It was given to a queue, and will have run at `fence_point`.
    pub(super) fn runs_until(&mut self, fence_point: &FencePoint) {
        self.list.runs_until(fence_point);
    }

    /// The first group that is not as it should be, by the answer to the last look of the context, once that has run.
    pub(super) fn read(&self, answer: &Shared) -> Option<usize> {
        let mut words = [0; MAX_GROUPS * WORD];
        answer.read(&mut words);
        let (words, _) = words.as_chunks::<WORD>();
        words[..self.groups].iter().position(|word| u32::from_ne_bytes(*word) != 0)
    }
}
