//! Code that several test programs use. Unit tests of the library cannot use this crate: it links the library itself, and its types would be
//! those of a second copy. They include files as modules instead: `worlds.rs`, and `frame_cases.rs` of
//! `tests/gpu-testing`.

pub mod allocations;
pub mod bundles;
pub mod c_interface;
pub mod child_test;
#[cfg(windows)]
pub mod d3d12;
#[cfg(windows)]
pub mod ffx;
pub mod fuzz_targets;
pub mod mutator;
#[cfg(target_os = "linux")]
pub mod process;
pub mod trials;
pub mod worlds;

pub use gpu_testing::frame_cases;
