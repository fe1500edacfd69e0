//! `study`: see `study --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    study::run(std::env::args_os())
}
