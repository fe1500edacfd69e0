//! Output of the frames.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cairn::{Error, ErrorKind, Result};

use crate::manifest::absolute;
use crate::output::remove_numbered;
use media::{FileSystem, Mp4Sink, PngSink, Sink, VideoFormat, Y4mSink, describe_io};

/// One file, or a folder.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Target {
    Mp4(PathBuf),
    Y4m(PathBuf),
    Pictures(PathBuf),
}

impl Target {
    /// Kind of output by `path`'s extension.
    pub(super) fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("mp4") => Ok(Self::Mp4(path.to_owned())),
            Some("y4m") => Ok(Self::Y4m(path.to_owned())),
            None => Ok(Self::Pictures(path.to_owned())),
            Some(_) if path.is_dir() => Ok(Self::Pictures(path.to_owned())),
            Some(other) => {
                Err(Error::new(ErrorKind::InvalidArgument, format!("files that end in .{other} are not written"))
                    .field("--out")
                    .remedy("Name a file that ends in .mp4 or .y4m, or a folder for PNG pictures"))
            }
        }
    }

    /// `out`, or an MP4 file beside the input, named after the multiplier.
    pub(super) fn choose(input: &Path, out: Option<&Path>, multiplier: u32) -> Result<Self> {
        if let Some(out) = out {
            return Self::of(out);
        }
        let input = absolute(input);
        let name = if input.is_dir() { input.file_name() } else { input.file_stem() };
        let mut name = name.unwrap_or("pictures".as_ref()).to_owned();
        name.push(format!("-{multiplier}x.mp4"));
        Ok(Self::Mp4(input.with_file_name(name)))
    }

    pub(super) fn path(&self) -> &Path {
        match self {
            Self::Mp4(path) | Self::Y4m(path) | Self::Pictures(path) => path,
        }
    }

    /// Checks that no existing file would be lost. Changes nothing.
    pub(super) fn check(&self, input: &Path, overwrite: bool) -> Result<()> {
        let path = self.path();
        let refused = |cause: String, remedy: &str| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field("--out").remedy(remedy))
        };
        if absolute(path) == absolute(input) {
            return refused("the output would replace its own input".into(), "Choose another place");
        }
        let taken = match self {
            Self::Pictures(folder) => match fs::read_dir(folder) {
                Ok(mut entries) => entries.next().is_some(),
                Err(e) if e.kind() == io::ErrorKind::NotFound => false,
                Err(e) => return Err(describe_io("cannot be written into", folder, &e)),
            },
            Self::Mp4(file) | Self::Y4m(file) if file.is_dir() => {
                return refused(format!("{} is a folder", file.display()), "Choose another name");
            }
            Self::Mp4(file) | Self::Y4m(file) => file.exists(),
        };
        if taken && !overwrite {
            return refused(
                format!("{} is there already", path.display()),
                "Choose another place, or add --overwrite to replace it",
            );
        }
        Ok(())
    }

    /// Creates the output, replacing an earlier one.
    pub(super) fn create(&self, disk: &Arc<dyn FileSystem>, format: &VideoFormat) -> Result<Box<dyn Sink>> {
        Ok(match self {
            Self::Mp4(path) => Box::new(Mp4Sink::create(disk.as_ref(), path, format, 0)?),
            Self::Y4m(path) => Box::new(Y4mSink::create(disk.as_ref(), path, format)?),
            Self::Pictures(folder) => {
                fs::create_dir_all(folder).map_err(|e| describe_io("cannot be made", folder, &e))?;
                remove_numbered(folder)?;
                Box::new(PngSink::new(Arc::clone(disk), folder))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_says_the_kind() {
        assert_eq!(Target::of("a/b.MP4".as_ref()).unwrap(), Target::Mp4("a/b.MP4".into()));
        assert_eq!(Target::of("b.y4m".as_ref()).unwrap(), Target::Y4m("b.y4m".into()));
        assert_eq!(Target::of("frames/".as_ref()).unwrap(), Target::Pictures("frames/".into()));
        let error = Target::of("b.avi".as_ref()).unwrap_err();
        assert!(error.to_string().contains(".avi") && error.to_string().contains(".y4m"), "{error}");
    }

    #[test]
    fn without_a_name_the_video_stands_beside_its_input() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let chosen = |input: &Path| Target::choose(input, None, 4).unwrap();
        assert_eq!(chosen(&root.join("walk.in.mov")), Target::Mp4(root.join("walk.in-4x.mp4")));
        fs::create_dir(root.join("shots.v1")).unwrap();
        assert_eq!(chosen(&root.join("shots.v1")), Target::Mp4(root.join("shots.v1-4x.mp4")));
    }
}
