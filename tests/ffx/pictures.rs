//! Textures of a frame as an engine has them, filled and read by the CPU.
#![allow(dead_code, unused_imports, reason = "each test program uses its part")]

use cairn::ffx::bindings::{Dimensions, Resource, ResourceState};
use cairn::ffx::{Frame, FrameParams, Pictures};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;

#[path = "../d3d12/pictures.rs"]
mod primitives;
pub(crate) use primitives::{Kept, flat, made, run, texture};
use primitives::{becomes, buffer, read};

/// Bytes of a pixel of every texture here.
const PIXEL: usize = 4;

/// The state of every texture between calls.
const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Textures of a frame, all of one size: RGBA8 pictures, float depth, motion in half2.
pub(crate) struct Textures {
    gpu: Gpu,
    size: Dimensions,
    pub(crate) color: Kept,
    pub(crate) output: Kept,
    pub(crate) depth: Kept,
    pub(crate) motion: Kept,
}

impl Textures {
    pub(crate) fn new(gpu: &Gpu, size: Dimensions) -> Self {
        let texture = |format| {
            let wanted = flat((size.width, size.height), format, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
            Kept { resource: made(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, STATE), state: STATE }
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
    pub(crate) fn frame(&self, list: &ID3D12GraphicsCommandList, reset: bool) -> Frame {
        let resource = |kept: &Kept| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
        Frame {
            command_list: list.as_raw(),
            color: resource(&self.color),
            output: resource(&self.output),
            depth: resource(&self.depth),
            motion: resource(&self.motion),
            hudless: Resource::default(),
            distortion: Resource::default(),
            shot: FrameParams { reset, ..FrameParams::of(self.size) },
        }
    }

    /// The same frame as inputs of a `TextureGenerator`.
    pub(crate) fn pictures(&self) -> Pictures<'_> {
        Pictures {
            color: self.color.resting(),
            output: self.output.resting(),
            depth: self.depth.resting(),
            motion: self.motion.resting(),
            hudless: None,
            distortion: None,
        }
    }

    /// Sets every pixel of a texture to `pixel` of its column and row.
    pub(crate) fn fill(&self, texture: &Kept, pixel: impl Fn(u32, u32) -> [u8; PIXEL]) {
        let Dimensions { width, height } = self.size;
        let pitch = (width as usize * PIXEL).next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize);
        let mut bytes = vec![0; pitch * height as usize];
        for (y, row) in (0..height).zip(bytes.chunks_exact_mut(pitch)) {
            for (x, place) in (0..width).zip(row.chunks_exact_mut(PIXEL)) {
                place.copy_from_slice(&pixel(x, y));
            }
        }
        let from = buffer(&self.gpu, &bytes);
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
        run(&self.gpu, |list| {
            becomes(list, texture, texture.state, D3D12_RESOURCE_STATE_COPY_DEST);
            // SAFETY: an open list, and live resources in the states of a copy.
            unsafe { list.CopyTextureRegion(&pixels, 0, 0, 0, &rows, None) };
            becomes(list, texture, D3D12_RESOURCE_STATE_COPY_DEST, texture.state);
        });
    }

    /// All pixels of the generated frame, row by row.
    pub(crate) fn generated(&self) -> Vec<[u8; PIXEL]> {
        self.pixels(&self.output)
    }

    /// All pixels of a texture of that size.
    pub(crate) fn pixels(&self, texture: &Kept) -> Vec<[u8; PIXEL]> {
        let bytes = read(&self.gpu, texture, self.size.width as usize * PIXEL);
        bytes.as_chunks().0.to_vec()
    }
}

/// Records a copy from one texture to another.
pub(crate) fn copy(list: &ID3D12GraphicsCommandList, from: &Kept, to: &Kept) {
    let (source, destination) = (D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATE_COPY_DEST);
    becomes(list, from, from.state, source);
    becomes(list, to, to.state, destination);
    // SAFETY: an open list, and live textures of one size and format in the states of a copy.
    unsafe { list.CopyResource(&to.resource, &from.resource) };
    becomes(list, from, source, from.state);
    becomes(list, to, destination, to.state);
}
