//! Input frames: a Y4M file, a folder of pictures, or any video that ffmpeg can read.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use cairn::{Error, ErrorKind, Picture, Result};

use super::ffmpeg;
use super::folder;
use crate::sets;
use media::{FrameRate, Y4M_MAGIC, Y4mReader, describe_io};

/// Frames of one size in order of time.
pub(super) trait Source: Send {
    /// Reads the next frame into `out`; `false` at the end.
    fn read(&mut self, out: &mut Picture) -> Result<bool>;
}

/// An opened input, whose frames are not read yet.
pub(super) struct Input {
    pub(super) size: (u32, u32),
    /// `None` if the input does not state it.
    pub(super) rate: Option<FrameRate>,
    pub(super) pixel_aspect: (u32, u32),
    /// Expected number of frames, if known in advance.
    pub(super) expected: Option<u64>,
    /// Notes for the report.
    pub(super) notes: Vec<String>,
    pub(super) source: Box<dyn Source>,
    /// Ends the other process, so that a blocked read returns.
    pub(super) stopper: Option<ffmpeg::Stopper>,
}

impl Source for Y4mReader {
    fn read(&mut self, out: &mut Picture) -> Result<bool> {
        Self::read(self, out)
    }
}

/// Opens `path`. The kind is decided by content, not by name.
pub(super) fn open(path: &Path) -> Result<Input> {
    let failed = |e: io::Error| describe_io("cannot be read", path, &e);
    let data = fs::metadata(path).map_err(failed)?;
    if data.is_dir() {
        return folder::open(path);
    }
    let mut file = File::open(path).map_err(failed)?;
    let mut head = Vec::new();
    (&mut file).take(Y4M_MAGIC.len() as u64).read_to_end(&mut head).map_err(failed)?;
    let name = path.display().to_string();
    if head == Y4M_MAGIC {
        let reader = Y4mReader::open(Box::new(io::Cursor::new(head).chain(file)), &name)?;
        let header = *reader.header();
        return Ok(Input {
            size: header.layout.size,
            rate: header.rate,
            pixel_aspect: header.pixel_aspect,
            expected: data.is_file().then(|| reader.frames_in(data.len())),
            notes: Vec::new(),
            source: Box::new(reader),
            stopper: None,
        });
    }
    let refused =
        |cause: &str, remedy: &str| Err(Error::new(ErrorKind::InvalidArgument, cause).field(&*name).remedy(remedy));
    if head.is_empty() {
        return refused("it is empty", "Name a video, or a folder of pictures");
    }
    if data.is_file() {
        sets::require_unsealed_film(path)?;
    }
    if head.starts_with(b"\x89PNG") || head.starts_with(b"\xff\xd8\xff") {
        return refused("it is one picture, and nothing lies between", "Name the folder that holds the pictures");
    }
    if !data.is_file() {
        return refused("what comes out of it is no Y4M video", "Give Y4M, or name a file");
    }
    ffmpeg::open(path)
}
