//! Worlds on DirectML, in the lab or on Windows, pass the same tests as worlds on the processor: parity with the oracle, bit-exact
//! continuation of saved states, budgets, the check that float16 is enough, and joined passes. By default a
//! short selection runs, with `--thorough` everything.

use std::process::Command;

use super::amd::Amd;
use super::tally::Tally;
use super::{Context, lab, python, windows_build};
use crate::shell::Log;

const STATES: &str = "rollout_state";
const BUDGETS: &str = "rollout_budget";
const HALF_PRECISION: &str = "half_precision";
const JOINED: &str = "joined";
const TRACE: &str = "parity-trace";

/// The short form's tests that load no world of their own: each world takes gigabytes if the processor emulates the device.
const SHORT_STATES: [&str; 2] =
    ["a_restored_rollout_continues_bit_for_bit", "a_state_continues_bit_for_bit_in_another_process"];
/// Tests whose result only a device can give: whether its memory is moved correctly, and what its clock measures.
const SHORT_BUDGETS: [&str; 2] = [
    "a_narrower_window_sees_the_newest_latents_and_a_wider_one_forgets_none",
    "latent_times_come_from_the_devices_clock",
];

/// That a value passes float16's largest number depends on the device: a processor adds float16 in float32.
const SHORT_HALF_PRECISION: [&str; 1] = ["sums_that_pass_float16_are_named_and_float32_mends_them"];

/// In float16 both graphs use the same weights on the device.
const SHORT_JOINED: [&str; 2] =
    ["joined_passes_give_the_latents_of_separate_ones", "half_precision_is_as_near_as_a_single_pass"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if !skip(&mut tally)? {
        context.build_for_windows(log)?;
        context.with_and_without_amd(&mut tally, |amd| {
            let mut tally = tests(context, log, STATES, Some(&SHORT_STATES), amd)?;
            tally.add(tests(context, log, BUDGETS, Some(&SHORT_BUDGETS), amd)?);
            tally.add(tests(context, log, HALF_PRECISION, Some(&SHORT_HALF_PRECISION), amd)?);
            tally.add(tests(context, log, JOINED, Some(&SHORT_JOINED), amd)?);
            tally.add(parity(context, log, true, amd)?);
            Ok(tally)
        })?;
    }
    Ok(tally)
}

/// All tests of saved states, and of joined passes.
pub(super) fn run_states(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_longer(context, log, |log, amd| {
        let mut tally = tests(context, log, STATES, None, amd)?;
        tally.add(tests(context, log, JOINED, None, amd)?);
        Ok(tally)
    })
}

/// All tests of budgets, and of the check that float16 is enough.
pub(super) fn run_budgets(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_longer(context, log, |log, amd| {
        let mut tally = tests(context, log, BUDGETS, None, amd)?;
        tally.add(tests(context, log, HALF_PRECISION, None, amd)?);
        Ok(tally)
    })
}

/// All rollouts of the comparison with the oracle.
pub(super) fn run_parity(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_longer(context, log, |log, amd| parity(context, log, false, amd))
}

fn run_longer(
    context: &Context<'_>,
    log: &mut Log,
    mut run: impl FnMut(&mut Log, &Amd) -> Result<Tally, String>,
) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if !skip(&mut tally)? {
        context.build_for_windows(log)?;
        context.with_and_without_amd(&mut tally, |amd| run(log, amd))?;
    }
    Ok(tally)
}

/// Adds a skip if this machine cannot have the lab. Returns whether it did.
fn skip(tally: &mut Tally) -> Result<bool, String> {
    let skip = lab::skip_unless_possible("parity and saved states on DirectML")?;
    tally.skips.extend(skip);
    Ok(!tally.skips.is_empty())
}

/// Runs a test program of the library, or some of its tests for the short form. One at a time, as each has worlds of its own.
fn tests(context: &Context<'_>, log: &mut Log, name: &str, short: Option<&[&str]>, amd: &Amd) -> Result<Tally, String> {
    let mut command = context.windows_tests([name], log)?;
    command.args(["--", "--test-threads=1"]);
    if let Some(short) = short {
        command.arg("--exact").args(short).env("CAIRN_TEST_SHORT", "1");
    }
    context.provide_windows_worlds(command.env("CAIRN_TEST_DEVICE", "d3d12"))?;
    amd.provide(&mut command);
    windows_build::run(&mut command, short.unwrap_or_default(), log)
}

/// Compares rollouts with a recomputation of the whole history.
fn parity(context: &Context<'_>, log: &mut Log, is_short: bool, amd: &Amd) -> Result<Tally, String> {
    let mut command = Command::new(context.python()?);
    command.env("PYTHONPATH", provision::python_path()).env("PARITY_DEVICE", "d3d12");
    let target = &context.workspace.target;
    let folder = if cfg!(windows) { target.clone() } else { target.join(provision::tools::WINDOWS_TARGET) };
    command.env("PARITY_TRACE", folder.join("debug").join(format!("{TRACE}.exe")));
    if !cfg!(windows) {
        let runner = lab::lab_run()?;
        let words: Vec<_> = std::iter::once(runner.get_program()).chain(runner.get_args()).collect();
        command.env("PARITY_RUNNER", words.join(" ".as_ref()));
    }
    context.provide_windows_worlds(&mut command)?;
    amd.provide(&mut command);
    // Whether the comparison detects faulty worlds does not depend on the device, so it is not tested here.
    let chosen: &[&str] = if is_short {
        command.env("PARITY_CASES", "short");
        // The first latents see little of the past, so these tests need more of them.
        &["test_rollout.py", "-k", "not real_windows and not past_carries"]
    } else {
        &["test_rollout.py"]
    };
    python::pytest(context, log, command, "tests/parity", ("parity-directml", chosen))
}
