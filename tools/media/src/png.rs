//! PNG pictures, one per frame, and single pictures as PNG or JPEG.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cairn::{Error, ErrorKind, Picture, Result};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::recorder::{Frame, Sink, WrittenFile};
use super::{FileSystem, write_whole};

/// How strongly a JPEG is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JpegQuality {
    /// Blocks are not visible.
    Page,
    /// About half the size: for files that are kept in a repository.
    Repository,
}

impl JpegQuality {
    /// Quality out of 100.
    fn percent(self) -> u8 {
        match self {
            Self::Page => 88,
            Self::Repository => 60,
        }
    }
}

/// Writes `000000.png`, `000001.png`, ... into a folder. Every file that exists is complete.
pub struct PngSink {
    disk: Arc<dyn FileSystem>,
    folder: PathBuf,
    written: Vec<WrittenFile>,
}

impl PngSink {
    /// Writes into `folder`, which must exist.
    pub fn new(disk: Arc<dyn FileSystem>, folder: &Path) -> Self {
        Self { disk, folder: folder.to_owned(), written: Vec::new() }
    }
}

impl Sink for PngSink {
    fn kind(&self) -> &'static str {
        "png"
    }

    fn wants_planes(&self) -> bool {
        false
    }

    fn write(&mut self, frame: &Frame<'_>) -> Result<()> {
        let path = self.folder.join(format!("{:06}.png", frame.number));
        write_whole(self.disk.as_ref(), &path, &encode_png(frame.picture)?)?;
        self.written.push(WrittenFile { path, kind: "png", frames: 1 });
        Ok(())
    }

    fn finish(self: Box<Self>, _failed: bool) -> (Vec<WrittenFile>, Option<Error>) {
        (self.written, None)
    }
}

/// `picture` as an 8-bit RGB PNG file; alpha is dropped.
///
/// # Errors
/// `OutOfMemory` or `InvalidArgument` from the encoder.
pub fn encode_png(picture: &Picture) -> Result<Vec<u8>> {
    encode(picture, CompressionType::Fast)
}

/// As [`encode_png`], slower and smaller: for single pictures that people keep and send.
///
/// # Errors
/// As [`encode_png`].
pub fn encode_small_png(picture: &Picture) -> Result<Vec<u8>> {
    encode(picture, CompressionType::Best)
}

/// `picture` as a JPEG file: for pages with many pictures.
///
/// # Errors
/// As [`encode_png`].
pub fn encode_jpeg(picture: &Picture, quality: JpegQuality) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality.percent())
        .write_image(&colours(picture)?, picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|e| Error::new(ErrorKind::InvalidArgument, format!("cannot be stored as JPEG: {e}")))?;
    Ok(file)
}

/// RGB bytes without alpha.
fn colours(picture: &Picture) -> Result<Vec<u8>> {
    let mut rgb = Vec::new();
    rgb.try_reserve_exact(picture.pixels().len() * 3)
        .map_err(|_| Error::new(ErrorKind::OutOfMemory, format!("{picture:?} does not fit memory as a file")))?;
    picture.pixels().iter().for_each(|px| rgb.extend_from_slice(&px[..3]));
    Ok(rgb)
}

fn encode(picture: &Picture, compression: CompressionType) -> Result<Vec<u8>> {
    let rgb = colours(picture)?;
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, compression, FilterType::Adaptive)
        .write_image(&rgb, picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|e| Error::new(ErrorKind::InvalidArgument, format!("cannot be stored as PNG: {e}")))?;
    Ok(file)
}
