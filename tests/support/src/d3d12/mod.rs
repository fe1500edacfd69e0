//! Direct3D 12 as an engine uses it, and hooks in its functions that record what the library calls.

pub mod amd;
pub mod buffers;
pub mod directml;
pub mod frame_scene;
pub mod function_tables;
pub mod list_calls;
pub mod object_counts;
pub mod recorder;

pub use gpu_testing::{engine, resources, textures};
