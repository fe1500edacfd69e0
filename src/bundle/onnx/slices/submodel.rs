//! Writes models of some of a transformer's nodes.

use super::super::messages::{GraphProto, ModelProto};
use super::super::model_writer::value_info;
use super::super::proto;
use super::super::shape_inference::{Footprint, Named, infer_sizes};
use super::super::wire::{Field, Fields};
use super::super::writer::{reserved, write_bytes};
use super::super::{CheckResult, Fault, Shape, quoted};
use super::{NamedTensor, Origin, SliceTensor, Splitting, Value, find, push};

/// Bytes of a value's name, type and shape in a model, at most.
const MAX_VALUE_INFO: usize = 1024;

/// The fields of a graph as they stand in the file, in the order of the lists in `proto::Graph`.
#[derive(Default)]
pub(super) struct GraphFields<'a> {
    name: Option<Field<'a>>,
    nodes: Vec<Field<'a>>,
    tensors: Vec<Field<'a>>,
    inputs: Vec<&'a [u8]>,
    outputs: Vec<&'a [u8]>,
}

/// The parts of the whole model that a slice takes: a flag for each node and each initializer, and the slice's inputs with their indices in
/// `Splitting::values`.
struct Selection {
    nodes: Vec<bool>,
    tensors: Vec<bool>,
    inputs: Vec<(SliceTensor, usize)>,
}

impl Splitting<'_> {
    /// Writes a model of the nodes `own`, and of the constants that they read. It makes `outputs`. Other values that the nodes read are its inputs:
    /// inputs and outputs of the whole model, the conditioning, and values of earlier models, which `of_earlier` finds. Returns the model, its inputs
    /// and its sizes.
    pub(super) fn write_model(
        &self,
        own: Vec<usize>,
        outputs: &[(SliceTensor, usize)],
        mut of_earlier: impl FnMut(usize) -> CheckResult<Option<SliceTensor>>,
    ) -> CheckResult<(Vec<u8>, Vec<SliceTensor>, Footprint)> {
        let Selection { nodes, tensors, inputs } = self.needed_by(own, &mut of_earlier)?;
        // Names and types of values between models are not in the whole one.
        let bytes = self.onnx.len() + (inputs.len() + outputs.len()) * MAX_VALUE_INFO;
        let mut graph = reserved(bytes)?;
        for (field, _) in self.fields.nodes.iter().zip(&nodes).filter(|(_, is_kept)| **is_kept) {
            field.write(&mut graph);
        }
        self.fields.name.iter().for_each(|name| name.write(&mut graph));
        for (field, _) in self.fields.tensors.iter().zip(&tensors).filter(|(_, is_kept)| **is_kept) {
            field.write(&mut graph);
        }
        for (number, tensors) in [(GraphProto::INPUT, &inputs[..]), (GraphProto::OUTPUT, outputs)] {
            for &(tensor, value) in tensors {
                match tensor {
                    SliceTensor::Input(at) => write_bytes(&mut graph, number, self.fields.inputs[at]),
                    SliceTensor::Output(at) => write_bytes(&mut graph, number, self.fields.outputs[at]),
                    SliceTensor::Intermediate(_) | SliceTensor::OfLevels(_) | SliceTensor::OfControls(_) => {
                        let NamedTensor { name, precision, shape } = self.described(value)?;
                        write_bytes(&mut graph, number, &value_info(&name, precision.into(), &shape));
                    }
                }
            }
        }
        let mut onnx = reserved(bytes)?;
        let mut fields = Fields::new("the model", self.onnx);
        while let Some(field) = fields.next()? {
            match field.number {
                ModelProto::GRAPH => write_bytes(&mut onnx, ModelProto::GRAPH, &graph),
                _ => field.write(&mut onnx),
            }
        }

        let footprint = self.check_written(&onnx, &inputs, outputs)?;
        Ok((onnx, inputs.into_iter().map(|(tensor, _)| tensor).collect(), footprint))
    }

    /// The nodes `own`, with the constants and inputs that they need.
    fn needed_by(
        &self,
        own: Vec<usize>,
        of_earlier: &mut impl FnMut(usize) -> CheckResult<Option<SliceTensor>>,
    ) -> CheckResult<Selection> {
        let (mut nodes, mut tensors) = (vec![false; self.graph.nodes.len()], vec![false; self.graph.tensors.len()]);
        own.iter().for_each(|&i| nodes[i] = true);
        let (mut inputs, mut pending) = (Vec::new(), own);
        let mut is_input = vec![false; self.values.len()];
        while let Some(i) = pending.pop() {
            for name in self.graph.nodes[i].inputs.iter().filter(|name| !name.is_empty()) {
                let value = find(&self.names, name)?;
                let input = match self.values[value] {
                    Value { origin: Origin::Tensor(at), .. } => {
                        tensors[at] = true;
                        None
                    }
                    Value { origin: Origin::Folded(at), .. } => {
                        if !std::mem::replace(&mut nodes[at], true) {
                            pending.push(at);
                        }
                        None
                    }
                    Value { origin: Origin::Node(at) | Origin::Conditioning(at), .. } if nodes[at] => None,
                    Value { origin: Origin::Input(at), .. } => Some(SliceTensor::Input(at)),
                    Value { origin: Origin::Conditioning(_), .. } => Some(self.conditioning_value(value)?),
                    Value { output: Some(at), .. } => Some(SliceTensor::Output(at)),
                    _ => of_earlier(value)?,
                };
                if let Some(tensor) = input
                    && !std::mem::replace(&mut is_input[value], true)
                {
                    inputs.push((tensor, value));
                }
            }
        }
        // Inputs in the order in which they are made; it does not depend on the order of the search.
        inputs.sort_by_key(|(_, value)| *value);
        Ok(Selection { nodes, tensors, inputs })
    }

    /// A value of the conditioning, as slices read it.
    fn conditioning_value(&self, value: usize) -> CheckResult<SliceTensor> {
        let of_levels = self.of_levels.binary_search(&value).ok().map(SliceTensor::OfLevels);
        let found = of_levels.or_else(|| self.of_controls.binary_search(&value).ok().map(SliceTensor::OfControls));
        found.ok_or_else(|| Fault::new(format!("no pass reads {}", quoted(self.values[value].name))))
    }

    /// Reads a written model as any model, and infers its sizes.
    fn check_written(
        &self,
        onnx: &[u8],
        inputs: &[(SliceTensor, usize)],
        outputs: &[(SliceTensor, usize)],
    ) -> CheckResult<Footprint> {
        let model = proto::model(onnx)?;
        let shapes = |list: &[(SliceTensor, usize)]| -> CheckResult<Vec<(&str, Shape)>> {
            let named = |&(_, value): &(SliceTensor, usize)| {
                let Value { name, shape, .. } = &self.values[value];
                let shape = shape.clone().ok_or_else(|| Fault::new(format!("{} has no shape", quoted(name))))?;
                Ok((*name, shape))
            };
            list.iter().map(named).collect()
        };
        let (inputs, outputs) = (shapes(inputs)?, shapes(outputs)?);
        let (inputs, outputs): (&Named<'_>, &Named<'_>) = (&inputs, &outputs);
        infer_sizes(&model.graph, self.opset, inputs, outputs, &mut |_, _, _| ())
    }
}

impl<'a> GraphFields<'a> {
    pub(super) fn of(onnx: &'a [u8]) -> CheckResult<Self> {
        let mut found = Self::default();
        let mut fields = Fields::new("the model", onnx);
        while let Some(field) = fields.next()? {
            if field.number != ModelProto::GRAPH {
                continue;
            }
            let mut fields = field.message("the graph")?;
            while let Some(field) = fields.next()? {
                match field.number {
                    GraphProto::NODE => push(&mut found.nodes, field)?,
                    GraphProto::NAME => found.name = Some(field),
                    GraphProto::INITIALIZER => push(&mut found.tensors, field)?,
                    GraphProto::INPUT => push(&mut found.inputs, field.bytes()?)?,
                    GraphProto::OUTPUT => push(&mut found.outputs, field.bytes()?)?,
                    _ => {}
                }
            }
        }
        Ok(found)
    }
}
