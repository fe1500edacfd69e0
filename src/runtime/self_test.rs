//! A graph with a known result, which a provider must compute before it gets a world.

use super::cpu::{CpuBackend, CpuOptions};
use super::device::Backend;
use super::graph::TensorSpec;
use super::{ContextLimits, Ort};
use crate::bundle::{DataType, ModelSource, ModelWriter, Precision};
use crate::{Error, ErrorKind, Result};

/// Length of the input and of the output.
pub(super) const LENGTH: usize = 2;

/// A model that adds the input `x` to itself; its output is `y`.
pub(super) fn model(precision: Precision) -> Vec<u8> {
    let mut model = ModelWriter::default();
    let element = DataType::from(precision);
    model.input("x", element, &[LENGTH]);
    model.node("Add", &["x", "x"], &["y"], &[]);
    model.output("y", element, &[LENGTH]);
    model.finish()
}

/// The bytes of an input, and of the output that belongs to it. Both are exact in either precision.
pub(super) fn input_and_output(precision: Precision) -> [Vec<u8>; 2] {
    [[1.5_f32, -2.0], [3.0, -4.0]].map(|values| match precision {
        Precision::F32 => bytemuck::cast_slice(&values).to_vec(),
        Precision::F16 => bytemuck::cast_slice(&values.map(half::f16::from_f32)).to_vec(),
    })
}

/// Runs the graph on the CPU provider, in the way that worlds run.
///
/// # Errors
/// `Device` if the result is wrong, and whatever a call of ONNX Runtime fails with.
pub(super) fn run_on_cpu(ort: &Ort) -> Result<()> {
    let backend = CpuBackend::new(ort, CpuOptions { threads: Some(1), ..CpuOptions::default() })?;
    let [x, y] = ["x", "y"].map(|name| TensorSpec::new(name, Precision::F32, &[LENGTH]));
    let onnx = model(Precision::F32);
    let source = ModelSource { onnx: &onnx, external: Vec::new() };
    let graph = backend.graph("self-test", &source, &[], vec![x], vec![y], None)?;
    let mut context = backend.context(ContextLimits::default())?;
    let [given, expected] = input_and_output(Precision::F32);
    let (x, y) = (context.buffer(given.len())?, context.buffer(expected.len())?);
    let binding = context.bind(&graph, &[x, y])?;
    context.upload(x, 0, &given)?;
    context.run(binding)?;
    let mut found = vec![0; expected.len()];
    context.read(y, 0, &mut found)?;
    if found == expected {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Device, "its CPU provider gives a wrong sum"))
}
