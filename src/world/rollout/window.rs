//! Moves a rollout to another world of the same bundle with a longer or shorter context window.

use std::sync::Arc;

use super::Rollout;
use crate::allocate;
use crate::world::kv_cache::copy_slots;
use crate::world::operating_point::OperatingPoint;
use crate::world::world::World;
use crate::{Error, ErrorKind, Result};

impl Rollout {
    /// Continues in `world`: the same bundle at the same precision, loaded with another global window. With a shorter window the
    /// oldest latents are forgotten; with a longer one all are kept, and later ones are kept longer. Clocks, seed, schedule,
    /// the last latent and its pictures, and the decoder's memories stay. A pass sees the same as in a world that had this window
    /// from the start, except for latents that a shorter window has already forgotten.
    ///
    /// The rings are copied through host memory, and the memory of two rollouts is allocated during the call. Call it rarely, such as
    /// once in many seconds.
    ///
    /// # Errors
    /// `InvalidArgument` for a world of another bundle or precision; otherwise as [`Rollout::new`], and `Device` when the memory
    /// cannot be read. The rollout is unchanged then.
    pub fn move_to(&mut self, world: &Arc<World>) -> Result<()> {
        let refuse = |cause: &str| Err(Error::new(ErrorKind::InvalidArgument, cause).field("world"));
        if world.digest() != self.world.digest() {
            return refuse("it is another bundle's");
        }
        if world.precision() != self.world.precision() {
            return refuse("it computes in another precision");
        }
        self.device.check_restored()?;
        let point = OperatingPoint { global_window: world.global_window(), ..self.point.clone() };
        let freed = self.world.rollout_need();
        let mut moved = Self::with_stop(world, &point, self.planner.seed(), self.stop_flag().clone(), freed)?;
        moved.keep_encoder_stream(self.keeps_encoder_stream())?;
        let slots = moved.planner.take_over(&self.planner);
        let mut contents = Vec::new();
        for (to, from) in moved.device.state_buffers().zip(self.device.state_buffers()) {
            let mut bytes = allocate::zeroed(self.device.context.size(from))?;
            self.device.context.read(from, 0, &mut bytes)?;
            if self.device.is_global_ring(from) {
                let mut resized = allocate::zeroed(moved.device.context.size(to))?;
                copy_slots(&self.world.shapes, self.world.precision(), &bytes, &mut resized, &slots);
                bytes = resized;
            }
            contents.push((to, bytes));
        }
        let contents: Vec<_> = contents.iter().map(|(to, bytes)| (*to, bytes.as_slice())).collect();
        moved.device.context.replace(&contents)?;
        // Nothing fails from here on.
        moved.times = self.times.for_next_context(&mut *self.device.context, &self.world);
        moved.limits = std::mem::take(&mut self.limits);
        *self = moved;
        Ok(())
    }
}
