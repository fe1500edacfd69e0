//! The compiled shaders match their HLSL sources, and the library's sources also compile to valid SPIR-V.

use std::fs;

use provision::Console;

use super::Context;
use super::tally::{Skip, Tally};
use crate::shaders::{FOLDERS, LIBRARY, Shaders, output};
use crate::shell::Log;

/// Vulkan's version, whose rules SPIR-V must follow.
const VULKAN: &str = "vulkan1.1";
/// Binding numbers: HLSL counts registers of type b, t and u separately, SPIR-V counts all bindings of a set together. b starts at 0, t at 16
/// and u at 32.
const BINDINGS: [&str; 8] = [
    "--shift-cbuffer-binding",
    "0",
    "--shift-texture-binding",
    "16",
    "--shift-ssbo-binding",
    "32",
    "--shift-UAV-binding",
    "32",
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    for folder in FOLDERS {
        check_folder(context, log, folder, &mut tally)?;
    }
    check_spirv(context, log, &mut tally)?;
    Ok(tally)
}

/// Vulkan could run the same sources: each compiles to SPIR-V that the validator accepts.
fn check_spirv(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let name = "the shaders compiled to SPIR-V";
    if let Err(why) = provision::lab::possible() {
        tally.skips.push(Skip { name: name.to_owned(), reason: format!("needs lab: {why}") });
        return Ok(());
    }
    let console = Console::new();
    let tools = provision::lab::lab(&console).and_then(|lab| lab.spirv_tools(&console)).map_err(|e| e.to_string())?;
    let shaders = Shaders::find(context.workspace, LIBRARY)?;
    let out = context.workspace.target.join("xtask").join("spirv");
    fs::create_dir_all(&out).map_err(|e| format!("{}: {e}", out.display()))?;
    for name in &shaders.names {
        let module = out.join(format!("{name}.spv"));
        let mut compiler = tools.compiler();
        compiler.args(["-D", "-V", "-S", "comp", "-e", "main", "--target-env", VULKAN]).args(BINDINGS);
        let compiled = log.run(compiler.arg("-o").arg(&module).arg(shaders.source(name)))?;
        let mut validator = tools.validator();
        let is_valid = compiled.success && log.run(validator.args(["--target-env", VULKAN]).arg(&module))?.success;
        tally.check((!is_valid).then(|| format!("{name}.hlsl does not compile to valid SPIR-V")));
    }
    Ok(())
}

fn check_folder(context: &Context<'_>, log: &mut Log, folder: &'static str, tally: &mut Tally) -> Result<(), String> {
    let shaders = Shaders::find(context.workspace, folder)?;
    if shaders.names.is_empty() {
        return Err(format!("there is no shader in {folder}"));
    }
    for name in &shaders.names {
        tally.check(shaders.differs(name));
    }
    let left_over = shaders.left_over()?;
    tally.check(
        (!left_over.is_empty()).then(|| format!("blobs or record lines without a source: {}", left_over.join(", "))),
    );
    if !cfg!(windows)
        && let Err(why) = provision::lab::possible()
    {
        let name = format!("the shaders of {folder} compiled again");
        tally.skips.push(Skip { name, reason: format!("needs lab: {why}") });
        return Ok(());
    }
    let out = context.workspace.target.join("xtask").join("shaders");
    let ended = log.run(&mut shaders.compiler(context.workspace, &out)?)?;
    if !ended.success {
        return Err(format!("the shaders of {folder} do not compile"));
    }
    for name in &shaders.names {
        let same =
            fs::read(output(&out, name)).ok().is_some_and(|again| fs::read(shaders.blob(name)).ok() == Some(again));
        tally
            .check((!same).then(|| format!("{name}.dxbc is not what its source compiles to: run cargo xtask shaders")));
    }
    Ok(())
}
