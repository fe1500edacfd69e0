//! Presentation: timing, generation and scaling of the frames that are shown.

mod area;
#[cfg(windows)]
pub mod d3d12;
#[cfg(windows)]
pub mod device;
mod drawer;
mod governor;
mod motion;
pub mod pacing;
pub mod presenter;
mod statistics;
pub mod timeline;
pub mod upscale;

/// Which generator or upscaler made the last frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Its name and version, such as `fsr 3.1.5`, `shader` or `spatial`; empty for the generator on the CPU, and for no upscaler.
    pub name: String,
    /// Why a preferred one was not used; empty if it was.
    pub reason: String,
}
