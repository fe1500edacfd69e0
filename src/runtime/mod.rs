//! ONNX Runtime on one device: sessions, memory and bindings.
//!
//! [`Ort`] is the library itself, loaded by path. A [`Device`] makes `Graph`s (sessions, shared by all rollouts) and
//! `ExecutionContext`s (the buffers and bound graphs of one rollout, with its work in order). A context's memory may be host memory
//! or a graphics device's: users name buffers by handle, move bytes only through `ExecutionContext`, and wait for the device only
//! in `ExecutionContext::read`, `ExecutionContext::find_not_finite` and `ExecutionContext::rest`.

mod aligned_buffer;
mod cpu;
mod device;
#[cfg(windows)]
mod directml;
mod execution_context;
mod failure;
#[cfg(test)]
pub(crate) mod fake;
mod finite;
mod graph;
mod library;
mod library_search;
#[cfg(windows)]
mod module;
mod pin;
mod self_test;
mod webgpu;

pub use cpu::CpuOptions;
pub(crate) use device::MemoryChanges;
pub use device::{Device, DeviceKind, DeviceMemory};
#[cfg(windows)]
pub use directml::DirectMlOptions;
#[cfg(windows)]
pub(crate) use directml::Snapshot;
pub use execution_context::Bytes;
pub(crate) use execution_context::{
    Backup, BindingId, BufferId, ContextLimits, DecodedPicture, ExecutionContext, FiniteCheckId, RecordedCopiesId,
    RecordedCopy, Region, Tap,
};
#[cfg(windows)]
pub use execution_context::{CaptureStatistics, ExternalTimes};
#[cfg(windows)]
pub(crate) use execution_context::{Decoded, Work};
pub(crate) use finite::all_finite;
pub(crate) use graph::{ElementType, Graph, TensorSpec, element_size};
pub use library::Ort;
#[cfg(windows)]
pub use module::{LoadedLibrary, loaded_libraries};
pub(crate) use webgpu::WebGpuRequirements;
pub use webgpu::{WebGpuAdapter, WebGpuOptions, webgpu_adapters};
