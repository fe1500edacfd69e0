//! Device time of a rollout's work. Windows only.

use super::Rollout;
use crate::gpu::Spent;
use crate::runtime::{Captured, ExternalTimes, Work};

/// Device time since a rollout was made, of work known to be complete; work that nobody has waited for is counted later.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceTimes {
    /// Encoder runs.
    pub encode: Spent,
    /// Transformer passes: denoise passes and cache passes, which make K and V for the ring.
    pub passes: Spent,
    /// Decoder runs, including those that only prime the decoder.
    pub decode: Spent,
    /// Copies of new K and V into the ring.
    pub commit: Spent,
    /// Wall time that was spent outside of this library's own code.
    pub external: ExternalTimes,
}

impl Rollout {
    /// Device time by the device's own clock, from the first to the last command of each pass; `None` if the device is not a
    /// Direct3D 12 device. All zero if the queue for anchors has no timestamps. [`Statistics`](super::Statistics) has wall times.
    pub fn device_times(&mut self) -> Option<DeviceTimes> {
        let mut spent = |work| self.context.spent(work);
        let (world, before) = (&self.world, self.times_before);
        Some(DeviceTimes {
            encode: before.encode.and(spent(Work::Runs(&world.encoder))?),
            passes: before.passes.and(spent(Work::Runs(&world.transformer))?),
            decode: before.decode.and(spent(Work::Runs(&world.decoder))?),
            commit: before.commit.and(spent(Work::RecordedCopies)?),
            external: before.external.and(self.context.external()?),
        })
    }

    /// How many of its passes, each with its own buffers, run by graph capture, and why others do not; `None` if the device is not
    /// a Direct3D 12 device. [`DirectMlOptions::captured_passes`](crate::runtime::DirectMlOptions::captured_passes) turns it on.
    pub fn captured(&self) -> Option<Captured> {
        self.context.captured()
    }
}
