//! What an anchor keeps on a Direct3D 12 device. Windows only.

use half::f16;
use half::slice::HalfFloatSliceExt;
use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::super::convert;
use super::super::rollout::Rollout;
use crate::bundle::Precision;
use crate::gpu::FencePoint;
use crate::runtime::{Decoded, Snapshot};
use crate::{Picture, Result};

/// An anchor's latent and pictures where they were made.
#[derive(Debug)]
pub(super) struct OnDevice {
    snapshot: Snapshot,
    precision: Precision,
    numbers: usize,
}

impl OnDevice {
    /// Room for an anchor of `rollout`; none where its device is no Direct3D 12 one.
    pub(super) fn room(rollout: &mut Rollout) -> Result<Option<Self>> {
        let pictures = rollout.point.pictures_per_latent as usize;
        let snapshot = rollout.context.room_on_device(rollout.latent, pictures, rollout.world.render_size())?;
        let (precision, numbers) = (rollout.world.precision(), rollout.world.latent_len());
        Ok(snapshot.map(|snapshot| Self { snapshot, precision, numbers }))
    }

    /// Has what `rollout` made last copied; nothing waits for it and nothing comes down.
    pub(super) fn copy(&mut self, rollout: &mut Rollout) -> Result<()> {
        let world = &rollout.world;
        let temporal = world.manifest().geometry.autoencoder.temporal;
        let pictures: Vec<_> =
            (0..rollout.point.pictures_per_latent).map_while(|i| rollout.point.decoded_index(i, temporal)).collect();
        let decoded = Decoded {
            planes: rollout.autoencoder.pictures(),
            pictures: &pictures,
            size: world.decoded_size(),
            precision: self.precision,
        };
        rollout.context.keep_on_device(&decoded, rollout.latent, &mut self.snapshot)
    }

    pub(super) fn texture(&self, i: usize) -> Option<(&ID3D12Resource, &FencePoint)> {
        self.snapshot.texture(i)
    }

    pub(super) fn latent(&self) -> Option<(&ID3D12Resource, &FencePoint, bool)> {
        let (latent, fence_point) = self.snapshot.latent_buffer()?;
        Some((latent, fence_point, self.precision == Precision::F16))
    }

    /// Whether its copy has run.
    pub(super) fn has_arrived(&self) -> bool {
        self.snapshot.latent_buffer().is_none_or(|(_, fence_point)| fence_point.reached())
    }

    pub(super) fn read_picture(&self, i: usize) -> Result<Picture> {
        self.snapshot.read_picture(i)
    }

    pub(super) fn read_latent(&self) -> Result<Vec<f32>> {
        let mut latent = convert::zeroed::<f32>(self.numbers)?;
        match self.precision {
            Precision::F32 => self.snapshot.read_latent(bytemuck::cast_slice_mut(&mut latent))?,
            Precision::F16 => {
                let mut halves = convert::zeroed::<f16>(self.numbers)?;
                self.snapshot.read_latent(bytemuck::cast_slice_mut(&mut halves))?;
                halves.convert_to_f32_slice(&mut latent);
            }
        }
        Ok(latent)
    }
}
