//! Judges a graphics adapter for Cairn: what is there, whether results on it are right, and how long they take. `docs/check.md` is its manual.
//!
//! [`checks::ALL`] lists the checks. The program runs each in a process of its own ([`runner`]), so that one that crashes or hangs is a line of
//! the report and not its end. [`report`] is the report, [`page`] its HTML, and [`compare`] holds two of them against each other.
#![warn(missing_docs)]

pub mod checks;
mod cli;
pub mod compare;
pub mod finding;
pub mod hardware;
pub mod page;
pub mod privacy;
pub mod report;
pub mod runner;
mod summary;

use std::process::ExitCode;

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    cli::run(std::env::args_os())
}

pub use cli::{run, run_as};
