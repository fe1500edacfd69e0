//! Times ffmpeg's `minterpolate`.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Picture, Result};

use super::THREADS;
use crate::quality::rows::minterpolate;
use crate::quality::rows::program::{Scratch, run};

/// Pictures that the filter outputs per interval: the anchor and the one in the middle.
const PICTURES_PER_INTERVAL: usize = 2;
/// Anchors that the filter reads before its first picture; at the end it outputs the last ones without computing.
const READ_AHEAD: usize = 3;

/// The filter and the anchors it is given.
pub(super) struct Filter {
    program: PathBuf,
    // Keeps the anchors' files until the filter is dropped.
    _scratch: Scratch,
    anchors: PathBuf,
    size: String,
    count: usize,
}

impl Filter {
    /// Converts `anchors` to the 8-bit YUV 4:2:0 that the filter reads.
    ///
    /// # Errors
    /// `Unsupported` when the program does not run.
    pub(super) fn new(program: &Path, anchors: &[Picture]) -> Result<Self> {
        let scratch = Scratch::new()?;
        let size = anchors.first().map_or_else(String::new, |p| format!("{}x{}", p.width(), p.height()));
        let (rgb, yuv) = (scratch.pictures("anchors.rgb", anchors)?, scratch.path("anchors.yuv"));
        let filter = Self { program: program.into(), _scratch: scratch, anchors: yuv, size, count: anchors.len() };
        let mut convert = filter.input_command("rgb24", &rgb);
        run("ffmpeg", convert.args(["-pix_fmt", "yuv420p", "-f", "rawvideo"]).arg(&filter.anchors))?;
        Ok(filter)
    }

    fn input_command(&self, format: &str, path: &Path) -> Command {
        let mut command = Command::new(&self.program);
        command.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y", "-threads", &THREADS.to_string()]);
        command.args(["-f", "rawvideo", "-pix_fmt", format, "-s", &self.size, "-r", "15", "-i"]).arg(path);
        command
    }

    /// Runs the filter once over all anchors. Returns the time from the first picture of each interval to that of the next, at the scored settings.
    /// Reading and checksums run on other threads of ffmpeg.
    ///
    /// # Errors
    /// `Unsupported` when it fails, or outputs another number of pictures.
    pub(super) fn times(&self) -> Result<Vec<Duration>> {
        let fail = |cause: String| Error::new(ErrorKind::Unsupported, cause).field("ffmpeg");
        let mut command = self.input_command("yuv420p", &self.anchors);
        let filter = format!("minterpolate=fps=30:{}", minterpolate::SETTINGS);
        // The framecrc output: a line with time and checksum of each picture as soon as it is made.
        command.args(["-filter_threads", &THREADS.to_string(), "-vf", &filter]);
        command.args(["-f", "framecrc", "-flush_packets", "1", "-"]);
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = KillOnDrop(child.map_err(|e| fail(format!("it does not run: {e}")))?);
        let mut moments = Vec::new();
        let mut pictures: Vec<String> = Vec::new();
        for line in child.0.stdout.take().into_iter().flat_map(|out| BufReader::new(out).lines()) {
            let (now, line) = (Instant::now(), line.map_err(|e| fail(format!("what it says cannot be read: {e}")))?);
            if let Some(checksum) = line.rsplit(',').next().filter(|_| !line.starts_with('#')) {
                moments.push(now);
                pictures.push(checksum.trim().into());
            }
        }
        let mut messages = String::new();
        if let Some(mut errors) = child.0.stderr.take() {
            // Its messages are used for the error only.
            let _ = errors.read_to_string(&mut messages);
        }
        let status = child.0.wait().map_err(|e| fail(format!("it cannot be waited for: {e}")))?;
        if !status.success() {
            return Err(fail(format!("it failed: {}", messages.trim())));
        }
        between(&moments, &pictures, intervals(self.count).len()).ok_or_else(|| {
            fail(format!("of {} anchors it gave {} pictures, or one more than once", self.count, pictures.len()))
        })
    }
}

/// The intervals that are timed out of `anchors` anchors, by their earlier anchor.
pub(super) fn intervals(anchors: usize) -> std::ops::Range<usize> {
    1..anchors.saturating_sub(READ_AHEAD - 1)
}

/// Kills the process when dropped.
struct KillOnDrop(Child);

impl Drop for KillOnDrop {
    fn drop(&mut self) {
        // Both fail if the process has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Durations of `intervals` from the arrival times of `pictures`; `None` if there are too few pictures, or if one equals its predecessor, because a
/// copied picture costs nothing.
fn between(moments: &[Instant], pictures: &[String], intervals: usize) -> Option<Vec<Duration>> {
    let is_copied = pictures.windows(2).any(|two| two[0] == two[1]);
    let firsts: Vec<&Instant> = moments.iter().step_by(PICTURES_PER_INTERVAL).take(intervals + 1).collect();
    let times: Vec<Duration> = firsts.windows(2).map(|two| *two[1] - *two[0]).collect();
    (times.len() == intervals && intervals > 0 && !is_copied).then_some(times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_lasts_from_its_first_picture_to_that_of_the_next() {
        let start = Instant::now();
        // Pictures arrive in pairs, as the filter outputs them, and the rest at the end.
        let moments = [800, 800, 1300, 1301, 1790, 1790, 1790].map(|ms| start + Duration::from_millis(ms));
        let mut pictures: Vec<String> = (0..7).map(|n| format!("0x{n}")).collect();
        let found = between(&moments, &pictures, 2);
        assert_eq!(found, Some(vec![Duration::from_millis(500), Duration::from_millis(490)]));
        assert_eq!(between(&moments[..4], &pictures[..4], 2), None, "too few");
        pictures[3] = pictures[2].clone();
        assert_eq!(between(&moments, &pictures, 2), None, "a copy is not made");
    }
}
