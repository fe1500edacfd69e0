//! Compute shaders in an engine's command list or in one of our own.
//!
//! [`CommandRing`] is a ring of [`FRAMES_IN_FLIGHT`] frames, each with its part of a descriptor heap and a command list. What a shader
//! reads and writes is given with the state it rests in ([`ResourceWithState`]); a [`CommandRecorder`] brings it into the state that the shader needs
//! and, in the end, back. Constants lie in the command list itself. Pipelines are made once, with what records them.

mod barrier;
mod command_recorder;
mod command_ring;
mod kernel;
pub(crate) mod pictures;
mod timing;
mod view;

pub use super::Spent;
pub use barrier::transition;
pub use command_recorder::CommandRecorder;
pub(crate) use command_recorder::Table;
pub use command_ring::{CommandRing, FRAMES_IN_FLIGHT};
pub(crate) use kernel::{Kernel, Shape};
pub use pictures::{Output, Transfer};
pub use view::ResourceWithState;
pub(crate) use view::{Texture, View, Words, texture, untyped};
