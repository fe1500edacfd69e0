//! `cairn-check`: judges a graphics adapter for Cairn.

use std::process::ExitCode;

fn main() -> ExitCode {
    cairn_check::main()
}
