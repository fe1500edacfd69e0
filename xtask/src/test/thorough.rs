//! What takes minutes by intention: fuzzing, and the long soak.

use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::cargo;
use super::tally::{Skip, Tally};
use crate::shell::Log;

/// How long the soaks are.
const SOAK_LATENTS: &str = "2000";
const SOAK_FRAMES: &str = "10000";

/// The cargo-fuzz that drives the fuzz targets.
const CARGO_FUZZ_VERSION: &str = "0.13.2";

/// How long each fuzz target runs.
const FUZZ_SECONDS: u32 = 60;

pub(super) fn fuzz(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let files = context.clone.files()?;
    let targets = files.iter().filter_map(|file| file.strip_prefix("fuzz/fuzz_targets/")?.strip_suffix(".rs"));
    let mut tally = Tally::default();
    // libFuzzer's instrumentation is a feature of the nightly compiler.
    let has_nightly = log.run(Command::new("rustup").args(["run", "nightly", "rustc", "--version"]));
    if !has_nightly.is_ok_and(|ended| ended.success) {
        let reason = "no nightly toolchain: rustup toolchain install nightly";
        tally.skips.extend(targets.map(|name| Skip { name: name.to_owned(), reason: reason.to_owned() }));
        return Ok(tally);
    }
    let program = tools::cargo_program("cargo-fuzz", CARGO_FUZZ_VERSION, &Console::new()).map_err(|e| e.to_string())?;
    for target in targets {
        let mut command = Command::new("rustup");
        command
            .args(["run", "nightly"])
            .arg(&program)
            .args(["run", target, "--", &format!("-max_total_time={FUZZ_SECONDS}")])
            .current_dir(&context.clone.root)
            // We run under the pinned toolchain's cargo, which would otherwise be inherited.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO")
            .env("CARGO_TARGET_DIR", context.clone.target.join("fuzz"));
        let ended = log.run(&mut command)?;
        tally.check((!ended.success).then(|| format!("fuzz target {target} does not build, or an input broke it")));
    }
    Ok(tally)
}

pub(super) fn soak(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // The whole workspace is named so that what the cargo runner compiled serves here.
    let mut command = context.clone.cargo(["test", "--workspace", "--test", "soak", "--test", "soak_frames"]);
    context.provide_worlds(&mut command)?;
    Ok(cargo::count(&log.run(command.env("CAIRN_SOAK_LATENTS", SOAK_LATENTS).env("CAIRN_SOAK_FRAMES", SOAK_FRAMES))?))
}
