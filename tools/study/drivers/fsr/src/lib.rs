//! Messages between the driver of AMD's FSR and the process that wants its frames.
//!
//! The driver runs on Direct3D 12, so on Windows or in the lab; the other process may run on Linux. They speak over the driver's standard
//! input and output, all numbers little-endian:
//!
//! ```text
//! driver: greeting               text: the provider's version, such as 3.1.5
//! other:  request                header of 8 words; previous and current picture, RGBA8; motion, 2 x f16; depth, f32; row by row
//! driver: frame                  RGBA8, the frame half way between the two pictures
//! ```
//!
//! Greeting and frame follow a word that is 0; after any other word the rest is the text of an error. A text is its length in bytes, a word,
//! and UTF-8. The driver answers each request before it reads the next one, and ends with its input.

use std::io::{self, Read, Write};

use cairn::framegen::AnchorPair;
use cairn::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::{Error, ErrorKind, MAX_SIDE, Picture, Result};
use half::f16;

/// Time between the anchors of every request, in milliseconds of the world's time.
pub const INTERVAL_MS: f32 = 1000.0 / 15.0;

/// First word of each request: the messages' version.
const REQUEST: u32 = 0x4653_5201;
/// First word of a greeting or a frame.
const DONE: u32 = 0;
/// First word of an error.
const FAILED: u32 = 1;
/// Longest text in bytes.
const MAX_TEXT: u32 = 1 << 16;

/// A pair of anchors, with motion and depth of the later one, one value per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Whether the pair starts a clip. Otherwise its first anchor is the last request's second one, and the provider uses its history.
    pub starts: bool,
    /// The earlier anchor.
    pub previous: Picture,
    /// The later anchor.
    pub current: Picture,
    /// Motion in pixels from the later anchor to the earlier one, and device depth, 0 near.
    pub guidance: Guidance,
}

impl Request {
    /// Writes the request of a pair.
    ///
    /// # Errors
    /// `InvalidArgument` for motion or depth in tiles; `Io`.
    pub fn write(pair: &AnchorPair<'_>, starts: bool, mut to: impl Write) -> Result<()> {
        let (guidance, (width, height)) = (pair.guidance(), pair.size());
        if guidance.motion().tile() != 1 || guidance.depth().tile() != 1 {
            let cause = "the driver takes motion and depth per pixel, not per tile";
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("guidance"));
        }
        let camera = guidance.depth().projection();
        let origin = match guidance.origin() {
            MotionOrigin::Geometry => 0,
            MotionOrigin::LatentGradient => 1,
            MotionOrigin::OpticalFlow => 2,
        };
        let planes = [camera.near(), camera.far(), camera.vertical_fov()].map(f32::to_bits);
        let words = [REQUEST, width, height, u32::from(starts), origin, planes[0], planes[1], planes[2]];
        let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        bytes.extend_from_slice(pair.previous().rgba());
        bytes.extend_from_slice(pair.current().rgba());
        bytes.extend(guidance.motion().vectors().iter().flatten().flat_map(|v| v.to_le_bytes()));
        bytes.extend(guidance.depth().depth().iter().flat_map(|v| v.to_le_bytes()));
        to.write_all(&bytes).and_then(|()| to.flush()).map_err(|e| broken("cannot be written", &e))
    }

    /// Reads the next request; `None` at the end of the input.
    ///
    /// # Errors
    /// `InvalidArgument` for bytes that are no request; `Io`, also for one that ends early.
    pub fn read(mut from: impl Read) -> Result<Option<Self>> {
        let mut first = [0; 4];
        match from.read(&mut first[..1]) {
            Ok(0) => return Ok(None),
            Ok(_) => {}
            Err(e) => return Err(broken("cannot be read", &e)),
        }
        from.read_exact(&mut first[1..]).map_err(|e| broken("ends early", &e))?;
        let mut words = [0; 7];
        for word in &mut words {
            *word = read_word(&mut from)?;
        }
        let [width, height, starts, origin, near, far, fov] = words;
        let refuse = |cause: &str| Err(Error::new(ErrorKind::InvalidArgument, cause).field("request"));
        if u32::from_le_bytes(first) != REQUEST || starts > 1 {
            return refuse("it is none of this version");
        }
        if ![width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
            return refuse(&format!("there are no pictures of {width} x {height} pixels"));
        }
        let origin = match origin {
            0 => MotionOrigin::Geometry,
            1 => MotionOrigin::LatentGradient,
            2 => MotionOrigin::OpticalFlow,
            _ => return refuse("its motion has no known origin"),
        };
        let pixels = width as usize * height as usize;
        let mut bytes = |each: usize| {
            let mut bytes = vec![0; pixels * each];
            from.read_exact(&mut bytes).map_err(|e| broken("ends early", &e)).map(|()| bytes)
        };
        let previous = Picture::from_rgba(width, height, bytes(4)?)?;
        let current = Picture::from_rgba(width, height, bytes(4)?)?;
        let component = |at: &[u8]| f16::from_le_bytes([at[0], at[1]]);
        let vectors = bytes(4)?.chunks_exact(4).map(|v| [component(v), component(&v[2..])]).collect();
        let depth = bytes(4)?.chunks_exact(4).map(|v| f32::from_le_bytes([v[0], v[1], v[2], v[3]])).collect();
        let [near, far, fov] = [near, far, fov].map(f32::from_bits);
        let projection = Projection::new(near, far, fov)?;
        let motion = MotionField::from_vectors(width, height, vectors)?;
        let depth = DepthMap::from_host(width, height, depth, DepthEncoding::default(), projection)?;
        let guidance = Guidance::from_parts(motion, depth, origin)?;
        Ok(Some(Self { starts: starts == 1, previous, current, guidance }))
    }
}

/// Writes the greeting: the provider's version, or why there is none.
///
/// # Errors
/// `Io`.
pub fn write_greeting(provider: &Result<String>, mut to: impl Write) -> Result<()> {
    match provider {
        Ok(version) => write_text(DONE, version, &mut to),
        Err(error) => write_text(FAILED, &error.to_string(), &mut to),
    }
}

/// Reads the greeting.
///
/// # Errors
/// `Unsupported` with the driver's reason; `Io` if the driver ended.
pub fn read_greeting(mut from: impl Read) -> Result<String> {
    read_status(&mut from)?;
    read_text(&mut from)
}

/// Writes a frame, or why there is none.
///
/// # Errors
/// `Io`.
pub fn write_frame(frame: &Result<Picture>, mut to: impl Write) -> Result<()> {
    match frame {
        Ok(picture) => to
            .write_all(&DONE.to_le_bytes())
            .and_then(|()| to.write_all(picture.rgba()))
            .and_then(|()| to.flush())
            .map_err(|e| broken("cannot be written", &e)),
        Err(error) => write_text(FAILED, &error.to_string(), &mut to),
    }
}

/// Reads a frame of `size`.
///
/// # Errors
/// `Unsupported` with the driver's reason; `Io` if the driver ended.
pub fn read_frame(mut from: impl Read, size: (u32, u32)) -> Result<Picture> {
    read_status(&mut from)?;
    let mut rgba = vec![0; size.0 as usize * size.1 as usize * 4];
    from.read_exact(&mut rgba).map_err(|e| broken("ends early", &e))?;
    Picture::from_rgba(size.0, size.1, rgba)
}

fn write_text(word: u32, text: &str, to: &mut impl Write) -> Result<()> {
    let kept = text.floor_char_boundary(MAX_TEXT as usize);
    let length = u32::try_from(kept).unwrap_or(MAX_TEXT);
    to.write_all(&word.to_le_bytes())
        .and_then(|()| to.write_all(&length.to_le_bytes()))
        .and_then(|()| to.write_all(&text.as_bytes()[..kept]))
        .and_then(|()| to.flush())
        .map_err(|e| broken("cannot be written", &e))
}

/// Reads the first word of an answer, and the error after it.
fn read_status(from: &mut impl Read) -> Result<()> {
    match read_word(from)? {
        DONE => Ok(()),
        FAILED => Err(Error::new(ErrorKind::Unsupported, read_text(from)?)),
        word => Err(Error::new(ErrorKind::Unsupported, format!("it answered with the word {word:#x}"))),
    }
}

fn read_text(from: &mut impl Read) -> Result<String> {
    let length = read_word(from)?;
    if length > MAX_TEXT {
        return Err(Error::new(ErrorKind::Unsupported, format!("it sent a text of {length} bytes")));
    }
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes).map_err(|e| broken("ends early", &e))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn read_word(from: &mut impl Read) -> Result<u32> {
    let mut bytes = [0; 4];
    from.read_exact(&mut bytes).map_err(|e| broken("ends early", &e))?;
    Ok(u32::from_le_bytes(bytes))
}

fn broken(what: &str, error: &io::Error) -> Error {
    Error::new(ErrorKind::Io, format!("the stream {what}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(seed: u8) -> Picture {
        Picture::from_rgba(3, 2, (0..24).map(|i| if i % 4 == 3 { 255 } else { i * 7 + seed }).collect()).unwrap()
    }

    fn guidance() -> Guidance {
        let vectors = (0..6).map(|i| [f16::from_f32(i as f32 - 2.5), f16::from_f32(-0.25)]).collect();
        let motion = MotionField::from_vectors(3, 2, vectors).unwrap();
        let camera = Projection::new(0.1, f32::INFINITY, 1.0).unwrap();
        let depth = (0..6).map(|i| i as f32 / 6.0).collect();
        let depth = DepthMap::from_host(3, 2, depth, DepthEncoding::default(), camera).unwrap();
        Guidance::from_parts(motion, depth, MotionOrigin::OpticalFlow).unwrap()
    }

    fn written(starts: bool) -> Vec<u8> {
        let (previous, current, guidance) = (picture(1), picture(2), guidance());
        let mut bytes = Vec::new();
        Request::write(&AnchorPair::new(&previous, &current, &guidance).unwrap(), starts, &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn requests_come_out_as_they_went_in_until_the_stream_ends() {
        let bytes = [written(true), written(false)].concat();
        let mut from = bytes.as_slice();
        for starts in [true, false] {
            let expected = Request { starts, previous: picture(1), current: picture(2), guidance: guidance() };
            assert_eq!(Request::read(&mut from).unwrap(), Some(expected));
        }
        assert_eq!(Request::read(&mut from).unwrap(), None);
    }

    #[test]
    fn damaged_requests_are_refused() {
        let whole = written(true);
        for length in [1, 4, 31, 32, whole.len() - 1] {
            assert_eq!(Request::read(&whole[..length]).unwrap_err().kind(), ErrorKind::Io, "{length} bytes");
        }
        // Version, width, whether a clip starts, origin, near plane.
        for (word, value) in [(0, 7), (1, 0), (1, MAX_SIDE + 1), (3, 2), (4, 3), (5, 0)] {
            let mut bytes = whole.clone();
            bytes[4 * word..4 * word + 4].copy_from_slice(&value.to_le_bytes());
            let error = Request::read(bytes.as_slice()).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument, "word {word} = {value}: {error}");
        }
    }

    #[test]
    fn answers_come_with_their_reason_where_they_failed() {
        let mut bytes = Vec::new();
        write_greeting(&Ok("3.1.5".into()), &mut bytes).unwrap();
        write_frame(&Ok(picture(3)), &mut bytes).unwrap();
        let failed = Error::new(ErrorKind::Unsupported, "there is no device").field("adapter");
        write_frame(&Err(failed), &mut bytes).unwrap();
        let mut from = bytes.as_slice();
        assert_eq!(read_greeting(&mut from).unwrap(), "3.1.5");
        assert_eq!(read_frame(&mut from, (3, 2)).unwrap(), picture(3));
        let error = read_frame(&mut from, (3, 2)).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Unsupported);
        assert!(error.to_string().contains("there is no device"), "{error}");
        assert_eq!(read_frame(&mut from, (3, 2)).unwrap_err().kind(), ErrorKind::Io);

        let mut bytes = Vec::new();
        write_greeting(&Err(Error::new(ErrorKind::Unsupported, "no libraries")), &mut bytes).unwrap();
        assert!(read_greeting(bytes.as_slice()).unwrap_err().to_string().contains("no libraries"));
        assert!(read_greeting([9, 0, 0, 0].as_slice()).is_err());
    }
}
