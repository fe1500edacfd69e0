//! Plans of latent steps, made without touching a device.
//!
//! A [`Planner`] holds the two clocks, the flags of both rings and the schedule. It makes [`StepPlan`]s; the rollout executes a
//! plan exactly and reports it with [`Planner::commit`]. Nothing changes until then, so a step that fails changes nothing here.

mod state;
#[cfg(test)]
mod tests;

use crate::bundle::{ControlCounts, Manifest};
use crate::world::controls::ControlInput;
use crate::world::noise::NoiseKey;
use crate::world::operating_point::{CacheMode, OperatingPoint};
use crate::world::ring::Ring;
use crate::world::schedule::SigmaTable;
use crate::{Error, ErrorKind, Result};

/// Source of the keys and values of a latent that are committed to the ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CachePass {
    /// A separate forward pass on the finished latent at sigma 0, with the same controls, clocks and visibility; its `present`
    /// slabs are committed.
    Separate,
    /// No extra pass; the `present` slabs of the last denoise pass are committed.
    Fused,
    /// No extra pass and no commit: ring and ring clock stay unchanged.
    Skip,
    /// No pass and no commit in this step: the first pass of the next one makes the keys and values, and it commits them
    /// ([`StepPlan::pending`]).
    Deferred,
}

/// The slots of one kind of layer that are visible to a latent step, and the slot that it writes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RingPlan {
    /// For each slot, whether it is visible to all passes of the step. The latent itself is always visible too.
    pub visible: Vec<bool>,
    /// The slot that the commit overwrites; `None` if it writes none.
    pub slot: Option<usize>,
}

/// The commit of the latent before, which the first pass of a step or append makes: the finished latent runs through it at sigma 0, beside the new
/// one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PendingPlan {
    /// RoPE time of the finished latent.
    pub rope_time: u64,
    /// Its `controls` input.
    pub controls: Vec<f32>,
    /// Local layers: the slots that are visible to the finished latent, and the one it is committed to, before the step's second pass.
    pub local: RingPlan,
    /// Global layers.
    pub global: RingPlan,
}

/// One latent step, or the append of one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct StepPlan {
    /// Number of the latent, counted from 0.
    pub latent: u64,
    /// RoPE time of all its passes.
    pub rope_time: u64,
    /// Commits before this step, that of `pending` included.
    pub ring_clock: u64,
    /// The commit of the latent before; `None` if it was made with that latent.
    pub pending: Option<PendingPlan>,
    /// The noise that denoising starts from; `None` when a picture is appended.
    pub noise: Option<NoiseKey>,
    /// Noise level of each denoise pass; empty when a picture is appended.
    pub sigmas: Vec<f32>,
    /// The next noise level minus this one, for each denoise pass.
    pub dsigmas: Vec<f32>,
    /// The transformer's `controls` input, in every pass of the step; all zero when a picture is appended.
    pub controls: Vec<f32>,
    /// Local layers.
    pub local: RingPlan,
    /// Global layers.
    pub global: RingPlan,
    /// How the step commits.
    pub cache: CachePass,
    /// How often the decoder runs on this latent beforehand, with its pictures discarded: at the first decode after a reset, once
    /// less than a latent has pictures (three times with four pictures), else never.
    pub prime: u32,
}

impl StepPlan {
    /// Whether the latent's own keys and values are committed with it, not later and not never.
    pub(crate) fn commits_itself(&self) -> bool {
        matches!(self.cache, CachePass::Separate | CachePass::Fused)
    }
}

impl Default for StepPlan {
    /// An empty plan to be filled by [`Planner::plan_step_into`]; it cannot be executed.
    fn default() -> Self {
        Self {
            latent: 0,
            rope_time: 0,
            ring_clock: 0,
            pending: None,
            noise: None,
            sigmas: Vec::new(),
            dsigmas: Vec::new(),
            controls: Vec::new(),
            local: RingPlan::default(),
            global: RingPlan::default(),
            cache: CachePass::Skip,
            prime: 0,
        }
    }
}

/// The clocks, ring flags and settings of one rollout, from which plans are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Planner {
    seed: u64,
    cache_mode: CacheMode,
    table: SigmaTable,
    controls: ControlCounts,
    time_multiplier: u32,
    prime: u32,
    clocks: Clocks,
    local: Ring,
    global: Ring,
    /// The controls of the last latent, if its commit was deferred.
    pending: Option<Vec<f32>>,
}

/// The counters. The ring clock counts commits, the RoPE clock counts latents; nothing converts one to the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Clocks {
    /// Latents, appended and generated.
    latents: u64,
    /// Latents that were generated.
    generated: u64,
    /// Latents that were committed.
    commits: u64,
}

impl Planner {
    /// A planner at the start of a rollout of the world `manifest` describes.
    ///
    /// # Errors
    /// `InvalidArgument` when the operating point does not fit the world, and the errors of [`Ring::new`] and
    /// [`Schedule::table`](crate::world::Schedule::table).
    pub fn new(manifest: &Manifest, point: &OperatingPoint, seed: u64) -> Result<Self> {
        let geometry = &manifest.geometry;
        point.check_for(geometry)?;
        // Fails if the world's controls cannot be written.
        let mut controls = vec![0.0; manifest.controls.len()];
        ControlInput::IDLE.write(&manifest.controls, &mut controls)?;
        Ok(Self {
            seed,
            cache_mode: point.cache_mode,
            table: point.schedule.table(&manifest.sampler)?,
            controls: manifest.controls,
            time_multiplier: manifest.rates.time_multiplier,
            prime: geometry.autoencoder.temporal - 1,
            clocks: Clocks::default(),
            local: Ring::new(geometry.local.window, 1)?,
            global: Ring::new(point.global_window / geometry.global.dilation, geometry.global.dilation)?,
            pending: None,
        })
    }

    /// Plans the append of a picture: no denoise pass, zero controls, its own cache pass at sigma 0, which the next step makes in a rollout with
    /// joined passes.
    ///
    /// # Errors
    /// `Unsupported` when a clock has run out, after 2^64 / `time_multiplier` latents.
    pub fn plan_append(&self) -> Result<StepPlan> {
        let mut plan = StepPlan::default();
        self.plan_append_into(&mut plan)?;
        Ok(plan)
    }

    /// As [`Planner::plan_append`], into a plan whose memory is reused.
    ///
    /// # Errors
    /// As [`Planner::plan_append`].
    pub fn plan_append_into(&self, plan: &mut StepPlan) -> Result<()> {
        plan.noise = None;
        plan.sigmas.clear();
        plan.dsigmas.clear();
        plan.cache = if self.cache_mode == CacheMode::Joined { CachePass::Deferred } else { CachePass::Separate };
        self.fill(&ControlInput::IDLE, plan)
    }

    /// Plans a latent step with these controls.
    ///
    /// # Errors
    /// As [`Planner::plan_append`], and those of [`ControlInput::write`].
    pub fn plan_step(&self, input: &ControlInput) -> Result<StepPlan> {
        let mut plan = StepPlan::default();
        self.plan_step_into(input, &mut plan)?;
        Ok(plan)
    }

    /// As [`Planner::plan_step`], into a plan whose memory is reused: nothing is allocated after the first call.
    ///
    /// # Errors
    /// As [`Planner::plan_step`].
    pub fn plan_step_into(&self, input: &ControlInput, plan: &mut StepPlan) -> Result<()> {
        plan.noise = Some(NoiseKey { seed: self.seed, latent: self.clocks.latents });
        plan.sigmas.clear();
        plan.sigmas.extend_from_slice(&self.table.sigmas[..self.table.passes()]);
        plan.dsigmas.clear();
        plan.dsigmas.extend_from_slice(&self.table.dsigmas);
        plan.cache = match self.cache_mode {
            CacheMode::Separate => CachePass::Separate,
            CacheMode::Fused => CachePass::Fused,
            CacheMode::Interval(k) if self.clocks.generated.wrapping_add(1).is_multiple_of(u64::from(k)) => {
                CachePass::Separate
            }
            CacheMode::Interval(_) => CachePass::Skip,
            CacheMode::Joined => CachePass::Deferred,
        };
        self.fill(input, plan)
    }

    /// Fills the fields that steps and appends share; `plan.cache` is already set.
    fn fill(&self, input: &ControlInput, plan: &mut StepPlan) -> Result<()> {
        let latents = self.clocks.latents;
        plan.latent = latents;
        plan.rope_time = latents.checked_mul(u64::from(self.time_multiplier)).ok_or_else(clock_ran_out)?;
        plan.controls.resize(self.controls.len(), 0.0);
        input.write(&self.controls, &mut plan.controls)?;
        let commits = self.fill_pending(&mut plan.pending);
        plan.ring_clock = commits;
        let commits_now = plan.commits_itself();
        let pending = plan.pending.as_ref();
        for (ring, ring_plan, pending) in [
            (&self.local, &mut plan.local, pending.and_then(|pending| pending.local.slot)),
            (&self.global, &mut plan.global, pending.and_then(|pending| pending.global.slot)),
        ] {
            let is_visible = |slot| {
                let is_new = pending == Some(slot) && !(ring.is_write_step(commits) && slot == ring.slot(commits));
                is_new || ring.is_visible(commits, slot)
            };
            ring_plan.visible.clear();
            ring_plan.visible.extend((0..ring.slot_count()).map(is_visible));
            ring_plan.slot = (commits_now && ring.is_write_step(commits)).then(|| ring.slot(commits));
        }
        // Every latent is decoded, so the first one after a reset is the one that primes.
        plan.prime = if latents == 0 { self.prime } else { 0 };
        Ok(())
    }

    /// Plans the commit that was deferred, if any. Returns the commits after it.
    fn fill_pending(&self, plan: &mut Option<PendingPlan>) -> u64 {
        let Clocks { latents, commits, .. } = self.clocks;
        let Some(controls) = &self.pending else {
            *plan = None;
            return commits;
        };
        let plan = plan.get_or_insert_default();
        plan.rope_time = (latents - 1).saturating_mul(self.time_multiplier.into());
        plan.controls.clone_from(controls);
        for (ring, ring_plan) in [(&self.local, &mut plan.local), (&self.global, &mut plan.global)] {
            ring_plan.visible.clear();
            ring_plan.visible.extend((0..ring.slot_count()).map(|slot| ring.is_visible(commits, slot)));
            ring_plan.slot = ring.is_write_step(commits).then(|| ring.slot(commits));
        }
        commits + 1
    }

    /// Whether `plan` is the commit that was deferred, or none is and it is `None`.
    fn is_pending(&self, plan: Option<&PendingPlan>) -> bool {
        let Clocks { latents, commits, .. } = self.clocks;
        let (Some(controls), Some(plan)) = (&self.pending, plan) else {
            return self.pending.is_none() && plan.is_none();
        };
        let is_of = |ring: &Ring, plan: &RingPlan| {
            let slot = ring.is_write_step(commits).then(|| ring.slot(commits));
            let visible = (0..ring.slot_count()).map(|slot| ring.is_visible(commits, slot));
            plan.slot == slot && visible.eq(plan.visible.iter().copied())
        };
        plan.controls == *controls
            && plan.rope_time == (latents - 1).saturating_mul(self.time_multiplier.into())
            && is_of(&self.local, &plan.local)
            && is_of(&self.global, &plan.global)
    }

    /// Records that `plan` was executed: marks the slots that it wrote and advances the clocks. The plan may be another planner's or
    /// an altered one, but it must be for the next latent.
    ///
    /// # Errors
    /// `InvalidArgument` for a plan of another latent, for a slot that does not exist, and for a plan that names a slot
    /// and skips its commit. Nothing has changed then.
    pub fn commit(&mut self, plan: &StepPlan) -> Result<()> {
        self.check(plan)?;
        let pending = plan.pending.as_ref();
        for (ring, slots) in [
            (&mut self.local, [pending.and_then(|pending| pending.local.slot), plan.local.slot]),
            (&mut self.global, [pending.and_then(|pending| pending.global.slot), plan.global.slot]),
        ] {
            slots.into_iter().flatten().try_for_each(|slot| ring.mark_written(slot))?;
        }
        self.clocks.latents += 1;
        self.clocks.generated += u64::from(plan.noise.is_some());
        self.clocks.commits += u64::from(plan.pending.is_some()) + u64::from(plan.commits_itself());
        match (&mut self.pending, plan.cache) {
            (Some(controls), CachePass::Deferred) => controls.clone_from(&plan.controls),
            (pending, CachePass::Deferred) => *pending = Some(plan.controls.clone()),
            (pending, _) => *pending = None,
        }
        Ok(())
    }

    /// Checks that `plan` can be executed now; [`Planner::commit`] and the rollout rely on it.
    ///
    /// # Errors
    /// As [`Planner::commit`], and `InvalidArgument` when a list has a length that does not fit the world.
    pub fn check(&self, plan: &StepPlan) -> Result<()> {
        let wrong = |field: &str, cause: String| {
            Err(Error::new(ErrorKind::InvalidArgument, cause)
                .field(format!("plan.{field}"))
                .remedy("Make the plan anew from the planner"))
        };
        if self.clocks.latents == u64::MAX {
            return Err(clock_ran_out());
        }
        if plan.latent != self.clocks.latents {
            return wrong("latent", format!("the plan is for latent {}, next is {}", plan.latent, self.clocks.latents));
        }
        if plan.sigmas.len() != plan.dsigmas.len() {
            return wrong(
                "sigmas",
                format!("{} noise levels do not go with {} differences", plan.sigmas.len(), plan.dsigmas.len()),
            );
        }
        if plan.cache == CachePass::Fused && plan.sigmas.is_empty() {
            return wrong("cache", "there is no denoise pass whose keys and values could be kept".into());
        }
        if plan.cache == CachePass::Deferred && self.cache_mode != CacheMode::Joined {
            return wrong("cache", "only a rollout with joined passes defers commits".into());
        }
        if plan.pending.is_some() && plan.commits_itself() {
            return wrong("cache", "a step that commits the latent before does not commit its own as well".into());
        }
        if !self.is_pending(plan.pending.as_ref()) {
            return wrong("pending", "it is not the commit that the latent before has left".into());
        }
        if plan.controls.len() != self.controls.len() {
            return wrong(
                "controls",
                format!("{} numbers, the world has {}", plan.controls.len(), self.controls.len()),
            );
        }
        for (name, ring, ring_plan) in [("local", &self.local, &plan.local), ("global", &self.global, &plan.global)] {
            if ring_plan.visible.len() != ring.slot_count() {
                return wrong(name, format!("{} slots, the ring has {}", ring_plan.visible.len(), ring.slot_count()));
            }
            match ring_plan.slot {
                Some(slot) if slot >= ring.slot_count() => {
                    return wrong(name, format!("slot {slot} does not exist in a ring of {}", ring.slot_count()));
                }
                Some(slot) if !plan.commits_itself() => {
                    return wrong(name, format!("slot {slot} is named, but nothing is committed"));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Returns to the start: no latents, empty rings, decoder unprimed.
    pub fn reset(&mut self) {
        self.clocks = Clocks::default();
        self.local.clear();
        self.global.clear();
        self.pending = None;
    }

    /// Takes over the clocks and ring flags of a planner of the same world at another global window. Of the global ring, the newest
    /// latents that fit are kept. Returns pairs of global slots, in the other planner's ring and in this one's, whose contents must
    /// be copied.
    pub(super) fn take_over(&mut self, other: &Planner) -> Vec<(usize, usize)> {
        self.clocks = other.clocks;
        self.local = other.local.clone();
        self.pending.clone_from(&other.pending);
        self.global.take_over(&other.global, other.clocks.commits)
    }

    /// The rollout's seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Sets the noise levels of later plans.
    pub(super) fn set_table(&mut self, table: SigmaTable) {
        self.table = table;
    }

    /// Noise levels of a latent step.
    pub fn sigma_table(&self) -> &SigmaTable {
        &self.table
    }

    /// Latents so far, appended and generated: the number of the next one.
    pub fn latents(&self) -> u64 {
        self.clocks.latents
    }

    /// Generated latents so far.
    pub fn generated(&self) -> u64 {
        self.clocks.generated
    }

    /// Commits so far: the ring clock. A deferred commit is not counted before it is made.
    pub fn ring_clock(&self) -> u64 {
        self.clocks.commits
    }

    /// The ring of local layers.
    pub fn local(&self) -> &Ring {
        &self.local
    }

    /// The ring of global layers.
    pub fn global(&self) -> &Ring {
        &self.global
    }
}

fn clock_ran_out() -> Error {
    Error::new(ErrorKind::Unsupported, "the rollout's clock has run out").remedy("Reset the rollout")
}
