//! `cargo xtask lab`: runs Windows programs, and Linux programs that need Vulkan, on this machine.

use std::ffi::OsString;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus};
use std::sync::mpsc::channel;
use std::time::Duration;

use provision::{Console, Progress};

/// Builds the lab if it is missing, and prints where it is.
pub(crate) fn build() -> Result<(), String> {
    let console = Console::new();
    let lab = provision::lab::lab(&console).map_err(|e| e.to_string())?;
    console.done(&format!("the lab is there: {}", lab.folder().display()));
    Ok(())
}

/// The exit status after Ctrl-C, as shells have it.
const INTERRUPTED: u8 = 130;

/// Interval at which the program's exit is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Runs a program with our own streams, in the lab or natively on Windows; returns its exit status. Ctrl-C ends the program and all
/// that it started.
pub(crate) fn run(program: &Path, arguments: &[OsString]) -> Result<ExitCode, String> {
    let mut command = command(program)?;
    let failed = |e: std::io::Error| format!("{}: {e}", program.display());
    let (interrupt, interrupted) = channel();
    ctrlc::set_handler(move || _ = interrupt.send(())).map_err(|e| format!("Ctrl-C cannot be heard: {e}"))?;
    let mut child = command.args(arguments).spawn().map_err(failed)?;
    let status = loop {
        let ended = child.try_wait().map_err(failed)?;
        if interrupted.recv_timeout(POLL_INTERVAL).is_ok() {
            // A terminal sends Ctrl-C to the program as well, so it may already have ended.
            _ = child.kill();
            child.wait().map_err(failed)?;
            break INTERRUPTED;
        }
        if let Some(status) = ended {
            break code(status);
        }
    };
    Ok(ExitCode::from(status))
}

/// A command that runs a program, in the lab or natively on Windows.
pub(crate) fn command(program: &Path) -> Result<Command, String> {
    if cfg!(windows) {
        return Ok(Command::new(program));
    }
    let lab = provision::lab::lab(&Console::new()).map_err(|e| e.to_string())?;
    let command = if is_elf(program) { lab.linux_command(program) } else { lab.command(program) };
    command.map_err(|e| e.to_string())
}

/// Whether a file is a Linux program. One that cannot be read is not.
fn is_elf(program: &Path) -> bool {
    let mut start = [0; 4];
    File::open(program).and_then(|mut file| file.read_exact(&mut start)).is_ok_and(|()| start == *b"\x7fELF")
}

/// The exit status in eight bits: any failure stays different from 0.
fn code(status: ExitStatus) -> u8 {
    let low = |code: i32| code.to_le_bytes()[0];
    match status.code() {
        Some(0) => 0,
        Some(code) => low(code).max(1),
        // A signal ended it.
        None => 1,
    }
}
