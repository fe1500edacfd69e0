//! GPU timestamp queries in pairs, before and after some work.

use std::time::Duration;

use windows::Win32::Graphics::Direct3D12::*;

use super::{Gpu, Heap, MappedBuffer, Queue, failed_on};
use crate::Result;
use crate::gpu_time::GpuTimeStatistics;
use crate::object_count::count_object;

impl GpuTimeStatistics {
    /// Adds one measurement.
    pub(crate) fn add(&mut self, took: Duration) {
        self.count += 1;
        self.total = self.total.saturating_add(took);
        self.longest = self.longest.max(took);
        self.last = took;
    }

    /// The statistics of both; `later` has the later measurements.
    pub(crate) fn merge(self, later: Self) -> Self {
        Self {
            count: self.count + later.count,
            total: self.total.saturating_add(later.total),
            longest: self.longest.max(later.longest),
            last: if later.count > 0 { later.last } else { self.last },
        }
    }
}

/// Pairs of timestamp queries, one before some work and one after it.
pub(crate) struct TimestampPairs {
    heap: ID3D12QueryHeap,
    timestamps: MappedBuffer,
    /// Ticks per second.
    rate: u64,
}

const TIMESTAMP_BYTES: usize = size_of::<u64>();
const PAIR_BYTES: usize = 2 * TIMESTAMP_BYTES;

impl TimestampPairs {
    /// Creates `pairs` pairs for a queue of the type of `queue`; `None` if it has no timestamps.
    pub(crate) fn new(gpu: &Gpu, queue: &Queue, pairs: usize) -> Result<Option<Self>> {
        // SAFETY: a live queue; the call takes nothing.
        let Ok(rate) = (unsafe { queue.d3d12().GetTimestampFrequency() }) else { return Ok(None) };
        if rate == 0 {
            return Ok(None);
        }
        let count = 2 * pairs as u32;
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: count, NodeMask: 0 };
        let mut heap: Option<ID3D12QueryHeap> = None;
        count_object();
        // SAFETY: a live device; description and output pointer live during the call.
        unsafe { gpu.device().CreateQueryHeap(&wanted, &mut heap) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateQueryHeap", &e))?;
        let Some(heap) = heap else { return Ok(None) };
        Ok(Some(Self { heap, timestamps: MappedBuffer::new(gpu, Heap::Readback, PAIR_BYTES * pairs)?, rate }))
    }

    /// Records the start timestamp of some work in an open list. The heap must live until the list has run.
    pub(crate) fn start(&self, list: &ID3D12GraphicsCommandList, pair: usize) {
        // SAFETY: an open list and a live heap with two queries per pair.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, 2 * pair as u32) };
    }

    /// Records the end timestamp in the same list or a later one of the queue, and resolves both to the readback buffer.
    pub(crate) fn end(&self, list: &ID3D12GraphicsCommandList, pair: usize) {
        let (first, at) = (2 * pair as u32, (PAIR_BYTES * pair) as u64);
        // SAFETY: as above.
        unsafe { list.EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first + 1) };
        // SAFETY: as above; the buffer has room for each pair.
        unsafe {
            list.ResolveQueryData(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, first, 2, self.timestamps.resource(), at);
        };
    }

    /// Reads a pair whose lists have run: the start timestamp, which identifies this use of the pair, and the time between both; no time
    /// if the clock was reset in between.
    pub(crate) fn read(&self, pair: usize) -> (u64, Option<Duration>) {
        let mut timestamps = [0; PAIR_BYTES];
        self.timestamps.read_at(PAIR_BYTES * pair, &mut timestamps);
        let [start, end] =
            [0, TIMESTAMP_BYTES].map(|at| u64::from_le_bytes(std::array::from_fn(|i| timestamps[at + i])));
        let nanoseconds = |ticks: u64| u128::from(ticks) * 1_000_000_000 / u128::from(self.rate);
        let took = end.checked_sub(start).map(|ticks| u64::try_from(nanoseconds(ticks)).unwrap_or(u64::MAX));
        (start, took.map(Duration::from_nanos))
    }
}
