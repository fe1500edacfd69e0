//! The MP4 boxes (ISO/IEC 14496-12) needed for an AV1 video without sound.

use super::VideoFormat;
use super::av1::StreamHeader;

/// Parameters of the video track.
#[derive(Clone)]
pub(super) struct Track {
    /// The rate's numerator is the number of ticks per second, its denominator that per frame.
    pub(super) format: VideoFormat,
    pub(super) header: StreamHeader,
}

/// One coded frame.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub(super) size: u32,
    pub(super) key: bool,
}

impl Track {
    /// Duration of `frames` frames in ticks.
    fn ticks(&self, frames: u64) -> u64 {
        frames.saturating_mul(self.format.rate.denominator().into())
    }
}

/// Samples that are consecutive in the file.
pub(super) struct Chunk {
    /// Offset of the first byte in the file.
    pub(super) offset: u64,
    pub(super) samples: Vec<Sample>,
}

/// `sample_flags` of a frame at which decoding can start, and of one that depends on earlier frames.
const KEY: u32 = 0x0200_0000;
const DEPENDS: u32 = 0x0101_0000;

/// Bytes of a `moof` with `samples` frames, up to the first byte of the coded data.
const fn moof_len(samples: usize) -> usize {
    // moof, mfhd, traf, tfhd, tfdt, trun, mdat header.
    8 + 16 + 8 + 20 + 20 + 20 + 8 * samples + 8
}

/// The first box of the file.
pub(super) fn ftyp() -> Vec<u8> {
    boxed(*b"ftyp", |b| {
        b.extend(b"isom");
        put32(b, 512);
        b.extend(b"isomiso6av01mp41");
    })
}

/// 16 bytes without meaning, which [`wide_mdat`] replaces later.
pub(super) fn placeholder() -> Vec<u8> {
    boxed(*b"free", |b| b.extend([0; 8]))
}

/// The header of a media data box of `len` bytes, these 16 included.
pub(super) fn wide_mdat(len: u64) -> Vec<u8> {
    let mut header = Vec::from([0, 0, 0, 1]);
    header.extend(b"mdat");
    header.extend(len.to_be_bytes());
    header
}

/// The movie header of a fragmented file.
pub(super) fn moov_for_fragments(track: &Track) -> Vec<u8> {
    boxed(*b"moov", |b| {
        b.extend(mvhd(track, 0));
        b.extend(trak(track, 0, &[]));
        b.extend(boxed(*b"mvex", |b| {
            b.extend(full(*b"trex", 0, 0, |b| {
                put32(b, 1);
                put32(b, 1);
                put32(b, track.format.rate.denominator());
                put32(b, 0);
                put32(b, DEPENDS);
            }));
        }));
    })
}

/// The movie header of a file whose frames lie in `chunks`.
pub(super) fn moov_for_chunks(track: &Track, chunks: &[Chunk]) -> Vec<u8> {
    let frames = chunks.iter().map(|c| c.samples.len() as u64).sum();
    boxed(*b"moov", |b| {
        b.extend(mvhd(track, frames));
        b.extend(trak(track, frames, chunks));
    })
}

/// One fragment: `moof` and the header of its `mdat`. The coded frames follow, each of `ticks` ticks.
pub(super) fn fragment_header(number: u32, first_frame: u64, ticks: u32, samples: &[Sample]) -> Vec<u8> {
    let data: u64 = samples.iter().map(|s| u64::from(s.size)).sum();
    let mut bytes = boxed(*b"moof", |b| {
        b.extend(full(*b"mfhd", 0, 0, |b| put32(b, number)));
        b.extend(boxed(*b"traf", |b| {
            // Offsets are relative to the moof; every frame has the same duration.
            b.extend(full(*b"tfhd", 0, 0x02_0008, |b| {
                put32(b, 1);
                put32(b, ticks);
            }));
            b.extend(full(*b"tfdt", 1, 0, |b| put64(b, first_frame.saturating_mul(ticks.into()))));
            // Data offset, and size and flags of every sample.
            b.extend(full(*b"trun", 0, 0x0601, |b| {
                put32(b, samples.len() as u32);
                put32(b, moof_len(samples.len()) as u32);
                for sample in samples {
                    put32(b, sample.size);
                    put32(b, if sample.key { KEY } else { DEPENDS });
                }
            }));
        }));
    });
    put32(&mut bytes, (data + 8) as u32);
    bytes.extend(b"mdat");
    debug_assert_eq!(bytes.len(), moof_len(samples.len()));
    bytes
}

fn mvhd(track: &Track, frames: u64) -> Vec<u8> {
    full(*b"mvhd", 1, 0, |b| {
        // No creation time, so that equal frames give equal files.
        put64(b, 0);
        put64(b, 0);
        put32(b, track.format.rate.numerator());
        put64(b, track.ticks(frames));
        put32(b, 0x0001_0000);
        put16(b, 0x0100);
        b.extend([0; 10]);
        matrix(b);
        b.extend([0; 24]);
        put32(b, 2);
    })
}

fn trak(track: &Track, frames: u64, chunks: &[Chunk]) -> Vec<u8> {
    boxed(*b"trak", |b| {
        b.extend(full(*b"tkhd", 1, 3, |b| {
            put64(b, 0);
            put64(b, 0);
            put32(b, 1);
            put32(b, 0);
            put64(b, track.ticks(frames));
            b.extend([0; 16]);
            matrix(b);
            put32(b, shown_width(&track.format) << 16);
            put32(b, track.format.size.1 << 16);
        }));
        b.extend(boxed(*b"mdia", |b| {
            b.extend(full(*b"mdhd", 1, 0, |b| {
                put64(b, 0);
                put64(b, 0);
                put32(b, track.format.rate.numerator());
                put64(b, track.ticks(frames));
                put16(b, 0x55c4); // "und"
                put16(b, 0);
            }));
            b.extend(full(*b"hdlr", 0, 0, |b| {
                put32(b, 0);
                b.extend(b"vide");
                b.extend([0; 12]);
                b.extend(b"Cairn\0");
            }));
            b.extend(boxed(*b"minf", |b| {
                b.extend(full(*b"vmhd", 0, 1, |b| b.extend([0; 8])));
                b.extend(boxed(*b"dinf", |b| {
                    b.extend(full(*b"dref", 0, 0, |b| {
                        put32(b, 1);
                        b.extend(full(*b"url ", 0, 1, |_| {}));
                    }));
                }));
                b.extend(stbl(track, chunks));
            }));
        }));
    })
}

/// The sample table. Fragmented tracks have the same table without entries.
fn stbl(track: &Track, chunks: &[Chunk]) -> Vec<u8> {
    let samples = || chunks.iter().flat_map(|c| &c.samples);
    let count = samples().count() as u32;
    boxed(*b"stbl", |b| {
        b.extend(full(*b"stsd", 0, 0, |b| {
            put32(b, 1);
            b.extend(av01(track));
        }));
        b.extend(full(*b"stts", 0, 0, |b| {
            put32(b, u32::from(count > 0));
            if count > 0 {
                put32(b, count);
                put32(b, track.format.rate.denominator());
            }
        }));
        if count > 0 {
            let keys: Vec<u32> = samples().zip(1..).filter(|(s, _)| s.key).map(|(_, n)| n).collect();
            b.extend(full(*b"stss", 0, 0, |b| {
                put32(b, keys.len() as u32);
                keys.iter().for_each(|&n| put32(b, n));
            }));
        }
        // Runs of chunks with the same number of samples.
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for (chunk, number) in chunks.iter().zip(1..) {
            let len = chunk.samples.len() as u32;
            if runs.last().is_none_or(|run| run.1 != len) {
                runs.push((number, len));
            }
        }
        b.extend(full(*b"stsc", 0, 0, |b| {
            put32(b, runs.len() as u32);
            for (first, len) in runs {
                put32(b, first);
                put32(b, len);
                put32(b, 1);
            }
        }));
        b.extend(full(*b"stsz", 0, 0, |b| {
            put32(b, 0);
            put32(b, count);
            samples().for_each(|s| put32(b, s.size));
        }));
        b.extend(full(*b"co64", 0, 0, |b| {
            put32(b, chunks.len() as u32);
            chunks.iter().for_each(|c| put64(b, c.offset));
        }));
    })
}

/// The sample entry: AV1 Codec ISO Media File Format Binding, section 2.
fn av01(track: &Track) -> Vec<u8> {
    boxed(*b"av01", |b| {
        b.extend([0; 6]);
        put16(b, 1);
        b.extend([0; 16]);
        put16(b, track.format.size.0 as u16);
        put16(b, track.format.size.1 as u16);
        put32(b, 0x0048_0000); // 72 dpi, both ways
        put32(b, 0x0048_0000);
        put32(b, 0);
        put16(b, 1);
        b.extend([0; 32]);
        put16(b, 24);
        put16(b, 0xffff);
        b.extend(boxed(*b"av1C", |b| {
            // Version 1; main profile and the level; main tier, 8 bits, 4:2:0 with left-sited chroma.
            b.extend([0x81, track.header.level, 0x0d, 0]);
            b.extend(&track.header.sequence);
        }));
        b.extend(boxed(*b"colr", |b| {
            b.extend(b"nclx");
            put16(b, 1); // primaries: BT.709
            put16(b, 13); // transfer: sRGB
            put16(b, 1); // matrix: BT.709
            b.push(0); // limited range
        }));
        b.extend(boxed(*b"pasp", |b| {
            put32(b, track.format.pixel_aspect.0);
            put32(b, track.format.pixel_aspect.1);
        }));
    })
}

/// The display width in units of the pixel height: `tkhd` has no field for the pixel aspect.
fn shown_width(format: &VideoFormat) -> u32 {
    let (across, down) = format.pixel_aspect;
    let width = u64::from(format.size.0) * u64::from(across) / u64::from(down.max(1));
    width.clamp(1, u16::MAX.into()) as u32
}

fn matrix(b: &mut Vec<u8>) {
    for value in [0x0001_0000, 0, 0, 0, 0x0001_0000, 0, 0, 0, 0x4000_0000] {
        put32(b, value);
    }
}

fn boxed(kind: [u8; 4], fill: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = vec![0; 4];
    bytes.extend(kind);
    fill(&mut bytes);
    let len = bytes.len() as u32;
    bytes[..4].copy_from_slice(&len.to_be_bytes());
    bytes
}

fn full(kind: [u8; 4], version: u8, flags: u32, fill: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    boxed(kind, |b| {
        put32(b, u32::from(version) << 24 | flags);
        fill(b);
    })
}

fn put16(b: &mut Vec<u8>, value: u16) {
    b.extend(value.to_be_bytes());
}

fn put32(b: &mut Vec<u8>, value: u32) {
    b.extend(value.to_be_bytes());
}

fn put64(b: &mut Vec<u8>, value: u64) {
    b.extend(value.to_be_bytes());
}
