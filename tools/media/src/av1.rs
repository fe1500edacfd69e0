//! AV1 by rav1e. Equal frames always give equal bytes.

use cairn::{Error, ErrorKind, Result};
use rav1e::prelude::{
    ChromaSamplePosition, ChromaSampling, ColorDescription, ColorPrimaries, Config, Context, EncoderConfig,
    EncoderStatus, FrameType, MatrixCoefficients, PixelRange, Rational, SceneDetectionSpeed, SpeedSettings,
    TransferCharacteristics,
};

use super::{VideoFormat, Yuv420};

/// Name of the encoder for the manifest.
pub const ENCODER: &str = "rav1e 0.8.1";
/// Whether the assembly kernels are compiled in. They affect the speed, not the bytes.
pub const ASSEMBLY: bool = cfg!(feature = "asm");

/// The smallest width or height that rav1e accepts.
const MIN_SIDE: u32 = 16;

/// One coded picture.
pub(super) struct Packet {
    /// The OBUs without temporal delimiter, as an MP4 sample holds them.
    pub(super) data: Vec<u8>,
    /// Whether decoding can start here.
    pub(super) key: bool,
}

/// Stream parameters for a container, known from the first key frame on.
#[derive(Clone)]
pub(super) struct StreamHeader {
    pub(super) level: u8,
    /// The sequence header OBU with its size field.
    pub(super) sequence: Vec<u8>,
}

/// An encoder of one stream.
pub(super) struct Av1Encoder {
    context: Context<u8>,
    level: u8,
    header: Option<StreamHeader>,
}

impl Av1Encoder {
    /// Encodes on `threads` threads (0: one to a core).
    pub(super) fn new(format: &VideoFormat, threads: usize) -> Result<Self> {
        let ((width, height), rate) = (format.size, format.rate);
        if width < MIN_SIDE || height < MIN_SIDE || width > 65_535 || height > 65_535 {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("AV1 video of {width} x {height} cannot be made"),
            )
            .field("size")
            .remedy(format!("Use at least {MIN_SIDE} x {MIN_SIDE}, or PNG pictures")));
        }
        let mut speed = SpeedSettings::from_preset(10);
        // No look-ahead, and key frames at fixed intervals: each frame is output when it is pushed, and no scene-cut search is needed.
        speed.rdo_lookahead_frames = 1;
        speed.scene_detection_mode = SceneDetectionSpeed::None;
        speed.fast_deblock = true;
        let level = level((width, height), rate.ceil());
        let settings = EncoderConfig {
            width: width as usize,
            height: height as usize,
            time_base: Rational::new(rate.denominator().into(), rate.numerator().into()),
            bit_depth: 8,
            chroma_sampling: ChromaSampling::Cs420,
            chroma_sample_position: ChromaSamplePosition::Vertical,
            pixel_range: PixelRange::Limited,
            color_description: Some(ColorDescription {
                color_primaries: ColorPrimaries::BT709,
                transfer_characteristics: TransferCharacteristics::SRGB,
                matrix_coefficients: MatrixCoefficients::BT709,
            }),
            level_idx: Some(level),
            low_latency: true,
            min_key_frame_interval: rate.ceil().into(),
            max_key_frame_interval: rate.ceil().into(),
            quantizer: format.quantiser.into(),
            // The number depends on the size, not on the thread count, so that the bytes do not depend on the machine.
            tiles: if u64::from(width) * u64::from(height) >= 640 * 360 { 4 } else { 1 },
            speed_settings: speed,
            ..EncoderConfig::default()
        };
        let context =
            Config::new().with_encoder_config(settings).with_threads(threads).new_context().map_err(|e| {
                Error::new(ErrorKind::InvalidArgument, format!("AV1 cannot store this: {e}")).field("size")
            })?;
        Ok(Self { context, level, header: None })
    }

    /// Encodes one picture and returns the packets that are ready.
    pub(super) fn push(&mut self, planes: &Yuv420) -> Result<Vec<Packet>> {
        let mut frame = self.context.new_frame();
        for (i, plane) in frame.planes.iter_mut().enumerate() {
            plane.copy_from_raw_u8(planes.plane(i), planes.plane_size(i).0, 1);
        }
        self.context.send_frame(frame).map_err(|status| encoder_failed(&status))?;
        self.drain()
    }

    /// Returns the remaining packets at the end.
    pub(super) fn flush(&mut self) -> Result<Vec<Packet>> {
        self.context.flush();
        self.drain()
    }

    /// Available after the first packet.
    pub(super) fn header(&self) -> Option<&StreamHeader> {
        self.header.as_ref()
    }

    fn drain(&mut self) -> Result<Vec<Packet>> {
        let mut packets = Vec::new();
        loop {
            match self.context.receive_packet() {
                Ok(packet) => {
                    let obus = split_obus(&packet.data)
                        .ok_or_else(|| Error::new(ErrorKind::Device, "the AV1 encoder made a broken packet"))?;
                    let mut data = Vec::with_capacity(packet.data.len());
                    for (kind, bytes) in obus {
                        if kind == OBU_SEQUENCE_HEADER && self.header.is_none() {
                            self.header = Some(StreamHeader { level: self.level, sequence: bytes.to_vec() });
                        }
                        if kind != OBU_TEMPORAL_DELIMITER {
                            data.extend_from_slice(bytes);
                        }
                    }
                    packets.push(Packet { data, key: packet.frame_type == FrameType::KEY });
                }
                Err(EncoderStatus::Encoded) => {}
                Err(EncoderStatus::NeedMoreData | EncoderStatus::LimitReached) => return Ok(packets),
                Err(status) => return Err(encoder_failed(&status)),
            }
        }
    }
}

fn encoder_failed(status: &EncoderStatus) -> Error {
    Error::new(ErrorKind::Device, format!("the AV1 encoder stopped: {status}")).field("mp4")
}

const OBU_SEQUENCE_HEADER: u8 = 1;
const OBU_TEMPORAL_DELIMITER: u8 = 2;

/// The OBUs of a packet with their types; `None` if the packet is malformed.
fn split_obus(mut data: &[u8]) -> Option<Vec<(u8, &[u8])>> {
    let mut units = Vec::new();
    while let Some(&first) = data.first() {
        let kind = first >> 3 & 15;
        let mut header = if first & 4 == 0 { 1 } else { 2 };
        let mut length = data.len().checked_sub(header)?;
        if first & 2 != 0 {
            length = 0;
            for shift in 0..8 {
                let &byte = data.get(header)?;
                header += 1;
                length |= usize::from(byte & 127) << (7 * shift);
                if byte & 128 == 0 {
                    break;
                }
            }
        }
        let (unit, rest) = data.split_at_checked(header.checked_add(length)?)?;
        units.push((kind, unit));
        data = rest;
    }
    Some(units)
}

/// The smallest level (its index in the sequence header) that holds the picture size and rate; 31 when none does.
/// AV1 specification, annex A.3.
fn level((width, height): (u32, u32), rate: u32) -> u8 {
    const LEVELS: [(u8, u64, u32, u32, u64); 12] = [
        (0, 147_456, 2048, 1152, 4_423_680),
        (1, 278_784, 2816, 1584, 8_363_520),
        (4, 665_856, 4352, 2448, 19_975_680),
        (5, 1_065_024, 5504, 3096, 31_950_720),
        (8, 2_359_296, 6144, 3456, 70_778_880),
        (9, 2_359_296, 6144, 3456, 141_557_760),
        (12, 8_912_896, 8192, 4352, 267_386_880),
        (13, 8_912_896, 8192, 4352, 534_773_760),
        (14, 8_912_896, 8192, 4352, 1_069_547_520),
        (16, 35_651_584, 16_384, 8704, 1_069_547_520),
        (17, 35_651_584, 16_384, 8704, 2_139_095_040),
        (18, 35_651_584, 16_384, 8704, 4_278_190_080),
    ];
    let area = u64::from(width) * u64::from(height);
    let fits =
        |l: &&(u8, u64, u32, u32, u64)| area <= l.1 && width <= l.2 && height <= l.3 && area * u64::from(rate) <= l.4;
    LEVELS.iter().find(fits).map_or(31, |l| l.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameRate;
    use cairn::Picture;

    /// A manifest names the version that is compiled in.
    #[test]
    fn the_encoders_name_has_the_version_of_the_lock_file() {
        let lock = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../Cargo.lock")).unwrap();
        let mut lines = lock.lines().skip_while(|line| *line != "name = \"rav1e\"").skip(1);
        let version = lines.next().and_then(|line| line.strip_prefix("version = \"")?.strip_suffix('"'));
        assert_eq!(ENCODER.strip_prefix("rav1e "), version);
        assert!(version.is_some());
    }

    #[test]
    fn levels_follow_the_specification() {
        assert_eq!(level((1920, 1080), 30), 8);
        assert_eq!(level((1920, 1080), 60), 9);
        assert_eq!(level((320, 180), 30), 0);
        assert_eq!(level((65_535, 65_535), 30), 31);
    }

    #[test]
    fn obus_are_split_and_broken_ones_refused() {
        // A temporal delimiter of no bytes, then a sequence header of two.
        let data = [0x12, 0, 0x0a, 2, 7, 9];
        assert_eq!(split_obus(&data).unwrap(), vec![(2, &data[..2]), (1, &data[2..])]);
        assert!(split_obus(&data[..5]).is_none());
        assert!(split_obus(&[0x0a]).is_none());
    }

    fn format(width: u32, height: u32, rate: u64) -> VideoFormat {
        VideoFormat::new((width, height), FrameRate::new(rate, 1).unwrap())
    }

    fn encode(threads: usize) -> Vec<u8> {
        let mut encoder = Av1Encoder::new(&format(640, 360, 2), threads).unwrap();
        let mut planes = Yuv420::new(640, 360).unwrap();
        let mut picture = Picture::new(640, 360).unwrap();
        let mut bytes = Vec::new();
        let mut keys = Vec::new();
        for n in 0..3u32 {
            for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
                let (x, y) = (i as u32 % 640 + 3 * n, i as u32 / 640);
                px[..3].copy_from_slice(&[(x ^ y) as u8, (x / 2) as u8, (y + n) as u8]);
            }
            planes.convert(&picture).unwrap();
            let mut packets = encoder.push(&planes).unwrap();
            if n == 2 {
                packets.extend(encoder.flush().unwrap());
            }
            for packet in packets {
                assert!(split_obus(&packet.data).unwrap().iter().all(|o| o.0 != OBU_TEMPORAL_DELIMITER));
                keys.push(packet.key);
                bytes.extend(packet.data);
            }
        }
        assert_eq!(keys, [true, false, true]);
        assert_eq!(encoder.header().unwrap().level, 1);
        bytes
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_number_of_threads() {
        assert!(encode(1) == encode(3));
    }

    #[test]
    fn sizes_below_the_encoders_minimum_are_refused_with_a_remedy() {
        let error = Av1Encoder::new(&format(8, 8, 30), 1).err().unwrap();
        assert!(error.to_string().contains("16 x 16"), "{error}");
    }
}
