//! ONNX Runtime on one device: sessions, memory and their bindings.
//!
//! [`Ort`] is the library itself, loaded by path. A [`Device`] makes `Graph`s (sessions, shared by everybody) and
//! `Lane`s (one rollout's memory and bound runs, in order). What lies behind a lane may be host memory or a graphics
//! device: users name buffers by handle, move bytes only through `Lane`, and wait only in `Lane::read` and
//! `Lane::finite`.

mod cpu;
mod device;
#[cfg(windows)]
mod directml;
mod failure;
mod find;
mod finite;
mod graph;
mod lane;
mod library;
mod memory;
#[cfg(windows)]
mod module;
mod pin;
mod stop;

pub use cpu::CpuOptions;
pub(crate) use device::MemoryChanges;
pub use device::{Device, DeviceMemory};
#[cfg(windows)]
pub(crate) use directml::Snapshot;
#[cfg(windows)]
pub use directml::{Captured, DirectMlOptions};
pub(crate) use graph::{Graph, TensorSpec, element_size};
pub use lane::Bytes;
#[cfg(windows)]
pub use lane::Elsewhere;
pub(crate) use lane::{Backup, BindingId, BufferId, CopiesId, KeptCopy, Lane, LookId, Region};
#[cfg(windows)]
pub(crate) use lane::{Decoded, Work};
pub use library::Ort;
#[cfg(windows)]
pub use module::{LoadedLibrary, loaded_libraries};
pub(crate) use stop::StopLane;
