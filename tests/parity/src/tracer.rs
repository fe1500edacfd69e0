//! Steps a rollout from latent to latent and records every pass and its results.

use std::path::Path;

use cairn::Picture;
use cairn::bundle::{Geometry, Precision};
use cairn::world::{CachePass, ControlInput, KvPart, Rollout, StepPlan};
use sha2::{Digest, Sha256};

use crate::mutant::Mutant;
use crate::recorder::{Frozen, Record, StepRecord, Tensors};
use crate::{Failure, script};

/// Name of the pass at noise level 0 among the passes of a latent.
const CACHE_PASS: &str = "cache";

/// A rollout, and the record of its steps.
pub(crate) struct Tracer {
    rollout: Rollout,
    geometry: Geometry,
    precision: Precision,
    mutant: Option<Mutant>,
    /// The controls of the latent before, as the graph gets them.
    previous: Vec<f32>,
    tensors: Tensors,
    record: Record,
}

impl Tracer {
    pub(crate) fn new(rollout: Rollout, mutant: Option<Mutant>) -> Self {
        let world = rollout.world().clone();
        let point = rollout.operating_point();
        let record = Record {
            cache: point.cache_mode.to_string(),
            schedule: point.schedule.to_string(),
            global_window: point.global_window,
            precision: format!("{:?}", world.precision()).to_lowercase(),
            seed: rollout.planner().seed(),
            mutant: mutant
                .map(|m| clap::ValueEnum::to_possible_value(&m).map_or_else(String::new, |v| v.get_name().to_owned())),
            steps: Vec::new(),
        };
        Self {
            geometry: world.manifest().geometry.clone(),
            precision: world.precision(),
            previous: vec![0.0; world.manifest().controls.len()],
            mutant,
            tensors: Tensors::default(),
            record,
            rollout,
        }
    }

    /// Makes latent `q`. If it is recorded, first runs every pass frozen, with the ring's digest before and after each.
    pub(crate) fn step(&mut self, q: u64, appended: bool, recorded: bool) -> Result<(), Failure> {
        let input = if appended { ControlInput::IDLE } else { script::controls(q)? };
        let correct_plan =
            if appended { self.rollout.planner().plan_append()? } else { self.rollout.planner().plan_step(&input)? };
        let mut plan = correct_plan.clone();
        if let Some(mutant) = self.mutant {
            mutant.apply(self.rollout.planner(), &self.previous, &mut plan);
        }

        let mut frozen = Vec::new();
        let before = self.digest()?;
        if appended {
            self.append(q, &correct_plan, &plan, recorded, &mut frozen)?;
        } else {
            self.generate(q, &plan, recorded, &mut frozen)?;
        }
        let step = Frozen { name: "step".into(), before, after: self.digest()? };

        let latent = self.rollout.latent()?.to_vec();
        self.tensors.floats(format!("{q}.latent"), &self.latent_shape(), &latent);
        if recorded {
            self.record_results(q)?;
        }
        self.previous = correct_plan.controls;
        let planner = self.rollout.planner();
        self.record.steps.push(StepRecord {
            appended,
            recorded,
            mouse: input.mouse(),
            keys: input.keys().iter().map(|key| key.0).collect(),
            scroll: input.scroll(),
            passes: correct_plan.sigmas.len(),
            frozen,
            step: recorded.then_some(step),
            written: [planner.local().written().to_vec(), planner.global().written().to_vec()],
        });
        Ok(())
    }

    /// Writes both files.
    pub(crate) fn finish(self, out: &Path) -> Result<(), Failure> {
        std::fs::create_dir_all(out)?;
        std::fs::write(out.join("trace.json"), serde_json::to_vec_pretty(&self.record)?)?;
        self.tensors.write(&out.join("trace.safetensors"))
    }

    /// Appends the script's picture: through the public call, unless a mutant changed the plan.
    fn append(
        &mut self,
        q: u64,
        correct_plan: &StepPlan,
        plan: &StepPlan,
        recorded: bool,
        frozen: &mut Vec<Frozen>,
    ) -> Result<(), Failure> {
        let picture = script::picture(q)?;
        if recorded || plan != correct_plan {
            let latent = self.with_digests(frozen, "encode", |rollout| Ok(rollout.encode(&picture)?))?;
            if recorded {
                self.probe(q, CACHE_PASS, plan, 0.0, &latent, frozen)?;
                let (width, height) = picture.size();
                let shape = [height as usize, width as usize, 4];
                self.tensors.octets(format!("{q}.picture"), &shape, picture.rgba().to_vec());
            }
            if plan != correct_plan {
                self.rollout.execute_append(plan, &latent)?;
                return Ok(());
            }
        }
        self.rollout.append(&picture)?;
        Ok(())
    }

    /// Generates a latent by `plan`.
    fn generate(&mut self, q: u64, plan: &StepPlan, recorded: bool, frozen: &mut Vec<Frozen>) -> Result<(), Failure> {
        let mut x = vec![0.0; self.rollout.world().latent_len()];
        if let Some(key) = plan.noise {
            key.fill(&mut x);
        }
        self.round(&mut x);
        // In fused mode the last denoise input fills the slot, so it is always recorded.
        if recorded || plan.cache == CachePass::Fused {
            for (pass, (&sigma, &dsigma)) in plan.sigmas.iter().zip(&plan.dsigmas).enumerate() {
                let v = if recorded {
                    self.probe(q, &pass.to_string(), plan, sigma, &x, frozen)?
                } else {
                    self.tensors.floats(format!("{q}.{pass}.x"), &self.latent_shape(), &x);
                    self.rollout.probe(plan, sigma, &x)?.velocity
                };
                self.euler(&mut x, &v, dsigma);
            }
        }
        if recorded {
            self.tensors.floats(format!("{q}.{}.x", plan.sigmas.len()), &self.latent_shape(), &x);
            let latent = self.denoise_only(plan, frozen)?;
            if plan.cache == CachePass::Separate {
                self.probe(q, CACHE_PASS, plan, 0.0, &latent, frozen)?;
            }
        }
        self.rollout.execute(plan)?;
        Ok(())
    }

    /// Runs the step's denoise passes without its commit, returns their latent, and restores the rollout.
    fn denoise_only(&mut self, plan: &StepPlan, frozen: &mut Vec<Frozen>) -> Result<Vec<f32>, Failure> {
        let state = self.rollout.save()?;
        let mut skip = plan.clone();
        skip.cache = CachePass::Skip;
        skip.local.slot = None;
        skip.global.slot = None;
        if let Some(mutant) = self.mutant {
            mutant.apply_frozen(plan, &mut skip);
        }
        self.with_digests(frozen, "denoise passes", |rollout| Ok(rollout.execute(&skip)?))?;
        let latent = self.rollout.latent()?.to_vec();
        self.rollout.restore(&state)?;
        Ok(latent)
    }

    /// Runs and records one frozen pass; returns its velocity.
    fn probe(
        &mut self,
        q: u64,
        pass: &str,
        plan: &StepPlan,
        sigma: f32,
        x: &[f32],
        frozen: &mut Vec<Frozen>,
    ) -> Result<Vec<f32>, Failure> {
        let probe = self.with_digests(frozen, &format!("pass {pass}"), |rollout| Ok(rollout.probe(plan, sigma, x)?))?;
        let shape = self.latent_shape();
        self.tensors.floats(format!("{q}.{pass}.x"), &shape, x);
        self.tensors.floats(format!("{q}.{pass}.v"), &shape, &probe.velocity);
        let g = &self.geometry;
        let slab = [1, g.kv_heads as usize, g.tokens as usize, g.head_width as usize];
        for (layer, (k, v)) in probe.keys.iter().zip(&probe.values).enumerate() {
            self.tensors.floats(format!("{q}.{pass}.k.{layer}"), &slab, k);
            self.tensors.floats(format!("{q}.{pass}.value.{layer}"), &slab, v);
        }
        Ok(probe.velocity)
    }

    /// Records ring, pictures and decoder memories after a latent.
    fn record_results(&mut self, q: u64) -> Result<(), Failure> {
        let g = &self.geometry;
        for layer in 0..g.layers {
            let ring =
                if g.is_global(layer) { self.rollout.planner().global() } else { self.rollout.planner().local() };
            let shape = [1, g.kv_heads as usize, ring.slot_count() * g.tokens as usize, g.head_width as usize];
            for (part, name) in [(KvPart::Keys, "k"), (KvPart::Values, "value")] {
                let bytes = self.rollout.ring_bytes(layer, part)?;
                self.tensors.device(format!("{q}.ring.{name}.{layer}"), &shape, self.precision, bytes);
            }
        }
        let [width, height] = self.rollout.world().manifest().picture.decoded;
        let shape = [g.autoencoder.temporal as usize, 3, height as usize, width as usize];
        self.tensors.floats(format!("{q}.rgb"), &shape, &self.rollout.decoded()?);
        let mut picture = Picture::new(1, 1)?;
        for i in 0..g.autoencoder.temporal {
            self.rollout.read_picture(i, &mut picture)?;
            let (width, height) = picture.size();
            let shape = [height as usize, width as usize, 4];
            self.tensors.octets(format!("{q}.shown.{i}"), &shape, picture.rgba().to_vec());
        }
        for (i, (memory, shape)) in self.rollout.decoder_memories()?.iter().zip(&g.autoencoder.memories).enumerate() {
            let shape = [1, shape[0] as usize, shape[1] as usize, shape[2] as usize];
            self.tensors.floats(format!("{q}.memory.{i}"), &shape, memory);
        }
        Ok(())
    }

    /// Runs an operation that must not change the ring, and records the ring's digest before and after.
    fn with_digests<T>(
        &mut self,
        frozen: &mut Vec<Frozen>,
        name: &str,
        act: impl FnOnce(&mut Rollout) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let before = self.digest()?;
        let result = act(&mut self.rollout)?;
        frozen.push(Frozen { name: name.to_owned(), before, after: self.digest()? });
        Ok(result)
    }

    /// SHA-256 of all rings' bytes and flags.
    fn digest(&self) -> Result<String, Failure> {
        let mut hash = Sha256::new();
        for layer in 0..self.geometry.layers {
            for part in [KvPart::Keys, KvPart::Values] {
                hash.update(self.rollout.ring_bytes(layer, part)?);
            }
        }
        for ring in [self.rollout.planner().local(), self.rollout.planner().global()] {
            hash.update(ring.written().iter().map(|&flag| u8::from(flag)).collect::<Vec<_>>());
        }
        Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// The graph's Euler step: computed in f32, then rounded to the graphs' type.
    fn euler(&self, x: &mut [f32], v: &[f32], dsigma: f32) {
        x.iter_mut().zip(v).for_each(|(x, v)| *x += dsigma * v);
        self.round(x);
    }

    /// Rounds to the graphs' type, as an upload to the device does.
    fn round(&self, x: &mut [f32]) {
        if self.precision == Precision::F16 {
            x.iter_mut().for_each(|x| *x = half::f16::from_f32(*x).to_f32());
        }
    }

    fn latent_shape(&self) -> [usize; 3] {
        let l = self.geometry.latent;
        [l.channels as usize, l.height as usize, l.width as usize]
    }
}
