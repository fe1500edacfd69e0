//! Upscales pictures in memory on a device: for tools, which have no textures.
//!
//! Each picture is uploaded, upscaled and read back, and the caller waits for it.

use windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;

use super::inputs::OwnedGuidance;
use super::upsampler::{LowResolutionAnchor, Upsampler};
use crate::ffx::{Api, Choice, Version};
use crate::framegen::AnchorId;
use crate::framegen::device::guidance_textures;
use crate::gpu::{Gpu, read_texture, texture_from_picture};
use crate::guidance::Guidance;
use crate::{Error, ErrorKind, Picture, Result};

/// Upscales the pictures of a stream with AMD's temporal upscaler, as a presenter upscales anchors.
pub struct PictureUpscaler {
    gpu: Gpu,
    upsampler: Upsampler,
    from: (u32, u32),
    interval_ms: f32,
    /// Index of the next picture; a picture without guidance skips one index, so that the upscaler restarts its history.
    next: u64,
}

impl PictureUpscaler {
    /// Creates an upscaler from pictures of the size `from` to the size `to`; `interval_ms` is the world time between two pictures in milliseconds.
    ///
    /// # Errors
    /// `InvalidArgument` if `to` is smaller than `from`; as of [`TextureUpscaler::new`](crate::ffx::TextureUpscaler::new).
    pub fn new(
        gpu: &Gpu,
        api: &Api,
        choice: Choice,
        from: (u32, u32),
        to: (u32, u32),
        interval_ms: f32,
    ) -> Result<Self> {
        if to.0 < from.0 || to.1 < from.1 {
            let cause = format!("{} x {} pixels are not made smaller, as {} x {} are", from.0, from.1, to.0, to.1);
            return Err(Error::new(ErrorKind::InvalidArgument, cause)
                .field("size")
                .remedy("Have them resized in space"));
        }
        let upsampler = Upsampler::new(gpu, api, choice, from, to)?;
        Ok(Self { gpu: gpu.clone(), upsampler, from, interval_ms, next: 0 })
    }

    /// The version of the upscaler in use.
    pub fn version(&self) -> &Version {
        self.upsampler.version()
    }

    /// Upscales the next picture of the stream. `guidance` leads from it back to the picture before; `None` at the start and after a cut.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture or guidance of another size; errors of AMD's library; `OutOfMemory`, `DeviceRemoved`.
    pub fn upscale(&mut self, picture: &Picture, guidance: Option<&Guidance>) -> Result<Picture> {
        let sizes = [Some((picture.size(), "picture")), guidance.map(|guidance| (guidance.size(), "guidance"))];
        for (size, field) in sizes.into_iter().flatten() {
            if size != self.from {
                let (has, wants) = (size, self.from);
                let cause = format!("{} x {} pixels, and not {} x {}", has.0, has.1, wants.0, wants.1);
                return Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
            }
        }
        let (texture, _) = texture_from_picture(&self.gpu, picture)?;
        let uploaded = guidance.map(|guidance| {
            let [motion, depth] = guidance_textures(&self.gpu, guidance)?;
            let textures = OwnedGuidance {
                motion,
                motion_tile: guidance.motion().tile(),
                depth,
                depth_tile: guidance.depth().tile(),
                motion_origin: guidance.origin(),
            };
            Ok::<_, Error>((textures, guidance.depth().projection()))
        });
        let uploaded = uploaded.transpose()?;
        let index = self.next + u64::from(uploaded.is_none());
        self.next = index + 1;
        let guidance = uploaded.as_ref().map(|(textures, projection)| (textures, *projection));
        let id = Some(AnchorId { epoch: 0, index });
        let source = LowResolutionAnchor { id, picture: &texture, guidance, interval_ms: self.interval_ms };
        let upscaled = self.upsampler.anchor(&source)?;
        self.gpu.frames().signal()?.wait()?;
        read_texture(&self.gpu, &upscaled, D3D12_RESOURCE_STATE_COMMON)
    }
}

impl std::fmt::Debug for PictureUpscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PictureUpscaler({:?} to {:?}, {})", self.from, self.upsampler.to(), self.version())
    }
}
