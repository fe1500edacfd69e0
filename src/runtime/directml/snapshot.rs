//! Copies of a latent and its pictures in device memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};

use crate::gpu::{FencePoint, Gpu, Heap, buffer, picture_texture, read_buffer, read_texture};
use crate::{Error, ErrorKind, Picture, Result};

/// Copies of a latent and its pictures, made on the device and kept there; they are read back only on request.
pub(crate) struct Snapshot {
    gpu: Gpu,
    /// RGBA8, in the state COMMON between command lists.
    textures: Vec<ID3D12Resource>,
    latent: ID3D12Resource,
    /// Reached when all copies are complete; `None` before they are submitted.
    fence_point: Option<FencePoint>,
    /// Counter of bytes read back from the context and its snapshots.
    read: Arc<AtomicU64>,
}

impl Snapshot {
    /// Allocates `pictures` textures of `size` and a latent buffer of `latent` bytes.
    pub(super) fn new(
        gpu: &Gpu,
        pictures: usize,
        size: (u32, u32),
        latent: usize,
        read: &Arc<AtomicU64>,
    ) -> Result<Self> {
        let textures = (0..pictures).map(|_| picture_texture(gpu, size)).collect::<Result<_>>()?;
        let latent = buffer(gpu, Heap::Device, latent)?;
        Ok(Self { gpu: gpu.clone(), textures, latent, fence_point: None, read: read.clone() })
    }

    pub(super) fn textures(&self) -> &[ID3D12Resource] {
        &self.textures
    }

    pub(super) fn latent(&self) -> &ID3D12Resource {
        &self.latent
    }

    pub(super) fn set_fence_point(&mut self, fence_point: FencePoint) {
        self.fence_point = Some(fence_point);
    }

    /// Picture `i` as a texture, and the fence point at which it is complete.
    pub(crate) fn texture(&self, i: usize) -> Option<(&ID3D12Resource, &FencePoint)> {
        self.textures.get(i).zip(self.fence_point.as_ref())
    }

    /// The latent in a buffer, in the state COMMON between command lists, and the fence point at which it is complete.
    pub(crate) fn latent_buffer(&self) -> Option<(&ID3D12Resource, &FencePoint)> {
        Some((&self.latent, self.fence_point.as_ref()?))
    }

    /// Waits for picture `i`, then reads it back.
    pub(crate) fn read_picture(&self, i: usize) -> Result<Picture> {
        let (texture, fence_point) = self.texture(i).ok_or_else(nothing_there)?;
        fence_point.wait()?;
        let picture = read_texture(&self.gpu, texture, D3D12_RESOURCE_STATE_COMMON)?;
        self.read.fetch_add(picture.rgba().len() as u64, Ordering::Relaxed);
        Ok(picture)
    }

    /// Waits for the latent, then reads back its first `into.len()` bytes.
    pub(crate) fn read_latent(&self, into: &mut [u8]) -> Result<()> {
        self.fence_point.as_ref().ok_or_else(nothing_there)?.wait()?;
        read_buffer(&self.gpu, &self.latent, into)?;
        self.read.fetch_add(into.len() as u64, Ordering::Relaxed);
        Ok(())
    }
}

impl Drop for Snapshot {
    fn drop(&mut self) {
        // The queue may still write to the resources that are freed next.
        if let Some(fence_point) = &self.fence_point {
            fence_point.wait_ignoring_loss();
        }
    }
}

impl std::fmt::Debug for Snapshot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Snapshot({} pictures, {:?})", self.textures.len(), self.fence_point)
    }
}

/// Does not occur: a snapshot is filled before anyone can read it.
fn nothing_there() -> Error {
    Error::new(ErrorKind::InvalidState, "nothing was kept on the device yet")
}
