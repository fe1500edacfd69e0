//! AMD's ffx-api: its structs, its libraries loaded at run time, and the providers in them. Nothing of AMD's SDK is needed to
//! build.
//!
//! The interface is five functions over structs that name themselves by an id and point to the next ([`Chain`]). Which of the
//! structs a library understands differs from release to release, 1.1 to 2.4 of the SDK; what it does is decided by what it
//! answers ([`Provider`]).

mod api;
pub mod bindings;
mod chain;
#[cfg(windows)]
mod clean_motion;
mod context;
mod diagnose;
#[cfg(test)]
mod double;
#[cfg(windows)]
mod fourfold;
mod generator;
mod library;
mod memory;
mod message;
mod provider;
#[cfg(windows)]
mod requirements;
#[cfg(windows)]
mod resource;
#[cfg(windows)]
mod self_test;
#[cfg(windows)]
mod swapchain;
#[cfg(windows)]
mod texture_upscaler;
#[cfg(windows)]
mod textures;
mod upscaler;
#[cfg(windows)]
mod watch;

pub use api::{Api, Effect};
pub use chain::{Chain, Described, Extends, Header};
pub use context::{Context, Provider};
#[cfg(windows)]
pub use fourfold::FourfoldGenerator;
pub use generator::{Camera, Frame, Generator, Shot};
pub use library::Part;
#[cfg(windows)]
pub use library::{File, FileVersion, Library, LoadOptions, allow_unsigned_in_host};
pub use memory::{Reports, memory_needed};
pub use provider::{Choice, Dialect, Family, Version, choose, versions};
#[cfg(windows)]
pub use requirements::{Needed, Requirement, requirements};
#[cfg(windows)]
pub(crate) use swapchain::is_presenting_thread;
#[cfg(windows)]
pub use swapchain::{
    Interface, Paced, PacedPictures, Pacing, Swapchain, SwapchainMemory, SwapchainOptions, swapchain_memory_needed,
};
#[cfg(windows)]
pub use texture_upscaler::{TextureUpscaler, UpscalePictures};
#[cfg(windows)]
pub use textures::{Memory, Pictures, TextureGenerator, TextureOptions};
pub use upscaler::{ReactiveMask, UpscaleFrame, UpscaleShot, Upscaler};
#[cfg(windows)]
pub use watch::Seen;
