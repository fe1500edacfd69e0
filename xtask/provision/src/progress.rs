//! Reports to the caller what is being fetched.

use std::io::{self, Write};
use std::sync::{LazyLock, Mutex};
use std::time::Instant;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

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

/// Writes to standard error: on a terminal a line for each job that runs, elsewhere plain lines.
#[derive(Debug, Default)]
pub struct Console {
    current: Mutex<Option<Job>>,
}

#[derive(Debug)]
struct Job {
    what: String,
    bar: ProgressBar,
    began: Instant,
    last_line: Instant,
}

/// The lines of all consoles of this process, whose jobs may run beside each other. Hidden where standard error is no terminal.
static LINES: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

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

    /// A line that stays.
    fn print(line: &str) {
        if LINES.is_hidden() {
            Self::print_plain(line);
        } else {
            _ = LINES.println(line);
        }
    }

    /// A line without a terminal. A closed stderr is no reason to stop the work, and `eprintln!` would panic.
    fn print_plain(line: &str) {
        _ = writeln!(io::stderr(), "{line}");
    }
}

impl Progress for Console {
    fn start(&self, what: &str) {
        self.with_job(|job| {
            let now = Instant::now();
            let bar = LINES.add(ProgressBar::new_spinner().with_prefix(what.to_owned()));
            if let Ok(style) = ProgressStyle::with_template("  {prefix} ... {elapsed} {wide_msg}") {
                bar.set_style(style);
            }
            bar.tick();
            if LINES.is_hidden() {
                Self::print_plain(&format!("  {what} ..."));
            }
            *job = Some(Job { what: what.to_owned(), bar, began: now, last_line: now });
        });
    }

    fn detail(&self, detail: &str) {
        self.with_job(|job| {
            let Some(job) = job else { return };
            job.bar.set_message(detail.to_owned());
            if LINES.is_hidden() && job.last_line.elapsed().as_secs() >= LOG_EVERY_SECONDS {
                job.last_line = Instant::now();
                // What a job is doing is told after a colon, and its line said it.
                let name = job.what.split(':').next().unwrap_or_default();
                Self::print_plain(&format!("    {name}, {} s: {detail}", job.began.elapsed().as_secs()));
            }
        });
    }

    fn done(&self, outcome: &str) {
        self.with_job(|job| match job.take() {
            Some(job) => {
                let seconds = job.began.elapsed().as_secs_f64();
                drop(job);
                Self::print(&format!("  {outcome} ({seconds:.1} s)"));
            }
            None => Self::print(&format!("  {outcome}")),
        });
    }
}

impl Drop for Job {
    /// A job that failed leaves no line behind its error.
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        LINES.remove(&self.bar);
    }
}
