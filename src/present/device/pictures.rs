//! Pictures in memory made larger by a device: for tools, which have no textures.
//!
//! Everything goes to the device and comes back for every picture, and each is waited for.

use windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;

use super::resource_cache::Textures;
use super::upsampler::{Small, Upsampler};
use crate::ffx::{Api, Choice, Version};
use crate::framegen::device::textures_of;
use crate::gpu::{Gpu, read_texture, texture_of};
use crate::guidance::Guidance;
use crate::{Error, ErrorKind, Picture, Result};

/// Makes pictures of a stream larger by AMD's upscaler, each from what it and those before it show, as a presenter makes anchors.
pub struct PictureUpscaler {
    gpu: Gpu,
    enlarger: Upsampler,
    from: (u32, u32),
    interval_ms: f32,
    /// Which picture is next; what starts anew skips one.
    next: u64,
}

impl PictureUpscaler {
    /// For pictures of the size `from` that are to have the size `to`, so many milliseconds of the world's time apart.
    ///
    /// # Errors
    /// `InvalidArgument` for a size that is smaller; as of [`TextureUpscaler::new`](crate::ffx::TextureUpscaler::new).
    pub fn new(
        gpu: &Gpu,
        api: &Api,
        choice: Choice,
        from: (u32, u32),
        to: (u32, u32),
        interval_ms: f32,
    ) -> Result<Self> {
        if to.0 < from.0 || to.1 < from.1 {
            let why = format!("{} x {} pixels are not made smaller, as {} x {} are", from.0, from.1, to.0, to.1);
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("size").remedy("Have them resized in space"));
        }
        let enlarger = Upsampler::new(gpu, api, choice, from, to)?;
        Ok(Self { gpu: gpu.clone(), enlarger, from, interval_ms, next: 0 })
    }

    /// What runs.
    pub fn version(&self) -> &Version {
        self.enlarger.version()
    }

    /// The next picture of the stream, larger. `guidance` leads to it from the one before; None where nothing does, as at a cut.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture or guidance of another size; what the library answers; `OutOfMemory`, `DeviceRemoved`.
    pub fn upscale(&mut self, picture: &Picture, guidance: Option<&Guidance>) -> Result<Picture> {
        let sizes = [Some((picture.size(), "picture")), guidance.map(|guidance| (guidance.size(), "guidance"))];
        for (size, field) in sizes.into_iter().flatten() {
            if size != self.from {
                let (has, wants) = (size, self.from);
                let why = format!("{} x {} pixels, and not {} x {}", has.0, has.1, wants.0, wants.1);
                return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
            }
        }
        let (texture, _) = texture_of(&self.gpu, picture)?;
        let lead = guidance.map(|guidance| {
            let [motion, depth] = textures_of(&self.gpu, guidance)?;
            let textures = Textures {
                motion,
                motion_tile: guidance.motion().tile(),
                depth,
                depth_tile: guidance.depth().tile(),
                depth_is_even: guidance.depth().even().is_some(),
            };
            Ok::<_, Error>((textures, guidance.depth().projection()))
        });
        let lead = lead.transpose()?;
        let place = Some((0, self.next + u64::from(lead.is_none())));
        self.next = place.map_or(0, |(_, number)| number + 1);
        let lead = lead.as_ref().map(|(textures, projection)| (textures, *projection));
        let small = Small { place, picture: &texture, lead, interval_ms: self.interval_ms };
        let larger = self.enlarger.anchor(&small)?;
        self.gpu.frames().now()?.wait()?;
        read_texture(&self.gpu, &larger, D3D12_RESOURCE_STATE_COMMON)
    }
}

impl std::fmt::Debug for PictureUpscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PictureUpscaler({:?} to {:?}, {})", self.from, self.enlarger.to(), self.version())
    }
}
