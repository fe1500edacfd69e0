//! Copies of anchors that outlive the next step.

#[cfg(windows)]
mod device_copy;

use std::sync::OnceLock;

use super::rollout::Rollout;
use crate::allocate;
use crate::runtime::Device;
use crate::{Error, ErrorKind, Picture, Result};

/// A copy of an anchor: its pictures, its latent and its number in the rollout. It does not change when the rollout continues.
///
/// On a Direct3D 12 device the copy is in device memory: pictures are textures, and each is read back when it is read for the first
/// time. A shader resizes them, which may differ from [`Rollout::read_picture`] by one step of 255.
///
/// Threads: may be used from any thread at any time.
#[derive(Debug)]
pub struct KeptAnchor {
    number: u64,
    latents_per_second: u32,
    cut: bool,
    size: (u32, u32),
    /// In order of time; the last is the anchor itself. An entry is empty until a picture on the device is read back.
    pictures: Vec<OnceLock<Picture>>,
    shape: [u32; 3],
    latent: OnceLock<Vec<f32>>,
    /// The device that made it; `None` for a picture that no world made.
    device: Option<Device>,
    #[cfg(windows)]
    device_copy: Option<device_copy::DeviceCopy>,
}

impl KeptAnchor {
    /// Copies the last latent and pictures of `rollout`. `cut`: there is no continuous motion from the anchor before.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent; `OutOfMemory` when there is no memory for a copy; `Device` when the result cannot
    /// be read.
    pub fn of(rollout: &mut Rollout, cut: bool) -> Result<Self> {
        let mut anchor = Self::allocate(rollout)?;
        anchor.fill(rollout, cut)?;
        Ok(anchor)
    }

    /// Allocates memory for an anchor of `rollout`. It is called before the step, so that the step's result is not lost when memory
    /// is exhausted.
    ///
    /// # Errors
    /// `OutOfMemory`.
    pub(crate) fn allocate(rollout: &mut Rollout) -> Result<Self> {
        #[cfg(windows)]
        let device_copy = device_copy::DeviceCopy::allocate(rollout)?;
        rollout.prepare_read_picture()?;
        let point = rollout.operating_point();
        let size = rollout.world().render_size();
        let shape = rollout.world().manifest().geometry.latent;
        #[cfg(windows)]
        let on_host = device_copy.is_none();
        #[cfg(not(windows))]
        let on_host = true;
        let picture = || if on_host { Picture::new(size.0, size.1).map(OnceLock::from) } else { Ok(OnceLock::new()) };
        let pictures = (0..point.pictures_per_latent).map(|_| picture()).collect::<Result<Vec<_>>>()?;
        let latent = OnceLock::new();
        if on_host {
            let mut values = Vec::new();
            allocate::reserve(&mut values, rollout.world().latent_len())?;
            _ = latent.set(values);
        }
        let (latents_per_second, device) = (point.latents_per_second, Some(rollout.world().device().clone()));
        let shape = [shape.channels, shape.height, shape.width];
        Ok(Self {
            number: 0,
            latents_per_second,
            cut: false,
            size,
            pictures,
            shape,
            latent,
            device,
            #[cfg(windows)]
            device_copy,
        })
    }

    /// Copies the last latent and pictures of `rollout` into memory that [`allocate`](Self::allocate) made for it. Allocates nothing
    /// whose size depends on the world.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub(crate) fn fill(&mut self, rollout: &mut Rollout, cut: bool) -> Result<()> {
        rollout.check_started()?;
        #[cfg(windows)]
        if let Some(device_copy) = &mut self.device_copy {
            device_copy.fill(rollout)?;
        }
        for (i, picture) in (0..).zip(&mut self.pictures) {
            if let Some(picture) = picture.get_mut() {
                rollout.read_picture(i, picture)?;
            }
        }
        if let Some(latent) = self.latent.get_mut() {
            latent.clear();
            latent.extend_from_slice(rollout.latent()?);
        }
        self.number = rollout.planner().latents().saturating_sub(1);
        self.cut = cut;
        Ok(())
    }

    /// An anchor from a picture that no world made: it has no latent and no rate.
    pub fn of_picture(picture: Picture, number: u64, cut: bool) -> Self {
        Self {
            number,
            latents_per_second: 0,
            cut,
            size: picture.size(),
            pictures: vec![OnceLock::from(picture)],
            shape: [0; 3],
            latent: OnceLock::from(Vec::new()),
            device: None,
            #[cfg(windows)]
            device_copy: None,
        }
    }

    /// The device that made it; `None` for a picture that no world made.
    pub fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    /// Number of its latent in the rollout, from 0.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Latents per second of world time; 0 for a picture that no world made.
    pub fn latents_per_second(&self) -> u32 {
        self.latents_per_second
    }

    /// Whether there is no continuous motion from the anchor before.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// `(width, height)` of its pictures.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Number of its pictures, in order of time; the last is the anchor itself. At least one.
    pub fn count(&self) -> usize {
        self.pictures.len()
    }

    /// Picture `i`, from 0; waits for it if only the device has it.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture that does not exist; `OutOfMemory`, `Device`, `DeviceRemoved` when it cannot be read back.
    pub fn read(&self, i: usize) -> Result<&Picture> {
        let picture = self.pictures.get(i).ok_or_else(|| {
            let cause = format!("there is no picture {i}; the anchor has {}", self.count());
            Error::new(ErrorKind::InvalidArgument, cause).field("i").remedy("Count from 0")
        })?;
        match picture.get() {
            Some(picture) => Ok(picture),
            None => {
                let read = self.read_from_device(i)?;
                Ok(picture.get_or_init(|| read))
            }
        }
    }

    /// The anchor's own picture, which is the last.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn picture(&self) -> Result<&Picture> {
        self.read(self.count() - 1)
    }

    /// Its latent, `[channels, height, width]`; empty if it has none. Waits for it if only the device has it.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn latent(&self) -> Result<&[f32]> {
        match self.latent.get() {
            Some(latent) => Ok(latent),
            None => {
                let read = self.read_latent_from_device()?;
                Ok(self.latent.get_or_init(|| read))
            }
        }
    }

    /// Shape of its latent, `[channels, height, width]`; all 0 if it has none.
    pub fn latent_shape(&self) -> [u32; 3] {
        self.shape
    }

    /// Picture `i` as a texture of its size, RGBA8, that does not change, and the fence point at which it is complete. `None` if
    /// the anchor was not made on a Direct3D 12 device, or has no such picture.
    #[cfg(windows)]
    pub fn texture(
        &self,
        i: usize,
    ) -> Option<(&windows::Win32::Graphics::Direct3D12::ID3D12Resource, &crate::gpu::FencePoint)> {
        self.device_copy.as_ref()?.texture(i)
    }

    /// Its latent as a buffer, the fence point at which it is complete, and whether its values are f16 instead of f32. `None` as
    /// for [`texture`](Self::texture).
    #[cfg(windows)]
    pub(crate) fn latent_buffer(
        &self,
    ) -> Option<(&windows::Win32::Graphics::Direct3D12::ID3D12Resource, &crate::gpu::FencePoint, bool)> {
        self.device_copy.as_ref()?.latent()
    }

    /// Whether the device has completed its copies. Always true if they are in host memory.
    pub fn is_complete(&self) -> bool {
        #[cfg(windows)]
        if let Some(device_copy) = &self.device_copy {
            return device_copy.is_complete();
        }
        true
    }

    #[cfg(windows)]
    fn read_from_device(&self, i: usize) -> Result<Picture> {
        self.device_copy.as_ref().ok_or_else(no_data)?.read_picture(i)
    }

    #[cfg(windows)]
    fn read_latent_from_device(&self) -> Result<Vec<f32>> {
        self.device_copy.as_ref().ok_or_else(no_data)?.read_latent()
    }

    #[cfg(not(windows))]
    fn read_from_device(&self, _: usize) -> Result<Picture> {
        Err(no_data())
    }

    #[cfg(not(windows))]
    fn read_latent_from_device(&self) -> Result<Vec<f32>> {
        Err(no_data())
    }
}

/// Cannot occur: data that is not in host memory is in device memory.
fn no_data() -> Error {
    Error::new(ErrorKind::InvalidState, "the anchor is nowhere")
}
