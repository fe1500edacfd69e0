//! `cairn-check`: judges one machine for Cairn. Each check runs in a process of its own and gives a line with PASS, FAIL or CANNOT TELL;
//! docs/check.md describes the checks and the report.

mod checks;
mod child;
mod cli;
mod compare;
mod outcome;
mod page;
mod privacy;
mod report;
mod run;
mod settings;
mod verdict;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
