//! Runs other programs, with pictures exchanged as files of raw 8-bit RGB.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use cairn::{Error, ErrorKind, Picture, Result};

use crate::inputs;
use media::describe_io;

/// A folder for one run, removed when dropped.
pub(in crate::quality) struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    /// A new folder of its own.
    pub(in crate::quality) fn new() -> Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let name = format!("cairn-quality-{}-{}", std::process::id(), NUMBER.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
        Ok(Self { folder })
    }

    /// A file in it.
    pub(in crate::quality) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes `text` into a file in it.
    pub(in crate::quality) fn text(&self, name: &str, text: &str) -> Result<PathBuf> {
        let path = self.path(name);
        fs::write(&path, text).map_err(|e| describe_io("cannot be written", &path, &e))?;
        Ok(path)
    }

    /// Writes pictures consecutively into a file in it.
    pub(in crate::quality) fn pictures<'a>(
        &self,
        name: &str,
        pictures: impl IntoIterator<Item = &'a Picture>,
    ) -> Result<PathBuf> {
        let path = self.path(name);
        let pixels = pictures.into_iter().flat_map(Picture::pixels);
        let bytes: Vec<u8> = pixels.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        fs::write(&path, bytes).map_err(|e| describe_io("cannot be written", &path, &e))?;
        Ok(path)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // If it cannot be removed, it stays in the folder for temporary files.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Reads as many pictures of `size` as a file of raw RGB holds.
pub(in crate::quality) fn read_pictures(path: &Path, size: (u32, u32)) -> Result<Vec<Picture>> {
    let bytes = fs::read(path).map_err(|e| describe_io("cannot be read", path, &e))?;
    let picture = |rgb: &[u8]| {
        Picture::from_rgba(size.0, size.1, rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect())
    };
    bytes.chunks_exact(size.0 as usize * size.1 as usize * 3).map(picture).collect()
}

/// Runs a program without input until it ends.
///
/// # Errors
/// `Unsupported` when it does not start or fails, with the end of its messages.
pub(in crate::quality) fn run(name: &str, command: &mut Command) -> Result<String> {
    let fail = |cause: String| Error::new(ErrorKind::Unsupported, cause).field(name);
    let output = command.stdin(Stdio::null()).output().map_err(|e| fail(format!("it does not run: {e}")))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = said.lines().filter(|line| !line.trim().is_empty()).collect();
    Err(fail(format!("it failed: {}", lines[lines.len().saturating_sub(3)..].join("; "))))
}

/// Converts a fetch error.
pub(in crate::quality) fn not_provided(error: &provision::Error) -> Error {
    inputs::not_provided(error, ErrorKind::Unsupported)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_go_out_and_come_back() {
        let scratch = Scratch::new().unwrap();
        let picture = |v: u8| Picture::from_rgba(2, 1, vec![v, 1, 2, 255, 3, v, 4, 255]).unwrap();
        let path = scratch.pictures("two", [&picture(9), &picture(7)]).unwrap();
        assert_eq!(read_pictures(&path, (2, 1)).unwrap(), [picture(9), picture(7)]);
        let folder = scratch.folder.clone();
        drop(scratch);
        assert!(!folder.exists());
    }

    #[test]
    fn a_program_that_fails_or_is_not_there_is_told() {
        let missing = run("nothing", &mut Command::new("no-such-program-of-ours")).unwrap_err();
        assert!(missing.to_string().starts_with("nothing: it does not run"), "{missing}");
        let ourselves = std::env::current_exe().unwrap();
        let failed = run("tests", Command::new(ourselves).arg("--no-such-option")).unwrap_err();
        assert!(failed.to_string().starts_with("tests: it failed: "), "{failed}");
        assert!(failed.to_string().contains("no-such-option"), "{failed}");
    }
}
