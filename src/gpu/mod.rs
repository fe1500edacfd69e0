//! Direct3D 12: devices, queues and the moments on their timelines. Windows only.
//!
//! A [`Gpu`] is an engine's own device with its queue, or one of ours on an adapter; it has two [`Queue`]s, one for frames and
//! one for anchors, so that a world's long passes never stand before a frame. Work of one queue waits for work of the other at
//! a [`FencePoint`] and nowhere else.

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
pub(crate) use clock::Marks;
pub use clock::Spent;
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
/// The bindings in which objects of Direct3D are handed over.
pub use windows;
