//! The C interface: `include/cairn.h` is made from this module and from nothing else.
//!
//! Here is marshalling, and no work: what a call does is done by the rooms below. One file for each object and, in the order
//! of the header:
//!
//! | file | what |
//! |---|---|
//! | `version`, `results`, `logging`, `threads` | version numbers; results and the last error; log callback; threads, or the host's job system |
//! | `requirements`, `device`, `world` | what is created first |
//! | `images`, `controls` | what crosses the border in every frame |
//! | `rollout`, `steps`, `anchor`, `state` | a rollout step by step, by its queue, what it makes, and its state kept |
//! | `guidance`, `presenter`, `budget` | motion and depth, frames when they are due, and what it all may take |
//! | `script`, `recorder` | input written down, and played again |
//! | `statistics` | what can be asked |
//! | `d3d12` | experimental: what an engine's own Direct3D 12 objects come through |
//! | `swapchain` | experimental: AMD's swap chain, for engines that want AMD to present |
//!
//! Internal modules, not in the header: `boundary` wraps every entry point and catches panics; `handles` is the table behind every
//! handle, with a `gate` for each object; `preferences` resolves a host's preferences for frames; `structs` and `text` read and write
//! the host's memory; `record` lists the interface, to be compared with the header.
#![allow(non_camel_case_types, reason = "the names are the header's")]
#![allow(clippy::missing_safety_doc, reason = "the header says once, for all functions, what pointers must be")]

pub mod anchor;
pub mod budget;
pub mod controls;
pub mod d3d12;
pub mod device;
pub mod guidance;
pub mod images;
pub mod logging;
pub mod presenter;
pub mod record;
pub mod recorder;
pub mod requirements;
pub mod results;
pub mod rollout;
pub mod script;
pub mod state;
pub mod statistics;
pub mod steps;
pub mod swapchain;
pub mod threads;
pub mod version;
pub mod world;

mod boundary;
mod gate;
mod handles;
mod preferences;
mod structs;
mod text;
