//! The C interface: `include/cairn.h` is made from this module and from nothing else.
//!
//! This module only marshals: it converts arguments and results, and calls the modules below it. One file for each object, in the
//! order of the header:
//!
//! | file | contents |
//! |---|---|
//! | `version`, `results`, `logging`, `threads` | version numbers; results and the last error; log callback; threads, or the host's job system |
//! | `requirements`, `device`, `world` | devices and their requirements; loaded worlds |
//! | `images`, `controls` | pictures in the host's memory; the player's controls |
//! | `rollout`, `steps`, `anchor`, `state` | a rollout, its queue of steps, its anchors, its saved state |
//! | `guidance`, `presenter`, `budget` | motion and depth; frames and when they are due; limits on time and memory |
//! | `script`, `recorder` | control scripts and their recording |
//! | `statistics` | counters and measured times |
//! | `d3d12` | experimental: functions that take an engine's own Direct3D 12 objects |
//! | `swapchain` | experimental: AMD's swap chain, for engines that want AMD to present |
//!
//! Internal modules, not in the header: `boundary` wraps every entry point and catches panics; `handles` is the table behind every
//! handle, with a `gate` for each object; `presenter::preferences` resolves a host's preferences for frames; `structs` and `text` read and write
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
mod structs;
mod text;
