//! Compares results of a Direct3D 12 device with those of the processor, and makes the cases that are compared. Tests, benchmarks and
//! `cairn-check` use it.
//!
//! A function panics if results differ by more than its documentation allows, and if the device fails.

#[cfg(windows)]
pub mod blend;
#[cfg(windows)]
pub mod comparison;
#[cfg(windows)]
pub mod engine;
pub mod fault;
#[cfg(windows)]
pub mod flow;
pub mod frame_cases;
#[cfg(windows)]
pub mod generator;
#[cfg(windows)]
pub mod high_dynamic_range;
#[cfg(windows)]
pub mod memory;
#[cfg(windows)]
pub mod paper_guidance;
#[cfg(windows)]
pub mod presenters;
#[cfg(windows)]
pub mod resize;
#[cfg(windows)]
pub mod resources;
#[cfg(windows)]
pub mod system_calls;
#[cfg(windows)]
pub mod textures;
