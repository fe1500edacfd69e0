//! MP4 that a browser plays, and that is playable up to the last fragment however the program ends.
//!
//! While frames come in, the file is a fragmented MP4: every half second a self-contained fragment is appended. At the end an ordinary index is
//! appended, and the 16 placeholder bytes before the first fragment become the header of a media data box that contains the fragments with
//! their headers. The result is an ordinary MP4, in which every player can seek. If the index does not fit on the disk, the fragmented
//! file remains.

use std::path::Path;

use cairn::{Error, ErrorKind, Result};

use super::av1::{Av1Encoder, Packet};
use super::mp4_boxes::{Chunk, Sample, Track, fragment_header, ftyp, moov_for_chunks, moov_for_fragments};
use super::mp4_boxes::{placeholder, wide_mdat};
use super::recorder::{Frame, Sink, WrittenFile};
use super::{FileSystem, GrowingFile, VideoFormat};

/// Encodes and writes one MP4 file.
pub struct Mp4Sink {
    encoder: Av1Encoder,
    format: VideoFormat,
    file: GrowingFile,
    /// Known from the first packet on, when the file's header is written.
    track: Option<Track>,
    /// Offset of the placeholder.
    mdat_at: u64,
    /// Frames that are not written yet.
    pending: Vec<Sample>,
    data: Vec<u8>,
    chunks: Vec<Chunk>,
    frames: u64,
}

impl Mp4Sink {
    /// Starts `path`, encoded on `threads` threads (0: one to a core).
    ///
    /// # Errors
    /// `InvalidArgument` for a size that AV1 cannot store, `Io` when the file cannot be made.
    pub fn create(disk: &dyn FileSystem, path: &Path, format: &VideoFormat, threads: usize) -> Result<Self> {
        let encoder = Av1Encoder::new(format, threads)?;
        let file = GrowingFile::create(disk, path)?;
        Ok(Self {
            encoder,
            format: *format,
            file,
            track: None,
            mdat_at: 0,
            pending: Vec::new(),
            data: Vec::new(),
            chunks: Vec::new(),
            frames: 0,
        })
    }

    fn take(&mut self, packets: Vec<Packet>) -> Result<()> {
        for packet in packets {
            let size = u32::try_from(packet.data.len())
                .ok()
                .filter(|&size| size < 1 << 28)
                .ok_or_else(|| Error::new(ErrorKind::Unsupported, "a coded frame is too large for MP4").field("mp4"))?;
            self.pending.push(Sample { size, key: packet.key });
            self.data.extend(packet.data);
            if self.pending.len() as u32 >= (self.format.rate.ceil() / 2).max(1) || self.data.len() > 1 << 28 {
                self.write_fragment()?;
            }
        }
        Ok(())
    }

    fn write_fragment(&mut self) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        if self.track.is_none() {
            self.write_header()?;
        }
        let number = self.chunks.len() as u32 + 1;
        let mut unit = fragment_header(number, self.frames, self.format.rate.denominator(), &self.pending)?;
        let offset = self.file.end() + unit.len() as u64;
        unit.append(&mut self.data);
        let samples = std::mem::take(&mut self.pending);
        self.file.append(&unit)?;
        self.frames += samples.len() as u64;
        self.chunks.push(Chunk { offset, samples });
        Ok(())
    }

    fn write_header(&mut self) -> Result<()> {
        let header = self.encoder.header().cloned().ok_or_else(|| {
            Error::new(ErrorKind::Device, "the AV1 encoder made a frame without a sequence header").field("mp4")
        })?;
        let track = Track { format: self.format, header };
        let mut unit = ftyp()?;
        let mdat_at = unit.len() as u64;
        unit.extend(placeholder()?);
        unit.extend(moov_for_fragments(&track)?);
        self.file.append(&unit)?;
        self.mdat_at = mdat_at;
        self.track = Some(track);
        Ok(())
    }

    /// Appends the index and hides the fragments' headers.
    fn write_index(&mut self, track: &Track) -> Result<()> {
        let end = self.file.end();
        let indexed = moov_for_chunks(track, &self.chunks)
            .and_then(|index| self.file.append(&index))
            .and_then(|()| self.file.replace(self.mdat_at, &wide_mdat(end - self.mdat_at)));
        if indexed.is_err() {
            // Restores a valid fragmented file.
            self.file.replace(self.mdat_at, &placeholder()?)?;
            self.file.truncate(end)?;
        }
        indexed
    }
}

impl Sink for Mp4Sink {
    fn kind(&self) -> &'static str {
        "mp4"
    }

    fn wants_planes(&self) -> bool {
        true
    }

    fn write(&mut self, frame: &Frame<'_>) -> Result<()> {
        let packets = self.encoder.push(frame.planes)?;
        self.take(packets)
    }

    fn finish(mut self: Box<Self>, failed: bool) -> (Vec<WrittenFile>, Option<Error>) {
        let mut trouble = None;
        if !failed {
            let rest = self.encoder.flush().and_then(|packets| self.take(packets)).and_then(|()| self.write_fragment());
            trouble = rest.err();
        }
        let (Some(track), 1..) = (self.track.take(), self.frames) else {
            self.file.discard();
            return (Vec::new(), trouble);
        };
        trouble = trouble.or(self.write_index(&track).err());
        let frames = self.frames;
        match self.file.close() {
            Ok(path) => (vec![WrittenFile { path, kind: "mp4", frames }], trouble),
            Err(error) => (Vec::new(), trouble.or(Some(error))),
        }
    }
}
