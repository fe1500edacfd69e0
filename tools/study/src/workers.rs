//! Runs this program again in several parallel processes, each of which makes one folder of frames.

use std::ffi::OsString;
use std::io::Read;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Result};

use crate::output::FRAMES;
use crate::progress::Progress;

/// Polling interval.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Time limit for an interrupted process to finish its frame and its manifest.
const GRACE_PERIOD: Duration = Duration::from_secs(10);
/// Maximum number of bytes kept of a process's messages.
const MAX_MESSAGE_BYTES: u64 = 64 << 10;
/// Maximum number of parallel processes.
pub(crate) const MAX_JOBS: usize = 256;

/// Default number of rollouts at a time that use `threads` threads each: one to as many processors.
pub(crate) fn usual_jobs(threads: usize) -> usize {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    (processors / threads.max(1)).clamp(1, MAX_JOBS)
}

/// Work of one process.
pub(crate) struct Work {
    /// Name for messages.
    pub(crate) name: String,
    /// Folder of its frames.
    pub(crate) folder: PathBuf,
    /// The command line, without the program.
    pub(crate) arguments: Vec<OsString>,
    /// Expected number of frames.
    pub(crate) planned: u64,
}

/// Checks the number of parallel processes.
///
/// # Errors
/// `InvalidArgument`.
pub(crate) fn check_jobs(jobs: usize) -> Result<()> {
    if (1..=MAX_JOBS).contains(&jobs) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::InvalidArgument, format!("{jobs} rollouts cannot be made at a time"))
        .field("--jobs")
        .remedy(format!("Use 1 to {MAX_JOBS}")))
}

/// A running process; dropping the value kills it.
struct Running<'a> {
    work: &'a Work,
    child: Child,
    /// Reads its messages.
    messages: Option<JoinHandle<String>>,
    /// Frames counted in its folder.
    frames: u64,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        // Both fail if the process has ended, which is fine.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl<'a> Running<'a> {
    fn start(work: &'a Work) -> Result<Self> {
        let failed = |e: std::io::Error| {
            Error::new(ErrorKind::Io, format!("{}: this program cannot be started again: {e}", work.name))
        };
        let program = std::env::current_exe().map_err(failed)?;
        let mut child = Command::new(program)
            .args(&work.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        // Read all the time: a process whose pipe is full waits.
        let stderr = child.stderr.take();
        let messages = std::thread::spawn(move || {
            let mut kept = Vec::new();
            if let Some(mut stderr) = stderr {
                // If its messages cannot be read, the error has no text.
                _ = stderr.by_ref().take(MAX_MESSAGE_BYTES).read_to_end(&mut kept);
                _ = std::io::copy(&mut stderr, &mut std::io::sink());
            }
            String::from_utf8_lossy(&kept).into_owned()
        });
        Ok(Self { work, child, messages: Some(messages), frames: 0 })
    }

    /// Number of frames in the folder.
    fn frames(&mut self) -> u64 {
        let frames = self.work.folder.join(FRAMES);
        while frames.join(format!("{:06}.png", self.frames)).exists() && self.frames < self.work.planned {
            self.frames += 1;
        }
        self.frames
    }

    /// Whether the process has ended; an error if it failed.
    fn has_ended(&mut self) -> Result<bool> {
        let name = &self.work.name;
        let status = self.child.try_wait().map_err(|e| Error::new(ErrorKind::Io, format!("{name}: {e}")))?;
        let Some(status) = status else { return Ok(false) };
        if status.success() {
            return Ok(true);
        }
        let output = self.messages.take().and_then(|messages| messages.join().ok()).unwrap_or_default();
        let message = output.lines().find_map(|line| line.strip_prefix("error: ")).unwrap_or_default();
        let kind = if status.code() == Some(2) { ErrorKind::InvalidArgument } else { ErrorKind::InvalidState };
        let cause =
            if message.is_empty() { format!("its process ended by itself: {status}") } else { message.to_owned() };
        Err(Error::new(kind, format!("{name}: {cause}"))
            .field(self.work.folder.display().to_string())
            .remedy("Run the same command again: finished parts are kept"))
    }
}

/// Runs all of `work`, `jobs` processes at a time. After a failure no new process starts, and running ones finish.
///
/// # Errors
/// Errors of a process, with its name; `Cancelled` when `stop` was set.
pub(crate) fn run_all(work: &[Work], jobs: usize, progress: &Progress, stop: &AtomicBool) -> Result<()> {
    let Some(first) = work.first() else { return Ok(()) };
    let more = if work.len() > 1 { format!(", and {} more", work.len() - 1) } else { String::new() };
    progress.phase(&format!("{}{more}", first.name));
    progress.begin(work.iter().map(|work| work.planned).sum::<u64>());
    let mut waiting = work.iter();
    let mut running: Vec<Running<'_>> = Vec::new();
    let (mut done, mut failure, mut interrupted) = (0, None, None);
    loop {
        if interrupted.is_none() && stop.load(Ordering::Relaxed) {
            interrupted = Some(Instant::now());
        }
        while running.len() < jobs && failure.is_none() && interrupted.is_none() {
            match waiting.next().map(Running::start) {
                None => break,
                Some(Ok(started)) => running.push(started),
                Some(Err(error)) => failure = Some(error),
            }
        }
        // The processes also get the keyboard's signal; those that ignore it are killed.
        if running.is_empty() || interrupted.is_some_and(|since| since.elapsed() > GRACE_PERIOD) {
            break;
        }
        let mut now = done;
        running.retain_mut(|process| match process.has_ended() {
            Ok(false) => {
                now += process.frames();
                true
            }
            Ok(true) => {
                done += process.work.planned;
                now += process.work.planned;
                false
            }
            Err(error) => {
                if interrupted.is_none() {
                    failure.get_or_insert(error);
                }
                false
            }
        });
        progress.frames(now);
        std::thread::sleep(POLL_INTERVAL);
    }
    progress.end();
    drop(running);
    match (failure, interrupted) {
        (Some(error), _) => Err(error),
        (None, Some(_)) => Err(Error::new(ErrorKind::Cancelled, "interrupted")),
        (None, None) => Ok(()),
    }
}
