//! AMD's ffx-api: the library's tests against the test double of AMD's libraries, and against AMD's own if this machine has them.

use std::fs;

use provision::Console;

use super::Context;
use super::amd::Amd;
use super::tally::Tally;
use super::{lab, recorder, windows_build};
use crate::shell::Log;
use crate::workspace;

/// The test programs.
const PROGRAMS: [&str; 10] = [
    "ffx",
    "ffx_amd",
    "ffx_frames",
    "ffx_interface",
    "ffx_mutants",
    "ffx_presenter",
    "ffx_swapchain",
    "ffx_swapchain_interface",
    "ffx_upscale",
    DRIVER,
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("AMD's ffx-api: loading, and providers of every release")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    let mut command = context.windows_tests(PROGRAMS, log)?;
    // A device of the C interface runs worlds too.
    let library = provision::onnxruntime_for_windows(&Console::new()).map_err(|e| e.to_string())?;
    command.env("CAIRN_ONNXRUNTIME", library);
    let own = Amd::own()?;
    if own.is_none() {
        windows_build::copy_descriptors(&mut command);
    }
    own.as_ref().unwrap_or(&Amd::None).provide(&mut command);
    tally.add(windows_build::run(&mut command, &[], log)?);
    with_double(context, log, &mut tally)?;
    Ok(tally)
}

/// File name of the double, and AMD's name for its frame generation library.
pub(super) const DOUBLE: &str = "ffx_double.dll";
pub(super) const AMD: &str = "amd_fidelityfx_framegeneration_dx12.dll";

/// Names of tests of two programs: what a presenter and the plugin for Unity do with AMD's libraries, including tests without
/// them.
const OVER_THE_DOUBLE: [&str; 4] = [
    "frames_continue_after_resizing_minimising_and_late_anchors",
    "small_anchors::shaders_generate_frames_too_small_for_amds_libraries",
    "a_device_time_budget_limits_generated_frames",
    "devices_come_and_go_and_nothing_of_them_is_kept",
];

/// The study's driver of AMD's libraries. It has one test, and its harness takes one name at most.
const DRIVER: &str = "fsr_driver";

/// The release that the double emulates: the one in AMD's SDK 2.0.
const ROLE: &str = "sdk 2.0\noffers 0xf600000000c01005 3.1.5\n";

/// Runs those tests with the double in place of AMD's libraries; the double must report no wrong call.
fn with_double(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let folder = context.workspace.target.join("xtask").join("ffx-double");
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    workspace::make_empty(&folder)?;
    fs::copy(context.windows_programs().join(DOUBLE), folder.join(AMD)).map_err(failed)?;
    fs::write(folder.join(format!("{AMD}.txt")), ROLE).map_err(failed)?;
    let mut command = context.windows_tests(["d3d12_presenter", "host"], log)?;
    context.provide_windows_worlds(&mut command)?;
    let double = Amd::Double(folder.clone());
    double.provide(&mut command);
    windows_build::copy_descriptors(&mut command);
    command.args(["--", "--exact"]).args(OVER_THE_DOUBLE);
    // Unity's test double uses the recorder's rules. The list's entries are for all tests of a program.
    let mut counted = recorder::run_tests(context, log, &mut command, &[], &double)?;
    let mut driver = context.windows_tests([DRIVER], log)?;
    double.provide(&mut driver);
    counted.add(windows_build::run(&mut driver, &[], log)?);
    let ran = counted.passed + counted.failures.len();
    tally.add(counted);
    let wanted = OVER_THE_DOUBLE.len() + 1;
    if ran != wanted {
        tally.failures.push(format!("{ran} tests ran over the double, not {wanted}"));
    }
    let lines = |name: &str| fs::read_to_string(folder.join(name)).unwrap_or_default().lines().count();
    tally.test((lines("calls.txt") == 0).then(|| "the double was never asked".to_owned()));
    let wrong_calls = lines("judgement.txt");
    tally.test((wrong_calls > 0).then(|| format!("{wrong_calls} calls of the double were not as they must be")));
    Ok(())
}
