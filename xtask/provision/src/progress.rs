//! Reports to the caller what is being fetched.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::Instant;

/// Receives progress reports. One job at a time: `start`, any number of `detail`s, then `done` unless it failed.
pub trait Progress: Sync {
    /// A job begins, e.g. "fetching ONNX Runtime 1.24.4 from PyPI".
    fn start(&self, what: &str);
    /// Progress, a few times per second, e.g. "12.3 MB".
    fn detail(&self, detail: &str);
    /// The job has succeeded; `outcome` describes the result.
    fn done(&self, outcome: &str);
}

/// Reports nothing.
#[derive(Debug, Default, Clone, Copy)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _: &str) {}
    fn detail(&self, _: &str) {}
    fn done(&self, _: &str) {}
}

/// Writes to standard error: one line that is rewritten on a terminal, plain lines elsewhere.
#[derive(Debug, Default)]
pub struct Console {
    current: Mutex<Option<Job>>,
}

#[derive(Debug)]
struct Job {
    what: String,
    began: Instant,
    last_line: Instant,
}

/// Without a terminal an occasional log line suffices to show activity, and a log of an hour stays one that is read.
const LOG_EVERY_SECONDS: u64 = 60;

impl Console {
    /// A console without output yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn with_job(&self, act: impl FnOnce(&mut Option<Job>)) {
        // A poisoned lock only means that another thread died while printing; the text is still good.
        act(&mut self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
    }
}

impl Progress for Console {
    fn start(&self, what: &str) {
        self.with_job(|job| {
            let now = Instant::now();
            *job = Some(Job { what: what.to_owned(), began: now, last_line: now });
            if std::io::stderr().is_terminal() {
                eprint!("\r\x1b[K  {what} ...");
                // Progress is a courtesy: a closed stderr is no reason to stop the work.
                let _ = std::io::stderr().flush();
            } else {
                eprintln!("  {what} ...");
            }
        });
    }

    fn detail(&self, detail: &str) {
        self.with_job(|job| {
            let Some(job) = job else { return };
            let seconds = job.began.elapsed().as_secs();
            if std::io::stderr().is_terminal() {
                eprint!("\r\x1b[K  {} ... {detail}, {seconds} s", job.what);
                let _ = std::io::stderr().flush();
            } else if job.last_line.elapsed().as_secs() >= LOG_EVERY_SECONDS {
                job.last_line = Instant::now();
                eprintln!("    {seconds} s: {detail}");
            }
        });
    }

    fn done(&self, outcome: &str) {
        self.with_job(|job| {
            let clear = if std::io::stderr().is_terminal() { "\r\x1b[K" } else { "" };
            match job.take() {
                Some(job) => eprintln!("{clear}  {outcome} ({:.1} s)", job.began.elapsed().as_secs_f64()),
                None => eprintln!("{clear}  {outcome}"),
            }
        });
    }
}
