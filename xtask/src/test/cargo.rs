//! Runners that are cargo commands.

use provision::{Console, tools};

use super::Context;
use super::tally::{Skip, Tally};
use crate::shell::{CommandOutput, Log};

/// The version of cargo-deny that `deny.toml` is written for.
pub(crate) const DENY_VERSION: &str = "0.20.2";

/// The fuzz targets' own workspace.
pub(super) const FUZZ: &str = "fuzz/Cargo.toml";

pub(super) fn fmt(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    tools::rust_component("rustfmt", "rustfmt", &Console::new()).map_err(|e| e.to_string())?;
    let ended = log.run(&mut context.workspace.cargo(["fmt", "--all", "--check"]))?;
    let fuzz = log.run(&mut context.workspace.cargo(["fmt", "--manifest-path", FUZZ, "--check"]))?;
    Ok(Tally::checked(ended.success && fuzz.success, "files are not formatted; cargo xtask fix does it"))
}

/// For this system and for Windows in one command, so that both processors have something to do.
pub(super) fn clippy(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    tools::rust_component("clippy", "cargo-clippy", &Console::new()).map_err(|e| e.to_string())?;
    tools::rust_target(tools::WINDOWS_TARGET, &Console::new()).map_err(|e| e.to_string())?;
    let mut command = context.workspace.cargo(["clippy", "--workspace", "--all-targets", "--target", &host()?]);
    if !cfg!(windows) {
        command.args(["--target", tools::WINDOWS_TARGET]);
    }
    let ended = log.run(command.args(["--", "-D", "warnings"]))?;
    let mut tally = Tally::checked(ended.success, "clippy has something to say");
    // The fuzz targets are a workspace of their own, which is compiled with `--thorough` only.
    let mut command = context.workspace.cargo(["tree", "--quiet", "--locked", "--manifest-path", FUZZ, "--depth", "0"]);
    let ended = log.run(&mut command)?;
    tally.check((!ended.success).then(|| "fuzz/Cargo.lock is not that of its manifest".to_owned()));
    Ok(tally)
}

/// This machine's target.
pub(super) fn host() -> Result<String, String> {
    let printed = crate::shell::output(std::process::Command::new("rustc").args(["--print", "host-tuple"]))?;
    Ok(printed.trim().to_owned())
}

/// Builds the libraries, programs and tests that the runners after this one use.
pub(super) fn build(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    tally.check(warning(context.build_programs(log)?));
    Ok(tally)
}

/// The error if a build printed a warning.
pub(super) fn warning(printed: &str) -> Option<String> {
    printed.lines().find(|line| line.starts_with("warning")).map(|line| format!("the build warns: {line}"))
}

/// For a target by name, as clippy, so that the dependencies that it checked are not checked a second time.
pub(super) fn docs(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut command = context.workspace.cargo(["doc", "--workspace", "--no-deps", "--target", &host()?]);
    let ended = log.run(command.env("RUSTDOCFLAGS", "-D warnings"))?;
    Ok(Tally::checked(ended.success, "the documentation has warnings"))
}

/// Test programs of the study and of the scenes, and their tests that take a minute or more, which run with `--thorough` only.
const LONG: [(&str, &str); 4] = [
    ("cadence", "a_quick_look_has_every_phase_of_every_cadence"),
    ("cast", "the_walk_meets_every_member_of_the_cast"),
    ("reconstruct", "both_sources_of_motion_beat_the_nearer_anchor"),
    ("world_quality", "a_quick_look_has_every_row_and_goes_on_where_it_was"),
];

pub(super) fn tests(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut command = test_command(context)?;
    // By full name: another test whose name contains one of them still runs, and so does a renamed one.
    command.args(["--", "--exact"]).args(LONG.iter().flat_map(|(_, test)| ["--skip", test]));
    Ok(count(&log.run(&mut command)?))
}

/// The tests that [`tests`] leaves out.
pub(super) fn long_tests(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let (programs, tests) = (LONG.map(|(program, _)| program), LONG.map(|(_, test)| test));
    let mut command = test_command(context)?;
    command.args(programs.iter().flat_map(|program| ["--test", program])).args(["--", "--exact"]).args(tests);
    Ok(count_named(&log.run(&mut command)?, &tests))
}

/// Cargo's command for tests of the workspace, without a choice.
fn test_command(context: &Context<'_>) -> Result<std::process::Command, String> {
    let mut command = context.workspace.cargo(["test", "--workspace", "--no-fail-fast"]);
    // As in `Context::build_programs`.
    if cfg!(windows) {
        command.args(["--exclude", "xtask"]);
    }
    context.provide_worlds(&mut command)?;
    context.provide_lpips(&mut command)?;
    Ok(command)
}

/// Sums up the output of the test programs of one cargo run.
pub(super) fn count(ended: &CommandOutput) -> Tally {
    let mut tally = Tally::default();
    for line in ended.output.lines() {
        if let Some(counts) = line.trim().strip_prefix("test result: ") {
            tally.passed += counted(counts, "passed");
        } else if let Some(test) = line.strip_prefix("test ") {
            if let Some(name) = test.strip_suffix(" ... FAILED") {
                tally.failures.push(name.trim().to_owned());
            } else if let Some((name, reason)) = test.split_once(" ... ignored") {
                // libtest writes `ignored, reason`, libtest_mimic `ignored (reason)`.
                let reason = reason.trim_start_matches([',', ' ']);
                let reason = reason.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')).unwrap_or(reason);
                let reason = if reason.is_empty() { "no reason given" } else { reason };
                tally.skips.push(Skip { name: name.trim().to_owned(), reason: reason.to_owned() });
            }
        }
    }
    if !ended.success && tally.failures.is_empty() {
        tally.failures.push("cargo test failed before a test could".to_owned());
    }
    tally
}

/// The same for a command that names tests or parts of their names. A name that matches no test is a failure: its tests have not
/// run.
pub(super) fn count_named(ended: &CommandOutput, names: &[&str]) -> Tally {
    let mut tally = count(ended);
    let ran: Vec<&str> = ended.output.lines().filter_map(test_name).collect();
    let missing = names.iter().filter(|name| !ran.iter().any(|test| test.contains(*name)));
    tally.failures.extend(missing.map(|name| format!("no test of the name {name} has run: was it renamed?")));
    tally
}

/// The test's name in a result line of libtest.
fn test_name(line: &str) -> Option<&str> {
    Some(line.strip_prefix("test ")?.split_once(" ... ")?.0.trim())
}

/// The number before `word` in `ok. 12 passed; 0 failed; ...`.
fn counted(counts: &str, word: &str) -> usize {
    let words: Vec<&str> = counts.split([' ', ';']).filter(|word| !word.is_empty()).collect();
    words.windows(2).find(|pair| pair[1] == word).and_then(|pair| pair[0].parse().ok()).unwrap_or(0)
}

pub(super) fn deny(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let program = tools::cargo_program("cargo-deny", DENY_VERSION, &Console::new()).map_err(|e| e.to_string())?;
    let mut tally = Tally::default();
    for rule in ["licenses", "bans", "sources"] {
        let mut command = std::process::Command::new(&program);
        let ended = log.run(command.args(["--locked", "check", rule]).current_dir(&context.workspace.root))?;
        tally.check((!ended.success).then(|| format!("deny.toml refuses a dependency ({rule})")));
    }
    Ok(tally)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(success: bool, output: &str) -> CommandOutput {
        CommandOutput { success, output: output.to_owned() }
    }

    #[test]
    fn sums_up_several_programs() {
        let tally = count(&ended(
            false,
            "running 3 tests\ntest a::b ... ok\ntest a::c ... FAILED\ntest a::d ... ignored, needs real-gpu\n\n\
             test result: FAILED. 1 passed; 1 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s\n\
             test result: ok. 12 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.00s\n",
        ));
        assert_eq!(tally.to_string(), "13 passed, 1 failed, 1 skipped");
        assert_eq!(tally.failures, ["a::c"]);
        assert_eq!(tally.skips[0], Skip { name: "a::d".to_owned(), reason: "needs real-gpu".to_owned() });
    }

    #[test]
    fn a_test_that_is_skipped_as_it_runs_is_a_skip_with_its_reason() {
        let output = "test of_amd    ... ignored (needs amd-dlls: none (yet))\ntest result: ok. 0 passed; 0 failed; 1 ignored;\n";
        let tally = count(&ended(true, output));
        let skip = Skip { name: "of_amd".to_owned(), reason: "needs amd-dlls: none (yet)".to_owned() };
        assert_eq!((tally.skips.as_slice(), tally.failures.len()), ([skip].as_slice(), 0));
    }

    #[test]
    fn a_name_without_a_test_is_a_failure() {
        let output = "test a::of_rollouts ... ok\ntest a::of_states - should panic ... ok\ntest result: ok. 2 passed; 0 failed;\n";
        let ended = ended(true, output);
        assert_eq!(count_named(&ended, &["a::of_rollouts", "of_states"]).to_string(), "2 passed, 0 failed, 0 skipped");
        let renamed = count_named(&ended, &["a::of_rollouts", "a::of_worlds"]);
        assert_eq!(renamed.failures, ["no test of the name a::of_worlds has run: was it renamed?"]);
    }

    #[test]
    fn a_warning_is_a_line_that_starts_with_the_word() {
        let built = "   Compiling cairn v0.1.0\n  a warning\n    Finished `dev` profile\n";
        assert_eq!(warning(built), None);
        let warned = format!("{built}warning: unused variable: `a`\n");
        assert_eq!(warning(&warned).as_deref(), Some("the build warns: warning: unused variable: `a`"));
    }

    #[test]
    fn a_failed_build_is_one_failure_and_no_test_makes_an_empty_tally() {
        assert_eq!(count(&ended(false, "error: could not compile")).failures.len(), 1);
        assert!(count(&ended(true, "test result: ok. 0 passed; 0 failed; 0 ignored;")).is_empty());
    }
}
