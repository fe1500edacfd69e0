//! Splits a transformer into models of its conditioning, and slices: models of consecutive layers. Together they compute the bits of the whole model.
//!
//! A slice is a range of the transformer's nodes that run, without those of the conditioning. Constants, and nodes that read only constants, go into
//! each model that uses them. A value that one slice makes and a later one reads is an intermediate tensor: an output of the first and an input of the
//! second. What slices read of the conditioning is an input of theirs.

mod groups;
mod submodel;

use std::cell::OnceCell;
use std::collections::HashMap;
use std::ops::Range;

use self::groups::groups;
use self::submodel::GraphFields;
use super::check::{footprint_at, opset, parse};
use super::conditioning::{Runs, when_nodes_run};
use super::interface::{Interface, Port};
use super::proto::{self, Data, Graph};
use super::shape_inference::Footprint;
use super::{CheckResult, DataType, Fault, ModelContext, Shape, quoted};
use crate::bundle::cost::GraphCost;
use crate::bundle::{Bundle, GraphKind, Manifest, Precision};
use crate::{Error, ErrorKind, Result};

/// Multiply-adds that count as much as one byte that is moved. Processors do fewer in that time, graphics adapters more; the layers of a
/// transformer are so much alike that the shares hardly depend on it.
const MULTIPLY_ADDS_PER_BYTE: u64 = 16;

/// A transformer, and the nodes between which it can be split.
pub(crate) struct Splitting<'a> {
    onnx: &'a [u8],
    context: ModelContext<'a>,
    opset: i64,
    graph: Graph<'a>,
    fields: GraphFields<'a>,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// The global window of all shapes, in latents.
    window: u32,
    values: Vec<Value<'a>>,
    names: HashMap<&'a str, usize>,
    /// When each node runs.
    runs: Vec<Runs>,
    /// Values that depend on noise levels alone and that passes read: positions in `values`.
    of_levels: Vec<usize>,
    /// The same for values that depend on controls alone.
    of_controls: Vec<usize>,
    /// The node at which each part starts: 0, and one between each two layers that can be separated.
    starts: Vec<usize>,
    /// Estimated work of each part, once it was needed.
    work: OnceCell<Vec<u64>>,
}

/// A value of the graph.
struct Value<'a> {
    name: &'a str,
    origin: Origin,
    /// Known for inputs and for values of nodes that run.
    shape: Option<Shape>,
    /// The last node that runs and reads it; 0 if none does.
    last_use: usize,
    /// Its position among the graph's outputs.
    output: Option<usize>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Origin {
    /// A position among the graph's inputs.
    Input(usize),
    /// A position among the graph's initializers.
    Tensor(usize),
    /// A node that reads constants only.
    Folded(usize),
    /// A node of the conditioning.
    Conditioning(usize),
    /// A node that runs.
    Node(usize),
}

/// A transformer in slices.
pub(crate) struct Slices {
    /// In the order in which they run.
    pub(crate) models: Vec<SliceModel>,
    /// Values that one slice makes and later ones read.
    pub(crate) intermediates: Vec<IntermediateTensor>,
    /// Sizes in bytes of the buffers that these tensors share.
    pub(crate) buffer_sizes: Vec<usize>,
}

/// The conditioning of a transformer, the same with every number of slices.
pub(crate) struct ConditioningModels {
    /// `None` if the transformer has no product of noise levels and weights.
    pub(crate) of_levels: Option<ConditioningModel>,
    /// `None` if the transformer has no product of controls and weights.
    pub(crate) of_controls: Option<ConditioningModel>,
}

/// One half of it.
pub(crate) struct ConditioningModel {
    /// A model whose weights are those of the whole model.
    pub(crate) onnx: Vec<u8>,
    /// Its only input, a position among those of the whole model.
    pub(crate) input: usize,
    /// Its outputs.
    pub(crate) values: Vec<NamedTensor>,
    pub(in crate::bundle) footprint: Footprint,
    /// Bytes of its weights, as they are stored.
    pub(in crate::bundle) stored_weights: u64,
}

/// A value between models.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NamedTensor {
    pub(crate) name: String,
    pub(crate) precision: Precision,
    pub(crate) shape: Vec<usize>,
}

/// One slice.
pub(crate) struct SliceModel {
    /// A model whose weights are those of the whole model.
    pub(crate) onnx: Vec<u8>,
    pub(crate) inputs: Vec<SliceTensor>,
    pub(crate) outputs: Vec<SliceTensor>,
    pub(in crate::bundle) footprint: Footprint,
}

/// An input or output of a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SliceTensor {
    /// The whole model's input at this position.
    Input(usize),
    /// The whole model's output at this position.
    Output(usize),
    /// The value at this position of [`Slices::intermediates`].
    Intermediate(usize),
    /// The value at this position of those that are made of the noise levels.
    OfLevels(usize),
    /// The value at this position of those that are made of the controls.
    OfControls(usize),
}

/// A value that one slice makes and later ones read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct IntermediateTensor {
    pub(crate) tensor: NamedTensor,
    /// The buffer that holds it, a position in [`Slices::buffer_sizes`]. Other values use it before this one is made and after the last slice
    /// that reads this one.
    pub(crate) buffer: usize,
    /// The slice that makes it, and the last one that reads it.
    slices: (usize, usize),
}

impl Bundle {
    /// Finds where the transformer can be split, or the joined graph, at a global window of `g` latents.
    ///
    /// # Errors
    /// `Unsupported` if the bundle has no such graph of `precision`; `InvalidBundle` if shapes are inconsistent at this window.
    pub(crate) fn splitting(&self, kind: GraphKind, precision: Precision, g: u32) -> Result<Splitting<'_>> {
        let onnx = self.model(kind, precision)?.onnx;
        Splitting::of(onnx, ModelContext { manifest: &self.manifest, kind, precision }, g)
    }
}

/// The models of a transformer in `slices` slices, in the order in which they run, at a global window of `g` latents, after the models of its
/// conditioning: of noise levels, and of controls, if it has them. Their weights are those of the whole model. For tools and tests: [`World::load`](crate::world::World::load) splits a transformer itself.
///
/// # Errors
/// `InvalidBundle` for a model that is no transformer of this manifest; `InvalidArgument` for a number of slices that it cannot have, and for a
/// window that the manifest does not allow.
pub fn slice_transformer(
    onnx: &[u8],
    manifest: &Manifest,
    precision: Precision,
    g: u32,
    slices: u32,
) -> Result<Vec<Vec<u8>>> {
    manifest.geometry.check_window(g)?;
    let context = ModelContext { manifest, kind: GraphKind::Transformer, precision };
    let splitting = Splitting::of(onnx, context, g)?;
    let (ConditioningModels { of_levels, of_controls }, Slices { models, .. }) =
        (splitting.conditioning()?, splitting.split(slices)?);
    let conditioning = of_levels.into_iter().chain(of_controls).map(|model| model.onnx);
    Ok(conditioning.chain(models.into_iter().map(|model| model.onnx)).collect())
}

impl<'a> Splitting<'a> {
    fn of(onnx: &'a [u8], context: ModelContext<'a>, g: u32) -> Result<Self> {
        Self::find(onnx, context, g).map_err(|fault| context.to_error(fault))
    }

    fn find(onnx: &'a [u8], context: ModelContext<'a>, window: u32) -> CheckResult<Self> {
        let model = parse(onnx)?;
        let Interface { inputs, outputs } = Interface::of(context.kind, context.precision, context.manifest);
        let interface = Interface { inputs, outputs };
        interface.check(&model.graph.inputs, &model.graph.outputs)?;
        let mut shapes = Vec::new();
        shapes.try_reserve_exact(model.graph.nodes.len()).map_err(Fault::no_memory)?;
        footprint_at(&model, context, window, &mut |_, _, outputs| shapes.push(outputs.to_vec()))?;

        let Interface { inputs, outputs } = interface;
        let mut splitting = Self {
            onnx,
            context,
            opset: opset(&model)?,
            fields: GraphFields::of(onnx)?,
            graph: model.graph,
            inputs,
            outputs,
            window,
            values: Vec::new(),
            names: HashMap::new(),
            runs: Vec::new(),
            of_levels: Vec::new(),
            of_controls: Vec::new(),
            starts: Vec::new(),
            work: OnceCell::new(),
        };
        splitting.runs = when_nodes_run(&splitting.graph)?;
        splitting.add_values(shapes)?;
        splitting.starts = splitting.starts()?;
        Ok(splitting)
    }

    /// The most slices that the transformer can have.
    pub(crate) fn max_slices(&self) -> u32 {
        u32::try_from(self.starts.len()).unwrap_or(u32::MAX)
    }

    /// Estimated share of the longest of `slices` slices in a pass, above 0 and at most 1.
    ///
    /// # Errors
    /// `InvalidArgument` for a number of slices that the transformer cannot have.
    pub(crate) fn longest_share(&self, slices: u32) -> Result<f64> {
        let (work, groups) = (self.work()?, self.groups(slices)?);
        let sum = |parts: &Range<usize>| work[parts.clone()].iter().map(|&work| work as f64).sum::<f64>();
        let longest = groups.iter().map(sum).fold(0.0, f64::max);
        Ok(longest / sum(&(0..work.len())))
    }

    /// The transformer in `slices` slices of about the same work.
    ///
    /// # Errors
    /// `InvalidArgument` for a number of slices that the transformer cannot have; `InvalidBundle` if a value between slices is
    /// no floating-point tensor.
    pub(crate) fn split(&self, slices: u32) -> Result<Slices> {
        let mut split = Slices { models: Vec::new(), intermediates: Vec::new(), buffer_sizes: Vec::new() };
        let mut positions = HashMap::new();
        let mut write = |slice, parts: Range<usize>| {
            let model = self.write(slice, self.nodes(&parts), &mut positions, &mut split.intermediates)?;
            split.models.push(model);
            Ok(())
        };
        for (slice, parts) in self.groups(slices)?.into_iter().enumerate() {
            write(slice, parts).map_err(|fault: Fault| self.context.to_error(fault))?;
        }
        split.assign_buffers();
        Ok(split)
    }

    /// The models of the conditioning.
    ///
    /// # Errors
    /// `InvalidBundle` if a value that passes read of it is no floating-point tensor.
    pub(crate) fn conditioning(&self) -> Result<ConditioningModels> {
        let model = |runs, made: &[usize], tensor: fn(usize) -> SliceTensor| {
            self.write_conditioning(runs, made, tensor).map_err(|fault| self.context.to_error(fault))
        };
        Ok(ConditioningModels {
            of_levels: model(Runs::PerLevel, &self.of_levels, SliceTensor::OfLevels)?,
            of_controls: model(Runs::PerStep, &self.of_controls, SliceTensor::OfControls)?,
        })
    }

    fn groups(&self, slices: u32) -> Result<Vec<Range<usize>>> {
        let most = self.max_slices();
        if slices == 0 || slices > most {
            let cause = format!("the transformer cannot run in {slices} slices: it can be split into 1 to {most}");
            let remedy = format!("Use 1 to {most}: a slice has one layer at least");
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("slices").remedy(remedy));
        }
        match slices {
            1 => Ok(std::iter::once(0..self.starts.len()).collect()),
            _ => Ok(groups(self.work()?, slices as usize)),
        }
    }

    fn work(&self) -> Result<&[u64]> {
        if self.work.get().is_none() {
            let work = self.part_work().map_err(|fault| self.context.to_error(fault))?;
            _ = self.work.set(work);
        }
        Ok(self.work.get().map_or(&[], Vec::as_slice))
    }

    /// The nodes of consecutive parts.
    fn nodes(&self, parts: &Range<usize>) -> Range<usize> {
        let start = |part| self.starts.get(part).copied().unwrap_or(self.graph.nodes.len());
        start(parts.start)..start(parts.end)
    }

    /// Fills `values`, `names`, `of_levels` and `of_controls`. `shapes` has the shapes of the outputs of each node that reads more than constants.
    fn add_values(&mut self, shapes: Vec<Vec<Shape>>) -> CheckResult<()> {
        let mut shapes = shapes.into_iter();
        for (i, (value, port)) in self.graph.inputs.iter().zip(&self.inputs).enumerate() {
            let shape = Some(port.shape(self.context.manifest, self.window));
            add(&mut self.values, &mut self.names, value.name, Origin::Input(i), shape)?;
        }
        for (i, tensor) in self.graph.tensors.iter().enumerate() {
            add(&mut self.values, &mut self.names, tensor.name, Origin::Tensor(i), None)?;
        }
        for (i, node) in self.graph.nodes.iter().enumerate() {
            let (origin, made) = match self.runs[i] {
                Runs::AtLoad => (Origin::Folded(i), None),
                Runs::PerPass => (Origin::Node(i), shapes.next()),
                Runs::PerLevel | Runs::PerStep => (Origin::Conditioning(i), shapes.next()),
            };
            for name in node.inputs.iter().filter(|name| !name.is_empty()) {
                let value = find(&self.names, name)?;
                if self.runs[i] == Runs::PerPass {
                    self.values[value].last_use = i;
                }
            }
            for (j, name) in node.outputs.iter().enumerate() {
                let shape = made.as_ref().and_then(|made| made.get(j)).cloned();
                add(&mut self.values, &mut self.names, name, origin, shape)?;
            }
        }
        for (i, output) in self.graph.outputs.iter().enumerate() {
            let value = find(&self.names, output.name)?;
            self.values[value].output = Some(i);
        }
        // Node 0 reads none of these values, so that 0 says that no pass does.
        let read = |runs| {
            let is_one = |i: &usize| {
                let Value { origin, last_use, .. } = self.values[*i];
                matches!(origin, Origin::Conditioning(node) if self.runs[node] == runs && last_use > 0)
            };
            (0..self.values.len()).filter(is_one).collect::<Vec<_>>()
        };
        (self.of_levels, self.of_controls) = (read(Runs::PerLevel), read(Runs::PerStep));
        Ok(())
    }

    /// Finds where parts start. Between two layers, all nodes that read keys or values of the ring, or make those of the current latent, belong
    /// to one side; of the places where that is so, the one with the fewest bytes of intermediate tensors is taken, the last of several.
    fn starts(&self) -> CheckResult<Vec<usize>> {
        let (nodes, layers) = (self.graph.nodes.len(), self.context.manifest.geometry.layers as usize);
        let mut touched: Vec<Option<(usize, usize)>> = vec![None; layers];
        for (i, node) in self.graph.nodes.iter().enumerate().filter(|(i, _)| self.runs[*i] == Runs::PerPass) {
            let layer = |name: &&str, of: fn(&Self, &Value<'_>) -> Option<usize>| {
                self.names.get(name).and_then(|&value| of(self, &self.values[value]))
            };
            let read = node.inputs.iter().filter_map(|name| layer(name, Self::past_layer));
            let made = node.outputs.iter().filter_map(|name| layer(name, Self::present_layer));
            for layer in read.chain(made) {
                let range = touched.get_mut(layer).ok_or_else(|| Fault::new("a layer is out of range"))?;
                *range = Some(range.map_or((i, i), |(first, _)| (first, i)));
            }
        }

        let bytes = self.bytes_between();
        // The first node of all later layers, for each layer.
        let mut first = vec![nodes; layers];
        for layer in (0..layers.saturating_sub(1)).rev() {
            first[layer] = first[layer + 1].min(touched[layer + 1].map_or(nodes, |(first, _)| first));
        }
        let (mut starts, mut last) = (vec![0], None);
        for layer in 0..layers.saturating_sub(1) {
            last = last.max(touched[layer].map(|(_, last)| last));
            let (earliest, latest) = (last.map_or(0, |last| last + 1), first[layer]);
            let places = (earliest..=latest).filter(|&at| starts.last().is_some_and(|&start| start < at) && at < nodes);
            starts.extend(places.min_by_key(|&at| (bytes[at], std::cmp::Reverse(at))));
        }
        Ok(starts)
    }

    /// The layer whose keys or values in the ring a value is.
    fn past_layer(&self, value: &Value<'_>) -> Option<usize> {
        let Origin::Input(at) = value.origin else { return None };
        self.layer(at, self.inputs.len())
    }

    /// The layer whose keys or values of the current latent a value is.
    fn present_layer(&self, value: &Value<'_>) -> Option<usize> {
        self.layer(value.output?, self.outputs.len())
    }

    /// The layer of an input or output: two of each layer end the lists, in the order of the layers.
    fn layer(&self, at: usize, all: usize) -> Option<usize> {
        let pairs = 2 * self.context.manifest.geometry.layers as usize;
        Some(at.checked_sub(all.checked_sub(pairs)?)? / 2)
    }

    /// For each node, the bytes of values that are made before it and read by it or a later one.
    fn bytes_between(&self) -> Vec<u64> {
        let nodes = self.graph.nodes.len();
        let (mut begin, mut end) = (vec![0_u64; nodes + 1], vec![0_u64; nodes + 1]);
        for value in &self.values {
            if let (Origin::Node(made), Some(shape)) = (value.origin, &value.shape)
                && value.last_use > made
            {
                let bytes = shape.count().unwrap_or(u64::MAX).saturating_mul(shape.element.bytes());
                begin[made + 1] = begin[made + 1].saturating_add(bytes);
                end[value.last_use + 1] = end[value.last_use + 1].saturating_add(bytes);
            }
        }
        let mut live = 0_u64;
        let at = |(begin, end)| {
            live = live.saturating_add(begin).saturating_sub(end);
            live
        };
        begin.into_iter().zip(end).map(at).collect()
    }

    /// Estimated work of each part.
    fn part_work(&self) -> CheckResult<Vec<u64>> {
        let (mut positions, mut list) = (HashMap::new(), Vec::new());
        let mut work = |part: usize| {
            let model = self.write(part, self.nodes(&(part..part + 1)), &mut positions, &mut list)?;
            let GraphCost { multiply_adds, bytes } = model.footprint.cost;
            Ok(multiply_adds.saturating_add(bytes.saturating_mul(MULTIPLY_ADDS_PER_BYTE)).max(1))
        };
        (0..self.starts.len()).map(&mut work).collect()
    }

    /// Writes the model of a slice and infers its sizes. `positions` has the values that slices hand over, by their position in `values`, and `list`
    /// their description.
    fn write(
        &self,
        slice: usize,
        nodes: Range<usize>,
        positions: &mut HashMap<usize, usize>,
        list: &mut Vec<IntermediateTensor>,
    ) -> CheckResult<SliceModel> {
        let mut outputs = Vec::new();
        let own: Vec<usize> = nodes.clone().filter(|&i| self.runs[i] == Runs::PerPass).collect();
        for name in own.iter().flat_map(|&i| &self.graph.nodes[i].outputs) {
            let value = find(&self.names, name)?;
            match self.values[value] {
                Value { output: Some(at), .. } => outputs.push((SliceTensor::Output(at), value)),
                Value { last_use, .. } if last_use >= nodes.end => {
                    let at = self.add_intermediate(slice, value, positions, list)?;
                    outputs.push((SliceTensor::Intermediate(at), value));
                }
                _ => {}
            }
        }
        let of_earlier = |value: usize| match positions.get(&value).copied() {
            Some(at) => {
                list[at].slices.1 = slice;
                Ok(Some(SliceTensor::Intermediate(at)))
            }
            None => Err(Fault::new(format!("no earlier slice makes {}", quoted(self.values[value].name)))),
        };
        let (onnx, inputs, footprint) = self.write_model(own, &outputs, of_earlier)?;
        let outputs = outputs.into_iter().map(|(tensor, _)| tensor).collect();
        Ok(SliceModel { onnx, inputs, outputs, footprint })
    }

    /// Writes the model of the nodes that run so often and make the values `made`, if there are any.
    fn write_conditioning(
        &self,
        runs: Runs,
        made: &[usize],
        tensor: fn(usize) -> SliceTensor,
    ) -> CheckResult<Option<ConditioningModel>> {
        if made.is_empty() {
            return Ok(None);
        }
        let own = (0..self.runs.len()).filter(|&i| self.runs[i] == runs).collect();
        let outputs: Vec<_> = made.iter().enumerate().map(|(at, &value)| (tensor(at), value)).collect();
        let fault = |value: usize| Fault::new(format!("the conditioning reads {}", quoted(self.values[value].name)));
        let (onnx, inputs, footprint) = self.write_model(own, &outputs, |value| Err(fault(value)))?;
        let [SliceTensor::Input(input)] = inputs[..] else {
            return Err(Fault::new("the conditioning has not one input"));
        };
        let tensors = proto::model(&onnx)?.graph.tensors;
        let stored_weights = tensors.iter().map(|tensor| match tensor.data {
            Data::Inline(bytes) => bytes.len() as u64,
            Data::External { length, .. } => length,
        });
        let stored_weights = stored_weights.fold(0, u64::saturating_add);
        let values = made.iter().map(|&value| self.described(value)).collect::<CheckResult<_>>()?;
        Ok(Some(ConditioningModel { onnx, input, values, footprint, stored_weights }))
    }

    /// Adds a value that `slice` makes and a later one reads; returns its position in `list`.
    fn add_intermediate(
        &self,
        slice: usize,
        value: usize,
        positions: &mut HashMap<usize, usize>,
        list: &mut Vec<IntermediateTensor>,
    ) -> CheckResult<usize> {
        let tensor = self.described(value)?;
        positions.try_reserve(1).map_err(Fault::no_memory)?;
        positions.insert(value, list.len());
        list.push(IntermediateTensor { tensor, buffer: 0, slices: (slice, slice) });
        Ok(list.len() - 1)
    }

    /// Name, type and shape of a value between models.
    fn described(&self, value: usize) -> CheckResult<NamedTensor> {
        let Value { name, shape, .. } = &self.values[value];
        let fault = |what: &str| Fault::new(format!("{} goes from layer to layer and {what}", quoted(name)));
        let shape = shape.as_ref().ok_or_else(|| fault("has no shape"))?;
        let precision = match shape.element {
            DataType::F32 => Precision::F32,
            DataType::F16 => Precision::F16,
            DataType::U8 | DataType::I32 | DataType::I64 => return Err(fault(&format!("is {}", shape.element))),
        };
        let shape = shape.dims.iter().map(|&n| usize::try_from(n)).collect::<std::result::Result<Vec<_>, _>>();
        let shape = shape.map_err(|_| fault("is too large"))?;
        Ok(NamedTensor { name: (*name).to_owned(), precision, shape })
    }
}

impl ConditioningModel {
    /// Bytes that its session takes: weights in the types in which it reads them, and intermediate values.
    pub(crate) fn session_bytes(&self) -> u64 {
        self.footprint.weights.saturating_add(self.footprint.peak)
    }
}

impl NamedTensor {
    /// Size in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.shape.iter().product::<usize>() * self.precision.bytes()
    }
}

impl Slices {
    /// Lets tensors of one size share a buffer, where the slices that make or read them differ.
    fn assign_buffers(&mut self) {
        // For each buffer, the last slice that uses it.
        let mut used_until: Vec<usize> = Vec::new();
        for value in &mut self.intermediates {
            let (bytes, (made, last)) = (value.tensor.bytes(), value.slices);
            let free = (0..self.buffer_sizes.len()).find(|&at| self.buffer_sizes[at] == bytes && used_until[at] < made);
            value.buffer = free.unwrap_or_else(|| {
                self.buffer_sizes.push(bytes);
                used_until.push(0);
                self.buffer_sizes.len() - 1
            });
            used_until[value.buffer] = last;
        }
    }
}

fn add<'a>(
    values: &mut Vec<Value<'a>>,
    names: &mut HashMap<&'a str, usize>,
    name: &'a str,
    origin: Origin,
    shape: Option<Shape>,
) -> CheckResult<()> {
    names.try_reserve(1).map_err(Fault::no_memory)?;
    names.insert(name, values.len());
    push(values, Value { name, origin, shape, last_use: 0, output: None })
}

fn push<T>(list: &mut Vec<T>, item: T) -> CheckResult<()> {
    list.try_reserve(1).map_err(Fault::no_memory)?;
    list.push(item);
    Ok(())
}

fn find(names: &HashMap<&str, usize>, name: &str) -> CheckResult<usize> {
    names.get(name).copied().ok_or_else(|| Fault::new(format!("{} is read before it is made", quoted(name))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensors_share_a_buffer_only_while_no_slice_needs_both() {
        let value = |shape: &[usize], slices| IntermediateTensor {
            tensor: NamedTensor { name: String::new(), precision: Precision::F16, shape: shape.to_vec() },
            buffer: 0,
            slices,
        };
        let intermediates = vec![
            value(&[4], (0, 1)),
            value(&[4], (0, 3)),
            value(&[8], (0, 1)),
            value(&[4], (1, 2)),
            value(&[2, 2], (2, 3)),
            value(&[4], (3, 4)),
        ];
        let mut slices = Slices { models: Vec::new(), intermediates, buffer_sizes: Vec::new() };
        slices.assign_buffers();
        let buffers: Vec<usize> = slices.intermediates.iter().map(|value| value.buffer).collect();
        assert_eq!(buffers, [0, 1, 2, 3, 0, 3]);
        assert_eq!(slices.buffer_sizes, [8, 8, 16, 8]);
    }
}
