//! Times of work on the GPU by its own clock, and statistics of them.

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_SAMPLE_DESC;
use cairn::{Error, ErrorKind, Result};

use super::resources::{create_resource, run_list};
use crate::outcome::{Better, Figure};

/// Measures work on the queue for frames.
pub(super) struct Clock {
    queries: ID3D12QueryHeap,
    results: ID3D12Resource,
    /// Ticks per second.
    frequency: f64,
}

fn failed(call: &str, e: &cairn::gpu::windows::core::Error) -> Error {
    Error::new(ErrorKind::Device, format!("{call}: {}", e.message()))
}

impl Clock {
    /// # Errors
    /// `Unsupported` if the queue has no timestamps.
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: 2, NodeMask: 0 };
        let mut queries: Option<ID3D12QueryHeap> = None;
        // SAFETY: the description and the variable live during the call.
        unsafe { gpu.device().CreateQueryHeap(&wanted, &mut queries) }.map_err(|e| failed("CreateQueryHeap", &e))?;
        let wanted = D3D12_RESOURCE_DESC {
            Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
            Width: 16,
            Height: 1,
            DepthOrArraySize: 1,
            MipLevels: 1,
            SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
            Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
            ..Default::default()
        };
        let results = create_resource(gpu, D3D12_HEAP_TYPE_READBACK, &wanted, D3D12_RESOURCE_STATE_COPY_DEST);
        // SAFETY: a live queue.
        let frequency = unsafe { gpu.frames().d3d12().GetTimestampFrequency() }.unwrap_or(0);
        match queries {
            Some(queries) if frequency > 0 => Ok(Self { queries, results, frequency: frequency as f64 }),
            _ => Err(Error::new(ErrorKind::Unsupported, "the GPU has no clock").remedy("Update the graphics driver")),
        }
    }

    /// Runs the recorded commands and returns their time in milliseconds.
    pub(super) fn time(&self, gpu: &Gpu, record: impl FnOnce(&ID3D12GraphicsCommandList) -> Result<()>) -> Result<f64> {
        let mut recorded = Ok(());
        run_list(gpu, |list| {
            // SAFETY: an open list; the queries live until it has run.
            unsafe { list.EndQuery(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 0) };
            recorded = record(list);
            // SAFETY: as above, and a buffer with room for both.
            unsafe {
                list.EndQuery(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 1);
                list.ResolveQueryData(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 0, 2, &self.results, 0);
            }
        });
        recorded?;
        let mut address = std::ptr::null_mut();
        // SAFETY: a buffer in a readback heap.
        unsafe { self.results.Map(0, None, Some(&mut address)) }.map_err(|e| failed("Map", &e))?;
        // SAFETY: it holds two numbers, which the device has written.
        let [start, end] = unsafe { address.cast::<[u64; 2]>().read() };
        // SAFETY: it is mapped.
        unsafe { self.results.Unmap(0, None) };
        Ok(1e3 * end.wrapping_sub(start) as f64 / self.frequency)
    }
}

/// Median, 99th percentile and longest of some times in milliseconds.
pub(super) struct Times {
    pub(super) median: f64,
    pub(super) percentile_99: f64,
    pub(super) longest: f64,
}

impl Times {
    /// Of at least one time.
    pub(super) fn new(mut all: Vec<f64>) -> Self {
        all.sort_by(f64::total_cmp);
        let last = all.len() - 1;
        // Rounded up: the 99th percentile of few times is their longest.
        Self { median: all[last / 2], percentile_99: all[(last * 99).div_ceil(100)], longest: all[last] }
    }

    /// As figures whose names begin with `name`.
    pub(super) fn figures(&self, name: &str) -> [Figure; 3] {
        [("median", self.median), ("99th percentile", self.percentile_99), ("longest", self.longest)].map(
            |(of, value)| Figure { name: format!("{name}, {of}"), value, unit: "ms".into(), better: Better::Lower },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_of_sorted_times() {
        let times = Times::new((1..=200).rev().map(f64::from).collect());
        assert_eq!((times.median, times.percentile_99, times.longest), (100.0, 199.0, 200.0));
        let one = Times::new(vec![3.0]);
        assert_eq!((one.median, one.percentile_99, one.longest), (3.0, 3.0, 3.0));
    }
}
