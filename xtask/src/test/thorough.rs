//! What takes minutes by intention: fuzzing, and the long soak.

use std::path::PathBuf;
use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::cargo;
use super::tally::{Skip, Tally};
use crate::shell::{Log, output};

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

/// The program of rollouts and queues against a library whose every access is watched, its standard library's too.
pub(super) fn races(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    const TARGET: &str = "x86_64-unknown-linux-gnu";
    let mut tally = Tally::default();
    let nightly = |arguments: &[&str]| {
        let mut command = Command::new("rustup");
        command.args(["run", "nightly"]).args(arguments).env_remove("RUSTUP_TOOLCHAIN").env_remove("CARGO");
        command
    };
    let sysroot = output(&mut nightly(&["rustc", "--print", "sysroot"])).map(|text| PathBuf::from(text.trim()));
    let rustlib = sysroot.unwrap_or_default().join("lib/rustlib");
    if !rustlib.join("src/rust/library").is_dir() {
        let reason = "no sources of nightly's standard library: rustup component add rust-src --toolchain nightly";
        tally.skips.push(Skip { name: "rollout under ThreadSanitizer".into(), reason: reason.into() });
        return Ok(tally);
    }
    let root = &context.clone.root;
    let target = context.clone.target.join("tsan");
    let mut build = nightly(&["cargo", "build", "-Zbuild-std", "--target", TARGET, "-p", "cairn", "--lib"]);
    build.current_dir(root).env("RUSTFLAGS", "-Zsanitizer=thread").env("CARGO_TARGET_DIR", &target);
    if !log.run(&mut build)?.success {
        return Err("the library does not build for ThreadSanitizer".to_owned());
    }
    let library = target.join(TARGET).join("debug");
    let program = target.join("rollout");
    let mut command = Command::new("gcc");
    // Objects that call the sanitizer, and the one runtime that the library's own instrumentation is made for.
    command.args(["-std=c11", "-g", "-D_GNU_SOURCE", "-fsanitize=thread", "-c", "-I"]).arg(root.join("include"));
    command.arg(root.join("tests/abi/rollout.c")).arg("-o").arg(program.with_extension("o"));
    let compiled = log.run(&mut command)?.success;
    let mut command = Command::new("gcc");
    command.arg(program.with_extension("o")).arg(library.join("libcairn.so")).arg("-Wl,--whole-archive");
    command.arg(rustlib.join(TARGET).join("lib/librustc-nightly_rt.tsan.a"));
    command.args(["-Wl,--no-whole-archive", "-Wl,--export-dynamic", "-lstdc++", "-lpthread", "-lm", "-ldl", "-lrt"]);
    command.arg(format!("-Wl,-rpath,{}", library.display())).arg("-o").arg(&program);
    if !compiled || !log.run(&mut command)?.success {
        return Err("the program does not link with ThreadSanitizer".to_owned());
    }
    // Its shadow memory needs addresses that are not random.
    let mut command = Command::new("setarch");
    let options = format!("suppressions={} exitcode=66", root.join("tests/abi/tsan.supp").display());
    command.arg("-R").arg(&program).current_dir(&target).env("TSAN_OPTIONS", options);
    context.provide_worlds(command.env("CAIRN_TEST_WORLD", context.bundle("tiny")?))?;
    let ended = log.run(&mut command)?;
    tally.passed += ended.output.lines().filter(|line| line.starts_with("test ") && line.ends_with(" ... ok")).count();
    tally.check((!ended.success).then(|| "ThreadSanitizer, or a test under it, has found something".to_owned()));
    Ok(tally)
}

pub(super) fn soak(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // The whole workspace is named so that what the cargo runner compiled serves here.
    let mut command = context.clone.cargo(["test", "--workspace", "--test", "soak", "--test", "soak_frames"]);
    context.provide_worlds(&mut command)?;
    Ok(cargo::count(&log.run(command.env("CAIRN_SOAK_LATENTS", SOAK_LATENTS).env("CAIRN_SOAK_FRAMES", SOAK_FRAMES))?))
}
