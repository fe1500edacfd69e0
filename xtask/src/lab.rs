//! `cargo xtask lab`: Windows programs on this machine.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus};

use provision::lab::Lab;
use provision::{Console, Progress};

/// Builds the lab where it is missing, and says where it is.
pub(crate) fn build() -> Result<(), String> {
    let console = Console::new();
    let lab = provision::lab::lab(&console).map_err(|e| e.to_string())?;
    console.done(&format!("the lab is there: {}", lab.place().display()));
    Ok(())
}

/// Runs a Windows program with our own streams, in the lab or, on Windows, as it is; gives its exit status.
pub(crate) fn run(program: &Path, arguments: &[OsString]) -> Result<ExitCode, String> {
    let mut command = command(program)?;
    let status = command.args(arguments).status().map_err(|e| format!("{}: {e}", program.display()))?;
    Lab::tidy();
    Ok(ExitCode::from(code(status)))
}

/// A command that runs a Windows program, wherever we are.
pub(crate) fn command(program: &Path) -> Result<Command, String> {
    if cfg!(windows) {
        return Ok(Command::new(program));
    }
    provision::lab::lab(&Console::new()).and_then(|lab| lab.command(program)).map_err(|e| e.to_string())
}

/// The exit status as a process can hand it on: what does not fit into eight bits is still not 0.
fn code(status: ExitStatus) -> u8 {
    let low = |code: i32| code.to_le_bytes()[0];
    match status.code() {
        Some(0) => 0,
        Some(code) => low(code).max(1),
        // A signal ended it.
        None => 1,
    }
}
