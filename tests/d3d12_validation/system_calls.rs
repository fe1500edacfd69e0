//! The sorts of calls that the library makes, without the library: messages about them are vkd3d's, and `xtask/validation.toml` lists them.

use std::mem::ManuallyDrop;

use cairn::gpu::windows::Win32::Graphics::Direct3D::ID3DBlob;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::DXGI_PRESENT;
use test_support::d3d12::engine::Engine;
use test_support::d3d12::textures::{Recording, TextureDesc, read, wait};
use test_support::ffx::window::{Window, of_engine};

/// Compares two buffers of words: two root constants, and a table of two inputs and an output.
const SHADER: &[u8] = include_bytes!("../../src/gpu/shaders/compiled/equal.dxbc");
/// Compared words, in four rows of a texture.
const WORDS: u32 = 256;
/// Size of a buffer. Copies of it take longer than a submission, so that several submissions are in flight.
const BYTES: u64 = 16 << 20;

#[test]
fn buffers_are_copied_in_successive_submissions() {
    let Engine { device, direct, compute } = Engine::create();
    let (source, kept) = (upload(&device, 1), buffer(&device));
    let back = buffer_in(&device, D3D12_HEAP_TYPE_READBACK, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_FLAG_NONE);
    // Each submission is done before the next one of its queue starts, and buffers decay to COMMON between them.
    let write_twice_and_read = [(&source, &kept), (&source, &kept), (&kept, &back)];
    let read_and_write = [(&kept, &back), (&source, &kept)];
    for queue in [&direct, &compute] {
        for copies in [&write_twice_and_read[..], &read_and_write] {
            let submitted = copies.iter().map(|(from, to)| {
                let recording = Recording::on(&device, queue);
                // SAFETY: an open list; the buffers live until it has run.
                unsafe { recording.list().CopyBufferRegion(*to, 0, *from, 0, BYTES) };
                recording.submit(queue);
                recording
            });
            let submitted: Vec<_> = submitted.collect();
            wait(&device, queue);
            drop(submitted);
        }
    }
}

#[test]
fn a_texture_is_copied_to_twice_in_a_list() {
    let Engine { device, direct, .. } = Engine::create();
    let (source, kept) = (upload(&device, 2), buffer(&device));
    let texture = TextureDesc { size: (64, 4), state: D3D12_RESOURCE_STATE_COPY_DEST, ..TextureDesc::default() };
    let texture = texture.create(&device);
    let recording = Recording::on(&device, &direct);
    // SAFETY: an open list; the resources live until it has run.
    unsafe { recording.list().CopyBufferRegion(&kept, 0, &source, 0, BYTES) };
    recording.barrier(&kept, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COPY_SOURCE);
    // Direct3D has no barrier between copies to one resource: they run one after the other.
    for _ in 0..2 {
        copy_to_texture(&recording, &kept, &texture);
    }
    recording.barrier(&texture, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COMMON);
    recording.submit(&direct);
    wait(&device, &direct);
    assert!(read(&device, &direct, &texture, D3D12_RESOURCE_STATE_COMMON).iter().all(|&byte| byte == 2));
}

#[test]
fn a_list_that_is_recorded_first_runs_last() {
    let Engine { device, direct, .. } = Engine::create();
    let read = D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE;
    let desc = TextureDesc { size: (64, 4), state: D3D12_RESOURCE_STATE_COPY_SOURCE, ..TextureDesc::default() };
    let (picture, texture) = (desc.create(&device), TextureDesc { state: read, ..desc }.create(&device));
    // As a plugin of an engine records: the engine executes the barrier before.
    let copy = Recording::on(&device, &direct);
    // SAFETY: an open list; both textures live until it has run.
    unsafe { copy.list().CopyResource(&texture, &picture) };
    let before = Recording::on(&device, &direct);
    before.barrier(&texture, read, D3D12_RESOURCE_STATE_COPY_DEST);
    before.submit(&direct);
    copy.submit(&direct);
    let after = Recording::on(&device, &direct);
    after.barrier(&texture, D3D12_RESOURCE_STATE_COPY_DEST, read);
    after.submit(&direct);
    wait(&device, &direct);
}

#[test]
fn dispatches_write_and_read_buffers() {
    let Engine { device, direct, compute } = Engine::create();
    for queue in [&direct, &compute] {
        let (first, second, verdict) = (upload(&device, 3), upload(&device, 3), buffer(&device));
        let kept = buffer(&device);
        let recording = Recording::on(&device, queue);
        // SAFETY: an open list; the buffers live until it has run.
        unsafe { recording.list().CopyBufferRegion(&kept, 0, &first, 0, BYTES) };
        recording.barrier(&kept, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE);
        recording.barrier(&verdict, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        let dispatch = Dispatch::new(&device, [&kept, &second], &verdict);
        let times = Timestamps::new(&device);
        times.record(&recording, 0);
        for _ in 0..2 {
            dispatch.record(&recording);
            uav_barrier(&recording, &verdict);
        }
        times.record(&recording, 1);
        recording.barrier(&verdict, D3D12_RESOURCE_STATE_UNORDERED_ACCESS, D3D12_RESOURCE_STATE_COMMON);
        recording.barrier(&kept, D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE, D3D12_RESOURCE_STATE_COMMON);
        recording.submit(queue);
        // The next submission reads and writes the same memory.
        let again = Recording::on(&device, queue);
        again.barrier(&verdict, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        again.barrier(&kept, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE);
        dispatch.record(&again);
        again.submit(queue);
        wait(&device, queue);
    }
}

#[test]
fn root_constants_fill_a_root_signature() {
    let Engine { device, direct, .. } = Engine::create();
    let (first, second, verdict) = (upload(&device, 3), upload(&device, 3), buffer(&device));
    // With the table and the two that the shader reads, as many words as a root signature may have.
    let dispatch = Dispatch::with_unused_constants(&device, [&first, &second], &verdict, &[60, 1]);
    let recording = Recording::on(&device, &direct);
    recording.barrier(&verdict, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
    dispatch.record(&recording);
    recording.submit(&direct);
    wait(&device, &direct);
}

#[test]
fn one_queue_reads_what_the_other_wrote() {
    let Engine { device, direct, compute } = Engine::create();
    let (source, kept) = (upload(&device, 4), buffer(&device));
    let texture = TextureDesc { size: (64, 4), ..TextureDesc::default() }.create(&device);
    let written = Recording::on(&device, &compute);
    // SAFETY: an open list; the buffers live until it has run.
    unsafe { written.list().CopyBufferRegion(&kept, 0, &source, 0, BYTES) };
    written.submit(&compute);
    // SAFETY: a live queue and fence.
    unsafe { direct.Wait(written.fence(), 1) }.expect("a wait");
    let reading = Recording::on(&device, &direct);
    reading.barrier(&texture, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_COPY_DEST);
    copy_to_texture(&reading, &kept, &texture);
    reading.barrier(&texture, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COMMON);
    reading.submit(&direct);
    wait(&device, &direct);
    assert!(read(&device, &direct, &texture, D3D12_RESOURCE_STATE_COMMON).iter().all(|&byte| byte == 4));
}

#[test]
fn a_window_shows_frames() {
    let engine = Engine::create();
    let window = Window::open();
    let swapchain = of_engine(&engine, &window);
    let Engine { device, direct, .. } = &engine;
    for _ in 0..6 {
        // SAFETY: a live swap chain and the index of one of its buffers.
        let buffer: ID3D12Resource =
            unsafe { swapchain.GetBuffer(swapchain.GetCurrentBackBufferIndex()) }.expect("a buffer");
        // SAFETY: a live resource.
        let desc = unsafe { buffer.GetDesc() };
        let (size, format) = ((desc.Width as u32, desc.Height), desc.Format);
        let picture = TextureDesc { size, format, ..TextureDesc::default() }.create(device);
        let recording = Recording::on(device, direct);
        recording.barrier(&picture, D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_COPY_SOURCE);
        recording.barrier(&buffer, D3D12_RESOURCE_STATE_PRESENT, D3D12_RESOURCE_STATE_COPY_DEST);
        // SAFETY: an open list; both textures live until it has run.
        unsafe { recording.list().CopyResource(&buffer, &picture) };
        recording.barrier(&buffer, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_PRESENT);
        recording.submit(direct);
        // SAFETY: a live swap chain.
        unsafe { swapchain.Present(0, DXGI_PRESENT(0)) }.ok().expect("it is shown");
        wait(device, direct);
    }
}

/// A buffer in the default heap that shaders may write, in the state COMMON.
fn buffer(device: &ID3D12Device) -> ID3D12Resource {
    let flags = D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS;
    buffer_in(device, D3D12_HEAP_TYPE_DEFAULT, D3D12_RESOURCE_STATE_COMMON, flags)
}

/// A buffer in the upload heap, every byte `byte`.
fn upload(device: &ID3D12Device, byte: u8) -> ID3D12Resource {
    let state = D3D12_RESOURCE_STATE_GENERIC_READ;
    let made = buffer_in(device, D3D12_HEAP_TYPE_UPLOAD, state, D3D12_RESOURCE_FLAG_NONE);
    let mut address = std::ptr::null_mut();
    // SAFETY: a buffer in an upload heap.
    unsafe { made.Map(0, None, Some(&mut address)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer, and nothing uses it yet.
    unsafe { std::ptr::write_bytes(address.cast::<u8>(), byte, BYTES as usize) };
    made
}

fn buffer_in(
    device: &ID3D12Device,
    heap: D3D12_HEAP_TYPE,
    state: D3D12_RESOURCE_STATES,
    flags: D3D12_RESOURCE_FLAGS,
) -> ID3D12Resource {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let desc = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: BYTES,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        Flags: flags,
        ..Default::default()
    };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: description and variable live during the call.
    unsafe { device.CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &desc, state, None, &mut made) }
        .expect("a buffer");
    made.expect("a buffer")
}

/// Copies a buffer to a texture of 64 x 4 pixels.
fn copy_to_texture(recording: &Recording, from: &ID3D12Resource, to: &ID3D12Resource) {
    let footprint = D3D12_SUBRESOURCE_FOOTPRINT {
        Format: DXGI_FORMAT_R8G8B8A8_UNORM,
        Width: 64,
        Height: 4,
        Depth: 1,
        RowPitch: D3D12_TEXTURE_DATA_PITCH_ALIGNMENT,
    };
    let from = D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(from),
        Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 {
            PlacedFootprint: D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: footprint },
        },
    };
    let to = D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(to),
        Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
    };
    // SAFETY: an open list, and resources that live until it has run.
    unsafe { recording.list().CopyTextureRegion(&to, 0, 0, 0, &from, None) };
}

fn uav_barrier(recording: &Recording, resource: &ID3D12Resource) {
    let barrier = D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 {
            UAV: ManuallyDrop::new(D3D12_RESOURCE_UAV_BARRIER { pResource: borrowed(resource) }),
        },
        ..Default::default()
    };
    // SAFETY: an open list and a live resource.
    unsafe { recording.list().ResourceBarrier(&[barrier]) };
}

/// A resource as a parameter that holds no reference.
fn borrowed(resource: &ID3D12Resource) -> ManuallyDrop<Option<ID3D12Resource>> {
    // SAFETY: the same pointer, not released by this copy.
    unsafe { std::mem::transmute_copy(resource) }
}

/// A pipeline with its root signature and a heap with its table.
struct Dispatch {
    root: ID3D12RootSignature,
    pipeline: ID3D12PipelineState,
    heap: ID3D12DescriptorHeap,
    /// Numbers of constants that the shader does not read, each of a root parameter.
    unused: Vec<u32>,
}

impl Dispatch {
    fn new(device: &ID3D12Device, inputs: [&ID3D12Resource; 2], output: &ID3D12Resource) -> Self {
        Self::with_unused_constants(device, inputs, output, &[])
    }

    fn with_unused_constants(
        device: &ID3D12Device,
        inputs: [&ID3D12Resource; 2],
        output: &ID3D12Resource,
        unused: &[u32],
    ) -> Self {
        let range = |kind, register| D3D12_DESCRIPTOR_RANGE {
            RangeType: kind,
            NumDescriptors: 1,
            BaseShaderRegister: register,
            OffsetInDescriptorsFromTableStart: D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND,
            ..Default::default()
        };
        let ranges = [
            range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, 0),
            range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, 1),
            range(D3D12_DESCRIPTOR_RANGE_TYPE_UAV, 0),
        ];
        let constants = |register, count| D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
            Anonymous: D3D12_ROOT_PARAMETER_0 {
                Constants: D3D12_ROOT_CONSTANTS {
                    ShaderRegister: register,
                    Num32BitValues: count,
                    ..Default::default()
                },
            },
            ..Default::default()
        };
        let mut parameters = vec![
            constants(0, 2),
            D3D12_ROOT_PARAMETER {
                ParameterType: D3D12_ROOT_PARAMETER_TYPE_DESCRIPTOR_TABLE,
                Anonymous: D3D12_ROOT_PARAMETER_0 {
                    DescriptorTable: D3D12_ROOT_DESCRIPTOR_TABLE {
                        NumDescriptorRanges: ranges.len() as u32,
                        pDescriptorRanges: ranges.as_ptr(),
                    },
                },
                ..Default::default()
            },
        ];
        parameters.extend((1..).zip(unused).map(|(register, count)| constants(register, *count)));
        let wanted = D3D12_ROOT_SIGNATURE_DESC {
            NumParameters: parameters.len() as u32,
            pParameters: parameters.as_ptr(),
            ..Default::default()
        };
        let mut blob: Option<ID3DBlob> = None;
        // SAFETY: the description and what it points to live during the call, and so does the variable.
        unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }.expect("a blob");
        let blob = blob.expect("a blob");
        // SAFETY: the blob's own memory, which lives as long as it does.
        let bytes = unsafe { std::slice::from_raw_parts(blob.GetBufferPointer().cast::<u8>(), blob.GetBufferSize()) };
        // SAFETY: a live device and bytes that live during the call.
        let root: ID3D12RootSignature = unsafe { device.CreateRootSignature(0, bytes) }.expect("a root signature");
        let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
            // SAFETY: a copy that holds no reference and is only read during the call.
            pRootSignature: unsafe { std::mem::transmute_copy(&root) },
            CS: D3D12_SHADER_BYTECODE { pShaderBytecode: SHADER.as_ptr().cast(), BytecodeLength: SHADER.len() },
            ..Default::default()
        };
        // SAFETY: a live device; the description and the code live during the call.
        let pipeline = unsafe { device.CreateComputePipelineState(&wanted) }.expect("a pipeline");
        let wanted = D3D12_DESCRIPTOR_HEAP_DESC {
            Type: D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV,
            NumDescriptors: 3,
            Flags: D3D12_DESCRIPTOR_HEAP_FLAG_SHADER_VISIBLE,
            NodeMask: 0,
        };
        // SAFETY: a live device and a description that lives during the call.
        let heap: ID3D12DescriptorHeap = unsafe { device.CreateDescriptorHeap(&wanted) }.expect("a heap");
        // SAFETY: a live heap and device.
        let (start, step) = unsafe {
            (heap.GetCPUDescriptorHandleForHeapStart(), device.GetDescriptorHandleIncrementSize(wanted.Type) as usize)
        };
        let mut input = D3D12_SHADER_RESOURCE_VIEW_DESC {
            Format: DXGI_FORMAT_R32_TYPELESS,
            ViewDimension: D3D12_SRV_DIMENSION_BUFFER,
            Shader4ComponentMapping: D3D12_DEFAULT_SHADER_4_COMPONENT_MAPPING,
            ..Default::default()
        };
        input.Anonymous.Buffer =
            D3D12_BUFFER_SRV { NumElements: WORDS, Flags: D3D12_BUFFER_SRV_FLAG_RAW, ..Default::default() };
        let mut view = D3D12_UNORDERED_ACCESS_VIEW_DESC {
            Format: DXGI_FORMAT_R32_TYPELESS,
            ViewDimension: D3D12_UAV_DIMENSION_BUFFER,
            ..Default::default()
        };
        view.Anonymous.Buffer =
            D3D12_BUFFER_UAV { NumElements: WORDS, Flags: D3D12_BUFFER_UAV_FLAG_RAW, ..Default::default() };
        for (i, resource) in inputs.into_iter().enumerate() {
            let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: start.ptr + i * step };
            // SAFETY: a live device and buffer, a view that fits it, and a descriptor of the heap.
            unsafe { device.CreateShaderResourceView(resource, Some(&raw const input), at) };
        }
        let at = D3D12_CPU_DESCRIPTOR_HANDLE { ptr: start.ptr + 2 * step };
        // SAFETY: as above.
        unsafe { device.CreateUnorderedAccessView(output, None, Some(&raw const view), at) };
        Self { root, pipeline, heap, unused: unused.to_vec() }
    }

    fn record(&self, recording: &Recording) {
        let list = recording.list();
        let constants = [WORDS, WORDS];
        // SAFETY: an open list; all objects live until it has run.
        unsafe {
            list.SetDescriptorHeaps(&[Some(self.heap.clone())]);
            list.SetComputeRootSignature(&self.root);
            list.SetPipelineState(&self.pipeline);
            list.SetComputeRoot32BitConstants(0, constants.len() as u32, constants.as_ptr().cast(), 0);
            list.SetComputeRootDescriptorTable(1, self.heap.GetGPUDescriptorHandleForHeapStart());
            for (parameter, count) in (2..).zip(&self.unused) {
                let constants = vec![0_u32; *count as usize];
                list.SetComputeRoot32BitConstants(parameter, *count, constants.as_ptr().cast(), 0);
            }
            list.Dispatch(1, 1, 1);
        }
    }
}

/// Two timestamps and the buffer that they are written to.
struct Timestamps {
    heap: ID3D12QueryHeap,
    back: ID3D12Resource,
}

impl Timestamps {
    fn new(device: &ID3D12Device) -> Self {
        let wanted = D3D12_QUERY_HEAP_DESC { Type: D3D12_QUERY_HEAP_TYPE_TIMESTAMP, Count: 2, NodeMask: 0 };
        let mut heap: Option<ID3D12QueryHeap> = None;
        // SAFETY: description and variable live during the call.
        unsafe { device.CreateQueryHeap(&wanted, &mut heap) }.expect("a heap");
        let state = D3D12_RESOURCE_STATE_COPY_DEST;
        let back = buffer_in(device, D3D12_HEAP_TYPE_READBACK, state, D3D12_RESOURCE_FLAG_NONE);
        Self { heap: heap.expect("a heap"), back }
    }

    /// Records a timestamp, and after the second one the copy of both.
    fn record(&self, recording: &Recording, index: u32) {
        // SAFETY: an open list; heap and buffer live until it has run.
        unsafe { recording.list().EndQuery(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, index) };
        if index == 1 {
            // SAFETY: as above.
            unsafe { recording.list().ResolveQueryData(&self.heap, D3D12_QUERY_TYPE_TIMESTAMP, 0, 2, &self.back, 0) };
        }
    }
}
