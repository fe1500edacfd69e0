//! ONNX Runtime on one device: sessions, memory and their bindings.
//!
//! [`Ort`] is the library itself, loaded by path. A [`Device`] makes `Graph`s (sessions, shared by all rollouts) and
//! `ExecutionContext`s (the buffers and bound graphs of one rollout, with its work in order). A context's memory may be host memory
//! or a graphics device's: users name buffers by handle, move bytes only through `ExecutionContext`, and wait for the device only
//! in `ExecutionContext::read`, `ExecutionContext::not_finite` and `ExecutionContext::rest`.

mod cpu;
mod device;
#[cfg(windows)]
mod directml;
mod execution_context;
mod failure;
mod find;
mod finite;
mod graph;
mod library;
mod memory;
#[cfg(windows)]
mod module;
mod pin;
mod stoppable;

pub use cpu::CpuOptions;
pub(crate) use device::MemoryChanges;
pub use device::{Device, DeviceMemory};
#[cfg(windows)]
pub(crate) use directml::Snapshot;
#[cfg(windows)]
pub use directml::{Captured, DirectMlOptions};
pub use execution_context::Bytes;
#[cfg(windows)]
pub use execution_context::ExternalTimes;
pub(crate) use execution_context::{
    Backup, BindingId, BufferId, ExecutionContext, FiniteCheckId, RecordedCopiesId, RecordedCopy, Region,
};
#[cfg(windows)]
pub(crate) use execution_context::{Decoded, Work};
pub(crate) use graph::{Graph, TensorSpec, element_size};
pub use library::Ort;
#[cfg(windows)]
pub use module::{LoadedLibrary, loaded_libraries};
pub(crate) use stoppable::StoppableContext;
