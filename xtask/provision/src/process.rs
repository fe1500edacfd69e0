//! Runs another program, keeps its output and reports its progress.

use std::io::{BufRead, BufReader, Read};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::sync::mpsc;
use std::time::Duration;

/// A program's output and exit status.
pub(crate) struct ProcessOutput {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl ProcessOutput {
    /// The last `lines` lines of its output, standard error after standard output.
    pub(crate) fn tail(&self, lines: usize) -> String {
        let all: Vec<&str> =
            self.stdout.lines().chain(self.stderr.lines()).filter(|line| !line.trim().is_empty()).collect();
        all[all.len().saturating_sub(lines)..].join("\n")
    }
}

/// Runs `command` to its end without input. `tick` is called a few times per second with the last line it printed.
pub(crate) fn run(command: &mut Command, mut tick: impl FnMut(&str)) -> std::io::Result<ProcessOutput> {
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let last_line = Mutex::new(String::new());
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    let (finished, waiting) = mpsc::channel::<()>();
    let (stdout, stderr) = std::thread::scope(|scope| {
        let out = {
            let (last_line, finished) = (&last_line, finished.clone());
            scope.spawn(move || collect(stdout, last_line, finished))
        };
        let err = {
            let last_line = &last_line;
            scope.spawn(move || collect(stderr, last_line, finished))
        };
        // Ends when both streams are closed, which drops the senders.
        while let Err(mpsc::RecvTimeoutError::Timeout) | Ok(()) = waiting.recv_timeout(Duration::from_millis(250)) {
            let line = last_line.lock().map(|line| line.clone()).unwrap_or_default();
            tick(&line);
        }
        (out.join().unwrap_or_default(), err.join().unwrap_or_default())
    });
    Ok(ProcessOutput { status: child.wait()?, stdout, stderr })
}

fn collect(stream: Option<impl Read>, last_line: &Mutex<String>, _finished: mpsc::Sender<()>) -> String {
    let Some(stream) = stream else { return String::new() };
    let mut all = String::new();
    let mut reader = BufReader::new(stream);
    let mut bytes = Vec::new();
    while matches!(reader.read_until(b'\n', &mut bytes), Ok(n) if n > 0) {
        let line = String::from_utf8_lossy(&bytes);
        if let Ok(mut last) = last_line.lock() {
            line.trim().clone_into(&mut last);
        }
        all.push_str(&line);
        bytes.clear();
    }
    all
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn keeps_both_streams_and_the_status() {
        let outcome = run(Command::new("sh").args(["-c", "echo out; echo err >&2; exit 3"]), |_| {}).unwrap();
        assert_eq!(outcome.status.code(), Some(3));
        assert_eq!((outcome.stdout.as_str(), outcome.stderr.as_str()), ("out\n", "err\n"));
        assert_eq!(outcome.tail(1), "err");
    }
}
