//! Uploads pictures and guidance for the generator on the device, and compares its frames with the processor's.

use std::fmt::Debug;

use cairn::framegen::shader::GuidanceTextures;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::{DepthMap, Guidance, MotionOrigin};
use cairn::{Pixel, Raster};
use half::f16;

use crate::resources::{TestResource, create_resource, texture_desc, upload_texture};

/// A pixel format that frames are compared in.
pub trait ComparablePixel: Pixel + bytemuck::Pod + Debug {
    /// The texture format of such pixels.
    const FORMAT: DXGI_FORMAT;

    /// The pixel with these levels of 255.
    fn from_levels(levels: [f32; 4]) -> Self;
    /// Whether two pixels differ by at most one level of 255.
    fn is_near(self, other: Self) -> bool;
}

impl ComparablePixel for [u8; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R8G8B8A8_UNORM;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| (v + 0.5) as u8)
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| a.abs_diff(b) <= 1)
    }
}

impl ComparablePixel for [f16; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R16G16B16A16_FLOAT;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| f16::from_f32(v / 255.0))
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| (a.to_f32() - b.to_f32()).abs() <= 1.0 / 255.0)
    }
}

/// A picture with these levels of 255.
pub fn raster<P: ComparablePixel>(size: (u32, u32), levels: &[[f32; 4]]) -> Raster<P> {
    let mut picture = Raster::new(size.0, size.1).expect("a picture");
    picture.pixels_mut().iter_mut().zip(levels).for_each(|(pixel, &levels)| *pixel = P::from_levels(levels));
    picture
}

/// The picture in a texture.
pub fn upload_picture<P: ComparablePixel>(gpu: &Gpu, picture: &Raster<P>) -> TestResource {
    upload_texture(gpu, picture.size(), P::FORMAT, bytemuck::cast_slice(picture.pixels()))
}

/// The depth map in a texture.
pub fn depth_texture(gpu: &Gpu, depth: &DepthMap) -> TestResource {
    upload_texture(gpu, (depth.columns(), depth.rows()), DXGI_FORMAT_R32_FLOAT, bytemuck::cast_slice(depth.depth()))
}

/// Guidance in textures.
pub struct DeviceGuidance {
    motion: TestResource,
    depth: TestResource,
    tiles: [u32; 2],
    motion_origin: MotionOrigin,
}

impl DeviceGuidance {
    /// Uploads the guidance.
    pub fn new(gpu: &Gpu, guidance: &Guidance) -> Self {
        let (field, depth) = (guidance.motion(), guidance.depth());
        let size = (field.columns(), field.vectors().len() as u32 / field.columns());
        let motion = upload_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, bytemuck::cast_slice(field.vectors()));
        Self {
            motion,
            depth: depth_texture(gpu, depth),
            tiles: [field.tile(), depth.tile()],
            motion_origin: guidance.origin(),
        }
    }

    /// The textures without an overlay mask.
    pub fn textures(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: self.motion.with_state(),
            motion_tile: self.tiles[0],
            depth: self.depth.with_state(),
            depth_tile: self.tiles[1],
            motion_origin: self.motion_origin,
            hud: None,
        }
    }
}

/// A render target that shaders cannot write.
pub fn target(gpu: &Gpu, size: (u32, u32), format: DXGI_FORMAT) -> TestResource {
    let state = D3D12_RESOURCE_STATE_RENDER_TARGET;
    let wanted = texture_desc(size, format, D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET);
    TestResource { resource: create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state }
}

/// Numbers of compared pixels, of pixels that are not equal, and of pixels that differ by more than a level.
#[derive(Default, Debug, Clone, Copy)]
pub struct Differences {
    /// Compared pixels.
    pub pixels: usize,
    /// Pixels that are not equal.
    pub unequal: usize,
    /// Pixels that differ by more than a level of 255.
    pub far: usize,
}

impl Differences {
    /// Compares a frame in bytes with a picture.
    pub fn compare<P: ComparablePixel>(&mut self, found: &[u8], wanted: &Raster<P>, what: &str) {
        let found: &[P] = bytemuck::cast_slice(found);
        let mut this = Self::default();
        for (&found, &wanted) in found.iter().zip(wanted.pixels()) {
            this.pixels += 1;
            this.unequal += usize::from(bytemuck::bytes_of(&found) != bytemuck::bytes_of(&wanted));
            this.far += usize::from(!found.is_near(wanted));
        }
        if this.far > 0 {
            println!("{what}: {this:?}");
        }
        self.pixels += this.pixels;
        self.unequal += this.unequal;
        self.far += this.far;
    }
}
