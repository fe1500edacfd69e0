//! The compiled shaders match their HLSL sources.

use std::fs;

use super::Context;
use super::tally::{Skip, Tally};
use crate::shaders::{FOLDERS, Shaders, output};
use crate::shell::Log;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    for folder in FOLDERS {
        check_folder(context, log, folder, &mut tally)?;
    }
    Ok(tally)
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
