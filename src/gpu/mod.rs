//! Direct3D 12: devices, queues and fence points. Windows only.
//!
//! A [`Gpu`] is an engine's device with its queue, or our own device on an adapter. It has two [`Queue`]s, one for frames and
//! one for anchors, so that a world's long passes never delay a frame. Work of one queue waits for work of the other only at
//! a [`FencePoint`].

mod adapter;
mod budget_changes;
mod buffers;
pub mod compute;
mod device;
mod failure;
mod fence_point;
mod fenced_slots;
mod memory_budget;
mod pipeline;
mod pipeline_cache;
mod queue;
mod residency;
mod resize;
mod shader;
mod system;
mod target;
mod texture;
mod timestamps;
mod uploads;

pub use crate::gpu_time::GpuTimeStatistics;
pub use adapter::{Adapter, adapters};
pub(crate) use budget_changes::BudgetChanges;
pub(crate) use buffers::{Heap, MappedBuffer, buffer};
pub use device::Gpu;
pub(crate) use failure::failed_on;
pub use fence_point::FencePoint;
pub(crate) use fenced_slots::FencedSlots;
pub use memory_budget::MemoryBudget;
pub(crate) use pipeline::Pipeline;
pub(crate) use pipeline_cache::PipelineCache;
pub use queue::Queue;
pub(crate) use residency::ResidencySet;
pub use resize::{Planes, Resize};
pub use system::System;
pub use target::Target;
pub(crate) use target::check_list;
pub(crate) use texture::{open_list, picture_texture, read_buffer, writable_texture};
pub use texture::{read_texture, texture_from_picture};
pub(crate) use timestamps::TimestampPairs;
pub use uploads::{PendingUpload, Uploads};
/// The crate whose Direct3D types this interface uses.
pub use windows;
