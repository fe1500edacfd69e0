//! The size of a model's largest tensor of weights.

use super::Fault;
use super::proto::{self, Data};
use crate::Result;

/// Name and size in bytes of a model's largest tensor of weights; `None` if it has none.
///
/// # Errors
/// `InvalidBundle` for a model that does not pass the checks.
pub(crate) fn largest_weight(onnx: &[u8]) -> Result<Option<(String, u64)>> {
    let model = proto::model(onnx).map_err(Fault::error)?;
    let sizes = model.graph.tensors.iter().map(|tensor| {
        let bytes = match tensor.data {
            Data::Inline(bytes) => bytes.len() as u64,
            Data::External { length, .. } => length,
        };
        (tensor.name.to_owned(), bytes)
    });
    Ok(sizes.max_by_key(|(_, bytes)| *bytes))
}

#[cfg(test)]
mod tests {
    use super::super::{DataType, ModelWriter};
    use super::*;

    #[test]
    fn the_largest_weight_is_found() {
        let mut model = ModelWriter::default();
        model.input("x", DataType::F32, &[1000]);
        model.constant("small", &[1], &[1.0_f32]);
        model.constant("large", &[2, 3], &[1_i64; 6]);
        model.constant("middle", &[2], &[1_i32; 2]);
        assert_eq!(largest_weight(&model.finish()).unwrap(), Some(("large".to_owned(), 48)));
        assert_eq!(largest_weight(&ModelWriter::default().finish()).unwrap(), None);
    }
}
