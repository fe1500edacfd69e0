//! Checks that an ONNX model passes before the runtime gets it: `docs/bundle.md` section 4.
//!
//! - [`wire`] and [`proto`] parse the bytes, field by field; [`messages`] has the numbers of the fields.
//! - [`operators`] and [`shape_inference`] check that every operator is on the list and that every shape follows from the inputs' shapes.
//! - [`residual`] finds the residual stream and checks its type.
//! - [`blocks`] checks the matrices that are stored in fewer than 16 bits.
//! - [`peaks`] adds outputs to a model: the largest magnitudes of its values.
//! - [`split_k`] divides float16 products by weights into sums of fewer numbers, for providers that add float16 in float16.
//! - [`products`] rewrites the products of attention for providers without `FusedMatMul`.
//! - [`largest_weight`] finds a model's largest tensor of weights.
//! - [`model_writer`] writes the small models that move and check values on a device.
//! - [`conditioning`] finds the parts of a transformer that depend on noise levels alone, or on controls alone.
//! - [`slices`] splits a transformer into that part and models of consecutive layers.
//! - [`interface`] compares inputs and outputs with the format's tables.
//! - [`check`] combines these checks, and checks that weights lie inside files that the bundle lists.
//!
//! Nothing here recurses, and nothing allocates more than a small multiple of the model's own size.

mod blocks;
mod check;
mod conditioning;
mod interface;
mod largest_weight;
mod messages;
mod model_writer;
mod operators;
mod peaks;
mod products;
mod proto;
mod residual;
mod shape_inference;
mod slices;
mod split_k;
#[cfg(any(windows, test))]
mod weights;
mod wire;
mod writer;

pub(super) use blocks::check_scales;
pub(super) use check::{ExternalData, ModelContext, check, footprint};
pub(crate) use conditioning::with_weights_inside;
pub(crate) use largest_weight::largest_weight;
pub(crate) use model_writer::ModelWriter;
pub use operators::operators;
pub(crate) use peaks::ModelWithPeaks;
pub(crate) use products::without_fused_products;
pub(super) use shape_inference::Footprint;
pub use slices::slice_transformer;
pub(crate) use slices::{ConditioningModel, ConditioningModels, NamedTensor, SliceModel, SliceTensor, Slices};
pub(crate) use split_k::with_split_k;
#[cfg(windows)]
pub(crate) use weights::{Weight, weights_as_inputs};

use crate::bundle::Precision;
use crate::{Error, ErrorKind};

/// Result of a check inside one model.
type CheckResult<T> = Result<T, Fault>;

/// Why a model is refused: one sentence without a final stop.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Fault {
    cause: String,
    /// The model is not at fault: memory ran out during the check.
    is_out_of_memory: bool,
}

impl Fault {
    fn new(cause: impl Into<String>) -> Self {
        Self { cause: cause.into(), is_out_of_memory: false }
    }

    fn no_memory(_: impl std::error::Error) -> Self {
        Self { cause: "the lists that are needed to check it cannot be allocated".into(), is_out_of_memory: true }
    }

    /// The error for a model without a file, such as one that is rewritten.
    fn error(self) -> Error {
        Error::new(if self.is_out_of_memory { ErrorKind::OutOfMemory } else { ErrorKind::InvalidBundle }, self.cause)
    }

    /// The same fault with `location` prepended.
    fn within(self, location: &str) -> Self {
        Self { cause: format!("{location}: {}", self.cause), ..self }
    }
}

/// A name from a model, safe to print and not too long.
fn quoted(name: &str) -> String {
    let mut text: String = name.chars().take(80).flat_map(char::escape_debug).collect();
    if name.chars().nth(80).is_some() {
        text.push_str("...");
    }
    format!("`{text}`")
}

/// Element types of values, with ONNX's numbers for them (`TensorProto.DataType`). A bundle's graphs may have all but `I32`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DataType {
    F32 = 1,
    U8 = 2,
    I32 = 6,
    I64 = 7,
    F16 = 10,
}

impl DataType {
    /// The type of a value in a bundle's graph.
    fn of(data_type: i64) -> CheckResult<Self> {
        match data_type {
            1 => Ok(Self::F32),
            2 => Ok(Self::U8),
            7 => Ok(Self::I64),
            10 => Ok(Self::F16),
            other => {
                let known = "float32 (1), uint8 (2), int64 (7) and float16 (10)";
                Err(Fault::new(format!("the element type {other} is none of {known}")))
            }
        }
    }

    /// Whether operators compute with it; others only carry stored integers.
    fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F16)
    }

    fn bytes(self) -> u64 {
        match self {
            Self::F32 | Self::I32 => 4,
            Self::U8 => 1,
            Self::I64 => 8,
            Self::F16 => 2,
        }
    }
}

impl From<Precision> for DataType {
    fn from(precision: Precision) -> Self {
        match precision {
            Precision::F32 => Self::F32,
            Precision::F16 => Self::F16,
        }
    }
}

impl std::fmt::Display for DataType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::F32 => "float32",
            Self::U8 => "uint8",
            Self::I32 => "int32",
            Self::I64 => "int64",
            Self::F16 => "float16",
        })
    }
}

/// Type and size of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Shape {
    element: DataType,
    dims: Vec<u64>,
}

impl Shape {
    /// Number of elements; `None` if it overflows.
    fn count(&self) -> Option<u64> {
        self.dims.iter().try_fold(1_u64, |product, &n| product.checked_mul(n))
    }
}
