//! Compute shaders in an engine's command list or in one of our own.
//!
//! [`CommandRing`] is a ring of [`FRAMES_IN_FLIGHT`] frames, each with a command list and its range of a descriptor heap. Resources are
//! passed with their current state ([`ResourceWithState`]); a [`CommandRecorder`] transitions them to the states that shaders need, and
//! back at the end of the frame. Constants are root constants. Pipelines are created once, when their owner is created.

mod barrier;
mod command_recorder;
mod command_ring;
mod frame_timing;
mod kernel;
pub(crate) mod picture_formats;
mod view;

pub use super::GpuTimeStatistics;
pub(in crate::gpu) use barrier::borrowed;
pub use barrier::transition;
pub use command_recorder::CommandRecorder;
pub(crate) use command_recorder::{Table, compute_queue_knows};
pub use command_ring::{CommandRing, FRAMES_IN_FLIGHT};
pub(crate) use kernel::{Kernel, Shape};
pub use picture_formats::{Output, Transfer};
pub use view::ResourceWithState;
pub(crate) use view::{Texture, View, WordRange, texture, untyped};
