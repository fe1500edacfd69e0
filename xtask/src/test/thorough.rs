//! Tests that take minutes: fuzzing, and the long soak.

use provision::{Console, tools};

use super::Context;
use super::cargo;
use super::tally::{Skip, Tally};
use crate::shell::Log;

/// Number of latents in the soaks.
const SOAK_LATENTS: &str = "2000";
const SOAK_FRAMES: &str = "10000";

/// The version of cargo-fuzz that runs the fuzz targets.
const CARGO_FUZZ_VERSION: &str = "0.13.2";

/// How long each fuzz target runs.
const FUZZ_SECONDS: u32 = 60;

pub(super) fn fuzz(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let files = context.workspace.files()?;
    let targets = files.iter().filter_map(|file| file.strip_prefix("fuzz/fuzz_targets/")?.strip_suffix(".rs"));
    let target = context.workspace.target.join("fuzz");
    tools::rust_component("clippy", "cargo-clippy", &Console::new()).map_err(|e| e.to_string())?;
    // The targets are a workspace of their own, whose dependencies clippy would check once more in every run.
    let mut clippy = context.workspace.cargo(["clippy", "--locked", "--manifest-path", cargo::FUZZ, "--all-targets"]);
    let ended = log.run(clippy.env("CARGO_TARGET_DIR", &target).args(["--", "-D", "warnings"]))?;
    let mut tally = Tally::default();
    tally.check((!ended.success).then(|| "a fuzz target does not compile, clippy has something to say, or fuzz/Cargo.lock is not that of its manifest".to_owned()));
    // libFuzzer's instrumentation needs the nightly compiler.
    let toolchain = match tools::nightly(&["rust-src"], &Console::new()) {
        Ok(toolchain) => toolchain,
        Err(e) => {
            tally.skips.extend(targets.map(|name| Skip { name: name.to_owned(), reason: e.to_string() }));
            return Ok(tally);
        }
    };
    let mut seeds = context.workspace.cargo(["run", "--manifest-path", cargo::FUZZ, "--example", "seeds"]);
    context.provide_worlds(seeds.env("CARGO_TARGET_DIR", &target))?;
    let ended = log.run(&mut seeds)?;
    tally.check((!ended.success).then(|| "the seed inputs could not be written".to_owned()));
    let program = tools::cargo_program("cargo-fuzz", CARGO_FUZZ_VERSION, &Console::new()).map_err(|e| e.to_string())?;
    for name in targets {
        let mut command = tools::rustup_run(toolchain);
        command.arg(&program).args(["run", name, "--", &format!("-max_total_time={FUZZ_SECONDS}")]);
        command.current_dir(&context.workspace.root).env("CARGO_TARGET_DIR", &target);
        context.provide_worlds(command.env("CAIRN_TEST_WORLD", context.bundle("tiny")?))?;
        let ended = log.run(&mut command)?;
        tally.test((!ended.success).then(|| format!("fuzz target {name} does not build, or an input broke it")));
    }
    Ok(tally)
}

pub(super) fn soak_latents(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    soak(context, log, "soak", "CAIRN_SOAK_LATENTS", SOAK_LATENTS)
}

pub(super) fn soak_frames(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    soak(context, log, "soak_frames", "CAIRN_SOAK_FRAMES", SOAK_FRAMES)
}

/// Runs the test program `name` with its `variable` at the long run's number.
fn soak(context: &Context<'_>, log: &mut Log, name: &str, variable: &str, number: &str) -> Result<Tally, String> {
    // The whole workspace is named so that the `cargo` runner's compiled code is reused.
    let mut command = context.workspace.cargo(["test", "--workspace", "--test", name]);
    context.provide_worlds(&mut command)?;
    Ok(cargo::count(&log.run(command.env(variable, number))?))
}
