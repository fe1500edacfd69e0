//! The Python tests: the bundle builder's own, and parity of the runtime with the oracle.

use std::fs;
use std::process::Command;

use super::Context;
use super::junit;
use super::tally::Tally;
use crate::shell::Log;

/// Where they lie.
const FOLDERS: [&str; 2] = ["bindings/python", "tests/parity"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // The parity tests drive a program of the workspace.
    context.build_programs(log)?;
    let report = context.clone.target.join("xtask").join("pytest.xml");
    match fs::remove_file(&report) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(format!("{}: {e}", report.display())),
        _ => {}
    }
    let mut command = Command::new(context.python()?);
    command
        .args(["-m", "pytest", "-p", "no:cacheprovider", "-ra", "--junitxml"])
        .arg(&report)
        .args(FOLDERS)
        .current_dir(&context.clone.root)
        .env("PYTHONPATH", provision::python_path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("CAIRN_PARITY_TRACE", context.clone.program("debug", "parity"));
    context.provide_worlds(&mut command)?;
    let ended = log.run(&mut command)?;
    let xml = fs::read_to_string(&report).map_err(|e| format!("pytest left no report: {e}"))?;
    let mut tally = junit::read(&xml)?;
    if !ended.success && tally.failures.is_empty() {
        tally.failures.push("pytest failed outside of a test".to_owned());
    }
    Ok(tally)
}
