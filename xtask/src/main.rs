//! `cargo xtask`: the only place that defines how builds, tests and tools of this repository are run. `cargo xtask help` is its manual.

mod abi;
mod book;
mod cli;
mod counts;
mod demo;
mod dist;
mod lab;
mod shaders;
mod shell;
mod test;
mod workspace;

use std::env;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command, LabCommand};
use workspace::Workspace;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // `lab run` does as little as possible between a program and its caller.
    if let Command::Lab { command: Some(LabCommand::Run { command }) } = &cli.command
        && let [program, arguments @ ..] = command.as_slice()
    {
        return lab::run(program.as_ref(), arguments).unwrap_or_else(|why| failed(&why));
    }
    let result = Workspace::find().and_then(|workspace| {
        remove_from_library_path(&workspace.target);
        run(&workspace, cli.command)
    });
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => failed(&why),
    }
}

fn run(workspace: &Workspace, command: Command) -> Result<bool, String> {
    match command {
        Command::Lab { .. } => lab::build().map(|()| true),
        Command::Setup { all } => demo::setup(workspace, all).map(|()| true),
        Command::Demo { arguments } => demo::run(workspace, &arguments).map(|()| true),
        Command::Test(options) => test::run(workspace, &options),
        Command::Bench { count: true, publish, .. } => counts::bench(workspace, publish).map(|()| true),
        Command::Bench { lab: false, arguments, .. } => demo::bench(workspace, &arguments).map(|()| true),
        Command::Bench { lab: true, arguments, .. } => demo::bench_in_lab(workspace, &arguments).map(|()| true),
        Command::Dist(options) => dist::run(workspace, &options).map(|()| true),
        Command::Book => book::run(workspace).map(|()| true),
        Command::Shaders => shaders::compile(workspace).map(|()| true),
        Command::Fix { abi: true } => abi::fix(workspace).map(|()| true),
        Command::Fix { abi: false } => demo::fix(workspace).map(|()| true),
    }
}

/// Removes folders below `target` from `LD_LIBRARY_PATH`. `cargo xtask` puts them first there, and the programs that a command starts would load the
/// library from them, and not the one that they were linked with or that lies beside them.
fn remove_from_library_path(target: &Path) {
    const VARIABLE: &str = "LD_LIBRARY_PATH";
    let Some(folders) = env::var_os(VARIABLE) else { return };
    let others = env::split_paths(&folders).filter(|folder| !folder.starts_with(target));
    if let Ok(others) = env::join_paths(others) {
        // SAFETY: no other thread has been started.
        unsafe { env::set_var(VARIABLE, others) };
    }
}

fn failed(why: &str) -> ExitCode {
    eprintln!("\nerror: {why}");
    ExitCode::FAILURE
}
