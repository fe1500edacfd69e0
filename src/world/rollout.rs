//! The rollout: one running instance of a world.

use std::borrow::Borrow;
use std::cell::{Cell, OnceCell};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::autoencoder::Autoencoder;
use super::budget::LatentBudget;
use super::controls::ControlInput;
use super::convert;
use super::governor::Governed;
use super::kv_memory::{KvMemory, Part};
use super::operating_point::OperatingPoint;
use super::passes::Passes;
use super::plan::{CachePass, Planner, StepPlan};
use super::resize::Bilinear;
use super::statistics::{Stages, Statistics, StepInfo};
use super::world::World;
use crate::runtime::{
    BufferId, ExecutionContext, FiniteCheckId, RecordedCopiesId, RecordedCopy, Region, StoppableContext,
};
use crate::{Error, ErrorKind, Picture, Result};

/// One running instance of a world: KV ring, clocks, noise seed, autoencoder memories.
///
/// Every call either succeeds or, when it fails, leaves the rollout unchanged; only a lost device is an exception.
///
/// Threads: a rollout may move between threads and is used by one at a time. Rollouts of one world may run at the same
/// time.
pub struct Rollout {
    pub(super) world: Arc<World>,
    pub(super) point: OperatingPoint,
    pub(super) planner: Planner,
    pub(super) context: Box<dyn ExecutionContext>,
    pub(super) kv: KvMemory,
    pub(super) autoencoder: Autoencoder,
    /// The last finished latent.
    pub(super) latent: BufferId,
    passes: Passes,
    /// Copies the finished latent from the passes' buffer to `latent`.
    keep_latent: RecordedCopiesId,
    /// A finite check of all results of a step, for each side of the decoder. Its groups are `LATENT`, `DECODED`, and K and V.
    finite_checks: [FiniteCheckId; 2],
    /// A finite check of the latent alone.
    latent_check: FiniteCheckId,
    /// Reused from step to step to avoid allocations.
    plan: StepPlan,
    /// The last finished latent in host memory, once it was requested.
    host_latent: OnceCell<Vec<f32>>,
    spare_latent: Cell<Vec<f32>>,
    /// Buffer for reading one decoded picture.
    planes: Vec<f32>,
    to_render: Bilinear,
    statistics: Statistics,
    stop: Arc<AtomicBool>,
    /// Time limit of latents.
    pub(super) budget: Option<LatentBudget>,
    /// Limits of latents and frames together.
    pub(super) governed: Option<Governed>,
    /// Device times of the worlds that this rollout ran in before.
    #[cfg(windows)]
    pub(super) times_before: super::DeviceTimes,
}

/// Groups of a step's finite check; the next one is K and V.
const LATENT: usize = 0;
const DECODED: usize = 1;

/// The results of a frozen pass, for parity tests and research.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// The velocity v, `[C, h, w]`.
    pub velocity: Vec<f32>,
    /// The latent's K of each layer, `[kv_heads, T, head_width]`.
    pub keys: Vec<Vec<f32>>,
    /// The latent's V of each layer, the same shape.
    pub values: Vec<Vec<f32>>,
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
    pub(super) fn with_stop(
        world: &Arc<World>,
        point: &OperatingPoint,
        seed: u64,
        stop: Arc<AtomicBool>,
        freed: u64,
    ) -> Result<Self> {
        world.check_point(point)?;
        world.check_room_for_rollout(freed)?;
        let planner = Planner::new(world.manifest(), point, seed)?;
        let mut context: Box<dyn ExecutionContext> = Box::new(StoppableContext::new(world.device(), stop.clone())?);
        let kv = KvMemory::new(&mut *context, world)?;
        let passes = Passes::new(&mut *context, world, &kv)?;
        let autoencoder = Autoencoder::new(&mut *context, world, passes.latent())?;
        let whole = Region { to: 0, from: 0, len: context.size(passes.latent()) };
        let latent = context.buffer(whole.len)?;
        let keep_latent =
            context.keep(vec![RecordedCopy { to: latent, from: passes.latent(), regions: vec![whole] }])?;
        let (made, slabs, precision) = ([passes.latent()], kv.slabs().collect::<Vec<_>>(), world.precision());
        let mut look = |decoded| context.add_finite_check(&[&made, decoded, &slabs], precision);
        let [one, other] = autoencoder.sides();
        let finite_checks = [look(one)?, look(other)?];
        let latent_check = context.add_finite_check(&[&made], precision)?;
        Ok(Self {
            planner,
            point: point.clone(),
            kv,
            autoencoder,
            latent,
            passes,
            keep_latent,
            finite_checks,
            latent_check,
            context,
            plan: StepPlan::default(),
            host_latent: OnceCell::new(),
            spare_latent: Cell::new(convert::zeroed(world.latent_len())?),
            planes: convert::zeroed(world.shapes.picture_len())?,
            to_render: Bilinear::new(world.decoded_size(), world.render_size()),
            statistics: Statistics::default(),
            stop,
            budget: None,
            governed: None,
            #[cfg(windows)]
            times_before: super::DeviceTimes::default(),
            world: world.clone(),
        })
    }

    /// Appends a still picture of any size, as the seed or later in a rollout. The picture is resized to the autoencoder's size,
    /// without regard to its aspect ratio, encoded, committed by a cache pass of its own at sigma 0 with idle controls, and
    /// decoded.
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
                let mut run = Run::start(rollout);
                let start = Instant::now();
                if !rollout.autoencoder.encode(&mut *rollout.context, pictures)? {
                    return Err(device_not_finite("the encoder's memory"));
                }
                run.stages.encode.add(1, start);
                let made = rollout.finish(plan, run)?;
                rollout.autoencoder.commit_encoding();
                Ok(made)
            },
        )
    }

    /// Sets whether the encoder continues from one appended picture to the next, as the released engine's does, or starts anew with
    /// each, which is the default. The stream starts at this call and at each reset; it is part of a saved state.
    ///
    /// # Errors
    /// `Unsupported` if the bundle's encoder does not take its memories as inputs; `Device` when the device is lost.
    pub fn keep_encoder_stream(&mut self, keep: bool) -> Result<()> {
        self.autoencoder.keep_stream(&mut *self.context, keep)
    }

    /// Whether the encoder's stream is kept; see [`keep_encoder_stream`](Self::keep_encoder_stream).
    pub fn keeps_encoder_stream(&self) -> bool {
        self.autoencoder.keeps_stream()
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
        let spent = self.governed.is_some().then(|| self.spent_on_device()).flatten();
        let start = Instant::now();
        let made = self.with_plan(|planner, plan| planner.plan_step_into(input, plan), Self::execute)?;
        self.note_latent(start.elapsed());
        self.report_to_governor(start, spent);
        Ok(made)
    }

    /// Executes a plan exactly, whoever made it: denoise passes, cache pass, decoding, commit.
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
        let run = Run::start(self);
        self.finish(plan, run)
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
        let run = Run::start(self);
        self.passes.set_latent(&mut *self.context, latent)?;
        self.finish(plan, run)
    }

    /// Runs one frozen pass of `plan` on latent `x` at noise level `sigma`. Returns the velocity, which is `x - x_next` at dsigma
    /// -1, and K and V of the latent. The rollout is unchanged.
    ///
    /// # Errors
    /// As [`execute_append`](Self::execute_append), for any plan.
    pub fn probe(&mut self, plan: &StepPlan, sigma: f32, x: &[f32]) -> Result<Probe> {
        self.check_plan(plan)?;
        self.check_latent(x)?;
        if !sigma.is_finite() {
            return Err(not_finite("sigma"));
        }
        self.passes.prepare(&mut *self.context, plan, [sigma, -1.0])?;
        self.passes.set_latent(&mut *self.context, x)?;
        self.passes.extra(&mut *self.context, plan)?;
        let mut velocity = convert::zeroed(x.len())?;
        self.passes.read_next(&*self.context, &mut velocity)?;
        velocity.iter_mut().zip(x).for_each(|(v, x)| *v = x - *v);
        let (mut keys, mut values) = (Vec::new(), Vec::new());
        for (i, slab) in self.kv.slabs().enumerate() {
            let mut numbers = convert::zeroed(self.world.shapes.slab_len())?;
            convert::read(&*self.context, self.world.precision(), slab, 0, &mut numbers)?;
            if i % 2 == 0 { keys.push(numbers) } else { values.push(numbers) }
        }
        Ok(Probe { velocity, keys, values })
    }

    /// Encodes a picture of any size to the latent, `[C, h, w]`, that an append would make of it now. The rollout is unchanged.
    ///
    /// # Errors
    /// `Device` when the encoder fails or gives a value that is not finite.
    pub fn encode(&mut self, picture: &Picture) -> Result<Vec<f32>> {
        self.autoencoder.encode(&mut *self.context, &[picture])?;
        let mut latent = convert::zeroed(self.world.latent_len())?;
        convert::read(&*self.context, self.world.precision(), self.passes.latent(), 0, &mut latent)?;
        match self.context.not_finite(self.latent_check)? {
            None => Ok(latent),
            Some(_) => Err(device_not_finite("the encoded latent")),
        }
    }

    /// Waits for submitted work, then evicts the rollout's device memory so that others can use it: rings, latents, the
    /// autoencoder's memories and pictures. The next call that needs them makes them resident again, with their contents. The
    /// world's large weights are evicted when the last of its rollouts rests, and are resident again before the first that no
    /// longer does; kept anchors stay. Does nothing on a processor. For a rollout that makes no latents for a while.
    ///
    /// # Errors
    /// `Device`, `DeviceRemoved`; the rollout is not resting then. The call that makes the memory resident fails with `OutOfMemory`
    /// if there is no room for it; it changes nothing then, and may be tried again.
    pub fn rest(&mut self) -> Result<()> {
        self.context.rest()
    }

    /// Whether its memory was evicted by [`rest`](Self::rest) and has not been needed since.
    pub fn is_resting(&self) -> bool {
        self.context.is_resting()
    }

    /// Returns to the start, with the same seed.
    ///
    /// # Errors
    /// `Device` when the device is lost.
    pub fn reset(&mut self) -> Result<()> {
        let buffers: Vec<_> = self.state_buffers().collect();
        self.context.clear(&buffers)?;
        self.planner.reset();
        self.forget_host_latent();
        Ok(())
    }

    /// The last latent, `[C, h, w]`; waits for it.
    ///
    /// # Errors
    /// `InvalidArgument` before the first latent; `Device` when it cannot be read.
    pub fn latent(&self) -> Result<&[f32]> {
        self.check_started()?;
        if let Some(latent) = self.host_latent.get() {
            return Ok(latent);
        }
        let mut latent = self.spare_latent.take();
        if latent.is_empty() {
            latent = convert::zeroed(self.world.latent_len())?;
        }
        convert::read(&*self.context, self.world.precision(), self.latent, 0, &mut latent)?;
        Ok(self.host_latent.get_or_init(|| latent))
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
        let (width, height) = self.world.render_size();
        if picture.size() != (width, height) {
            *picture = Picture::new(width, height)?;
        }
        self.autoencoder.read(&*self.context, index as usize, &mut self.planes)?;
        self.to_render.to_picture(&self.planes, picture);
        self.statistics.stages.resize.add(1, start);
        Ok(())
    }

    /// All decoded pictures of the last latent at the decoder's size, `[pictures, 3, H, W]`; waits for them.
    ///
    /// # Errors
    /// As [`latent`](Self::latent).
    pub fn decoded(&self) -> Result<Vec<f32>> {
        self.check_started()?;
        let shapes = &self.world.shapes;
        let mut rgb = convert::zeroed(shapes.pictures * shapes.picture_len())?;
        self.autoencoder.read(&*self.context, 0, &mut rgb)?;
        Ok(rgb)
    }

    /// The decoder's memories, in the manifest's order and shapes.
    ///
    /// # Errors
    /// `Device` when they cannot be read.
    pub fn decoder_memories(&self) -> Result<Vec<Vec<f32>>> {
        let element = crate::runtime::element_size(self.world.precision());
        let count = self.world.manifest().geometry.autoencoder.memories.len();
        self.autoencoder
            .state()
            .take(count)
            .map(|buffer| {
                let mut memory = convert::zeroed(self.context.size(buffer) / element)?;
                convert::read(&*self.context, self.world.precision(), buffer, 0, &mut memory)?;
                Ok(memory)
            })
            .collect()
    }

    /// K or V of one layer's ring, as stored on the device: `[kv_heads, buckets * T, head_width]` in the graphs' element type.
    ///
    /// # Errors
    /// `InvalidArgument` for a layer that does not exist; `Device` when it cannot be read.
    pub fn ring_bytes(&self, layer: u32, part: Part) -> Result<Vec<u8>> {
        let buffer = self.kv.ring(layer as usize, part).ok_or_else(|| {
            let layers = self.world.manifest().geometry.layers;
            Error::new(ErrorKind::InvalidArgument, format!("there is no layer {layer}; the world has {layers}"))
                .field("layer")
        })?;
        let mut bytes = convert::zeroed(self.context.size(buffer))?;
        self.context.read(buffer, 0, &mut bytes)?;
        Ok(bytes)
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
        // `self.statistics.bytes` has the bytes that earlier contexts of the rollout moved.
        Statistics { bytes: self.statistics.bytes + self.context.bytes(), ..self.statistics }
    }

    /// Continues the statistics of `other`, which this rollout replaces.
    pub(super) fn continue_statistics(&mut self, other: &mut Self) {
        self.statistics = other.statistics();
        #[cfg(windows)]
        {
            self.times_before = other.device_times().unwrap_or_default();
        }
    }

    /// The flag that stops a step or an append from another thread. While it is set no pass starts, the call fails with
    /// `Cancelled`, and the rollout stays as before the call. The caller that sets the flag clears it.
    pub fn stop_flag(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// Makes a plan in the reused `plan`, and executes it.
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

    /// All parts of a step from its denoise passes on. The rollout's state is written only after every result is complete and
    /// finite, and then all at once.
    fn finish(&mut self, plan: &StepPlan, mut run: Run) -> Result<StepInfo> {
        // Checked first, because nothing may fail once the plan's commit is done.
        self.planner.check(plan)?;
        let context = &mut *self.context;
        self.passes.prepare(context, plan, [0.0, 0.0])?;
        let start = Instant::now();
        self.passes.denoise(context, plan)?;
        run.stages.denoise.add(plan.sigmas.len() as u64, start);
        if plan.cache == CachePass::Separate {
            let start = Instant::now();
            self.passes.extra(context, plan)?;
            run.stages.cache.add(1, start);
        }
        let committed = plan.cache != CachePass::Skip;
        let start = Instant::now();
        let decoding = self.autoencoder.decode(context, plan.prime)?;
        run.stages.decode.add(u64::from(plan.prime) + 1, start);
        let start = Instant::now();
        // One check for all results, because it waits for the device.
        let looked = context.not_finite(self.finite_checks[decoding.side()]).and_then(|group| {
            let what = match group {
                None => return Ok(()),
                Some(LATENT) => "latent",
                Some(DECODED) => "the decoder's view of latent",
                // K and V that are not committed need not be finite.
                Some(_) if !committed => return Ok(()),
                Some(_) => "K or V of latent",
            };
            Err(device_not_finite(&format!("{what} {}", plan.latent)))
        });
        if let Err(error) = looked {
            self.autoencoder.undo(context, decoding)?;
            return Err(error);
        }
        run.stages.commit.add(0, start);

        let start = Instant::now();
        let before = context.bytes().copied;
        if let Err(error) = self.kv.commit(context, plan.local.slot, plan.global.slot, self.keep_latent) {
            self.autoencoder.undo(context, decoding)?;
            return Err(error);
        }
        let ring_bytes = context.bytes().copied - before - context.size(self.latent) as u64;
        self.autoencoder.commit(decoding);
        self.planner.committed(plan)?;
        run.stages.commit.add(u64::from(committed), start);
        self.forget_host_latent();

        self.statistics.latents += 1;
        self.statistics.stages.add(&run.stages);
        self.statistics.ring_bytes += ring_bytes;
        let bytes = self.context.bytes() - run.bytes;
        Ok(StepInfo { latent: plan.latent, committed, stages: run.stages, bytes, ring_bytes })
    }

    pub(super) fn forget_host_latent(&mut self) {
        if let Some(latent) = self.host_latent.take() {
            self.spare_latent.set(latent);
        }
    }

    pub(super) fn check_started(&self) -> Result<()> {
        if self.planner.latents() > 0 {
            return Ok(());
        }
        Err(Error::new(ErrorKind::InvalidArgument, "there is no latent yet").remedy("Append a picture or step first"))
    }

    fn check_plan(&self, plan: &StepPlan) -> Result<()> {
        self.planner.check(plan)?;
        if plan.sigmas.len() > self.passes.max_passes() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("{} denoise passes are more than {}", plan.sigmas.len(), self.passes.max_passes()),
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

/// Time and bytes of one step so far.
struct Run {
    stages: Stages,
    bytes: crate::runtime::Bytes,
}

impl Run {
    fn start(rollout: &Rollout) -> Self {
        Self { stages: Stages::default(), bytes: rollout.context.bytes() }
    }
}

fn not_finite(field: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, "a number is not finite").field(field).remedy("Give finite numbers")
}

fn device_not_finite(what: &str) -> Error {
    Error::new(ErrorKind::Device, format!("{what} came out with a number that is not finite"))
}
