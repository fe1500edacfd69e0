//! Reads a rollout's last latent and its pictures back from the device.

use std::cell::{Cell, OnceCell};

use super::device_state::DeviceState;
use crate::allocate;
use crate::world::resize::Bilinear;
use crate::world::world::World;
use crate::{Picture, Result};

/// Host memory for results, reused from step to step so that reading allocates nothing.
pub(super) struct Readback {
    /// The last finished latent, once it was read.
    latent: OnceCell<Vec<f32>>,
    /// Memory of an earlier latent, for the next one; empty while `latent` uses it.
    spare_latent: Cell<Vec<f32>>,
    /// One decoded picture, `[3, H, W]`.
    planes: Vec<f32>,
    to_render: Bilinear,
}

impl Readback {
    pub(super) fn new(world: &World) -> Result<Self> {
        Ok(Self {
            latent: OnceCell::new(),
            spare_latent: Cell::new(allocate::zeroed(world.latent_len())?),
            planes: allocate::zeroed(world.shapes.picture_len())?,
            to_render: Bilinear::new(world.decoded_size(), world.render_size()),
        })
    }

    /// The last latent. Waits for the device the first time it is read after a step.
    pub(super) fn latent(&self, device: &DeviceState, world: &World) -> Result<&[f32]> {
        if let Some(latent) = self.latent.get() {
            return Ok(latent);
        }
        let mut latent = self.spare_latent.take();
        if latent.is_empty() {
            latent = allocate::zeroed(world.latent_len())?;
        }
        device.read_latent(&mut latent)?;
        Ok(self.latent.get_or_init(|| latent))
    }

    /// Forgets the latent that was read, because the device has another one now.
    pub(super) fn forget_latent(&mut self) {
        if let Some(latent) = self.latent.take() {
            self.spare_latent.set(latent);
        }
    }

    /// Makes what reading a picture needs on the device, before the step whose picture it is.
    pub(super) fn prepare_read_picture(&self, device: &mut DeviceState) -> Result<()> {
        device.prepare_read_picture(&self.to_render)
    }

    /// Reads decoded picture `index` and resizes it to render size; waits for it. `picture` is replaced if it has another size.
    pub(super) fn read_picture(
        &mut self,
        device: &mut DeviceState,
        world: &World,
        index: usize,
        picture: &mut Picture,
    ) -> Result<()> {
        let (width, height) = world.render_size();
        if picture.size() != (width, height) {
            *picture = Picture::new(width, height)?;
        }
        if device.read_picture(index, &self.to_render, picture)? {
            return Ok(());
        }
        device.read_decoded(index, &mut self.planes)?;
        self.to_render.to_picture(&self.planes, picture);
        Ok(())
    }
}
