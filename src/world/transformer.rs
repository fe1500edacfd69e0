//! The transformer of a world: one graph, or slices of it that run one after the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use half::f16;

use super::conditioning::{LevelConditioning, Levels, value_spec};
use super::graph_spec::{self, GraphSpec, Shapes};
use super::preset::Preset;
use super::schedule::SigmaTable;
use crate::bundle::{
    Bundle, ConditioningModels, GraphKind, Manifest, ModelSource, Precision, SliceModel, SliceTensor, Slices,
};
#[cfg(windows)]
use crate::runtime::Work;
use crate::runtime::{BindingId, BufferId, ContextLimits, Device, ElementType, ExecutionContext, Graph, TensorSpec};
use crate::{Error, Result};

/// Timed passes, after one warm-up pass.
const MEASURED_PASSES: usize = 3;

/// Values per upload when inputs are filled for the measurement.
const UPLOAD_CHUNK: usize = 64 << 10;

/// The graphs of a transformer and how they fit together. Shared by rollouts.
pub(super) struct Transformer {
    /// In the order in which they run.
    slices: Vec<Slice>,
    /// Inputs of the whole transformer, then its outputs.
    tensors: Vec<TensorSpec>,
    /// Number of inputs in `tensors`.
    inputs: usize,
    /// Sizes in bytes of the buffers for intermediate tensors between slices.
    intermediates: Vec<usize>,
    /// What runs apart from passes.
    conditioning: SharedConditioning,
}

/// The conditioning of a transformer, the same with every number of slices.
#[derive(Clone, Default)]
pub(super) struct SharedConditioning {
    /// What passes need of their noise levels; `None` if they compute all of that themselves.
    levels: Option<Arc<LevelConditioning>>,
    /// Embeds the controls; `None` if each pass does so.
    controls: Option<Arc<ControlEmbedding>>,
}

/// The graph that runs once in each step, and makes what passes need of the controls.
struct ControlEmbedding {
    graph: Arc<Graph>,
    /// The controls, a position in [`Transformer::tensors`].
    input: usize,
    values: Vec<TensorSpec>,
}

struct Slice {
    graph: Arc<Graph>,
    /// The tensor of each input, then of each output.
    tensors: Vec<Tensor>,
}

/// The tensor that an input or output of a slice is bound to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tensor {
    /// An input or output of the whole transformer, a position in [`Transformer::tensors`].
    Whole(usize),
    /// A position in [`Transformer::intermediates`].
    Intermediate(usize),
    /// A position in [`LevelConditioning::values`].
    OfLevels(usize),
    /// A position in [`ControlEmbedding::values`].
    OfControls(usize),
}

/// Buffers of one context that all bindings of a transformer share, because its passes follow each other.
pub(super) struct SharedBuffers {
    /// Intermediate tensors between slices.
    intermediates: Vec<BufferId>,
    /// The conditioning of the next pass.
    pub(super) conditioning: Vec<BufferId>,
    /// The embedded controls of the step.
    controls: Vec<BufferId>,
}

/// A transformer with all inputs and outputs bound to buffers of one context.
pub(super) struct PassBinding(Vec<BindingId>);

impl PassBinding {
    /// Runs the slices. Between two of them a context that is stopped ends the pass, and one with a limit on queued work may wait.
    pub(super) fn run(&self, context: &mut dyn ExecutionContext) -> Result<()> {
        self.0.iter().try_for_each(|slice| context.run(*slice))
    }
}

/// Device, bundle and shapes that a transformer is loaded from.
pub(super) struct TransformerSource<'a> {
    pub(super) device: &'a Device,
    pub(super) bundle: &'a Bundle,
    pub(super) precision: Precision,
    pub(super) shapes: &'a Shapes,
    pub(super) global_window: u32,
}

impl TransformerSource<'_> {
    fn manifest(&self) -> &Manifest {
        self.bundle.manifest()
    }

    /// The models of the conditioning of the transformer, or of the joined graph.
    pub(super) fn conditioning_models(&self, kind: GraphKind) -> Result<ConditioningModels> {
        self.bundle.splitting(kind, self.precision, self.global_window)?.conditioning()
    }

    /// Computes the conditioning at the noise levels of all presets, and makes the session that embeds controls. `proceed` is called before each of
    /// the two sessions. The joined graph's uses the weights of `shared` where its device can share them.
    ///
    /// # Errors
    /// As [`World::load_with`](super::World::load_with).
    pub(super) fn load_conditioning(
        &self,
        kind: GraphKind,
        models: &ConditioningModels,
        shared: &SharedConditioning,
        proceed: &dyn Fn() -> Result<()>,
    ) -> Result<SharedConditioning> {
        let source = self.bundle.model(kind, self.precision)?;
        let ConditioningModels { of_levels, of_controls } = models;
        let levels = of_levels.as_ref().map(|model| {
            proceed()?;
            let levels = self.preset_levels(kind);
            LevelConditioning::new(self.device, model, &source, kind.latents() as usize, &levels).map(Arc::new)
        });
        let levels = levels.transpose()?;
        let inputs = self.spec(kind).inputs;
        let controls = of_controls.as_ref().map(|model| {
            proceed()?;
            let embedding = ModelSource { onnx: &model.onnx, external: source.external.clone() };
            let values: Vec<_> = model.values.iter().map(value_spec).collect();
            let (input, outputs) = (vec![inputs[model.input].clone()], values.clone());
            let shared = shared.controls.as_ref().map(|controls| &controls.graph);
            let graph = self.device.graph("controls", &embedding, &[], input, outputs, shared)?;
            Ok::<_, Error>(Arc::new(ControlEmbedding { graph, input: model.input, values }))
        });
        Ok(SharedConditioning { levels, controls: controls.transpose()? })
    }

    /// Makes the sessions of `slices` slices; `proceed` is called before each.
    ///
    /// # Errors
    /// As [`World::load_with`](super::World::load_with).
    pub(super) fn load(
        &self,
        slices: u32,
        conditioning: &SharedConditioning,
        proceed: &dyn Fn() -> Result<()>,
    ) -> Result<Transformer> {
        let split = self.bundle.splitting(GraphKind::Transformer, self.precision, self.global_window)?.split(slices)?;
        self.sessions(GraphKind::Transformer, split, conditioning, None, &|slice| {
            proceed()?;
            Ok(match slices {
                1 => "transformer".to_owned(),
                _ => format!("transformer, slice {slice} of {slices}"),
            })
        })
    }

    /// Makes the session of the joined graph, which uses the weights of `transformer` where its device can share them.
    ///
    /// # Errors
    /// As [`load`](Self::load), and `Unsupported` if the bundle has no joined graph.
    pub(super) fn load_joined(
        &self,
        transformer: &Transformer,
        conditioning: &SharedConditioning,
    ) -> Result<Transformer> {
        let split = self.bundle.splitting(GraphKind::Joined, self.precision, self.global_window)?.split(1)?;
        let shared = transformer.slices.first().map(|slice| &slice.graph);
        self.sessions(GraphKind::Joined, split, conditioning, shared, &|_| Ok("joined pass".to_owned()))
    }

    fn spec(&self, kind: GraphKind) -> GraphSpec {
        let spec = if kind == GraphKind::Joined { graph_spec::joined } else { graph_spec::transformer };
        spec(&self.manifest().geometry, self.shapes, self.precision)
    }

    /// Makes the sessions of a transformer. `name` is called before each with the slice's number, from 1.
    fn sessions(
        &self,
        kind: GraphKind,
        split: Slices,
        conditioning: &SharedConditioning,
        shared: Option<&Arc<Graph>>,
        name: &dyn Fn(usize) -> Result<String>,
    ) -> Result<Transformer> {
        let source = self.bundle.model(kind, self.precision)?;
        let dimensions = graph_spec::dimensions(self.shapes, kind.latents() as usize);
        let Slices { models, intermediates, buffer_sizes } = split;
        let spec = self.spec(kind);
        let (inputs, whole) = (spec.inputs.len(), [spec.inputs, spec.outputs].concat());
        let position = |tensor: &SliceTensor| match *tensor {
            SliceTensor::Input(at) => Tensor::Whole(at),
            SliceTensor::Output(at) => Tensor::Whole(inputs + at),
            SliceTensor::Intermediate(at) => Tensor::Intermediate(intermediates[at].buffer),
            SliceTensor::OfLevels(at) => Tensor::OfLevels(at),
            SliceTensor::OfControls(at) => Tensor::OfControls(at),
        };
        let spec_of = |tensor: &SliceTensor| match *tensor {
            SliceTensor::Input(at) => whole[at].clone(),
            SliceTensor::Output(at) => whole[inputs + at].clone(),
            SliceTensor::Intermediate(at) => value_spec(&intermediates[at].tensor),
            SliceTensor::OfLevels(at) => conditioning.level_values()[at].clone(),
            SliceTensor::OfControls(at) => conditioning.control_values()[at].clone(),
        };
        let make = |(i, model): (usize, &SliceModel)| {
            let what = name(i + 1)?;
            let slice = ModelSource { onnx: &model.onnx, external: source.external.clone() };
            let specs = |tensors: &[SliceTensor]| tensors.iter().map(spec_of).collect();
            let (inputs, outputs) = (specs(&model.inputs), specs(&model.outputs));
            let graph = self.device.graph(&what, &slice, &dimensions, inputs, outputs, shared)?;
            Ok(Slice { graph, tensors: model.inputs.iter().chain(&model.outputs).map(position).collect() })
        };
        let slices = models.iter().enumerate().map(make).collect::<Result<_>>()?;
        let conditioning = conditioning.clone();
        Ok(Transformer { slices, tensors: whole, inputs, intermediates: buffer_sizes, conditioning })
    }

    /// The noise levels of passes of all presets, without duplicates. A joined pass has 0 of the finished latent, and the first level of a schedule, or
    /// again 0 for an append.
    fn preset_levels(&self, kind: GraphKind) -> Vec<Levels> {
        let mut levels: Vec<Levels> = Vec::new();
        for preset in Preset::ALL {
            // A sampler may not allow every schedule.
            let Ok(table) = preset.operating_point().schedule.table(&self.manifest().sampler) else { continue };
            levels.extend(pass_levels(kind, &table));
        }
        levels.sort_by(|a, b| a.iter().map(|level| level.to_bits()).cmp(b.iter().map(|level| level.to_bits())));
        levels.dedup();
        levels
    }

    /// Makes the sessions of as few slices as keep the longest within `limit`, and returns the measured time of the longest one. The whole
    /// transformer is measured first; how many slices are needed is estimated from that time, and measured again. `fits` says whether so many
    /// slices fit in memory. If no number of slices keeps the limit, the largest one that fits is taken.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub(super) fn load_within(
        &self,
        limit: Duration,
        conditioning: &SharedConditioning,
        fits: &dyn Fn(u32) -> bool,
        proceed: &dyn Fn(u32) -> Result<()>,
    ) -> Result<(Transformer, Duration)> {
        let splitting = self.bundle.splitting(GraphKind::Transformer, self.precision, self.global_window)?;
        let mut slices = 1;
        loop {
            let transformer = self.load(slices, conditioning, &|| proceed(slices))?;
            let longest = transformer.measure(self.device)?.into_iter().max().unwrap_or_default();
            log::info!("the longest of {slices} slices of the transformer takes {longest:?}, the limit is {limit:?}");
            let next = more_slices(slices, longest, limit, splitting.max_slices(), |n| splitting.longest_share(n))?;
            let Some(next) = next.and_then(|next| (slices + 1..=next).rev().find(|&n| fits(n))) else {
                if longest > limit {
                    log::warn!("a slice of the transformer takes {longest:?}, more than the limit of {limit:?}");
                }
                return Ok((transformer, longest));
            };
            slices = next;
        }
    }
}

/// The noise levels of the passes of a step with this schedule, and of an append.
fn pass_levels(kind: GraphKind, table: &SigmaTable) -> Vec<Levels> {
    match (kind, table.sigmas.first()) {
        (GraphKind::Joined, Some(&first)) => vec![vec![0.0, first], vec![0.0; 2]],
        _ => table.sigmas.iter().map(|&level| vec![level]).collect(),
    }
}

impl SharedConditioning {
    fn level_values(&self) -> &[TensorSpec] {
        self.levels.as_ref().map_or(&[], |levels| levels.values())
    }

    fn control_values(&self) -> &[TensorSpec] {
        self.controls.as_ref().map_or(&[], |controls| &controls.values)
    }
}

/// The number of slices to try after `slices`, of which the longest takes `longest`; `None` if that is within `limit` or no more than `most`
/// are possible. `share` is the estimated share of the longest of so many slices.
fn more_slices(
    slices: u32,
    longest: Duration,
    limit: Duration,
    most: u32,
    share: impl Fn(u32) -> Result<f64>,
) -> Result<Option<u32>> {
    if longest <= limit || slices >= most {
        return Ok(None);
    }
    let wanted = share(slices)? * limit.as_secs_f64() / longest.as_secs_f64();
    // Grow by at least a quarter, or an estimate that stays too low would try every number.
    for more in (slices + slices.div_ceil(4)).min(most)..most {
        if share(more)? <= wanted {
            return Ok(Some(more));
        }
    }
    Ok(Some(most))
}

impl Transformer {
    /// A transformer that is one graph with these inputs and outputs.
    pub(super) fn whole(graph: Arc<Graph>, spec: GraphSpec) -> Self {
        let (inputs, tensors) = (spec.inputs.len(), [spec.inputs, spec.outputs].concat());
        let slice = Slice { graph, tensors: (0..tensors.len()).map(Tensor::Whole).collect() };
        Self {
            slices: vec![slice],
            tensors,
            inputs,
            intermediates: Vec::new(),
            conditioning: SharedConditioning::default(),
        }
    }

    /// Computes the conditioning of all passes of a step with this schedule, so that no step has to.
    pub(super) fn prepare_levels(&self, kind: GraphKind, table: &SigmaTable) -> Result<()> {
        self.conditioning().map_or(Ok(()), |conditioning| conditioning.prepare(&pass_levels(kind, table)))
    }

    /// Number of slices.
    pub(super) fn slices(&self) -> u32 {
        u32::try_from(self.slices.len()).unwrap_or(u32::MAX)
    }

    /// The graphs, in the order in which they run.
    #[cfg(windows)]
    pub(super) fn graphs(&self) -> impl Iterator<Item = &Arc<Graph>> {
        self.slices.iter().map(|slice| &slice.graph)
    }

    /// Inputs, then outputs.
    pub(super) fn tensors(&self) -> &[TensorSpec] {
        &self.tensors
    }

    /// Number of inputs in [`tensors`](Self::tensors).
    pub(super) fn input_count(&self) -> usize {
        self.inputs
    }

    /// What passes need of their noise levels; `None` if they compute all of that themselves.
    pub(super) fn conditioning(&self) -> Option<&Arc<LevelConditioning>> {
        self.conditioning.levels.as_ref()
    }

    /// The graph that embeds the controls of a step; `None` if each pass does so.
    #[cfg(windows)]
    pub(super) fn controls(&self) -> Option<&Arc<Graph>> {
        self.conditioning.controls.as_ref().map(|controls| &controls.graph)
    }

    /// Whether passes read noise levels, beside the conditioning.
    pub(super) fn reads_levels(&self) -> bool {
        let read = |tensor: &Tensor| matches!(*tensor, Tensor::Whole(at) if self.tensors[at].name == "sigma");
        self.slices.iter().any(|slice| slice.tensors.iter().any(read))
    }

    /// Bytes of a rollout's intermediate tensors between slices, of its embedded controls, and of what it keeps of the conditioning at `levels` noise
    /// levels.
    pub(super) fn intermediate_bytes(&self, levels: usize) -> u64 {
        let conditioning = self.conditioning().map_or(0, |conditioning| conditioning.bytes());
        let controls = self.conditioning.control_values().iter().map(|value| value.bytes() as u64).sum::<u64>();
        let between_slices = self.intermediates.iter().map(|&bytes| bytes as u64).sum::<u64>();
        between_slices + controls + conditioning * (levels as u64 + 1)
    }

    /// Buffers for [`bind`](Self::bind).
    pub(super) fn shared_buffers(&self, context: &mut dyn ExecutionContext) -> Result<SharedBuffers> {
        let mut buffers = |sizes: &mut dyn Iterator<Item = usize>| {
            sizes.map(|bytes| context.buffer(bytes)).collect::<Result<Vec<_>>>()
        };
        Ok(SharedBuffers {
            intermediates: buffers(&mut self.intermediates.iter().copied())?,
            conditioning: buffers(&mut self.conditioning.level_values().iter().map(TensorSpec::bytes))?,
            controls: buffers(&mut self.conditioning.control_values().iter().map(TensorSpec::bytes))?,
        })
    }

    /// Binds the graph that embeds controls, which must run before the passes of a step: `tensors` as in [`bind`](Self::bind). `None` if there is none.
    pub(super) fn bind_controls(
        &self,
        context: &mut dyn ExecutionContext,
        tensors: &[BufferId],
        shared: &SharedBuffers,
    ) -> Result<Option<BindingId>> {
        let Some(embedding) = &self.conditioning.controls else { return Ok(None) };
        let ControlEmbedding { graph, input, .. } = &**embedding;
        let buffers: Vec<BufferId> = std::iter::once(tensors[*input]).chain(shared.controls.iter().copied()).collect();
        context.bind(graph, &buffers).map(Some)
    }

    /// Binds all slices permanently: `tensors` are the inputs of the whole transformer in order, then its outputs in order.
    pub(super) fn bind(
        &self,
        context: &mut dyn ExecutionContext,
        tensors: &[BufferId],
        shared: &SharedBuffers,
    ) -> Result<PassBinding> {
        assert_eq!(tensors.len(), self.tensors.len(), "one buffer for each input and output");
        let buffer = |tensor: &Tensor| match *tensor {
            Tensor::Whole(at) => tensors[at],
            Tensor::Intermediate(at) => shared.intermediates[at],
            Tensor::OfLevels(at) => shared.conditioning[at],
            Tensor::OfControls(at) => shared.controls[at],
        };
        let bind = |slice: &Slice| {
            let buffers: Vec<BufferId> = slice.tensors.iter().map(buffer).collect();
            context.bind(&slice.graph, &buffers)
        };
        self.slices.iter().map(bind).collect::<Result<_>>().map(PassBinding)
    }

    /// For tests: slice, input, and another value of the same size that the slice could read by mistake: another intermediate tensor, or what is made of
    /// the controls for another layer.
    #[cfg(test)]
    fn confusable(&self) -> Vec<(usize, usize, Tensor)> {
        let controls: Vec<usize> = self.conditioning.control_values().iter().map(TensorSpec::bytes).collect();
        let alike = |sizes: &[usize], own: usize| -> Vec<usize> {
            (0..sizes.len()).filter(|&other| other != own && sizes[other] == sizes[own]).collect()
        };
        let mut pairs = Vec::new();
        for (i, slice) in self.slices.iter().enumerate() {
            let inputs = slice.graph.input_count();
            for (at, tensor) in slice.tensors[..inputs].iter().enumerate() {
                let others: Vec<Tensor> = match *tensor {
                    Tensor::Intermediate(own) => {
                        alike(&self.intermediates, own).into_iter().map(Tensor::Intermediate).collect()
                    }
                    Tensor::OfControls(own) => alike(&controls, own).into_iter().map(Tensor::OfControls).collect(),
                    Tensor::Whole(_) | Tensor::OfLevels(_) => Vec::new(),
                };
                pairs.extend(others.into_iter().map(|other| (i, at, other)));
            }
        }
        pairs
    }

    /// For tests: number of mutants for [`mutate`](Self::mutate).
    #[cfg(test)]
    pub(super) fn mutants(&self) -> usize {
        self.confusable().len()
    }

    /// For tests: binds an input of a slice to the buffer of another value.
    #[cfg(test)]
    pub(super) fn mutate(&mut self, mutant: usize) {
        let (slice, input, other) = self.confusable()[mutant];
        self.slices[slice].tensors[input] = other;
    }

    /// Measures passes: the median time of each slice, by the device's clock if it has one.
    fn measure(&self, device: &Device) -> Result<Vec<Duration>> {
        let mut context = device.context(ContextLimits::default())?;
        let buffers: Vec<BufferId> =
            self.tensors.iter().map(|spec| context.buffer(spec.bytes())).collect::<Result<_>>()?;
        // Non-zero values, because kernels may be faster on zeroes.
        let (wide, half) = (vec![0.1_f32; UPLOAD_CHUNK], vec![f16::from_f32(0.1); UPLOAD_CHUNK]);
        let shared = self.shared_buffers(&mut *context)?;
        let conditioning = self.conditioning.level_values();
        let inputs =
            buffers.iter().zip(&self.tensors[..self.inputs]).chain(shared.conditioning.iter().zip(conditioning));
        for (buffer, spec) in inputs {
            let values: &[u8] = match spec.element {
                ElementType::F16 => bytemuck::cast_slice(&half),
                _ => bytemuck::cast_slice(&wide),
            };
            for at in (0..spec.bytes()).step_by(values.len()) {
                context.upload(*buffer, at, &values[..values.len().min(spec.bytes() - at)])?;
            }
        }
        let binding = self.bind(&mut *context, &buffers, &shared)?;
        if let Some(controls) = self.bind_controls(&mut *context, &buffers, &shared)? {
            context.run(controls)?;
        }
        let mut times = vec![Vec::with_capacity(MEASURED_PASSES); self.slices.len()];
        for pass in 0..=MEASURED_PASSES {
            for ((slice, binding), times) in self.slices.iter().zip(&binding.0).zip(&mut times) {
                let start = Instant::now();
                context.run(*binding)?;
                // Waits for the device.
                context.read(buffers[0], 0, &mut [0; 2])?;
                let took = device_time(&mut *context, &slice.graph).unwrap_or_else(|| start.elapsed());
                if pass > 0 {
                    times.push(took);
                }
            }
        }
        let median = |mut times: Vec<Duration>| {
            times.sort_unstable();
            times[times.len() / 2]
        };
        Ok(times.into_iter().map(median).collect())
    }
}

/// Time of the last run of a graph by the device's own clock; `None` if it has none.
fn device_time(context: &mut dyn ExecutionContext, graph: &Arc<Graph>) -> Option<Duration> {
    #[cfg(windows)]
    return context.gpu_time(Work::Runs(graph)).map(|time| time.last).filter(|last| !last.is_zero());
    #[cfg(not(windows))]
    {
        let _ = (context, graph);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_slices_are_tried_as_the_time_of_the_longest_suggests() {
        const MS: Duration = Duration::from_millis(1);
        // 24 layers of equal work.
        let share = |slices: u32| Ok(f64::from(24_u32.div_ceil(slices)) / 24.0);
        let more = |slices, longest: u32, limit: u32| {
            more_slices(slices, longest * MS, limit * MS, 24, share).expect("a number")
        };
        assert_eq!(more(1, 24, 24), None);
        assert_eq!(more(1, 24, 23), Some(2));
        assert_eq!(more(1, 24, 8), Some(3));
        // In five slices the longest has five layers, in six it has four.
        assert_eq!(more(1, 24, 4), Some(6));
        assert_eq!(more(1, 24, 1), Some(24));
        assert_eq!(more(1, 24, 0), Some(24));
        // The estimate was too low: the next one starts from what was measured, and is a quarter more at least.
        assert_eq!(more(6, 5, 4), Some(8));
        assert_eq!(more(12, 5, 4), Some(24));
        assert_eq!(more(23, 2, 1), Some(24));
        assert_eq!(more(24, 2, 1), None);
    }
}
