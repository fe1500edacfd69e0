//! Time of a rollout's work on the device itself. Windows only.

use super::Rollout;
use crate::gpu::Spent;
use crate::runtime::{Captured, ExternalTimes, Work};

/// Time on the device since a rollout was made, of what is known to be done: work that nobody has waited for is counted later.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceTimes {
    /// Pictures made latents.
    pub encode: Spent,
    /// Passes of the transformer, those that denoise and those that make K and V for the ring.
    pub passes: Spent,
    /// Latents made pictures, those that only prime the decoder among them.
    pub decode: Spent,
    /// Copies of new K and V into the ring.
    pub commit: Spent,
    /// What the processor did meanwhile that is not the library's own work.
    pub external: ExternalTimes,
}

impl Rollout {
    /// Time on the device by its own clock, from the first to the last command of each pass; none on a device that is no Direct3D
    /// 12 one. All is zero where the queue for anchors has no clock. [`Statistics`](super::Statistics) has the processor's view.
    pub fn device_times(&mut self) -> Option<DeviceTimes> {
        let mut spent = |work| self.context.spent(work);
        let (world, before) = (&self.world, self.times_before);
        Some(DeviceTimes {
            encode: before.encode.and(spent(Work::Runs(&world.encoder))?),
            passes: before.passes.and(spent(Work::Runs(&world.transformer))?),
            decode: before.decode.and(spent(Work::Runs(&world.decoder))?),
            commit: before.commit.and(spent(Work::Repeated)?),
            external: before.external.and(self.context.external()?),
        })
    }

    /// Which of its passes, each with buffers of its own, run by graph capture, and why others do not; none on a device that is no
    /// Direct3D 12 one. [`DirectMlOptions::captured_passes`](crate::runtime::DirectMlOptions::captured_passes) is the switch.
    pub fn captured(&self) -> Option<Captured> {
        self.context.captured()
    }
}
