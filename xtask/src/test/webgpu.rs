//! Worlds on ONNX Runtime's WebGPU provider, in the lab, on its software Vulkan driver: tests of their own, saved states, and parity with the
//! oracle.

use std::process::Command;

use super::tally::{Skip, Tally};
use super::{Context, cargo, lab, python};
use crate::shell::Log;

/// Tests of saved states that also run in every test of DirectML.
const STATES: [&str; 2] =
    ["a_restored_rollout_continues_bit_for_bit", "a_state_continues_bit_for_bit_in_another_process"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    if cfg!(windows) {
        let reason = "the tests are for Linux, where the lab emulates an adapter".to_owned();
        return Ok(Tally { skips: vec![Skip { name: "worlds on WebGPU".to_owned(), reason }], ..Tally::default() });
    }
    if let Some(skip) = lab::skip_unless_possible("worlds on WebGPU")? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let mut tally = tests(context, log, "webgpu", &[])?;
    tally.add(tests(context, log, "rollout_state", &STATES)?);
    tally.add(parity(context, log)?);
    Ok(tally)
}

/// Runs a test program of the library on the adapter, or some of its tests. One at a time, as each has worlds of its own in the memory of an
/// adapter that the processor emulates.
fn tests(context: &Context<'_>, log: &mut Log, program: &str, chosen: &[&str]) -> Result<Tally, String> {
    // Of the whole workspace, as in the runner `build`, so that no package is compiled again with other features.
    let mut command = context.workspace.cargo(["test", "--workspace", "--test", program]);
    lab::run_in_lab(&mut command, &cargo::host()?)?;
    context.provide_webgpu_worlds(&mut command)?;
    command.args(["--", "--test-threads=1"]);
    if !chosen.is_empty() {
        command.arg("--exact").args(chosen).env("CAIRN_TEST_SHORT", "1").env("CAIRN_TEST_DEVICE", "webgpu");
    }
    Ok(cargo::count(&log.run(&mut command)?))
}

/// Compares short rollouts with a recomputation of the whole history.
fn parity(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let build = ["build", "--workspace", "--bin", "parity-trace"];
    log.run(&mut context.workspace.cargo(build))?;
    let mut command = Command::new(context.python()?);
    command.env("PYTHONPATH", provision::python_path()).env("PARITY_DEVICE", "webgpu").env("PARITY_CASES", "short");
    command.env("PARITY_TRACE", context.workspace.target.join("debug").join("parity-trace"));
    let runner = lab::lab_run()?;
    let words: Vec<_> = std::iter::once(runner.get_program()).chain(runner.get_args()).collect();
    command.env("PARITY_RUNNER", words.join(" ".as_ref()));
    context.provide_webgpu_worlds(&mut command)?;
    // The first latents see little of the past, so these tests need more of them.
    let chosen = ["test_rollout.py", "-k", "not real_windows and not past_carries"];
    python::pytest(context, log, command, "tests/parity", ("parity-webgpu", &chosen))
}
