//! Reads all other videos through an ffmpeg process that writes Y4M to a pipe.

use std::ffi::OsString;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cairn::{Error, ErrorKind, Picture, Result};

use super::source::{Input, Source};
use media::{Matrix, Y4mReader};

/// Environment variable with the path of an ffmpeg that is not on the path.
const VARIABLE: &str = "CAIRN_FFMPEG";
/// Maximum number of bytes kept of ffmpeg's messages.
const MAX_WORDS: usize = 4096;

/// Ends ffmpeg from another thread.
#[derive(Clone)]
pub(super) struct Stopper(Arc<Mutex<Child>>);

impl Stopper {
    pub(super) fn stop(&self) {
        let mut child = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = child.kill();
        // Reaps the process; its status is irrelevant.
        let _ = child.wait();
    }
}

struct Ffmpeg {
    reader: Y4mReader,
    child: Stopper,
    words: Receiver<String>,
    name: String,
    frames: u64,
}

impl Source for Ffmpeg {
    fn read(&mut self, out: &mut Picture) -> Result<bool> {
        match self.reader.read(out) {
            Ok(true) => {
                self.frames += 1;
                Ok(true)
            }
            // The end of the stream counts only if ffmpeg succeeded; otherwise its message is the better error.
            end => match self.failure() {
                Some(error) => Err(error),
                None => end,
            },
        }
    }
}

impl Ffmpeg {
    /// The error of a failed ffmpeg.
    fn failure(&mut self) -> Option<Error> {
        let (status, words) = ended(&self.child, &self.words);
        let status = status.filter(|status| !status.success());
        if status.is_none() && words.is_empty() {
            return None;
        }
        let how = status.map_or("ffmpeg met damage".into(), |status| format!("ffmpeg failed ({status})"));
        let cause = format!("{how} after {} frames{}", self.frames, error_text(&words));
        Some(
            Error::new(ErrorKind::Io, cause)
                .field(&self.name)
                .remedy("Play the video to see whether its file is whole"),
        )
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        self.child.stop();
    }
}

/// Starts ffmpeg on the video at `path`.
pub(super) fn open(path: &Path) -> Result<Input> {
    let name = path.display().to_string();
    let program = program().ok_or_else(|| {
        Error::new(ErrorKind::Unsupported, "to read this kind of file takes ffmpeg, and there is none on the path")
            .field(&*name)
            .remedy(format!("Install ffmpeg or name one with {VARIABLE}, or give Y4M or a folder of pictures"))
    })?;
    let about = probe(&program, path)?;
    if about.is_hdr {
        let cause = "the video is HDR, of which the frames would be pale: pictures here have eight bits of sRGB";
        let remedy = "Map it first, as by ffmpeg -i IN -vf zscale=t=linear:npl=203,tonemap=mobius,zscale=p=bt709:t=bt709:m=bt709:r=tv OUT";
        return Err(Error::new(ErrorKind::Unsupported, cause).field(&*name).remedy(remedy));
    }
    let mut command = Command::new(&program);
    command.args(["-nostdin", "-hide_banner", "-v", "error", "-i"]).arg(file_url(path));
    // Selects the first video stream that is no cover picture, in the Y4M format that keeps 8-bit video exact and states its rate.
    let scale =
        format!("scale=in_color_matrix={}:out_color_matrix=bt709:out_range=tv:flags=accurate_rnd", about.matrix);
    command.args(["-map", "0:V:0", "-vf", &scale, "-pix_fmt", "yuv444p", "-f", "yuv4mpegpipe", "-"]);
    let mut child = start(&mut command, &program)?;
    let (Some(frames), Some(words)) = (child.stdout.take(), child.stderr.take()) else {
        return Err(Error::new(ErrorKind::Device, "ffmpeg has no pipes"));
    };
    let words = listen(words);
    let child = Stopper(Arc::new(Mutex::new(child)));
    let reader = match Y4mReader::open_as(Box::new(frames), &name, Some(Matrix::Bt709)) {
        Ok(reader) => reader,
        Err(error) => {
            child.stop();
            let words = words.recv_timeout(PATIENCE).unwrap_or_default();
            // For example interlaced video: ffmpeg passes it on, and the reader refuses it.
            return Err(if words.is_empty() { error } else { unread(&name, &words) });
        }
    };
    let header = *reader.header();
    let expected = about.seconds.zip(header.rate).map(|(seconds, rate)| (seconds * rate.per_second()).round() as u64);
    let source = Box::new(Ffmpeg { reader, child: child.clone(), words, name, frames: 0 });
    Ok(Input {
        size: header.layout.size,
        rate: header.rate,
        pixel_aspect: header.pixel_aspect,
        expected,
        notes: about.has_sound.then(|| "the sound is left aside".to_owned()).into_iter().collect(),
        source,
        stopper: Some(child),
    })
}

/// Time limit for the last messages of a process that has ended.
const PATIENCE: Duration = Duration::from_secs(2);

fn program() -> Option<PathBuf> {
    match std::env::var_os(VARIABLE).filter(|name| !name.is_empty()) {
        Some(named) => Some(named.into()),
        None => provision::tools::on_path("ffmpeg"),
    }
}

/// Adds the protocol, so that a file name is never parsed as a URL.
fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

fn start(command: &mut Command, program: &Path) -> Result<Child> {
    // Ctrl-C must reach this program only, which then ends ffmpeg.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().map_err(|e| {
        Error::new(ErrorKind::Unsupported, format!("{} cannot be started: {e}", program.display()))
            .field(VARIABLE)
            .remedy(format!("Install ffmpeg, or let {VARIABLE} name one that runs"))
    })
}

/// What ffmpeg reports about a video before decoding.
struct VideoInfo {
    matrix: &'static str,
    seconds: Option<f64>,
    has_sound: bool,
    is_hdr: bool,
}

/// Asks ffmpeg about a video. Without an output ffmpeg describes the input and exits with an error, which is ignored.
fn probe(program: &Path, path: &Path) -> Result<VideoInfo> {
    let mut command = Command::new(program);
    command.args(["-nostdin", "-hide_banner", "-i"]).arg(file_url(path));
    let child = start(&mut command, program)?;
    let output =
        child.wait_with_output().map_err(|e| Error::new(ErrorKind::Io, format!("ffmpeg cannot be read: {e}")))?;
    let text = String::from_utf8_lossy(&output.stderr);
    if !text.contains("Video:") {
        return Err(unread(&path.display().to_string(), &text));
    }
    Ok(describe(&text))
}

fn describe(text: &str) -> VideoInfo {
    let video =
        text.lines().find(|line| line.contains("Video:") && !line.contains("(attached pic)")).unwrap_or_default();
    // The colour matrix is in brackets, such as yuv420p(tv, bt709, progressive) or yuv420p(tv, smpte170m/bt470bg/bt709).
    let tagged = ["bt709", "bt470bg", "smpte170m", "smpte240m", "bt2020nc", "fcc", "gbr", "ycgco"];
    let told =
        video.split(['(', ',', ')']).map(str::trim).any(|word| tagged.contains(&word.split('/').next().unwrap_or("")));
    let size = video.split([',', ' ']).find_map(|word| {
        let (width, height) = word.split_once('x')?;
        Some((width.parse().ok()?, height.parse().ok()?)).filter(|&(w, h): &(u32, u32)| w > 0 && h > 0)
    });
    let matrix = match (told, size.map(Matrix::by_size)) {
        (true, _) | (_, None) => "auto",
        (_, Some(Matrix::Bt601)) => "bt601",
        (_, Some(Matrix::Bt709)) => "bt709",
    };
    let duration = text.split_once("Duration: ").and_then(|(_, rest)| rest.split(',').next());
    let seconds = duration.and_then(|clock| {
        clock.split(':').try_fold(0.0, |sum, part| Some(sum * 60.0 + part.trim().parse::<f64>().ok()?))
    });
    // PQ and hybrid log-gamma.
    let is_hdr = ["smpte2084", "arib-std-b67"].iter().any(|transfer| video.contains(transfer));
    VideoInfo { matrix, seconds, has_sound: text.contains("Audio:"), is_hdr }
}

/// Collects a process's messages on a thread of its own, so that the process never blocks. Sends their beginning when the stream ends.
fn listen(mut words: impl Read + Send + 'static) -> Receiver<String> {
    let (send, heard) = channel();
    // If the thread cannot start, the messages are treated as empty.
    let _ = std::thread::Builder::new().name("ffmpeg".into()).spawn(move || {
        let mut kept = Vec::new();
        let _ = (&mut words).take(MAX_WORDS as u64).read_to_end(&mut kept);
        let _ = io::copy(&mut words, &mut io::sink());
        let _ = send.send(String::from_utf8_lossy(&kept).trim().to_owned());
    });
    heard
}

/// Waits for a process whose output has ended, and for its last messages.
fn ended(child: &Stopper, words: &Receiver<String>) -> (Option<ExitStatus>, String) {
    // Not `wait`, which would hold the lock that `Stopper` needs to end the process.
    let mut status = None;
    for _ in 0..PATIENCE.as_millis() / 10 {
        status = child.0.lock().unwrap_or_else(PoisonError::into_inner).try_wait().ok().flatten();
        if status.is_some() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    (status, words.recv_timeout(PATIENCE).unwrap_or_default())
}

fn unread(name: &str, words: &str) -> Error {
    // The last line has the reason; earlier ones describe the file.
    let last = words.lines().rev().find(|line| !line.trim().is_empty() && !line.contains("output file"));
    Error::new(
        ErrorKind::InvalidArgument,
        format!("ffmpeg finds no video in it{}", error_text(last.unwrap_or_default())),
    )
    .field(name)
    .remedy("Name a video, a Y4M file or a folder of pictures")
}

/// Formats messages as the end of a sentence.
fn error_text(words: &str) -> String {
    let lines: Vec<&str> = words.lines().map(str::trim).filter(|line| !line.is_empty()).take(3).collect();
    if lines.is_empty() { String::new() } else { format!(": {}", lines.join("; ").trim_end_matches('.')) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "Input #0, mov, from 'v.mp4':\n  Duration: 00:01:10.50, start: 0.000000, bitrate: 500 kb/s\n";

    fn about(stream: &str) -> VideoInfo {
        describe(&format!(
            "{HEAD}  Stream #0:0[0x1](und): Video: {stream}\nAt least one output file must be specified\n"
        ))
    }

    #[test]
    fn the_matrix_is_the_videos_own_or_by_its_size() {
        for (stream, matrix) in [
            ("h264 (High) (avc1 / 0x31637661), yuv420p(tv, bt709, progressive), 640x360 [SAR 1:1], 24 fps", "auto"),
            ("h264 (High), yuv420p(tv, smpte170m/bt470bg/bt709), 1920x1080, 25 fps", "auto"),
            ("h264 (High) (avc1 / 0x31637661), yuv420p(tv, unknown/bt709/bt709), 1920x1080, 25 fps", "bt709"),
            ("mpeg4 (Simple Profile), yuv420p(progressive), 720x576 [SAR 16:15 DAR 4:3], 25 fps", "bt601"),
            ("vp9, yuv420p, 1280x720, 30 fps", "bt709"),
        ] {
            assert_eq!(about(stream).matrix, matrix, "{stream}");
        }
    }

    #[test]
    fn hdr_is_found_by_its_transfer_function() {
        for (stream, is_hdr) in [
            ("hevc (Main 10), yuv420p10le(tv, bt2020nc/bt2020/smpte2084), 3840x2160, 24 fps", true),
            ("hevc (Main 10), yuv420p10le(tv, bt2020nc/bt2020/arib-std-b67), 1920x1080, 30 fps", true),
            ("h264 (High), yuv420p(tv, bt709, progressive), 1920x1080, 25 fps", false),
        ] {
            assert_eq!(about(stream).is_hdr, is_hdr, "{stream}");
        }
    }

    #[test]
    fn length_and_sound_are_found() {
        let found = about("vp9, yuv420p, 1280x720, 30 fps");
        assert_eq!((found.seconds, found.has_sound), (Some(70.5), false));
        let other = describe("Duration: N/A\n Stream #0:1: Audio: aac\n Stream #0:0: Video: vp9, yuv420p, 1280x720\n");
        assert_eq!((other.seconds, other.has_sound), (None, true));
    }
}
