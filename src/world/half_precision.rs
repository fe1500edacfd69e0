//! Whether float16 is enough for a bundle: one latent of it is made in float32 and in float16, from the same noise, and compared.
//!
//! The float32 transformer also returns the largest magnitude of each value that the float16 transformer holds in float16. So an overflow is found,
//! and its tensor named, also on a device that does not compute in float16 itself: ONNX Runtime's CPU provider does most of it in float32.

use half::f16;

use super::conditioning::LevelInputs;
use super::convert::{self, Uploader};
use super::graph_spec::{self, GraphSpec, Shapes};
use super::noise::NoiseKey;
use super::passes::HIDDEN;
use super::rope::RopeTable;
use super::schedule::Schedule;
use super::transformer::{PassBinding, Transformer};
use crate::allocate;
use crate::bundle::{Bundle, GraphKind, LayerKind, Manifest, ModelSource, ModelWithPeaks, Precision, Residual};
use crate::runtime::{BufferId, ContextLimits, Device, ExecutionContext, TensorSpec, element_size};
use crate::{Error, ErrorKind, Result};

/// The largest relative error, in the L2 norm, of a latent that is made in float16.
pub const MAX_LATENT_ERROR: f64 = 0.03;

/// Comparison of one latent of a bundle in float16 and in float32.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfPrecision {
    /// Relative error of the float16 latent in the L2 norm; infinite if a number of it is not finite.
    pub latent_error: f64,
    /// The layer whose keys and values have the largest relative error in float16, and that error. If some are not finite, the first such layer
    /// and infinity.
    pub worst_layer: (u32, f64),
    /// Of the values that the float16 transformer holds in float16, in float32: the first one in the graph's order that overflows float16, or the
    /// one of the largest magnitude if none does. `None` if the two transformers name their values differently.
    pub peak: Option<Peak>,
    /// Whether the residual stream of the float16 transformer is float32.
    pub is_residual_wide: bool,
}

/// A value of the transformer and its largest magnitude in any pass of a latent.
#[derive(Debug, Clone, PartialEq)]
pub struct Peak {
    /// The value's name in the graph.
    pub tensor: String,
    /// Its largest magnitude.
    pub magnitude: f32,
    /// Whether it is a sum of the residual stream.
    pub is_residual: bool,
}

impl HalfPrecision {
    /// Checks that nothing passes float16's largest number and that the latent's error is at most [`MAX_LATENT_ERROR`].
    ///
    /// # Errors
    /// `Unsupported`, with the tensor or layer, the numbers and a remedy.
    pub fn check(&self) -> Result<()> {
        let wide = "Build it again with the option --residual float32 of `python -m cairn.build rebuild`, or of `quantise` if its weights have fewer \
                    than 16 bits; or load it in f32";
        let f32_only = "Load it in f32";
        let refuse = |field: &str, cause: String, remedy| {
            Err(Error::new(ErrorKind::Unsupported, cause).field(field).remedy(remedy))
        };
        if let Some(peak) = self.peak.as_ref().filter(|peak| peak.magnitude > f16::MAX.to_f32()) {
            let Peak { tensor, magnitude, is_residual } = peak;
            let what = if *is_residual { "a sum of the residual stream" } else { "a value of the transformer" };
            let cause =
                format!("f16 is not enough for this bundle: {what} reaches {magnitude:.0}, and float16 ends at 65504");
            return refuse(tensor, cause, if *is_residual { wide } else { f32_only });
        }
        let (layer, error) = self.worst_layer;
        let (field, percent) = (format!("blocks.{layer}"), |error: f64| 100.0 * error);
        let remedy = if self.is_residual_wide { f32_only } else { wide };
        if !error.is_finite() {
            let cause =
                "f16 is not enough for this bundle: this is the first layer with keys or values that are not finite";
            return refuse(&field, cause.to_owned(), remedy);
        }
        // Keys and values are those of the float32 latent, so they can be finite where the float16 latent is not.
        if !self.latent_error.is_finite() {
            let cause = "f16 is not enough for this bundle: its latent has values that are not finite";
            return refuse("x_next", cause.to_owned(), remedy);
        }
        if self.latent_error > MAX_LATENT_ERROR {
            let cause = format!(
                "f16 is not enough for this bundle: a latent has a relative error of {:.2} %, at most {} % are accepted; this layer's keys and \
                 values have the largest error, {:.2} %",
                percent(self.latent_error),
                percent(MAX_LATENT_ERROR),
                percent(error)
            );
            return refuse(&field, cause, remedy);
        }
        Ok(())
    }
}

/// One latent in float32, with which float16 is compared.
pub(super) struct Reference {
    latent: Latent,
    peak: Option<Peak>,
    is_residual_wide: bool,
}

impl Reference {
    /// Loads the float32 transformer of `bundle` on `device` at its narrowest window, makes a latent, and drops the transformer.
    pub(super) fn make(device: &Device, bundle: &Bundle) -> Result<Self> {
        let manifest = bundle.manifest();
        let shapes = Shapes::new(manifest, manifest.geometry.global.dilation);
        let with_peaks = bundle.transformer_with_peaks()?;
        let mut spec = graph_spec::transformer(&manifest.geometry, &shapes, Precision::F32);
        let peaks = 0..with_peaks.values.len();
        spec.outputs.extend(peaks.map(|i| TensorSpec::new(ModelWithPeaks::output(i), Precision::F32, &[])));
        let ModelSource { external, .. } = bundle.model(GraphKind::Transformer, Precision::F32)?;
        let source = ModelSource { onnx: &with_peaks.onnx, external };
        let dimensions = graph_spec::dimensions(&shapes, 1);
        let GraphSpec { inputs, outputs } = spec.clone();
        let graph = device.graph("transformer in f32", &source, &dimensions, inputs, outputs, None)?;
        let transformer = Transformer::whole(graph, spec);
        let latent = Latent::make(device, &transformer, manifest, &shapes, Precision::F32, None)?;
        if !latent.x.iter().chain(latent.states.iter().flatten()).all(|v| v.is_finite()) {
            let cause = "the check of f16 made a latent in f32 with a value that is not finite";
            return Err(Error::new(ErrorKind::Device, cause).remedy("Build the bundle again: its weights are damaged"));
        }
        Ok(Self {
            peak: worst_peak(&with_peaks, &latent.peaks),
            latent,
            is_residual_wide: manifest.residual == Some(Residual::Float32),
        })
    }

    /// Makes the same latent with a float16 transformer on `device`, and compares the two.
    pub(super) fn compare(
        self,
        device: &Device,
        transformer: &Transformer,
        manifest: &Manifest,
        shapes: &Shapes,
    ) -> Result<HalfPrecision> {
        let half = Latent::make(device, transformer, manifest, shapes, Precision::F16, Some(&self.latent.x))?;
        let errors: Vec<f64> =
            half.states.iter().zip(&self.latent.states).map(|(half, full)| relative_error(half, full)).collect();
        let first_bad = errors.iter().position(|error| !error.is_finite());
        let worst = first_bad.or_else(|| (0..errors.len()).max_by(|&a, &b| errors[a].total_cmp(&errors[b])));
        let layer = worst.map_or((0, 0.0), |i| ((i / 2) as u32, errors[i]));
        Ok(HalfPrecision {
            latent_error: relative_error(&half.x, &self.latent.x),
            worst_layer: layer,
            peak: self.peak,
            is_residual_wide: self.is_residual_wide,
        })
    }
}

/// The first value that passes float16's largest number, else the largest one.
fn worst_peak(model: &ModelWithPeaks, magnitudes: &[f32]) -> Option<Peak> {
    let peaks = || model.values.iter().zip(magnitudes);
    let first = peaks().find(|(_, magnitude)| **magnitude > f16::MAX.to_f32());
    let (value, &magnitude) = first.or_else(|| peaks().max_by(|a, b| a.1.total_cmp(b.1)))?;
    Some(Peak { tensor: value.name.clone(), magnitude, is_residual: value.is_residual })
}

/// Relative error in the L2 norm; infinite if a number of `found` is not finite.
fn relative_error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    let size: f64 = truth.iter().map(|v| square(*v)).sum();
    let error = if apart == 0.0 { 0.0 } else { (apart / size).sqrt() };
    if error.is_finite() { error } else { f64::INFINITY }
}

/// A latent by the stock schedule, without a past and with idle controls.
struct Latent {
    /// `[C, h, w]`.
    x: Vec<f32>,
    /// Keys and values of the cache pass, layer by layer.
    states: Vec<Vec<f32>>,
    /// Outputs of the graph that are magnitudes of its values: the largest of each in any pass.
    peaks: Vec<f32>,
}

impl Latent {
    /// Runs the denoise passes, then the cache pass: on `committed` if that is given, else on the latent that was made.
    fn make(
        device: &Device,
        transformer: &Transformer,
        manifest: &Manifest,
        shapes: &Shapes,
        precision: Precision,
        committed: Option<&[f32]>,
    ) -> Result<Self> {
        let mut context = device.context(ContextLimits::default())?;
        let mut run = TransformerPass::new(&mut *context, transformer, manifest, shapes, precision)?;
        let mut x = allocate::zeroed(shapes.latent_len())?;
        NoiseKey { seed: 0, latent: 0 }.fill(&mut x);
        // Both precisions start from the same numbers.
        x.iter_mut().for_each(|v| *v = f16::from_f32(*v).to_f32());
        let table = Schedule::Stock.table(&manifest.sampler)?;
        for (&sigma, &dsigma) in table.sigmas.iter().zip(&table.dsigmas) {
            run.pass(&mut *context, &x, sigma, dsigma)?;
            run.read_next(&*context, &mut x)?;
        }
        run.pass(&mut *context, committed.unwrap_or(&x), 0.0, 0.0)?;
        Ok(Self { states: run.states(&*context)?, x, peaks: run.peaks })
    }
}

/// Buffers of one transformer and the binding that reads and writes them.
struct TransformerPass {
    precision: Precision,
    uploader: Uploader,
    /// x, sigma and dsigma.
    inputs: [BufferId; 3],
    /// x_next, then keys and values, then further outputs.
    outputs: Vec<BufferId>,
    slabs: usize,
    slab_len: usize,
    binding: PassBinding,
    conditioning: Option<LevelInputs>,
    peaks: Vec<f32>,
}

impl TransformerPass {
    fn new(
        context: &mut dyn ExecutionContext,
        transformer: &Transformer,
        manifest: &Manifest,
        shapes: &Shapes,
        precision: Precision,
    ) -> Result<Self> {
        let buffers: Vec<BufferId> =
            transformer.tensors().iter().map(|spec| context.buffer(spec.bytes())).collect::<Result<_>>()?;
        let rope = RopeTable::new(&manifest.geometry)?;
        let (mut cos, mut sin) = (allocate::zeroed(rope.len())?, allocate::zeroed(rope.len())?);
        rope.fill(0, &mut cos, &mut sin)?;
        let largest = shapes
            .latent_len()
            .max(shapes.attended_keys(LayerKind::Global))
            .max(shapes.attended_keys(LayerKind::Local));
        let mut uploader = Uploader::new(precision, largest)?;
        // The inputs in their order: x, sigma, dsigma, rope_cos, rope_sin, controls, local_mask, global_mask. Others stay zero.
        for (buffer, table) in [(buffers[3], &cos), (buffers[4], &sin)] {
            context.upload(buffer, 0, bytemuck::cast_slice(table))?;
        }
        for (buffer, kind) in [(buffers[6], LayerKind::Local), (buffers[7], LayerKind::Global)] {
            let mut mask = allocate::zeroed::<f32>(shapes.attended_keys(kind))?;
            let past = mask.len() - shapes.tokens;
            mask[..past].fill(HIDDEN);
            uploader.upload(context, buffer, &mask)?;
        }
        let shared = transformer.shared_buffers(context)?;
        let binding = transformer.bind(context, &buffers, &shared)?;
        if let Some(controls) = transformer.bind_controls(context, &buffers, &shared)? {
            context.run(controls)?;
        }
        let conditioning = LevelInputs::of(context, transformer, &shared, 1)?;
        let (inputs, outputs) = buffers.split_at(transformer.input_count());
        let slabs = 2 * shapes.layers;
        Ok(Self {
            precision,
            uploader,
            inputs: [inputs[0], inputs[1], inputs[2]],
            outputs: outputs.to_vec(),
            slabs,
            slab_len: shapes.slab_len(),
            binding,
            conditioning,
            peaks: vec![0.0; outputs.len() - 1 - slabs],
        })
    }

    fn pass(&mut self, context: &mut dyn ExecutionContext, x: &[f32], sigma: f32, dsigma: f32) -> Result<()> {
        self.uploader.upload(context, self.inputs[0], x)?;
        for (buffer, value) in [(self.inputs[1], sigma), (self.inputs[2], dsigma)] {
            context.upload(buffer, 0, &value.to_ne_bytes())?;
        }
        if let Some(conditioning) = &mut self.conditioning {
            let levels = [sigma];
            conditioning.prepare(context, std::iter::once(&levels[..]))?;
            conditioning.select(context, &levels)?;
        }
        self.binding.run(context)?;
        for (largest, buffer) in self.peaks.iter_mut().zip(&self.outputs[1 + self.slabs..]) {
            let mut bytes = [0; size_of::<f32>()];
            context.read(*buffer, 0, &mut bytes)?;
            *largest = largest.max(f32::from_ne_bytes(bytes));
        }
        Ok(())
    }

    fn read_next(&self, context: &dyn ExecutionContext, x: &mut [f32]) -> Result<()> {
        convert::read(context, self.precision, self.outputs[0], 0, x)
    }

    fn states(&self, context: &dyn ExecutionContext) -> Result<Vec<Vec<f32>>> {
        let read = |buffer: &BufferId| {
            assert_eq!(context.size(*buffer), self.slab_len * element_size(self.precision), "a slab");
            let mut values = allocate::zeroed(self.slab_len)?;
            convert::read(context, self.precision, *buffer, 0, &mut values)?;
            Ok(values)
        };
        self.outputs[1..=self.slabs].iter().map(read).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::rollout::worlds;
    use super::super::{World, WorldOptions};
    use super::*;

    fn found(latent_error: f64, worst_layer: (u32, f64), magnitude: f32, is_residual: bool) -> HalfPrecision {
        let peak = Some(Peak { tensor: "blocks.5.mlp.sum".to_owned(), magnitude, is_residual });
        HalfPrecision { latent_error, worst_layer, peak, is_residual_wide: false }
    }

    #[test]
    fn errors_name_the_place_the_numbers_and_the_remedy() {
        assert!(found(0.03, (3, 0.2), 65504.0, true).check().is_ok());
        let wide = "--residual float32";
        for (case, field, cause, has_remedy) in [
            (
                found(0.0, (0, 0.0), 65536.0, true),
                "blocks.5.mlp.sum",
                "residual stream reaches 65536, and float16 ends at 65504",
                true,
            ),
            (found(0.0, (0, 0.0), 1e6, false), "blocks.5.mlp.sum", "a value of the transformer reaches 1000000", false),
            (
                found(f64::INFINITY, (4, f64::INFINITY), 1.0, true),
                "blocks.4",
                "keys or values that are not finite",
                true,
            ),
            (found(f64::INFINITY, (4, 0.2), 1.0, true), "x_next", "its latent has values that are not finite", true),
            (
                found(0.0312, (7, 0.5), 1.0, true),
                "blocks.7",
                "a relative error of 3.12 %, at most 3 % are accepted",
                true,
            ),
        ] {
            let error = case.check().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some(field)));
            assert!(error.to_string().contains(cause), "{error}");
            assert_eq!(error.remedy_text().is_some_and(|text| text.contains(wide)), has_remedy, "{error}");
            let widened = HalfPrecision { is_residual_wide: true, ..case };
            let error = widened.check().unwrap_err();
            // A residual sum is not among the values in float16 then.
            let is_sum = widened.peak.is_some_and(|peak| peak.is_residual && peak.magnitude > 65504.0);
            assert_eq!(error.remedy_text().is_some_and(|text| text.contains(wide)), is_sum, "{error}");
        }
    }

    /// The reference is the transformer as it is stored. A world divides it: what depends on noise levels or controls alone does not run in passes.
    #[test]
    fn a_divided_transformer_gives_the_bits_of_the_whole_one() {
        for name in ["tiny", "stream"] {
            let (device, bundle) = (worlds::device(), worlds::bundle(name));
            let (manifest, window) = (bundle.manifest(), Some(bundle.geometry().global.dilation));
            let whole = Reference::make(&device, &bundle).expect("a latent").latent;
            for slices in [1, 3] {
                let options = WorldOptions {
                    precision: Some(Precision::F32),
                    global_window: window,
                    slices: Some(slices),
                    ..WorldOptions::default()
                };
                let world = World::load(&device, &bundle, options).expect("a world");
                assert!(world.transformer.conditioning().is_some() && !world.transformer.reads_levels());
                let made = Latent::make(&device, &world.transformer, manifest, &world.shapes, Precision::F32, None);
                let made = made.expect("a latent");
                assert!(made.x == whole.x && made.states == whole.states, "{name} in {slices} slices");
            }
        }
    }

    #[test]
    fn an_error_is_relative_to_the_truth_and_infinite_for_numbers_that_are_not_finite() {
        assert_eq!(relative_error(&[3.0, 4.0], &[3.0, 4.0]), 0.0);
        assert!((relative_error(&[3.0, 4.5], &[3.0, 4.0]) - 0.1).abs() < 1e-9);
        assert_eq!(relative_error(&[3.0, f32::NAN], &[3.0, 4.0]), f64::INFINITY);
        assert_eq!(relative_error(&[0.0], &[0.0]), 0.0);
    }
}
