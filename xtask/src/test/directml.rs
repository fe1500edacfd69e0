//! Worlds on DirectML, in the lab or on Windows, held to what worlds on the processor are held to: parity with the oracle, and
//! saved states that go on to the bit. A short form in every run, all of it with `--thorough`.

use std::process::Command;

use super::tally::Tally;
use super::{Context, cargo, lab, python};
use crate::shell::Log;

/// What cargo is told to build: all in one command, so that nothing is compiled a second time for another choice of features.
const PACKAGES: [&str; 4] = ["--package", "cairn", "--package", "parity-trace"];
const STATES: &str = "rollout_state";
const TRACE: &str = "parity-trace";

/// The tests of the short form that load no world besides their own: each world is gigabytes where a processor plays the device.
const SHORT: [&str; 2] = ["a_restored_rollout_continues", "in_another_process"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    all(context, log, true)
}

pub(super) fn run_longer(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    all(context, log, false)
}

fn all(context: &Context<'_>, log: &mut Log, is_short: bool) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::or_skip("parity and saved states on DirectML")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    let mut build = context.clone.cargo(["build"]);
    build.args(PACKAGES).args(["--bin", TRACE, "--test", STATES]);
    lab::for_windows(&mut build)?;
    if !log.run(&mut build)?.success {
        return Ok(Tally::broken("the programs do not build for Windows"));
    }
    tally.add(states(context, log, is_short)?);
    tally.add(parity(context, log, is_short)?);
    Ok(tally)
}

/// Saved states. One test at a time, as each has worlds of its own.
fn states(context: &Context<'_>, log: &mut Log, is_short: bool) -> Result<Tally, String> {
    let mut command = context.clone.cargo(["test", "--no-fail-fast"]);
    command.args(PACKAGES).args(["--test", STATES]);
    lab::for_windows(&mut command)?;
    command.args(["--", "--test-threads=1"]);
    if is_short {
        command.args(SHORT).env("CAIRN_TEST_SHORT", "1");
    }
    context.provide_windows_worlds(command.env("CAIRN_TEST_DEVICE", "d3d12"))?;
    Ok(cargo::count(&log.run(&mut command)?))
}

/// Rollouts against the whole history recomputed.
fn parity(context: &Context<'_>, log: &mut Log, is_short: bool) -> Result<Tally, String> {
    let mut command = Command::new(context.python()?);
    command.env("PYTHONPATH", provision::python_path()).env("PARITY_DEVICE", "d3d12");
    let target = &context.clone.target;
    let folder = if cfg!(windows) { target.clone() } else { target.join(provision::tools::WINDOWS_TARGET) };
    command.env("PARITY_TRACE", folder.join("debug").join(format!("{TRACE}.exe")));
    if !cfg!(windows) {
        let runner = lab::lab_run()?;
        let words: Vec<_> = std::iter::once(runner.get_program()).chain(runner.get_args()).collect();
        command.env("PARITY_RUNNER", words.join(" ".as_ref()));
    }
    context.provide_windows_worlds(&mut command)?;
    // Whether a faulty world is told from a good one is a question to the comparison, which is the same for every device.
    let chosen: &[&str] = if is_short {
        command.env("PARITY_CASES", "short");
        // The first latents see little of the past.
        &["test_rollout.py", "-k", "not real_windows and not past_carries"]
    } else {
        &["test_rollout.py"]
    };
    python::pytest(context, log, command, "tests/parity", ("parity-directml", chosen))
}
