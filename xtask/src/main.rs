//! `cargo xtask`: the one place that knows how things are run in this clone. `cargo xtask help` is its manual.

mod abi;
mod book;
mod cli;
mod clone;
mod demo;
mod dist;
mod lab;
mod shaders;
mod shell;
mod test;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command, LabCommand};
use clone::Clone;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // What stands between a program and its caller is as little as can be.
    if let Command::Lab { command: Some(LabCommand::Run { command }) } = &cli.command
        && let [program, arguments @ ..] = command.as_slice()
    {
        return lab::run(program.as_ref(), arguments).unwrap_or_else(|why| failed(&why));
    }
    let result = Clone::find().and_then(|clone| match cli.command {
        Command::Lab { .. } => lab::build().map(|()| true),
        Command::Setup { all } => demo::setup(&clone, all).map(|()| true),
        Command::Demo { arguments } => demo::run(&clone, &arguments).map(|()| true),
        Command::Test(options) => test::run(&clone, &options),
        Command::Bench { lab: false, arguments } => demo::bench(&clone, &arguments).map(|()| true),
        Command::Bench { lab: true, arguments } => demo::bench_in_lab(&clone, &arguments).map(|()| true),
        Command::Dist(options) => dist::run(&clone, &options).map(|()| true),
        Command::Book => book::run(&clone).map(|()| true),
        Command::Shaders => shaders::compile(&clone).map(|()| true),
        Command::Fix { abi: true } => abi::fix(&clone).map(|()| true),
        Command::Fix { abi: false } => demo::fix(&clone).map(|()| true),
    });
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => failed(&why),
    }
}

fn failed(why: &str) -> ExitCode {
    eprintln!("\nerror: {why}");
    ExitCode::FAILURE
}
