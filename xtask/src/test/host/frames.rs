//! Independent readers for the output of `host-c`: Y4M videos and PPM pictures.

use std::fs;
use std::path::Path;

/// The pictures of a Y4M video in 4:4:4 with 8 bits: planes Y, Cb and Cr of each, one after the other.
pub(super) struct Video {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Pictures per second, e.g. `60:1`.
    pub(super) rate: String,
    pub(super) frames: Vec<Vec<u8>>,
}

/// A PPM picture: red, green and blue of each pixel, rows from top to bottom.
pub(in crate::test) struct Ppm {
    pub(in crate::test) width: usize,
    pub(in crate::test) height: usize,
    pub(in crate::test) pixels: Vec<u8>,
}

/// Red, green and blue of each pixel with more than eight bits, rows from top to bottom.
pub(super) struct Numbers {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f64>,
}

fn bytes(path: &Path) -> Result<Vec<u8>, String> {
    fs::read(path).map_err(|e| format!("{}: {e}", path.display()))
}

impl Video {
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        Self::parse(&bytes(path)?).map_err(|why| format!("{}: {why}", path.display()))
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut lines = bytes.splitn(2, |byte| *byte == b'\n');
        let header = lines.next().and_then(|line| std::str::from_utf8(line).ok()).unwrap_or_default();
        let words = header.strip_prefix("YUV4MPEG2 ").ok_or("no Y4M")?;
        let word = |mark: char| words.split(' ').find_map(|word| word.strip_prefix(mark));
        let number = |mark| word(mark).and_then(|text| text.parse::<usize>().ok());
        let (width, height) = number('W').zip(number('H')).ok_or("the header names no size")?;
        if word('C') != Some("444") {
            return Err("is not in 4:4:4".to_owned());
        }
        let rate = word('F').ok_or("the header names no rate")?.to_owned();
        let mut rest = lines.next().unwrap_or_default();
        let mut frames = Vec::new();
        while !rest.is_empty() {
            let planes = rest.strip_prefix(b"FRAME\n").ok_or("a frame has no mark")?;
            let (frame, next) = planes.split_at_checked(width * height * 3).ok_or("the last frame is cut")?;
            frames.push(frame.to_vec());
            rest = next;
        }
        Ok(Self { width, height, rate, frames })
    }
}

impl Ppm {
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        Self::parse(&bytes(path)?).map_err(|why| format!("{}: {why}", path.display()))
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut parts = bytes.splitn(4, |byte| *byte == b'\n');
        let mut line = || parts.next().and_then(|line| std::str::from_utf8(line).ok()).unwrap_or_default();
        if line() != "P6" {
            return Err("no PPM".to_owned());
        }
        let size = line().split_once(' ').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let (width, height): (usize, usize) = size.ok_or("the header names no size")?;
        if line() != "255" {
            return Err("is not of 8 bits".to_owned());
        }
        let pixels = parts.next().unwrap_or_default().to_vec();
        match pixels.len() == width * height * 3 {
            true => Ok(Self { width, height, pixels }),
            false => Err(format!("{} bytes of pixels", pixels.len())),
        }
    }

    pub(in crate::test) fn write(&self, path: &Path) -> Result<(), String> {
        let mut bytes = format!("P6\n{} {}\n255\n", self.width, self.height).into_bytes();
        bytes.extend(&self.pixels);
        fs::write(path, bytes).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Largest difference between the planes of a video's frame and this picture, by BT.601 in limited range.
    pub(super) fn distance(&self, planes: &[u8]) -> f64 {
        let count = self.width * self.height;
        let mut most = 0.0_f64;
        for (i, pixel) in self.pixels.chunks_exact(3).enumerate() {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(|value| f64::from(value) / 255.0);
            let expected = [
                16.0 + 65.481 * r + 128.553 * g + 24.966 * b,
                128.0 - 37.797 * r - 74.203 * g + 112.0 * b,
                128.0 + 112.0 * r - 93.786 * g - 18.214 * b,
            ];
            for (plane, expected) in expected.iter().enumerate() {
                most = most.max((f64::from(planes[plane * count + i]) - expected).abs());
            }
        }
        most
    }
}

impl Numbers {
    /// A PPM of ten bits, 0 to 1023, or a PFM of single floats.
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        Self::parse(&bytes(path)?).map_err(|why| format!("{}: {why}", path.display()))
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut parts = bytes.splitn(4, |byte| *byte == b'\n');
        let mut line = || parts.next().and_then(|line| std::str::from_utf8(line).ok()).unwrap_or_default();
        let (kind, size, range) = (line(), line(), line());
        let size = size.split_once(' ').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let (width, height): (usize, usize) = size.ok_or("the header names no size")?;
        let rest = parts.next().unwrap_or_default();
        let values: Vec<f64> = match (kind, range) {
            ("P6", "1023") => rest.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair).into()).collect(),
            ("PF", "-1.0") => {
                let numbers: Vec<f64> =
                    rest.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four).into()).collect();
                numbers.chunks(3 * width.max(1)).rev().flatten().copied().collect()
            }
            _ => return Err("is neither a PPM of ten bits nor a PFM".to_owned()),
        };
        match values.len() == width * height * 3 {
            true => Ok(Self { width, height, values }),
            false => Err(format!("{} numbers", values.len())),
        }
    }

    /// Largest difference from the result of `pixel` for each of the picture's pixels; infinite for another size.
    pub(super) fn distance(&self, picture: &Ppm, pixel: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
        if (self.width, self.height) != (picture.width, picture.height) {
            return f64::INFINITY;
        }
        let pairs = self.values.chunks_exact(3).zip(picture.pixels.chunks_exact(3));
        let differences = pairs.flat_map(|(found, of)| {
            let wanted = pixel([0, 1, 2].map(|c| f64::from(of[c]) / 255.0));
            [0, 1, 2].map(|c| (found[c] - wanted[c]).abs())
        });
        // NaN counts as an infinite difference.
        differences.fold(0.0, |most, v| if v <= most { most } else { if v.is_nan() { f64::INFINITY } else { v } })
    }
}

/// Linear light of an sRGB value.
fn light(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// sRGB to ten-bit HDR10 code values, with white at `white` nits: SMPTE ST 2084, ITU-R BT.2087.
pub(super) fn hdr10([r, g, b]: [f64; 3], white: f64) -> [f64; 3] {
    const WIDE: [[f64; 3]; 3] = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
    let linear = [r, g, b].map(light);
    WIDE.map(|row| {
        let nits = white * row.iter().zip(linear).map(|(a, b)| a * b).sum::<f64>();
        let p = (nits / 10_000.0).powf(2610.0 / 16384.0);
        let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 128.0, 2392.0 / 128.0);
        1023.0 * ((c1 + c2 * p) / (1.0 + c3 * p)).powf(2523.0 / 32.0)
    })
}

/// The same in scRGB: linear, 1 is 80 nits.
pub(super) fn scrgb(pixel: [f64; 3], white: f64) -> [f64; 3] {
    pixel.map(|v| light(v) * white / 80.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_beyond_eight_bits_are_read_whole_or_not() {
        let ten = Numbers::parse(b"P6\n1 1\n1023\n\x03\xff\0\x0a\0\0").unwrap();
        assert_eq!((ten.width, ten.height, ten.values), (1, 1, vec![1023.0, 10.0, 0.0]));
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
        let text = [b"PF\n1 2\n-1.0\n".to_vec(), floats(&[4.0, 5.0, 6.0, 1.0, 2.0, 3.0])].concat();
        let read = Numbers::parse(&text).unwrap();
        assert_eq!(read.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "the lowest row comes first");
        assert!(Numbers::parse(&text[..text.len() - 1]).is_err() && Numbers::parse(b"P6\n1 1\n255\nabc").is_err());
        let picture = Ppm { width: 1, height: 2, pixels: vec![0; 6] };
        assert_eq!((read.distance(&picture, |p| p), read.distance(&picture, |_| [f64::NAN; 3])), (6.0, f64::INFINITY));
    }

    #[test]
    fn white_has_the_requested_brightness() {
        // ITU-R BT.2408: 203 nits are 58 % of PQ.
        assert!(hdr10([1.0; 3], 203.0).iter().all(|v| (v / 1023.0 - 0.58).abs() < 0.002));
        assert!(
            hdr10([0.0; 3], 203.0).iter().all(|v| *v < 0.001) && (hdr10([1.0; 3], 10_000.0)[0] - 1023.0).abs() < 0.1
        );
        assert_eq!((scrgb([1.0, 0.0, 1.0], 80.0), scrgb([1.0; 3], 160.0)), ([1.0, 0.0, 1.0], [2.0; 3]));
    }

    #[test]
    fn videos_and_pictures_are_read_whole_or_not() {
        let video = b"YUV4MPEG2 W2 H1 F60:1 Ip A1:1 C444\nFRAME\nabcdefFRAME\n\n23456";
        let read = Video::parse(video).unwrap();
        assert_eq!((read.width, read.height, read.rate.as_str()), (2, 1, "60:1"));
        assert_eq!(read.frames, [b"abcdef", b"\n23456"]);
        assert!(Video::parse(&video[..video.len() - 1]).is_err());
        assert!(Video::parse(b"YUV4MPEG2 W2 H1 F60:1 C420\n").is_err());

        let picture = b"P6\n1 2\n255\n\n2345\xff";
        let read = Ppm::parse(picture).unwrap();
        assert_eq!((read.width, read.height, read.pixels.as_slice()), (1, 2, &b"\n2345\xff"[..]));
        assert!(Ppm::parse(&picture[..picture.len() - 1]).is_err());
    }

    #[test]
    fn black_white_and_red_are_where_the_standard_has_them() {
        let picture = Ppm { width: 3, height: 1, pixels: vec![0, 0, 0, 255, 255, 255, 255, 0, 0] };
        assert!(picture.distance(&[16, 235, 81, 128, 128, 90, 128, 128, 240]) < 0.6);
        assert!(picture.distance(&[16, 235, 81, 128, 128, 92, 128, 128, 240]) > 1.0);
    }
}
