//! Files below the output folder of a comparison or a sweep.
//!
//! ```text
//! OUT/forest-41/seed.png, script.txt      inputs of all rollouts through a scene
//! OUT/forest-41/truth/frames/000000.png   a stream of frames: the renderer's
//! OUT/forest-41/coherence/                a rollout: its manifest and its frames
//! ```

use std::path::{Path, PathBuf};

use crate::output::FRAMES;
use crate::scene_id::SceneId;

/// Folder of the renderer's frames, within that of the scene.
pub(crate) const TRUTH: &str = "truth";

impl SceneId {
    /// Folder of the scene below `out`.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        out.join(format!("{}-{}", self.family, self.seed))
    }

    /// Seed picture of all rollouts through the scene.
    pub(crate) fn seed_picture(self, out: &Path) -> PathBuf {
        self.folder(out).join("seed.png")
    }

    /// Control script of all rollouts through the scene; with `straight`, the one without the mouse.
    pub(crate) fn script(self, out: &Path, straight: bool) -> PathBuf {
        self.folder(out).join(if straight { "script-straight.txt" } else { "script.txt" })
    }
}

/// File of frame `number` in a stream's folder.
pub(crate) fn frame(folder: &Path, number: u64) -> PathBuf {
    folder.join(FRAMES).join(format!("{number:06}.png"))
}
