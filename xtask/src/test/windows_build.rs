//! The workspace's programs for Windows, built once for all runners.
//!
//! Cargo unites the features of dependencies over the packages that a command chooses. Commands that choose other packages therefore compile
//! the same crates again, the library and `windows` among them. So every command for Windows chooses its packages here, and it is a failure
//! if one of them still compiles something.

use std::process::Command;

use provision::{Console, tools};

use super::tally::Tally;
use super::{Context, cargo, lab};
use crate::shell::{CommandOutput, Log};

/// Everything that runs on Windows; `xtask` needs packages that only building on this machine needs.
const EVERYTHING: [&str; 3] = ["--workspace", "--exclude", "xtask"];

/// The packages whose unit tests run on Windows, with those that need the same features as everything together.
const WITH_UNIT_TESTS: [&str; 10] = [
    "--package",
    "study",
    "--package",
    "cairn-unity",
    "--package",
    "ffx-double",
    "--package",
    "parity-trace",
    "--package",
    "d3d12-recorder",
];

impl Context<'_> {
    /// Builds libraries, programs, tests and the example that shows a picture in the Unity test host, once; returns what cargo printed.
    pub(super) fn build_for_windows(&self, log: &mut Log) -> Result<&str, String> {
        let build = || {
            let mut all = self.workspace.cargo(["build"]);
            all.args(EVERYTHING).args(["--lib", "--bins", "--test", "*", "--example", "show"]);
            let mut unit_tests = self.workspace.cargo(["test", "--no-run"]);
            unit_tests.args(WITH_UNIT_TESTS).arg("--lib");
            let mut printed = String::new();
            for command in [&mut all, &mut unit_tests] {
                lab::for_windows(command)?;
                let ended = log.run(command)?;
                if !ended.success {
                    return Err("the workspace does not build for Windows".to_owned());
                }
                printed.push_str(&ended.output);
            }
            Ok(printed)
        };
        self.built_for_windows.get_or_init(build).as_deref().map_err(String::clone)
    }

    /// A command that runs the test programs of these names. Libraries that they load, such as the test double of AMD's, are built before.
    pub(super) fn windows_tests<'a>(
        &self,
        programs: impl IntoIterator<Item = &'a str>,
        log: &mut Log,
    ) -> Result<Command, String> {
        self.build_for_windows(log)?;
        let mut command = self.workspace.cargo(["test", "--no-fail-fast"]);
        command.args(EVERYTHING).args(programs.into_iter().flat_map(|program| ["--test", program]));
        lab::for_windows(&mut command)?;
        Ok(command)
    }

    /// A command that runs the unit tests that can depend on the system.
    pub(super) fn windows_unit_tests(&self, log: &mut Log) -> Result<Command, String> {
        self.build_for_windows(log)?;
        let mut command = self.workspace.cargo(["test", "--no-fail-fast"]);
        command.args(WITH_UNIT_TESTS).arg("--lib");
        lab::for_windows(&mut command)?;
        Ok(command)
    }
}

/// Runs one of these commands. A name in `named` that matches no test is a failure.
pub(super) fn run(command: &mut Command, named: &[&str], log: &mut Log) -> Result<Tally, String> {
    Ok(judge(&log.run(command)?, named))
}

/// The counts of one of these commands that has run.
pub(super) fn judge(ended: &CommandOutput, named: &[&str]) -> Tally {
    let mut tally = cargo::count_named(ended, named);
    // Counted only if it fails: runners compare the number of tests with the expected one.
    tally.failures.extend(compiled_again(&ended.output));
    tally
}

/// The error if cargo compiled something, which [`Context::build_for_windows`] should have built.
fn compiled_again(output: &str) -> Option<String> {
    let compiled: Vec<&str> = output.lines().filter_map(|line| line.trim_start().strip_prefix("Compiling ")).collect();
    let last = compiled.last()?;
    Some(format!(
        "cargo compiled {} packages a second time, {last} the last: the packages of this command need other features than those of the build \
         for all of Windows (xtask/src/test/windows_build.rs)",
        compiled.len()
    ))
}

/// Links the workspace for Windows, and checks the library and the plugin.
pub(super) fn link(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let console = Console::new();
    tools::rust_target(tools::WINDOWS_TARGET, &console).map_err(|e| e.to_string())?;
    let printed = if cfg!(windows) || tools::mingw(&console).map_err(|e| e.to_string())? == tools::Mingw::Gcc {
        context.build_for_windows(log)?.to_owned()
    } else {
        // Zig can link the shipped DLLs, but not the test programs for the lab.
        let mut command = context.workspace.cargo(["zigbuild", "--lib", "--target", tools::WINDOWS_TARGET]);
        command.args(["--package", "cairn", "--package", "cairn-unity"]);
        tools::by_zig(&mut command, &console).map_err(|e| e.to_string())?;
        let ended = log.run(&mut command)?;
        if !ended.success {
            return Err("the library does not build for Windows".to_owned());
        }
        ended.output
    };
    let warnings = printed.lines().find(|line| line.starts_with("warning"));
    let mut tally = Tally::default();
    tally.check(warnings.map(|line| format!("the build warns: {line}")));
    for name in ["cairn.dll", "cairn_unity.dll"] {
        let dll = context.windows_programs().join(name);
        tally.check(match std::fs::read(&dll) {
            Ok(bytes) if bytes.starts_with(b"MZ") => None,
            Ok(_) => Some(format!("{} is no Windows library", dll.display())),
            Err(e) => Some(format!("{}: {e}", dll.display())),
        });
    }
    Ok(tally)
}

#[cfg(test)]
mod tests {
    use super::compiled_again;

    #[test]
    fn crates_that_are_compiled_twice_are_reported() {
        assert_eq!(compiled_again("    Finished `test` profile in 0.3s\n     Running tests/d3d12.rs\n"), None);
        let twice = "   Compiling windows v0.62.2\n   Compiling cairn v0.1.0 (/somewhere)\n    Finished\n";
        let error = compiled_again(twice).unwrap();
        assert!(error.contains("2 packages") && error.contains("cairn v0.1.0"), "{error}");
    }
}
