//! The conditioning of a transformer's passes: what they compute from their noise levels alone, computed once for each level.

use std::sync::Arc;

use super::schedule::MAX_POINTS;
use super::transformer::{SharedBuffers, Transformer};
use crate::Result;
use crate::bundle::{ConditioningModel, ModelSource, Precision, with_weights_inside};
use crate::locks::Mutex;
use crate::runtime::{BufferId, Device, ExecutionContext, Region, TensorSpec};

/// Noise levels of a pass: one of each latent.
type Levels = Vec<f32>;

/// The conditioning at the levels of one pass: the bytes of each value.
type Values = Arc<[Vec<u8>]>;

/// The conditioning of one graph: its model, and the values of the levels that were asked for last. Shared by rollouts.
pub(super) struct Conditioning {
    device: Device,
    /// A model with its weights inside. The device has its session, and so its weights, only while values are computed.
    onnx: Vec<u8>,
    levels: TensorSpec,
    values: Vec<TensorSpec>,
    /// At most [`MAX_POINTS`], the oldest first.
    computed: Mutex<Vec<(Levels, Values)>>,
}

impl Conditioning {
    /// Takes the weights of `model` from those of the whole model, `source`, and computes the values at `levels`.
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
            values: model
                .values
                .iter()
                .map(|value| TensorSpec::new(&value.name, value.precision, &value.shape))
                .collect(),
            computed: Mutex::new(Vec::new()),
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

    /// The values at each of `levels`, in that order.
    fn at(&self, levels: &[Levels]) -> Result<Vec<Values>> {
        let known: Vec<Option<Values>> = {
            let computed = self.computed.lock();
            let find = |wanted: &Levels| computed.iter().find(|(own, _)| is_same(own, wanted)).map(|(_, v)| v.clone());
            levels.iter().map(find).collect()
        };
        let missing: Vec<Levels> =
            levels.iter().zip(&known).filter(|(_, known)| known.is_none()).map(|(levels, _)| levels.clone()).collect();
        let mut new = if missing.is_empty() { Vec::new() } else { self.compute(&missing)? }.into_iter();
        Ok(known.into_iter().filter_map(|known| known.or_else(|| new.next())).collect())
    }

    /// Computes values, and keeps them. No lock is held while the session runs, so that two rollouts may compute the same.
    fn compute(&self, levels: &[Levels]) -> Result<Vec<Values>> {
        let source = ModelSource { onnx: &self.onnx, external: Vec::new() };
        let (inputs, outputs) = (vec![self.levels.clone()], self.values.clone());
        let graph = self.device.graph("conditioning", &source, &[], inputs, outputs, None)?;
        let mut context = self.device.context()?;
        let specs = std::iter::once(&self.levels).chain(&self.values);
        let buffers = specs.map(|spec| context.buffer(spec.bytes())).collect::<Result<Vec<_>>>()?;
        let binding = context.bind(&graph, &buffers)?;
        let mut computed = Vec::with_capacity(levels.len());
        for levels in levels {
            context.upload(buffers[0], 0, bytemuck::cast_slice(levels))?;
            context.run(binding)?;
            let read = |(spec, &buffer): (&TensorSpec, &BufferId)| {
                let mut bytes = vec![0; spec.bytes()];
                context.read(buffer, 0, &mut bytes).map(|()| bytes)
            };
            computed.push(self.values.iter().zip(&buffers[1..]).map(read).collect::<Result<Values>>()?);
        }
        let mut kept = self.computed.lock();
        kept.extend(levels.iter().cloned().zip(computed.iter().cloned()));
        let excess = kept.len().saturating_sub(MAX_POINTS);
        kept.drain(..excess);
        Ok(computed)
    }
}

fn is_same(a: &[f32], b: &[f32]) -> bool {
    a.iter().map(|level| level.to_bits()).eq(b.iter().map(|level| level.to_bits()))
}

/// The conditioning of one rollout's passes, on its device.
pub(super) struct ConditioningInputs {
    source: Arc<Conditioning>,
    /// What passes read.
    inputs: Vec<BufferId>,
    /// Noise levels, and the buffers that have their values; no levels where buffers have none.
    kept: Vec<(Levels, Vec<BufferId>)>,
}

impl ConditioningInputs {
    /// Allocates memory for the values at `count` levels. `None` for a transformer without conditioning.
    pub(super) fn of(
        context: &mut dyn ExecutionContext,
        transformer: &Transformer,
        shared: &SharedBuffers,
        count: usize,
    ) -> Result<Option<Self>> {
        let Some(source) = transformer.conditioning() else { return Ok(None) };
        let mut made = Self { source: source.clone(), inputs: shared.conditioning.clone(), kept: Vec::new() };
        (0..count).try_for_each(|_| made.add(context))?;
        Ok(Some(made))
    }

    fn add(&mut self, context: &mut dyn ExecutionContext) -> Result<()> {
        let buffers = self.source.values.iter().map(|value| context.buffer(value.bytes())).collect::<Result<_>>()?;
        self.kept.push((Vec::new(), buffers));
        Ok(())
    }

    /// Makes the values at all of `levels` available for [`select`](Self::select), until the next call.
    pub(super) fn prepare<'l>(
        &mut self,
        context: &mut dyn ExecutionContext,
        levels: impl Iterator<Item = &'l [f32]> + Clone,
    ) -> Result<()> {
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
            let is_free = |(own, _): &(Levels, Vec<BufferId>)| !levels.clone().any(|levels| is_same(levels, own));
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

    /// Forgets all values: after a failure, uploads may not have reached the device.
    pub(super) fn forget(&mut self) {
        self.kept.iter_mut().for_each(|(levels, _)| levels.clear());
    }
}
