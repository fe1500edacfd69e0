//! An engine's buffers, and its command lists that copy between them.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_SAMPLE_DESC;
use cairn::gpu::windows::core::Interface;

/// Used bytes of every buffer.
const LENGTH: usize = 8;

/// A chain of buffers: an upload buffer first, a readback buffer last, and default-heap buffers between them.
pub struct Buffers {
    chain: Vec<ID3D12Resource>,
    /// The readback buffer.
    pub read: ID3D12Resource,
}

impl Buffers {
    /// A chain of `count` buffers.
    pub fn new(device: &ID3D12Device, count: usize) -> Self {
        let kind = |i: usize| match i {
            0 => (D3D12_HEAP_TYPE_UPLOAD, D3D12_RESOURCE_STATE_GENERIC_READ),
            _ if i + 1 == count => (D3D12_HEAP_TYPE_READBACK, D3D12_RESOURCE_STATE_COPY_DEST),
            // Buffers of the default heap are promoted implicitly to the state of their use, and decay when the list has run.
            _ => (D3D12_HEAP_TYPE_DEFAULT, D3D12_RESOURCE_STATE_COMMON),
        };
        let chain: Vec<_> = (0..count).map(kind).map(|(heap, state)| buffer(device, heap, state)).collect();
        Self { read: chain[count - 1].clone(), chain }
    }

    /// Writes the first buffer.
    pub fn upload(&self, text: &[u8; LENGTH]) {
        with_mapping(&self.chain[0], |bytes| bytes.copy_from_slice(text));
    }
}

fn buffer(device: &ID3D12Device, heap: D3D12_HEAP_TYPE, state: D3D12_RESOURCE_STATES) -> ID3D12Resource {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let wanted = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: LENGTH as u64,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        ..Default::default()
    };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and variable live during the call.
    unsafe { device.CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &wanted, state, None, &mut made) }
        .expect("a buffer");
    made.expect("a buffer")
}

/// The contents of a readback buffer.
pub fn bytes(buffer: &ID3D12Resource) -> [u8; LENGTH] {
    let mut found = [0; LENGTH];
    with_mapping(buffer, |bytes| found.copy_from_slice(bytes));
    found
}

/// Calls `act` with the contents of a buffer in an upload or readback heap.
fn with_mapping(buffer: &ID3D12Resource, act: impl FnOnce(&mut [u8])) {
    let mut address = std::ptr::null_mut();
    // SAFETY: a buffer in an upload or readback heap.
    unsafe { buffer.Map(0, None, Some(&mut address)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer and nothing on the device uses it now.
    act(unsafe { std::slice::from_raw_parts_mut(address.cast(), LENGTH) });
    // SAFETY: mapped above.
    unsafe { buffer.Unmap(0, None) };
}

/// A command list with its allocator, which must live until the list has run.
pub struct List {
    list: ID3D12GraphicsCommandList,
    _allocator: ID3D12CommandAllocator,
}

impl List {
    /// An open list.
    pub fn new(device: &ID3D12Device, kind: D3D12_COMMAND_LIST_TYPE) -> Self {
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }.expect("an allocator");
        // SAFETY: a live device and allocator.
        let list = unsafe { device.CreateCommandList(0, kind, &allocator, None) }.expect("a list");
        Self { list, _allocator: allocator }
    }

    /// Records a barrier for a buffer of the default heap that an earlier list of the same submission has written, then as
    /// [`copy`](Self::copy).
    pub fn copy_written(&self, buffers: &Buffers, from: usize, to: usize) -> ID3D12CommandList {
        let (before, after) = (D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COPY_SOURCE);
        let barrier = cairn::gpu::compute::transition(&buffers.chain[from], before, after);
        // SAFETY: an open list and a live buffer.
        unsafe { self.list.ResourceBarrier(&[barrier]) };
        self.copy(buffers, from, to)
    }

    /// Records a copy between two buffers of the chain, by their indices, and closes the list.
    pub fn copy(&self, buffers: &Buffers, from: usize, to: usize) -> ID3D12CommandList {
        // SAFETY: live buffers, which the test keeps until the list has run.
        unsafe { self.list.CopyBufferRegion(&buffers.chain[to], 0, &buffers.chain[from], 0, LENGTH as u64) };
        // SAFETY: an open list.
        unsafe { self.list.Close() }.expect("a closed list");
        self.still_open()
    }

    /// The list in the type that queues accept, closed or not.
    pub fn still_open(&self) -> ID3D12CommandList {
        self.list.cast().expect("a command list")
    }
}
