//! The main job as a program: a seed picture and a control script become anchors, generated frames and a video, with a
//! manifest from which the same files can be made again.
//!
//! ```text
//! cli -> settings -> job -> media, latents, sheet -> manifest
//!                      ^                              |
//!                      +----------- replay -----------+
//! ```

mod cadence;
mod cli;
mod compare;
mod demo;
mod device;
mod document;
mod generator;
mod inputs;
mod interpolate;
mod job;
mod latents;
mod machine;
mod manifest;
pub mod media;
pub mod metrics;
mod motion;
mod output;
mod picture;
mod place;
mod progress;
mod quality;
mod reconstruct;
mod replay;
mod settings;
mod sheet;
mod sweep;
mod table;
mod text;
mod upscaler;
mod workers;
mod world_quality;

pub use cli::run;
pub use device::DeviceChoice;
pub use generator::GeneratorChoice;
pub use inputs::Overrides;
pub use interpolate::{FOLDER_RATE, Interpolation, MAX_MULTIPLIER, Report, interpolate};
pub use job::{Job, Outcome, run as run_job};
pub use machine::{AdapterVersion, LibraryVersion, Versions};
pub use manifest::{Counts, Input, Inputs, MANIFEST_VERSION, Manifest, Output, sha256};
pub use progress::Progress;
pub use reconstruct::{
    ReconstructCounts, ReconstructManifest, ReconstructOutcome, ReconstructSettings, Reconstruction, Summary,
    TruthOrPicture, reconstruct,
};
pub use replay::{Compared, Difference, Replay, replay};
pub use settings::{Formats, Settings};
