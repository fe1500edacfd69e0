//! Conditioning by noise levels: the results of the nodes that depend on noise levels alone, computed once for each level.

use std::sync::Arc;

use super::transformer::{SharedBuffers, Transformer};
use crate::allocate;
use crate::bundle::{ConditioningModel, KEPT_LEVELS, ModelSource, NamedTensor, Precision, with_weights_inside};
use crate::locks::Mutex;
use crate::runtime::{BufferId, ContextLimits, Device, ExecutionContext, Region, TensorSpec};
use crate::{Error, ErrorKind, Result};

/// Noise levels of a pass: one of each latent.
pub(super) type Levels = Vec<f32>;

/// The conditioning at the levels of one pass: the bytes of each value.
type Values = Arc<[Vec<u8>]>;

/// The conditioning of one graph by noise levels: its model, and the values of the levels that were asked for last. Shared by rollouts.
pub(super) struct LevelConditioning {
    device: Device,
    /// A model with its weights inside. The device has its session, and so its weights, only while values are computed.
    onnx: Vec<u8>,
    levels: TensorSpec,
    values: Vec<TensorSpec>,
    /// Bytes that the session takes on the device.
    session_bytes: u64,
    /// At most [`KEPT_LEVELS`]: those of presets, then the others, the last used ones last.
    computed: Mutex<Vec<(Levels, Values)>>,
    /// Number of levels of presets.
    of_presets: usize,
}

impl LevelConditioning {
    /// Takes the weights of `model` from those of the whole model, `source`, and computes the values at `levels`, which are kept.
    pub(super) fn new(
        device: &Device,
        model: &ConditioningModel,
        source: &ModelSource<'_>,
        latents: usize,
        levels: &[Levels],
    ) -> Result<Self> {
        let own = ModelSource { onnx: &model.onnx, external: source.external.clone() };
        let made = Self {
            device: device.clone(),
            onnx: with_weights_inside(&own)?,
            levels: TensorSpec::new("sigma", Precision::F32, &[latents]),
            values: model.values.iter().map(value_spec).collect(),
            session_bytes: model.session_bytes(),
            computed: Mutex::new(Vec::new()),
            of_presets: levels.len().min(KEPT_LEVELS / 2),
        };
        made.compute(levels)?;
        Ok(made)
    }

    /// Types and shapes of the values.
    pub(super) fn values(&self) -> &[TensorSpec] {
        &self.values
    }

    /// Bytes of the values at the levels of one pass.
    pub(super) fn bytes(&self) -> u64 {
        self.values.iter().map(|value| value.bytes() as u64).sum()
    }

    /// Computes the values at `levels` that are not known yet. A step then makes no session.
    pub(super) fn prepare(&self, levels: &[Levels]) -> Result<()> {
        self.at(levels).map(drop)
    }

    /// The values at each of `levels`, in that order.
    fn at(&self, levels: &[Levels]) -> Result<Vec<Values>> {
        let known: Vec<Option<Values>> = {
            let mut computed = self.computed.lock();
            let mut find = |wanted: &Levels| {
                let at = computed.iter().position(|(own, _)| is_same(own, wanted))?;
                let values = computed[at].1.clone();
                if at >= self.of_presets {
                    computed[at..].rotate_left(1);
                }
                Some(values)
            };
            levels.iter().map(&mut find).collect()
        };
        let missing: Vec<Levels> =
            levels.iter().zip(&known).filter(|(_, known)| known.is_none()).map(|(levels, _)| levels.clone()).collect();
        let mut new = if missing.is_empty() { Vec::new() } else { self.compute(&missing)? }.into_iter();
        Ok(known.into_iter().filter_map(|known| known.or_else(|| new.next())).collect())
    }

    /// Computes values, and keeps them. No lock is held while the session runs, so that two rollouts may compute the same.
    fn compute(&self, levels: &[Levels]) -> Result<Vec<Values>> {
        let available = self.device.available_memory();
        if let Some(available) = available.filter(|&available| available < self.session_bytes) {
            let (needed, available) = (self.session_bytes.div_ceil(1 << 20), available >> 20);
            let cause =
                format!("{needed} MiB of the adapter are needed to compute noise levels, {available} MiB are left");
            return Err(Error::new(ErrorKind::OutOfMemory, cause)
                .field("schedule")
                .remedy("Use a preset's schedule, whose levels are computed at load, or free memory of the adapter"));
        }
        let source = ModelSource { onnx: &self.onnx, external: Vec::new() };
        let (inputs, outputs) = (vec![self.levels.clone()], self.values.clone());
        let graph = self.device.graph("conditioning", &source, &[], inputs, outputs, None)?;
        let mut context = self.device.context(ContextLimits::default())?;
        let specs = std::iter::once(&self.levels).chain(&self.values);
        let buffers = specs.map(|spec| context.buffer(spec.bytes())).collect::<Result<Vec<_>>>()?;
        let binding = context.bind(&graph, &buffers)?;
        let mut computed = Vec::with_capacity(levels.len());
        for levels in levels {
            context.upload(buffers[0], 0, bytemuck::cast_slice(levels))?;
            context.run(binding)?;
            let read = |(spec, &buffer): (&TensorSpec, &BufferId)| {
                let mut bytes = allocate::zeroed(spec.bytes())?;
                context.read(buffer, 0, &mut bytes).map(|()| bytes)
            };
            computed.push(self.values.iter().zip(&buffers[1..]).map(read).collect::<Result<Values>>()?);
        }
        let mut kept = self.computed.lock();
        kept.extend(levels.iter().cloned().zip(computed.iter().cloned()));
        let excess = kept.len().saturating_sub(KEPT_LEVELS);
        let first = self.of_presets.min(kept.len() - excess);
        kept.drain(first..first + excess);
        Ok(computed)
    }
}

/// Type and shape of a value between models.
pub(super) fn value_spec(value: &NamedTensor) -> TensorSpec {
    TensorSpec::new(&value.name, value.precision, &value.shape)
}

fn is_same(a: &[f32], b: &[f32]) -> bool {
    a.iter().map(|level| level.to_bits()).eq(b.iter().map(|level| level.to_bits()))
}

/// The conditioning of one rollout's passes, in its context. On WebGPU kept values stay in the host's memory, as buffers do that no graph is bound to.
pub(super) struct LevelInputs {
    source: Arc<LevelConditioning>,
    /// What passes read.
    inputs: Vec<BufferId>,
    /// Noise levels, and the buffers that have their values; no levels where buffers have none. The last one lacks buffers if there was no memory for
    /// them.
    kept: Vec<(Levels, Vec<BufferId>)>,
    /// How often the context had lost work when they were uploaded.
    lost_submissions: u64,
}

impl LevelInputs {
    /// Allocates memory for the values at `count` levels. `None` for a transformer without conditioning.
    pub(super) fn of(
        context: &mut dyn ExecutionContext,
        transformer: &Transformer,
        shared: &SharedBuffers,
        count: usize,
    ) -> Result<Option<Self>> {
        let Some(source) = transformer.conditioning() else { return Ok(None) };
        let inputs = shared.conditioning.clone();
        let mut made = Self { source: source.clone(), inputs, kept: Vec::new(), lost_submissions: 0 };
        (0..count).try_for_each(|_| made.add(context))?;
        Ok(Some(made))
    }

    fn add(&mut self, context: &mut dyn ExecutionContext) -> Result<()> {
        let values = &self.source.values;
        if self.kept.last().is_none_or(|(_, buffers)| buffers.len() == values.len()) {
            self.kept.push((Vec::new(), Vec::new()));
        }
        let Some((_, buffers)) = self.kept.last_mut() else { return Ok(()) };
        while let Some(value) = values.get(buffers.len()) {
            buffers.push(context.buffer(value.bytes())?);
        }
        Ok(())
    }

    /// Makes the values at all of `levels` available for [`select`](Self::select), until the next call.
    pub(super) fn prepare<'l>(
        &mut self,
        context: &mut dyn ExecutionContext,
        levels: impl Iterator<Item = &'l [f32]> + Clone,
    ) -> Result<()> {
        // Uploads of earlier calls may not have reached the device.
        if self.lost_submissions != context.lost_submissions() {
            self.kept.iter_mut().for_each(|(levels, _)| levels.clear());
            self.lost_submissions = context.lost_submissions();
        }
        let mut missing: Vec<Levels> = Vec::new();
        for wanted in levels.clone() {
            let known = self.kept.iter().map(|(own, _)| own).chain(&missing);
            if !known.into_iter().any(|known| is_same(known, wanted)) {
                missing.push(wanted.to_vec());
            }
        }
        if missing.is_empty() {
            return Ok(());
        }
        let values = self.source.at(&missing)?;
        for (wanted, values) in missing.into_iter().zip(values) {
            let is_free = |(own, buffers): &(Levels, Vec<BufferId>)| {
                buffers.len() == self.source.values.len() && !levels.clone().any(|levels| is_same(levels, own))
            };
            let at = match self.kept.iter().position(is_free) {
                Some(at) => at,
                None => {
                    self.add(context)?;
                    self.kept.len() - 1
                }
            };
            let (own, buffers) = &mut self.kept[at];
            own.clear();
            for (buffer, bytes) in buffers.iter().zip(values.iter()) {
                context.upload(*buffer, 0, bytes)?;
            }
            *own = wanted;
        }
        Ok(())
    }

    /// Copies the values at `levels` to where the next pass reads them. [`prepare`](Self::prepare) must have made them available.
    pub(super) fn select(&self, context: &mut dyn ExecutionContext, levels: &[f32]) -> Result<()> {
        let found = self.kept.iter().find(|(own, _)| is_same(own, levels));
        let (_, buffers) = found.expect("the levels of a prepared pass");
        for (&input, &buffer) in self.inputs.iter().zip(buffers) {
            let whole = Region { to: 0, from: 0, len: context.size(input) };
            context.copy(input, buffer, &[whole])?;
        }
        Ok(())
    }
}
