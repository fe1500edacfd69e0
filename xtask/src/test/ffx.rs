//! AMD's ffx-api: the library's tests against the double that plays AMD's libraries, and against AMD's own where they are there.

use std::path::PathBuf;

use provision::Console;

use super::Context;
use super::tally::Tally;
use super::{cargo, lab};
use crate::shell::Log;

/// The folder of AMD's own libraries, which may not be redistributed.
const VARIABLE: &str = "CAIRN_FFX_DIR";

/// The test programs.
const PROGRAMS: [&str; 9] = [
    "ffx",
    "ffx_amd",
    "ffx_frames",
    "ffx_interface",
    "ffx_mutants",
    "ffx_presenter",
    "ffx_swapchain",
    "ffx_swapchain_interface",
    "ffx_upscale",
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::or_skip("AMD's ffx-api: loading, and providers of every release")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    // Together with the library, so that what both use is compiled once.
    let mut double = context.clone.cargo(["build", "--package", "cairn", "--package", "ffx-double", "--lib"]);
    lab::for_windows(&mut double)?;
    if !log.run(&mut double)?.success {
        return Err("the library that plays AMD's does not build".to_owned());
    }
    let mut command = context.clone.cargo(["test", "--package", "cairn", "--no-fail-fast"]);
    command.args(PROGRAMS.iter().flat_map(|program| ["--test", program]));
    lab::for_windows(&mut command)?;
    // A device of the C interface runs worlds as well.
    let library = provision::onnxruntime_for_windows(&Console::new()).map_err(|e| e.to_string())?;
    command.env("CAIRN_ONNXRUNTIME", library);
    if let Some(folder) = std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()) {
        let folder = std::path::absolute(PathBuf::from(folder)).map_err(|e| format!("{VARIABLE}: {e}"))?;
        command.env(VARIABLE, folder);
    }
    tally.add(cargo::count(&log.run(&mut command)?));
    Ok(tally)
}
