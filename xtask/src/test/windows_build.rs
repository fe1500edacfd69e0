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

/// The test programs that a runner runs on Windows. Others show nothing there that they do not show on this machine.
const TEST_PROGRAMS: [&str; 43] = [
    "callbacks",
    "check",
    "compare",
    "d3d12",
    "d3d12_drawer",
    "d3d12_flow",
    "d3d12_generator",
    "d3d12_hostile",
    "d3d12_interface",
    "d3d12_libraries",
    "d3d12_lifecycle",
    "d3d12_memory",
    "d3d12_prepare",
    "d3d12_presenter",
    "d3d12_residency",
    "d3d12_shaders",
    "d3d12_validation",
    "directml",
    "exchanged_states",
    "ffx",
    "ffx_amd",
    "ffx_frames",
    "ffx_interface",
    "ffx_mutants",
    "ffx_presenter",
    "ffx_swapchain",
    "ffx_swapchain_interface",
    "ffx_upscale",
    "fsr_driver",
    "half_precision",
    "host",
    "hostile",
    "joined",
    "lock_order",
    "media",
    "order",
    "program",
    "recorder",
    "rollout_budget",
    "rollout_state",
    "score",
    "sweep",
    "unload",
];

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
    /// Builds libraries, programs, these test programs and the example that shows a picture in the Unity test host, once; returns what cargo printed.
    pub(super) fn build_for_windows(&self, log: &mut Log) -> Result<&str, String> {
        let build = || {
            let mut command = self.workspace.cargo(["build"]);
            command.args(EVERYTHING).args(["--lib", "--bins", "--example", "show"]).args(tests_named(TEST_PROGRAMS));
            lab::for_windows(&mut command)?;
            let ended = log.run(&mut command)?;
            if !ended.success {
                return Err("the workspace does not build for Windows".to_owned());
            }
            Ok(ended.output)
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
        let programs: Vec<_> = programs.into_iter().collect();
        if let Some(other) = programs.iter().find(|program| !TEST_PROGRAMS.contains(program)) {
            return Err(format!("{other} is not among TEST_PROGRAMS in xtask/src/test/windows_build.rs"));
        }
        let mut command = self.workspace.cargo(["test", "--no-fail-fast"]);
        command.args(EVERYTHING).args(tests_named(programs));
        lab::for_windows(&mut command)?;
        Ok(command)
    }

    /// Builds the unit tests that can depend on the system; returns a command that runs them.
    pub(super) fn windows_unit_tests(&self, log: &mut Log) -> Result<Command, String> {
        self.build_for_windows(log)?;
        let unit_tests = |arguments: &[&str]| {
            let mut command = self.workspace.cargo(["test"]);
            command.args(arguments).args(WITH_UNIT_TESTS).arg("--lib");
            lab::for_windows(&mut command).map(|()| command)
        };
        if !log.run(&mut unit_tests(&["--no-run"])?)?.success {
            return Err("unit tests do not build for Windows".to_owned());
        }
        unit_tests(&["--no-fail-fast"])
    }
}

/// Arguments of cargo that choose these test programs.
fn tests_named<'a>(programs: impl IntoIterator<Item = &'a str>) -> impl Iterator<Item = &'a str> {
    programs.into_iter().flat_map(|program| ["--test", program])
}

/// Makes vkd3d, in the lab, copy the descriptors of a dispatch instead of binding whole heaps. Each heap is then not cleared descriptor by
/// descriptor, which takes up to two thirds of the time of programs that make frames. DirectML crashes with it, so programs with worlds run
/// without.
pub(super) fn copy_descriptors(command: &mut Command) {
    command.env("VKD3D_CONFIG", "virtual_heaps");
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
    let mut tally = Tally::default();
    tally.check(cargo::warning(&printed));
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
