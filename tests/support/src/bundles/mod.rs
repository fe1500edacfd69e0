//! Small bundles, models and archives, valid and invalid.

pub mod onnx_writer;
pub mod toy_bundle;
pub mod zip_writer;
