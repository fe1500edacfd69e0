//! Worlds on ONNX Runtime's WebGPU provider, in the lab, on its software Vulkan driver: tests of their own, the tests that worlds on other
//! devices pass, and parity with the oracle. By default a short selection runs, with `--thorough` everything.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use provision::Console;

use super::tally::{Skip, Tally};
use super::{Context, abi, cargo, lab, python, windows_build};
use crate::shell::Log;

/// Test programs for worlds on any device, and the tests of each that are in every run.
const SHORT: [(&str, &[&str]); 2] = [
    (
        "rollout_state",
        &["a_restored_rollout_continues_bit_for_bit", "a_state_continues_bit_for_bit_in_another_process"],
    ),
    ("rollout_budget", &["a_narrower_window_sees_the_newest_latents_and_a_wider_one_forgets_none"]),
];

/// The programs whose tests all run with `--thorough`.
const PROGRAMS: [&str; 8] = [
    "rollout",
    "rollout_budget",
    "rollout_refusals",
    "rollout_state",
    "slices",
    "joined",
    "half_precision",
    "quantised_worlds",
];

/// Those of them that also run as Windows programs.
const PROGRAMS_ON_WINDOWS: [&str; 3] = ["rollout_budget", "rollout_state", "half_precision"];

/// Latents of the soak.
const SOAK_LATENTS: &str = "500";

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    if let Some(skip) = skip()? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    // A driver's double among them, which a test loads.
    context.build_programs(log)?;
    let mut tally = tests(context, log, "webgpu", |_| ())?;
    for (program, chosen) in SHORT {
        tally.add(worlds(context, log, program, |command| {
            command.arg("--exact").args(chosen).env("CAIRN_TEST_SHORT", "1");
        })?);
    }
    tally.add(parity(context, log, true)?);
    Ok(tally)
}

/// The thorough form: all tests of worlds on any device, the soak, the Windows programs, states exchanged with DirectML, faults of the C layer, and all of
/// the comparison with the oracle. The tests of WebGPU alone are in the short form only.
pub(super) fn run_thorough(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    if let Some(skip) = skip()? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let mut tally = Tally::default();
    for program in PROGRAMS {
        tally.add(worlds(context, log, program, |_| ())?);
    }
    tally.add(worlds(context, log, "soak", |command| {
        command.env("CAIRN_SOAK_LATENTS", SOAK_LATENTS);
    })?);
    for program in PROGRAMS_ON_WINDOWS {
        tally.add(on_windows(context, log, program, |_| ())?);
    }
    tally.add(exchanged_states(context, log)?);
    tally.add(abi::run_faults_on_webgpu(context, log)?);
    tally.add(parity(context, log, false)?);
    Ok(tally)
}

/// Saved states of the processor, WebGPU and DirectML go on on the two others.
fn exchanged_states(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    const PROGRAM: &str = "exchanged_states";
    const VARIABLE: &str = "CAIRN_EXCHANGED_STATES";
    // Not a temporary folder of the system: the lab has its own.
    let folder = tempfile::tempdir_in(&context.workspace.target).map_err(|e| format!("a folder for states: {e}"))?;
    let mut tally = Tally::default();
    // The first two come again, to continue the states of those after them.
    for device in ["cpu", "webgpu", "webgpu on Windows", "d3d12", "cpu", "webgpu"] {
        let more = |command: &mut Command| {
            command.arg("--nocapture").env(VARIABLE, folder.path());
        };
        tally.add(match device {
            "webgpu on Windows" => on_windows(context, log, PROGRAM, more)?,
            "d3d12" => {
                let mut command = context.windows_tests([PROGRAM], log)?;
                more(command.arg("--").env("CAIRN_TEST_DEVICE", device));
                context.provide_windows_worlds(&mut command)?;
                windows_build::run(&mut command, &[], log)?
            }
            _ => tests(context, log, PROGRAM, |command| more(command.env("CAIRN_TEST_DEVICE", device)))?,
        });
    }
    // Each run continues all states that it finds.
    for state in ["cpu-linux", "webgpu-linux", "webgpu-windows", "directml-windows"] {
        let is_there = folder.path().join(state).with_extension("state").is_file();
        tally.check((!is_there).then(|| format!("no run of {PROGRAM} has left a state of {state}")));
    }
    Ok(tally)
}

/// Runs a test program for worlds on any device as a Windows program, on the WebGPU provider. It uses Vulkan there, since the lab's Direct3D 12
/// shares no fences, which the provider's Direct3D 12 needs.
fn on_windows(
    context: &Context<'_>,
    log: &mut Log,
    program: &str,
    more: impl FnOnce(&mut Command),
) -> Result<Tally, String> {
    let mut command = context.windows_tests([program], log)?;
    more(command.args(["--", "--test-threads=1"]).env("CAIRN_TEST_DEVICE", "webgpu"));
    context.provide_windows_worlds(&mut command)?;
    command.env("CAIRN_ONNXRUNTIME", lab::windows_path(&windows_runtime(context)?));
    windows_build::run(&mut command, &[], log)
}

/// ONNX Runtime for Windows in a folder with the provider's library and Vulkan's loader, where the library finds it.
fn windows_runtime(context: &Context<'_>) -> Result<PathBuf, String> {
    let console = Console::new();
    let library = provision::onnxruntime_with_webgpu_for_windows(&console).map_err(|e| e.to_string())?;
    let lab = provision::lab::lab(&console).map_err(|e| e.to_string())?;
    let loader = lab.folder().join("root/windows/drive_c/windows/system32/vulkan-1.dll");
    let folder = context.workspace.target.join("webgpu-windows");
    let copy = || -> std::io::Result<PathBuf> {
        fs::create_dir_all(&folder)?;
        let mut files = vec![loader.clone()];
        for file in library.parent().expect("a folder").read_dir()? {
            files.push(file?.path());
        }
        for file in &files {
            fs::copy(file, folder.join(file.file_name().expect("a file")))?;
        }
        Ok(folder.join(library.file_name().expect("a file")))
    };
    copy().map_err(|e| format!("{}: {e}", folder.display()))
}

/// Why this machine cannot run them.
fn skip() -> Result<Option<Skip>, String> {
    if cfg!(windows) {
        let reason = "the tests are for Linux, where the lab emulates an adapter".to_owned();
        return Ok(Some(Skip { name: "worlds on WebGPU".to_owned(), reason }));
    }
    lab::skip_unless_possible("worlds on WebGPU")
}

/// Runs a test program of the library on the adapter, with more arguments or variables. One test at a time, as each has worlds of its own in
/// the memory of an adapter that the processor emulates.
fn tests(
    context: &Context<'_>,
    log: &mut Log,
    program: &str,
    more: impl FnOnce(&mut Command),
) -> Result<Tally, String> {
    // Of the whole workspace, as in the runner `build`, so that no package is compiled again with other features.
    let mut command = context.workspace.cargo(["test", "--workspace", "--test", program]);
    lab::run_in_lab(&mut command, &cargo::host()?)?;
    context.provide_webgpu_worlds(&mut command)?;
    command.args(["--", "--test-threads=1"]);
    more(&mut command);
    Ok(cargo::count(&log.run(&mut command)?))
}

/// Runs a test program for worlds on any device.
fn worlds(
    context: &Context<'_>,
    log: &mut Log,
    program: &str,
    more: impl FnOnce(&mut Command),
) -> Result<Tally, String> {
    tests(context, log, program, |command| {
        command.env("CAIRN_TEST_DEVICE", "webgpu");
        more(command);
    })
}

/// Compares rollouts with a recomputation of the whole history; the short form compares short ones.
fn parity(context: &Context<'_>, log: &mut Log, is_short: bool) -> Result<Tally, String> {
    let build = ["build", "--workspace", "--bin", "parity-trace"];
    if !log.run(&mut context.workspace.cargo(build))?.success {
        return Err("parity-trace does not build".to_owned());
    }
    let mut command = Command::new(context.python()?);
    command.env("PYTHONPATH", provision::python_path()).env("PARITY_DEVICE", "webgpu");
    command.env("PARITY_TRACE", context.workspace.target.join("debug").join("parity-trace"));
    let runner = lab::lab_run()?;
    let words: Vec<_> = std::iter::once(runner.get_program()).chain(runner.get_args()).collect();
    command.env("PARITY_RUNNER", words.join(" ".as_ref()));
    context.provide_webgpu_worlds(&mut command)?;
    let chosen: &[&str] = if is_short {
        command.env("PARITY_CASES", "short");
        // The first latents see little of the past, so these tests need more of them.
        &["test_rollout.py", "-k", "not real_windows and not past_carries"]
    } else {
        &["test_rollout.py"]
    };
    python::pytest(context, log, command, "tests/parity", ("parity-webgpu", chosen))
}
