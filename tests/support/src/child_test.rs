//! Tests that run in a process of their own.

use std::process::{Command, Output};

/// Runs this program's test `name` alone in a process, whose command `with` changes.
///
/// # Panics
/// If the test fails or does not exist.
pub fn run_test(name: &str, with: impl FnOnce(&mut Command)) -> Output {
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--exact", name, "--nocapture"]);
    with(&mut command);
    let output = command.output().expect("a process");
    let text = [&output.stdout, &output.stderr].map(|part| String::from_utf8_lossy(part)).concat();
    assert!(output.status.success() && text.contains("1 passed"), "{name}: {text}");
    output
}
