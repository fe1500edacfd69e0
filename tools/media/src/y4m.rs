//! Y4M: uncompressed video with a text header, read by ffmpeg, mpv and encoders.

use std::path::Path;

use cairn::{Error, Result};

use super::recorder::{Frame, Sink, WrittenFile};
use super::{Disk, GrowingFile, VideoFormat};

/// Writes a Y4M file: 4:2:0, left-sited chroma, limited range, the same planes that the AV1 encoder gets.
pub struct Y4mSink {
    file: GrowingFile,
    unit: Vec<u8>,
    frames: u64,
}

impl Y4mSink {
    /// Starts `path`.
    ///
    /// # Errors
    /// `Io` when the file cannot be made.
    pub fn create(disk: &dyn Disk, path: &Path, format: &VideoFormat) -> Result<Self> {
        let mut file = GrowingFile::create(disk, path)?;
        let VideoFormat { size: (width, height), rate, pixel_aspect: (across, down), .. } = *format;
        let header = format!(
            "YUV4MPEG2 W{width} H{height} F{}:{} Ip A{across}:{down} C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED \
             XCOLORMATRIX=BT709\n",
            rate.numerator(),
            rate.denominator()
        );
        if let Err(error) = file.append(header.as_bytes()) {
            file.discard();
            return Err(error);
        }
        Ok(Self { file, unit: Vec::new(), frames: 0 })
    }
}

impl Sink for Y4mSink {
    fn kind(&self) -> &'static str {
        "y4m"
    }

    fn wants_planes(&self) -> bool {
        true
    }

    fn write(&mut self, frame: &Frame<'_>) -> Result<()> {
        self.unit.clear();
        self.unit.extend_from_slice(b"FRAME\n");
        for i in 0..3 {
            self.unit.extend_from_slice(frame.planes.plane(i));
        }
        self.file.append(&self.unit)?;
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>, _failed: bool) -> (Vec<WrittenFile>, Option<Error>) {
        let frames = self.frames;
        match self.file.close() {
            Ok(path) => (vec![WrittenFile { path, kind: "y4m", frames }], None),
            Err(error) => (Vec::new(), Some(error)),
        }
    }
}
