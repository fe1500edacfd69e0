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
