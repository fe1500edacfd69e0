//! Runs a command: its output goes to a log, its last line to the screen.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use provision::{Console, Progress};

/// The log of one runner.
pub(crate) struct Log {
    path: PathBuf,
    file: File,
    screen: Console,
}

/// How a command ended, and its output: stdout and stderr in the order they came.
pub(crate) struct CommandOutput {
    pub(crate) success: bool,
    pub(crate) output: String,
}

impl Log {
    /// A new log at `path`; `title` is shown while it is written.
    pub(crate) fn new(path: &Path, title: &str) -> Result<Self, String> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        }
        let file = File::create(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let screen = Console::new();
        screen.start(title);
        Ok(Self { path: path.to_owned(), file, screen })
    }

    /// Adds a line.
    pub(crate) fn line(&mut self, line: &str) -> Result<(), String> {
        writeln!(self.file, "{line}").map_err(|e| format!("{}: {e}", self.path.display()))
    }

    /// Runs `command` with an empty stdin until it ends.
    pub(crate) fn run(&mut self, command: &mut Command) -> Result<CommandOutput, String> {
        let command_line = show(command);
        self.line(&format!("$ {command_line}"))?;
        let failed = |e: std::io::Error| format!("{command_line} does not run: {e}");
        let (reader, writer) = std::io::pipe().map_err(failed)?;
        command.env("CARGO_TERM_COLOR", "never").env("CARGO_TERM_PROGRESS_WHEN", "never");
        command.stdin(Stdio::null()).stdout(writer.try_clone().map_err(failed)?).stderr(writer);
        let mut child = command.spawn().map_err(failed)?;
        // `command` would keep the pipe's write ends open, and the reader would never see its end.
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());

        let (sender, lines) = mpsc::channel::<String>();
        let reading = std::thread::spawn(move || {
            let mut reader = BufReader::new(reader);
            let mut bytes = Vec::new();
            while matches!(reader.read_until(b'\n', &mut bytes), Ok(n) if n > 0) {
                if sender.send(String::from_utf8_lossy(&bytes).into_owned()).is_err() {
                    return;
                }
                bytes.clear();
            }
        });
        let mut output = String::new();
        let mut last = String::new();
        loop {
            match lines.recv_timeout(Duration::from_millis(500)) {
                Ok(line) => {
                    if let Err(e) = self.file.write_all(line.as_bytes()) {
                        // Otherwise it would go on without a log.
                        _ = child.kill();
                        _ = child.wait();
                        return Err(format!("{}: {e}", self.path.display()));
                    }
                    output.push_str(&line);
                    last = line.trim().chars().take(80).collect();
                    self.screen.detail(&last);
                }
                Err(mpsc::RecvTimeoutError::Timeout) => self.screen.detail(&last),
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
        let status = child.wait().map_err(failed)?;
        if reading.join().is_err() {
            return Err(format!("{command_line}: its output could not be read"));
        }
        self.line(&format!("# {status}"))?;
        Ok(CommandOutput { success: status.success(), output })
    }

    /// Closes the log; `outcome` stays on the screen.
    pub(crate) fn end(self, outcome: &str) {
        self.screen.done(outcome);
    }
}

/// A command as a person would type it.
pub(crate) fn show(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let arguments = command.get_args().map(|argument| {
        let argument = argument.to_string_lossy();
        if argument.contains(char::is_whitespace) { format!("\"{argument}\"") } else { argument.into_owned() }
    });
    std::iter::once(program).chain(arguments).collect::<Vec<_>>().join(" ")
}

/// Runs a command with our own input and output, so that its progress bar is visible.
pub(crate) fn pass_through(command: &mut Command) -> Result<(), String> {
    let command_line = show(command);
    let status = command.status().map_err(|e| format!("{command_line} does not run: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("\"{command_line}\" ended with {status}")) }
}

/// A command's stdout; its stderr goes to the screen.
pub(crate) fn output(command: &mut Command) -> Result<String, String> {
    let command_line = show(command);
    let output = command.stderr(Stdio::inherit()).output().map_err(|e| format!("{command_line} does not run: {e}"))?;
    if !output.status.success() {
        return Err(format!("\"{command_line}\" ended with {}", output.status));
    }
    String::from_utf8(output.stdout).map_err(|_| format!("\"{command_line}\" printed what is not UTF-8"))
}
