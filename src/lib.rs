//! Cairn: a generative world inside a game engine.
//!
//! Its inputs are a player's controls, its outputs are pictures. The modules follow one data flow:
//!
//! ```text
//! controls -> world -> anchor -> guidance -> frame generation -> presentation target
//! ```
//!
//! A module uses only the modules below it in the list here, never above.
#![warn(missing_docs)]

// Unit tests share helpers with the integration tests, which refer to the library by name.
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

#[cfg(test)]
mod shader_constants;

#[cfg(windows)]
pub mod gpu;

pub mod tasks;

#[doc(hidden)]
pub mod locks;

mod allocate;
mod error;
mod gpu_time;
mod libraries;
mod object_count;
mod picture;
mod pixel_format;
mod quiet_mutex;
mod rule_set;

pub use error::{Error, ErrorKind, Result};
pub use gpu_time::GpuTimeStatistics;
pub use libraries::LibrarySearch;
pub use picture::{MAX_SIDE, Picture, PictureF16, Pixel, Raster};
pub use pixel_format::Colours;
