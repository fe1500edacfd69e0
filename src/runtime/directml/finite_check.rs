//! Checks on the device whether buffers hold only finite values, by a command list that is recorded once.

use windows::Win32::Graphics::Direct3D12::*;

use super::context::{DirectMlContext, groups_for};
use super::reusable_list::ReusableList;
use crate::Result;
use crate::bundle::Precision;
use crate::gpu::compute::transition;
use crate::gpu::{FencePoint, MappedBuffer};
use crate::runtime::execution_context::{BufferId, MAX_GROUPS};
use crate::runtime::finite::exponents;

/// A command list whose shaders check groups of buffers one after another. The result of a group is set if this group or an earlier
/// one holds a value that is not finite.
pub(super) struct FiniteCheck {
    list: ReusableList,
    groups: usize,
}

/// Size of the result of one group, in bytes.
const RESULT_BYTES: usize = size_of::<u32>();

impl FiniteCheck {
    /// Records a check of buffers of `context`; it must not be used after the context.
    pub(super) fn new(context: &DirectMlContext, groups: &[&[BufferId]], precision: Precision) -> Result<Self> {
        assert!(groups.len() <= MAX_GROUPS, "groups that can be told apart");
        let [low, high] = exponents(precision);
        let (check_result, check_readback) = (&context.check_result, context.check_readback.resource());
        let becomes = |list: &ID3D12GraphicsCommandList, before, after| {
            // SAFETY: an open list and a live buffer in the state before.
            unsafe { list.ResourceBarrier(&[transition(check_result, before, after)]) };
        };
        let list = ReusableList::record(&context.gpu, |list| {
            // SAFETY: an open list and buffers that the context holds, with room for a word.
            unsafe { list.CopyBufferRegion(check_result, 0, context.zeroes.resource(), 0, RESULT_BYTES as u64) };
            let mut before = D3D12_RESOURCE_STATE_COPY_DEST;
            for (i, group) in groups.iter().enumerate() {
                becomes(list, before, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
                for buffer in group.iter().map(|buffer| &context.buffers[buffer.0]) {
                    let words = u32::try_from(buffer.bytes.div_ceil(RESULT_BYTES)).unwrap_or(u32::MAX);
                    let (count, threads) = groups_for(words);
                    let constants = [words, low, high, threads];
                    // The first use of a buffer in a list promotes it from COMMON to a shader-readable state.
                    context.kernels.finite.record(list, &constants, &[&buffer.resource], &[check_result], count);
                }
                becomes(list, D3D12_RESOURCE_STATE_UNORDERED_ACCESS, D3D12_RESOURCE_STATE_COPY_SOURCE);
                before = D3D12_RESOURCE_STATE_COPY_SOURCE;
                // SAFETY: as above; the readback buffer has a word for each group.
                unsafe {
                    list.CopyBufferRegion(
                        check_readback,
                        (i * RESULT_BYTES) as u64,
                        check_result,
                        0,
                        RESULT_BYTES as u64,
                    )
                };
            }
        })?;
        Ok(Self { list, groups: groups.len() })
    }

    /// Waits until the list may be submitted again.
    pub(super) fn ready(&self) -> Result<()> {
        self.list.ready()
    }

    /// The list, in the type that a queue takes.
    pub(super) fn list(&self) -> &ID3D12CommandList {
        self.list.list()
    }

    /// Records that the list was submitted and has run when `fence_point` is reached.
    pub(super) fn runs_until(&mut self, fence_point: &FencePoint) {
        self.list.runs_until(fence_point);
    }

    /// The first group that holds a value that is not finite. `check_readback` is the readback buffer after this check has run.
    pub(super) fn read(&self, check_readback: &MappedBuffer) -> Option<usize> {
        let mut words = [0; MAX_GROUPS * RESULT_BYTES];
        check_readback.read(&mut words);
        let (words, _) = words.as_chunks::<RESULT_BYTES>();
        words[..self.groups].iter().position(|word| u32::from_ne_bytes(*word) != 0)
    }
}
