//! Compute shaders in an engine's command list or in one of our own.
//!
//! [`Frames`] is a ring of [`FRAMES_IN_FLIGHT`] frames, each with its part of a descriptor heap and a command list. What a shader
//! reads and writes is given with the state it rests in ([`Resting`]); a [`Frame`] brings it into the state that the shader needs
//! and, in the end, back. Constants lie in the command list itself. Pipelines are made once, with what records them.

mod barrier;
mod frame;
mod frames;
mod kernel;
pub(crate) mod pictures;
mod timing;
mod view;

pub use super::Spent;
pub use barrier::transition;
pub use frame::Frame;
pub(crate) use frame::Table;
pub use frames::{FRAMES_IN_FLIGHT, Frames};
pub(crate) use kernel::{Kernel, Shape};
pub use pictures::{Output, Transfer};
pub use view::Resting;
pub(crate) use view::{Texture, View, Words, texture, untyped};
