//! Presentation: timing, generation and scaling of the frames that are shown.

mod area;
mod cpu_drawer;
#[cfg(windows)]
pub mod d3d12;
#[cfg(windows)]
pub mod device;
mod frame;
mod frame_governor;
mod motion;
pub mod pacing;
pub mod presenter;
mod statistics;
pub mod timeline;
pub mod upscale;

use crate::Colours;

/// Whether a generator or an upscaler is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preference {
    /// If possible.
    #[default]
    Auto,
    /// Always: preparation fails if it cannot be used.
    Require,
    /// Never.
    Never,
}

/// Which generators and upscalers make frames for Direct3D 12.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RendererOptions {
    /// Encoding of the targets' colours.
    pub colours: Colours,
    /// AMD's frame generation, for frames half way between two anchors. Needs the shaders, which make all others.
    pub fsr: Preference,
    /// The library's own shaders.
    pub shader: Preference,
    /// AMD's upscaling, for frames larger than the anchors. Needs the shaders.
    pub upscaler: Preference,
}

/// Which generator or upscaler made the last frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Its name and version, such as `fsr 3.1.5`, `shader` or `spatial`; empty for the generator on the CPU, and for no upscaler.
    pub name: String,
    /// Why a preferred one was not used; empty if it was.
    pub reason: String,
}
