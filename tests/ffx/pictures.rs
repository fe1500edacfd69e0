//! Textures as an engine makes them, filled and read by the processor.

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_SAMPLE_DESC};
use cairn::gpu::windows::core::Interface;

/// Bytes of a pixel of every texture here.
const PIXEL: usize = 4;
/// What every texture is in between calls.
const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// A list that is recorded, run and waited for.
pub(crate) struct Work<'a> {
    gpu: &'a Gpu,
    pub(crate) list: ID3D12GraphicsCommandList,
    _allocator: ID3D12CommandAllocator,
}

impl<'a> Work<'a> {
    pub(crate) fn new(gpu: &'a Gpu) -> Self {
        let kind = gpu.frames().kind();
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator =
            unsafe { gpu.device().CreateCommandAllocator(kind) }.expect("an allocator");
        // SAFETY: a live device and allocator.
        let list = unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }.expect("a list");
        Self { gpu, list, _allocator: allocator }
    }

    pub(crate) fn run(self) {
        // SAFETY: an open list.
        unsafe { self.list.Close() }.expect("a closed list");
        let lists = [self.list.cast().expect("a list")];
        self.gpu.frames().submit(&lists).expect("a submission").wait().expect("it is done");
    }

    fn transition(&self, resource: &ID3D12Resource, before: D3D12_RESOURCE_STATES, after: D3D12_RESOURCE_STATES) {
        let transition = D3D12_RESOURCE_TRANSITION_BARRIER {
            // SAFETY: a copy of the pointer without a reference, as barriers take it; never dropped.
            pResource: unsafe { std::mem::transmute_copy(resource) },
            Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
            StateBefore: before,
            StateAfter: after,
        };
        let barrier = D3D12_RESOURCE_BARRIER {
            Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
            Anonymous: D3D12_RESOURCE_BARRIER_0 { Transition: std::mem::ManuallyDrop::new(transition) },
            ..Default::default()
        };
        // SAFETY: an open list and a live resource.
        unsafe { self.list.ResourceBarrier(&[barrier]) };
    }
}

/// A texture of pixels of four bytes.
pub(crate) struct Texture {
    pub(crate) resource: ID3D12Resource,
    format: DXGI_FORMAT,
    size: (u32, u32),
}

impl Texture {
    pub(crate) fn new(gpu: &Gpu, format: DXGI_FORMAT, size: (u32, u32)) -> Self {
        let wanted = D3D12_RESOURCE_DESC {
            Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
            Width: size.0.into(),
            Height: size.1,
            DepthOrArraySize: 1,
            MipLevels: 1,
            Format: format,
            SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
            Flags: D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS,
            ..Default::default()
        };
        Self { resource: committed(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, STATE), format, size }
    }

    /// Bytes of a row where a texture is copied, and of all rows.
    fn pitch(&self) -> (usize, usize) {
        let pitch = (self.size.0 as usize * PIXEL).next_multiple_of(256);
        (pitch, pitch * self.size.1 as usize)
    }

    /// Sets every pixel to what `pixel` says of its column and row.
    pub(crate) fn fill(&self, gpu: &Gpu, pixel: impl Fn(u32, u32) -> [u8; PIXEL]) {
        let (pitch, length) = self.pitch();
        let buffer = buffer(gpu, D3D12_HEAP_TYPE_UPLOAD, D3D12_RESOURCE_STATE_GENERIC_READ, length);
        mapped(&buffer, length, |bytes| {
            for (y, row) in (0..self.size.1).zip(bytes.chunks_exact_mut(pitch)) {
                for (x, place) in (0..self.size.0).zip(row.chunks_exact_mut(PIXEL)) {
                    place.copy_from_slice(&pixel(x, y));
                }
            }
        });
        let work = Work::new(gpu);
        work.transition(&self.resource, STATE, D3D12_RESOURCE_STATE_COPY_DEST);
        self.copy(&work, &buffer, true);
        work.transition(&self.resource, D3D12_RESOURCE_STATE_COPY_DEST, STATE);
        work.run();
    }

    /// All pixels, row by row.
    pub(crate) fn read(&self, gpu: &Gpu) -> Vec<[u8; PIXEL]> {
        let (pitch, length) = self.pitch();
        let buffer = buffer(gpu, D3D12_HEAP_TYPE_READBACK, D3D12_RESOURCE_STATE_COPY_DEST, length);
        let work = Work::new(gpu);
        work.transition(&self.resource, STATE, D3D12_RESOURCE_STATE_COPY_SOURCE);
        self.copy(&work, &buffer, false);
        work.transition(&self.resource, D3D12_RESOURCE_STATE_COPY_SOURCE, STATE);
        work.run();
        let mut pixels = Vec::new();
        mapped(&buffer, length, |bytes| {
            for row in bytes.chunks_exact(pitch) {
                let row = row.chunks_exact(PIXEL).take(self.size.0 as usize);
                pixels.extend(row.map(|pixel| <[u8; PIXEL]>::try_from(pixel).expect("four bytes")));
            }
        });
        pixels
    }

    fn copy(&self, work: &Work<'_>, buffer: &ID3D12Resource, is_upload: bool) {
        // SAFETY: a copy of the pointer without a reference, as copies take it; never dropped.
        let borrowed = |resource: &ID3D12Resource| unsafe { std::mem::transmute_copy(resource) };
        let footprint = D3D12_SUBRESOURCE_FOOTPRINT {
            Format: self.format,
            Width: self.size.0,
            Height: self.size.1,
            Depth: 1,
            RowPitch: u32::try_from(self.pitch().0).expect("small"),
        };
        let bytes = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(buffer),
            Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 {
                PlacedFootprint: D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: footprint },
            },
        };
        let texture = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(&self.resource),
            Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
        };
        let (to, from) = if is_upload { (&texture, &bytes) } else { (&bytes, &texture) };
        // SAFETY: an open list, and live resources in the states of a copy.
        unsafe { work.list.CopyTextureRegion(to, 0, 0, 0, from, None) };
    }
}

fn buffer(gpu: &Gpu, heap: D3D12_HEAP_TYPE, state: D3D12_RESOURCE_STATES, length: usize) -> ID3D12Resource {
    let wanted = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
        Width: length as u64,
        Height: 1,
        DepthOrArraySize: 1,
        MipLevels: 1,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
        ..Default::default()
    };
    committed(gpu, heap, &wanted, state)
}

fn committed(
    gpu: &Gpu,
    heap: D3D12_HEAP_TYPE,
    wanted: &D3D12_RESOURCE_DESC,
    state: D3D12_RESOURCE_STATES,
) -> ID3D12Resource {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and place live during the call.
    unsafe { gpu.device().CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, wanted, state, None, &mut made) }
        .expect("a resource");
    made.expect("a resource")
}

fn mapped(buffer: &ID3D12Resource, length: usize, act: impl FnOnce(&mut [u8])) {
    let mut place = std::ptr::null_mut();
    // SAFETY: a buffer of a heap that the processor sees.
    unsafe { buffer.Map(0, None, Some(&mut place)) }.expect("a mapping");
    // SAFETY: the mapping is as long as the buffer and nothing on the device uses it now.
    act(unsafe { std::slice::from_raw_parts_mut(place.cast(), length) });
    // SAFETY: mapped above.
    unsafe { buffer.Unmap(0, None) };
}
