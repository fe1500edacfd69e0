//! `study play`: a window in which one walks through the world. A thread of its own steps the world, and the window shows what there is.
//!
//! ```text
//! window -> controls -> worker: rollout, guidance -> playback: presenter, frame generator -> overlay -> window
//!                         |
//!                         +-- walk file: record, replay
//! ```

pub(crate) mod controls;
mod overlay;
mod pacing;
pub(crate) mod playback;
mod walk_file;
mod window;
mod worker;

use std::path::PathBuf;

use cairn::world::OperatingPoint;
use scenes::Family;

pub(crate) use walk_file::WalkFile;
pub(crate) use window::run;

use crate::device::DeviceChoice;

/// Options of a game.
pub(crate) struct PlayOptions {
    /// The bundle; `None` for the library's own.
    pub(crate) world: Option<PathBuf>,
    pub(crate) level: Family,
    pub(crate) point: OperatingPoint,
    /// Frames per anchor.
    pub(crate) multiplier: u32,
    /// Seed of the noise.
    pub(crate) seed: u64,
    pub(crate) device: DeviceChoice,
    /// Threads of a pass; `None` for one per core.
    pub(crate) threads: Option<usize>,
    /// Size of the window in pixels.
    pub(crate) size: [u32; 2],
    /// Number of latents after which the window closes.
    pub(crate) latents: Option<u64>,
    pub(crate) replay: Option<WalkFile>,
    /// Folder of recordings.
    pub(crate) out: PathBuf,
    /// Record from the start.
    pub(crate) record: bool,
    /// Draw nothing over the picture at first.
    pub(crate) plain: bool,
    /// Show anchors only at first.
    pub(crate) anchors: bool,
}
