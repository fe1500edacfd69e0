//! Small bundles, models and archives of the tests' own making, honest and otherwise.
#![allow(dead_code, reason = "each user of this module needs another part of it")]

pub(crate) mod onnx_writer;
pub(crate) mod toy_bundle;
pub(crate) mod zip_writer;
