//! Resources that share the memory of a heap, with the barriers and first uses that Direct3D requires, and without them.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use test_support::d3d12::engine::Engine;
use test_support::d3d12::recorder::findings_of;
use test_support::d3d12::textures::{Recording, TextureDesc, borrowed, readback, wait};

/// Enough for each resource of this file.
const HEAP_BYTES: u64 = 1 << 20;
const SIZE: (u32, u32) = (64, 64);
/// Bytes of a buffer.
const BYTES: u64 = 256;

fn buffer_desc() -> D3D12_RESOURCE_DESC {
    D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: BYTES,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        ..Default::default()
    }
}

fn heap(device: &ID3D12Device, flags: D3D12_HEAP_FLAGS) -> ID3D12Heap {
    let desc = D3D12_HEAP_DESC {
        SizeInBytes: HEAP_BYTES,
        Properties: D3D12_HEAP_PROPERTIES { Type: D3D12_HEAP_TYPE_DEFAULT, ..Default::default() },
        Alignment: 0,
        Flags: flags,
    };
    let mut made: Option<ID3D12Heap> = None;
    // SAFETY: a description and a variable that live during the call.
    unsafe { device.CreateHeap(&desc, &mut made) }.expect("a heap");
    made.expect("a heap")
}

/// A resource at the start of a heap.
fn place(
    device: &ID3D12Device,
    heap: &ID3D12Heap,
    desc: &D3D12_RESOURCE_DESC,
    state: D3D12_RESOURCE_STATES,
) -> ID3D12Resource {
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: a live heap; a description and a variable that live during the call.
    unsafe { device.CreatePlacedResource(heap, 0, desc, state, None, &mut made) }.expect("a resource");
    made.expect("a resource")
}

fn aliasing_barrier(list: &ID3D12GraphicsCommandList, before: &ID3D12Resource, after: &ID3D12Resource) {
    let barrier = D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_ALIASING,
        Anonymous: D3D12_RESOURCE_BARRIER_0 {
            Aliasing: std::mem::ManuallyDrop::new(D3D12_RESOURCE_ALIASING_BARRIER {
                pResourceBefore: borrowed(before),
                pResourceAfter: borrowed(after),
            }),
        },
        ..Default::default()
    };
    // SAFETY: an open list and live resources.
    unsafe { list.ResourceBarrier(&[barrier]) };
}

/// Identifiers of the rules that a list breaks.
fn broken(engine: &Engine, record: impl FnOnce(&Recording)) -> Vec<String> {
    let findings = findings_of(|| {
        let recording = Recording::on(&engine.device, &engine.direct);
        record(&recording);
        recording.submit(&engine.direct);
        wait(&engine.device, &engine.direct);
    });
    findings.into_iter().map(|finding| finding.id).collect()
}

#[test]
fn buffers_in_the_same_memory_need_an_aliasing_barrier_between_their_uses() {
    let engine = Engine::create();
    let heap = heap(&engine.device, D3D12_HEAP_FLAG_ALLOW_ONLY_BUFFERS);
    let [one, other] = [(); 2].map(|()| place(&engine.device, &heap, &buffer_desc(), D3D12_RESOURCE_STATE_COPY_DEST));
    let [first, second] = [(); 2].map(|()| readback(&engine.device, BYTES));
    let copy_both = |has_barrier: bool| {
        broken(&engine, |recording| {
            let list = recording.list();
            // SAFETY: an open list, and live resources of the same size.
            unsafe { list.CopyResource(&first, &one) };
            if has_barrier {
                aliasing_barrier(list, &one, &other);
            }
            // SAFETY: as above.
            unsafe { list.CopyResource(&second, &other) };
        })
    };
    assert_eq!(copy_both(true), [""; 0]);
    assert_eq!(copy_both(false), ["RECORDER_ALIASING_BARRIER_MISSING"]);
}

#[test]
fn a_placed_render_target_is_cleared_before_it_is_read() {
    let engine = Engine::create();
    let heap = heap(&engine.device, D3D12_HEAP_FLAG_ALLOW_ONLY_RT_DS_TEXTURES);
    let state = D3D12_RESOURCE_STATE_RENDER_TARGET;
    let read = TextureDesc { size: SIZE, state: D3D12_RESOURCE_STATE_COPY_DEST, ..TextureDesc::default() };
    let read = read.create(&engine.device);
    // SAFETY: a live texture.
    let mut desc = unsafe { read.GetDesc() };
    desc.Flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    let views =
        D3D12_DESCRIPTOR_HEAP_DESC { Type: D3D12_DESCRIPTOR_HEAP_TYPE_RTV, NumDescriptors: 1, ..Default::default() };
    // SAFETY: a description that lives during the call.
    let views: ID3D12DescriptorHeap = unsafe { engine.device.CreateDescriptorHeap(&views) }.expect("a heap");
    let copy = |is_cleared: bool| {
        let target = place(&engine.device, &heap, &desc, state);
        // SAFETY: a live texture, and a descriptor of a live heap.
        let view = unsafe {
            let view = views.GetCPUDescriptorHandleForHeapStart();
            engine.device.CreateRenderTargetView(&target, None, view);
            view
        };
        broken(&engine, |recording| {
            let list = recording.list();
            if is_cleared {
                // SAFETY: an open list and a written descriptor.
                unsafe { list.ClearRenderTargetView(view, &[0.0; 4], None) };
            }
            recording.barrier(&target, state, D3D12_RESOURCE_STATE_COPY_SOURCE);
            // SAFETY: an open list, and live textures of the same size.
            unsafe { list.CopyResource(&read, &target) };
        })
    };
    assert_eq!(copy(true), [""; 0]);
    assert_eq!(copy(false), ["RECORDER_PLACED_RESOURCE_NOT_INITIALIZED"]);
}
