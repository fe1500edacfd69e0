//! This program again, in processes of their own, so many at a time: each makes one folder of frames.

use std::ffi::OsString;
use std::io::Read;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Result};

use crate::output::FRAMES;
use crate::progress::Progress;

/// Between two looks at the processes.
const EVERY: Duration = Duration::from_millis(50);
/// How long a process that was interrupted may take to finish its frame and its manifest.
const PATIENCE: Duration = Duration::from_secs(10);
/// The most that is kept of what a process says.
const MAX_WORDS: u64 = 64 << 10;
/// The most processes at a time.
const MAX_JOBS: usize = 256;

/// What one process makes.
pub(crate) struct Work {
    /// For people.
    pub(crate) name: String,
    /// Where its frames will lie.
    pub(crate) folder: PathBuf,
    /// The command line, without the program.
    pub(crate) arguments: Vec<OsString>,
    /// Frames.
    pub(crate) planned: u64,
}

/// Refuses a number of processes that makes no sense.
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

/// A process at work. It does not outlive this value.
struct Running<'a> {
    work: &'a Work,
    child: Child,
    /// Frames that were seen in its folder.
    frames: u64,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        // Both fail for one that has ended, which is as it should be.
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
        let child = Command::new(program)
            .args(&work.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        Ok(Self { work, child, frames: 0 })
    }

    /// Frames that are there by now.
    fn frames(&mut self) -> u64 {
        let frames = self.work.folder.join(FRAMES);
        while frames.join(format!("{:06}.png", self.frames)).exists() && self.frames < self.work.planned {
            self.frames += 1;
        }
        self.frames
    }

    /// Whether it has ended; an error when not well.
    fn ended(&mut self) -> Result<bool> {
        let name = &self.work.name;
        let status = self.child.try_wait().map_err(|e| Error::new(ErrorKind::Io, format!("{name}: {e}")))?;
        let Some(status) = status else { return Ok(false) };
        if status.success() {
            return Ok(true);
        }
        let mut words = String::new();
        if let Some(stderr) = self.child.stderr.take() {
            // What it said before it ended; that it cannot be read tells nothing more.
            let _ = stderr.take(MAX_WORDS).read_to_string(&mut words);
        }
        let said = words.lines().find_map(|line| line.strip_prefix("error: ")).unwrap_or_default();
        let kind = if status.code() == Some(2) { ErrorKind::InvalidArgument } else { ErrorKind::InvalidState };
        let cause = if said.is_empty() { format!("its process ended by itself: {status}") } else { said.to_owned() };
        Err(Error::new(kind, format!("{name}: {cause}"))
            .field(self.work.folder.display().to_string())
            .remedy("Run the same command again: what is whole is kept"))
    }
}

/// Makes all of `work`, `jobs` at a time. After a failure nothing new is begun, and what runs comes to its end.
///
/// # Errors
/// What a process fails with, with its name; `Cancelled` when `stop` was set.
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
        // The signal of the keyboard reaches them too; what ignores it is ended.
        if running.is_empty() || interrupted.is_some_and(|since| since.elapsed() > PATIENCE) {
            break;
        }
        let mut now = done;
        running.retain_mut(|process| match process.ended() {
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
        std::thread::sleep(EVERY);
    }
    progress.end();
    drop(running);
    match (failure, interrupted) {
        (Some(error), _) => Err(error),
        (None, Some(_)) => Err(Error::new(ErrorKind::Cancelled, "interrupted")),
        (None, None) => Ok(()),
    }
}
