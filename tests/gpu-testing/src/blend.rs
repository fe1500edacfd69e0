//! A shader that blends two textures, and a timer on the device.

use std::mem::ManuallyDrop;

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D::ID3DBlob;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_SAMPLE_DESC};

use crate::resources::{TestResource, create_resource, run_list};

/// Width and height of its thread groups.
const GROUP: u32 = 8;

/// The shader with two pictures and a target for their mean.
pub struct Blend {
    root: ID3D12RootSignature,
    pipeline: ID3D12PipelineState,
    heap: ID3D12DescriptorHeap,
    groups: [u32; 2],
}

impl Blend {
    /// The mean of two pictures of `size`.
    pub fn new(gpu: &Gpu, [before, after, mean]: [&TestResource; 3], size: (u32, u32)) -> Self {
        let device = gpu.device();
        let range = |kind, count| D3D12_DESCRIPTOR_RANGE {
            RangeType: kind,
            NumDescriptors: count,
            OffsetInDescriptorsFromTableStart: D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND,
            ..Default::default()
        };
        let ranges = [range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, 2), range(D3D12_DESCRIPTOR_RANGE_TYPE_UAV, 1)];
        let table = D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_DESCRIPTOR_TABLE,
            Anonymous: D3D12_ROOT_PARAMETER_0 {
                DescriptorTable: D3D12_ROOT_DESCRIPTOR_TABLE {
                    NumDescriptorRanges: ranges.len() as u32,
                    pDescriptorRanges: ranges.as_ptr(),
                },
            },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        };
        let wanted = D3D12_ROOT_SIGNATURE_DESC { NumParameters: 1, pParameters: &table, ..Default::default() };
        let mut text: Option<ID3DBlob> = None;
        // SAFETY: the description and what it points to live during the call, and so does the variable.
        unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut text, None) }.expect("a text");
        let text = text.expect("a text");
        // SAFETY: a live blob.
        let (address, length) = unsafe { (text.GetBufferPointer(), text.GetBufferSize()) };
        // SAFETY: the blob's own memory, which lives as long as it does.
        let bytes = unsafe { std::slice::from_raw_parts(address.cast::<u8>(), length) };
        // SAFETY: a live device and bytes that live during the call.
        let root: ID3D12RootSignature = unsafe { device.CreateRootSignature(0, bytes) }.expect("a root signature");
        let code = include_bytes!("../../../benches/gpu/compiled/blend.dxbc");
        let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
            pRootSignature: ManuallyDrop::new(Some(root.clone())),
            CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
            ..Default::default()
        };
        // SAFETY: a live device; the description and the code live during the call.
        let pipeline = unsafe { device.CreateComputePipelineState(&wanted) }.expect("a pipeline");
        drop(ManuallyDrop::into_inner(wanted.pRootSignature));
        let wanted = D3D12_DESCRIPTOR_HEAP_DESC {
            Type: D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV,
            NumDescriptors: 3,
            Flags: D3D12_DESCRIPTOR_HEAP_FLAG_SHADER_VISIBLE,
            NodeMask: 0,
        };
        // SAFETY: a live device and a description that lives during the call.
        let heap: ID3D12DescriptorHeap = unsafe { device.CreateDescriptorHeap(&wanted) }.expect("a heap");
        // SAFETY: a live device and heap.
        let (first, step) = unsafe {
            let step = device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV);
            (heap.GetCPUDescriptorHandleForHeapStart().ptr, step as usize)
        };
        for (i, picture) in [before, after].into_iter().enumerate() {
            let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: first + i * step };
            // SAFETY: a live device and resource, and a descriptor in the heap.
            unsafe { device.CreateShaderResourceView(&picture.resource, None, at) };
        }
        let view = D3D12_UNORDERED_ACCESS_VIEW_DESC {
            Format: DXGI_FORMAT_R8G8B8A8_UNORM,
            ViewDimension: D3D12_UAV_DIMENSION_TEXTURE2D,
            ..Default::default()
        };
        let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: first + 2 * step };
        // SAFETY: as above.
        unsafe { device.CreateUnorderedAccessView(&mean.resource, None, Some(&view), at) };
        Self { root, pipeline, heap, groups: [size.0.div_ceil(GROUP), size.1.div_ceil(GROUP)] }
    }

    /// Records it; the pictures stay in states in which shaders read and write them.
    pub fn record(&self, list: &ID3D12GraphicsCommandList) {
        // SAFETY: an open list; everything lives until it has run.
        unsafe {
            list.SetDescriptorHeaps(&[Some(self.heap.clone())]);
            list.SetComputeRootSignature(&self.root);
            list.SetPipelineState(&self.pipeline);
            list.SetComputeRootDescriptorTable(0, self.heap.GetGPUDescriptorHandleForHeapStart());
            list.Dispatch(self.groups[0], self.groups[1], 1);
        }
    }
}

/// Measures time on the device.
pub struct Clock {
    queries: ID3D12QueryHeap,
    results: ID3D12Resource,
    /// Ticks per second.
    frequency: f64,
}

impl Clock {
    /// A clock of the queue for frames.
    pub fn new(gpu: &Gpu) -> Self {
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: 2, NodeMask: 0 };
        let mut queries: Option<ID3D12QueryHeap> = None;
        // SAFETY: the description and the variable live during the call.
        unsafe { gpu.device().CreateQueryHeap(&wanted, &mut queries) }.expect("queries");
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
        let frequency = unsafe { gpu.frames().d3d12().GetTimestampFrequency() }.expect("a frequency") as f64;
        Self { queries: queries.expect("queries"), results, frequency }
    }

    /// Runs the recorded commands and returns their time in seconds.
    pub fn time(&self, gpu: &Gpu, record: impl FnOnce(&ID3D12GraphicsCommandList)) -> f64 {
        run_list(gpu, |list| {
            // SAFETY: an open list; the queries live until it has run.
            unsafe { list.EndQuery(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 0) };
            record(list);
            // SAFETY: as above, and a buffer with room for both.
            unsafe {
                list.EndQuery(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 1);
                list.ResolveQueryData(&self.queries, D3D12_QUERY_TYPE_TIMESTAMP, 0, 2, &self.results, 0);
            }
        });
        let mut address = std::ptr::null_mut();
        // SAFETY: a buffer in an upload or readback heap.
        unsafe { self.results.Map(0, None, Some(&mut address)) }.expect("a mapping");
        // SAFETY: it holds two numbers, which the device has written.
        let [start, end] = unsafe { address.cast::<[u64; 2]>().read() };
        // SAFETY: it is mapped.
        unsafe { self.results.Unmap(0, None) };
        end.wrapping_sub(start) as f64 / self.frequency
    }
}
