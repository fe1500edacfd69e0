//! What takes minutes by intention: fuzzing, and the long soak.

use std::process::Command;

use super::Context;
use super::cargo;
use super::tally::{Skip, Tally};
use crate::shell::Log;

/// How long the soak is.
const SOAK_LATENTS: &str = "2000";

/// How long each fuzz target runs.
const FUZZ_SECONDS: u32 = 60;

pub(super) fn fuzz(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let files = context.clone.files()?;
    let targets = files.iter().filter_map(|file| file.strip_prefix("fuzz/fuzz_targets/")?.strip_suffix(".rs"));
    let mut probe = Command::new("cargo");
    probe.args(["+nightly", "fuzz", "--version"]).current_dir(&context.clone.root).env_remove("RUSTUP_TOOLCHAIN");
    let there = log.run(&mut probe).is_ok_and(|ended| ended.success);
    if there {
        // Valid inputs to start from; from nothing, a minute would hardly get past the first check.
        let mut seeds = context.clone.cargo(["run", "--manifest-path", "fuzz/Cargo.toml", "--example", "seeds"]);
        log.run(&mut seeds)?;
    }
    let mut tally = Tally::default();
    for target in targets {
        if !there {
            let reason =
                "no nightly toolchain with cargo-fuzz: rustup toolchain install nightly; cargo install cargo-fuzz";
            tally.skips.push(Skip { name: target.to_owned(), reason: reason.to_owned() });
            continue;
        }
        let mut command = Command::new("cargo");
        command
            .args(["+nightly", "fuzz", "run", target, "--"])
            .arg(format!("-max_total_time={FUZZ_SECONDS}"))
            .current_dir(&context.clone.root)
            // We run under the pinned toolchain's cargo, which would otherwise be inherited.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO");
        let ended = log.run(&mut command)?;
        tally.check((!ended.success).then(|| format!("fuzz target {target} found an input that breaks it")));
    }
    Ok(tally)
}

pub(super) fn soak(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // The whole workspace is named so that what the cargo runner compiled serves here.
    let mut command = context.clone.cargo(["test", "--workspace", "--test", "soak"]);
    context.provide_worlds(&mut command)?;
    Ok(cargo::count(&log.run(command.env("CAIRN_SOAK_LATENTS", SOAK_LATENTS))?))
}
