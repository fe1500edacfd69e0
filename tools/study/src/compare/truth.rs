//! The renderer's truth of a scene: the same walk, rendered at the times and the size of the comparison.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use cairn::world::ControlScript;
use cairn::{ErrorKind, Result};
use scenes::{Clip, ClipOptions, Scene};
use serde::{Deserialize, Serialize};

use super::paths::{TRUTH, frame};
use super::walk::{self, RATE};
use crate::manifest::{MANIFEST_VERSION, read_manifest, sha256, to_json};
use crate::output::{FRAMES, MANIFEST};
use crate::progress::Progress;
use crate::scene_id::SceneId;
use media::{RealDisk, describe_io, encode_png, write_whole};

/// Folder of the truth of the walk without the mouse.
const STRAIGHT: &str = "truth-straight";
/// Job name in the manifest.
const JOB: &str = "truth";

/// Output folder and size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings<'a> {
    /// The output folder.
    pub(crate) out: &'a Path,
    /// `[width, height]`.
    pub(crate) size: [u32; 2],
}

/// `manifest.json` of a rendered walk.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Manifest {
    manifest_version: u32,
    /// `truth`.
    job: String,
    /// `forest`, `sword`, `desert` or `snow`.
    scene: String,
    /// Seed of the scene.
    place: u64,
    /// Checksum of the control script.
    script_sha256: String,
    /// Frames a second.
    rate: u32,
    /// `[width, height]` of the frames.
    size: [u32; 2],
    /// Version of this program, which renders the frames.
    version: String,
    /// The size of each frame's file, in bytes.
    files: Vec<u64>,
}

/// Renders `count` frames of a scene, unless they are there; with `straight`, of its walk without the mouse.
///
/// # Errors
/// `Unsupported` for a manifest of a newer version; `Io`; `Cancelled` when `stop` was set.
pub(crate) fn draw(
    id: SceneId,
    straight: bool,
    count: u64,
    settings: &Settings<'_>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<PathBuf> {
    let folder = id.folder(settings.out).join(if straight { STRAIGHT } else { TRUTH });
    let path = folder.join(MANIFEST);
    let script = if straight { walk::straight(id.family) } else { id.family.script().to_owned() };
    let wanted = |files| Manifest {
        manifest_version: MANIFEST_VERSION,
        job: JOB.into(),
        scene: id.family.to_string(),
        place: id.seed,
        script_sha256: sha256(script.as_bytes()),
        rate: RATE,
        size: settings.size,
        version: env!("CARGO_PKG_VERSION").into(),
        files,
    };
    if path.exists() && whole(&folder, &path, count, &wanted)? {
        return Ok(folder);
    }
    // Before its frames are replaced: a manifest vouches for all of them.
    match std::fs::remove_file(&path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(describe_io("cannot be removed", &path, &e)),
        _ => {}
    }
    let frames = folder.join(FRAMES);
    std::fs::create_dir_all(&frames).map_err(|e| describe_io("cannot be made", &frames, &e))?;
    progress.phase(&format!("drawing {id}"));
    let [width, height] = settings.size;
    let (scene, script) = (Scene::new(id.family, id.seed), ControlScript::parse(&script)?);
    let options = ClipOptions { width, height, rate: RATE, ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options)?;
    let mut files = Vec::new();
    progress.each_frame(count, stop, |number| {
        let bytes = encode_png(&clip.frame()?.picture)?;
        write_whole(&RealDisk, &frame(&folder, number), &bytes)?;
        files.push(bytes.len() as u64);
        Ok(())
    })?;
    write_whole(&RealDisk, &path, &to_json(&wanted(files))?)?;
    Ok(folder)
}

/// Whether all frames match the manifest, and the manifest is the wanted one.
fn whole(folder: &Path, path: &Path, count: u64, wanted: &dyn Fn(Vec<u64>) -> Manifest) -> Result<bool> {
    let found: Manifest = match read_manifest(path, "a drawn walk", "study compare") {
        Ok(found) => found,
        Err(error) if error.kind() == ErrorKind::InvalidArgument => return Ok(false),
        Err(error) => return Err(error),
    };
    let there =
        |(number, size): (u64, &u64)| std::fs::metadata(frame(folder, number)).is_ok_and(|data| data.len() == *size);
    Ok(found == wanted(found.files.clone()) && found.files.len() as u64 >= count && (0..).zip(&found.files).all(there))
}
