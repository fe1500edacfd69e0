//! Tests that need a nightly compiler: Miri for code without foreign calls, and ThreadSanitizer for the rest.

use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::cargo;
use super::tally::{Skip, Tally};
use crate::shell::{Log, output};

/// The modules whose tests run under Miri: all of the C interface that needs no ONNX Runtime, and the presentation clock.
const UNDER_MIRI: [&str; 3] = ["abi::", "present::pacing::", "present::timeline::"];

/// The target that ThreadSanitizer is run on.
const TARGET: &str = "x86_64-unknown-linux-gnu";

/// Miri detects undefined behaviour, data races and leaks.
pub(super) fn miri(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let toolchain = match tools::nightly(&["miri", "rust-src"], &Console::new()) {
        Ok(toolchain) => toolchain,
        Err(e) => return Ok(skipped("tests under Miri", &e)),
    };
    let mut command = tools::rustup_run(toolchain);
    // Miri interprets dependencies, so they are built into a folder of their own.
    command.args(["cargo", "miri", "test", "--package", "cairn", "--lib", "--"]).args(UNDER_MIRI);
    command.current_dir(&context.workspace.root).env("CARGO_TARGET_DIR", context.workspace.target.join("miri"));
    let ended = log.run(&mut command)?;
    let mut tally = cargo::count_named(&ended, &UNDER_MIRI);
    // Leaks are reported after the last test.
    if !ended.success && tally.failures.is_empty() {
        tally.failures.push("Miri has found something".to_owned());
    }
    Ok(tally)
}

/// Runs the C program of rollouts and queues against a library, and its standard library, built with ThreadSanitizer.
pub(super) fn races(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let name = "rollout under ThreadSanitizer";
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Ok(skipped(name, &format!("needs {TARGET}")));
    }
    let toolchain = match tools::nightly(&["rust-src"], &Console::new()) {
        Ok(toolchain) => toolchain,
        Err(e) => return Ok(skipped(name, &e)),
    };
    let sysroot = output(tools::rustup_run(toolchain).args(["rustc", "--print", "sysroot"]))?;
    let root = &context.workspace.root;
    let target = context.workspace.target.join("tsan");
    let mut build = tools::rustup_run(toolchain);
    build.args(["cargo", "build", "-Zbuild-std", "--target", TARGET, "--package", "cairn", "--lib"]);
    build.current_dir(root).env("RUSTFLAGS", "-Zsanitizer=thread").env("CARGO_TARGET_DIR", &target);
    if !log.run(&mut build)?.success {
        return Err("the library does not build for ThreadSanitizer".to_owned());
    }
    let library = target.join(TARGET).join("debug");
    let program = target.join("rollout");
    let mut command = Command::new("gcc");
    // Compiled with GCC's instrumentation, but linked with the sanitizer runtime that the Rust library was instrumented for.
    command.args(["-std=c11", "-g", "-D_GNU_SOURCE", "-fsanitize=thread", "-c", "-I"]).arg(root.join("include"));
    command.arg(root.join("tests/abi/rollout.c")).arg("-o").arg(program.with_extension("o"));
    let compiled = log.run(&mut command)?.success;
    let mut command = Command::new("gcc");
    command.arg(program.with_extension("o")).arg(library.join("libcairn.so")).arg("-Wl,--whole-archive");
    command.arg(format!("{}/lib/rustlib/{TARGET}/lib/librustc-nightly_rt.tsan.a", sysroot.trim()));
    command.args(["-Wl,--no-whole-archive", "-Wl,--export-dynamic", "-lstdc++", "-lpthread", "-lm", "-ldl", "-lrt"]);
    command.arg(format!("-Wl,-rpath,{}", library.display())).arg("-o").arg(&program);
    if !compiled || !log.run(&mut command)?.success {
        return Err("the program does not link with ThreadSanitizer".to_owned());
    }
    let mut command = Command::new("ldd");
    if !log.run(command.arg(&program))?.output.contains(&library.join("libcairn.so").display().to_string()) {
        return Err("the program would load another library than the one made for ThreadSanitizer".to_owned());
    }
    // ThreadSanitizer's shadow memory requires address space randomisation to be off.
    let mut command = Command::new("setarch");
    let options = format!("suppressions={} exitcode=66", root.join("tests/abi/tsan.supp").display());
    command.arg("-R").arg(&program).current_dir(&target).env("TSAN_OPTIONS", options);
    context.provide_worlds(command.env("CAIRN_TEST_WORLD", context.bundle("tiny")?))?;
    let ended = log.run(&mut command)?;
    let mut tally = Tally::default();
    tally.passed += ended.output.lines().filter(|line| line.starts_with("test ") && line.ends_with(" ... ok")).count();
    if tally.passed == 0 {
        tally.failures.push("no test of the program has run".to_owned());
    }
    if !ended.success {
        tally.failures.push("ThreadSanitizer, or a test under it, has found something".to_owned());
    }
    Ok(tally)
}

fn skipped(name: &str, why: &dyn std::fmt::Display) -> Tally {
    let mut tally = Tally::default();
    tally.skips.push(Skip { name: name.to_owned(), reason: why.to_string() });
    tally
}
