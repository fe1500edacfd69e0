//! Pictures for both generators: upload to the device, and comparison.

use std::fmt::Debug;

use cairn::framegen::shader::GuidanceTextures;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::{DepthMap, Guidance};
use cairn::{Pixel, Raster};
use half::f16;

use crate::pictures::{Kept, filled, flat, made};

/// A pixel format that frames are compared in.
pub(crate) trait Compared: Pixel + bytemuck::Pod + Debug {
    const FORMAT: DXGI_FORMAT;
    fn from_levels(levels: [f32; 4]) -> Self;
    /// Whether two are within one level of 255.
    fn is_near(self, other: Self) -> bool;
}

impl Compared for [u8; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R8G8B8A8_UNORM;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| (v + 0.5) as u8)
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| a.abs_diff(b) <= 1)
    }
}

impl Compared for [f16; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R16G16B16A16_FLOAT;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| f16::from_f32(v / 255.0))
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| (a.to_f32() - b.to_f32()).abs() <= 1.0 / 255.0)
    }
}

pub(crate) fn raster<P: Compared>(size: (u32, u32), levels: &[[f32; 4]]) -> Raster<P> {
    let mut picture = Raster::new(size.0, size.1).expect("a picture");
    picture.pixels_mut().iter_mut().zip(levels).for_each(|(pixel, &levels)| *pixel = P::from_levels(levels));
    picture
}

pub(crate) fn textured<P: Compared>(gpu: &Gpu, picture: &Raster<P>) -> Kept {
    filled(gpu, picture.size(), P::FORMAT, bytemuck::cast_slice(picture.pixels()))
}

pub(crate) fn depth_texture(gpu: &Gpu, depth: &DepthMap) -> Kept {
    filled(gpu, (depth.columns(), depth.rows()), DXGI_FORMAT_R32_FLOAT, bytemuck::cast_slice(depth.depth()))
}

/// Guidance on the device.
pub(crate) struct Guided {
    motion: Kept,
    depth: Kept,
    tiles: [u32; 2],
    depth_is_even: bool,
}

impl Guided {
    pub(crate) fn new(gpu: &Gpu, guidance: &Guidance) -> Self {
        let (field, depth) = (guidance.motion(), guidance.depth());
        let size = (field.columns(), field.vectors().len() as u32 / field.columns());
        let motion = filled(gpu, size, DXGI_FORMAT_R16G16_FLOAT, bytemuck::cast_slice(field.vectors()));
        Self {
            motion,
            depth: depth_texture(gpu, depth),
            tiles: [field.tile(), depth.tile()],
            depth_is_even: depth.even().is_some(),
        }
    }

    pub(crate) fn textures(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: self.motion.resting(),
            motion_tile: self.tiles[0],
            depth: self.depth.resting(),
            depth_tile: self.tiles[1],
            depth_is_even: self.depth_is_even,
            hud: None,
        }
    }
}

/// A render target that shaders cannot write.
pub(crate) fn target(gpu: &Gpu, size: (u32, u32), format: DXGI_FORMAT) -> Kept {
    let state = D3D12_RESOURCE_STATE_RENDER_TARGET;
    let wanted = flat(size, format, D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET);
    Kept { resource: made(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state }
}

/// Counts pixels, those that differ, and those that differ by more than the tolerance.
#[derive(Default, Debug)]
pub(crate) struct Tally {
    pub(crate) pixels: usize,
    unequal: usize,
    pub(crate) far: usize,
}

impl Tally {
    pub(crate) fn compare<P: Compared>(&mut self, found: &[u8], wanted: &Raster<P>, what: &str) {
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
