//! Creates buffers and textures with contents, and reads them back.

use cairn::gpu::Gpu;
use cairn::gpu::compute::ResourceWithState;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;

use crate::fault;

/// A resource with its state between uses.
pub struct TestResource {
    /// The resource.
    pub resource: ID3D12Resource,
    /// Its state between uses.
    pub state: D3D12_RESOURCE_STATES,
}

impl TestResource {
    /// The resource as the library's functions take it.
    pub fn with_state(&self) -> ResourceWithState<'_> {
        ResourceWithState { resource: &self.resource, state: self.state }
    }
}

/// A buffer on the device that holds `bytes`.
pub fn upload_buffer(gpu: &Gpu, bytes: &[u8]) -> TestResource {
    let upload =
        create_resource(gpu, D3D12_HEAP_TYPE_UPLOAD, &buffer_desc(bytes.len()), D3D12_RESOURCE_STATE_GENERIC_READ);
    let mut place = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { upload.Map(0, None, Some(&mut place)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer, and nothing uses it yet.
    unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), place.cast::<u8>(), bytes.len()) };
    let mut wanted = buffer_desc(bytes.len());
    wanted.Flags = D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS;
    let resource = create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, D3D12_RESOURCE_STATE_COMMON);
    run_list(gpu, |list| {
        // SAFETY: an open list; both buffers live until it has run.
        unsafe { list.CopyBufferRegion(&resource, 0, &upload, 0, bytes.len() as u64) };
    });
    TestResource { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

/// A texture that shaders may write and that may be a render target, in the state `state`.
pub fn writable_texture(
    gpu: &Gpu,
    (width, height): (u32, u32),
    format: DXGI_FORMAT,
    state: D3D12_RESOURCE_STATES,
) -> TestResource {
    let flags = D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS | D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    let wanted = texture_desc((width, height), format, flags);
    TestResource { resource: create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state }
}

/// The description of a two-dimensional texture without mipmaps.
pub fn texture_desc(
    (width, height): (u32, u32),
    format: DXGI_FORMAT,
    flags: D3D12_RESOURCE_FLAGS,
) -> D3D12_RESOURCE_DESC {
    D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
        Width: u64::from(width),
        Height: height,
        DepthOrArraySize: 1,
        MipLevels: 1,
        Format: format,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Flags: flags,
        ..Default::default()
    }
}

/// A committed resource.
pub fn create_resource(
    gpu: &Gpu,
    heap: D3D12_HEAP_TYPE,
    wanted: &D3D12_RESOURCE_DESC,
    state: D3D12_RESOURCE_STATES,
) -> ID3D12Resource {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let mut created: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and variable live during the call.
    unsafe { gpu.device().CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, wanted, state, None, &mut created) }
        .expect("a resource");
    created.expect("a resource")
}

fn buffer_desc(bytes: usize) -> D3D12_RESOURCE_DESC {
    D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: bytes.next_multiple_of(4) as u64,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        ..Default::default()
    }
}

/// A texture that shaders read, in the state COMMON. `rows` contains its rows without padding.
pub fn upload_texture(gpu: &Gpu, (width, height): (u32, u32), format: DXGI_FORMAT, rows: &[u8]) -> TestResource {
    let wanted = texture_desc((width, height), format, D3D12_RESOURCE_FLAG_NONE);
    let resource = create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, D3D12_RESOURCE_STATE_COPY_DEST);
    let mut place = D3D12_PLACED_SUBRESOURCE_FOOTPRINT::default();
    let mut bytes = 0;
    // SAFETY: variables that live during the call.
    unsafe { gpu.device().GetCopyableFootprints(&wanted, 0, 1, 0, Some(&mut place), None, None, Some(&mut bytes)) };
    let upload =
        create_resource(gpu, D3D12_HEAP_TYPE_UPLOAD, &buffer_desc(bytes as usize), D3D12_RESOURCE_STATE_GENERIC_READ);
    let mut address = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { upload.Map(0, None, Some(&mut address)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer, and nothing uses it yet.
    let all = unsafe { std::slice::from_raw_parts_mut(address.cast::<u8>(), bytes as usize) };
    let row = rows.len() / height as usize;
    for (to, from) in all.chunks_mut(place.Footprint.RowPitch as usize).zip(rows.chunks(row)) {
        to[..row].copy_from_slice(from);
    }
    let texture = TestResource { resource, state: D3D12_RESOURCE_STATE_COMMON };
    run_list(gpu, |list| {
        let to = D3D12_TEXTURE_COPY_LOCATION {
            // SAFETY: a copy that holds no reference and is only read during the call.
            pResource: unsafe { std::mem::transmute_copy(&texture.resource) },
            Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
        };
        let from = D3D12_TEXTURE_COPY_LOCATION {
            // SAFETY: as above.
            pResource: unsafe { std::mem::transmute_copy(&upload) },
            Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: place },
        };
        // SAFETY: an open list; both resources live until it has run.
        unsafe { list.CopyTextureRegion(&to, 0, 0, 0, &from, None) };
        transition(list, &texture, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COMMON);
    });
    texture
}

/// The first `N` 32-bit words of a buffer.
pub fn read_words<const N: usize>(gpu: &Gpu, buffer: &ResourceWithState<'_>) -> [u32; N] {
    let back = create_resource(gpu, D3D12_HEAP_TYPE_READBACK, &buffer_desc(4 * N), D3D12_RESOURCE_STATE_COPY_DEST);
    run_list(gpu, |list| {
        // SAFETY: an open list; both buffers live until it has run.
        unsafe { list.CopyBufferRegion(&back, 0, buffer.resource, 0, 4 * N as u64) };
    });
    let mut address = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { back.Map(0, None, Some(&mut address)) }.expect("a mapping");
    // SAFETY: the mapping is as long, and the device is done with it.
    unsafe { address.cast::<[u32; N]>().read() }
}

/// The rows of a texture, each of `row` bytes.
pub fn read_texture(gpu: &Gpu, texture: &TestResource, row: usize) -> Vec<u8> {
    // SAFETY: a live resource.
    let wanted = unsafe { texture.resource.GetDesc() };
    let rows = wanted.Height as usize;
    let mut place = D3D12_PLACED_SUBRESOURCE_FOOTPRINT::default();
    let mut bytes = 0;
    // SAFETY: variables that live during the call.
    unsafe { gpu.device().GetCopyableFootprints(&wanted, 0, 1, 0, Some(&mut place), None, None, Some(&mut bytes)) };
    let back =
        create_resource(gpu, D3D12_HEAP_TYPE_READBACK, &buffer_desc(bytes as usize), D3D12_RESOURCE_STATE_COPY_DEST);
    run_list(gpu, |list| {
        let from = D3D12_TEXTURE_COPY_LOCATION {
            // SAFETY: a copy that holds no reference and is only read during the call.
            pResource: unsafe { std::mem::transmute_copy(&texture.resource) },
            Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
        };
        let to = D3D12_TEXTURE_COPY_LOCATION {
            // SAFETY: as above.
            pResource: unsafe { std::mem::transmute_copy(&back) },
            Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: place },
        };
        transition(list, texture, texture.state, D3D12_RESOURCE_STATE_COPY_SOURCE);
        // SAFETY: an open list; both resources live until it has run.
        unsafe { list.CopyTextureRegion(&to, 0, 0, 0, &from, None) };
        transition(list, texture, D3D12_RESOURCE_STATE_COPY_SOURCE, texture.state);
    });
    let mut address = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { back.Map(0, None, Some(&mut address)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer and the device is done with it.
    let all = unsafe { std::slice::from_raw_parts(address.cast::<u8>(), bytes as usize) };
    let mut read: Vec<u8> =
        (0..rows).flat_map(|y| all[y * place.Footprint.RowPitch as usize..][..row].to_vec()).collect();
    fault::alter(&mut read);
    read
}

/// Records a transition barrier if the states differ.
pub fn transition(
    list: &ID3D12GraphicsCommandList,
    texture: &TestResource,
    before: D3D12_RESOURCE_STATES,
    after: D3D12_RESOURCE_STATES,
) {
    if before == after {
        return;
    }
    let barrier = D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
        Anonymous: D3D12_RESOURCE_BARRIER_0 {
            Transition: std::mem::ManuallyDrop::new(D3D12_RESOURCE_TRANSITION_BARRIER {
                // SAFETY: a copy that holds no reference and is only read during the call.
                pResource: unsafe { std::mem::transmute_copy(&texture.resource) },
                Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
                StateBefore: before,
                StateAfter: after,
            }),
        },
        ..Default::default()
    };
    // SAFETY: an open list and a live resource.
    unsafe { list.ResourceBarrier(&[barrier]) };
}

/// Records and closes a command list for the queue for frames. The allocator lives until the list has run.
pub fn recorded_list(
    gpu: &Gpu,
    record: impl FnOnce(&ID3D12GraphicsCommandList),
) -> (ID3D12CommandAllocator, ID3D12CommandList) {
    let kind = gpu.frames().kind();
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator = unsafe { gpu.device().CreateCommandAllocator(kind) }.expect("an allocator");
    // SAFETY: a live device and allocator.
    let list: ID3D12GraphicsCommandList =
        unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }.expect("a list");
    record(&list);
    // SAFETY: an open list.
    unsafe { list.Close() }.expect("a closed list");
    (allocator, list.cast().expect("a list"))
}

/// Records a command list for the queue for frames, executes it, and waits for it.
pub fn run_list(gpu: &Gpu, record: impl FnOnce(&ID3D12GraphicsCommandList)) {
    let (_allocator, list) = recorded_list(gpu, record);
    gpu.frames().submit(&[list]).expect("a submission").wait().expect("it is done");
}
