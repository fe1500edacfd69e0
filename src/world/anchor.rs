//! Anchors that outlive the step that made them.

use super::rollout::Rollout;
use crate::runtime::Device;
use crate::{Error, ErrorKind, Picture, Result};

/// A copy of an anchor: its pictures, its latent and its place in the rollout. It stays as it is, whatever becomes of the
/// rollout.
#[derive(Debug, Clone)]
pub struct KeptAnchor {
    number: u64,
    latents_per_second: u32,
    cut: bool,
    /// In order of time; the last is the anchor itself.
    pictures: Vec<Picture>,
    shape: [u32; 3],
    latent: Vec<f32>,
    /// Where it was made.
    device: Option<Device>,
}

impl KeptAnchor {
    /// Copies what `rollout` made last. `cut` says that nothing leads to it from the anchor before.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent; `OutOfMemory` when there is no room for a copy; `Device` when it cannot be
    /// read.
    pub fn of(rollout: &mut Rollout, cut: bool) -> Result<Self> {
        let mut anchor = Self::room(rollout)?;
        anchor.copy(rollout, cut)?;
        Ok(anchor)
    }

    /// Memory for an anchor of `rollout`, before the step that makes it: what was made is not lost for want of room.
    ///
    /// # Errors
    /// `OutOfMemory`.
    pub(crate) fn room(rollout: &Rollout) -> Result<Self> {
        let point = rollout.operating_point();
        let (width, height) = rollout.world().render_size();
        let pictures =
            (0..point.pictures_per_latent).map(|_| Picture::new(width, height)).collect::<Result<Vec<_>>>()?;
        let shape = rollout.world().manifest().geometry.latent;
        let count = rollout.world().latent_len();
        let mut latent = Vec::new();
        latent
            .try_reserve_exact(count)
            .map_err(|_| Error::new(ErrorKind::OutOfMemory, format!("a latent of {count} numbers cannot be copied")))?;
        let shape = [shape.channels, shape.height, shape.width];
        let (latents_per_second, device) = (point.latents_per_second, Some(rollout.world().device().clone()));
        Ok(Self { number: 0, latents_per_second, cut: false, pictures, shape, latent, device })
    }

    /// Copies what `rollout`, whose room this is, made last. Allocates nothing that depends on the world.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub(crate) fn copy(&mut self, rollout: &mut Rollout, cut: bool) -> Result<()> {
        for (i, picture) in (0..).zip(&mut self.pictures) {
            rollout.read_picture(i, picture)?;
        }
        self.latent.clear();
        self.latent.extend_from_slice(rollout.latent()?);
        self.number = rollout.planner().latents().saturating_sub(1);
        self.cut = cut;
        Ok(())
    }

    /// An anchor of a picture that no world made: it has no latent and no rate.
    pub fn of_picture(picture: Picture, number: u64, cut: bool) -> Self {
        let pictures = vec![picture];
        Self { number, latents_per_second: 0, cut, pictures, shape: [0; 3], latent: Vec::new(), device: None }
    }

    /// The device it was made on; none for a picture that no world made.
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

    /// Whether nothing leads to it from the anchor before.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// Its pictures, in order of time; the last is the anchor itself. There is one at least.
    pub fn pictures(&self) -> &[Picture] {
        &self.pictures
    }

    /// The picture that the anchor is.
    pub fn picture(&self) -> &Picture {
        &self.pictures[self.pictures.len() - 1]
    }

    /// Its latent, `[channels, height, width]`; empty where it has none.
    pub fn latent(&self) -> &[f32] {
        &self.latent
    }

    /// Shape of its latent, `[channels, height, width]`; all 0 where it has none.
    pub fn latent_shape(&self) -> [u32; 3] {
        self.shape
    }
}
