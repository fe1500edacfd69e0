//! AMD's ffx-api: its structs, its libraries loaded at run time, and their providers. Building needs nothing of AMD's SDK.
//!
//! The interface is five functions over linked structs, each with an id ([`Chain`]). Which structs a library accepts differs
//! between the releases 1.1 to 2.4 of the SDK; the provider's version and return codes decide which are used ([`Provider`]).

mod api;
pub mod bindings;
mod chain;
mod context;
mod diagnosis;
mod exception;
#[cfg(test)]
mod fake_library;
mod generator;
mod library;
mod memory_usage;
mod message;
#[cfg(windows)]
mod pass_through_detector;
mod provider;
#[cfg(windows)]
mod requirements;
#[cfg(windows)]
mod resource;
#[cfg(windows)]
mod sanitised_motion;
#[cfg(windows)]
mod self_test;
#[cfg(windows)]
mod swapchain;
#[cfg(windows)]
mod texture_generator;
#[cfg(windows)]
mod texture_upscaler;
mod upscaler;

pub use api::{Api, Effect};
pub use chain::{Chain, Extends, FfxStruct, Header};
pub use context::{Context, Provider};
pub use generator::{Camera, Frame, FrameParams, Generator};
pub use library::LibraryKind;
#[cfg(windows)]
pub use library::{File, FileVersion, Library, LoadOptions, allow_unsigned_in_host, signer_of};
pub use memory_usage::{ReportsMemory, memory_needed};
#[cfg(windows)]
pub use pass_through_detector::GenerationCheck;
pub use provider::{Choice, Dialect, Family, Version, choose, versions};
#[cfg(windows)]
pub use requirements::{Requirement, RequirementKind, requirements};
#[cfg(windows)]
pub(crate) use swapchain::is_presenting_thread;
#[cfg(windows)]
pub use swapchain::{
    FrameTextures, Interface, Pacing, Swapchain, SwapchainMemory, SwapchainOptions, SwapchainSource,
    swapchain_memory_needed,
};
#[cfg(windows)]
pub use texture_generator::{GenerationTextures, TextureGenerator, TextureMemory, TextureOptions};
#[cfg(windows)]
pub use texture_upscaler::{TextureUpscaler, UpscaleTextures};
pub use upscaler::{ReactiveMask, UpscaleFrame, UpscaleParams, Upscaler};
