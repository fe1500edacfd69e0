//! Anchors that outlive the step that made them.

use super::rollout::Rollout;
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
}

impl KeptAnchor {
    /// Copies what `rollout` made last. `cut` says that nothing leads to it from the anchor before.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent; `OutOfMemory` when there is no room for a copy; `Device` when it cannot be
    /// read.
    pub fn of(rollout: &mut Rollout, cut: bool) -> Result<Self> {
        let point = rollout.operating_point().clone();
        let (width, height) = rollout.world().render_size();
        let mut pictures = Vec::new();
        for i in 0..point.pictures_per_latent {
            let mut picture = Picture::new(width, height)?;
            rollout.read_picture(i, &mut picture)?;
            pictures.push(picture);
        }
        let shape = rollout.world().manifest().geometry.latent;
        let values = rollout.latent()?;
        let mut latent = Vec::new();
        latent.try_reserve_exact(values.len()).map_err(|_| {
            Error::new(ErrorKind::OutOfMemory, format!("a latent of {} numbers cannot be copied", values.len()))
        })?;
        latent.extend_from_slice(values);
        Ok(Self {
            number: rollout.planner().latents().saturating_sub(1),
            latents_per_second: point.latents_per_second,
            cut,
            pictures,
            shape: [shape.channels, shape.height, shape.width],
            latent,
        })
    }

    /// An anchor of a picture that no world made: it has no latent and no rate.
    pub fn of_picture(picture: Picture, number: u64, cut: bool) -> Self {
        let pictures = vec![picture];
        Self { number, latents_per_second: 0, cut, pictures, shape: [0; 3], latent: Vec::new() }
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
