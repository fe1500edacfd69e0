//! An engine's textures, and its command lists that use them.

use std::mem::ManuallyDrop;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;

use crate::fault;

/// Description of a two-dimensional texture in the default heap.
#[derive(Clone, Copy)]
pub struct TextureDesc {
    /// Width and height, in pixels.
    pub size: (u32, u32),
    /// Format of a pixel.
    pub format: DXGI_FORMAT,
    /// Allowed uses.
    pub flags: D3D12_RESOURCE_FLAGS,
    /// State after creation.
    pub state: D3D12_RESOURCE_STATES,
    /// Number of mipmap levels.
    pub levels: u16,
    /// Number of array slices.
    pub slices: u16,
}

impl Default for TextureDesc {
    fn default() -> Self {
        Self {
            size: (1, 1),
            format: DXGI_FORMAT_R8G8B8A8_UNORM,
            flags: D3D12_RESOURCE_FLAG_NONE,
            state: D3D12_RESOURCE_STATE_COMMON,
            levels: 1,
            slices: 1,
        }
    }
}

impl TextureDesc {
    /// The texture.
    pub fn create(&self, device: &ID3D12Device) -> ID3D12Resource {
        let desc = D3D12_RESOURCE_DESC {
            Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
            Width: u64::from(self.size.0),
            Height: self.size.1,
            DepthOrArraySize: self.slices,
            MipLevels: self.levels,
            Format: self.format,
            SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
            Flags: self.flags,
            ..Default::default()
        };
        committed(device, D3D12_HEAP_TYPE_DEFAULT, &desc, self.state)
    }
}

/// A readback buffer of `bytes` bytes.
pub fn readback(device: &ID3D12Device, bytes: u64) -> ID3D12Resource {
    let desc = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: bytes,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        ..Default::default()
    };
    committed(device, D3D12_HEAP_TYPE_READBACK, &desc, D3D12_RESOURCE_STATE_COPY_DEST)
}

fn committed(
    device: &ID3D12Device,
    heap: D3D12_HEAP_TYPE,
    desc: &D3D12_RESOURCE_DESC,
    state: D3D12_RESOURCE_STATES,
) -> ID3D12Resource {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and variable live during the call.
    unsafe { device.CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, desc, state, None, &mut made) }
        .expect("a resource");
    made.expect("a resource")
}

/// An open command list with its allocator, which must live until the list has run, and a fence that gets the value 1 then.
pub struct Recording {
    list: ID3D12GraphicsCommandList,
    _allocator: ID3D12CommandAllocator,
    fence: ID3D12Fence,
}

impl Recording {
    /// A list of this type.
    pub fn new(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE) -> Self {
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }.expect("an allocator");
        // SAFETY: a live device and allocator.
        let list = unsafe { device.CreateCommandList(0, kind, &allocator, None) }.expect("a list");
        // SAFETY: a live device.
        let fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
        Self { list, _allocator: allocator, fence }
    }

    /// The fence that [`Recording::submit`] signals.
    pub fn fence(&self) -> &ID3D12Fence {
        &self.fence
    }

    /// Signals the fence, as an engine does for a list that it will never execute.
    pub fn drop_list(&self) {
        // SAFETY: a live fence.
        unsafe { self.fence.Signal(1) }.expect("a signal");
    }

    /// A list of the queue's type.
    pub fn on(device: &ID3D12Device, queue: &ID3D12CommandQueue) -> Self {
        // SAFETY: a live queue.
        Self::new(device, unsafe { queue.GetDesc() }.Type)
    }

    /// The command list.
    pub fn list(&self) -> &ID3D12GraphicsCommandList {
        &self.list
    }

    /// Records a transition barrier if the states differ.
    pub fn barrier(&self, texture: &ID3D12Resource, before: D3D12_RESOURCE_STATES, after: D3D12_RESOURCE_STATES) {
        if before == after {
            return;
        }
        let barrier = D3D12_RESOURCE_BARRIER {
            Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
            Anonymous: D3D12_RESOURCE_BARRIER_0 {
                Transition: ManuallyDrop::new(D3D12_RESOURCE_TRANSITION_BARRIER {
                    pResource: borrowed(texture),
                    Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
                    StateBefore: before,
                    StateAfter: after,
                }),
            },
            ..Default::default()
        };
        // SAFETY: an open list and a live texture in the state before.
        unsafe { self.list.ResourceBarrier(&[barrier]) };
    }

    /// Closes the list and executes it on a queue, which then signals the fence.
    pub fn submit(&self, queue: &ID3D12CommandQueue) {
        // SAFETY: an open list.
        unsafe { self.list.Close() }.expect("a closed list");
        let list: ID3D12CommandList = self.list.cast().expect("a command list");
        // SAFETY: a closed list of the queue's device, which lives until it has run.
        unsafe { queue.ExecuteCommandLists(&[Some(list)]) };
        // SAFETY: a live queue and fence.
        unsafe { queue.Signal(&self.fence, 1) }.expect("it takes a signal");
    }
}

/// Waits until a queue has finished all submitted work.
pub fn wait(device: &ID3D12Device, queue: &ID3D12CommandQueue) {
    // SAFETY: a live device.
    let fence: ID3D12Fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    // SAFETY: a live queue and fence.
    unsafe { queue.Signal(&fence, 1) }.expect("it takes a signal");
    // SAFETY: a live fence.
    while unsafe { fence.GetCompletedValue() } < 1 {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

/// The pixels of a texture, row by row without padding. The texture is in `state` before and after.
pub fn read(
    device: &ID3D12Device,
    queue: &ID3D12CommandQueue,
    texture: &ID3D12Resource,
    state: D3D12_RESOURCE_STATES,
) -> Vec<u8> {
    // SAFETY: a live texture.
    let desc = unsafe { texture.GetDesc() };
    let (mut layout, mut rows, mut row, mut bytes) = (D3D12_PLACED_SUBRESOURCE_FOOTPRINT::default(), 0, 0, 0);
    let places = (Some(&raw mut layout), Some(&raw mut rows), Some(&raw mut row), Some(&raw mut bytes));
    // SAFETY: a live device; description and variables live during the call.
    unsafe { device.GetCopyableFootprints(&desc, 0, 1, 0, places.0, places.1, places.2, places.3) };
    let buffer = readback(device, bytes);
    let recording = Recording::on(device, queue);
    recording.barrier(texture, state, D3D12_RESOURCE_STATE_COPY_SOURCE);
    let to = D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(&buffer),
        Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: layout },
    };
    let from = D3D12_TEXTURE_COPY_LOCATION {
        pResource: borrowed(texture),
        Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
    };
    // SAFETY: an open list, and live resources in the states for it.
    unsafe { recording.list.CopyTextureRegion(&to, 0, 0, 0, &from, None) };
    recording.barrier(texture, D3D12_RESOURCE_STATE_COPY_SOURCE, state);
    recording.submit(queue);
    wait(device, queue);
    let mut place = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { buffer.Map(0, None, Some(&mut place)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer, and the device is done with it.
    let all = unsafe { std::slice::from_raw_parts(place.cast::<u8>(), bytes as usize) };
    let pitch = layout.Footprint.RowPitch as usize;
    let mut pixels: Vec<u8> =
        all.chunks(pitch).take(rows as usize).flat_map(|line| &line[..row as usize]).copied().collect();
    fault::alter(&mut pixels);
    pixels
}

/// A resource as a parameter that holds no reference.
pub fn borrowed(resource: &ID3D12Resource) -> ManuallyDrop<Option<ID3D12Resource>> {
    // SAFETY: the same pointer, not released by this copy.
    unsafe { std::mem::transmute_copy(resource) }
}
