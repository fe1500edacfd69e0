//! Times and statistics of a rollout, across all worlds that it ran in.

use std::time::Instant;

#[cfg(windows)]
use crate::gpu::GpuTimeStatistics;
use crate::runtime::{Bytes, ExecutionContext};
#[cfg(windows)]
use crate::runtime::{ExternalTimes, Work};
use crate::world::latent_time::LatentTime;
use crate::world::plan::StepPlan;
use crate::world::statistics::{Stages, Statistics, StepInfo};
use crate::world::world::World;

/// Device time since a rollout was made, of work known to be complete; work that nobody has waited for is counted later.
#[cfg(windows)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceTimes {
    /// Encoder runs.
    pub encode: GpuTimeStatistics,
    /// Transformer passes: denoise passes and cache passes, which make K and V for the ring. A joined pass counts as one of each. In a world of several
    /// slices `longest` is the longest slice, and `last` the last one.
    pub passes: GpuTimeStatistics,
    /// Decoder runs, including those that only prime the decoder.
    pub decode: GpuTimeStatistics,
    /// Copies of new K and V into the ring.
    pub commit: GpuTimeStatistics,
    /// Wall time that was spent outside of this library's own code.
    pub external: ExternalTimes,
}

/// Statistics and device times of a rollout since it was made.
#[derive(Default)]
pub(super) struct Times {
    /// All steps. Its `bytes` are those of the contexts before the current one.
    statistics: Statistics,
    /// Device times of the contexts before the current one.
    #[cfg(windows)]
    earlier: DeviceTimes,
}

impl Times {
    pub(super) fn statistics(&self, context: &dyn ExecutionContext) -> Statistics {
        Statistics { bytes: self.statistics.bytes + context.bytes(), ..self.statistics }
    }

    /// Adds a step that has succeeded.
    pub(super) fn add_step(&mut self, step: &StepInfo) {
        self.statistics.latents += 1;
        self.statistics.stages.add(&step.stages);
        self.statistics.ring_bytes += step.ring_bytes;
    }

    /// Adds a picture that was read and resized between `start` and now.
    pub(super) fn add_picture(&mut self, start: Instant) {
        self.statistics.stages.resize.add(1, start);
    }

    /// The times to start with when the rollout moves to another context. `context`, of `world`, is its context so far.
    pub(super) fn for_next_context(&self, context: &mut dyn ExecutionContext, world: &World) -> Self {
        #[cfg(not(windows))]
        let _ = world;
        Self {
            statistics: self.statistics(context),
            #[cfg(windows)]
            earlier: self.device_times(context, world).unwrap_or_default(),
        }
    }

    #[cfg(windows)]
    pub(super) fn device_times(&self, context: &mut dyn ExecutionContext, world: &World) -> Option<DeviceTimes> {
        let mut gpu_time = |work| context.gpu_time(work);
        let mut slices = world.transformer.graphs().map(|graph| gpu_time(Work::Runs(graph)));
        let first = slices.next().flatten()?;
        let passes =
            slices.try_fold(first, |sum, slice| Some(GpuTimeStatistics { count: sum.count, ..sum.merge(slice?) }));
        let mut passes = passes?;
        for graph in world.joined.iter().flat_map(|joined| joined.graphs()) {
            let joined = gpu_time(Work::Runs(graph))?;
            passes = passes.merge(GpuTimeStatistics { count: 2 * joined.count, ..joined });
        }
        // What passes need of the controls is part of their time, and no pass of its own.
        let transformers = std::iter::once(&world.transformer).chain(&world.joined);
        for graph in transformers.filter_map(|transformer| transformer.controls()) {
            passes = GpuTimeStatistics { count: passes.count, ..passes.merge(gpu_time(Work::Runs(graph))?) };
        }
        let earlier = &self.earlier;
        Some(DeviceTimes {
            encode: earlier.encode.merge(gpu_time(Work::Runs(&world.encoder))?),
            passes: earlier.passes.merge(passes),
            decode: earlier.decode.merge(gpu_time(Work::Runs(&world.decoder))?),
            commit: earlier.commit.merge(gpu_time(Work::RecordedCopies)?),
            external: earlier.external.merge(context.external_times()?),
        })
    }

    /// The sum of all device times, and the part that passes took; `None` if the device does not measure them.
    pub(super) fn total_device_time(&self, context: &mut dyn ExecutionContext, world: &World) -> Option<LatentTime> {
        #[cfg(windows)]
        return self
            .device_times(context, world)
            .map(|DeviceTimes { encode, passes, decode, commit, .. }| LatentTime {
                total: encode.total + passes.total + decode.total + commit.total,
                passes: passes.total,
                count: passes.count,
            })
            .filter(|time| !time.total.is_zero());
        #[cfg(not(windows))]
        {
            let _ = (context, world);
            None
        }
    }
}

/// Times and bytes of one step so far.
pub(super) struct StepMeasurement {
    pub(super) stages: Stages,
    /// Bytes that the step copied into the rings.
    pub(super) ring_bytes: u64,
    /// The context's bytes before the step.
    bytes_before: Bytes,
}

impl StepMeasurement {
    pub(super) fn start(context: &dyn ExecutionContext) -> Self {
        Self { stages: Stages::default(), ring_bytes: 0, bytes_before: context.bytes() }
    }

    /// The statistics of the step of `plan`, which has succeeded.
    pub(super) fn finish(self, plan: &StepPlan, context: &dyn ExecutionContext) -> StepInfo {
        StepInfo {
            latent: plan.latent,
            committed: plan.pending.is_some() || plan.commits_itself(),
            stages: self.stages,
            bytes: context.bytes() - self.bytes_before,
            ring_bytes: self.ring_bytes,
        }
    }
}
