//! A copy of an anchor in the memory of a Direct3D 12 device. Windows only.

use half::f16;
use half::slice::HalfFloatSliceExt;
use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::super::rollout::Rollout;
use crate::allocate;
use crate::bundle::Precision;
use crate::gpu::FencePoint;
use crate::runtime::Snapshot;
use crate::{Picture, Result};

/// An anchor's latent and pictures, in the memory of the device that made them.
#[derive(Debug)]
pub(super) struct DeviceCopy {
    snapshot: Snapshot,
    precision: Precision,
    /// Number of values of the latent.
    latent_len: usize,
}

impl DeviceCopy {
    /// Allocates memory for an anchor of `rollout`; `None` if its device is not a Direct3D 12 device.
    pub(super) fn allocate(rollout: &mut Rollout) -> Result<Option<Self>> {
        let snapshot = rollout.allocate_snapshot()?;
        let (precision, latent_len) = (rollout.world().precision(), rollout.world().latent_len());
        Ok(snapshot.map(|snapshot| Self { snapshot, precision, latent_len }))
    }

    /// Submits copies of the last latent and pictures of `rollout`. Does not wait, and reads nothing back.
    pub(super) fn fill(&mut self, rollout: &mut Rollout) -> Result<()> {
        rollout.fill_snapshot(&mut self.snapshot)
    }

    pub(super) fn texture(&self, i: usize) -> Option<(&ID3D12Resource, &FencePoint)> {
        self.snapshot.texture(i)
    }

    pub(super) fn latent(&self) -> Option<(&ID3D12Resource, &FencePoint, bool)> {
        let (latent, fence_point) = self.snapshot.latent_buffer()?;
        Some((latent, fence_point, self.precision == Precision::F16))
    }

    /// Whether its copies are complete.
    pub(super) fn is_complete(&self) -> bool {
        self.snapshot.latent_buffer().is_none_or(|(_, fence_point)| fence_point.reached())
    }

    pub(super) fn read_picture(&self, i: usize) -> Result<Picture> {
        self.snapshot.read_picture(i)
    }

    pub(super) fn read_latent(&self) -> Result<Vec<f32>> {
        let mut latent = allocate::zeroed::<f32>(self.latent_len)?;
        match self.precision {
            Precision::F32 => self.snapshot.read_latent(bytemuck::cast_slice_mut(&mut latent))?,
            Precision::F16 => {
                let mut halves = allocate::zeroed::<f16>(self.latent_len)?;
                self.snapshot.read_latent(bytemuck::cast_slice_mut(&mut halves))?;
                halves.convert_to_f32_slice(&mut latent);
            }
        }
        Ok(latent)
    }
}
