//! The contents of the two trace files.

use std::path::Path;

use cairn::bundle::Precision;
use safetensors::Dtype;
use safetensors::tensor::{TensorView, serialize_to_file};
use serde::Serialize;

use crate::Failure;

/// `trace.json`.
#[derive(Serialize)]
pub(crate) struct Record {
    pub(crate) cache: String,
    pub(crate) schedule: String,
    pub(crate) global_window: u32,
    pub(crate) precision: String,
    pub(crate) seed: u64,
    pub(crate) mutant: Option<String>,
    pub(crate) steps: Vec<StepRecord>,
}

/// One latent: the script's input, and digests and flags of the ring.
#[derive(Serialize)]
pub(crate) struct StepRecord {
    pub(crate) appended: bool,
    pub(crate) recorded: bool,
    pub(crate) mouse: [f32; 2],
    pub(crate) keys: Vec<u8>,
    pub(crate) scroll: f32,
    pub(crate) passes: usize,
    pub(crate) frozen: Vec<Frozen>,
    /// The ring before and after the step itself, where it was recorded.
    pub(crate) step: Option<Frozen>,
    /// Written flags of the local and the global ring after the step.
    pub(crate) written: [Vec<bool>; 2],
}

/// Digests of the ring's bytes and flags before and after an operation.
#[derive(Serialize)]
pub(crate) struct Frozen {
    pub(crate) name: String,
    pub(crate) before: String,
    pub(crate) after: String,
}

struct Tensor {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// Tensors by name, in the order in which they were added.
#[derive(Default)]
pub(crate) struct Tensors(Vec<Tensor>);

impl Tensors {
    /// Adds numbers in f32.
    pub(crate) fn floats(&mut self, name: String, shape: &[usize], numbers: &[f32]) {
        self.bytes(name, Dtype::F32, shape, bytemuck::cast_slice(numbers).to_vec());
    }

    /// Adds device bytes in the graphs' type.
    pub(crate) fn device(&mut self, name: String, shape: &[usize], precision: Precision, bytes: Vec<u8>) {
        let dtype = if precision == Precision::F16 { Dtype::F16 } else { Dtype::F32 };
        self.bytes(name, dtype, shape, bytes);
    }

    /// Adds 8-bit numbers.
    pub(crate) fn octets(&mut self, name: String, shape: &[usize], bytes: Vec<u8>) {
        self.bytes(name, Dtype::U8, shape, bytes);
    }

    fn bytes(&mut self, name: String, dtype: Dtype, shape: &[usize], bytes: Vec<u8>) {
        self.0.push(Tensor { name, dtype, shape: shape.to_vec(), bytes });
    }

    /// Writes all to one file.
    pub(crate) fn write(&self, path: &Path) -> Result<(), Failure> {
        let views = self
            .0
            .iter()
            .map(|t| Ok((t.name.as_str(), TensorView::new(t.dtype, t.shape.clone(), &t.bytes)?)))
            .collect::<Result<Vec<_>, Failure>>()?;
        Ok(serialize_to_file(views, None, path)?)
    }
}
