//! Videos that only an ffmpeg can read, through the program as a person starts it. The ffmpegs are small scripts, each with
//! one way to behave.
#![cfg(unix)]

mod common;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use common::clips::{walk, y4m};
use common::decoder::decode;

const SIZE: (u32, u32) = (64, 36);
/// What ffmpeg says about a video when it is given no output.
const ABOUT: &str = "Input #0, matroska\n  Duration: 00:00:00.40, start: 0.000000\n  Stream #0:0: Video: h264 (High), \
                     yuv420p(tv, bt709), 64x36, 15 fps\n  Stream #0:1: Audio: opus\nAt least one output file must be specified";

struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    /// A folder with a file that is no Y4M, the Y4M an ffmpeg would make of it, and an ffmpeg that reads it with the
    /// shell commands `reads`.
    fn new(reads: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("clip.mkv"), b"\x1aE\xdf\xa3 pretends to be a film").unwrap();
        fs::write(folder.path().join("clip.y4m"), y4m(&walk(SIZE, 6), "15:1")).unwrap();
        let case = Self { folder };
        let script = format!(
            "#!/bin/sh\ncase \"$*\" in *yuv4mpegpipe*) ;; *) cat >&2 <<'END'\n{ABOUT}\nEND\nexit 1;; esac\n\
             echo \"$*\" > '{}'\nY4M='{}'\n{reads}\n",
            case.path("asked").display(),
            case.path("clip.y4m").display()
        );
        fs::write(case.path("ffmpeg"), script).unwrap();
        fs::set_permissions(case.path("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
        command.env("CAIRN_FFMPEG", self.path("ffmpeg")).arg("interpolate").arg(self.path("clip.mkv"));
        command
    }

    fn run(&self) -> (i32, String) {
        ended(self.command().output().unwrap())
    }

    fn frames(&self) -> usize {
        decode(&self.path("clip-2x.mp4")).luma.len()
    }
}

fn ended(output: Output) -> (i32, String) {
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code().expect("it ends by itself"), text)
}

#[test]
fn a_video_is_read_through_a_pipe() {
    let case = Case::new("cat \"$Y4M\"");
    let (status, text) = case.run();
    assert_eq!(status, 0, "{text}");
    assert!(text.contains("6 frames at 15 a second became 12 at 30") && text.contains("sound"), "{text}");
    assert_eq!(case.frames(), 12);
    let asked = fs::read_to_string(case.path("asked")).unwrap();
    assert!(
        asked.contains("in_color_matrix=auto") && asked.contains(&format!("file:{}", case.path("clip.mkv").display()))
    );
}

#[test]
fn an_ffmpeg_that_fails_or_is_killed_costs_what_follows() {
    for (reads, words) in [
        ("head -c 12000 \"$Y4M\"; echo 'partial file' >&2; exit 3", "partial file"),
        ("head -c 12000 \"$Y4M\"; kill -9 $$", "signal: 9"),
        // It ends well, and yet something was wrong with the file.
        ("head -c 10499 \"$Y4M\"; echo 'error while decoding' >&2", "error while decoding"),
    ] {
        let case = Case::new(reads);
        let (status, text) = case.run();
        assert_eq!(status, 1, "{text}");
        assert!(text.contains(words) && text.contains("clip.mkv") && text.contains("until then"), "{text}");
        assert_eq!(case.frames(), 6, "{text}");
    }
}

#[test]
fn an_ffmpeg_that_gives_nothing_is_told_with_its_words() {
    let case = Case::new("echo 'Decoder not found' >&2; exit 1");
    let (status, text) = case.run();
    assert!(status == 2 && text.contains("Decoder not found") && text.contains("Y4M"), "{text}");
    assert!(!case.path("clip-2x.mp4").exists());

    fs::write(case.path("ffmpeg"), "#!/bin/sh\necho 'clip.mkv: Invalid data found when processing input' >&2\nexit 1")
        .unwrap();
    let (status, text) = case.run();
    assert!(status == 2 && text.contains("no video") && text.contains("Invalid data"), "{text}");
}

#[test]
fn interlaced_video_is_refused_with_a_remedy() {
    let case = Case::new("sed '1s/ Ip / It /' \"$Y4M\"");
    let (status, text) = case.run();
    assert!(status == 1 && text.contains("interlaced") && text.contains("bwdif"), "{text}");
}

#[test]
fn without_an_ffmpeg_there_is_a_remedy() {
    let case = Case::new("");
    let (status, text) = ended(case.command().env("CAIRN_FFMPEG", "").env("PATH", "/nowhere").output().unwrap());
    assert!(status == 1 && text.contains("CAIRN_FFMPEG") && text.contains("folder of pictures"), "{text}");
    let (status, text) = ended(case.command().env("CAIRN_FFMPEG", "/nowhere/ffmpeg").output().unwrap());
    assert!(status == 1 && text.contains("/nowhere/ffmpeg") && text.contains("CAIRN_FFMPEG"), "{text}");
}

#[test]
fn ctrl_c_ends_an_ffmpeg_that_hangs_and_keeps_what_is_there() {
    let case = Case::new("echo $$ > \"$Y4M.pid\"; head -c 12000 \"$Y4M\"; exec sleep 600");
    let mut program = case.command().arg("--quiet").stderr(Stdio::piped()).spawn().unwrap();
    // A file named .part appears with the first frames.
    let part = case.path("clip-2x.mp4.part");
    wait_for("the first frames", || part.exists());
    std::thread::sleep(Duration::from_millis(300));
    assert!(Command::new("kill").arg("-INT").arg(program.id().to_string()).status().unwrap().success());
    wait_for("its end", || program.try_wait().unwrap().is_some());
    let (status, text) = ended(program.wait_with_output().unwrap());
    assert!(status == 130 && text.contains("interrupted"), "{status}: {text}");
    assert!(case.frames() >= 5);
    let ffmpeg = fs::read_to_string(case.path("clip.y4m.pid")).unwrap();
    assert!(!Path::new("/proc").join(ffmpeg.trim()).exists(), "no ffmpeg is left behind");
}

fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let start = Instant::now();
    while !there() {
        assert!(start.elapsed() < Duration::from_secs(60), "waited a minute for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
