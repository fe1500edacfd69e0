//! A world on disk: reading, checking and describing a bundle. The format is `docs/bundle.md`.

mod manifest;

pub use manifest::*;
