//! Direct3D 12: devices, queues and fence points. Windows only.
//!
//! A [`Gpu`] is an engine's device with its queue, or our own device on an adapter. It has two [`Queue`]s, one for frames and
//! one for anchors, so that a world's long passes never delay a frame. Work of one queue waits for work of the other only at
//! a [`FencePoint`].

mod adapter;
mod budget;
mod budget_change;
mod clock;
pub mod compute;
mod device;
mod failure;
mod fence_point;
mod memory;
mod pipeline;
mod pipelines;
mod queue;
mod recorded;
mod residency;
mod resize;
mod shader;
mod system;
mod target;
mod texture;
mod uploads;

pub use adapter::{Adapter, adapters};
pub use budget::Budget;
pub(crate) use budget_change::BudgetChanges;
pub use clock::Spent;
pub(crate) use clock::TimestampPairs;
pub use device::Gpu;
pub(crate) use failure::failed_on;
pub use fence_point::FencePoint;
pub(crate) use memory::{Heap, Shared, buffer};
pub(crate) use pipeline::Pipeline;
pub(crate) use pipelines::Pipelines;
pub use queue::Queue;
pub(crate) use recorded::RecordedMemory;
pub(crate) use residency::ResidencySet;
pub use resize::{Planes, Resize};
pub use system::System;
pub use target::Target;
pub(crate) use target::check_list;
pub(crate) use texture::{blank_texture, read_buffer, written_texture};
pub use texture::{read_texture, texture_of};
pub use uploads::{Place, Uploads};
/// The crate whose Direct3D types this interface uses.
pub use windows;
