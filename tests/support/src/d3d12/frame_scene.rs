//! Inputs and outputs of two frames' kinds of work: a decoded picture is resized into a texture, and a frame is generated between it and a
//! second texture.

use cairn::framegen::shader::{GuidanceTextures, TexturePair};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, Planes, texture_from_picture};
use cairn::guidance::MotionOrigin;
use cairn::{Picture, Result};

use super::resources::{TestResource, upload_buffer, upload_texture, writable_texture};

/// Pixels of one guidance tile, in each direction.
const TILE: u32 = 8;

/// Buffers and textures of such frames. All are in COMMON between uses.
pub struct FrameScene {
    current: TestResource,
    decoded: TestResource,
    motion: TestResource,
    depth: TestResource,
    /// The resized picture.
    pub resized: TestResource,
    /// The generated frame.
    pub out: TestResource,
}

impl FrameScene {
    /// Width and height of the pictures in pixels.
    pub const SIZE: (u32, u32) = (96, 64);

    /// Resources on a device, with their contents.
    ///
    /// # Errors
    /// The device has no memory for them, or is removed.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let (width, height) = Self::SIZE;
        let pixel = |x: u32, y: u32| [(x * 5 + y) as u8, (y * 3 + x * x / 16) as u8, (x ^ y) as u8, 255];
        let bytes: Vec<u8> = (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x, y))).collect();
        let mut picture = Picture::new(width, height)?;
        picture.rgba_mut().copy_from_slice(&bytes);
        let (current, _) = texture_from_picture(gpu, &picture)?;
        // The same picture as planes of floats, so that it is no cut.
        let plane = |channel: usize| bytes.iter().skip(channel).step_by(4).map(|&byte| f32::from(byte) / 255.0);
        let planes: Vec<u8> = (0..3).flat_map(plane).flat_map(f32::to_le_bytes).collect();
        let tiles = (width / TILE, height / TILE);
        let count = (tiles.0 * tiles.1) as usize;
        let writable = || writable_texture(gpu, Self::SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
        Ok(Self {
            current: TestResource { resource: current, state: D3D12_RESOURCE_STATE_COMMON },
            decoded: upload_buffer(gpu, &planes),
            motion: upload_texture(gpu, tiles, DXGI_FORMAT_R16G16_FLOAT, &[0, 0x40, 0, 0].repeat(count)),
            depth: upload_texture(gpu, tiles, DXGI_FORMAT_R32_FLOAT, &0.5_f32.to_le_bytes().repeat(count)),
            resized: writable(),
            out: writable(),
        })
    }

    /// The decoded picture, which is resized into `resized`.
    pub fn planes(&self) -> Planes<'_> {
        Planes { buffer: self.decoded.with_state(), picture: 0, size: Self::SIZE, half: false }
    }

    /// The anchors of the generated frame: `resized` is the previous one.
    pub fn pair(&self) -> TexturePair<'_> {
        let guidance = GuidanceTextures {
            motion: self.motion.with_state(),
            motion_tile: TILE,
            depth: self.depth.with_state(),
            depth_tile: TILE,
            motion_origin: MotionOrigin::OpticalFlow,
            hud: None,
        };
        TexturePair {
            previous: self.resized.with_state(),
            current: self.current.with_state(),
            guidance,
            previous_depth: None,
            cut: false,
        }
    }
}
