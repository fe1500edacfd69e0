//! The rollout: one running instance of a world.
//!
//! A [`Rollout`] owns its plan and its operating point, and calls its parts: `device_state` does the work on the device, `readback`
//! reads results, `times` measures, and `limits` holds budgets. Three files add calls of their own to [`Rollout`]: `govern` keeps the
//! limits, `state` saves and restores, and `window` moves to another world.

mod device_state;
#[cfg(test)]
mod fake_device_tests;
#[cfg(test)]
mod fault_tests;
mod govern;
mod limits;
mod readback;
mod state;
mod times;
mod window;
// The crate `test-support` cannot be used here: its types are those of another copy of this library.
#[cfg(test)]
#[path = "../../../tests/support/src/worlds.rs"]
#[allow(dead_code, unreachable_pub, reason = "the crate has all of it")]
pub(super) mod worlds;

use std::borrow::Borrow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use self::device_state::DeviceState;
pub use self::device_state::Probe;
use self::limits::Limits;
use self::readback::Readback;
#[cfg(windows)]
pub use self::times::DeviceTimes;
use self::times::{StepMeasurement, Times};
use super::controls::ControlInput;
use super::kv_cache::KvPart;
use super::operating_point::OperatingPoint;
use super::plan::{Planner, StepPlan};
use super::statistics::{Statistics, StepInfo};
use super::world::World;
use crate::allocate;
#[cfg(windows)]
use crate::runtime::{CaptureStatistics, Snapshot};
use crate::{Error, ErrorKind, Picture, Result};

/// One running instance of a world: KV ring, clocks, noise seed, autoencoder memories.
///
/// Every call either succeeds or, when it fails, leaves the rollout unchanged; only a lost device is an exception.
///
/// Threads: a rollout may move between threads and is used by one at a time. Rollouts of one world may run at the same
/// time.
pub struct Rollout {
    // Fields are dropped in this order. `world` may be dropped before `device`, whose context holds the graphs and the device itself.
    // `limits` is dropped last: it may hold the last references to worlds, and the context has waited for all work by then.
    world: Arc<World>,
    point: OperatingPoint,
    planner: Planner,
    device: DeviceState,
    /// Reused from step to step to avoid allocations.
    plan: StepPlan,
    readback: Readback,
    times: Times,
    stop: Arc<AtomicBool>,
    limits: Limits,
}

impl Rollout {
    /// A rollout at its start: empty rings, clocks at zero, decoder unprimed. `seed` decides all noise.
    ///
    /// # Errors
    /// `InvalidArgument` when the operating point does not fit the world, or has another global window than the world was loaded
    /// with; `OutOfMemory`, with figures, when its memory cannot be allocated; `Device` when ONNX Runtime refuses a binding.
    pub fn new(world: &Arc<World>, point: &OperatingPoint, seed: u64) -> Result<Self> {
        Self::with_stop(world, point, seed, Arc::default(), 0)
    }

    /// As [`new`](Self::new), with the flag that stops its steps. It replaces another rollout, whose `freed` bytes become free
    /// afterwards.
    fn with_stop(
        world: &Arc<World>,
        point: &OperatingPoint,
        seed: u64,
        stop: Arc<AtomicBool>,
        freed: u64,
    ) -> Result<Self> {
        world.check_point(point)?;
        world.check_rollout_fits(freed)?;
        let planner = Planner::new(world.manifest(), point, seed)?;
        world.prepare_levels(planner.sigma_table())?;
        let mut device = DeviceState::new(world, stop.clone())?;
        device.prepare_levels(planner.sigma_table())?;
        Ok(Self {
            planner,
            point: point.clone(),
            device,
            plan: StepPlan::default(),
            readback: Readback::new(world)?,
            times: Times::default(),
            stop,
            limits: Limits::None,
            world: world.clone(),
        })
    }

    /// Appends a still picture of any size, as the seed or later in a rollout. The picture is resized to the autoencoder's size,
    /// without regard to its aspect ratio, encoded, committed by a cache pass of its own at sigma 0 with idle controls (with
    /// joined passes, in the next step), and decoded.
    ///
    /// # Errors
    /// `Device` when a pass fails or gives a value that is not finite; `Unsupported` when a clock has run out.
    pub fn append(&mut self, picture: &Picture) -> Result<StepInfo> {
        self.append_pictures(&[picture])
    }

    /// Appends consecutive pictures, the oldest first, as one latent: as many as a latent has, so that a moving scene keeps moving.
    /// A single one is a still, as in [`append`](Self::append).
    ///
    /// # Errors
    /// As [`append`](Self::append), and `InvalidArgument` for another number of pictures.
    pub fn append_pictures(&mut self, pictures: &[impl Borrow<Picture>]) -> Result<StepInfo> {
        self.with_plan(
            |planner, plan| planner.plan_append_into(plan),
            |rollout, plan| {
                let mut measured = StepMeasurement::start(&*rollout.device.context);
                let start = Instant::now();
                rollout.device.encode_for_append(pictures)?;
                measured.stages.encode.add(1, start);
                let info = rollout.finish(plan, measured)?;
                rollout.device.commit_encoding();
                Ok(info)
            },
        )
    }

    /// Sets whether the encoder continues from one appended picture to the next, as the released engine's does, or starts anew with
    /// each, which is the default. The stream starts at this call and at each reset; it is part of a saved state.
    ///
    /// # Errors
    /// `Unsupported` if the bundle's encoder does not take its memories as inputs; `Device` when the device is lost.
    pub fn keep_encoder_stream(&mut self, keep: bool) -> Result<()> {
        self.device.keep_encoder_stream(keep)
    }

    /// Whether the encoder's stream is kept; see [`keep_encoder_stream`](Self::keep_encoder_stream).
    pub fn keeps_encoder_stream(&self) -> bool {
        self.device.keeps_encoder_stream()
    }

    /// Appends a latent, `[C, h, w]`, as [`append`](Self::append) does with an encoded picture.
    ///
    /// # Errors
    /// As [`append`](Self::append), and `InvalidArgument` for another length or a value that is not finite.
    pub fn append_latent(&mut self, latent: &[f32]) -> Result<StepInfo> {
        self.with_plan(
            |planner, plan| planner.plan_append_into(plan),
            |rollout, plan| rollout.execute_append(plan, latent),
        )
    }

    /// Makes the next latent with these controls.
    ///
    /// # Errors
    /// As [`append`](Self::append).
    pub fn step(&mut self, input: &ControlInput) -> Result<StepInfo> {
        self.apply_decision();
        self.step_as_decided(input)
    }

    /// As [`step`](Self::step), without applying its governor's decision, which may replace the context that memory belongs to.
    pub(super) fn step_as_decided(&mut self, input: &ControlInput) -> Result<StepInfo> {
        let start = self.start_latent();
        let info = self.with_plan(|planner, plan| planner.plan_step_into(input, plan), Self::execute)?;
        self.finish_latent(&start, &info);
        Ok(info)
    }

    /// Executes a plan exactly, which may be altered or another planner's: denoise passes, cache pass, decoding, commit.
    ///
    /// # Errors
    /// As [`append`](Self::append), and `InvalidArgument` for a plan that cannot be executed now, that holds a value that is not
    /// finite, or that does not start from noise.
    pub fn execute(&mut self, plan: &StepPlan) -> Result<StepInfo> {
        self.check_plan(plan)?;
        if plan.noise.is_none() || plan.sigmas.is_empty() {
            return Err(Error::new(ErrorKind::InvalidArgument, "the plan makes no latent: it is an append's")
                .field("plan.noise")
                .remedy("Give the latent that is appended"));
        }
        let measured = StepMeasurement::start(&*self.device.context);
        self.finish(plan, measured)
    }

    /// Executes the plan of an append with a latent of the caller, `[C, h, w]`.
    ///
    /// # Errors
    /// As [`execute`](Self::execute), and `InvalidArgument` for a plan that starts from noise, and for a latent of another length
    /// or with a value that is not finite.
    pub fn execute_append(&mut self, plan: &StepPlan, latent: &[f32]) -> Result<StepInfo> {
        self.check_plan(plan)?;
        if plan.noise.is_some() || !plan.sigmas.is_empty() {
            return Err(Error::new(ErrorKind::InvalidArgument, "the plan makes a latent of its own")
                .field("plan.noise")
                .remedy("Use the plan of an append"));
        }
        self.check_latent(latent)?;
        let measured = StepMeasurement::start(&*self.device.context);
        self.device.set_latent(latent)?;
        self.finish(plan, measured)
    }

    /// Runs one frozen pass of `plan` on latent `x` at noise level `sigma`. Returns the velocity, which is `x - x_next` at dsigma
    /// -1, and K and V of the latent. The rollout is unchanged.
    ///
    /// # Errors
    /// As [`execute_append`](Self::execute_append), for any plan; `Unsupported` for one with a pending commit, because the ring lacks the latent
    /// before.
    pub fn probe(&mut self, plan: &StepPlan, sigma: f32, x: &[f32]) -> Result<Probe> {
        self.check_plan(plan)?;
        if plan.pending.is_some() {
            return Err(Error::new(
                ErrorKind::Unsupported,
                "the last latent's keys and values are not in the ring yet",
            )
            .field("plan.pending")
            .remedy("Probe a rollout with separate cache passes"));
        }
        self.check_latent(x)?;
        if !sigma.is_finite() {
            return Err(not_finite("sigma"));
        }
        self.device.probe(plan, sigma, x)
    }

    /// Encodes a picture of any size to the latent, `[C, h, w]`, that an append would make of it now. The rollout is unchanged.
    ///
    /// # Errors
    /// `Device` when the encoder fails or gives a value that is not finite.
    pub fn encode(&mut self, picture: &Picture) -> Result<Vec<f32>> {
        self.device.encode_picture(picture)
    }

    /// Waits for submitted work, then evicts the rollout's device memory so that others can use it: rings, latents, the
    /// autoencoder's memories and pictures. The next call that needs them makes them resident again, with their contents. The
    /// world's large weights are evicted when the last of its rollouts rests, and are resident again before the first that no
    /// longer does; kept anchors stay resident. Does nothing on a processor. Call it when the rollout will make no latents for a while.
    ///
    /// # Errors
    /// `Device`, `DeviceRemoved`; the rollout is not resting then. The call that makes the memory resident fails with `OutOfMemory`
    /// if there is no room for it; it changes nothing then, and may be tried again.
    pub fn rest(&mut self) -> Result<()> {
        self.device.context.rest()
    }

    /// Whether its memory was evicted by [`rest`](Self::rest) and has not been needed since.
    pub fn is_resting(&self) -> bool {
        self.device.context.is_resting()
    }

    /// Returns to the start, with the same seed.
    ///
    /// # Errors
    /// `Device` when the device is lost.
    pub fn reset(&mut self) -> Result<()> {
        self.device.clear()?;
        self.planner.reset();
        self.readback.forget_latent();
        Ok(())
    }

    /// The last latent, `[C, h, w]`; waits for it.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent; `Device` when it cannot be read.
    pub fn latent(&self) -> Result<&[f32]> {
        self.check_started()?;
        self.readback.latent(&self.device, &self.world)
    }

    /// Writes picture `i` of the last latent, 0 to `pictures_per_latent - 1` in order of time, at render size; waits for it.
    /// `picture` is replaced if it has another size, else its memory is reused.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent and for a picture that does not exist; `Device` when it cannot be read.
    pub fn read_picture(&mut self, i: u32, picture: &mut Picture) -> Result<()> {
        self.check_started()?;
        let temporal = self.world.manifest().geometry.autoencoder.temporal;
        let index = self.point.decoded_index(i, temporal).ok_or_else(|| {
            let count = self.point.pictures_per_latent;
            Error::new(ErrorKind::InvalidArgument, format!("there is no picture {i}; a latent has {count}"))
                .field("i")
                .remedy("Count from 0")
        })?;
        let start = Instant::now();
        self.readback.read_picture(&mut self.device, &self.world, index as usize, picture)?;
        self.times.add_picture(start);
        Ok(())
    }

    /// Makes what [`read_picture`](Self::read_picture) needs on the device, so that reading the next step's pictures allocates nothing there.
    pub(super) fn prepare_read_picture(&mut self) -> Result<()> {
        self.readback.prepare_read_picture(&mut self.device)
    }

    /// All decoded pictures of the last latent at the decoder's size, `[pictures, 3, H, W]`; waits for them.
    ///
    /// # Errors
    /// As [`latent`](Self::latent).
    pub fn decoded(&self) -> Result<Vec<f32>> {
        self.check_started()?;
        let shapes = &self.world.shapes;
        let mut rgb = allocate::zeroed(shapes.pictures * shapes.picture_len())?;
        self.device.read_decoded(0, &mut rgb)?;
        Ok(rgb)
    }

    /// The decoder's memories, in the manifest's order and shapes.
    ///
    /// # Errors
    /// `Device` when they cannot be read.
    pub fn decoder_memories(&self) -> Result<Vec<Vec<f32>>> {
        self.device.decoder_memories(self.world.manifest().geometry.autoencoder.memories.len())
    }

    /// K or V of one layer's ring, as stored on the device: `[kv_heads, slots * T, head_width]` in the graphs' element type.
    ///
    /// # Errors
    /// `InvalidArgument` for a layer that does not exist; `Device` when it cannot be read.
    pub fn ring_bytes(&self, layer: u32, part: KvPart) -> Result<Vec<u8>> {
        self.device.ring_bytes(layer as usize, part).unwrap_or_else(|| {
            let layers = self.world.manifest().geometry.layers;
            Err(Error::new(ErrorKind::InvalidArgument, format!("there is no layer {layer}; the world has {layers}"))
                .field("layer"))
        })
    }

    /// The world it runs in.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Its operating point.
    pub fn operating_point(&self) -> &OperatingPoint {
        &self.point
    }

    /// Clocks and ring flags, and plans for [`execute`](Self::execute) and [`probe`](Self::probe).
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// Statistics since it was made; [`reset`](Self::reset) and [`restore`](Self::restore) do not change them.
    pub fn statistics(&self) -> Statistics {
        self.times.statistics(&*self.device.context)
    }

    /// Device time by the device's own clock, from the first to the last command of each pass; `None` if the device is not a
    /// Direct3D 12 device. All zero if the queue for anchors has no timestamps. [`Statistics`] has wall times.
    #[cfg(windows)]
    pub fn device_times(&mut self) -> Option<DeviceTimes> {
        self.times.device_times(&mut *self.device.context, &self.world)
    }

    /// How many of its passes, each with its own buffers, run by graph capture, and why others do not; `None` if the device is not
    /// a Direct3D 12 device. [`DirectMlOptions::captured_passes`](crate::runtime::DirectMlOptions::captured_passes) turns it on.
    #[cfg(windows)]
    pub fn capture_statistics(&self) -> Option<CaptureStatistics> {
        self.device.context.capture_statistics()
    }

    /// Allocates device memory for a copy of the last latent and its pictures; `None` if the device is not a Direct3D 12 device.
    #[cfg(windows)]
    pub(super) fn allocate_snapshot(&mut self) -> Result<Option<Snapshot>> {
        self.device.allocate_snapshot(self.point.pictures_per_latent as usize, self.world.render_size())
    }

    /// Submits copies of the last latent and its pictures into `snapshot`, which this rollout allocated. Does not wait.
    #[cfg(windows)]
    pub(super) fn fill_snapshot(&mut self, snapshot: &mut Snapshot) -> Result<()> {
        let temporal = self.world.manifest().geometry.autoencoder.temporal;
        let pictures: Vec<_> =
            (0..self.point.pictures_per_latent).map_while(|i| self.point.decoded_index(i, temporal)).collect();
        self.device.fill_snapshot(&pictures, self.world.decoded_size(), snapshot)
    }

    /// The flag that stops a step or an append from another thread. While it is set no pass starts, the call fails with
    /// `Cancelled`, and the rollout stays as before the call. The caller that sets the flag clears it.
    pub fn stop_flag(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// Makes a plan in the memory of `self.plan`, and executes it.
    fn with_plan(
        &mut self,
        make: impl FnOnce(&Planner, &mut StepPlan) -> Result<()>,
        execute: impl FnOnce(&mut Self, &StepPlan) -> Result<StepInfo>,
    ) -> Result<StepInfo> {
        let mut plan = std::mem::take(&mut self.plan);
        let result = make(&self.planner, &mut plan).and_then(|()| execute(self, &plan));
        self.plan = plan;
        result
    }

    /// Executes `plan` from its denoise passes on, and advances the clocks.
    fn finish(&mut self, plan: &StepPlan, mut measured: StepMeasurement) -> Result<StepInfo> {
        // Checked first, because nothing may fail once the device's state has changed.
        self.planner.check(plan)?;
        self.device.execute(plan, &mut measured)?;
        self.planner.commit(plan)?;
        self.readback.forget_latent();
        let info = measured.finish(plan, &*self.device.context);
        self.times.add_step(&info);
        Ok(info)
    }

    pub(super) fn check_started(&self) -> Result<()> {
        if self.planner.latents() > 0 {
            return Ok(());
        }
        Err(Error::new(ErrorKind::InvalidArgument, "there is no latent yet").remedy("Append a picture or step first"))
    }

    fn check_plan(&self, plan: &StepPlan) -> Result<()> {
        self.planner.check(plan)?;
        if plan.sigmas.len() > self.device.max_passes() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("{} denoise passes are more than {}", plan.sigmas.len(), self.device.max_passes()),
            )
            .field("plan.sigmas"));
        }
        for (name, values) in [("sigmas", &plan.sigmas), ("dsigmas", &plan.dsigmas), ("controls", &plan.controls)] {
            if values.iter().any(|v| !v.is_finite()) {
                return Err(not_finite(&format!("plan.{name}")));
            }
        }
        Ok(())
    }

    fn check_latent(&self, latent: &[f32]) -> Result<()> {
        let expected = self.world.latent_len();
        if latent.len() != expected {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a latent of this world has {expected} numbers, not {}", latent.len()),
            )
            .field("latent"));
        }
        if latent.iter().any(|v| !v.is_finite()) {
            return Err(not_finite("latent"));
        }
        Ok(())
    }
}

impl std::fmt::Debug for Rollout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Rollout(latent {} at {} of {:?})", self.planner.latents(), self.point, self.world)
    }
}

fn not_finite(field: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, "a number is not finite").field(field).remedy("Give finite numbers")
}
