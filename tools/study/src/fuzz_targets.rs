//! The functions that the fuzz targets of this crate call, and the targets' seed inputs. The tests below call them with truncated and changed
//! seeds; `fuzz/` calls them with whatever libFuzzer finds.

use std::io::Cursor;

use cairn::Picture;

use crate::metrics::check_weights;
use crate::picture;
use media::{Y4mReader, y4m_header};

/// Pixels of the largest picture that is decoded: more only takes longer.
const MAX_PIXELS: u64 = 1 << 20;
/// Frames that are read of a video.
const MAX_FRAMES: usize = 4;

fn is_small((width, height): (u32, u32)) -> bool {
    u64::from(width) * u64::from(height) <= MAX_PIXELS
}

/// A Y4M video is refused, or its frames are pictures of the header's size; the count of frames that its length suggests is never less
/// than the number of those that can be read, unless frames have parameters.
pub fn y4m(bytes: &[u8]) {
    let line = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    if y4m_header(line).is_ok_and(|header| !is_small(header.layout.size)) {
        return;
    }
    let Ok(mut reader) = Y4mReader::open(Box::new(Cursor::new(bytes.to_vec())), "fuzz.y4m") else { return };
    let header = *reader.header();
    assert!(header.layout.frame_bytes() > 0 && header.pixel_aspect.0 > 0 && header.pixel_aspect.1 > 0);
    let (width, height) = header.layout.size;
    let mut out = Picture::new(width, height).expect("a size that was accepted");
    let mut frames = 0;
    while frames < MAX_FRAMES && reader.read(&mut out).is_ok_and(|more| more) {
        assert!(out.pixels().iter().all(|pixel| pixel[3] == 255), "a video is opaque");
        frames += 1;
    }
    assert!(frames == MAX_FRAMES || frames as u64 <= reader.frames_in(bytes.len() as u64));
}

/// A seed picture is refused, or decoded at the size that its header states, opaque, and scaled to any other.
pub fn seed_picture(bytes: &[u8]) {
    let size = picture::size(Cursor::new(bytes));
    if size.as_ref().is_ok_and(|size| !is_small(*size)) {
        return;
    }
    let Ok(decoded) = picture::decode(bytes) else { return };
    assert_eq!(Some(decoded.size()), size.ok(), "the header's size is the picture's");
    assert!(decoded.pixels().iter().all(|pixel| pixel[3] == 255));
    assert_eq!(picture::cover(&decoded, (64, 36)).expect("a scaled picture").size(), (64, 36));
}

/// A file of LPIPS weights is refused, or its arrays have as many bytes as their shapes need.
pub fn lpips_weights(bytes: &[u8]) {
    _ = check_weights(bytes);
}

/// Seed inputs of each target.
pub mod seeds {
    use cairn::Picture;

    use crate::metrics::small_weights;
    use crate::picture;
    use media::{JpegQuality, encode_jpeg, encode_png, y4m_header};

    fn drawn() -> Picture {
        let mut drawn = Picture::new(16, 16).expect("a picture");
        for (i, pixel) in (0_u32..).zip(drawn.pixels_mut()) {
            *pixel = [(i * 7) as u8, (i * 3) as u8, (i * 13) as u8, 255];
        }
        drawn
    }

    /// A video with the header that the study writes, and one of each other layout; two frames each.
    pub fn y4m() -> Vec<Vec<u8>> {
        let study = "Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED XCOLORMATRIX=BT709";
        let others = ["C420jpeg", "C420paldv XCOLORRANGE=FULL", "C422", "C444 XCOLORMATRIX=BT601", "Cmono A4:3"];
        let video = |parameters: &str| {
            let header = format!("YUV4MPEG2 W6 H4 F30:1 {parameters}");
            let frame = y4m_header(header.as_bytes()).expect("a header").layout.frame_bytes();
            let mut bytes = header.into_bytes();
            bytes.push(b'\n');
            for value in [90, 160] {
                bytes.extend(b"FRAME\n");
                bytes.extend(std::iter::repeat_n(value, frame));
            }
            bytes
        };
        std::iter::once(study).chain(others).map(video).collect()
    }

    /// A PNG and a JPEG.
    pub fn seed_picture() -> Vec<Vec<u8>> {
        let drawn = drawn();
        let small = picture::shrink(&drawn, (5, 3)).expect("a picture");
        let png = |picture: &Picture| encode_png(picture).expect("a PNG");
        vec![png(&drawn), png(&small), encode_jpeg(&drawn, JpegQuality::Repository).expect("a JPEG")]
    }

    /// A pickle with nested dictionaries of arrays.
    pub fn lpips_weights() -> Vec<Vec<u8>> {
        vec![small_weights()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncated_and_changed_seeds_are_refused_or_read() {
        for (target, seeds) in [
            (y4m as fn(&[u8]), seeds::y4m()),
            (seed_picture, seeds::seed_picture()),
            (lpips_weights, seeds::lpips_weights()),
        ] {
            for seed in seeds {
                target(&seed);
                // Headers are read byte by byte; of the data behind them a sample is enough.
                let sampled = (0..seed.len()).filter(|at| *at < 256 || at % 7 == 0);
                for at in sampled {
                    target(&seed[..at]);
                    for mask in [1 << (at % 8), 0x80, 0xff] {
                        let mut changed = seed.clone();
                        changed[at] ^= mask;
                        target(&changed);
                    }
                }
            }
        }
    }

    #[test]
    fn the_seeds_are_accepted() {
        for seed in seeds::y4m() {
            let mut reader = Y4mReader::open(Box::new(Cursor::new(seed)), "seed.y4m").unwrap();
            let (width, height) = reader.header().layout.size;
            assert!(reader.read(&mut Picture::new(width, height).unwrap()).unwrap());
        }
        for seed in seeds::seed_picture() {
            picture::decode(&seed).unwrap();
        }
        for seed in seeds::lpips_weights() {
            assert_eq!(check_weights(&seed), Some(1));
        }
    }
}
