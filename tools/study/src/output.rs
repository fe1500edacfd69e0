//! The output folder of a rollout or a reconstruct: names of its files, and checks of the folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cairn::{Error, ErrorKind, Result};

use crate::manifest::{Output, digest_file};
use crate::settings::Formats;
use media::{FileSystem, Mp4Sink, PngSink, Sink, VideoFormat, WrittenFile, Y4mSink, describe_io};

pub(crate) const MANIFEST: &str = "manifest.json";
pub(crate) const SHEET: &str = "contact-sheet.png";
pub(crate) const LATENTS: &str = "latents.safetensors";
pub(crate) const VIDEO: &str = "rollout.mp4";
pub(crate) const RAW: &str = "rollout.y4m";
pub(crate) const FRAMES: &str = "frames";

/// Files of a reconstruct, besides the manifest, the sheet and the frames.
pub(crate) mod reconstruct {
    pub(crate) const VIDEO: &str = "reconstruct.mp4";
    pub(crate) const RAW: &str = "reconstruct.y4m";
    pub(crate) const COMPARISON_VIDEO: &str = "comparison.mp4";
    pub(crate) const COMPARISON: &str = "comparison.png";
    pub(crate) const TABLE: &str = "scores.csv";
}

/// The output folder.
pub(crate) struct Folder {
    path: PathBuf,
}

impl Folder {
    /// Checks that `path` may be written to: it is missing, empty, or may be overwritten. Changes nothing.
    pub(crate) fn check(path: &Path, overwrite: bool) -> Result<Self> {
        let folder = Self { path: path.to_owned() };
        let empty = match fs::read_dir(path) {
            Ok(mut entries) => entries.next().is_none(),
            Err(e) if e.kind() == io::ErrorKind::NotFound => true,
            Err(e) => return Err(describe_io("cannot be written into", path, &e)),
        };
        match overwrite || empty {
            true => Ok(folder),
            false => Err(Error::new(ErrorKind::InvalidArgument, format!("{} is not empty", path.display()))
                .field("--out")
                .remedy("Choose another folder, or add --overwrite to replace an earlier rollout in it")),
        }
    }

    /// Creates the folder and removes an earlier rollout's files: those with the names above and no others.
    pub(crate) fn prepare(&self, pictures: bool) -> Result<()> {
        fs::create_dir_all(&self.path).map_err(|e| describe_io("cannot be made", &self.path, &e))?;
        let frames = self.join(FRAMES);
        let of_reconstruct = [
            reconstruct::VIDEO,
            reconstruct::RAW,
            reconstruct::COMPARISON_VIDEO,
            reconstruct::COMPARISON,
            reconstruct::TABLE,
        ];
        let names = [MANIFEST, SHEET, LATENTS, VIDEO, RAW].into_iter().chain(of_reconstruct);
        let mut old: Vec<PathBuf> = names.map(|name| self.join(name)).collect();
        old.extend(old.clone().into_iter().map(|path| path.with_added_extension("part")));
        remove(old)?;
        remove_numbered(&frames)?;
        if pictures {
            fs::create_dir_all(&frames).map_err(|e| describe_io("cannot be made", &frames, &e))?;
        }
        Ok(())
    }

    pub(crate) fn join(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Describes a finished file.
    pub(crate) fn describe(&self, path: &Path, kind: &str, frames: u64, complete: bool) -> Result<Output> {
        let (size, sha256) = digest_file(path)?;
        let relative = path.strip_prefix(&self.path).unwrap_or(path);
        let path = relative.to_string_lossy().replace('\\', "/");
        Ok(Output { path, kind: kind.to_owned(), frames, complete, size, sha256 })
    }

    /// Describes what a recorder wrote; a video is complete when it holds all `presented` frames.
    pub(crate) fn describe_media(&self, file: &WrittenFile, presented: u64) -> Result<Output> {
        self.describe(&file.path, file.kind, file.frames, file.kind == "png" || file.frames == presented)
    }
}

/// Sinks for the frames in `formats`: the MP4 and Y4M files with these `names`, and the folder of pictures. Encodes on `threads` threads, 0 for
/// one per core.
pub(crate) fn sinks(
    disk: &Arc<dyn FileSystem>,
    folder: &Folder,
    formats: Formats,
    [video, raw]: [&str; 2],
    format: &VideoFormat,
    threads: usize,
) -> Result<Vec<Box<dyn Sink>>> {
    let mut sinks: Vec<Box<dyn Sink>> = Vec::new();
    if formats.mp4 {
        sinks.push(Box::new(Mp4Sink::create(disk.as_ref(), &folder.join(video), format, threads)?));
    }
    if formats.y4m {
        sinks.push(Box::new(Y4mSink::create(disk.as_ref(), &folder.join(raw), format)?));
    }
    if formats.png {
        sinks.push(Box::new(PngSink::new(Arc::clone(disk), &folder.join(FRAMES))));
    }
    Ok(sinks)
}

/// Removes the numbered pictures of an earlier run, and no other files.
pub(crate) fn remove_numbered(folder: &Path) -> Result<()> {
    let numbered = |name: &str| {
        let stem = name.strip_suffix(".part").unwrap_or(name).strip_suffix(".png").unwrap_or("");
        stem.len() >= 6 && stem.bytes().all(|b| b.is_ascii_digit())
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    remove(entries.filter(|e| numbered(&e.file_name().to_string_lossy())).map(|e| e.path()))
}

fn remove(paths: impl IntoIterator<Item = PathBuf>) -> Result<()> {
    for path in paths {
        match fs::remove_file(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => {
                return Err(describe_io("cannot be replaced", &path, &e));
            }
            _ => {}
        }
    }
    Ok(())
}
