//! Y4M: uncompressed video with a text header, read by ffmpeg, mpv and encoders.

use std::path::Path;

use cairn::{Error, Result};

use super::recorder::{Frame, Sink, WrittenFile};
use super::{FileSystem, GrowingFile, Matrix, VideoFormat, Yuv420};

/// Writes a Y4M file: 4:2:0, left-sited chroma, limited range, and the matrix that players assume for its size, as a Y4M file has no tag that
/// they read.
pub struct Y4mSink {
    file: GrowingFile,
    planes: Yuv420,
    unit: Vec<u8>,
    frames: u64,
}

impl Y4mSink {
    /// Starts `path`.
    ///
    /// # Errors
    /// `Io` when the file cannot be made; `InvalidArgument` for an empty picture; `OutOfMemory`.
    pub fn create(disk: &dyn FileSystem, path: &Path, format: &VideoFormat) -> Result<Self> {
        let planes = Yuv420::with_matrix(format.size.0, format.size.1, Matrix::by_size(format.size))?;
        let mut file = GrowingFile::create(disk, path)?;
        let VideoFormat { size: (width, height), rate, pixel_aspect: (across, down), .. } = *format;
        // FFmpeg before 4.3, and others, refuse more than 80 bytes.
        let header = format!(
            "YUV4MPEG2 W{width} H{height} F{}:{} Ip A{across}:{down} C420mpeg2 XCOLORRANGE=LIMITED\n",
            rate.numerator(),
            rate.denominator()
        );
        if let Err(error) = file.append(header.as_bytes()) {
            file.discard();
            return Err(error);
        }
        Ok(Self { file, planes, unit: Vec::new(), frames: 0 })
    }
}

impl Sink for Y4mSink {
    fn kind(&self) -> &'static str {
        "y4m"
    }

    fn wants_planes(&self) -> bool {
        false
    }

    fn write(&mut self, frame: &Frame<'_>) -> Result<()> {
        self.planes.convert(frame.picture)?;
        self.unit.clear();
        self.unit.extend_from_slice(b"FRAME\n");
        for i in 0..3 {
            self.unit.extend_from_slice(self.planes.plane(i));
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
