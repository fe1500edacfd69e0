//! The timeline: what is shown when, at which size.

pub mod pacing;
pub mod presenter;
pub mod timeline;
pub mod upscale;
