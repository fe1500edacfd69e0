//! Reads Y4M strictly: unknown formats are rejected, not guessed, and a file that ends within a frame is distinguished from one that ends after a
//! frame.

use std::io::{self, BufRead, BufReader, Read};

use cairn::{Error, ErrorKind, MAX_SIDE, Picture, Result};

use super::from_yuv::{Chroma, FromYuv, Layout, Matrix};
use super::{FrameRate, describe_io};

/// The first bytes of every Y4M stream.
pub const Y4M_MAGIC: &[u8] = b"YUV4MPEG2";
/// Maximum length of a header line, in bytes.
const MAX_LINE: u64 = 4096;

/// Content of the header line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Y4mHeader {
    /// Layout of the frames.
    pub layout: Layout,
    /// `None` if the header says that the rate is unknown, or has none.
    pub rate: Option<FrameRate>,
    /// Width over height of a pixel; `(1, 1)` if unknown.
    pub pixel_aspect: (u32, u32),
}

/// Reads frames from a stream, one at a time.
pub struct Y4mReader {
    name: String,
    source: BufReader<Box<dyn Read + Send>>,
    header: Y4mHeader,
    header_bytes: u64,
    converter: FromYuv,
    frame: Vec<u8>,
    frames: u64,
}

impl Y4mReader {
    /// Reads the header of `source`. Errors call the stream `name`: its path.
    ///
    /// # Errors
    /// `InvalidArgument` for another kind of stream or a damaged one, `Unsupported` for kinds of video that are not supported,
    /// `Io`.
    pub fn open(source: Box<dyn Read + Send>, name: &str) -> Result<Self> {
        Self::open_as(source, name, None)
    }

    /// As [`open`](Self::open), with a known matrix.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_as(source: Box<dyn Read + Send>, name: &str, matrix: Option<Matrix>) -> Result<Self> {
        let mut source = BufReader::with_capacity(1 << 18, source);
        let named = |e: Error| e.field(name);
        let line = line(&mut source, name)?.ok_or_else(|| named(no_y4m("it is empty")))?;
        let mut header = parse(&line).map_err(named)?;
        header.layout.matrix = matrix.unwrap_or(header.layout.matrix);
        let converter = FromYuv::new(header.layout).map_err(named)?;
        let bytes = header.layout.frame_bytes();
        let mut frame = Vec::new();
        frame.try_reserve_exact(bytes).map_err(|_| {
            named(Error::new(ErrorKind::OutOfMemory, format!("a frame of {bytes} bytes does not fit memory")))
        })?;
        frame.resize(bytes, 0);
        let header_bytes = line.len() as u64 + 1;
        Ok(Self { name: name.to_owned(), source, header, header_bytes, converter, frame, frames: 0 })
    }

    /// The stream's header.
    pub fn header(&self) -> &Y4mHeader {
        &self.header
    }

    /// Number of frames in a stream of `bytes` bytes if no frame has parameters, as is usual.
    pub fn frames_in(&self, bytes: u64) -> u64 {
        bytes.saturating_sub(self.header_bytes) / (self.frame.len() as u64 + 6)
    }

    /// Reads the next frame into `out`; `false` at the end.
    ///
    /// # Errors
    /// `Io` when it cannot be read or ends within a frame, `InvalidArgument` when it is damaged or `out` has another size.
    pub fn read(&mut self, out: &mut Picture) -> Result<bool> {
        let Some(line) = line(&mut self.source, &self.name)? else { return Ok(false) };
        if line != b"FRAME" && !line.starts_with(b"FRAME ") {
            let cause = format!("frame {} does not begin with FRAME: the file is damaged", self.frames);
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field(&self.name));
        }
        match self.source.read_exact(&mut self.frame) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Err(self.cut_short()),
            Err(e) => return Err(unreadable(&self.name, &e)),
        }
        self.converter.convert(&self.frame, out)?;
        self.frames += 1;
        Ok(true)
    }

    fn cut_short(&self) -> Error {
        let cause =
            format!("it ends in the midst of frame {}; the {} frames before it are whole", self.frames, self.frames);
        Error::new(ErrorKind::Io, cause).field(&self.name).remedy("Get the whole file, if there is more of it")
    }
}

/// A line without its newline; `None` at the end of the stream.
fn line(source: &mut impl BufRead, name: &str) -> Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    source.take(MAX_LINE).read_until(b'\n', &mut line).map_err(|e| unreadable(name, &e))?;
    match line.pop() {
        None => Ok(None),
        Some(b'\n') => Ok(Some(line)),
        Some(_) if (line.len() as u64) < MAX_LINE - 1 => {
            Err(Error::new(ErrorKind::Io, "it ends in the midst of a header")
                .field(name)
                .remedy("Get the whole file, if there is more of it"))
        }
        Some(_) => Err(no_y4m("a header has no end").field(name)),
    }
}

fn unreadable(name: &str, cause: &io::Error) -> Error {
    describe_io("cannot be read", name.as_ref(), cause)
}

fn no_y4m(cause: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("it is no Y4M video that can be read: {cause}"))
        .remedy("Make it anew, for example with ffmpeg -i VIDEO -pix_fmt yuv420p VIDEO.y4m")
}

/// Parses the header line, without its newline.
///
/// # Errors
/// [`ErrorKind::InvalidArgument`] where a word of it is missing or cannot be read; [`ErrorKind::Unsupported`] for interlaced video and for a form
/// of colour that [`Y4mReader`] does not read.
pub fn parse(line: &[u8]) -> Result<Y4mHeader> {
    let text = std::str::from_utf8(line).map_err(|_| no_y4m("its header is no text"))?;
    let mut words = text.split(' ');
    if words.next().map(str::as_bytes) != Some(Y4M_MAGIC) {
        return Err(no_y4m("it does not begin with YUV4MPEG2"));
    }
    let (mut width, mut height) = (None, None);
    let (mut rate, mut pixel_aspect, mut full_range, mut matrix) = (None, (1, 1), false, None);
    let (mut colour, mut old_colour) = (None, None);
    for word in words.filter(|w| !w.is_empty()) {
        let (key, value) = word.split_at_checked(1).ok_or_else(|| no_y4m("its header is no text"))?;
        match key {
            "W" => width = Some(side(value)?),
            "H" => height = Some(side(value)?),
            "F" if value != "0:0" => {
                rate = Some(FrameRate::parse(value).map_err(|e| no_y4m(&e.to_string()))?);
            }
            "I" if !matches!(value, "p" | "?") => return Err(interlaced()),
            "A" => pixel_aspect = ratio(value)?,
            "C" => colour = Some(value),
            "X" => match value.split_once('=') {
                Some(("COLORRANGE", range)) => full_range = range.eq_ignore_ascii_case("FULL"),
                Some(("COLORMATRIX", "BT709")) => matrix = Some(Matrix::Bt709),
                Some(("COLORMATRIX", "BT601")) => matrix = Some(Matrix::Bt601),
                // The older parameter, from before `C` existed.
                Some(("YSCSS", value)) => old_colour = Some(value.to_ascii_lowercase()),
                _ => {}
            },
            _ => {}
        }
    }
    let (Some(width), Some(height)) = (width, height) else {
        return Err(no_y4m("its header lacks a width or a height"));
    };
    let chroma = chroma(colour.or(old_colour.as_deref()).unwrap_or("420jpeg"))?;
    let matrix = matrix.unwrap_or_else(|| Matrix::by_size((width, height)));
    Ok(Y4mHeader { layout: Layout { size: (width, height), chroma, matrix, full_range }, rate, pixel_aspect })
}

fn side(text: &str) -> Result<u32> {
    let side = text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    side.ok_or_else(|| no_y4m(&format!("a side of {text} is not from 1 to {MAX_SIDE}")))
}

/// A pixel aspect; `0:0` means unknown.
fn ratio(text: &str) -> Result<(u32, u32)> {
    let numbers = text.split_once(':').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match numbers {
        Some((0, 0)) => Ok((1, 1)),
        // Wider than any real pixel aspect, and small enough for a container.
        Some((a @ 1..=65_535, b @ 1..=65_535)) if a / b < 16 && b / a < 16 => Ok((a, b)),
        _ => Err(no_y4m(&format!("pixels cannot have the shape {text}"))),
    }
}

fn chroma(name: &str) -> Result<Chroma> {
    match name {
        "420" | "420jpeg" => Ok(Chroma::Half420Centre),
        "420mpeg2" => Ok(Chroma::Half420Left),
        "420paldv" => Ok(Chroma::Half420PalDv),
        "422" => Ok(Chroma::Half422),
        "444" => Ok(Chroma::Full444),
        "mono" => Ok(Chroma::Mono),
        other => Err(Error::new(ErrorKind::Unsupported, format!("Y4M of the kind C{other} is not read"))
            .remedy("Convert it to 8 bits first: ffmpeg -i VIDEO -pix_fmt yuv420p 8-BIT.y4m")),
    }
}

fn interlaced() -> Error {
    Error::new(ErrorKind::Unsupported, "the video is interlaced: each of its frames shows two moments")
        .remedy("Make it progressive first: ffmpeg -i VIDEO -vf bwdif PROGRESSIVE.y4m")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(bytes: &[u8]) -> Result<Y4mReader> {
        Y4mReader::open(Box::new(io::Cursor::new(bytes.to_vec())), "clip.y4m")
    }

    fn header(line: &str) -> Result<Y4mHeader> {
        open(format!("{line}\n").as_bytes()).map(|reader| *reader.header())
    }

    #[test]
    fn parameters_may_stand_in_any_order() {
        let one =
            header("YUV4MPEG2 W320 H240 F30000:1001 Ip A16:15 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=FULL").unwrap();
        let two = header("YUV4MPEG2 XCOLORRANGE=FULL C420mpeg2  A16:15 I? XWHATEVER H240 F30000:1001 W320").unwrap();
        assert_eq!(one, two);
        assert_eq!((one.layout.size, one.pixel_aspect), ((320, 240), (16, 15)));
        assert_eq!(one.rate, Some(FrameRate::new(30_000, 1001).unwrap()));
        assert!(one.layout.full_range && one.layout.chroma == Chroma::Half420Left);
    }

    #[test]
    fn what_is_not_said_is_what_programs_assume() {
        let plain = header("YUV4MPEG2 W720 H576").unwrap();
        let layout =
            Layout { size: (720, 576), chroma: Chroma::Half420Centre, matrix: Matrix::Bt601, full_range: false };
        assert_eq!(plain, Y4mHeader { layout, rate: None, pixel_aspect: (1, 1) });
        assert_eq!(header("YUV4MPEG2 W1280 H720 F0:0").unwrap().layout.matrix, Matrix::Bt709);
        assert_eq!(header("YUV4MPEG2 W64 H36 XCOLORMATRIX=BT709").unwrap().layout.matrix, Matrix::Bt709);
        assert_eq!(header("YUV4MPEG2 W64 H36 XYSCSS=420PALDV").unwrap().layout.chroma, Chroma::Half420PalDv);
    }

    #[test]
    fn what_cannot_be_shown_as_meant_is_refused_with_a_remedy() {
        for (line, words) in [
            ("YUV4MPEG2 W64 H36 C420p10", "-pix_fmt yuv420p"),
            ("YUV4MPEG2 W64 H36 C444alpha", "444alpha"),
            ("YUV4MPEG2 W64 H36 C411", "411"),
            ("YUV4MPEG2 W64 H36 It", "bwdif"),
            ("YUV4MPEG2 W64 H36 Im", "interlaced"),
        ] {
            let error = header(line).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Unsupported, "{line}");
            assert!(error.to_string().contains(words) && error.to_string().contains("clip.y4m"), "{line}: {error}");
        }
        for line in [
            "",
            "YUV4MPEG W64 H36",
            "YUV4MPEG2",
            "YUV4MPEG2 W64",
            "YUV4MPEG2 W0 H36",
            "YUV4MPEG2 W64 H-36",
            "YUV4MPEG2 W64 H99999999999999999999",
            "YUV4MPEG2 W64 H36 F30:0",
            "YUV4MPEG2 W64 H36 A1:0",
            "YUV4MPEG2 W64 H36 \u{e9}",
        ] {
            let error = header(line).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument, "{line}");
            assert!(error.to_string().contains("ffmpeg"), "{line}: {error}");
        }
        assert!(open(&[b'Y'; 9000]).is_err());
        assert!(open(b"\x89PNG\r\n\x1a\n\xff\xfe").is_err());
    }

    fn clip(frames: &[&[u8]]) -> Vec<u8> {
        let mut bytes = b"YUV4MPEG2 W2 H2 F15:1 Cmono\n".to_vec();
        frames.iter().for_each(|frame| bytes.extend_from_slice(frame));
        bytes
    }

    #[test]
    fn frames_come_one_by_one_to_the_end() {
        let bytes = clip(&[b"FRAME\n\x10\x10\x10\x10", b"FRAME Ip XNOTE\n\xeb\xeb\xeb\xeb"]);
        let mut reader = open(&bytes).unwrap();
        assert_eq!(reader.frames_in(28 + 10 * 7), 7);
        let mut out = Picture::new(2, 2).unwrap();
        assert!(reader.read(&mut out).unwrap() && out.pixels()[3] == [0, 0, 0, 255]);
        assert!(reader.read(&mut out).unwrap() && out.pixels()[0] == [255; 4]);
        assert!(!reader.read(&mut out).unwrap() && !reader.read(&mut out).unwrap());
    }

    #[test]
    fn an_end_in_the_midst_of_a_frame_is_told() {
        let whole = clip(&[b"FRAME\n\x10\x10\x10\x10", b"FRAME\n\x10\x10\x10\x10"]);
        for len in 28 + 11..whole.len() {
            let mut reader = open(&whole[..len]).unwrap();
            let mut out = Picture::new(2, 2).unwrap();
            assert!(reader.read(&mut out).unwrap());
            let error = reader.read(&mut out).unwrap_err();
            assert!(error.kind() == ErrorKind::Io && error.to_string().contains("clip.y4m"), "{len}: {error}");
        }
        let damaged = clip(&[b"FRAME\n\x10\x10\x10\x10", b"FRAMES\n\x10\x10\x10\x10"]);
        let (mut reader, mut out) = (open(&damaged).unwrap(), Picture::new(2, 2).unwrap());
        assert!(reader.read(&mut out).unwrap());
        assert!(reader.read(&mut out).unwrap_err().to_string().contains("frame 1"));
    }
}
