//! Worlds on ONNX Runtime's WebGPU provider: in the lab, on its software Vulkan driver, or natively on Windows.

use super::tally::Tally;
use super::{Context, cargo, lab};
use crate::shell::Log;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    if let Some(skip) = lab::skip_unless_possible("worlds on WebGPU")? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    // Of the whole workspace, as in the runner `build`, so that no package is compiled again with other features.
    let mut command = context.workspace.cargo(["test", "--workspace", "--test", "webgpu"]);
    if !cfg!(windows) {
        lab::run_in_lab(&mut command, &cargo::host()?)?;
    }
    context.provide_webgpu_worlds(&mut command)?;
    // One at a time: each has worlds of its own in the memory of a device that the processor emulates.
    command.args(["--", "--test-threads=1"]);
    Ok(cargo::count(&log.run(&mut command)?))
}
