//! The timeline: what is shown when, at which size.

#[cfg(windows)]
pub mod device;
mod motion;
pub mod pacing;
pub mod presenter;
mod statistics;
pub mod timeline;
pub mod upscale;
