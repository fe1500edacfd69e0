//! The timeline: what is shown when, at which size.

pub mod timeline;
pub mod upscale;
