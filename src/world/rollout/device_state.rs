//! A rollout's memory on the device: its buffers, the graphs bound to them, and the work of a step.

use std::borrow::Borrow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::times::StepMeasurement;
use crate::allocate;
use crate::bundle::Precision;
use crate::runtime::{
    BufferId, ContextLimits, DecodedPicture, ExecutionContext, FiniteCheckId, RecordedCopiesId, RecordedCopy, Region,
    element_size,
};
#[cfg(windows)]
use crate::runtime::{Decoded, Snapshot};
use crate::world::autoencoder::Autoencoder;
use crate::world::convert;
use crate::world::graph_spec::Shapes;
use crate::world::kv_cache::{KvCache, KvPart, MadeCommit};
use crate::world::passes::Passes;
use crate::world::plan::{CachePass, StepPlan};
use crate::world::resize::Bilinear;
use crate::world::schedule::SigmaTable;
use crate::world::world::World;
use crate::{Error, ErrorKind, Picture, Result};

/// Groups of a step's finite check. The group after them is K and V.
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

/// The execution context of a rollout and everything that lives in it. It holds no clock and no setting: those are the planner's.
pub(super) struct DeviceState {
    // Declared first, so that it is dropped first: it owns the buffers, bindings and recorded copies, and waits for the device before
    // it frees them. The other fields only hold ids of them.
    pub(super) context: Box<dyn ExecutionContext>,
    kv: KvCache,
    autoencoder: Autoencoder,
    /// The last finished latent.
    latent: BufferId,
    passes: Passes,
    /// Copies the finished latent from the passes' buffer to `latent`.
    keep_latent: RecordedCopiesId,
    /// A finite check of all results of a step, for each side of the decoder. Its groups are `LATENT`, `DECODED`, and K and V.
    finite_checks: [FiniteCheckId; 2],
    /// The same for a step that commits the latent before it: K and V are that latent's. Only where the world has the joined graph.
    joined_checks: Option<[FiniteCheckId; 2]>,
    /// A commit of a failed step that could not be undone either.
    not_undone: Option<MadeCommit>,
    /// A finite check of the latent alone.
    latent_check: FiniteCheckId,
    shapes: Shapes,
    precision: Precision,
}

impl DeviceState {
    /// Allocates the memory of a rollout of `world` and binds its graphs. While `stop` is set, no graph runs.
    pub(super) fn new(world: &World, stop: Arc<AtomicBool>) -> Result<Self> {
        let limits = ContextLimits { longest_submission: world.longest_submission(), stop: Some(stop) };
        let mut context = world.device().context(limits)?;
        let kv = KvCache::new(&mut *context, world)?;
        let latent = context.buffer(world.shapes.latent_len() * element_size(world.precision()))?;
        let passes = Passes::new(&mut *context, world, &kv, latent)?;
        let autoencoder = Autoencoder::new(&mut *context, world, passes.latent())?;
        let whole = Region { to: 0, from: 0, len: context.size(passes.latent()) };
        let keep_latent =
            context.record_copies(vec![RecordedCopy { to: latent, from: passes.latent(), regions: vec![whole] }])?;
        let (new_latent, precision) = ([passes.latent()], world.precision());
        let mut step_checks = |slabs: &[BufferId]| {
            let [first, second] = autoencoder.sides();
            let mut check = |decoded| context.add_finite_check(&[&new_latent, decoded, slabs], precision);
            Ok::<_, Error>([check(first)?, check(second)?])
        };
        let finite_checks = step_checks(&kv.slabs().collect::<Vec<_>>())?;
        let finished_slabs: Vec<_> = kv.finished_slabs().collect();
        let joined_checks = if finished_slabs.is_empty() { None } else { Some(step_checks(&finished_slabs)?) };
        let latent_check = context.add_finite_check(&[&new_latent], precision)?;
        let shapes = world.shapes;
        Ok(Self {
            context,
            kv,
            autoencoder,
            latent,
            passes,
            keep_latent,
            finite_checks,
            joined_checks,
            not_undone: None,
            latent_check,
            shapes,
            precision,
        })
    }

    /// Prepares passes at the noise levels of a schedule.
    pub(super) fn prepare_levels(&mut self, table: &SigmaTable) -> Result<()> {
        self.passes.prepare_levels(&mut *self.context, table)
    }

    /// Maximum number of denoise passes of a step.
    pub(super) fn max_passes(&self) -> usize {
        self.passes.max_passes()
    }

    /// Sets the latent that an append starts from.
    pub(super) fn set_latent(&mut self, latent: &[f32]) -> Result<()> {
        self.passes.set_latent(&mut *self.context, latent)
    }

    /// Encodes pictures to the latent that an append starts from. After the append, [`commit_encoding`](Self::commit_encoding) must
    /// follow.
    pub(super) fn encode_for_append(&mut self, pictures: &[impl Borrow<Picture>]) -> Result<()> {
        match self.autoencoder.encode(&mut *self.context, pictures)? {
            true => Ok(()),
            false => Err(not_finite("the encoder's memory")),
        }
    }

    /// Makes the encoder's memories of the last encoding current, if its stream is kept.
    pub(super) fn commit_encoding(&mut self) {
        self.autoencoder.commit_encoding();
    }

    /// The latent of a picture, `[C, h, w]`.
    pub(super) fn encode_picture(&mut self, picture: &Picture) -> Result<Vec<f32>> {
        // The check below covers the latent; memories of a kept stream do not become current.
        self.autoencoder.encode(&mut *self.context, &[picture])?;
        let mut latent = allocate::zeroed(self.shapes.latent_len())?;
        convert::read(&*self.context, self.precision, self.passes.latent(), 0, &mut latent)?;
        match self.context.find_not_finite(self.latent_check)? {
            None => Ok(latent),
            Some(_) => Err(not_finite("the encoded latent")),
        }
    }

    /// See [`Rollout::keep_encoder_stream`](super::Rollout::keep_encoder_stream).
    pub(super) fn keep_encoder_stream(&mut self, keep: bool) -> Result<()> {
        self.autoencoder.keep_stream(&mut *self.context, keep)
    }

    /// Whether the encoder's stream is kept.
    pub(super) fn keeps_encoder_stream(&self) -> bool {
        self.autoencoder.keeps_stream()
    }

    /// Does all device work of a step, from its denoise passes on: they start from the plan's noise, or from a latent that was set or
    /// encoded. The state changes only after every result is complete and finite, and then all at once; a deferred commit is made before, and
    /// undone if the step fails.
    pub(super) fn execute(&mut self, plan: &StepPlan, measured: &mut StepMeasurement) -> Result<()> {
        self.finish_undo()?;
        self.passes.prepare(&mut *self.context, plan, [0.0, 0.0])?;
        let start = Instant::now();
        // A joined pass embeds its own.
        if plan.pending.is_none() || plan.sigmas.len() > 1 {
            self.passes.embed_controls(&mut *self.context)?;
        }
        self.passes.start(&mut *self.context, plan)?;
        let Some(pending) = &plan.pending else { return self.execute_from(plan, 0, start, measured) };
        self.passes.joined_pass(&mut *self.context, plan, pending)?;
        // Its time is that of the first denoise pass, if there is one.
        let start = match plan.sigmas.is_empty() {
            true => {
                measured.stages.cache.add(1, start);
                Instant::now()
            }
            false => {
                measured.stages.cache.count += 1;
                start
            }
        };
        // The other passes read it from the ring.
        let before = self.context.bytes().copied;
        let made = self.kv.commit_finished(&mut *self.context, pending.local.slot, pending.global.slot)?;
        let copied = self.context.bytes().copied - before;
        let result = self.execute_from(plan, 1, start, measured);
        match &result {
            // Half of the bytes were copied to the backup.
            Ok(()) => measured.ring_bytes += copied / 2,
            Err(_) => {
                if let Err(why) = KvCache::undo(&mut *self.context, &made) {
                    log::warn!("the ring could not be restored after a failed step; the next step tries again: {why}");
                    self.not_undone = Some(made);
                }
            }
        }
        result
    }

    /// Restores the ring, if a failed step could not.
    fn finish_undo(&mut self) -> Result<()> {
        if let Some(made) = &self.not_undone {
            KvCache::undo(&mut *self.context, made)?;
            self.not_undone = None;
        }
        Ok(())
    }

    /// Fails while the ring holds keys and values of a failed step.
    pub(super) fn check_restored(&self) -> Result<()> {
        match self.not_undone {
            None => Ok(()),
            Some(_) => Err(Error::new(ErrorKind::Device, "the ring could not be restored after a failed step")
                .remedy("Make the step again")),
        }
    }

    /// The work of a step from denoise pass `first` on. `start` is when its denoising started.
    fn execute_from(
        &mut self,
        plan: &StepPlan,
        first: usize,
        start: Instant,
        measured: &mut StepMeasurement,
    ) -> Result<()> {
        let context = &mut *self.context;
        self.passes.denoise(context, plan, first)?;
        measured.stages.denoise.add(plan.sigmas.len() as u64, start);
        if plan.cache == CachePass::Separate {
            let start = Instant::now();
            self.passes.extra_pass(context, plan)?;
            measured.stages.cache.add(1, start);
        }
        let start = Instant::now();
        let decoding = self.autoencoder.decode(context, plan.prime)?;
        measured.stages.decode.add(u64::from(plan.prime) + 1, start);
        if let Err(error) = self.commit(plan, decoding.side(), measured) {
            self.autoencoder.undo(&mut *self.context, decoding)?;
            return Err(error);
        }
        self.autoencoder.commit(decoding);
        Ok(())
    }

    /// Checks the results of a step, decoded to `side`, and writes latent and ring slots.
    fn commit(&mut self, plan: &StepPlan, side: usize, measured: &mut StepMeasurement) -> Result<()> {
        let commits_kv = plan.pending.is_some() || plan.commits_itself();
        let start = Instant::now();
        // One check for all results, because it waits for the device.
        let checks =
            if plan.pending.is_some() { self.joined_checks.unwrap_or(self.finite_checks) } else { self.finite_checks };
        let what = match self.context.find_not_finite(checks[side])? {
            None => None,
            Some(LATENT) => Some("latent"),
            Some(DECODED) => Some("the decoder's view of latent"),
            // K and V that are not committed need not be finite.
            Some(_) if !commits_kv => None,
            Some(_) => Some("K or V of latent"),
        };
        if let Some(what) = what {
            return Err(not_finite(&format!("{what} {}", plan.latent)));
        }
        let before = self.context.bytes().copied;
        self.kv.commit(&mut *self.context, plan.local.slot, plan.global.slot, self.keep_latent)?;
        measured.ring_bytes = self.context.bytes().copied - before - self.context.size(self.latent) as u64;
        measured.stages.commit.add(u64::from(commits_kv), start);
        Ok(())
    }

    /// Runs one frozen pass; see [`Rollout::probe`](super::Rollout::probe).
    pub(super) fn probe(&mut self, plan: &StepPlan, sigma: f32, x: &[f32]) -> Result<Probe> {
        self.passes.prepare(&mut *self.context, plan, [sigma, -1.0])?;
        self.passes.embed_controls(&mut *self.context)?;
        self.passes.set_latent(&mut *self.context, x)?;
        self.passes.extra_pass(&mut *self.context, plan)?;
        let mut velocity = allocate::zeroed(x.len())?;
        self.passes.read_next(&*self.context, &mut velocity)?;
        velocity.iter_mut().zip(x).for_each(|(v, x)| *v = x - *v);
        let (mut keys, mut values) = (Vec::new(), Vec::new());
        for (i, slab) in self.kv.slabs().enumerate() {
            let mut half = allocate::zeroed(self.shapes.slab_len())?;
            convert::read(&*self.context, self.precision, slab, 0, &mut half)?;
            if i % 2 == 0 { keys.push(half) } else { values.push(half) }
        }
        Ok(Probe { velocity, keys, values })
    }

    /// Zeroes rings, last latent, and memories of decoder and encoder: all or nothing.
    pub(super) fn clear(&mut self) -> Result<()> {
        let buffers: Vec<_> = self.state_buffers().collect();
        self.context.clear(&buffers)
    }

    /// All buffers of a saved state, in the order of its format.
    pub(super) fn state_buffers(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.kv
            .rings()
            .chain([self.latent])
            .chain(self.autoencoder.decoder_state())
            .chain(self.autoencoder.encoder_state())
    }

    /// Whether `buffer` is the ring of a global layer.
    pub(super) fn is_global_ring(&self, buffer: BufferId) -> bool {
        self.kv.is_global_ring(buffer)
    }

    /// Reads the last latent; waits for it.
    pub(super) fn read_latent(&self, latent: &mut [f32]) -> Result<()> {
        convert::read(&*self.context, self.precision, self.latent, 0, latent)
    }

    /// Reads decoded pictures from picture `i` on, as many as fit in `planes`, `[n, 3, H, W]`; waits for them.
    pub(super) fn read_decoded(&self, i: usize, planes: &mut [f32]) -> Result<()> {
        self.autoencoder.read(&*self.context, i, planes)
    }

    /// Reads decoded picture `index`, resized by the device; waits for it. Returns false, and does nothing, if the device cannot resize.
    pub(super) fn read_picture(&mut self, index: usize, resize: &Bilinear, picture: &mut Picture) -> Result<bool> {
        let from = self.decoded_picture(self.autoencoder.pictures(), index, resize);
        self.context.read_picture(&from, picture)
    }

    /// Makes what [`read_picture`](Self::read_picture) needs, for the pictures of any later latent.
    pub(super) fn prepare_read_picture(&mut self, resize: &Bilinear) -> Result<()> {
        for planes in self.autoencoder.pictures_of_both_sides() {
            let from = self.decoded_picture(planes, 0, resize);
            self.context.prepare_read_picture(&from)?;
        }
        Ok(())
    }

    fn decoded_picture<'a>(&self, planes: BufferId, index: usize, resize: &'a Bilinear) -> DecodedPicture<'a> {
        let [rows, columns] = resize.taps();
        let Shapes { pictures, decoded: size, .. } = self.shapes;
        DecodedPicture { planes, pictures, size, precision: self.precision, index, rows, columns }
    }

    /// The first `count` buffers of the decoder's state.
    pub(super) fn decoder_memories(&self, count: usize) -> Result<Vec<Vec<f32>>> {
        let element = element_size(self.precision);
        self.autoencoder
            .decoder_state()
            .take(count)
            .map(|buffer| {
                let mut memory = allocate::zeroed(self.context.size(buffer) / element)?;
                convert::read(&*self.context, self.precision, buffer, 0, &mut memory)?;
                Ok(memory)
            })
            .collect()
    }

    /// K or V of one layer's ring; `None` for a layer that does not exist.
    pub(super) fn ring_bytes(&self, layer: usize, part: KvPart) -> Option<Result<Vec<u8>>> {
        let buffer = self.kv.ring(layer, part)?;
        let read = || {
            let mut bytes = allocate::zeroed(self.context.size(buffer))?;
            self.context.read(buffer, 0, &mut bytes)?;
            Ok(bytes)
        };
        Some(read())
    }

    /// Allocates device memory for a copy of the last latent and of `pictures` pictures of `size`; `None` if the device is not a
    /// Direct3D 12 device.
    #[cfg(windows)]
    pub(super) fn allocate_snapshot(&mut self, pictures: usize, size: (u32, u32)) -> Result<Option<Snapshot>> {
        self.context.allocate_snapshot(self.latent, pictures, size)
    }

    /// Submits copies of the last latent and of the decoded pictures `pictures`, each of `size`, into `snapshot`. Does not wait.
    #[cfg(windows)]
    pub(super) fn fill_snapshot(&mut self, pictures: &[u32], size: (u32, u32), snapshot: &mut Snapshot) -> Result<()> {
        let planes = self.autoencoder.pictures();
        let decoded = Decoded { planes, pictures, size, precision: self.precision };
        self.context.fill_snapshot(&decoded, self.latent, snapshot)
    }
}

/// An error for a result of the device with a value that is not finite.
fn not_finite(what: &str) -> Error {
    Error::new(ErrorKind::Device, format!("{what} came out with a number that is not finite"))
}
