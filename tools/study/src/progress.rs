//! Progress output: a bar on a terminal, otherwise a line now and then.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::{Error, ErrorKind, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Interval between two lines without a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Prints progress to standard error.
pub struct Progress {
    style: Style,
    fetching: provision::Console,
}

enum Style {
    Quiet,
    Bar(ProgressBar),
    Lines(Mutex<Lines>),
}

struct Lines {
    total: Option<u64>,
    began: Instant,
    printed: Instant,
}

impl Progress {
    /// Prints nothing.
    pub fn quiet() -> Self {
        Self { style: Style::Quiet, fetching: provision::Console::new() }
    }

    /// A bar if standard error is a terminal, otherwise lines.
    pub fn console() -> Self {
        let style = if std::io::stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            bar.set_style(spinner());
            Style::Bar(bar)
        } else {
            let now = Instant::now();
            Style::Lines(Mutex::new(Lines { total: None, began: now, printed: now }))
        };
        Self { style, fetching: provision::Console::new() }
    }

    /// Prints the current phase before the first frame.
    pub fn phase(&self, what: &str) {
        match &self.style {
            Style::Quiet => {}
            Style::Bar(bar) => {
                bar.set_message(what.to_owned());
                bar.enable_steady_tick(Duration::from_millis(120));
            }
            Style::Lines(_) => eprintln!("{what} ..."),
        }
    }

    /// Starts counting frames, `total` of them if known.
    pub(crate) fn begin(&self, total: impl Into<Option<u64>>) {
        let total = total.into();
        match &self.style {
            Style::Quiet => {}
            Style::Bar(bar) => {
                bar.disable_steady_tick();
                bar.reset();
                match total {
                    Some(total) => bar.set_length(total),
                    None => bar.unset_length(),
                }
                bar.set_style(if total.is_some() { frames() } else { frames_without_end() });
                bar.set_message("");
            }
            Style::Lines(lines) => {
                let now = Instant::now();
                *lock(lines) = Lines { total, began: now, printed: now };
            }
        }
    }

    /// Sets the number of frames that are done.
    pub(crate) fn frames(&self, done: u64) {
        match &self.style {
            Style::Quiet => {}
            Style::Bar(bar) => bar.set_position(done),
            Style::Lines(lines) => {
                let mut lines = lock(lines);
                if lines.printed.elapsed() >= LINE_INTERVAL {
                    lines.printed = Instant::now();
                    eprintln!("{}", line(done, lines.total, lines.began.elapsed()));
                }
            }
        }
    }

    /// Runs `step` for each of `total` frames, with their count.
    ///
    /// # Errors
    /// The first error of `step`; `Cancelled` when `stop` was set.
    pub(crate) fn each_frame(
        &self,
        total: u64,
        stop: &AtomicBool,
        mut step: impl FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        self.begin(total);
        let done = (0..total).try_for_each(|number| {
            check_stop(stop)?;
            step(number)?;
            self.frames(number + 1);
            Ok(())
        });
        self.end();
        done
    }

    /// Removes the bar.
    pub(crate) fn end(&self) {
        if let Style::Bar(bar) = &self.style {
            bar.finish_and_clear();
        }
    }
}

impl provision::Progress for Progress {
    fn start(&self, what: &str) {
        if !matches!(self.style, Style::Quiet) {
            self.fetching.start(what);
        }
    }

    fn detail(&self, detail: &str) {
        if !matches!(self.style, Style::Quiet) {
            self.fetching.detail(detail);
        }
    }

    fn done(&self, outcome: &str) {
        if !matches!(self.style, Style::Quiet) {
            self.fetching.done(outcome);
        }
    }
}

/// Fails with `Cancelled` when `stop` is set.
pub(crate) fn check_stop(stop: &AtomicBool) -> Result<()> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::new(ErrorKind::Cancelled, "interrupted"));
    }
    Ok(())
}

/// A poisoned lock only means that another thread panicked while printing.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn spinner() -> ProgressStyle {
    ProgressStyle::with_template("{spinner} {msg} ({elapsed})").unwrap_or_else(|_| ProgressStyle::default_spinner())
}

fn frames() -> ProgressStyle {
    ProgressStyle::with_template("{bar:30.cyan/dim} frame {pos} of {len}  {per_sec}  {eta} left{msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn frames_without_end() -> ProgressStyle {
    ProgressStyle::with_template("{spinner} frame {pos}  {per_sec}")
        .unwrap_or_else(|_| ProgressStyle::default_spinner())
}

fn line(done: u64, total: Option<u64>, elapsed: Duration) -> String {
    let rate = done as f64 / elapsed.as_secs_f64().max(1e-3);
    let Some(total) = total else { return format!("frame {done}, {rate:.2} per second") };
    let left = if done == 0 {
        "time left not known yet".to_owned()
    } else {
        format!("about {} left", duration((total.saturating_sub(done)) as f64 / rate.max(1e-6)))
    };
    format!("frame {done} of {total}, {rate:.2} per second, {left}")
}

/// `95` as `1 min 35 s`.
pub(crate) fn duration(seconds: f64) -> String {
    let whole = seconds.round().clamp(0.0, 1e9) as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_end_with_an_error_or_when_stopped() {
        let stop = AtomicBool::new(false);
        let mut frames = Vec::new();
        let done = Progress::quiet().each_frame(9, &stop, |number| {
            frames.push(number);
            stop.store(number == 2, Ordering::Relaxed);
            Ok(())
        });
        assert_eq!((done.unwrap_err().kind(), frames), (ErrorKind::Cancelled, vec![0, 1, 2]));
        let error = || Error::new(ErrorKind::Io, "full");
        let done =
            Progress::quiet().each_frame(9, &AtomicBool::new(false), |n| if n == 1 { Err(error()) } else { Ok(()) });
        assert_eq!(done.unwrap_err().kind(), ErrorKind::Io);
        Progress::quiet().each_frame(3, &AtomicBool::new(false), |_| Ok(())).unwrap();
    }

    #[test]
    fn lines_tell_rate_and_time_left() {
        let text = line(30, Some(121), Duration::from_secs(10));
        assert_eq!(text, "frame 30 of 121, 3.00 per second, about 30 s left");
        assert!(line(0, Some(121), Duration::from_secs(10)).ends_with("not known yet"));
        assert_eq!(line(30, None, Duration::from_secs(10)), "frame 30, 3.00 per second");
        assert_eq!((duration(95.2), duration(7_260.0)), ("1 min 35 s".into(), "2 h 1 min".into()));
    }
}
