//! The MP4 boxes (ISO/IEC 14496-12) of an AV1 video without sound.

use cairn::{Error, ErrorKind, Result};
use mp4_atom::{
    Atom, Av01, Av1c, Co64, Colr, Dinf, Dref, DrefEntry, Encode, FourCC, Free, Ftyp, Hdlr, Mdhd, Mdia, Mfhd, Minf,
    Moof, Moov, Mvex, Mvhd, Pasp, Stbl, Stsc, StscEntry, Stsd, Stss, Stsz, StszSamples, Stts, SttsEntry, Tfdt, Tfhd,
    Tkhd, Traf, Trak, Trex, Trun, TrunEntry, TrunSamples, Url, Visual, Vmhd, Zeroed,
};

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

/// Samples that are consecutive in the file.
pub(super) struct Chunk {
    /// Offset of the first byte in the file.
    pub(super) offset: u64,
    pub(super) samples: Vec<Sample>,
}

/// The only track's number.
const TRACK: u32 = 1;
/// `sample_flags` of a frame at which decoding can start, and of one that depends on earlier frames.
const KEY: u32 = 0x0200_0000;
const DEPENDS: u32 = 0x0101_0000;
/// Bytes of the header of a box.
const BOX_HEADER: u32 = 8;

/// The first box of the file.
pub(super) fn ftyp() -> Result<Vec<u8>> {
    let compatible_brands = [b"isom", b"iso6", b"av01", b"mp41"].map(FourCC::new).into();
    encoded(&Ftyp { major_brand: FourCC::new(b"isom"), minor_version: 512, compatible_brands })
}

/// 16 bytes without meaning, which [`wide_mdat`] replaces later.
pub(super) fn placeholder() -> Result<Vec<u8>> {
    encoded(&Free { zeroed: Zeroed { size: 8 } })
}

/// The header of a media data box of `len` bytes, these 16 included.
pub(super) fn wide_mdat(len: u64) -> Vec<u8> {
    // A size of 1 says that 64 bits with the size follow the kind.
    [&1_u32.to_be_bytes()[..], b"mdat", &len.to_be_bytes()].concat()
}

/// The movie header of a fragmented file.
pub(super) fn moov_for_fragments(track: &Track) -> Result<Vec<u8>> {
    let trex = Trex {
        track_id: TRACK,
        default_sample_description_index: 1,
        default_sample_duration: track.format.rate.denominator(),
        default_sample_size: 0,
        default_sample_flags: DEPENDS,
    };
    encoded(&Moov { mvex: Some(Mvex { mehd: None, trex: vec![trex] }), ..moov(track, &[]) })
}

/// The movie header of a file whose frames lie in `chunks`.
pub(super) fn moov_for_chunks(track: &Track, chunks: &[Chunk]) -> Result<Vec<u8>> {
    encoded(&moov(track, chunks))
}

/// One fragment: `moof` and the header of its `mdat`. The coded frames follow, each of `ticks` ticks.
pub(super) fn fragment_header(number: u32, first_frame: u64, ticks: u32, samples: &[Sample]) -> Result<Vec<u8>> {
    let entry = |sample: &Sample| TrunEntry {
        size: Some(sample.size),
        flags: Some(if sample.key { KEY } else { DEPENDS }),
        ..TrunEntry::default()
    };
    let entries: Vec<TrunEntry> = samples.iter().map(entry).collect();
    let moof = |data_offset: i32| {
        let trun = Trun { data_offset: Some(data_offset), samples: TrunSamples::Explicit(entries.clone()) };
        // Offsets are relative to the moof; every frame has the same duration.
        let tfhd = Tfhd {
            track_id: TRACK,
            default_sample_duration: Some(ticks),
            default_base_is_moof: true,
            ..Tfhd::default()
        };
        let tfdt = Some(Tfdt { base_media_decode_time: first_frame.saturating_mul(ticks.into()) });
        let traf = Traf { tfhd, tfdt, trun: vec![trun], ..Traf::default() };
        encoded(&Moof { mfhd: Mfhd { sequence_number: number }, traf: vec![traf] })
    };
    // The length does not depend on the offset.
    let data_offset = moof(0)?.len() as i32 + BOX_HEADER as i32;
    let mut bytes = moof(data_offset)?;
    let data: u32 = samples.iter().map(|sample| sample.size).sum();
    bytes.extend((data + BOX_HEADER).to_be_bytes());
    bytes.extend(b"mdat");
    Ok(bytes)
}

/// No creation time anywhere, so that equal frames give equal files.
fn moov(track: &Track, chunks: &[Chunk]) -> Moov {
    let frames = chunks.iter().map(|chunk| chunk.samples.len() as u64).sum::<u64>();
    let (timescale, tick) = (track.format.rate.numerator(), track.format.rate.denominator());
    let duration = frames.saturating_mul(tick.into());
    let mvhd =
        Mvhd { timescale, duration, rate: 1.into(), volume: 1.into(), next_track_id: TRACK + 1, ..Mvhd::default() };
    let tkhd = Tkhd {
        track_id: TRACK,
        duration,
        enabled: true,
        in_movie: true,
        width: shown_width(&track.format).into(),
        height: (track.format.size.1 as u16).into(),
        ..Tkhd::default()
    };
    let mdhd = Mdhd { timescale, duration, language: "und".into(), ..Mdhd::default() };
    let hdlr = Hdlr { handler: FourCC::new(b"vide"), name: "Cairn".into() };
    let dinf = Dinf { dref: Dref { entries: vec![DrefEntry::Url(Url { location: String::new() })] } };
    let minf = Minf { vmhd: Some(Vmhd::default()), dinf, stbl: stbl(track, chunks), ..Minf::default() };
    Moov {
        mvhd,
        meta: None,
        mvex: None,
        trak: vec![Trak { tkhd, mdia: Mdia { mdhd, hdlr, minf }, ..Trak::default() }],
        udta: None,
        ainf: None,
    }
}

/// The sample table. Fragmented tracks have the same table without entries.
fn stbl(track: &Track, chunks: &[Chunk]) -> Stbl {
    let samples = || chunks.iter().flat_map(|chunk| &chunk.samples);
    let sizes: Vec<u32> = samples().map(|sample| sample.size).collect();
    let time = SttsEntry { sample_count: sizes.len() as u32, sample_delta: track.format.rate.denominator() };
    let keys = samples().zip(1..).filter(|(sample, _)| sample.key).map(|(_, number)| number).collect();
    // Runs of chunks with the same number of samples.
    let mut runs: Vec<StscEntry> = Vec::new();
    for (chunk, first_chunk) in chunks.iter().zip(1..) {
        let samples_per_chunk = chunk.samples.len() as u32;
        if runs.last().is_none_or(|run| run.samples_per_chunk != samples_per_chunk) {
            runs.push(StscEntry { first_chunk, samples_per_chunk, sample_description_index: 1 });
        }
    }
    Stbl {
        stsd: Stsd { codecs: vec![av01(track).into()] },
        stts: Stts { entries: if sizes.is_empty() { Vec::new() } else { vec![time] } },
        stss: (!sizes.is_empty()).then_some(Stss { entries: keys }),
        stsc: Stsc { entries: runs },
        stsz: Stsz { samples: StszSamples::Different { sizes } },
        co64: Some(Co64 { entries: chunks.iter().map(|chunk| chunk.offset).collect() }),
        ..Stbl::default()
    }
}

/// The sample entry: AV1 Codec ISO Media File Format Binding, section 2.
fn av01(track: &Track) -> Av01 {
    let Track { format, header } = track;
    Av01 {
        visual: Visual {
            data_reference_index: 1,
            width: format.size.0 as u16,
            height: format.size.1 as u16,
            ..Visual::default()
        },
        // Main profile, main tier, 8 bits, 4:2:0 with left-sited chroma.
        av1c: Av1c {
            seq_level_idx_0: header.level,
            chroma_subsampling_x: true,
            chroma_subsampling_y: true,
            chroma_sample_position: 1,
            config_obus: header.sequence.clone(),
            ..Av1c::default()
        },
        // BT.709 primaries and matrix, sRGB transfer, limited range.
        colr: Some(Colr::Nclx {
            colour_primaries: 1,
            transfer_characteristics: 13,
            matrix_coefficients: 1,
            full_range_flag: false,
        }),
        pasp: Some(Pasp { h_spacing: format.pixel_aspect.0, v_spacing: format.pixel_aspect.1 }),
        ..Av01::default()
    }
}

/// The display width in units of the pixel height: `tkhd` has no field for the pixel aspect.
fn shown_width(format: &VideoFormat) -> u16 {
    let (across, down) = format.pixel_aspect;
    let width = u64::from(format.size.0) * u64::from(across) / u64::from(down.max(1));
    width.clamp(1, u16::MAX.into()) as u16
}

fn encoded(atom: &impl Atom) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    atom.encode(&mut bytes).map_err(|e| Error::new(ErrorKind::Unsupported, format!("MP4: {e}")).field("mp4"))?;
    Ok(bytes)
}
