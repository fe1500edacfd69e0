//! One video per scene with all streams side by side, in step.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::{ErrorKind, Picture, Result};
use serde::{Deserialize, Serialize};

use super::panels::SideBySide;
use super::plan::Settings;
use super::walk::RATE;
use crate::manifest::{MANIFEST_VERSION, digest_file, read_manifest, to_json};
use crate::progress::Progress;
use crate::scene_id::SceneId;
use media::{FrameRate, Mp4Sink, RealDisk, Recorder, VideoFormat, write_whole};

/// File name of the video in its scene's folder.
pub(super) const VIDEO: &str = "side-by-side.mp4";
const MANIFEST: &str = "side-by-side.json";
const JOB: &str = "side-by-side";
/// Version of the layout; raised when it changes.
const LAYOUT: u32 = 2;

/// Record of a video's inputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Manifest {
    manifest_version: u32,
    /// `side-by-side`.
    job: String,
    layout: u32,
    /// Key of all streams, as in their series.
    streams: String,
    frames: u64,
    size: [u32; 2],
    /// Checksum of the video.
    sha256: String,
}

/// Makes the video of a scene unless it is there. `streams` is the key of its frames.
///
/// # Errors
/// `Unsupported` for a manifest of a newer version; `Io`; `Cancelled` when `stop` was set; errors of the encoder.
pub(super) fn video(
    scene: SceneId,
    streams: &str,
    frames: u64,
    settings: &Settings,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<PathBuf> {
    let folder = scene.folder(&settings.out);
    let (path, about) = (folder.join(VIDEO), folder.join(MANIFEST));
    let panels = SideBySide::new(scene, settings);
    let (width, height) = panels.size();
    let wanted = |sha256: String| Manifest {
        manifest_version: MANIFEST_VERSION,
        job: JOB.into(),
        layout: LAYOUT,
        streams: streams.to_owned(),
        frames,
        size: [width, height],
        sha256,
    };
    if about.exists() {
        let found = match read_manifest::<Manifest>(&about, "a side-by-side video", "study compare") {
            Ok(found) => Some(found),
            Err(error) if error.kind() == ErrorKind::InvalidArgument => None,
            Err(error) => return Err(error),
        };
        let there = path.exists().then(|| digest_file(&path)).transpose()?;
        if let (Some(found), Some((_, sha256))) = (found, there)
            && found == wanted(sha256)
        {
            return Ok(path);
        }
    }
    progress.phase(&format!("encoding {scene}"));
    let format = VideoFormat {
        quantiser: VideoFormat::SMALL,
        ..VideoFormat::new((width, height), FrameRate::new(RATE.into(), 1)?)
    };
    let sink = Mp4Sink::create(&RealDisk, &path, &format, 0)?;
    let recorder = Recorder::start(vec![Box::new(sink)], (width, height))?;
    let drawn = progress.each_frame(frames, stop, |number| {
        let mut picture = recorder.recycled().map_or_else(|| Picture::new(width, height), Ok)?;
        panels.draw(number, &mut picture)?;
        // If the recorder has stopped, `finish` returns the reason.
        recorder.push(picture);
        Ok(())
    });
    let recorded = recorder.finish()?;
    drawn?;
    if let Some(failure) = recorded.failure {
        return Err(failure);
    }
    let (_, sha256) = digest_file(&path)?;
    write_whole(&RealDisk, &about, &to_json(&wanted(sha256))?)?;
    Ok(path)
}
