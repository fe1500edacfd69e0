//! Cairn: a generative world inside a game engine.
//!
//! Controls go in, pictures come out, and one sentence of data flow orders the rooms:
//!
//! ```text
//! controls -> world -> anchor -> guidance -> frame generation -> presentation target
//! ```
//!
//! A room uses only the rooms below it in the list of modules here, never above.
#![warn(missing_docs)]

// Tests inside the library share helpers with those outside, which call it by name.
#[cfg(test)]
extern crate self as cairn;

pub mod abi;

pub mod present;

pub mod framegen;

pub mod guidance;

pub mod world;

pub mod runtime;

pub mod bundle;

pub mod ffx;

#[cfg(windows)]
pub mod gpu;

pub mod tasks;

mod error;
mod libraries;
mod object_count;
mod picture;
mod texels;

pub use error::{Error, ErrorKind, Result};
pub use libraries::LibrarySearch;
pub use picture::{MAX_SIDE, Picture, PictureF16, Pixel, Raster};
pub use texels::Colours;
