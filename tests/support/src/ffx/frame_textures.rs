//! Textures of a frame as an engine has them, filled and read by the CPU.

use cairn::ffx::bindings::{Dimensions, Resource, ResourceState};
use cairn::ffx::{Frame, FrameParams, GenerationTextures};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;

use crate::d3d12::resources::{
    TestResource, create_resource, read_texture, run_list, texture_desc, transition, upload_buffer,
};

/// Bytes of a pixel of every texture here.
const PIXEL: usize = 4;

/// The state of every texture between calls.
const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Textures of a frame, all of one size: RGBA8 pictures, float depth, motion in half2.
pub struct Textures {
    gpu: Gpu,
    size: Dimensions,
    /// The picture.
    pub color: TestResource,
    /// The generated frame.
    pub output: TestResource,
    /// Device depth.
    pub depth: TestResource,
    /// Motion vectors.
    pub motion: TestResource,
}

impl Textures {
    /// Textures of `size` pixels, without contents.
    pub fn new(gpu: &Gpu, size: Dimensions) -> Self {
        let texture = |format| {
            let wanted = texture_desc((size.width, size.height), format, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
            TestResource { resource: create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, STATE), state: STATE }
        };
        Self {
            gpu: gpu.clone(),
            size,
            color: texture(DXGI_FORMAT_R8G8B8A8_UNORM),
            output: texture(DXGI_FORMAT_R8G8B8A8_UNORM),
            depth: texture(DXGI_FORMAT_R32_FLOAT),
            motion: texture(DXGI_FORMAT_R16G16_FLOAT),
        }
    }

    /// A frame of these textures, with the default camera, no jitter, and motion in pixels.
    pub fn frame(&self, list: &ID3D12GraphicsCommandList, reset: bool) -> Frame {
        let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
        Frame {
            command_list: list.as_raw(),
            color: resource(&self.color),
            output: resource(&self.output),
            depth: resource(&self.depth),
            motion: resource(&self.motion),
            hudless: Resource::default(),
            distortion: Resource::default(),
            params: FrameParams { reset, ..FrameParams::of(self.size) },
        }
    }

    /// The same frame as inputs of a `TextureGenerator`.
    pub fn pictures(&self) -> GenerationTextures<'_> {
        GenerationTextures {
            color: self.color.with_state(),
            output: self.output.with_state(),
            depth: self.depth.with_state(),
            motion: self.motion.with_state(),
            hudless: None,
            distortion: None,
        }
    }

    /// Sets every pixel of a texture to `pixel` of its column and row.
    pub fn fill(&self, texture: &TestResource, pixel: impl Fn(u32, u32) -> [u8; PIXEL]) {
        let Dimensions { width, height } = self.size;
        let pitch = (width as usize * PIXEL).next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize);
        let mut bytes = vec![0; pitch * height as usize];
        for (y, row) in (0..height).zip(bytes.chunks_exact_mut(pitch)) {
            for (x, place) in (0..width).zip(row.chunks_exact_mut(PIXEL)) {
                place.copy_from_slice(&pixel(x, y));
            }
        }
        let from = upload_buffer(&self.gpu, &bytes);
        // SAFETY: a copy of the pointer without a reference, as copy locations take it; never dropped.
        let borrowed = |resource: &ID3D12Resource| unsafe { std::mem::transmute_copy(resource) };
        // SAFETY: a live resource.
        let format = unsafe { texture.resource.GetDesc() }.Format;
        let footprint = D3D12_SUBRESOURCE_FOOTPRINT {
            Format: format,
            Width: width,
            Height: height,
            Depth: 1,
            RowPitch: pitch as u32,
        };
        let rows = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(&from.resource),
            Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 {
                PlacedFootprint: D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: footprint },
            },
        };
        let pixels = D3D12_TEXTURE_COPY_LOCATION {
            pResource: borrowed(&texture.resource),
            Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
            Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
        };
        run_list(&self.gpu, |list| {
            transition(list, texture, texture.state, D3D12_RESOURCE_STATE_COPY_DEST);
            // SAFETY: an open list, and live resources in the states of a copy.
            unsafe { list.CopyTextureRegion(&pixels, 0, 0, 0, &rows, None) };
            transition(list, texture, D3D12_RESOURCE_STATE_COPY_DEST, texture.state);
        });
    }

    /// All pixels of the generated frame, row by row.
    pub fn generated(&self) -> Vec<[u8; PIXEL]> {
        self.pixels(&self.output)
    }

    /// All pixels of a texture of that size.
    pub fn pixels(&self, texture: &TestResource) -> Vec<[u8; PIXEL]> {
        let bytes = read_texture(&self.gpu, texture, self.size.width as usize * PIXEL);
        bytes.as_chunks().0.to_vec()
    }
}

/// Records a copy from one texture to another.
pub fn copy(list: &ID3D12GraphicsCommandList, from: &TestResource, to: &TestResource) {
    let (source, destination) = (D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATE_COPY_DEST);
    transition(list, from, from.state, source);
    transition(list, to, to.state, destination);
    // SAFETY: an open list, and live textures of one size and format in the states of a copy.
    unsafe { list.CopyResource(&to.resource, &from.resource) };
    transition(list, from, source, from.state);
    transition(list, to, destination, to.state);
}
