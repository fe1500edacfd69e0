//! The study as a library: picture metrics, media, and the experiments on a world, as the program `study` runs them.
//!
//! | module | content |
//! |---|---|
//! | [`metrics`] | PSNR, SSIM, MS-SSIM and LPIPS of a picture against the true one |
//! | [`motion`], [`cadence`] | experiments on frame generation, in scenes whose motion and depth are known |
//! | [`quality`] | generated frames beside those of other methods |
//! | [`world_quality`] | a world against the truth of the scenes |
//! | [`compare`], [`sweep`] | operating points against each other, in rollouts that worker processes make |
//!
//! Rollouts are [`Job`]s, which [`replay`](replay()) makes again from their [`Manifest`]; [`reconstruct`](reconstruct()) and
//! [`interpolate`](interpolate()) make the frames between anchors of a scene and of an existing video. `study play` is in the private module `play`:
//! a window in which one walks through a world. [`run`] is the command line.
//!
//! ```text
//! cli -> settings -> job -> media, latents, sheet -> manifest
//!                     ^                              |
//!                     +----------- replay -----------+
//! cli -> experiment <- motion, cadence, quality, world_quality, compare, sweep
//! ```
#![warn(missing_docs)]

pub mod cadence;
mod cli;
pub mod compare;
mod demo;
mod device;
mod document;
pub mod experiment;
#[doc(hidden)]
pub mod fuzz_targets;
mod generator;
mod inputs;
mod interpolate;
mod job;
mod latents;
mod level;
mod losses;
mod machine;
mod manifest;
pub mod metrics;
pub mod motion;
mod output;
mod picture;
mod play;
mod progress;
pub mod quality;
mod reconstruct;
mod replay;
mod scene_id;
mod seed_picture;
mod sets;
mod settings;
mod sheet;
mod statistics;
pub mod sweep;
mod table;
mod text;
mod upscaler;
mod workers;
pub mod world_quality;

pub use cli::run;
pub use device::DeviceChoice;
pub use generator::GeneratorChoice;
pub use inputs::Overrides;
pub use interpolate::{FOLDER_RATE, Interpolation, MAX_MULTIPLIER, Report, interpolate};
pub use job::{Job, JobOutcome, run as run_job};
pub use machine::{AdapterVersion, LibraryVersion, Versions};
pub use manifest::{Counts, Input, Inputs, MANIFEST_VERSION, Manifest, Output, sha256};
pub use progress::Progress;
pub use reconstruct::{
    ReconstructCounts, ReconstructManifest, ReconstructOutcome, ReconstructSettings, Reconstruction, Summary,
    TruthOrPicture, reconstruct,
};
pub use replay::{Difference, Replay, ReplayReport, replay};
pub use settings::{Formats, Settings};
